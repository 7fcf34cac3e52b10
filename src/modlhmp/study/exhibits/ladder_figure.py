"""Figure ladder: the error of every rung from the paper's configuration to the best one (not in the paper)."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits.style import PAGE_MM, empty_panel, figure, save
from modlhmp.study.layout import Layout

DRAWN = 3  # panels per dataset: the longest horizons
COLOURS = {"ours": "#0072B2", "before": "#7F7F7F", "reference": "#D55E00"}


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    rungs: Sequence[str],
    reference: str,
    titles: Mapping[str, str],
    with_memory: Collection[str],
) -> None:
    """Draw the ADE of every rung with its interval: one row of panels per dataset, one column per horizon.

    `rungs` are the methods from the paper's to the best, `reference` the one that all are compared with, `titles` map
    them to their titles, `with_memory` names those of them whose maps have it. Intervals are of single rungs and far
    wider than the paired ones of the table.
    """
    scored = pd.concat(
        [read_parquet(layout.ladder(dataset.name, "scores")).to_pandas() for dataset in datasets], ignore_index=True
    )
    complete = scored[(scored["protocol"] == "complete") & scored["method"].isin([*rungs, reference])]
    names = [dataset.name for dataset in datasets]
    horizons = {name: sorted(set(complete.loc[complete["dataset"] == name, "horizon_s"]))[-DRAWN:] for name in names}
    columns = max(map(len, horizons.values()))
    fig, axes = figure(len(names), columns, PAGE_MM, (14 + 4.0 * len(rungs)) * len(names))
    colours = {method: COLOURS["ours" if method in with_memory else "before"] for method in rungs}
    colours[reference] = COLOURS["reference"]
    for line, dataset in zip(axes, datasets, strict=True):
        mine = complete[complete["dataset"] == dataset.name]
        for panel, horizon in zip(line, horizons[dataset.name], strict=False):
            at = mine[mine["horizon_s"] == horizon].set_index("method")
            panel.set_yticks(np.arange(len(rungs))[::-1], [])
            if not at.loc[list(rungs), "n"].any():
                empty_panel(panel, f"{dataset.title}: {lacks.NO_TRACK.text.format(horizon=horizon)}")
                continue
            _panel(panel, at.loc[list(rungs)], at.loc[reference, "ade_m"], colours)
            panel.set_title(f"{dataset.title}: {horizon:g} s", loc="left")
        line[0].set_yticklabels([titles[method] for method in rungs])
        for panel in line[len(horizons[dataset.name]) :]:
            panel.set_axis_off()
    save(fig, stem, scored, any(dataset.demo for dataset in datasets))


def _panel(panel, at, reference_m, colours):
    """The rungs at one horizon from top to bottom: `at` is indexed by method, `reference_m` [m] is a dotted line."""
    place = np.arange(len(at))[::-1]
    panel.plot(at["ade_m"], place, color="0.6", linewidth=0.8, zorder=1)
    for y, (method, rung) in zip(place, at.iterrows(), strict=True):
        panel.plot([rung["ade_low_m"], rung["ade_high_m"]], [y, y], color=colours[method], linewidth=2, alpha=0.35)
        panel.plot(rung["ade_m"], y, "o", color=colours[method], markersize=3.5)
        right = np.nanmax([rung["ade_m"], rung["ade_high_m"]])
        panel.annotate(f"{rung['ade_m']:.2f}", (right, y), (4, 0), textcoords="offset points", va="center",
                       fontsize=5.5, color=colours[method])  # fmt: skip
    panel.axvline(reference_m, color=COLOURS["reference"], linewidth=0.6, linestyle=":", zorder=0)
    panel.set(xlim=(0, 1.2 * np.nanmax([at["ade_m"], at["ade_high_m"]])), ylim=(-0.7, len(at) - 0.3))
    panel.set_xlabel(f"ADE [m], n = {at['n'].iloc[0]:g}")
