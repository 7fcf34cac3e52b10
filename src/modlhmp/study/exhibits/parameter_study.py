"""Figure parameter: ADE against beta and against r_s at several horizons, mean and one SD (paper Sec. V-B)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import main_rows
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_errors, summarise

NAMES = {"beta": "kernel parameter β", "sampling_radius_m": "sampling radius $r_s$ [m]"}


def draw(
    layout: Layout,
    dataset: Dataset,
    stem: str,
    method: str,
    values: Mapping[str, Sequence[float]],
    chosen: Mapping[str, float],
    horizons: Sequence[float],
) -> None:
    """One column per parameter, one row per protocol.

    `method` is the title of the studied one; `values` are those that were tried of each parameter, `chosen` those that
    the other exhibits use, marked by a dotted line; `horizons` [s] are the dataset's of the tables.
    """
    rows = pd.concat([_summaries(layout, dataset, name, tried) for name, tried in values.items()], ignore_index=True)
    rows = rows[[any(np.isclose(h, horizons)) for h in rows["horizon_s"]]]
    fig, axes = style.figure(2, len(values), height_mm=105.0, sharex="col", sharey=True)
    for line, protocol in enumerate(PROTOCOLS):
        for column, parameter in enumerate(values):
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
        title=f"{dataset.title}, {method}: mean,\n"
        f"1 SD over tracks (thin bars) and over {rows['seeds'].max()} seeds (thick bars) by horizon;\n"
        "in brackets: n scored over the values / eligible, paper and complete protocol;\n"
        "dotted line: the value of the other exhibits",
        title_fontsize=6,
    )
    style.save(fig, stem, rows, dataset.demo)


def _summaries(layout, dataset, parameter, values):
    """Rows of `results.csv` for every value of a parameter, the main output only."""
    tables = []
    for value in sorted(values):
        errors = read_errors(layout.study_value(dataset.name, parameter, value))
        table = summarise(dataset.name, parameter, errors, dataset.time_step_s)
        tables.append(main_rows(table).assign(value=float(value)))
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
