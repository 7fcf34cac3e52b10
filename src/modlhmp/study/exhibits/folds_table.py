"""Table folds: methods that never saw whom the test persons walked among, over all folds (not in the paper)."""

from collections.abc import Iterable, Mapping, Sequence

import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.study.exhibits.ladder_table import difference_cell, errors_cell, row_of
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.exhibits.words import OVER, SEED_MEANS
from modlhmp.study.ladder import differences, scores
from modlhmp.study.layout import Layout
from modlhmp.study.summary import ErrorsByOutput, at_horizons, joined

NOTE = (
    f"Errors are ADE / FDE in m, {SEED_MEANS} over the tracks of all folds, complete protocol; then, on the same "
    f"tracks, ADE less that of {{reference}} with its 95 % interval ({OVER}). "
    "The paper protocol is at the right. Options are those of the dataset files."
)


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    methods: Mapping[str, str],
    reference: str,
    horizons: Mapping[str, Sequence[float]],
    days: Mapping[str, Mapping[str, str]],
) -> None:
    """One row per dataset and method.

    `methods` maps names to titles, `horizons` [s] datasets' names to theirs, `days` to their test recordings'
    days.
    """
    rows: list[dict[str, str]] = []
    for title in dict.fromkeys(one.fold_of for one in datasets):
        parts = [one for one in datasets if one.fold_of == title]
        shown = horizons[parts[0].name]
        step_s = parts[0].time_step_s
        errors = {
            method: pooled(at_horizons(layout.errors(one.name, method), shown, step_s) for one in parts)
            for method in methods
        }
        own = {recording: day for one in parts for recording, day in days[one.name].items()}
        rows += _rows(title, errors, shown, [round(s / step_s) for s in shown], own, methods, reference)
    table = pd.DataFrame(rows).fillna("–")
    at = sorted([name for name in table if name.endswith(" s")], key=lambda name: float(name.split()[0]))
    last = [name for name in table if name.startswith("paper protocol")]
    write_table(
        table[["dataset", "method", *at, *last]], stem, "Without contemporaries, by folds",
        any(dataset.demo for dataset in datasets), NOTE.format(reference=methods[reference]),
    )  # fmt: skip


def pooled(folds: Iterable[ErrorsByOutput]) -> ErrorsByOutput:
    """The errors of all folds as those of one dataset: their tracks one after the other."""
    listed = list(folds)
    return {key: joined([one[key] for one in listed if key in one]) for key in listed[0]}


def _rows(title, errors, horizons, steps, days, methods, reference):
    """The rows of one dataset."""
    scored = scores(title, errors, horizons, steps, days)
    compared = differences(title, errors, [(method, reference) for method in errors], horizons, days)
    rows = []
    for method, name in methods.items():
        cells = {"dataset": title, "method": name}
        for horizon in horizons:
            one = row_of(scored, "complete", horizon, method=method)
            beside = difference_cell(compared, "complete", horizon, method, reference)
            cells[f"{horizon:g} s"] = f"{errors_cell(one)} (n {one.n:g}); {beside}"
        one = row_of(scored, "paper", horizons[-1], method=method)
        cells["paper protocol, the longest horizon"] = f"{errors_cell(one)} ({one.n:g}/{one.eligible})"
        rows.append(cells)
    return rows
