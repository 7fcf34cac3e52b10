"""How a recording is written, guessed from its first lines: a dataset file's keys, and what a human must decide."""

import itertools
import json
import re
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.file_format import LENGTH_M, FileFormat, Units
from modlhmp.inspection.roles import Columns, Values, find_columns, values_of
from modlhmp.inspection.sheet import Sheet, first_lines, read_sheet
from modlhmp.motion import Moves, moves, recorded_agreement
from modlhmp.readers import read_recording
from modlhmp.readers.delimited import SECONDS, SPEED_MPS
from modlhmp.readers.raw import open_raw
from modlhmp.settings import check
from modlhmp.speed_units import EXTENT_M, USUAL_MPS, extent_of, rate_for
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, usual_step

_RATE = re.compile(r"(?:frame ?-?rate|fps)\D{0,3}(\d+(?:\.\d+)?)", re.I)
_IN_CM = re.compile(r"\bin (cm|mm|m)\b|[xy]\s?[/\[(]\s?(cm|mm|m)\b", re.I)
_UNIX = {"s": (3e8, 7e9), "ms": (3e11, 7e12), "us": (3e14, 7e15), "ns": (3e17, 7e18)}  # years 1980 to 2190
_NEAR = "this gives a walking speed, but so do others near it"
PLAUSIBLE_MPS = (0.5, 2.5)  # of a unit that is taken without asking
UNFIT = (0.25, 0.8)  # times between rows [s] of which the last one in every second is now early, now late
CAMERAS = (25.0, 30.0, 15.0, 10.0, 9.0, 5.0, 2.5, 1.0)  # frames per second, the commonest first
PIXEL_M = (0.01, 0.06)  # of cameras that see a place
AGREES, FOLLOWS = 0.85, 0.4  # mean cosine of headings and displacements, correlation of speeds with theirs


@dataclass
class Guess:
    """Keys of a dataset file, and a remark for those that a human must decide or may want to know about."""

    keys: dict[str, Any]
    asks: dict[str, str] = field(default_factory=dict)
    clock: bool = False  # times are of a clock, so that days are known
    left_out: str = ""  # why columns of speed and heading are

    @property
    def form(self) -> FileFormat:
        """The keys as settings."""
        return check(FileFormat, self.keys, "the guessed format")


def guess(path: str | Path) -> Guess:
    """How a file is written; `DataError` where no form gives people who move."""
    with open_raw(path) as file:
        head = file.read(1 << 16)
    if known := _known_form(head):
        if known.keys.get("frame_rate") == 0:
            per_frame = _pace_of(read_recording(path, replace(FileFormat(reader="trajnet"), frame_rate=1.0))[0])
            known.keys["frame_rate"] = rate_for(per_frame) or 25.0
        return known
    lines = first_lines(path)
    sheet = read_sheet(path, lines)
    values = values_of(sheet)
    columns = find_columns(sheet, values)
    if columns is None:
        shown = "; ".join(" ".join(row) for row in sheet.rows[:2])[:120]
        raise DataError(
            f"{path}: no choice of id, time, x and y among its {len(sheet.rows[0])} columns gives people who move "
            f"(rows such as {shown!r}): are ids in a column of their own? Say `columns` in a dataset file"
        )
    found = Guess(_layout(sheet))
    _times_and_lengths(Path(path), found, sheet, values, columns)
    _velocities(found, sheet, values, columns)
    if columns.by_values:
        found.asks["columns"] = "guessed from the values, as the file does not name them"
    return found


def _known_form(head: bytes) -> Guess | None:
    """The formats that are known by their first bytes."""
    text = head.decode("utf-8", "replace").lstrip("\ufeff \r\n")
    if head.startswith(b"SQLite format 3"):
        return Guess({"reader": "jupedsim"})
    if head.startswith(b"\x89HDF"):
        return Guess({"reader": "hdf5"})
    if re.search(r"^\s*(Properties|TRACK)\.R\d+\s*=", text, re.M):
        asks = {"frame_rate": "of the Edinburgh Forum, about 9", "scale": "of the Edinburgh Forum"}
        return Guess({"reader": "edinburgh", "frame_rate": 9.0, "scale": 0.0247}, asks)
    if text.startswith("FILE_ID,"):
        return Guess({"reader": "magni"})
    if text.startswith("{"):
        try:
            objects = [json.loads(line) for line in text.splitlines()[:-1] or [text] if line.strip()]
        except ValueError:
            return None
        if not any("track" in one for one in objects):
            return None
        rates = {one["scene"].get("fps") for one in objects if isinstance(one.get("scene"), dict)}
        if len(rates - {None}) == 1:
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
    if sheet.comment and not (sheet.comment == "#" and sheet.separator is None):
        keys["comment"] = sheet.comment
    if sheet.skip_lines:
        keys["skip_lines"] = sheet.skip_lines
    if sheet.header:
        keys["header"] = True
    return keys


def _column(sheet: Sheet, position: int) -> int | str:
    """How a column is named in `columns`."""
    name = sheet.names[position] if sheet.header else ""
    return name if name and sheet.names.count(name) == 1 else position


def _times_and_lengths(path: Path, found: Guess, sheet: Sheet, values: Values, columns: Columns) -> None:
    """Columns of places and times, and their units."""
    places = ("track_id", "t", "x", "y")
    found.keys["columns"] = {role: _column(sheet, getattr(columns, role)) for role in places}
    clock = values.numbers[:, columns.t]
    if columns.t not in values.iso and not np.isfinite(clock).any():
        raise DataError(
            f"{path}: times such as {sheet.rows[0][columns.t]!r} are neither numbers nor ISO 8601 "
            "(2026-03-02T09:00:00.5, with or without +01:00): rewrite that column"
        )
    told = " ".join(sheet.comments) + " " + " ".join(sheet.names)
    length = columns.units.get("x") or next((a or b for a, b in _IN_CM.findall(told)), None)
    length = length.lower() if length else None
    rate = float(match[1]) if (match := _RATE.search(told)) else None
    time = "iso" if columns.t in values.iso else _unit_of_time(clock, columns.units.get("t"), rate)
    if time == "iso" or (time in _UNIX and _UNIX[time][0] < np.nanmedian(clock) < _UNIX[time][1]):
        found.clock = True
    pace = _pace(values, columns)  # units of length per unit of time
    seconds = SECONDS.get(time or "", 1.0 if time == "iso" else None)
    if time is None or time == "frame":
        if length is None and _are_pixels(values, columns):
            length = "px"
        _frames_or_seconds(found, pace, extent_of(_rows(values, columns)), length, time, rate)
        return
    assert seconds is not None
    if time != "s":
        found.keys.setdefault("units", {})["time"] = time
    _length(found, pace / seconds, length)


def _unit_of_time(clock: np.ndarray, named: str | None, rate: float | None) -> str | None:
    """The unit of a column of times; None for whole numbers that may be seconds, milliseconds or frames."""
    middle = float(np.nanmedian(clock))
    for unit, (first, last) in _UNIX.items():
        if first < middle < last:
            return unit
    if named in ("s", "ms", "us", "ns", "frame"):
        return named
    known = clock[np.isfinite(clock)]
    if not np.array_equal(known, np.rint(known)):
        return "s"
    return "frame" if rate else None


def _rows(values: Values, columns: Columns) -> Tracks:
    """The table as tracks in the file's own units."""
    numbers = values.numbers
    known = np.isfinite(numbers[:, [columns.t, columns.x, columns.y]]).all(axis=1)
    ids, t = values.codes[known, columns.track_id], numbers[known, columns.t]
    order = np.lexsort((t, ids))
    unknown = np.full(len(t), np.nan)
    x, y = (numbers[known, column][order] for column in (columns.x, columns.y))
    return Tracks(ids[order], t[order], x, y, unknown, unknown)


def _are_pixels(values: Values, columns: Columns) -> bool:
    """Whether positions may be of an image: whole numbers, of a range that images have."""
    places = values.numbers[:, [columns.x, columns.y]]
    places = places[np.isfinite(places).all(axis=1)]
    spread = np.ptp(places, axis=0).max() if len(places) else 0
    return bool(100 < spread < 8000 and places.min() >= 0 and np.array_equal(places, np.rint(places)))


def _pace(values: Values, columns: Columns) -> float:
    """The median speed of those who move, in the file's units; over some rows, so that jitter does not count."""
    return _pace_of(_rows(values, columns))


def _pace_of(rows: Tracks) -> float:
    longest = len(rows.t) // max(len(rows.bounds()) - 1, 1) // 4
    speeds = moves(rows, int(np.clip(longest, 1, 10))).speed if len(rows.t) > 2 else np.empty(0)
    return float(np.median(speeds)) if len(speeds) else float("nan")


def _frames_or_seconds(found, pace, extent, length, time, rate):
    """Whole numbers as times: seconds or milliseconds if people walk as people do, else frames of some rate."""
    for unit, of_length in itertools.product(("s", "ms"), [length] if length else LENGTH_M):
        metres = LENGTH_M.get(of_length)
        if metres is None or time == "frame" or not EXTENT_M[0] <= extent * metres <= EXTENT_M[1]:
            continue
        if PLAUSIBLE_MPS[0] <= pace * metres / SECONDS[unit] <= PLAUSIBLE_MPS[1]:
            if unit != "s":
                found.keys["units"] = {"time": unit}
            found.asks["units"] = f"times are whole numbers without a unit: {unit} give a walking speed"
            return _length(found, pace / SECONDS[unit], of_length)
    found.keys["units"] = {"time": "frame"}
    if rate is not None:
        found.keys["frame_rate"] = rate
        return _length(found, pace * rate, length)
    if length == "px":
        fits = (one for one in CAMERAS if PIXEL_M[0] <= USUAL_MPS / (pace * one) <= PIXEL_M[1])
        found.keys["frame_rate"] = next(fits, CAMERAS[0]) if pace > 0 else CAMERAS[0]
        found.asks["frame_rate"] = "the file does not say it: with the scale it gives a walking speed, as others do"
        return _length(found, pace * found.keys["frame_rate"], length)
    for unit in [length] if length else ["m", "cm", "mm"]:
        fitting = rate_for(pace * LENGTH_M.get(unit, 1.0))
        if fitting is not None:
            found.keys["frame_rate"] = fitting
            found.asks["frame_rate"] = "the file does not say it: " + _NEAR
            return _length(found, pace * fitting, unit)
    found.keys["frame_rate"] = 25.0
    found.asks["frame_rate"] = "the file does not say it, and no rate gives a walking speed in m, cm or mm"
    return _length(found, pace * 25.0, length)


def _length(found: Guess, pace: float, length: str | None) -> None:
    """The unit of positions; `pace` is the walking speed in it [1/s]."""
    units = found.keys.setdefault("units", {})
    fitting = [unit for unit, metres in LENGTH_M.items() if PLAUSIBLE_MPS[0] <= pace * metres <= PLAUSIBLE_MPS[1]]
    if length is None and len(fitting) == 1:
        length = fitting[0]
        if length != "m":
            found.asks.setdefault("units", f"positions have no unit: {length} give {pace * LENGTH_M[length]:.2g} m/s")
    if length is None or length.startswith(("px", "pixel")):
        scale = float(f"{USUAL_MPS / pace:.2g}") if pace > 0 else 1.0
        length, found.keys["scale"] = "px", scale
        found.asks["scale"] = f"metres per pixel are not in the file: this gives {USUAL_MPS:g} m/s, as is usual"
    if length != "m":
        units["length"] = length
    if not units:
        del found.keys["units"]


def _velocities(found: Guess, sheet: Sheet, values: Values, columns: Columns) -> None:
    """Columns of speed and heading with their units, where they follow displacements."""
    form = found.form
    rows = _rows(values, columns)
    seconds = 1.0 / form.frame_rate if form.units.time == "frame" else SECONDS.get(form.units.time, 1.0)  # type: ignore[operator]
    rows = rows._replace(t=rows.t * seconds, x=rows.x * form.metres, y=rows.y * form.metres)
    step = usual_step(rows)
    around = moves(rows, max(2, 2 * round(0.5 / step)) if step > 0 else 2)
    numbers = values.numbers
    known = np.isfinite(numbers[:, [columns.t, columns.x, columns.y]]).all(axis=1)
    order = np.lexsort((numbers[known, columns.t], values.codes[known, columns.track_id]))
    others = [c for c in range(numbers.shape[1]) if c not in (columns.track_id, columns.t, columns.x, columns.y)]
    of_column = {column: numbers[known, column][order] for column in others if column not in values.iso}
    if len(around.row) < 10:
        return
    speed = _speed_column(of_column, around, columns.named.get("speed"))
    heading = _heading_column({c: part for c, part in of_column.items() if speed and c != speed[0]}, rows, around,
                              columns.named.get("heading"))  # fmt: skip
    if speed is None or heading is None:
        return
    if UNFIT[0] < step < UNFIT[1]:
        found.left_out = (
            f"columns {_column(sheet, speed[0])!r} and {_column(sheet, heading[0])!r} are speed and heading; they are "
            f"left out, since rows {step:.2g} s apart do not fit into steps of 1 s, where positions can be interpolated"
        )
        return
    found.keys["columns"] |= {"speed": _column(sheet, speed[0]), "heading": _column(sheet, heading[0])}
    units = found.keys.setdefault("units", {})
    if SPEED_MPS[speed[1]] != form.metres:
        units["speed"] = speed[1]
    units |= heading[1]
    if not units:
        del found.keys["units"]


def _speed_column(of_column: dict[int, np.ndarray], around: Moves, named: int | None) -> tuple[int, str] | None:
    """The column of speeds and its unit: the one nearest to displacements that rises and falls with them."""
    found: list[tuple[float, int, str]] = []
    for column, part in of_column.items():
        here = part[around.row]
        known = np.isfinite(here)
        if (named is not None and column != named) or known.mean() < 0.8 or (here[known] < 0).any():
            continue
        if column != named and (
            np.std(here[known]) == 0 or np.corrcoef(here[known], around.speed[known])[0, 1] < FOLLOWS
        ):
            continue
        for unit, factor in SPEED_MPS.items():
            ratios = here[known] * factor / around.speed[known]
            off = float(np.median(np.abs(ratios - 1)))
            if 0.75 < np.median(ratios) < 1.33 and off < 0.25:
                found.append((off, column, unit))
    return min(found)[1:] if found else None


def _heading_column(
    of_column: dict[int, np.ndarray], rows: Tracks, around: Moves, named: int | None
) -> tuple[int, dict[str, str]] | None:
    """The column of headings, its unit and convention where they are not the defaults."""
    best: tuple[float, int, dict[str, str]] | None = None
    for column, part in of_column.items():
        if named is not None and column != named:
            continue
        known = part[np.isfinite(part)]
        if not len(known):
            continue
        angle = "deg" if np.abs(known).max() > 6.4 else "rad"
        headings = np.deg2rad(part) if angle == "deg" else part
        for convention in ("from_x", "from_x_clockwise", "compass"):
            meant = {"from_x": headings, "from_x_clockwise": -headings, "compass": np.pi / 2 - headings}[convention]
            units = Units(angle=angle, heading=convention)  # type: ignore[arg-type]
            cosine, _, _ = recorded_agreement(rows._replace(heading=meant), around, units)
            told = {"angle": angle} if angle == "deg" else {}
            told |= {"heading": convention} if convention != "from_x" else {}
            if cosine >= AGREES and (best is None or cosine > best[0] + 1e-6):
                best = (cosine, column, told)
    return best[1:] if best else None


def days_of(rows: Tracks, zone: Any = timezone.utc) -> tuple[str, int]:
    """The first local day of recorded unix times, and how many days they are of."""
    first, last = (datetime.fromtimestamp(float(t), zone).date() for t in (rows.t.min(), rows.t.max()))
    return first.isoformat(), (last - first).days + 1
