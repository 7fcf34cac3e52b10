"""Algorithm 1 of the paper: roll a walker's state forward, biased at each step by a velocity sampled from a MoD."""

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.replay import hold
from modlhmp.kernels import kernel
from modlhmp.maps.base import parts
from modlhmp.streams import uniform

TWO_PI = 2.0 * np.pi


def roll_out(mod, observed, velocity, steps, keys, step_s=1.0, beta=1.0, speed_rule="constant"):
    """Forecast `steps` time steps with a MoD (contract: `maps.base`); returns a `Forecast`.

    `velocity` = (speed [n], heading [n]) at t0, `keys` [n, k] the random streams. Each step moves first, then samples
    at the new position, and a step is alive if the map has dynamics there. `speed_rule` = "constant" keeps the
    observed speed, "kernel" updates it as the paper's equation does.
    """
    n, k = keys.shape
    xy, log_fitness = np.empty((n * k, steps, 2), np.float32), np.empty((n * k, steps), np.float32)
    steps_alive = np.zeros(n * k, np.int32)
    here, t0 = np.column_stack([observed.x[:, -1], observed.y[:, -1]]), observed.t[:, -1]
    for one, tracks in parts(mod, t0):
        # Particles still on the map stand at the beginning of these arrays.
        particle = (tracks[:, None] * k + np.arange(k)).ravel()
        track, stream, alive = particle // k, keys.ravel()[particle], len(particle)
        state = np.stack([*here[track].T, *(part[track] for part in velocity), np.zeros(alive)])
        t, moved, draws = t0[track], np.empty((2, alive)), np.empty((alive, one.draws))
        for step in range(steps):
            _move(state, stream, alive, step, step_s, moved, draws)
            x, y, speed, heading = moved[0, :alive], moved[1, :alive], state[2, :alive], state[3, :alive]
            sampled = one.sample(x, y, speed, heading, t[:alive], draws[:alive])
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
        moved[0, i], moved[1, i] = x + speed * np.cos(heading) * step_s, y + speed * np.sin(heading) * step_s
        for draw in range(number):
            draws[i, draw] = uniform(stream[i], step * number + draw)


@kernel
def _bias(state, particle, stream, t, moved, map_speed, map_heading, log_p, found, step, beta, kernel_speed,
          xy, log_fitness, steps_alive):  # fmt: skip
    """Line 8: turn towards the sampled velocity; record the step; keep the particles that found dynamics.

    Returns how many those are.
    """
    kept = 0
    for i in range(len(found)):
        if not found[i]:
            continue
        speed, heading, fitness, one = state[2, i], state[3, i], state[4, i] + log_p[i], particle[i]
        xy[one, step, 0], xy[one, step, 1] = moved[0, i], moved[1, i]
        log_fitness[one, step], steps_alive[one] = fitness, step + 1
        turn = _wrapped(map_heading[i] - heading)
        heading = _wrapped(heading + turn * np.exp(-beta * turn**2))
        if kernel_speed:
            change = map_speed[i] - speed
            speed += change * np.exp(-beta * change**2)
        state[0, kept], state[1, kept] = moved[0, i], moved[1, i]
        state[2, kept], state[3, kept], state[4, kept] = speed, heading, fitness
        particle[kept], stream[kept], t[kept] = one, stream[i], t[i]
        kept += 1
    return kept


@kernel
def _wrapped(angle):
    """An angle in [-3 pi, 3 pi] brought to (-pi, pi], to the bit as `tracks.wrap_angle` does."""
    below = np.pi - angle
    if below < 0.0:
        below += TWO_PI
    elif below >= TWO_PI:
        below -= TWO_PI
    return np.pi - below if below < TWO_PI else np.pi


@kernel
def _hold(xy, log_fitness, steps_alive, here, k):
    """Stopped futures stay at their last position alive, with the fitness that they had there."""
    for one in range(len(xy)):
        alive = steps_alive[one]
        hold(xy[one], alive, here[one // k])
        log_fitness[one, alive:] = log_fitness[one, alive - 1] if alive else 0.0
