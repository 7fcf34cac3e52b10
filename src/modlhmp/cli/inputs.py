"""What verbs read and write: tracks in any form that is beyond doubt, streams, tables."""

import contextlib
import json
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import typer

from modlhmp.api import Map, load_map
from modlhmp.arguments import STEPS_APART, site_from, site_of_tracks
from modlhmp.cleaning import clean_recording, tell_of_faults
from modlhmp.exchange.tracks import NEEDED, RECORDED, read_tracks_table
from modlhmp.file_format import FileFormat, Recording
from modlhmp.kinds import all_kinds
from modlhmp.settings import as_plain, check
from modlhmp.site import Site
from modlhmp.storage import DataError, no_folder
from modlhmp.tracks import Tracks, owner_ids, owner_texts, usual_step

STREAM = "-"
SAME = 1e-3  # of two time steps that are said, relative
OF_FILES = {
    *(".csv", ".html", ".json", ".jsonl", ".ndjson", ".npz", ".parquet", ".pdf", ".png", ".svg", ".txt", ".xml"),
    *(".yaml", ".yml"),
}


def named_values(given: list[str] | None, here: Mapping[str, str]) -> dict[str, Any]:
    """What `--set NAME=VALUE` gave, as {name: value}: a number, true, false, null or a word; x=-60,80 is a list.

    `here` are arguments of the function that takes the values which are no options of a kind, and how this verb is told
    of them (empty: not at all); they are refused. Whether there is such an option, and its type, is checked where it is
    used.
    """
    found: dict[str, Any] = {}
    for one in given or []:
        name, mark, value = one.partition("=")
        if not mark or not name:
            raise typer.BadParameter(f"--set {one!r}: give NAME=VALUE, such as k=20")
        if name in here:
            told = f"here that is {here[name]}" if here[name] else "that is no option, `modlhmp kinds NAME` lists them"
            raise DataError(f"--set {one}: {told}")
        try:
            found[name] = json.loads(f"[{value}]" if "," in value else value)
        except (ValueError, RecursionError):
            found[name] = value
    return found


def with_exits(given: dict[str, Any], ways_out: Path | None) -> dict[str, Any]:
    """What `--set` gave with the map of `--exits FILE`, beside which exits=true and exits=false are all it may say."""
    if "exits" in given and (ways_out is not None or not isinstance(given["exits"], bool)):
        raise DataError(f"--set exits={given['exits']}: here that is --exits FILE")
    return given if ways_out is None else {**given, "exits": load_map(ways_out)}


class Walkers(NamedTuple):
    """Tracks, {track id: the owner's id} of those that differ, whether the file has speeds itself, and the site.

    The site is the dataset file's; of other files it is known by the time step alone.
    """

    tracks: Tracks
    owners: dict[int, str]
    recorded: bool
    site: Site


def read_walkers(path: str, time_step_s: float | None, data_root: Path, in_doubt: str = "") -> Walkers:
    """Tracks of a file by the `time_step_s`; None: by that of the dataset file or clean recording, of others 1 s.

    `in_doubt`: refuse files that would be brought to 1 s only because no step was said; the text ends the message.

    A table with columns track_id, t, x, y (`exchange.tracks`) is taken as it is where its rows are a time step apart,
    as is a clean recording (.parquet); else it is cleaned, as are the recordings of a dataset file (.yaml), which lie
    under `data_root`, and any other file whose form can be guessed without doubt; `DataError` says what is in doubt.
    "-" is standard input.
    """
    with file_of(path) as (file, shown):
        if is_dataset(path):
            from modlhmp.datasets import load_dataset  # noqa: PLC0415 - the rest of the library
            from modlhmp.recordings import clean_all  # noqa: PLC0415

            dataset = load_dataset(file, data_root)
            _check_step(shown, dataset.time_step_s, time_step_s, (1 - SAME, 1 + SAME))
            return Walkers(*clean_all(dataset), dataset.has_velocity, site_from(as_plain(dataset), path))
        if file.suffix == ".parquet":
            tracks, names = read_tracks_table(file)
            site = site_of_tracks(shown, tracks)
            _check_step(shown, usual_step(tracks), time_step_s)
            return Walkers(tracks, names | owner_ids(file), _has_speeds(tracks), site)
        in_doubt = in_doubt if time_step_s is None else ""
        time_step_s = Site().time_step_s if time_step_s is None else time_step_s
        site = Site(time_step_s=time_step_s)
        try:
            if set(NEEDED) <= set(_header(file)):
                tracks, names = read_tracks_table(file)
                step = usual_step(tracks)
                if np.isnan(step) or STEPS_APART[0] <= step / time_step_s <= STEPS_APART[1]:
                    return Walkers(tracks, names, _has_speeds(tracks), site)
                if in_doubt:
                    raise DataError(f"{shown}: rows every {step:.4g} s, and {in_doubt}")
                typer.echo(f"{shown}: rows every {step:.4g} s, brought to a row every {time_step_s:g} s", err=True)
            if in_doubt:
                raise DataError(f"{shown}: it is to be brought to a time step, and {in_doubt}")
            form = _form_of(file, shown, time_step_s)
            tracks, account = clean_recording(file, form, Recording())
        except DataError as error:
            raise DataError(str(error).replace(str(file), shown)) from None
        tell_of_faults(shown, account)
        return Walkers(tracks, owner_texts(account.get("owners", {})), form.has_velocity, site)


def _check_step(shown: str, step_s: float, wanted_s: float | None, within: tuple[float, float] = STEPS_APART) -> None:
    """`DataError` where tracks that are taken as they are have another time step than is wanted."""
    if wanted_s is not None and not (np.isnan(step_s) or within[0] <= step_s / wanted_s <= within[1]):
        raise DataError(
            f"{shown}: its time step is {step_s:.4g} s, {wanted_s:g} s is needed, that of the map, of the forecasts or "
            "of --time-step: give the recording itself, which is brought to it, or what has the file's time step"
        )


def _has_speeds(tracks: Tracks) -> bool:
    return bool(np.isfinite(tracks.speed).any())


def check_file(option: str, path: str | Path, *endings: str) -> None:
    """`DataError` where the name of a file that is to be written says another form; asked before the work."""
    if Path(path).suffix not in endings:
        named = [one for one in endings if one]
        listed = " or ".join([", ".join(named[:-1]), named[-1]] if named[1:] else named)
        raise DataError(f"{option} {path}: the name must end in {listed}")


def check_folder(option: str, path: str | Path, what: str) -> None:
    """The same of a folder, which is `what`."""
    if (suffix := Path(path).suffix).lower() in OF_FILES:
        raise DataError(f"{option} {path}: {what} is a folder; give a name without {suffix}")


def is_dataset(path: str | Path) -> bool:
    """Whether a file is a dataset file, by its name."""
    return Path(path).suffix in {".yaml", ".yml"}


def map_or_kind(by: str) -> Map | str:
    """The map that lies at `by`, or the name of a kind that needs none; `DataError`."""
    kind = None if Path(by).exists() else all_kinds().get(by)
    if kind is None:
        return load_map(by)
    if kind.has_map:
        raise DataError(
            f"--map {by}: a kind of map, not a map: build one by `modlhmp map build {by}`, or name its file"
        )
    return by


@contextlib.contextmanager
def file_of(path: str) -> Iterator[tuple[Path, str]]:
    """The file at a path and how messages call it; of "-" a copy of standard input, for as long as it is needed."""
    if path != STREAM:
        no_folder(path)
        if not Path(path).is_file():
            raise DataError(f"{path}: no such file")
        yield Path(path), path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "standard-input.csv")
        with copy.open("wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file)
        yield copy, "standard input"


def _form_of(file: Path, shown: str, time_step_s: float) -> FileFormat:
    """How a file of tracks is written, if that is beyond doubt."""
    names = _header(file)
    if set(NEEDED) <= set(names):
        columns = [*NEEDED, *(RECORDED if set(RECORDED) <= set(names) else ())]
        plain = {"columns": {name: name for name in columns}, "header": True, "time_step_s": time_step_s}
        return check(FileFormat, plain, shown)
    from modlhmp.inspection.guess import guess  # noqa: PLC0415 - only files of others need it

    remedy = (
        "call the columns track_id, t, x, y (s, m), or describe the file once, `modlhmp inspect FILE > form.yaml`, and "
        "give that in its place"
    )
    try:
        found = guess(file)
    except DataError as error:
        raise DataError(f"{error}; {remedy}") from None
    if found.asks:
        doubts = "; ".join(f"{key}: {why}" for key, why in found.asks.items())
        raise DataError(f"{shown}: how it is written is in doubt ({doubts}): {remedy}")
    columns = found.keys.get("columns", {})
    taken = ", ".join(f"{role} = {column}" for role, column in columns.items()) or found.keys["reader"]
    for told in (f"read as {taken}, brought to a row every {time_step_s:g} s", *found.notes):
        typer.echo(f"{shown}: {told}", err=True)
    return check(FileFormat, {**found.keys, "time_step_s": time_step_s}, shown)


def _header(file: Path) -> list[str]:
    """The fields of a file's first line; nothing if it cannot be read, of which others tell."""
    try:
        with file.open(encoding="utf-8-sig", errors="replace") as lines:
            return [name.strip().strip('"') for name in lines.readline(4096).split(",")]
    except OSError:
        return []
