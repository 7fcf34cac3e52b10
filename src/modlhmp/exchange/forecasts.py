"""Forecasts in the long form, one row per predicted position, in CSV or Parquet: what any program can write and read.

| column | unit | meaning |
|---|---|---|
| `track_id` | | whose forecast it is: whole number or text |
| `t0` | s | time of the last observed row, unix or the recording's; in the hand-in of a task 0, or left out |
| `sample` | | which of the track's futures: a whole number from 0; left out where there is one |
| `probability` | | of the sample, the same in all its rows; a forecast's sum to 1; left out: all alike |
| `step` | | 1, 2, ... time steps after t0; or `t`, or both |
| `t` | s | after t0, on the grid of time steps; beside `step` it tells how long a time step is |
| `x`, `y` | m | position, in the recording's frame |

A sample that ends, since the person has left, has no rows from then on.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.exchange.columns import line_of, read_columns
from modlhmp.exchange.tracks import numbers_of
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.median import weighted_geometric_median, with_median
from modlhmp.forecasting.ranking import best_first
from modlhmp.forecasting.recording import TRACKS_AT_ONCE
from modlhmp.storage import DataError, column
from modlhmp.tracks import runs

TYPES = {"track_id": pa.string()} | dict.fromkeys(("t0", "sample", "probability", "step", "t", "x", "y"), pa.float64())
LATEST_S = 86400.0  # after t0; what is later is a clock's time
OFF_GRID_S = 0.05  # what a time may differ from its time step, at most a tenth of that
SUM_WITHIN = 1e-3  # of the probabilities of a forecast's samples

How = Literal["likeliest", "mean", "geometric_median"]  # one path comes out of several samples


class Rows(NamedTuple):
    """Predicted positions as a file lists them, each an array [rows]; `line` is how the file counts the row.

    `t0` is 0 where the file has none; `probability` NaN where it has none. `names` are the texts of ids that are no
    plain numbers.
    """

    track_id: np.ndarray
    t0: np.ndarray
    sample: np.ndarray
    probability: np.ndarray
    step: np.ndarray
    x: np.ndarray
    y: np.ndarray
    line: np.ndarray
    names: dict[int, str]


class Samples(NamedTuple):
    """f forecasts of m samples in all, checked and sorted: by track, t0, sample, step.

    `track_id`, `t0` [f]; `first` [f + 1] is each forecast's first sample, `begin` [m + 1] each sample's first row in
    `xy` [rows, 2], `line` [f] each forecast's first row in the file. `probability` [m] sums to 1 over a forecast.
    `alike` says whether all forecasts have the same number of samples, of the same probability.
    """

    track_id: np.ndarray
    t0: np.ndarray
    first: np.ndarray
    probability: np.ndarray
    begin: np.ndarray
    xy: np.ndarray
    line: np.ndarray
    alike: bool
    names: dict[int, str]

    def name(self, forecast: int) -> str:
        """Whose a forecast is, as the file writes it."""
        number = int(self.track_id[forecast])
        return self.names.get(number, str(number))

    @property
    def steps(self) -> np.ndarray:
        """Time steps of each sample [m]."""
        return np.diff(self.begin)

    @property
    def most(self) -> int:
        """The largest number of samples of a forecast."""
        return int(np.diff(self.first).max(initial=0))


def read_samples(path: str | Path, step_s: float) -> Samples:
    """The forecasts of a long table, by time steps of `step_s`; `DataError` names the file, row, value and remedy."""
    return samples_of(rows_of(read_long(path), step_s, path), path)


def read_long(path: str | Path) -> pa.Table:
    """A long table as it is; `DataError` where a column is missing."""
    table = read_columns(path, TYPES)
    missing = [name for name in ("track_id", "x", "y") if name not in table.column_names]
    if missing or not {"step", "t"} & set(table.column_names):
        raise DataError(
            f"{path}: {f'no column {missing[0]}' if missing else 'one of the columns step and t is needed'}; it has "
            f"{', '.join(table.column_names)}, the form is track_id, t0, sample, probability, step or t, x, y"
        )
    return table


def step_said(table: pa.Table, path: str | Path) -> float | None:
    """The time step [s] that a long table says itself, by `t` beside `step`, as ours do; None: it does not.

    `DataError` names the row where the two do not go together.
    """
    if not ({"step", "t"} <= set(table.column_names) and len(table)):
        return None
    step, t, line = column(table, "step"), column(table, "t"), line_of(path, 0) + np.arange(len(table))
    _refuse_clock(path, line, t)
    last = int(np.argmax(step))  # where rounded times tell it best
    step_s = float(f"{t[last] / max(step[last], 1.0):.9g}")
    _refuse(path, line, _off_grid(t, step, step_s), lambda row: (
        f"t {t[row]:g} s is not step {step[row]:g} of {step_s:g} s, as row {line[last]} has them: steps count from 1, "
        "t from t0; correct one of the columns, or leave it out"
    ))  # fmt: skip
    return step_s or None


def rows_of(table: pa.Table, step_s: float, path: str | Path) -> Rows:
    """The rows of a long table; texts of ids become numbers as in a recording (`modlhmp.ids`)."""
    n = len(table)
    ids, names = numbers_of(table["track_id"], path)
    found = {name: column(table, name) for name in table.column_names if name != "track_id"}
    line = line_of(path, 0) + np.arange(n)
    if "t" in found:
        t = found.pop("t")
        step = _steps_of(t, step_s, path, line)
        said = found.setdefault("step", step)
        _refuse(path, line, (said != step) & np.isfinite(said), lambda row: (
            f"t {t[row]:g} s is not step {said[row]:g} of {step_s:g} s; leave one of the columns out"
        ))  # fmt: skip
    filled = {"t0": np.zeros(n), "sample": np.zeros(n), "probability": np.full(n, np.nan), **found}
    return Rows(track_id=ids, line=line, names=names, **filled)


def _steps_of(t: np.ndarray, step_s: float, path: str | Path, line: np.ndarray) -> np.ndarray:
    """The time steps of seconds after t0."""
    _refuse_clock(path, line, t)
    step = np.rint(t / step_s)
    _refuse(path, line, _off_grid(t, step, step_s), lambda row: (
        f"t {t[row]:g} is no multiple of the time step, {step_s:g} s; t is in s after t0: interpolate to whole steps"
    ))  # fmt: skip
    return step


def _off_grid(t: np.ndarray, step: np.ndarray, step_s: float) -> np.ndarray:
    """Whether times [rows] are away from their time steps."""
    return np.abs(t - step * step_s) > min(OFF_GRID_S, 0.1 * step_s)


def _refuse_clock(path: str | Path, line: np.ndarray, t: np.ndarray) -> None:
    _refuse(path, line, t > LATEST_S, lambda row: (
        f"t {t[row]:.16g}: t is in seconds after t0, and this is more than a day; it looks like a clock's time: take "
        "that of t0 off"
    ))  # fmt: skip


def samples_of(rows: Rows, path: str | Path) -> Samples:
    """Rows checked and sorted; `path` is named in errors."""
    track_id, t0, sample, probability, step, x, y, line, names = rows
    for name in ("t0", "step", "x", "y"):
        values = getattr(rows, name)
        _refuse(path, line, ~np.isfinite(values), lambda row, name=name, values=values: (
            f"{name} {values[row]} is no finite number; leave out what comes after a sample has ended"
        ))  # fmt: skip
    _refuse(path, line, (sample != np.rint(sample)) | ~(sample >= 0), lambda row: (
        f"sample {sample[row]:g} is no whole number from 0; number the futures of a track 0, 1, 2 ..."
    ))  # fmt: skip
    _refuse(path, line, step != np.rint(step), lambda row: (
        f"step {step[row]:g} is no whole number; interpolate to whole time steps, or give their seconds as t"
    ))  # fmt: skip
    _refuse(path, line, step < 1, lambda row: (
        f"step {step[row]:g}: a future begins one time step after t0; t0 is step 0, so leave out what was observed"
    ))  # fmt: skip
    order = np.lexsort((step, sample, t0, track_id))
    track_id, t0, sample, probability, step, x, y, line = (part[order] for part in rows[:-1])
    same = (track_id[1:] == track_id[:-1]) & (t0[1:] == t0[:-1])
    new = np.r_[True, ~same][: len(line)]
    begins = np.r_[True, ~(same & (sample[1:] == sample[:-1]))][: len(line)]
    before = np.where(begins, 0.0, np.r_[0.0, step[:-1]][: len(line)])
    whose = _whose(track_id, t0, sample, names)
    _refuse(path, line, step == before, lambda row: (
        f"{whose(row)} has step {step[row]:g} twice, first in row {line[row - 1]}; keep one"
    ))  # fmt: skip
    _refuse(path, line, step != before + 1, lambda row: (
        f"{whose(row)} has step {step[row]:g}, but no step {before[row] + 1:g}; give every step until it ends"
    ))  # fmt: skip
    begin = np.flatnonzero(begins)
    first = np.searchsorted(begin, np.flatnonzero(new))
    shares, alike = _shares(path, line, probability, begin, first, whose)
    return Samples(
        track_id[new], t0[new], np.r_[first, len(begin)], shares, np.r_[begin, len(line)], np.column_stack([x, y]),
        line[new], alike, names,
    )  # fmt: skip


def _shares(path, line, probability, begin, first, whose):
    """Probabilities [m] of the samples, which sum to 1 over a forecast, and whether all are alike."""
    counts = np.diff(np.r_[first, len(begin)])
    of = np.repeat(np.arange(len(counts)), counts)
    if np.isnan(probability).all():
        return 1.0 / counts[of], len(set(counts.tolist())) <= 1
    _refuse(path, line, ~((probability >= 0) & (probability <= 1)), lambda row: (
        f"probability {probability[row]:g} of {whose(row)} is not from 0 to 1; give weights that sum to 1"
    ))  # fmt: skip
    mine = probability[begin]
    differs = probability != np.repeat(mine, np.diff(np.r_[begin, len(line)]))
    _refuse(path, line, differs, lambda row: (
        f"probability {probability[row]:g} differs from that in the first row of {whose(row)}; give all its rows one"
    ))  # fmt: skip
    total = np.bincount(of, mine)
    bad = np.zeros(len(line), bool)
    bad[begin[first]] = np.abs(total - 1) > SUM_WITHIN
    _refuse(path, line, bad, lambda row: (
        f"the probabilities of {whose(row, False)} sum to {total[np.searchsorted(begin[first], row)]:.6g} over its "
        "samples; divide them by their sum, or leave the column out where all are alike"
    ))  # fmt: skip
    shares = mine / total[of]
    return shares, bool(len(set(counts.tolist())) <= 1 and np.ptp(shares) <= 1e-9)


def _whose(track_id, t0, sample, names):
    """A function (row, whether to name the sample): whose row it is, in words."""

    def told(row, of_sample=True):
        text = f"track {names.get(int(track_id[row]), track_id[row])}" + (f" at t0 {t0[row]:.16g}" if t0.any() else "")
        return f"sample {sample[row]:g} of {text}" if of_sample else text

    return told


def _refuse(path, line, bad, told):
    """`DataError` about the first row, as the file counts them, that is `bad` [rows]; `told` makes its text."""
    if bad.any():
        where = np.flatnonzero(bad)
        row = int(where[line[where].argmin()])
        raise DataError(f"{path}, row {line[row]}: {told(row)}")


def forecast_of(samples: Samples, which: np.ndarray, start: np.ndarray, steps: int, path: How | None) -> Forecast:
    """The forecasts `which` [n] of a table as a `Forecast` to `steps`; -1 is a track without one, held where it is.

    `start` [n, 2] are the positions at t0, `path` is how one comes out of several samples. Every sample counts by its
    probability; of those that have ended only where none is left (`likeliest`: as the protocols say).
    """
    n, k = len(which), max(samples.most, 1)
    xy = np.repeat(np.asarray(start, np.float32)[:, None, None], k, axis=1).repeat(steps, axis=2)
    alive, weight = np.zeros((n, k), np.int32), np.zeros((n, k))
    known = np.flatnonzero(which >= 0)
    chosen = which[known]
    counts = samples.first[chosen + 1] - samples.first[chosen]
    sample = runs(samples.first[chosen], counts)
    walker, slot = np.repeat(known, counts), runs(np.zeros(len(counts), np.int64), counts)
    lived = samples.steps[sample]
    alive[walker, slot], weight[walker, slot] = lived, samples.probability[sample]
    row, step = runs(samples.begin[sample], lived), runs(np.zeros(len(lived), np.int64), lived)
    xy[np.repeat(walker, lived), np.repeat(slot, lived), step] = samples.xy[row]
    last = np.minimum(np.arange(steps), np.maximum(alive - 1, 0)[:, :, None])
    xy = np.take_along_axis(xy, last[..., None], axis=2)
    fitness = np.zeros((n, k, steps), np.float32)
    if k == 1:
        return Forecast(xy, fitness, alive, "single")
    if path == "likeliest":
        with np.errstate(divide="ignore"):
            fitness += np.log(weight)[:, :, None].astype(np.float32)
        return Forecast(xy, fitness, alive, "likeliest")
    if path == "geometric_median" and samples.alike:
        return with_median(Forecast(xy, fitness, alive, "mean"))
    return _with_path(Forecast(xy, fitness, alive, "mean"), weight, path)


def _with_path(forecast: Forecast, weight: np.ndarray, path: How | None) -> Forecast:
    """Samples with their weighted mean or geometric median before them, over those that are still there."""
    xy, fitness, alive, _ = forecast
    there = alive[:, :, None] > np.arange(xy.shape[2])
    counted = np.where(there, weight[:, :, None], 0.0)
    total = counted.sum(axis=1)
    counted /= np.where(total > 0, total, 1.0)[:, None]
    found = _medians(xy, counted) if path == "geometric_median" else (counted[..., None] * xy).sum(axis=1)
    lived = np.where(weight > 0, alive, 0).max(axis=1)
    last = np.minimum(np.arange(xy.shape[2]), np.maximum(lived - 1, 0)[:, None])
    found = np.take_along_axis(found, last[..., None], axis=1)
    found = np.where((lived > 0)[:, None, None], found, xy[:, 0])
    return Forecast(
        np.concatenate([found[:, None].astype(np.float32), xy], axis=1),
        np.concatenate([fitness[:, :1], fitness], axis=1),
        np.concatenate([lived[:, None].astype(np.int32), alive], axis=1),
        "median" if path == "geometric_median" else "mean_path",
    )


def _medians(xy: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Geometric medians [n, T, 2] at every step of futures `xy` [n, k, T, 2] that count by their `share` [n, k, T].

    0 where none counts. Each is found for itself, so that nobody's depends on who else is in the file.
    """
    found = np.zeros((len(xy), *xy.shape[2:]))
    for walker, step in zip(*np.nonzero(share.any(axis=1)), strict=True):
        counts = share[walker, :, step] > 0
        x, y = xy[walker, counts, step].astype(float).T.copy()
        found[walker, step] = weighted_geometric_median(x, y, share[walker, counts, step], len(x))
    return found


def long_table(
    track_id: np.ndarray,
    t0: np.ndarray,
    forecast: Forecast,
    owners: Mapping[int, str] | None = None,
    step_s: float | None = None,
) -> pa.Table:
    """Futures of n tracks as a long table; ranked ones in the order of their ranks at the longest horizon.

    `owners` are texts to write for ids, `step_s` is the time step, which adds `t` beside `step`. What a future gives
    once it has stopped is left out, and with it futures that never began. Modes have probabilities; others are alike,
    so the fitness of ranked ones is in their order only.
    """
    forecast = best_first(forecast)
    n, k, _, _ = forecast.xy.shape
    lived = forecast.steps_alive.ravel()
    walker, sample = np.repeat(np.repeat(np.arange(n), k), lived), np.repeat(np.tile(np.arange(k), n), lived)
    step = runs(np.zeros(n * k, np.int64), lived)
    ids: pa.Array = pa.array(np.asarray(track_id)[walker])
    if owners:
        ids = pa.array([owners.get(one, str(one)) for one in track_id.tolist()], pa.string()).take(pa.array(walker))
    columns = {"track_id": ids, "t0": np.asarray(t0, float)[walker]}
    if k > 1:
        columns["sample"] = sample
    if forecast.output in {"modes", "likeliest"}:
        shares = np.exp(forecast.log_fitness[..., -1].astype(float)) * (forecast.steps_alive > 0)
        total = shares.sum(axis=1, keepdims=True)
        columns["probability"] = (shares / np.where(total > 0, total, 1.0))[walker, sample]
    columns["step"] = step + 1
    if step_s is not None:
        columns["t"] = np.round(step_s * columns["step"], 9)
    xy = forecast.xy[walker, sample, step]
    return pa.table({**columns, "x": xy[:, 0], "y": xy[:, 1]})


def in_blocks(
    samples: Samples, which: np.ndarray, start: np.ndarray, steps: int, path: How | None
) -> Iterator[tuple[slice, Forecast]]:
    """`forecast_of` a few tracks after the other, at least once: (which of them, Forecast)."""
    for first in range(0, max(len(which), 1), TRACKS_AT_ONCE):
        these = slice(first, first + TRACKS_AT_ONCE)
        yield these, forecast_of(samples, which[these], start[these], steps, path)
