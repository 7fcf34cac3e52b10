"""Table claims: every claim of the paper's results section beside our test of it (`study.claims`)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.logs import progress
from modlhmp.scoring.errors import lengths_counted
from modlhmp.storage import read_json, read_parquet
from modlhmp.study.claims import Evidence, claim_horizons, idle_keys, test_claims
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout
from modlhmp.study.summary import at_horizons
from modlhmp.tracks import read_tracks

NOTE = (
    "Verdicts: supported (p < 0.05 after Holm's correction, one-sided), contradicted (the same for the opposite), not "
    "shown (neither); of a number, contradicted or not, by whether the interval holds it. A difference that does not "
    "vary has no p. Two families of tests are corrected, each by dataset and protocol and for either side by itself: "
    "those between methods, which are those of the table of t-tests, and those that only this table makes. Intervals "
    "are two-sided and not corrected. `not forecast` counts tracks that one side could not forecast; a verdict that "
    "rests on them says so. Under the paper protocol the tracks are those that both sides scored. The recordings are "
    "not all the paper's: docs/results.md."
)


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    recordings: Mapping[str, Sequence[str]],
    titles: Mapping[str, str],
    kinds: Mapping[str, str],
    studies: Mapping[str, Sequence[float]],
    horizons: Mapping[str, Sequence[float]],
    measured: Sequence[str],
    days: Mapping[str, Mapping[str, str]],
) -> None:
    """Test every claim on every dataset and write the table.

    `recordings` are the test recordings of each dataset by its name, `titles` and `kinds` are of the compared methods,
    `studies` has the values of each studied parameter of TC-CLiFF, `horizons` [s] are those of the tables by dataset,
    `measured` names the datasets that the runtime study has been run on, `days` has the day of each recording by
    dataset.
    """
    evidence = [
        gather(
            layout, dataset, recordings[dataset.name], titles, studies, horizons[dataset.name],
            dataset.name in measured, days[dataset.name],
        )
        for dataset in datasets
    ]  # fmt: skip
    table = test_claims(evidence, titles, kinds)
    write_claims(table, any(dataset.demo for dataset in datasets), stem)


def gather(
    layout: Layout,
    dataset: Dataset,
    recordings: Sequence[str],
    methods: Sequence[str] | Mapping[str, str],
    studies: Mapping[str, Sequence[float]],
    table_horizons: Sequence[float],
    measured: bool,
    days: Mapping[str, str],
) -> Evidence:
    """All that the claims need to know of one dataset; arguments as of `draw`."""
    name, step_s = dataset.name, dataset.time_step_s
    horizons = claim_horizons(dataset, table_horizons)
    lengths, idle = [], set()
    for recording in recordings:
        tracks = read_tracks(layout.tracks(name, recording))
        lengths.append(lengths_counted([tracks], dataset, "paper"))
        idle |= idle_keys(recording, tracks, dataset)
    return Evidence(
        dataset,
        horizons,
        read_parquet(layout.ttests(name)).to_pandas(),
        {
            method: at_horizons(layout.errors(name, method), horizons, step_s)
            for method in progress(methods, desc="methods")
        },
        {
            parameter: {
                value: at_horizons(layout.study_value(name, parameter, value), horizons, step_s) for value in values
            }
            for parameter, values in studies.items()
        },
        np.concatenate(lengths),
        idle,
        days,
        read_json(layout.runtime(name)) if measured else None,
    )


def write_claims(table: pd.DataFrame, demo: bool, stem: str) -> None:
    """Write what `test_claims` gave in the forms of a table."""
    shown = table.copy()
    for name in ("n", "clusters", "not forecast"):
        shown[name] = [f"{n:,.1f}".removesuffix(".0") if np.isfinite(n) else "" for n in table[name].astype(float)]
    for name, form in (
        ("mean difference", "{:.3f}"),
        ("p", "{:.2g}"),
        ("p Holm", "{:.2g}"),
        ("p Holm, opposite", "{:.2g}"),
    ):
        shown[name] = [form.format(v) if np.isfinite(v) else "" for v in table[name].astype(float)]
    write_table(shown.fillna(""), stem, "The paper's claims, tested", demo, NOTE)
