"""Smoothed CLiFF-map: time-conditioned, but an hour says only as much of its own as its rows support.

A location has the components of the whole day's CLiFF-map at every hour. What is an hour's own are their weights, which
are drawn to the day's as if some rows of the day had been seen in that hour; where nobody came, they are the day's. A
background, of what is known of people anywhere, takes part and has a weight as well. The tables have the form of
`maps.every_hour`.
"""

from pathlib import Path

import numpy as np
import pyarrow as pa

from modlhmp.kernels import kernel
from modlhmp.logs import progress
from modlhmp.maps import cliff, every_hour, swgmm
from modlhmp.maps.density import NoMap
from modlhmp.options import RollOut, SmoothedBuilding
from modlhmp.site import Site
from modlhmp.tracks import Tracks

BACKGROUND, BACKGROUND_ROWS = 0.02, 5.0  # its usual weight, and how many rows say so beside those of a location
ITERATIONS = 30  # of the weights; they have settled long before


def build_hours(
    tracks: Tracks, site: Site, building: SmoothedBuilding | None = None
) -> tuple[pa.Table | None, dict[int, pa.Table]]:
    """(the map of the whole day, {hour with data: its map}), in the form of CLiFF-maps with a column `background`."""
    building = building or SmoothedBuilding()
    of = every_hour.walked(tracks, site, building)
    heading, speed = of.tracks.heading, of.tracks.speed
    elsewhere = np.exp(NoMap(speed).log_density(of.tracks.x, of.tracks.y, of.tracks.t, heading, speed))
    mixtures: list[np.ndarray] = []
    weights: dict[int | None, list[np.ndarray]] = {hour: [] for hour in (None, *of.wanted)}
    for mine in progress(of.members, desc="Smoothed CLiFF-map", unit=" locations"):
        one = cliff.fit_location(heading[mine], speed[mine], building.bandwidth)
        p = densities(heading[mine], speed[mine], elsewhere[mine], one)
        usual = np.append((1 - BACKGROUND) * one[:, 0], BACKGROUND)
        day = reweighted(p, usual, BACKGROUND_ROWS)
        mixtures.append(one)
        weights[None].append(day)
        for hour in of.wanted:
            weights[hour].append(reweighted(p[of.hours[mine] == hour], day, building.day_rows))
    hours = {hour: _table(of, building, hour, mixtures, weights[hour]) for hour in of.wanted}
    return _table(of, building, None, mixtures, weights[None]), hours


def densities(heading: np.ndarray, speed: np.ndarray, elsewhere: np.ndarray, components: np.ndarray) -> np.ndarray:
    """Density of velocities [n] under each component, then what it is anywhere: [n, J + 1]."""
    alone = [swgmm.log_density(heading, speed, np.array([[1.0, *one[1:]]])) for one in components]
    return np.column_stack([*np.exp(alone), elsewhere])


@kernel
def reweighted(p, prior, rows):
    """The likeliest weights [m] of components with densities `p` [n, m], as if `rows` more had said `prior` [m]."""
    weights = prior.copy()
    for _ in range(ITERATIONS):
        total = rows * prior
        for i in range(len(p)):
            share = weights * p[i]
            total += share / max(share.sum(), 1e-300)
        weights = total / (len(p) + rows)
    return weights


def _table(of, building, hour, mixtures, weights):
    """The table of an hour, from the components of each location and their weights, the background's last."""
    own = [
        np.column_stack([found[:-1] / found[:-1].sum(), one[:, 1:]])
        for one, found in zip(mixtures, weights, strict=True)
    ]
    return every_hour.table(of, building, hour, own, np.array([found[-1] for found in weights]))


def load(path: str | Path | pa.Table, site: Site, options: RollOut) -> cliff.CliffMap:
    """Read an hour's map, which has the form of a CLiFF-map."""
    return cliff.load(path, site, options)


load_whole = load  # as has that of the whole day
