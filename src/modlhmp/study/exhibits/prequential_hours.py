"""Figure prequential: how maps that are updated foretell the next hour, and follow a reversal (not in the paper)."""

from collections.abc import Mapping, Sequence

import pandas as pd
from matplotlib.axes import Axes

from modlhmp.datasets import Dataset
from modlhmp.study import lacks, prequential
from modlhmp.study.exhibits import style
from modlhmp.study.layout import Layout
from modlhmp.tracks import read_people

PARTS = ("as recorded", "planted: the half that turns round", "planted: the other half")
COLUMNS = ["dataset", "part", "number", "hour", "map", "nll", "covered", "n"]


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, recordings: Mapping[str, Sequence[str]]) -> None:
    """One row per dataset: the hours as they were, and both halves of the planted reversal; one line per map.

    `recordings` are the training recordings of each dataset by its name.
    The last rows of the numbers, without an hour, are over all hours as recorded.
    """
    fig, axes = style.figure(len(datasets), len(PARTS), style.PAGE_MM, 46.0 * len(datasets))
    tables = [
        _row(line, layout, dataset, recordings[dataset.name]) for line, dataset in zip(axes, datasets, strict=True)
    ]
    names = [*prequential.MAPS, prequential.NO_MAP]
    note = "Each hour is scored with what was known before it; dotted: the hour from which half of the place is turned."
    style.legend_below(fig, [style.line_of(position) for position in range(len(names))], names, note, most=7)
    style.save(fig, stem, pd.concat(tables, ignore_index=True), any(dataset.demo for dataset in datasets))


def _row(line: Sequence[Axes], layout: Layout, dataset: Dataset, recordings: Sequence[str]) -> pd.DataFrame:
    """Draw one dataset's panels; returns their numbers."""
    if dataset.clock == "unknown":
        return _nothing(line, dataset, lacks.NO_CLOCK)
    tracks, person = read_people([layout.tracks(dataset.name, name) for name in recordings])
    table, overall = prequential.scores(tracks, dataset, person=person)
    if table.empty:
        return _nothing(line, dataset, lacks.ONE_HOUR)
    people, half, turn = prequential.planted(tracks, dataset.timezone)
    reversal, _ = prequential.scores(people, dataset, half)
    shown = [table, *(reversal[reversal["part"] == part] for part in (1, 0))]
    for panel, one, title in zip(line, shown, PARTS, strict=True):
        for position, (_, curve) in enumerate(one.groupby("map", sort=False)):
            panel.plot(curve["number"], curve["nll"], clip_on=False, **style.method_style(position))
        hours = one.drop_duplicates("number")  # the planted rows may lack an hour, and then count without it
        hours = hours[:: max(len(hours) // 6, 1)]
        panel.set_xticks(hours["number"], hours["hour"])
        panel.set_title(f"{dataset.title}: {title}" if title == PARTS[0] else title)
        panel.set(xlabel="clock hour", ylabel="negative log density [nat]" if title == PARTS[0] else None)
        if title != PARTS[0]:
            panel.axvline(turn, color="0.4", linestyle=":", linewidth=0.8)
    named = [one.assign(dataset=dataset.name, part=title) for one, title in zip(shown, PARTS, strict=True)]
    return pd.concat([*named, overall.assign(dataset=dataset.name, part="all hours as recorded")], ignore_index=True)


def _nothing(line: Sequence[Axes], dataset: Dataset, why: lacks.Lack) -> pd.DataFrame:
    """Empty panels that say why; returns no numbers."""
    for panel in line:
        style.empty_panel(panel, f"{dataset.title}: {why}")
    return pd.DataFrame(columns=COLUMNS)
