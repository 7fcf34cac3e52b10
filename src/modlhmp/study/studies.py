"""Studies, errors only: one parameter of the roll-out varied (paper Sec. V-B), or the amount of training data."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa

from modlhmp.forecasting import forecast_recording, make_forecaster, seeds_of
from modlhmp.maps import cliff, episodes, exits, snippets
from modlhmp.scoring import score_recording
from modlhmp.storage import write_parquet
from modlhmp.streams import stream_keys
from modlhmp.tracks import usable_tracks


def sample_tracks(recordings, dataset, max_tracks):
    """At most about `max_tracks` usable tracks of all recordings, always the same ones; {name: Tracks}.

    A track is in by a hash of its name and id, so neither the order of files nor the other tracks' lengths matter.
    """
    keys = {
        name: stream_keys(np.unique(tracks.track_id), 1, "study sample", dataset["name"], name)[:, 0]
        for name, tracks in recordings.items()
    }
    usable = sum(len(usable_tracks(tracks, dataset["observed_rows"])) for tracks in recordings.values())
    if usable <= max_tracks:
        return recordings
    everyone = np.sort(np.concatenate(list(keys.values())))
    limit = everyone[max(round(len(everyone) * max_tracks / usable), 1) - 1]
    return {
        name: tracks.take(np.isin(tracks.track_id, np.unique(tracks.track_id)[keys[name] <= limit]))
        for name, tracks in recordings.items()
    }


def vary(parameter, values, method, recordings, dataset, map_path, seeds):
    """Yield (value, errors table as of `score_recording`) for each value of a roll-out's `parameter`.

    `method` is {name, kind, options}; every variant draws the random numbers of the method itself, so the variants
    differ by the parameter alone, and the default's errors are those of the main run.
    """
    for value in values:
        options = {**method["options"], parameter: value}
        forecaster = make_forecaster(method["kind"], options, dataset, map_path)
        yield value, _errors(method, forecaster, recordings, dataset, seeds)


def vary_training(shares, methods, training, recordings, dataset, options, seeds):
    """Yield (share, method name, errors table) for maps of a share of the training tracks, drawn by a hash of the id.

    `methods` are {name, kind, options} of the kinds in `BUILDERS`, `options` the configuration's `maps`. A larger share
    holds all that a smaller one does.
    """
    key = stream_keys(training.track_id, 1, "training share", dataset["name"])[:, 0]
    for share in shares:
        some = training.take(key <= np.uint64(min(share * 2.0**64, 2.0**64 - 2048)))
        with TemporaryDirectory() as folder:
            for kind in {"exits", *(method["kind"] for method in methods)}:
                write_parquet(BUILDERS[kind](some, options, dataset), Path(folder) / f"{kind}.parquet")
            for method in methods:
                path, ways_out = (Path(folder) / f"{kind}.parquet" for kind in (method["kind"], "exits"))
                forecaster = make_forecaster(method["kind"], method["options"], dataset, path, ways_out)
                yield share, method["name"], _errors(method, forecaster, recordings, dataset, seeds)


BUILDERS = {
    "cliff": lambda tracks, options, dataset: cliff.build(tracks, **options["cliff"]),
    "episodes": lambda tracks, options, dataset: episodes.build(tracks, dataset["time_step_s"]),
    "exits": lambda tracks, options, dataset: exits.build(tracks, dataset["time_step_s"], **options["exits"]),
    "snippets": lambda tracks, options, dataset: snippets.build(
        tracks, dataset["time_step_s"], past=dataset["observed_rows"] - 1, **options["snippets"]
    ),
}


def _errors(method, forecaster, recordings, dataset, seeds):
    """Errors of one method on some recordings {name: Tracks}."""
    tables, k = [], method["options"].get("k", 1)
    for name, tracks in recordings.items():
        names = (dataset["name"], method["name"], name)
        drawn = seeds_of(method["kind"], seeds)
        forecasts = forecast_recording(tracks, forecaster, dataset, names, k, drawn, keep=1)
        tables.append(score_recording(tracks, forecasts, name, dataset))
    return pa.concat_tables(tables).unify_dictionaries()
