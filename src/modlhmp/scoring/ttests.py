"""Paired one-sided t-tests between methods: is the first one's error smaller on the same tracks?

Tracks of one day share it, so they are no independent samples: standard errors are those of the jackknife that leaves
out one cluster after the other (days, or persons where there are few days), with Student's t of as many degrees of
freedom as there are clusters less one. J. MacKinnon, M. Nielsen, M. Webb, J. Applied Econometrics 38, 2023: of the
estimates for clusters of unequal size the one that holds its level. With a cluster per track it is the plain paired
t-test.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from modlhmp.scoring.errors import nan_mean, seed_mean

SAME = 1e-6  # differences that vary by less than this share of the errors are constant but for rounding


class MeanTest(NamedTuple):
    """Test of a mean against 0: `n` tracks (mean over the seeds) in `clusters`; its 95 % interval; Cohen's d; t.

    `p` is of the alternative that the mean is below 0, `p_greater` that it is above. All but `n`, `clusters` and `mean`
    are NaN for fewer than two clusters, or where nothing varies but by rounding.
    """

    n: float
    clusters: int
    mean: float
    low: float
    high: float
    effect: float
    t: float
    p: float
    p_greater: float


def paired_test(ours: np.ndarray, theirs: np.ndarray, cluster: np.ndarray | None = None) -> MeanTest:
    """Test H1: the mean of ours - theirs is below 0, on the tracks that both scored with the same seed.

    `ours` and `theirs` are errors [n] or [seeds, n], one seed of the one counting for all of the other; `cluster` [n]
    says which tracks belong together (default: none). The mean is that of the seeds' own means.
    """
    ours, theirs = np.atleast_2d(ours), np.atleast_2d(theirs)
    difference = ours.astype(float) - theirs
    sizes = [np.nanmax(np.abs(part), initial=0.0) for part in (ours, theirs)]
    return mean_test(difference, cluster, SAME * max(sizes))


def mean_test(values: np.ndarray, cluster: np.ndarray | None = None, rounding: float = 0.0) -> MeanTest:
    """Test a mean of values [n] or [seeds, n] against 0; NaN do not count. Arguments as of `paired_test`.

    Values that vary by less than `rounding` are taken as constant.
    """
    values = np.atleast_2d(values).astype(float)
    by_track = nan_mean(values, axis=0)
    known = np.isfinite(by_track)
    varies = known.sum() > 1 and np.ptp(by_track[known]) > rounding
    which = _numbered(cluster, known)
    found = _test(float(seed_mean(values)), _without_each(values, which), _count(values), varies)
    return found._replace(effect=found.mean / by_track[known].std(ddof=1)) if np.isfinite(found.p) else found


def groups_test(
    values: np.ndarray, first: np.ndarray, second: np.ndarray, cluster: np.ndarray | None = None
) -> MeanTest:
    """Test H1: the mean of one group of tracks is below that of another; groups are masks [n] of `values` [seeds, n].

    As `mean_test` otherwise; NaN where a group has fewer than two tracks.
    """
    values = np.atleast_2d(values).astype(float)
    which = _numbered(cluster, np.isfinite(values).any(axis=0) & (first | second))
    sides = [np.where(group, values, np.nan) for group in (first, second)]
    means, others = [float(seed_mean(side)) for side in sides], [_without_each(side, which) for side in sides]
    numbers = [_count(side) for side in sides]
    return _test(means[0] - means[1], others[0] - others[1], sum(numbers), min(numbers) >= 2)


def _count(values):
    """Tracks per seed."""
    return float(np.isfinite(values).sum(axis=1).mean())


def _numbered(cluster, known):
    """The number of each track's cluster, from 0; -1 for tracks that are not `known`."""
    which = np.full(len(known), -1)
    names = np.flatnonzero(known) if cluster is None else np.asarray(cluster)[known]
    which[known] = np.unique(names, return_inverse=True)[1]
    return which


def _without_each(values, which):
    """The mean of the seeds' means of [seeds, n] without each of the clusters, [clusters]."""
    number, counted = which.max(initial=-1) + 1, which >= 0
    sums, counts = np.empty((2, len(values), number))
    for seed, row in enumerate(values):
        known = counted & np.isfinite(row)
        sums[seed] = np.bincount(which[known], row[known], number)
        counts[seed] = np.bincount(which[known], minlength=number)
    rest, left = sums.sum(axis=1, keepdims=True) - sums, counts.sum(axis=1, keepdims=True) - counts
    return nan_mean(np.divide(rest, left, out=np.full_like(rest, np.nan), where=left > 0), axis=0)


def _test(mean, without, n, varies):
    """The test of a mean from its values without each of the clusters, without d."""
    clusters = len(without)
    about = without - without.mean() if clusters > 1 else np.zeros(1)
    error = np.sqrt((clusters - 1) / clusters * (about**2).sum()) if clusters > 1 else 0.0
    if not (varies and error > 0):
        return MeanTest(n, clusters, mean, *[np.nan] * 6)
    from scipy.special import stdtr, stdtrit  # noqa: PLC0415 - 0.1 s, and most exhibits test nothing

    t, freedom = mean / error, clusters - 1
    reach = stdtrit(freedom, 0.975) * error
    return MeanTest(n, clusters, mean, mean - reach, mean + reach, np.nan, t, stdtr(freedom, t), stdtr(freedom, -t))


def detectable(test: MeanTest, level: float = 0.05, power: float = 0.8) -> float:
    """The difference that a one-sided test of such a spread and number of clusters would find in four of five tries."""
    if not np.isfinite(test.low):
        return float("nan")
    from scipy.special import stdtrit  # noqa: PLC0415 - likewise

    reach, one_sided, found = (stdtrit(test.clusters - 1, p) for p in (0.975, 1 - level, power))
    return float((one_sided + found) * (test.high - test.low) / 2 / reach)


def holm(p: Sequence[float] | np.ndarray) -> np.ndarray:
    """Holm's step-down adjusted p values; NaN stay NaN and do not count."""
    p = np.asarray(p, float)
    adjusted, finite = np.full(len(p), np.nan), np.flatnonzero(np.isfinite(p))
    order = finite[np.argsort(p[finite], kind="stable")]
    scaled = p[order] * np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return adjusted
