"""One path out of many: geometric medians against a minimiser, medians of futures, averages of methods, both scored."""

import math

import numpy as np
import pytest
import twins
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from modlhmp.forecasting.average import average_forecasts
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import read_forecasts, write_forecasts
from modlhmp.forecasting.median import geometric_median, with_median
from modlhmp.scoring.protocols import PROTOCOLS, score

FEW = settings(max_examples=30)
SEEDS = st.integers(0, 10**6)
STEPS = 8


def median(points):
    x, y = np.array(points, float).T.copy()
    return geometric_median(x, y, len(points))


def mean_distance(at, points):
    return np.hypot(*(np.asarray(points) - at).T).mean()


def assert_best(points):
    """No point has a mean distance that is smaller by more than a centimetre."""
    start = np.mean(points, axis=0)
    options = {"xatol": 1e-6, "fatol": 1e-9, "maxiter": 4000}
    best = min(
        minimize(mean_distance, guess, args=(points,), method="Nelder-Mead", options=options).fun
        for guess in (start, np.median(points, axis=0))
    )
    assert mean_distance(median(points), points) <= best + 0.01


# --- the geometric median -----------------------------------------------------------------------------------


@FEW
@given(SEEDS, st.integers(1, 40), st.floats(0.05, 20.0))
def test_no_point_is_nearer_to_random_points(seed, number, spread):
    assert_best(np.random.default_rng(seed).normal(0, spread, (number, 2)) + np.array([100.0, -40.0]))


@FEW
@given(SEEDS)
def test_no_point_is_nearer_to_two_groups(seed):
    """One group of 12, one of 7: the mean lies between, the median with the many."""
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.normal(0, 0.5, (12, 2)), rng.normal(0, 0.5, (7, 2)) + np.array([10.0, 0.0])])
    assert_best(points)
    assert math.hypot(*median(points)) < 2.0


@FEW
@given(st.lists(st.integers(-20, 20), min_size=1, max_size=9, unique=True), st.floats(-3.1, 3.1))
def test_of_an_odd_number_on_a_line_it_is_the_middle_one(places, angle):
    places = places if len(places) % 2 else places[1:]
    if places:
        along = np.array([math.cos(angle), math.sin(angle)])
        expected = np.median(places) * along
        np.testing.assert_allclose(median(np.array(places)[:, None] * along), expected, atol=0.05)


@given(st.floats(-50, 50), st.floats(-50, 50), st.integers(1, 30))
def test_of_equal_points_it_is_that_point(x, y, number):
    np.testing.assert_allclose(median([(x, y)] * number), (x, y), atol=1e-9)


@given(st.floats(-50, 50), st.floats(-50, 50))
def test_of_two_points_it_is_halfway(x, y):
    np.testing.assert_allclose(median([(x, y), (-3.0, 8.0)]), ((x - 3.0) / 2, (y + 8.0) / 2), atol=1e-9)


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([(0, 0), (6, 6), (0, 4), (4, 0)], (2, 2)),  # of a convex quadrilateral where the diagonals cross
        ([(0, 0), (4, 0), (2, 2 * math.sqrt(3))], (2, 2 / math.sqrt(3))),  # of an equilateral triangle the centre
        ([(0, 0), (3, 0.5), (-3, 0.5)], (0, 0)),  # a corner of 120 degrees or more
        ([(5, 5)] * 5 + [(90, 0), (0, 90), (-80, 3), (1, -70)], (5, 5)),  # most are at one point
    ],
)
def test_closed_forms(points, expected):
    np.testing.assert_allclose(median(points), expected, atol=0.03)


def test_points_beyond_the_count_do_not_count():
    x, y = np.array([1.0, 3.0, 99.0, np.nan]), np.array([2.0, 4.0, 99.0, np.nan])
    assert geometric_median(x, y, 2) == geometric_median(x[:2], y[:2], 2)


@FEW
@given(SEEDS, st.floats(-3.1, 3.1))
def test_order_place_and_direction_of_the_axes_do_not_matter(seed, angle):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 4, (15, 2))
    at, shift = np.array(median(points)), np.array([30.0, -20.0])
    np.testing.assert_allclose(median(points[rng.permutation(15)]), at, atol=2e-3)
    np.testing.assert_allclose(median(points + shift), at + shift, atol=1e-6)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    np.testing.assert_allclose(median(points @ turn), at @ turn, atol=5e-3)


# --- the median of futures ----------------------------------------------------------------------------------


def futures(seed, n=6, k=5, lives=(0, 2, 5, STEPS)):
    """Random futures that are held from the end of their lives on; the last walker's never lived."""
    rng = np.random.default_rng(seed)
    start = rng.normal(0, 5, (n, 2))
    xy = (start[:, None, None] + np.cumsum(rng.normal(0.5, 1, (n, k, STEPS, 2)), axis=2)).astype(np.float32)
    alive = rng.choice(lives, (n, k)).astype(np.int32)
    alive[-1] = 0
    fitness = np.cumsum(rng.normal(-1, 1, (n, k, STEPS)), axis=2).astype(np.float32)
    for i, j in np.ndindex(n, k):
        xy[i, j, alive[i, j] :] = xy[i, j, alive[i, j] - 1] if alive[i, j] else start[i]
    return Forecast(xy, fitness, alive, "ranked"), start


@pytest.mark.parametrize("seed", range(5))
def test_the_median_path_equals_the_loop(seed):
    """At each step of those still alive; held when none is; where nobody ever lived, at the start."""
    forecast, start = futures(seed)
    got = with_median(forecast)
    assert got.output == "median"
    for i, (paths, alive) in enumerate(zip(forecast.xy, forecast.steps_alive, strict=True)):
        expected = []
        for step in range(STEPS):
            there = [path[step] for path, life in zip(paths, alive, strict=True) if life > step]
            expected.append(median(there) if there else expected[-1] if expected else start[i])
        np.testing.assert_allclose(got.xy[i, 0], expected, atol=1e-5)
        assert got.steps_alive[i, 0] == alive.max()


def test_the_futures_follow_their_median_unchanged():
    forecast, _ = futures(1)
    got = with_median(forecast)
    for one, other in zip(got[:3], forecast[:3], strict=True):
        np.testing.assert_array_equal(one[:, 1:], other)
        assert one.dtype == other.dtype
    assert not got.log_fitness[:, 0].any()


def test_the_dead_do_not_pull():
    """Nine futures stop at once and stand; the tenth walks on, and the median with it."""
    xy = np.zeros((1, 10, STEPS, 2), np.float32)
    xy[0, 9, :, 0] = np.arange(1, STEPS + 1)
    alive = np.array([[1] * 9 + [STEPS]], np.int32)
    got = with_median(Forecast(xy, np.zeros((1, 10, STEPS), np.float32), alive, "ranked"))
    np.testing.assert_allclose(got.xy[0, 0, 1:], xy[0, 9, 1:], atol=1e-6)
    assert math.hypot(*got.xy[0, 0, 0]) < 0.1


def test_a_shorter_horizon_and_fewer_walkers_have_the_same_median():
    forecast, _ = futures(2)
    whole = with_median(forecast)
    short = with_median(
        Forecast(forecast.xy[:, :, :3], forecast.log_fitness[:, :, :3], np.minimum(forecast.steps_alive, 3), "ranked")
    )
    np.testing.assert_array_equal(short.xy, whole.xy[:, :, :3])
    np.testing.assert_array_equal(short.steps_alive, np.minimum(whole.steps_alive, 3))
    few = with_median(Forecast(*(part[[3, 1]] for part in forecast[:3]), "ranked"))
    np.testing.assert_array_equal(few.xy, whole.xy[[3, 1]])


# --- storing and scoring medians ----------------------------------------------------------------------------


def test_a_median_is_stored_with_its_futures(tmp_path):
    forecast = with_median(futures(3, k=7)[0])
    ids = np.arange(6) + 50
    write_forecasts(tmp_path / "f.parquet", [(4, ids, forecast)])
    [(seed, got_ids, got)] = read_forecasts(tmp_path / "f.parquet")
    assert (seed, got.output) == (4, "median")
    assert got_ids.tolist() == ids.tolist()
    for one, other in zip(got[:3], forecast[:3], strict=True):
        np.testing.assert_array_equal(one, other)


def test_ranked_futures_are_stored_all(tmp_path):
    forecast, _ = futures(3, k=30)
    write_forecasts(tmp_path / "f.parquet", [(0, np.arange(6), forecast)])
    [(_, _, got)] = read_forecasts(tmp_path / "f.parquet")
    np.testing.assert_array_equal(got.xy, forecast.xy)


@pytest.mark.parametrize("seed", range(5))
def test_a_median_is_scored_as_one_path(seed):
    """Complete: held where it has ended. Paper: not scored beyond its life. Its futures do not count."""
    rng = np.random.default_rng(seed)
    forecast = with_median(futures(seed, n=12, lives=(0, 2, 2, 5))[0])
    n, life = 12, forecast.steps_alive[:, 0]
    truth = rng.normal(0, 5, (n, STEPS, 2))
    length = rng.integers(0, STEPS + 3, n)
    truth[np.arange(1, STEPS + 1) > length[:, None]] = np.nan
    walls = rng.random((n, 6, STEPS)) < 0.3
    got = score(forecast, truth, {"paper": length, "complete": length}, walls)
    assert set(got) == {("median", protocol) for protocol in PROTOCOLS}
    scored = dict.fromkeys(PROTOCOLS, 0)
    for (_, protocol), values in got.items():
        for i, step in np.ndindex(n, STEPS):
            expected = (np.nan,) * 3
            if step < length[i] and (protocol == "complete" or step < life[i]):
                expected = *twins.errors_at(forecast.xy[i, 0], truth[i], step + 1), walls[i, 0, step]
                scored[protocol] += 1
            one = [values[name][i, step] for name in ("ade", "fde", "infeasible")]
            np.testing.assert_allclose(one, expected, rtol=1e-5)
    assert 0 < scored["paper"] < scored["complete"]


# --- averages of methods ------------------------------------------------------------------------------------

IDS = np.array([7, 9])


def method(*paths, alive=None, ids=IDS, output="single", more=0):
    """One seed's forecast of two walkers along x, each path a list of x; `more` futures after it, far away."""
    x = np.array(paths, np.float32)
    xy = np.stack([x, np.zeros_like(x)], axis=-1)[:, None]
    alive = np.array([x.shape[1]] * len(x) if alive is None else alive, np.int32)[:, None]
    xy = np.concatenate([xy, np.full((len(x), more, *xy.shape[2:]), 1e3, np.float32)], axis=1)
    alive = np.repeat(alive, 1 + more, axis=1)
    return ids, Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, output)


def averaged(*members):
    """{seed: (x [n, T], steps alive [n])} of the average of members {seed: (ids, forecast)}."""
    lists = [[(seed, *one) for seed, one in member.items()] for member in members]
    result = {}
    for seed, ids, forecast in average_forecasts(lists):
        assert forecast.output == "single"
        assert forecast.xy.shape == (len(ids), 1, forecast.xy.shape[2], 2)
        assert forecast.xy.dtype == np.float32
        assert forecast.steps_alive.shape == (len(ids), 1)
        assert not forecast.log_fitness.any()
        result[seed] = forecast.xy[:, 0, :, 0].tolist(), forecast.steps_alive[:, 0].tolist()
    return result


def test_the_average_of_three_paths():
    got = averaged({0: method([0, 1, 2], [5] * 3)}, {0: method([3, 4, 5], [5] * 3)}, {0: method([6, 7, 8], [8] * 3)})
    assert got == {0: ([[3, 4, 5], [6, 6, 6]], [3, 3])}


def test_only_the_first_future_counts():
    got = averaged({0: method([0, 2], [0, 0], output="median", more=5)}, {0: method([4, 4], [2, 2])})
    assert got == {0: ([[2, 3], [1, 1]], [2, 2])}


def test_a_path_that_has_ended_no_longer_counts():
    got = averaged({0: method([0, 1, 1, 1], [0] * 4, alive=[2, 4])}, {0: method([2, 3, 4, 5], [4] * 4)})
    assert got == {0: ([[1, 2, 4, 5], [2, 2, 2, 2]], [4, 4])}


def test_the_average_is_held_when_all_have_ended():
    one, other = method([0, 1, 1, 1], [0] * 4, alive=[2, 4]), method([2, 3, 5, 5], [4] * 4, alive=[3, 4])
    assert averaged({0: one}, {0: other}) == {0: ([[1, 2, 5, 5], [2, 2, 2, 2]], [3, 4])}


def test_where_nobody_knows_more_than_constant_velocity_that_is_averaged():
    one, other = method([0, 1, 2], [1, 2, 3], alive=[0, 3]), method([2, 3, 4], [9, 9, 9], alive=[0, 0])
    assert averaged({0: one}, {0: other}) == {0: ([[1, 2, 3], [1, 2, 3]], [0, 3])}


@pytest.mark.parametrize("turned", [False, True])
def test_a_seed_is_averaged_with_the_same_seed_or_with_the_only_one(turned):
    five = {seed: method([seed] * 2, [0, 0]) for seed in range(5)}
    again = {seed: method([10 * seed] * 2, [0, 0]) for seed in range(5)}
    once = {0: method([100] * 2, [0, 0])}
    members = [once, again, five] if turned else [five, once, again]
    got = averaged(*members)
    assert list(got) == list(range(5))
    for seed, (x, _) in got.items():
        np.testing.assert_allclose(x, [[(11 * seed + 100) / 3] * 2, [0, 0]], rtol=1e-6)


@pytest.mark.parametrize("ids", [[7, 8], [9, 7], [7]])
def test_forecasts_of_different_tracks_are_not_averaged(ids):
    other = method(*[[0.0, 1.0]] * len(ids), ids=np.array(ids))
    with pytest.raises(ValueError, match="different tracks"):
        averaged({0: method([0, 1], [0, 1])}, {0: other})


def test_the_average_of_a_method_with_itself_is_the_method():
    forecast = with_median(futures(6)[0])
    ids = np.arange(6)
    [(_, _, got)] = average_forecasts([[(0, ids, forecast)]] * 3)
    np.testing.assert_allclose(got.xy[:, 0], forecast.xy[:, 0], atol=1e-6)
    np.testing.assert_array_equal(got.steps_alive[:, 0], forecast.steps_alive[:, 0])


def test_the_average_for_a_recording_without_usable_tracks_can_be_written(tmp_path):
    """Its members' files hold no row, and so must this one."""
    nobody = Forecast(np.empty((0, 1, STEPS, 2), np.float32), np.empty((0, 1, STEPS), np.float32),
                      np.empty((0, 1), np.int32), "single")  # fmt: skip
    for name in ("a", "b"):
        write_forecasts(tmp_path / name, [(0, np.empty(0, np.int64), nobody)])
    members = [list(read_forecasts(tmp_path / name)) for name in ("a", "b")]
    write_forecasts(tmp_path / "average", average_forecasts(members))
    assert list(read_forecasts(tmp_path / "average")) == []
