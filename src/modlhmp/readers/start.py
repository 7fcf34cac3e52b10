"""The start of a delimited file: how its lines are written, and at which position each column is."""

import codecs
import csv
import re
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import Any, NamedTuple

from modlhmp.readers.hints import hint
from modlhmp.readers.numerals import number
from modlhmp.readers.raw import People
from modlhmp.storage import DataError

MOST_COLUMNS = 10_000
_MOST_COMMENTS = 1000  # at a file's start, of which it is looked whether they are rows
_NO_HEADER = "is a header where numbers are expected; remove that line, or use `reader: delimited` with `header: true`"


class Form(NamedTuple):
    """Form of a file: its columns of numbers and of text, field by field, and how its lines are written.

    `numbers` and `texts` map a field to its positions among `width` columns; a text of several columns is joined by
    slashes. `separator` None stands for any blanks. `ids` is the position of ids that may be plain numbers, -1 where
    there is none: they are read as text only where a block has others. `header` holds the names in the first row.
    """

    numbers: dict[str, int]
    texts: dict[str, tuple[int, ...]]
    width: int
    separator: str | None
    decimal: str
    thousands: str
    comment: str
    ids: int
    header: list[str] | None


class _First(NamedTuple):
    """A file's first row, which may name the columns: where it is, its line and fields, the text from there on.

    `comments` are those before it in the `whole` block: the number of lines before each, and where it begins.
    """

    place: str
    lines_before: int
    line: bytes
    fields: list[str]
    block: bytes
    whole: bytes
    comments: list[tuple[int, int]]


def look_at_start(
    path: str | Path | People, layout: Mapping[str, Any], blocks: Iterator[bytes], texts: Set[str]
) -> tuple[Form, bytes, int]:
    """From a file's first blocks: its form, the block from the first row of data on, the number of lines before that.

    `layout` as in `delimited`; `texts` are the fields that are text. `DataError` where the file is not as it says.
    """
    decimal, thousands = layout.get("decimal") or ".", layout.get("thousands") or ""
    form = Form({}, {}, 0, layout.get("separator", ","), decimal, thousands, layout.get("comment") or "", -1, None)
    first = _first_row(path, layout, blocks, form)
    _check_first(first, layout, form, texts)
    form = _with_columns(form, first, layout, texts)
    if layout.get("header"):
        return form, first.block.partition(b"\n")[2], first.lines_before + 1
    for before, begin in first.comments:
        line = first.whole[begin : _after_line(first.whole, begin)]
        if is_row(form, _fields_of_line(line, form)):  # ids may begin with the mark: then these lines are counted
            return form, first.whole[begin:], before
    return form, first.block, first.lines_before


def _first_row(path, layout, blocks, form):
    """The first row: after a mark of the encoding, the lines to skip, blank lines and comments."""
    block, before = next(blocks).removeprefix(codecs.BOM_UTF8), layout.get("skip_lines") or 0
    begin = 0  # of the line, not cut off from the block: each cut copies all that is left
    for skipped in range(before):
        if begin == len(block):
            raise DataError(f"{path}: skip_lines {before}: there are {skipped} lines only, or the first are too long")
        begin = _after_line(block, begin)
    comment, comments = form.comment.encode(), list[tuple[int, int]]()
    while True:
        if begin == len(block):
            block, begin, comments = next(blocks, b""), 0, []
        if not block:
            also = f", or lines that begin with {form.comment!r} as comments do" if comment else ""
            raise DataError(f"{path}: has no row, only blank lines{also}; was the export cut off?")
        end = _after_line(block, begin)
        line = block[begin:end]
        if line.strip() and not (comment and line.lstrip().startswith(comment)):
            break
        if line.strip() and len(comments) < _MOST_COMMENTS:
            comments.append((before, begin))
        begin, before = end, before + 1
    line = line.removesuffix(b"\n")
    fields = _fields_of_line(line, form)
    return _First(f"{path}, row {before + 1}", before, line, fields, block[begin:], block, comments)


def _fields_of_line(line, form):
    plain = single_blanks(line) if form.separator is None else line
    return fields_of(plain.decode("utf-8", "replace"), form.separator)


def _after_line(block, begin):
    """Where the line that begins there is over."""
    return block.find(b"\n", begin) + 1 or len(block)


def _check_first(first, layout, form, texts):
    """Whether there is a header where one is said to be, and as many columns as a format has."""
    if len(first.fields) > MOST_COLUMNS:
        raise DataError(f"{first.place}: {len(first.fields)} columns; at most {MOST_COLUMNS} are read")
    numbers = [number(field, form.decimal, form.thousands) is not None for field in first.fields]
    all_text = set(layout["columns"]) <= texts
    if not layout.get("header") and not any(numbers) and not all_text:
        shown = first.line.decode(errors="replace")[:80]
        raise DataError(f"{first.place}: {shown!r} {hint(first.block, layout) or _NO_HEADER}")
    if layout.get("header") and all(numbers):
        raise DataError(
            f"{first.place}: only numbers, but `header: true` says that it names the columns; drop that key"
        )
    if layout.get("width") and len(first.fields) != layout["width"]:
        raise DataError(
            f"{first.place}: {len(first.fields)} columns, but this format has {layout['width']}: is `reader` right?"
        )


def _with_columns(form, first, layout, texts):
    """The form with the positions of its columns."""
    numbers, joined = {}, {}
    for field, column in layout["columns"].items():
        several = column if isinstance(column, list | tuple) else [column]
        positions = tuple(_position(first, field, one, layout) for one in several)
        if field in texts:
            joined[field] = positions
        else:
            numbers[field] = positions[0]
    ids = joined.get("track_id", ())
    if both := [field for field, at in numbers.items() if any(at in positions for positions in joined.values())]:
        raise DataError(
            f"{first.place}: the column of {both[0]} is one of numbers, and {layout['columns'][both[0]]!r} is compared "
            "as text as well (`only`, `without`, `split` or an id); name another column"
        )
    return form._replace(
        numbers=numbers, texts=joined, width=len(first.fields), ids=ids[0] if len(ids) == 1 else -1,
        header=first.fields if layout.get("header") else None,
    )  # fmt: skip


def _position(first, field, column, layout):
    """Position of a column that the layout gives by position or, with a header, by name."""
    names, header = first.fields, layout.get("header")
    if isinstance(column, int) and column < len(names):
        return column
    if header and names.count(column) > 1:
        raise DataError(f"{first.place}: {names.count(column)} columns are called {column!r}; use positions")
    if not header or column not in names:
        known = names if header else [f"positions 0 to {len(names) - 1}"]
        advice = hint(first.block, layout)
        raise DataError(
            f"{first.place}: no column {column!r} for {field}; it has {', '.join(known)}"
            + (f"; this {advice}" if advice else "")
        )
    return names.index(column)


def is_row(form: Form, fields: list[str]) -> bool:
    """Whether a line is a row, whatever it begins with: it has all columns, and numbers where these are expected."""
    return len(fields) == form.width and all(
        fields[at] and number(fields[at], form.decimal, form.thousands) is not None for at in form.numbers.values()
    )


def single_blanks(block: bytes) -> bytes:
    """Lines whose fields are separated by runs of blanks and tabs, one blank between fields and none around them."""
    block = re.sub(rb"[ \t]+", b" ", block)
    return re.sub(rb"(?m)^ | (?=\r?$)", b"", block)


def fields_of(line: str, separator: str | None) -> list[str]:
    """Fields of a line, quotes and blanks around them removed; a line of unbalanced quotes is one field."""
    line = line.strip("\r\n")
    if '"' in line:
        try:
            return [field.strip() for field in next(csv.reader([line], delimiter=separator or " ", strict=True))]
        except (csv.Error, StopIteration):
            return [line]
    return [field.strip() for field in line.split(separator or " ")]
