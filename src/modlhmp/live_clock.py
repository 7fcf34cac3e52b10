"""What time it is in a stream of rows, where a row, a person or a sensor may have a wrong time.

Time goes on with the rows. Neither one row from far ahead nor one person whose rows all are takes it along: such rows
wait until somebody else, or enough of them, say the same. Nor do late rows set it back, unless they are many more.
One row alone does not tell whether all the others are silent or its own clock is wrong; rows from the present do.
"""

import copy
import math
from collections.abc import Container
from typing import Any

from modlhmp.time_step import ROUNDING_S

MOST_LATE = 10  # rows in succession that come from long ago: then the clock has been set back
MOST_WAITING = 1024
Row = tuple[float, Any, float, float]  # t [unix s], id, x, y [m]; without an id it says what time it is


class Clock:
    """The time `now` [unix s] of a stream, and the rows that are `waiting`, of one person and by rising time.

    A row is late that is more than `kept_s` older than now. It is from ahead if it is more than `gap_s` newer, though
    somebody else was seen in the last `alone_s` before now, the time that stands still meanwhile. Such rows are right
    once another person has one, or the same person has had them for `alone_s`, without a row from the present in
    between: one of those shows that they were wrong.
    """

    def __init__(self, kept_s: float, gap_s: float, alone_s: float) -> None:
        self.now, self.set_back = -math.inf, 0
        self.waiting: tuple[Row, ...] = ()
        self._wrong = ""  # whose rows were shown to be wrong last
        self._kept_s, self._gap_s, self._alone_s = kept_s, gap_s, alone_s
        self._late: tuple[str, ...] = ()  # whose the late rows in succession are
        self._seen: tuple[tuple[float, str], ...] = ()  # when the two were seen who were seen last

    def tell(self, row: Row) -> list[tuple[str, Row]]:
        """Take a row in; returns the rows that are decided now, and why each is not to be taken, "" if it is.

        The row itself is the last of them, unless it waits.
        """
        t, who = row[0], _name(row)
        if t < self.now - self._kept_s:
            self._late += (who,)
            if len(self._late) < MOST_LATE:
                return [("late", row)]
            self.now, self.set_back, self._late, self._seen = -math.inf, self.set_back + 1, (), ()
        elif t > self.now + self._gap_s and who and not self._is_alone(who):
            return self._tell_from_ahead(row)
        elif len(set(self._late)) < 2 or not (who and self._is_alone(who)):
            self._late = ()  # one person alone does not keep several others late
        waiting, self.waiting = self.waiting, ()
        self._go_on(row)
        if waiting and waiting[-1][0] > self.now + self._gap_s:
            self._wrong = _name(waiting[-1])
        return [*(("" if one[0] <= self.now + self._gap_s else "ahead", one) for one in waiting), ("", row)]

    def waits(self, row: Row) -> bool:
        """Whether a row would wait; nothing is taken in."""
        if row[0] <= self.now + self._gap_s:  # as nearly all are: then there is no need to try
            return False
        decided = copy.copy(self).tell(row)
        return not decided or decided[-1][1] is not row

    def likely(self, known: Container[str]) -> tuple[Row, ...]:
        """The rows that wait, if they are likely to be right: of a newcomer, or several, one after another.

        Not of a person whose last ones were shown to be wrong. `known` are those who were there before.
        """
        who = _name(self.waiting[0]) if self.waiting else ""
        return () if who == self._wrong or (len(self.waiting) == 1 and who in known) else self.waiting

    def _tell_from_ahead(self, row: Row) -> list[tuple[str, Row]]:
        """See `tell`: the row waits, or time has gone on to those that do, and it is told anew."""
        t, waiting = row[0], self.waiting
        if waiting:
            same, first = _name(row) == _name(waiting[0]), waiting[0][0]
            if t >= (first + self._alone_s - ROUNDING_S if same else first - self._gap_s):
                self.waiting = ()
                for one in waiting:
                    self._go_on(one)
                return [*(("", one) for one in waiting), *self.tell(row)]
            if not same or t <= waiting[-1][0]:  # it disagrees with those that wait, which are given up
                self.waiting = (row,)
                return [("ahead", one) for one in waiting]
            if len(waiting) == MOST_WAITING:
                return [("ahead", row)]
        self.waiting = (*waiting, row)
        return []

    def _is_alone(self, who: str) -> bool:
        """Whether nobody else was seen lately, who could contradict."""
        return not any(other != who and t > self.now - self._alone_s for t, other in self._seen)

    def _go_on(self, row: Row) -> None:
        self.now = max(self.now, row[0])
        if _name(row) == self._wrong:
            self._wrong = ""
        seen = {who: t for t, who in self._seen}
        seen[_name(row)] = max(row[0], seen.get(_name(row), row[0]))
        self._seen = tuple(sorted(((t, who) for who, t in seen.items()), reverse=True)[:2])


def _name(row: Row) -> str:
    """Whose a row is; "" where it says the time alone, which nobody is called."""
    return "" if row[1] is None else str(row[1])
