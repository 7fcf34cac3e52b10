"""Which of the k futures is the forecast? Paper Sec. III-D: the one with the largest cumulative log fitness.

Fitness adds up over steps alive, so only futures that have lived equally long compare. Under the complete protocol,
which leaves no track out, those that have lived longest up to the horizon stand first (`longest_lived`), among them the
fittest (`most_likely`), ties in the order of the futures. `rank_order` puts all of them in that order: its first is
`most_likely(log_fitness, longest_lived(steps_alive, T))` at its horizon. The paper protocol chooses by `most_likely`
among those that are alive at the horizon.
"""

import numpy as np

from modlhmp.forecasting.base import Forecast

RANKED = ("ranked", "medoid", "modes", "likeliest")  # outputs whose futures differ in standing, by their fitness


def longest_lived(steps_alive: np.ndarray, steps: int) -> np.ndarray:
    """Which of the futures [n, k] have lived longest at each of `steps` horizons, bool [n, k, T]."""
    lived = _lived(steps_alive[:, :, None], np.arange(1, steps + 1))
    return lived == lived.max(axis=1, keepdims=True)


def most_likely(log_fitness: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """Index [n, T] of the fittest candidate at each horizon, -1 where there is none.

    `log_fitness` [n, k, T] is cumulative, so each horizon ranks by its own prefix; `candidates` [n, k, T] says which
    futures may be chosen. Ties go to the first.
    """
    # A future of probability 0 has -inf, and is still a candidate before those that are none.
    score = np.where(candidates, np.maximum(log_fitness, np.finfo(log_fitness.dtype).min), -np.inf)
    return np.where(candidates.any(axis=1), score.argmax(axis=1), -1)


def best_path(forecast: Forecast) -> tuple[np.ndarray, np.ndarray]:
    """The result as one path per track: positions [n, T, 2], and how many steps it is alive [n].

    The best ranked at the longest horizon of those that are results; a median and a single path are the only one.
    """
    xy, log_fitness, alive, _ = forecast.results
    best = most_likely(log_fitness, longest_lived(alive, xy.shape[2]))[:, -1]
    return xy[np.arange(len(best)), best], alive[np.arange(len(best)), best]


def rank_order(forecast: Forecast, steps: int) -> np.ndarray:
    """Indices [n, k] of the futures of every track, best ranked first, at the horizon of `steps` steps.

    A `forecast` without the axis of tracks, `log_fitness` [k, T] and `steps_alive` [k], has indices [k].
    """
    return np.lexsort((-forecast.log_fitness[..., steps - 1], -_lived(forecast.steps_alive, steps)))


def best_first(forecast: Forecast) -> Forecast:
    """The futures in the order of their ranks at the longest horizon; as they are where they have none."""
    if forecast.output not in RANKED:
        return forecast
    return forecast.take(rank_order(forecast, forecast.xy.shape[2]))


def _lived(steps_alive: np.ndarray, horizon: int | np.ndarray) -> np.ndarray:
    """Steps alive up to a horizon: a long life beyond it does not count."""
    return np.minimum(steps_alive, horizon)
