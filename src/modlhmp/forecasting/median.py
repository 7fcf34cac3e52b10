"""One path out of many: the geometric median, at every time step, of those futures that are still there.

It is the point with the least mean distance to them, and so the output of least expected displacement error.
E. Weiszfeld, Tohoku Math. J. 43, 1937.
"""

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.kernels import kernel

SOFTENING_M = 0.01  # keeps the weights finite where the median meets a point
TOLERANCE_M = 1e-3
MOST_ITERATIONS = 50


def with_median(forecast: Forecast) -> Forecast:
    """The same futures with their median path before them, as a `Forecast` of output `median`.

    It is as long alive as the longest-lived of them, and held when none is left (where they start, if none ever was).
    """
    n, k, steps, _ = forecast.xy.shape
    xy, alive = np.empty((n, 1 + k, steps, 2), np.float32), np.empty((n, 1 + k), np.int32)
    log_fitness = np.zeros((n, 1 + k, steps), np.float32)
    xy[:, 1:], alive[:, 1:], log_fitness[:, 1:] = forecast.xy, forecast.steps_alive, forecast.log_fitness
    fill_medians(xy, alive)
    return Forecast(xy, log_fitness, alive, "median")


@kernel
def fill_medians(xy, alive):
    """Fill the first of the futures `xy` [n, 1 + k, T, 2] and of their `alive` [n, 1 + k] with the others' median."""
    n, _, steps, _ = xy.shape
    x, y = np.empty(xy.shape[1]), np.empty(xy.shape[1])
    for i in range(n):
        alive[i, 0] = alive[i, 1:].max()
        for step in range(steps):
            count = 0
            for j in range(1, xy.shape[1]):
                if alive[i, j] > step:
                    x[count], y[count] = xy[i, j, step, 0], xy[i, j, step, 1]
                    count += 1
            if count:
                xy[i, 0, step, 0], xy[i, 0, step, 1] = geometric_median(x, y, count)
            else:
                xy[i, 0, step] = xy[i, 0, step - 1] if step else xy[i, 1, 0]


@kernel
def geometric_median(x, y, count):
    """Geometric median (x, y) of the first `count` of the points `x`, `y` [..]; their mean is the first guess."""
    mx, my = x[:count].mean(), y[:count].mean()
    for _ in range(MOST_ITERATIONS):
        x_new, y_new = _weighted_mean(x, y, count, mx, my)
        moved = abs(x_new - mx) + abs(y_new - my)
        mx, my = x_new, y_new
        if moved < TOLERANCE_M:
            break
    return mx, my


@kernel(error_model="numpy", fastmath={"reassoc"})
def weighted_geometric_median(x, y, share, count):
    """Geometric median (x, y) of the first `count` of the points `x`, `y` [..], which count by their `share`."""
    sx = sy = total = 0.0
    for i in range(count):  # the first guess is their mean
        sx += share[i] * x[i]
        sy += share[i] * y[i]
        total += share[i]
    mx, my = sx / total, sy / total
    for _ in range(MOST_ITERATIONS):
        sx = sy = total = 0.0
        for i in range(count):
            weight = share[i] / (np.sqrt((x[i] - mx) ** 2 + (y[i] - my) ** 2) + SOFTENING_M)
            sx += weight * x[i]
            sy += weight * y[i]
            total += weight
        moved = abs(sx / total - mx) + abs(sy / total - my)
        mx, my = sx / total, sy / total
        if moved < TOLERANCE_M:
            break
    return mx, my


@kernel(error_model="numpy", fastmath={"reassoc"})
def _weighted_mean(x, y, count, mx, my):
    """Mean of the points, each weighted by the inverse of its distance from (`mx`, `my`)."""
    # Freed from the order of the sums and from checks for zero, the compiler takes several points at a time.
    sx = sy = total = 0.0
    for i in range(count):
        weight = 1.0 / (np.sqrt((x[i] - mx) ** 2 + (y[i] - my) ** 2) + SOFTENING_M)
        sx += weight * x[i]
        sy += weight * y[i]
        total += weight
    return sx / total, sy / total
