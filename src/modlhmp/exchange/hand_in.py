"""Forecasts that come from outside for a task: a file of them, and a JSON file of the same name beside it.

    theirs/forecasts.csv     (or .parquet: the long form of `exchange.forecasts`; or .ndjson: `exchange.trajnet`)
    theirs/forecasts.json    {"task": "<the hash in task.json>", "path": "mean"}

Of several datasets each has a folder of its name in it. `path` says how one path comes out of several samples: `mean`,
`likeliest`, or `geometric_median`.
"""

import json
import logging
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.exchange.columns import write_columns
from modlhmp.exchange.forecasts import How, Samples, in_blocks, long_table, read_samples, samples_of
from modlhmp.exchange.task import Task
from modlhmp.exchange.trajnet import predictions_as_lines, read_predictions, write_lines
from modlhmp.forecasting.base import Forecast
from modlhmp.ids import as_written
from modlhmp.settings import check, option
from modlhmp.storage import DataError, refused, write_text

FORMS = (".csv", ".parquet", ".ndjson")
MOST_SHEET_BYTES = 1_000_000
NOBODY_M_S = 10.0  # nobody walks so fast
_LOG = logging.getLogger("modlhmp")


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """The JSON file beside the forecasts."""

    task: str = option(meaning='the hash in `task.json`, its key "task"')
    path: How | None = option(
        None, "how one path comes out of several samples; may be left out where every track has one"
    )


@dataclass(frozen=True)
class HandIn:
    """Forecasts of a task that have passed every check: `file` is theirs, `which` [tasks] each task's, -1 if none."""

    file: Path
    sheet: Sheet
    samples: Samples
    which: np.ndarray
    task: Task

    @property
    def missing(self) -> np.ndarray:
        """Numbers of the tasks without a forecast."""
        return np.flatnonzero(self.which < 0)

    def coverage(self) -> str:
        """How many tasks it answers, in words."""
        missing = self.missing
        text = f"{self.file}: {len(self.which) - len(missing)} of {len(self.which)} tracks have a forecast"
        if not len(missing):
            return text
        shown = ", ".join(map(str, missing[:5])) + (" ..." if len(missing) > 5 else "")
        return (
            f"{text}; without one are {shown}: the paper protocol leaves them out, the complete one scores them as "
            "standing still"
        )

    def forecasts(self, recording: str) -> Iterator[tuple[int, np.ndarray, Forecast]]:
        """(seed, track ids, `Forecast`) of a recording's tracks, a few after the other, as `files.read_forecasts`."""
        ids, steps = self.task.ids[recording], self.task.about["steps"]
        blocks = in_blocks(self.samples, self.which[ids], self.task.start[ids], steps, self.sheet.path)
        for these, forecast in blocks:
            yield 0, self.task.track_id[recording][these], forecast


def hand_in_files(folder: str | Path, dataset: str) -> tuple[Path, Path]:
    """The file of forecasts and the JSON file beside it, of a dataset; `DataError` where there is no such pair."""
    folder = Path(folder)
    within = folder / dataset if (folder / dataset).is_dir() else folder
    if not within.is_dir():
        raise DataError(f"{folder}: no such folder; it holds forecasts such as {folder}/forecasts.csv")
    pairs = [file for file in sorted(within.iterdir()) if file.suffix in FORMS and file.with_suffix(".json").is_file()]
    if len(pairs) != 1:
        found = " and ".join(file.name for file in pairs) or "no such pair"
        raise DataError(
            f"{within}: one file of forecasts ({', '.join(FORMS)}) is needed, with a JSON file of the same name beside "
            f'it, such as forecasts.csv and forecasts.json, {{"task": "...", "path": "mean"}}; there is {found}'
        )
    return pairs[0], pairs[0].with_suffix(".json")


def read_sheet(path: str | Path) -> Sheet:
    """The JSON file of a hand-in."""
    with open(path, "rb") as file:
        text = file.read(MOST_SHEET_BYTES + 1)
    if len(text) > MOST_SHEET_BYTES:
        raise DataError(f"{path}: more than {MOST_SHEET_BYTES:,} bytes, which a sheet of two keys cannot have")
    with refused(f"{path}: cannot be read as JSON", ValueError, RecursionError, remedy="correct it"):
        plain = json.loads(text.decode("utf-8-sig"))
    return check(Sheet, plain, path)


def read_hand_in(folder: str | Path, task: Task) -> HandIn:
    """What lies in a folder for a task; `DataError` names the file, the row, the value and the remedy."""
    about = task.about
    file, beside = hand_in_files(folder, about["dataset"])
    sheet = read_sheet(beside)
    if sheet.task != about["task"]:
        raise DataError(
            f"{beside}: task {sheet.task!r} is another than that of {about['dataset']} here, {about['task']!r}: it is "
            "of other tracks, or of other settings (dataset, observed_rows, time_step_s, horizon_s, cleaning); export "
            "the task again with `modlhmp export-task` and forecast that"
        )
    if file.suffix == ".ndjson":
        rows = read_predictions(file, about["observed_rows"], about["steps"])
        samples = samples_of(rows, file)
    else:
        samples = read_samples(file, about["time_step_s"])
    _check_against(file, samples, about)
    if samples.most > 1 and sheet.path is None:
        raise DataError(
            f"{beside}: there are up to {samples.most} samples of a track; say how one path comes out of them, "
            '"path": "likeliest", "mean" or "geometric_median"'
        )
    _warn_of_jumps(file, samples, task)
    which = np.full(about["tasks"], -1)
    which[samples.track_id] = np.arange(len(samples.track_id))
    return HandIn(file, sheet, samples, which, task)


def _check_against(file: Path, samples: Samples, about: Mapping[str, Any]) -> None:
    """Whether forecasts are of a task's tracks, moments and steps."""
    tasks, steps, step_s = about["tasks"], about["steps"], about["time_step_s"]
    if not len(samples.track_id):
        raise DataError(f"{file}: it has no forecasts")
    known = (samples.track_id >= 0) & (samples.track_id < tasks)
    if not known.all():
        strangers = np.flatnonzero(~known)
        of = int(strangers[samples.line[strangers].argmin()])
        raise DataError(
            f"{file}, row {samples.line[of]}: track_id {samples.name(of)} is not in the task; its tracks are 0 to "
            f"{tasks - 1}, as in its observations{as_written(samples.name(of), map(str, range(tasks)))}"
        )
    if samples.t0.any():
        of = int(np.argmax(samples.t0 != 0))
        raise DataError(
            f"{file}, row {samples.line[of]}: t0 {samples.t0[of]:.16g}: in a task t0 is 0; leave the column out"
        )
    longest = np.maximum.reduceat(samples.steps, samples.first[:-1])
    horizon = f"the task's horizon is {steps} steps of {step_s:g} s, {about['horizon_s']:g} s"
    if longest.max() > steps:
        of = int(np.argmax(longest > steps))
        raise DataError(
            f"{file}: track {samples.track_id[of]}, from row {samples.line[of]} on, has step {longest[of]}: {horizon}; "
            "leave out what is beyond, or forecast by the task's time step"
        )
    if longest.max() < steps:
        raise DataError(
            f"{file}: no sample has a step beyond {longest.max()}: {horizon}; forecast up to it (a sample that ends "
            "before is of somebody who has left)"
        )


def _warn_of_jumps(file: Path, samples: Samples, task: Task) -> None:
    """Warn where a future begins farther from the last observed position than anybody walks in a time step."""
    walker = np.repeat(samples.track_id, np.diff(samples.first))
    away = np.linalg.norm(samples.xy[samples.begin[:-1]] - task.start[walker], axis=1)
    far = np.unique(walker[away > NOBODY_M_S * task.about["time_step_s"]])
    if len(far):
        _LOG.warning(
            "%s: %d of %d tracks, first %d, have a step 1 that is up to %.4g m from where they were seen last: is "
            "everything in m, in the recording's frame?",
            file, len(far), len(samples.track_id), far[0], away.max(),
        )  # fmt: skip


def write_hand_in(
    folder: str | Path,
    task: Task,
    forecasts: Mapping[str, Iterable[tuple[int, np.ndarray, Forecast]]],
    form: str = "csv",
) -> list[Path]:
    """Write forecasts of ours, {recording: as `files.read_forecasts` gives them}, as a hand-in of the task.

    What each method gives as its result is written: one path, its ranked futures, or its modes with probabilities; of
    several seeds the first. Tracks stand in the order of their numbers: that of the recordings tells who came when. A
    file of forecasts that an earlier export left in another form is removed. Returns the files.
    """
    file = Path(folder) / f"forecasts.{form}"
    blocks = [
        (ids, forecast.results) for name, of in forecasts.items() for ids, forecast in _first_seed(task, name, of)
    ]
    most = max((one.xy.shape[1] for _, one in blocks), default=1)
    if form == "ndjson":
        observed, steps, step_s = (task.about[name] for name in ("observed_rows", "steps", "time_step_s"))
        places = sorted(
            (number, at, row) for at, (of, _) in enumerate(blocks) for row, number in enumerate(of.tolist())
        )
        lines: list[str] = []
        for number, at, row in places:
            xy, fitness, alive = (part[row : row + 1] for part in blocks[at][1][:3])
            one, ids = Forecast(xy, fitness, alive, blocks[at][1].output), np.array([number])
            lines += predictions_as_lines(ids, ids, ids * (observed + steps) + observed - 1, one, observed, step_s)
        write_lines(lines, file)
    else:
        tables = [long_table(ids, np.zeros(len(ids)), one) for ids, one in blocks]
        write_columns([pa.concat_tables(tables).sort_by("track_id")], file)
    for suffix in set(FORMS) - {file.suffix}:  # which would pass for forecasts of this task, by the sheet
        file.with_suffix(suffix).unlink(missing_ok=True)
    path = "mean" if any(one.output == "mean" for _, one in blocks) else "likeliest"  # of futures of equal standing
    sheet = {"task": task.about["task"], **({"path": path} if most > 1 else {})}
    write_text(file.with_suffix(".json"), json.dumps(sheet, indent=1) + "\n")
    return [file, file.with_suffix(".json")]


def _first_seed(
    task: Task, name: str, forecasts: Iterable[tuple[int, np.ndarray, Forecast]]
) -> Iterator[tuple[np.ndarray, Forecast]]:
    """(numbers of tasks, Forecast) of the first seed of a recording's forecasts."""
    ids, whose, first, done = task.ids[name], task.track_id[name], None, 0
    for seed, tracks, forecast in forecasts:
        first = seed if first is None else first
        these = slice(done, done + len(tracks))
        if seed != first:
            break
        if not np.array_equal(tracks, whose[these]) or forecast.xy.shape[2] != task.about["steps"]:
            raise DataError(f"{name}: the forecasts are of other tracks, or another horizon, than the task")
        yield ids[these], forecast
        done += len(tracks)
    if done != len(ids):
        raise DataError(f"{name}: there are {done} forecasts for the {len(ids)} tracks of the task; make them again")
