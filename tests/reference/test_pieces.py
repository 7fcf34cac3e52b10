"""Pieces of tracks: against loops, and what the metric says of two walkers."""

import math

import crowds
import memory_twins
import numpy as np
import pytest
import twins
from hypothesis import given
from hypothesis import strategies as st

from modlhmp.maps.pieces import HEADINGS, Metric, differences, features, heading_bin, resample, vector_mean
from modlhmp.tracks import concatenate, empty_tracks

METRIC = Metric(8.0, 4.0, 2.0, 3.0)
WEIGHTS = [0.48, 0.33, 0.19]
ANGLES = st.floats(-math.pi, math.pi)


def steady(*velocities):
    """Last velocities [n, 3, 2] of walkers at constant velocity."""
    return np.repeat(np.array(velocities, float)[:, None], 3, axis=1)


def polar(speed, *degrees):
    return [(speed * math.cos(math.radians(a)), speed * math.sin(math.radians(a))) for a in degrees]


def apart(steps, metric=METRIC, xy=((0.0, 0.0), (0.0, 0.0)), hour=(9.0, 9.0), weights=WEIGHTS):
    """How unlike two walkers are, in m."""
    points, _ = features(np.array(xy), np.array(steps, float), weights, metric, np.array(hour))
    return math.dist(*points)


# --- bringing tracks to the time step -----------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("clock_s", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("step_s", [0.5, 1.0, 2.0])
def test_resampling_equals_the_loop(seed, clock_s, step_s):
    """With jittered clocks, gaps within 5 s and over, and people of one row."""
    tracks = crowds.crowd(seed, step_s=clock_s, gaps=(1,) * 9 + (2, 11))
    expected = memory_twins.resample(crowds.people_of(tracks), step_s)
    assert 5 < len(expected) < 40, "some are left out"
    pieces = resample(tracks, step_s)
    assert pieces.person.tolist() == [n for n, walk in enumerate(expected) for _ in walk]
    assert pieces.age.tolist() == [row for walk in expected for row in range(len(walk))]
    ends = np.cumsum([len(walk) for walk in expected]) - 1
    assert pieces.last.tolist() == [end for end, walk in zip(ends, expected, strict=True) for _ in walk]
    rows = np.array([row for walk in expected for row in walk])
    np.testing.assert_allclose(pieces.t, rows[:, 0], rtol=0, atol=1e-5)
    np.testing.assert_allclose(pieces.xy, rows[:, 1:], rtol=0, atol=1e-5)


def test_resampling_by_hand():
    tracks = concatenate([
        crowds.walk(5, [0.0, 2.0, 3.9], [(0, 0), (2, 0), (2, 1.9)]),
        crowds.walk(3, [0.0], [(9, 9)]),  # one row
        crowds.walk(4, [0.0, 5.5], [(9, 9), (9, 8)]),  # a gap
        crowds.walk(9, [0.0, 0.4], [(7, 7), (7, 8)]),  # less than a step: one row, which is also the last
    ])  # fmt: skip
    pieces = resample(tracks, 1.0)
    assert pieces.person.tolist() == [0, 0, 0, 0, 1]
    np.testing.assert_allclose(pieces.xy, [(0, 0), (1, 0), (2, 0), (2, 1), (7, 7)], atol=1e-6)
    assert pieces.last.tolist() == [3, 3, 3, 3, 4]
    assert pieces.age.tolist() == [0, 1, 2, 3, 0]


@pytest.mark.parametrize(("duration", "rows"), [(2.94, 3), (2.96, 4), (3.04, 4)])
def test_a_jittered_clock_does_not_cost_the_last_row(duration, rows):
    pieces = resample(crowds.walk(1, [0.0, 1.0, duration], [(0, 0), (1, 0), (duration, 0)]), 1.0)
    assert len(pieces.t) == rows
    assert pieces.xy[-1, 0] == pytest.approx(min(rows - 1, duration), abs=1e-6)


def test_no_tracks_have_no_pieces():
    assert [len(part) for part in resample(empty_tracks(), 1.0)] == [0] * 5


def test_resampling_does_not_depend_on_the_other_tracks():
    tracks = crowds.crowd(3)
    number = len(tracks.bounds()) - 1
    order = np.random.default_rng(3).permutation(number)
    one, other = resample(tracks, 1.0), resample(crowds.reordered(tracks, order), 1.0)
    by_walk = [
        sorted(tuple(np.round(p.xy[p.person == n], 5).ravel()) for n in np.unique(p.person)) for p in (one, other)
    ]
    assert by_walk[0] == by_walk[1]


# --- velocities ---------------------------------------------------------------------------------------------


def test_differences_are_the_newest_first():
    xy = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (4.0, 2.0)])
    got = differences(xy, 3, 0.5)
    assert got.shape == (4, 3, 2)
    assert got[3].tolist() == [[6, 0], [0, 4], [2, 0]]
    assert got[2, :2].tolist() == [[0, 4], [2, 0]]


def test_the_vector_mean_by_hand():
    steps = np.array([[(1.0, 0.0), (0.0, 1.0), (-1.0, 2.0)]])
    np.testing.assert_allclose(vector_mean(steps, WEIGHTS), [[0.48 - 0.19, 0.33 + 0.38]])
    np.testing.assert_allclose(vector_mean(steps, [1.0]), [[1.0, 0.0]])
    np.testing.assert_allclose(vector_mean(steps, [3.0, 1.0]), [[0.75, 0.25]])
    np.testing.assert_allclose(vector_mean(steps[:, :2], [2.0, 2.0, 4.0]), [[0.5, 0.5]])


def test_the_vector_mean_does_not_depend_on_the_other_walkers():
    steps = np.random.default_rng(1).normal(0, 1, (400, 3, 2))
    whole = vector_mean(steps, WEIGHTS)
    for n in range(0, 400, 7):
        np.testing.assert_array_equal(vector_mean(steps[n : n + 1], WEIGHTS)[0], whole[n])


# --- how alike two walkers are ------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("weights", [[1.0], WEIGHTS, [3.0, 1.0]])
def test_features_equal_the_loop(seed, weights):
    rng = np.random.default_rng(seed)
    xy, steps, hour = rng.normal(0, 5, (30, 2)), rng.normal(0, 0.5, (30, 3, 2)), rng.uniform(0, 24, 30)
    points, speed = features(xy, steps, weights, METRIC, hour)
    for n in range(30):
        expected = memory_twins.point(xy[n], steps[n].tolist(), weights, METRIC, hour[n])
        np.testing.assert_allclose(points[n], expected[0], atol=1e-12)
        assert speed[n] == pytest.approx(expected[1])


@given(ANGLES)
def test_sixty_degrees_at_1_m_s_are_heading_m(angle):
    degrees = math.degrees(angle)
    assert apart(steady(*polar(1.0, degrees, degrees + 60))) == pytest.approx(METRIC.heading_m)
    assert apart(steady(*polar(1.0, degrees, degrees + 180))) == pytest.approx(2 * METRIC.heading_m)


@pytest.mark.parametrize("speed", [0.0, 0.1, 0.2, 0.3, 2.0])
def test_a_heading_fades_below_30_cm_s(speed):
    expected = 2 * METRIC.heading_m * min(speed / 0.3, 1.0)
    assert apart(steady(*polar(speed, 0, 180))) == pytest.approx(expected)


def test_a_metre_counts_as_a_metre():
    assert apart(steady((1, 0), (1, 0)), xy=[(0, 0), (3, 4)]) == pytest.approx(5.0)


def test_1_m_s_is_speed_m():
    assert apart(steady((1, 0), (2, 0))) == pytest.approx(METRIC.speed_m)


def test_a_change_of_velocity_by_1_m_s_is_change_m():
    """From the oldest observed step to the newest, whatever lies between."""
    steady_one, faster = [(1, 0), (1, 0), (1, 0)], [(1.5, 0), (9, 9), (0.5, 0)]
    assert apart([steady_one, faster], Metric(0.0, 0.0, METRIC.change_m)) == pytest.approx(METRIC.change_m)


def test_an_hour_is_hour_m():
    assert apart(steady((1, 0), (1, 0)), hour=(9.0, 11.5)) == pytest.approx(2.5 * METRIC.hour_m)


@given(st.integers(0, 10**6), ANGLES, st.floats(-100, 100))
def test_moving_and_turning_both_walkers_changes_nothing(seed, angle, shift):
    rng = np.random.default_rng(seed)
    xy, steps = rng.normal(0, 3, (2, 2)), rng.normal(0, 1, (2, 3, 2))
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    assert apart(steps @ turn, xy=xy @ turn + shift) == pytest.approx(apart(steps, xy=xy), abs=1e-6)


# --- heading bins -------------------------------------------------------------------------------------------


@given(ANGLES, st.floats(0.31, 3.0))
def test_the_heading_bin_is_the_nearest_of_eight(angle, speed):
    got = heading_bin(np.array([[speed * math.cos(angle), speed * math.sin(angle)]]))[0]
    away = abs(twins.wrap(angle - got * math.pi / 4))
    assert 0 <= got < HEADINGS
    assert away <= math.pi / 8 + 1e-9


def test_heading_bins_go_from_east_to_the_left():
    directions = np.array(polar(1.0, 0, 45, 90, 135, 180, -180, -135, -90, -45))
    assert heading_bin(directions).tolist() == [0, 1, 2, 3, 4, 4, 5, 6, 7]


@pytest.mark.parametrize("border", range(8))
def test_a_heading_bin_ends_at_22_5_degrees_from_its_middle(border):
    degrees = 45 * border + 22.5
    around = heading_bin(np.array(polar(1.0, degrees - 0.01, degrees + 0.01)))
    assert around.tolist() == [border, (border + 1) % 8]
    assert heading_bin(np.array(polar(1.0, degrees)))[0] in around


@pytest.mark.parametrize(("speed", "slow"), [(0.0, True), (0.29, True), (0.3, False), (0.31, False)])
def test_whoever_hardly_moves_has_a_bin_of_their_own(speed, slow):
    assert (heading_bin(np.array([[0.0, speed]]))[0] == HEADINGS) == slow
