"""Table tab_encounters: how often forecasts run into others' true paths (not in the paper)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.scoring.encounters import TOUCH_M
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout

NOTE = (
    f"Share of the forecasts [%] that have been less than {TOUCH_M:g} m from where another person really was at that "
    "time, up to the horizon (in brackets: people's own paths, of the same tracks); complete protocol, mean over the "
    "seeds. Everybody recorded that day counts as another person. A forecast that stops early, or ends between paths, "
    "meets fewer people: read it with the errors."
)


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """One row per dataset and method, one column per horizon; `methods` maps names to titles."""
    rows = []
    for dataset in datasets:
        for method, title in methods.items():
            table = read_parquet(layout.encounters(dataset.name, method)).to_pandas()
            cells = {f"{one.horizon_s:g} s": _cell(one) for one in table.itertuples()}
            rows.append({"dataset": dataset.title, "method": title, **cells})
    table = pd.DataFrame(rows).fillna("–")
    horizons = sorted([name for name in table if name.endswith(" s")], key=lambda name: float(name.split()[0]))
    write_table(
        table[["dataset", "method", *horizons]], stem, "Forecasts that run into others",
        any(dataset.demo for dataset in datasets), NOTE,
    )  # fmt: skip


def _cell(row):
    if not np.isfinite(row.met):
        return f"– (n {row.n})"
    return f"{100 * row.met:.1f} ({100 * row.truth_met:.1f}; n {row.n})"
