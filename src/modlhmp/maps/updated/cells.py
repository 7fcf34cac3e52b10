"""The mixture of a cell from its histogram of velocities: where the counts gather, then EM over the occupied bins.

A bin is a heading of `HEADINGS` and a speed in steps of `SPEED_STEP`; its number is heading * `SPEEDS` + speed. What is
found depends on the histogram alone, never on an earlier mixture: that is what makes a map independent of the order in
which it was told of people. Clusters are the hills of the smoothed histogram, as mean shift finds them between
observations (`maps.mean_shift`), with the same bandwidth.
"""

import numpy as np

from modlhmp.angles import TWO_PI, one_turn
from modlhmp.kernels import kernel
from modlhmp.maps.cliff import MIN_CLUSTER
from modlhmp.maps.swgmm import (
    MAX_ITERATIONS,
    WINDINGS,
    add_statistics,
    copy_row,
    floor_covariance,
    precompute,
    relative_densities,
    windings_of,
)

HEADINGS, HEADING_STEP = 36, TWO_PI / 36
SPEEDS, SPEED_STEP = 64, 0.125  # [m/s]; the last bin is open
VARIANCES = HEADING_STEP**2 / 12, SPEED_STEP**2 / 12  # of what is anywhere in a bin
# Of the bandwidth of mean shift: a bin is wide itself. Chosen by held-out persons of training data (docs/decisions.md).
NARROWER = 0.7
MOST_COMPONENTS = 32
FARTHER = 1.5  # by which each step of EM that succeeds goes farther than the last
TOLERANCE = 3e-5  # as in `swgmm`; its 1e-5 takes a fifth longer and describes new people no better


def bins_of(heading: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Number of the bin [n] of headings [rad] and speeds [m/s]."""
    turned = np.floor(np.mod(heading, TWO_PI) / HEADING_STEP).astype(np.int64) % HEADINGS
    return turned * SPEEDS + np.minimum(np.floor(speed / SPEED_STEP), SPEEDS - 1).astype(np.int64)


@kernel
def fit_cells(starts, bins, weights):
    """Mixtures of cells whose bins are `starts[c]` to `starts[c + 1]`; `bins`, `weights` [m], sorted by bin in a cell.

    Returns (first component of each cell [cells + 1], components [J, 6], heaviest of a cell first).
    """
    cells = len(starts) - 1
    first, found, used = np.zeros(cells + 1, np.int64), np.empty((2 * cells + MOST_COMPONENTS, 6)), 0
    for c in range(cells):
        some = slice(starts[c], starts[c + 1])
        fitted = _fit(bins[some], weights[some])
        if used + len(fitted) > len(found):
            grown = np.empty((2 * len(found) + MOST_COMPONENTS, 6))
            for j in range(used):
                copy_row(found[j], grown[j])
            found = grown
        for j in range(len(fitted)):
            copy_row(fitted[j], found[used + j])
        used += len(fitted)
        first[c + 1] = used
    return first, found[:used].copy()


@kernel
def _fit(bins, weights):
    """Mixture [J, 6] of one histogram."""
    heading = (bins // SPEEDS + 0.5) * HEADING_STEP
    speed = (bins % SPEEDS + 0.5) * SPEED_STEP
    components = _components(heading, speed, weights, _hills(bins, heading, speed, weights))
    total = weights.sum()
    while True:
        _em(heading, speed, weights, components)
        kept = 0
        for j in range(len(components)):
            kept += components[j, 0] * total >= 1.0
        if kept == len(components) or not kept:
            return _by_weight(components)
        heavy, kept = np.empty((kept, 6)), 0
        for j in range(len(components)):
            if components[j, 0] * total >= 1.0:
                copy_row(components[j], heavy[kept])
                kept += 1
        _normalise(heavy)
        components = heavy


@kernel
def _normalise(components):
    """Make the weights of components [J, 6] sum to 1."""
    total = 0.0
    for j in range(len(components)):
        total += components[j, 0]
    for j in range(len(components)):
        components[j, 0] /= total


@kernel
def _by_weight(components):
    """Components [J, 6] by falling weight; of the same weight in the order that they have."""
    ordered = np.empty_like(components)
    for j in range(len(components)):
        place = 0
        for other in range(len(components)):
            heavier = components[other, 0] - components[j, 0]
            place += heavier > 0.0 or (heavier == 0.0 and other < j)
        copy_row(components[j], ordered[place])
    return ordered


@kernel
def _bandwidth(heading, speed, weights):
    """`mean_shift.bandwidth_isotropic` of a histogram."""
    n = east = north = mean = variance = 0.0
    for i in range(len(weights)):
        n += weights[i]
        east += weights[i] * np.cos(heading[i])
        north += weights[i] * np.sin(heading[i])
    direction, distance = np.arctan2(north, east), np.empty(len(weights))
    for i in range(len(weights)):
        distance[i] = np.hypot(one_turn(heading[i] - direction), speed[i])
        mean += weights[i] * distance[i]
    mean /= n
    for i in range(len(weights)):
        variance += weights[i] * (distance[i] - mean) ** 2
    return max((4.0 / (3.0 * n)) ** 0.2 * np.sqrt(variance / max(n - 1.0, 1.0)), 1e-5)


@kernel
def _hills(bins, heading, speed, weights):
    """Label [m] of each bin: the hill of the smoothed histogram on which it lies; small ones joined to the nearest."""
    h = NARROWER * _bandwidth(heading, speed, weights)
    low, high = SPEEDS, 0
    for n in range(len(bins)):
        low, high = min(low, bins[n] % SPEEDS), max(high, bins[n] % SPEEDS)
    speeds = high - low + 1
    smooth = _smoothed(bins, weights, h, low, speeds)
    labels, roots, number = np.empty(len(bins), np.int64), np.full(HEADINGS * speeds, -1), 0
    for n in range(len(bins)):
        i, j = bins[n] // SPEEDS, bins[n] % SPEEDS - low
        while True:
            up, over, best = i, j, smooth[i, j]
            for a in range(-1, 2):
                for b in range(max(j - 1, 0), min(j + 2, speeds)):
                    at = (i + a) % HEADINGS
                    if smooth[at, b] > best:
                        up, over, best = at, b, smooth[at, b]
            if up == i and over == j:
                break
            i, j = up, over
        root = i * speeds + j
        if roots[root] < 0:
            roots[root] = number
            number += 1
        labels[n] = roots[root]
    return _joined(heading, speed, weights, labels, number)


@kernel
def _smoothed(bins, weights, h, low, speeds):
    """The histogram [HEADINGS, speeds] under a Gaussian of standard deviation h in rad and in m/s."""
    across, smooth = np.zeros((HEADINGS, speeds)), np.zeros((HEADINGS, speeds))
    along = np.empty(speeds)
    for away in range(speeds):
        along[away] = np.exp(-0.5 * (away * (SPEED_STEP / h)) ** 2)
    for n in range(len(bins)):
        i, j = bins[n] // SPEEDS, bins[n] % SPEEDS - low
        for at in range(speeds):
            across[i, at] += weights[n] * along[abs(at - j)]
    for offset in range(-(HEADINGS // 2), HEADINGS // 2):
        k = np.exp(-0.5 * (offset * HEADING_STEP / h) ** 2)
        if k > 1e-12:
            for i in range(HEADINGS):
                source = (i + offset) % HEADINGS
                for at in range(speeds):
                    smooth[i, at] += k * across[source, at]
    return smooth


@kernel
def _joined(heading, speed, weights, labels, number):
    """Labels with the members of clusters under `MIN_CLUSTER` given to the nearest large one (one, if none is)."""
    mass = np.zeros(number)
    for n in range(len(labels)):
        mass[labels[n]] += weights[n]
    if mass.max() < MIN_CLUSTER:
        return np.zeros(len(labels), np.int64)
    clusters = _components(heading, speed, weights, labels)
    joined = labels.copy()
    for n in range(len(labels)):
        if mass[labels[n]] < MIN_CLUSTER:
            nearest = np.inf
            for j in range(number):
                turn = one_turn(heading[n] - clusters[j, 1])
                d2 = turn**2 + (speed[n] - clusters[j, 2]) ** 2
                if mass[j] >= MIN_CLUSTER and d2 < nearest:
                    nearest, joined[n] = d2, j
    return joined


@kernel
def _components(heading, speed, weights, labels):
    """Weight and moments [J, 6] of each cluster that has members, by rising label."""
    last, total = 0, 0.0
    for i in range(len(labels)):
        last = max(last, labels[i])
        total += weights[i]
    components, used = np.empty((last + 1, 6)), 0
    for label in range(last + 1):
        n = east = north = mr = 0.0
        for i in range(len(labels)):
            if labels[i] == label:
                n += weights[i]
                east += weights[i] * np.cos(heading[i])
                north += weights[i] * np.sin(heading[i])
                mr += weights[i] * speed[i]
        if n == 0.0:  # its members were given to others
            continue
        mt, mr = np.arctan2(north, east), mr / n
        shift = 0.0
        for i in range(len(labels)):
            if labels[i] == label:
                shift += weights[i] * one_turn(heading[i] - mt)
        shift /= n
        vtt = vtr = vrr = 0.0
        for i in range(len(labels)):
            if labels[i] == label:
                dt, dr = one_turn(heading[i] - mt) - shift, speed[i] - mr
                vtt += weights[i] * dt * dt
                vtr += weights[i] * dt * dr
                vrr += weights[i] * dr * dr
        # What lies in one bin is as wide as the bin.
        vtt, vtr, vrr = floor_covariance(max(vtt / n, VARIANCES[0]), vtr / n, max(vrr / n, VARIANCES[1]))
        components[used, 0], components[used, 1], components[used, 2] = n / total, one_turn(mt + shift), mr
        components[used, 3], components[used, 4], components[used, 5] = vtt, vtr, vrr
        used += 1
    return components[:used].copy()


@kernel
def _em(heading, speed, weights, components):
    """EM in place, as `swgmm.fit` does it, of bins with weights; no covariance gets smaller than a bin's.

    The variance of a bin is not subtracted (W. F. Sheppard, 1898): narrower components describe new people worse.
    Steps go farther than EM's as long as that helps (R. Salakhutdinov, S. Roweis, Adaptive overrelaxed bound
    optimization methods, ICML 2003): half as many lead as far.
    """
    n, m = len(heading), len(components)
    share = np.empty((m, 2 * WINDINGS + 1, n))
    stepped = components.copy()
    total, before, factor = weights.sum(), -np.inf, 1.0
    for iteration in range(MAX_ITERATIONS + 1):
        terms = precompute(components)
        windings = windings_of(components)
        log_likelihood = _shares(heading, speed, weights, terms, windings, share)
        if log_likelihood < before and factor > 1.0:  # too far: back to where EM would have gone
            for j in range(m):
                copy_row(stepped[j], components[j])
            factor = 1.0
            continue
        if iteration == MAX_ITERATIONS or log_likelihood - before <= TOLERANCE * total:
            return
        before, factor = log_likelihood, FARTHER * factor
        statistics = np.zeros((m, 6))
        add_statistics(heading, speed, terms, windings, share, statistics)
        for j in range(m):
            _step(statistics[j], total, components[j], stepped[j], factor)
        _normalise(components)


@kernel
def _step(statistics, total, component, stepped, factor):
    """M-step of a component in place, `factor` times as far; `stepped` is set to where 1 leads."""
    s = max(statistics[0], 1e-12 * total)
    dt, dr = statistics[1] / s, statistics[2] / s
    vtt, vtr, vrr = statistics[3] / s - dt * dt, statistics[4] / s - dt * dr, statistics[5] / s - dr * dr
    for far, to in ((1.0, stepped), (factor, component)):
        w = max(component[0] + far * (s / total - component[0]), 0.1 * component[0])
        tt, tr = component[3] + far * (vtt - component[3]), component[4] + far * (vtr - component[4])
        rr = component[5] + far * (vrr - component[5])
        tt, tr, rr = floor_covariance(max(tt, VARIANCES[0]), tr, max(rr, VARIANCES[1]))
        mt, mr = one_turn(component[1] + far * dt), component[2] + far * dr
        to[0], to[1], to[2], to[3], to[4], to[5] = w, mt, mr, tt, tr, rr


@kernel
def _shares(heading, speed, weights, terms, windings, share):
    """E-step: fill `share` [J, windings, n] with the weight of each bin times its responsibilities; log-likelihood."""
    n = len(heading)
    peak, mass = relative_densities(heading, speed, terms, windings, share)
    log_likelihood = 0.0
    for i in range(n):
        log_likelihood += weights[i] * (peak[i] + np.log(mass[i]))
        mass[i] = weights[i] / mass[i]
    for j in range(len(terms)):
        for k in range(2 * windings[j] + 1):
            for i in range(n):
                share[j, k, i] *= mass[i]
    return log_likelihood
