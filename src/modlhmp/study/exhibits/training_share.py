"""Figure training-share: ADE against the share of the training tracks that maps are built from (not in the paper)."""

from pathlib import Path

import numpy as np
import pandas as pd

from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import main_rows
from modlhmp.study.summary import read_errors, scored_horizons, summarise


def draw(folders, datasets, titles, horizons, stem):
    """One row of panels a dataset, one column a horizon (its three longest), a line a method; complete protocol.

    `folders` hold {method}/{share}.parquet, in the order of `datasets`.
    """
    rows = pd.concat(
        [_summaries(Path(f), d, titles) for f, d in zip(folders, datasets, strict=True)], ignore_index=True
    )
    fig, axes = style.figure(len(datasets), 3, style.PAGE_MM, 52.0 * len(datasets) + 8, sharex=True)
    for line, dataset in zip(axes, datasets, strict=True):
        drawn = scored_horizons(horizons, dataset)[-3:]
        for panel, horizon in zip(line, drawn, strict=False):
            here = rows[(rows["dataset"] == dataset["name"]) & np.isclose(rows["horizon_s"], horizon)]
            for position, method in enumerate(titles):
                curve = here[here["method"] == method].sort_values("share")
                panel.plot(100 * curve["share"], curve["ade_m"], **style.method_style(position))
            panel.set_xscale("log")
            panel.set_ylim(bottom=0)
            n = here["n"].max() if len(here) else 0
            panel.set_title(f"{dataset['title']}: {horizon:g} s (n = {n:.0f})", loc="left")
        for panel in line[len(drawn) :]:
            panel.set_axis_off()
        line[0].set_ylabel("ADE [m]")
    for panel in axes[-1]:
        panel.set_xlabel("training tracks used [%]")
    handles = [style.line_of(position) for position in range(len(titles))]
    fig.legend(handles, list(titles.values()), loc="outside lower center", ncols=len(titles))
    style.save(fig, stem, rows, any(dataset["demo"] for dataset in datasets))


def _summaries(folder, dataset, titles):
    """Rows of `results.csv` for every method and share, the main output under the complete protocol."""
    tables = []
    for method in titles:
        for file in sorted((folder / method).glob("*.parquet")):
            table = summarise(dataset["name"], method, read_errors(file), dataset["time_step_s"])
            table = main_rows(table[table["protocol"] == "complete"])
            tables.append(table.assign(share=float(file.stem)))
    return pd.concat(tables, ignore_index=True)
