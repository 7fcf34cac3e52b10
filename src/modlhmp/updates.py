"""Maps that are kept up to date: told of people bit by bit, merged, and made to forget a day, a person, or with time.

    kept = UpdatedMap("cliff", Site(timezone="Asia/Tokyo"))
    kept.add(tracks_of_monday, "monday")
    kept.add(tracks_of_tuesday, "tuesday")      # in any order, in pieces of any size
    kept.remove(day="2012-10-24")
    futures = modlhmp.forecast(kept.written(), history)

What equals what, to the bit, and why, is in docs/updated-maps.md.
"""

import logging
from collections.abc import Callable
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.api import Map
from modlhmp.arguments import check_tracks, path_of, site_from, site_of
from modlhmp.exchange.parquet import is_parquet
from modlhmp.kinds import find
from modlhmp.maps.updated.cliff import CountedCliff
from modlhmp.maps.updated.counted import Counted
from modlhmp.maps.updated.kept import Kept
from modlhmp.maps.updated.slots import Update, repeats
from modlhmp.maps.updated.stef import CountedStef
from modlhmp.settings import as_plain, check, unknown
from modlhmp.site import Site
from modlhmp.storage import DataError, read_metadata, read_parquet, write_parquet
from modlhmp.tracks import Tracks

STATES: dict[str, Callable[..., Counted | Kept]] = {
    kind: state for state in (CountedCliff, CountedStef, Kept) for kind in state.kinds
}
NOT_COUNTED = {"intensity": "count", "bandwidth": "isotropic"}  # of a CLiFF-map: other ways need the rows


class UpdatedMap:
    """A map of a kind (cliff, tc_cliff, stef, episodes, snippets, exits) that is updated.

    `building` are the kind's own options. `half_life_h`: what was seen so many hours before the newest rows counts
    half; None: nothing is forgotten. An update that is refused (`DataError`) leaves the map as it was.
    """

    def __init__(
        self, /, kind: str, site: Site | None = None, half_life_h: float | None = None, **building: Any
    ) -> None:
        if kind not in STATES:
            raise DataError(unknown("UpdatedMap", "kind", kind, STATES))
        record: Any = find(kind)
        options = check(record.building, building, f"UpdatedMap({kind!r})")
        for name, only in NOT_COUNTED.items():
            if getattr(options, name, only) != only:
                raise DataError(
                    f"UpdatedMap({kind!r}): {name} {getattr(options, name)!r} needs the rows, which are not held: "
                    f"use {only!r}, or modlhmp.build_map"
                )
        interval_s = getattr(options, "interval_s", 3600.0)
        if (3600 / interval_s) % 1:
            raise DataError(
                f"UpdatedMap({kind!r}): interval_s {interval_s}: counts do not say at which hour within an interval: "
                "give one that divides an hour, such as 600, or use modlhmp.build_map"
            )
        self._state = STATES[kind](kind, site_of(site), options)
        self.forget(half_life_h)

    @property
    def kind(self) -> str:
        """Kind of the map that is `written`."""
        return self._state.kind

    @property
    def site(self) -> Site:
        """The site it is of."""
        return self._state.site

    @property
    def building(self) -> dict[str, Any]:
        """The kind's own options."""
        return as_plain(self._state.building)

    @property
    def half_life_h(self) -> float | None:
        """See `forget`."""
        return self._state.half_life_h

    def add(self, tracks: Tracks, recording: str = "") -> Update:
        """Add tracks; rows that the map has already are counted once. Returns what became of the rows.

        Persons are known by `recording` and track id, so recordings whose ids repeat need names of their own.
        `DataError` for tracks that are not a time step apart, rows that contradict others, or another frame.
        """
        where = f"add to a map of kind {self.kind}"
        if not isinstance(recording, str):
            raise DataError(f"{where}: recording {recording!r}: give a name")
        ordered, repeated, moved = _in_order(tracks, where, self.site)
        check_tracks(where, ordered, self.site)
        if not (finite := np.isfinite(ordered.x) & np.isfinite(ordered.y)).all():
            row = int(np.argmin(finite))
            who = f"track {ordered.track_id[row]} at t {ordered.t[row]:.3f}"
            raise DataError(f"{where}: row {row}: {who} has a position that is not a number; leave such rows out")
        update = self._state.add(ordered, recording)
        update = update._replace(repeated=update.repeated + repeated, out_of_order=moved)
        if repeated or update.repeated or moved or not update.taken:
            logging.getLogger("modlhmp").warning("%s, recording %r: %s", where, recording, update)
        return update

    def merge(self, other: "UpdatedMap") -> int:
        """Add what another map of the same kind, site and cells holds; returns the rows that both had, counted once."""
        if not isinstance(other, UpdatedMap):
            raise DataError(f"merge: {type(other).__name__}: give an UpdatedMap, as UpdatedMap.load reads it")
        ours, theirs = self._cells(), other._cells()
        for name in ours:  # the kind comes first, and says which others there are
            if ours[name] != theirs[name]:
                raise DataError(
                    f"merge: {name} {ours[name]!r} and {theirs[name]!r}: maps of other cells cannot be added up; build "
                    f"one anew with {name} {ours[name]!r}"
                )
        both = self._state.merge(other._state)  # type: ignore[arg-type]  # of one kind
        if both:
            logging.getLogger("modlhmp").warning("merge: both maps have %d rows, which are counted once", both)
        return both

    def _cells(self):
        """What maps must share to be added up."""
        site = {"time zone": self.site.timezone, "time step [s]": self.site.time_step_s}
        return {"kind": self.kind, **site, **self.building}

    def remove(self, day: str | None = None, *, person: int | None = None, recording: str = "") -> int:
        """Take out all rows of a day of the place (ISO date), or of a person; returns their number.

        Nothing of them is left: the map is that of before they were added. Maps of counts cannot take out a person.
        """
        if (day is None) == (person is None):
            raise DataError("remove: give a day, such as '2012-10-24', or a person's track id")
        if day is not None:
            return self._state.remove(day)
        if not isinstance(person, Integral) or isinstance(person, bool):
            raise DataError(f"remove: person {person!r}: give a track id, a whole number")
        return self._state.remove_person(int(person), recording)

    def forget(self, half_life_h: float | None) -> None:
        """Let what is seen count half after so many hours; None: for ever. It is read so; nothing held is lost."""
        if half_life_h is not None and (
            not isinstance(half_life_h, Real) or isinstance(half_life_h, bool) or not 0 < half_life_h < float("inf")
        ):
            raise DataError(
                f"half_life_h {half_life_h!r}: give hours above 0, such as 3; None forgets nothing. To count the last "
                "hour alone, build a map of it"
            )
        self._state.half_life_h = None if half_life_h is None else float(half_life_h)

    def written(self) -> Map:
        """The map in the form of its kind, as `modlhmp.build_map` gives it, which every forecaster reads.

        `DataError` where it is empty, before anything is added or after everything is removed.
        """
        whole, hours = self._state.tables()
        if not any(len(table) for table in (whole, *hours.values()) if table is not None):
            raise DataError(
                f"the map of kind {self.kind} is empty: it holds nobody, or too few people who move; add tracks first"
            )
        return Map(self.kind, self.site, whole, hours)

    def save(self, path: str | Path) -> None:
        """Write what it holds to a Parquet file, from which `load` goes on."""
        path = path_of("UpdatedMap.save", path)
        write_parquet(
            self._state.state(), path, updated=self.kind, site=as_plain(self.site), building=self.building,
            half_life_h=self.half_life_h,
        )  # fmt: skip

    @classmethod
    def load(cls, path: str | Path) -> "UpdatedMap":
        """Read what `save` wrote; `DataError` for another or a damaged file."""
        path = path_of("UpdatedMap.load", path)
        about = read_metadata(path)
        if "updated" not in about:
            raise DataError(
                f"{path}: it holds no counts to be updated; a map that is built or written out is finished: begin with "
                "`modlhmp map update` and the tracks"
            )
        site = site_from(about["site"], f"{path}: its site")
        found = cls(about["updated"], site, about["half_life_h"], **about["building"])
        found._state.restore(read_parquet(path), path)
        return found


def is_state(path: str | Path) -> bool:
    """Whether a file is what `UpdatedMap.save` wrote."""
    return Path(path).is_file() and is_parquet(path) and "updated" in read_metadata(path)


def _in_order(tracks: Any, where: str, site: Site) -> tuple[Tracks, int, int]:
    """Tracks by person and time; how many rows stood twice, which are left out, and how many out of order."""
    if not isinstance(tracks, Tracks) or {np.shape(part) for part in tracks} != {np.shape(tracks[0])[:1]}:
        check_tracks(where, tracks, site)
    order = np.lexsort((tracks.y, tracks.x, tracks.t, tracks.track_id))
    moved = int((np.diff(tracks.t) < 0)[np.diff(tracks.track_id) == 0].sum())
    tracks = tracks.take(order)
    same, apart = repeats(*tracks[:4])
    if len(bad := np.flatnonzero(same & apart)):
        at = bad[0]
        raise DataError(
            f"{where}: row {order[at]}: track {tracks.track_id[at]} at t {tracks.t[at]:.3f} is at ({tracks.x[at]:g}, "
            f"{tracks.y[at]:g}) m, and in row {order[at - 1]} at ({tracks.x[at - 1]:g}, {tracks.y[at - 1]:g}) m: "
            "leave one out"
        )
    return tracks.take(~same), int(same.sum()), moved
