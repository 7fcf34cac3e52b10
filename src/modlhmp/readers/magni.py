"""THOR-MAGNI's scenario files: a head of key lines, then one row per instant with columns for every tracked body.

T. Schreiter et al., THÖR-MAGNI: A large-scale indoor motion capture recording of human movement and robot interaction,
Int. J. Robotics Research, 2024. Positions are the bodies' centroids in mm, 100 times per second; empty where not seen.
"""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv

from modlhmp.account import Account
from modlhmp.readers.delimited import from_origin
from modlhmp.readers.jupedsim import ROW_BYTES
from modlhmp.readers.raw import read_whole
from modlhmp.readers.start import MOST_COLUMNS
from modlhmp.storage import DataError, check_held
from modlhmp.time_step import positions_alone
from modlhmp.tracks import Tracks

BODY = re.compile(r"(Helmet_\d+) Centroid_X")  # robots and carried objects are no people
MM = 0.001


def read(
    path: str | Path,
    origin: float,
    day: tuple[float, float] | None = None,
    origin_m: tuple[int, int] | None = None,
) -> tuple[Tracks, Account]:
    """Read a file into rows sorted by track and time; returns (Tracks, Account), headings unknown.

    A row of the account is one body at one instant. Ids are the bodies' names: who wears a helmet changes from run to
    run. Instants where a body is not seen are dropped as `not_measured`, frames that come twice as `duplicate_row`,
    lines of another length as `wrong_column_count`.
    """
    names, table, skipped = _table(path)
    bodies = [match[1] for name in names if (match := BODY.fullmatch(name))]
    if "Time" not in names or not bodies:
        raise DataError(
            f"{path}: no columns `Time` and `Helmet_1 Centroid_X`: is `reader: magni` right? Files with one row per "
            "person and time are read by `reader: delimited`"
        )
    check_held(path, ROW_BYTES * len(table["Time"]) * len(set(bodies)))
    account, pieces = Account(), []
    seconds = _numbers(table, "Time")
    for body in sorted(set(bodies)):
        x, y = (_numbers(table, f"{body} Centroid_{axis}") * MM for axis in "XY")
        seen = np.isfinite(seconds) & np.isfinite(x) & np.isfinite(y)
        account.rows_read += len(seconds) + skipped
        account.drop_rows("wrong_column_count", skipped)
        account.drop_rows("not_measured", (~seen).sum())
        ids = np.full(int(seen.sum()), account.owners.number(body))
        pieces.append((ids, origin + seconds[seen], x[seen], y[seen]))
    ids, t, x, y = map(np.concatenate, zip(*pieces, strict=True))
    x, y, near = from_origin(path, x, y, origin_m, account)
    rows = positions_alone(ids[near], t[near], x[near], y[near], day, account)
    if not len(rows.t):
        raise DataError(f"{path}: no usable row; {account.rows_read} read, dropped {dict(account.dropped_rows)}")
    return rows, account


def _table(path):
    """The names of the columns, the table below them as text, and how many lines have another length."""
    text = read_whole(path)
    lines = text.removeprefix(b"\xef\xbb\xbf").split(b"\n", 64)
    begins = (b"Frame,", b"Time,", b'"Frame",', b'"Time",')
    at = next((n for n, line in enumerate(lines[:-1]) if line.startswith(begins)), None)
    if at is None:
        raise DataError(f"{path}: no line of column names that begins with `Frame,`: is `reader: magni` right?")
    if (columns := lines[at].count(b",") + 1) > MOST_COLUMNS:
        raise DataError(f"{path}, row {at + 1}: {columns} columns; at most {MOST_COLUMNS} are read")
    names = [name.strip().strip('"') for name in lines[at].decode("utf-8", "replace").strip().split(",")]
    body = b"\n".join(lines[at + 1 :])
    if not body.strip():
        raise DataError(f"{path}: no row below the column names")
    if not body.isascii():  # a row of another length would fail in Arrow, which shows it as text
        body = body.decode("utf-8", "replace").encode()
    keys = [f"{n}" for n in range(len(names))]
    skipped: list[int] = []

    def skip(row: pa_csv.InvalidRow) -> str:
        skipped.append(row.number)
        return "skip"

    try:
        table = pa_csv.read_csv(
            pa.BufferReader(body),
            pa_csv.ReadOptions(column_names=keys),
            pa_csv.ParseOptions(invalid_row_handler=skip),
            pa_csv.ConvertOptions(column_types=dict.fromkeys(keys, pa.string())),
        )
    except pa.ArrowInvalid as error:
        raise DataError(f"{path}: cannot be read as a table ({str(error).splitlines()[0]})") from None
    places = {name: keys[n] for n, name in reversed(list(enumerate(names)))}
    return names, {name: table.column(key) for name, key in places.items()}, len(skipped)


def _numbers(table, name):
    """A column as numbers, NaN where there is none; of a column that the file lacks, all NaN."""
    import pyarrow.compute as pc  # noqa: PLC0415 - as in columns

    if name not in table:
        return np.full(len(next(iter(table.values()))), np.nan)
    texts = pc.utf8_trim_whitespace(table[name])
    plain = pc.match_substring_regex(texts, r"^[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?$")
    return pc.if_else(plain, texts, None).cast(pa.float64()).fill_null(np.nan).combine_chunks().to_numpy()
