"""The common time step, imposed on recordings in one of two ways, and on what is known at one moment (`ending_at`).

Recordings that say how fast people walk keep the last sample of each person and step, as the 1 Hz ATC files do, while
they are read, so that memory does not follow the raw rate. Others are interpolated once they are clean, since cleaning
counts their own rows.
"""

import numpy as np

from modlhmp.account import Account
from modlhmp.kernels import kernel
from modlhmp.storage import DataError
from modlhmp.tracks import LATE_STEPS, LEAST_JUMP_S, Tracks, gap_limit, laid_out

HERE, NEW, GONE = range(3)  # whether somebody can be forecast at a moment
ROUNDING_S = 1e-6  # a double holds unix times to 2.4e-7 s


def without_repeats(rows: Tracks, account: Account) -> Tracks:
    """Rows sorted by person and time, without further ones of the same person and time: the first one counts."""
    rows = rows.take(np.lexsort((rows.t, rows.track_id)))
    repeated = np.zeros(len(rows.t), bool)
    repeated[1:] = (np.diff(rows.track_id) == 0) & (np.diff(rows.t) == 0)
    account.drop_rows("duplicate_row", repeated.sum())
    return rows.take(~repeated)


def positions_alone(
    track_id: np.ndarray, t: np.ndarray, x: np.ndarray, y: np.ndarray, day: tuple[float, float] | None, account: Account
) -> Tracks:
    """Rows of a file without velocities, sorted and without repeats; `day` = (first, last) unix second, None: all."""
    first, last = day or (-np.inf, np.inf)
    outside = (t < first) | (t >= last)
    account.drop_rows("outside_day", outside.sum())
    unknown = np.full(len(t), np.nan)
    return without_repeats(Tracks(track_id, t, x, y, unknown, unknown).take(~outside), account)


def jumped(rows: Tracks, jump_mps: float) -> np.ndarray:
    """Which rows, bool [n], nobody can have come to from the track's row before; `rows` are sorted by track and time.

    A displacement counts over at least `LEAST_JUMP_S`, so that a tracker's jitter is none.
    """
    found = np.zeros(len(rows.t), bool)
    walked, seconds = np.hypot(np.diff(rows.x), np.diff(rows.y)), np.maximum(np.diff(rows.t), LEAST_JUMP_S)
    found[1:] = (np.diff(rows.track_id) == 0) & (walked > jump_mps * seconds)
    return found


def last_of_step(rows: Tracks, step_s: float, account: Account) -> Tracks:
    """Keep each person's last sample of each time step, as the 1 Hz ATC files do."""
    rows = without_repeats(rows, account)
    bins = np.floor(rows.t / step_s + 1e-4)  # a clock's rounding does not move a row into the step before
    overtaken = np.zeros(len(rows.t), bool)
    overtaken[:-1] = (np.diff(rows.track_id) == 0) & (np.diff(bins) == 0)
    account.drop_rows("downsampled", overtaken.sum())
    return rows.take(~overtaken)


def interpolate(tracks: Tracks, step_s: float) -> Tracks:
    """Each track on a grid of `step_s` from its own first row, linearly; velocities are backward differences.

    The first row of a track has no velocity (NaN). Where a track's last rows are about as far apart as the steps, the
    last one may be `LATE_STEPS` early, or a clock's jitter would take it.
    """
    bounds = tracks.bounds()
    if len(bounds) == 1:
        return tracks
    first, last = bounds[:-1], bounds[1:] - 1
    duration, before = tracks.t[last] - tracks.t[first], np.maximum(last - 1, first)
    early = np.where(tracks.t[last] - tracks.t[before] > step_s / 2, LATE_STEPS, max(1e-6, ROUNDING_S / step_s))
    counts = np.floor(duration / step_s + early) + 1
    if counts.sum() > 100 * len(tracks.t) + 86_400 / step_s:
        raise DataError("tracks have gaps of hours; set a shorter `max_gap_s`")
    counts = counts.astype(np.int64)
    axis, offset, _ = laid_out(tracks, np.column_stack([first, last]), 2 * step_s)
    track = np.repeat(np.arange(len(first)), counts)
    step = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) * step_s
    grid, end = step + offset[track], axis[last][track]
    grid = np.where(grid > end + ROUNDING_S, end, grid)  # not on towards the next track
    x, y = np.interp(grid, axis, tracks.x), np.interp(grid, axis, tracks.y)
    speed, heading = backward_differences(tracks.track_id[first][track], step, x, y)
    return Tracks(tracks.track_id[first][track], tracks.t[first][track] + step, x, y, speed, heading)


def backward_differences(
    track_id: np.ndarray, t: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Speed [m/s] and heading [rad] from the row before, NaN on each track's first row."""
    speed, heading = np.full(len(t), np.nan), np.full(len(t), np.nan)
    same = np.flatnonzero(np.diff(track_id) == 0)
    dx, dy = x[same + 1] - x[same], y[same + 1] - y[same]
    speed[same + 1] = np.hypot(dx, dy) / (t[same + 1] - t[same])
    heading[same + 1] = np.arctan2(dy, dx)
    return speed, heading


def newest_moment(t: float, every_s: float, reached: bool = True) -> int:
    """Number of the newest multiple of `every_s` before `t` [unix s], or, `reached`, at `t`, to what a clock rounds."""
    nearest = round(t / every_s)
    return nearest if t - nearest * every_s > (-ROUNDING_S if reached else ROUNDING_S) else nearest - 1


def ending_at(tracks: Tracks, t0: float, step_s: float, rows: int) -> tuple[Tracks, np.ndarray]:
    """Everyone's `rows` positions on the grid of `step_s` that ends at `t0` [unix s], from rows up to `t0` alone.

    `tracks` are of any rate. Positions are linear between rows, a row at a moment of the grid is taken as it is, and
    beyond the newest row a person goes on at the velocity of the last `step_s`. Somebody is `HERE` whose newest row is
    at most 1 + `LATE_STEPS` steps old at `t0`, or half as old again as the one before was then (a slow sensor), and
    whose rows reach back to the grid's beginning without a gap (`tracks.gap_limit`); who has fewer is `NEW`, the
    others are `GONE`.
    Returns the rows of those who are here, without velocities, and [m] which of the three each of the m tracks is.
    """
    bounds = tracks.bounds()
    state, grid = np.empty(len(bounds) - 1, np.int8), np.empty((3, len(bounds) - 1, rows))
    _end_at(tracks.t, tracks.x, tracks.y, bounds, float(t0), step_s, gap_limit(step_s), grid, state)
    here = state == HERE
    unknown = np.full(rows * int(here.sum()), np.nan)
    track_id = np.repeat(tracks.track_id[bounds[:-1]][here], rows)
    return Tracks(track_id, *(part[here].ravel() for part in grid), unknown, unknown), state  # type: ignore[call-arg]


@kernel
def _end_at(t, x, y, bounds, t0, step_s, gap_s, grid, state):
    """Fill `state` [m], and of those who are here `grid` [3, m, rows] with t, x, y."""
    rows = grid.shape[2]
    for track in range(len(state)):
        first, last = bounds[track], bounds[track + 1] - 1
        while last >= first and t[last] > t0 + ROUNDING_S:
            last -= 1
        lately = (1 + LATE_STEPS) * step_s
        if last > first:
            lately = max(lately, 1.5 * (t[last] - t[last - 1]))
        if last < first or t0 - t[last] > min(lately, gap_s):
            state[track] = GONE
            continue
        begin = last  # first row after the last long gap
        while begin > first and t[begin] - t[begin - 1] <= gap_s:
            begin -= 1
        if begin == last or t[begin] > t0 - (rows - 1) * step_s + ROUNDING_S:
            state[track] = NEW
            continue
        state[track] = HERE
        back = last
        for age in range(rows):
            at, place = t0 - age * step_s, rows - 1 - age
            while t[back] > at + ROUNDING_S:
                back -= 1
            grid[0, track, place] = t[back] if abs(t[back] - at) <= ROUNDING_S else at
            if back == last:
                before = _at(t, x, begin, last, t[last] - step_s), _at(t, y, begin, last, t[last] - step_s)
                rate = (grid[0, track, place] - t[last]) / min(step_s, t[last] - t[begin])
                grid[1, track, place] = x[last] + rate * (x[last] - before[0])
                grid[2, track, place] = y[last] + rate * (y[last] - before[1])
            else:
                grid[1, track, place] = _at(t, x, back, back + 1, grid[0, track, place])
                grid[2, track, place] = _at(t, y, back, back + 1, grid[0, track, place])


@kernel
def _at(t, values, first, last, at):
    """A value at a time, linear between rows `first` to `last`; that of the first row before it."""
    row = last - 1
    while row > first and t[row] > at:
        row -= 1
    part = max(at - t[row], 0.0) / (t[row + 1] - t[row])
    return values[row] + part * (values[row + 1] - values[row])
