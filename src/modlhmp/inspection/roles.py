"""Which column of a table holds what: by its name where that is known, and by its values.

A time goes up in the same steps for everybody; people move little between two of their rows, compared with the place.
"""

import re
from typing import NamedTuple

import numpy as np

from modlhmp.clock import unix_time
from modlhmp.inspection.sheet import Sheet
from modlhmp.motion import moves
from modlhmp.tracks import Tracks

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
_BOXES = {"x": "bbleft left xmin bbx xtl boxleft x1", "y": "bbtop top ymin bby ytl boxtop y1"}  # upper left corners
_BOX = {name: role for role, names in _BOXES.items() for name in names.split()}
_BEST_FIRST = {"m": 0, "cm": 1, "mm": 1, "km": 1, "ft": 1, "feet": 1, "px": 3, "pixel": 3, "pixels": 3}  # no unit: 2
_HEIGHTS = {"z", "posz", "zpos", "positionz", "coordcentz", "zest"}
MOST_NAME = 200  # characters of a column's name that are looked at: a search for its unit may take their square
_UNIT = re.compile(
    r"[\s_/(\[]+(?:in\s+)?(mm|cm|km/h|kmh|m/s|ms|us|ns|degrees|deg|rad|pixels?|px|ft|feet|km|m|s)[)\]\s]*$",
    re.IGNORECASE,
)
SMOOTH = 0.2  # a step of a person by the size of the place
AS_SMOOTH = 2.0  # times the smallest step: so far may those of another column of ids be
UNTIDY = 1.0  # of recordings it is below 0.5; of tables that are none, such as a map, above 1.5
_IMAGE_PX = 100.0  # the least that positions in an image vary
FLATTER = 5.0  # times: so much less than the others vary heights
_BY_VALUES = "guessed from the values, as the file does not name them"
_BOX_CORNER = "upper left corners of boxes; the middle of the lower edge, where feet are, would be better"


class Columns(NamedTuple):
    """Positions of the columns, and of those that are named; units that names say; what a human may want to check.

    `track_id` None: all rows are one person's. `of_image`: positions are of boxes in an image.
    """

    track_id: int | None
    t: int
    x: int
    y: int
    named: dict[str, int]
    units: dict[str, str]
    remarks: list[str]
    of_image: bool = False


class Values(NamedTuple):
    """The columns of a table as numbers (NaN where they are none), ids as whole numbers per distinct text."""

    numbers: np.ndarray  # [rows, columns]
    codes: np.ndarray  # [rows, columns]
    iso: list[int]

    def take(self, rows: np.ndarray) -> "Values":
        """The values of some rows."""
        return self._replace(numbers=self.numbers[rows], codes=self.codes[rows])

    def ids(self, columns: Columns) -> np.ndarray:
        """Whose each row is, as a number."""
        if columns.track_id is None:
            return np.zeros(len(self.codes), np.int64)
        return self.codes[:, columns.track_id]


def values_of(sheet: Sheet) -> Values:
    """The fields of a table's first rows as numbers; ISO dates and times as unix seconds."""
    width = len(sheet.rows[0])
    numbers = np.full((len(sheet.rows), width), np.nan)
    codes, iso = np.empty((len(sheet.rows), width), np.int64), []
    for column in range(width):
        texts = [row[column] for row in sheet.rows]
        found = [sheet.number(text) for text in texts]
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
    name = name[:MOST_NAME]
    match = _UNIT.search(name)
    unit = match[1].lower() if match and match.start() > 0 else ""
    plain = name[: match.start()] if unit and match else name
    tidy = re.sub(r"[^a-z0-9]", "", plain.lower())
    return (tidy, unit) if tidy in _ROLE or not unit else (re.sub(r"[^a-z0-9]", "", name.lower()), "")


def is_time(name: str) -> bool:
    """Whether a column's name is one of times."""
    return _ROLE.get(name_and_unit(name)[0]) == "t"


def find_columns(sheet: Sheet, values: Values, owner: int | None = None) -> Columns | None:
    """The columns of a table, None where no choice of them gives people who move; `owner` is that of ids, if known."""
    named, units, remarks = _named(sheet, values)
    if owner is not None:
        named["track_id"] = owner
    if {"track_id", "t", "x", "y"} <= named.keys():
        places: tuple[int, int, int, int] = (named["track_id"], named["t"], named["x"], named["y"])
    else:
        owners = [named["track_id"]] if "track_id" in named else list(range(values.numbers.shape[1]))
        best = _by_values(values, named, owners)
        if best is None:
            return None
        places = best
        remarks = [*remarks, _BY_VALUES]
    of_image = _are_corners(sheet, values, *places)
    return Columns(*places, named, units, [*remarks, *([_BOX_CORNER] if of_image else [])], of_image)


def one_person(sheet: Sheet, values: Values) -> Columns | None:
    """The columns of a table whose rows are all of one person; None where it is none."""
    named, units, remarks = _named(sheet, values)
    if {"t", "x", "y"} <= named.keys():
        return Columns(None, named["t"], named["x"], named["y"], named, units, remarks)
    best = _by_values(values, named, [None])
    if best is None:
        return None
    owner, t, x, y = best
    return Columns(owner, t, x, y, named, units, [_BY_VALUES])


def table_rows(values: Values, columns: Columns) -> tuple[Tracks, np.ndarray]:
    """The rows with a time and a place as tracks in the file's own units, and where each stands in the table."""
    numbers, ids = values.numbers, values.ids(columns)
    known = np.flatnonzero(np.isfinite(numbers[:, [columns.t, columns.x, columns.y]]).all(axis=1))
    order = known[np.lexsort((numbers[known, columns.t], ids[known]))]
    t, x, y = (numbers[order, column] for column in (columns.t, columns.x, columns.y))
    unknown = np.full(len(t), np.nan)
    return Tracks(ids[order], t, x, y, unknown, unknown), order


def _counts(part, clock, ids):
    """Whether a column counts rows, or is another time: the same for all who are there at one time."""
    rows = np.diff(part)
    if len(rows) and (rows == 1).mean() > 0.95 and (np.diff(ids) == 0).mean() < 1:
        return True
    order = np.lexsort((part, clock))
    together = np.diff(clock[order]) == 0
    return together.sum() > 10 and (np.diff(part[order])[together] == 0).mean() > 0.99


def pace_of(rows: Tracks) -> float:
    """The median speed of those who move, in the file's units; over some rows, so that jitter does not count."""
    longest = len(rows.t) // max(len(rows.bounds()) - 1, 1) // 4
    speeds = moves(rows, int(np.clip(longest, 1, 10))).speed if len(rows.t) > 2 else np.empty(0)
    return float(np.median(speeds)) if len(speeds) else float("nan")


def _named(sheet, values):
    """Columns by their names, units that these say, and remarks: ({role: position}, {role: unit}, list of text)."""
    found: dict[tuple[str, bool], list[int]] = {}  # by role and whether it is a box's
    unit_of: dict[int, str] = {}
    for position, name in enumerate(sheet.names):
        plain, unit_of[position] = name_and_unit(name)
        for role_of in (_ROLE, _BOX):
            if plain in role_of:
                found.setdefault((role_of[plain], role_of is _BOX), []).append(position)
        if _ROLE.get(plain) == "t":
            unit_of[position] = (
                "frame" if plain.startswith("f") else "ms" if plain.endswith("ms") else unit_of[position]
            )
    for role, of_box in found.keys() & {("x", False), ("y", False)}:
        found[role, of_box].sort(key=lambda position: _BEST_FIRST.get(unit_of[position], 2))
    named = {role: positions[0] for (role, of_box), positions in found.items() if not of_box}
    for role in ("x", "y"):  # a column that holds one value is filled in, as in trackers' files of boxes
        varying = (p for of_box in (False, True) for p in found.get((role, of_box), []) if _spread(values, p) > 0)
        if (chosen := next(varying, None)) is not None:
            named[role] = chosen
    if "t" in named:
        usable = [p for p in found["t", False] if np.isfinite(values.numbers[:, p]).mean() > 0.5]
        distinct = {p: len(np.unique(values.codes[:, p])) for p in usable}
        named["t"] = max(usable, key=lambda p: (unit_of[p] != "frame", distinct[p]), default=named["t"])
    remarks = []
    height = next((p for p, name in enumerate(sheet.names) if name_and_unit(name)[0] in _HEIGHTS), None)
    if height is not None and {"x", "y"} <= named.keys():
        across, up, along = (_spread(values, p) for p in (named["x"], named["y"], height))
        if min(across, along) > FLATTER * up:
            named["y"] = height
            remarks = ["y hardly varies, as heights do, so z is taken for it"]
    if "track_id" in named:
        owner = _owner(values, named, found["track_id", False])
        named = {role: column for role, column in (named | {"track_id": owner}).items() if column is not None}
    return named, {role: unit_of[p] for role, p in named.items() if unit_of[p]}, remarks


def _owner(values, named, candidates):
    """Of columns with names of ids the one of people; None where every row has a number of its own.

    Of those whose ids move little from time to time, the one of most ids, so that nobody is two people: neither kinds
    of people, nor cameras, nor numbers that detections have at a time.
    """
    if not {"t", "x", "y"} <= named.keys():
        best = _by_values(values, named, candidates)
        return best[0] if best else candidates[0]
    places = values.numbers[:, [named["t"], named["x"], named["y"]]]
    known = np.isfinite(places).all(axis=1)
    ids, places = values.codes[known], places[known]
    several = [column for column in candidates if len(np.unique(ids[:, column])) < len(ids)]
    if len(ids) and not several:
        return None
    steps = {}
    for column in several:
        order = np.lexsort((places[:, 0], ids[:, column]))
        ahead = np.diff(places[order], axis=0)[np.diff(ids[order, column]) == 0]
        if (later := ahead[:, 0] > 0).any():
            steps[column] = np.median(np.hypot(*ahead[later, 1:].T))
    if not steps:
        return candidates[0]
    smooth = [column for column, step in steps.items() if step <= AS_SMOOTH * min(steps.values())]
    return max(smooth, key=lambda column: len(np.unique(ids[:, column])))


def _spread(values, column):
    """How far a column's middle nine tenths reach."""
    part = values.numbers[:, column]
    return float(np.nanquantile(part, 0.95) - np.nanquantile(part, 0.05)) if np.isfinite(part).any() else 0.0


def _are_corners(sheet, values, owner, t, x, y):
    """Whether x and y are corners of boxes in an image: by their names, or by the columns beside them."""
    if any(name_and_unit(sheet.names[column])[0] in _BOX for column in (x, y) if column < len(sheet.names)):
        return True
    numbers = values.numbers
    if sheet.names or y != x + 1 or y + 2 >= numbers.shape[1] or {owner, t} & {y + 1, y + 2}:
        return False
    if (numbers[:, t] % 1 > 0).any():  # seconds, not frames: heights and speeds may follow positions, as in ATC's files
        return False
    first, second = numbers[:, [x, y]], numbers[:, [y + 1, y + 2]]
    known = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    if known.mean() < 0.8 or _spread(values, x) < _IMAGE_PX:
        return False
    sizes = (second, second - first)  # width and height, or the lower right corner
    return any(
        (size[known] > 0).mean() > 0.99 and (np.std(size[known], axis=0) < 0.5 * np.mean(size[known], axis=0)).all()
        for size in sizes
    )


def _by_values(values, named, owners):
    """The (id, time, x, y) that make the smoothest tracks, ids in one of the columns `owners`."""
    times = [named["t"]] if "t" in named else range(values.numbers.shape[1])
    owners = [owner for owner in owners if owner is None or _are_ids(values, owner)]
    found = [_score(values, owner, t, named) for t in times for owner in owners if t != owner]
    score, chosen = min((one for one in found if one is not None), default=(np.inf, None))
    return chosen if score < UNTIDY else None


def _are_ids(values, column):
    """Whether a column may be of ids: no fractions, of more people than one, with more rows than one."""
    whose, kinds = values.numbers[:, column], len(np.unique(values.codes[:, column]))
    whole = whose[np.isfinite(whose)]
    return np.array_equal(whole, np.rint(whole)) and 1 < kinds <= 0.5 * len(whose)


def _score(values, owner, t, named):
    """(how far from people's tracks, the columns) of one choice of id and time; `owner` None: all are one person's."""
    clock = values.numbers[:, t]
    ids = np.zeros(len(clock), np.int64) if owner is None else values.codes[:, owner]
    usable = np.isfinite(clock)
    if usable.mean() < 0.8 or len(clock) < 2:
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
    untidy = np.mean(steps == 0) + (1 - abs(float(np.mean(ahead)))) + 0.5 * (1 - even) + (1 - np.mean(same))
    untidy += 0.2 * (1 - shared)
    if untidy >= UNTIDY:  # whatever the positions are; a wide table has many columns to look at
        return None
    smooth = {}
    for column in range(values.numbers.shape[1]):
        part, spread = values.numbers[order, column], _spread(values, column)
        taken = (owner, t, named.get("speed"), named.get("heading"))
        if column not in taken and spread > 0 and not _counts(values.numbers[:, column], clock, ids):
            smooth[column] = float(np.nanmedian(np.abs(np.diff(part)[same])) / spread)
    places = [column for column, ratio in smooth.items() if ratio < SMOOTH]
    x = named.get("x", places[0] if places else None)
    y = named.get("y", next((column for column in places if column != x), None))
    if x is None or y is None or x not in smooth or y not in smooth:
        return None
    return smooth[x] + smooth[y] + untidy + 0.01 * ((owner or 0) + t), (owner, t, x, y)
