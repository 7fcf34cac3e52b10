"""Which cells will be occupied, and when, with what probability, by those who are there now.

A cell is occupied at a moment if the position of at least one person, the point that a recording gives, lies in it; how
wide a body is does not count, so a planner inflates the cells as it does obstacles. People are independent given the
present: p = 1 - prod over people (1 - share of the person's samples in the cell). A sample that has left, through a
door or off the map, occupies nothing. Somebody whom the map does not know is where the forecast says, straight on.
"""

from typing import NamedTuple

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.kernels import kernel

Box = tuple[float, float, float, float]


class Occupancy(NamedTuple):
    """Probabilities [T, rows, columns] float32, row 0 below, at `times_s` [T] after `t0` (unix s).

    Cells are `cell_m` wide, the grid's lower left corner is at `origin` = (x, y) in m.
    """

    probabilities: np.ndarray
    origin: tuple[float, float]
    cell_m: float
    times_s: np.ndarray
    t0: float


def occupancy(forecast: Forecast, times_s: np.ndarray, t0: float, extent: Box, cell_m: float = 1.0) -> Occupancy:
    """The `Occupancy` of `extent` = (x low, x high, y low, y high) [m] at the `times_s` [T] of a forecast after `t0`.

    All walkers of the forecast were seen at `t0`. Cells are [i, i + 1) x [j, j + 1) times `cell_m`.
    """
    low = np.floor(np.array([extent[0], extent[2]]) / cell_m + 1e-9).astype(np.int64)
    high = np.maximum(np.ceil(np.array([extent[1], extent[3]]) / cell_m - 1e-9).astype(np.int64), low + 1)
    samples, (columns, rows) = forecast.samples, (high - low).tolist()
    occupied = np.zeros((len(times_s), rows, columns), np.float32)
    _occupy(samples.xy, counted_steps(samples), low, cell_m, occupied)
    x, y = (low * cell_m).tolist()
    return Occupancy(occupied, (x, y), cell_m, times_s, t0)


def extent_of(forecast: Forecast, cell_m: float = 1.0) -> Box:
    """(x low, x high, y low, y high) [m] of the cells of all samples; one cell where there is nobody."""
    samples = forecast.samples
    there = samples.xy[np.arange(samples.xy.shape[2]) < counted_steps(samples)[..., None]].astype(float)
    low, high = (there.min(axis=0), there.max(axis=0)) if len(there) else (np.zeros(2), np.zeros(2))
    (x_low, y_low), (x_high, y_high) = np.floor(low / cell_m) * cell_m, (np.floor(high / cell_m) + 1) * cell_m
    return float(x_low), float(x_high), float(y_low), float(y_high)


def counted_steps(samples: Forecast) -> np.ndarray:
    """For how many steps each sample [n, k] occupies a cell: while it is alive, or all of a walker who never was."""
    unknown = samples.steps_alive.max(axis=1, initial=0) == 0
    return np.where(unknown[:, None], samples.xy.shape[2], samples.steps_alive)


@kernel
def _occupy(xy, steps, first, cell_m, occupied):
    """Fill `occupied` [T, rows, columns], all 0, where samples are: 1 less the product of who is elsewhere."""
    n, k, _, _ = xy.shape
    rows, columns = occupied.shape[1:]
    # Only cells that somebody may reach are touched: most of a map's are none.
    free, count = np.ones((rows, columns), np.float32), np.zeros((rows, columns), np.int32)
    touched, reached = np.empty((k, 2), np.int64), np.empty((min(n * k, rows * columns), 2), np.int64)
    known = np.zeros((rows, columns), np.bool_)  # whether it is one of `reached`
    for step in range(len(occupied)):
        total = 0
        for i in range(n):
            number = 0
            for j in range(k):
                if step >= steps[i, j]:
                    continue
                column = int(np.floor(xy[i, j, step, 0] / cell_m)) - first[0]
                row = int(np.floor(xy[i, j, step, 1] / cell_m)) - first[1]
                if 0 <= row < rows and 0 <= column < columns:
                    if count[row, column] == 0:
                        touched[number] = row, column
                        number += 1
                    count[row, column] += 1
            for row, column in touched[:number]:
                if not known[row, column]:
                    known[row, column], reached[total] = True, (row, column)
                    total += 1
                free[row, column] *= 1.0 - count[row, column] / k
                count[row, column] = 0
        for row, column in reached[:total]:
            occupied[step, row, column] = np.float32(1.0) - free[row, column]
            free[row, column], known[row, column] = 1.0, False
