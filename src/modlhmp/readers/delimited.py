"""Any recording in delimited text: one row per person and time, columns by name or position, units as said.

The ATC readers are layouts of this one. Files are read in blocks; where rows carry velocities, each block is at
once reduced to the last sample of every person and time step, so memory does not follow the raw rate.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.account import Account
from modlhmp.angles import wrap_angle
from modlhmp.readers.columns import read_columns
from modlhmp.storage import DataError
from modlhmp.time_step import last_of_step, without_repeats
from modlhmp.tracks import Tracks, concatenate

MAX_DISTANCE_M = 10_000.0  # farther from the origin, or faster, is a sensor fault, not a walking person
MAX_SPEED_MPS = 15.0
MAX_HEADING_RAD = 100.0
_LENGTH_M = {"m": 1.0, "cm": 0.01, "mm": 0.001}
_SECONDS = {"s": 1.0, "ms": 0.001}
FIELDS = ("track_id", "t", "x", "y", "speed", "heading")


def read_delimited(
    path: str | Path, layout: Mapping[str, Any], day: tuple[float, float] | None = None, step_s: float = 1.0
) -> tuple[Tracks, Account]:
    """Read a file into rows sorted by track and time.

    `layout` holds `columns` (field -> position from 0, or name with `header: true`), `width` (columns per row, None:
    as the first row has), `separator`, `header`, `units` {time: s|ms|frame, length: m|cm|mm|px, angle: rad|deg},
    `scale` [m/px], `frame_rate` [1/s], `origin` (unix time of time 0). `day` = (first, last) unix second of the
    recording's day; rows outside are dropped. With speed and heading columns the last sample of each `step_s` is
    kept. Returns (Tracks, Account).
    """
    account, pieces, previous = Account(), [], -np.inf
    has_velocity = "speed" in layout["columns"]
    for values in read_columns(path, layout, account):
        rows = _to_si(values, layout)
        rows = _drop_bad_rows(rows, values["row"], has_velocity, day, account)
        latest = np.maximum.accumulate(np.concatenate([[previous], rows.t]))
        account.notes["rows_out_of_time_order"] += int(np.sum(rows.t < latest[:-1]))
        previous = latest[-1]
        pieces.append(last_of_step(rows, step_s, account) if has_velocity else rows)
    rows = concatenate(pieces)
    rows = last_of_step(rows, step_s, account) if has_velocity else without_repeats(rows, account)
    if not len(rows.t):
        raise DataError(f"{path}: no usable row; {account.rows_read} read, dropped {dict(account.dropped_rows)}")
    return rows, account


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
            "nan_value": np.logical_or.reduce([np.isnan(column) for column in measured]),
            "no_person": rows.track_id < 0,
            "absurd_value": (np.hypot(rows.x, rows.y) > MAX_DISTANCE_M) | (speed < 0) | (speed > MAX_SPEED_MPS)
            | (np.abs(np.nan_to_num(rows.heading)) > MAX_HEADING_RAD),
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
