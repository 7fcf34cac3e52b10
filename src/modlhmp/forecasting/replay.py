"""Forecasting with an episode map: replay what the most similar persons did next, from here and at the walker's pace.

At every second only those count who are still under way then, so ways out need no model of their own: whoever has left
is not asked. The result is the geometric median of the nearest of them, or what else `outputs` makes of the replays.
"""

import numpy as np

from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.cvm import constant_velocity
from modlhmp.forecasting.median import geometric_median
from modlhmp.forecasting.observe import Observed, observed_steps, polar
from modlhmp.forecasting.outputs import with_output
from modlhmp.forecasting.paths import between, hold, paced
from modlhmp.kernels import kernel
from modlhmp.maps.episodes import EpisodeMap
from modlhmp.maps.pieces import features, vector_mean
from modlhmp.options import Episodes
from modlhmp.site import Site

PIECES_A_PERSON = 8  # looked up for each person of the median: several of a person's rows are alike
SAMPLES_A_PERSON = 4  # replays beside the median: most have left after a minute, and enough are to be left


def forecaster(mod: EpisodeMap, site: Site, options: Episodes) -> Forecaster:
    """The forecaster of an episode map (contract: `kinds.Kind`)."""

    def forecast(observed: Observed, steps: int, keys: np.ndarray) -> Forecast:
        futures = replay(
            mod, observed, steps, site.time_step_s, options.persons, options.pace, options.reach_m, options.exclude_s,
            options.samples == "pieces",
        )  # fmt: skip
        return with_output(futures, options.output, options.persons)

    return forecast


def replay(
    mod: EpisodeMap,
    observed: Observed,
    steps: int,
    step_s: float,
    k: int,
    pace: float,
    reach_m: float,
    exclude_s: float = 0.0,
    of_pieces: bool = False,
) -> Forecast:
    """Forecast with an `EpisodeMap`; returns a `Forecast`: the median of `k` persons, then 4 `k` single replays.

    The median at a second is of the `k` nearest persons who are still under way then. The replays are of the nearest
    persons at t0, or, `of_pieces`, of the nearest pieces, whosoever they are; in turn again where there are fewer.
    See `followed` for the rest.
    """
    samples = SAMPLES_A_PERSON * k
    return followed(mod, observed, steps, step_s, k, samples, pace, reach_m, exclude_s, of_pieces)[0]


def followed(
    mod: EpisodeMap,
    observed: Observed,
    steps: int,
    step_s: float,
    k: int,
    samples: int,
    pace: float,
    reach_m: float,
    exclude_s: float = 0.0,
    of_pieces: bool = False,
) -> tuple[Forecast, np.ndarray]:
    """What `replay` says, with so many `samples`, and how many of these are different replays [n].

    Persons who are more than `reach_m` (in the map's metric) unlike the walker are not followed; whoever has nobody to
    follow walks on at constant velocity and counts as not alive from the start. `pace` = 1 replays at the walker's own
    speed, 0 at the other's. Pieces within `exclude_s` of the walker's t0 are left out ("no contemporaries").
    """
    here = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
    velocities = observed_steps(observed)
    points, speed = features(
        here, velocities, mod.weights, mod.metric, mod.metric.hour(observed.t[:, -1], mod.timezone)
    )
    rows, distance = mod.nearest(points, PIECES_A_PERSON * k)
    straight = constant_velocity(observed, polar(vector_mean(velocities, mod.weights)), steps, step_s)
    usable = distance <= reach_m
    if exclude_s:
        usable &= np.abs(mod.t[rows] - observed.t[:, -1:]) > exclude_s
    xy = np.repeat(straight.xy, 1 + samples, axis=1)
    alive, different = np.zeros(xy.shape[:2], np.int32), np.zeros(len(xy), np.int64)
    walks = mod.person, mod.last, mod.xy, mod.speed
    _replay(rows, usable, *walks, here, speed, pace, k, of_pieces, xy, alive, different)
    return Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, "median"), np.minimum(different, samples)


@kernel
def _replay(rows, usable, person, last, path, path_speed, here, speed, pace, k, of_pieces, xy, alive, different):
    """Fill `xy` [n, 1 + samples, T, 2] and `alive` [n, 1 + samples] of the walkers who have somebody to follow.

    And `different` [n]: how many replays there are before they come again.
    """
    n, samples, steps = len(rows), xy.shape[1] - 1, xy.shape[2]
    persons, factor = np.empty(rows.shape[1], np.int64), np.empty(rows.shape[1])
    sampled, whose = np.empty(rows.shape[1], np.int64), np.empty(rows.shape[1], np.int64)
    x, y, point = np.empty(k), np.empty(k), np.empty(2)
    for i in range(n):
        number = total = 0
        for j in range(rows.shape[1]):  # the nearest piece of every person
            row, new = rows[i, j], usable[i, j]
            if of_pieces and new:
                sampled[total] = row
                total += 1
            for other in whose[:number]:
                if other == person[row]:
                    new = False
                    break
            if new:
                persons[number], whose[number] = row, person[row]
                factor[number] = paced(speed[i], path_speed[row], pace)
                number += 1
        if not number:
            continue
        if not of_pieces:
            sampled[:number], total = persons[:number], number
        different[i] = total
        for j in range(samples):
            row = sampled[j % total]
            rate = paced(speed[i], path_speed[row], pace)
            for step in range(steps):
                if not _at(path, row, last[row], (step + 1) * rate, here[i], point):
                    hold(xy[i, 1 + j], step, here[i])
                    break
                xy[i, 1 + j, step] = point
                alive[i, 1 + j] = step + 1
        for step in range(steps):
            count = 0
            for j in range(number):
                row = persons[j]
                if _at(path, row, last[row], (step + 1) * factor[j], here[i], point):
                    x[count], y[count] = point
                    count += 1
                    if count == k:
                        break
            if not count:
                hold(xy[i, 0], step, here[i])
                break
            xy[i, 0, step] = geometric_median(x, y, count)
            alive[i, 0] = step + 1


@kernel
def _at(path, row, last, rows_on, here, point):
    """Where somebody was `rows_on` rows after `row`, moved to start from `here`; False if they had left by then."""
    whole = int(rows_on)
    part = rows_on - whole
    at = row + whole
    if at > last or (at == last and part > 0.0):
        return False
    for axis in range(2):
        point[axis] = here[axis] + between(path, row + rows_on, axis) - path[row, axis]
    return True
