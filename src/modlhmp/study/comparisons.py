"""Paired one-sided t-tests of every pair of methods that a run compares: is the first one's error smaller?"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.ttests import holm, paired_test
from modlhmp.study.summary import ErrorsByOutput, main_output

COLUMNS = (
    "dataset", "protocol", "horizon_s", "metric", "method", "against", "output", "output_against", "n",
    "mean_difference_m", "ci_low_m", "ci_high_m", "effect_size", "t", "p", "p_holm",
)  # fmt: skip


def compare(
    dataset: str,
    errors: Mapping[str, ErrorsByOutput],
    pairs: Sequence[tuple[str, str]],
    horizons: Sequence[float],
) -> pd.DataFrame:
    """Test every pair of methods at every horizon [s], ADE and FDE, both protocols; one row per test (`COLUMNS`).

    `errors` maps a method to what `summary.at_horizons` gives for `horizons`; `pairs` lists (method, against). Holm's
    correction is over all tests of one dataset and protocol.
    """
    rows = []
    for protocol in PROTOCOLS:
        for ours, theirs in pairs:
            outputs = [main_output({output for output, _ in errors[method]}) for method in (ours, theirs)]
            a, b = errors[ours][outputs[0], protocol], errors[theirs][outputs[1], protocol]
            _, at_a, at_b = np.intersect1d(a.keys, b.keys, return_indices=True)
            for metric in ("ade", "fde"):
                mine, other = a.by_track(metric)[at_a], b.by_track(metric)[at_b]
                for column, horizon in enumerate(horizons):
                    test = paired_test(mine[:, column], other[:, column])
                    rows.append((dataset, protocol, horizon, metric, ours, theirs, *outputs, *test, np.nan))
    table = pd.DataFrame(rows, columns=COLUMNS)
    if len(table):
        table["p_holm"] = table.groupby("protocol")["p"].transform(holm)
    return table
