"""Dataset files: one YAML file says how the recordings of one place are read, split, cleaned and shown."""

import dataclasses
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le, MaxLen, MinLen

from modlhmp.cleaning import are_polygons, check_rules
from modlhmp.clock import CLOCK
from modlhmp.file_format import FileFormat, Recording, Split, check_format
from modlhmp.floor_plan import image_of
from modlhmp.readers.files import IN_NAME, check_different, day_in_name, find_files, names_of, recording_at
from modlhmp.readers.raw import ids_of_people
from modlhmp.settings import Seconds, WholeFrom1, check, option
from modlhmp.site import Site, check_site
from modlhmp.splits import FOLDS, check_column
from modlhmp.storage import DataError, boundary
from modlhmp.yaml_file import read_yaml

VALIDATION_DAYS = 0.3
REQUIRED = ("title", "reader", "timezone", "recordings", "horizon_s", "velocity", "citation", "terms")


@dataclass(frozen=True, kw_only=True)
class Files:
    """An entry of `recordings`: files of one day and split."""

    files: str = option(meaning="path or glob under `data_root`; `**` stands for any number of folders, also none")
    day: str | None = option(
        None,
        "local date, such as 2012-10-24, or `in_name` where each file's name has it, such as atc-20121024.csv; not "
        "where the `clock` is unknown",
    )
    start: str | None = option(
        None,
        'local clock time of the file\'s time 0, quoted, such as "09:00", or with its offset from UTC, "02:30+01:00"; '
        "without it times are unix seconds, so files whose times count from 0 need it",
    )
    days: WholeFrom1 = option(1, "how many days it is of, `day` being the first: 2 where it goes on after midnight")
    split: Literal["train", "test"] | Split = option(
        meaning="maps are built from `train`, forecasts scored on `test`; or how the file's people are divided between "
        "the two, such as {by: time, test: 0.25}"
    )


@dataclass(frozen=True, kw_only=True)
class Area:
    """Places that figures of forecasts mark."""

    title: str = option(meaning="name in the figure's key")
    colour: Literal["green", "red", "blue", "orange"] = option(meaning="colour of the area")
    polygons: tuple[Any, ...] = option(
        meaning="lists of corners [x, y], like those of `cleaning`: in pixels if there is a `scale`, else m; from the "
        "local origin, if `origin_m` names one"
    )


@dataclass(frozen=True, kw_only=True)
class Source:
    """A file that may be fetched."""

    url: str = option(meaning="address, http or https")
    file: str = option(meaning="where the download goes, under `data_root`")
    sha256: str | None = option(None, "its SHA-256; without it that of the first download is recorded")


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """What a dataset is called, how it is shown, and where it comes from."""

    title: str = option("", "name shown in tables and figures")
    label: str = option("", "prefix of the exhibits' file names; default: the dataset's name")
    demo: bool = option(False, 'generated recordings; every exhibit then says "demo data"')
    figure_hours: Annotated[tuple[Annotated[int, Ge(0), Le(23)], ...], MaxLen(4)] = option(
        (), "hours whose maps are drawn, at most 4; none: the first, a middle and the last with a map"
    )
    areas: tuple[Area, ...] = option((), "areas that figures of forecasts mark")
    clock: Literal["recorded", "estimated", "unknown"] = option(
        "recorded",
        "whether times of day are known; claims about them are not tested on estimates, and where it is "
        "unknown there are no maps by hours",
    )
    tuned: dict[str, dict[str, Any]] = option(
        {}, "kind or method: options that were chosen on a validation part of this dataset's training recordings"
    )
    sources: tuple[Source, ...] = option((), "files that may be fetched")
    owner_page: str = option("", "page where the recordings can be obtained")
    paper_results: Literal["atc", "edinburgh"] | None = option(
        None, "which of the paper's columns are shown beside ours"
    )
    citation: str = option("", "whom to cite")
    terms: str = option("", "terms of use")


@dataclass(frozen=True, kw_only=True)
class DatasetFile(_Shown, FileFormat, Site):
    """A dataset file, `config/datasets/<name>.yaml`."""

    recordings: Annotated[tuple[Files, ...], MinLen(1)] = option((), "files, and the day and split of each")
    floor_plan: str | None = option(None, "ROS map_server YAML under `data_root`")
    observed_s: Seconds | None = option(
        None,
        "instead of `observed_rows`: that many time steps, so that 3.2 s at 0.4 s are 8 rows; the paper's O_s = 3 s at "
        "1 Hz is 4 rows, since the row at t0 counts, too",
    )


@dataclass(frozen=True, kw_only=True)
class Dataset(_Shown, FileFormat, Site):
    """A dataset as it is used: its recordings found, its defaults filled in."""

    name: str = ""
    fold_of: str = ""  # title of the dataset that it is a fold of
    recordings: tuple[Recording, ...] = ()
    floor_plan: tuple[str, ...] = ()  # the YAML file and its image; empty where there is none

    def of_split(self, split: str | None) -> list[Recording]:
        """Its recordings of one split, or all of them, in the file's order."""
        return [one for one in self.recordings if split in (None, one.split)]

    def recording(self, name: str) -> Recording:
        """The recording of that name."""
        return next(one for one in self.recordings if one.name == name)

    def days(self, split: str) -> dict[str, str]:
        """The day of each recording of a split; one of an unknown day stands for itself."""
        return {one.name: one.day or one.name for one in self.of_split(split)}

    def same_day(self, name: str) -> list[str]:
        """Names of the other recordings of a recording's day: their people were there as well."""
        day = self.recording(name).day
        file = self.recording(name).path
        others = [one for one in self.recordings if one.name != name]
        return [one.name for one in others if one.path == file or (day and one.day == day)]

    def people(self, split: str) -> list[str]:
        """Names of a split's recordings, and of all others of their days: everyone there."""
        names = [name for one in self.of_split(split) for name in (one.name, *self.same_day(one.name))]
        return list(dict.fromkeys(names))


def load_dataset(path: str | Path, data_root: str | Path, demo_root: str | Path | None = None) -> Dataset:
    """Load a dataset file, check it, fill its defaults and resolve its recordings.

    They lie under `data_root`, generated ones under `demo_root` where that is given. A file that does not exist keeps
    the path where it is expected. `DataError` names the file, the key, the value and the remedy.
    """
    with boundary(path, "does not describe a dataset"):
        return _load(path, data_root, demo_root)


def _load(path: str | Path, data_root: str | Path, demo_root: str | Path | None) -> Dataset:
    listed = read_yaml(path, "a dataset file")
    file = check(DatasetFile, listed, path, REQUIRED)
    name = Path(path).stem
    label = file.label or name
    if file.observed_s is not None:
        file = dataclasses.replace(file, observed_rows=_observed_rows(path, file, listed.get("observed_rows")))
    _check_dataset(path, file, label)
    root = Path(os.path.expanduser(demo_root if file.demo and demo_root else data_root))
    recordings = divided(path, _recordings(path, file, root))
    for split in ("train", "test"):
        if not any(one.split == split for one in recordings):
            raise DataError(
                f"{path}: no recording has `split: {split}`; maps need training, scores need test recordings"
            )
    own = {f.name: getattr(file, f.name) for f in dataclasses.fields(file) if f.name != "observed_s"}
    return Dataset(**{
        **own, "name": name, "label": label, "recordings": recordings,
        "floor_plan": _floor_plan_files(file, root),
    })  # fmt: skip


def divided(path: str | Path, recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Recordings whose file holds both splits as one of each; whole days where that is how they are divided.

    `DataError` that names `path`, the dataset file, where nothing would be left for one of the two.
    """
    days = sorted({one.day for one in recordings if one.chosen is not None and one.chosen.by == "day"})
    if len(days) == 1:
        raise DataError(f"{path}: split: {{by: day}}: there is one day only, {days[0] or 'unknown'}; divide it by time")
    found = []
    for one in recordings:
        if one.chosen is None:
            found.append(one)
        elif one.chosen.by == "day":
            share = one.chosen.test if isinstance(one.chosen.test, float) else 0.25
            tested = days[-min(_rounded_up(share * len(days)), len(days) - 1) :]
            found.append(dataclasses.replace(one, chosen=None, split="test" if one.day in tested else "train"))
        else:
            found += [
                dataclasses.replace(one, name=f"{one.name}-{side}", split=side, side=side) for side in ("train", "test")
            ]
    return tuple(found)


def _rounded_up(days: float) -> int:
    """A share of some days as whole ones: 0.28 of 25 are 7, though their product in floats is just above."""
    return max(math.ceil(days - 1e-9), 1)


def validation_part(dataset: Dataset) -> Dataset:
    """The dataset without its test recordings: part of the training recordings stands in for them.

    The last `VALIDATION_DAYS` of the training days, rounded up; a single day is cut by blocks of time
    (`splits.in_validation_blocks`), which gives two recordings of each. What is chosen in such a run has not seen the
    test set.
    """
    training = dataset.of_split("train")
    days = sorted({one.day for one in training})
    if len(days) > 1:
        held = days[-_rounded_up(VALIDATION_DAYS * len(days)) :]
        parts = [dataclasses.replace(one, split="test" if one.day in held else "train") for one in training]
    else:
        splits = {"fit": "train", "validation": "test"}
        parts = [_part(one, part, split) for one in training for part, split in splits.items()]
    return dataclasses.replace(dataset, recordings=tuple(parts))


def tested_between(dataset: Dataset, first: str, last: str) -> Dataset:
    """The dataset with the test recordings of the days from `first` to `last` only; `DataError` where it has none."""
    for day in (first, last):
        _check_day("configuration, test_days", day)
    kept = [one for one in dataset.recordings if one.split != "test" or first <= one.day <= last]
    if not any(one.split == "test" for one in kept):
        days = sorted(set(dataset.days("test").values()))
        raise DataError(
            f"configuration, test_days: dataset {dataset.name} has no test recording from {first} to {last}; its test "
            f"days are {days[0]} to {days[-1]}"
        )
    return dataclasses.replace(dataset, recordings=tuple(kept))


def folds(dataset: Dataset) -> list[Dataset]:
    """The dataset `FOLDS` times, the test recordings dealt out: each time all else but their contemporaries trains.

    Test days are dealt where there are `FOLDS` or more, and all of the other days' people train. Fewer days are cut by
    blocks of time (`splits.in_part`). All folds together test the dataset's own test tracks, once each.
    """
    days = sorted({one.day for one in dataset.of_split("test")})
    found = []
    for fold in range(1, FOLDS + 1):
        if len(days) >= FOLDS:
            out = days[fold - 1 :: FOLDS]
            named = [one for one in dataset.recordings if one.day not in out or one.split == "test"]
            parts = [dataclasses.replace(one, split="test" if one.day in out else "train") for one in named]
        else:
            there = [one for one in dataset.recordings if one.day in days]
            parts = [one for one in dataset.recordings if one.day not in days]
            parts += [_part(one, f"without-{fold}", "train") for one in there]
            parts += [_part(one, f"fold-{fold}", "test") for one in there if one.split == "test"]
        found.append(
            dataclasses.replace(
                dataset, name=f"{dataset.name}-{fold}", label=f"{dataset.label}-{fold}", fold_of=dataset.title,
                title=f"{dataset.title}, fold {fold} of {FOLDS}", recordings=tuple(parts),
            )
        )  # fmt: skip
    return found


def _part(recording: Recording, part: str, split: str) -> Recording:
    """A part of a recording (`splits.in_part`) as one of its own."""
    return dataclasses.replace(recording, name=f"{recording.name}-{part}", part=part, split=split)


def _observed_rows(path: str | Path, file: DatasetFile, also: object) -> int:
    """The rows of a file's `observed_s`; `also` is the `observed_rows` that it gives besides, None if none."""
    seconds, step_s = file.observed_s or 0.0, file.time_step_s
    rows = seconds / step_s
    if also is not None:
        raise DataError(f"{path}: observed_s {seconds:g} and observed_rows: {also} are both given; keep one of them")
    if abs(rows - round(rows)) > 1e-6:
        near = " or ".join(f"{max(count, 2) * step_s:g}" for count in (math.floor(rows), math.ceil(rows)))
        raise DataError(f"{path}: observed_s {seconds:g} is no whole number of steps of {step_s:g} s; write {near}")
    if round(rows) < 2:
        raise DataError(f"{path}: observed_s {seconds:g} is 1 row of {step_s:g} s; a velocity takes two rows")
    return round(rows)


def _check_dataset(path: str | Path, file: DatasetFile, label: str) -> None:
    """Checks that types cannot say; `DataError`."""
    _check_files(path, file)
    check_site(file, path)
    if not re.fullmatch(r"[A-Za-z0-9_-]{1,100}", label):
        raise DataError(
            f"{path}: name the file with letters, digits, _ and - only, at most 100, or give it a `label` of these"
        )
    check_rules(file.cleaning, path)
    for area in file.areas:
        if not are_polygons(area.polygons):
            raise DataError(f"{path}: area {area.title}: polygons must be lists of at least three [x, y] corners")
    for source in file.sources:
        if not re.match("https?://", source.url):
            raise DataError(f"{path}: sources: {source.url!r} is no address that begins with http:// or https://")
        if Path(source.file).is_absolute() or ".." in Path(source.file).parts:
            raise DataError(f"{path}: sources: file {source.file!r} is not below `data_root`; name a file there")
        if source.sha256 is not None and not re.fullmatch("[0-9a-f]{64}", source.sha256):
            raise DataError(f"{path}: sources: sha256 {source.sha256!r} is not 64 hexadecimal digits")


def _check_files(path: str | Path, file: DatasetFile) -> None:
    """Whether the reader is told all that it needs."""
    check_format(file, path)
    if file.velocity == "as_recorded" and not file.has_velocity:
        raise DataError(f"{path}: velocity: as_recorded needs speed and heading columns; use velocity: differences")
    for entry in file.recordings:
        if isinstance(entry.split, Split):
            _check_split(path, entry.split, file)
        if file.clock == "unknown":
            if entry.day or entry.start:
                raise DataError(
                    f"{path}: recordings: the `clock` is unknown, so there is no day or start: leave them out"
                )
            continue
        if not entry.day:
            raise DataError(
                f"{path}: recordings: {entry.files}: give the `day`, such as 2012-10-24, or set `clock: unknown`"
            )
        if not file.has_clock and not entry.start:
            raise DataError(
                f'{path}: the files have no clock; every entry of `recordings` needs a `start`, such as "09:00"'
            )
        if entry.start is not None and file.units.time == "iso":
            raise DataError(
                f"{path}: recordings: start {entry.start!r}: times are of a clock already (`iso`): leave it out"
            )
        if entry.start is not None and not CLOCK.fullmatch(entry.start):
            raise DataError(f'{path}: recordings: start {entry.start!r} is no clock time such as "09:00"')


def _check_split(path: str | Path, split: Split, file: FileFormat) -> None:
    """Whether a split says all that it needs."""
    where = f"{path}: recordings: split"
    if split.by == "column" and file.reader not in ("delimited", "text"):
        raise DataError(
            f"{where}: {{by: column}} is for the readers delimited and text, not for {file.reader}; divide by time"
        )
    if split.by == "column" and (split.column is None or not isinstance(split.test, tuple)):
        raise DataError(f"{where}: {{by: column}} needs `column`, and in `test` the texts that mean so, such as [test]")
    if split.by != "column" and isinstance(split.test, tuple):
        raise DataError(f"{where}: test {list(split.test)}: with `by: {split.by}` give a share, such as 0.25")
    check_column(where, split, file)


def _floor_plan_files(file: DatasetFile, data_root: str | Path) -> tuple[str, ...]:
    """The YAML file of the floor plan and its image (if the YAML is there); empty where there is none."""
    if file.floor_plan is None:
        return ()
    plan = Path(data_root) / file.floor_plan
    if file.demo:  # made by the workflow
        return str(plan), str(plan.with_suffix(".pgm"))
    try:
        there = plan.exists()
    except OSError as error:
        raise DataError(f"{plan}: cannot be looked for ({error.strerror}); correct `floor_plan`") from None
    if not there:  # asked for like a missing recording
        return (str(plan),)
    if not image_of(plan).exists():
        raise DataError(f"{plan}: image {image_of(plan)} does not exist; put it there, or correct `image`")
    return str(plan), str(image_of(plan))


def _recordings(path: str | Path, file: DatasetFile, root: Path) -> tuple[Recording, ...]:
    """The recordings that the entries stand for, each with its own name."""
    found, each = list[Recording](), list[Recording]()
    for entry in file.recordings:
        files = find_files(path, entry.files, root)
        made = [recording_at(one, root) for one in files]
        each += made
        if file.file_is == "person":
            ids_of_people(files)  # before a run has begun
            made = [dataclasses.replace(made[0], path=str(root / entry.files), people=tuple(map(str, files)))]
        days = [day_in_name(path, file) if entry.day == IN_NAME else entry.day for file in files[: len(made)]]
        for day in days:
            _check_day(path, day)
        split, chosen = (entry.split, None) if isinstance(entry.split, str) else ("", entry.split)
        found += [
            dataclasses.replace(one, day=day or "", start=entry.start, days=entry.days, split=split, chosen=chosen)
            for one, day in zip(made, days, strict=True)
        ]
    check_different(path, each, found)
    names = names_of(path, found)
    return tuple(dataclasses.replace(one, name=name) for one, name in zip(found, names, strict=True))


def _check_day(path: str | Path, day: str | None) -> None:
    try:
        if day and not re.fullmatch(r"\d{4}-\d\d-\d\d", day):
            raise ValueError
        date.fromisoformat(day or "1970-01-01")
    except ValueError:
        raise DataError(f"{path}: day {day!r} is not a date like 2012-10-24") from None
