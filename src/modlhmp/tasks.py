"""Tasks of dataset files: export one, and score what comes back, without a run of the workflow."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.datasets import Dataset, load_dataset, validation_part
from modlhmp.exchange.hand_in import HandIn, read_hand_in, write_hand_in
from modlhmp.exchange.task import Task, make_task, write_task
from modlhmp.forecasting.files import read_forecasts
from modlhmp.recordings import clean, clean_with_scenes
from modlhmp.scoring.errors import nan_mean
from modlhmp.scoring.horizons import scored_horizons
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.recording import score_recording
from modlhmp.storage import DataError, column

Split = Literal["test", "validation", "train"]


class Row(NamedTuple):
    """Mean errors [m] at one horizon under one protocol, of `n` tracks of the `eligible`."""

    protocol: str
    output: str
    horizon_s: float
    ade_m: float
    fde_m: float
    n: int
    eligible: int


def export_task(
    dataset: str | Path,
    folder: str | Path,
    data_root: str | Path,
    *,
    split: Split = "test",
    form: str = "csv",
    neighbours: bool = False,
    training: bool = False,
    forecasts: str | Path | None = None,
) -> tuple[Task, list[Path]]:
    """Write the task of a dataset file's test tracks into a folder; returns it and the files (`exchange.task`).

    `split` "validation" is what `evaluate_on: validation` tests on, "train" the training tracks. `neighbours` tells who
    else was near, and with it more than one task should (`task.json` says what). `training` adds the tracks to train
    on, which would be the answers where `split` is "train", so that is refused. `forecasts`, a folder of forecasts of
    the workflow, are written in the form of a hand-in. `DataError` names what is wrong.
    """
    if training and split == "train":
        raise DataError(
            "training: with split 'train' the training tracks are what is asked for, so they would give the answers "
            "away: leave training out, or export split 'test' or 'validation'"
        )
    used = _dataset(dataset, data_root, split)
    task = task_of(used, split, neighbours)
    train = (clean(used, one) for one in used.of_split("train")) if training else None
    files = write_task(task, folder, form, train)
    if forecasts is not None:
        of = {name: Path(forecasts, f"{name}.parquet") for name in task.ids}
        if missing := [file for file in of.values() if not file.exists()]:
            raise DataError(f"{missing[0]}: no such file; give the folder of a method's forecasts of this dataset")
        files += write_hand_in(folder, task, {name: read_forecasts(file) for name, file in of.items()}, form)
    return task, files


def task_of(dataset: Dataset, split: Split = "test", neighbours: bool = False) -> Task:
    """The task of a dataset's recordings of a split; they are read and cleaned for it."""
    return make_task(
        (
            (
                one.name,
                *clean_with_scenes(dataset, one),
                [clean(dataset, dataset.recording(other)) for other in dataset.same_day(one.name)]
                if neighbours
                else None,
            )
            for one in _tested(dataset, split)
        ),
        dataset,
        dataset.name,
    )


def score_hand_in(
    folder: str | Path, dataset: str | Path, data_root: str | Path, split: Split = "test"
) -> tuple[HandIn, list[Row]]:
    """Check the forecasts in a folder for the task of a dataset file, and score them as a run would."""
    used = _dataset(dataset, data_root, split)
    tested = {one.name: clean_with_scenes(used, one) for one in _tested(used, split)}
    handed = read_hand_in(folder, make_task(((name, *one, None) for name, one in tested.items()), used, used.name))
    tables = [
        score_recording(tracks, handed.forecasts(name), name, used, scenes=scenes)
        for name, (tracks, scenes) in tested.items()
    ]
    return handed, rows_of(tables, scored_horizons(None, used), used.time_step_s)


def rows_of(tables: Sequence[pa.Table], horizons_s: Sequence[float], step_s: float) -> list[Row]:
    """Means over the tracks of tables of `score_recording` at some horizons, protocol by protocol."""
    table = pa.concat_tables(tables).combine_chunks()
    of = np.array(list(zip(table["protocol"].to_pylist(), table["output"].to_pylist(), strict=True)))
    lengths = column(table, "eligible_steps")
    ade, fde = (column(table, name).reshape(len(table), -1) for name in ("ade", "fde"))
    found = []
    for protocol, output in sorted(np.unique(of, axis=0).tolist(), key=lambda one: PROTOCOLS.index(one[0])):
        mine = (of == (protocol, output)).all(axis=1)
        for horizon_s in horizons_s:
            step = round(horizon_s / step_s) - 1
            means = [float(nan_mean(one[mine, step], axis=0)) for one in (ade, fde)]
            n, eligible = int(np.isfinite(ade[mine, step]).sum()), int((lengths[mine] > step).sum())
            found.append(Row(protocol, output, horizon_s, means[0], means[1], n, eligible))
    return found


def _dataset(file: str | Path, data_root: str | Path, split: Split) -> Dataset:
    """A dataset file as it is used for a split."""
    if split not in ("test", "validation", "train"):
        raise DataError(f"split {split!r}: there are test, validation, train")
    dataset = load_dataset(file, data_root)
    return validation_part(dataset) if split == "validation" else dataset


def _tested(dataset: Dataset, split: Split) -> list:
    return dataset.of_split("train" if split == "train" else "test")
