"""One path out of many that is one of them: at every horizon the medoid of those futures that have lived longest.

Of the samples it is the one with the least mean distance to the others, and so, unlike a median, a path that somebody
could walk. Distances are between whole paths up to the horizon, not between their ends.
"""

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.kernels import kernel


def with_medoid(samples: Forecast, nearest: int | None = None) -> Forecast:
    """The same samples, as a `Forecast` of output `medoid`: their fitness is minus their mean distance to the others.

    So `ranking.most_likely` among the longest-lived is the medoid. Others are the longest-lived at the horizon, the
    first `nearest` of them where samples come in the order of their likeness to the walker.
    """
    distances = mean_distances(samples.xy, samples.steps_alive, nearest or samples.xy.shape[1])
    return Forecast(samples.xy, -distances, samples.steps_alive, "medoid")


@kernel
def mean_distances(xy, steps_alive, nearest):
    """Mean distance [n, k, T] in m of each path of `xy` [n, k, T, 2], up to each step, from the longest-lived there.

    The first `nearest` of them count, and a path's distance of 0 from itself with them.
    """
    n, k, steps, _ = xy.shape
    distances = np.empty((n, k, steps), np.float32)
    apart, others = np.empty((k, k)), np.empty(k, np.int64)  # apart: summed over the steps so far
    x, y = np.empty(k), np.empty(k)
    for i in range(n):
        apart[:] = 0.0
        longest = steps_alive[i].max()
        for step in range(steps):
            x[:], y[:] = xy[i, :, step, 0], xy[i, :, step, 1]
            number = 0
            for a in range(k):
                for b in range(k):
                    apart[a, b] += np.sqrt((x[a] - x[b]) ** 2 + (y[a] - y[b]) ** 2)
                if number < nearest and steps_alive[i, a] >= min(longest, step + 1):
                    others[number] = a
                    number += 1
            for a in range(k):
                total = 0.0
                for other in others[:number]:
                    total += apart[other, a]
                distances[i, a, step] = total / (number * (step + 1))
    return distances
