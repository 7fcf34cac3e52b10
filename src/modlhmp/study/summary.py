"""From errors per track to the numbers of a table: `results.csv` in long form."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from modlhmp.scoring.errors import nan_mean
from modlhmp.storage import column, read_parquet, read_pieces

COLUMNS = (
    "dataset", "method", "output", "protocol", "horizon_s", "ade_m", "fde_m",
    "ade_sd_m", "fde_sd_m", "ade_seed_sd_m", "n", "eligible", "seeds",
    "own_ade_m", "own_fde_m", "own_n", "infeasible", "truth_infeasible",
)  # fmt: skip

METRICS = ("ade", "fde", "infeasible")
# The first that a method has stands for it.
OUTPUTS = ("ranked", "median", "medoid", "modes", "mean", "single", "mean_path")


class Errors(NamedTuple):
    """Errors of one method, output and protocol; tracks in a fixed order.

    `keys` [tracks] are "recording/track"; `ade`, `fde` [seeds, tracks, T] float32 in m, NaN where not scored;
    `eligible_steps` [tracks]. With a floor plan, `infeasible` [seeds, tracks, T] is 1 where the forecast has been
    inside a wall (a share where it is a mean of several), and `truth_infeasible` [tracks, T] says so of the truth.
    """

    keys: np.ndarray
    ade: np.ndarray
    fde: np.ndarray
    eligible_steps: np.ndarray
    infeasible: np.ndarray | None = None
    truth_infeasible: np.ndarray | None = None

    def by_track(self, metric: str) -> np.ndarray:
        """Mean over the seeds that scored a track, [tracks, T]; NaN where none did."""
        return nan_mean(getattr(self, metric), axis=0)


ErrorsByOutput = dict[tuple[str, str], Errors]  # of one method, by (output, protocol)


def read_errors(path: str | Path, steps: slice | Sequence[int] = slice(None)) -> ErrorsByOutput:
    """An errors file as {(output, protocol): `Errors`}, of all time steps or those that are chosen."""
    schema = pq.read_schema(path)
    metrics = [name for name in METRICS if name in schema.names]
    rows = read_parquet(path, [name for name in schema.names if name not in metrics]).to_pandas()
    width = schema.field("ade").type.list_size
    step = np.arange(1, width + 1)[steps]
    found, place = {}, np.empty((2, len(rows)), np.int64)  # seed and track of every row
    for key, group in rows.groupby(["output", "protocol"], observed=True):
        names = group["recording"].astype(str) + "/" + group["track_id"].astype(str)
        keys, track = np.unique(names, return_inverse=True)
        seeds, seed = np.unique(group["seed"], return_inverse=True)
        place[:, group.index] = seed, track
        arrays: dict[str, np.ndarray] = {
            name: np.full((len(seeds), len(keys), len(step)), np.nan, np.float32) for name in metrics
        }
        eligible = np.zeros(len(keys), np.int64)
        eligible[track] = group["eligible_steps"]
        if "infeasible" in arrays:
            first = np.zeros(len(keys), np.int64)
            first[track] = group["truth_infeasible_from"]
            arrays["truth_infeasible"] = (first[:, None] > 0) & (step >= first[:, None])
        found[key] = Errors(keys, eligible_steps=eligible, **arrays)
    begin = 0
    for piece in read_pieces(path, metrics):
        of = rows.iloc[begin : begin + len(piece)].groupby(["output", "protocol"], observed=True).indices
        for name in metrics:
            values = column(piece, name).reshape(-1, width)[:, steps]
            for key, mine in of.items():
                getattr(found[key], name)[tuple(place[:, begin + mine])] = values[mine]
        begin += len(piece)
    return found


def summarise(dataset: str, method: str, errors: ErrorsByOutput, step_s: float) -> pd.DataFrame:
    """Rows of `results.csv` for one method: one per output, protocol and horizon.

    `errors` as from `read_errors`. Mean over seeds per track first, then over tracks; SD over tracks;
    `ade_seed_sd_m` is the SD over seeds of the mean error; `n` scored tracks (mean over seeds) of `eligible`.
    `own_ade_m`, `own_fde_m`, `own_n`: every track counts at its own length, or at the horizon if it is longer.
    `infeasible`, `truth_infeasible`: share of the scored forecasts, and of the same tracks' true paths, that have been
    inside a wall; NaN without a floor plan.
    """
    rows = []
    for (output, protocol), one in sorted(errors.items()):
        ade, fde = one.by_track("ade"), one.by_track("fde")
        n = np.isfinite(one.ade).sum(axis=1).mean(axis=0)
        seed_means = nan_mean(one.ade, axis=1)
        own = [at_own_length(metric, one.eligible_steps) for metric in (ade, fde, np.isfinite(one.ade).mean(axis=0))]
        nothing = np.full(ade.shape[1], np.nan)
        entered = truth_entered = nothing
        if one.infeasible is not None and one.truth_infeasible is not None:
            entered = nan_mean(one.by_track("infeasible"), axis=0)
            truth_entered = nan_mean(np.where(np.isfinite(ade), one.truth_infeasible, np.nan), axis=0)
        for step in range(ade.shape[1]):
            rows.append((
                dataset, method, output, protocol, (step + 1) * step_s,
                *(float(nan_mean(e[:, step], axis=0)) for e in (ade, fde)),
                *(sample_sd(e[:, step]) for e in (ade, fde)),
                sample_sd(seed_means[:, step]), n[step], int((one.eligible_steps > step).sum()), len(one.ade),
                *(float(nan_mean(e[:, step], axis=0)) for e in own[:2]), float(np.nansum(own[2][:, step])),
                entered[step], truth_entered[step],
            ))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def at_horizons(path: str | Path, horizons_s: Sequence[float], step_s: float) -> ErrorsByOutput:
    """An errors file at these horizons only, the seeds averaged, [1, tracks, H]: what comparisons of methods need."""
    errors = read_errors(path, [round(horizon / step_s) - 1 for horizon in horizons_s])
    return {
        key: one._replace(**{m: one.by_track(m)[None] for m in METRICS if getattr(one, m) is not None})
        for key, one in errors.items()
    }


def at_own_length(by_track: np.ndarray, eligible_steps: np.ndarray) -> np.ndarray:
    """Values [tracks, T] of each track at its own length, or at the horizon where it is longer; NaN for length 0."""
    steps = np.minimum(np.arange(by_track.shape[1]), eligible_steps[:, None] - 1)
    return np.where(steps >= 0, np.take_along_axis(by_track, np.maximum(steps, 0), axis=1), np.nan)


def main_output(outputs: Collection[str]) -> str:
    """The output that stands for a method in tables and tests: the first of `OUTPUTS` that it has."""
    return next(output for output in OUTPUTS if output in outputs)


def sample_sd(values: np.ndarray) -> float:
    """Standard deviation (n - 1) of the finite values; NaN for fewer than two."""
    finite = values[np.isfinite(values)].astype(np.float64)
    return float(np.std(finite, ddof=1)) if len(finite) > 1 else float("nan")
