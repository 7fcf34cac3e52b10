"""Occupancy: against a plain count, with exits, and what cannot be asked."""

import itertools

import numpy as np
import pytest

import modlhmp
from modlhmp import DataError, Futures, Site
from modlhmp.forecasting.base import Forecast

SITE = Site(horizon_s=3)


def futures(paths, alive=None, output="mean", t0=0.0):
    """Of samples [n, k, T, 2]; by default all stay to the end."""
    xy = np.asarray(paths, np.float32)
    n, k, steps, _ = xy.shape
    lived = np.full((n, k), steps, np.int32) if alive is None else np.asarray(alive, np.int32)
    forecast = Forecast(xy, np.zeros((n, k, steps), np.float32), lived, output)
    return Futures(np.arange(n), np.full(n, t0), xy[:, 0, 0].astype(float), forecast, SITE)


def plain(paths, alive, cells, cell_m=1.0):
    """Probability per step and cell (i, j), person by person and sample by sample."""
    found = {}
    for step, (i, j) in itertools.product(range(len(paths[0][0])), cells):
        free = 1.0
        for walker, lived in zip(paths, alive, strict=True):
            there = [
                life > step and np.floor(path[step][0] / cell_m) == i and np.floor(path[step][1] / cell_m) == j
                for path, life in zip(walker, lived, strict=True)
            ]
            free *= 1 - sum(there) / len(there)
        found[step, i, j] = 1 - free
    return found


@pytest.mark.parametrize("cell_m", [1.0, 0.7])
def test_it_equals_the_plain_count(cell_m):
    rng = np.random.default_rng(3)
    paths = rng.normal(0, 2, (5, 9, 4, 2)).astype(np.float32)
    alive = rng.integers(1, 5, (5, 9))
    got = futures(paths, alive).occupancy(cell_m)
    rows, columns = got.probabilities.shape[1:]
    low = [round(one / cell_m) for one in got.origin]
    cells = [(low[0] + i, low[1] + j) for i in range(columns) for j in range(rows)]
    for (step, i, j), p in plain(paths, alive, cells, cell_m).items():
        assert got.probabilities[step, j - low[1], i - low[0]] == pytest.approx(p, abs=1e-6)
    there = (alive[..., None] > np.arange(4)).sum(axis=(0, 1))
    assert (got.probabilities.sum(axis=(1, 2)) <= there / 9 + 1e-5).all()
    np.testing.assert_array_equal(got.times_s, [1, 2, 3, 4])


def test_two_who_may_be_there():
    """Of each half the samples: 1 - 1/4; and a cell's lower border is its own."""
    walker = [[[0.5, 0.5]] * 2, [[1.0, 0.0]] * 2]
    got = futures([walker, walker]).occupancy(extent=(0, 3, 0, 2))
    assert got.probabilities[0].tolist() == [[0.75, 0.75, 0], [0, 0, 0]]
    assert got.origin == (0, 0)


def test_who_has_left_occupies_nothing():
    stays, leaves = [[1.5, 0.5]] * 3, [[0.5, 0.5]] * 3
    got = futures([[stays, leaves]], [[3, 1]]).occupancy(extent=(0, 2, 0, 1))
    np.testing.assert_allclose(got.probabilities[:, 0], [[0.5, 0.5], [0, 0.5], [0, 0.5]])


def test_whom_the_map_does_not_know_goes_straight_on():
    """Such a walker counts as never alive, and is there all the same."""
    straight = [[[0.5 + step, 0.5] for step in range(3)]]
    got = futures([straight], [[0]]).occupancy(extent=(0, 3, 0, 1))
    np.testing.assert_array_equal(got.probabilities[:, 0], np.eye(3))


@pytest.mark.parametrize(("output", "results"), [("median", 1), ("modes", 5)])
def test_results_before_the_samples_do_not_count(output, results):
    paths = [[[[9.5, 0.5]]] * results + [[[0.5, 0.5]], [[1.5, 0.5]]]]
    got = futures(paths, output=output).occupancy(extent=(0, 10, 0, 1))
    np.testing.assert_allclose(got.probabilities[0, 0, [0, 1, 9]], [0.5, 0.5, 0])


def test_what_lies_beyond_the_grid_does_not_count():
    got = futures([[[[-0.5, 0.5]], [[0.5, 0.5]]]]).occupancy(extent=(0, 1, 0, 1))
    assert got.probabilities.tolist() == [[[0.5]]]
    whole = futures([[[[-0.5, 0.5]], [[1.0, 2.0]]]]).occupancy()
    assert (whole.origin, whole.probabilities.shape) == ((-1, 0), (1, 3, 3))


def test_what_cannot_be_asked():
    one = futures(np.zeros((2, 3, 4, 2)))
    for cell_m in (0, -1, "1", True, float("nan")):
        with pytest.raises(DataError, match="a size in m above 0"):
            one.occupancy(cell_m)
    for extent in ((0, 1, 0), (1, 0, 0, 1), "abcd", (0, 1, 0, float("inf"))):
        with pytest.raises(DataError, match="give \\(x low"):
            one.occupancy(extent=extent)
    with pytest.raises(DataError, match="larger cell_m"):
        one.occupancy(extent=(0, 1e5, 0, 1e5))
    with pytest.raises(DataError, match="at one moment"):
        futures(np.zeros((2, 3, 4, 2)), t0=np.array([0.0, 5.0])).occupancy()


def test_of_a_live_forecast():
    live = modlhmp.Live("cvm", 3, site=SITE)
    for t in range(5):
        live.see(t, "a", t, 0.5)
        live.see(t, "b", 2 * t, 0.5)
    got = live.forecast().occupancy(extent=(0, 15, 0, 1))
    assert got.t0 == 4
    assert [np.flatnonzero(row[0]).tolist() for row in got.probabilities] == [[5, 10], [6, 12], [7, 14]]
