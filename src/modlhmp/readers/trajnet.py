"""TrajNet++'s JSON lines: scenes and the positions of people in them.

P. Kothari, S. Kreiss, A. Alahi, Human Trajectory Forecasting in Crowds: A Deep Learning Perspective, IEEE T-ITS 2021.
Frames are the source's own, a few of them apart; the scenes say how many rows there are per second. A scene asks for
one forecast, of its primary pedestrian from its first to its last frame; everyone else there is a neighbour.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from modlhmp.account import Account
from modlhmp.ids import is_missing, is_nobodys
from modlhmp.readers.delimited import from_origin
from modlhmp.readers.raw import line_blocks
from modlhmp.scenes import Scenes
from modlhmp.storage import DataError
from modlhmp.time_step import positions_alone
from modlhmp.tracks import Tracks


class _Scene(NamedTuple):
    """A scene as the file has it: its primary's track id, its first and last frame."""

    track_id: int
    first: float
    last: float
    fps: float | None
    name: str


def read(
    path: str | Path,
    frame_rate: float | None,
    origin: float,
    day: tuple[float, float] | None = None,
    origin_m: tuple[int, int] | None = None,
) -> tuple[Tracks, Account]:
    """Read a file into rows sorted by track and time; returns (Tracks, Account), headings unknown.

    `frame_rate` is of frames; without it, it is the scenes' `fps` times the usual number of frames between two rows of
    their primary, the same for all. `origin` is the unix time of frame 0, `day` and `origin_m` as in `read_delimited`.
    Lines that are neither a track nor a scene are dropped as `other_object`, predictions as `prediction`, scenes
    without primary or frames as `bad_scene`. The others are the account's `scenes`, where the file has any; rows
    outside them are kept.
    """
    rows: list[tuple[int, float, float, float]] = []
    scenes: list[_Scene] = []
    account, number = Account(), 0
    for block in line_blocks(path):
        for line in block.removesuffix(b"\n").split(b"\n"):
            number += 1
            _one_line(line, number, rows, scenes, account)
    if not rows:
        raise DataError(f"{path}: no usable row; {account.rows_read} read, dropped {dict(account.dropped_rows)}")
    person, frame, x, y = (np.array(part) for part in zip(*rows, strict=True))
    x, y, near = from_origin(path, x, y, origin_m, account)
    person, frame, x, y = person[near], frame[near], x[near], y[near]
    if frame_rate is None:
        frame_rate = _frame_rate(path, scenes, person, frame)
    if scenes:
        whose, first, last, *_ = zip(*scenes, strict=True)
        begin, end = (origin + np.array(at) / frame_rate for at in (first, last))
        account.scenes = Scenes(np.array(whose, np.int64), begin, end)
        account.notes["scenes"] = len(scenes)
    t = origin + frame / frame_rate
    account.note_order(person, t)
    return positions_alone(person, t, x, y, day, account), account


def _frame_rate(path, scenes, person, frame):
    """Frames per second, by scenes whose primary has two rows; `DataError` where they do not agree, or none says it."""
    order = np.lexsort((frame, person))
    person, frame = person[order], frame[order]
    found: dict[float, str] = {}
    for one in scenes:
        begin, end = (np.searchsorted(person, one.track_id, side) for side in ("left", "right"))
        inside = frame[begin:end]
        steps = np.diff(np.unique(inside[(inside >= one.first) & (inside <= one.last)]))
        if one.fps is not None and len(steps):
            values, counts = np.unique(steps, return_counts=True)
            step = float(values[counts.argmax()])
            told = f"{one.name} says {one.fps:g} `fps` and has a row every {step:g} frames"
            found.setdefault(round(one.fps * step, 6), told)
    if not found:
        raise DataError(
            f"{path}: none of its {len(scenes)} scenes has an `fps` and two rows of its primary, so the time between "
            "frames is unknown: say the `frame_rate` of the frames"
        )
    if len(found) > 1:
        (rate, told), (other, also), *_ = found.items()
        raise DataError(
            f"{path}: its scenes differ in frames per second: {told} ({rate:g} per second), {also} ({other:g}): put "
            "the scenes and tracks of each rate in a file of their own, or say the `frame_rate` of all frames"
        )
    return next(iter(found))


def _one_line(line, number, rows, scenes, account):
    """One line into `rows` or `scenes`, or counted as dropped."""
    if not line or line.isspace():  # without the cost of an example and an error: there may be millions
        account.rows_read += 1
        account.drop_rows("blank_line", 1, f"row {number}: ''")
        return
    example = f"row {number}: {line[:80].decode(errors='replace')!r}"
    try:
        found = json.loads(line)
        scene, track = found.get("scene"), found.get("track")
    except (ValueError, AttributeError, RecursionError):
        account.rows_read += 1
        account.drop_rows("text_value", 1, example)
        return
    if isinstance(scene, dict):
        one = _scene(scene, number, account.owners)
        if one is None:
            account.rows_read += 1
            account.drop_rows("bad_scene", 1, example)
        else:
            scenes.append(one)
        return
    account.rows_read += 1
    if not isinstance(track, dict):
        account.drop_rows("other_object", 1, example)
        return
    frame, x, y = values = [_number(track.get(name)) for name in ("f", "x", "y")]
    if "prediction_number" in track:
        account.drop_rows("prediction", 1, example)
    elif None in values or "p" not in track:
        account.drop_rows("text_value", 1, example)
    elif is_missing(_text(track["p"])):
        account.drop_rows("no_track_id", 1, example)
    elif not np.isfinite(values).all():
        account.drop_rows("nan_value", 1, example)
    elif is_nobodys(_text(track["p"])):
        account.drop_rows("no_person", 1, example)
    else:
        rows.append((account.owners.number(_text(track["p"])), frame, x, y))


def _scene(scene, number, owners):
    """A scene's primary, frames and rows per second; None where it has none."""
    first, last, fps = (_number(scene.get(name)) for name in ("s", "e", "fps"))
    whose = _text(scene.get("p"))
    if is_missing(whose) or is_nobodys(whose):
        return None
    if first is None or last is None or not -np.inf < first < last < np.inf:
        return None
    if scene.get("fps") is not None and not (fps is not None and 0 < fps < np.inf):
        return None
    return _Scene(owners.number(whose), first, last, fps, f"scene {scene.get('id', '')} (row {number})")


def _text(person):
    """Whose a row or a scene is: 1.0 is 1, as JSON does not tell the two apart."""
    whole = isinstance(person, float) and person.is_integer()
    return str(int(person)) if whole else str(person)


def _number(value):
    """A number of JSON as a float; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return np.inf
