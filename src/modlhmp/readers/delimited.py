"""Any recording in delimited text: one row per person and time, columns by name or position, units as said.

The ATC readers are layouts of this one. Files are read in blocks; where rows carry velocities, each block is at
once reduced to the last sample of every person and time step, so memory does not follow the raw rate.
"""

import difflib
import logging
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.account import Account
from modlhmp.angles import by_convention, wrap_angle
from modlhmp.clock import unix_time, utc_offset
from modlhmp.file_format import LENGTH_M
from modlhmp.ids import NOBODYS, is_missing, is_nobodys
from modlhmp.readers.columns import NO_ID, read_columns
from modlhmp.readers.hints import hint, hint_of_rows, hint_of_units
from modlhmp.readers.numerals import number
from modlhmp.readers.raw import People, line_blocks
from modlhmp.storage import DataError
from modlhmp.time_step import jumped, last_of_step, without_repeats
from modlhmp.tracks import Tracks, concatenate, empty_tracks

MAX_DISTANCE_M = 10_000.0  # farther from the origin, or faster, is a sensor fault, not a walking person
MAX_SPEED_MPS = 15.0
MAX_HEADING_RAD = 100.0
MOST_TEXTS = 10_000  # of a column that rows are chosen by, which are remembered for messages
NEAR = 0.7  # to a mistyped text, as difflib has it: child is near to chidl, but man not to van
WHOLE_TURN_RAD = 8.0  # beyond it lies no angle from -pi to pi, or 0 to 2 pi, whatever it is measured from
SPEED_MPS = {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001, "km/h": 1 / 3.6}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_LOG = logging.getLogger("modlhmp")
FIELDS = ("track_id", "t", "x", "y", "speed", "heading")


class OtherFrameError(DataError):
    """Positions are together, but far from the origin, which `origin_m` [whole m of the file's frame] would move."""

    def __init__(self, message: str = "", origin_m: tuple[int, int] = (0, 0)) -> None:
        super().__init__(message)
        self.origin_m = origin_m


def read_delimited(
    path: str | Path | People, layout: Mapping[str, Any], day: tuple[float, float] | None = None, step_s: float = 1.0
) -> tuple[Tracks, Account]:
    """Read a file into rows sorted by track and time.

    `layout` holds `columns` (field -> position from 0, or name with `header: true`), `width` (columns per row, None:
    as the first row has), `ids` (`text`: any; else whole numbers), `separator` (None: blanks), `header`, `decimal`,
    `thousands`, `comment`, `skip_lines`, `units` (as `file_format.Units`), `missing`, `only`, `scale` [m/px],
    `frame_rate` [1/s], `origin` (unix time of time 0), `timezone`, `homography`, `origin_m`, `min_heading_mps`,
    `max_jump_mps`. `day` = (first, last) unix second of the recording's day; rows outside are dropped. With speed and
    heading columns the last sample of each `step_s` is kept, and jumps between rows are noted. Returns (Tracks,
    Account).
    """
    account, pieces, newest = Account(), [], empty_tracks()
    has_velocity = "speed" in layout["columns"]
    chosen = {f"{key}:{column}": (key, column) for key in ("only", "without") for column in layout.get(key) or {}}
    positions = {field: int(column) if column.isdecimal() else column for field, (_, column) in chosen.items()}
    wanted = {**layout, "columns": {**layout["columns"], **positions}}
    seen: dict[str, set[str]] = {field: set() for field in chosen}
    for read in read_columns(path, wanted, account, _converters(layout, chosen, account, seen)):
        values = _wanted(read, chosen, layout.get("missing") or {}, account)
        rows = _to_si(values, layout)
        rows = _drop_bad_rows(path, rows, values["row"], has_velocity, day, layout, account)
        account.note_order(rows.track_id, rows.t)
        if has_velocity and layout.get("max_jump_mps"):
            newest = _note_jumps(newest, rows, layout["max_jump_mps"], step_s, account)
        pieces.append(last_of_step(rows, step_s, account) if has_velocity else rows)
    for field, (key, column) in chosen.items():
        _check_texts(path, key, column, layout[key][column], seen[field], layout)
    rows = concatenate(pieces)
    pieces.clear()  # a fifth of the memory of what follows
    rows = last_of_step(rows, step_s, account) if has_velocity else without_repeats(rows, account)
    if lost := account.dropped_rows["row_as_comment"]:
        _LOG.warning(
            "%s: %d lines that begin with %r are dropped as comments, but are rows else (first: %s); if ids begin so, "
            'set `comment: ""`',
            *(path, lost, layout["comment"], account.first_seen["row_as_comment"]),
        )
    if not account.rows_read and layout.get("header"):
        raise DataError(f"{path}: names its columns, but has no row; was the export cut off?")
    if not len(rows.t):
        raise DataError(f"{path}: {_nothing_left(path, layout, chosen, seen, account)}")
    return rows, account


def _note_jumps(newest, rows, jump_mps, step_s, account):
    """Note the rows of a block to which ids jumped, at most one of a step; `newest` is each id's last row before it.

    Returns each id's last row by now. Between steps such a jump would look like a walk.
    """
    rows = without_repeats(concatenate([newest, rows]), Account())  # the account counts them later
    account.jumps.append(last_of_step(rows.take(jumped(rows, jump_mps)), step_s, Account()))
    return rows.take(rows.bounds()[1:] - 1)


def _nothing_left(path, layout, chosen, seen, account):
    """What is said of a file without a usable row."""
    first = f" (first: {next(iter(account.first_seen.values()))})" if account.first_seen else ""
    told = f"no usable row; {account.rows_read} read, dropped {dict(account.dropped_rows)}{first}"
    advice = hint(next(line_blocks(path)), layout) or hint_of_rows(account.unread, layout)
    advice = f"the file {advice}" if advice else ""
    for field, (key, column) in chosen.items():
        if not advice and key == "only" and account.dropped_rows[f"other_{column}"]:
            advice = f"column {column!r} holds {', '.join(map(repr, sorted(seen[field])[:8]))}"
    advice = advice or hint_of_units(account.beyond, account.rows_read, layout.get("origin", 0.0))
    return told + (f"; {advice}" if advice else "")


def _converters(layout, chosen, account, seen):
    """What the texts of a file stand for, by field: ids, times, and whether a row is one of those that are wanted."""
    found = {}
    if layout.get("ids") == "text":
        found["track_id"] = partial(_whose, owners=account.owners)
    if (layout.get("units") or {}).get("time") == "iso":
        found["t"] = partial(_moment, timezone=layout.get("timezone", "UTC"), first={})
    for field, (key, column) in chosen.items():
        texts = {str(text) for text in layout[key][column]}
        found[field] = partial(_is_kept, texts=texts, inside=key == "only", seen=seen[field])
    return found


def _moment(text, place, timezone, first):
    """The unix time of a text; `first` holds the first place of one with a zone (True) and of one without."""
    t = unix_time(text, timezone)
    if t is None:
        return None
    zoned = utc_offset(text) is not None
    if zoned not in first:
        first[zoned] = f"{place()}, {text!r},"
    if len(first) > 1:
        has, other = ("has a zone", "has none") if zoned else ("has no zone", "has one")
        raise DataError(
            f"the time {text!r} {has}, but that of {first[not zoned]} {other}, and they may be hours apart: write all "
            "times with their offset from UTC, or none"
        )
    return t


def _whose(text, place, owners):
    owners.check()
    if is_missing(text):
        return NO_ID
    return NOBODYS if is_nobodys(text) else owners.number(_utf8(text))


def _is_kept(text, place, texts, inside, seen):
    if len(seen) < MOST_TEXTS or text in texts:
        seen.add(_utf8(text))
    return (text in texts) == inside


def _check_texts(path, key, column, texts, seen, layout):
    """Whether no text to choose rows by differs from one of the file's in nothing but case, blanks or digits.

    The file may have both, and one that is nearly another of the file's may be meant: these are warned of. Without one
    it is no fault: a recording may have no cars.
    """
    texts = list(map(str, texts))
    others = sorted(seen - set(texts))
    written = {_plainly(one, layout): one for one in reversed(others)}
    for text in texts:
        chosen, alike = f"{key}: {{{column}: [{text}]}}", written.get(_plainly(text, layout))
        if text in seen:
            if alike is not None:
                _LOG.warning("%s: %s: the file also has %r: is it meant as well?", path, chosen, alike)
        elif alike is not None:
            raise DataError(f"{path}: {chosen}: the file writes {alike!r}; correct it")
        elif not text.isdecimal() and (near := difflib.get_close_matches(text, others, 1, NEAR)):
            _LOG.warning("%s: %s: no row has that text, but the file has %r: is it mistyped?", path, chosen, near[0])


def _plainly(text, layout):
    """What a text says in any spelling: the number that it is, if a float holds it, else the text in small letters."""
    value = number(text, layout.get("decimal") or ".", layout.get("thousands") or "")
    return value if value is not None and abs(value) < 2**53 else text.strip().casefold()


def _utf8(text):
    """The text; `DataError` where it holds bytes of another encoding, which no output could show."""
    if any("\udc80" <= character <= "\udcff" for character in text):
        shown = text.encode("utf-8", "surrogateescape").decode("latin-1")
        raise DataError(f"the text {shown!r} is not UTF-8 (Latin-1 or Windows-1252?): save it as UTF-8")
    return text


def _wanted(values, chosen, missing, account):
    """The rows that are of those wanted, and were measured."""
    for field, (key, column) in chosen.items():
        kept = values.pop(field) > 0
        account.drop_rows(f"other_{column}" if key == "only" else f"these_{column}", (~kept).sum())
        values = {name: part[kept] for name, part in values.items()}
    if missing:
        absent = np.logical_and.reduce([values[field] == value for field, value in missing.items()])
        account.drop_rows("not_measured", absent.sum())
        values = {name: part[~absent] for name, part in values.items()}
    return values


def _to_si(values, layout):
    """Raw columns to the units of the track table."""
    units = {"time": "s", "length": "m", "angle": "rad", **(layout.get("units") or {})}
    x, y = values["x"], values["y"]
    if units["time"] == "iso":
        t = values["t"]
    else:
        seconds = 1.0 / layout["frame_rate"] if units["time"] == "frame" else SECONDS[units["time"]]
        t = values["t"] * seconds + layout.get("origin", 0.0)
    metres = layout["scale"] if units["length"] == "px" else LENGTH_M[units["length"]]
    if layout.get("homography"):
        matrix = np.asarray(layout["homography"], float)
        x, y, factor = matrix @ np.stack([x, y, np.ones(len(x))])
        x, y = x / factor, y / factor
    east, north = layout.get("origin_m") or (0, 0)
    unknown = np.full(len(values["t"]), np.nan)
    speed, heading = values.get("speed", unknown), values.get("heading", unknown)
    heading = np.deg2rad(heading) if units["angle"] == "deg" else heading
    heading = by_convention(heading, units.get("heading", "from_x"))
    return Tracks(
        values["track_id"],
        t,
        x * metres - east,
        y * metres - north,
        speed * (SPEED_MPS[units["speed"]] if units.get("speed") else metres),
        heading,
    )


def _drop_bad_rows(path, rows, numbers, has_velocity, day, layout, account):
    """Drop rows that no person can have made, each under one name, the first that applies."""
    slow = layout.get("min_heading_mps", 0.0)
    if has_velocity and slow:  # who stands has no direction, whatever the file says
        standing = (rows.speed < slow) | (np.isnan(rows.heading) & np.isnan(rows.speed))
        rows = rows._replace(heading=np.where(standing, np.nan, rows.heading))
    else:
        standing = np.zeros(len(rows.t), bool)
    measured = [rows.t, rows.x, rows.y] + [np.where(standing, 0.0, part) for part in rows[4:]] * has_velocity
    speed, distance = np.nan_to_num(rows.speed), np.hypot(rows.x, rows.y)
    turned = np.abs(np.nan_to_num(rows.heading))
    first, last = day or (-np.inf, np.inf)
    _note_beyond(rows, distance, speed, turned, (first, last), account)
    with np.errstate(invalid="ignore"):
        tests = {
            "infinite_value": np.logical_or.reduce([np.isinf(column) for column in measured]),
            "nan_value": np.logical_or.reduce([np.isnan(column) for column in measured]),
            "no_person": rows.track_id == NOBODYS if layout.get("ids") == "text" else rows.track_id < 0,
            "absurd_value": (distance > MAX_DISTANCE_M) | (speed < 0) | (speed > MAX_SPEED_MPS)
            | (turned > MAX_HEADING_RAD),
            "outside_day": (rows.t < first) | (rows.t >= last),
        }  # fmt: skip
    if layout.get("ids") == "text":
        check_frame(path, rows.x, rows.y, layout.get("origin_m"))
    good = np.ones(len(rows.t), bool)
    for reason, failed in tests.items():
        bad = failed & good
        if bad.any():
            row = int(np.argmax(bad))
            values = ", ".join(f"{name} {column[row]:g}" for name, column in zip(FIELDS, rows, strict=True))
            account.drop_rows(reason, bad.sum(), f"row {int(numbers[row])}: {values}")
            good &= ~bad
    rows = rows.take(good)
    return rows._replace(heading=wrap_angle(rows.heading))


def _note_beyond(rows, distance, speed, turned, day, account):
    """Count what tells a wrong unit."""
    for what, values, limit in (
        ("distance", distance, MAX_DISTANCE_M),
        ("speed", speed, MAX_SPEED_MPS),
        ("heading", turned, WHOLE_TURN_RAD),
    ):
        account.note_beyond(what, values[np.isfinite(values) & (values > limit)])
    account.note_beyond("time", rows.t[np.isfinite(rows.t) & ((rows.t < day[0]) | (rows.t >= day[1]))])


def check_frame(
    path: object, x: np.ndarray, y: np.ndarray, origin_m: tuple[int, int] | None, units: bool = True
) -> None:
    """Whether most positions [m] are near the origin, which is at `origin_m` of the file's frame.

    `OtherFrameError` that names the option which moves it; `units`: whether the reader has one for the unit of length.
    """
    distance = np.hypot(x, y)
    far = distance[np.isfinite(distance)] > MAX_DISTANCE_M
    if not len(far) or far.mean() <= 0.5:
        return
    example = f"{far.mean():.0%} of the first rows are more than {MAX_DISTANCE_M / 1000:g} km from the origin, such as"
    example += f" x {x[0]:g} m, y {y[0]:g} m"
    sides = [np.nanquantile(part, 0.95) - np.nanquantile(part, 0.05) for part in (x, y)]
    if max(sides) > MAX_DISTANCE_M / 2:  # a frame of its own would keep them together
        remedy = "set `units: {length: mm}`, or cm, if they are" if units else "the reader takes them for metres"
        raise DataError(f"{path}: {example}, and {max(sides) / 1000:.3g} km apart: {remedy}")
    moved = origin_m or (0, 0)
    east, north = (int(round(float(np.nanmedian(part)) + at, -2)) for part, at in zip((x, y), moved, strict=True))
    remedy = "correct `units: {length: ...}`" if units else "the reader takes positions for metres"
    raise OtherFrameError(
        f"{path}: {example}: for a national grid, set `origin_m: [{east}, {north}]`; if not, {remedy}", (east, north)
    )


def from_origin(
    path: object, x: np.ndarray, y: np.ndarray, origin_m: tuple[int, int] | None, account: Account
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finite positions [m] of a file that is no table, with the origin at `origin_m`; which of them are near it.

    The others are counted as `absurd_value`; `DataError` where these are most.
    """
    east, north = origin_m or (0, 0)
    x, y = x - east, y - north
    check_frame(path, x, y, origin_m, units=False)
    near = np.hypot(x, y) <= MAX_DISTANCE_M
    if not near.all():
        first = np.argmin(near)
        account.note_beyond("distance", np.hypot(x, y)[~near])
        account.drop_rows("absurd_value", (~near).sum(), f"x {x[first]:g} m, y {y[first]:g} m")
    return x, y, near
