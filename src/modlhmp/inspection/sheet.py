"""The first lines of a text file as a table: its separator, marks in numbers, comments, preamble and header."""

import codecs
import itertools
import re
from collections import Counter, deque
from pathlib import Path
from typing import NamedTuple

from modlhmp.readers.fields import fields_of
from modlhmp.readers.numerals import number
from modlhmp.readers.raw import FILE_COLUMN, People, line_blocks
from modlhmp.storage import DataError

MOST_LINES, MOST_BYTES = 20_000, 1 << 23  # that are looked at: whatever comes first
MOST_FIELDS = 100_000  # by which a separator is chosen
_COMMENTS = "#%"
_SEPARATORS = (";", "\t", ",", "|", None)  # None: blanks; of those that fit as well, the first one
_MARKS = ((".", ""), (",", ""), (".", ","), (".", "'"), (".", " "), (",", "."), (",", "'"), (",", " "))  # likewise
_LEAST_COLUMNS = 3  # of one person's file: a time and two positions
_MOST_ODD = 0.05  # of rows that may have another number of fields, and are not read


class Sheet(NamedTuple):
    """How a text file is written, and the fields of its first rows, all of the same number.

    `separator` None: blanks; `skip_lines`: before the header or the first row, comments not counted where they are
    known as such; `names`: those of the header, or of a comment that looks like one (`header` says which); `rows` are
    the raw fields; `comments` the comment lines. Numbers have a `decimal` mark and marks of `thousands`, if not empty.
    `asks` are remarks on keys that a human must decide, `notes` those on lines that are not read.
    """

    separator: str | None
    decimal: str
    thousands: str
    comment: str | None
    skip_lines: int
    header: bool
    names: list[str]
    rows: list[list[str]]
    comments: list[str]
    asks: dict[str, str]
    notes: list[str]

    def number(self, text: str) -> float | None:
        """The number that a field is, None for any other text."""
        return number(text, self.decimal, self.thousands)

    def called(self, column: int) -> int | str:
        """How a column is called in a dataset file: by its name where that is one, else by position."""
        name = self.names[column] if self.header else ""
        return name if name and "\ufffd" not in name and self.names.count(name) == 1 else column


def first_lines(path: str | Path | People) -> list[str]:
    """The first lines of a text file; `DataError` where it is none, or in an encoding that readers do not take."""
    lines: list[str] = []
    size = 0
    for block in line_blocks(path):
        lines += _lines_of(block)
        size += len(block)
        if len(lines) >= MOST_LINES or size >= MOST_BYTES:
            break
    return lines[:MOST_LINES]


def last_lines(path: str | Path | People) -> list[str]:
    """The last lines of a text file, of which all is read, as it may be compressed, but nothing else looked at."""
    return _lines_of(deque(line_blocks(path), maxlen=1).pop())[-MOST_LINES:]


def _lines_of(block):
    """The lines of a block of whole lines; they have no other ends than readers count."""
    text = block.removeprefix(codecs.BOM_UTF8).decode("utf-8", "replace").removesuffix("\n")
    return [line.rstrip("\r") for line in text.split("\n")]


def read_sheet(path: str | Path | People, lines: list[str]) -> Sheet:
    """The table that a file's first lines hold; `DataError` where no form gives one of three columns or more."""
    first = next((line.lstrip()[0] for line in lines if line.strip()), "")
    mark = first if first in _COMMENTS and first else "#" if any(line.startswith("#") for line in lines) else None
    for comment in dict.fromkeys((mark, None)):  # None: where all ids begin so, nothing is a comment
        commented = [line.strip() for line in lines if comment and line.lstrip().startswith(comment)]
        kept = [
            (n, line) for n, line in enumerate(lines) if line.strip() and not (comment and line.lstrip()[0] == comment)
        ]
        best = max((_fits([line for _, line in kept], separator) for separator in _SEPARATORS), key=lambda fit: fit[0])
        score, separator, marks, width, numeric = best
        if score > 0:
            break

    def is_row(row):
        return len(row) == width and _is_data(row, numeric, marks)

    table = [(n, _fields(line, separator)) for n, line in kept]
    begin = next((i for i, (_, row) in enumerate(table) if is_row(row)), None)
    if score <= 0 or begin is None:  # or columns of nothing, which is a number that was not measured
        raise DataError(f"{path}: {_no_table([line for _, line in kept])}")
    odd = {n: line for (n, line), (_, row) in zip(kept, table, strict=True)
           if len(row) != width and _looks_like_row(line, separator, marks)}  # fmt: skip
    _refuse_many(path, odd, len(kept), width)
    top = begin
    while top and (table[top - 1][0] in odd or not any(table[top - 1][1])):  # the names stand above those, too
        top -= 1
    above = [(n, row) for n, row in itertools.islice(table, max(top - 2, 0), top) if len(row) == width]
    if len(above) == 2 and not (_are_alike(above[1][1]) and not _are_alike(above[0][1])):
        above = above[1:]  # the line before the names is of a preamble
    names = above[0][1] if above else _names_in(commented, width, [FILE_COLUMN] * isinstance(path, People))
    rows = [(n, row) for n, row in table[begin:] if len(row) == width]
    number_of_line = above[0][0] if above else rows[0][0]
    skipped = number_of_line if kept[0][0] < number_of_line else 0
    asks, notes = {}, []
    if before := [line for n, line in odd.items() if n < skipped]:
        asks["skip_lines"] = f"rows or not? {_counted(before)}"
    if inside := [line for n, line in odd.items() if n >= skipped]:
        notes.append(f"decide: rows with other than {width} fields are not read: {_counted(inside)}")
    if like_rows := [line for line in commented if is_row(_fields(line, separator))]:
        asks["comment"] = f"rows or not? {_counted(like_rows)}; if ids begin so, set ''"
    rows_alone = [row for _, row in rows]
    decimal, thousands = marks
    if separator in marks and not above:  # readers tell them apart by the header's width
        raise DataError(
            f"{path}: numbers in quotes, such as those of {kept[begin][1].strip()[:80]!r}, hold the mark that stands "
            "between columns as well, and no header names these: add one, or save the file with ; between columns"
        )
    return Sheet(
        separator, decimal, thousands, comment, skipped, bool(above), names, rows_alone, commented, asks, notes
    )  # fmt: skip


def _are_alike(fields):
    """Whether some fields are the same, as the units of x and y are, or their types, but no names."""
    written = [field for field in fields if field]
    return len(set(written)) < len(written)


def _looks_like_row(line, separator, marks):
    """Whether most fields of a line are numbers, quotes that may end in a later line not counted."""
    fields = _fields(line.replace('"', ""), separator)
    numbers = sum(bool(field) and number(field, *marks) is not None for field in fields)
    return numbers >= _LEAST_COLUMNS and 2 * numbers > len(fields)


def _refuse_many(path, odd, lines, width):
    """`DataError` where so many rows have another number of fields that no form reads the table."""
    if len(odd) > max(_MOST_ODD * lines, 3):
        number_of_line = next(iter(odd)) + 1
        raise DataError(
            f"{path}: of the first {lines} lines most have {width} fields, but {len(odd)} others look like rows as "
            f"well, such as line {number_of_line}, {odd[number_of_line - 1].strip()[:80]!r}: write all rows with as "
            "many fields as the first line, and each in one line"
        )


def _counted(lines):
    return f"{len(lines)} of the first lines, such as {lines[0].strip()[:80]!r}"


def _no_table(lines):
    """What is said of a file that holds no table."""
    first = lines[0].strip() if lines else ""
    if first.startswith(("[{", "[[", "{")) or first == "[":
        return "is JSON; export it as CSV, one row for each person and time, or as TrajNet++'s JSON lines"
    if len(lines) == 1 and any(len(_fields(first, one)) >= _LEAST_COLUMNS for one in (";", "\t", ",", "|")):
        return f"has no row, only {first[:80]!r}; was the export cut off?"
    if (line := next((one for one in lines[:9] if one.count('"') % 2), None)) is not None:
        return f"has texts in quotes that go over several lines, such as {line[:80]!r}: write each row in one line"
    fields = [field for line in lines[1:3] for separator in _SEPARATORS for field in _fields(line, separator)]
    if suffixed := next((field for field in fields if re.fullmatch(r"-?\d+(\.\d+)? ?(m|cm|mm|s|ms|m/s)", field)), None):
        return f"has numbers with their units, such as {suffixed!r}: write numbers alone"
    if other := next((field for field in fields if any(one.isdigit() and not one.isascii() for one in field)), None):
        return f"has digits other than 0 to 9, such as {other!r}: rewrite them"
    return f"holds no table of an id, a time and two positions in each line; it begins {' / '.join(lines[:3])[:120]!r}"


def _fits(lines, separator):
    """How well a separator fits: (score, separator, marks in numbers, columns, which of them are of numbers)."""
    sample = lines[max(len(lines) // 5, len(lines) > 1) :][:300]  # neither a preamble nor names
    rows = [_fields(line, separator) for line in sample]
    counts = Counter(map(len, rows))
    width, often = max(counts.items(), key=lambda item: (item[1], item[0])) if counts else (0, 0)
    best: tuple[float, str | None, tuple[str, str], int, list[int]] = (0.0, separator, _MARKS[0], width, [])
    if width < _LEAST_COLUMNS:
        return best
    rows = [row for row in rows if len(row) == width][: MOST_FIELDS // width + 1]
    between = separator or " "
    quoted = any(between in field for row in rows for field in row)
    for marks in _MARKS:
        if between in marks and not quoted:
            continue
        numeric = [
            column
            for column in range(width)
            if sum(number(row[column], *marks) is not None for row in rows) >= 0.8 * len(rows)
        ]
        # Blanks may also be marks of thousands, and then make more columns.
        score = len(numeric) * (often / len(sample)) ** 2 * (0.6 if separator is None else 1.0)
        better = score > best[0] or (score == best[0] and marks == (".", ",") and _are_groups(rows, numeric))
        if len(numeric) >= 2 and better:
            best = (score, separator, marks, width, numeric)
    return best


def _are_groups(rows, numeric):
    """Whether commas stand for thousands rather than decimals: in a column with them, smaller numbers have none."""
    for column in numeric:
        texts = [row[column].lstrip("+-") for row in rows]
        marked = [text for text in texts if "," in text]
        small = [text for text in texts if text and "," not in text]
        if marked and small and all(re.fullmatch(r"[1-9]\d{0,2}(,\d{3})+", text) for text in marked):
            return all(len(text) <= 3 for text in small)
    return False


def _fields(line, separator):
    return fields_of(" ".join(line.split()) if separator is None else line, separator)


def _is_data(row, numeric, marks):
    """Whether a row holds numbers where others do; some may not have been measured."""
    return sum(bool(row[column]) and number(row[column], *marks) is not None for column in numeric) * 2 >= len(numeric)


def _names_in(comments, width, before):
    """Names of the columns, `before` first, in the last comment that has as many words as there are columns."""
    for line in reversed(comments):
        words = [*before, *line.strip("#% ").replace(",", " ").replace(";", " ").split()]
        if len(words) == width and not any(number(word) is not None for word in words):
            return words
    return []
