"""Paired one-sided t-tests between methods: is the first one's error smaller on the same tracks?"""

from collections.abc import Sequence

import numpy as np
from scipy import stats


def paired_test(ours: np.ndarray, theirs: np.ndarray) -> tuple[int, float, float, float, float, float, float]:
    """Test H1: mean(ours - theirs) < 0 on the tracks that both scored.

    Returns (n, mean difference, low and high end of its two-sided 95 % interval, Cohen's d_z, t, p); all but n are
    NaN for fewer than two tracks or where all differences are equal.
    """
    both = np.isfinite(ours) & np.isfinite(theirs)
    difference = ours[both] - theirs[both]
    n = int(both.sum())
    if n < 2 or np.ptp(difference) == 0:
        mean = difference.mean() if n else np.nan
        return n, mean, np.nan, np.nan, np.nan, np.nan, np.nan
    less = stats.ttest_rel(ours[both], theirs[both], alternative="less")
    interval = stats.ttest_rel(ours[both], theirs[both]).confidence_interval(0.95)
    effect = difference.mean() / difference.std(ddof=1)
    return n, difference.mean(), interval.low, interval.high, effect, less.statistic, less.pvalue


def holm(p: Sequence[float] | np.ndarray) -> np.ndarray:
    """Holm's step-down adjusted p values; NaN stay NaN and do not count."""
    p = np.asarray(p, float)
    adjusted, finite = np.full(len(p), np.nan), np.flatnonzero(np.isfinite(p))
    order = finite[np.argsort(p[finite], kind="stable")]
    scaled = p[order] * np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return adjusted
