"""What a forecaster may see: the first rows of a track, and the walker's current velocity.

Paper Sec. III-A: a mean of the last velocities with Gaussian weights of sigma = 1.5 steps, as in the
ATLAS benchmark (A. Rudenko et al., 2022); the weights are normalised to sum 1.
"""

from typing import NamedTuple

import numpy as np

from modlhmp.maps.pieces import vector_mean
from modlhmp.site import Site
from modlhmp.tracks import Tracks, positions_at

SIGMA_STEPS = 1.5


class Observed(NamedTuple):
    """Observed rows of n tracks, the last one at t0: [n, rows] each, `track_id` [n]; speeds may be NaN.

    `neighbours` [n, M, rows, 2] are the positions of M others at t0 and whole time steps before it, nearest first, NaN
    where absent; M is 0 where nobody asked for them (`forecasting.neighbours`).
    """

    track_id: np.ndarray
    t: np.ndarray
    x: np.ndarray
    y: np.ndarray
    speed: np.ndarray
    heading: np.ndarray
    neighbours: np.ndarray


def observe(tracks: Tracks, rows: np.ndarray, observed_rows: int = 4) -> Observed:
    """The first `observed_rows` rows of the tracks whose first rows are `rows[:, 0]`, without neighbours."""
    seen = rows[:, :1] + np.arange(observed_rows)
    nobody = np.empty((len(rows), 0, observed_rows, 2))
    return Observed(tracks.track_id[rows[:, 0]], *(column[seen] for column in tracks[1:]), nobody)  # type: ignore[call-arg]


def at_whole_steps(observed: Observed, step_s: float) -> np.ndarray:
    """Positions [n, rows, 2] at t0 and whole time steps before it, from what is observed."""
    n, seen = observed.t.shape
    rows = np.arange(n)[:, None] * seen + [0, seen - 1]
    flat = Tracks(np.repeat(observed.track_id, seen), *(column.ravel() for column in observed[1:6]))
    when = (observed.t[:, -1:] - observed.t[:, :1]) - step_s * np.arange(seen - 1, -1, -1)
    return positions_at(flat, rows, when)


def observation_weights(steps: int) -> np.ndarray:
    """g(1), g(2), ... of the paper for the newest to the oldest of `steps` velocities, summing to 1."""
    # Sec. III-A: g(t), whose factor 1 / (sigma sqrt(2 pi)) the normalisation takes out.
    g = np.exp(-0.5 * (np.arange(1, steps + 1) / SIGMA_STEPS) ** 2)
    return g / g.sum()


def current_velocity(observed: Observed, source: str) -> tuple[np.ndarray, np.ndarray]:
    """Speed [n] in m/s and heading [n] in rad at t0: weighted mean of speeds, circular mean of headings.

    `source` = "as_recorded": the file's velocities of the rows before t0 (t0's own is not used);
    "differences": the differences of positions that end at t0, t0 - 1, ...
    """
    if source == "as_recorded":
        speed, heading = observed.speed[:, -2::-1], observed.heading[:, -2::-1]
    else:
        # Contiguous, since numpy's arctan2 has another last bit for strided rows on some processors.
        backward = (np.diff(column, axis=1)[:, ::-1] for column in (observed.x, observed.y, observed.t))
        dx, dy, dt = map(np.ascontiguousarray, backward)
        speed, heading = np.hypot(dx, dy) / dt, np.arctan2(dy, dx)
    # Sec. III-A: rho_obs and theta_obs, the latter as a mean of directions instead of angles.
    weights = observation_weights(speed.shape[1])
    # Sums by row, not a matrix product: that one's last bit depends on how many tracks there are. Who stands has no
    # heading, and a row may lack its velocity: the others count.
    sine, cosine = ((weights * np.nan_to_num(part(heading))).sum(axis=1) for part in (np.sin, np.cos))
    known = np.isfinite(speed)
    mean = (weights * np.nan_to_num(speed)).sum(axis=1)
    if not known.all():
        mean = mean / np.maximum((weights * known).sum(axis=1), np.finfo(float).tiny)
    return mean, np.arctan2(sine, cosine)


def velocity_at_t0(observed: Observed, velocity: str, site: Site) -> tuple[np.ndarray, np.ndarray]:
    """Speed [n] in m/s and heading [n] in rad at t0, by a method's option `velocity`.

    `dataset`: the paper's mean of the velocities that the site says; `differences`: the vector mean of the last steps.
    """
    if velocity == "differences":
        return polar(vector_mean(observed_steps(observed), site.difference_weights))
    return current_velocity(observed, site.velocity)


def observed_steps(observed: Observed) -> np.ndarray:
    """Velocities [n, rows - 1, 2] in m/s between the observed positions, newest first."""
    dx, dy, dt = ((now[:, 1:] - now[:, :-1])[:, ::-1] for now in (observed.x, observed.y, observed.t))
    return np.stack([dx / dt, dy / dt], axis=-1)


def polar(velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Speed [n] in m/s and heading [n] in rad of velocities [n, 2]."""
    x, y = (np.ascontiguousarray(part) for part in velocity.T)  # see current_velocity
    return np.hypot(x, y), np.arctan2(y, x)
