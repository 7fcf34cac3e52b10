"""What verbs read and write: tracks in any form that is beyond doubt, streams, tables."""

import contextlib
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from modlhmp.cleaning import clean_recording
from modlhmp.file_format import FileFormat, Recording
from modlhmp.settings import check
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, owner_ids, owner_texts, read_tracks

STREAM = "-"
OWN = ("track_id", "t", "x", "y")  # columns that say what they are: s, m
RECORDED = ("speed", "heading")  # likewise: m/s, rad


def read_walkers(path: str, time_step_s: float) -> tuple[Tracks, dict[int, str]]:
    """Clean tracks of a file by the `time_step_s`, and the owner's ids that are no plain numbers.

    A table with columns track_id, t, x, y (s, m; maybe speed, heading) is read as that, a clean recording (.parquet) as
    it is, a dataset file (.yaml) by what it says. Of any other file the form is guessed as `modlhmp inspect` does, and
    `DataError` says what is in doubt. "-" is standard input.
    """
    with file_of(path) as (file, shown):
        if file.suffix in {".yaml", ".yml"}:
            from modlhmp.api import read_tracks as read_any  # noqa: PLC0415 - the rest of the library

            return read_any(file), {}
        if file.suffix == ".parquet":
            return read_tracks(file), owner_ids(file)
        try:
            form = _form_of(file, shown, time_step_s)
            tracks, account = clean_recording(file, form, Recording())
        except DataError as error:
            raise DataError(str(error).replace(str(file), shown)) from None
        return tracks, owner_texts(account.get("owners", {}))


@contextlib.contextmanager
def file_of(path: str) -> Iterator[tuple[Path, str]]:
    """The file at a path and how messages call it; of "-" a copy of standard input, for as long as it is needed."""
    if path != STREAM:
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
    if set(OWN) <= set(names):
        columns = [*OWN, *(RECORDED if set(RECORDED) <= set(names) else ())]
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
        doubts = "; ".join(f"{key}: {found.keys.get(key)!r}, {why}" for key, why in found.asks.items())
        raise DataError(f"{shown}: how it is written is in doubt ({doubts}): {remedy}")
    return check(FileFormat, {**found.keys, "time_step_s": time_step_s}, shown)


def _header(file: Path) -> list[str]:
    """The fields of a file's first line; nothing if it cannot be read, of which others tell."""
    try:
        with file.open(encoding="utf-8-sig", errors="replace") as lines:
            return [name.strip().strip('"') for name in lines.readline(4096).split(",")]
    except OSError:
        return []
