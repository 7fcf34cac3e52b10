"""Algorithm 1 of the paper: roll a walker's state forward, biased at each step by a velocity sampled from a MoD."""

import numpy as np

from modlhmp.forecasting.base import Forecast, uniforms
from modlhmp.tracks import circular_difference, wrap_angle


def roll_out(mod, observed, velocity, steps, keys, step_s=1.0, beta=1.0, speed_rule="constant"):
    """Forecast `steps` time steps with a MoD (contract: `maps.base`); returns a `Forecast`.

    `velocity` = (speed [n], heading [n]) at t0, `keys` [n, k] the random streams. Each step moves first, then samples
    at the new position, and a step is alive if the map has dynamics there. `speed_rule` = "constant" keeps the
    observed speed, "kernel" updates it as the paper's equation does.
    """
    n, k = keys.shape
    track = np.repeat(np.arange(n), k)
    x, y = observed.x[track, -1], observed.y[track, -1]
    t0 = observed.t[track, -1]
    speed, heading = (np.asarray(part, float)[track] for part in velocity)
    stream = keys.ravel()
    xy = np.empty((steps, n * k, 2), np.float32)
    log_fitness = np.empty((steps, n * k), np.float32)
    steps_alive = np.zeros(n * k, np.int32)
    position, fitness = np.column_stack([x, y]), np.zeros(n * k)
    alive = np.arange(n * k)
    for step in range(steps):
        v, theta = speed[alive], heading[alive]
        x_new = position[alive, 0] + v * np.cos(theta) * step_s
        y_new = position[alive, 1] + v * np.sin(theta) * step_s
        draws = uniforms(stream[alive], step, mod.draws)
        v_map, theta_map, log_p, found = mod.sample(x_new, y_new, v, theta, t0[alive], draws)
        alive = alive[found]
        position[alive, 0], position[alive, 1] = x_new[found], y_new[found]
        fitness[alive] += log_p[found]
        steps_alive[alive] += 1
        turn = circular_difference(theta_map[found], theta[found])
        heading[alive] = wrap_angle(theta[found] + turn * np.exp(-beta * turn**2))
        if speed_rule == "kernel":
            change = v_map[found] - v[found]
            speed[alive] = v[found] + change * np.exp(-beta * change**2)
        xy[step], log_fitness[step] = position, fitness
    return Forecast(
        np.ascontiguousarray(xy.transpose(1, 0, 2)).reshape(n, k, steps, 2),
        np.ascontiguousarray(log_fitness.T).reshape(n, k, steps),
        steps_alive.reshape(n, k),
        "ranked",
    )
