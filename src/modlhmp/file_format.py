"""How the files of a recording are written, and how they are cleaned: what a reader must know."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le, MaxLen, MinLen

from modlhmp.settings import Positive, WholeFrom0, WholeFrom1, option
from modlhmp.site import check_timezone
from modlhmp.storage import DataError

Column = WholeFrom0 | str
_READER_NEEDS = {
    "edinburgh": ("frame_rate", "scale"),
    "edinburgh_rows": ("frame_rate", "scale", "row_stride"),
    "delimited": ("columns",),
}


@dataclass(frozen=True, kw_only=True)
class Units:
    """Units of the columns; a speed is in the length unit per second."""

    time: Literal["s", "ms", "frame"] = option("s", "`frame` needs `frame_rate`")
    length: Literal["m", "cm", "mm", "px"] = option("m", "`px` needs `scale`")
    angle: Literal["rad", "deg"] = option("rad", "of headings")


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Which column holds what: by position from 0 or, with a header, by name."""

    track_id: Column = option(meaning="whole number of the person whose row it is")
    t: Column = option(meaning="time")
    x: Column = option(meaning="position")
    y: Column = option(meaning="position")
    speed: Column | None = option(None, "speed, if recorded; then `heading` as well")
    heading: Column | None = option(None, "direction of motion, if recorded; then `speed` as well")

    def given(self) -> dict[str, Column]:
        """The columns that there are, by field."""
        named = {name: getattr(self, name) for name in ("track_id", "t", "x", "y", "speed", "heading")}
        return {name: column for name, column in named.items() if column is not None}


@dataclass(frozen=True, kw_only=True)
class FileFormat:
    """Reader, columns, units and cleaning rules of a recording's files."""

    reader: Literal["atc", "atc_1hz", "edinburgh", "edinburgh_rows", "delimited"] = option(
        "delimited", "form of the files; `delimited` reads any CSV by `columns`, `header`, `separator` and `units`"
    )
    timezone: str = option("UTC", "tz database name of the place, such as Asia/Tokyo")
    time_step_s: Annotated[float, Ge(0.01), Le(60)] = option(
        1.0, "time step of the cleaned tracks and of forecasts [s]"
    )
    cleaning: tuple[str | dict[str, dict[str, Any]], ...] = option(
        ("single_row", "gap_over_5s"), "rules of modlhmp.cleaning, applied in this order"
    )
    columns: Columns | None = option(None, "which column holds what, by position from 0 or, with a header, by name")
    header: bool = option(False, "whether the first row names the columns")
    separator: Annotated[str, MinLen(1), MaxLen(1)] = option(",", "character between columns")
    units: Units = field(default_factory=Units, metadata={"description": "units of the columns"})
    frame_rate: Positive | None = option(None, "frames per second")
    row_stride: WholeFrom1 | None = option(None, "raw frames between two rows of a track")
    scale: Positive | None = option(None, "metres per pixel")

    @property
    def has_velocity(self) -> bool:
        """Whether the files say how fast and which way people walk."""
        return self.reader in {"atc", "atc_1hz"} or (self.columns is not None and self.columns.speed is not None)


def check_format(form: FileFormat, source: object) -> None:
    """Whether a reader knows all that it needs; `DataError` that names `source`, the key and the remedy."""
    check_timezone(form.timezone, source)
    for key in _READER_NEEDS.get(form.reader, ()):
        if getattr(form, key) is None:
            raise DataError(f"{source}: reader {form.reader!r} needs the key {key!r}")
    for unit, key in (("px", "scale"), ("frame", "frame_rate")):
        if unit in {form.units.time, form.units.length} and getattr(form, key) is None:
            raise DataError(f"{source}: units in {unit!r} need the key {key!r}")
    if form.columns is not None and (form.columns.speed is None) != (form.columns.heading is None):
        raise DataError(f"{source}: columns: give both speed and heading, or neither")
    given = form.columns.given() if form.columns else {}
    for name, column in given.items():
        if twice := [other for other in given if other != name and given[other] == column]:
            raise DataError(f"{source}: columns: {name} and {twice[0]} are both column {column!r}; correct one")


@dataclass(frozen=True, kw_only=True)
class Recording:
    """One recording of a dataset: where it lies, of which day and split it is.

    `stored` is the file on disk (`path`, or the archive that it leads into), `member` the file in an archive, `file`
    `stored` under the data root; `part` is what of it is used (`cleaning.in_part`), where it is cut.
    """

    day: str
    start: str | None = None
    split: str = "train"
    name: str = ""
    path: str = ""
    stored: str = ""
    member: str | None = None
    file: str = ""
    exists: bool = True
    part: str | None = None
