"""Other people's forms of maps, read and written; `forms` lists them."""

import hashlib
import json
import logging
import re
from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.exchange import stef_forms
from modlhmp.exchange.forms import FORMS, Form, Repaired, find_form, recognise
from modlhmp.exchange.parquet import DAY_STEM, HOUR, PARQUET, about, check_one_form, is_parquet
from modlhmp.exchange.rows import Source
from modlhmp.exchange.rows import read_source as read_stream
from modlhmp.kinds import find
from modlhmp.maps import stef
from modlhmp.maps.base import day_file, hour_files
from modlhmp.settings import check
from modlhmp.site import Site
from modlhmp.storage import DataError, boundary, read_parquet, write_text

Tables = tuple[str, pa.Table | None, dict[int, pa.Table]]  # kind, of the whole day, {hour: of that hour}
IMPORTED = b"imported"  # in a table's metadata: JSON of the file, its SHA-256, its form, and what was repaired
_LOG = logging.getLogger("modlhmp")


def hour_sources(path: str | Path) -> dict[int | str, Path]:
    """{hour, or `day`: file} of a folder whose files are named so (9.csv, 09.csv, day.csv); {} of a plain file.

    `{hour}` in a file's name stands for the hour where the names hold more. `DataError` where there is none.
    """
    path = Path(path)
    if not path.is_dir() and "{hour}" not in path.name:
        return {}
    folder, name = (path, "{hour}.*") if path.is_dir() else (path.parent, path.name)
    pattern = re.escape(name).replace(re.escape("{hour}"), HOUR).replace(re.escape("*"), "[a-z]+")
    found: dict[int | str, Path] = {}
    for file in sorted(folder.glob("*")):
        if matched := re.fullmatch(pattern, file.name):
            hour = int(matched[1])
            if hour in found:
                raise DataError(f"{file}: hour {hour} has a file already, {found[hour].name}; remove one of them")
            found[hour] = file
        elif path.is_dir() and file.stem == DAY_STEM:
            found[DAY_STEM] = file
    # A day beside files that may be hours by names of others is not all of a map.
    of_day = found.get(DAY_STEM) if len(found) == 1 else None
    if not found or (of_day and any(file != of_day for file in folder.glob(f"*{of_day.suffix}"))):
        what = "a folder without a map" if path.is_dir() else "there are no such files"
        raise DataError(f"{path}: {what}; a map by hours has files such as 09.parquet or 09.csv, or give {{hour}}.csv")
    return found


def map_files(path: str | Path) -> list[Path]:
    """The files of a map, ours or foreign; `DataError` where there are none."""
    path = Path(path)
    ours = [*hour_files(path).values(), *filter(None, [day_file(path)])] if path.is_dir() else []
    return ours or list(hour_sources(path).values()) or [path]


def kind_in(path: str | Path, form: str | None = None) -> str:
    """The kind of the map that a file or folder holds, from a look at its first file."""
    with boundary(path, "cannot be read as a map"):
        return _kind_in(Path(path), form)


def _kind_in(path: Path, form: str | None) -> str:
    first = map_files(path)[0]
    if is_parquet(path, form):
        read_parquet(first, [])
        return str(about(first)["kind"])
    source = read_source(first)
    record = find_form(form or recognise(source))
    return record.kinds[0 if first == path else -1]


def read_tables(
    path: str | Path,
    form: str | None = None,
    site: Site | None = None,
    origin_m: tuple[float, float] | None = None,
    **how: Any,
) -> Tables:
    """Kind and tables of a map in a foreign form: a file, or a file for each hour (`hour_sources`).

    `form` is recognised where it is unmistakable. Without a `site` hours are those of UTC, with a warning. `origin_m`
    is the origin of the recordings in the map's frame, as dataset files have it. `how` are the form's own options. What
    was repaired is logged once for a file, and kept in the table's metadata. `DataError` names the file, the row, the
    value and the remedy.
    """
    with boundary(path, "cannot be read as a map"):
        return _read_tables(path, form, site, origin_m, how)


def _read_tables(
    path: str | Path, form: str | None, site: Site | None, origin_m: Any, how: Mapping[str, Any]
) -> Tables:
    files = hour_sources(path)
    origin = origin_of(origin_m)
    if not files:
        source = read_source(path, origin)
        return read_one(source, form or recognise(source), site, how)
    sources = {hour: read_source(file, origin) for hour, file in files.items()}
    names = {hour: form or recognise(source) for hour, source in sources.items()}
    if PARQUET in names.values():
        raise DataError(f"{path}: Parquet files of hours are named 09.parquet")
    if len(set(names.values())) > 1:
        raise DataError(f"{path}: files of several forms, {', '.join(sorted(set(names.values())))}: of several maps?")
    record = find_form(next(iter(names.values())))
    if record.read is None:
        raise DataError(f"{path}: a map of form {record.name} is one file for all hours: give that")
    tables = {hour: _table(record, source, how) for hour, source in sources.items()}
    whole = tables.pop(DAY_STEM, None)
    kind = record.kinds[-1]
    if kind == "stef" and whole is not None:
        whole = stef_forms.constant(whole)
    if tables and site is None:
        tell_of_zone(path)
    return kind, whole, {hour: tables[hour] for hour in sorted(tables)}  # type: ignore[type-var, misc]


def tell_of_zone(where: object, verb: str = "convert") -> None:
    """Neither tracks nor a foreign form say of which time zone their hours are; `verb` of `modlhmp map` takes it."""
    _LOG.warning(
        "%s: its hours are taken for those of UTC; say whose they are: site=modlhmp.Site(timezone=...), or "
        "`modlhmp map %s --timezone NAME`", where, verb,
    )  # fmt: skip


def read_one(source: Source, form: str, site: Site | None, how: Mapping[str, Any]) -> Tables:
    """The same of one file's content."""
    record = find_form(form)
    if site is None:
        if record.read is None:
            tell_of_zone(source.name)
        site = Site()
    if record.read is None:
        details: Any = check(record.reading, dict(how), f"{source.name}, form {form}")
        whole, hours, repaired = stef_forms.read_histograms(source, details, site)
        return "stef", _told(whole, source, record, repaired), hours
    table = _table(record, source, how)
    if record.kinds[0] != "stef":
        return record.kinds[0], table, {}
    return "stef", stef_forms.constant(table), dict.fromkeys(site.listed_hours or range(24), table)


def origin_of(origin_m: Any) -> tuple[float, float]:
    """(x, y) [m], (0, 0) where none is given; `DataError` for what is no such pair."""
    if origin_m is None:
        return 0.0, 0.0
    pair = isinstance(origin_m, Sequence | np.ndarray) and len(origin_m) == 2
    if not pair or not all(isinstance(one, Real) and np.isfinite(float(one)) for one in origin_m):
        raise DataError(f"origin_m {origin_m!r}: give (x, y) in m, of the recordings' origin in the map's frame")
    return float(origin_m[0]), float(origin_m[1])


def read_source(path: str | Path, origin: tuple[float, float] = (0.0, 0.0)) -> Source:
    """A file's bytes; `DataError` where there is none."""
    try:
        with open(path, "rb") as file:
            return read_stream(str(path), file, origin)
    except FileNotFoundError:
        raise DataError(f"{path}: no such file") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error})") from None


def _table(record: Form, source: Source, how: Mapping[str, Any]) -> pa.Table:
    assert record.read is not None
    details: Any = check(record.reading, dict(how), f"{source.name}, form {record.name}")
    table, repaired = record.read(source, details)
    return _told(table, source, record, repaired)


def _told(table: pa.Table, source: Source, record: Form, repaired: Repaired) -> pa.Table:
    """The table with what is known of its origin in its metadata; what was repaired is logged."""
    about = "; ".join(f"{number} {what}" for what, number in repaired.items()) or "nothing to repair"
    level = logging.WARNING if repaired else logging.INFO
    _LOG.log(level, "%s: read as form `%s`, %d rows: %s", source.name, record.name, table.num_rows, about)
    digest = hashlib.sha256(source.data).hexdigest()
    told = {"file": Path(source.name).name, "sha256": digest, "form": record.name, "repaired": repaired}
    return table.replace_schema_metadata({**(table.schema.metadata or {}), IMPORTED: json.dumps(told)})


def imported(table: pa.Table) -> dict[str, Any]:
    """What `read_tables` has noted of a table's origin; {} of one that was built."""
    return json.loads((table.schema.metadata or {}).get(IMPORTED, b"{}"))


def texts(
    kind: str, whole: pa.Table | None, hours: Mapping[int, pa.Table], form: str, site: Site, **how: Any
) -> dict[int | str, str]:
    """{hour, `day`, or "" for all of it: text} of a map in a foreign form; `DataError` where the form cannot carry it.

    A map by hours is a file for each, but for a histogram, which is one.
    """
    record, own, kind = find_form(form), kind, find(kind).tables
    if kind not in record.kinds:
        able = [one.name for one in FORMS if kind in one.kinds]
        raise DataError(f"form {form} cannot carry a map of kind {own}; forms that can: {', '.join([*able, PARQUET])}")
    details: Any = check(record.writing, how, f"form {form}")
    if record.write is None:
        if not hours:
            raise DataError(f"form {form}: the map has no hours")
        text, box = stef_forms.write_histograms(hours, site)
        _LOG.warning("form `%s` does not say its box; tell whoever reads it: %s", form, box)
        return {"": text}
    if kind == "stef" and whole is not None:
        whole = stef.mean_probabilities(whole)
    by_hours = kind == record.kinds[-1] != "cliff"
    parts: dict[int | str, pa.Table] = dict(sorted(hours.items()))
    if whole is not None:
        parts[DAY_STEM if by_hours else ""] = whole
    return {part: record.write(table, details) for part, table in parts.items()}


def write_tables(
    path: str | Path, kind: str, whole: pa.Table | None, hours: Mapping[int, pa.Table], form: str, site: Site,
    **how: Any,
) -> list[Path]:  # fmt: skip
    """Write a map in a foreign form to a file, or to a folder of hours; returns the files."""
    path, suffix, files = Path(path), find_form(form).suffix, {}
    for part, text in texts(kind, whole, hours, form, site, **how).items():
        stem = f"{part:02d}" if isinstance(part, int) else part
        files[path / f"{stem}{suffix}" if stem else path] = text
    in_folder = path not in files
    if path.is_dir() != in_folder and path.exists():
        lies, wanted = ("file", "folder") if in_folder else ("folder", "file")
        raise DataError(f"{path}: a {lies} is there; this map is a {wanted}, so give another name")
    before = check_one_form(path, suffix) if in_folder else set()
    try:
        for file, text in files.items():
            write_text(file, text)
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error})") from None
    for file in before - files.keys():  # hours of a map that lay there before are not this one's
        file.unlink()
    return list(files)
