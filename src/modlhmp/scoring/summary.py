"""From errors a track to the numbers of a table: `results.csv` in long form."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from modlhmp.storage import read_parquet

COLUMNS = (
    "dataset", "method", "output", "protocol", "horizon_s", "ade_m", "fde_m",
    "ade_sd_m", "fde_sd_m", "ade_seed_sd_m", "n", "eligible", "seeds",
)  # fmt: skip


OUTPUTS = ("ranked", "median", "mean", "single")  # the first that a method has stands for it


class Errors(NamedTuple):
    """Errors of one method, output and protocol; tracks in a fixed order.

    `keys` [tracks] are "recording/track"; `ade`, `fde` [seeds, tracks, T] float32 in m, NaN where not scored;
    `eligible_steps` [tracks].
    """

    keys: np.ndarray
    ade: np.ndarray
    fde: np.ndarray
    eligible_steps: np.ndarray

    def by_track(self, metric):
        """Mean over the seeds that scored a track, [tracks, T]; NaN where none did."""
        return nan_mean(getattr(self, metric), axis=0)


def read_errors(path):
    """An errors file as {(output, protocol): `Errors`}."""
    table = read_parquet(path)
    steps = table.schema.field("ade").type.list_size
    ade, fde = (table[name].combine_chunks().flatten().to_numpy().reshape(-1, steps) for name in ("ade", "fde"))
    rows = table.drop_columns(["ade", "fde"]).to_pandas()
    found = {}
    for (output, protocol), group in rows.groupby(["output", "protocol"], observed=True):
        names = group["recording"].astype(str) + "/" + group["track_id"].astype(str)
        keys, track = np.unique(names, return_inverse=True)
        seeds, seed = np.unique(group["seed"], return_inverse=True)
        arrays = [np.full((len(seeds), len(keys), steps), np.nan, np.float32) for _ in range(2)]
        for array, values in zip(arrays, (ade, fde), strict=True):
            array[seed, track] = values[group.index]
        eligible = np.zeros(len(keys), np.int64)
        eligible[track] = group["eligible_steps"]
        found[output, protocol] = Errors(keys, *arrays, eligible)
    return found


def summarise(dataset, method, errors, step_s):
    """Rows of `results.csv` for one method: one an output, protocol and horizon.

    `errors` as from `read_errors`. Mean over seeds per track first, then over tracks; SD over tracks;
    `ade_seed_sd_m` is the SD over seeds of the mean error; `n` scored tracks (mean over seeds) of `eligible`.
    """
    rows = []
    for (output, protocol), one in sorted(errors.items()):
        ade, fde = one.by_track("ade"), one.by_track("fde")
        n = np.isfinite(one.ade).sum(axis=1).mean(axis=0)
        seed_means = nan_mean(one.ade, axis=1)
        for step in range(ade.shape[1]):
            rows.append((
                dataset, method, output, protocol, (step + 1) * step_s,
                *(float(nan_mean(e[:, step], axis=0)) for e in (ade, fde)),
                *(sample_sd(e[:, step]) for e in (ade, fde)),
                sample_sd(seed_means[:, step]), n[step], int((one.eligible_steps > step).sum()), len(one.ade),
            ))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def main_output(outputs):
    """The output that stands for a method in tables and tests: the first of `OUTPUTS` that it has."""
    return next(output for output in OUTPUTS if output in outputs)


def scored_horizons(horizons_s, dataset):
    """Those of the tables' horizons [s] that a dataset has: whole time steps, up to its longest."""
    steps = np.asarray(horizons_s) / dataset["time_step_s"]
    whole = np.isclose(steps, np.rint(steps)) & (steps > 0.5) & (np.asarray(horizons_s) <= dataset["horizon_s"])
    return np.asarray(horizons_s)[whole].tolist()


def nan_mean(values, axis):
    """Mean over the finite values along an axis; NaN (without a warning) where there is none."""
    finite = np.isfinite(values)
    number = finite.sum(axis=axis)
    total = np.where(finite, values, 0).sum(axis=axis, dtype=np.float64)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def sample_sd(values):
    """Standard deviation (n - 1) of the finite values; NaN for fewer than two."""
    finite = values[np.isfinite(values)].astype(np.float64)
    return float(np.std(finite, ddof=1)) if len(finite) > 1 else float("nan")
