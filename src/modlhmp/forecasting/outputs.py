"""What a method gives out of its samples, by its option `output`: for every kind with samples, in this one place."""

import numpy as np

from modlhmp.forecasting.base import RESULTS, Forecast
from modlhmp.forecasting.median import with_median
from modlhmp.forecasting.medoid import with_medoid
from modlhmp.forecasting.modes import with_modes
from modlhmp.forecasting.ranking import longest_lived, most_likely


def with_output(forecast: Forecast, output: str, nearest: int | None = None) -> Forecast:
    """The forecast's samples with `output` (`ranked`, `geometric_median`, `medoid` or `modes`) as their result.

    `forecast` is of output `ranked`, or `median` with samples behind it, which is kept if a median is asked for.
    `nearest`: as for `medoid.with_medoid`.
    """
    if output == "ranked" or (output == "geometric_median" and forecast.output == "median"):
        return forecast
    if output == "geometric_median":
        return with_median(forecast.samples)
    return with_medoid(forecast.samples, nearest) if output == "medoid" else with_modes(forecast.samples)


def kept(forecast: Forecast, number: int) -> Forecast:
    """The forecast with `number` of its samples beside a median or modes, the first; others are kept whole.

    A medoid is another sample at every horizon. Of its samples those are kept that are the medoid at most horizons, the
    one at the longest always, which is among the longest-lived at every other; if any is missing, the nearest to it of
    those kept stands in.
    """
    if forecast.output in RESULTS:
        return forecast.first(RESULTS[forecast.output] + number)
    if forecast.output != "medoid" or forecast.xy.shape[1] <= number:
        return forecast
    n, k, steps, _ = forecast.xy.shape
    medoid = most_likely(forecast.log_fitness, longest_lived(forecast.steps_alive, steps))
    chosen = np.zeros((n, k), np.int64)
    np.add.at(chosen, (np.arange(n)[:, None], medoid), 1)
    chosen[np.arange(n), medoid[:, -1]] += steps
    return forecast.take(np.sort(np.argsort(-chosen, axis=1, kind="stable")[:, :number], axis=1))
