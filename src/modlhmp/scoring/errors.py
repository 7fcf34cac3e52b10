"""Truth, displacement errors (paper Sec. IV-D), and paths that end up inside walls."""

from collections.abc import Iterable

import numpy as np

from modlhmp.floor_plan import FloorPlan, value_at
from modlhmp.forecasting.windows import Windows, usable
from modlhmp.site import Site
from modlhmp.tracks import LATE_STEPS, Tracks, positions_at

IDLE_S = 5.0
MIN_DEPTH_M = 0.3  # a path this deep inside occupied area is infeasible


def ground_truth(
    tracks: Tracks, rows: np.ndarray, observed_rows: int, steps: int, step_s: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Positions at t0 + 1, 2, ... steps, linearly interpolated: (xy [n, T, 2], seconds of truth [n] as steps).

    `rows` [n, 2] are the first observed and the last row of each track. Positions beyond a track's end are NaN; the
    number of steps is floor((t_last - t0) / step + 0.05), so clock jitter does not cost the last one.
    """
    until = tracks.t[rows[:, 1]]
    return _after(tracks, rows, np.arange(len(rows)), rows[:, 0] + observed_rows - 1, until, steps, step_s)


def truth_of(tracks: Tracks, wanted: Windows, site: Site) -> tuple[np.ndarray, np.ndarray]:
    """The `ground_truth` of a recording's forecasts."""
    return _after(tracks, wanted.tracks, wanted.of, wanted.row, wanted.until, site.steps, site.time_step_s)


def _after(tracks, rows, of, at_t0, until, steps, step_s):
    """Truth after the rows `at_t0` [n] of the tracks `of` [n], whose first and last rows are `rows` [m, 2]."""
    t0, first = tracks.t[at_t0], rows[of, 0]
    length = np.floor((until - t0) / step_s + LATE_STEPS).astype(np.int64)
    wanted = np.arange(1, steps + 1)
    xy = positions_at(tracks, rows, (t0 - tracks.t[first])[:, None] + wanted * step_s, of)
    xy[wanted > length[:, None]] = np.nan
    return xy, length


def displacement_errors(xy: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ADE and FDE [m] of each future at every horizon, both [n, k, T]; NaN beyond the truth."""
    fde = np.hypot(xy[..., 0] - truth[:, None, :, 0], xy[..., 1] - truth[:, None, :, 1])
    return np.cumsum(fde, axis=-1) / np.arange(1, fde.shape[-1] + 1), fde


def is_idle(tracks: Tracks, rows: np.ndarray, apart: int = 5, min_displacement_m: float = 1.0) -> np.ndarray:
    """Whether any two rows `apart` of each other in a track are less than `min_displacement_m` apart; [n].

    The ATC idle filter of the `paper` protocol. It looks at the whole track, its future included.
    """
    close = np.zeros(len(tracks.t) + 1, np.int64)
    if len(tracks.t) > apart:
        moved = np.hypot(tracks.x[apart:] - tracks.x[:-apart], tracks.y[apart:] - tracks.y[:-apart])
        close[1 : len(moved) + 1] = np.cumsum(moved < min_displacement_m)
        close[len(moved) + 1 :] = close[len(moved)]
    last = np.maximum(rows[:, 1] - apart + 1, rows[:, 0])
    return close[last] > close[rows[:, 0]]


def left_out(tracks: Tracks, rows: np.ndarray, site: Site) -> np.ndarray:
    """Which tracks the paper protocol leaves out as idle at a site, [n]; `rows` as of `is_idle`."""
    idle_filter = site.paper_protocol.idle_filter
    if idle_filter is None:
        return np.zeros(len(rows), bool)
    return is_idle(tracks, rows, idle_filter.rows, idle_filter.min_displacement_m)


def stands_about(tracks: Tracks, rows: np.ndarray, site: Site) -> np.ndarray:
    """Whether people are once less than 1 m from where they were 5 s before, [n]; `rows` as of `is_idle`.

    The ATC idle filter, asked of any recording, also where the paper protocol keeps such tracks.
    """
    return is_idle(tracks, rows, max(round(IDLE_S / site.time_step_s), 1))


def lengths_counted(recordings: Iterable[Tracks], site: Site, protocol: str) -> np.ndarray:
    """Seconds from t0 to the end of every usable track of several track tables that a protocol counts, [n]."""
    parts = [np.empty(0)]
    for tracks in recordings:
        rows = usable(tracks, site)
        if protocol == "paper":
            rows = rows[~left_out(tracks, rows, site)]
        parts.append(tracks.t[rows[:, 1]] - tracks.t[rows[:, 0] + site.observed_rows - 1])
    return np.concatenate(parts)


def enters_occupied(plan: FloorPlan, depth: np.ndarray, start: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Whether a path has been `MIN_DEPTH_M` or more inside occupied area by each step and had not started there.

    `plan` and `depth` as in `modlhmp.floor_plan`; `start` [n, 2] are the positions at t0, `xy` [n, ..., T, 2] the
    paths, seen at their time steps only. Returns bool [n, ..., T].
    """
    inside = np.maximum.accumulate(value_at(plan, depth, xy[..., 0], xy[..., 1]) >= MIN_DEPTH_M, axis=-1)
    outside_at_start = value_at(plan, depth, start[:, 0], start[:, 1]) < MIN_DEPTH_M
    return inside & outside_at_start.reshape(-1, *[1] * (xy.ndim - 2))


def nan_mean(values: np.ndarray, axis: int) -> np.ndarray:
    """Mean over the finite values along an axis; NaN (without a warning) where there is none."""
    finite = np.isfinite(values)
    number = finite.sum(axis=axis)
    total = np.where(finite, values, 0).sum(axis=axis, dtype=np.float64)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def seed_mean(values: np.ndarray) -> np.ndarray:
    """Mean of the seeds' own means over the tracks that each scored: [seeds, tracks, ...] to [...].

    Not the mean over all tracks that any seed scored: that grows with the number of seeds, towards harder tracks.
    """
    return nan_mean(nan_mean(values, axis=1), axis=0)
