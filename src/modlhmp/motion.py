"""How people of a recording move, by their positions alone, and how what the file says of it agrees."""

from typing import NamedTuple

import numpy as np

from modlhmp.angles import by_convention, wrap_angle
from modlhmp.file_format import Units
from modlhmp.tracks import Tracks, usual_step

TRACK_QUANTILE, SITE_QUANTILE = 0.75, 0.9  # a track's speed when it moves, and the speed of tracks that move
MOVING, JUMPING = 0.25, 8.0  # times that speed: slower is standing or jitter, faster is an id that jumps
LONGEST = 3.0  # times the usual time: longer is a gap
FAR, MOSTLY = 4.0, 0.8  # times the usual displacement: farther is a jump; the share that make one


class Moves(NamedTuple):
    """Displacements of people who move: their middle row, speed [m/s], direction [rad]; how long they are [s]."""

    row: np.ndarray
    speed: np.ndarray
    direction: np.ndarray
    seconds: float


def moves(rows: Tracks, apart: int) -> Moves:
    """The displacements between rows `apart` rows from each other in a track, of those who move.

    Who moves is judged by the recording's own speeds, so that it does not depend on any unit.
    """
    first = np.flatnonzero(rows.track_id[apart:] == rows.track_id[:-apart])
    seconds = rows.t[first + apart] - rows.t[first]
    usual = usual_step(rows) * apart
    kept = (seconds > 0) & (seconds <= LONGEST * usual)
    first, seconds = first[kept], seconds[kept]
    dx, dy = rows.x[first + apart] - rows.x[first], rows.y[first + apart] - rows.y[first]
    speed = np.hypot(dx, dy) / seconds
    usual_speed = _speed_of_moving(rows.track_id[first], speed)
    moving = (speed > MOVING * usual_speed) & (speed < JUMPING * usual_speed)
    return Moves((first + apart // 2)[moving], speed[moving], np.arctan2(dy, dx)[moving], usual)


def _speed_of_moving(track: np.ndarray, speed: np.ndarray) -> float:
    """A high quantile over tracks of each one's high quantile of speeds [m/s]: neither who stands nor jumps count."""
    if not len(speed):
        return 0.0
    order = np.lexsort((speed, track))
    starts = np.concatenate([[0], np.flatnonzero(np.diff(track)) + 1, [len(track)]])
    at = starts[:-1] + (TRACK_QUANTILE * (np.diff(starts) - 1)).astype(np.int64)
    return float(np.quantile(speed[order][at], SITE_QUANTILE))


def returned_to(rows: Tracks) -> tuple[np.ndarray, float, float]:
    """Whether rows [n] are at the one position that people jump to and from, again and again; that position's x and y.

    It is exactly the same for all, of several tracks, and most of those who come there or leave it go much farther
    than between other rows: a number that stands for "not seen". Without such a place no row is at it.
    """
    nowhere = np.zeros(len(rows.t), bool), float("nan"), float("nan")
    step = np.hypot(np.diff(rows.x), np.diff(rows.y))
    step[np.diff(rows.track_id) != 0] = 0
    if not (step > 0).any():
        return nowhere
    far = step > FAR * np.median(step[step > 0])
    ends = np.unique(np.concatenate([np.flatnonzero(far), np.flatnonzero(far) + 1]))
    if len(ends) < 2:
        return nowhere
    places, counts = np.unique(rows.x[ends] + 1j * rows.y[ends], return_counts=True)
    place = places[np.argmax(counts)]
    at = (rows.x == place.real) & (rows.y == place.imag)
    moved = (at[1:] != at[:-1]) & (np.diff(rows.track_id) == 0)
    if len(np.unique(rows.track_id[at])) < 2 or not moved.any() or far[moved].mean() < MOSTLY:
        return nowhere
    return at, float(place.real), float(place.imag)


def recorded_ratio(rows: Tracks, around: Moves) -> tuple[float, float]:
    """Median of recorded speeds by those of displacements, and the median of the latter [m/s]; NaN without any."""
    known = np.isfinite(rows.speed[around.row])
    if not known.any():
        return float("nan"), float("nan")
    return float(np.median((rows.speed[around.row] / around.speed)[known])), float(np.median(around.speed[known]))


def recorded_agreement(rows: Tracks, around: Moves, units: Units) -> tuple[float, float, str]:
    """How recorded headings follow displacements: the mean cosine between them as declared; the best one, and how.

    `rows` are as read with `units`. The other ways are the conventions of `units.heading`, each as it is and turned
    round, and radians where degrees are declared.
    """
    known = np.isfinite(rows.heading[around.row])
    heading, direction = rows.heading[around.row][known], around.direction[known]
    if not len(heading):
        return float("nan"), float("nan"), ""
    angles = {"": wrap_angle(by_convention(heading, units.heading))}
    if units.angle == "deg" and np.abs(angles[""]).max() < np.radians(2 * np.pi) + 0.001:
        angles = {"angle: rad": np.degrees(angles[""])}
    found = []
    for unit, of_file in angles.items():
        for name, also in _ALSO.items():
            option = ", ".join(filter(None, [unit, f"heading: {name}" if name != units.heading or not unit else ""]))
            cosine = float(np.cos(direction - by_convention(of_file, name)).mean())
            found.append((cosine, f"`units: {{{option}}}`{also}"))
            back = "headings turned round, as they point backwards (no option does that: correct the file, or leave "
            found.append((-cosine - 0.01, f"{back}speed and heading out of `columns`)"))
    best = max(found)
    return float(np.cos(direction - heading).mean()), *best


_ALSO = {"from_x": "", "compass": "", "from_x_clockwise": " (or a y that points down)"}
