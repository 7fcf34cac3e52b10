"""The ladder: methods in a row that differ by one change each, with paired differences and their intervals."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.scoring.errors import seed_mean
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.ttests import mean_test, paired_test
from modlhmp.study.comparisons import clusters, main_errors, side_by_side, sides
from modlhmp.study.summary import ErrorsByOutput

SCORES = (
    "dataset", "protocol", "horizon_s", "method", "ade_m", "ade_low_m", "ade_high_m", "fde_m", "n", "eligible",
)  # fmt: skip
DIFFERENCES = (
    "dataset", "protocol", "horizon_s", "metric", "method", "against", "n",
    "difference_m", "low_m", "high_m", "percent", "n_unknown",
)  # fmt: skip


def scores(
    dataset: str,
    errors: Mapping[str, ErrorsByOutput],
    horizons: Sequence[float],
    steps: Sequence[int],
    days: Mapping[str, str],
) -> pd.DataFrame:
    """Errors of every method with their intervals; one row per protocol, horizon and method (`SCORES`).

    `errors` maps a method to what `summary.at_horizons` gives for `horizons` [s], which are `steps` time steps; `days`
    as of `clusters`.
    """
    table = []
    for protocol in PROTOCOLS:
        for method in errors:
            one = main_errors(errors[method], protocol)
            cluster = clusters(one.person, days)
            for column, horizon in enumerate(horizons):
                ade, fde = one.ade[:, :, column], one.fde[:, :, column]
                test, eligible = mean_test(ade, cluster), one.eligible_steps >= steps[column]
                mean = (test.mean, test.low, test.high, float(seed_mean(fde)))
                table.append((dataset, protocol, horizon, method, *mean, test.n, eligible.sum()))
            del one
    return pd.DataFrame(table, columns=SCORES)


def differences(
    dataset: str,
    errors: Mapping[str, ErrorsByOutput],
    pairs: Iterable[tuple[str, str]],
    horizons: Sequence[float],
    days: Mapping[str, str],
) -> pd.DataFrame:
    """Paired differences, method less against, over the tracks that both scored (`DIFFERENCES`).

    One row per protocol, horizon, metric and pair (method, against); `percent` is of the mean error of `against` there,
    `n_unknown` counts the tracks that one of the two could not forecast.
    """
    table = []
    for protocol in PROTOCOLS:
        for method, against, one, other in sides(errors, dict.fromkeys(pairs), protocol):
            for metric in ("ade", "fde"):
                both = side_by_side(one, other, metric, days)
                for column, horizon in enumerate(horizons):
                    ours, theirs = both.ours[:, :, column], both.theirs[:, :, column]
                    test = paired_test(ours, theirs, both.cluster)
                    share = 100 * test.mean / float(seed_mean(theirs)) if test.n else np.nan
                    unknown = int((both.unknown & np.isfinite(ours).any(axis=0)).sum())
                    numbers = (test.n, test.mean, test.low, test.high, share, unknown)
                    table.append((dataset, protocol, horizon, metric, method, against, *numbers))
            del one, other  # before the next pair is read
    return pd.DataFrame(table, columns=DIFFERENCES)
