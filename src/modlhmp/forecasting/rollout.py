"""Algorithm 1 of the paper: roll a walker's state forward, biased at each step by a velocity sampled from a MoD."""

from typing import Any

import numpy as np

from modlhmp.angles import wrapped
from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.observe import Observed, velocity_at_t0
from modlhmp.forecasting.outputs import with_output
from modlhmp.forecasting.paths import hold
from modlhmp.kernels import kernel
from modlhmp.maps.base import parts
from modlhmp.options import RollOut
from modlhmp.site import Site
from modlhmp.streams import uniform


def forecaster(mod: Any, site: Site, options: RollOut) -> Forecaster:
    """The forecaster of a map that is sampled at every step; its result is as `options.output` says."""

    def forecast(observed: Observed, steps: int, keys: np.ndarray) -> Forecast:
        velocity = velocity_at_t0(observed, options.velocity, site)
        futures = roll_out(mod, observed, velocity, steps, keys, site.time_step_s, options.beta, options.speed)
        return with_output(futures, options.output)

    return forecast


def roll_out(
    mod: Any,
    observed: Observed,
    velocity: tuple[np.ndarray, np.ndarray],
    steps: int,
    keys: np.ndarray,
    step_s: float = 1.0,
    beta: float = 1.0,
    speed_rule: str = "constant",
) -> Forecast:
    """Forecast `steps` time steps with a MoD (contract: `maps.base`); returns a `Forecast`.

    `velocity` = (speed [n], heading [n]) at t0, `keys` [n, k] the random streams. Each step moves first, then samples
    at the new position, and a step is alive if the map has dynamics there. `speed_rule` = "constant" keeps the
    observed speed, "kernel" updates it as Eq. 2 does.
    """
    n, k = keys.shape
    xy, log_fitness = np.empty((n * k, steps, 2), np.float32), np.empty((n * k, steps), np.float32)
    steps_alive = np.zeros(n * k, np.int32)
    here, t0 = np.column_stack([observed.x[:, -1], observed.y[:, -1]]), observed.t[:, -1]
    for single, tracks in parts(mod, t0):
        # Particles still on the map stand at the beginning of these arrays.
        particle = (tracks[:, None] * k + np.arange(k)).ravel()
        track, stream, alive = particle // k, keys.ravel()[particle], len(particle)
        # Line 3: s_t0 = (x, y, rho_obs, theta_obs), and line 4: p = 1, whose log is 0.
        state = np.stack([*here[track].T, *(part[track] for part in velocity), np.zeros(alive)])
        t, moved, draws = t0[track], np.empty((2, alive)), np.empty((alive, single.draws))
        for step in range(steps):  # line 5
            _move(state, stream, alive, step, step_s, moved, draws)
            x, y, speed, heading = moved[0, :alive], moved[1, :alive], state[2, :alive], state[3, :alive]
            sampled = single.sample(x, y, speed, heading, t[:alive], draws[:alive])  # line 7
            alive = _bias(state, particle, stream, t, moved, *sampled, step, beta, speed_rule == "kernel",
                          xy, log_fitness, steps_alive)  # fmt: skip
            if not alive:
                break
    _hold(xy, log_fitness, steps_alive, here, k)
    return Forecast(xy.reshape(n, k, steps, 2), log_fitness.reshape(n, k, steps), steps_alive.reshape(n, k), "ranked")


@kernel
def _move(state, stream, alive, step, step_s, moved, draws):
    """Line 6 of Algorithm 1: positions `moved` [2, m] one step on, and the `draws` [m, d] for sampling there."""
    number = draws.shape[1]
    for i in range(alive):
        x, y, speed, heading = state[0, i], state[1, i], state[2, i], state[3, i]
        # Eq. 1
        moved[0, i], moved[1, i] = x + speed * np.cos(heading) * step_s, y + speed * np.sin(heading) * step_s
        for draw in range(number):
            draws[i, draw] = uniform(stream[i], step * number + draw)


@kernel
def _bias(state, particle, stream, t, moved, map_speed, map_heading, log_p, found, step, beta, kernel_speed,
          xy, log_fitness, steps_alive):  # fmt: skip
    """Lines 8 to 11: turn towards the sampled velocity; record the step; keep the particles that found dynamics.

    Returns how many those are.
    """
    kept = 0
    for i in range(len(found)):
        if not found[i]:
            continue
        # Line 10: p <- p p_t, as a sum of logs.
        speed, heading, fitness, future = state[2, i], state[3, i], state[4, i] + log_p[i], particle[i]
        xy[future, step, 0], xy[future, step, 1] = moved[0, i], moved[1, i]
        log_fitness[future, step], steps_alive[future] = fitness, step + 1
        # Eq. 2, with K(x) = exp(-beta x^2) of the difference.
        turn = wrapped(map_heading[i] - heading)
        heading = wrapped(heading + turn * np.exp(-beta * turn**2))
        if kernel_speed:
            change = map_speed[i] - speed
            speed += change * np.exp(-beta * change**2)
        state[0, kept], state[1, kept] = moved[0, i], moved[1, i]
        state[2, kept], state[3, kept], state[4, kept] = speed, heading, fitness
        particle[kept], stream[kept], t[kept] = future, stream[i], t[i]
        kept += 1
    return kept


@kernel
def _hold(xy, log_fitness, steps_alive, here, k):
    """Stopped futures stay at their last position alive, with the fitness that they had there."""
    for future in range(len(xy)):
        alive = steps_alive[future]
        hold(xy[future], alive, here[future // k])
        log_fitness[future, alive:] = log_fitness[future, alive - 1] if alive else 0.0
