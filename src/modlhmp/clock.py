"""Clock times of a place as unix seconds; those that a change of the clocks skips or repeats are not guessed."""

import re
from datetime import datetime, timedelta
from datetime import timezone as fixed_zone
from functools import lru_cache
from zoneinfo import ZoneInfo

from modlhmp.storage import DataError

# ISO 8601 of whole days and clock times. Not `datetime.fromisoformat`, which takes less in Python 3.10 than later.
_DATE = r"(?P<year>\d{4})(?P<dash>-?)(?P<month>\d\d)(?P=dash)(?P<day>\d\d)"
_TIME = r"(?P<hour>\d\d)(?:(?P<colon>:?)(?P<minute>\d\d)(?:(?P=colon)(?P<second>\d\d)(?:[.,](?P<fraction>\d+))?)?)?"
_ZONE = r" ?(?P<zone>[Zz]|UTC|[+-](?P<hours>\d\d)(?::?(?P<minutes>[0-5]\d)(?::?(?P<seconds>[0-5]\d))?)?)"
_MOMENT = re.compile(rf"{_DATE}(?:\D{_TIME}(?:{_ZONE})?)?", re.ASCII)
_DAY_S = 86_400
# Of a recording's start.
CLOCK = re.compile(r"([01][0-9]|2[0-3]):[0-5][0-9](:[0-5][0-9]([.,][0-9]+)?)?([+-][0-9]{2}:[0-9]{2})?")


@lru_cache(maxsize=1 << 16)
def unix_time(text: str, timezone: str) -> float | None:
    """Unix time [s] of an ISO date and time such as 2026-03-02T09:00:00.25+01:00; None for any other text.

    Without a zone it is local time of `timezone`; `DataError` where that does not exist, or exists twice. A leap second
    is the first second of the next day, as unix times have it.
    """
    match = _MOMENT.fullmatch(text)
    if match is None:
        return None
    parts = match.group("year", "month", "day", "hour", "minute", "second")
    year, month, day, hour, minute, second = (int(part or 0) for part in parts)
    leap = second == 60
    try:
        when = datetime(year, month, day, hour, minute, second - leap)
        offset = _offset(match)
        zone = None if offset is None else fixed_zone(offset)
    except ValueError:
        return None
    whole = (when.replace(tzinfo=zone).timestamp() if zone else local_time(when, timezone)) + leap
    if leap and whole % _DAY_S:
        return None
    return whole + float(f"0.{match['fraction'] or 0}")


def utc_offset(text: str) -> timedelta | None:
    """The offset from UTC that an ISO date and time says; None where it says none, or is no such text."""
    match = _MOMENT.fullmatch(text)
    return None if match is None else _offset(match)


def _offset(match):
    zone, *parts = match.group("zone", "hours", "minutes", "seconds")
    if zone is None:
        return None
    hours, minutes, seconds = (int(part or 0) for part in parts)
    offset = timedelta(hours=hours, minutes=minutes, seconds=seconds)
    return -offset if zone[0] == "-" else offset


def start_time(day: datetime, start: str, timezone: str) -> float | None:
    """Unix time [s] of a clock time on a day, such as 09:00, 09:00:00.5 or 02:30+01:00; None for any other text.

    `DataError` where the day has no such time, or has it twice, or where the zone has no such offset about that day.
    """
    if not (isinstance(start, str) and CLOCK.fullmatch(start)):
        return None
    text = f"{day:%Y-%m-%d}T{start}"
    t, offset = unix_time(text, timezone), utc_offset(text)
    about = {(day + timedelta(days=later)).replace(tzinfo=ZoneInfo(timezone)).utcoffset() for later in (-1, 0, 1, 2)}
    if t is not None and offset is not None and offset not in about:
        known = " or ".join(sorted(_shown(one) for one in about if one is not None))
        raise DataError(f"the offset from UTC of {timezone} is {known} then: correct it, or leave it out")
    return t


def local_time(when: datetime, timezone: str) -> float:
    """Unix time [s] of a local date and time without zone; `DataError` where it does not exist, or exists twice."""
    zone = ZoneInfo(timezone)
    first, second = (when.replace(tzinfo=zone, fold=fold) for fold in (0, 1))
    if first.utcoffset() != second.utcoffset():
        exists = datetime.fromtimestamp(first.timestamp(), zone).replace(tzinfo=None) == when
        offsets = " or ".join(_shown(one.utcoffset()) for one in (first, second))
        fault = "exists twice, as clocks were put back" if exists else "does not exist, as clocks were put forward"
        raise DataError(
            f"{when.isoformat(sep=' ')} in {timezone} {fault}: write it with its offset from UTC ({offsets})"
        )
    return first.timestamp()


def midnight(day: datetime, timezone: str, later_days: int = 0) -> float:
    """Unix time [s] at which a local day begins, or one some days later."""
    return (day + timedelta(days=later_days)).replace(tzinfo=ZoneInfo(timezone)).timestamp()


def _shown(offset):
    """An offset from UTC as ISO 8601 has it: +01:00."""
    return fixed_zone(offset).tzname(None).removeprefix("UTC") or "+00:00"
