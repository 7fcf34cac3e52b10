"""TrajNet++'s JSON lines: scenes, positions of people, and predictions; what `readers.trajnet` reads as recordings.

    {"scene": {"id": 0, "p": 0, "s": 0, "e": 63, "fps": 1.0, "tag": 0}}
    {"track": {"f": 3, "p": 0, "x": 1.25, "y": -2.5}}
    {"track": {"f": 4, "p": 0, "x": 1.5, "y": -2.5, "prediction_number": 0, "scene_id": 0}}

A frame is a time step, `s` and `e` are a scene's first and last frame, `p` is its primary person, whose future is
predicted. Positions are in m. The form has no probabilities and no clock.
P. Kothari, S. Kreiss, A. Alahi, Human trajectory forecasting in crowds, IEEE T-ITS 2022.
"""

import itertools
import json
import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from modlhmp.exchange.forecasts import Rows
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.ranking import best_first
from modlhmp.readers.raw import line_blocks
from modlhmp.storage import DataError, write_text
from modlhmp.time_step import interpolate
from modlhmp.tracks import LATE_STEPS, Tracks, gap_limit

MOST_SCENES = 1 << 31  # whose frames are whole numbers that a float holds
FIELDS = ("f", "p", "x", "y", "prediction_number", "scene_id")


def write_lines(lines: Iterable[str], path: str | Path) -> None:
    """Write lines as a file."""
    write_text(path, "".join(f"{line}\n" for line in lines))


def scene_line(number: int, person: int, first: int, last: int, step_s: float) -> str:
    """A scene of the frames `first` to `last`."""
    scene = {"id": number, "p": person, "s": first, "e": last, "fps": round(1 / step_s, 6), "tag": 0}
    return json.dumps({"scene": scene})


def track_lines(person: int, first: int, xy: np.ndarray, **of_prediction: int) -> Iterator[str]:
    """Positions [rows, 2] of a person from a frame on; NaN is left out. `of_prediction`: its number and its scene."""
    for frame, (x, y) in enumerate(xy.tolist(), first):
        if not math.isnan(x):
            yield json.dumps({"track": {"f": frame, "p": person, "x": x, "y": y, **of_prediction}})


def tracks_as_lines(tracks: Tracks, step_s: float) -> Iterator[str]:
    """Whole tracks, a scene each, at whole time steps from their own first rows, whose frames are rounded from t.

    So everybody has one position in a frame and walks at their own speed. Gaps that nobody interpolates stay.
    """
    people, began = list[tuple[int, int, np.ndarray]](), tracks.t.min(initial=np.inf)
    even, late_s = interpolate(tracks, step_s), LATE_STEPS * step_s
    bounds = (itertools.pairwise(one.bounds().tolist()) for one in (tracks, even))
    for (begin, end), (first, last) in zip(*bounds, strict=True):
        t, when = tracks.t[begin:end], even.t[first:last]
        xy = np.column_stack([even.x[first:last], even.y[first:last]])
        for gap in np.flatnonzero(np.diff(t) > gap_limit(step_s)):
            xy[(when > t[gap] + late_s) & (when < t[gap + 1] - late_s)] = np.nan
        people.append((int(tracks.track_id[begin]), round((t[0] - began) / step_s), xy))
    for number, (person, first, xy) in enumerate(people):
        yield scene_line(number, person, first, first + len(xy) - 1, step_s)
    for person, first, xy in people:
        yield from track_lines(person, first, xy)


def predictions_as_lines(
    scene: np.ndarray, person: np.ndarray, at_t0: np.ndarray, forecast: Forecast, observed_rows: int, step_s: float
) -> Iterator[str]:
    """Futures of n walkers, each the primary `person` [n] of a `scene` [n] whose frame at t0 is `at_t0` [n].

    Ranked ones are numbered in the order of their ranks at the longest horizon. What a future gives once it has stopped
    is left out. Numbers are those of float32.
    """
    forecast = best_first(forecast)
    steps = forecast.xy.shape[2]
    for row, (number, whose, frame) in enumerate(zip(scene.tolist(), person.tolist(), at_t0.tolist(), strict=True)):
        yield scene_line(number, whose, frame - observed_rows + 1, frame + steps, step_s)
        for future, lived in enumerate(forecast.steps_alive[row].tolist()):
            xy = forecast.xy[row, future, :lived]
            short = np.array([float(str(one)) for one in xy.ravel()]).reshape(-1, 2)  # no digits that float32 lacks
            yield from track_lines(whose, frame + 1, short, prediction_number=future, scene_id=number)


def read_predictions(path: str | Path, observed_rows: int, steps: int) -> Rows:
    """The predictions of a task's primary persons, whose number is their scene's, as rows of the long form.

    Scene n of a task has the frames n * (observed + future steps) on. Rows of others and rows that are no prediction
    are left out. `DataError` names the file, the row, the value and the remedy.
    """
    found: list[tuple[float, ...]] = []
    number, others = 0, ""
    for block in line_blocks(path):
        for line in block.removesuffix(b"\n").split(b"\n"):
            number += 1
            for one, person in _one_line(path, number, line):
                if person == one[-1]:
                    found.append(one)
                elif not others:
                    others = f"row {number}: p {person:g} of a prediction for scene {one[-1]:g}"
    if not found and others:
        raise DataError(
            f"{path}, {others}, and likewise all: whose future is asked for has the number of the scene, p = scene_id"
        )
    if not found:
        raise DataError(
            f'{path}: no predictions; their lines are {{"track": {{{", ".join(f"{name!r}: ..." for name in FIELDS)}}}}}'
        )
    line, frame, x, y, sample, scene = np.array(found, float).T
    scenes = scene.astype(np.int64)
    step = frame - scenes * (observed_rows + steps) - observed_rows + 1
    outside = (step < 1) | (step > steps)
    if outside.any():
        row = int(np.argmax(outside))
        first = int(scenes[row] * (observed_rows + steps) + observed_rows)
        raise DataError(
            f"{path}, row {int(line[row])}: frame {frame[row]:g}: the future of scene {scenes[row]} begins one frame "
            f"after t0 and lasts {steps} frames, from {first} to {first + steps - 1}; predict these"
        )
    zero, unknown = np.zeros(len(line)), np.full(len(line), np.nan)
    return Rows(scenes, zero, sample, unknown, step, x, y, line.astype(np.int64), {})


def _one_line(path: str | Path, number: int, line: bytes) -> Iterator[tuple[tuple[float, ...], float]]:
    """The row of one line, if it is a prediction, and of whom."""
    if not line.strip():
        return
    where = f"{path}, row {number}"
    try:
        track = json.loads(line).get("track")
    except (ValueError, AttributeError, RecursionError):
        raise DataError(f"{where}: {line[:80].decode(errors='replace')!r} is no JSON object; correct it") from None
    if not isinstance(track, dict) or "prediction_number" not in track:
        return
    for name in FIELDS:
        if not isinstance(track.get(name), int | float) or isinstance(track[name], bool):
            raise DataError(f"{where}: {name} {track.get(name)!r} of a prediction is no number; correct it")
    try:
        finite = bool(np.isfinite([float(track[name]) for name in FIELDS]).all())
    except OverflowError:  # a whole number of hundreds of digits
        finite = False
    if not finite:
        raise DataError(
            f"{where}: {line[:120].decode(errors='replace')!r}: NaN, or as large; a future that has ended has no rows"
        )
    if not 0 <= track["scene_id"] < MOST_SCENES or track["scene_id"] != int(track["scene_id"]):
        raise DataError(f"{where}: scene_id {track['scene_id']!r} is not the number of a scene; take it from the task")
    yield (number, *(float(track[name]) for name in ("f", "x", "y", "prediction_number", "scene_id"))), track["p"]
