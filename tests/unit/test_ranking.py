"""The rank order of futures: who lived longest, then who is fittest."""

import numpy as np
from hypothesis import given, strategies

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.ranking import longest_lived, most_likely, rank_order
from modlhmp.scoring.protocols import PROTOCOLS, score

K, STEPS = 5, 6


def test_rank_order_by_hand():
    """First those that live longest up to the horizon, then the fittest there; a long life beyond it does not count."""
    fitness = np.zeros((4, 6))
    fitness[:, 2] = [-1.0, -5.0, -2.0, 9.0]
    forecast = Forecast(np.zeros((4, 6, 2)), fitness, np.array([3, 6, 4, 2]), "ranked")
    assert rank_order(forecast, 3).tolist() == [0, 2, 1, 3]


def test_nobody_to_choose_from():
    """-1 at a horizon without a candidate, the only candidate at the other, though it is not the fittest."""
    fitness = np.array([[[-1.0, -1.0], [-3.0, -4.0]]])
    candidates = np.array([[[False, False], [False, True]]])
    assert most_likely(fitness, candidates).tolist() == [[-1, 1]]


def test_a_future_of_probability_0_is_chosen_before_one_that_has_ended():
    """Only the first has any; the others are still there at step 2, and the first of them is the forecast."""
    alive = np.array([[1, 2, 2]])
    fitness = np.full((1, 3, 2), -np.inf, np.float32)
    fitness[:, 0] = 0.0
    xy = np.zeros((1, 3, 2, 2), np.float32)
    xy[0, :, 1, 0] = [1.0, 0.0, 5.0]
    truth, eligible = np.zeros((1, 2, 2)), dict.fromkeys(PROTOCOLS, np.array([2]))
    found = score(Forecast(xy, fitness, alive, "likeliest"), truth, eligible)
    for protocol in PROTOCOLS:
        assert found["likeliest", protocol]["fde"][0].tolist() == [0.0, 0.0]


@given(
    strategies.lists(strategies.integers(0, STEPS), min_size=K, max_size=K),
    strategies.lists(
        strategies.sampled_from([-np.inf, -3.0, -2.0, -0.0, 0.0, 1.0]), min_size=K * STEPS, max_size=K * STEPS
    ),
)
def test_the_best_ranked_is_the_fittest_of_the_longest_lived(alive, fitness):
    """Ties included: scores and figures choose the same future at every horizon."""
    fitness, alive = np.reshape(fitness, (K, STEPS)), np.array(alive)
    best = most_likely(fitness[None], longest_lived(alive[None], STEPS))[0]
    one = Forecast(np.zeros((K, STEPS, 2)), fitness, alive, "ranked")
    assert [rank_order(one, steps)[0] for steps in range(1, STEPS + 1)] == best.tolist()
