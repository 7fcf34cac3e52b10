"""The common time step, imposed in one of two ways.

Recordings that say how fast people walk keep the last sample of each person and step, as the 1 Hz ATC files do, while
they are read, so that memory does not follow the raw rate. Others are interpolated once they are clean, since cleaning
counts their own rows.
"""

import numpy as np

from modlhmp.account import Account
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, laid_out


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

    The first row of a track has no velocity (NaN).
    """
    bounds = tracks.bounds()
    if len(bounds) == 1:
        return tracks
    first, last = bounds[:-1], bounds[1:] - 1
    duration = tracks.t[last] - tracks.t[first]
    counts = np.floor(duration / step_s + 1e-6) + 1
    if counts.sum() > 100 * len(tracks.t) + 86_400 / step_s:
        raise DataError("tracks have gaps of hours; add `gap_over_5s` to the dataset's `cleaning`")
    counts = counts.astype(np.int64)
    axis, offset, _ = laid_out(tracks, np.column_stack([first, last]), 2 * step_s)
    track = np.repeat(np.arange(len(first)), counts)
    step = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) * step_s
    grid = step + offset[track]
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
