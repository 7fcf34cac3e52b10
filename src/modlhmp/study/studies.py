"""Studies, errors only: one parameter of the roll-out varied (paper Sec. V-B), or the amount of training data."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.forecasting.base import Forecaster
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.forecasting.windows import usable
from modlhmp.methods import Method, build_map, make_forecaster
from modlhmp.scenes import Scenes
from modlhmp.scoring.recording import score_recording
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.streams import stream_keys
from modlhmp.tracks import Tracks

NONE: Mapping[str, Scenes | None] = {}


def sample_tracks(recordings: Mapping[str, Tracks], dataset: str, site: Site, max_tracks: int) -> Mapping[str, Tracks]:
    """At most about `max_tracks` usable tracks of all recordings, always the same ones; {name: Tracks}.

    A track is in by a hash of its name and id, so neither the order of files nor the other tracks' lengths matter.
    """
    keys = {
        name: stream_keys(np.unique(tracks.track_id), 1, "study sample", dataset, name)[:, 0]
        for name, tracks in recordings.items()
    }
    number = sum(len(usable(tracks, site)) for tracks in recordings.values())
    if number <= max_tracks:
        return recordings
    everyone = np.sort(np.concatenate(list(keys.values())))
    limit = everyone[max(round(len(everyone) * max_tracks / number), 1) - 1]
    return {
        name: tracks.take(np.isin(tracks.track_id, np.unique(tracks.track_id)[keys[name] <= limit]))
        for name, tracks in recordings.items()
    }


def vary(
    parameter: str,
    values: Sequence[float],
    method: Method,
    recordings: Mapping[str, Tracks],
    dataset: str,
    site: Site,
    map_path: str | Path,
    seeds: Sequence[int],
    scenes: Mapping[str, Scenes | None] = NONE,
    exits: str | Path | None = None,
) -> Iterator[tuple[float, pa.Table]]:
    """Yield (value, errors table as of `score_recording`) for each value of a roll-out's `parameter`.

    Every variant draws the random numbers of the method itself, so the variants differ by the parameter alone, and the
    default's errors are those of the main run. `scenes` are those of recordings that have some, `exits` leads to the
    ways out of a method that uses them.
    """
    for value in values:
        options = dataclasses.replace(method.options, **{parameter: value})
        forecaster = make_forecaster(method.kind, options, site, map_path, exits)
        yield value, _errors(method, forecaster, recordings, dataset, site, seeds, scenes)


def vary_training(
    shares: Sequence[float],
    methods: Sequence[Method],
    training: Tracks,
    recordings: Mapping[str, Tracks],
    dataset: str,
    site: Site,
    buildings: Mapping[str, Any],
    seeds: Mapping[str, Sequence[int]],
    scenes: Mapping[str, Scenes | None] = NONE,
) -> Iterator[tuple[float, str, pa.Table]]:
    """Yield (share, method name, errors table) for maps of a share of the training tracks, drawn by a hash of the id.

    `methods` are of kinds that can be built `from_share`, `buildings` their building options by kind, and those of the
    ways out. A larger share holds all that a smaller one does. `scenes` as of `vary`.
    """
    key = stream_keys(training.track_id, 1, "training share", dataset)[:, 0]
    for share in shares:
        some = training.take(key <= np.uint64(min(share * 2.0**64, 2.0**64 - 2048)))
        with TemporaryDirectory() as folder:
            files = {kind: Path(folder) / f"{kind}.parquet" for kind in buildings}
            for kind, file in files.items():
                write_parquet(build_map(kind, some, site, buildings[kind])[0], file)
            for method in methods:
                forecaster = make_forecaster(method.kind, method.options, site, files[method.kind], files["exits"])
                errors = _errors(method, forecaster, recordings, dataset, site, seeds[method.name], scenes)
                yield share, method.name, errors


def _errors(
    method: Method,
    forecaster: Forecaster,
    recordings: Mapping[str, Tracks],
    dataset: str,
    site: Site,
    seeds: Sequence[int],
    scenes: Mapping[str, Scenes | None],
) -> pa.Table:
    """Errors of one method on some recordings {name: Tracks}."""
    tables = []
    for name, tracks in recordings.items():
        names = (dataset, method.name, name)
        own = scenes.get(name)
        forecasts = forecast_recording(tracks, forecaster, site, names, method.futures, seeds, scenes=own)
        tables.append(score_recording(tracks, forecasts, name, site, scenes=own))
    return pa.concat_tables(tables).unify_dictionaries()
