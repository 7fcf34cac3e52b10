"""Cleaning: named rules that remove whole tracks, then the common time step.

The rules of the Edinburgh recordings are B. Majecka's (see the paper, Sec. IV-A); every rule counts what it drops.
"""

import numpy as np
from matplotlib.path import Path as Polygon

from modlhmp.readers import read_recording
from modlhmp.storage import DataError
from modlhmp.tracks import MAX_GAP_S, Tracks

VALIDATION_SHARE = 0.15
BLOCK_S = 1800.0


def clean_recording(path, dataset, recording):
    """Read a recording, apply the dataset's cleaning rules in their order, bring it to the time step.

    Returns (Tracks at `time_step_s`, account as a dict of JSON data that adds up).
    """
    tracks, account = read_recording(path, dataset, recording)
    # What each block dropped is counted; what is left belongs to tracks from here on.
    account.tracks_read += 0 if account.tracks_read else len(tracks.bounds()) - 1
    for name, options in map(_rule, dataset["cleaning"]):
        tracks = _drop(tracks, name, RULES[name](tracks, dataset, **options), account)
    if recording.get("part"):
        tracks = _drop(tracks, "other_part", held_out(tracks) != (recording["part"] == "validation"), account)
    account.rows_kept = len(tracks.t)
    account.tracks_kept = len(tracks.bounds()) - 1
    if np.isnan(tracks.speed).all():
        try:
            tracks = interpolate(tracks, dataset["time_step_s"])
        except DataError as error:
            raise DataError(f"{path}: {error}") from None
    account.rows_written = len(tracks.t)
    if not len(tracks.t):
        raise DataError(
            f"{path}: cleaning left no track; rows dropped: {dict(account.dropped_rows)}, "
            f"tracks dropped: {dict(account.dropped_tracks)}; is `cleaning` too strict?"
        )
    return tracks, account.as_dict()


def single_row(tracks, dataset):
    """Tracks of one row: no motion to learn from."""
    return _rows(tracks) == 1


def gap_over_5s(tracks, dataset):
    """Tracks with a gap of more than 5 s between two rows: probably two persons under one id."""
    return _any_row(
        tracks, np.concatenate([[False], (np.diff(tracks.t) > MAX_GAP_S) & (np.diff(tracks.track_id) == 0)])
    )


def min_points(tracks, dataset, points):
    """Tracks with fewer than `points` rows: spurious detections."""
    return _rows(tracks) < points


def start_end_margin(tracks, dataset, polygons):
    """Tracks that start or end outside all of `polygons` (in the file's pixels), the doors' side of the scene."""
    starts, ends = _ends(tracks, dataset["scale"])
    return ~(_inside(starts, polygons) & _inside(ends, polygons))


def lift_loiterers(tracks, dataset, polygons):
    """Tracks that both start and end inside `polygons` (in the file's pixels), where people wait for the lift."""
    starts, ends = _ends(tracks, dataset["scale"])
    return _inside(starts, polygons) & _inside(ends, polygons)


RULES = {rule.__name__: rule for rule in (single_row, gap_over_5s, min_points, start_end_margin, lift_loiterers)}


def held_out(tracks, seed=0):
    """Whether tracks belong to the validation part of their recording: those that begin in some blocks of time.

    About `VALIDATION_SHARE` of the recording's half-hours with people, drawn with `seed`, at least one. Companions stay
    together, so a forecast of the one cannot be taken from the other.
    """
    block = (tracks.t[tracks.bounds()[:-1]] // BLOCK_S).astype(np.int64)
    blocks = np.unique(block)
    number = max(round(VALIDATION_SHARE * len(blocks)), 1)
    return np.isin(block, np.random.default_rng(seed).permutation(blocks)[:number])


def interpolate(tracks, step_s):
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
    # One np.interp serves all tracks: they are laid one after the other on a common axis.
    offset = np.concatenate([[0.0], np.cumsum(duration + 2 * step_s)[:-1]])
    axis = tracks.t - np.repeat(tracks.t[first] - offset, np.diff(bounds))
    track = np.repeat(np.arange(len(first)), counts)
    step = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) * step_s
    grid = step + offset[track]
    x, y = np.interp(grid, axis, tracks.x), np.interp(grid, axis, tracks.y)
    speed, heading = backward_differences(tracks.track_id[first][track], step, x, y)
    return Tracks(tracks.track_id[first][track], tracks.t[first][track] + step, x, y, speed, heading)


def backward_differences(track_id, t, x, y):
    """Speed [m/s] and heading [rad] from the row before, NaN on each track's first row."""
    speed, heading = np.full(len(t), np.nan), np.full(len(t), np.nan)
    same = np.flatnonzero(np.diff(track_id) == 0)
    dx, dy = x[same + 1] - x[same], y[same + 1] - y[same]
    speed[same + 1] = np.hypot(dx, dy) / (t[same + 1] - t[same])
    heading[same + 1] = np.arctan2(dy, dx)
    return speed, heading


def _rule(entry):
    name, options = (entry, {}) if isinstance(entry, str) else next(iter(entry.items()))
    return name, options


def _drop(tracks, name, dropped, account):
    rows = np.repeat(dropped, _rows(tracks))
    account.drop_tracks(name, int(dropped.sum()), int(rows.sum()))
    return tracks.take(~rows)


def _rows(tracks):
    return np.diff(tracks.bounds())


def _any_row(tracks, mask):
    return np.logical_or.reduceat(mask, tracks.bounds()[:-1]) if len(mask) > 1 or len(tracks.t) else mask[:0]


def _ends(tracks, scale):
    bounds = tracks.bounds()
    positions = np.column_stack([tracks.x, tracks.y]) / scale
    return positions[bounds[:-1]], positions[bounds[1:] - 1]


def _inside(points, polygons):
    inside = np.zeros(len(points), bool)
    for polygon in polygons:
        # Points on the border are inside; the sign of `radius` follows the polygon's sense of rotation.
        for radius in (1e-9, -1e-9):
            inside |= Polygon(polygon).contains_points(points, radius=radius)
    return inside
