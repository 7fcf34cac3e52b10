"""Forecasting with a snippet flow map: particles that string real snippets together.

A particle draws a snippet that starts where it is, as it walks, follows it at its own pace, and draws the next one
where that ends. A snippet whose person left takes its particle with it. The result is the geometric median, at every
second, of the particles that are still there; all of them are the distribution. With snippets of one step this is
CLiFF-LHMP with real velocities instead of a mixture's, conditioned on heading and speed.
"""

import numpy as np

from modlhmp.forecasting.base import Forecast, uniform
from modlhmp.forecasting.cvm import constant_velocity
from modlhmp.forecasting.median import with_median
from modlhmp.forecasting.observe import observed_steps, polar
from modlhmp.forecasting.replay import between, hold, paced
from modlhmp.kernels import kernel
from modlhmp.maps.pieces import HEADINGS, SLOW_M_S, features, vector_mean
from modlhmp.tracks import clock_time

MOST_TRIES = 50  # of the rejection sampler, after which the most similar snippet tried is taken
NEIGHBOURING = 1.5  # heading bins to the middle of a bin that is looked at: a bin's people differ, the metric decides
STROLL_M_S = 0.9  # who walks faster does not go on as one who hardly moves
RINGS = (1, 3)  # cells around a particle that are looked at: the second only if the first holds nothing


def chain(mod, observed, steps, keys, kernel_m, pace=1.0, exits=True, exclude_s=0.0):
    """Forecast with a `SnippetMap`; returns a `Forecast`, its first future the median, then one a key.

    A snippet is drawn with probability proportional to exp(-d^2 / (2 `kernel_m`^2)), d being how unlike it and the
    particle are. Without `exits` a particle whose snippet ends in one draws another. Snippets within `exclude_s` of the
    walker's t0 are left out ("no contemporaries"; others up to a minute beyond, since a map knows full minutes only).
    A walker near whom nobody walked this way goes on at constant velocity and counts as not alive from the start.
    """
    here = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
    velocities, t0 = observed_steps(observed), observed.t[:, -1]
    points, speed = features(here, velocities, mod.weights, mod.metric, clock_time(t0, mod.timezone))
    velocity = polar(vector_mean(velocities, mod.weights))
    walkers = (points, speed, velocity[1], t0 / 60.0)
    xy, alive = _chain(mod.arrays, keys, *walkers, exclude_s / 60.0, steps, kernel_m, pace, exits)
    forecast = with_median(Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, "median"))
    nowhere = forecast.steps_alive[:, 0] == 0
    straight = constant_velocity(observed, velocity, steps, mod.step_s)
    forecast.xy[nowhere] = straight.xy[nowhere]
    return forecast


@kernel
def _chain(mod, keys, points, speeds, headings, minutes, exclude, steps, kernel, pace, exits):
    """Futures [n, k, T, 2] and how many steps each is alive [n, k]; `mod` are the map's `SnippetArrays`."""
    n, k = keys.shape
    xy = np.empty((n, k, steps, 2), np.float32)
    alive = np.zeros((n, k), np.int32)
    bins, upto = np.empty(49 * (HEADINGS + 1), np.int64), np.empty(49 * (HEADINGS + 1))
    point = np.empty(points.shape[1])
    for i in range(n):
        for j in range(k):
            point[:], speed, heading = points[i], speeds[i], headings[i]
            # When the present snippet began, in steps since t0; steps done; random numbers used.
            began, step, drawn = 0.0, 0, 0
            while step < steps:
                row, drawn = _draw(
                    mod, keys[i, j], drawn, point, speed, heading, minutes[i], exclude, kernel, bins, upto
                )
                if row < 0:
                    break
                rate, end = paced(speed, mod.speed[row], pace), mod.steps[row]
                while step < steps and (step + 1 - began) * rate <= end:
                    at = mod.past + (step + 1 - began) * rate
                    for axis in range(2):
                        xy[i, j, step, axis] = point[axis] + between(mod.path[row], at, axis)
                    step += 1
                if mod.leaves[row] and exits:
                    break
                began += end / rate
                speed, heading = _move_on(mod, point, mod.path[row], mod.past + end, rate / mod.step_s)
            alive[i, j] = step
            hold(xy[i, j], step, points[i, :2])
    return xy, alive


@kernel
def _move_on(mod, point, path, at, rate):
    """Turn `point` into that of a particle at row `at` of a snippet's path; returns its speed and heading."""
    weights, metric, vx, vy = mod.weights, mod.metric, 0.0, 0.0
    for m in range(len(weights)):
        vx += rate * weights[m] * (path[at - m, 0] - path[at - m - 1, 0])
        vy += rate * weights[m] * (path[at - m, 1] - path[at - m - 1, 1])
    speed, oldest = np.sqrt(vx * vx + vy * vy), at - len(weights) + 1
    point[0] += path[at, 0]
    point[1] += path[at, 1]
    point[2] = metric[0] * vx / max(speed, SLOW_M_S)
    point[3] = metric[0] * vy / max(speed, SLOW_M_S)
    point[4] = metric[1] * speed
    for axis in range(2):
        newest_step = path[at, axis] - path[at - 1, axis]
        oldest_step = path[oldest, axis] - path[oldest - 1, axis]
        point[5 + axis] = metric[2] * rate * (newest_step - oldest_step)
    return speed, np.arctan2(vy, vx)


@kernel
def _draw(mod, key, drawn, point, speed, heading, minute, exclude, kernel, bins, upto):
    """A snippet for a particle, -1 if there is none around, and the number of random numbers used so far."""
    number = _bins_around(mod, point, speed, heading, bins, upto)
    best, nearest, tries = -1, np.inf, MOST_TRIES if number else 0
    for _ in range(tries):
        at, accept = uniform(key, drawn) * upto[number - 1], uniform(key, drawn + 1)
        drawn += 2
        place = np.searchsorted(upto[:number], at, side="right")
        b = bins[place]
        size = mod.starts[b + 1] - mod.starts[b]
        row = mod.starts[b] + min(int((upto[place] - at) / mod.count[b] * size), size - 1)
        if exclude > 0.0 and -exclude - 1.0 < mod.minute[row] - minute <= exclude:
            continue
        d2 = 0.0
        for part in range(len(point)):
            d2 += (point[part] - mod.points[row, part]) ** 2
        if accept < np.exp(-0.5 * d2 / kernel**2):
            return row, drawn
        if d2 < nearest:
            best, nearest = row, d2
    return best, drawn


@kernel
def _bins_around(mod, point, speed, heading, bins, upto):
    """Fill `bins` around a particle and `upto`, how many pieces they and those before stand for; returns their number.

    A particle that hardly moves looks at all headings, one that walks at the bins around its own, and one that strolls
    at those who hardly move as well.
    """
    angle = heading * HEADINGS / (2 * np.pi)  # not from the point: there a heading may count nothing
    ci, cj = int(np.floor(point[0] / mod.cell)) - mod.origin[0], int(np.floor(point[1] / mod.cell)) - mod.origin[1]
    number, total = 0, 0.0
    for ring in RINGS:
        for i in range(max(ci - ring, 0), min(ci + ring + 1, mod.index.shape[0])):
            for j in range(max(cj - ring, 0), min(cj + ring + 1, mod.index.shape[1])):
                for h in range(HEADINGS + 1):
                    turn = abs((h - angle + HEADINGS / 2) % HEADINGS - HEADINGS / 2)
                    near = speed < SLOW_M_S or turn <= NEIGHBOURING if h < HEADINGS else speed < STROLL_M_S
                    b = mod.index[i, j, h] if near else -1
                    if b >= 0:
                        total += mod.count[b]
                        bins[number], upto[number] = b, total
                        number += 1
        if number:
            break
    return number
