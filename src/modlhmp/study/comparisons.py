"""Paired one-sided t-tests of every pair of methods that a run compares: is the first one's error smaller?"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from modlhmp.scoring.errors import seed_mean
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.ttests import MeanTest, detectable, holm, paired_test
from modlhmp.study.summary import Errors, ErrorsByOutput, main_output

LEAST_DAYS = 5  # with fewer, no test over days can reach p < 0.05 (signs of 4 differences: 1 in 16)
COLUMNS = (
    "dataset", "protocol", "horizon_s", "metric", "method", "against", "output", "output_against", "n", "clusters",
    "mean_m", "mean_against_m", "mean_difference_m", "ci_low_m", "ci_high_m", "effect_size", "t", "p", "p_greater",
    "n_unknown", "p_known", "p_greater_known", "detectable_m",
    "p_holm", "p_greater_holm", "p_known_holm", "p_greater_known_holm",
)  # fmt: skip


class Pair(NamedTuple):
    """Two methods' errors on the tracks that both have, in the same order.

    `ours`, `theirs` [seeds, tracks, H] in m, NaN where either was not scored; `keys` [tracks]; `cluster` [tracks];
    `unknown` [tracks]: whether one of the two could not forecast the track.
    """

    keys: np.ndarray
    ours: np.ndarray
    theirs: np.ndarray
    cluster: np.ndarray
    unknown: np.ndarray


def main_errors(errors: ErrorsByOutput, protocol: str) -> Errors:
    """Errors of the output that stands for a method."""
    return errors[main_output({output for output, _ in errors}), protocol]


def clusters(person: Sequence[str] | np.ndarray, days: Mapping[str, str]) -> np.ndarray:
    """What tests and intervals are over: the days of persons "recording/person" where there are enough, else these.

    `days` maps a recording to its day: people of one day share it, so days are what another sample would differ by.
    """
    if len(set(days.values())) < LEAST_DAYS:
        return np.asarray(person)
    return np.array([days[one.rsplit("/", 1)[0]] for one in person])


def tracks_of(keys: Sequence[str] | np.ndarray) -> np.ndarray:
    """Of which track the forecasts of these keys (`summary.Errors`) are: "recording/track" [tracks]."""
    parts = [key.rpartition("/") for key in np.asarray(keys).tolist()]
    return np.array([f"{recording}/{track.partition('@')[0]}" for recording, _, track in parts], dtype=str)


def side_by_side(one: Errors, other: Errors, metric: str, days: Mapping[str, str]) -> Pair:
    """Two methods side by side; a method of one seed stands beside every seed of the other."""
    keys, at_one, at_other = one.keys, slice(None), slice(None)  # most often all are the same: none is copied
    if not np.array_equal(one.keys, other.keys):
        keys, at_one, at_other = np.intersect1d(one.keys, other.keys, return_indices=True)  # type: ignore[assignment]
    ours, theirs = np.broadcast_arrays(getattr(one, metric)[:, at_one], getattr(other, metric)[:, at_other])
    both = np.isfinite(ours) & np.isfinite(theirs)
    ours, theirs = np.where(both, ours, np.nan), np.where(both, theirs, np.nan)
    cluster, unknown = clusters(one.person[at_one], days), one.unknown[at_one] | other.unknown[at_other]
    return Pair(keys, ours, theirs, cluster, unknown)


def with_known(
    test: Callable[..., MeanTest], unknown: np.ndarray, scored: np.ndarray, *values: np.ndarray
) -> tuple[MeanTest, int, MeanTest]:
    """A test of `values` [..., tracks], how many of these tracks one side could not forecast, and it without them.

    `unknown` and `scored` [tracks] say which could not be forecast, and which the test is of.
    """
    whole, number = test(*values), int((unknown & scored).sum())
    return whole, number, test(*(one[..., ~unknown] for one in values)) if number else whole


def sides(
    errors: Mapping[str, ErrorsByOutput], pairs: Iterable[tuple[str, str]], protocol: str
) -> Iterator[tuple[str, str, Errors, Errors]]:
    """Every pair (method, against) with the errors of both; no more than one pair's are held, of large files."""
    held: dict[str, Errors] = {}
    for pair in pairs:
        held = {method: held[method] for method in pair if method in held}
        for method in pair:
            if method not in held:
                held[method] = main_errors(errors[method], protocol)
        yield pair[0], pair[1], held[pair[0]], held[pair[1]]


def compare(
    dataset: str,
    errors: Mapping[str, ErrorsByOutput],
    pairs: Sequence[tuple[str, str]],
    horizons: Sequence[float],
    days: Mapping[str, str],
) -> pd.DataFrame:
    """Test every pair of methods at every horizon [s], ADE and FDE, both protocols; one row per test (`COLUMNS`).

    `errors` maps a method to what `summary.at_horizons` gives for `horizons`; `pairs` lists (method, against); `days`
    as of `clusters`. `mean_m`, `mean_against_m` are over the tracks that both scored. `n_unknown` counts those among
    them that one side could not forecast; `p_known` and `p_greater_known` are without these. `detectable_m` is the
    difference that such a test finds in four of five tries. Holm's correction is over all tests of one dataset and
    protocol, once for each side, and for each without the tracks that one could not forecast.
    """
    rows = []
    for protocol in PROTOCOLS:
        for ours, theirs, one, other in sides(errors, pairs, protocol):
            outputs = [main_output({output for output, _ in errors[method]}) for method in (ours, theirs)]
            for metric in ("ade", "fde"):
                tested = _all_tested(side_by_side(one, other, metric, days))
                for horizon, numbers in zip(horizons, tested, strict=True):
                    rows.append((dataset, protocol, horizon, metric, ours, theirs, *outputs, *numbers))
            del one, other  # before the next pair is read
    table = pd.DataFrame(rows, columns=[name for name in COLUMNS if not name.endswith("_holm")])
    for side in ("p", "p_greater", "p_known", "p_greater_known"):
        table[f"{side}_holm"] = table.groupby("protocol")[side].transform(holm) if len(table) else []
    return table


def _all_tested(both):
    """The numbers of every horizon; the pair's errors are held no longer than this takes."""
    return [_tested(both, column) for column in range(both.ours.shape[2])]


def _tested(both, column):
    """A row's numbers from n to `detectable_m`."""
    ours, theirs = both.ours[:, :, column], both.theirs[:, :, column]
    scored = np.isfinite(ours).any(axis=0)
    test, unknown, known = with_known(paired_test, both.unknown, scored, ours, theirs, both.cluster)
    means = [float(seed_mean(part)) for part in (ours, theirs)]
    numbers = (test.mean, test.low, test.high, test.effect, test.t, test.p, test.p_greater)
    return test.n, test.clusters, *means, *numbers, unknown, known.p, known.p_greater, detectable(test)
