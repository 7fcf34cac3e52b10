"""Picking and printing rows of `results.csv`, and the track that figures show as an example."""

import itertools
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow.compute as pc

from modlhmp.storage import open_parquet, read_parquet, read_pieces
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
    key, schema = ["recording", "track_id"], open_parquet(errors_file).schema_arrow
    owner = "owner_id" if "owner_id" in schema.names else "track_id"
    kept, chosen = [*key, "protocol", "eligible_steps"], ["output", "seed", "ade"]
    parts = []
    for piece in itertools.chain([schema.empty_table()], read_pieces(errors_file, [*{*kept, owner, *chosen}])):
        wanted = pc.and_(pc.equal(piece["output"], output), pc.equal(piece["seed"], pc.min(known["seed"])))
        some = piece.filter(wanted)
        one = some.select(kept).append_column("owner", some[owner].cast("string"))
        parts.append(one.append_column("ade_m", pc.list_element(some["ade"], steps - 1)).to_pandas())
    rows = pd.concat(parts).astype({"recording": str, "track_id": np.int64}).drop_duplicates([*key, "protocol"])
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
