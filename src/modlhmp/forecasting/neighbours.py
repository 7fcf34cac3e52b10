"""Who else was near a walker at t0, and where: only what had been seen by then, of everyone present."""

from typing import NamedTuple

import numpy as np

from modlhmp.tracks import LATE_STEPS, Tracks, gap_limit, positions_at, runs

RADIUS_M = 6.0  # the corner of Social LSTM's grid is 5.7 m away, the other networks look 2 to 3 m far
MOST = 5


class Neighbours(NamedTuple):
    """M = `MOST` neighbours of n walkers, nearest first: `track` [n, M] is whose (-1: nobody), counted as the tracks
    of the table stand; `xy` [n, M, rows, 2] in m, NaN where absent.
    """

    track: np.ndarray
    xy: np.ndarray


def find_neighbours(everyone: Tracks, own_row: np.ndarray, observed_rows: int = 4, step_s: float = 1.0) -> Neighbours:
    """Neighbours of the walkers whose rows at t0 are `own_row` [n] in `everyone`, the tracks of all who were there.

    A person counts whose newest row at t0 is at most about a step old and who then is within `RADIUS_M`. Rows after t0
    are never looked at: beyond the newest row the position goes on at the person's last velocity.
    """
    n, table = len(own_row), everyone
    bounds = table.bounds()
    first_row = np.repeat(bounds[:-1], np.diff(bounds))
    track_of = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    t0, xy = table.t[own_row], np.column_stack([table.x, table.y])
    by_time = np.argsort(table.t, kind="stable")
    low, high = (np.searchsorted(table.t[by_time], time, side="right") for time in (t0 - (1 + LATE_STEPS) * step_s, t0))
    walker = np.repeat(np.arange(n), high - low)
    row = by_time[runs(low, high - low)]
    other = track_of[row] != track_of[own_row[walker]]
    walker, row = walker[other], row[other]
    newest = np.ones(len(row), bool)
    order = np.lexsort((row, track_of[row], walker))
    walker, row = walker[order], row[order]
    newest[:-1] = (walker[1:] != walker[:-1]) | (track_of[row[1:]] != track_of[row[:-1]])
    walker, row = walker[newest], row[newest]
    velocity = _last_velocity(table, xy, row, first_row, gap_limit(step_s))
    now = xy[row] + velocity * (t0[walker] - table.t[row])[:, None]
    distance = np.hypot(*(now - xy[own_row[walker]]).T)
    near = distance <= RADIUS_M
    walker, row, velocity, distance = walker[near], row[near], velocity[near], distance[near]
    order = np.lexsort((track_of[row], distance, walker))
    walker, row, velocity = walker[order], row[order], velocity[order]
    rank = np.arange(len(walker)) - np.searchsorted(walker, walker)
    few = rank < MOST
    walker, row, velocity, rank = walker[few], row[few], velocity[few], rank[few]

    times = t0[walker][:, None] - step_s * np.arange(observed_rows - 1, -1, -1)
    since, known = times - table.t[first_row[row]][:, None], (table.t[row] - table.t[first_row[row]])[:, None]
    tracks, whose = np.unique(track_of[row], return_inverse=True)
    rows = np.column_stack([bounds[tracks], bounds[tracks + 1] - 1])
    seen = positions_at(table, rows, np.minimum(since, known), whose)
    seen += velocity[:, None] * np.maximum(since - known, 0.0)[..., None]
    seen[since < -LATE_STEPS * step_s] = np.nan
    found = Neighbours(np.full((n, MOST), -1), np.full((n, MOST, observed_rows, 2), np.nan))
    found.track[walker, rank] = track_of[row]
    found.xy[walker, rank] = seen
    return found


def _last_velocity(table, xy, row, first_row, gap_s):
    """Velocity [n, 2] in m/s between each row and the one before it; 0 for a first row, or after more than `gap_s`."""
    before = np.maximum(row - 1, 0)
    dt = table.t[row] - table.t[before]
    known = (row > first_row[row]) & (dt > 0) & (dt <= gap_s)
    return np.where(known[:, None], (xy[row] - xy[before]) / np.where(known, dt, 1.0)[:, None], 0.0)
