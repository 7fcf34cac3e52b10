"""JuPedSim's SQLite trajectories, and the HDF5 files of the Pedestrian Dynamics Data Archive."""

import contextlib
import itertools
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.account import Account
from modlhmp.ids import NOBODYS
from modlhmp.readers.columns import NO_ID
from modlhmp.readers.delimited import from_origin
from modlhmp.storage import DataError, check_held, refused
from modlhmp.time_step import positions_alone
from modlhmp.tracks import Tracks

ROWS_AT_ONCE, STEPS_AT_ONCE, STEPS_PER_BYTE = 10_000, 100_000, 10  # of SQLite's machine: about one for a byte
ROW_BYTES = 120  # of a row from the file to its track


def read_sqlite(
    path: str | Path,
    origin: float,
    day: tuple[float, float] | None = None,
    origin_m: tuple[int, int] | None = None,
) -> tuple[Tracks, Account]:
    """Read a JuPedSim file into rows sorted by track and time; positions in m from `origin_m`, headings unknown."""
    foreseen = (sqlite3.Error, ValueError, TypeError, OverflowError)
    with (
        refused(f"{path}: cannot be read as a JuPedSim file", *foreseen),
        contextlib.closing(sqlite3.connect(f"{Path(path).resolve().as_uri()}?mode=ro", uri=True)) as file,
    ):
        # A view, or a column that is computed, could go on for ever; the rows of a table take a few steps each.
        steps = itertools.count(1)
        most = STEPS_PER_BYTE * Path(path).stat().st_size // STEPS_AT_ONCE
        file.set_progress_handler(lambda: next(steps) > most, STEPS_AT_ONCE)
        (computed,) = file.execute("SELECT count(*) FROM pragma_table_xinfo('trajectory_data') WHERE hidden > 0")
        if computed[0]:
            raise DataError(f"{path}: columns of trajectory_data are computed, not stored; write them as plain ones")
        cursor = file.execute("SELECT id, frame, pos_x, pos_y FROM trajectory_data")
        ids, parts = [np.empty(0, np.int64)], [np.empty((0, 3))]
        for number, part in enumerate(iter(lambda: cursor.fetchmany(ROWS_AT_ONCE), [])):
            given = np.array([NO_ID if row[0] is None else row[0] for row in part])
            ids.append(_whole(path, given, number * ROWS_AT_ONCE))
            parts.append(np.array([row[1:] for row in part], float))
        rows = np.concatenate(parts)
        found = file.execute("SELECT value FROM metadata WHERE key = 'fps'").fetchone()
        rate = float(found[0]) if found else None
    if rate is None or not rows.size:
        raise DataError(f"{path}: {'no `fps` in its metadata' if rows.size else 'no rows in trajectory_data'}")
    return _tracks(path, np.concatenate(ids), rows, rate, origin, day, origin_m)


def read_hdf5(
    path: str | Path,
    origin: float,
    day: tuple[float, float] | None = None,
    origin_m: tuple[int, int] | None = None,
) -> tuple[Tracks, Account]:
    """Read an archive's HDF5 file (dataset `trajectory` with id, frame, x, y and attribute `fps`) likewise."""
    try:
        import h5py  # noqa: PLC0415 - an extra that few need
    except ImportError:
        raise DataError(f"{path}: HDF5 files need the package h5py: pip install 'modlhmp[hdf5]'") from None
    foreseen = (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError)
    with refused(f"{path}: cannot be read as an archive's HDF5 file", *foreseen), h5py.File(path, "r") as file:
        table: Any = file["trajectory"]
        rate = float(table.attrs["fps"])
        check_held(path, ROW_BYTES * table.size)
        ids = _whole(path, np.asarray(table["id"]))
        rows = np.column_stack([np.asarray(table[name], float) for name in ("frame", "x", "y")])
    return _tracks(path, ids, rows, rate, origin, day, origin_m)


def _whole(path, ids, rows_before=0):
    """Ids [n] as int64, `NO_ID` where there is none; `DataError` for one that is not whole, or too large to be sure."""
    if ids.dtype.kind == "i":
        return ids.astype(np.int64)
    if ids.dtype.kind == "u":
        whole = ids < 2**63
    else:
        ids = ids if ids.dtype.kind == "f" else ids.astype(float)
        ids = np.where(np.isfinite(ids), ids, NO_ID)
        whole = (ids == NO_ID) | ((ids == np.rint(ids)) & (np.abs(ids) < 2 / np.finfo(ids.dtype).eps))
    if not whole.all():
        row = int(np.argmin(whole))
        raise DataError(
            f"{path}, row {rows_before + row + 1}: id {ids[row]} is no whole number that its type holds exactly, so "
            "several people may share it: write ids as integers of 64 bits"
        )
    return ids.astype(np.int64)


def _tracks(path, ids, rows, rate, origin, day, origin_m):
    """Rows of ids [n] and frame, x, y [n, 3] as tracks with their account."""
    account = Account()
    account.rows_read = len(rows)
    if not rate > 0:
        raise DataError(f"{path}: its frame rate is {rate:g}")
    none, nan, nobody = ids == NO_ID, ~np.isfinite(rows).all(axis=1), ids == NOBODYS
    account.drop_rows("no_track_id", none.sum())
    account.drop_rows("nan_value", (nan & ~none).sum())
    account.drop_rows("no_person", (nobody & ~nan).sum())
    good = ~(none | nan | nobody)
    ids = ids[good]
    frame, x, y = rows[good].T
    x, y, near = from_origin(path, x, y, origin_m, account)
    tracks = positions_alone(ids[near], origin + frame[near] / rate, x[near], y[near], day, account)
    return tracks, account
