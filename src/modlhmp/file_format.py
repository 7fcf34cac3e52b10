"""How the files of a recording are written, and how they are cleaned: what a reader must know."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Lt, MaxLen, MinLen

from modlhmp.settings import Positive, WholeFrom0, WholeFrom1, option
from modlhmp.site import TimeStep, check_timezone
from modlhmp.storage import DataError
from modlhmp.tracks import gap_limit

Column = WholeFrom0 | str
# Checks of whether a recording can be what is said of it, `modlhmp.plausibility` and `modlhmp.split_checks`.
CheckName = Literal[
    "absurd_rows", "unreadable_rows", "walking_speed", "recorded_speed", "recorded_heading", "time_step",
    "clock_digits", "outside_day", "extent", "jumps", "glued_files", "not_measured", "repeated_rows", "shared_people",
    "copied_recording", "untrained_place", "horizon", "hours",
]  # fmt: skip
LENGTH_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_READER_NEEDS = {
    "edinburgh": ("frame_rate", "scale"),
    "edinburgh_rows": ("frame_rate", "scale", "row_stride"),
    "delimited": ("columns",),
    "text": ("columns",),
}
# How a file is written, of which each reader reads a part; any of them may be given for a table of the user's own.
_WRITTEN = (
    "columns", "header", "separator", "decimal", "thousands", "skip_lines", "comment", "missing", "only", "without",
    "units", "frame_rate", "row_stride", "scale", "homography", "origin_m",
)  # fmt: skip
_READS = {
    **dict.fromkeys(("atc", "atc_1hz", "magni", "jupedsim", "hdf5"), ("origin_m",)),
    "trajnet": ("frame_rate", "origin_m"),
    "edinburgh": _READER_NEEDS["edinburgh"],
    "edinburgh_rows": _READER_NEEDS["edinburgh_rows"],
    "text": tuple(key for key in _WRITTEN if key not in ("separator", "row_stride")),
    "delimited": tuple(key for key in _WRITTEN if key != "row_stride"),
}
# What readers take for granted, beside the defaults, of the keys and units that they do not read: it may be said.
_GRANTED: dict[str, dict[str, tuple[Any, ...]]] = {
    "atc": {"length": ("mm",), "speed": ("mm/s",)},
    "atc_1hz": {"speed": ("m/s",)},
    "magni": {"length": ("mm",)},
    **{reader: {"time": ("frame",)} for reader in ("trajnet", "jupedsim", "hdf5")},
    **{reader: {"length": ("px",), "time": ("frame",)} for reader in ("edinburgh", "edinburgh_rows")},
    "text": {"separator": (" ", "\t")},
}


@dataclass(frozen=True, kw_only=True)
class Units:
    """Units of the columns."""

    time: Literal["s", "ms", "us", "ns", "frame", "iso"] = option(
        "s", "`frame` needs `frame_rate`; `iso` is text such as 2026-03-02T09:00:00.5+01:00, local time without a zone"
    )
    length: Literal["m", "cm", "mm", "px"] = option("m", "`px` needs `scale`")
    speed: Literal["m/s", "cm/s", "mm/s", "km/h"] | None = option(None, "null: the length unit per second")
    angle: Literal["rad", "deg"] = option("rad", "of headings")
    heading: Literal["from_x", "from_x_clockwise", "compass"] = option(
        "from_x", "`from_x`: from the x-axis towards the y-axis; `compass`: from the y-axis clockwise"
    )


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Which column holds what: by position from 0 or, with a header, by name."""

    track_id: Column | tuple[Column, ...] | None = option(
        None,
        "whose row it is: any text or number; of several columns together, where one alone does not tell; not where "
        "every file is a person",
    )
    t: Column = option(meaning="time")
    x: Column = option(meaning="position")
    y: Column = option(meaning="position")
    speed: Column | None = option(None, "speed, if recorded; then `heading` as well")
    heading: Column | None = option(None, "direction of motion, if recorded; then `speed` as well")

    def given(self) -> dict[str, Any]:
        """The columns that there are, by field."""
        named = {name: getattr(self, name) for name in ("track_id", "t", "x", "y", "speed", "heading")}
        return {name: column for name, column in named.items() if column is not None}


@dataclass(frozen=True, kw_only=True)
class FileFormat:
    """Reader, columns, units and cleaning rules of a recording's files."""

    reader: Literal[
        "atc", "atc_1hz", "edinburgh", "edinburgh_rows", "delimited", "text", "trajnet", "magni", "jupedsim", "hdf5"
    ] = option(
        "delimited",
        "form of the files; `delimited` reads any CSV, `text` columns between blanks with comments, both "
        "by `columns`; `trajnet` TrajNet++'s JSON lines, `magni` THOR-MAGNI's scenario files, `jupedsim` its SQLite, "
        "`hdf5` those of the Pedestrian Dynamics Data Archive",
    )
    timezone: str = option("UTC", "tz database name of the place, such as Asia/Tokyo")
    time_step_s: TimeStep = option(1.0, "time step of the cleaned tracks and of forecasts [s]")
    cleaning: tuple[str | dict[str, dict[str, Any]], ...] = option(
        ("single_row",), "rules of cleaning, see below, applied in this order"
    )
    gaps: Literal["split", "drop"] = option(
        "split", "tracks with a gap: cut there, the pieces being different people, or dropped, as the paper does"
    )
    same_person: bool = option(
        False,
        "whether the pieces of a track that was split are one person: never both trained and tested on, nor held out "
        "to choose by, and one cluster of tests and intervals",
    )
    max_gap_s: Positive | None = option(
        None,
        "longest time between two rows of a track [s]; null: 5, or two time steps if these are more, which is the most "
        "where speeds and headings are recorded",
    )
    max_jump_mps: Positive | None = option(
        15.0, "a faster displacement, over 0.4 s or more, is another person's: the track is cut there; null: not"
    )
    min_heading_mps: Annotated[float, Ge(0)] = option(
        0.05, "recorded speeds below are standing, and have no heading [m/s]"
    )
    file_is: Literal["recording", "person"] = option(
        "recording",
        "`person`: the files of an entry are one recording, each of one person, whose id is its name without suffix",
    )
    columns: Columns | None = option(None, "which column holds what, by position from 0 or, with a header, by name")
    header: bool = option(False, "whether the first row names the columns")
    separator: Annotated[str, MinLen(1), MaxLen(1)] = option(",", "character between columns")
    decimal: Literal[".", ","] = option(".", "decimal mark")
    thousands: Literal[".", ",", " ", "'"] | None = option(None, "mark between groups of three digits, if any")
    skip_lines: WholeFrom0 = option(0, "lines before the header or the first row")
    comment: Annotated[str, MaxLen(1)] | None = option(
        None,
        'lines that begin with this character are comments; null: `#` for reader `text`, none for others; "": none',
    )
    missing: dict[str, float] = option(
        {}, "field: value; a row that has these values in all these fields was not measured, such as {x: 0, y: 0}"
    )
    only: dict[str, tuple[str | int, ...]] = option(
        {}, "column: texts; rows with another text there are dropped, such as {class: [pedestrian]}"
    )
    without: dict[str, tuple[str | int, ...]] = option({}, "column: texts; rows with one of these there are dropped")
    units: Units = field(default_factory=Units, metadata={"description": "units of the columns"})
    frame_rate: Positive | None = option(None, "frames per second")
    row_stride: WholeFrom1 | None = option(None, "raw frames between two rows of a track")
    scale: Positive | None = option(None, "metres per pixel")
    homography: tuple[tuple[float, float, float], ...] | None = option(
        None, "three rows of three numbers that take the file's x, y, 1 to metres (times a factor)"
    )
    origin_m: tuple[int, int] | None = option(
        None,
        "x and y of the local origin in the file's frame [whole metres], for national grids; plans move as well; every "
        "reader of metres takes it",
    )

    accept: tuple[CheckName, ...] = option((), "checks of the recordings whose findings are known to be right")
    strict: bool = option(False, "whether what a check only warns of stops as well")

    @property
    def comment_mark(self) -> str:
        """What a comment begins with; "" where there are none."""
        return ("#" if self.reader == "text" else "") if self.comment is None else self.comment

    @property
    def has_velocity(self) -> bool:
        """Whether the files say how fast and which way people walk."""
        return self.reader in {"atc", "atc_1hz"} or (self.columns is not None and self.columns.speed is not None)

    @property
    def has_clock(self) -> bool:
        """Whether the files' times are of a clock, unless a `start` is given; those of the others count from 0."""
        return self.reader in {"atc", "atc_1hz", "delimited", "text"} and self.units.time != "frame"

    @property
    def metres(self) -> float:
        """Metres of the files' unit of length."""
        if self.reader.startswith("edinburgh") or self.units.length == "px":
            return self.scale or 1.0
        return LENGTH_M["mm" if self.reader == "atc" else self.units.length]

    @property
    def gap_s(self) -> float:
        """The longest time between two rows of a track [s]."""
        return self.max_gap_s or gap_limit(self.time_step_s)


def check_format(form: FileFormat, source: object) -> None:
    """Whether a reader knows all that it needs; `DataError` that names `source`, the key and the remedy."""
    check_timezone(form.timezone, source)
    for key in _READER_NEEDS.get(form.reader, ()):
        if getattr(form, key) is None:
            raise DataError(f"{source}: reader {form.reader!r} needs the key {key!r}")
    usual, granted = {**vars(FileFormat()), **vars(Units())}, _GRANTED.get(form.reader, {})
    for key in _WRITTEN:
        said = vars(form.units) if key == "units" else {key: getattr(form, key)}
        odd = any(value != usual[name] and value not in granted.get(name, ()) for name, value in said.items())
        if odd and key not in _READS[form.reader]:
            known = ", ".join(_READS[form.reader])
            raise DataError(
                f"{source}: reader {form.reader!r} does not read the key {key!r}, only {known}: leave it out, or "
                "export the file as CSV and use `reader: delimited`"
            )
    for unit, key in (("px", "scale"), ("frame", "frame_rate")) if "units" in _READS[form.reader] else ():
        if unit in {form.units.time, form.units.length} and getattr(form, key) is None:
            raise DataError(f"{source}: units in {unit!r} need the key {key!r}")
    _check_marks(form, source)
    _check_homography(form, source)
    for column in form.missing:
        if column not in ("t", "x", "y", "speed", "heading"):
            raise DataError(f"{source}: missing: no field named {column!r}; it has t, x, y, speed, heading")
        if form.columns is not None and column not in form.columns.given():
            raise DataError(f"{source}: missing: {column}: `columns` names no {column}; name it there, or leave it out")
    if form.columns is not None and (form.columns.speed is None) != (form.columns.heading is None):
        raise DataError(f"{source}: columns: give both speed and heading, or neither")
    if form.has_velocity and form.gap_s > (most := gap_limit(form.time_step_s)):
        raise DataError(
            f"{source}: max_gap_s {form.gap_s:g}: rows with recorded speeds are not interpolated, so such a gap would "
            f"stay, and tracks with a gap over {most:g} s are neither forecast nor replayed; set {most:g} or less, or "
            "read positions alone"
        )
    named = form.columns is not None and form.columns.track_id is not None
    if form.columns is not None and named == (form.file_is == "person"):
        remedy = "leave it out" if named else "say whose a row is, or set `file_is: person`"
        raise DataError(f"{source}: columns: {'a' if named else 'no'} track_id: {remedy}")
    if form.file_is == "person" and form.reader not in ("delimited", "text"):
        raise DataError(f"{source}: file_is: person is for the readers delimited and text, not for {form.reader}")
    given = form.columns.given() if form.columns else {}
    for name, column in given.items():
        if twice := [other for other in given if other != name and given[other] == column]:
            raise DataError(f"{source}: columns: {name} and {twice[0]} are both column {column!r}; correct one")


def how_to_set(remedy: str, form: FileFormat) -> str:
    """What must be added to a remedy that names, in backticks, keys which `check_format` would refuse; else empty."""
    if form.homography is not None and "`units: {length" in remedy:
        return " (a `homography` takes positions to metres: correct its numbers instead of the unit of length)"
    keys = [key for key in _WRITTEN if f"`{key}" in remedy and key not in _READS[form.reader]]
    if not keys or "`reader: delimited`" in remedy:
        return ""
    is_table = form.reader in ("atc", "atc_1hz", "text")
    file = "read the file by `reader: delimited`" if is_table else "export it as CSV, for `reader: delimited`"
    return f" (reader {form.reader!r} does not read {', '.join(keys)}: {file} with `columns`, which does)"


def _check_marks(form, source):
    """Whether separator, comment and the marks of numbers are told apart."""
    for key in ("decimal", "thousands") if form.reader == "delimited" else ():
        if getattr(form, key) == form.separator and not (form.header and form.separator == ","):
            raise DataError(
                f"{source}: {key} {form.separator!r} is also the separator; the two can be told apart only where such "
                "numbers are quoted and a `header` gives the number of columns: save the file with ; between columns"
            )
    for key, mark in (("separator", form.separator), ("comment", form.comment or "#")):
        shown = mark.isprintable() and (mark.isascii() or key == "comment")
        if mark.isalnum() or mark in "+-.\"'" or not (shown or mark == "\t"):
            raise DataError(
                f"{source}: {key} {mark!r}: give one printable character of ASCII that is no part of numbers, words or "
                "quotes, such as , ; | or #"
            )
    if form.thousands == form.decimal:
        raise DataError(f"{source}: thousands {form.thousands!r} is also the decimal mark; correct one")


def _check_homography(form, source):
    if form.homography is None:
        return
    if len(form.homography) != 3:
        raise DataError(f"{source}: homography: give three rows of three numbers")
    if abs(float(np.linalg.det(np.array(form.homography)))) < 1e-12:
        raise DataError(
            f"{source}: homography: its rows depend on each other, so it takes a place to a line; correct it"
        )
    if form.units.length != "m":
        raise DataError(f"{source}: homography takes positions to metres: leave out units.length")


@dataclass(frozen=True, kw_only=True)
class Split:
    """Which people of a recording are tested on, where one file holds both."""

    by: Literal["person", "time", "day", "column"] = option(
        meaning="`person`: a share of them, whenever they walk; `time`: those who come in the last part of it; "
        "`day`: the last of several days; `column`: what the file says"
    )
    test: Annotated[float, Gt(0), Lt(1)] | tuple[str, ...] = option(
        0.25, "share that is tested on; with `by: column` the texts that mean so"
    )
    seed: WholeFrom0 = option(0, "of the choice of persons")
    column: Column | None = option(None, "where the file says it, by name or position")


@dataclass(frozen=True, kw_only=True)
class Recording:
    """One recording of a dataset: where it lies, of which day and split it is.

    `stored` is the file on disk (`path`, or the archive that it leads into), `member` the file in an archive, `file`
    `stored` under the data root. `chosen` says who of the file is tested on, None: nobody or all, as `split` says;
    `side` is which side of `chosen` it holds, `train` or `test`, whatever it is used for: `split` says that, and may be
    another in a validation part or a fold. `part` is what of that is used (`splits.in_part`), where it is cut; `days`
    is how many days it is of, `day` being the first. `people` are the files where each is of one person; `path` is the
    glob that lists them then.
    """

    day: str = ""
    start: str | None = None
    split: str = "train"
    name: str = ""
    path: str = ""
    stored: str = ""
    member: str | None = None
    file: str = ""
    exists: bool = True
    chosen: Split | None = None
    side: str = ""
    part: str | None = None
    days: int = 1
    people: tuple[str, ...] = ()
