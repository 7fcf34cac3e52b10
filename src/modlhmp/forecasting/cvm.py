"""Constant velocity model: the walker keeps the current velocity. One path, always alive."""

import numpy as np

from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.observe import Observed, velocity_at_t0
from modlhmp.options import ConstantVelocity
from modlhmp.site import Site


def forecaster(model: None, site: Site, options: ConstantVelocity) -> Forecaster:
    """The forecaster of a method (contract: `kinds.Kind`); there is no map, so no `model`."""
    return lambda observed, steps, keys: constant_velocity(
        observed, velocity_at_t0(observed, options.velocity, site), steps, site.time_step_s
    )


def constant_velocity(
    observed: Observed, velocity: tuple[np.ndarray, np.ndarray], steps: int, step_s: float = 1.0
) -> Forecast:
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
