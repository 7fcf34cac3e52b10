"""Slow, plain twins of the package's fast routines: loops that follow the formulas of the paper word by word.

The routines under test must equal them. Nothing here is fast, and nothing is taken from the package but its
demo recordings and its cleaning, which `demo_tracks` calls.
"""

import math
from collections import defaultdict
from datetime import datetime
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from zoneinfo import ZoneInfo

import numpy as np
import yaml
from scipy.stats import multivariate_normal

from modlhmp.cleaning import clean_recording
from modlhmp.file_format import FileFormat, Recording
from modlhmp.settings import build
from modlhmp.study import demo

TWO_PI = 2.0 * math.pi
WINDINGS = (-1, 0, 1)


def wrap(angle):
    """The angle in (-pi, pi] that differs from `angle` by whole turns."""
    while angle > math.pi:
        angle -= TWO_PI
    while angle <= -math.pi:
        angle += TWO_PI
    return angle


def covariance(component):
    """Sigma = [[var(heading), cov], [cov, var(speed)]] of a component (w, mt, mr, vtt, vtr, vrr)."""
    return np.array([[component[3], component[4]], [component[4], component[5]]])


# --- semi-wrapped Gaussian mixture --------------------------------------------------------------------------


def swgmm_density(heading, speed, components):
    """p(theta, rho) = sum_j w_j sum_{k = -1, 0, 1} N([theta, rho]; mu_j + [2 pi k, 0], Sigma_j), shape [n]."""
    points = np.column_stack([np.atleast_1d(heading), np.atleast_1d(speed)])
    total = np.zeros(len(points))
    for component in components:
        for k in WINDINGS:
            mean = [component[1] + TWO_PI * k, component[2]]
            total += component[0] * np.atleast_1d(multivariate_normal(mean, covariance(component)).pdf(points))
    return total


def floored(sigma, floor):
    """Sigma with its eigenvalues raised to `floor`: U max(Lambda, floor) U^T."""
    values, vectors = np.linalg.eigh(sigma)
    return vectors @ np.diag(np.maximum(values, floor)) @ vectors.T


def em_step(heading, speed, components, floor):
    """One step of expectation maximisation, components [J, 6] to components [J, 6].

    E: r_ijk = w_j N(x_i; mu_j + [2 pi k, 0], S_j) / sum_jk of the same.
    M: w_j = sum_ik r / n, mu_j = sum_ik r (x_i - [2 pi k, 0]) / sum_ik r,
       S_j = sum_ik r (x_i - [2 pi k, 0] - mu_j)(...)^T / sum_ik r, eigenvalues floored.
    """
    points = np.column_stack([heading, speed])
    unwrapped = np.stack([points - [TWO_PI * k, 0.0] for k in WINDINGS], axis=1)
    r = np.empty((len(points), len(components), len(WINDINGS)))
    for j, component in enumerate(components):
        normal = multivariate_normal(component[1:3], covariance(component))
        r[:, j] = component[0] * normal.pdf(unwrapped)
    r /= r.sum(axis=(1, 2), keepdims=True)
    updated = []
    for j in range(len(components)):
        share = r[:, j].sum()
        mean = np.einsum("ik,ikd->d", r[:, j], unwrapped) / share
        away = unwrapped - mean
        sigma = floored(np.einsum("ik,ikd,ike->de", r[:, j], away, away) / share, floor)
        updated.append([share / len(points), wrap(mean[0]), mean[1], sigma[0, 0], sigma[0, 1], sigma[1, 1]])
    return np.array(updated)


def em(heading, speed, components, floor=1e-4, tolerance=1e-5, max_iterations=100):
    """EM steps until one gains no more than `tolerance` an observation; (components, log-likelihoods on the way)."""
    gained = [np.log(swgmm_density(heading, speed, components)).sum()]
    for _ in range(max_iterations):
        components = em_step(heading, speed, components, floor)
        gained.append(np.log(swgmm_density(heading, speed, components)).sum())
        if gained[-1] - gained[-2] <= tolerance * len(heading):
            break
    return components, gained


# --- mean shift ---------------------------------------------------------------------------------------------


def mean_shift(heading, speed, bandwidth, merge=0.5):
    """Exact mean shift from every observation over all observations: (labels [n], modes [m, 2]).

    x <- x + sum_ik K(d_ik) d_ik / sum_ik K(d_ik) with d_ik = x_i + [2 pi k, 0] - x, three windings, and K a Gaussian
    of standard deviations `bandwidth`. Ends closer than `merge` bandwidths are one mode.
    """
    data, h = np.column_stack([heading, speed]), np.asarray(bandwidth, float)
    at = data.copy()
    for _ in range(5000):
        away = data[None] - at[:, None]
        away[..., 0] = np.angle(np.exp(1j * away[..., 0]))
        away = np.stack([away + np.array([TWO_PI * k, 0.0]) for k in WINDINGS], axis=2)
        kernel = np.exp(-0.5 * ((away / h) ** 2).sum(axis=-1))
        step = np.einsum("sik,sikd->sd", kernel, away) / kernel.sum(axis=(1, 2))[:, None]
        at += step
        if (np.abs(step) < 1e-7 * h).all():
            break
    labels, modes = [], []
    for end in at:
        near = [m for m, mode in enumerate(modes) if cylinder_distance(end, mode, h) < merge]
        if not near:
            modes.append(np.array([wrap(end[0]), end[1]]))
        labels.append(near[0] if near else len(modes) - 1)
    return np.array(labels), np.array(modes)


def cylinder_distance(a, b, bandwidth):
    """Distance of two velocities (heading, speed) in bandwidths."""
    return math.hypot(wrap(a[0] - b[0]) / bandwidth[0], (a[1] - b[1]) / bandwidth[1])


# --- CLiFF-map ----------------------------------------------------------------------------------------------


def neighbourhoods(x, y, resolution, radius, min_observations):
    """{(node x, node y): observations within the closed ball}, for lattice nodes i * resolution with enough."""
    reach = math.ceil(radius / resolution) + 1

    def indices(v):
        return range(math.floor(min(v) / resolution) - reach, math.ceil(max(v) / resolution) + reach + 1)

    found = {}
    for node in ((i * resolution, j * resolution) for i in indices(x) for j in indices(y)):
        ball = [n for n in range(len(x)) if math.hypot(x[n] - node[0], y[n] - node[1]) <= radius]
        if len(ball) >= min_observations:
            found[node] = ball
    return found


def locate(x, y, locations, p, radius):
    """Algorithm 2, lines 1-2: of the locations with distance <= radius the one with the largest p, or -1.

    Equal p: the nearest of them, then the first.
    """
    near = [(-p[n], math.hypot(at[0] - x, at[1] - y), n) for n, at in enumerate(locations)]
    near = [candidate for candidate in near if candidate[1] <= radius]
    return min(near)[2] if near else -1


class PlainCliff:
    """Algorithm 2 on a table of components (dict of columns), one particle at a time."""

    draws = 3

    def __init__(self, columns, radius):
        self.radius, self.mixtures = radius, {}
        for n in range(len(columns["x"])):
            at = columns["x"][n], columns["y"][n], columns["p"][n]
            names = ("weight", "mean_heading", "mean_speed", "var_heading", "cov_heading_speed", "var_speed")
            self.mixtures.setdefault(at, []).append([columns[name][n] for name in names])
        self.locations, self.p = [key[:2] for key in self.mixtures], [key[2] for key in self.mixtures]

    def sample(self, x, y, speed, u):
        """(speed, heading, log fitness) of a draw from the mixture in reach, or None.

        The component by cumulative weight; z = sqrt(-2 ln u1) (cos 2 pi u2, sin 2 pi u2) is standard normal,
        mu + L z with L L^T = Sigma has the component's distribution. A negative speed counts as 0.
        """
        row = locate(x, y, self.locations, self.p, self.radius)
        if row < 0:
            return None
        mixture = list(self.mixtures.values())[row]
        weights = [component[0] for component in mixture]
        chosen = next((j for j in range(len(mixture)) if u[0] <= sum(weights[: j + 1])), len(mixture) - 1)
        r = math.sqrt(-2.0 * math.log(u[1]))
        z = r * math.cos(TWO_PI * u[2]), r * math.sin(TWO_PI * u[2])
        theta, rho = mixture[chosen][1:3] + np.linalg.cholesky(covariance(mixture[chosen])) @ z
        theta, rho = wrap(theta), max(rho, 0.0)
        return rho, theta, math.log(swgmm_density(theta, rho, mixture)[0])


# --- STeF-map -----------------------------------------------------------------------------------------------


def nearest_orientation(heading, orientations):
    """The i whose direction i * 2 pi / orientations is nearest to the heading."""
    return min(range(orientations), key=lambda i: abs(wrap(heading - i * TWO_PI / orientations)))


def stef_signals(rows, timezone, orientations, interval_s):
    """(times [T], {(cell, orientation): signal [T]}) of rows (t, x, y, heading), cells of 1 m.

    Detections are counted by cell, interval of the local day and direction, and divided by the busiest direction's
    count in that cell and interval. Every interval of every day with data counts; nobody there is 0.
    """
    counts, days = defaultdict(lambda: defaultdict(int)), set()
    for t, x, y, heading in rows:
        clock = datetime.fromtimestamp(t, ZoneInfo(timezone))
        second = clock.hour * 3600 + clock.minute * 60 + clock.second
        when = clock.date().toordinal(), int(second // interval_s)
        days.add(when[0])
        counts[(math.floor(x), math.floor(y)), when][nearest_orientation(heading, orientations)] += 1
    slots = [(day, slot) for day in sorted(days) for slot in range(math.ceil(86400 / interval_s))]
    signals = {}
    for cell in sorted({key[0] for key in counts}):
        for o in range(orientations):
            here = [counts.get((cell, when), {}) for when in slots]
            signals[cell, o] = [seen.get(o, 0) / max(seen.values()) if seen else 0.0 for seen in here]
    return [(day - min(days)) * 86400 + (slot + 0.5) * interval_s for day, slot in slots], signals


def fremen(times, signal, order):
    """(mean, [(amplitude, phase, period)] * order), strongest first, of periods 24 h / i, i = 1..24.

    a_i = |1/n sum (s - mean) exp(2 pi j t / T_i)|, only where 1.5 T_i fits into the time covered; of parts that are
    equally strong the longer period comes first; parts that are wanting have amplitude 0.
    """
    mean = math.fsum(signal) / len(signal)
    parts = []
    for i in range(1, 25):
        period = 86400.0 / i
        if 1.5 * period <= max(times) - min(times):
            both = list(zip(times, signal, strict=True))
            re = math.fsum((s - mean) * math.cos(TWO_PI * t / period) for t, s in both) / len(both)
            im = math.fsum((s - mean) * math.sin(TWO_PI * t / period) for t, s in both) / len(both)
            parts.append((math.hypot(re, im), math.atan2(im, re), period))
    parts.sort(key=lambda part: (-round(part[0], 12), -part[2]))
    return mean, (parts + [(0.0, 0.0, 86400.0)] * order)[:order]


def fremen_value(t, mean, parts):
    """p(t) = mean + 2 sum_i a_i cos(2 pi t / T_i - phi_i), clipped to [0, 1]."""
    value = mean + 2.0 * sum(a * math.cos(TWO_PI * t / period - phase) for a, phase, period in parts)
    return min(max(value, 0.0), 1.0)


class PlainStef:
    """Algorithm 3 on cell centres and orientation probabilities, one particle at a time."""

    draws = 1

    def __init__(self, x, y, probabilities, radius):
        self.cells, self.radius = list(zip(x, y, probabilities, strict=True)), radius

    def sample(self, x, y, speed, u):
        """(speed, heading, log fitness): a direction of the nearest cell by its probabilities, or None.

        No dynamics: no cell centre at distance <= radius, or the nearest one's probabilities are all 0.
        """
        distances = [math.hypot(cell[0] - x, cell[1] - y) for cell in self.cells]
        nearest = distances.index(min(distances))
        share = self.cells[nearest][2]
        if distances[nearest] > self.radius or sum(share) == 0.0:
            return None
        possible = [i for i in range(len(share)) if share[i] > 0]
        chosen = next((i for i in possible if u[0] <= sum(share[: i + 1])), possible[-1])
        return speed, wrap(chosen * TWO_PI / len(share)), math.log(share[chosen])


# --- roll-out -----------------------------------------------------------------------------------------------


def roll_out(mod, x, y, speed, heading, draws, step_s, beta, speed_rule):
    """Algorithm 1 for one particle: ([(x, y)] * T, [cumulative log fitness] * T, steps alive).

    x_t = x_{t-1} + rho cos(theta) dt, then theta_t = theta_{t-1} + d exp(-beta d^2) with d the wrapped difference of
    the heading sampled at x_t, and likewise the speed where the rule is "kernel". `draws` [T, mod.draws]. From the
    first step without dynamics on, position and fitness stay as they were.
    """
    path, fitness, total, alive = [], [], 0.0, 0
    for u in draws:
        if alive == len(path):
            to = x + speed * math.cos(heading) * step_s, y + speed * math.sin(heading) * step_s
            sampled = mod.sample(*to, speed, u)
            if sampled is not None:
                x, y = to
                d_speed, d_heading = sampled[0] - speed, wrap(sampled[1] - heading)
                heading = wrap(heading + d_heading * math.exp(-beta * d_heading**2))
                if speed_rule == "kernel":
                    speed += d_speed * math.exp(-beta * d_speed**2)
                total += sampled[2]
                alive += 1
        path.append((x, y))
        fitness.append(total)
    return path, fitness, alive


# --- neighbours ---------------------------------------------------------------------------------------------


def find_neighbours(people, who, row, rows, step_s, radius=6.0, most=5, late=1.05):
    """[(person, [(x, y) or None] * rows)] around person `who` at that person's `row`, the nearest first.

    `people` is a list of lists of (t, x, y). Of another person the rows up to t0 are known; the newest must be younger
    than `late` steps. Beyond it the last velocity goes on (0 without a row in the 5 s, or 2.05 steps, before it),
    between rows the path is linear, and at times more than `late` - 1 steps before the first row the person is absent.
    """
    t0, x0, y0 = people[who][row]
    found = []
    for person, walk in enumerate(people):
        known = [at for at in walk if at[0] <= t0]
        if person == who or not known or t0 - known[-1][0] >= late * step_s:
            continue
        velocity = 0.0, 0.0
        if len(known) > 1 and 0 < known[-1][0] - known[-2][0] <= max(5.0, 2.05 * step_s):
            dt = known[-1][0] - known[-2][0]
            velocity = (known[-1][1] - known[-2][1]) / dt, (known[-1][2] - known[-2][2]) / dt
        seen = [
            None if t < known[0][0] - (late - 1.0) * step_s else position(known, t, velocity)
            for t in (t0 - step_s * back for back in range(rows - 1, -1, -1))
        ]
        distance = math.hypot(seen[-1][0] - x0, seen[-1][1] - y0)
        if distance <= radius:
            found.append((distance, person, seen))
    return [(person, seen) for _, person, seen in sorted(found)[:most]]


def position(walk, t, velocity=(0.0, 0.0)):
    """(x, y) at time t of rows (t, x, y): linear between two, the first before them, going on at `velocity` after."""
    if t <= walk[0][0]:
        return walk[0][1:]
    for (ta, xa, ya), (tb, xb, yb) in pairwise(walk):
        if t <= tb:
            share = (t - ta) / (tb - ta)
            return xa + share * (xb - xa), ya + share * (yb - ya)
    last, x, y = walk[-1]
    return x + velocity[0] * (t - last), y + velocity[1] * (t - last)


# --- scoring ------------------------------------------------------------------------------------------------


def ground_truth(t, x, y, observed_rows, steps, step_s):
    """Truth of one track: ([(x, y) or None] * steps, eligible steps); rows beyond t0 linearly interpolated."""
    t0 = t[observed_rows - 1]
    length = math.floor((t[-1] - t0) / step_s + 0.05)
    positions = []
    for h in range(1, steps + 1):
        when = min(t0 + h * step_s, t[-1])
        after = next(n for n in range(1, len(t)) if t[n] >= when)
        share = (when - t[after - 1]) / (t[after] - t[after - 1])
        at = tuple(v[after - 1] + share * (v[after] - v[after - 1]) for v in (x, y))
        positions.append(at if h <= length else None)
    return positions, length


def is_idle(x, y, apart, min_displacement_m):
    """Whether two rows of one track that are `apart` rows of each other are less than the displacement apart."""
    return any(math.hypot(x[n + apart] - x[n], y[n + apart] - y[n]) < min_displacement_m for n in range(len(x) - apart))


def errors_at(path, truth, h):
    """(ADE, FDE) at horizon h steps: mean and last of the distances of the steps 1..h."""
    away = [math.dist(path[n], truth[n]) for n in range(h)]
    return sum(away) / h, away[-1]


def score(protocol, output, paths, fitness, alive, truth, eligible, h):
    """(ADE, FDE) of one track at horizon h steps under a protocol, or None where it is not scored.

    paper: of the futures alive at h the best ranked, or the mean of their errors; none alive: not scored.
    complete: of the futures that lived longest up to h the best ranked; the mean is over all futures.
    The path of mean positions needs all futures alive under the paper protocol.
    """
    if h > eligible:
        return None
    everyone = range(len(paths))
    lived = [min(alive[n], h) for n in everyone]
    counted = [n for n in everyone if lived[n] == (h if protocol == "paper" else max(lived))]
    if not counted:
        return None
    if output == "mean_path":
        middle = [tuple(sum(paths[n][s][axis] for n in everyone) / len(paths) for axis in (0, 1)) for s in range(h)]
        return errors_at(middle, truth, h) if protocol == "complete" or len(counted) == len(paths) else None
    if output == "mean":
        counted = counted if protocol == "paper" else everyone
        each = [errors_at(paths[n], truth, h) for n in counted]
        return sum(e[0] for e in each) / len(each), sum(e[1] for e in each) / len(each)
    return errors_at(paths[max(counted, key=lambda n: (fitness[n][h - 1], -n))], truth, h)


def mean(values):
    """Mean of a list, NaN if it is empty."""
    return math.fsum(values) / len(values) if len(values) else math.nan


def deviation(values):
    """Sample standard deviation (n - 1), NaN for fewer than two values."""
    if len(values) < 2:
        return math.nan
    return math.sqrt(sum((v - mean(values)) ** 2 for v in values) / (len(values) - 1))


def holm(p):
    """Textbook step-down: the i-th smallest of m p values times m - i + 1, at least the one before, at most 1."""
    tested = sorted((value, n) for n, value in enumerate(p) if not math.isnan(value))
    adjusted, before = [math.nan] * len(p), 0.0
    for rank, (value, n) in enumerate(tested):
        before = max(before, min(1.0, (len(tested) - rank) * value))
        adjusted[n] = before
    return adjusted


# --- demo data ----------------------------------------------------------------------------------------------


@cache
def demo_tracks(day, scale=1.0, seed=1):
    """Clean tracks of one day of the demo hall, by the keys of config/datasets/demo_hall.yaml."""
    keys = yaml.safe_load((Path(__file__).parents[2] / "config/datasets/demo_hall.yaml").read_text())
    with TemporaryDirectory() as folder:
        path = Path(folder) / "hall.csv"
        demo.write_recording(path, "hall", day, seed, scale)
        return clean_recording(path, build(FileFormat, keys), Recording(day=day))[0]
