"""Forecasts of people whose positions stream in: what is known at a moment decides, whatever comes late or never.

How rows that are late, repeated, out of order or impossible are treated is a table in docs/live.md; each is counted.
Memory is bounded: by how many people, by how many rows of each, and by how old these are; where a map learns, also by
the rows of an hour, a time step apart.
"""

import logging
import math
from array import array
from bisect import bisect_left
from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np

from modlhmp.api import Map, predictor
from modlhmp.arguments import LATEST_S, free_kind, unix_time, uses_recorded
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.observe import Observed
from modlhmp.futures import Futures
from modlhmp.ids import id_of, is_missing, is_nobodys
from modlhmp.kinds import find
from modlhmp.live_clock import Clock, Row
from modlhmp.live_map import RECORDING, Learner, is_jump, learned
from modlhmp.settings import as_plain, fields_of
from modlhmp.storage import DataError, column
from modlhmp.time_step import GONE, HERE, NEW, ending_at
from modlhmp.tracks import Tracks, gap_limit
from modlhmp.updates import UpdatedMap

MOST_PEOPLE = 1000
MOST_ROWS = 1024  # of a person; 9 s at 100 Hz are fewer
FARTHEST_M = 1e7  # of a position; one beyond is no position in m
COUNTED = (
    "taken", "bad", "late", "ahead", "repeated", "out_of_order", "thinned", "turned_away", "cut_at_gap", "cut_at_jump",
    "clock_set_back", "forecasts",
)  # fmt: skip


class _Person:
    """The newest rows of one person, by rising time."""

    __slots__ = ("given", "rows", "track_id")

    def __init__(self, given: Any, text: str) -> None:
        self.given, self.track_id = given, id_of(text)
        self.rows = array("d"), array("d"), array("d")  # t, x, y

    def drop(self, number: int) -> None:
        """Without the oldest rows."""
        for part in self.rows:
            del part[:number]

    def thin(self) -> int:
        """Without every second row, the newest being kept; returns how many those are."""
        before = len(self.rows[0])
        for part in self.rows:
            part[:] = part[::-2][::-1]
        return before - len(self.rows[0])

    def jumps(self, at: int, t: float, x: float, y: float) -> bool:
        """Whether nobody gets from the row before place `at`, or to the row there, in that time."""
        beside = zip(*(part[max(at - 1, 0) : at + 1] for part in self.rows), strict=True)
        return any(is_jump(t1, x1, y1, t, x, y) for t1, x1, y1 in beside)


class Live:
    """Forecasts of people as they are seen.

        live = modlhmp.Live(modlhmp.load_map("map.parquet"))
        for t, who, x, y in rows:              # unix s, any id, m; any rate, any order
            live.see(t, who, x, y)
        futures = live.forecast()              # of everyone who is there now, at live.now
        [live.who[one] for one in futures.track_id]

    The arguments are those of `modlhmp.forecast`. Two defaults differ, where a method has the option: everyone is asked
    who is there, so `samples` are of `pieces`; and there are positions alone, so `velocity` is of `differences` where
    the site's is `as_recorded`. `options` are all of the method's: the batch forecast of a track that ends at t0,

        modlhmp.forecast(a_map, track, live.horizon_s, seed=0, **live.options)

    is the same to the bit, given what `seed`, `key` and `site` were given to `Live`. Rows up to t0 alone count
    (`time_step.ending_at`). Not for several threads at once.

    `counts` say what became of the rows, `present` who was `here`, `new` (too few rows yet) or `gone` at the last
    forecast, `who` {track id of the futures: the id that was given} of those who were here; `extent` is the map's,
    (x low, x high, y low, y high) [m], for grids that stay the same, None where there is no map.

    `by` may be an `UpdatedMap`: then it is told of who is seen, at every full hour (`live_map`), before the forecast:
    of all up to the first moment of the new hour, once time goes on or a forecast is asked. `recording` names the
    stream there: ids that two streams share are two people, in maps that are merged.
    """

    def __init__(
        self, /, by: Map | UpdatedMap | str, horizon_s: float | None = None, seed: int = 0, *,
        most_people: int = MOST_PEOPLE, recording: str = RECORDING, **asked: Any,
    ) -> None:  # fmt: skip
        if not isinstance(most_people, int | np.integer) or isinstance(most_people, bool) or most_people < 1:
            raise DataError(f"most_people {most_people!r}: give a whole number of at least 1")
        if not isinstance(recording, str):
            raise DataError(f"Live: recording {recording!r}: give a name")
        if recording != RECORDING and not isinstance(by, UpdatedMap):
            raise DataError(
                f"Live: recording {recording!r}: its map does not learn: give an UpdatedMap (a state of `modlhmp map "
                "update`), or no name"
            )
        self._learner = Learner(by, recording) if isinstance(by, UpdatedMap) else None
        self._used = self._wanted = 0  # version of the learned map, of the forecasts and of the last full hour
        by = learned(by) if isinstance(by, UpdatedMap) else by
        asked = {"horizon_s": horizon_s, "seed": seed, **_defaults(by, asked.get("site")), **asked}
        self._predictor, self._asked = predictor(by, **asked), asked
        site = self._predictor.site
        if uses_recorded(self._predictor.options, site):
            raise DataError("Live: positions are all that it is told; use velocity='differences'")
        self.site, self.extent, self.horizon_s = site, _extent_of(by), self._predictor.steps * site.time_step_s
        self.options = as_plain(self._predictor.options)
        if isinstance(asked.get("exits"), Map):
            self.options["exits"] = asked["exits"]
        self.counts = dict.fromkeys(COUNTED, 0)
        self.present = {"here": 0, "new": 0, "gone": 0}
        self.who: dict[int, Any] = {}
        self._told_ahead = self._told_unfit = False
        self._gap_s = gap_limit(site.time_step_s)
        # What a forecast at most a step before now may need: the grid, and a row before its beginning.
        self._kept_s = site.observed_rows * site.time_step_s + self._gap_s
        # Who is alone waits for no longer than for a first forecast.
        self.clock = Clock(self._kept_s, self._gap_s, (site.observed_rows - 1) * site.time_step_s)
        self._most_people, self._swept = int(most_people), -math.inf
        self._people: dict[str, _Person] = {}

    @property
    def now(self) -> float:
        """The time of the newest row [unix s], but for those from far ahead (`ahead` in `counts`)."""
        return self.clock.now

    def see(self, t: float, who: int | str, x: float, y: float) -> str:
        """Take a row: somebody was at (x, y) [m] at t [unix s]; returns "", or why it was not taken, as in `counts`.

        A row from far ahead waits: that is "", and counted as `ahead` unless it is taken later.
        """
        if is_row(t, who, x, y):
            return self._enter((float(t), who, float(x), float(y)))
        self.counts["bad"] += 1
        return "bad"

    def pass_time(self, t: float) -> str:
        """It is t [unix s] now, whether anybody is seen or not; returns "", or why that is not so, as `see` does."""
        if is_row(t, 0, 0.0, 0.0):
            return self._enter((float(t), None, 0.0, 0.0))
        self.counts["bad"] += 1
        return "bad"

    def _enter(self, row: Row) -> str:
        """Let time go on, or back, with a row, and take what it decides; returns why the row is not taken, if not."""
        before, turns = self.now, self.clock.set_back
        decided = self.clock.tell(row)
        if self.clock.set_back > turns:
            self.counts["clock_set_back"] += 1
            if self._learner:
                self._learn(self._learner, before)
                self._learner.forget(math.inf)
            self._people.clear()
            before = self._swept = -math.inf
        if self.now - self._swept >= self._gap_s:
            self._sweep()
        waits, why = not decided or decided[-1][1] is not row, ""
        self.counts["ahead"] += waits
        for refused, one in decided:
            if not refused and one[0] > before:
                self._learn_if_due(before)
                before = one[0]
            why = refused or self._take(*one)
            if refused and one is not row:  # it has waited, and is counted
                self._tell_of_ahead(*one[:2])
                continue
            self.counts["ahead"] -= one is not row
            if why or one[1] is not None:
                self.counts[why or "taken"] += 1
        return "" if waits else why

    def _let_in(self, waiting):
        """Take rows that wait: time has gone on to the last of them."""
        if waiting:
            self._enter((waiting[-1][0], None, 0.0, 0.0))

    def _tell_of_ahead(self, t, who):
        if not self._told_ahead:
            self._told_ahead = True
            logging.getLogger("modlhmp").warning(
                "Live: a row of %r is %.4g s ahead of everybody else: such rows are left out, and counted as `ahead`",
                who, t - self.now,
            )  # fmt: skip

    def _learn_if_due(self, now):
        """Tell the map of what has been seen once an hour is over, whether anybody asks for forecasts or not."""
        if self._learner and self._learner.due(now):
            self._learn(self._learner, now)

    def _learn(self, learner, now):
        learner.learn(now)
        self._wanted = learner.version

    def _take(self, t, who, x, y):
        """Give a row to its person; returns why not, if not."""
        if who is None:
            return ""
        text = str(who)
        person = self._people.get(text)
        if person is None:
            if len(self._people) >= self._most_people and self.now > self._swept:
                self._sweep()
            if len(self._people) >= self._most_people:
                return "turned_away"
            person = self._people[text] = _Person(who, text)
        why = self._add(person, t, x, y)
        if self._learner and not why:
            self._learner.see(t, who, x, y)
        return why

    def forecast(self, t0: float | None = None) -> Futures:
        """The futures of everyone who is there at `t0` (unix s; default: `now`), in the order in which they came.

        Without a t0, where rows wait that are likely to be right (`Clock.likely`), it is of their time instead: whoever
        was there before is silent, and who has come is `new`. A row from the present ends that.

        `DataError` for a time of which rows have been forgotten, more than a time step before `now`.
        """
        if t0 is None and self.now == -math.inf:
            raise DataError("Live.forecast: nobody has been seen yet; give rows to `see` first, or a t0")
        ahead = self.clock.likely(self._people) if t0 is None else ()
        t0 = self.now if t0 is None else unix_time("Live.forecast: t0", t0)
        if t0 < self.now - self.site.time_step_s:
            raise DataError(
                f"Live.forecast: t0 {t0:.3f} is {self.now - t0:.3g} s before the newest row; what a forecast needs is "
                f"kept for one time step, {self.site.time_step_s:g} s"
            )
        self._let_in([one for one in self.clock.waiting if one[0] <= t0])  # who asks says that it is that late
        self._learn_if_due(self.now)
        if self._learner and self._used != self._wanted:
            self._predictor, self._used = predictor(learned(self._learner.kept), **self._asked), self._wanted
        known = self._people
        if ahead:  # as if they were taken
            who, t0 = ahead[0][1], ahead[-1][0]
            newcomer = _Person(who, str(who))
            for part, place in zip(newcomer.rows, (0, 2, 3), strict=True):
                part.extend(row[place] for row in ahead)
            known = {**known, str(who): newcomer}
        people = [person for person in known.values() if len(person.rows[0])]
        seen, state = ending_at(_tracks_of(people), t0, self.site.time_step_s, self.site.observed_rows)
        number = np.bincount(state, minlength=3)
        self.present = {"here": int(number[HERE]), "new": int(number[NEW]), "gone": int(number[GONE])}
        here = [people[one] for one in np.flatnonzero(state == HERE)]
        self.who = {person.track_id: person.given for person in here}
        n, rows = len(here), self.site.observed_rows
        observed = Observed(  # of whom nobody is near
            seen.track_id[::rows],
            *(part.reshape(n, rows) for part in seen[1:]),
            np.empty((n, 0, rows, 2)),  # type: ignore[call-arg]
        )
        futures = self._predictor.futures(observed) if n else self._nobody()
        self.counts["forecasts"] += 1
        if not self._told_unfit and (why := self._predictor.unfit(futures)):
            self._told_unfit = True
            logging.getLogger("modlhmp").warning("Live: %s; told once", why)
        return futures

    def _nobody(self):
        steps, none = self._predictor.steps, np.empty(0)
        forecast = Forecast(
            np.empty((0, 1, steps, 2), np.float32),
            np.empty((0, 1, steps), np.float32),
            np.empty((0, 1), np.int32),
            "single",
        )
        return Futures(none.astype(np.int64), none, np.empty((0, 2)), forecast, self.site)

    @property
    def learns(self) -> bool:
        """Whether its map is kept up to date."""
        return self._learner is not None

    def updated(self) -> UpdatedMap:
        """The map that is kept up to date, told of all that has been seen so far.

        Rows that wait are taken first, if they are likely to be right (`Clock.likely`).
        """
        if self._learner is None:
            raise DataError("Live.updated: its map is not kept up to date; make it of an UpdatedMap")
        self._let_in(self.clock.likely(self._people))
        if math.isfinite(self.now):
            self._learner.learn(self.now)
        return self._learner.kept

    def warm_up(self) -> None:
        """Load what the first forecast would wait for, and compile it where it never has been."""
        step_s, rows, x = self.site.time_step_s, self.site.observed_rows, 0.0 if self.extent is None else self.extent[0]
        y = 0.0 if self.extent is None else (self.extent[2] + self.extent[3]) / 2
        nan = np.full((24, rows), np.nan)
        # Somebody walks in at every hour of a day, since some hours may have no map.
        t = 3600.0 * np.arange(24)[:, None] + step_s * np.arange(rows)
        seen = Observed(np.arange(24), t, x + t - t[:, :1], np.full_like(t, y), nan, nan, np.empty((24, 0, rows, 2)))
        replace(self._predictor.futures(seen), t0=np.zeros(24)).occupancy(extent=(x, x + 1, y, y + 1))
        ending_at(_tracks_of([]), 0.0, step_s, rows)

    def _add(self, person, t, x, y):
        """Put a row into its place; returns why not, if not."""
        times = person.rows[0]
        at = len(times) if not len(times) or t > times[-1] else bisect_left(times, t)
        if at < len(times):
            if times[at] == t:
                return "repeated"
            if person.jumps(at, t, x, y):
                return "bad"
            self.counts["out_of_order"] += 1
        elif at:
            cut = "cut_at_gap" if t - times[-1] > self._gap_s else "cut_at_jump" if person.jumps(at, t, x, y) else ""
            if cut:
                self.counts[cut] += 1
                person.drop(at)
                at = 0
        for part, value in zip(person.rows, (t, x, y), strict=True):
            part.insert(at, value)
        if times[0] < self.now - 2 * self._kept_s:
            person.drop(bisect_left(times, self.now - self._kept_s))
        if len(times) > MOST_ROWS:
            person.drop(bisect_left(times, self.now - self._kept_s))
        if len(times) > MOST_ROWS:
            self.counts["thinned"] += person.thin()
        return ""

    def _sweep(self):
        """Forget those who have not been seen for so long that they would begin anew."""
        self._swept = self.now
        gone = [
            text for text, one in self._people.items() if not one.rows[0] or one.rows[0][-1] < self.now - self._kept_s
        ]
        for text in gone:
            del self._people[text]
        if self._learner:  # no row that is still taken is less than a gap after what was then
            self._learner.forget(self.now - self._kept_s - self._gap_s)


def is_row(t: Any, who: Any, x: Any, y: Any) -> bool:
    """Whether t, x and y are numbers that can be a time [unix s] and a position [m], and `who` can be an id."""
    if not isinstance(who, str | Real) or isinstance(who, bool):
        return False
    if is_missing(str(who)) or is_nobodys(str(who)) or str(who) in ("inf", "-inf"):
        return False
    if not all(isinstance(one, Real) and not isinstance(one, bool) for one in (t, x, y)):
        return False
    try:
        str(who).encode("utf-8", "surrogateescape")  # which half a surrogate pair cannot be
    except UnicodeEncodeError:
        return False
    return abs(t) < LATEST_S and abs(x) < FARTHEST_M and abs(y) < FARTHEST_M  # False for NaN


def _tracks_of(people: list[_Person]) -> Tracks:
    """Their rows as a track table, person by person."""
    if not people:
        return Tracks(np.empty(0, np.int64), *np.empty((5, 0)))
    t, x, y = (np.concatenate([np.frombuffer(one.rows[part]) for one in people]) for part in range(3))
    counts = [len(one.rows[0]) for one in people]
    unknown = np.full(len(t), np.nan)
    return Tracks(np.repeat(np.array([one.track_id for one in people], np.int64), counts), t, x, y, unknown, unknown)


def _defaults(by: Any, site: Any) -> dict[str, str]:
    """The options whose default is another one here: everyone is asked who is there, and positions alone are known."""
    record, site = (find(by.kind), by.site) if isinstance(by, Map) else (free_kind(by), site)
    names = {option for option, *_ in fields_of(record.options)}
    found = {"samples": "pieces"} if record.name in {"episodes", "pooled"} else {}
    if "velocity" in names and getattr(site, "velocity", "") == "as_recorded":
        logging.getLogger("modlhmp").warning(
            "Live: the site has recorded velocities, but a stream has positions alone: velocity is `differences`"
        )
        found["velocity"] = "differences"
    return found


def _extent_of(by: Any) -> tuple[float, float, float, float] | None:
    """What a map covers, to a metre."""
    if not isinstance(by, Map):
        return None
    tables = [table for table in (by.whole, *by.hours.values()) if table is not None and len(table)]
    tables = [table for table in tables if {"x", "y"} <= set(table.column_names)]
    if not tables:
        return None
    x, y = (np.concatenate([column(table, axis) for table in tables]) for axis in ("x", "y"))
    return float(np.floor(x.min())), float(np.ceil(x.max())), float(np.floor(y.min())), float(np.ceil(y.max()))
