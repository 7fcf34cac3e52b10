"""Horizons of tables, tests and figures: the usual ones where a dataset has them, else such as fit it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modlhmp.scoring.horizons import LADDER_S, scored_horizons
from modlhmp.site import Site


def site(horizon_s, time_step_s=1.0):
    return Site(horizon_s=horizon_s, time_step_s=time_step_s)


@pytest.mark.parametrize(
    ("horizon_s", "time_step_s", "expected"),
    [
        (60, 1.0, [5, 10, 20, 30, 60]),  # ATC
        (20, 1.0, [5, 10, 20]),  # Edinburgh
        (4.8, 0.4, [1.2, 2.4, 3.6, 4.8]),  # ETH: 12 steps
        (25, 1.0, [5, 10, 20, 25]),  # the longest always
        (12, 1.0, [5, 10, 12]),
        (10, 1.0, [2, 5, 8, 10]),  # two of the usual ones are too few
        (60, 0.5, [5, 10, 20, 30, 60]),
        (2.0, 1.0, [1, 2]),
        (0.4, 0.4, [0.4]),
    ],
)
def test_horizons_that_nobody_chose_fit_the_dataset(horizon_s, time_step_s, expected):
    assert scored_horizons(None, site(horizon_s, time_step_s)) == expected


def test_the_ladder_has_usual_horizons_of_its_own():
    assert scored_horizons(None, site(60), LADDER_S) == [5, 10, 20, 60]
    assert scored_horizons(None, site(20), LADDER_S) == [5, 10, 20]
    assert scored_horizons(None, site(4.8, 0.4), LADDER_S) == [1.2, 2.4, 3.6, 4.8]


def test_chosen_horizons_are_taken_as_they_are_without_those_that_do_not_fit():
    eth = site(4.8, 0.4)
    assert scored_horizons([5, 10, 20], eth) == []
    assert scored_horizons([0.8, 1, 4, 12 * 0.4, 5], eth) == [0.8, 4, 12 * 0.4]  # in floats more than 4.8
    assert scored_horizons([2.0], site(60)) == [2.0]


@given(st.integers(1, 400), st.sampled_from([0.1, 0.4, 0.5, 1.0, 2.5, 1 / 3]))
def test_such_horizons_are_whole_steps_in_order_and_end_with_the_longest(steps, time_step_s):
    longest = round(steps * time_step_s, 9)
    found = scored_horizons(None, site(longest, time_step_s))
    assert found == sorted(set(found))
    assert found[-1] == longest
    assert len(found) >= min(3, steps)
    assert all(one / time_step_s == pytest.approx(round(one / time_step_s), abs=1e-6) for one in found)
