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


def with_median(forecast):
    """The same futures with their median path before them, as a `Forecast` of output `median`.

    It is as long alive as the longest-lived of them, and held when none is left (where they start, if none ever was).
    """
    n, _, steps, _ = forecast.xy.shape
    path = _median_paths(forecast.xy, forecast.steps_alive)
    return Forecast(
        np.concatenate([path[:, None], forecast.xy], axis=1),
        np.concatenate([np.zeros((n, 1, steps), np.float32), forecast.log_fitness], axis=1),
        np.concatenate([forecast.steps_alive.max(axis=1, keepdims=True), forecast.steps_alive], axis=1),
        "median",
    )


@kernel
def geometric_median(points, count):
    """Geometric median (x, y) of the first `count` of the `points` [.., 2]; their mean is the first guess."""
    mx = my = 0.0
    for i in range(count):
        mx += points[i, 0]
        my += points[i, 1]
    mx /= count
    my /= count
    for _ in range(MOST_ITERATIONS):
        sx = sy = total = 0.0
        for i in range(count):
            weight = 1.0 / (np.sqrt((points[i, 0] - mx) ** 2 + (points[i, 1] - my) ** 2) + SOFTENING_M)
            sx += weight * points[i, 0]
            sy += weight * points[i, 1]
            total += weight
        moved = abs(sx / total - mx) + abs(sy / total - my)
        mx, my = sx / total, sy / total
        if moved < TOLERANCE_M:
            break
    return mx, my


@kernel
def _median_paths(xy, steps_alive):
    n, k, steps, _ = xy.shape
    path = np.empty((n, steps, 2), np.float32)
    points = np.empty((k, 2))
    for i in range(n):
        for step in range(steps):
            count = 0
            for j in range(k):
                if steps_alive[i, j] > step:
                    points[count, 0], points[count, 1] = xy[i, j, step, 0], xy[i, j, step, 1]
                    count += 1
            if count:
                path[i, step, 0], path[i, step, 1] = geometric_median(points, count)
            elif step:
                path[i, step] = path[i, step - 1]
            else:
                path[i, step] = xy[i, 0, 0]
    return path
