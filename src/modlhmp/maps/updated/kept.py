"""Kept maps: the rows of tracks themselves, from which episodes, snippets and ways out are read.

A snippet or a way out is no sum over rows: what comes after a row decides, and that may be told later. So the rows are
kept, once each, by (recording, person, time): batches may cut a person's walk anywhere, maps may overlap, and a day or
a person is taken out again, all to the bit. A sample of snippets that must give a day back would need one sample a day,
and these are larger than the rows as long as a bin sees fewer than some 200 people a day.

Whom a map holds is drawn by keys of (recording, person, time), not by a generator's state: the same rows give the same
map, however they came. Forgetting draws by weight: a snippet's key grows with its age (P. Efraimidis, P. Spirakis,
Weighted random sampling with a reservoir, 2006), and an episode stays with the probability that is its weight.
"""

from typing import Any, ClassVar, NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.maps import episodes, exits, snippets
from modlhmp.maps.base import EDGE_M
from modlhmp.maps.pieces import resample
from modlhmp.maps.updated.slots import Update, day_number, day_text, repeats
from modlhmp.site import Site
from modlhmp.storage import DataError, column
from modlhmp.streams import row_keys, uniform_of
from modlhmp.tracks import Tracks, clock_numbers, gap_limit, usable_tracks

COLUMNS = ("recording", "track_id", "t", "x", "y")


class Rows(NamedTuple):
    """Rows of tracks [n]: the number of its recording in a sorted list of names, the person, when [s] and where [m]."""

    recording: np.ndarray
    track_id: np.ndarray
    t: np.ndarray
    x: np.ndarray
    y: np.ndarray

    def take(self, some: np.ndarray) -> "Rows":
        """The rows of a mask or an index array."""
        return Rows(*(part[some] for part in self))


NOBODY = Rows(*(np.empty(0, np.int64) for _ in range(2)), *(np.empty(0) for _ in range(3)))


class Kept:
    """A map of kept rows, of one of `kinds`."""

    kinds: ClassVar[tuple[str, ...]] = ("episodes", "snippets", "exits")

    def __init__(self, kind: str, site: Site, building: Any, half_life_h: float | None = None) -> None:
        self.kind, self.site, self.building, self.half_life_h = kind, site, building, half_life_h
        self.names: list[str] = []
        self.rows = NOBODY

    def add(self, tracks: Tracks, recording: str = "") -> Update:
        """Keep the rows of tracks, sorted, that are not kept; see `Update`.

        `DataError` where a row contradicts one that is in the map, or all are far from it; then nothing is added.
        """
        new = Rows(np.zeros(len(tracks.t), np.int64), *tracks[:4])
        if len(self.rows.t) and len(new.t):
            box = [(part.min() - EDGE_M, part.max() + EDGE_M) for part in (self.rows.x, self.rows.y)]
            if not ((new.x >= box[0][0]) & (new.x <= box[0][1]) & (new.y >= box[1][0]) & (new.y <= box[1][1])).any():
                raise DataError(
                    f"add: row 0: ({new.x[0]:g}, {new.y[0]:g}) m: no row is within {EDGE_M:g} m of the map: another "
                    "frame? Move the tracks; of a new place, build a map of its own and merge it"
                )
        names, rows, known = _union(self.names, self.rows, [recording], new, "add")
        hours = self._hours(tracks.t[~known])
        late = int((hours < self._newest()).sum()) if len(self.rows.t) else 0
        self.names, self.rows = names, rows
        return Update(len(hours), int(known.sum()), 0, late, len(np.unique(hours)))

    def merge(self, other: "Kept") -> int:
        """Keep the rows of another map, too; returns the rows that both had, which are kept once."""
        self.names, self.rows, known = _union(self.names, self.rows, other.names, other.rows, "merge")
        return int(known.sum())

    def remove(self, day: str) -> int:
        """Take out a day of the place (ISO date); returns the number of its rows. `DataError` where it has none."""
        days, number = self._hours(self.rows.t) // 24, day_number(day)
        if not (days == number).any():
            have = ", ".join(map(day_text, np.unique(days)))
            raise DataError(f"remove: day {day}: the map has {have or 'no days'}")
        return self._keep(days != number)

    def remove_person(self, person: int, recording: str = "") -> int:
        """Take out a person; returns the number of rows. `DataError` where the map has none."""
        number = self.names.index(recording) if recording in self.names else -1
        theirs = (self.rows.track_id == person) & (self.rows.recording == number)
        if not theirs.any():
            raise DataError(
                f"remove: person {person}: the map has nobody of that number in recording {recording!r}; its "
                f"recordings are {', '.join(map(repr, self.names)) or 'none'}"
            )
        return self._keep(~theirs)

    def _keep(self, some):
        before = len(self.rows.t)
        rows = self.rows.take(some)
        used = np.unique(rows.recording)
        self.names, self.rows = (
            [self.names[one] for one in used],
            rows._replace(recording=np.searchsorted(used, rows.recording)),
        )
        return before - len(rows.t)

    def tables(self) -> tuple[pa.Table | None, dict[int, pa.Table]]:
        """The map in the form of its kind: (its table, {}); a walk that goes on after a gap is a new one."""
        if not len(self.rows.t):
            return None, {}
        rows, gap_s = self.rows, gap_limit(self.site.time_step_s)
        new = np.ones(len(rows.t), bool)
        new[1:] = (np.diff(rows.recording) != 0) | (np.diff(rows.track_id) != 0) | (np.diff(rows.t) > gap_s)
        unknown = np.full(len(rows.t), np.nan)
        tracks = Tracks(np.cumsum(new) - 1, rows.t, rows.x, rows.y, unknown, unknown)
        if self.kind == "episodes":
            return episodes.build(self._thinned(tracks, np.flatnonzero(new)), self.site), {}
        pieces = resample(tracks, self.site.time_step_s)
        if self.kind == "exits":
            row = exits.counted(pieces)
            weights = None if self.half_life_h is None else self._weights(pieces.t[row])
            return exits.table_of(pieces, row, self.site, self.building, weights), {}
        row = snippets.whole(pieces, self.site)
        keys = self._uniforms(tracks, pieces, row)
        weights = None if self.half_life_h is None else self._weights(pieces.t[row])
        if weights is not None:
            keys = -np.log1p(-keys) / weights
        return snippets.table_of(pieces, row, keys, self.site, self.building, weights), {}

    def state(self) -> pa.Table:
        """What is held: a row a row of a track, sorted by recording, person and time."""
        names = pa.array([self.names[one] for one in self.rows.recording.tolist()], pa.string())
        return pa.table(dict(zip(COLUMNS, (names, *self.rows[1:]), strict=True)))

    def restore(self, table: pa.Table, path: object) -> None:
        """Take what `state` gave; `DataError` that names `path` where it is nothing of the kind."""
        try:
            said = table["recording"].to_pylist()
            self.names = sorted(set(said))
            number = {name: place for place, name in enumerate(self.names)}
            parts = [np.array(column(table, name)) for name in COLUMNS[1:]]
            rows = Rows(np.array([number[name] for name in said], np.int64), parts[0].astype(np.int64), *parts[1:])
            if not all(np.isfinite(part).all() for part in rows):
                raise ValueError("a value is not a number")
            _, self.rows, known = _union(self.names, NOBODY, self.names, rows, str(path))
            if known.any():
                raise ValueError(f"{known.sum()} rows stand twice")
        except (KeyError, ValueError, TypeError, pa.ArrowException) as error:
            raise DataError(f"{path}: not the rows of a map of kind {self.kind} ({error}); make it again") from None

    def _hours(self, t):
        """Clock hours since 1970 [n] of the place."""
        return clock_numbers(t, self.site.timezone)

    def _weights(self, t):
        """What times count now: halved by the hours before the map's newest."""
        return 0.5 ** ((self._newest() - self._hours(t)) / self.half_life_h)

    def _newest(self):
        """The clock hour of the newest row."""
        return self._hours(self.rows.t.max(keepdims=True))[0]

    def _thinned(self, tracks, first):
        """The walks that stay: each by a number of its own, with the probability that is its weight."""
        if self.half_life_h is None:
            return tracks
        last = np.append(first[1:], len(tracks.t)) - 1
        stays = self._drawn("episode", first, tracks.t[first]) < self._weights(tracks.t[last])
        return tracks.take(stays[tracks.track_id])

    def _uniforms(self, tracks, pieces, row):
        """A number in (0, 1) of each piece, by its recording, its person and its time."""
        first = usable_tracks(tracks, 1, self.site.time_step_s)[:, 0]
        return self._drawn("snippet", first[pieces.person[row]], pieces.t[row])

    def _drawn(self, what, rows, t):
        """Numbers in (0, 1) [n] by the recordings and persons of `rows` and times `t` [s]."""
        keys = np.empty(len(rows), np.uint64)
        for number, name in enumerate(self.names):
            mine = self.rows.recording[rows] == number
            keys[mine] = row_keys(self.rows.track_id[rows[mine]], t[mine], what, name)
        return uniform_of(keys)


def _union(
    names: list[str], ours: Rows, other: list[str], theirs: Rows, what: str
) -> tuple[list[str], Rows, np.ndarray]:
    """Sorted names and rows of two maps, and which [n] of `theirs` stand in `ours`, too, or twice."""
    used = sorted({*names, *(other if len(theirs.t) else [])})
    numbers = [
        np.array([used.index(one) for one in some], np.int64) for some in (names, other if len(theirs.t) else [])
    ]
    both = [part._replace(recording=number[part.recording]) for part, number in
            zip((ours, theirs), numbers, strict=True) if len(part.t)]  # fmt: skip
    known = np.zeros(len(theirs.t), bool)
    if not both:
        return used, NOBODY, known
    rows = Rows(*(np.concatenate(parts) for parts in zip(*both, strict=True)))
    # So that either order is the same.
    order = np.lexsort((rows.y, rows.x, rows.t, rows.track_id, rows.recording))
    rows = rows.take(order)
    same, apart = repeats(*rows[1:])
    same[1:] &= np.diff(rows.recording) == 0
    if len(bad := np.flatnonzero(same & apart)):
        at = bad[0]
        raise DataError(
            f"{what}: track {rows.track_id[at]} of recording {used[rows.recording[at]]!r} at t {rows.t[at]:.3f} is at "
            f"({rows.x[at - 1]:g}, {rows.y[at - 1]:g}) m and at ({rows.x[at]:g}, {rows.y[at]:g}) m: are these two "
            "recordings? Name them (recording=...)"
        )
    pairs = np.column_stack([order, np.roll(order, 1)])[same]  # of which one, or both, are of `theirs`
    known[pairs.max(axis=1) - len(ours.t)] = True
    return used, rows.take(~same), known
