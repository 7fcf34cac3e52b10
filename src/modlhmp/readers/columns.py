"""Delimited text to columns of numbers, block by block: regular lines through pyarrow, the few others one by one.

Two threads parse ahead of the caller. Every line is either returned as numbers or counted as dropped by name.
"""

import codecs
import csv
import itertools
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from modlhmp.account import Account
from modlhmp.kernels import kernel
from modlhmp.readers.raw import line_blocks
from modlhmp.storage import DataError

THREADS = 2


class Form(NamedTuple):
    """Form of a file: `fields` are wanted from the columns at `positions` of `width`."""

    fields: tuple[str, ...]
    positions: list[int]
    width: int
    separator: str


class Parsed(NamedTuple):
    """A block's regular lines as numbers [fields, regular lines]; the ends of all lines and which are regular."""

    values: np.ndarray | list[np.ndarray]
    ends: np.ndarray
    regular: np.ndarray


def read_columns(path: str | Path, layout: Mapping[str, Any], account: Account) -> Iterator[dict[str, np.ndarray]]:
    """Yield the columns of one block after the other as a dict of arrays; `layout` as in `delimited`.

    `row` is the row's number in the file, `track_id` int64, everything else float, NaN where a value is missing.
    """
    blocks = line_blocks(path)
    form, block, row = _look_at_start(path, layout, next(blocks))
    with ThreadPoolExecutor(THREADS) as pool:
        for text, future in _parsed_ahead(pool, form, itertools.chain([block], blocks)):
            parsed = future.result()
            yield _finish(form, text, parsed, row, account)
            row += len(parsed.ends)


def _parsed_ahead(pool, form, blocks):
    """Each block and the future of its parsing, in order, a few blocks ahead of the caller."""
    waiting: deque[Any] = deque()
    for block in blocks:
        waiting.append((block, pool.submit(parse, form, block)))
        if len(waiting) > THREADS:
            yield waiting.popleft()
    yield from waiting


def parse(form: Form, block: bytes) -> Parsed:
    """Parse the regular lines of a block of whole lines; safe to run in threads."""
    wanted = np.isin(np.arange(form.width), form.positions)
    ends, regular = _scan(np.frombuffer(block, np.uint8), _byte_kinds(form.separator), wanted)
    names = [str(position) for position in range(form.width)]
    values: np.ndarray | list[np.ndarray] = np.empty((len(form.fields), 0))
    if regular.any():
        try:
            table = pa_csv.read_csv(
                pa.BufferReader(_lines(block, ends, regular)),
                pa_csv.ReadOptions(column_names=names, use_threads=False),
                pa_csv.ParseOptions(delimiter=form.separator),
                pa_csv.ConvertOptions(
                    column_types=dict.fromkeys(names, pa.float64()),
                    include_columns=[str(position) for position in form.positions],
                ),
            )
            values = [np.from_dlpack(part.fill_null(np.nan).combine_chunks()) for part in table.columns]
        except pa.ArrowInvalid:  # made of a number's characters, but not a number, such as 1-2
            regular[:] = False
    return Parsed(values, ends, regular)


def _look_at_start(path, layout, block):
    """From the first row: the form of the file, the block without byte order mark and header, rows before it."""
    block = block.removeprefix(codecs.BOM_UTF8)
    separator, header = layout.get("separator", ","), layout.get("header")
    first, _, rest = block.partition(b"\n")
    names = _fields(first.decode("utf-8", "replace"), separator)
    if not header and not any(_is_number(name) for name in names):
        raise DataError(
            f"{path}, row 1: {first.decode(errors='replace')[:80]!r} is a header where numbers are expected; "
            "remove that line, or use `reader: delimited` with `header: true`"
        )
    if header and all(_is_number(name) for name in names):
        raise DataError(
            f"{path}, row 1: only numbers, but `header: true` says that it names the columns; drop that key"
        )
    if layout.get("width") and len(names) != layout["width"]:
        raise DataError(
            f"{path}, row 1: {len(names)} columns, but this format has {layout['width']}: is `reader` right?"
        )
    positions = [_position(path, field, column, names, header) for field, column in layout["columns"].items()]
    form = Form(tuple(layout["columns"]), positions, len(names), separator)
    return form, rest if header else block, 1 if header else 0


def _position(path, field, column, names, header):
    """Position of a column that the layout gives by position or, with a header, by name."""
    if isinstance(column, int) and column < len(names):
        return column
    if header and names.count(column) > 1:
        raise DataError(f"{path}, row 1: {names.count(column)} columns are called {column!r}; use positions")
    if not header or column not in names:
        known = names if header else [f"positions 0 to {len(names) - 1}"]
        raise DataError(f"{path}, row 1: no column {column!r} for {field}; it has {', '.join(known)}")
    return names.index(column)


def _finish(form, block, parsed, rows_before, account):
    """Columns of a block, its irregular lines read one by one, rows in the file's order."""
    values, ends, regular = parsed
    account.rows_read += len(ends)
    readable = regular
    if not regular.all():
        starts, readable = np.concatenate([[0], ends[:-1] + 1]), regular.copy()
        every = np.empty((len(form.fields), len(ends)))
        every[:, regular] = values
        for line in np.flatnonzero(~regular):
            text = block[starts[line] : ends[line]].decode("utf-8", "replace")
            numbers = _one_row(form, text, rows_before + 1 + line, account)
            if numbers is not None:
                every[:, line], readable[line] = numbers, True
        values = every[:, readable]
    rows = rows_before + 1 + np.flatnonzero(readable)
    return _with_track_ids({**dict(zip(form.fields, values, strict=True)), "row": rows}, account)


def _with_track_ids(columns, account):
    """The rows that have a whole number as id: a row without belongs to nobody."""
    ids = columns["track_id"]
    whole = (np.abs(ids) < 2**53) & (ids == np.rint(ids))
    if not whole.all():
        row = np.argmin(whole)
        account.drop_rows("no_track_id", (~whole).sum(), f"row {columns['row'][row]}: track id {ids[row]}")
        columns = {name: column[whole] for name, column in columns.items()}
    return {**columns, "track_id": columns["track_id"].astype(np.int64)}


def _one_row(form, text, row, account):
    """Values of one line, or None once it is counted as dropped."""
    fields, example = _fields(text, form.separator), f"row {row}: {text[:80]!r}"
    if not text.strip():
        account.drop_rows("blank_line", 1, example)
    elif len(fields) != form.width:
        account.drop_rows("wrong_column_count", 1, example)
    else:
        try:
            return [float(fields[position] or "nan") for position in form.positions]
        except ValueError:
            account.drop_rows("text_value", 1, example)
    return None


def _fields(line, separator):
    """Fields of a line, quotes and blanks around them removed; a line of unbalanced quotes is one field."""
    line = line.strip("\r")
    if '"' in line:
        try:
            return [field.strip() for field in next(csv.reader([line], delimiter=separator, strict=True))]
        except (csv.Error, StopIteration):
            return [line]
    return [field.strip() for field in line.split(separator)]


def _lines(block, ends, chosen):
    """The bytes of the chosen lines; the block itself where all are."""
    if chosen.all():
        return block
    starts = np.concatenate([[0], ends[:-1] + 1])
    # One piece per run of neighbouring lines.
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return b"".join(block[starts[i] : ends[j - 1] + 1] for i, j in edges.reshape(-1, 2))


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True


# What a byte can be to `_scan`.
_NUMBER, _POINT, _SEPARATOR, _NEWLINE, _QUOTE, _OTHER = range(6)


def _byte_kinds(separator):
    kinds = np.full(256, _OTHER, np.uint8)
    kinds[list(b"0123456789+-eE\r")] = _NUMBER
    for byte, kind in ((".", _POINT), (separator, _SEPARATOR), ("\n", _NEWLINE), ('"', _QUOTE)):
        kinds[ord(byte)] = kind
    return kinds


@kernel(nogil=True)
def _scan(data, kinds, wanted):
    """Ends of all lines, and whether each is regular: the right number of columns, plain numbers in the wanted ones.

    A plain number is made of digits, signs, exponents and at most one point; whatever else, and a quote anywhere
    since it may hide separators, is left to Python.
    """
    lines = 0
    for byte in data:
        lines += byte == 10
    ends, regular = np.empty(lines, np.int64), np.empty(lines, np.bool_)
    columns = len(wanted)
    line, column, points, bad = 0, 0, 0, False
    for i in range(len(data)):
        kind = kinds[data[i]]
        if kind <= _POINT:
            points += kind
        elif kind == _OTHER:
            bad |= column >= columns or wanted[column]
        elif kind == _QUOTE:
            bad = True
        else:
            bad |= points > 1 and (column >= columns or wanted[column])
            points = 0
            column += 1
            if kind == _NEWLINE:
                ends[line] = i
                regular[line] = column == columns and not bad
                line, column, bad = line + 1, 0, False
    return ends, regular
