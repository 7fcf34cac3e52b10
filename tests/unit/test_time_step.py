"""Positions on the grid that ends at one moment, as a live forecast knows them."""

import numpy as np
import pytest

from modlhmp.contract import crowd
from modlhmp.time_step import GONE, HERE, NEW, ending_at
from modlhmp.tracks import Tracks, concatenate

T0 = 1.3e9


def walk(track, t, speed=1.2):
    """Somebody who walks straight on, with rows at these seconds after `T0`."""
    t = np.asarray(t, float)
    nan = np.full(len(t), np.nan)
    return Tracks(np.full(len(t), track), T0 + t, speed * t, 3.0 - 0.5 * t, nan, nan)


def state_of(t, at=0.0, step_s=1.0):
    """What somebody with these rows is."""
    return ending_at(walk(1, t), T0 + at, step_s, 4)[1].tolist()


def test_rows_on_the_grid_are_taken_as_they_are():
    """To the bit, whoever else is there, and also where a time step is no binary fraction."""
    people = crowd()
    one = people.take(people.track_id == 7)
    for at in (5, 11):
        got, state = ending_at(people, one.t[at], 1.0, 4)
        mine = got.take(got.track_id == 7)
        assert state[7] == HERE
        for ours, theirs in zip(mine[:4], one[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs[at - 3 : at + 1])
        assert np.isnan(mine.speed).all()
    fine = one._replace(t=T0 + 0.4 * np.arange(len(one.t)))
    got, _ = ending_at(fine, fine.t[9], 0.4, 4)
    np.testing.assert_array_equal(got.t, fine.t[6:10])
    np.testing.assert_array_equal(got.x, fine.x[6:10])


@pytest.mark.parametrize("step_s", [0.4, 1.0])
def test_between_rows_it_is_linear(step_s):
    rng = np.random.default_rng(1)
    t = np.append(np.sort(rng.uniform(-12, 0, 59)), 0.0)  # the last row is at t0: beyond it nothing is known
    one = walk(3, t)._replace(x=rng.normal(size=60), y=rng.normal(size=60))
    got, _ = ending_at(one, T0, step_s, 4)
    grid = T0 + step_s * np.arange(-3, 1)
    np.testing.assert_allclose(got.t, grid, atol=1e-6)
    np.testing.assert_allclose(got.x, np.interp(grid, one.t, one.x), atol=1e-6)
    np.testing.assert_allclose(got.y, np.interp(grid, one.t, one.y), atol=1e-6)


def test_only_rows_up_to_t0_count():
    t = np.arange(-6, 6, 0.3)
    past, whole = walk(1, t[t <= 0]), walk(1, t)
    whole.x[t > 0] = 99.0
    for ours, theirs in zip(*(ending_at(one, T0, 1.0, 4)[0] for one in (whole, past)), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_beyond_the_newest_row_a_person_goes_on_as_in_the_last_step():
    """Not as in the last two rows, whose noise is as large as their distance at a tracker's rate."""
    t = np.arange(-8, -0.5, 0.04)
    noisy = walk(1, t)
    noisy.x[-1] += 0.03
    got, _ = ending_at(noisy, T0, 1.0, 4)
    assert got.t[-1] == T0
    assert got.x[-1] == pytest.approx(0.03, abs=0.03), "the last two rows alone would say 0.4"
    got, _ = ending_at(walk(1, np.arange(-9.7, 0, 2)), T0, 1.0, 4)  # of a slow sensor: several moments lie beyond
    np.testing.assert_allclose(got.x, 1.2 * np.arange(-3, 1), atol=1e-6)


@pytest.mark.parametrize(
    ("t", "is_"),
    [
        (np.arange(-3, 1), HERE),
        (np.arange(-2, 1), NEW),
        ([0], NEW),
        ([-1], NEW),
        ([1, 2], GONE),
        (np.arange(-9, -1.5), GONE),
        (np.arange(-9.04, -1), HERE),  # persons' clocks tick apart
        (np.arange(-10.9, 0, 2), HERE),  # half as long again as the sensor takes
        (np.arange(-11.1, -2, 2), GONE),
        ([-9, -8, -7, -1, 0], NEW),  # after a gap a track begins anew
        ([-9, -8, -4, 0], HERE),
    ],
)
def test_who_is_here(t, is_):
    assert state_of(t) == [is_]


def test_nobody_and_several():
    got, state = ending_at(walk(1, []), T0, 1.0, 4)
    assert not len(got.t)
    assert not len(state)
    people = concatenate([walk(1, np.arange(-9, 1)), walk(2, [-1, 0]), walk(5, np.arange(-5, 3))])
    got, state = ending_at(people, T0, 1.0, 3)
    assert state.tolist() == [HERE, NEW, HERE]
    assert got.track_id.tolist() == [1, 1, 1, 5, 5, 5]
