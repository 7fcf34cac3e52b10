"""Figure training-share: ADE against the share of the training tracks that maps are built from (not in the paper)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import main_rows
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_errors, summarise


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    titles: Mapping[str, str],
    shares: Sequence[float],
    horizons: Mapping[str, Sequence[float]],
) -> None:
    """One row of panels per dataset, one column per horizon (its three longest), one line per method.

    Complete protocol. `titles` maps the methods' names to their titles; `shares` are of the training tracks, `horizons`
    [s] are those of the ladder by dataset.
    """
    rows = pd.concat([_summaries(layout, dataset, titles, shares) for dataset in datasets], ignore_index=True)
    fig, axes = style.figure(len(datasets), 3, style.PAGE_MM, 56.0 * len(datasets) + 8, sharex=True)
    for line, dataset in zip(axes, datasets, strict=True):
        drawn = horizons[dataset.name][-3:]
        for panel, horizon in zip(line, drawn, strict=False):
            here = rows[(rows["dataset"] == dataset.name) & np.isclose(rows["horizon_s"], horizon)]
            for position, method in enumerate(titles):
                curve = here[here["method"] == method].sort_values("share")
                panel.plot(100 * curve["share"], curve["ade_m"], **style.method_style(position))
            panel.set_xscale("log")
            style.plain_numbers(panel.xaxis)
            panel.set_ylim(bottom=0)
            n = here["n"].max() if len(here) else 0
            panel.set_title(f"{dataset.title}\n{horizon:g} s (n = {n:.0f})", loc="left")
        for panel in line[len(drawn) :]:
            panel.set_axis_off()
        line[0].set_ylabel("ADE [m]")
    for panel in axes[-1]:
        panel.set_xlabel("training tracks used [%]")
    handles = [style.line_of(position) for position in range(len(titles))]
    style.legend_below(fig, handles, list(titles.values()), "", most=5)
    style.save(fig, stem, rows, any(dataset.demo for dataset in datasets))


def _summaries(layout, dataset, titles, shares):
    """Rows of `results.csv` for every method and share, the main output under the complete protocol."""
    tables = []
    for method in titles:
        for share in sorted(shares):
            errors = read_errors(layout.training_share(dataset.name, method, share))
            table = summarise(dataset.name, method, errors, dataset.time_step_s)
            table = main_rows(table[table["protocol"] == "complete"])
            tables.append(table.assign(share=float(share)))
    return pd.concat(tables, ignore_index=True)
