"""Kernels that look at a block of lines: where each ends, and which of them pyarrow may read."""

import numpy as np

from modlhmp.kernels import kernel

# What a byte can be to `scan`.
_NUMBER, _POINT, _SEPARATOR, _NEWLINE, _QUOTE, _OTHER = range(6)
_MOST_DIGITS = 15  # of a whole number that a float holds exactly


def byte_kinds(separator: str, decimal: str) -> np.ndarray:
    """What each of the 256 bytes can be to `scan`."""
    kinds = np.full(256, _OTHER, np.uint8)
    kinds[list(b"0123456789+-eE\r")] = _NUMBER
    for byte, kind in ((decimal, _POINT), (separator, _SEPARATOR), ("\n", _NEWLINE), ('"', _QUOTE)):
        kinds[ord(byte)] = kind
    return kinds


@kernel(nogil=True)
def scan(data, kinds, numbers, comment):
    """Ends of all lines, and which are regular.

    A line is regular that has the right number of columns, plain numbers in those of `numbers`, and does not
    begin with the byte `comment`. A plain number is made of digits, signs, exponents and at most one point; whatever
    else, and a quote anywhere since it may hide separators, is left to Python.
    """
    lines = 0
    for byte in data:
        lines += byte == 10
    ends, regular = np.empty(lines, np.int64), np.empty(lines, np.bool_)
    columns = len(numbers)
    line, column, points, bad = 0, 0, 0, False
    for i in range(len(data)):
        kind = kinds[data[i]]
        if kind <= _POINT:
            points += kind
        elif kind == _OTHER:
            bad |= column >= columns or numbers[column] or (column == 0 and data[i] == comment)
        elif kind == _QUOTE:
            bad = True
        else:
            bad |= points > 1 and (column >= columns or numbers[column])
            points = 0
            column += 1
            if kind == _NEWLINE:
                ends[line] = i
                regular[line] = column == columns and not bad
                line, column, bad = line + 1, 0, False
    return ends, regular


@kernel(nogil=True)
def plain_ids(data, ends, regular, separator, position):
    """Whether the field at a position is a plain whole number, which a float holds, in all regular lines."""
    at = 0
    for line in range(len(ends)):
        if regular[line]:
            column = 0
            while column < position:
                column += data[at] == separator
                at += 1
            at += data[at] == 45
            first, digits = at, 0
            while 48 <= data[at] <= 57:
                at += 1
            digits = at - first
            if data[at] not in (separator, 13, 10) or not 0 < digits <= _MOST_DIGITS:
                return False
            if data[first] == 48 and (digits > 1 or (first > 0 and data[first - 1] == 45)):
                return False
        at = ends[line] + 1
    return True
