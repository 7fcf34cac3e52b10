"""Forecasts of every usable track of a recording, a few tracks at a time."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.neighbours import find_neighbours
from modlhmp.forecasting.observe import Observed, observe
from modlhmp.forecasting.outputs import kept
from modlhmp.logs import progress
from modlhmp.site import Site
from modlhmp.streams import stream_keys
from modlhmp.tracks import Tracks, together, usable_tracks

TRACKS_AT_ONCE = 250  # whose futures are in memory together; a forecast does not depend on who else is forecast


def forecast_recording(
    tracks: Tracks,
    forecaster: Forecaster,
    site: Site,
    names: tuple[str, ...],
    k: int,
    seeds: Sequence[int],
    others: Iterable[Tracks] | None = None,
    keep: int | None = None,
) -> Iterator[tuple[int, np.ndarray, Forecast]]:
    """Forecast every usable track of a recording to the longest horizon, for each seed.

    `names` = (dataset, method, recording) key the random numbers; `others` are the tracks of that day's other
    recordings, if the forecaster looks at neighbours. Yields (seed, track_ids [m], Forecast) of a few tracks after the
    other, at least once per seed. With `keep` they have at most so many samples beside their result (`outputs.kept`).
    """
    seen, rows = site.observed_rows, usable_tracks(tracks, site.observed_rows)
    observed = observe(tracks, rows, seen)
    if others is not None:
        everyone, at_t0 = together([tracks, *others]), rows[:, 0] + seen - 1
        found = find_neighbours(everyone, at_t0, seen, site.time_step_s)
        observed = observed._replace(neighbours=found.xy)
    steps, n = site.steps, len(rows)
    with progress(total=n * len(seeds), desc="forecasts", unit=" tracks") as bar:
        for seed in seeds:
            for first in range(0, max(n, 1), TRACKS_AT_ONCE):
                some = Observed(*(values[first : first + TRACKS_AT_ONCE] for values in observed))
                forecast = forecaster(some, steps, stream_keys(some.track_id, k, seed, *names))
                yield seed, some.track_id, forecast if keep is None else kept(forecast, keep)
                bar.update(len(some.track_id))
