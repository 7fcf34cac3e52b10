"""Pieces of real tracks: what the two maps with memory store, and how alike two ways of walking are.

A piece is a row of a training track, resampled at the time step, together with what came before and after it. Two
walkers are alike if they are at nearly the same place, with nearly the same heading, speed and change of velocity; one
metric in metres says how much (`features`). Not in the paper.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from modlhmp.options import Alike
from modlhmp.tracks import Tracks, clock_time, gap_limit, positions_at, runs, usable_tracks

HEADINGS = 8  # bins of 45 degrees, and one more for people who hardly move
SLOW_M_S = 0.3  # below this speed a heading means little, at 0 nothing
PARTS = 8  # numbers by which two ways of walking are compared


class Pieces(NamedTuple):
    """Rows of tracks a time step apart: `person` [n] counts from 0, `t` [n] in s, `xy` [n, 2] in m.

    `last` [n] is the last row of each row's person, `age` [n] how many rows of the person come before it.
    """

    person: np.ndarray
    t: np.ndarray
    xy: np.ndarray
    last: np.ndarray
    age: np.ndarray


class Metric(NamedTuple):
    """How many metres apart two walkers count who differ by 1 in ..."""

    heading_m: float  # the unit vector of the heading (an angle of 60 degrees)
    speed_m: float  # speed, m/s
    change_m: float  # change of velocity over the observation, m/s
    hour_m: float = 0.0  # clock time, h

    @classmethod
    def of(cls, options: Alike) -> "Metric":
        """That of a method's options."""
        return cls(*(getattr(options, name) for name in cls._fields))

    def hour(self, t: np.ndarray, timezone: str) -> np.ndarray:
        """Clock time of day [h] of unix times `t` [s]; 0 where it does not count."""
        return clock_time(t, timezone) if self.hour_m else np.zeros(len(t))


def resample(tracks: Tracks, step_s: float) -> Pieces:
    """`Pieces` of every track without a gap over `gap_limit`, linear between its rows."""
    rows = usable_tracks(tracks, 1, gap_limit(step_s))
    count = np.floor((tracks.t[rows[:, 1]] - tracks.t[rows[:, 0]]) / step_s + 0.05).astype(np.int64) + 1
    person, age = np.repeat(np.arange(len(rows)), count), runs(np.zeros(len(rows), np.int64), count)
    xy = positions_at(tracks, rows, (age * step_s)[:, None], person)[:, 0]
    return Pieces(person, tracks.t[rows[person, 0]] + age * step_s, xy, np.repeat(np.cumsum(count) - 1, count), age)


def differences(xy: np.ndarray, number: int, step_s: float) -> np.ndarray:
    """Velocities [n, number, 2] in m/s of the last `number` steps that end at each row of `xy` [n, 2], newest first.

    Only rows with that many rows of the same person before them mean anything.
    """
    rows = np.maximum(np.arange(len(xy))[:, None] - np.arange(number + 1), 0)
    return (xy[rows[:, :-1]] - xy[rows[:, 1:]]) / step_s


def vector_mean(steps: np.ndarray, weights: Sequence[float]) -> np.ndarray:
    """Current velocity [n, 2] from the last velocities [n, m, 2], newest first: their mean with these weights."""
    used = np.asarray(weights, float)[: steps.shape[1]]
    # Sums by row, not a matrix product: that one's last bit depends on how many rows there are.
    return (steps[:, : len(used)] * (used / used.sum())[:, None]).sum(axis=1)


def features(
    xy: np.ndarray, steps: np.ndarray, weights: Sequence[float], metric: Metric, hour: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points [n, 8] whose distances say how alike walkers are, and the speeds [n] in m/s.

    `steps` [n, m, 2] are the last velocities, newest first, `hour` [n] the clock time in h.
    """
    velocity = vector_mean(steps, weights)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    direction = velocity / np.maximum(speed, SLOW_M_S)[:, None]
    change = steps[:, 0] - steps[:, -1]
    scaled = (metric.heading_m * direction, (metric.speed_m * speed)[:, None], metric.change_m * change)
    return np.column_stack([xy, *scaled, metric.hour_m * hour]), speed


def cell_and_bin(pieces: Pieces, row: np.ndarray, cell_m: float, step_s: float) -> np.ndarray:
    """Cell (i, j) and heading bin [n, 3] of some rows of `Pieces`, each with a row of its person before it."""
    cell = np.floor(pieces.xy[row] / cell_m).astype(np.int64)
    return np.column_stack([cell, heading_bin(differences(pieces.xy, 1, step_s)[row, 0])])


def heading_bin(velocity: np.ndarray) -> np.ndarray:
    """Bin of velocities [n, 2]: 0 around east, then on to the left, or `HEADINGS` for people who hardly move."""
    angle = np.arctan2(velocity[:, 1], velocity[:, 0]) * HEADINGS / (2 * np.pi)
    slow = np.hypot(velocity[:, 0], velocity[:, 1]) < SLOW_M_S
    return np.where(slow, HEADINGS, np.rint(angle).astype(np.int64) % HEADINGS)
