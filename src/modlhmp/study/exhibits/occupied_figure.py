"""Figure occupied: are cells occupied as often as was said? (not in the paper)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.artist import Artist

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits import style
from modlhmp.study.layout import Layout
from modlhmp.study.occupied import CLOSE, ENOUGH, reliability_of

MOST_PANELS = 4
ROW_MM, BELOW_MM = 46.0, 20.0
EXACT: style.Look = {"color": "0.55", "linewidth": 0.6, "zorder": 1}
NEAR: style.Look = {"color": "0.92", "linewidth": 0, "zorder": 0}


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    titles: Mapping[str, str],
    horizons: Mapping[str, Sequence[float]],
) -> None:
    """One row per dataset, a panel for each of the first horizons [s]; `titles` are the methods' by name.

    The CSV has every moment that was measured.
    """
    fig, axes = style.figure(len(datasets), MOST_PANELS, style.PAGE_MM, ROW_MM * len(datasets) + BELOW_MM)
    tables = []
    for line, dataset in zip(axes, datasets, strict=True):
        table = reliability_of(read_parquet(layout.occupied(dataset.name, "bins")).to_pandas())
        shown = list(horizons[dataset.name])[:MOST_PANELS]
        for ax in line[len(shown) :]:
            ax.set_axis_off()
        for ax, horizon_s in zip(line, shown, strict=False):
            _panel(ax, table[np.isclose(table["horizon_s"], horizon_s)], titles, f"{dataset.title}, {horizon_s:g} s")
        table.insert(0, "dataset", dataset.name)
        tables.append(table)
    handles: list[Artist] = [style.line_of(place) for place in range(len(titles))]
    handles += [style.plt.Line2D([], [], **EXACT), style.plt.Rectangle((0, 0), 1, 1, **NEAR)]
    note = (
        "Cells of 1 m in ten bins of their probability. Bars: 95 % of the share, cells of a half-hour and of a "
        f"place together; hollow: fewer than {ENOUGH} cells."
    )
    style.legend_below(fig, handles, [*titles.values(), "as announced", f"within {CLOSE:g}"], note, most=5)
    style.save(fig, stem, pd.concat(tables, ignore_index=True), any(dataset.demo for dataset in datasets))


def _panel(ax, table, titles, title):
    if table.empty:
        style.empty_panel(ax, f"{title}\n{lacks.NOBODY}")
        return
    ends = np.array([0.0, 1.0])
    ax.fill_between(ends, ends - CLOSE, ends + CLOSE, **NEAR)
    ax.plot(ends, ends, **EXACT)
    for place, method in enumerate(titles):
        bins = table[table["method"] == method]
        look = style.method_style(place)
        ax.plot(bins["forecast"], bins["outcome"], linewidth=0.7, **{**look, "marker": "none"})
        for some, face in ((bins[bins["n"] >= ENOUGH], look["color"]), (bins[bins["n"] < ENOUGH], "white")):
            marks = {**look, "linestyle": "none", "markeredgewidth": 0.6, "markerfacecolor": face}
            ax.plot(some["forecast"], some["outcome"], **marks, zorder=3)
        half = bins["half"].fillna(0)
        low, high = np.minimum(half, bins["outcome"]), np.minimum(half, 1 - bins["outcome"])  # it is a share
        bars = {"ecolor": look["color"], "elinewidth": 0.5, "alpha": 0.4}
        ax.errorbar(bins["forecast"], bins["outcome"], [low, high], fmt="none", **bars)
    ax.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), aspect="equal", title=title)
    ax.set(xlabel="probability of a cell", ylabel="share that was occupied")
