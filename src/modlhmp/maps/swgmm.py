"""Semi-wrapped Gaussian mixture over (heading, speed): density and expectation maximisation.

p(theta, rho) = sum_j w_j sum_{k=-1..1} N([theta + 2 pi k, rho]; mu_j, Sigma_j), the mixture of the CLiFF-map
(paper Sec. III-C.1; T. Kucner et al., Enabling flow awareness for mobile robots in partially observable environments,
RA-L 2017).
A component is six numbers: weight, mean heading, mean speed, var(heading), cov(heading, speed), var(speed).
"""

import numpy as np

from modlhmp.angles import TWO_PI, circular_mean, one_turn, unwrapped
from modlhmp.kernels import kernel

WINDINGS = 1  # k = -1, 0, 1
MIN_EIGENVALUE = 1e-4  # floor of a covariance's eigenvalues
TOLERANCE = 1e-5  # gain of log-likelihood per observation below which EM has converged
MAX_ITERATIONS = 100
NARROW = 0.2  # below this var(heading) a component's other windings are e^-24 of its peak: EM takes the nearest only
BLOCK = 256  # observations that EM takes at a time


def log_density(heading: np.ndarray, speed: np.ndarray, components: np.ndarray) -> np.ndarray:
    """Log of the mixture density at each observation, shape [n]; `components` is [J, 6]."""
    heading, speed = np.atleast_1d(heading).astype(float), np.atleast_1d(speed).astype(float)
    out = np.empty(len(heading))
    terms = precompute(np.asarray(components, float))
    _log_density_many(heading, speed, terms, out)
    return out


def fit(heading: np.ndarray, speed: np.ndarray, components: np.ndarray) -> tuple[np.ndarray, float]:
    """Expectation maximisation from the given `components` [J, 6]; returns (components [J, 6], log-likelihood).

    Responsibilities use log-sum-exp, so no observation loses its weight; components that end below
    one observation are removed. The log-likelihood is the total over all observations.
    """
    components = np.array(components, float)
    while True:
        log_likelihood = _em(heading, speed, components, MAX_ITERATIONS, TOLERANCE)
        heavy = components[:, 0] * len(heading) >= 1.0
        if heavy.all():
            return components, log_likelihood
        components = components[heavy]
        components[:, 0] /= components[:, 0].sum()


@kernel
def floor_covariance(vtt, vtr, vrr):
    """Raise the eigenvalues of [[vtt, vtr], [vtr, vrr]] to at least `MIN_EIGENVALUE`."""
    half, d = 0.5 * (vtt + vrr), 0.5 * (vtt - vrr)
    root = np.sqrt(d * d + vtr * vtr)
    low, high = half - root, half + root
    if low >= MIN_EIGENVALUE:
        return vtt, vtr, vrr
    new_low, new_high = max(low, MIN_EIGENVALUE), max(high, MIN_EIGENVALUE)
    if root < 1e-300:
        return new_high, 0.0, new_high
    # Sigma = low I + (high - low) P with P the projector on the leading eigenvector.
    scale = (new_high - new_low) / (2.0 * root)
    centre = 0.5 * (new_low + new_high)
    return centre + scale * d, scale * vtr, centre - scale * d


@kernel
def floor_covariances(components):
    """`floor_covariance` of components [J, 6], in place."""
    for j in range(len(components)):
        vtt, vtr, vrr = floor_covariance(components[j, 3], components[j, 4], components[j, 5])
        components[j, 3], components[j, 4], components[j, 5] = vtt, vtr, vrr


@kernel
def moments(heading, speed):
    """Circular-linear mean and covariance of observations: [mean heading, mean speed, vtt, vtr, vrr]."""
    mean_heading = circular_mean(heading)
    d_heading = one_turn(heading - mean_heading)
    mean_heading += d_heading.mean()
    d_heading -= d_heading.mean()
    d_speed = speed - speed.mean()
    vtt, vtr, vrr = floor_covariance((d_heading**2).mean(), (d_heading * d_speed).mean(), (d_speed**2).mean())
    return np.array([mean_heading, speed.mean(), vtt, vtr, vrr])


@kernel
def copy_row(source, to):
    """Copy a component [6]: numba takes many times as long to compile an assignment of slices."""
    for i in range(6):
        to[i] = source[i]


@kernel
def precompute(components):
    """[J, 6] components to [J, 6] terms: log weight - log(2 pi sqrt(det)), means, inverse covariance."""
    terms = np.empty_like(components)
    for j in range(len(components)):
        w, mt, mr, vtt, vtr, vrr = components[j]
        det = vtt * vrr - vtr * vtr
        terms[j, 0] = np.log(w) - np.log(TWO_PI) - 0.5 * np.log(det)
        terms[j, 1], terms[j, 2] = mt, mr
        terms[j, 3], terms[j, 4], terms[j, 5] = vrr / det, -vtr / det, vtt / det
    return terms


@kernel
def windings_of(components):
    """How many windings to each side of components [J, 6] EM takes, [J]."""
    windings = np.empty(len(components), np.int64)
    for j in range(len(components)):
        windings[j] = 0 if components[j, 3] < NARROW else WINDINGS
    return windings


@kernel(inline="always")
def log_density_one(heading, speed, terms, first, last):
    """Log mixture density of one velocity under the components `first` to `last` - 1 of `terms`."""
    peak, total = -np.inf, 0.0  # the sum is total * exp(peak)
    for j in range(first, last):
        for k in range(-WINDINGS, WINDINGS + 1):
            exponent = _exponent(heading + TWO_PI * k, speed, terms, j)
            if exponent > peak:
                total = total * np.exp(peak - exponent) + 1.0
                peak = exponent
            elif exponent > peak - 40.0:  # less is below the last bit of the sum
                total += np.exp(exponent - peak)
    return peak + np.log(total)


@kernel(inline="always")
def _exponent(heading, speed, terms, j):
    dt, dr = heading - terms[j, 1], speed - terms[j, 2]
    return terms[j, 0] - 0.5 * (terms[j, 3] * dt * dt + 2.0 * terms[j, 4] * dt * dr + terms[j, 5] * dr * dr)


@kernel
def _log_density_many(heading, speed, terms, out):
    for i in range(len(heading)):
        out[i] = log_density_one(heading[i], speed[i], terms, 0, len(terms))


@kernel
def _em(heading, speed, components, max_iterations, tolerance):
    """EM in place; the sufficient statistics of each component are gathered in one pass over the data.

    The data are taken in blocks whose loops run over observations, so that the processor's vector units do them.
    """
    n, m = len(heading), len(components)
    share = np.empty((m, 2 * WINDINGS + 1, BLOCK))
    statistics = np.empty((m, 6))
    before = -np.inf
    for iteration in range(max_iterations + 1):
        terms = precompute(components)
        windings = windings_of(components)
        statistics[:] = 0.0
        log_likelihood = 0.0
        for first in range(0, n, BLOCK):
            some = slice(first, min(first + BLOCK, n))
            log_likelihood += _responsibilities(heading[some], speed[some], terms, windings, share)
            add_statistics(heading[some], speed[some], terms, windings, share, statistics)
        if iteration == max_iterations or log_likelihood - before <= tolerance * n:
            break  # the log-likelihood is that of the components as they stand
        before = log_likelihood
        for j in range(m):
            s = statistics[j, 0]
            if s < 1e-12:
                components[j, 0] = 1e-12
                continue
            dt, dr = statistics[j, 1] / s, statistics[j, 2] / s
            components[j, 0] = s / n
            components[j, 1] = one_turn(components[j, 1] + dt)
            components[j, 2] += dr
            components[j, 3], components[j, 4], components[j, 5] = floor_covariance(
                statistics[j, 3] / s - dt * dt, statistics[j, 4] / s - dt * dr, statistics[j, 5] / s - dr * dr
            )
    return log_likelihood


@kernel
def relative_densities(heading, speed, terms, windings, density):
    """Fill `density` [J, windings, n] with each wrapped component's of n observations, over the largest of each.

    Returns the logarithm of that largest one [n] and the sum of all over it [n].
    """
    n = len(heading)
    peak, total = np.full(n, -np.inf), np.zeros(n)
    for j in range(len(terms)):
        for k in range(-windings[j], windings[j] + 1):
            exponent = density[j, k + windings[j]]
            for i in range(n):
                dt, dr = unwrapped(heading[i] - terms[j, 1], k), speed[i] - terms[j, 2]
                quadratic = terms[j, 3] * dt * dt + 2.0 * terms[j, 4] * dt * dr + terms[j, 5] * dr * dr
                exponent[i] = terms[j, 0] - 0.5 * quadratic
                peak[i] = max(peak[i], exponent[i])
    for j in range(len(terms)):
        for k in range(2 * windings[j] + 1):
            relative = density[j, k]
            for i in range(n):
                relative[i] = exp_of_negative(relative[i] - peak[i])
                total[i] += relative[i]
    return peak, total


@kernel
def _responsibilities(heading, speed, terms, windings, share):
    """E-step of a block: fill `share` [J, windings, n] with r_jk of every observation; returns its log-likelihood."""
    n = len(heading)
    peak, total = relative_densities(heading, speed, terms, windings, share)
    log_likelihood, product = peak.sum(), 1.0
    for i in range(n):  # one logarithm for many: a total is between 1 and the number of terms
        product *= total[i]
        if product > 1e200:
            log_likelihood += np.log(product)
            product = 1.0
        total[i] = 1.0 / total[i]
    log_likelihood += np.log(product)
    for j in range(len(terms)):
        for k in range(2 * windings[j] + 1):
            for i in range(n):
                share[j, k, i] *= total[i]
    return log_likelihood


@kernel(fastmath={"reassoc"})
def add_statistics(heading, speed, terms, windings, share, statistics):
    """Add a block's sums of r, r dt, r dr, r dt^2, r dt dr, r dr^2 about the present means, so that nothing cancels."""
    for j in range(len(terms)):
        for k in range(-windings[j], windings[j] + 1):
            r = share[j, k + windings[j]]
            s0 = s1 = s2 = s3 = s4 = s5 = 0.0
            for i in range(len(heading)):
                dt, dr = unwrapped(heading[i] - terms[j, 1], k), speed[i] - terms[j, 2]
                s0 += r[i]
                s1 += r[i] * dt
                s2 += r[i] * dr
                s3 += r[i] * dt * dt
                s4 += r[i] * dt * dr
                s5 += r[i] * dr * dr
            statistics[j, 0] += s0
            statistics[j, 1] += s1
            statistics[j, 2] += s2
            statistics[j, 3] += s3
            statistics[j, 4] += s4
            statistics[j, 5] += s5


@kernel(inline="always")
def exp_of_negative(x):
    """exp(x) of x <= 0 to 1e-12 of 1, as (e^(x / 1024))^1024: sums and products only, so that loops of it vectorise."""
    y = max(x, -40.0) / 1024.0
    e = 1.0 + y * (1.0 + y * (1 / 2 + y * (1 / 6 + y * (1 / 24 + y * (1 / 120 + y / 720)))))
    for _ in range(10):
        e *= e
    return e
