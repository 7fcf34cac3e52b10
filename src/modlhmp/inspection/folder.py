"""Files of a folder that may be recordings, how a dataset file lists them, and their days."""

import os
from collections import Counter
from pathlib import Path

import numpy as np

from modlhmp.inspection.guess import Guess, days_of
from modlhmp.inspection.roles import values_of
from modlhmp.inspection.sheet import first_lines, last_lines, read_sheet
from modlhmp.readers import read_recording
from modlhmp.readers.delimited import SECONDS
from modlhmp.readers.raw import COMPRESSED
from modlhmp.storage import DataError
from modlhmp.tracks import empty_tracks

_NEVER = {"", ".yaml", ".yml", ".json", ".md", ".rst", ".pdf", ".png", ".jpg", ".jpeg", ".pgm", ".html", ".py", ".log"}


def files_in(folder: Path) -> tuple[list[Path], str]:
    """The files of the commonest kind in a folder or, if it has none, below it; and the glob for them.

    `DataError` where there are none.
    """
    for pattern in ("*", "**/*"):
        files = sorted(one for one in folder.glob(pattern) if one.is_file() and not one.name.startswith("."))
        kinds = Counter(kind for one in files if (kind := _suffix(one)) not in _NEVER)
        if kinds:
            kind, _ = max(kinds.items(), key=lambda item: item[1])
            return [one for one in files if _suffix(one) == kind], pattern + kind
    raise DataError(f"{folder}: holds no file that could be a recording; name one")


def _suffix(file: Path) -> str:
    """The suffix of a file, with that of its compression."""
    return "".join(file.suffixes[-2:]) if file.suffix in COMPRESSED else file.suffix


def under(file: Path, data_root: str | Path) -> str:
    """A file's path under the data root, also where a link in there leads to it; else the whole path."""
    root = os.path.expanduser(data_root)
    for true_path in (os.path.abspath, os.path.realpath):
        if Path(true_path(file)).is_relative_to(true_path(root)):
            return os.path.relpath(true_path(file), true_path(root))
    return os.path.abspath(file)


def first_day(file: Path, found: Guess) -> tuple[str, int]:
    """The first day of a recording of a known form whose times are of a clock, and how many days.

    By the first and the last rows of a table, of which nothing else is looked at.
    """
    if "columns" not in found.keys:
        return days_of(read_recording(file, found.form)[0])
    sheet = read_sheet(file, first_lines(file) + last_lines(file))
    column = found.keys["columns"]["t"]
    if isinstance(column, str) and column not in sheet.names:
        raise DataError(
            f"{file}: has no column {column!r}, as the largest file of the folder has; inspect it by itself"
        )
    clock = values_of(sheet).numbers[:, column if isinstance(column, int) else sheet.names.index(column)]
    t = clock[np.isfinite(clock)] * SECONDS.get(found.form.units.time, 1.0)
    try:
        return days_of(empty_tracks()._replace(t=t))
    except (ValueError, OverflowError, OSError):  # no times at all, or of no year that there is
        raise DataError(
            f"{file}: times in column {column!r} are none in {found.form.units.time}, as those of the largest file of "
            "the folder are; inspect it by itself"
        ) from None
