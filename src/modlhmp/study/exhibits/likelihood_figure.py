"""Figure likelihood: how much a map tells, hour by hour (not in the paper)."""

from collections.abc import Mapping, Sequence

import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits import style
from modlhmp.study.layout import Layout
from modlhmp.study.likelihood import ALL_HOURS, NO_MAP, SPACES, TITLES

ROW_MM, BELOW_MM = 46.0, 12.0
COLUMNS = ("space", "map", "hour", "gain", "dataset")  # of the numbers, where no dataset has any
NAMES = {"joint": "headings and speeds", "heading": "headings alone"}


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, titles: Mapping[str, str]) -> None:
    """One row per dataset: gain over no map by clock hour, of headings with speeds, and of headings alone."""
    titles = dict(titles) | TITLES
    fig, axes = style.figure(len(datasets), len(SPACES), style.PAGE_MM, ROW_MM * len(datasets) + BELOW_MM, sharey="row")
    tables, names = [], []
    for line, dataset in zip(axes, datasets, strict=True):
        if dataset.clock == "unknown":
            for ax in line:
                style.empty_panel(ax, f"{dataset.title}: {lacks.NO_CLOCK}")
            continue
        table = read_parquet(layout.likelihood(dataset.name, "scores")).to_pandas()
        table = table[(table["accounting"] == "background") & (table["hour"] != ALL_HOURS) & (table["map"] != NO_MAP)]
        tables.append(table.assign(dataset=dataset.name))
        for ax, space in zip(line, SPACES, strict=True):
            for name, group in table[table["space"] == space].groupby("map", sort=False):
                names += [name] if name not in names else []
                ax.plot(group["hour"], group["gain"], **style.method_style(names.index(name)))
            ax.axhline(0.0, color="0.55", linewidth=0.6)
            ax.set(title=f"{dataset.title}, {NAMES[space]}", xlabel="hour of the day")
        line[0].set_ylabel("gain over no map [nat]")
    if names:
        lines = [style.line_of(place) for place in range(len(names))]
        style.legend_below(fig, lines, [titles[name] for name in names], "map, with its background", 4)
    table = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=list(COLUMNS))
    style.save(fig, stem, table, any(one.demo for one in datasets))
