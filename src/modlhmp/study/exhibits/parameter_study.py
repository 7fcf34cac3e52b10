"""Figure parameter: ADE against beta and against r_s at several horizons, mean and one SD (paper Sec. V-B)."""

from pathlib import Path

import numpy as np
import pandas as pd

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import main_rows
from modlhmp.study.summary import read_errors, scored_horizons, summarise

NAMES = {"beta": "kernel parameter β", "sampling_radius_m": "sampling radius $r_s$ [m]"}


def draw(folders, dataset, method, chosen, horizons, stem):
    """One column a parameter, one row a protocol.

    `folders` hold {value}.parquet and are named after the parameter; `chosen` maps a parameter to the value that the
    other exhibits use, marked by a dotted line.
    """
    horizons = scored_horizons(horizons, dataset)
    rows = pd.concat([_summaries(Path(folder), dataset) for folder in folders], ignore_index=True)
    rows = rows[[any(np.isclose(h, horizons)) for h in rows["horizon_s"]]]
    parameters = [Path(folder).name for folder in folders]
    fig, axes = style.figure(2, len(parameters), height_mm=105.0, sharex="col", sharey=True)
    for line, protocol in enumerate(PROTOCOLS):
        for column, parameter in enumerate(parameters):
            ax = axes[line, column]
            one = rows[(rows["parameter"] == parameter) & (rows["protocol"] == protocol)]
            _panel(ax, one, horizons, chosen[parameter])
            ax.set_title(f"{protocol} protocol")
            if line == 1:
                ax.set_xlabel(NAMES[parameter])
        axes[line, 0].set_ylabel("ADE [m]")
    axes[0, 0].set_ylim(bottom=0)
    handles = [style.line_of(position) for position in range(len(horizons))]
    fig.legend(
        handles,
        [f"{horizon:g} s ({_counts(rows, horizon)})" for horizon in horizons],
        loc="outside lower center",
        ncols=2,
        title=f"{dataset['title']}, {method}: mean,\n"
        f"1 SD over tracks (thin bars) and over {rows['seeds'].max()} seeds (thick bars) by horizon;\n"
        "in brackets: n scored over the values / eligible, paper and complete protocol;\n"
        "dotted line: the value of the other exhibits",
        title_fontsize=6,
    )
    style.save(fig, stem, rows, dataset["demo"])


def _summaries(folder, dataset):
    """Rows of `results.csv` for every value of a parameter, the main output only."""
    tables = []
    for file in sorted(folder.glob("*.parquet"), key=lambda file: float(file.stem)):
        table = summarise(dataset["name"], folder.name, read_errors(file), dataset["time_step_s"])
        tables.append(main_rows(table).assign(value=float(file.stem)))
    return pd.concat(tables, ignore_index=True).rename(columns={"method": "parameter"})


def _panel(ax, rows, horizons, chosen):
    values = sorted(rows["value"].unique())
    place = {value: index for index, value in enumerate(values)}  # evenly spaced: the values are chosen, not measured
    for position, horizon in enumerate(horizons):
        curve = rows[np.isclose(rows["horizon_s"], horizon)].sort_values("value")
        x = curve["value"].map(place) + 0.08 * (position - (len(horizons) - 1) / 2)
        look = style.method_style(position)
        ax.plot(x, curve["ade_m"], **look)
        mean, sd, seed_sd = (curve[name].to_numpy(float) for name in ("ade_m", "ade_sd_m", "ade_seed_sd_m"))
        low = np.minimum(np.nan_to_num(sd), mean)  # an error is not negative
        ax.errorbar(x, mean, [low, np.nan_to_num(sd)], fmt="none", ecolor=look["color"], elinewidth=0.4, alpha=0.7)
        ax.errorbar(x, mean, np.nan_to_num(seed_sd), fmt="none", ecolor=look["color"], elinewidth=2.0, alpha=0.7)
    if chosen in place:
        ax.axvline(place[chosen], color="0.3", linewidth=0.6, linestyle=":")
    ax.set_xticks(range(len(values)), [f"{value:g}" for value in values])


def _counts(rows, horizon):
    """`n` lowest-highest over the values, of the eligible tracks, for each protocol."""
    texts = []
    for protocol in PROTOCOLS:
        one = rows[(rows["protocol"] == protocol) & np.isclose(rows["horizon_s"], horizon)]
        low, high = round(one["n"].min()), round(one["n"].max())
        texts.append(f"{low}/{one['eligible'].max()}" if low == high else f"{low}–{high}/{one['eligible'].max()}")
    return ", ".join(texts)
