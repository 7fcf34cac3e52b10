"""Figure calibration: is a method's real error what it expects, and do people leave as often as it says?"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.study import lacks
from modlhmp.study.comparisons import clusters
from modlhmp.study.exhibits import style
from modlhmp.study.layout import Layout
from modlhmp.study.reliability import calibration, read_uncertainty, reliability

ROW_MM, BELOW_MM = 46.0, 20.0
FEW = 5  # tracks; bins with fewer are drawn hollow
EXACT: style.Look = {"color": "0.55", "linewidth": 0.6, "zorder": 1}


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    methods: Mapping[str, str],
    measured: Sequence[str],
    days: Mapping[str, Mapping[str, str]],
) -> None:
    """One row per dataset: expected against real error, probability against share of having left; two horizons each.

    `methods` maps names to titles in table order, `measured` are those with a file, `days` maps datasets to their test
    recordings' days. The CSV has all horizons.
    """
    fig, axes = style.figure(len(datasets), 4, style.PAGE_MM, ROW_MM * len(datasets) + BELOW_MM)
    tables = []
    for line, dataset in zip(axes, datasets, strict=True):
        table = bins_of(layout, dataset, measured, days[dataset.name])
        horizons = shown_horizons(sorted(table["horizon_s"].unique()), dataset.horizon_s)
        for what, places in (("error", line[:2]), ("left", line[2:])):
            for ax in places[len(horizons) :]:
                ax.set_axis_off()
            for ax, horizon in zip(places, horizons, strict=False):
                one = table[(table["what"] == what) & (table["horizon_s"] == horizon)]
                _panel(ax, one, what, methods, f"{dataset.title}, {horizon:g} s")
        tables.append(table)
    handles = [style.line_of(list(methods).index(method)) for method in measured]
    handles.append(style.plt.Line2D([], [], **EXACT))
    note = (
        "Means in ten bins, bars: their 95 % intervals; hollow: fewer than five tracks.\n"
        "Errors: bins of equally many tracks; above the line, a method is too sure of itself; "
        "those of one sample alone are in no bin.\n"
        "Having left: bins of equally wide probability; above the line, more people have left than announced."
    )
    style.legend_below(fig, handles, [*(methods[method] for method in measured), "as announced"], note, most=5)
    style.save(fig, stem, pd.concat(tables, ignore_index=True), any(dataset.demo for dataset in datasets))


def bins_of(layout: Layout, dataset: Dataset, measured: Sequence[str], days: Mapping[str, str]) -> pd.DataFrame:
    """Bins of every measured method and horizon of a dataset, as one table; `what`: `error` [m] or `left`."""
    tables = []
    for method in measured:
        horizons, by_track, person = read_uncertainty(layout.uncertainty(dataset.name, method))
        cluster = clusters(person, days)
        for column, horizon in enumerate(horizons):
            at = {name: one[:, column] for name, one in by_track.items()}
            both = {
                "error": calibration(at["expected_m"], at["real_m"], cluster),
                "left": reliability(at["left"], at["has_left"], cluster),
            }
            whose: dict[str, Any] = {"dataset": dataset.name, "method": method, "horizon_s": horizon}
            tables += [bins.assign(**whose, what=what) for what, bins in both.items()]
    return pd.concat(tables, ignore_index=True)


def shown_horizons(horizons: Sequence[float], longest: float) -> list[float]:
    """The longest of the horizons, and of the others the one nearest to a third of the dataset's."""
    return [*sorted(horizons[:-1], key=lambda horizon: abs(horizon - longest / 3))[:1], horizons[-1]]


def _panel(ax, table, what, methods, title):
    if table.empty:
        style.empty_panel(ax, f"{title}\n{lacks.NOT_AS_LONG}")
        return
    high = 1.0
    if what == "error":
        high = max(table["forecast"].max(), table["outcome"].max())
    ax.plot([0, high], [0, high], **EXACT)
    for method, bins in table.groupby("method"):
        look = style.method_style(list(methods).index(method))
        ax.plot(bins["forecast"], bins["outcome"], linewidth=0.7, **{**look, "marker": "none"})
        for some, face in ((bins[bins["n"] >= FEW], look["color"]), (bins[bins["n"] < FEW], "white")):
            marks = {**look, "linestyle": "none", "markeredgewidth": 0.6, "markerfacecolor": face}
            ax.plot(some["forecast"], some["outcome"], **marks, zorder=3)
        half = (bins["high"] - bins["outcome"]).fillna(0)
        low = np.minimum(half, bins["outcome"])  # neither errors nor shares are negative
        bars = {"ecolor": look["color"], "elinewidth": 0.5, "alpha": 0.4}
        ax.errorbar(bins["forecast"], bins["outcome"], [low, half], fmt="none", **bars)
    limits = (-0.03 * high, 1.03 * high)
    ax.set(xlim=limits, ylim=limits, aspect="equal", title=title)
    if what == "error":
        ax.set(xlabel="expected error [m]", ylabel="real error [m]")
    else:
        ax.set(xlabel="probability of having left", ylabel="share that has left")
