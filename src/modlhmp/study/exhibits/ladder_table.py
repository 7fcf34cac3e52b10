"""Table ladder-<label>: from the paper's configuration to the best one, one change per row (not in the paper)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_json, read_parquet
from modlhmp.study.comparisons import LEAST_DAYS
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.exhibits.words import SEED_MEANS
from modlhmp.study.layout import Layout

NOTE = (
    f"Errors are ADE / FDE in m, {SEED_MEANS}; brackets hold 95 % intervals over {{over}}. "
    "Every row is compared with the one above it and with {reference}, on the same tracks (complete protocol: every "
    "eligible track counts). The paper protocol is at the right: it drops idle tracks where the dataset says so, "
    "and forecasts that have left the map. `not forecast` counts tracks that one of the two "
    "could not forecast: no dynamics from t0 on. Cost is the time of a forecast to the longest horizon on one core."
)


def draw(
    layout: Layout,
    dataset: Dataset,
    stem: str,
    rows: Sequence[Sequence[str]],
    reference: str,
    beside: Sequence[Sequence[str]],
    titles: Mapping[str, str],
    days: Sequence[str],
) -> None:
    """Write the table of one dataset.

    `rows` are [method, what changes], `reference` is the method that all are compared with, `beside` are [method,
    against, what differs], `titles` maps all these methods to their titles, `days` are those of the test recordings.
    """
    scored, compared = (
        read_parquet(layout.ladder(dataset.name, part)).to_pandas() for part in ("scores", "differences")
    )
    costs = read_json(layout.costs(dataset.name))
    horizons = sorted(scored["horizon_s"].unique())
    above = dict(zip([m for m, _ in rows[1:]], [m for m, _ in rows], strict=False))
    tables = []
    for horizon in reversed(horizons):
        tables.append((f"{horizon:g} s", _rungs(scored, compared, rows, above, reference, horizon, costs, titles)))
    if beside:
        tables.append(("Beside the ladder: one thing changed", _beside(scored, compared, beside, horizons, titles)))
    over = f"the {len(days)} test days" if len(days) >= LEAST_DAYS else "persons"
    note = NOTE.format(over=over, reference=titles[reference])
    heading = f"From the paper's configuration to the best one: {dataset.title}"
    first = tables[0][1]
    write_table(first, stem, f"{heading}, {tables[0][0]}", dataset.demo, note, tables[1:])


def _rungs(scored, compared, rows, above, reference, horizon, costs, titles):
    """The rungs at one horizon."""
    table = []
    for method, change in rows:
        complete, paper = (row_of(scored, protocol, horizon, method=method) for protocol in ("complete", "paper"))
        table.append(
            {
                "what changes": change,
                "method": titles[method],
                "ADE / FDE [m]": errors_cell(complete),
                "n": f"{complete.n:g}",
                "ADE less the row above": difference_cell(compared, "complete", horizon, method, above.get(method)),
                f"less {titles[reference]}": difference_cell(compared, "complete", horizon, method, reference),
                "FDE, the same": difference_cell(compared, "complete", horizon, method, reference, "fde"),
                "ms per track": f"{costs[method]:.2g}" if np.isfinite(costs.get(method, np.nan)) else "–",
                "paper protocol": errors_cell(paper),
                "paper protocol: n": f"{paper.n:g}/{paper.eligible}",
            }
        )
    return pd.DataFrame(table)


def _beside(scored, compared, beside, horizons, titles):
    """Pairs of methods, one column per horizon."""
    table = []
    for method, against, change in beside:
        cells = {"what changes": change, "method": titles[method], "against": titles[against]}
        for horizon in horizons:
            one = row_of(scored, "complete", horizon, method=method)
            difference = difference_cell(compared, "complete", horizon, method, against)
            cells[f"{horizon:g} s"] = f"{errors_cell(one)}; {difference}" if one.n else "–"
        table.append(cells)
    return pd.DataFrame(table)


def errors_cell(row: Any) -> str:
    """`2.31 / 4.10`, a dash where nobody was scored."""
    return f"{row.ade_m:.2f} / {row.fde_m:.2f}" if row.n else "–"


def difference_cell(
    compared: pd.DataFrame, protocol: str, horizon: float, method: str, against: str | None, metric: str = "ade"
) -> str:
    """`-2.31 (-2.85 to -1.73), -26 %` of a pair, a dash where there is none; one person has no interval."""
    if against is None or against == method:
        return "–"
    one = row_of(compared, protocol, horizon, method=method, against=against, metric=metric)
    if not one.n:
        return "–"
    interval = f" ({one.low_m:+.2f} to {one.high_m:+.2f})" if np.isfinite(one.low_m) else ""
    unknown = f", {one.n_unknown} not forecast" if one.n_unknown else ""
    return f"{one.difference_m:+.2f}{interval}, {one.percent:+.0f} %{unknown}"


def row_of(table: pd.DataFrame, protocol: str, horizon: float, **wanted: str) -> Any:
    """The row of a table of `study.ladder` at a horizon [s] whose columns hold what is `wanted`."""
    chosen = (table["protocol"] == protocol) & (table["horizon_s"] == horizon)
    for name, value in wanted.items():
        chosen &= table[name] == value
    return table[chosen].iloc[0]
