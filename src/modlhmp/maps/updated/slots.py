"""Slots of time, days of the place, what the same row is, and what an update did."""

from collections.abc import Iterator
from datetime import date, timedelta
from typing import NamedTuple

import numpy as np

from modlhmp.storage import DataError

DAY_S = 86400.0
_EPOCH = date(1970, 1, 1)


class Update(NamedTuple):
    """What became of the rows of an update.

    `taken` are new; `repeated` were in the map and count once; `unused` have no heading or stand still, which kinds of
    counts leave out; `late` are those taken that belong before the newest hour of the map, which changes nothing but
    is worth knowing; `changed` is the number of slots (hours, intervals) that are not as before: of 0 the map is that
    of before; `out_of_order` came after a later row of their person.
    """

    taken: int
    repeated: int
    unused: int
    late: int
    changed: int
    out_of_order: int = 0

    def __str__(self) -> str:
        text = ", ".join(f"{value} {name}" for name, value in self._asdict().items() if value and name != "changed")
        done = f"{self.changed} slots of time changed" if self.changed else "the map is that of before"
        return f"{text or 'no rows'}; {done}"


def day_number(day: str) -> int:
    """Days since 1970 of an ISO date."""
    try:
        return (date.fromisoformat(day) - _EPOCH).days
    except (TypeError, ValueError):
        raise DataError(f"remove: day {day!r}: give an ISO date of the place, such as '2012-10-24'") from None


def day_text(number: int) -> str:
    """ISO date of days since 1970."""
    return str(_EPOCH + timedelta(days=int(number)))


def thousandths(values: np.ndarray) -> np.ndarray:
    """Times [s] in whole ms, or positions [m] in whole mm, float [n].

    Rows of one person and ms are the same row if x and y are the same in mm, else they contradict each other. Rounding,
    not a tolerance, since of three rows the first may not be the same as the second alone.
    """
    return np.rint(1000 * values)


def repeats(track_id: np.ndarray, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of rows sorted by person and time, which [n] are of the person and ms of the row before, and which are apart."""
    same, apart = np.zeros(len(t), bool), np.zeros(len(t), bool)
    same[1:] = (np.diff(track_id) == 0) & (np.diff(thousandths(t)) == 0)
    apart[1:] = (np.diff(thousandths(x)) != 0) | (np.diff(thousandths(y)) != 0)
    return same, apart


def spans(values: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """(value, the places [m] where it stands, rising) of each value of `values` [n], by rising value."""
    order = np.argsort(values, kind="stable")
    first = np.flatnonzero(np.diff(values[order], prepend=np.iinfo(np.int64).min))
    for mine in np.split(order, first[1:]) if len(values) else ():
        yield int(values[mine[0]]), mine
