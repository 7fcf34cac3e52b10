"""A look at a recording, or at a dataset file, before any run: what it is, what looks wrong, and a draft to edit."""

import dataclasses
import glob
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from modlhmp.cleaning import source_of
from modlhmp.datasets import Dataset, load_dataset
from modlhmp.file_format import Recording
from modlhmp.forecasting.windows import windows
from modlhmp.inspection.draft import Listed, draft, time_step
from modlhmp.inspection.facts import Facts, look_at, of_both_sides
from modlhmp.inspection.folder import files_in, first_day, under
from modlhmp.inspection.guess import Guess, days_of, guess, guess_people
from modlhmp.inspection.page import page
from modlhmp.inspection.picture import draw, some_tracks, text_map
from modlhmp.inspection.unfit import NoIdsError
from modlhmp.logs import progress
from modlhmp.plausibility import Finding
from modlhmp.readers import read_recording
from modlhmp.scenes import scenes_of
from modlhmp.scoring.errors import truth_of
from modlhmp.scoring.horizons import scored_horizons
from modlhmp.site import MOST_STEP_S
from modlhmp.split_checks import check_splits, trained_share
from modlhmp.storage import DataError, write_text
from modlhmp.tracks import Tracks, clock_hours, empty_tracks, together, usual_step

Table = tuple[str, list[tuple[str, str]]]
# Of a run without networks, from docs/scaling.md: seconds of one core for each 1,000 test tracks and second of horizon,
# and for each MB of raw files, beside what every run takes; memory of the largest job [MB].
_BASE_S, _PER_TRACK_S, _PER_MB_S, _MEMORY_MB = 100.0, 0.07, 0.013, 700


@dataclass
class Inspection:
    """What was found: tables of facts, findings with what they are of, tracks to draw, a draft where there is one."""

    title: str
    tables: list[Table]
    findings: list[tuple[str, Finding]]
    tracks: Tracks
    draft: str = ""
    accept: tuple[str, ...] = ()
    strict: bool = False
    notes: list[str] = field(default_factory=list)
    faults: list[tuple[str, str]] = field(default_factory=list)  # why nothing is left of a recording

    @property
    def stops(self) -> bool:
        """Whether a run would stop."""
        found = [one for _, one in self.findings if one.check not in self.accept]
        return bool(self.faults) or any(one.severity == "stop" or self.strict for one in found)

    def told(self) -> list[tuple[str, str, str]]:
        """The faults and findings as (severity, of what, text)."""
        return [("stop", of, text) for of, text in self.faults] + [
            ("warn" if one.check in self.accept else one.severity, of,
             f"{one}" if one.check not in self.accept else f"{one.check} (accepted): {one.text}")
            for of, one in self.findings
        ]  # fmt: skip

    def summary(self) -> str:
        """All of it as text for a terminal."""
        parts = [self.title, "=" * len(self.title), text_map(self.tracks)]
        for heading, rows in self.tables:
            wide = max((len(name) for name, _ in rows), default=0)
            parts += ["", heading, *(f"  {name.ljust(wide)}  {text}" for name, text in rows)]
        words = {"stop": "LOOKS WRONG", "warn": "WARNING"}
        parts += ["", *(f"{words[severity]}: {of}: {text}" for severity, of, text in self.told())]
        return "\n".join([*parts, *([] if self.told() else ["Nothing looks wrong."]), *self.notes])

    def write(self, folder: str | Path, name: str) -> list[Path]:
        """Write the picture and the page into a folder; the picture is left out without matplotlib."""
        picture, html = Path(folder, f"{name}.inspect.png"), Path(folder, f"{name}.inspect.html")
        files = [picture, html]
        try:
            try:
                draw(self.tracks, self.title, picture)
            except ImportError:
                self.notes.append("No picture: drawing needs matplotlib, pip install 'modlhmp[study]'")
                files = [html]
            shown = picture if picture in files else None
            write_text(html, page(self.title, self.tables, self.told(), shown, self.draft))
        except OSError as error:
            raise DataError(f"{folder}: cannot be written to ({error.strerror}); name a folder by --to") from None
        return files


def inspect_file(path: str | Path, data_root: str | Path = "data") -> Inspection:
    """Guess how a recording, or the recordings in a folder, are written, look at one, and draft the dataset file.

    `data_root` is the folder that the draft's paths are relative to, if the files lie in it. `DataError` where no form
    gives people who move.
    """
    path = Path(path)
    if path.is_dir():
        return _inspect_folder(path, data_root)
    found = guess(path)
    return _drafted(path, found, Recording(name=path.stem, path=str(path), stored=str(path)), [path], data_root)


def _inspect_folder(folder: Path, data_root: str | Path) -> Inspection:
    """The files of a folder as one recording if each is of one person, else as one each, of which the largest shows."""
    files, pattern = files_in(folder)
    people = guess_people(files) if len(files) > 1 else None
    if people is not None:
        recording = Recording(name=folder.name, path=str(folder), stored=str(files[0]), people=tuple(map(str, files)))
        return _drafted(folder, people, recording, [Path(glob.escape(str(folder)), pattern)], data_root)
    largest = max(files, key=lambda file: file.stat().st_size)
    try:
        found = guess(largest)
    except NoIdsError:
        raise DataError(
            f"{largest}: has no column of ids, and is the folder's only file, or others of it hold several people: "
            "give every file a column `id`, or put the files of one person each in a folder of their own; a dataset "
            "file for one such file says `file_is: person`"
        ) from None
    recording = Recording(name=largest.stem, path=str(largest), stored=str(largest))
    return _drafted(folder, found, recording, files, data_root)


def _drafted(
    path: Path, found: Guess, recording: Recording, files: Sequence[Path], data_root: str | Path
) -> Inspection:
    """The inspection of a recording whose form has been guessed; `files` are those that the draft lists."""
    source = source_of(recording.path, found.form, recording)
    rows, _ = read_recording(source, found.form)
    if (step := usual_step(rows)) > MOST_STEP_S:
        raise DataError(
            f"{path}: rows of a person are {step:g} s apart, read with times in {found.form.units.time}; a row every "
            f"{MOST_STEP_S:g} s is needed at least: is that column another unit of time?"
        )
    found.keys["time_step_s"] = time_step(step)
    if found.clock:
        day, days = days_of(rows)
        recording = dataclasses.replace(recording, day=day, days=days)
    facts = look_at(recording.path, found.form, recording, found.clock)
    if facts.fault:
        raise DataError(facts.fault)
    listed = [_listed(file, found, recording, data_root) for file in files]
    but = " but for the days of their first and last lines" if found.clock else ""
    others = f"{len(files) - 1} other files have not been looked at{but}; inspect this draft as well"
    away = (
        f"decide: not under the data root {data_root}, where others have it"
        if Path(listed[0].files).is_absolute()
        else ""
    )
    remark = "; ".join(filter(None, [others if len(files) > 1 else "", away]))
    written = draft(path.resolve().stem, listed, found, facts, remark)
    guessed = [(key, f"{value!r}".strip("'") + (f" ({found.asks[key]})" if key in found.asks else ""))
               for key, value in found.keys.items()]  # fmt: skip
    tables: list[Table] = [("The file, as guessed", guessed), (f"The recording {recording.name}", facts.lines())]
    findings = [(Path(recording.path).name, one) for one in facts.findings]
    notes = [f"Note: {remark}"] if len(files) > 1 else []
    return Inspection(str(path), tables, findings, facts.clean, written, notes=notes)


def _listed(file: Path, found: Guess, recording: Recording, data_root: str | Path) -> Listed:
    """A file as the draft lists it, with its own days where times are of a clock."""
    if not found.clock:
        return Listed(under(file, data_root))
    day, days = (
        (recording.day, recording.days) if recording.people or str(file) == recording.path else first_day(file, found)
    )
    return Listed(under(file, data_root), day, days)


def inspect_dataset(path: str | Path, data_root: str | Path) -> Inspection:
    """Look at every recording of a dataset file, and at its splits; `DataError` where the file is wrong itself."""
    dataset = load_dataset(path, data_root)
    plans = [file for file in dataset.floor_plan if not Path(file).exists()]
    if missing := [one.path for one in dataset.recordings if not one.exists] + plans:
        raise DataError(f"{missing[0]}: no such file; put it there, or name its folder by --data-root")
    tables: list[Table] = []
    findings: list[tuple[str, Finding]] = []
    some: list[Tracks] = []
    looked: list[Facts] = []
    before: Facts | None = None  # the other side of a file that holds both splits
    for one in progress(dataset.recordings, desc=dataset.name):
        file = Path(one.stored, one.member) if one.member else Path(one.path)
        facts = look_at(file, dataset, one, bool(one.day) and one.start is None)
        both_of_a_file = one.chosen is not None and one.chosen.by != "column"  # which reads each side by itself
        if both_of_a_file and before is None:
            before = facts
        else:
            tables.append(_of_recording(before, facts))
            before = None
        named = one.name.removesuffix(f"-{one.split}") if both_of_a_file else one.name
        findings += [(named, found) for found in facts.findings if (named, found) not in findings]
        some.append(some_tracks(facts.clean, max(20, 600 // len(dataset.recordings))))
        looked.append(dataclasses.replace(facts, raw=empty_tracks()))
    findings += [(dataset.name, one) for one in check_splits(((one.recording, one.clean) for one in looked), dataset)]
    tables.insert(0, ("The dataset", _of_dataset(dataset, looked)))
    shown = together(some)
    faults = [(one.recording.name, one.fault) for one in looked if one.fault]
    return Inspection(
        f"{dataset.title} ({path})", tables, findings, shown, "", dataset.accept, dataset.strict, faults=faults
    )


def _of_recording(other: Facts | None, facts: Facts) -> Table:
    """The table of a recording, with its other side if its file holds both splits."""
    one = facts.recording
    day = one.day or "unknown day"
    told = facts.lines() if other is None else of_both_sides(other, facts)
    told += [("fault", each.fault) for each in (other, facts) if each is not None and each.fault]
    if other is None or one.chosen is None:
        return f"{one.name} ({one.split}, {day})", told
    return f"{one.name.removesuffix('-test')} (divided by {one.chosen.by}, {day})", told


def _of_dataset(dataset: Dataset, looked: list[Facts]) -> list[tuple[str, str]]:
    """What is told of all recordings together."""
    tracks = {split: sum(len(one.clean.bounds()) - 1 for one in looked if one.recording.split == split)
              for split in ("train", "test")}  # fmt: skip
    parts = [[one.clean for one in looked if one.recording.split == split] for split in ("train", "test")]
    raw = sum({one.recording.stored: one.megabytes for one in looked}.values())
    seconds = _BASE_S + _PER_MB_S * raw + _PER_TRACK_S / 1000 * tracks["test"] * dataset.horizon_s
    days = {one.recording.day or one.recording.path for one in looked}
    tested = [one for one in looked if one.recording.split == "test"]
    ahead = [windows(one.clean, dataset, scenes_of(one.account)) for one in tested]
    lengths = [truth_of(one.clean, found, dataset)[1] for one, found in zip(tested, ahead, strict=True)]
    steps = np.concatenate([*lengths, np.empty(0, int)])
    by_horizon = {h: int((steps >= round(h / dataset.time_step_s)).sum()) for h in scored_horizons(None, dataset)}
    return [
        ("recordings", f"{len(looked)}, of {len(days)} day{'s' * (len(days) != 1)}, from files of {raw:,.3g} MB"),
        ("tracks", f"{tracks['train']:,} to train on, {tracks['test']:,} to test on"),
        ("forecasts by horizon", ", ".join(f"{horizon:g} s: {count:,}" for horizon, count in by_horizon.items())),
        *_of_hours(dataset, looked),
        ("test rows on the training map", f"{trained_share(*parts):.0%} are in 1 m cells with training rows"),
        ("a run takes", f"about {max(seconds / 60, 1):.0f} min of one core for each seed and {_MEMORY_MB} MB, without "
         "networks, whose trainings take up to an hour each; within a factor of two or three"),
    ]  # fmt: skip


def _of_hours(dataset: Dataset, looked: list[Facts]) -> list[tuple[str, str]]:
    """In which clock hours people trained and are tested; nothing where days are unknown."""
    if dataset.clock == "unknown":
        return []
    trained, tested = (
        sorted({int(hour) for one in looked if one.recording.split == split
                for hour in np.unique(clock_hours(one.clean.t, dataset.timezone))})
        for split in ("train", "test")
    )  # fmt: skip
    mapped = [hour for hour in trained if dataset.listed_hours is None or hour in dataset.listed_hours]
    alone = [hour for hour in tested if hour not in mapped]
    told = f"trained in {', '.join(map(str, trained))}; tested in {', '.join(map(str, tested))}"
    return [("hours", told + (f", without a map of their own in {', '.join(map(str, alone))}" if alone else ""))]
