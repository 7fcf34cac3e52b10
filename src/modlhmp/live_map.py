"""A map that is kept up to date by the people whom `Live` sees: their rows, a time step apart, once an hour."""

import logging
import math
from array import array
from typing import NamedTuple

import numpy as np

from modlhmp.api import Map
from modlhmp.arguments import FASTEST_M_S
from modlhmp.ids import id_of
from modlhmp.maps.updated.slots import Update
from modlhmp.storage import DataError
from modlhmp.time_step import newest_moment
from modlhmp.tracks import LEAST_JUMP_S, Tracks, gap_limit
from modlhmp.updates import UpdatedMap

RECORDING = "live"  # what a stream is called, unless it has a name
EVERY_S = 3600.0
JUMP_MPS = 15.0  # faster is somebody else, as in a recording (`max_jump_mps`)


class _Last(NamedTuple):
    """Somebody's last row, the number and position of their last step on the grid (-1: none yet), and which piece."""

    t: float
    x: float
    y: float
    step: int
    x0: float
    y0: float
    piece: int


class Learner:
    """Gives an `UpdatedMap` what is seen.

    Rows come at any rate; the map is told of the positions at whole time steps since 1970, linear between rows that are
    no gap apart, with velocities of the last step. Rows that come out of order are left to the forecasts, however late.
    Who jumps goes on as another person, as a recording is cut (`ids.id_of`); so does who is faster on the grid than a
    map takes, or all people's hour would be refused.
    `recording` names the stream: ids that two streams share are two persons.
    """

    def __init__(self, kept: UpdatedMap, recording: str = RECORDING, every_s: float = EVERY_S) -> None:
        self.kept, self.recording, self.every_s = kept, recording, every_s
        self._step_s = kept.site.time_step_s
        self._gap_s = gap_limit(self._step_s)
        self._last: dict[str, _Last] = {}
        self._ids, self._rows = array("q"), array("d")
        self._since = math.inf
        self.version = 0  # grows where what is learned changes the map

    def see(self, t: float, who: int | str, x: float, y: float) -> None:
        """Take a row: somebody was at (x, y) [m] at t [unix s]."""
        text, step_s = str(who), self._step_s
        before = self._last.get(text)
        if before is not None and t <= before.t:
            return
        self._since = min(self._since, t)
        piece = 1 if before is None else before.piece + is_jump(before.t, before.x, before.y, t, x, y)
        if before is None or piece > before.piece or t - before.t > self._gap_s:
            first = newest_moment(t, step_s, reached=False) + 1
            before = _Last(t - step_s, x, y, -1, x, y, piece)  # who comes stands there; only a step just now is one
        else:
            first = newest_moment(before.t, step_s) + 1
        number, x0, y0 = before.step, before.x0, before.y0
        for step in range(max(first, number + 1), newest_moment(t, step_s) + 1):
            share = min(max((step * step_s - before.t) / (t - before.t), 0.0), 1.0)
            at = before.x + share * (x - before.x), before.y + share * (y - before.y)
            speed = heading = math.nan
            if number == step - 1 and number >= 0:
                moved = at[0] - x0, at[1] - y0
                speed, heading = math.hypot(*moved) / step_s, math.atan2(moved[1], moved[0])
                if speed > FASTEST_M_S:  # by several rows, or one, within `LEAST_JUMP_S`
                    piece, speed, heading = piece + 1, math.nan, math.nan
            self._ids.append(id_of(text, piece))
            self._rows.extend((step * step_s, *at, speed, heading))
            number, (x0, y0) = step, at
        self._last[text] = _Last(t, x, y, number, x0, y0, piece)

    def due(self, now: float) -> bool:
        """Whether the map is to be told: its time has come."""
        return now // self.every_s > self._since // self.every_s

    def learn(self, now: float) -> Update:
        """Tell the map of all that was seen since the last time.

        An hour without anybody, or one that the map refuses (its clock was set back, say), leaves it as it was.
        """
        rows = np.array(self._rows).reshape(-1, 5)
        tracks = Tracks(np.array(self._ids, np.int64), *(np.ascontiguousarray(part) for part in rows.T))
        self._ids, self._rows, self._since = array("q"), array("d"), now
        order = np.lexsort((tracks.t, tracks.track_id))
        try:
            update = self.kept.add(tracks.take(order), self.recording)
        except DataError as error:
            logging.getLogger("modlhmp").warning("Live: %d rows are not learned: %s", len(order), error)
            update = Update(0, 0, len(order), 0, 0)
        self.version += bool(update.changed)
        return update

    def forget(self, before: float) -> None:
        """Forget who was last seen before that time [unix s], and would begin anew."""
        self._last = {text: last for text, last in self._last.items() if last.t >= before}


def is_jump(t0: float, x0: float, y0: float, t: float, x: float, y: float) -> bool:
    """Whether nobody gets from one row to another, t [s], x and y [m], whichever is first (`time_step.jumped`)."""
    return math.hypot(x - x0, y - y0) > JUMP_MPS * max(abs(t - t0), LEAST_JUMP_S)


def learned(kept: UpdatedMap) -> Map:
    """The map as it is now; `DataError` where it holds nothing that a forecast could use."""
    try:
        return kept.written()
    except DataError as error:
        raise DataError(f"Live: {error}") from None
