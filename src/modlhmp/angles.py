"""Angles: wrapped to one turn, their differences and their mean. All wrapping of the project is done here."""

import numpy as np

from modlhmp.kernels import kernel

TWO_PI = 2.0 * np.pi


def wrap_angle(angle: np.ndarray) -> np.ndarray:
    """Wrap angles [rad] to (-pi, pi]."""
    wrapped = np.pi - np.mod(np.pi - angle, TWO_PI)
    return np.where(wrapped <= -np.pi, np.pi, wrapped)  # rounding can reach the open end


def circular_difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Signed smallest difference a - b of angles [rad], in (-pi, pi]."""
    return wrap_angle(a - b)


@kernel(inline="always")
def wrapped(angle):
    """`wrap_angle` of one angle, to the bit, for kernels."""
    below = np.pi - angle
    if not 0.0 <= below < TWO_PI:
        below = np.mod(below, TWO_PI)
    return np.pi if below >= TWO_PI else np.pi - below  # so that NaN stays NaN


@kernel(inline="always")
def one_turn(angle):
    """An angle, or an array of them, brought to [-pi, pi] with one operation: rounding can reach the end at -pi."""
    return np.pi - np.mod(np.pi - angle, TWO_PI)


@kernel(inline="always")
def unwrapped(difference, turns):
    """A difference of angles wrapped to [-pi, pi], plus so many whole `turns`."""
    return difference - TWO_PI * (np.rint(difference / TWO_PI) - turns)


@kernel
def circular_mean(angles):
    """Direction [rad] of the sum of the unit vectors of `angles` [n], in [-pi, pi]."""
    return np.arctan2(np.sin(angles).mean(), np.cos(angles).mean())


def by_convention(angle: np.ndarray, convention: str) -> np.ndarray:
    """Angles [rad] of a convention (`file_format.Units.heading`) from the x-axis towards y, and back again."""
    if convention == "from_x":
        return angle
    return np.pi / 2 - angle if convention == "compass" else -angle
