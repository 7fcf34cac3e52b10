"""`Live` over two streams of JSON lines: rows in, forecasts out, at moments that are multiples of so many seconds.

A row is `{"t": 1351042800.1, "id": 7, "x": 1.5, "y": -3.0}`; one without `id` says that it is t now, and that everyone
who has been seen by then has been told. A moment is forecast once a row from after it comes, or a row without `id` from
then or after. Of several moments that one row passes only the last is forecast.
"""

import copy
import json
import math
import os
import select
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from modlhmp.arguments import LATEST_S
from modlhmp.forecasting.occupancy import Occupancy, counted_steps
from modlhmp.futures import Futures
from modlhmp.live import FARTHEST_M, Live, is_row
from modlhmp.live_clock import Clock, Row
from modlhmp.time_step import newest_moment

MOST_BYTES = 65_536  # of a line
LEAST_SHOWN = 0.01  # probability of a cell


def batches(source: int) -> Iterator[list[bytes]]:
    """The lines of a file descriptor, as many as come at once; of one that is too long, its beginning."""
    rest = b""
    while chunk := os.read(source, MOST_BYTES):
        *lines, rest = (rest + chunk).split(b"\n")
        yield lines
        rest = rest[: MOST_BYTES + 1]
    yield [rest]


def row_of(line: bytes) -> Row | str:
    """t, id, x, y of a line, the id None where time alone is told; of a line that is neither, why."""
    if len(line) > MOST_BYTES:
        return f"longer than {MOST_BYTES} bytes"
    try:
        read = json.loads(line, parse_constant=_not_a_number)
    except _NotANumberError as error:
        return str(error)
    except (ValueError, RecursionError):
        return "not JSON"
    if not isinstance(read, dict):
        return 'not {...}, such as {"t": 1351042800.1, "id": 7, "x": 1.5, "y": -3.0}'
    t, who, x, y = (read.get(name) for name in ("t", "id", "x", "y"))  # type: Any, Any, Any, Any
    if who is None and x is None and y is None and is_row(t, 0, 0.0, 0.0):
        return float(t), None, 0.0, 0.0
    return (float(t), who, float(x), float(y)) if is_row(t, who, x, y) else _why(read)


class _NotANumberError(ValueError):
    pass


def _not_a_number(name: str) -> float:
    raise _NotANumberError(f"{name} is no number of JSON")


def _why(read: dict[str, Any]) -> str:
    """What is wrong with an object that `is_row` refuses."""
    for name in ("t", *(("id", "x", "y") if {"id", "x", "y"} & read.keys() else ())):
        value = read.get(name)
        if value is None:
            return f"no {name}; it has {', '.join(sorted(map(str, read)))[:100] or 'nothing'}"
        if isinstance(value, bool | list | dict) or (name != "id" and isinstance(value, str)):
            what = {bool: "true or false", list: "a list", dict: "an object", str: "text"}[type(value)]
            return f"{name} is {what}, not a number{' or text' * (name == 'id')}"
        if name == "t" and not abs(value) < LATEST_S:
            return f"t {str(value)[:20]} is beyond the year 5138: in ms? Give s"
        if name in {"x", "y"} and not abs(value) < FARTHEST_M:
            return f"{name} {str(value)[:20]} is beyond 10,000 km: in m?"
    return f"id {read['id']!r} is nobody's"


class Moments:
    """Which moments have come: multiples of `every_s`, each once."""

    def __init__(self, every_s: float) -> None:
        self.every_s, self.last = every_s, math.nan

    def begin(self, t: float) -> None:
        """It is `t`: rows begin, or the clock has been set back. Of moments before nothing is known."""
        self.last = newest_moment(t, self.every_s, reached=False)

    def passed(self, t: float, reached: bool = False) -> float | None:
        """The newest moment before `t`, or, `reached`, at `t`, if it is a new one."""
        count = newest_moment(t, self.every_s, reached)
        if math.isnan(self.last) and not reached:
            self.begin(t)
        if count <= self.last:
            return None
        self.last = count
        return count * self.every_s


def forecasts(
    live: Live,
    source: Iterable[Sequence[bytes]],
    every_s: float,
    latest: bool = False,
    problem: Callable[[int, bytes, str], None] = lambda number, line, why: None,
) -> Iterator[tuple[float, Futures]]:
    """(t0, futures) at every moment that has come; with `latest` at most one for each batch of lines, the newest.

    `problem` is told the number, from 1, and the text of a line that is none, and why it is none.
    """
    moments, number = Moments(every_s), 0
    for lines in source:
        rows: list[Row] = []
        for line in lines:
            number += 1
            if not line.strip():
                continue
            row = row_of(line)
            if isinstance(row, str):
                live.counts["bad"] += 1
                problem(number, line, row)
            else:
                rows.append(row)
        chosen = _last_due(rows, copy.copy(moments), copy.copy(live.clock)) if latest else None
        for place, (t, who, x, y) in enumerate(rows):
            moment = None if live.clock.waits((t, who, x, y)) else moments.passed(t, reached=who is None)
            if moment is not None and chosen in (None, place):
                yield moment, live.forecast(moment)
            turns = live.clock.set_back
            if who is None:
                live.pass_time(t)
            else:
                live.see(t, who, x, y)
            if live.clock.set_back > turns:
                moments.begin(live.now)
    moment = moments.passed(live.now, reached=True) if math.isfinite(live.now) else None
    if moment is not None:
        yield moment, live.forecast(moment)


def _last_due(rows: Sequence[Row], moments: Moments, clock: Clock) -> int:
    """Place of the last row that a moment has come with; -1 where there is none."""
    last = -1
    for place, row in enumerate(rows):
        if not clock.waits(row) and moments.passed(row[0], reached=row[1] is None) is not None:
            last = place
        turns = clock.set_back
        clock.tell(row)
        if clock.set_back > turns:
            moments.begin(clock.now)
    return last


def text_of(
    t0: float, futures: Futures, live: Live, samples: int = 0, at_s: Sequence[float] = (), cell_m: float = 1.0
) -> str:
    """A forecast as a line of JSON, without its end.

    Of everyone the id, `path` (`futures.best`, a position in m for every `step_s` s after `t0`) and `left`, the
    probability of having left by then; so many `samples`, each as long as it is under way; and for each moment of
    `at_s` [s] the cells of `cell_m` that are occupied with a probability p of a hundredth or more: [x, y, p] with the
    cell's centre. How many are there of whom too little is known yet is `new`.
    """
    steps = counted_steps(futures.forecast.samples)
    left = (steps[:, :, None] < np.arange(1, len(futures.times_s) + 1)).mean(axis=1)
    people: list[dict[str, Any]] = [
        {"id": live.who[who], "path": path, "left": gone}
        for who, path, gone in zip(futures.track_id.tolist(), _rounded(futures.best, 3), _rounded(left, 3), strict=True)
    ]
    for number, one in enumerate(people):
        if samples:
            lived = steps[number, :samples].tolist()
            paths = _rounded(futures.paths[number, :samples], 3)
            one["samples"] = [path[:there] for path, there in zip(paths, lived, strict=True)]
    told: dict[str, Any] = {"t0": round(t0, 6), "step_s": futures.site.time_step_s, "people": people}
    told["new"] = live.present["new"]
    if at_s:
        occupancy = futures.occupancy(cell_m, live.extent)
        told["occupancy"] = [
            {"at_s": moment, "cells": _cells(occupancy, round(moment / futures.site.time_step_s) - 1)}
            for moment in at_s
        ]
    return json.dumps(told, separators=(",", ":"))


def _cells(occupancy: Occupancy, place: int) -> list[list[float]]:
    """[x, y, p] of the cells that are worth telling."""
    p = occupancy.probabilities[place]
    row, column = np.nonzero(p >= LEAST_SHOWN)
    x, y = ((cell + 0.5) * occupancy.cell_m + low for cell, low in zip((column, row), occupancy.origin, strict=True))
    return _rounded(np.column_stack([x, y, p[row, column]]), 3)


def _rounded(values: np.ndarray, digits: int) -> Any:
    """As lists; of doubles, since the digits of a float32 as a double are many."""
    return np.round(np.asarray(values, np.float64), digits).tolist()


def write_all(sink: int, text: str) -> None:
    """Write a line to a file descriptor, and wait for its reader as long as that takes."""
    left = memoryview(text.encode() + b"\n")
    while left:
        try:
            left = left[os.write(sink, left) :]
        except BlockingIOError:  # somebody has made it one that does not wait
            select.select([], [sink], [])


class Newest:
    """A writer that never waits: while the reader is busy, a line takes the place of the one before it.

    `skipped` counts these; `put` raises `BrokenPipeError` once the reader has gone.
    """

    def __init__(self, sink: int) -> None:
        self.skipped, self._sink = 0, sink
        self._line: str | None = None
        self._changed, self._ends, self._failed = threading.Condition(), False, False
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def put(self, line: str) -> None:
        """Have a line written when its turn comes."""
        with self._changed:
            if self._failed:
                raise BrokenPipeError
            self.skipped += self._line is not None
            self._line = line
            self._changed.notify()

    def close(self) -> None:
        """Wait until the last line is written."""
        with self._changed:
            self._ends = True
            self._changed.notify()
        self._thread.join()

    def _work(self):
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._line is not None or self._ends)
                line, self._line = self._line, None
            if line is None:
                return
            try:
                write_all(self._sink, line)
            except OSError:
                with self._changed:
                    self._failed = True
                return
