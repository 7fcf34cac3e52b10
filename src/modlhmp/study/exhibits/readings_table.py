"""Table readings-<label>: the results table under every reading of the scoring rules, the paper's numbers beside it."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout
from modlhmp.study.published import RESULTS, RESULTS_AT_S

NOTE = (
    "ADE / FDE in m at the longest horizon, n scored / eligible. Idle: two rows 5 s apart less than 1 m from each "
    "other. The paper does not say which of these readings is its own; beside each error is how far it is from the "
    "paper's, and the reading nearest to the paper's ADE is bold. Methods with `positions` have another velocity "
    "at t0. The paper's recordings are others (docs/results.md)."
)


def draw(layout: Layout, dataset: Dataset, stem: str, methods: Mapping[str, str], kinds: Mapping[str, str]) -> None:
    """Write the table of one dataset; `methods` and `kinds` map the methods' names to their titles and kinds."""
    published = RESULTS[dataset.paper_results] if dataset.paper_results else {}
    if dataset.paper_results and RESULTS_AT_S[dataset.paper_results] != dataset.horizon_s:
        published = {}
    parts = []
    for method, title in methods.items():
        rows = read_parquet(layout.readings(dataset.name, method)).to_pandas()
        ade, fde = published.get(kinds[method], (np.nan, np.nan))
        apart = 100 * (rows[["ade_m", "fde_m"]] / [ade, fde] - 1)
        nearest = apart["ade_m"].abs().idxmin() if apart["ade_m"].notna().any() else None
        parts.append(
            pd.DataFrame(
                {
                    "method": title,
                    "idle tracks": rows["idle"],
                    "tracks that left the map": rows["left"],
                    "mean over the tracks": rows["tracks"],
                    "ADE / FDE [m]": [_errors(row, number == nearest) for number, row in rows.iterrows()],
                    "n": [f"{row['n']:g}/{row['eligible']}" for _, row in rows.iterrows()],
                    "the paper's": f"{ade:.3f} / {fde:.3f}" if np.isfinite(ade) else "–",
                    "less the paper's [%]": [
                        f"{one:+.0f} / {other:+.0f}" if np.isfinite(one) else "–" for one, other in apart.to_numpy()
                    ],
                }
            )
        )
    heading = f"Readings of the scoring rules: {dataset.title}, {dataset.horizon_s:g} s"
    write_table(pd.concat(parts), stem, heading, dataset.demo, NOTE)


def _errors(row, bold):
    if not np.isfinite(row["ade_m"]):
        return "–"
    text = f"{row['ade_m']:.3f} / {row['fde_m']:.3f}"
    return f"**{text}**" if bold else text
