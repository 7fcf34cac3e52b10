"""Hand-made and random track tables for the tests of neighbours and networks."""

from itertools import pairwise

import numpy as np

from modlhmp.tracks import Tracks, concatenate

START = 1.9e9  # unix time [s]


def walk(track_id, times, xy):
    """Rows of one person at `times` [n] s after START; `xy` [n, 2] in m."""
    unknown = np.full(len(times), np.nan)
    x, y = np.asarray(xy, float).T
    return Tracks(np.full(len(times), track_id), START + np.asarray(times, float), x, y, unknown, unknown)


def straight(track_id, start, velocity, rows, began=0.0, step_s=1.0):
    """A person at constant velocity [m/s] from `start`, one row per time step."""
    times = step_s * np.arange(rows)
    return walk(track_id, began + times, np.array(start) + times[:, None] * np.array(velocity))


def crowd(seed, people=40, size=9.0, step_s=1.0, most_rows=20, span=30, gaps=(1, 1, 1, 1, 2, 7)):
    """People who come within `span` steps, with jittered clocks, rows some `gaps` apart and now and then just one."""
    rng = np.random.default_rng(seed)
    tables = []
    for track_id in 7 + rng.permutation(people):
        rows = int(rng.integers(1, most_rows))
        times = rng.uniform(0, span) + np.cumsum(rng.choice(gaps, rows))
        times = step_s * (times + rng.uniform(-0.04, 0.04, rows))
        pace = rng.uniform(-0.7, 0.7, 2) / step_s * (times - times[0])[:, None]
        tables.append(walk(track_id, times, rng.uniform(0, size, 2) + pace + rng.normal(0, 0.05, (rows, 2))))
    return concatenate(tables)


def people_of(tracks):
    """The tracks as lists of (t, x, y)."""
    rows = list(zip(tracks.t.tolist(), tracks.x.tolist(), tracks.y.tolist(), strict=True))
    bounds = tracks.bounds()
    return [rows[a:b] for a, b in pairwise(bounds)]


def reordered(tracks, order):
    """The same tracks, one after the other in another order."""
    bounds = tracks.bounds()
    return concatenate([tracks.take(slice(bounds[n], bounds[n + 1])) for n in order])
