"""Angles: brought to one turn, and their differences. Every wrap of the project is one of these."""

import numpy as np

TWO_PI = 2.0 * np.pi


def wrap_angle(angle):
    """Wrap angles [rad] to (-pi, pi]."""
    wrapped = np.pi - np.mod(np.pi - angle, 2 * np.pi)
    return np.where(wrapped <= -np.pi, np.pi, wrapped)  # rounding can reach the open end


def circular_difference(a, b):
    """Signed smallest difference a - b of angles [rad], in (-pi, pi]."""
    return wrap_angle(a - b)
