"""Forecasting with a snippet flow map: particles that string real snippets together.

A particle draws a snippet that starts where it is, as it walks, follows it at its own pace, and draws the next one
where that ends. A snippet whose person left takes its particle with it. The result is the geometric median, at every
second, of the particles that are still there, or what else `outputs` makes of them; all of them are the distribution.
With snippets of one step this is CLiFF-LHMP with real velocities instead of a mixture's, conditioned on heading and
speed.
"""

import numpy as np

from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.cvm import constant_velocity
from modlhmp.forecasting.median import fill_medians
from modlhmp.forecasting.observe import Observed, observed_steps, polar
from modlhmp.forecasting.outputs import with_output
from modlhmp.forecasting.paths import between, hold, paced
from modlhmp.kernels import kernel
from modlhmp.maps.pieces import HEADINGS, PARTS, SLOW_M_S, features, vector_mean
from modlhmp.maps.snippets import SnippetMap
from modlhmp.options import Snippets
from modlhmp.site import Site
from modlhmp.streams import uniform

MOST_TRIES = 50  # of the rejection sampler, after which the most similar snippet tried is taken
# The heading bins looked at by one who heads into bin h are h and its neighbours: a bin's people differ, the metric
# decides. The fourth is of those who hardly move; the last row is for one who hardly moves and looks at all.
AROUND = np.array(
    [[*sorted((h + turn) % HEADINGS for turn in (-1, 0, 1)), *[HEADINGS] * (HEADINGS - 2)] for h in range(HEADINGS)]
    + [[*range(HEADINGS + 1)]]
)
STROLL_M_S = 0.9  # who walks faster does not go on as one who hardly moves
RINGS = (1, 3)  # cells around a particle that are looked at: the second only if the first holds nothing
MOST_BINS = (2 * RINGS[-1] + 1) ** 2 * (HEADINGS + 1)


def forecaster(mod: SnippetMap, site: Site, options: Snippets) -> Forecaster:
    """The forecaster of a snippet flow map (contract: `kinds.Kind`)."""

    def forecast(observed: Observed, steps: int, keys: np.ndarray) -> Forecast:
        futures = chain(mod, observed, steps, keys, options.bandwidth_m, options.pace, options.exits, options.exclude_s)
        return with_output(futures, options.output)

    return forecast


def chain(
    mod: SnippetMap,
    observed: Observed,
    steps: int,
    keys: np.ndarray,
    bandwidth_m: float,
    pace: float = 1.0,
    exits: bool = True,
    exclude_s: float = 0.0,
) -> Forecast:
    """Forecast with a `SnippetMap`; returns a `Forecast`, its first future the median, then one per key.

    A snippet is drawn with probability proportional to exp(-d^2 / (2 `bandwidth_m`^2)), d being how unlike it and the
    particle are. Without `exits` a particle whose snippet ends in one draws another. Snippets within `exclude_s` of the
    walker's t0 are left out ("no contemporaries"; others up to a minute beyond, since a map knows full minutes only).
    A walker near whom nobody walked this way goes on at constant velocity and counts as not alive from the start.
    """
    here = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
    velocities, t0 = observed_steps(observed), observed.t[:, -1]
    points, speed = features(here, velocities, mod.weights, mod.metric, mod.metric.hour(t0, mod.timezone))
    velocity = polar(vector_mean(velocities, mod.weights))
    walkers = (points, speed, velocity[1], t0 / 60.0)
    xy, alive = _chain(mod.arrays, keys, *walkers, exclude_s / 60.0, steps, bandwidth_m, pace, exits)
    fill_medians(xy, alive)
    nowhere = alive[:, 0] == 0
    straight = constant_velocity(observed, velocity, steps, mod.step_s)
    xy[nowhere] = straight.xy[nowhere]
    return Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, "median")


@kernel
def _chain(mod, keys, points, speeds, headings, minutes, exclude, steps, bandwidth_m, pace, exits):
    """Futures [n, 1 + k, T, 2] and how many steps each is alive [n, 1 + k], with room for the median as the first.

    `mod` are the map's `SnippetArrays`.
    """
    # Single arrays from here on: handing the whole tuple to a function costs as much as that function does.
    (
        index, origin, cell, starts, count, starting, speed_of, ends, leaves, minute_of, path, past, step_s, weights,
        metric,
    ) = mod  # fmt: skip
    n, k = keys.shape
    xy = np.empty((n, 1 + k, steps, 2), np.float32)
    alive = np.zeros((n, 1 + k), np.int32)
    bins, upto = np.empty(MOST_BINS, np.int64), np.empty(MOST_BINS)
    point = np.empty(PARTS)
    for i in range(n):
        for j in range(1, 1 + k):
            point[:], speed, heading = points[i], speeds[i], headings[i]
            # When the present snippet began, in steps since t0; steps done; random numbers used.
            began, step, drawn = 0.0, 0, 0
            while step < steps:
                number = _bins_around(index, origin, cell, count, point, speed, heading, bins, upto)
                row, drawn = _draw(
                    starts, count, starting, minute_of, bins, upto, number,
                    keys[i, j - 1], drawn, point, minutes[i], exclude, bandwidth_m,
                )  # fmt: skip
                if row < 0:
                    break
                rate, end = paced(speed, speed_of[row], pace), ends[row]
                while step < steps and (step + 1 - began) * rate <= end:
                    at = past + (step + 1 - began) * rate
                    for axis in range(2):
                        xy[i, j, step, axis] = point[axis] + between(path[row], at, axis)
                    step += 1
                if leaves[row] and exits:
                    break
                began += end / rate
                speed, heading = _move_on(point, path[row], past + end, rate / step_s, weights, metric)
            alive[i, j] = step
            hold(xy[i, j], step, points[i, :2])
    return xy, alive


@kernel
def _move_on(point, path, at, rate, weights, metric):
    """Turn `point` into that of a particle at row `at` of a snippet's path; returns its speed and heading."""
    vx = vy = 0.0
    for m in range(len(weights)):
        vx += rate * weights[m] * _step(path, at - m, 0)
        vy += rate * weights[m] * _step(path, at - m, 1)
    speed, oldest = np.sqrt(vx * vx + vy * vy), at - len(weights) + 1
    point[0] += path[at, 0]
    point[1] += path[at, 1]
    point[2] = metric[0] * vx / max(speed, SLOW_M_S)
    point[3] = metric[0] * vy / max(speed, SLOW_M_S)
    point[4] = metric[1] * speed
    for axis in range(2):
        point[5 + axis] = metric[2] * rate * (_step(path, at, axis) - _step(path, oldest, axis))
    return speed, np.arctan2(vy, vx)


@kernel
def _step(path, at, axis):
    """From the row before row `at` of a path [m, 2] to this; in a kernel, float() would leave it float32."""
    return np.float64(path[at, axis]) - np.float64(path[at - 1, axis])


@kernel
def _draw(starts, count, points, minutes, bins, upto, number, key, drawn, point, minute, exclude, bandwidth_m):
    """A snippet for a particle, -1 if there is none around, and the number of random numbers used so far.

    It is of the `number` first `bins`; `starts` [b + 1], `count` [b], `points` [m, 8] and `minutes` [m] are the map's.
    """
    best, nearest, narrow = -1, np.inf, 0.5 / bandwidth_m**2
    for _ in range(MOST_TRIES if number else 0):
        at, accept = uniform(key, drawn) * upto[number - 1], uniform(key, drawn + 1)
        drawn += 2
        place = _place(upto, number, at)
        b = bins[place]
        size = starts[b + 1] - starts[b]
        row = starts[b] + min(int((upto[place] - at) / count[b] * size), size - 1)
        if exclude > 0.0 and -exclude - 1.0 < minutes[row] - minute <= exclude:
            continue
        d2 = _unlike(point, points, row)
        x = d2 * narrow
        # 1 + x + x^2 / 2 < exp(x): most are rejected without an exponential.
        if accept * (1.0 + x * (1.0 + 0.5 * x)) < 1.0 and accept < np.exp(-x):
            return row, drawn
        best, nearest = row if d2 < nearest else best, min(d2, nearest)
    return best, drawn


@kernel(fastmath={"reassoc", "contract"})
def _unlike(point, points, row):
    """Squared distance of a point [8] from a row of `points` [m, 8]."""
    d2 = 0.0
    for part in range(PARTS):
        d2 += (point[part] - points[row, part]) ** 2
    return d2


@kernel
def _place(upto, number, at):
    """How many of the first `number` of the rising `upto`, but for the last, are at most `at`.

    They are few: comparing with all, several at once, takes less time than the branches of a binary search.
    """
    place = 0
    for other in range(number - 1):
        place += upto[other] <= at
    return place


@kernel
def _bins_around(index, origin, cell, count, point, speed, heading, bins, upto):
    """Fill `bins` around a particle and `upto`, how many pieces they and those before stand for; returns their number.

    A particle that hardly moves looks at all headings, one that walks at the bins around its own, and one that strolls
    at those who hardly move as well. `index`, `origin`, `cell` and `count` are the map's.
    """
    own = int(np.rint(heading * HEADINGS / (2 * np.pi))) % HEADINGS  # not from the point: there it may count nothing
    looked_at = AROUND[HEADINGS if speed < SLOW_M_S else own]
    headings = HEADINGS + 1 if speed < SLOW_M_S else 4 if speed < STROLL_M_S else 3
    ci, cj = int(np.floor(point[0] / cell)) - origin[0], int(np.floor(point[1] / cell)) - origin[1]
    number, total = 0, 0.0
    for ring in RINGS:
        for i in range(max(ci - ring, 0), min(ci + ring + 1, index.shape[0])):
            for j in range(max(cj - ring, 0), min(cj + ring + 1, index.shape[1])):
                for h in range(headings):
                    b = index[i, j, looked_at[h]]
                    if b >= 0:
                        total += count[b]
                        bins[number], upto[number] = b, total
                        number += 1
        if number:
            break
    return number
