"""The ladder: methods in a row that differ by one change each, with paired differences and bootstrap intervals."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.study.summary import Errors, ErrorsByOutput, main_output

RESAMPLES = 2000
AT_ONCE = 100  # resamples: all of tens of thousands of persons would be gigabytes
LEAST_DAYS = 5  # fewer days cannot say how days differ
SCORES = (
    "dataset", "protocol", "horizon_s", "method", "ade_m", "ade_low_m", "ade_high_m", "fde_m", "n", "eligible",
)  # fmt: skip
DIFFERENCES = (
    "dataset", "protocol", "horizon_s", "metric", "method", "against", "n",
    "difference_m", "low_m", "high_m", "percent",
)  # fmt: skip


def bootstrap(values: np.ndarray, cluster: np.ndarray) -> tuple[float, float, float]:
    """Mean of `values` [n] and the ends of its 95 % percentile bootstrap interval; clusters [n] are drawn as a whole.

    NaN do not count. The ends are NaN for fewer than two clusters. B. Efron, R. Tibshirani, An introduction to the
    bootstrap, 1993.
    """
    known = np.isfinite(values)
    if not known.any():
        return np.nan, np.nan, np.nan
    _, which = np.unique(cluster[known], return_inverse=True)
    sums, counts = np.bincount(which, values[known]), np.bincount(which)
    mean, number = sums.sum() / counts.sum(), len(sums)
    if number < 2:
        return mean, np.nan, np.nan
    rng, alike, means = np.random.default_rng(0), np.full(number, 1 / number), []
    for _ in range(RESAMPLES // AT_ONCE):
        drawn = rng.multinomial(number, alike, AT_ONCE)
        means.append((drawn @ sums) / (drawn @ counts))
    return mean, *np.percentile(means, [2.5, 97.5])


def clusters(keys: Sequence[str] | np.ndarray, days: Mapping[str, str]) -> np.ndarray:
    """What intervals are drawn over: the days of tracks "recording/track" where there are enough, else the persons.

    `days` maps a recording to its day: people of one day share it, so days are what another sample would differ by.
    """
    if len(set(days.values())) < LEAST_DAYS:
        return np.asarray(keys)
    return np.array([days[key.rsplit("/", 1)[0]] for key in keys])


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
            one = _main(errors[method], protocol)
            ade, fde = one.by_track("ade"), one.by_track("fde")
            cluster = clusters(one.keys, days)
            for column, horizon in enumerate(horizons):
                mean = bootstrap(ade[:, column], cluster)
                scored, eligible = np.isfinite(ade[:, column]), one.eligible_steps >= steps[column]
                far = fde[scored, column].mean() if scored.any() else np.nan
                table.append((dataset, protocol, horizon, method, *mean, far, scored.sum(), eligible.sum()))
    return pd.DataFrame(table, columns=SCORES)


def differences(
    dataset: str,
    errors: Mapping[str, ErrorsByOutput],
    pairs: Iterable[tuple[str, str]],
    horizons: Sequence[float],
    days: Mapping[str, str],
) -> pd.DataFrame:
    """Paired differences, method less against, over the tracks that both scored (`DIFFERENCES`).

    One row per protocol, horizon, metric and pair (method, against); `percent` is of the mean error of `against` there.
    """
    table = []
    for protocol in PROTOCOLS:
        for method, against in dict.fromkeys(pairs):
            one, other = _main(errors[method], protocol), _main(errors[against], protocol)
            keys, at_one, at_other = np.intersect1d(one.keys, other.keys, return_indices=True)
            cluster = clusters(keys, days)
            for metric in ("ade", "fde"):
                mine, theirs = one.by_track(metric)[at_one], other.by_track(metric)[at_other]
                for column, horizon in enumerate(horizons):
                    difference = mine[:, column] - theirs[:, column]
                    both = np.isfinite(difference)
                    mean = bootstrap(difference, cluster)
                    share = 100 * mean[0] / theirs[both, column].mean() if both.any() else np.nan
                    table.append((dataset, protocol, horizon, metric, method, against, both.sum(), *mean, share))
    return pd.DataFrame(table, columns=DIFFERENCES)


def _main(errors: ErrorsByOutput, protocol: str) -> Errors:
    """Errors of the output that stands for a method."""
    return errors[main_output({output for output, _ in errors}), protocol]
