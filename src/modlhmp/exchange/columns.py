"""Tables with named columns, as CSV or Parquet: read strictly, each fault with its row; written with all digits."""

import csv
import re
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
from pyarrow import compute

from modlhmp.settings import unknown
from modlhmp.storage import DataError, atomic_path, check_held, no_folder, open_parquet, read_parquet, write_pieces

MOST_HEADER = 10_000  # characters; the names of all columns there are take a hundred
MOST_TEXT_BYTES = 1 << 28  # of a column of Parquet, in which a text that stands a million times is stored once
ROW_BYTES = 120  # of a row from the file to a forecast or a track
STREAM = "-"  # in place of a path: standard input or output


def read_columns(path: str | Path, types: Mapping[str, pa.DataType], empty: Collection[str] = ()) -> pa.Table:
    """The table in a .parquet file or a CSV file with a header, its columns of these types; others are refused.

    `path` "-" is CSV from standard input. Columns `empty` are NaN where they have no value; others must have all. Rows
    are counted as lines, those of Parquet from 1 (`line_of`). `DataError` names the file, the row, the value and the
    remedy.
    """
    no_folder(path)
    table = _parquet(path, types) if Path(path).suffix == ".parquet" else _csv(path, types)
    for place, name in enumerate(table.column_names):
        values = table[name]
        if name in empty:
            table = table.set_column(place, name, values.fill_null(float("nan")))
        elif values.null_count:
            if values.null_count == len(values):
                raise DataError(f"{path}: {name} is empty or NaN in every row; fill it in, or leave the column out")
            row = int(np.argmax(values.is_null().to_numpy()))
            raise DataError(
                f"{path}, row {line_of(path, row)}: {name} is empty or NaN; leave a row out where there is nothing"
            )
    return table


def line_of(path: str | Path, row: int) -> int:
    """How the row at an index is counted: as the file's line, from 1, or, of Parquet, among its rows from 1."""
    return row + (1 if Path(path).suffix == ".parquet" else 2)


def write_columns(tables: Iterable[pa.Table], path: str | Path | IO[bytes], **provenance: Any) -> None:
    """Write tables of one form as one, Parquet (with `provenance` in its metadata) or CSV by the name's end.

    `path` "-" is CSV to standard output. Numbers have as many digits as it takes to read them back unchanged.
    """
    if path == STREAM:
        return _write_csv(tables, sys.stdout.buffer)
    if not isinstance(path, str | Path):
        return _write_csv(tables, path)
    if Path(path).suffix == ".parquet":
        return write_pieces(tables, path, **provenance)
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        return _write_csv(tables, file)


def _write_csv(tables: Iterable[pa.Table], file: IO[bytes]) -> None:
    begun = False
    for table in tables:
        if not begun:
            file.write((",".join(table.column_names) + "\n").encode())
            begun = True
        pc.write_csv(table, file, pc.WriteOptions(include_header=False))
    file.flush()


def _check_names(path: str | Path, names: Sequence[str], types: Mapping[str, pa.DataType]) -> None:
    """Before anything is read: a file may have millions of columns."""
    for place, name in enumerate(names):
        if name not in types:
            raise DataError(unknown(str(path), "column", name[:100], types))
        if name in names[:place]:
            raise DataError(f"{path}: two columns are called {name}; keep one")


class _Begun:
    """A file of which the beginning was read, as a whole one again; Arrow asks nothing more of it."""

    closed = False

    def __init__(self, begin: bytes, rest: IO[bytes]) -> None:
        self.begin, self.rest = begin, rest

    def read(self, most: int) -> bytes:
        begin, self.begin = self.begin, b""
        return begin or self.rest.read(most)


def _csv(path: str | Path, types: Mapping[str, pa.DataType]) -> pa.Table:
    names: list[str] = []
    try:
        with nullcontext(sys.stdin.buffer) if path == STREAM else open(path, "rb") as file:
            begin = file.readline(MOST_HEADER)
            if path != STREAM:
                check_held(path, ROW_BYTES * _lines(path))
            if begin:
                first = re.split("[\r\n]", begin.decode("utf-8-sig", "replace"))[0]
                names = next(csv.reader([first], strict=True)) or [""]
                if len(names) == 1 and (mark := re.search(r"[;\t| ]", first)):
                    raise DataError(
                        f"{path}: one column named {first[:100]!r}: columns are separated by commas here, not by "
                        f"{mark[0]!r}, and decimals begin with a point"
                    )
                _check_names(path, names, types)
            return pc.read_csv(
                _Begun(begin, file),
                pc.ReadOptions(use_threads=False),  # so that errors say the row
                pc.ParseOptions(ignore_empty_lines=False),
                pc.ConvertOptions(column_types=types),
            )
    except FileNotFoundError:
        raise DataError(f"{path}: no such file") from None
    except (OSError, csv.Error, pa.ArrowInvalid) as error:
        raise DataError(_explained(path, str(error), names, types)) from None


def _lines(path: str | Path) -> int:
    """How many lines a file has, blank ones among them: a megabyte of these is a million rows."""
    lines = 0
    with open(path, "rb") as file:
        while block := file.read(1 << 20):
            lines += max(block.count(b"\n"), block.count(b"\r"))
    return lines


def _explained(path: str | Path, error: str, names: Sequence[str], types: Iterable[str]) -> str:
    """Arrow's words about a CSV file as ours."""
    row = f", row {found[1]}" if (found := re.search(r"Row #(\d+)", error)) else ""
    if found := re.search(r"CSV column #(\d+).*invalid value '(.*)'", error):
        return f"{path}{row}: {names[int(found[1])]} {found[2]!r} is not a number; correct it, or leave the row out"
    if found := re.search(r"Expected (\d+) columns, got (\d+)", error):
        return f"{path}{row}: {found[2]} fields where the header has {found[1]}; correct the row"
    return f"{path}{row}: no CSV with the columns {', '.join(types)} ({error})"


def _parquet(path: str | Path, types: Mapping[str, pa.DataType]) -> pa.Table:
    file = open_parquet(path)
    schema = file.schema_arrow
    _check_names(path, schema.names, types)
    check_held(path, ROW_BYTES * file.metadata.num_rows)
    table = read_parquet(
        path, texts_once=[one.name for one in schema if _is_text(one.type) or pa.types.is_binary(one.type)]
    )
    for place, field in enumerate(table.schema):
        wanted = types.get(field.name, field.type)
        if pa.types.is_nested(field.type) or (pa.types.is_floating(wanted) and _is_text(field.type)):
            raise DataError(f"{path}: column {field.name} is {field.type}; numbers are needed")
        values = table.column(place)
        if pa.types.is_floating(field.type):
            values = compute.if_else(compute.is_nan(values), None, values)
        if pa.types.is_dictionary(field.type) and _text_bytes(values) > MOST_TEXT_BYTES:
            raise DataError(
                f"{path}: column {field.name} has more than {MOST_TEXT_BYTES >> 20} MiB of text; shorten it"
            )
        try:
            table = table.set_column(place, field.name, values.cast(wanted))
        except pa.ArrowException as error:
            reason = str(error).splitlines()[0]
            raise DataError(f"{path}: column {field.name} is {field.type}, not {wanted} ({reason})") from None
    return table


def _text_bytes(values: pa.ChunkedArray) -> int:
    """Bytes of a column of texts that are stored once, if each stood where it is meant."""
    return sum(
        compute.sum(compute.binary_length(part.dictionary).take(part.indices)).as_py() or 0
        for part in values.chunks
        if _is_text(part.dictionary.type)
    )


def _is_text(of: pa.DataType) -> bool:
    return pa.types.is_string(of) or pa.types.is_large_string(of) or pa.types.is_dictionary(of)
