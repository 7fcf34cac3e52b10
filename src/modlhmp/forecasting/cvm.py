"""Constant velocity model: the walker keeps the current velocity. One path, always alive."""

import numpy as np

from modlhmp.forecasting.base import Forecast


def constant_velocity(observed, velocity, steps, step_s=1.0):
    """Forecast `steps` time steps; `velocity` = (speed [n], heading [n]) at t0."""
    speed, heading = velocity
    direction = np.column_stack([speed * np.cos(heading), speed * np.sin(heading)])
    start = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
    elapsed = np.arange(1, steps + 1) * step_s
    xy = start[:, None] + direction[:, None] * elapsed[:, None]
    n = len(start)
    return Forecast(
        xy[:, None].astype(np.float32),
        np.zeros((n, 1, steps), np.float32),
        np.full((n, 1), steps, np.int32),
        "single",
    )
