"""People whom a page shows one by one: what was observed, what they did, and what each method forecast."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import MODES, RESULTS, Forecast
from modlhmp.forecasting.files import STORED, are_alike, first_seed, read_forecasts
from modlhmp.forecasting.modes import modes_of
from modlhmp.forecasting.outputs import kept
from modlhmp.forecasting.ranking import longest_lived, most_likely, rank_order
from modlhmp.forecasting.windows import windows
from modlhmp.scenes import read_scenes
from modlhmp.scoring.errors import truth_of
from modlhmp.study.explorer.pack import Digits
from modlhmp.study.layout import Layout
from modlhmp.tracks import clock_time, owner_ids, read_tracks

MOST_PEOPLE = 100  # of a dataset
MOST_FUTURES = 20  # of a method, beside its results
LEAST_SAMPLES = 10  # for modes and a density
PLACE_M = 0.02


def people(layout: Layout, dataset: Dataset, recordings: Sequence[str], methods: Iterable[str]) -> dict[str, Any]:
    """Of at most `MOST_PEOPLE` test tracks, evenly of all: a tree for `pack.packed`.

    Each track's first forecast by the methods' first seed. Paths are held where they end; `lives` says when.
    """
    wanted = {name: _windows(layout, dataset, name) for name in recordings}
    everyone = [(name, row) for name, (_, found, _) in wanted.items() for row in _first_rows(found)]
    chosen = everyone[:: -(-len(everyone) // MOST_PEOPLE) or 1] if everyone else []
    rows = {name: [row for one, row in chosen if one == name] for name in recordings}
    parts = [_persons(dataset, name, wanted[name], rows[name]) for name in recordings if rows[name]]
    if not parts:
        return {"names": [], "of": 0, "methods": {}}
    ids = {name: wanted[name][1].track_id[rows[name]] for name in recordings if rows[name]}
    futures = {
        method: _futures([(layout.forecast(dataset.name, method, name), mine) for name, mine in ids.items()])
        for method in methods
    }
    length = np.concatenate([part["length"] for part in parts])
    truth = np.concatenate([part["truth"] for part in parts])
    observed = np.concatenate([part["observed"] for part in parts])
    return {
        "names": [name for part in parts for name in part["names"]],
        "recordings": [name for part in parts for name in part["recordings"]],
        "of": len(everyone),
        "clock": Digits(np.concatenate([part["clock"] for part in parts]), 1 / 3600),
        "length": length,
        "rows": observed.shape[1],
        "observed": Digits(observed.swapaxes(1, 2), PLACE_M, observed.shape[1]),
        "truth": Digits(truth.swapaxes(1, 2), PLACE_M, truth.shape[1]),
        "methods": {method: tree for method, tree in futures.items() if tree is not None},
    }


def _windows(layout, dataset, recording):
    file = layout.tracks(dataset.name, recording)
    tracks = read_tracks(file)
    return tracks, windows(tracks, dataset, read_scenes(file)), owner_ids(file)


def _first_rows(found):
    """Rows of the first forecast of each track."""
    return sorted(np.unique(found.track_id, return_index=True)[1].tolist())


def _persons(dataset, recording, of_recording, rows):
    """Names, clock [h], observed and true positions [n, T, 2] of some forecasts; the truth is held where it ends."""
    tracks, found, owners = of_recording
    truth, length = (part[rows] for part in truth_of(tracks, found, dataset))
    at_t0 = found.row[rows]
    seen = at_t0[:, None] + np.arange(1 - dataset.observed_rows, 1)
    observed = np.stack([tracks.x[seen], tracks.y[seen]], axis=-1)
    length = np.minimum(length, truth.shape[1])
    path = np.concatenate([observed[:, -1:], truth], axis=1)
    held = np.minimum(np.arange(path.shape[1]), length[:, None])
    names = [owners.get(one, str(one)) for one in found.track_id[rows].tolist()]
    return {
        "names": names,
        "recordings": [recording] * len(names),
        "clock": clock_time(found.t0[rows], dataset.timezone),
        "length": length,
        "observed": observed,
        "truth": np.take_along_axis(path, held[:, :, None], axis=1)[:, 1:],
    }


def _futures(files: Sequence[tuple[str, np.ndarray]]) -> dict[str, Any] | None:
    """One method's forecasts of these tracks of these files, in their order; None where one is missing."""
    parts = [_first_forecasts(file, wanted) for file, wanted in files]
    found = [part for part in parts if part is not None]
    if len(found) < len(parts):
        return None
    output = found[0].output
    xy, log_fitness, lives = (np.concatenate(part) for part in list(zip(*found, strict=True))[:3])
    whole = Forecast(xy, log_fitness, lives, output)
    unequal = _is_choice(whole) or not all(are_alike(file) for file, _ in files)
    forecast = _shown(whole)
    _, k, steps, _ = forecast.xy.shape
    results = forecast.results
    mode, chance = _modes(forecast, unequal)
    return {
        "output": output,
        "results": RESULTS.get(output, 0),
        "unequal": unequal,
        "futures": k,
        "steps": steps,
        "xy": Digits(forecast.xy.swapaxes(2, 3), PLACE_M, steps),
        "lives": forecast.steps_alive,
        "order": rank_order(forecast, steps),
        "best": most_likely(results.log_fitness, longest_lived(results.steps_alive, steps)),
        "modes": mode.shape[1],
        "mode": mode,
        "chance": Digits(chance, 0.001),
    }


def _is_choice(forecast):
    """Whether the futures that are shown were chosen to be results, so that shares of them are no probabilities."""
    k = forecast.xy.shape[1]
    if forecast.output == "medoid":  # a file that holds as many as are stored may have had more
        return k >= STORED
    return forecast.output not in RESULTS and forecast.output != "mean" and k > MOST_FUTURES


def _shown(forecast):
    """The forecast with every future that is its result after any number of steps, and others up to `MOST_FUTURES`."""
    if forecast.output in RESULTS or forecast.output == "mean":  # of which all are
        return kept(forecast, MOST_FUTURES)
    n, k, steps, _ = forecast.xy.shape
    other = np.ones((n, k), bool)
    other[np.arange(n)[:, None], most_likely(forecast.log_fitness, longest_lived(forecast.steps_alive, steps))] = False
    number = max(MOST_FUTURES, int((~other).sum(axis=1).max(initial=0)))
    return forecast.take(np.sort(np.argsort(other, axis=1, kind="stable")[:, :number], axis=1))


def _first_forecasts(file, wanted) -> Forecast | None:
    """The first forecast of each wanted track by the file's first seed; None without the file, or one of them."""
    if not Path(file).exists():
        return None
    found: dict[int, tuple[Forecast, int]] = {}
    for _, track_ids, forecast in first_seed(read_forecasts(file)):
        for row in np.flatnonzero(np.isin(track_ids, wanted)).tolist():
            found.setdefault(int(track_ids[row]), (forecast, row))
    if not set(wanted.tolist()) <= found.keys():
        return None
    rows = [found[one] for one in wanted.tolist()]
    xy, log_fitness, lives = (np.stack([forecast[part][row] for forecast, row in rows]) for part in range(3))
    return Forecast(xy, log_fitness, lives, rows[0][0].output)


def _modes(forecast, unequal):
    """Which futures stand for the modes, and the probability of each, both [n, modes].

    The forecast's own where these are its result; else none of few samples, or of `unequal` ones.
    """
    samples, n = forecast.samples, len(forecast.xy)
    if forecast.output == "modes":
        return np.tile(np.arange(MODES), (n, 1)), np.exp(forecast.results.log_fitness[:, :, -1])
    if unequal or samples.xy.shape[1] < LEAST_SAMPLES:
        return np.empty((n, 0), int), np.empty((n, 0))
    found = modes_of(samples)
    same = (samples.xy[:, None] == found.paths[:, :, None]).all(axis=(3, 4))
    return forecast.xy.shape[1] - samples.xy.shape[1] + same.argmax(axis=2), found.probabilities
