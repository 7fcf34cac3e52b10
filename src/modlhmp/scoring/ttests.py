"""Paired one-sided t-tests between methods: is the first one's error smaller on the same tracks?"""

import numpy as np
import pandas as pd
from scipy import stats

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.summary import main_output

COLUMNS = (
    "dataset", "protocol", "horizon_s", "metric", "method", "against", "output", "output_against", "n",
    "mean_difference_m", "ci_low_m", "ci_high_m", "effect_size", "t", "p", "p_holm",
)  # fmt: skip


def paired_test(ours, theirs):
    """Test H1: mean(ours - theirs) < 0 on the tracks that both scored.

    Returns (n, mean difference, low and high end of its two-sided 95 % interval, Cohen's d_z, t, p); all but n are
    NaN for fewer than two tracks or where all differences are equal.
    """
    both = np.isfinite(ours) & np.isfinite(theirs)
    difference = ours[both] - theirs[both]
    n = int(both.sum())
    if n < 2 or np.ptp(difference) == 0:
        mean = difference.mean() if n else np.nan
        return n, mean, *[np.nan] * 5
    less = stats.ttest_rel(ours[both], theirs[both], alternative="less")
    interval = stats.ttest_rel(ours[both], theirs[both]).confidence_interval(0.95)
    effect = difference.mean() / difference.std(ddof=1)
    return n, difference.mean(), interval.low, interval.high, effect, less.statistic, less.pvalue


def holm(p):
    """Holm's step-down adjusted p values; NaN stay NaN and do not count."""
    p = np.asarray(p, float)
    adjusted, finite = np.full(len(p), np.nan), np.flatnonzero(np.isfinite(p))
    order = finite[np.argsort(p[finite], kind="stable")]
    scaled = p[order] * np.arange(len(order), 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return adjusted


def compare(dataset, errors, pairs, horizons):
    """Test every pair of methods at every horizon, ADE and FDE, both protocols.

    `errors` maps a method to what `summary.at_horizons` gives for `horizons`; `pairs` lists (method, against). Holm's
    correction is over all tests of one dataset and protocol. Returns a DataFrame.
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
