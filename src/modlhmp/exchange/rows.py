"""Rows of numbers of other people's text files: every row as long as the first, every field a finite number."""

import io
import logging
import math
from array import array
from collections.abc import Callable, Iterator, Sequence
from typing import IO, NamedTuple

import numpy as np

from modlhmp.readers.numerals import number
from modlhmp.storage import DataError

MOST_BYTES = 32 << 20  # of a map's file, such as 350,000 components
MOST_COLUMNS = 400  # of a table; more are histograms
_LOG = logging.getLogger("modlhmp")
LFS = b"version https://git-lfs"  # how a pointer begins that Git LFS leaves in a file's place


class Source(NamedTuple):
    """What is read: a file's name, for messages, its bytes, and the origin [m] of the map's frame in the file's."""

    name: str
    data: bytes
    origin: tuple[float, float] = (0.0, 0.0)


class Rows(NamedTuple):
    """Numbers [n, columns], the number of each row in the file [n] from 1, and the header's names, if it has one."""

    values: np.ndarray
    number: np.ndarray
    header: tuple[str, ...]


def read_source(name: str, file: IO[bytes], origin: tuple[float, float] = (0.0, 0.0)) -> Source:
    """The bytes of a map's file; `DataError` where they are more than a map's, all of which are held at once."""
    data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise DataError(
            f"{name}: more than {MOST_BYTES >> 20} MiB, the most of a map in this form: is it a map? Make it with a "
            "larger distance between its locations, or give it as Parquet"
        )
    return Source(name, data, origin)


def check_content(source: Source) -> None:
    """`DataError` for what is not a map's content at all."""
    where, data, _ = source
    if data.startswith(LFS):
        raise DataError(f"{where}: a pointer of Git LFS, not the file: run `git lfs pull` where it was cloned")
    if not data.strip():
        raise DataError(f"{where}: the file is empty")


def text_of(source: Source) -> str:
    """A file as text without a byte order mark."""
    check_content(source)
    try:
        return source.data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{source.name}: not a text file (byte {error.start}), nor Parquet") from None


def lines_of(source: Source) -> Iterator[tuple[int, str]]:
    """(number from 1, text) of each line that is not blank, one after the other: all at once may be gigabytes."""
    for row, line in enumerate(io.StringIO(text_of(source), newline=None), 1):
        if line.strip():
            yield row, line


def read_rows(source: Source, most: int | None = None) -> Rows:
    """The numbers of a comma-separated file, or of its first rows, with or without a header; blank lines are skipped.

    `DataError` names the row and column of what is no number, is not finite, or of a row of another length.
    """
    where = source.name
    header: tuple[str, ...] = ()
    values, numbers, width = array("d"), array("q"), 0
    for row, line in lines_of(source):
        if (columns := line.count(",") + 1) > MOST_COLUMNS:
            raise DataError(f"{where}: row {row} has {columns} columns; at most {MOST_COLUMNS} are read")
        fields = [field.strip().strip('"') for field in line.split(",")]
        if not values and not header and all(number(field) is None for field in fields):
            header = tuple(fields)
            continue
        width = width or len(header)
        if width and len(fields) != width:
            raise DataError(
                f"{where}: row {row} has {len(fields)} columns, the rows before it {width}; is it damaged, or are "
                "two files in one?"
            )
        width = len(fields)
        found = [value for field in fields if (value := number(field)) is not None and math.isfinite(value)]
        if len(found) < len(fields):
            found = [finite(field, f"{where}: row {row}, column {at}") for at, field in enumerate(fields, 1)]
        values.extend(found)
        numbers.append(row)
        if len(numbers) == most:
            break
    if not values:
        raise DataError(f"{where}: it has no rows: the map is empty; was it built from enough data?")
    return Rows(np.array(values).reshape(-1, width), np.array(numbers), header)


def check_names(rows: Rows, form: str, names: Sequence[str], means: Callable[[str], str], where: str) -> None:
    """`DataError` where a header calls a column what a form, whose columns are `names`, does not have there.

    `means` says what a name stands for, "" where that is unknown. Such a column is taken by its place, with a word, and
    so are those that seem to be the same where the form has fewer of them, as theta and theta_theta do.
    """
    pairs = list(zip(rows.header, names, strict=False))
    said = [means(name.lower()) for name, _ in pairs]
    wanted = [means(here) for _, here in pairs]
    unclear = []
    for at, (name, here) in enumerate(pairs):
        if not said[at] or said.count(said[at]) > max(wanted.count(said[at]), 1):
            unclear.append(name)
        elif said[at] != wanted[at]:
            raise DataError(
                f"{where}: column {at + 1} is called {name}, where form {form} has {here}: bring the columns into its "
                f"order, {','.join(names)}, or correct the header"
            )
    if unclear:
        _LOG.warning("%s: unclear names of columns, taken by their places: %s", where, ", ".join(unclear)[:200])


def finite(field: str, where: str) -> float:
    """The finite number that a text is; `DataError` that begins with `where`."""
    value = number(field)
    if value is None:
        hint = " (columns are separated by commas)" if {";", "\t"} & set(field) else ""
        raise DataError(f"{where}: {field[:60]!r} is not a number{hint}")
    if not np.isfinite(value):
        raise DataError(f"{where}: {field!r} is not a finite number; leave that component out")
    return value


def table_text(columns: list[np.ndarray], header: tuple[str, ...] = ()) -> str:
    """Rows of numbers as comma-separated text with 9 significant digits, which every float32 survives."""
    lines = [",".join(header)] if header else []
    lines += [",".join(f"{value:.9g}" for value in row) for row in np.column_stack(columns).tolist()]
    return "\n".join(lines) + "\n"
