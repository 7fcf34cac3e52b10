"""Which column of a table holds what: by its name where that is known, and by its values.

A time goes up in the same steps for everybody; people move little between two of their rows, compared with the place.
"""

import re
from typing import NamedTuple

import numpy as np

from modlhmp.clock import unix_time
from modlhmp.inspection.sheet import Sheet
from modlhmp.readers.numerals import number

# Names of columns, without case, blanks and signs, as datasets, trackers and simulators write them.
_NAMES = {
    "track_id": "id trackid track ped pedid pedestrianid pedestrian person personid agent agentid agid objid objectid "
    "objectidentifier trackedobject no pedestrianno p uid humanid human subject subjectid tid pid obj object targetid",
    "t": "t time timestamp times sec secs seconds simsec pedestriansimsec simtime timesec frame frameid framenumber "
    "framenum frameno fr f datetime datetimeutc timestampms date timestep unixtime stamp",
    "x": "x posx xpos positionx xposition xcenter centerx xcentre coordcentx cx px xest xm easting east locx locationx",
    "y": "y posy ypos positiony yposition ycenter centery ycentre coordcenty cy py yest ym northing north locy "
    "locationy",
    "speed": "v speed vel velocity 2dspeed speed2d vabs absspeed",
    "heading": "heading th theta angle motionangle orientation direction yaw thetadelta psi course phi bearing",
}
_ROLE = {name: role for role, names in _NAMES.items() for name in names.split()}
_UNIT = re.compile(
    r"[\s_/(\[]+(?:in\s+)?(mm|cm|km/h|kmh|m/s|ms|us|ns|degrees|deg|rad|pixels?|px|m|s)[)\]\s]*$", re.IGNORECASE
)
SMOOTH = 0.2  # a step of a person by the size of the place
UNTIDY = 1.0  # of recordings it is below 0.5; of tables that are none, such as a map, above 1.5


class Columns(NamedTuple):
    """Positions of the columns, and of speed and heading candidates; units that names say; how sure the choice is."""

    track_id: int
    t: int
    x: int
    y: int
    named: dict[str, int]
    units: dict[str, str]
    by_values: bool = False


class Values(NamedTuple):
    """The columns of a table as numbers (NaN where they are none), ids as whole numbers per distinct text."""

    numbers: np.ndarray  # [rows, columns]
    codes: np.ndarray  # [rows, columns]
    iso: list[int]


def values_of(sheet: Sheet) -> Values:
    """The fields of a table's first rows as numbers; ISO dates and times as unix seconds."""
    width = len(sheet.rows[0])
    numbers = np.full((len(sheet.rows), width), np.nan)
    codes, iso = np.empty((len(sheet.rows), width), np.int64), []
    for column in range(width):
        texts = [row[column] for row in sheet.rows]
        found = [number(text, sheet.decimal) for text in texts]
        if (
            sum(one is None for one in found) > 0.5 * len(found)
            and unix_time(texts[len(texts) // 2], "UTC") is not None
        ):
            found = [unix_time(text, "UTC") for text in texts]
            iso.append(column)
        numbers[:, column] = [one if one is not None and np.isfinite(one) else np.nan for one in found]
        known: dict[str, int] = {}
        codes[:, column] = [known.setdefault(text, len(known)) for text in texts]
    return Values(numbers, codes, iso)


def name_and_unit(name: str) -> tuple[str, str]:
    """A column's name without its unit, case and signs, and the unit: `x/cm` -> x, cm."""
    match = _UNIT.search(name)
    unit = match[1].lower() if match and match.start() > 0 else ""
    plain = name[: match.start()] if unit and match else name
    tidy = re.sub(r"[^a-z0-9]", "", plain.lower())
    return (tidy, unit) if tidy in _ROLE or not unit else (re.sub(r"[^a-z0-9]", "", name.lower()), "")


def find_columns(sheet: Sheet, values: Values) -> Columns | None:
    """The columns of a table, None where no choice of them gives people who move."""
    named: dict[str, int] = {}
    units: dict[str, str] = {}
    for position, name in enumerate(sheet.names):
        plain, unit = name_and_unit(name)
        role = _ROLE.get(plain)
        if role and role not in named:
            named[role] = position
            if unit:
                units[role] = unit
            if role == "t" and plain.startswith(("frame", "fr", "f")) and not plain.startswith("from"):
                units[role] = "frame"
            if plain.endswith("ms") and role == "t" and plain != "ms":
                units[role] = "ms"
    if {"track_id", "t", "x", "y"} <= named.keys():
        return Columns(named["track_id"], named["t"], named["x"], named["y"], named, units)
    best = _by_values(values, named)
    if best is None:
        return None
    owner, t, x, y = best
    return Columns(owner, t, x, y, named, units, by_values=True)


def _by_values(values, named):
    """The (id, time, x, y) that make the smoothest tracks."""
    width, found = values.numbers.shape[1], []
    times = [named["t"]] if "t" in named else range(width)
    owners = [named["track_id"]] if "track_id" in named else range(width)
    for t in times:
        for owner in owners:
            if t != owner and (score := _score(values, owner, t, named)) is not None:
                found.append(score)
    score, chosen = min(found, default=(np.inf, None))
    return chosen if score < UNTIDY else None


def _score(values, owner, t, named):
    """(how far from people's tracks, the columns) of one choice of id and time."""
    clock, ids = values.numbers[:, t], values.codes[:, owner]
    numeric = np.isfinite(values.numbers[:, owner])
    fractions = numeric.any() and not np.array_equal(*(part[numeric] for part in (
        values.numbers[:, owner], np.rint(values.numbers[:, owner]))))  # fmt: skip
    usable = np.isfinite(clock)
    if fractions or usable.mean() < 0.8 or len(np.unique(ids)) > 0.5 * len(ids):
        return None
    by_file = np.lexsort((np.arange(len(ids)), ids))
    same = np.diff(ids[by_file]) == 0
    ahead = np.sign(np.diff(clock[by_file])[same])
    order = np.lexsort((clock, ids))
    same = np.diff(ids[order]) == 0
    steps = np.diff(clock[order])[same]
    if not len(steps) or not (steps > 0).any():
        return None
    usual = np.median(steps[steps > 0])
    even = sum(np.mean(np.abs(steps - usual) < off * usual) for off in (0.5, 0.01)) / 2
    shared = 1 - len(np.unique(clock[usable])) / usable.sum()  # several people at a time
    smooth = {}
    for column in range(values.numbers.shape[1]):
        part = values.numbers[order, column]
        spread = np.nanquantile(part, 0.95) - np.nanquantile(part, 0.05) if np.isfinite(part).any() else 0.0
        if column not in (owner, t) and spread > 0:
            smooth[column] = float(np.nanmedian(np.abs(np.diff(part)[same])) / spread)
    places = [column for column, ratio in smooth.items() if ratio < SMOOTH]
    x = named.get("x", places[0] if places else None)
    y = named.get("y", next((column for column in places if column != x), None))
    if x is None or y is None or x not in smooth or y not in smooth:
        return None
    untidy = np.mean(steps == 0) + (1 - abs(float(np.mean(ahead)))) + 0.5 * (1 - even) + (1 - np.mean(same))
    untidy += 0.2 * (1 - shared)
    return smooth[x] + smooth[y] + untidy + 0.01 * (owner + t), (owner, t, x, y)
