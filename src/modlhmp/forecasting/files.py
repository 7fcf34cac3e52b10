"""The file form of forecasts: one row per forecast and seed, in the blocks in which they are made."""

import itertools
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.forecasting.base import Forecast
from modlhmp.storage import (
    DataError,
    column,
    open_parquet,
    read_metadata,
    read_parquet,
    read_pieces,
    write_parquet,
    write_pieces,
)
from modlhmp.tracks import with_owners

STORED = 20  # of the samples behind a median, a medoid or modes; all of them would be gigabytes


def write_forecasts(
    path: str | Path,
    forecasts: Iterable[tuple[int, np.ndarray, Forecast]],
    t0: np.ndarray | None = None,
    owners: Mapping[int, str] | None = None,
    **provenance: Any,
) -> None:
    """Write forecasts as they come, one row per track and seed, one row group per block.

    Where a track is forecast several times, `t0` [n] in unix s, those of each seed's forecasts, tell them apart. The
    owner's ids of tracks (`tracks.owner_ids`) are written beside ours where there are some.
    """
    forecasts = iter(forecasts)
    first = next(forecasts, None)
    if first is None:  # the average of files without a row
        write_parquet({"track_id": np.empty(0, np.int64)}, path, **provenance, output="single", k=1, steps=0)
        return
    _, k, steps, _ = first[2].xy.shape
    tables = (with_owners(one, owners or None) for one in _tables(itertools.chain([first], forecasts), t0))
    write_pieces(tables, path, **provenance, output=first[2].output, k=k, steps=steps)


def _tables(forecasts, t0):
    """Every block of forecasts as a table."""
    done: dict[int, int] = {}
    for seed, track_ids, forecast in forecasts:
        begin, n = done.get(seed, 0), len(track_ids)
        done[seed] = begin + n
        columns = {"track_id": track_ids, **({} if t0 is None else {"t0": t0[begin : begin + n]})}
        columns["seed"] = np.full(n, seed, np.int32)
        for name in ("xy", "log_fitness", "steps_alive"):
            values = getattr(forecast, name)
            columns[name] = pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), int(np.prod(values.shape[1:])))
        yield pa.table(columns)


def read_owners(path: str | Path) -> dict[int, str]:
    """The owner's ids that a forecasts file gives beside the track ids; empty where these are the owner's."""
    if "owner_id" not in open_parquet(path).schema_arrow.names:
        return {}
    table = read_parquet(path, ["track_id", "owner_id"])
    return dict(zip(column(table, "track_id").tolist(), table["owner_id"].to_pylist(), strict=True))


def read_t0(path: str | Path) -> np.ndarray | None:
    """The t0 [n] in unix s of the forecasts of one seed of a file; None where every track is forecast once."""
    if "t0" not in open_parquet(path).schema_arrow.names:
        return None
    table = read_parquet(path, ["seed", "t0"])
    seed = column(table, "seed")
    return column(table, "t0")[seed == seed[:1]]


def read_forecasts(path: str | Path) -> Iterator[tuple[int, np.ndarray, Forecast]]:
    """Yield (seed, track_ids [m], Forecast) of a forecasts file, in the blocks in which it was written."""
    shape = read_metadata(path)
    if not {"k", "steps", "output"} <= shape.keys():
        raise DataError(f"{path}: not a forecasts file of ours (no number of futures and steps); make it again")
    k, steps = shape["k"], shape["steps"]
    for table in read_pieces(path):
        n = table.num_rows
        if not n:
            continue
        xy, fitness, alive = (column(table, name) for name in ("xy", "log_fitness", "steps_alive"))
        forecast = Forecast(
            xy.reshape(n, k, steps, 2), fitness.reshape(n, k, steps), alive.reshape(n, k), shape["output"]
        )
        yield table["seed"][0].as_py(), column(table, "track_id"), forecast


def are_alike(path: str | Path) -> bool:
    """Whether a forecasts file has as many samples of each track, all equally likely; from outside they may not be."""
    return bool(read_metadata(path).get("alike", True))


def check_alike(path: str | Path, method: str, key: str) -> None:
    """Refuse the forecasts of a method whose samples are not alike for what takes them so, at a setting `key`."""
    if not are_alike(path):
        raise DataError(
            f"{method}: its samples differ in number or probability, and scores of distributions take samples that are "
            f"alike: hand in as many of each track, drawn by their probabilities, or leave it out of `{key}` ({path})"
        )


def first_seed(
    forecasts: Iterable[tuple[int, np.ndarray, Forecast]],
) -> Iterator[tuple[int, np.ndarray, Forecast]]:
    """Those of the seed that comes first, which one from outside has numbered in its own way."""
    first = None
    for one in forecasts:
        first = one[0] if first is None else first
        if one[0] == first:
            yield one
