"""From errors per track to the numbers of a table: `results.csv` in long form."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from modlhmp.scoring.errors import nan_mean, seed_mean
from modlhmp.storage import column, open_parquet, read_parquet, read_pieces

COLUMNS = (
    "dataset", "method", "output", "protocol", "horizon_s", "ade_m", "fde_m",
    "ade_sd_m", "fde_sd_m", "ade_seed_sd_m", "n", "eligible", "seeds",
    "all_ade_m", "all_fde_m", "all_n", "own_ade_m", "own_fde_m", "own_n", "infeasible", "truth_infeasible",
)  # fmt: skip

METRICS = ("ade", "fde", "infeasible")
# The first that a method has stands for it.
OUTPUTS = ("ranked", "median", "medoid", "modes", "likeliest", "mean", "single", "mean_path")


class Errors(NamedTuple):
    """Errors of one method, output and protocol; tracks in a fixed order, each once or once per forecast.

    `keys` [tracks] are "recording/track", of a track that is forecast several times "recording/track@t0"; `ade`, `fde`
    [seeds, tracks, T] float32 in m, NaN where not scored; `eligible_steps` [tracks]; `unknown` [tracks]: whether the
    method could not forecast it, with some seed: no dynamics from t0 on. `person` [tracks] are "recording/person":
    every track is one, but for the pieces of a cut one where these are the same person. With a floor plan, `infeasible`
    [seeds, tracks, T] is 1 where the forecast has been inside a wall (a share where it is a mean of several), and
    `truth_infeasible` [tracks, T] says so of the truth.
    """

    keys: np.ndarray
    ade: np.ndarray
    fde: np.ndarray
    eligible_steps: np.ndarray
    unknown: np.ndarray
    person: np.ndarray
    infeasible: np.ndarray | None = None
    truth_infeasible: np.ndarray | None = None

    def by_track(self, metric: str) -> np.ndarray:
        """Mean over the seeds that scored a track, [tracks, T]; NaN where none did."""
        return nan_mean(getattr(self, metric), axis=0)


ErrorsByOutput = dict[tuple[str, str], Errors]  # of one method, by (output, protocol)


def read_errors(path: str | Path, steps: slice | Sequence[int] = slice(None)) -> ErrorsByOutput:
    """An errors file as {(output, protocol): `Errors`}, of all time steps or those that are chosen."""
    schema = open_parquet(path).schema_arrow
    metrics = [name for name in METRICS if name in schema.names]
    rows = read_parquet(path, [name for name in schema.names if name not in metrics]).to_pandas()
    width = schema.field("ade").type.list_size
    step = np.arange(1, width + 1)[steps]
    found, place = {}, np.empty((2, len(rows)), np.int64)  # seed and track of every row
    for key, group in rows.groupby(["output", "protocol"], observed=True):
        of = group["recording"].astype(str) + "/"
        names = of + group["track_id"].astype(str)
        if "t0" in group:
            names += "@" + group["t0"].astype(str)
        keys, first, track = np.unique(names, return_index=True, return_inverse=True)
        person = of + group["person" if "person" in group else "track_id"].astype(str)
        seeds, seed = np.unique(group["seed"], return_inverse=True)
        place[:, group.index] = seed, track
        arrays: dict[str, np.ndarray] = {
            name: np.full((len(seeds), len(keys), len(step)), np.nan, np.float32) for name in metrics
        }
        eligible = np.zeros(len(keys), np.int64)
        eligible[track] = group["eligible_steps"]
        unknown = np.zeros(len(keys), bool)
        np.logical_or.at(unknown, track, group["alive_steps"] == 0)
        if "infeasible" in arrays:
            since = np.zeros(len(keys), np.int64)
            since[track] = group["truth_infeasible_from"]
            arrays["truth_infeasible"] = (since[:, None] > 0) & (step >= since[:, None])
        whose = person.to_numpy(str)[first]
        found[key] = Errors(keys, eligible_steps=eligible, unknown=unknown, person=whose, **arrays)
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

    `errors` as from `read_errors`. `ade_m`, `fde_m`: mean of the seeds' own means over the tracks that each scored,
    `n` (mean over seeds) of `eligible`; `ade_seed_sd_m` their SD, `ade_sd_m` that over tracks. `all_*`: over the tracks
    that all seeds scored. `own_*`: every track counts at its own length, or at the horizon if it is longer.
    `infeasible`, `truth_infeasible`: share of the scored forecasts, and of the same tracks' true paths, that have been
    inside a wall; NaN without a floor plan.
    """
    rows = []
    for (output, protocol), one in sorted(errors.items()):
        both = (one.ade, one.fde)
        means, spread = [seed_mean(each) for each in both], [one.by_track("ade"), one.by_track("fde")]
        n, seed_means = np.isfinite(one.ade).sum(axis=1).mean(axis=0), nan_mean(one.ade, axis=1)
        by_all = np.isfinite(one.ade).all(axis=0)
        common = [seed_mean(np.where(by_all, each, np.nan)) for each in both]
        own = [at_own_length(each, one.eligible_steps) for each in (*both, np.isfinite(one.ade).astype(float))]
        own_means, own_n = [seed_mean(each) for each in own[:2]], np.nansum(own[2], axis=1).mean(axis=0)
        entered = truth_entered = np.full(one.ade.shape[2], np.nan)
        if one.infeasible is not None and one.truth_infeasible is not None:
            entered = seed_mean(one.infeasible)
            truth_entered = seed_mean(np.where(np.isfinite(one.ade), one.truth_infeasible, np.nan))
        for step in range(one.ade.shape[2]):
            rows.append((
                dataset, method, output, protocol, (step + 1) * step_s, *(float(each[step]) for each in means),
                *(sample_sd(each[:, step]) for each in spread), sample_sd(seed_means[:, step]), n[step],
                int((one.eligible_steps > step).sum()), len(one.ade),
                *(float(each[step]) for each in common), int(by_all[:, step].sum()),
                *(float(each[step]) for each in own_means), float(own_n[step]), entered[step], truth_entered[step],
            ))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def at_horizons(path: str | Path, horizons_s: Sequence[float], step_s: float) -> ErrorsByOutput:
    """An errors file at these horizons only: what comparisons of methods need."""
    return read_errors(path, [round(horizon / step_s) - 1 for horizon in horizons_s])


def at_own_length(values: np.ndarray, eligible_steps: np.ndarray) -> np.ndarray:
    """Values [..., tracks, T] of each track at its own length, or at the horizon if it is longer; NaN for length 0."""
    steps = np.minimum(np.arange(values.shape[-1]), eligible_steps[:, None] - 1)
    at = np.broadcast_to(np.maximum(steps, 0), values.shape)
    return np.where(steps >= 0, np.take_along_axis(values, at, axis=-1), np.nan)


def main_output(outputs: Collection[str]) -> str:
    """The output that stands for a method in tables and tests: the first of `OUTPUTS` that it has."""
    return next(output for output in OUTPUTS if output in outputs)


def sample_sd(values: np.ndarray) -> float:
    """Standard deviation (n - 1) of the finite values; NaN for fewer than two."""
    finite = values[np.isfinite(values)].astype(np.float64)
    return float(np.std(finite, ddof=1)) if len(finite) > 1 else float("nan")
