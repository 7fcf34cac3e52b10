"""Forecasting: methods by kind, and the file form of their forecasts."""

import itertools

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from modlhmp import maps
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.chain import chain
from modlhmp.forecasting.cvm import constant_velocity
from modlhmp.forecasting.median import with_median
from modlhmp.forecasting.neighbours import find_neighbours
from modlhmp.forecasting.observe import Observed, current_velocity, observe, observed_steps, polar
from modlhmp.forecasting.replay import replay
from modlhmp.forecasting.rollout import roll_out
from modlhmp.logs import progress
from modlhmp.maps.episodes import EpisodeMap
from modlhmp.maps.exits import WithExits
from modlhmp.maps.pieces import Metric, vector_mean
from modlhmp.maps.snippets import SnippetMap
from modlhmp.storage import column, read_metadata, write_parquet, write_pieces
from modlhmp.streams import stream_keys
from modlhmp.tracks import together, usable_tracks

STORED = 20  # of the samples behind a median; all of them would be gigabytes
TRACKS_AT_ONCE = 250  # whose futures are in memory together; a forecast does not depend on who else is forecast
UNSEEDED = ("cvm", "episodes")  # kinds that draw no random numbers


def seeds_of(kind, seeds):
    """Those of the seeds with which a kind of method is run: one without randomness needs the first only."""
    return seeds[:1] if kind in UNSEEDED else seeds


def make_forecaster(kind, options, dataset, map_path=None, exits_path=None):
    """The forecaster of a method: a function (observed, steps, keys) -> Forecast (contract: `forecasting.base`)."""
    if kind == "cvm":
        return lambda observed, steps, keys: constant_velocity(
            observed, velocity_at_t0(observed, options, dataset), steps, dataset["time_step_s"]
        )
    if kind in maps.FOLLOWED:
        return _follower(kind, options, dataset, map_path)
    mod = maps.load_map(kind, map_path, dataset["timezone"], options["sampling_radius_m"])
    return roll_out_forecaster(WithExits.load(mod, exits_path) if options["exits"] else mod, options, dataset)


def roll_out_forecaster(mod, options, dataset):
    """The forecaster of a map that is sampled at every step; its result is ranked, or the futures' median."""

    def forecast(observed, steps, keys):
        velocity = velocity_at_t0(observed, options, dataset)
        futures = roll_out(
            mod, observed, velocity, steps, keys, dataset["time_step_s"], options["beta"], options["speed"]
        )
        return with_median(futures) if options["output"] == "geometric_median" else futures

    return forecast


def velocity_at_t0(observed, options, dataset):
    """Speed [n] and heading [n]: the paper's mean of the dataset's velocities, or the vector mean of differences."""
    if options["velocity"] == "differences":
        return polar(vector_mean(observed_steps(observed), dataset["difference_weights"]))
    return current_velocity(observed, dataset["velocity"])


def _follower(kind, options, dataset, map_path):
    """The forecaster of a map with memory."""
    metric = Metric(*(options[name] for name in Metric._fields))
    weights, past = dataset["difference_weights"], dataset["observed_rows"] - 1
    if kind == "episodes":
        mod = EpisodeMap.load(map_path, metric, weights, past, dataset["time_step_s"], dataset["timezone"])
        rest = (options["k"], options["pace"], options["reach_m"], options["exclude_s"])
        return lambda observed, steps, keys: replay(mod, observed, steps, dataset["time_step_s"], *rest)
    mod = SnippetMap.load(map_path, metric, weights, options["length_s"], options["most"], dataset["timezone"])
    rest = (options["kernel_m"], options["pace"], options["exits"], options["exclude_s"])
    return lambda observed, steps, keys: chain(mod, observed, steps, keys, *rest)


def forecast_recording(tracks, forecaster, dataset, names, k, seeds, others=None, keep=None):
    """Forecast every usable track of a recording to the longest horizon, for each seed.

    `names` = (dataset, method, recording) key the random numbers; `others` are the tracks of that day's other
    recordings, if the forecaster looks at neighbours. Yields (seed, track_ids [m], Forecast) of a few tracks after the
    other, at least once a seed; a forecaster without randomness is run for the first seed only. Of a median's futures
    the first `keep` are given, by default all.
    """
    seen, rows = dataset["observed_rows"], usable_tracks(tracks, dataset["observed_rows"])
    observed = observe(tracks, rows, seen)
    if others is not None:
        everyone, at_t0 = together([tracks, *others]), rows[:, 0] + seen - 1
        found = find_neighbours(everyone, at_t0, seen, dataset["time_step_s"])
        observed = observed._replace(neighbours=found.xy)
    steps, n = round(dataset["horizon_s"] / dataset["time_step_s"]), len(rows)
    with progress(total=n * len(seeds), desc="forecasts", unit=" tracks") as bar:
        for seed in seeds:
            for first in range(0, max(n, 1), TRACKS_AT_ONCE):
                some = Observed(*(values[first : first + TRACKS_AT_ONCE] for values in observed))
                forecast = forecaster(some, steps, stream_keys(some.track_id, k, seed, *names))
                yield seed, some.track_id, forecast.first(keep) if forecast.output == "median" else forecast
                bar.update(len(some.track_id))
            if forecast.output == "single":
                return


def average_forecasts(members):
    """The mean path of several methods' forecasts, each as of `read_forecasts`; yields the same, of one future.

    A seed is averaged with the others' forecasts of that seed, or of their only one. Methods whose path has ended do
    not count from then on; the mean is held once all have.
    """
    by_seed = [_first_futures(member) for member in members]
    for seed in max(by_seed, key=len, default={}):
        chosen = [member.get(seed) or next(iter(member.values())) for member in by_seed]
        ids = chosen[0][0]
        if not all(np.array_equal(ids, other) for other, *_ in chosen):
            raise ValueError("the forecasts to be averaged are of different tracks; remake them")
        xy, alive = (np.stack(parts) for parts in zip(*(own for _, *own in chosen), strict=True))
        life, step = alive.max(axis=0), np.arange(xy.shape[2])
        # Where no member knows more than constant velocity, that is averaged.
        counts = (alive[..., None] > step) | (life == 0)[:, None]
        mean = (xy * counts[..., None]).sum(axis=0) / np.maximum(counts.sum(axis=0), 1)[..., None]
        held = np.minimum(step, np.where(life > 0, life - 1, len(step) - 1)[:, None])
        mean = np.take_along_axis(mean, held[..., None], axis=1).astype(np.float32)
        no_fitness = np.zeros((len(ids), 1, len(step)), np.float32)
        yield seed, ids, Forecast(mean[:, None], no_fitness, life[:, None].astype(np.int32), "single")


def _first_futures(forecasts):
    """{seed: (track_ids [n], xy [n, T, 2], steps alive [n])} of the first futures of all blocks."""
    blocks = {}
    for seed, ids, forecast in forecasts:
        blocks.setdefault(seed, []).append((ids, forecast.xy[:, 0].copy(), forecast.steps_alive[:, 0]))
    return {seed: tuple(map(np.concatenate, zip(*some, strict=True))) for seed, some in blocks.items()}


def write_forecasts(path, forecasts, **provenance):
    """Write forecasts as they come, one row a track and seed and one row group a block."""
    forecasts = iter(forecasts)
    first = next(forecasts, None)
    if first is None:  # the average of files without a row
        write_parquet({"track_id": np.empty(0, np.int64)}, path, **provenance, output="single", k=1, steps=0)
        return
    _, k, steps, _ = first[2].xy.shape
    tables = (_table(*block) for block in itertools.chain([first], forecasts))
    write_pieces(tables, path, **provenance, output=first[2].output, k=k, steps=steps)


def _table(seed, track_ids, forecast):
    """A block of forecasts as a table."""
    columns = {"track_id": track_ids, "seed": np.full(len(track_ids), seed, np.int32)}
    for name in ("xy", "log_fitness", "steps_alive"):
        values = getattr(forecast, name)
        columns[name] = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), int(np.prod(values.shape[1:])))
    return pa.table(columns)


def read_forecasts(path):
    """Yield (seed, track_ids [m], Forecast) of a forecasts file, in the blocks in which it was written."""
    shape = read_metadata(path)
    k, steps = shape["k"], shape["steps"]
    file = pq.ParquetFile(path)
    for group in range(file.num_row_groups):
        table = file.read_row_group(group)
        n = table.num_rows
        if not n:
            continue
        xy, fitness, alive = (column(table, name) for name in ("xy", "log_fitness", "steps_alive"))
        forecast = Forecast(
            xy.reshape(n, k, steps, 2), fitness.reshape(n, k, steps), alive.reshape(n, k), shape["output"]
        )
        yield table["seed"][0].as_py(), column(table, "track_id"), forecast
