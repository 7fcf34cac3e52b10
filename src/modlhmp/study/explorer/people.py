"""People whom a page shows one by one: what was observed, what they did, and what each method forecast."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import RESULTS, Forecast
from modlhmp.forecasting.files import read_forecasts
from modlhmp.forecasting.modes import modes_of
from modlhmp.forecasting.ranking import longest_lived, most_likely, rank_order
from modlhmp.forecasting.windows import windows
from modlhmp.scenes import read_scenes
from modlhmp.scoring.errors import truth_of
from modlhmp.study.explorer.pack import Digits
from modlhmp.study.layout import Layout
from modlhmp.tracks import clock_time, owner_ids, read_tracks

MOST_PEOPLE = 100  # of a dataset
MOST_FUTURES = 20  # of a method, beside its result
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
    parts = [_persons(dataset, name, *wanted[name], rows[name]) for name in recordings if rows[name]]
    if not parts:
        return {"names": [], "of": 0, "methods": {}}
    ids = {name: wanted[name][1].track_id[rows[name]] for name in recordings if rows[name]}
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
        "methods": {
            method: tree
            for method in methods
            if (tree := _futures({name: layout.forecast(dataset.name, method, name) for name in ids}, ids)) is not None
        },
    }


def _windows(layout, dataset, recording):
    file = layout.tracks(dataset.name, recording)
    tracks = read_tracks(file)
    return tracks, windows(tracks, dataset, read_scenes(file)), owner_ids(file)


def _first_rows(found):
    """Rows of the first forecast of each track."""
    return sorted(np.unique(found.track_id, return_index=True)[1].tolist())


def _persons(dataset, recording, tracks, found, owners, rows):
    """Names, clock [h], observed and true positions [n, T, 2] of some forecasts; the truth is held where it ends."""
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


def _futures(files: Mapping[str, str], ids: Mapping[str, np.ndarray]) -> dict[str, Any] | None:
    """One method's forecasts of the chosen tracks, in their order; None where a file is missing."""
    if not all(Path(file).exists() for file in files.values()):
        return None
    xy, alive, order, best, index, share, output = [], [], [], [], [], [], ""
    for recording, file in files.items():
        for one in _of_tracks(file, ids[recording]):
            output = one.output
            first = RESULTS.get(output, 0)
            kept = one.first(first + MOST_FUTURES)
            path, fitness, lives = (part[0] for part in kept[:3])
            ranked = rank_order(Forecast(path, fitness, lives, output), path.shape[1])
            results = kept.results
            fittest = most_likely(results.log_fitness, longest_lived(results.steps_alive, path.shape[1]))[0]
            for parts, part in zip((xy, alive, order, best), (path, lives, ranked, fittest), strict=True):
                parts.append(part)
            which, chance = _modes(kept)
            index.append(first + which)
            share.append(chance)
    if not xy:
        return None
    steps, several = xy[0].shape[1], len(index[0]) > 0
    return {
        "output": output,
        "results": RESULTS.get(output, 0),
        "futures": len(xy[0]),
        "steps": steps,
        "xy": Digits(np.stack(xy).swapaxes(2, 3), PLACE_M, steps),
        "lives": np.stack(alive),
        "order": np.stack(order),
        "best": np.stack(best),
        "modes": len(index[0]) if several else 0,
        "mode": np.stack(index) if several else np.empty(0, int),
        "chance": Digits(np.stack(share), 0.001) if several else np.empty(0, int),
    }


def _of_tracks(file, wanted):
    """The first forecast of each wanted track by the file's first seed, each a `Forecast` of one track."""
    found: dict[int, Forecast] = {}
    first = None
    for seed, track_ids, forecast in read_forecasts(file):
        first = seed if first is None else first
        if seed != first:
            continue
        for row in np.flatnonzero(np.isin(track_ids, wanted)).tolist():
            one = Forecast(*(part[row : row + 1] for part in forecast[:3]), forecast.output)
            found.setdefault(int(track_ids[row]), one)
    return [found[one] for one in wanted.tolist()]


def _modes(forecast):
    """Which of one track's samples stand for its modes, and the probability of each; none of one with few samples."""
    samples = forecast.samples
    if samples.xy.shape[1] < LEAST_SAMPLES:
        return np.empty(0, int), np.empty(0)
    found = modes_of(samples)
    same = (samples.xy[0][None] == found.paths[0][:, None]).all(axis=(2, 3))
    return same.argmax(axis=1), found.probabilities[0]
