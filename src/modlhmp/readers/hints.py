"""What a file looks like where it is not what was declared: the option that would read it, for messages."""

import re
from collections.abc import Iterable, Mapping
from datetime import datetime, timezone
from typing import Any

from modlhmp.clock import unix_time
from modlhmp.readers.fields import fields_of
from modlhmp.readers.numerals import ALSO, number

_ISO = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_DECIMAL_COMMA = re.compile(r"[+-]?(0,\d+|\d+,(\d{1,2}|\d{4,})|\d{4,},\d+)")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}([., '\u00a0\u202f\u2019])\d{3}(?:\1\d{3})*(?:([.,])\d+)?")
_LEAST_COLUMNS = 3  # of a table
_LOOKED_AT = 4096  # bytes
_OF_BLANKS = "has columns separated by blanks: use `reader: text`"


def hint(block: bytes, layout: Mapping[str, Any]) -> str:
    """What the first lines of a file look like, and the option to set; empty where nothing is known."""
    all_lines = block[:_LOOKED_AT].decode("utf-8", "replace").splitlines()
    lines = [line for line in all_lines if line.strip()]
    if not lines:
        return ""
    separator = layout.get("separator", ",")
    told = _of_separator(lines, separator)
    if not told and separator is not None and not layout.get("skip_lines"):
        told = _of_widths(all_lines, separator, layout)
    return told or hint_of_rows(lines[1:4], layout) or _of_encoding(block)


def _of_separator(lines, separator):
    """What stands between columns, where it is not what was declared."""
    first = lines[0].strip()
    if first.startswith("{"):
        return "looks like JSON lines: use `reader: trajnet`"
    if first.startswith("#"):
        return "begins with comments: use `reader: text`, or `comment: '#'`"
    if first.startswith("%"):
        return "begins with comments: set `comment: '%'`"
    if separator == " " and any(line.startswith(" ") or "  " in line.rstrip() for line in lines):
        return _OF_BLANKS
    if separator is not None and separator not in first:
        other = next((one for one in (";", "\t", ",", "|") if one in first), None)
        if other:
            return f"has columns separated by {other!r}: set `separator: {other!r}`"
        if " " in first:
            return _OF_BLANKS
    return ""


def _of_widths(lines, separator, layout):
    """How many lines stand before the table, or that its header has fewer columns than its rows."""
    table = [fields_of(line, separator) for line in lines]
    widest = max(map(len, table))
    begin = next((n for n, row in enumerate(table) if _LEAST_COLUMNS <= len(row) == widest), 0)
    before = [row for line, row in zip(lines, table[:begin], strict=False) if line.strip()]
    if not before:
        return ""
    names = {one for one in layout["columns"].values() if isinstance(one, str)}
    if names <= set(before[-1]) if names else len(before[-1]) == widest - 1:
        return (
            f"has {len(before[-1])} columns in its header and {widest} below: write all lines alike (is there a "
            f"{separator!r} at their ends?)"
        )
    return f"has {begin} lines before its table: set `skip_lines: {begin}`"


def hint_of_rows(lines: Iterable[str], layout: Mapping[str, Any]) -> str:
    """How times and numbers are written in rows that could not be read; empty where nothing is known."""
    separator = layout.get("separator", ",")
    plain = (re.sub(r"[ \t]+", " ", line).strip(" ") if separator is None else line for line in lines)
    fields = [field for line in plain for field in fields_of(line, separator)]
    if not fields:
        return ""
    iso = layout.get("units", {}).get("time") == "iso"
    if iso and not any(unix_time(field, "UTC") is not None for field in fields):
        return (
            "has no times such as 2026-03-02T09:00:00 (ISO 8601: year-month-day, then the time, 0 to 23 h): rewrite "
            "that column"
        )
    if not iso and any(_ISO.match(field) for field in fields):
        return "has times such as 2026-03-02T09:00: set `units: {time: iso}`"
    decimal, thousands = layout.get("decimal") or ".", layout.get("thousands")
    if decimal != "," and any(map(_DECIMAL_COMMA.fullmatch, fields)):
        return 'has numbers such as 1,25: set `decimal: ","`'
    for field in fields:
        if (found := _THOUSANDS.fullmatch(field)) and number(field, decimal, thousands or "") is None:
            mark = next((one for one, others in ALSO.items() if found[1] in others), found[1])
            told = [f"`thousands: {mark!r}`"] if mark != thousands else []
            told += [f"`decimal: {found[2]!r}`"] if found[2] not in (None, decimal) else []
            also = f", or `decimal: {mark!r}` if they are decimals" if mark in ",." and not found[2] else ""
            return f"has numbers such as {field}: set {' and '.join(told)}{also}" if told else ""
    return ""


def _of_encoding(block):
    """Whether the text is in another encoding than readers take."""
    try:
        block[:_LOOKED_AT].rpartition(b"\n")[0].decode("utf-8")
    except UnicodeDecodeError as error:
        return f"is not UTF-8 text (byte {error.object[error.start]:#x}; Latin-1 or Windows-1252?): save it as UTF-8"
    return ""


def hint_of_units(beyond: Mapping[str, tuple[int, float]], rows: int, origin: float = 0.0) -> str:
    """Which unit may be wrong where most of the values of a kind are `beyond` (`Account`) what any recording has.

    `origin` is the unix time [s] that the file's times are counted from.
    """
    told = []
    for what, (count, median) in beyond.items():
        if count > 0.5 * rows:
            told.append(_time(median, origin) if what == "time" else _UNIT_OF[what](median))
    return "; ".join(told)


def _time(seconds, origin):
    if origin and _YEAR_1980_S < seconds - origin < _YEAR_2200_S:
        when = datetime.fromtimestamp(seconds - origin, timezone.utc)
        return f"times are of a clock already, such as {when:%Y-%m-%d %H:%M} UTC: leave out `start`"
    if seconds > _YEAR_2200_S:
        unit = next((name for name, per in (("ms", 1e3), ("us", 1e6)) if seconds / per < _YEAR_2200_S), "ns")
        return f"times such as {seconds:.0f} s are beyond the year 2200: set `units: {{time: {unit}}}`"
    if seconds < _YEAR_1980_S:
        return (
            f"times such as {seconds:g} s are of about 1970: if they count from a begin, say the `start`; "
            "if not, correct `units: {time: s}`"
        )
    when = datetime.fromtimestamp(seconds, timezone.utc)
    return f"times such as {when:%Y-%m-%d %H:%M} UTC are of other days: correct `day`, `days` or `timezone`"


def _speed(mps):
    unit = "mm/s" if mps > 300 else "cm/s" if mps > 25 else "km/h"
    return f"speeds are {mps:.3g} m/s in the middle: set `units: {{speed: {unit}}}`"


_YEAR_1980_S, _YEAR_2200_S = 315_532_800.0, 7_258_118_400.0
_UNIT_OF = {
    "speed": _speed,
    "distance": lambda metres: (
        f"positions are {metres / 1000:.3g} km from the origin in the middle: correct "
        "`units: {length: ...}`, or set `origin_m`"
    ),
    "heading": lambda angle: f"headings are {angle:.3g} rad in the middle: set `units: {{angle: deg}}`",
}
