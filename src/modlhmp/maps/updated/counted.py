"""Counted maps: how often something was seen in a cell, in whole numbers by slot of time, and of which rows.

A slot is a clock hour of the place (an interval of a STeF-map). What a map holds of a slot is a sum over rows, in whole
numbers; so it does not depend on how rows are cut into batches or in which order these come, maps are merged by adding,
and a day is taken out again to the bit. A half-life is applied where the map is read out: weights that are stored have
rounded, and no subtraction gives back what was before.

Every row leaves a key of 64 bits, by which it is known again: rows that come twice are counted once. The key holds the
row's place, too, so that a person who is said to have been at two places at once is an error, not a matter of who came
first. Keys are of rows, not of persons: nobody's rows can be found in the counts.
"""

from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.maps.base import EDGE_M
from modlhmp.maps.updated.slots import DAY_S, Update, day_number, day_text, spans, thousandths
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.streams import row_keys
from modlhmp.tracks import Tracks, clock_offsets

LIMIT = 1 << 24  # cells are numbered from -LIMIT to LIMIT
BIN_BITS = 12
PLACE_BITS = np.uint64(16)  # of a row's key
COLUMNS = ("slot", "keys", "codes", "counts")


class Slot(NamedTuple):
    """What a map holds of a slot: the sorted `keys` [rows] uint64 of its rows, and `counts` [m] of `codes` [m], sorted.

    A code is a cell and a bin (`packed`).
    """

    keys: np.ndarray
    codes: np.ndarray
    counts: np.ndarray


class Counted:
    """A map of counts. A kind of them says which rows count (`used`), where (`code`) and how it is read (`tables`)."""

    kinds: ClassVar[tuple[str, ...]] = ()
    slot_s: float = 3600.0

    def __init__(self, kind: str, site: Site, building: Any, half_life_h: float | None = None) -> None:
        self.kind, self.site, self.building, self.half_life_h = kind, site, building, half_life_h
        self.slots: dict[int, Slot] = {}

    @staticmethod
    def used(tracks: Tracks) -> np.ndarray:
        """Which rows count: those that move."""
        return tracks.moves()

    def code(self, tracks: Tracks) -> tuple[np.ndarray, np.ndarray]:
        """(row [m], code [m]) of what rows add one to."""
        raise NotImplementedError

    def tables(self) -> tuple[pa.Table | None, dict[int, pa.Table]]:
        """The map in the form of its kind: (of the whole day, {hour: of that hour})."""
        raise NotImplementedError

    @property
    def per_day(self) -> int:
        """Slots of a day."""
        return int(np.ceil(DAY_S / self.slot_s))

    @property
    def newest(self) -> int:
        """The last slot with rows."""
        return max(self.slots)

    def slot_of(self, t: np.ndarray) -> np.ndarray:
        """Slot [n] of unix times [s]."""
        local = t + clock_offsets(t, self.site.timezone)
        return (local // DAY_S).astype(np.int64) * self.per_day + (local % DAY_S // self.slot_s).astype(np.int64)

    def age_h(self, slots: np.ndarray, now: np.ndarray | int) -> np.ndarray:
        """How many hours slots began before the slot `now`; 0 of later ones."""
        began = [one // self.per_day * DAY_S + one % self.per_day * self.slot_s for one in (np.asarray(slots), now)]
        return np.maximum(began[1] - began[0], 0.0) / 3600.0

    def add(self, tracks: Tracks, recording: str = "") -> Update:
        """Count the rows of tracks, sorted, that have not been counted; see `Update`.

        `DataError` where a row contradicts one that is in the map, or all are far from it; then nothing is added.
        """
        moving = self.used(tracks)
        rows = np.flatnonzero(moving)
        keys = _keys(tracks.take(rows), recording)
        slot, fresh, newest = self.slot_of(tracks.t[rows]), np.ones(len(rows), bool), max(self.slots, default=None)
        for number, mine in spans(slot):
            if number in self.slots:
                known = _known(keys[mine], self.slots[number].keys)
                _check_same(keys[mine], self.slots[number].keys, known, tracks, rows[mine], recording)
                fresh[mine] = known < 0
        rows, keys, slot = rows[fresh], keys[fresh], slot[fresh]
        self._check_frame(tracks.x[rows], tracks.y[rows])
        late = 0 if newest is None else int((slot < newest).sum())
        of, code = self.code(tracks.take(rows))
        codes = {number: code[mine] for number, mine in spans(slot[of])}
        none = np.empty(0, np.int64)  # of rows that are near no cell
        changed = {number: Slot(np.sort(keys[mine]), *summed(codes.get(number, none))) for number, mine in spans(slot)}
        for number, part in changed.items():
            self.slots[number] = _joined(self.slots[number], part) if number in self.slots else part
        return Update(len(rows), int(moving.sum()) - len(rows), int((~moving).sum()), late, len(changed))

    def merge(self, other: "Counted") -> int:
        """Add the counts of another map; returns the rows that both had, which are counted once.

        That is possible where one has all rows of an hour that the other has; `DataError` where they share some.
        """
        joined, both = {}, 0
        for number, theirs in other.slots.items():
            ours = self.slots.get(number)
            if ours is None:
                joined[number] = theirs
                continue
            known = _known(theirs.keys, ours.keys)
            shared = int((known >= 0).sum())
            if shared and (theirs.keys[known >= 0] != ours.keys[known[known >= 0]]).any():
                raise DataError(f"merge: {self._when(number)}: the maps say of one person two places at one time; "
                                "build both from the same recordings, or name the recordings differently")  # fmt: skip
            if not shared:
                joined[number] = _joined(ours, theirs)
            elif shared == len(theirs.keys):
                joined[number] = ours
            elif shared == len(ours.keys):
                joined[number] = theirs
            else:
                raise DataError(
                    f"merge: {self._when(number)}: the maps share {shared} of {len(ours.keys)} and "
                    f"{len(theirs.keys)} rows, and counts cannot tell which: remove that day from one of them and add "
                    "its tracks"
                )
            both += shared
        self.slots.update(joined)
        return both

    def remove(self, day: str) -> int:
        """Take out a day of the place (ISO date); returns the number of its rows. `DataError` where it has none."""
        number = day_number(day)
        gone = [slot for slot in self.slots if slot // self.per_day == number]
        if not gone:
            have = sorted({slot // self.per_day for slot in self.slots})
            raise DataError(f"remove: day {day}: the map has {', '.join(map(day_text, have)) or 'no days'}")
        return sum(len(self.slots.pop(slot).keys) for slot in gone)

    def remove_person(self, person: int, recording: str = "") -> int:
        """Refused: counts do not know whose they are."""
        raise DataError(
            f"remove: person {person}: a map of kind {self.kind} holds counts of rows, not whose rows they are, so no "
            "person can be taken out: remove the day and add its tracks without the person"
        )

    def state(self) -> pa.Table:
        """What is held, a row a slot; codes and keys as differences, which are smaller in a file."""
        numbers = sorted(self.slots)
        parts = [self.slots[number] for number in numbers]
        lists = [
            pa.array([np.diff(part.keys, prepend=np.uint64(0)) for part in parts], pa.list_(pa.uint64())),
            pa.array([np.diff(part.codes, prepend=0) for part in parts], pa.list_(pa.int64())),
            pa.array([part.counts for part in parts], pa.list_(pa.int64())),
        ]
        return pa.table(dict(zip(COLUMNS, [pa.array(numbers, pa.int64()), *lists], strict=True)))

    def restore(self, table: pa.Table, path: object) -> None:
        """Take what `state` gave; `DataError` that names `path` where it is nothing of the kind."""
        try:
            for number, keys, codes, counts in zip(*(table[name] for name in COLUMNS), strict=True):
                parts = [np.from_dlpack(one.values) for one in (keys, codes, counts)]
                slot = Slot(np.cumsum(parts[0]), np.cumsum(parts[1]), np.array(parts[2]))
                if len(slot.codes) != len(slot.counts) or (parts[1][1:] <= 0).any() or (slot.counts <= 0).any():
                    raise ValueError(f"slot {number}")
                self.slots[number.as_py()] = slot
        except (KeyError, ValueError, TypeError, AttributeError, pa.ArrowException) as error:
            raise DataError(f"{path}: not the counts of a map of kind {self.kind} ({error}); make it again") from None

    def _check_frame(self, x, y):
        """`DataError` where all positions are far from all cells."""
        codes = np.concatenate([np.empty(0, np.int64), *(slot.codes for slot in self.slots.values())])
        if not len(codes) or not len(x):
            return
        size = self.building.resolution_m
        box = [(part.min() * size - EDGE_M, (part.max() + 1) * size + EDGE_M) for part in unpacked(codes)[:2]]
        near = (x >= box[0][0]) & (x <= box[0][1]) & (y >= box[1][0]) & (y <= box[1][1])
        if not near.any():
            raise DataError(
                f"add: row 0: ({x[0]:g}, {y[0]:g}) m: no row is within {EDGE_M:g} m of the map, "
                f"{box[0][0] + EDGE_M:g} to {box[0][1] - EDGE_M:g} x {box[1][0] + EDGE_M:g} to {box[1][1] - EDGE_M:g} "
                "m: another frame? Move the tracks; of a new place, build a map of its own and merge it"
            )

    def _when(self, number):
        """A slot in words."""
        s = number % self.per_day * self.slot_s
        return f"{day_text(number // self.per_day)} {int(s // 3600):02d}:{int(s % 3600 // 60):02d}"


def packed(i: np.ndarray, j: np.ndarray, bins: np.ndarray) -> np.ndarray:
    """Code [n] of cells (i, j) and bins [n] below 2^12: sorted by i, j, bin."""
    if len(i) and max(np.abs(i).max(), np.abs(j).max()) >= LIMIT:
        raise DataError(f"a position is more than {LIMIT} cells from the origin; are positions in m?")
    return ((i + LIMIT) << (25 + BIN_BITS)) | ((j + LIMIT) << BIN_BITS) | bins


def unpacked(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells i, j and bins [n] of codes."""
    low = (1 << 25) - 1
    return (codes >> (25 + BIN_BITS)) - LIMIT, ((codes >> BIN_BITS) & low) - LIMIT, codes & ((1 << BIN_BITS) - 1)


def summed(codes: np.ndarray, counts: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(codes, counts) sorted, each code once with the sum of its counts (default: 1 each), those of 0 left out."""
    order = np.argsort(codes, kind="stable")
    codes = codes[order]
    first = np.flatnonzero(np.diff(codes, prepend=-1))
    if counts is None:
        return codes[first], np.diff(np.append(first, len(codes)))
    total = np.add.reduceat(counts[order], first) if len(first) else np.empty(0, np.int64)
    return codes[first][total != 0], total[total != 0]


def changes(before: Mapping[int, Slot], after: Mapping[int, Slot]) -> tuple[np.ndarray, np.ndarray]:
    """(codes, counts) that turn the sum over one set of slots into that over another; counts may be below 0."""
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    for number in before.keys() | after.keys():
        old, new = before.get(number), after.get(number)
        if old is not new:
            parts += [(old.codes, -old.counts)] if old else []
            parts += [(new.codes, new.counts)] if new else []
    return summed(*_together(parts))


def _together(parts: Iterable[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    parts = list(parts)
    if not parts:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    return np.concatenate([one for one, _ in parts]), np.concatenate([one for _, one in parts])


def _joined(ours, theirs):
    """Two parts of a slot as one."""
    keys = np.sort(np.concatenate([ours.keys, theirs.keys]))
    return Slot(keys, *summed(*_together([(ours.codes, ours.counts), (theirs.codes, theirs.counts)])))


def _keys(tracks, recording):
    """Keys [n] of rows: whose and when in the upper 48 bits, where in the lower 16."""
    who = row_keys(tracks.track_id, tracks.t, "row", recording)
    where = row_keys(thousandths(tracks.x).astype(np.int64), tracks.y, "place")
    return (who >> PLACE_BITS << PLACE_BITS) | (where & ((np.uint64(1) << PLACE_BITS) - np.uint64(1)))


def _known(keys, stored):
    """Where each key [n] stands in sorted keys, whatever its place says; -1: nowhere."""
    if not len(stored):
        return np.full(len(keys), -1)
    at = np.minimum(np.searchsorted(stored >> PLACE_BITS, keys >> PLACE_BITS), len(stored) - 1)
    return np.where(stored[at] >> PLACE_BITS == keys >> PLACE_BITS, at, -1)


def _check_same(keys, stored, known, tracks, rows, recording):
    """`DataError` where a row is another than the one that is known of the same person and time."""
    if len(bad := np.flatnonzero((known >= 0) & (stored[known] != keys))):
        row = rows[bad[0]]
        raise DataError(
            f"add: row {row}: track {tracks.track_id[row]} at t {tracks.t[row]:.3f} is at ({tracks.x[row]:g}, "
            f"{tracks.y[row]:g}) m, the map knows it elsewhere: is it another recording? Name it (recording=...), or "
            f"remove the day and add it anew{f'; now it is {recording!r}' if recording else ''}"
        )
