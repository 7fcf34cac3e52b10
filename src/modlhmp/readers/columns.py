"""Delimited text to columns of numbers, block by block: regular lines through pyarrow, the few others one by one.

Two threads parse ahead of the caller. Every line is either returned as numbers or counted as dropped by name.
"""

import itertools
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from modlhmp.account import Account
from modlhmp.ids import is_missing, is_nobodys
from modlhmp.readers.fields import fields_of, single_blanks
from modlhmp.readers.lines import byte_kinds, plain_ids, scan
from modlhmp.readers.numerals import number
from modlhmp.readers.raw import People, line_blocks
from modlhmp.readers.start import Form, is_row, look_at_start
from modlhmp.storage import DataError

THREADS = 2
NO_ID = -(2**63)  # in the column of ids, where a row has none


class Parsed(NamedTuple):
    """A block's regular lines: {field: numbers or dictionaries of texts}; the ends of all lines, which are regular."""

    block: bytes
    values: dict[str, Any]
    ends: np.ndarray
    regular: np.ndarray


Place = Callable[[], str]  # of a text, for errors: its file and row
Converters = Mapping[str, Callable[[str, Place], float | int | bool | None]]


def read_columns(
    path: str | Path | People, layout: Mapping[str, Any], account: Account, converters: Converters
) -> Iterator[dict[str, np.ndarray]]:
    """Yield the columns of one block after the other as a dict of arrays; `layout` as in `delimited`.

    `row` is the row's number in the file, `track_id` int64, everything else float, NaN where a value is missing.
    `converters` give what a text at a place stands for, by field: None where it is not one of its kind.
    """
    blocks = line_blocks(path)
    form, block, row = look_at_start(path, layout, blocks, frozenset(converters))
    with ThreadPoolExecutor(THREADS) as pool:
        for future in _parsed_ahead(pool, form, itertools.chain([block], blocks)):
            parsed = future.result()
            yield _finish(path, form, parsed, row, account, converters)
            row += len(parsed.ends)


def _parsed_ahead(pool, form, blocks):
    """The futures of the blocks' parsing, in order, a few blocks ahead of the caller."""
    waiting: deque[Any] = deque()
    for block in blocks:
        waiting.append(pool.submit(parse, form, block))
        if len(waiting) > THREADS:
            yield waiting.popleft()
    yield from waiting


def parse(form: Form, block: bytes) -> Parsed:
    """Parse the regular lines of a block of whole lines; safe to run in threads."""
    block = single_blanks(block) if form.separator is None else block
    separator = form.separator or " "
    numbers = np.isin(np.arange(form.width), list(form.numbers.values()))
    comment = form.comment.encode()[0] if form.comment else -1
    kinds = byte_kinds(separator, form.decimal)
    data = np.frombuffer(block, np.uint8)
    ends, regular = scan(data, kinds, numbers, comment)
    if not regular.any():
        return Parsed(block, {}, ends, regular)
    plain = form.ids >= 0 and plain_ids(data, ends, regular, ord(separator), form.ids)
    wanted = dict.fromkeys(form.numbers.values(), pa.float64())
    for field, positions in form.texts.items():
        kind = pa.float64() if field == "track_id" and plain and positions == (form.ids,) else pa.binary()
        wanted |= dict.fromkeys(positions, kind)
    names = [str(position) for position in range(form.width)]
    try:
        table = pa_csv.read_csv(
            pa.BufferReader(_lines(block, ends, regular)),
            pa_csv.ReadOptions(column_names=names, use_threads=False),
            pa_csv.ParseOptions(delimiter=separator),
            pa_csv.ConvertOptions(
                column_types={str(position): kind for position, kind in wanted.items()},
                include_columns=[str(position) for position in wanted],
                strings_can_be_null=False,
                decimal_point=form.decimal,
            ),
        )
    except pa.ArrowInvalid:  # made of a number's characters, but not a number, such as 1-2
        regular[:] = False
        return Parsed(block, {}, ends, regular)
    values: dict[str, Any] = {field: _numbers(table.column(str(position))) for field, position in form.numbers.items()}
    for field, positions in form.texts.items():
        columns = [table.column(str(position)).combine_chunks() for position in positions]
        values[field] = _numbers(table.column(str(positions[0]))) if wanted[positions[0]] == pa.float64() else columns
    return Parsed(block, values, ends, regular)


def _numbers(column):
    return np.from_dlpack(column.fill_null(np.nan).combine_chunks())


def _finish(path, form, parsed, rows_before, account, converters):
    """Columns of a block, its irregular lines read one by one, rows in the file's order."""
    block, values, ends, regular = parsed
    account.rows_read += len(ends)
    columns, faults = {}, {}

    def place(line):
        return f"{path}, row {rows_before + 1 + int(np.flatnonzero(regular)[line])}"

    for field in (*form.numbers, *form.texts):
        columns[field], faults[field] = _converted(field, values.get(field, np.empty(0)), converters, place)
    readable, unread = regular, np.zeros(len(ends), bool)
    if not regular.all():
        readable, every = regular.copy(), {}
        for field in (*form.numbers, *form.texts):
            every[field] = np.zeros(len(ends), np.int64 if field == "track_id" and field in form.texts else np.float64)
            every[field][regular] = columns[field]
        starts = np.concatenate([[0], ends[:-1] + 1])
        blank = ~regular & (ends == starts)  # not one by one: there may be millions
        if blank.any():
            account.drop_rows("blank_line", blank.sum(), f"row {rows_before + 1 + int(np.argmax(blank))}: ''")
        for line in np.flatnonzero(~regular & ~blank):
            text = block[starts[line] : ends[line]].decode("utf-8", "surrogateescape")
            found = _one_row(path, form, text, rows_before + 1 + line, account, converters)
            if found is not None:
                readable[line] = True
                for field, value in found.items():
                    every[field][line] = value
        columns = {field: column[readable] for field, column in every.items()}
    at = np.flatnonzero(readable)
    columns["row"] = rows_before + 1 + at
    for field, fault in faults.items():  # texts that are none of their kind, among the regular lines
        if fault is not None:
            unread[np.flatnonzero(regular)[fault.lines]] = True
            if fault.lines.size:
                row = rows_before + 1 + int(np.flatnonzero(regular)[fault.lines[0]])
                account.drop_rows("text_value", fault.lines.size, f"row {row}: {field} {fault.example!r}")
    if unread.any():
        columns = {field: column[~unread[at]] for field, column in columns.items()}
    return _belonging(columns, form, account)


class _Fault(NamedTuple):
    lines: np.ndarray  # among the regular ones
    example: str


def _converted(field, given, converters, place):
    """A field's column as numbers, and where texts are none of its kind; `place` (a regular line) is for errors."""
    if isinstance(given, np.ndarray):
        return given.astype(np.int64) if field == "track_id" and field in converters else given, None
    import pyarrow.compute as pc  # noqa: PLC0415 - it takes a tenth of a second, and few files have texts

    joined = given[0] if len(given) == 1 else pc.binary_join_element_wise(*given, b"\n")  # which is in no field
    coded = joined.dictionary_encode()
    texts = [_together(one.decode("utf-8", "surrogateescape").split("\n")) for one in coded.dictionary.to_pylist()]
    codes = coded.indices.to_numpy()
    found = [
        _meant(converters[field], text, lambda code=code: place(np.argmax(codes == code)))
        for code, text in enumerate(texts)
    ]
    kind = np.int64 if field == "track_id" else np.float64
    missing = np.array([one is None for one in found], bool)
    column = np.array([0 if one is None else one for one in found], kind)[codes] if texts else np.empty(0, kind)
    lines = np.flatnonzero(missing[codes]) if missing.any() else np.empty(0, np.int64)
    return column, _Fault(lines, texts[codes[lines[0]]] if lines.size else "")


def _together(fields):
    """What a row's fields of one text say: of an id of several parts nobody's, where the first is, or one is empty.

    Beyond the first, -1 may be a floor and None a group. Parts stand between slashes; one that a part holds has a
    backslash before it, so that no two ids are written alike.
    """
    parts = [field.strip() for field in fields]
    if len(parts) == 1:
        return parts[0]
    if is_missing(parts[0]) or is_nobodys(parts[0]):
        return parts[0]
    if any(part.casefold() in ("", "nan", "<na>") for part in parts):
        return ""
    return "/".join(part.replace("\\", r"\\").replace("/", r"\/") for part in parts)


def _meant(converter, text, place):
    """What a text stands for; where that is not known, the `DataError` says its place."""
    try:
        return converter(text, place)
    except DataError as error:
        raise DataError(f"{place()}: {error}") from None


def _belonging(columns, form, account):
    """The rows that belong to somebody: with an id, which is a whole number where a format says so."""
    ids = columns["track_id"]
    whole = ids != NO_ID if "track_id" in form.texts else (np.abs(ids) < 2**53) & (ids == np.rint(ids))
    if not whole.all():
        row = np.argmin(whole)
        shown = "" if "track_id" in form.texts else f" {ids[row]}"
        account.drop_rows("no_track_id", (~whole).sum(), f"row {columns['row'][row]}: track id{shown or ' is empty'}")
        columns = {name: column[whole] for name, column in columns.items()}
    return {**columns, "track_id": columns["track_id"].astype(np.int64)}


def _one_row(path, form, text, row, account, converters):
    """Values of one line by field, or None once it is counted as dropped."""
    fields, example = fields_of(text, form.separator), f"row {row}: {text[:80]!r}"
    if not text.strip():
        account.drop_rows("blank_line", 1, example)
    elif form.comment and text.lstrip().startswith(form.comment):
        account.drop_rows("row_as_comment" if is_row(form, fields) else "comment_line", 1, example)
    elif form.header is not None and fields_of(text.removeprefix("\ufeff"), form.separator) == form.header:
        account.drop_rows("header_again", 1, example)
    elif len(fields) != form.width:
        account.drop_rows("wrong_column_count", 1, example)
        account.note_unread(text)
    else:
        found = {
            field: number(fields[position], form.decimal, form.thousands) for field, position in form.numbers.items()
        }
        for field, positions in form.texts.items():
            given = _together([fields[position] for position in positions])
            found[field] = _meant(converters[field], given, lambda: f"{path}, row {row}")
        if None not in found.values():
            return found
        account.drop_rows("text_value", 1, example)
        account.note_unread(text)
    return None


def _lines(block, ends, chosen):
    """The bytes of the chosen lines; the block itself where all are."""
    if chosen.all():
        return block
    starts = np.concatenate([[0], ends[:-1] + 1])
    # One piece per run of neighbouring lines.
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return b"".join(block[starts[i] : ends[j - 1] + 1] for i, j in edges.reshape(-1, 2))
