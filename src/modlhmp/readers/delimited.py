"""Any recording in delimited text: one row a person and time, columns by name or position, units as said.

The ATC readers are layouts of this one. Files are read in blocks; where rows carry velocities, each block is at
once reduced to the last sample of every person and time step, so memory does not follow the raw rate.
"""

import codecs
import csv

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from numba import njit

from modlhmp.readers.account import Account
from modlhmp.readers.raw import line_blocks
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, concatenate, wrap_angle

MAX_DISTANCE_M = 10_000.0  # farther from the origin, or faster, is a sensor fault, not a walking person
MAX_SPEED_MPS = 15.0
_LENGTH_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_SECONDS = {"s": 1.0, "ms": 0.001}
FIELDS = ("track_id", "t", "x", "y", "speed", "heading")


def read_delimited(path, layout, day=None, step_s=1.0):
    """Read a file into rows sorted by track and time.

    `layout` holds `columns` (field -> position from 0, or name with `header: true`), `width` (columns a row, None:
    as the first row has), `separator`, `header`, `units` {time: s|ms|frame, length: m|cm|mm|px, angle: rad|deg},
    `scale` [m/px], `frame_rate` [1/s], `origin` (unix time of time 0). `day` = (first, last) unix second of the
    recording's day; rows outside are dropped. With speed and heading columns the last sample of each `step_s` is
    kept. Returns (Tracks, Account).
    """
    parser, has_velocity = _Parser(path, layout), "speed" in layout["columns"]
    account, pieces, previous = Account(), [], -np.inf
    for block in line_blocks(path):
        values = parser.parse(block, account)
        rows = _to_si(values, layout)
        rows = _drop_bad_rows(rows, values["row"], has_velocity, day, account)
        latest = np.maximum.accumulate(np.concatenate([[previous], rows.t]))
        account.notes["rows_out_of_time_order"] += int(np.sum(rows.t < latest[:-1]))
        previous = latest[-1]
        pieces.append(_last_of_step(rows, step_s, account) if has_velocity else rows)
    rows = concatenate(pieces)
    rows = _last_of_step(rows, step_s, account) if has_velocity else _without_repeats(_sort(rows), account)
    if not len(rows.t):
        raise DataError(f"{path}: no usable row; {account.rows_read} read, dropped {dict(account.dropped_rows)}")
    return rows, account


def _sort(rows):
    return rows.take(np.lexsort((rows.t, rows.track_id)))


def _without_repeats(rows, account):
    """Sorted rows without further rows of the same person and time: the first one counts."""
    repeated = np.zeros(len(rows.t), bool)
    repeated[1:] = (np.diff(rows.track_id) == 0) & (np.diff(rows.t) == 0)
    account.drop_rows("duplicate_row", repeated.sum())
    return rows.take(~repeated)


def _last_of_step(rows, step_s, account):
    """Keep each person's last sample of each time step, as the 1 Hz ATC files do."""
    rows = _without_repeats(_sort(rows), account)
    bins = np.floor(rows.t / step_s + 1e-4)  # a clock's rounding does not move a row into the step before
    overtaken = np.zeros(len(rows.t), bool)
    overtaken[:-1] = (np.diff(rows.track_id) == 0) & (np.diff(bins) == 0)
    account.drop_rows("downsampled", overtaken.sum())
    return rows.take(~overtaken)


def _to_si(values, layout):
    """Raw columns to the units of the track table."""
    units = {"time": "s", "length": "m", "angle": "rad", **layout.get("units", {})}
    seconds = 1.0 / layout["frame_rate"] if units["time"] == "frame" else _SECONDS[units["time"]]
    metres = layout["scale"] if units["length"] == "px" else _LENGTH_M[units["length"]]
    unknown = np.full(len(values["t"]), np.nan)
    heading = values.get("heading", unknown)
    return Tracks(
        values["track_id"],
        values["t"] * seconds + layout.get("origin", 0.0),
        values["x"] * metres,
        values["y"] * metres,
        values["speed"] * metres if "speed" in values else unknown,
        np.deg2rad(heading) if units["angle"] == "deg" else heading,
    )


def _drop_bad_rows(rows, numbers, has_velocity, day, account):
    """Drop rows that no person can have made, each under one name, the first that applies."""
    measured = [rows.t, rows.x, rows.y] + [rows.speed, rows.heading] * has_velocity
    speed = np.nan_to_num(rows.speed)
    first, last = day or (-np.inf, np.inf)
    with np.errstate(invalid="ignore"):
        tests = {
            "infinite_value": np.logical_or.reduce([np.isinf(column) for column in measured]),
            "nan_value": np.logical_or.reduce([np.isnan(column) for column in measured]) | np.isnan(numbers),
            "no_person": rows.track_id < 0,
            "absurd_value": (np.hypot(rows.x, rows.y) > MAX_DISTANCE_M) | (speed < 0) | (speed > MAX_SPEED_MPS),
            "outside_day": (rows.t < first) | (rows.t >= last),
        }  # fmt: skip
    good = np.ones(len(rows.t), bool)
    for reason, failed in tests.items():
        bad = failed & good
        if bad.any():
            row = int(np.argmax(bad))
            values = ", ".join(f"{name} {column[row]:g}" for name, column in zip(FIELDS, rows, strict=True))
            account.drop_rows(reason, bad.sum(), f"row {int(numbers[row])}: {values}")
            good &= ~bad
    rows = rows.take(good)
    return rows._replace(heading=wrap_angle(rows.heading))


class _Parser:
    """Bytes to columns: regular lines through pyarrow at once, the few others one by one."""

    def __init__(self, path, layout):
        self.path, self.layout = path, layout
        self.separator = layout.get("separator", ",")
        self.kinds = _byte_kinds(self.separator)
        self.row, self.names = 0, None

    def parse(self, block, account):
        """Columns of one block: float arrays, `track_id` int64, and `row`, the row's number in the file."""
        if self.names is None:
            block = self._start(block)
        columns = self._columns(block, account)
        # A row without a whole number as id belongs to nobody.
        ids = columns["track_id"]
        whole = np.isfinite(ids) & (np.abs(ids) < 2**53)
        whole[whole] = ids[whole] % 1 == 0
        if not whole.all():
            row = np.argmin(whole)
            account.drop_rows("no_track_id", (~whole).sum(), f"row {columns['row'][row]:.0f}: track id {ids[row]}")
            columns = {name: column[whole] for name, column in columns.items()}
        columns["track_id"] = columns["track_id"].astype(np.int64)
        return columns

    def _start(self, block):
        """Look at the first row: header or not, number of columns, positions of the named columns."""
        block = block.removeprefix(codecs.BOM_UTF8)
        first, _, rest = block.partition(b"\n")
        fields = self._fields(first.decode("utf-8", "replace"))
        if self.layout.get("header"):
            self.names, self.row, block = fields, 1, rest
        else:
            self.names = [str(position) for position in range(len(fields))]
            if not any(_is_number(field) for field in fields):
                raise DataError(
                    f"{self.path}, row 1: {first.decode(errors='replace')[:80]!r} is a header where numbers are "
                    "expected; remove that line, or use `reader: delimited` with `header: true`"
                )
        width = self.layout.get("width")
        if width and len(fields) != width:
            raise DataError(
                f"{self.path}, row 1: {len(fields)} columns, but this format has {width}: is `reader` right?"
            )
        self.wanted = {}
        for field, column in self.layout["columns"].items():
            name = column if self.layout.get("header") and isinstance(column, str) else str(column)
            if isinstance(column, int) and self.layout.get("header"):
                name = self.names[column] if column < len(self.names) else None
            if self.names.count(name) > 1:
                raise DataError(
                    f"{self.path}, row 1: {self.names.count(name)} columns are called {name!r}; use positions"
                )
            if name not in self.names:
                raise DataError(f"{self.path}, row 1: no column {column!r} for {field}; it has {', '.join(self.names)}")
            self.wanted[field] = name
        return block

    def _columns(self, block, account):
        """Values of the wanted columns and the row numbers, rows in the file's order."""
        positions = np.array([self.names.index(name) for name in self.wanted.values()])
        ends, regular = _scan(
            np.frombuffer(block, np.uint8), self.kinds, np.isin(np.arange(len(self.names)), positions)
        )
        numbers = np.arange(self.row + 1, self.row + 1 + len(ends))
        self.row += len(ends)
        account.rows_read += len(ends)
        try:
            values = (
                self._through_arrow(_lines(block, ends, regular)) if regular.any() else np.empty((len(positions), 0))
            )
        except pa.ArrowInvalid:  # made of a number's characters, but not a number, such as 1-2
            regular[:] = False
            values = np.empty((len(positions), 0))
        rows = numbers[regular]
        if not regular.all():
            starts = np.concatenate([[0], ends[:-1] + 1])
            others = {}
            for line in np.flatnonzero(~regular):
                text = block[starts[line] : ends[line]].decode("utf-8", "replace")
                row = self._one_row(text, positions, numbers[line], account)
                if row is not None:
                    others[numbers[line]] = row
            rows = np.concatenate([rows, np.array(list(others), np.int64)])
            values = np.concatenate([values, np.array(list(others.values())).reshape(-1, len(positions)).T], axis=1)
            order = np.argsort(rows)
            rows, values = rows[order], values[:, order]
        return {**dict(zip(self.wanted, values, strict=True)), "row": rows}

    def _through_arrow(self, block):
        table = pa_csv.read_csv(
            pa.BufferReader(block),
            pa_csv.ReadOptions(column_names=[str(position) for position in range(len(self.names))]),
            pa_csv.ParseOptions(delimiter=self.separator),
            pa_csv.ConvertOptions(
                column_types={str(position): pa.float64() for position in range(len(self.names))},
                include_columns=[str(self.names.index(name)) for name in self.wanted.values()],
            ),
        )
        return [column.to_numpy() for column in table.columns]  # null becomes NaN

    def _one_row(self, text, positions, row, account):
        """Values of one line, or None once it is counted as dropped."""
        fields, example = self._fields(text), f"row {row}: {text[:80]!r}"
        if not text.strip():
            account.drop_rows("blank_line", 1, example)
        elif len(fields) != len(self.names):
            account.drop_rows("wrong_column_count", 1, example)
        else:
            try:
                return [float(fields[position] or "nan") for position in positions]
            except ValueError:
                account.drop_rows("text_value", 1, example)
        return None

    def _fields(self, line):
        """Fields of a line, quotes and blanks around them removed; a line of unbalanced quotes is one field."""
        line = line.strip("\r")
        if '"' in line:
            try:
                return [field.strip() for field in next(csv.reader([line], delimiter=self.separator, strict=True))]
            except (csv.Error, StopIteration):
                return [line]
        return [field.strip() for field in line.split(self.separator)]


def _lines(block, ends, chosen):
    """The bytes of the chosen lines; the block itself where all are."""
    if chosen.all():
        return block
    starts = np.concatenate([[0], ends[:-1] + 1])
    # One piece a run of neighbouring lines.
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


@njit(cache=True)
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
