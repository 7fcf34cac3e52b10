"""The forms in which maps are exchanged: for each what it carries and loses, who reads it, how it is read and written.

The table of `docs/maps.md` is made of these records.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import pyarrow as pa
from annotated_types import Ge, Le, MaxLen, MinLen

from modlhmp.exchange import cliff_csv, cliff_xml, stef_forms
from modlhmp.exchange.parquet import MAGIC, PARQUET
from modlhmp.exchange.rows import MOST_COLUMNS, Rows, Source, check_content, read_rows
from modlhmp.options import StefBuilding
from modlhmp.settings import Metres, option, unknown
from modlhmp.storage import DataError

Edges = Annotated[tuple[float, ...], MinLen(2), MaxLen(2)]
Repaired = dict[str, int]


@dataclass(frozen=True, kw_only=True)
class Nothing:
    """Of forms that need no more to be said."""


@dataclass(frozen=True, kw_only=True)
class Lattice:
    """Of text that does not say how far apart its locations are."""

    resolution_m: Metres | None = option(None, "distance of neighbouring locations [m]; null: the usual one")


@dataclass(frozen=True, kw_only=True)
class Header:
    """Of text that is written."""

    header: bool = option(False, "whether the first row names the columns; readers of others take none")


@dataclass(frozen=True, kw_only=True)
class Box:
    """Of histograms, which do not say of which cells they are."""

    x: Edges = option(meaning="first and last edge of the box in x [m]")
    y: Edges = option(meaning="first and last edge of the box in y [m]")
    resolution_m: Metres = option(1.0, "size of a cell [m]")
    orientations: Annotated[int, Ge(2), Le(360)] = option(8, "directions per cell")
    order: Annotated[int, Ge(1), Le(24)] = option(
        StefBuilding().order, "periodic parts that FreMEn keeps per direction"
    )


@dataclass(frozen=True, kw_only=True)
class Form:
    """A form: `read(source, how) -> (table, repaired)` of one map, `write(table, how) -> text`.

    A map by hours is a folder of such files. The histogram, which holds all hours, has its own two functions.
    """

    name: str
    title: str
    kinds: tuple[str, ...]
    suffix: str
    carries: str
    loses: str
    read_by: str
    reading: type = Nothing
    writing: type = Nothing
    read: Callable[[Source, Any], tuple[pa.Table, Repaired]] | None = None
    write: Callable[[pa.Table, Any], str] | None = None


CLIFF = ("cliff", "tc_cliff")
FORMS = (
    Form(
        name="matlab", title="CLiFF CSV, angle first", kinds=CLIFF, suffix=".csv", reading=Lattice, writing=Header,
        carries="every component to 9 digits, p", loses="count, q, the radius, how many people",
        read_by="CLiFF-LHMP, LaCE-LHMP, congestion-coverage-plan, exploration_mod",
        read=lambda source, how: cliff_csv.read_order(source, "matlab", how.resolution_m),
        write=lambda table, how: cliff_csv.write_order(table, "matlab", how.header),
    ),
    Form(
        name="online", title="CLiFF CSV, speed first", kinds=CLIFF, suffix=".csv", reading=Lattice, writing=Header,
        carries="every component to 9 digits, count (p where counts are unknown)",
        loses="p that is not count by the largest count, q, the radius, how many people",
        read_by="online-mod, exploration_mod",
        read=lambda source, how: cliff_csv.read_order(source, "online", how.resolution_m),
        write=lambda table, how: cliff_csv.write_order(table, "online", how.header),
    ),
    Form(
        name="nemo", title="CLiFF CSV with a header, NeMo-style", kinds=CLIFF, suffix=".csv", reading=Lattice,
        carries="every component to 9 digits, its covariance as a correlation",
        loses="p (so the nearest location is used, not the busiest), count, q, the radius, how many people",
        read_by="nemo-map, which leaves out components whose covariance has a determinant below 1e-6",
        read=lambda source, how: cliff_csv.read_nemo(source, how.resolution_m),
        write=lambda table, how: cliff_csv.write_nemo(table),
    ),
    Form(
        name="xml", title="CLiFF XML", kinds=CLIFF, suffix=".xml",
        carries="every component to 9 digits, p (as q), the grid, the radius",
        loses="count, our q, which is 1, how many people",
        read_by="ROS cliffmap_ros, ROS 2 mod and nav2_mod_planner, mod_path_planning",
        read=lambda source, how: cliff_xml.read(source),
        write=lambda table, how: cliff_xml.write(table),
    ),
    Form(
        name="stef_csv", title="STeF CSV", kinds=("stef",), suffix=".csv", reading=Lattice, writing=Header,
        carries="orientation probabilities of an hour to 9 digits",
        loses="the periodic functions: a map that is read stays the same through its hour",
        read_by="exploration_mod (8 directions)",
        read=lambda source, how: stef_forms.read_csv(source, how.resolution_m),
        write=lambda table, how: stef_forms.write_csv(table, how.header),
    ),
    Form(
        name="histogram", title="STeF histograms", kinds=("stef",), suffix=".txt", reading=Box,
        carries=f"orientation probabilities of each hour, as whole {stef_forms.SHARES}ths, without a date",
        loses="the periodic functions, which FreMEn makes anew; the box, which a reader must be told",
        read_by="stefmap_ros, into whose FreMEn they go",
    ),
)  # fmt: skip
BY_NAME = {form.name: form for form in FORMS}


def find_form(name: str) -> Form:
    """The record of a form; `DataError` with the nearest name where there is none."""
    if name not in BY_NAME:
        raise DataError(unknown("form", "form", name, [*BY_NAME, PARQUET]))
    return BY_NAME[name]


def recognise(source: Source) -> str:
    """The name of a file's form, `parquet` among them; `DataError` where it must be named."""
    where, data, _ = source
    if data.startswith(MAGIC):
        return PARQUET
    check_content(source)
    if data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return "xml"
    first = data[: data.find(b"\n", 1)] if b"\n" in data[1:] else data
    if first.count(b",") > MOST_COLUMNS:
        raise DataError(
            f"{where}: {first.count(b',') + 1} numbers in a line: histograms? Then name the form, histogram, and its "
            "box: x=(first, last), y=(first, last), resolution_m, orientations"
        )
    return _form_of_columns(read_rows(source, most=1), where) or _order_by_name(read_rows(source), where)


def _form_of_columns(rows: Rows, where: str) -> str | None:
    """Which comma-separated form it is if names or the number of columns tell; None for a CLiFF-map's numbers."""
    names, columns = set(rows.header), rows.values.shape[1]
    if set(cliff_csv.NEMO) <= names:
        return "nemo"
    if {"component_id", "direction_rad"} & names:
        raise DataError(
            f"{where}: a CSV of cliffpy: it has no covariances, so no density can be made of it; save its map in "
            "another form"
        )
    if "theta_1" in names:
        return "stef_csv"
    if columns not in {10, 11}:
        raise DataError(
            f"{where}: {columns} columns: a CLiFF-map has 10 or 11; name the form if it is another: "
            f"{', '.join(BY_NAME)}"
        )
    return None


def _order_by_name(rows: Rows, where: str) -> str:
    """Which form of a CLiFF-map it is."""
    if named := cliff_csv.order_named(rows):
        return named
    covariance = rows.values[:, 5:7]
    if not (abs(covariance[:, 0] - covariance[:, 1]) <= 1e-4 * (1 + abs(covariance[:, 0]))).all():
        raise DataError(
            f"{where}: columns 6 and 7 differ, so it is no CLiFF-map; name the form, stef_csv, if its columns are x, y "
            "and weights of directions"
        )
    order, why = cliff_csv.order_of(rows)
    if not order:
        raise DataError(
            f"{where}: is its form matlab (column 3 the angle, 4 the speed) or online (column 3 the speed, 4 "
            f"the angle)? Nothing in the file tells for certain: {why}; name the form"
        )
    return order
