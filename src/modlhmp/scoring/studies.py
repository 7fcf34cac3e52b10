"""Parameter studies (paper Sec. V-B): the same forecasts with one parameter of the roll-out varied, errors only."""

import numpy as np
import pyarrow as pa

from modlhmp.forecasting import forecast_recording, make_forecaster
from modlhmp.forecasting.base import stream_keys
from modlhmp.forecasting.observe import usable_tracks
from modlhmp.scoring import score_recording


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
        tables = []
        for name, tracks in recordings.items():
            names = (dataset["name"], method["name"], name)
            forecasts = forecast_recording(tracks, forecaster, dataset, names, options["k"], seeds)
            tables.append(score_recording(tracks, forecasts, name, dataset))
        yield value, pa.concat_tables(tables).unify_dictionaries()
