"""Forecasting with whole walks and with snippets of them together: both sets of samples are one distribution.

Who follows whole walks knows where people go from here, but few of those who stood here are left after a minute.
Particles that string snippets together are many, but forget. Each half of the distribution weighs the same; its
geometric median lies nearer to what happens than either's, and than the mean of the two, which lies between two places
where the median chooses one.
"""

import numpy as np

from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.chain import chain
from modlhmp.forecasting.median import weighted_geometric_median
from modlhmp.forecasting.observe import Observed
from modlhmp.forecasting.outputs import with_output
from modlhmp.forecasting.paths import hold
from modlhmp.forecasting.replay import followed
from modlhmp.kernels import kernel
from modlhmp.maps.pooled import PooledMap
from modlhmp.options import Pooled
from modlhmp.site import Site


def forecaster(mod: PooledMap, site: Site, options: Pooled) -> Forecaster:
    """The forecaster of such a map (contract: `kinds.Kind`)."""

    def forecast(observed: Observed, steps: int, keys: np.ndarray) -> Forecast:
        return with_output(pool(mod, observed, steps, keys, site, options), options.output, 2 * options.persons)

    return forecast


def pool(mod: PooledMap, observed: Observed, steps: int, keys: np.ndarray, site: Site, options: Pooled) -> Forecast:
    """Forecast with a `PooledMap`; returns a `Forecast`: the median, then for each key a replay and a particle.

    The median at a second is of the `persons` nearest persons who are still under way then, who share one half of the
    weight, and of the particles that are still there, which share the other; where one of the two has nobody left, of
    the other alone. A walker for whom one of the two knows nobody from the start has the other's samples twice.
    """
    walks, different = followed(
        mod.episodes, observed, steps, site.time_step_s, options.persons, keys.shape[1], options.pace, options.reach_m,
        options.exclude_s, options.samples == "pieces",
    )  # fmt: skip
    snippets = chain(
        mod.snippets, observed, steps, keys, options.bandwidth_m, options.pace, options.exits, options.exclude_s
    )
    n, both = len(keys), 1 + 2 * keys.shape[1]
    xy, alive = np.empty((n, both, steps, 2), np.float32), np.empty((n, both), np.int32)
    for first, one, other in ((1, walks, snippets), (2, snippets, walks)):
        nobody = one.steps_alive[:, 0] == 0
        xy[:, first::2] = np.where(nobody[:, None, None, None], other.xy[:, 1:], one.xy[:, 1:])
        alive[:, first::2] = np.where(nobody[:, None], other.steps_alive[:, 1:], one.steps_alive[:, 1:])
    xy[:, 0] = snippets.xy[:, 0]  # constant velocity, where nobody is known
    nobody = walks.steps_alive[:, 0] == 0
    most = np.where(nobody, keys.shape[1], options.persons)
    _fill_medians(xy, alive, np.where(nobody, keys.shape[1], different), most)
    return Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, "median")


@kernel
def _fill_medians(xy, alive, different, most):
    """Fill the first of the futures `xy` [n, 1 + 2 k, T, 2] and of their `alive` [n, 1 + 2 k] with the median.

    The odd ones are replays, of the first `different` [n] of which the first `most` [n] that are alive count, the even
    ones particles.
    """
    n, number = alive.shape
    x, y, share = np.empty(number), np.empty(number), np.empty(number)
    for i in range(n):
        alive[i, 0] = alive[i, 1:].max()
        for step in range(alive[i, 0]):
            count = 0
            for half in range(1, 3):
                begin, upto = count, 1 + 2 * different[i] if half == 1 else number
                for j in range(half, upto, 2):
                    if alive[i, j] > step and (half == 2 or count - begin < most[i]):
                        x[count], y[count] = xy[i, j, step, 0], xy[i, j, step, 1]
                        count += 1
                share[begin:count] = 1.0 / max(count - begin, 1)
            xy[i, 0, step, 0], xy[i, 0, step, 1] = weighted_geometric_median(x, y, share, count)
        if alive[i, 0]:
            hold(xy[i, 0], alive[i, 0], xy[i, 0, 0])
