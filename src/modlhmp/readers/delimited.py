"""Any recording in delimited text: one row a person and time, columns by name or position, units as said.

The ATC readers are layouts of this one. Files are read in blocks; where rows carry velocities, each block is at
once reduced to the last sample of every person and time step, so memory does not follow the raw rate.
"""

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv

from modlhmp.readers.account import Account
from modlhmp.readers.raw import line_blocks
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, concatenate, wrap_angle

MAX_DISTANCE_M = 10_000.0  # farther from the origin, or faster, is a sensor fault, not a walking person
MAX_SPEED_MPS = 15.0
_SLOW_PATH_BYTES = 1 << 15
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
    parser = _Parser(path, layout)
    account, pieces, previous = Account(), [], -np.inf
    for block in line_blocks(path):
        values = parser.parse(block, account)
        rows = _to_si(values, layout)
        latest = np.fmax.accumulate(np.concatenate([[previous], rows.t]))
        account.notes["rows_out_of_time_order"] += int(np.sum(rows.t < latest[:-1]))
        previous = latest[-1]
        rows = _drop_bad_rows(rows, values["row"], day, account)
        pieces.append(_last_of_step(rows, step_s, account) if "speed" in layout["columns"] else rows)
    rows = _sort(concatenate(pieces))
    if "speed" in layout["columns"]:
        rows = _last_of_step(rows, step_s, account)
    else:
        same = np.zeros(len(rows.t), bool)
        same[1:] = (np.diff(rows.track_id) == 0) & (np.diff(rows.t) == 0)
        account.drop_rows("duplicate_row", same.sum())
        rows = rows.take(~same)
    if not len(rows.t):
        raise DataError(f"{path}: no usable row; {account.rows_read} read, dropped {dict(account.dropped_rows)}")
    return rows, account


def _sort(rows):
    return rows.take(np.lexsort((rows.t, rows.track_id)))


def _last_of_step(rows, step_s, account):
    """Keep each person's last sample of each time step, as the 1 Hz ATC files do."""
    rows = _sort(rows)
    same_track = np.diff(rows.track_id) == 0
    repeated = np.concatenate([[False], same_track & (np.diff(rows.t) == 0)])
    account.drop_rows("duplicate_row", repeated.sum())
    rows = rows.take(~repeated)
    bins = np.floor(rows.t / step_s)
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


def _drop_bad_rows(rows, numbers, day, account):
    """Drop rows that no person can have made, each under one name, the first that applies."""
    measured = [rows.t, rows.x, rows.y] + ([rows.speed, rows.heading] if not np.isnan(rows.speed).all() else [])
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
    """Bytes to columns: pyarrow where a block is clean, row by row in the small piece around a row that is not."""

    def __init__(self, path, layout):
        self.path, self.layout = path, layout
        self.separator = layout.get("separator", ",")
        self.row, self.names = 0, None

    def parse(self, block, account):
        """Columns of one block: float arrays, `track_id` int64, and `row`, the row's number in the file."""
        if self.names is None:
            block = self._start(block)
        columns = self._columns(block, account)
        # A row without an id belongs to nobody; it is counted with the other incomplete rows.
        known = ~np.isnan(columns["track_id"])
        account.drop_rows(
            "nan_value",
            (~known).sum(),
            f"row {int(columns['row'][np.argmin(known)]) if len(known) else 0}: no track id",
        )
        columns = {name: column[known] for name, column in columns.items()}
        columns["track_id"] = columns["track_id"].astype(np.int64)
        return columns

    def _start(self, block):
        """Look at the first row: header or not, number of columns, positions of the named columns."""
        first, _, rest = block.partition(b"\n")
        fields = [field.strip() for field in first.decode("utf-8-sig", "replace").strip("\r").split(self.separator)]
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
            if name not in self.names:
                raise DataError(f"{self.path}, row 1: no column {column!r} for {field}; it has {', '.join(self.names)}")
            self.wanted[field] = name
        return block

    def _columns(self, block, account):
        lines = block.count(b"\n")
        if not lines:
            return {name: np.empty(0) for name in [*self.wanted, "row"]}
        try:
            table = pa_csv.read_csv(
                pa.BufferReader(block),
                pa_csv.ReadOptions(column_names=self.names),
                pa_csv.ParseOptions(delimiter=self.separator),
                pa_csv.ConvertOptions(
                    column_types={name: pa.float64() for name in self.names},
                    include_columns=list(dict.fromkeys(self.wanted.values())),
                ),
            )
            clean = table.num_rows == lines
        except pa.ArrowInvalid:
            clean = False
        if clean:
            columns = {field: pc.fill_null(table[name], np.nan).to_numpy() for field, name in self.wanted.items()}
            columns["row"] = np.arange(self.row + 1, self.row + 1 + lines, dtype=float)
            account.rows_read += lines
            self.row += lines
            return columns
        if len(block) > _SLOW_PATH_BYTES and lines > 1:
            cut = block.find(b"\n", len(block) // 2) + 1 or block.rfind(b"\n", 0, len(block) - 1) + 1
            cut = cut if cut < len(block) else block.rfind(b"\n", 0, len(block) - 1) + 1
            halves = [self._columns(half, account) for half in (block[:cut], block[cut:])]
            return {name: np.concatenate([half[name] for half in halves]) for name in halves[0]}
        return self._row_by_row(block, account)

    def _row_by_row(self, block, account):
        positions = [self.names.index(name) for name in self.wanted.values()]
        kept = []
        for line in block.decode("utf-8", "replace").removesuffix("\n").split("\n"):
            self.row += 1
            account.rows_read += 1
            fields = line.strip("\r").split(self.separator)
            example = f"row {self.row}: {line[:80]!r}"
            if not line.strip():
                account.drop_rows("blank_line", 1, example)
            elif len(fields) != len(self.names):
                account.drop_rows("wrong_column_count", 1, example)
            else:
                try:
                    kept.append([float(fields[position].strip() or "nan") for position in positions] + [self.row])
                except ValueError:
                    account.drop_rows("text_value", 1, example)
        columns = np.array(kept, float).reshape(-1, len(positions) + 1).T
        return dict(zip([*self.wanted, "row"], columns, strict=True))


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True
