"""Angles: wrapping, differences and means, in arrays and in compiled functions."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from modlhmp import angles
from modlhmp.angles import TWO_PI, circular_difference, circular_mean, one_turn, wrap_angle
from modlhmp.kernels import kernel

ANGLES = st.floats(-1000, 1000)


def turn_between(a, b):
    """Angle between two directions [rad], >= 0, by complex numbers."""
    return abs(np.angle(np.exp(1j * (np.asarray(a) - np.asarray(b)))))


@kernel
def wrapped_many(many):
    """`angles.wrapped` as compiled functions use it."""
    out = np.empty_like(many)
    for n in range(len(many)):
        out[n] = angles.wrapped(many[n])
    return out


@kernel
def unwrapped_many(many, turns):
    """`angles.unwrapped` as compiled functions use it."""
    out = np.empty_like(many)
    for n in range(len(many)):
        out[n] = angles.unwrapped(many[n], turns)
    return out


def difficult():
    """Random angles of all sizes, multiples of half pi with their neighbours, tiny ones of both signs."""
    rng = np.random.default_rng(1)
    spread = np.concatenate([rng.uniform(-8, 8, 20000), rng.normal(0, 1, 20000) * 10.0 ** rng.integers(-18, 9, 20000)])
    edges = np.arange(-40, 41) * (np.pi / 2)
    near = [edges]
    for far in (np.inf, -np.inf):
        beside = edges
        for _ in range(3):
            beside = np.nextafter(beside, far)
            near.append(beside)
    tiny = np.array([5e-324, 1e-300, 1e-17, 1e-16, 2.3e-16, 4.5e-16])
    return np.concatenate([spread, *near, tiny, -tiny, [0.0, -0.0]])


@given(ANGLES)
@example(math.pi)
@example(-math.pi)
@example(math.nextafter(math.pi, 4))
@example(math.nextafter(-math.pi, -4))
@example(math.nextafter(3 * math.pi, 10))
@example(-0.0)
def test_wrapped_angles_lie_above_minus_pi_up_to_pi(angle):
    assert -math.pi < wrap_angle(angle) <= math.pi


@given(ANGLES)
def test_wrapping_keeps_the_direction(angle):
    assert turn_between(wrap_angle(angle), angle) < 1e-9


@given(st.floats(-3.14, 3.14))
def test_wrapping_leaves_wrapped_angles_alone(angle):
    assert wrap_angle(angle) == pytest.approx(angle, abs=1e-15)


@pytest.mark.parametrize("turns", [-3, -1, 1, 3, 5])
def test_half_turns_become_plus_pi(turns):
    assert wrap_angle(turns * math.pi) == pytest.approx(math.pi, abs=1e-12)


def test_wrapping_keeps_nan_and_shape():
    angles = np.array([[0.5, np.nan], [7.0, -7.0]])
    wrapped = wrap_angle(angles)
    assert wrapped.shape == (2, 2)
    assert np.isnan(wrapped).tolist() == [[False, True], [False, False]]


@given(st.floats(-4, 4), st.floats(-4, 4))
@example(math.pi, -math.pi)
@example(-math.pi, math.pi)
@example(0.0, math.pi)
@example(math.pi, 0.0)
@example(-3.0, 3.0)
def test_circular_difference_is_the_smallest_turn(a, b):
    difference = circular_difference(a, b)
    assert -math.pi < difference <= math.pi
    assert abs(difference) == pytest.approx(turn_between(a, b), abs=1e-9)
    assert turn_between(b + difference, a) < 1e-9


def test_circular_difference_across_the_border():
    assert circular_difference(-3.0, 3.0) == pytest.approx(2 * math.pi - 6)
    assert circular_difference(3.0, -3.0) == pytest.approx(6 - 2 * math.pi)


def test_the_compiled_wrap_is_that_of_arrays_to_the_bit():
    """Forecasts are compared to the bit, and some of their angles are wrapped the one way, some the other."""
    many = difficult()
    np.testing.assert_array_equal(wrapped_many(many).view(np.uint64), wrap_angle(many).view(np.uint64))
    assert np.isnan(wrapped_many(np.array([np.nan]))[0])


@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_unwrapped_differences_are_the_smallest_and_so_many_turns_on(turns):
    many = np.random.default_rng(2).uniform(-20, 20, 5000)
    got = unwrapped_many(many, turns) - TWO_PI * turns
    assert (np.abs(got) <= np.pi + 1e-12).all()
    np.testing.assert_allclose(np.exp(1j * got), np.exp(1j * many), atol=1e-12)


def test_the_circular_mean_is_the_direction_of_the_sum_of_unit_vectors():
    rng = np.random.default_rng(3)
    for _ in range(50):
        many = rng.normal(rng.uniform(-4, 4), rng.uniform(0.1, 2), rng.integers(1, 30))
        assert turn_between(circular_mean(many), np.angle(np.exp(1j * many).sum())) < 1e-9
    assert abs(circular_mean(np.array([math.pi - 0.1, 0.1 - math.pi]))) == pytest.approx(math.pi)


def test_one_turn_is_wrap_angle_but_for_the_end_that_rounding_reaches():
    angle = np.concatenate([np.linspace(-9, 9, 1001), [-1e-20 - np.pi, np.pi, -np.pi]])
    turned, expected = one_turn(angle), wrap_angle(angle)
    at_the_end = turned == -np.pi
    np.testing.assert_array_equal(turned[~at_the_end], expected[~at_the_end])
    assert (expected[at_the_end] == np.pi).all()
