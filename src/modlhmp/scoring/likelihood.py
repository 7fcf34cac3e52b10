"""How likely a map makes the velocities of people whom it has not seen, in four accountings of what it leaves open.

A map that says nothing of a place, or holds for impossible what happens there, has no finite likelihood. What is done
about that decides many comparisons, so four ways stand side by side, on the same rows:

* `charged`: such a row costs what a density of 1e-12 does, which weighs heavier than anything else;
* `common`: only rows that all maps cover, so nothing is said of the others;
* `background`: every map is mixed with what is known without one, by a weight that was chosen on other people. That is
  a density everywhere, so the score is proper (T. Gneiting, A. Raftery, J. Am. Stat. Assoc. 102, 2007): the headline;
* `fallback`: where the map says nothing the next broader one of its family is asked, in the end that without a map.

Log densities are arrays [n] in nats, NaN where a map does not cover, -inf where it holds a row for impossible.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from modlhmp.scoring.ttests import mean_test

LEAST = float(np.log(1e-12))  # what is charged
WEIGHTS = (0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.4)  # of the background, of which one is chosen
ACCOUNTINGS = ("background", "common", "charged", "fallback")
PRINTED = "printed"  # how numbers in the literature seem to have been made: see `as_printed`
DIFFERENCE = ("map", "against", "difference", "low", "high", "n")
SUMMARY = ("nll", "low", "high", "gain", "gain_low", "gain_high", "n", "clusters")


def charged(log_p: np.ndarray) -> np.ndarray:
    """Log densities with a charge for what is not covered or (nearly) impossible."""
    return np.where(np.isnan(log_p), LEAST, np.maximum(log_p, LEAST))


def is_charged(log_p: np.ndarray) -> np.ndarray:
    """Whether a row is charged, bool [n]."""
    return np.isnan(log_p) | (log_p < LEAST)


def as_printed(log_p: np.ndarray) -> np.ndarray:
    """Charged log densities of a density that counts each row three times, so that it integrates to 3.

    Windings that are wrapped again after they were shifted by a turn add the same term three times: a fault in public
    code since mended, which numbers in the literature seem to carry.
    """
    return charged(log_p + np.log(3.0))


def with_background(log_p: np.ndarray, without_map: np.ndarray, weight: float) -> np.ndarray:
    """Log of (1 - weight) p + weight p_0; where the map does not cover, of p_0."""
    unknown = np.isnan(log_p)
    mixed = np.logaddexp(np.log1p(-weight) + np.where(unknown, -np.inf, log_p), np.log(weight) + without_map)
    return np.where(unknown, without_map, mixed)


def choose_weight(log_p: np.ndarray, without_map: np.ndarray) -> float:
    """The weight of the background with the best mean on these rows: those of people held out of the training data."""
    return max(WEIGHTS, key=lambda weight: with_background(log_p, without_map, weight).mean())


def fallback(log_p: Sequence[np.ndarray]) -> np.ndarray:
    """The first of several maps that covers a row; what that holds for impossible is charged."""
    found = np.full(len(log_p[0]), np.nan)
    for one in log_p:
        found = np.where(np.isnan(found), one, found)
    return charged(found)


def accounted(
    log_p: Mapping[str, np.ndarray],
    without_map: np.ndarray,
    weights: Mapping[str, float],
    broader: Mapping[str, Sequence[np.ndarray]],
) -> dict[tuple[str, str], np.ndarray]:
    """{(map, accounting): log densities [n]}; NaN are rows that do not count in it.

    `weights` are those of the background, chosen on other people; `broader` are the log densities of the maps that are
    asked after a map in `fallback`, before none.
    """
    everywhere = ~np.any([np.isnan(one) for one in log_p.values()], axis=0)
    found = {}
    for name, one in log_p.items():
        found[name, "background"] = with_background(one, without_map, weights[name])
        found[name, "common"] = np.where(everywhere, charged(one), np.nan)
        found[name, "charged"] = charged(one)
        found[name, "fallback"] = fallback([one, *broader.get(name, ()), without_map])
    return found


def summarise(log_p: np.ndarray, without_map: np.ndarray, cluster: np.ndarray) -> tuple[float, ...]:
    """The `SUMMARY` of log densities [n]: negative mean and gain over no map, each with its 95 % interval [nat].

    Intervals are over clusters, by the jackknife (`ttests.mean_test`); rows of NaN do not count.
    """
    mean, gain = mean_test(-log_p, cluster), mean_test(log_p - without_map, cluster)
    return mean.mean, mean.low, mean.high, gain.mean, gain.low, gain.high, int(mean.n), mean.clusters


def differences(
    log_p: Mapping[str, np.ndarray], cluster: np.ndarray
) -> list[tuple[str, str, float, float, float, int]]:
    """Paired differences of every two maps: (map, against, difference, low, high, n) [nat], its 95 % interval.

    Below 0 the first one is the better: it is the difference of negative log densities.
    """
    rows, names = [], list(log_p)
    for place, ours in enumerate(names):
        for theirs in names[place + 1 :]:
            test = mean_test(log_p[theirs] - log_p[ours], cluster)
            rows.append((ours, theirs, test.mean, test.low, test.high, int(test.n)))
    return rows
