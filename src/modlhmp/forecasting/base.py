"""What every forecaster takes and gives.

A forecaster is a function or object called as

    forecast(observed, steps, keys) -> Forecast

with `observed` an `observe.Observed` of n tracks, `steps` the number of time steps to the longest horizon, and `keys`
[n, k] the random streams of the k futures (`streams.stream_keys`). It never learns how long a track is.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

MODES = 5  # at most so many distinct futures of a forecast of output `modes`
OUTPUTS = ("ranked", "median", "medoid", "modes", "mean", "single", "likeliest", "mean_path")  # see `Forecast`
RESULTS = {"median": 1, "mean_path": 1, "modes": MODES}  # futures that are no samples but stand before them, by output


class Forecast(NamedTuple):
    """k futures of n tracks.

    `xy` [n, k, T, 2] float32 in m, held at the last alive position (t0's if none; unless `ranked`, whom the map does
    not know may walk on) once a future has stopped;
    `log_fitness` [n, k, T] float32, cumulative, held likewise; `steps_alive` [n, k] int32;
    `output`: how one result comes out of the k (`ranked`: the fittest, `medoid`: the same, fitness being nearness to
    the others, `likeliest`: the same, fitness being the log of a probability, `mean`: the mean error, `single`: k = 1,
    `median`: the first one, which is the geometric median of the living others at each step, `mean_path`: the same with
    their mean, `modes`: the fittest of the first `MODES`, fitness being the log of their probability; their samples
    follow).
    """

    xy: np.ndarray
    log_fitness: np.ndarray
    steps_alive: np.ndarray
    output: str

    def first(self, number: int | None) -> "Forecast":
        """The first `number` of the futures."""
        xy, log_fitness, steps_alive = (part[:, :number] for part in self[:3])
        return Forecast(xy, log_fitness, steps_alive, self.output)

    def take(self, places: np.ndarray) -> "Forecast":
        """The futures of each track that are at `places` [n, m], in that order."""
        xy, log_fitness, steps_alive = (
            np.take_along_axis(part, places.reshape(places.shape + (1,) * (part.ndim - 2)), axis=1) for part in self[:3]
        )
        return Forecast(xy, log_fitness, steps_alive, self.output)

    @property
    def results(self) -> "Forecast":
        """Those of the futures among which the result is: the median, the modes, or all."""
        return self.first(RESULTS.get(self.output))

    @property
    def samples(self) -> "Forecast":
        """Those of the futures that are samples: all but a median or modes, of equal standing without these."""
        if self.output not in RESULTS:
            return self
        xy, log_fitness, steps_alive = (part[:, RESULTS[self.output] :] for part in self[:3])
        return Forecast(xy, log_fitness, steps_alive, "mean")


Forecaster = Callable[[Any, int, np.ndarray], Forecast]  # (observed, steps, keys), see above
