"""How a recording is written, guessed from its first lines: a dataset file's keys, and what a human must decide."""

import itertools
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.file_format import LENGTH_M, FileFormat
from modlhmp.ids import NOBODYS
from modlhmp.inspection.chosen import choose, joint_ids
from modlhmp.inspection.roles import Columns, Values, find_columns, one_person, pace_of, table_rows, values_of
from modlhmp.inspection.sheet import Sheet, first_lines, read_sheet
from modlhmp.inspection.unfit import (
    PIXEL_M,
    refuse_by_names,
    refuse_fractions,
    refuse_parts_of_one,
    refuse_unfit,
    refuse_without_columns,
)
from modlhmp.inspection.velocities import velocity_columns
from modlhmp.readers import read_recording
from modlhmp.readers.delimited import MAX_DISTANCE_M, SECONDS, OtherFrameError
from modlhmp.readers.raw import People, open_raw
from modlhmp.settings import check
from modlhmp.site import MOST_STEP_S
from modlhmp.speed_units import EXTENT_M, FOOT_M, USUAL_MPS, extent_of, rate_for
from modlhmp.storage import DataError, boundary
from modlhmp.tracks import Tracks, usual_step

_RATE = re.compile(r"(?:frame ?-?rate|fps)\D{0,3}(\d+(?:\.\d+)?)", re.I)
_IN_CM = re.compile(r"\bin (cm|mm|m)\b|[xy]\s?[/\[(]\s?(cm|mm|m)\b", re.I)
_UNIX = {"s": (3e8, 7e9), "ms": (3e11, 7e12), "us": (3e14, 7e15), "ns": (3e17, 7e18)}  # years 1980 to 2190
_NEAR = "this gives a walking speed, but so do others near it"
_MOVED = "whole metres of the file's frame; floor plans are moved by it as well"
_OTHERS_M = {"ft": FOOT_M, "km": 1000.0}  # units of length that there is no option for
_METRES = {**LENGTH_M, **_OTHERS_M}
SCALES = (0.002, 0.3)  # metres that a pixel may have
PLAUSIBLE_MPS = (0.5, 2.5)  # of a unit that is taken without asking
SLOWER = 10.0  # times slower, or faster, is nobody
CAMERAS = (25.0, 30.0, 15.0, 10.0, 9.0, 5.0, 2.5, 1.0)  # frames per second, the commonest first
MOST_BACK, RARELY = 10.0, 0.1  # usual steps that times may go back; share of rows in which they do, or of people
MOST_PX = 4100  # of an image's longer side


@dataclass
class Guess:
    """Keys of a dataset file, and a remark for those that a human must decide or may want to know about."""

    keys: dict[str, Any]
    asks: dict[str, str] = field(default_factory=dict)
    clock: bool = False  # times are of a clock, so that days are known
    notes: list[str] = field(default_factory=list)  # of what is left out, or left to a human

    @property
    def form(self) -> FileFormat:
        """The keys as settings."""
        return check(FileFormat, self.keys, "the guessed format")


def guess(path: str | Path) -> Guess:
    """How a file is written; `DataError` where no form gives people who move."""
    with boundary(path, "cannot be looked at"):
        return _guess(path)


def _guess(path: str | Path) -> Guess:
    with open_raw(path) as file:
        head = file.read(1 << 16)
    known = _known_form(head)
    if known is None:
        return _of_table(path)
    if known.keys["reader"] != "edinburgh":
        _ask_its_reader(path, known)
    return known


def _ask_its_reader(path: str | Path, found: Guess) -> None:
    """The origin that the reader of a known form asks for, and the frame rate where the file does not say it."""
    form = FileFormat(reader=found.keys["reader"], frame_rate=1.0 if found.keys.get("frame_rate") == 0 else None)
    try:
        rows, _ = read_recording(path, form)
    except OtherFrameError as error:
        found.keys["origin_m"] = list(error.origin_m)
        found.asks["origin_m"] = _MOVED
        rows, _ = read_recording(path, replace(form, origin_m=error.origin_m))
    if found.keys.get("frame_rate") == 0:
        found.keys["frame_rate"] = rate_for(pace_of(rows)) or 25.0


def guess_people(files: Sequence[str | Path]) -> Guess | None:
    """How files are written that are of one person each, with or without an id; None where they hold several people."""
    with open_raw(files[0]) as file:
        if _known_form(file.read(1 << 16)):
            return None
    largest = sorted(files, key=lambda file: Path(file).stat().st_size)[-3:]
    sheets = [read_sheet(file, first_lines(file)) for file in largest]
    first, of_one = sheets[-1], [_columns_of_one(sheet) for sheet in sheets]
    last = of_one[-1]
    if last is None or None in of_one:
        return None
    if any(_are_of_several(file, last, sheets) for file in files if file not in largest):
        return None
    comment = next((one.comment for one in sheets if one.comment), "#")
    found = _of_table(People(tuple(map(str, files)), first.separator or " ", first.header, first.skip_lines, comment))
    if isinstance(found.keys["columns"]["track_id"], list):  # another column tells several people of a file apart
        return None
    columns = {role: column for role, column in found.keys["columns"].items() if role != "track_id"}
    found.keys["columns"] = {role: _own(column) for role, column in columns.items()}
    for key in {"only", "without"} & found.keys.keys():
        found.keys[key] = {str(_own(column)): texts for column, texts in found.keys[key].items()}
    found.keys |= {"file_is": "person"} | ({"skip_lines": first.skip_lines} if first.skip_lines else {})
    return found


def _columns_of_one(sheet: Sheet) -> Columns | None:
    """The columns of a table, if all its rows are of one person."""
    values = values_of(sheet)
    columns = find_columns(sheet, values) or one_person(sheet, values)
    return columns if columns is not None and len(np.unique(values.ids(columns))) == 1 else None


def _are_of_several(file: str | Path, columns: Columns, sheets: Sequence[Sheet]) -> bool:
    """Whether a file holds several people, as others, of which `sheets` are the first lines, do not.

    It has several ids in the column that is named so; or texts that take turns in time, as dates, laps and zones do
    not, in one that has one text in each sheet, in each another. No table holds none, as its reader will tell.
    """
    try:
        sheet = read_sheet(file, first_lines(file))
    except DataError:
        return False
    values, width = values_of(sheet), min(len(one.rows[0]) for one in [sheet, *sheets])
    if "track_id" in columns.named:
        owner = columns.named["track_id"]
        return owner < width and len(np.unique(values.codes[:, owner])) > 1
    if columns.t >= width:
        return False
    kinds = ([{row[column] for row in one.rows} for one in sheets] for column in range(width))
    ids = [c for c, kind in enumerate(kinds) if set(map(len, kind)) == {1} and len(set.union(*kind)) == len(sheets)]
    in_time = [values.codes[np.lexsort((values.codes[:, c], values.numbers[:, columns.t])), c] for c in ids]
    return any(np.sum(np.diff(whose) != 0) > RARELY * len(whose) for whose in in_time)


def _own(column: int | str) -> int | str:
    """A column as its own file has it, without the name of the file before it."""
    return int(column) - 1 if isinstance(column, int) or column.isdecimal() else column


def _of_table(path: str | Path | People) -> Guess:
    """How a table in text is written, column by column."""
    sheet = read_sheet(path, first_lines(path))
    values = values_of(sheet)
    refuse_by_names(path, sheet, values)
    columns = find_columns(sheet, values, 0 if isinstance(path, People) else None)
    if columns is None:
        refuse_without_columns(path, sheet, values)
    refuse_fractions(path, sheet, values, columns)
    chosen = choose(sheet, values, columns)
    sheet = sheet._replace(rows=[row for row, kept in zip(sheet.rows, chosen.rows, strict=True) if kept])
    values = values.take(chosen.rows)
    followed = values  # without rows of nobody, who may stand many times at one time
    if columns.track_id is not None:
        followed = values.take(values.numbers[:, columns.track_id] != NOBODYS)
    other = joint_ids(followed, columns)
    found = Guess(_layout(sheet) | chosen.keys, sheet.asks | chosen.asks, notes=[*sheet.notes, *chosen.notes])
    found.keys["columns"] = {role: sheet.called(getattr(columns, role)) for role in ("track_id", "t", "x", "y")}
    if other is not None and columns.track_id is not None:
        refuse_parts_of_one(path, sheet, columns.track_id, other, table_rows(followed, columns)[0])
        found.keys["columns"]["track_id"] = [sheet.called(columns.track_id), sheet.called(other)]
        columns.remarks.append("an id alone stands several times at one time")
        codes = values.codes.copy()
        codes[:, columns.track_id] = codes[:, columns.track_id] * len(codes) + codes[:, other]
        values = values._replace(codes=codes)
    rows, order = table_rows(values, columns)
    refuse_unfit(path, sheet, values, columns, rows)
    _times_and_lengths(found, sheet, values, columns, rows)
    _origin(found, rows)
    moving = velocity_columns(found.form, sheet, values, columns, order, rows)
    found.keys["columns"] |= moving.columns
    found.keys |= {"units": {**found.keys.get("units", {}), **moving.units}} if moving.units else {}
    found.notes += [moving.left_out] if moving.left_out else []
    _odd_times(values, columns, found)
    if columns.remarks:
        found.asks["columns"] = "; ".join(columns.remarks)
    return found


def _known_form(head: bytes) -> Guess | None:
    """The formats that are known by their first bytes."""
    text = head.decode("utf-8", "replace").lstrip("\ufeff \r\n").replace("\r", "\n")
    if head.startswith(b"SQLite format 3"):
        return Guess({"reader": "jupedsim"})
    if head.startswith(b"\x89HDF"):
        return Guess({"reader": "hdf5"})
    if re.search(r"^[ \t]*(Properties|TRACK)\.R\d+[ \t]*=", text, re.M):
        asks = {"frame_rate": "of the Edinburgh Forum, about 9", "scale": "of the Edinburgh Forum"}
        return Guess({"reader": "edinburgh", "frame_rate": 9.0, "scale": 0.0247}, asks)
    if text.startswith("FILE_ID,"):
        return Guess({"reader": "magni"})
    if text.startswith("{"):
        try:
            objects = [json.loads(line) for line in text.splitlines()[:-1] or [text] if line.strip()]
        except (ValueError, RecursionError):
            return None
        if not all(isinstance(one, dict) for one in objects) or not any("track" in one for one in objects):
            return None
        scenes = [one["scene"] for one in objects if isinstance(one.get("scene"), dict)]
        if len({scene["fps"] for scene in scenes if isinstance(scene.get("fps"), int | float)}) == 1:
            return Guess({"reader": "trajnet"})
        return Guess({"reader": "trajnet", "frame_rate": 0.0}, {"frame_rate": "no scene says it: " + _NEAR})
    return None


def _layout(sheet: Sheet) -> dict[str, Any]:
    """The keys of how the lines are written."""
    keys: dict[str, Any] = {"reader": "delimited" if sheet.separator else "text"}
    if sheet.separator not in (None, ","):
        keys["separator"] = sheet.separator
    if sheet.decimal != ".":
        keys["decimal"] = sheet.decimal
    if sheet.thousands:
        keys["thousands"] = sheet.thousands
    if sheet.comment and ("comment" in sheet.asks or not (sheet.comment == "#" and sheet.separator is None)):
        keys["comment"] = sheet.comment
    elif sheet.separator is None and any(row[0].startswith("#") for row in sheet.rows):
        keys["comment"] = ""
    if sheet.skip_lines:
        keys["skip_lines"] = sheet.skip_lines
    if sheet.header:
        keys["header"] = True
    return keys


def _times_and_lengths(found: Guess, sheet: Sheet, values: Values, columns: Columns, rows: Tracks) -> None:
    """Units of times and places; `rows` are the table's in the file's own."""
    clock, step = values.numbers[:, columns.t], usual_step(rows)
    told = " ".join(sheet.comments) + " " + " ".join(sheet.names)
    length = columns.units.get("x") or next((a or b for a, b in _IN_CM.findall(told)), None)
    length = length.lower() if length else None
    length = "ft" if length == "feet" else length
    rate = float(match[1]) if (match := _RATE.search(told)) else None
    pace, extent = pace_of(rows), extent_of(rows)  # units of length per unit of time; units of length
    walking = _walking(pace, extent, length)
    units, possible = ({unit for unit, _, _ in some} for some in (walking, _walking(pace, extent, length, SLOWER)))
    told_unit = columns.units.get("t")
    time = "iso" if columns.t in values.iso else _unit_of_time(clock, step, told_unit, rate, units, possible)
    if time == "iso" or (time in _UNIX and _UNIX[time][0] < np.nanmedian(clock) < _UNIX[time][1]):
        found.clock = True
    seconds = SECONDS.get(time or "", 1.0 if time == "iso" else None)
    if time is None or time == "frame":
        if length is None and (columns.of_image or _are_pixels(rows)):
            length, time = "px", "frame"
        _frames_or_seconds(found, pace, extent, length, rate, [] if time == "frame" else walking)
        return
    assert seconds is not None
    if time != "s":
        found.keys.setdefault("units", {})["time"] = time
    _length(found, pace / seconds, extent, length)


def _walking(pace: float, extent: float, length: str | None, wider: float = 1.0) -> list[tuple[str, str, float]]:
    """Units of time and length by which people walk as people do, or so many times slower or faster; speeds in m/s."""
    return [
        (unit, of_length, speed)
        for unit, of_length in itertools.product(SECONDS, [length] if length else LENGTH_M)
        if (metres := _METRES.get(of_length)) is not None
        and EXTENT_M[0] <= extent * metres <= EXTENT_M[1]
        and PLAUSIBLE_MPS[0] / wider <= (speed := pace * metres / SECONDS[unit]) <= PLAUSIBLE_MPS[1] * wider
    ]


def _unit_of_time(
    clock: np.ndarray, step: float, named: str | None, rate: float | None, walking: set[str], possible: set[str]
) -> str | None:
    """The unit of a column of times; None for whole numbers that may be of a second, or less, or frames.

    The column's name comes first, then units since 1970, but none by which the usual `step` between a person's rows is
    too long, nor one since 1970 that is not `possible`, while people walk by another one (`walking`): numbers since a
    computer was started may look like times since 1970.
    """
    middle, known = float(np.nanmedian(clock)), clock[np.isfinite(clock)]
    whole = np.array_equal(known, np.rint(known))
    since_1970 = [unit for unit, (first, last) in _UNIX.items() if first < middle < last]
    told = [named] if named in SECONDS else []
    sensible = [*told, *(unit for unit in since_1970 if unit in possible or not walking)]
    if fitting := [unit for unit in sensible if step * SECONDS[unit] <= MOST_STEP_S]:
        return next((unit for unit in fitting if unit in walking), fitting[0])
    if named in (*SECONDS, "frame"):
        return named
    if not whole:
        return "s"
    return "frame" if rate else None


def _are_pixels(rows: Tracks) -> bool:
    """Whether positions may be of an image: whole numbers, of a range that images have."""
    places = np.column_stack([rows.x, rows.y])
    spread = np.ptp(places, axis=0).max() if len(places) else 0
    return bool(100 < spread < MOST_PX and places.min() > -0.3 * spread and (places % 1 == 0).all())


def _frames_or_seconds(found, pace, extent, length, rate, walking):
    """Whole numbers as times: seconds, or less, if people walk by them (`walking`), else frames of some rate."""
    if walking:
        unit, of_length, speed = walking[0]
        if unit != "s":
            found.keys["units"] = {"time": unit}
        found.asks["units"] = f"times are whole numbers without a unit: {unit} and {of_length} give {speed:.2g} m/s"
        return _length(found, pace / SECONDS[unit], extent, of_length)
    found.keys["units"] = {"time": "frame"}
    if rate is not None:
        found.keys["frame_rate"] = rate
        return _length(found, pace * rate, extent, length)
    if length == "px":
        fits = (one for one in CAMERAS if PIXEL_M[0] <= USUAL_MPS / (pace * one) <= PIXEL_M[1])
        found.keys["frame_rate"] = next(fits, CAMERAS[0]) if pace > 0 else CAMERAS[0]
        found.asks["frame_rate"] = "the file does not say it: with the scale it gives a walking speed, as others do"
        return _length(found, pace * found.keys["frame_rate"], extent, length)
    for unit in [length] if length else LENGTH_M:
        fitting = rate_for(pace * _METRES.get(unit, 1.0))
        if fitting is not None and EXTENT_M[0] <= extent * _METRES.get(unit, 1.0) <= EXTENT_M[1]:
            found.keys["frame_rate"] = fitting
            found.asks["frame_rate"] = "the file does not say it: " + _NEAR
            if length is None and unit != "m":
                found.asks["units"] = (
                    f"positions have no unit: {unit} with this rate give a walking speed, but are they px?"
                )
            return _length(found, pace * fitting, extent, unit)
    found.keys["frame_rate"] = 25.0
    found.asks["frame_rate"] = "the file does not say it, and no rate gives a walking speed in m, cm or mm"
    return _length(found, pace * 25.0, extent, length)


def _length(found: Guess, pace: float, extent: float, length: str | None) -> None:
    """The unit of positions; `pace` is the walking speed [1/s] and `extent` the size of the place in it."""
    units = found.keys.setdefault("units", {})
    fitting = [
        unit
        for unit, metres in LENGTH_M.items()
        if PLAUSIBLE_MPS[0] <= pace * metres <= PLAUSIBLE_MPS[1] and extent * metres <= EXTENT_M[1]
    ]
    if length is None and len(fitting) == 1:
        length = fitting[0]
        if length != "m":
            found.asks.setdefault("units", f"positions have no unit: {length} give {pace * LENGTH_M[length]:.2g} m/s")
    scale = float(f"{USUAL_MPS / pace:.2g}") if pace > 0 else 1.0
    if length in _OTHERS_M:
        found.keys["scale"] = _OTHERS_M[length]
        found.asks["scale"] = f"metres of {length}, for which there is no unit"
        length = "px"
    elif length is None and not SCALES[0] <= scale <= SCALES[1]:
        length, found.asks["units"] = "m", "positions have no unit, and no unit gives a walking speed"
        units["length"] = length
    elif length is None or length.startswith(("px", "pixel")):
        length, found.keys["scale"] = "px", scale
        found.asks["scale"] = f"metres per pixel are not in the file: this gives {USUAL_MPS:g} m/s, as is usual"
    if length != "m":
        units["length"] = length
    if not units:
        del found.keys["units"]


def _odd_times(values: Values, columns: Columns, found: Guess) -> None:
    """Remarks where times go back within an id here and there, or where everybody begins at the same one."""
    ids, t = values.ids(columns), values.numbers[:, columns.t]
    by_id = np.argsort(ids, kind="stable")  # rows of an id in the file's order
    steps = np.diff(t[by_id])[np.diff(ids[by_id]) == 0]
    back = steps < -MOST_BACK * np.median(np.abs(steps)) if len(steps) else steps
    if 0 < np.sum(back) < RARELY * len(steps):
        columns.remarks.append(
            f"times go back within {np.sum(back)} ids: two recordings in one file, or a clock that begins anew?"
        )
    begins = [t[by_id][part].min() for part in np.split(np.arange(len(t)), np.flatnonzero(np.diff(ids[by_id])) + 1)]
    if len(begins) >= 10 and np.mean(np.array(begins) == np.min(begins)) > 1 - RARELY:
        found.notes.append("decide: all begin at the same time: is it counted from each one's own begin?")


def _origin(found: Guess, rows: Tracks) -> None:
    """A local origin where positions are of a national grid: far away from zero, and together."""
    east, north = (float(np.median(part)) * found.form.metres for part in (rows.x, rows.y))
    if np.hypot(east, north) > MAX_DISTANCE_M > 2 * extent_of(rows) * found.form.metres:
        found.keys["origin_m"] = [int(round(east, -2)), int(round(north, -2))]
        found.asks["origin_m"] = _MOVED


def days_of(rows: Tracks, zone: Any = timezone.utc) -> tuple[str, int]:
    """The first local day of recorded unix times, and how many days they are of."""
    first, last = (datetime.fromtimestamp(float(t), zone).date() for t in (rows.t.min(), rows.t.max()))
    return first.isoformat(), (last - first).days + 1
