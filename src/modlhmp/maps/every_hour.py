"""Maps by hours that speak of the day's locations at every hour: what they are built from, and the form they share.

It is that of a CLiFF-map with one column more, `background`: the weight, at a location, of what is known of people
anywhere (`density.NoMap`), while the components' weights sum to 1 without it. Forecasts do not look at it.
"""

from collections.abc import Iterable
from typing import NamedTuple, Protocol

import numpy as np
import pyarrow as pa

from modlhmp.maps import cliff
from modlhmp.maps.base import hours_mapped
from modlhmp.site import Site
from modlhmp.tracks import Tracks, clock_hours


class Building(Protocol):
    """Which locations there are; of a settings class."""

    @property
    def resolution_m(self) -> float:
        """Distance of neighbouring locations [m]."""

    @property
    def radius_m(self) -> float:
        """A location takes the rows within this distance [m]."""

    @property
    def min_observations(self) -> int:
        """Fewer make no location."""


class Walked(NamedTuple):
    """Rows of those who move, their clock hours [n], and the day's locations [m, 2] with the rows around each."""

    tracks: Tracks
    hours: np.ndarray
    wanted: list[int]  # hours that get a map
    places: np.ndarray
    members: list[np.ndarray]
    observed: dict[int | None, int]  # time steps with people of each hour; None: of the day

    def counts(self, hour: int | None) -> np.ndarray:
        """Rows around each location [m] in an hour; None: in the day."""
        of = self.hours >= 0 if hour is None else self.hours == hour
        return np.array([of[mine].sum() for mine in self.members], np.int64)


def walked(tracks: Tracks, site: Site, building: Building) -> Walked:
    """What such a map is built from: rows with a heading and a speed above 0."""
    hours = clock_hours(tracks.t, site.timezone)
    moving = tracks.moves()
    wanted = [hour for hour in hours_mapped(tracks, site) if (hours[moving] == hour).any()]
    observed: dict[int | None, int] = {None: cliff.steps_observed(tracks.t, site.time_step_s)}
    observed |= {hour: cliff.steps_observed(tracks.t[hours == hour], site.time_step_s) for hour in wanted}
    tracks, hours = tracks.take(moving), hours[moving]
    places, members = cliff.neighbourhoods(
        tracks.x, tracks.y, building.resolution_m, building.radius_m, building.min_observations
    )
    return Walked(tracks, hours, wanted, places, members, observed)


def table(
    of: Walked, building: Building, hour: int | None, mixtures: Iterable[np.ndarray], background: np.ndarray
) -> pa.Table:
    """The map of an hour, None: of the day, from the mixture [J, 6] and the background of each location."""
    counts = of.counts(hour)
    own = [mixture[np.argsort(-mixture[:, 0], kind="stable")] for mixture in mixtures]
    found = cliff.table_of(
        of.places, own, counts, counts / counts.max(initial=1), building.resolution_m, building.radius_m,
        of.observed[hour],
    )  # fmt: skip
    shares = np.repeat(background, [len(one) for one in own])
    return found.append_column("background", pa.array(shares.astype(np.float32)))
