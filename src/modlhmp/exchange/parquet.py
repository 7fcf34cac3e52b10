"""Our own form of maps: a Parquet file, or a folder of hours; which files a map is made of."""

import re
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa

from modlhmp.kinds import find
from modlhmp.maps.base import DAY, day_file, hour_files
from modlhmp.storage import DataError, read_metadata, read_parquet

PARQUET, MAGIC = "parquet", b"PAR1"
TEXTS = (".csv", ".xml", ".txt")  # endings of others' forms, `exchange.forms`
HOUR = "([01]?[0-9]|2[0-3])"  # in the name of a file
DAY_STEM = Path(DAY).stem


class Ours(NamedTuple):
    """What the files of a map hold: its kind, its site as plain values, the table of the whole day, {hour: table}."""

    kind: str
    site: Any
    whole: pa.Table | None
    hours: dict[int, pa.Table]


def check_one_form(folder: Path, suffix: str) -> set[Path]:
    """The files of a map by hours in a folder; `DataError` where one has another ending than `suffix`."""
    named = re.compile(rf"({HOUR}|{DAY_STEM})({'|'.join(map(re.escape, (f'.{PARQUET}', *TEXTS)))})")
    found = sorted(file for file in folder.glob("*") if named.fullmatch(file.name))
    if other := next((file for file in found if file.suffix != suffix), None):
        raise DataError(
            f"{folder}: {other.name} lies there, of a map in another form than {suffix}; remove that map's files, or "
            "give another folder"
        )
    return set(found)


def is_parquet(path: str | Path, form: str | None = None) -> bool:
    """Whether a map is in our own form: as `form` says, or by its files; what is not there is taken for one.

    `DataError` for a folder with files of maps in two forms.
    """
    path = Path(path)
    if form is not None:
        return form == PARQUET
    if path.is_dir():
        return bool((hour_files(path) or day_file(path)) and check_one_form(path, f".{PARQUET}"))
    if path.suffix == ".parquet" or not path.exists():
        return "{hour}" not in path.name
    with open(path, "rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def about(file: Path) -> dict[str, Any]:
    """What a file of a map says of itself, its kind and its site among that; `DataError` where it does not."""
    found = read_metadata(file)
    if "updated" in found:
        raise DataError(
            f"{file}: a state, what a map of kind {found['updated']} that is kept up to date holds: write its map out, "
            f"`modlhmp map update {file} --out MAP`, or take UpdatedMap.load({str(file)!r}).written()"
        )
    if not {"kind", "site"} <= found.keys():
        raise DataError(f"{file}: lacks its kind and its site; build it again")
    return found


def read_ours(path: str | Path) -> Ours:
    """A map that `Map.save` or the workflow wrote; `DataError` where it is none."""
    path = Path(path)
    files, day = (hour_files(path), day_file(path)) if path.is_dir() else ({}, path)
    if not files and day is None:
        raise DataError(f"{path}: a folder without a map; a map by hours has files such as 09.parquet")
    tables = {hour: read_parquet(file) for hour, file in files.items()}
    whole = None if day is None else read_parquet(day)
    parts = [*files.items(), *([] if day is None else [(None, day)])]
    first = parts[0][1]
    origin = about(first)
    kind = find(origin["kind"])
    if kind.hourly != path.is_dir():
        said = "one file per hour: give the folder that holds them" if kind.hourly else "one file: give that"
        raise DataError(f"{path}: a map of kind {kind.name} is {said}")
    for hour, file in parts:
        if (own := read_metadata(file)) | {"hour": 0} != origin | {"hour": 0} or own.get("hour", hour) != hour:
            raise DataError(
                f"{file}: it is of another map, or of another hour, than its neighbours; build the map again"
            )
    return Ours(kind.name, origin["site"], whole, tables)
