"""What the networks see: people at whole time steps, each around its own position at t0.

Positions are relative to the predicted person's last observed one, so none of the published networks can know where in
the building it is; the originals are translation-invariant as well. `where` says it, and the time of day, to those that
learn a map. Nothing after t0 is in `past` or `where`.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from modlhmp.forecasting.neighbours import find_neighbours
from modlhmp.forecasting.observe import Observed, at_whole_steps, observe
from modlhmp.scoring.errors import ground_truth
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.streams import stream_keys
from modlhmp.tracks import (
    LATE_STEPS,
    Tracks,
    clock_offsets,
    clock_time,
    positions_at,
    runs,
    together,
    usable_tracks,
    whole_ids,
)

HELD_OUT_DAYS, HELD_OUT_BLOCKS = 0.2, 0.15  # shares, of `held_out: blocks`
BLOCK_S, LEAST_BLOCKS = 1800.0, 20  # blocks are shorter where there would be too few
Array = Any  # of NumPy; of torch in the batches that a network sees


class Scenes(NamedTuple):
    """n predicted persons (index 0 of axis 1) with up to M neighbours; positions in m, float32, 0 where not `present`.

    `past` [n, 1 + M, O, 2] with its last step at t0, `past_present` [n, 1 + M, O]; `future` [n, 1 + M, P, 2] and
    `future_present` [n, 1 + M, P], the latter contiguous for the predicted person. `where` [n, 3], float32, is the
    predicted person's x and y at t0 in m, in the dataset's axes, and t0's local clock hour, 0 to 24 with its fraction.
    """

    past: Array
    past_present: Array
    future: Array
    future_present: Array
    where: Array

    def take(self, rows: np.ndarray | slice) -> "Scenes":
        """Some of the scenes."""
        return Scenes(*(part[rows] for part in self))

    def lengths(self) -> np.ndarray:
        """Steps of truth of each predicted person, [n]."""
        return self.future_present[:, 0].sum(-1)


class Day(NamedTuple):
    """One day's people: `tracks` of everyone, and the `rows` [n, 2] of the usable tracks of one split among them.

    `timezone` is that of the clock. `pieces` maps the tracks of those who were cut, where pieces are one person, to the
    first usable one of each; who is not in it is one track.
    """

    tracks: Tracks
    rows: np.ndarray
    timezone: str = "UTC"
    pieces: Mapping[int, int] = {}

    def persons(self) -> np.ndarray:
        """Whose each of the `rows` is, [n]: the id in `tracks`, numbers within it, of the person's first track."""
        return whole_ids(self.tracks.track_id[self.rows[:, 0]], self.pieces)


def observed_scene(observed: Observed, step_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`past` and `past_present` of `Scenes` from an `Observed` with neighbours, and the origins [n, 2] in m."""
    own = at_whole_steps(observed, step_s)
    xy = np.concatenate([own[:, None], observed.neighbours], axis=1)
    origin = own[:, -1]
    return *_present(xy, origin), origin


def whereabouts(origin: np.ndarray, t0: np.ndarray, timezone: str) -> np.ndarray:
    """`where` of `Scenes` from the origins [n, 2] in m and unix times [n] in s."""
    return np.column_stack([origin, clock_time(t0, timezone)]).astype(np.float32)


def scenes_at(
    day: Day,
    starts: np.ndarray,
    ends: np.ndarray,
    steps: int,
    observed_rows: int,
    step_s: float,
    neighbours: bool = True,
) -> Scenes:
    """`Scenes` of the windows that begin at rows `starts` [n] of a day's tracks; `ends` [n] are their tracks' last.

    Without `neighbours` there is nobody but the predicted persons (M = 0): finding the others takes most of the time.
    """
    rows = np.column_stack([starts, ends])
    observed = observe(day.tracks, rows, observed_rows)
    truth, _ = ground_truth(day.tracks, rows, observed_rows, steps, step_s)
    after = truth[:, None]
    if neighbours:
        found = find_neighbours(day.tracks, starts + observed_rows - 1, observed_rows, step_s)
        observed = observed._replace(neighbours=found.xy)
        after = np.concatenate([after, _neighbours_after(day.tracks, found.track, observed.t[:, -1], steps, step_s)], 1)
    past, past_present, origin = observed_scene(observed, step_s)
    where = whereabouts(origin, observed.t[:, -1], day.timezone)
    future, future_present = _present(after, origin)
    return Scenes(past, past_present, future, future_present, where)


def training_windows(day: Day, futures: str, steps: int, observed_rows: int, step_s: float) -> np.ndarray:
    """Number of windows [n] that may be trained on in each usable track, all of them beginning at its first rows.

    With `futures` = "masked" a window needs one step of truth, with "full" all `steps`.
    """
    t, needed = day.tracks.t, (1 if futures == "masked" else steps) - LATE_STEPS
    first, last = day.rows[:, 0], day.rows[:, 1]
    counts = last - first + 1 - observed_rows
    row = runs(first, counts)
    track = np.repeat(np.arange(len(first)), counts)
    long_enough = t[last[track]] - t[row + observed_rows - 1] >= needed * step_s
    return np.bincount(track[long_enough], minlength=len(first))


def draw_windows(
    days: Sequence[Day],
    windows: Sequence[np.ndarray],
    rng: np.random.Generator,
    steps: int,
    observed_rows: int,
    step_s: float,
    neighbours: bool = True,
    another_every: int | None = None,
) -> Scenes:
    """One window of each track: its first in about half of the cases, as in the test, else any; `Scenes`.

    With `another_every`, another one of any for every so many that the track has.
    """
    parts = []
    for day, number in zip(days, windows, strict=True):
        usable = np.flatnonzero(number)
        anywhere = (rng.random(len(usable)) * number[usable]).astype(np.int64)
        shift = np.where(rng.random(len(usable)) < 0.5, 0, anywhere)
        if another_every:
            more = np.repeat(usable, number[usable] // another_every)
            shift = np.concatenate([shift, (rng.random(len(more)) * number[more]).astype(np.int64)])
            usable = np.concatenate([usable, more])
        rows = day.rows[usable]
        parts.append(scenes_at(day, rows[:, 0] + shift, rows[:, 1], steps, observed_rows, step_s, neighbours))
    return Scenes(*map(np.concatenate, zip(*parts, strict=True)))


class TrainingData(NamedTuple):
    """Training tracks of some days, whose windows are drawn anew each time, and the scenes of the held-out persons."""

    days: list[Day]
    windows: list[np.ndarray]
    shape: tuple[int, int, float]
    validation: Scenes
    neighbours: bool
    another_every: int | None

    @property
    def tracks(self) -> int:
        """Number of tracks to train on."""
        return sum(int((number > 0).sum()) for number in self.windows)

    @property
    def drawn(self) -> int:
        """Number of windows drawn at a time."""
        more = sum(int((number // self.another_every).sum()) for number in self.windows) if self.another_every else 0
        return self.tracks + more

    def draw(self, rng: np.random.Generator) -> Scenes:
        """One window of each track, or more (`draw_windows`)."""
        return draw_windows(self.days, self.windows, rng, *self.shape, self.neighbours, self.another_every)


def training_data(
    days: Sequence[Day],
    futures: str,
    share: float,
    seed: int,
    *shape: Any,
    held_out: str = "persons",
    neighbours: bool = True,
    another_every: int | None = None,
) -> TrainingData:
    """`TrainingData` of days; held-out persons are seen from the first row, as in the test.

    `shape` = (steps, observed rows, time step in s). Held out are, with `held_out` = "persons": that share of them, or
    "blocks": everybody of some days or hours (`blocks_held_out`), whatever the share.
    """
    by_blocks = held_out == "blocks"
    out = blocks_held_out(days, seed) if by_blocks else persons_held_out(days, share, seed)
    fitted = [day._replace(rows=day.rows[~mask]) for day, mask in zip(days, out, strict=True)]
    validation = [day._replace(rows=day.rows[mask]) for day, mask in zip(days, out, strict=True)]
    windows = [training_windows(day, futures, *shape) for day in fitted]
    if futures == "full" and not any(number.any() for number in windows):
        raise DataError(
            f"no training track goes on for the whole horizon of {shape[0] * shape[2]:g} s, which `futures: full` "
            "needs; use `futures: masked`, or a shorter horizon_s in the dataset file"
        )
    first = [np.minimum(training_windows(day, "masked", *shape), 1) for day in validation]
    scenes = draw_windows(validation, first, np.random.default_rng(0), *shape, neighbours)  # type: ignore[call-arg]
    return TrainingData(fitted, windows, shape, scenes, neighbours, another_every)


def persons_held_out(days: Sequence[Day], share: float, seed: int) -> list[np.ndarray]:
    """Masks, one [n] per day, of the persons held out: a share of all, by a hash of `Day.persons`.

    These are numbers within a recording, not its ids (`together`): who is in two recordings, such as files of an hour
    each, may be trained on in one and held out in the other.
    """
    keys = [stream_keys(day.persons(), 1, "validation", seed)[:, 0] for day in days]
    lowest = min((key.min() for key in keys if len(key)), default=0)
    limit = max(np.uint64(share * 2.0**64), lowest)  # somebody at least is held out
    return [key <= limit for key in keys]


def blocks_held_out(days: Sequence[Day], seed: int) -> list[np.ndarray]:
    """Masks, one [n] per day, of the persons held out: all of the last fifth of the days, else of some half-hours.

    Companions walk together and people of an hour walk alike, so what is learned of a place looks better on persons of
    the same minutes than it is. A person belongs to the day and the block of the first row; blocks are chosen by a hash
    of their number.
    """
    began = [_began(day) for day in days]
    t = np.concatenate([np.empty(0), *began])
    block = np.concatenate([np.empty(0), *(
        (first + clock_offsets(first, day.timezone)) // 86400 for first, day in zip(began, days, strict=True)
    )])  # fmt: skip
    numbers = np.unique(block)
    chosen = numbers[-max(1, round(HELD_OUT_DAYS * len(numbers))) :]
    if len(numbers) == 1:
        block = t // (min(BLOCK_S, np.ptp(t) / LEAST_BLOCKS) or BLOCK_S)
        numbers = np.unique(block)
        order = np.argsort(stream_keys(numbers, 1, "validation", seed)[:, 0])
        chosen = numbers[order[: max(1, round(HELD_OUT_BLOCKS * len(numbers)))]]
        if len(numbers) == 1:
            raise DataError(
                "all training tracks begin at the same moment, so no block of time can be held out; use "
                "`held_out: persons`, or more recordings"
            )
    return np.split(np.isin(block, chosen), np.cumsum([len(first) for first in began])[:-1])


def _began(day):
    """Time [s] of the first row of the person of each track, [n]."""
    t, (_, whose) = day.tracks.t[day.rows[:, 0]], np.unique(day.persons(), return_inverse=True)
    first = np.full(len(t), np.inf)
    np.minimum.at(first, whose, t)
    return first[whose]


def day_of(own: Tracks, others: Iterable[Tracks], site: Site, pieces: Mapping[int, int] | None = None) -> Day:
    """A `Day` of the tracks of one recording, with those of other recordings of that day as neighbours.

    `pieces` are the recording's `person_ids`.
    """
    tracks, rows = together([own, *others]), usable_tracks(own, site.observed_rows, site.time_step_s)
    day, whole = Day(tracks, rows, site.timezone), whole_ids(own.track_id[rows[:, 0]], pieces or {})
    _, first, whose = np.unique(whole, return_index=True, return_inverse=True)
    ids = day.persons()
    return day._replace(pieces=dict(zip(ids.tolist(), ids[first][whose].tolist(), strict=True)) if pieces else {})


def _neighbours_after(tracks, whose, t0, steps, step_s):
    """Where the neighbours `whose` [n, M] (tracks as they stand, -1: nobody) went after t0 [n]; NaN once gone."""
    after = np.full((*whose.shape, steps, 2), np.nan)
    who, slot = np.nonzero(whose >= 0)
    bounds = tracks.bounds()
    others, of = np.unique(whose[who, slot], return_inverse=True)
    rows = np.column_stack([bounds[others], bounds[others + 1] - 1])
    when = (t0[who] - tracks.t[rows[of, 0]])[:, None] + step_s * np.arange(1, steps + 1)
    xy = positions_at(tracks, rows, when, of)
    duration = tracks.t[rows[of, 1]] - tracks.t[rows[of, 0]]
    xy[when > duration[:, None] + LATE_STEPS * step_s] = np.nan
    after[who, slot] = xy
    return after


def _present(xy, origin):
    """Positions relative to `origin` as float32 with 0 for NaN, and where they were known."""
    present = np.isfinite(xy[..., 0])
    relative = np.where(present[..., None], xy - origin[:, None, None], 0.0)
    return relative.astype(np.float32), present
