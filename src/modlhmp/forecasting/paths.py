"""What kernels do with a path [T, 2]: read it between its rows, hold it once it has ended, walk it at another pace."""

import numpy as np

from modlhmp.kernels import kernel

PACED_M_S = 0.2  # a person slower than this has no pace to follow
PACE_LIMITS = (0.5, 2.0)


@kernel
def between(path, row, axis):
    """Linear interpolation between the rows of a path [m, 2] at a row number with a fraction."""
    whole = int(row)
    part = row - whole
    if part == 0.0:
        return np.float64(path[whole, axis])
    return (1.0 - part) * path[whole, axis] + part * path[whole + 1, axis]


@kernel
def hold(path, step, here):
    """From `step` on, stay where the path [T, 2] was before it."""
    for later in range(step, len(path)):
        for axis in range(2):
            path[later, axis] = path[step - 1, axis] if step else here[axis]


@kernel
def paced(own, other, exponent):
    """How many of the other's seconds pass in one of the walker's."""
    if own <= PACED_M_S or other <= PACED_M_S:
        return 1.0
    return min(max((own / other) ** exponent, PACE_LIMITS[0]), PACE_LIMITS[1])
