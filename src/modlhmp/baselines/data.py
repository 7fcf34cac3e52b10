"""What the networks see: people at whole time steps, each around its own position at t0.

Positions are relative to the predicted person's last observed one, so no network can know where in the building it
is; the originals are translation-invariant as well. Nothing after t0 is in `past`.
"""

from typing import NamedTuple

import numpy as np

from modlhmp.forecasting.base import stream_keys
from modlhmp.forecasting.neighbours import find_neighbours
from modlhmp.forecasting.observe import observe, usable_tracks
from modlhmp.scoring.errors import ground_truth
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, positions_at, runs, together


class Scenes(NamedTuple):
    """n predicted persons (index 0 of axis 1) with up to M neighbours; positions in m, float32, 0 where not `present`.

    `past` [n, 1 + M, O, 2] with its last step at t0, `past_present` [n, 1 + M, O]; `future` [n, 1 + M, P, 2] and
    `future_present` [n, 1 + M, P], the latter contiguous for the predicted person.
    """

    past: np.ndarray
    past_present: np.ndarray
    future: np.ndarray
    future_present: np.ndarray

    def take(self, rows):
        """Some of the scenes."""
        return Scenes(*(part[rows] for part in self))

    def lengths(self):
        """Steps of truth of each predicted person, [n]."""
        return self.future_present[:, 0].sum(-1)


class Day(NamedTuple):
    """One day's people: `tracks` of everyone, and the `rows` [n, 2] of the usable tracks of one split among them."""

    tracks: Tracks
    rows: np.ndarray


def observed_scene(observed, step_s):
    """`past` and `past_present` of `Scenes` from an `Observed` with neighbours, and the origins [n, 2] in m."""
    n, seen = observed.t.shape
    rows = np.arange(n)[:, None] * seen + [0, seen - 1]
    flat = Tracks(np.repeat(observed.track_id, seen), *(column.ravel() for column in observed[1:6]))
    when = (observed.t[:, -1:] - observed.t[:, :1]) - step_s * np.arange(seen - 1, -1, -1)
    own = positions_at(flat, rows, when)
    xy = np.concatenate([own[:, None], observed.neighbours], axis=1)
    origin = own[:, -1]
    return *_present(xy, origin), origin


def scenes_at(day, starts, ends, steps, observed_rows, step_s):
    """`Scenes` of the windows that begin at rows `starts` [n] of a day's tracks; `ends` [n] are their tracks' last."""
    rows = np.column_stack([starts, ends])
    observed = observe(day.tracks, rows, observed_rows)
    found = find_neighbours(day.tracks, starts + observed_rows - 1, observed_rows, step_s)
    past, past_present, origin = observed_scene(observed._replace(neighbours=found.xy), step_s)
    truth, _ = ground_truth(day.tracks, rows, observed_rows, steps, step_s)
    after = np.full((*found.track.shape, steps, 2), np.nan)
    who, slot = np.nonzero(found.track >= 0)
    bounds = day.tracks.bounds()
    others, whose = np.unique(found.track[who, slot], return_inverse=True)
    other_rows = np.column_stack([bounds[others], bounds[others + 1] - 1])
    since = day.tracks.t[starts + observed_rows - 1][who] - day.tracks.t[other_rows[whose, 0]]
    when = since[:, None] + step_s * np.arange(1, steps + 1)
    xy = positions_at(day.tracks, other_rows, when, whose)
    duration = day.tracks.t[other_rows[whose, 1]] - day.tracks.t[other_rows[whose, 0]]
    xy[when > duration[:, None] + 0.05 * step_s] = np.nan
    after[who, slot] = xy
    return Scenes(past, past_present, *_present(np.concatenate([truth[:, None], after], axis=1), origin))


def training_windows(day, futures, steps, observed_rows, step_s):
    """Number of windows [n] that may be trained on in each usable track, all of them beginning at its first rows.

    With `futures` = "masked" a window needs one step of truth, with "full" all `steps`.
    """
    t, needed = day.tracks.t, (1 if futures == "masked" else steps) - 0.05
    first, last = day.rows[:, 0], day.rows[:, 1]
    counts = last - first + 1 - observed_rows
    row = runs(first, counts)
    track = np.repeat(np.arange(len(first)), counts)
    long_enough = t[last[track]] - t[row + observed_rows - 1] >= needed * step_s
    return np.bincount(track[long_enough], minlength=len(first))


def draw_windows(days, windows, rng, steps, observed_rows, step_s):
    """One window of each track: its first in about half of the cases, as in the test, else any; `Scenes`."""
    parts = []
    for day, number in zip(days, windows, strict=True):
        usable = np.flatnonzero(number)
        anywhere = (rng.random(len(usable)) * number[usable]).astype(np.int64)
        shift = np.where(rng.random(len(usable)) < 0.5, 0, anywhere)
        rows = day.rows[usable]
        parts.append(scenes_at(day, rows[:, 0] + shift, rows[:, 1], steps, observed_rows, step_s))
    return Scenes(*map(np.concatenate, zip(*parts, strict=True)))


class TrainingData(NamedTuple):
    """Training tracks of some days, one window of each drawn at a time, and the scenes held out for validation."""

    days: list
    windows: list
    shape: tuple
    validation: Scenes

    @property
    def tracks(self):
        """Number of tracks to train on."""
        return sum(int((number > 0).sum()) for number in self.windows)

    def draw(self, rng):
        """One window of each track."""
        return draw_windows(self.days, self.windows, rng, *self.shape)


def training_data(days, futures, held_out_share, seed, *shape):
    """`TrainingData` of days; validation persons are chosen by a hash and seen from their first row, as in the test.

    `shape` = (steps, observed rows, time step in s).
    """
    keys = [stream_keys(d.tracks.track_id[d.rows[:, 0]], 1, "validation", seed)[:, 0] for d in days]
    lowest = min((key.min() for key in keys if len(key)), default=0)
    limit = max(np.uint64(held_out_share * 2.0**64), lowest)  # somebody at least is held out
    fitted = [day._replace(rows=day.rows[key > limit]) for day, key in zip(days, keys, strict=True)]
    validation = [day._replace(rows=day.rows[key <= limit]) for day, key in zip(days, keys, strict=True)]
    windows = [training_windows(day, futures, *shape) for day in fitted]
    if futures == "full" and not any(number.any() for number in windows):
        raise DataError(
            f"no training track goes on for the whole horizon of {shape[0] * shape[2]:g} s, which `futures: full` "
            "needs; use `futures: masked`, or a shorter horizon_s in the dataset file"
        )
    first = [np.minimum(training_windows(day, "masked", *shape), 1) for day in validation]
    scenes = draw_windows(validation, first, np.random.default_rng(0), *shape)
    return TrainingData(fitted, windows, shape, scenes)


def day_of(own, others, observed_rows):
    """A `Day` of the tracks of one recording, with those of other recordings of that day as neighbours."""
    return Day(together([own, *others]), usable_tracks(own, observed_rows))


def _present(xy, origin):
    """Positions relative to `origin` as float32 with 0 for NaN, and where they were known."""
    present = np.isfinite(xy[..., 0])
    relative = np.where(present[..., None], xy - origin[:, None, None], 0.0)
    return relative.astype(np.float32), present
