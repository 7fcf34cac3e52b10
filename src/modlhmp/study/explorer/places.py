"""What a page shows of a place: its maps, where people walked and where they left, for the day and for every hour.

Aggregates only. Of recorded people nothing is shown that fewer than `LEAST_PEOPLE` of them made.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.angles import circular_difference
from modlhmp.maps.base import DAY, hour_files
from modlhmp.maps.swgmm import floor_covariances
from modlhmp.site import Site
from modlhmp.storage import column, read_parquet
from modlhmp.study.explorer.pack import Digits
from modlhmp.tracks import Tracks, clock_hours, concatenate, person_ids, read_tracks, whole_ids

LEAST_PEOPLE = 5  # at a place, and of a component, for it to be shown of recorded people
CELL_M = 1.0
PLACE_M, SHARE, TURN, SPEED = 0.01, 0.001, 0.001, 0.001  # what numbers are rounded to: m, 1, rad, m/s


class Crowd(NamedTuple):
    """Rows of `tracks` of several recordings, the `person` of each row, and whether it is the `last` of its track."""

    tracks: Tracks
    person: np.ndarray
    last: np.ndarray

    def take(self, rows: np.ndarray) -> "Crowd":
        """The rows of a mask."""
        return Crowd(self.tracks.take(rows), self.person[rows], self.last[rows])


def read_crowd(files: Iterable[str | Path]) -> Crowd:
    """The people of some clean recordings; pieces of one cut track are one person."""
    tables, persons, lasts, known = [], [], [], 0
    for file in files:
        tracks = read_tracks(file)
        distinct, person = np.unique(whole_ids(tracks.track_id, person_ids(file)), return_inverse=True)
        last = np.zeros(len(tracks.t), bool)
        last[tracks.bounds()[1:] - 1] = len(tracks.t) > 0
        tables.append(tracks)
        persons.append(person + known)
        lasts.append(last)
        known += len(distinct)
    nothing = np.empty(0, np.int64)
    return Crowd(concatenate(tables), np.concatenate([nothing, *persons]), np.concatenate([nothing > 0, *lasts]))


def places(crowd: Crowd, site: Site, maps: dict[str, str], clock: bool, least: int) -> dict[str, Any]:
    """Everything of a place as a tree for `pack.packed`.

    `maps` are the paths of those of `cliff`, `tc_cliff` and `stef` that there are, `clock` says whether hours are
    known, `least` of how many people anything must be. `periods` are null, the whole day, and the hours; `cliff`,
    `stef` and `flow` have an entry for each, null where there is none.
    """
    hour = clock_hours(crowd.tracks.t, site.timezone) if clock else np.full(len(crowd.tracks.t), -1)
    files = {kind: hour_files(maps[kind]) if kind in maps and clock else {} for kind in ("tc_cliff", "stef")}
    hours = sorted({*np.unique(hour[hour >= 0]).tolist(), *files["tc_cliff"], *files["stef"]})
    hours = [one for one in site.listed_hours or hours if one in hours]
    crowds = [crowd, *(crowd.take(hour == one) for one in hours)]
    day = maps.get("cliff") or (f"{maps['tc_cliff']}/{DAY}" if "tc_cliff" in maps else None)
    components = [day, *(files["tc_cliff"].get(one) for one in hours)]
    cells = [None, *(files["stef"].get(one) for one in hours)]
    return {
        "periods": [None, *hours],
        "cliff": [_each(file, _cliff, part, least) for file, part in zip(components, crowds, strict=True)],
        "stef": [_each(file, _stef, crowd, least) for file in cells],
        "flow": [flow(part, least) for part in crowds],
    }


def flow(crowd: Crowd, least: int) -> dict[str, Any] | None:
    """Per cell of `CELL_M`: how many people, their mean velocity [m/s], of how many rows, and how many left there.

    `left` is NaN where it is of fewer people than `least`, but for none at all.
    """
    tracks = crowd.tracks
    cells, cell = np.unique(cells_of(tracks.x, tracks.y, CELL_M), axis=0, return_inverse=True)
    cell = cell.ravel()
    people = distinct(cell, crowd.person, len(cells))
    moving = np.isfinite(tracks.speed) & np.isfinite(tracks.heading)
    speed, heading = (np.where(moving, part, 0.0) for part in (tracks.speed, tracks.heading))
    seen = np.maximum(np.bincount(cell, moving, len(cells)), 1)
    vx, vy = (np.bincount(cell, speed * part(heading), len(cells)) / seen for part in (np.cos, np.sin))
    left = distinct(cell[crowd.last], crowd.person[crowd.last], len(cells)).astype(float)
    left[(left > 0) & (left < least)] = np.nan
    shown = people >= least
    if not shown.any():
        return None
    centre = (cells[shown] + 0.5) * CELL_M
    return {
        "x": Digits(centre[:, 0], CELL_M / 2),
        "y": Digits(centre[:, 1], CELL_M / 2),
        "people": people[shown],
        "rows": np.bincount(cell, minlength=len(cells))[shown],
        "left": Digits(left[shown]),
        "vx": Digits(vx[shown], SPEED),
        "vy": Digits(vy[shown], SPEED),
    }


def cells_of(x: np.ndarray, y: np.ndarray, size_m: float) -> np.ndarray:
    """Indices [n, 2] of the cells of positions."""
    return np.floor(np.column_stack([x, y]) / size_m).astype(np.int64)


def distinct(place: np.ndarray, person: np.ndarray, places: int) -> np.ndarray:
    """How many different people were at each of so many places; `place`, `person` [n] go together."""
    if not len(place):
        return np.zeros(places, np.int64)
    people = int(person.max()) + 1
    pairs = np.unique(place * people + person)  # one number a pair, which is much faster than rows of two
    return np.bincount(pairs // people, minlength=places)


def _each(file, reader, crowd, least):
    return None if file is None or not Path(file).exists() else reader(read_parquet(file), crowd, least)


def _stef(table: pa.Table, crowd: Crowd, least: int) -> dict[str, Any] | None:
    """An hour's cells with dynamics; a cell's signal is learned from the whole day, so its people are those of it."""
    size = float(table.schema.metadata[b"resolution"])
    share = column(table, "probabilities").reshape(table.num_rows, -1)
    x, y = (column(table, name).astype(float) for name in ("x", "y"))
    shown = (share > 0).any(axis=1) & (_people_in(crowd, cells_of(x, y, size), size) >= least)
    if not shown.any():
        return None
    return {
        "size": size,
        "x": Digits(x[shown], size / 2),
        "y": Digits(y[shown], size / 2),
        "orientations": share.shape[1],
        "share": Digits(share[shown], 0.01),
    }


def _people_in(crowd, cells, size):
    """How many people were in each of `cells` [m, 2]."""
    both = np.concatenate([cells, cells_of(crowd.tracks.x, crowd.tracks.y, size)])
    _, index = np.unique(both, axis=0, return_inverse=True)
    index = index.ravel()
    return distinct(index[len(cells) :], crowd.person, index.max(initial=0) + 1)[index[: len(cells)]]


def _cliff(table: pa.Table, crowd: Crowd, least: int) -> dict[str, Any] | None:
    """A CLiFF-map's locations and components; those of too few people are left out, the first with all of theirs."""
    names = ("weight", "mean_heading", "mean_speed", "var_heading", "cov_heading_speed", "var_speed")
    components = np.column_stack([column(table, name).astype(float) for name in names])
    floor_covariances(components)
    first = np.flatnonzero(np.diff(column(table, "location"), prepend=-1))
    number = np.diff(np.append(first, table.num_rows))
    x, y, p, count = (column(table, name)[first].astype(float) for name in ("x", "y", "p", "count"))
    radius = float((table.schema.metadata or {}).get(b"radius", 1.0))
    here, each = _people_of(crowd, np.column_stack([x, y]), radius, components, first, number)
    shown = (here >= least) & (np.add.reduceat(each >= least, first) > 0 if len(first) else False)
    if not shown.any():
        return None
    location = np.repeat(np.arange(len(first)), number)
    kept = shown[location] & (each >= least)
    steps = (SHARE, TURN, SPEED, 0.0001, 0.0001, 0.0001)
    return {
        "x": Digits(x[shown], PLACE_M),
        "y": Digits(y[shown], PLACE_M),
        "count": count[shown],
        "people": here[shown],
        "p": Digits(p[shown], 0.0001),
        "location": (np.cumsum(shown) - 1)[location[kept]],
        "by": each[kept],
        **{name: Digits(components[kept, i], steps[i]) for i, name in enumerate(names)},
    }


def _people_of(crowd, places_xy, radius, components, first, number):
    """How many people were within `radius` of each place, and of each component: those likeliest to be of it."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - only this needs it

    tracks = crowd.tracks
    crowd = crowd.take(tracks.moves())
    tracks = crowd.tracks
    if not len(tracks.t) or not len(first):
        return np.zeros(len(first), np.int64), np.zeros(len(components), np.int64)
    found = cKDTree(np.column_stack([tracks.x, tracks.y])).query_ball_point(places_xy, radius * (1 + 1e-12))
    member = np.concatenate(found).astype(np.int64)
    whose = [
        begin + likeliest(tracks.heading[mine], tracks.speed[mine], components[begin : begin + several])
        for mine, begin, several in zip(found, first, number, strict=True)
    ]
    person, place = crowd.person[member], np.repeat(np.arange(len(first)), [len(mine) for mine in found])
    return distinct(place, person, len(first)), distinct(np.concatenate(whose), person, len(components))


def likeliest(heading: np.ndarray, speed: np.ndarray, components: np.ndarray) -> np.ndarray:
    """Index [n] of the component, of `components` [J, 6], under which each heading [rad] and speed is likeliest."""
    weight, turn, mps, vtt, vtr, vrr = components.T
    t, r = circular_difference(heading[:, None], turn), speed[:, None] - mps
    determinant = vtt * vrr - vtr**2
    distance = (vrr * t**2 - 2 * vtr * t * r + vtt * r**2) / determinant
    return np.argmax(np.log(weight) - 0.5 * (np.log(determinant) + distance), axis=1)
