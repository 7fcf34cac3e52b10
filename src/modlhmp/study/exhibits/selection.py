"""Picking and printing rows of `results.csv`, and the track that figures show as an example."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow.compute as pc
import pyarrow.dataset

from modlhmp.storage import open_parquet, read_parquet
from modlhmp.study.summary import OUTPUTS, main_output


class Example(NamedTuple):
    """An example track, of how many it was chosen, and its owner's id."""

    recording: str
    track_id: int
    of: int
    owner: str


def main_rows(results: pd.DataFrame) -> pd.DataFrame:
    """Rows of each method's main output."""
    main = results.groupby(["dataset", "method"])["output"].transform(lambda outputs: main_output(set(outputs)))
    return results[results["output"] == main]


def scored_of(row: pd.Series) -> str:
    """`n/eligible` of a row; n is a mean over seeds, so it may have a decimal."""
    return f"{row['n']:.1f}".removesuffix(".0") + f"/{row['eligible']:.0f}"


def errors_at(errors_file: str | Path, steps: int) -> pd.DataFrame:
    """ADE [m] of a method's main output after `steps` by its first (smallest) seed, complete protocol.

    One row per test track, of its first forecast: `recording`, `track_id`, `owner` (the owner's id), `ade_m` (NaN where
    the track ends earlier), and whether it is `eligible` at that horizon under the paper protocol. Only one element of
    the lists is kept in memory.
    """
    known = read_parquet(errors_file, ["output", "seed"])
    # A file without rows has no output; any name then finds none.
    output = main_output({*known["output"].unique().to_pylist(), OUTPUTS[-1]})
    field, key = pc.field, ["recording", "track_id"]
    columns = {name: field(name) for name in (*key, "protocol", "eligible_steps")}
    named = "owner_id" in open_parquet(errors_file).schema_arrow.names
    columns["owner"] = field("owner_id" if named else "track_id").cast("string")
    columns["ade_m"] = pc.list_element(field("ade"), steps - 1)
    wanted = (field("output") == output) & (field("seed") == pc.min(known["seed"]))
    rows = pyarrow.dataset.dataset(errors_file).to_table(columns=columns, filter=wanted).to_pandas()
    rows = rows.astype({"recording": str}).drop_duplicates([*key, "protocol"])
    paper = rows.loc[rows["protocol"] == "paper", [*key, "eligible_steps"]]
    both = rows.loc[rows["protocol"] == "complete", [*key, "owner", "ade_m"]].merge(paper, on=key)
    return both.assign(eligible=both.pop("eligible_steps") >= steps)


def example_track(errors: pd.DataFrame) -> Example | None:
    """The eligible track of median error (the lower of two middle ones), an `Example`; None if there is none.

    `errors` as from `errors_at`. Tracks of equal error stand in the order of their recordings' names and their ids.
    """
    eligible = errors[errors["eligible"] & np.isfinite(errors["ade_m"])]
    if eligible.empty:
        return None
    ordered = eligible.sort_values(["ade_m", "recording", "track_id"])
    median = ordered.iloc[(len(ordered) - 1) // 2]
    return Example(str(median["recording"]), int(median["track_id"]), len(ordered), str(median["owner"]))
