"""From errors per track to the numbers of a table: `results.csv` in long form."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa

from modlhmp.scoring.errors import nan_mean
from modlhmp.storage import column, open_parquet, read_batches, read_pieces
from modlhmp.study.csv_cells import original

COLUMNS = (
    "dataset", "method", "output", "protocol", "horizon_s", "ade_m", "fde_m",
    "ade_sd_m", "fde_sd_m", "ade_seed_sd_m", "n", "eligible", "seeds",
    "all_ade_m", "all_fde_m", "all_n", "own_ade_m", "own_fde_m", "own_n", "infeasible", "truth_infeasible",
)  # fmt: skip

NAMES = ("dataset", "method", "output", "protocol")
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


class StoredErrors(Mapping[tuple[str, str], Errors]):
    """A file of errors by (output, protocol), read when they are asked for: none are held, and one may be too large.

    `parts` gives one recording after the other, so that what can be gathered by recording needs no more memory than
    that takes. Only time steps in `steps` are read.
    """

    def __init__(self, path: str | Path, steps: slice | Sequence[int] = slice(None)) -> None:
        self.path, self.steps = path, steps
        self._groups: dict[str, dict[int, None]] = {}  # the row groups that a recording stands in, in order
        self._seeds: dict[tuple[str, str], set[int]] = {}
        self._recordings: dict[tuple[str, str], set[str]] = {}
        for number, piece in enumerate(read_pieces(path, ["recording", "output", "protocol", "seed"])):
            for recording, output, protocol, seed in piece.to_pandas().drop_duplicates().itertuples(index=False):
                self._groups.setdefault(recording, {})[number] = None
                self._seeds.setdefault((output, protocol), set()).add(seed)
                self._recordings.setdefault((output, protocol), set()).add(recording)

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter(self._seeds)

    def __len__(self) -> int:
        return len(self._seeds)

    def __getitem__(self, key: tuple[str, str]) -> Errors:
        return joined(list(self.parts(key)))

    def parts(self, key: tuple[str, str]) -> Iterator[Errors]:
        """Errors of one recording after the other, in the order of their keys."""
        file, seeds = open_parquet(self.path), np.array(sorted(self._seeds[key]))
        names = file.schema_arrow.names
        metrics, width = [name for name in METRICS if name in names], file.schema_arrow.field("ade").type.list_size
        about = [name for name in names if name not in metrics]
        for recording in sorted(self._recordings[key], key=lambda name: f"{name}/"):
            groups = list(self._groups[recording])
            rows = pa.concat_tables(read_batches(self.path, file, groups, about)).to_pandas()
            is_of = zip(("recording", "output", "protocol"), (recording, *key), strict=True)
            mine = np.logical_and.reduce([rows[name] == value for name, value in is_of])
            values = {}
            for name in metrics:  # one after the other: they are nearly all that the file holds
                chosen, start = [], 0
                for batch in read_batches(self.path, file, groups, [name]):
                    mask = mine[start : start + len(batch)]
                    chosen.append(column(batch, name).reshape(-1, width)[mask][:, self.steps])
                    start += len(batch)
                values[name] = np.concatenate(chosen)
            yield _errors(rows[mine], values, seeds, np.arange(1, width + 1)[self.steps])


ErrorsByOutput = Mapping[tuple[str, str], Errors]  # of one method, by (output, protocol)


def read_errors(path: str | Path, steps: slice | Sequence[int] = slice(None)) -> StoredErrors:
    """An errors file as {(output, protocol): `Errors`}, of all time steps or those that are chosen."""
    return StoredErrors(path, steps)


def keys_of(rows: pd.DataFrame) -> pd.Series:
    """The key of each row's forecast (`Errors.keys`), of its `recording`, `track_id` and, if it has one, `t0`."""
    keys = rows["recording"].astype(str) + "/" + rows["track_id"].astype(str)
    return keys + "@" + rows["t0"].astype(str) if "t0" in rows else keys


def _errors(rows, values, seeds, steps):
    """`Errors` [seeds, tracks, T] of the rows of one recording, output and protocol, with their values [rows, T]."""
    keys, first, track = np.unique(keys_of(rows), return_index=True, return_inverse=True)
    whose = rows["recording"].astype(str) + "/" + rows["person" if "person" in rows else "track_id"].astype(str)
    arrays = {name: np.full((len(seeds), len(keys), len(steps)), np.nan, np.float32) for name in values}
    for name, array in arrays.items():
        array[np.searchsorted(seeds, rows["seed"]), track] = values[name]
    eligible, unknown = np.zeros(len(keys), np.int64), np.zeros(len(keys), bool)
    eligible[track] = rows["eligible_steps"]
    np.logical_or.at(unknown, track, rows["alive_steps"] == 0)
    if "infeasible" in arrays:
        since = np.zeros(len(keys), np.int64)
        since[track] = rows["truth_infeasible_from"]
        arrays["truth_infeasible"] = (since[:, None] > 0) & (steps >= since[:, None])
    return Errors(keys, eligible_steps=eligible, unknown=unknown, person=whose.to_numpy(str)[first], **arrays)


def joined(parts: Sequence[Errors]) -> Errors:
    """Errors of several recordings or folds as one; tracks are axis 0 of what has no seeds, else axis 1."""
    fields: dict[str, Any] = {}
    for name in Errors._fields:
        values = [getattr(part, name) for part in parts]
        axis = 1 if name in METRICS else 0
        fields[name] = None if any(value is None for value in values) else np.concatenate(values, axis=axis)
    return Errors(**fields)


class _Mean:
    """Mean over tracks of every seed and step, of parts as they come: to the last bit that of all in one array."""

    def __init__(self) -> None:
        self.total: Any = 0.0
        self.n: Any = 0

    def add(self, values):
        """Values [seeds, tracks, T]; NaN do not count."""
        finite = np.isfinite(values)
        first = np.broadcast_to(self.total, (len(values), values.shape[2]))[:, None]
        self.total = np.concatenate([first, np.where(finite, values, 0)], axis=1).sum(axis=1, dtype=np.float64)
        self.n = self.n + finite.sum(axis=1)

    @property
    def by_seed(self):
        return np.where(self.n > 0, self.total / np.maximum(self.n, 1), np.nan)

    @property
    def mean(self):
        """`errors.seed_mean`."""
        return nan_mean(self.by_seed, axis=0)


def summarise(dataset: str, method: str, errors: ErrorsByOutput, step_s: float) -> pd.DataFrame:
    """Rows of `results.csv` for one method: one per output, protocol and horizon.

    `errors` as from `read_errors`; of a file no more than a recording is held, and of all tracks their means over the
    seeds. `ade_m`, `fde_m`: mean of the seeds' own means over the tracks that each scored, `n` (mean over seeds) of
    `eligible`; `ade_seed_sd_m` their SD, `ade_sd_m` that over tracks. `all_*`: over the tracks that all seeds scored.
    `own_*`: every track counts at its own length, or at the horizon if it is longer. `infeasible`, `truth_infeasible`:
    share of the scored forecasts, and of the same tracks' true paths, that have been inside a wall; NaN without a floor
    plan.
    """
    rows = []
    for key in sorted(errors):
        parts = errors.parts(key) if isinstance(errors, StoredErrors) else iter([errors[key]])
        rows += [(dataset, method, *key, (step + 1) * step_s, *one) for step, one in enumerate(_summary(parts))]
    return pd.DataFrame(rows, columns=COLUMNS)


def read_scores(path: str | Path) -> pd.DataFrame:
    """`results.csv` as its rows were written (`summarise`): its names are texts, `20121024` and `NA` as well."""
    empty = {name: [""] for name in COLUMNS if name not in NAMES}
    table = pd.read_csv(path, dtype=dict.fromkeys(NAMES, str), keep_default_na=False, na_values=empty)
    return table.assign(**{name: table[name].map(original) for name in NAMES})


def _summary(parts):
    """For each step a row's numbers from `ade_m` on, of the `Errors` of one output and protocol in parts."""
    means = {name: _Mean() for name in ("ade", "fde", "all_ade", "all_fde", "own_ade", "own_fde", "walls", "truth")}
    tracks, eligible, by_all = [], np.zeros((), int), np.zeros((), int)
    for one in parts:
        scored = np.isfinite(one.ade)
        by_everyone = scored.all(axis=0)
        for name, values in (("ade", one.ade), ("fde", one.fde)):
            means[name].add(values)
            means[f"all_{name}"].add(np.where(by_everyone, values, np.nan))
            means[f"own_{name}"].add(at_own_length(values, one.eligible_steps))
        walls, truth = one.infeasible, one.truth_infeasible
        unknown = np.full(one.ade.shape, np.nan, np.float32)
        means["walls"].add(unknown if walls is None else walls)
        means["truth"].add(unknown if truth is None else np.where(scored, truth, np.nan))
        tracks.append((one.by_track("ade"), one.by_track("fde")))
        steps = np.arange(one.ade.shape[2])
        eligible = eligible + (one.eligible_steps[:, None] > steps).sum(axis=0)
        by_all = by_all + by_everyone.sum(axis=0)
    ade, own = means["ade"], means["own_ade"]
    found = {name: one.mean for name, one in means.items()}
    n, own_n = ade.n.mean(axis=0), own.n.mean(axis=0)
    for step in steps:
        spread = [sample_sd(np.concatenate([part[metric][:, step] for part in tracks])) for metric in (0, 1)]
        yield (
            float(found["ade"][step]), float(found["fde"][step]), *spread, sample_sd(ade.by_seed[:, step]), n[step],
            int(eligible[step]), len(ade.n), float(found["all_ade"][step]), float(found["all_fde"][step]),
            int(by_all[step]), float(found["own_ade"][step]), float(found["own_fde"][step]), float(own_n[step]),
            found["walls"][step], found["truth"][step],
        )  # fmt: skip


def at_horizons(path: str | Path, horizons_s: Sequence[float], step_s: float) -> StoredErrors:
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
