"""Readers: one recording file in, rows in SI units and the account of every row out."""

import math
import re
from datetime import datetime
from pathlib import Path
from typing import Any, cast

from modlhmp.account import Account
from modlhmp.clock import midnight, start_time
from modlhmp.file_format import FileFormat, how_to_set
from modlhmp.readers import atc, edinburgh, jupedsim, magni, trajnet
from modlhmp.readers.delimited import read_delimited
from modlhmp.readers.raw import FILE_COLUMN, People
from modlhmp.settings import as_plain
from modlhmp.storage import DataError, boundary, no_folder
from modlhmp.tracks import Tracks

_WHOLE = {"magni": magni.read, "jupedsim": jupedsim.read_sqlite, "hdf5": jupedsim.read_hdf5}


def read_recording(
    path: str | Path | People, form: FileFormat, day: str = "", start: str | None = None, days: int = 1
) -> tuple[Tracks, Account]:
    """Read `path` with the format's reader; returns (Tracks in the file's own sampling, Account).

    `day` is the local date (ISO), without which rows of every day are kept; `start` is the local time at which a file
    without a clock begins; the rows of so many `days` from then on are kept. `DataError` where a start has no day.
    """
    no_folder(path)
    try:
        limits, origin = _day_and_origin(form, day, start, days)
    except DataError as error:
        raise DataError(f"{path}: {error}") from None
    with boundary(path, "cannot be read as the dataset file says"):
        try:
            return _read(path, form, limits, origin)
        except DataError as error:
            error.args = (f"{error}{how_to_set(str(error), form)}",)
            raise


def _read(path, form, limits, origin):
    """What the form's reader reads."""
    frame_rate, row_stride, scale = (cast(Any, value) for value in (form.frame_rate, form.row_stride, form.scale))
    if isinstance(path, People):
        return _read_table(path, form, limits, origin)
    if form.reader == "edinburgh":
        return edinburgh.read_raw(path, frame_rate, scale, origin)
    if form.reader == "edinburgh_rows":
        return edinburgh.read_rows(path, frame_rate, row_stride, scale, origin, limits)
    if form.reader == "trajnet":
        return trajnet.read(path, frame_rate, origin, limits, form.origin_m)
    if form.reader in _WHOLE:
        return _WHOLE[form.reader](path, origin, limits, form.origin_m)
    return _read_table(path, form, limits, origin)


def _read_table(path, form, limits, origin):
    """Rows of a table in text, by the form's columns or a format's own."""
    layout = {"atc": atc.RAW_LAYOUT, "atc_1hz": atc.ONE_HZ_LAYOUT}.get(form.reader)
    columns = form.columns.given() if form.columns else {}
    if layout is None:
        plain = as_plain(form)
        keys = (
            *("header", "decimal", "thousands", "skip_lines", "units", "missing", "only", "without", "scale"),
            *("frame_rate", "timezone", "homography", "max_jump_mps"),
        )
        layout = {**{key: plain[key] for key in keys}, "columns": columns, "ids": "text"}
        layout["separator"] = None if form.reader == "text" else form.separator
        layout["comment"] = form.comment_mark
    if isinstance(path, People):
        moved = {field: column if isinstance(column, str) else column + 1 for field, column in columns.items()}
        layout |= {"columns": {"track_id": FILE_COLUMN if form.header else 0, **moved}, "skip_lines": 0}
        for key in ("only", "without"):  # the name of the file stands before the other columns
            layout[key] = {_next(column): texts for column, texts in getattr(form, key).items()}
    of_all = {"origin": origin, "origin_m": form.origin_m, "min_heading_mps": form.min_heading_mps}
    return read_delimited(path, {**layout, **of_all}, limits, form.time_step_s)


def _next(column):
    return str(int(column) + 1) if column.isdecimal() else column


def _day_and_origin(form: FileFormat, day: str, start: str | None, days: int) -> tuple[tuple[float, float], float]:
    """((first, last) unix second of the days, unix time of the file's time 0)."""
    if start is not None and form.units.time == "iso":
        raise DataError(f"start {start!r}: times are of a clock already (`iso`): leave it out")
    if not day:
        if start is not None:
            raise DataError(f"start {start!r}: say the `day` that it is the clock time of")
        return (-math.inf, math.inf), 0.0
    try:
        if not re.fullmatch(r"\d{4}-\d\d-\d\d", day):
            raise ValueError
        date = datetime.fromisoformat(day)
    except (TypeError, ValueError):
        raise DataError(f'day {day!r}: give a date, such as "2012-10-24"') from None
    if not 1900 < date.year < 2200:
        raise DataError(f"day {day!r}: give a date of our time")
    try:
        limits = midnight(date, form.timezone), midnight(date, form.timezone, days)
    except (ValueError, OverflowError):
        raise DataError(f"days {days}: the day that many days after {day} has no date; give a smaller number") from None
    if start is None and not form.has_clock:
        raise DataError(f'day {day!r}: the file has no clock: say its `start` too, such as "09:00", or no `day`')
    if start is None:
        return limits, 0.0
    try:
        origin = start_time(date, start, form.timezone)
    except DataError as error:
        raise DataError(f"start {start!r}: {error}") from None
    if origin is None:
        raise DataError(f'start {start!r}: give a clock time, such as "09:00"')
    return limits, origin
