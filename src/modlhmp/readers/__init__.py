"""Readers: one recording file in, rows in SI units and the account of every row out."""

import math
from datetime import datetime, time, timedelta
from pathlib import Path
from typing import Any, cast
from zoneinfo import ZoneInfo

from modlhmp.account import Account
from modlhmp.file_format import FileFormat
from modlhmp.readers import atc, edinburgh
from modlhmp.readers.delimited import read_delimited
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks


def read_recording(
    path: str | Path, form: FileFormat, day: str = "", start: str | None = None
) -> tuple[Tracks, Account]:
    """Read `path` with the format's reader; returns (Tracks in the file's own sampling, Account).

    `day` is the local date (ISO), without which rows of every day are kept; `start` is the local time at which a file
    without a clock begins. `DataError` where a start has no day.
    """
    limits, origin = _day_and_origin(form.timezone, day, start)
    frame_rate, row_stride, scale = (cast(Any, value) for value in (form.frame_rate, form.row_stride, form.scale))
    if form.reader == "edinburgh":
        return edinburgh.read_raw(path, frame_rate, scale, origin)
    if form.reader == "edinburgh_rows":
        return edinburgh.read_rows(path, frame_rate, row_stride, scale, origin, limits)
    layout = {"atc": atc.RAW_LAYOUT, "atc_1hz": atc.ONE_HZ_LAYOUT}.get(form.reader) or {
        "columns": form.columns.given() if form.columns else {},
        "separator": form.separator,
        "header": form.header,
        "units": {"time": form.units.time, "length": form.units.length, "angle": form.units.angle},
        "scale": form.scale,
        "frame_rate": form.frame_rate,
    }
    return read_delimited(path, {**layout, "origin": origin}, limits, form.time_step_s)


def _day_and_origin(timezone: str, day: str, start: str | None) -> tuple[tuple[float, float], float]:
    """((first, last) unix second of the day, unix time of the file's time 0)."""
    if not day:
        if start is not None:
            raise DataError(f"start {start!r}: say the `day` that it is the clock time of")
        return (-math.inf, math.inf), 0.0
    zone = ZoneInfo(timezone)
    try:
        date, clock = datetime.fromisoformat(day), time.fromisoformat(start or "00:00")
    except (TypeError, ValueError, OverflowError):
        raise DataError(
            f'day {day!r}, start {start!r}: give a date and a clock time, as "2012-10-24" and "09:00"'
        ) from None
    if not 1900 < date.year < 2200:
        raise DataError(f"day {day!r}: give a date of our time")
    midnight = date.replace(tzinfo=zone)
    limits = midnight.timestamp(), (date + timedelta(days=1)).replace(tzinfo=zone).timestamp()
    if start is None:
        return limits, 0.0
    return limits, datetime.combine(date, clock, zone).timestamp()
