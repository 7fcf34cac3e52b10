"""Forecasts of every usable track of a recording, a few at a time."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.neighbours import find_neighbours
from modlhmp.forecasting.observe import Observed, observe
from modlhmp.forecasting.outputs import kept
from modlhmp.forecasting.windows import windows
from modlhmp.logs import progress
from modlhmp.scenes import Scenes
from modlhmp.site import Site
from modlhmp.streams import stream_keys
from modlhmp.tracks import Tracks, together

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
    scenes: Scenes | None = None,
) -> Iterator[tuple[int, np.ndarray, Forecast]]:
    """Forecast every usable track of a recording to the longest horizon, for each seed: its `windows`, by its `scenes`.

    `names` = (dataset, method, recording) key the random numbers; `others` are the tracks of that day's other
    recordings, if the forecaster looks at neighbours. Yields (seed, track_ids [m], Forecast) of a few tracks after the
    other, at least once per seed. With `keep` they have at most so many samples beside their result (`outputs.kept`).
    """
    seen, wanted = site.observed_rows, windows(tracks, site, scenes)
    observed = observe(tracks, wanted.row[:, None] - seen + 1, seen)
    if others is not None:
        found = find_neighbours(together([tracks, *others]), wanted.row, seen, site.time_step_s)
        observed = observed._replace(neighbours=found.xy)
    steps, n = site.steps, len(wanted.t0)
    with progress(total=n * len(seeds), desc="forecasts", unit=" tracks") as bar:
        for seed in seeds:
            for first in range(0, max(n, 1), TRACKS_AT_ONCE):
                these = slice(first, first + TRACKS_AT_ONCE)
                some = Observed(*(values[these] for values in observed))
                keys = stream_keys(some.track_id, k, seed, *names, later_s=wanted.later_s[these])
                forecast = forecaster(some, steps, keys)
                yield seed, some.track_id, forecast if keep is None else kept(forecast, keep)
                bar.update(len(some.track_id))
