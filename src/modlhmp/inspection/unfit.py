"""What no option of a dataset file reads, answered with what to do about it."""

import re
from datetime import datetime, timedelta
from pathlib import Path
from typing import NoReturn

import numpy as np

from modlhmp.file_format import LENGTH_M
from modlhmp.inspection.chosen import REPEATED, repeated_share
from modlhmp.inspection.roles import Columns, Values, is_time, name_and_unit, one_person, pace_of
from modlhmp.inspection.sheet import Sheet
from modlhmp.plausibility import are_clock_digits
from modlhmp.readers.raw import People
from modlhmp.speed_units import EXTENT_M, USUAL_MPS, extent_of
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, usual_step

PIXEL_M = (0.01, 0.06)  # of cameras that see a place
_DEGREES = {"lat", "latitude", "lon", "long", "lng", "longitude"}
_LONGER = {"minutes": 60.0, "hours": 3600.0, "days": 86_400.0}  # units of time that there is no option for
_NAMES_OF = {"min": "minutes", "mins": "minutes", "minute": "minutes", "hour": "hours", "hrs": "hours", "day": "days"}
_DATE = re.compile(r"\d{1,4}([./-])\d{1,2}\1\d{1,4}([ T,].*)?")
_CLOCK = re.compile(r"\d{1,2}:\d\d(:\d\d([.,]\d+)?)?( ?[AP]M)?", re.IGNORECASE)
_NANOSECONDS = re.compile(r".*(nanosec|nsec|nanosecond)s?")  # names of what times have beyond whole seconds
_OF_A_SECOND = {  # names of what may be such, and how many of it a second has
    1e6: re.compile(r"(.*stamp|time|t)?(us|usecs?|micros|micros(ec|econd)s?)"),
    1e3: re.compile(r"(.*stamp|time|t)?(ms|msecs?|millis|millis(ec|econd)s?)"),
}
_NUMBERED = re.compile(r"(?:pos)?_?([xy])_?(\d+)", re.IGNORECASE)
_NUMBERED_ID = re.compile(r"(?:\w*id|ped\w*|person|agent|human|track)_?(\d+)", re.IGNORECASE)
_SPREADSHEET = (20_000, 80_000)  # days since the last of 1899: of the years 1954 to 2119
_CLOSE = 0.1  # of the place's longer side
_FINE = 0.02  # units of time between rows: in seconds 50 times a second, in minutes about once
_WALKS_MPS = (0.3, 3.0)


class NoIdsError(DataError):
    """A table has times and positions, but no column of ids."""


def refuse_by_names(path: str | Path | People, sheet: Sheet, values: Values) -> None:
    """`DataError` where a column holds nanoseconds beyond whole seconds, or a line several people."""
    for column in range(len(sheet.names)):
        if _NANOSECONDS.fullmatch(_letters(sheet, column)) and _is_below(values, column, 1e9):
            _refuse_fraction(path, sheet, column)
    if len({match[1] for name in sheet.names if (match := _NUMBERED_ID.fullmatch(name.strip()))}) > 1:
        _refuse_several(path, sheet, least=2)


def refuse_fractions(path: str | Path | People, sheet: Sheet, values: Values, columns: Columns) -> None:
    """`DataError` where times are whole seconds, of which one person has several rows, told apart by a part of one.

    The part may have been taken for the time itself, where another column that is named so holds the seconds.
    """
    ids = values.ids(columns)
    for column in set(range(len(sheet.names))) - {columns.x, columns.y, columns.track_id}:
        of_second = _letters(sheet, column)
        if any(names.fullmatch(of_second) and _is_below(values, column, per) for per, names in _OF_A_SECOND.items()):
            clocks = [columns.t] if column != columns.t else [c for c, name in enumerate(sheet.names) if is_time(name)]
            if any(_stand_still(ids, values.numbers[:, clock]) for clock in clocks):
                _refuse_fraction(path, sheet, column)


def _stand_still(ids: np.ndarray, seconds: np.ndarray) -> bool:
    """Whether times are whole seconds, more than one, of which one person has several rows."""
    whole = np.array_equal(seconds, np.rint(seconds), equal_nan=True)
    return whole and len(np.unique(seconds)) > 1 and repeated_share(ids, seconds) > REPEATED


def _letters(sheet: Sheet, column: int) -> str:
    return re.sub(r"[^a-z]", "", sheet.names[column].lower())


def _is_below(values: Values, column: int, most: float) -> bool:
    """Whether a column's numbers are from 0 to below `most`, and not all one: 0 alone is of rows at whole seconds."""
    part = values.numbers[:, column]
    return bool(0 <= np.nanmin(part, initial=0) < np.nanmax(part, initial=0) < most)


def _refuse_fraction(path: str | Path | People, sheet: Sheet, column: int) -> NoReturn:
    raise DataError(
        f"{path}: column {sheet.called(column)!r} holds what times have beyond whole seconds: add them up into one "
        "column"
    )


def refuse_without_columns(path: str | Path | People, sheet: Sheet, values: Values) -> NoReturn:
    """`DataError` for a table in which no choice of id, time, x and y gives people who move."""
    _refuse_several(path, sheet, least=3)
    if one_person(sheet, values) is not None:
        raise NoIdsError(
            f"{path}: has no column of ids: if every file is one person's alone, inspect its folder "
            "(`modlhmp inspect FOLDER`); or, where a line holds several people, write one row for each person and "
            "time; else say `columns` in a dataset file"
        )
    others = (text for column, text in enumerate(sheet.rows[0]) if column not in values.iso)
    if (text := next((one for one in others if _DATE.fullmatch(one) or _CLOCK.fullmatch(one)), None)) is not None:
        raise DataError(f"{path}: {_no_time(text)}")
    shown = "; ".join(" ".join(row) for row in sheet.rows[:2])[:120]
    raise DataError(
        f"{path}: no choice of id, time, x and y among its {len(sheet.rows[0])} columns gives people who move "
        f"(rows such as {shown!r}): are ids in a column of their own? Say `columns` in a dataset file"
    )


def refuse_parts_of_one(path: str | Path | People, sheet: Sheet, owner: int, other: int, rows: Tracks) -> None:
    """`DataError` where rows of one id and time, which column `other` tells apart, are one person's, not of several.

    `owner` is the column of ids; `rows` are the table's in its own units.
    """
    if not _are_one_person(rows):
        return
    called, texts = sheet.called(other), sorted({row[other] for row in sheet.rows})
    together = f"; if they are people who walk together, say `columns: {{track_id: [{sheet.called(owner)}, {called}]}}`"
    if isinstance(path, People):  # whose files have no such column; it stands before theirs
        called, together = called - 1 if isinstance(called, int) else called, ""
    raise DataError(
        f"{path}: several rows have one id and time and are close together; column {called!r} tells them apart "
        f"({', '.join(texts[:4])}). If it is a part of the time, add it to the column of times; if it is of cameras or "
        f"of parts of a body, keep one of them by `only: {{{called}: [{texts[0]}]}}`{together}, in a dataset file"
    )


def _are_one_person(rows: Tracks) -> bool:
    """Whether rows of one id and time are close together, as of one person's body, or within one second.

    Those of several people, say on two floors, are anywhere in the place. `rows` are in the file's own units.
    """
    same = (np.diff(rows.track_id) == 0) & (np.diff(rows.t) == 0)
    apart = np.hypot(np.diff(rows.x), np.diff(rows.y))[same]
    return len(apart) > 0 and float(np.median(apart)) < _CLOSE * extent_of(rows)


def refuse_unfit(path: str | Path | People, sheet: Sheet, values: Values, columns: Columns, rows: Tracks) -> None:
    """`DataError` for times or positions that no option reads; `rows` are the table's in its own units."""
    told = _of_times(sheet, values, columns, rows) or _of_places(sheet, values, columns, rows)
    if not told and not len(rows.t):
        shown = ", ".join(repr(sheet.rows[0][column]) for column in (columns.t, columns.x, columns.y))
        told = f"no row has numbers, of digits 0 to 9, as its time, x and y; the first one has {shown}"
    if told:
        raise DataError(f"{path}: {told}")


def _refuse_several(path, sheet, least):
    """`DataError` where names are x1, y1, x2, y2, x3, y3, of at least so many people; two of them may be of a box."""
    numbered = [match for name in sheet.names if (match := _NUMBERED.fullmatch(name.strip()))]
    axes = {axis: {match[2] for match in numbered if match[1].lower() == axis} for axis in "xy"}
    if min(map(len, axes.values())) >= least or axes == {"x": {"0", "1"}, "y": {"0", "1"}}:
        raise DataError(
            f"{path}: columns {', '.join(map(repr, sheet.names[:5]))} are of several people: write one row for each "
            "person and time, with the person's id in a column"
        )


def _of_times(sheet, values, columns, rows):
    """What is wrong with the times; empty where nothing is."""
    clock = values.numbers[:, columns.t]
    texts = [row[columns.t] for row in sheet.rows]
    other = next((c for c in range(values.numbers.shape[1]) if c != columns.t and _are_clock_times(sheet, c)), None)
    if other is not None and len(set(texts)) < 0.01 * len(texts) + 2:
        return (
            f"dates are in column {sheet.called(columns.t)!r} and times, such as {sheet.rows[0][other]!r}, in "
            f"{sheet.called(other)!r}: write both into one column, 2026-03-02T09:00:00.5"
        )
    if not np.isfinite(clock).any():
        return _no_time(texts[0])
    if columns.t in values.iso or not len(rows.t):
        return ""
    if are_clock_digits(clock):
        return (
            f"times such as {texts[0]} are hours, minutes and seconds of a clock, written as one number: write that "
            "column as 2026-03-02T09:00:00.5, or in seconds"
        )
    unit = _long_unit(sheet, columns, rows)
    if not unit:
        return ""
    middle = float(np.nanmedian(clock))
    if unit == "days" and _SPREADSHEET[0] < middle < _SPREADSHEET[1]:
        when = datetime(1899, 12, 30) + timedelta(days=float(np.nanmin(clock)))
        return (
            f"times such as {texts[0]} are days, as spreadsheets count them ({when:%Y-%m-%d %H:%M:%S}): write that "
            "column as 2026-03-02T09:00:00.5, or in seconds"
        )
    return f"times such as {texts[0]} are in {unit}, for which there is no unit: write that column in seconds"


def _no_time(text):
    return (
        f"times such as {text!r} are neither numbers nor ISO 8601 (2026-03-02T09:00:00.5, with or without +01:00): "
        "rewrite that column"
    )


def _are_clock_times(sheet, column):
    return all(_CLOCK.fullmatch(row[column]) for row in sheet.rows[:50])


def _long_unit(sheet, columns, rows):
    """The unit of times in minutes or longer, by its name or where only this gives people who walk; empty else."""
    name = name_and_unit(sheet.names[columns.t])[0] if columns.t < len(sheet.names) else ""
    if named := _NAMES_OF.get(name, name if name in _LONGER else ""):
        return named
    if not 0 < usual_step(rows) < _FINE:
        return ""
    pace, extent = pace_of(rows), extent_of(rows)
    lengths = [*LENGTH_M.values(), *([USUAL_MPS / pace] if pace and PIXEL_M[0] < USUAL_MPS / pace < PIXEL_M[1] else [])]
    if any(_WALKS_MPS[0] < pace * metres < _WALKS_MPS[1] and extent * metres > EXTENT_M[0] for metres in lengths):
        return ""
    return next((unit for unit, per in _LONGER.items() if _WALKS_MPS[0] < pace / per < _WALKS_MPS[1]), "")


def _of_places(sheet, values, columns, rows):
    """What is wrong with the positions; empty where nothing is."""
    for column in (columns.x, columns.y):
        bad = [row[column] for row in sheet.rows if sheet.number(row[column]) is None]
        if len(bad) > 0.2 * len(sheet.rows) and len(set(bad)) > 3:  # one text would stand for "not seen"
            return (
                f"positions such as {bad[0]!r} in column {sheet.called(column)!r} are no numbers: rewrite that column"
            )
    names = {name_and_unit(sheet.names[column])[0] for column in (columns.x, columns.y) if column < len(sheet.names)}
    if names & _DEGREES or _are_degrees(rows):
        called = " and ".join(repr(sheet.called(column)) for column in (columns.x, columns.y))
        return (
            f"columns {called} are degrees of longitude and latitude: project them to metres first, such as those of "
            "the place's UTM zone"
        )
    return ""


def _are_degrees(rows):
    """Whether positions are of a globe: far from zero compared with how far they reach, which is hardly anything."""
    if not len(rows.t):
        return False
    sides = [float(np.quantile(part, 0.98) - np.quantile(part, 0.02)) for part in (rows.x, rows.y)]
    middles = sorted(abs(float(np.median(part))) for part in (rows.x, rows.y))
    return 0 < max(sides) < 0.05 and middles[0] <= 90 and middles[1] <= 180 and middles[1] > 20 * max(sides)
