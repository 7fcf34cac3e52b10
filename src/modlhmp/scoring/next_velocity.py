"""How likely a forecast makes the walker's next velocity, given the last one: a kernel density of its samples.

A roll-out's first step is constant velocity by Eq. 1 of the paper, whatever the map says; the second follows what was
sampled. So the velocity is that of the second time step, by differences of positions, for every method alike. Samples
of any kind (velocities from a map through the roll-out's kernel, snippets, episodes, a network's futures, or one path)
become a density by the same kernel: normal and wrapped in heading, normal in speed and of speeds of 0 and more.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from modlhmp.angles import TWO_PI, circular_difference
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.windows import in_order, windows
from modlhmp.scenes import Scenes
from modlhmp.scoring.errors import truth_of
from modlhmp.site import Site
from modlhmp.tracks import Tracks

STEP = 2  # the time step whose velocity is scored
HEADING_RAD, SPEED_M_S = (0.05, 0.1, 0.2, 0.35, 0.6), (0.05, 0.1, 0.2, 0.35)  # kernels' standard deviations tried
KERNELS = tuple((heading, speed) for heading in HEADING_RAD for speed in SPEED_M_S)
WINDINGS = 1  # a kernel of 0.6 rad has e^-13 of its peak a turn and a half away


class Scored(NamedTuple):
    """What became of n forecasts: `track_id`, true `heading` [rad] and `speed` [m/s], `log_p` [n, kernels] in nats.

    `log_p` is NaN for a forecast of which no sample is alive.
    """

    track_id: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    log_p: np.ndarray


def score_next(
    tracks: Tracks,
    forecasts: Iterable[tuple[int, np.ndarray, Forecast]],
    recording: str,
    site: Site,
    scenes: Scenes | None = None,
) -> Scored:
    """Score the forecasts of one seed, `(seed, track_ids, Forecast)` in blocks, of those who walk in the second step.

    Forecasts of tracks that end before it, or of those who stand, are left out.
    """
    wanted = windows(tracks, site, scenes)
    truth, length = truth_of(tracks, wanted, site)
    steps = (truth[:, STEP - 1] - truth[:, STEP - 2]) / site.time_step_s
    speed, heading = np.hypot(*steps.T), np.arctan2(steps[:, 1], steps[:, 0])
    counted, log_p = (length >= STEP) & (speed > 0), np.full((len(speed), len(KERNELS)), np.nan)
    for _, of, forecast in in_order(forecasts, wanted, recording):
        walks, samples = counted[of], forecast.samples
        mine, xy = of[walks], samples.xy[walks, :, :STEP].astype(float)
        moved = (xy[:, :, STEP - 1] - xy[:, :, STEP - 2]) / site.time_step_s
        moved[samples.steps_alive[walks] < STEP] = np.nan
        log_p[mine] = kernel_density(moved, heading[mine], speed[mine])
    return Scored(wanted.track_id[counted], heading[counted], speed[counted], log_p[counted])


def kernel_density(samples: np.ndarray, heading: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Log density [n, kernels] of velocities, per rad and m/s, under samples [n, m, 2] in m/s (NaN: none)."""
    from scipy.special import log_ndtr  # noqa: PLC0415 - 0.1 s that other scores do not need

    alive = np.isfinite(samples[..., 0])
    east, north = np.where(alive[..., None], samples, 1.0).transpose(2, 0, 1)
    of_samples = np.hypot(east, north)
    turn, up = circular_difference(heading[:, None], np.arctan2(north, east)), speed[:, None] - of_samples
    # A kernel is a product: what is of the heading alone, and of the speed alone, is the same for several.
    around = {sd: np.where(alive, _wrapped(turn, sd), -np.inf) for sd in HEADING_RAD}
    # A kernel's share of speeds above 0 makes up for the rest.
    along = {sd: -0.5 * (up / sd) ** 2 - log_ndtr(of_samples / sd) - np.log(sd) for sd in SPEED_M_S}
    number = alive.sum(axis=1)
    found = np.empty((len(heading), len(KERNELS)))
    with np.errstate(divide="ignore"):
        for column, (sd_heading, sd_speed) in enumerate(KERNELS):
            terms = around[sd_heading] + along[sd_speed]
            peak = terms.max(axis=1, initial=-1e300)  # scipy's logsumexp does the same in three times the time
            found[:, column] = peak + np.log(np.exp(terms - peak[:, None]).sum(axis=1) / np.maximum(number, 1))
    found[number == 0] = np.nan
    return found - np.log(TWO_PI)


def _wrapped(turn, sd):
    """Log of a normal density's sum over the turns of the circle, but for 1 / sqrt(2 pi)."""
    once, *more = (-0.5 * ((turn + TWO_PI * k) / sd) ** 2 for k in range(-WINDINGS, WINDINGS + 1))
    for one in more:
        once = np.logaddexp(once, one)
    return once - np.log(sd)
