"""The track table: who was where, when, how fast and which way.

One row per person and time step, sorted by track, then time. Units: s (unix, UTC), m, m/s, rad in (-pi, pi].
"""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa

from modlhmp.storage import DataError, column, read_metadata, read_parquet, write_parquet

COLUMNS = {"track_id": np.int64, "t": np.float64, "x": np.float64, "y": np.float64,
           "speed": np.float64, "heading": np.float64}  # fmt: skip
LATE_STEPS = 0.05  # what the jitter of clocks may take from the time of a row, in time steps
MAX_GAP_S = 5.0  # a track with a longer gap between two rows is not one, at steps up to half of it (`gap_limit`)
_FIRST_S = -60_000_000_000  # the year 68: dates begin with the year 1, and no zone had changed its time by then
LEAST_JUMP_S = 0.4  # a displacement is judged over no less, so that a tracker's jitter is no jump


class Tracks(NamedTuple):
    """Rows of tracks as equally long 1-d arrays, sorted by track, then time.

    `t` is in unix s, `x` and `y` in m, `speed` in m/s, `heading` in rad from -pi to pi, 0 along x; speeds and headings
    are NaN where unknown.
    """

    track_id: np.ndarray
    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    speed: np.ndarray
    heading: np.ndarray

    def __repr__(self) -> str:
        """How many they are, when and where; of what is no table of numbers all that it has."""
        if not all(isinstance(one, np.ndarray) and one.ndim == 1 and one.dtype.kind in "iuf" for one in self):
            return tuple.__repr__(self)
        told = [f"{len(np.unique(self.track_id))} people", f"{len(self.track_id)} rows"]
        for name, values, unit in (("t", self.t, "s"), ("x", self.x, "m"), ("y", self.y, "m")):
            if len(known := values[np.isfinite(values)]):
                low, high = (shown_s(end) if name == "t" else f"{end:.1f}" for end in (known.min(), known.max()))
                told.append(f"{name} {low} to {high} {unit}")
        return f"Tracks({', '.join(told)})"

    def take(self, rows: np.ndarray | slice) -> "Tracks":
        """The rows of a mask or an index array."""
        return Tracks(*(column[rows] for column in self))

    def moves(self) -> np.ndarray:
        """Which rows, bool [n], have a velocity: a heading, and a speed above 0."""
        return np.isfinite(self.speed) & np.isfinite(self.heading) & (self.speed > 0)

    def bounds(self) -> np.ndarray:
        """First row of every track and, as the last entry, the number of rows: shape [tracks + 1]."""
        changes = np.flatnonzero(self.track_id[1:] != self.track_id[:-1]) + 1
        return np.concatenate([[0], changes, [len(self.t)]]) if len(self.t) else np.zeros(1, np.int64)

    def seen_by(self, t: float, rows: int = 1) -> "Tracks":
        """The rows up to `t` (s) of the tracks that are there at `t` and have `rows` rows or more by then."""
        if not isinstance(t, Real) or isinstance(t, bool) or not np.isfinite(float(t)):
            raise DataError(f"seen_by: t {t!r}: give a time in s")
        if not isinstance(rows, Integral) or isinstance(rows, bool):
            raise DataError(f"seen_by: rows {rows!r}: give a whole number")
        if not all(isinstance(column, np.ndarray) for column in self):
            raise DataError("seen_by: give every column of the tracks as a numpy array")
        t, rows = float(t), int(rows)
        bounds = self.bounds()
        first, end = bounds[:-1], bounds[1:]
        seen = np.add.reduceat(self.t <= t, first) if len(first) else first
        there = (seen >= max(rows, 1)) & (self.t[end - 1] >= t)
        return self.take(np.repeat(there, end - first) & (self.t <= t))


def shown_s(t: float) -> str:
    """A time [s] for people: to the microsecond, without the digits by which it misses a decimal number."""
    return f"{round(float(t), 6):.16g}"


def empty_tracks() -> Tracks:
    """A table without rows."""
    return Tracks(*(np.empty(0, kind) for kind in COLUMNS.values()))


def concatenate(tables: Iterable[Tracks]) -> Tracks:
    """One table of several, in the order given (ids must differ between them)."""
    tables = list(tables)
    return Tracks(*map(np.concatenate, zip(*tables, strict=True))) if tables else empty_tracks()


def together(tables: Iterable[Tracks]) -> Tracks:
    """One table of several recordings, in their order; ids may repeat between them, so each gets a range of its own.

    Ids of text are numbers so large (`modlhmp.ids`) that ranges would not fit: their tracks are numbered below 0.
    """
    shift, below, distinct = 0, 0, []
    for table in filter(lambda one: len(one.t), tables):
        lowest, highest = int(table.track_id.min()), int(table.track_id.max())
        if shift + highest - lowest < 2**62:
            distinct.append(table._replace(track_id=table.track_id - lowest + shift))
            shift += highest - lowest + 1
        else:
            tracks = np.diff(table.bounds())
            below += len(tracks)
            distinct.append(table._replace(track_id=np.repeat(np.arange(len(tracks)) - below, tracks)))
    return concatenate(distinct)


def write_tracks(tracks: Tracks, path: str | Path, **provenance: Any) -> None:
    """Write the clean form of a recording."""
    write_parquet(pa.table(dict(zip(COLUMNS, tracks, strict=True))), path, **provenance)


def owner_ids(path: str | Path) -> dict[int, str]:
    """The owner's ids behind the track ids of a clean recording, of those that are no plain numbers (`modlhmp.ids`).

    The second piece of a track that was cut is `P01 #2`.
    """
    return owner_texts(read_metadata(path).get("owners", {}))


def owner_texts(known: Mapping[str, Sequence[Any]]) -> dict[int, str]:
    """The same from an account's `owners`, {track id: (owner's id, which piece of that track)}."""
    return {int(number): owner + (f" #{piece}" if piece > 1 else "") for number, (owner, piece) in known.items()}


def with_owners(table: pa.Table, owners: Mapping[int, str] | None) -> pa.Table:
    """A table with a column `track_id`, and beside it the owner's ids as `owner_id`; without `owners` as it is."""
    if owners is None:
        return table
    texts = pa.array([owners.get(one, str(one)) for one in column(table, "track_id").tolist()], pa.string())
    at = table.column_names.index("track_id") + 1
    return table.add_column(at, "owner_id", texts.dictionary_encode())


def person_ids(*paths: str | Path) -> dict[int, int]:
    """{track id of a later piece: that of the first} of clean recordings, where pieces of a cut track are one person.

    Empty where they are not (`same_person`).
    """
    known = [read_metadata(path).get("persons", {}) for path in paths]
    return {int(piece): whole for one in known for piece, whole in one.items()}


def whole_ids(track_id: np.ndarray, pieces: Mapping[int, int]) -> np.ndarray:
    """Track ids [n], of a later piece that of the first (`pieces`, as of `person_ids`)."""
    if not pieces:
        return track_id
    ids, which = np.unique(track_id, return_inverse=True)
    return np.array([pieces.get(one, one) for one in ids.tolist()], np.int64)[which]


def numbered(track_ids: Iterable[np.ndarray], files: Iterable[str | Path]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers [n] of the person and of the recording of each row; `track_ids` are those of each of the files' rows."""
    persons, recordings, first = [np.empty(0, np.int64)], [np.empty(0, np.int64)], 0
    for place, (track_id, file) in enumerate(zip(track_ids, files, strict=True)):
        people, person = np.unique(whole_ids(track_id, person_ids(file)), return_inverse=True)
        persons.append(first + person)
        recordings.append(np.full(len(track_id), place))
        first += len(people)
    return np.concatenate(persons), np.concatenate(recordings)


def read_people(files: Sequence[str | Path]) -> tuple[Tracks, np.ndarray]:
    """Clean recordings `together`, and the number of the person of each row."""
    tables = list(map(read_tracks, files))
    return together(tables), numbered((one.track_id for one in tables), files)[0]


def whole_persons(tracks: Tracks, person: np.ndarray) -> Tracks:
    """Tracks of which all those of one person are one, with the id of the first; `person` [rows] says whose they are.

    As they are where every track is a person of its own.
    """
    _, first, which = np.unique(person, return_index=True, return_inverse=True)
    ids = tracks.track_id[first][which]
    if np.array_equal(ids, tracks.track_id):
        return tracks
    return tracks._replace(track_id=ids).take(np.lexsort((tracks.t, ids)))


def with_persons(table: pa.Table, persons: Mapping[int, int]) -> pa.Table:
    """A table with a column `track_id`, and at its end whose each is as `person`; without `persons` as it is."""
    if not persons:
        return table
    return table.append_column("person", pa.array(whole_ids(column(table, "track_id"), persons)))


def read_tracks(path: str | Path) -> Tracks:
    """Read a clean recording; `DataError` if it lacks a column, is not sorted, or has a time or place that is none."""
    table = read_parquet(path)
    missing = [name for name in COLUMNS if name not in table.column_names]
    if missing:
        raise DataError(f"{path}: no column {', '.join(missing)}; it is not a track table of this version")
    for name, kind in COLUMNS.items():
        found, whole = table.schema.field(name).type, np.issubdtype(kind, np.integer)
        if not (pa.types.is_integer(found) or (pa.types.is_floating(found) and not whole)):
            raise DataError(f"{path}: column {name} is {found}, {'whole numbers' if whole else 'numbers'} are needed")
    tracks = Tracks(*(column(table, name).astype(kind, copy=False) for name, kind in COLUMNS.items()))
    for name in ("t", "x", "y"):
        if not (finite := np.isfinite(getattr(tracks, name))).all():
            row = int(np.argmin(finite))
            raise DataError(f"{path}, row {row + 1}: {name} {getattr(tracks, name)[row]}; make the file again")
    change = np.diff(tracks.track_id)
    if not (ordered := (change > 0) | ((change == 0) & (np.diff(tracks.t) > 0))).all():
        row = int(np.argmin(ordered)) + 1
        raise DataError(
            f"{path}, row {row + 1}: track {tracks.track_id[row]} at {tracks.t[row]:.16g} s comes after track "
            f"{tracks.track_id[row - 1]} at {tracks.t[row - 1]:.16g} s; sort by both, or make the file again"
        )
    return tracks


def gap_limit(step_s: float) -> float:
    """The longest time between two rows of a track [s]: `MAX_GAP_S`, or two time steps if these are more.

    A row may be late as elsewhere, or one that is missing would be a gap or none by a clock's rounding.
    """
    return max(MAX_GAP_S, (2 + LATE_STEPS) * step_s)


def usual_step(tracks: Tracks) -> float:
    """The median time between two rows of a track [s]; NaN where no track has two."""
    steps = np.diff(tracks.t)[np.diff(tracks.track_id) == 0]
    return float(np.median(steps)) if len(steps) else float("nan")


def runs(first: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Whole numbers first, first + 1, ... of `counts` [m] runs that begin at `first` [m], one run after the other."""
    return np.repeat(first - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())


def usable_tracks(tracks: Tracks, observed_rows: int = 4, step_s: float = 1.0) -> np.ndarray:
    """First and last row of every usable track: more rows than are observed and no gap (`gap_limit`); [n, 2]."""
    bounds = tracks.bounds()
    first, last = bounds[:-1], bounds[1:] - 1
    gaps = np.zeros(len(tracks.t), bool)
    gaps[1:] = (np.diff(tracks.t) > gap_limit(step_s)) & (np.diff(tracks.track_id) == 0)
    gap_sum = np.concatenate([[0], np.cumsum(gaps)])
    usable = (last - first >= observed_rows) & (gap_sum[last + 1] == gap_sum[first])
    return np.column_stack([first, last])[usable]


def laid_out(tracks: Tracks, rows: np.ndarray, apart_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tracks one after the other on a common axis of time, `apart_s` between them, so that one np.interp serves all.

    `rows` [m, 2] are the first and last row of m tracks. Returns the axis [s] at each of their rows, the offset [m] [s]
    of each track on it, and the index of their rows in the table.
    """
    first, last = rows[:, 0], rows[:, 1]
    offset = np.concatenate([[0.0], np.cumsum(tracks.t[last] - tracks.t[first] + apart_s)])[:-1]
    counts = last - first + 1
    index = runs(first, counts)
    return tracks.t[index] - np.repeat(tracks.t[first] - offset, counts), offset, index


def positions_at(tracks: Tracks, rows: np.ndarray, when: np.ndarray, track: np.ndarray | None = None) -> np.ndarray:
    """Positions [n, T, 2] at `when` [n, T] s after a track's first row: linear between rows, held at both ends.

    `rows` [m, 2] are the first and last row of m tracks; `track` [n] says whose each row of `when` is (default: each
    track's own).
    """
    if not len(when):
        return np.empty((*np.shape(when), 2))
    axis, offset, index = laid_out(tracks, rows, 10.0)
    duration = tracks.t[rows[:, 1]] - tracks.t[rows[:, 0]]
    whose = slice(None) if track is None else track
    at = np.clip(when, 0.0, duration[whose][:, None]) + offset[whose][:, None]
    return np.stack([np.interp(at, axis, column[index]) for column in (tracks.x, tracks.y)], axis=-1)


def clock_hours(t: np.ndarray, timezone: str) -> np.ndarray:
    """Local clock hour (0-23) of unix times [s]."""
    return clock_numbers(t, timezone) % 24


def clock_numbers(t: np.ndarray, timezone: str) -> np.ndarray:
    """Local clock hours since 1970 of unix times [s]."""
    return np.floor(np.asarray(t, float) + clock_offsets(t, timezone)).astype(np.int64) // 3600


def clock_time(t: np.ndarray, timezone: str) -> np.ndarray:
    """Clock time of day [h] of unix times [s]."""
    return np.mod(t + clock_offsets(t, timezone), 86400.0) / 3600.0


def clock_offsets(t: np.ndarray, timezone: str) -> np.ndarray:
    """Local time minus UTC [s] at unix times [s]; zones change theirs at full minutes."""
    minutes, inverse = np.unique(np.floor_divide(np.asarray(t, float), 60).astype(np.int64), return_inverse=True)
    offsets = [_offset(minute, timezone) for minute in minutes.tolist()]
    return np.array(offsets, float)[inverse.ravel()].reshape(np.shape(t))


@lru_cache(maxsize=1 << 12)  # three days: a stream of weeks is not to fill memory
def _offset(minute: int, timezone: str) -> float:
    local = datetime.fromtimestamp(max(60 * minute, _FIRST_S), ZoneInfo(timezone))
    return local.utcoffset().total_seconds()  # type: ignore[union-attr]
