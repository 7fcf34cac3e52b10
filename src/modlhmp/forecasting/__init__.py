"""Forecasting: methods by kind, and the file form of their forecasts."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from modlhmp import maps
from modlhmp.forecasting.base import Forecast, stream_keys
from modlhmp.forecasting.cvm import constant_velocity
from modlhmp.forecasting.neighbours import find_neighbours, together
from modlhmp.forecasting.observe import current_velocity, observe, usable_tracks
from modlhmp.forecasting.rollout import roll_out
from modlhmp.storage import atomic_path, provenance_metadata, read_metadata


def make_forecaster(kind, options, dataset, map_path):
    """The forecaster of a method: a function (observed, steps, keys) -> Forecast (contract: `forecasting.base`)."""
    step_s, source = dataset["time_step_s"], dataset["velocity"]
    if kind == "cvm":
        return lambda observed, steps, keys: constant_velocity(
            observed, current_velocity(observed, source), steps, step_s
        )
    mod = maps.load_map(kind, map_path, dataset["timezone"], options["sampling_radius_m"])
    return lambda observed, steps, keys: roll_out(
        mod,
        observed,
        current_velocity(observed, source),
        steps,
        keys,
        step_s,
        options["beta"],
        options["speed"],
    )


def forecast_recording(tracks, forecaster, dataset, names, k, seeds, others=None):
    """Forecast every usable track of a recording to the longest horizon, for each seed.

    `names` = (dataset, method, recording) key the random numbers; `others` are the tracks of that day's other
    recordings, if the forecaster looks at neighbours. Yields (seed, track_ids [n], Forecast); a forecaster without
    randomness is run for the first seed only.
    """
    seen, rows = dataset["observed_rows"], usable_tracks(tracks, dataset["observed_rows"])
    observed = observe(tracks, rows, seen)
    if others is not None:
        everyone, at_t0 = together(tracks, others), rows[:, 0] + seen - 1
        found = find_neighbours(everyone, at_t0, seen, dataset["time_step_s"])
        observed = observed._replace(neighbours=found.xy)
    steps = round(dataset["horizon_s"] / dataset["time_step_s"])
    for seed in seeds:
        forecast = forecaster(observed, steps, stream_keys(observed.track_id, k, seed, *names))
        yield seed, observed.track_id, forecast
        if forecast.output == "single":
            return


def write_forecasts(path, forecasts, **provenance):
    """Write forecasts as they come, one row a track and seed and one row group a seed."""
    with atomic_path(path) as temporary:
        writer = None
        try:
            for seed, track_ids, forecast in forecasts:
                _, k, steps, _ = forecast.xy.shape
                table = pa.table(
                    {
                        "track_id": track_ids,
                        "seed": np.full(len(track_ids), seed, np.int32),
                        "xy": _lists(forecast.xy, k * steps * 2),
                        "log_fitness": _lists(forecast.log_fitness, k * steps),
                        "steps_alive": _lists(forecast.steps_alive, k),
                    }
                )
                if writer is None:
                    shape = {"output": forecast.output, "k": k, "steps": steps}
                    metadata = provenance_metadata(**provenance, **shape)
                    writer = pq.ParquetWriter(temporary, table.schema.with_metadata(metadata), compression="zstd")
                writer.write_table(table, row_group_size=max(len(track_ids), 1))
        finally:
            if writer is not None:
                writer.close()


def read_forecasts(path):
    """Yield (seed, track_ids, Forecast) of a forecasts file, one seed at a time."""
    shape = read_metadata(path)
    k, steps = shape["k"], shape["steps"]
    file = pq.ParquetFile(path)
    for group in range(file.num_row_groups):
        table = file.read_row_group(group)
        n = table.num_rows
        if not n:
            continue
        xy, fitness, alive = (_flat(table[name]) for name in ("xy", "log_fitness", "steps_alive"))
        forecast = Forecast(
            xy.reshape(n, k, steps, 2), fitness.reshape(n, k, steps), alive.reshape(n, k), shape["output"]
        )
        yield table["seed"][0].as_py(), table["track_id"].to_numpy(), forecast


def _lists(array, size):
    return pa.FixedSizeListArray.from_arrays(pa.array(array.ravel()), size)


def _flat(column):
    return column.combine_chunks().flatten().to_numpy()
