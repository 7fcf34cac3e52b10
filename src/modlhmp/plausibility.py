"""Whether a recording can be what is said of it: its units, rates, angles and ids against how people walk.

A check compares, and says with numbers what looks wrong and which option would answer it. Where the data would
otherwise be wrong the recording is refused; where they may be right there is a warning, and `strict` refuses as well.
A check of how people move needs `LEAST_MOVES` displacements of at least `LEAST_TRACKS` tracks.
"""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from modlhmp.account import Account
from modlhmp.file_format import CheckName, FileFormat, how_to_set
from modlhmp.motion import Moves, moves, recorded_agreement, recorded_ratio, returned_to
from modlhmp.readers.delimited import SPEED_MPS
from modlhmp.readers.hints import hint_of_rows, hint_of_units
from modlhmp.settings import as_plain
from modlhmp.site import MOST_STEP_S
from modlhmp.speed_units import explain, extent_of
from modlhmp.storage import DataError
from modlhmp.tracks import LEAST_JUMP_S, Tracks, usual_step

LOOKED_AT = 20_000  # rows, of whole tracks: how people move shows in some of them
LEAST_MOVES, LEAST_TRACKS, LEAST_ROWS, LEAST_JUMPS = 15, 2, 15, 3
STOP_MPS, WARN_MPS = (0.3, 3.0), (0.8, 1.8)  # median speeds outside are refused, or warned of
STOP_RATIO, WARN_RATIO = (0.5, 2.0), (0.7, 1.4)  # of recorded speeds to displacements
STOP_COSINE, WARN_COSINE = 0.4, 0.7  # mean, of recorded headings to displacements
SIDES_M = (1.0, 2000.0)
ABSURD, UNREADABLE, REPEATED, OUTSIDE, JUMPS, APART = 0.05, 0.2, 0.1, 0.1, 0.01, 1.5
UNREADABLE_STOP = 0.5
FLAT_M = 0.05  # people who walk spread further in either direction

Severity = Literal["stop", "warn"]
Told = tuple[Severity, str, str] | None  # severity, what looks wrong, what would answer it


class Finding(NamedTuple):
    """What a check found: `text` says what looks wrong, with numbers, `remedy` which option would answer it."""

    check: str
    severity: Severity
    text: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.check}: {self.text}; {self.remedy}; if it is right, set `accept: [{self.check}]`"


@dataclass(frozen=True)
class Evidence:
    """A recording as it was read, before anything is cut or dropped by a rule of cleaning; `rows` are of some tracks.

    `clock`: its times are unix times of the file, so that their unit is known.
    """

    rows: Tracks
    account: Account
    form: FileFormat
    clock: bool = False

    @cached_property
    def step_s(self) -> float:
        """The usual time between two rows of a track [s]."""
        return usual_step(self.rows)

    @cached_property
    def walk(self) -> Moves:
        """Displacements over about a second of those who move."""
        tracks = max(len(self.rows.bounds()) - 1, 1)
        longest = len(self.rows.t) // tracks // 4  # in rows; a wrong rate would ask for too many
        apart = round(1 / self.step_s) if self.step_s > 0 else 1
        return moves(self.rows, min(max(apart, 1), max(longest, 1), 30))

    @cached_property
    def around(self) -> Moves:
        """Displacements from the row before to the row after, where the row itself has a speed and a heading."""
        return moves(self.rows, 2)

    def enough(self, found: Moves) -> bool:
        """Whether these displacements are evidence."""
        return len(found.speed) >= LEAST_MOVES and len(np.unique(self.rows.track_id[found.row])) >= LEAST_TRACKS


def absurd_rows(seen: Evidence) -> Told:
    """Rows with positions or speeds that no person can have, which the reader drops."""
    account, read = seen.account, max(seen.account.rows_read, 1)
    known: dict[str, tuple[int, float]] = {
        what: account.beyond[what] for what in ("distance", "speed") if what in account.beyond
    }
    uncounted = 0 if account.beyond else account.dropped_rows["absurd_value"]  # by readers that do not say what of
    count = max([one for one, _ in known.values()], default=uncounted)
    if seen.account.rows_read < LEAST_ROWS or count <= ABSURD * read:
        return None
    first = account.first_seen.get("absurd_value", "none is kept")
    remedy = hint_of_units(known, 0) or "correct `units`, `scale` or `frame_rate`"
    if count < 0.5 * read:
        remedy += '; or name values that mean "not seen" as `missing`'
    return "stop", f"{count / read:.0%} of the rows are dropped as absurd (first: {first})", remedy


def unreadable_rows(seen: Evidence) -> Told:
    """Lines that could not be read as rows."""
    account, reasons = seen.account, ("text_value", "wrong_column_count", "no_track_id")
    dropped = {reason: account.dropped_rows[reason] for reason in reasons if account.dropped_rows[reason]}
    if account.rows_read < LEAST_ROWS or sum(dropped.values()) <= UNREADABLE * account.rows_read:
        return None
    first = next((account.first_seen[reason] for reason in dropped if reason in account.first_seen), "none is kept")
    told = f"{sum(dropped.values()) / account.rows_read:.0%} of the lines are dropped: {dropped} (first: {first})"
    form = seen.form
    layout = {**as_plain(form), "separator": None if form.reader == "text" else form.separator}
    known = hint_of_rows(account.unread, layout)
    nobodys = dropped.get("no_track_id", 0)  # were read
    severity: Severity = "stop" if sum(dropped.values()) - nobodys > UNREADABLE_STOP * account.rows_read else "warn"
    others = "correct `separator`, `decimal`, `thousands`, `columns`, `comment`, or choose rows with `only`"
    return severity, told, f"the file {known}" if known else others


def repeated_rows(seen: Evidence) -> Told:
    """Rows of the same id and time, of which the first one counts."""
    remedy = "name all columns that make an id in `columns: {track_id: [...]}`, or a finer column of time"
    return _dropped(seen, "duplicate_row", REPEATED, "have the id and the time of another row", remedy)


def glued_files(seen: Evidence) -> Told:
    """Files that were put one after the other, so that the people of one are taken for those of another."""
    account, told = seen.account, []
    headers, repeated = account.dropped_rows["header_again"], account.dropped_rows["duplicate_row"]
    if headers:
        told.append(
            f"the header stands again in the middle ({headers} times, first: {account.first_seen['header_again']})"
        )
    if repeated and account.starts_anew:
        told.append(f"times start anew in the middle ({account.starts_anew} times)")
    if not told:
        return None
    lost = f", and {repeated} rows with the id and time of an earlier one are dropped" if repeated else ""
    remedy = "were files put one after the other? Give each by itself, as it was, in `recordings`"
    return "warn", " and ".join(told) + lost, remedy


def outside_day(seen: Evidence) -> Told:
    """Rows before or after the recording's day."""
    remedy = "set `days: 2` if it goes on after midnight, or correct `day`, `start` or `timezone`"
    return _dropped(seen, "outside_day", OUTSIDE, "are before or after the recording's day", remedy)


def _dropped(seen: Evidence, reason: str, limit: float, told: str, remedy: str) -> Told:
    """A warning of rows that the reader dropped for a reason, where they are more than a share of all."""
    read, count = seen.account.rows_read, seen.account.dropped_rows[reason]
    if read < LEAST_ROWS or count <= limit * read:
        return None
    return "warn", f"{count / read:.0%} of the rows {told}, and are dropped", remedy


def walking_speed(seen: Evidence) -> Told:
    """The median speed of those who move."""
    if not seen.enough(seen.walk):
        return None
    median = float(np.median(seen.walk.speed))
    if WARN_MPS[0] <= median <= WARN_MPS[1]:
        return None
    told = (
        f"people who move do so at {median:.3g} m/s in the middle, over {len(seen.walk.speed)} displacements of about "
        f"{seen.walk.seconds:.3g} s; {WARN_MPS[0]:g} to {WARN_MPS[1]:g} are usual"
    )
    options = explain(median, seen.rows, seen.form, seen.clock)
    severity: Severity = "warn" if STOP_MPS[0] <= median <= STOP_MPS[1] else "stop"
    return severity, told, options or "correct the units of length and time, `frame_rate` or `scale`"


def recorded_speed(seen: Evidence) -> Told:
    """The file's speeds by those of displacements."""
    if not seen.form.has_velocity or not seen.enough(seen.around):
        return None
    ratio, walked = recorded_ratio(seen.rows, seen.around)
    if not np.isfinite(ratio) or WARN_RATIO[0] <= ratio <= WARN_RATIO[1]:
        return None
    now = SPEED_MPS.get(seen.form.units.speed or "", 0.0) or seen.form.metres
    known = [
        f"`units: {{speed: {unit}}}`"
        for unit, factor in SPEED_MPS.items()
        if WARN_RATIO[0] <= ratio * factor / now <= WARN_RATIO[1] and factor != now
    ]
    told = f"the file's speeds are {ratio:.3g} times those of its displacements ({walked:.3g} m/s in the middle)"
    severity: Severity = "stop" if known or not STOP_RATIO[0] <= ratio <= STOP_RATIO[1] else "warn"
    others = "correct `units`, or leave speed and heading out of `columns`"
    return severity, told, f"{' or '.join(known)} would explain it" if known else others


def recorded_heading(seen: Evidence) -> Told:
    """The file's headings against the directions of displacements."""
    count, median = seen.account.beyond.get("heading", (0, 0.0))
    if count > ABSURD * seen.account.rows_read >= ABSURD * LEAST_ROWS:
        told = f"{count / seen.account.rows_read:.0%} of the headings are beyond a whole turn ({median:.3g} rad)"
        fits = seen.form.units.angle == "rad"
        return "stop", told, "set `units: {angle: deg}`" if fits else "leave speed and heading out of `columns`"
    if not seen.form.has_velocity or not seen.enough(seen.around):
        return None
    now, best, option = recorded_agreement(seen.rows, seen.around, seen.form.units)
    if not np.isfinite(now) or now >= WARN_COSINE:
        return None
    told = f"the file's headings do not follow its displacements: the mean cosine between them is {now:.2f}"
    if best >= WARN_COSINE:
        return "stop", told, f"with {option} it would be {best:.2f}"
    severity: Severity = "stop" if now < STOP_COSINE else "warn"
    return severity, told, "leave speed and heading out of `columns`, so that positions tell both"


def time_step(seen: Evidence) -> Told:
    """The usual time between rows by the time step."""
    step, wanted = seen.step_s, seen.form.time_step_s
    if len(seen.rows.t) < LEAST_ROWS or not step > APART * wanted:
        return None
    told = f"rows of a track are usually {step:.3g} s apart, the time step is {wanted:g} s: most rows would be made up"
    return "warn", told, step_of(step)


def clock_digits(seen: Evidence) -> Told:
    """Clock times such as 090000.5 read as seconds: they skip 40 s after each minute, and 4000 s after each hour."""
    if not are_clock_digits(seen.rows.t):
        return None
    told = (
        f"times such as {seen.rows.t[0]:06.0f} have no second or minute from 60 to 99: are they of a clock, 09:00:00?"
    )
    return "stop", told, "write them as 2026-03-02T09:00:00.5 (`units: {time: iso}`), or as seconds since midnight"


def are_clock_digits(t: np.ndarray) -> bool:
    """Whether numbers are 90102.5 for 9:01:02.5, maybe of thousandths: many minutes with no second from 60 to 99."""
    for digits in (1, 1000):
        minute, second = np.divmod(np.unique(t[np.isfinite(t)] // digits), 100)
        within = (second < 60) & (minute % 100 < 60) & (minute // 100 % 100 < 24)
        if within.all() and len(np.unique(second)) >= 30 and len(np.unique(minute)) >= 3:
            return True
    return False


def step_of(usual_s: float) -> str:
    """What to do about rows that are usually so far apart [s]."""
    if usual_s > MOST_STEP_S:
        return f"a row every {MOST_STEP_S:g} s is needed at least: are times in another unit (`units`, `frame_rate`)?"
    return f"set `time_step_s: {usual_s:.3g}`"


def extent(seen: Evidence) -> Told:
    """How large the place is, and whether it has two dimensions."""
    if seen.enough(seen.walk):
        spread = {name: np.ptp(part) for name, part in (("x", seen.rows.x), ("y", seen.rows.y))}
        flat = min(spread, key=lambda name: spread[name])
        if spread[flat] < FLAT_M < SIDES_M[0] < max(spread.values()):
            told = f"all {flat} are within {spread[flat]:.2g} m: is that the height of something?"
            return "warn", told, "correct `columns`"
    if not seen.enough(seen.walk) or SIDES_M[0] <= (side := extent_of(seen.rows)) <= SIDES_M[1]:
        return None
    return "warn", f"98 % of all rows are within {side:.3g} m", "correct `units: {length: ...}`, `scale` or `origin_m`"


def jumps(seen: Evidence) -> Told:
    """Displacements that nobody makes: an id has gone over to somebody else."""
    rows, limit = seen.rows, seen.form.max_jump_mps or 15.0
    same = np.diff(rows.track_id) == 0
    seconds = np.maximum(np.diff(rows.t)[same], LEAST_JUMP_S)
    jumped = int((np.hypot(np.diff(rows.x), np.diff(rows.y))[same] > limit * seconds).sum())
    if len(seconds) < LEAST_ROWS or jumped < LEAST_JUMPS or jumped <= JUMPS * len(seconds):
        return None
    told = f"{jumped} of {len(seconds)} displacements ({jumped / len(seconds):.0%}) are faster than {limit:g} m/s"
    return "warn", told, "do ids change hands? Check `columns: {track_id: ...}`; tracks are cut there (`max_jump_mps`)"


def not_measured(seen: Evidence) -> Told:
    """Rows at one and the same position, from which people jump back: a number that stands for "not seen"."""
    at, x, y = returned_to(seen.rows)
    count, form = int(at.sum()), seen.form
    if len(at) < LEAST_ROWS or count < LEAST_JUMPS or count <= JUMPS * len(at):
        return None
    told = f"{count / len(at):.1%} of the rows are at exactly x {x:g} m, y {y:g} m, where people jump to and from"
    if form.homography is not None or form.reader not in ("delimited", "text"):
        return "stop", told, 'do they mean "not seen"? Name what the file has there as `missing`'
    east, north = form.origin_m or (0, 0)
    values = [round((part + begin) / form.metres, 6) + 0.0 for part, begin in ((x, east), (y, north))]
    return "stop", told, 'if they mean "not seen", set `missing: {{x: {:.12g}, y: {:.12g}}}`'.format(*values)


@dataclass(frozen=True)
class Check:
    """A check, for the tables: what it compares, when it stops and when it warns, and the options that answer it."""

    name: CheckName
    compares: str
    severity: str
    remedy: str
    of: Callable[[Evidence], Told] | None = field(default=None, repr=False)  # None: of whole datasets


CHECKS = (
    Check("absurd_rows", "rows farther than 10 km away or faster than 15 m/s, which are dropped", "stops above 5 %",
          "`units`, `scale`, `origin_m`", absurd_rows),
    Check("unreadable_rows", "lines that are no rows of numbers and an id, which are dropped",
          "warns above 20 %, stops where more than half cannot be read",
          "`separator`, `decimal`, `thousands`, `columns`, `comment`, `only`", unreadable_rows),
    Check("walking_speed", "median speed of those who move, over about a second",
          "warns outside 0.8 to 1.8 m/s, stops outside 0.3 to 3",
          "`units: {length, time}`, `frame_rate`, `scale`, `row_stride`", walking_speed),
    Check("recorded_speed", "the file's speeds by those of displacements",
          "warns outside 0.7 to 1.4, stops outside 0.5 to 2, or where a unit explains it",
          "`units: {speed}`, `columns`", recorded_speed),
    Check("recorded_heading", "the file's headings against displacements: the mean cosine between them",
          "warns below 0.7, stops below 0.4, where a convention explains it, or beyond a whole turn",
          "`units: {angle, heading}`, `columns`", recorded_heading),
    Check("time_step", "the usual time between two rows by the time step", "warns above 1.5", "`time_step_s`",
          time_step),
    Check("clock_digits", "clock times such as 090000 for 09:00:00, read as seconds: no second or minute from 60 to 99",
          "stops from the third minute", "`columns: {t}`", clock_digits),
    Check("outside_day", "rows before or after the recording's day, which are dropped", "warns above 10 %",
          "`days`, `day`, `start`, `timezone`", outside_day),
    Check("extent", "size of the place, without the outermost 1 % of rows on each side; and of both axes",
          "warns outside 1 m to 2 km, and where an axis is flat", "`units: {length}`, `scale`, `origin_m`, `columns`",
          extent),
    Check("jumps", "displacements faster than `max_jump_mps` (15 m/s)", "warns above 1 %",
          "`columns: {track_id}`, `max_jump_mps`", jumps),
    Check("glued_files", "the header again in the middle of a file; or times that start anew there, in a file by time, "
          "with rows of the id and time of an earlier one, which are dropped", "warns from the first", "`recordings`",
          glued_files),
    Check("not_measured", "rows at one and the same position that people jump to and from", "stops above 1 %",
          "`missing`", not_measured),
    Check("repeated_rows", "rows with the id and time of another one, which are dropped", "warns above 10 %",
          "`columns: {track_id, t}`", repeated_rows),
    Check("shared_people", "test tracks that are in the training recordings as well: the same positions in the same "
          "order, or one id going on within 5 s, or two time steps, of the same day",
          "warns from the first, stops above 1 %",
          "`recordings`, `split`"),
    Check("copied_recording", "recordings of one split with walks in common: the same positions in the same order",
          "warns above 1 %, stops above half", "`recordings`"),
    Check("untrained_place", "test rows in 1 m cells with training rows", "warns below half, stops below a tenth",
          "`recordings`, `units`, `origin_m`"),
    Check("horizon", "how long test tracks last after what is observed", "warns where none lasts `horizon_s`",
          "`horizon_s`, `observed_rows`"),
    Check("hours", "training rows in every hour of `hours`", "warns where an hour has none",
          "`hours`, `timezone`, `start`"),
)  # fmt: skip
# What other checks only repeat.
_SAYS = {"walking_speed": {"extent", "jumps"}, "not_measured": {"jumps"}, "glued_files": {"repeated_rows"}}


def check_recording(rows: Tracks, account: Account, form: FileFormat, clock: bool = False) -> list[Finding]:
    """What looks wrong about a recording as `read_recording` returns it, in the order of `CHECKS`.

    `clock`: its times are unix times of the file, not counted from a start.
    """
    seen, found = Evidence(_of_some_tracks(rows), account, form, clock), list[Finding]()
    for check in CHECKS:
        told = check.of(seen) if check.of else None
        if told is not None:
            severity, text, remedy = told
            found.append(Finding(check.name, severity, text, remedy + how_to_set(remedy, form)))
    said = set().union(*(_SAYS.get(one.check, set()) for one in found))
    return [one for one in found if one.check not in said]


def _of_some_tracks(rows: Tracks) -> Tracks:
    """The rows of every so many tracks, about `LOOKED_AT` in all."""
    every, bounds = -(-len(rows.t) // LOOKED_AT), rows.bounds()
    if every <= 1:
        return rows
    return rows.take(np.repeat(np.arange(len(bounds) - 1) % every == 0, np.diff(bounds)))


def ask_about(source: object, findings: Iterable[Finding], form: FileFormat) -> list[str]:
    """Findings that are not accepted: `DataError` that names `source` for those that stop, a loud warning for others.

    Returns the warnings.
    """
    open_ones = [one for one in findings if one.check not in form.accept]
    stops = [one for one in open_ones if one.severity == "stop" or form.strict]
    if stops:
        strict = " (`strict: true`)" if all(one.severity == "warn" for one in stops) else ""
        raise DataError(f"{source}: looks wrong{strict}:\n  " + "\n  ".join(map(str, stops)))
    for one in open_ones:
        logging.getLogger("modlhmp").warning("WARNING: %s: %s", source, one)
    return [str(one) for one in open_ones]
