"""TrajNet++'s JSON lines: scenes and the positions of people in them.

P. Kothari, S. Kreiss, A. Alahi, Human Trajectory Forecasting in Crowds: A Deep Learning Perspective, IEEE T-ITS 2021.
Frames are the source's own, a few of them apart; the scenes say how many rows there are per second.
"""

import json
from pathlib import Path

import numpy as np

from modlhmp.account import Account
from modlhmp.readers.delimited import MAX_DISTANCE_M
from modlhmp.readers.raw import line_blocks
from modlhmp.storage import DataError
from modlhmp.time_step import positions_alone
from modlhmp.tracks import Tracks

FIELDS = ("p", "f", "x", "y")


def read(
    path: str | Path, frame_rate: float | None, origin: float, day: tuple[float, float] | None = None
) -> tuple[Tracks, Account]:
    """Read a file into rows sorted by track and time; returns (Tracks, Account), headings unknown.

    `frame_rate` is of frames; without it, it is the scenes' `fps` times the usual number of frames between two rows of
    a person. `origin` is the unix time of frame 0, `day` as in `read_delimited`. Lines that are neither a track nor a
    scene are dropped as `other_object`, predictions as `prediction`.
    """
    rows: list[tuple[int, float, float, float]] = []
    rates: set[float] = set()
    account, number = Account(), 0
    for block in line_blocks(path):
        for line in block.removesuffix(b"\n").split(b"\n"):
            number += 1
            _one_line(line, number, rows, rates, account)
    if not rows:
        raise DataError(f"{path}: no usable row; {account.rows_read} read, dropped {dict(account.dropped_rows)}")
    person, frame, x, y = (np.array(part) for part in zip(*rows, strict=True))
    order = np.lexsort((frame, person))
    steps = np.diff(frame[order])[np.diff(person[order]) == 0]
    if frame_rate is None:
        if len(rates) != 1:
            raise DataError(
                f"{path}: its scenes have {len(rates)} different `fps`; say the `frame_rate` of the frames instead"
            )
        values, counts = np.unique(steps[steps > 0], return_counts=True)
        if not len(values):
            raise DataError(f"{path}: nobody has two rows, so the step between frames is unknown; give `frame_rate`")
        frame_rate = rates.pop() * float(values[counts.argmax()])
    return positions_alone(person, origin + frame / frame_rate, x, y, day, account), account


def _one_line(line, number, rows, rates, account):
    """One line into `rows` or `rates`, or counted as dropped."""
    example = f"row {number}: {line[:80].decode(errors='replace')!r}"
    try:
        found = json.loads(line)
        scene, track = found.get("scene"), found.get("track")
    except (ValueError, AttributeError, RecursionError):
        account.rows_read += 1
        account.drop_rows("text_value" if line.strip() else "blank_line", 1, example)
        return
    if isinstance(scene, dict):
        if isinstance(scene.get("fps"), int | float) and scene["fps"] > 0:
            rates.add(float(scene["fps"]))
        return
    account.rows_read += 1
    if not isinstance(track, dict):
        account.drop_rows("other_object", 1, example)
    elif "prediction_number" in track:
        account.drop_rows("prediction", 1, example)
    elif not all(isinstance(track.get(name), int | float) for name in FIELDS[1:]) or "p" not in track:
        account.drop_rows("text_value", 1, example)
    elif not np.isfinite([float(track[name]) for name in FIELDS[1:]]).all():
        account.drop_rows("nan_value", 1, example)
    elif np.hypot(track["x"], track["y"]) > MAX_DISTANCE_M:
        account.drop_rows("absurd_value", 1, example)
    else:
        rows.append((account.owners.number(str(track["p"])), float(track["f"]), float(track["x"]), float(track["y"])))
