"""Clock times of a place as unix seconds; those that a change of the clocks skips or repeats are not guessed."""

from datetime import datetime, timedelta
from functools import lru_cache
from zoneinfo import ZoneInfo

from modlhmp.storage import DataError


@lru_cache(maxsize=1 << 16)
def unix_time(text: str, timezone: str) -> float | None:
    """Unix time [s] of an ISO date and time such as 2026-03-02T09:00:00.25+01:00; None for any other text.

    Without a zone it is local time of `timezone`; `DataError` where that does not exist, or exists twice.
    """
    try:
        when = datetime.fromisoformat(text.replace("Z", "+00:00").replace(",", "."))
    except ValueError:
        return None
    return when.timestamp() if when.tzinfo else local_time(when, timezone)


def local_time(when: datetime, timezone: str) -> float:
    """Unix time [s] of a local date and time without zone; `DataError` where it does not exist, or exists twice."""
    zone = ZoneInfo(timezone)
    first, second = (when.replace(tzinfo=zone, fold=fold) for fold in (0, 1))
    if first.utcoffset() != second.utcoffset():
        exists = datetime.fromtimestamp(first.timestamp(), zone).replace(tzinfo=None) == when
        offsets = " or ".join(f"{one:%z}"[:3] + ":" + f"{one:%z}"[3:] for one in (first, second))
        fault = "exists twice, as clocks were put back" if exists else "does not exist, as clocks were put forward"
        raise DataError(
            f"{when.isoformat(sep=' ')} in {timezone} {fault}: write it with its offset from UTC ({offsets})"
        )
    return first.timestamp()


def midnight(day: datetime, timezone: str, later_days: int = 0) -> float:
    """Unix time [s] at which a local day begins, or one some days later."""
    return (day + timedelta(days=later_days)).replace(tzinfo=ZoneInfo(timezone)).timestamp()
