"""Files with their provenance, Parquet and JSON: written under a temporary name, then renamed, so none is ever half.

Not after a loss of power either: what is renamed is on disk (`put_in_place`).

Each carries a seal, the SHA-256 of its own bytes with zeros where the seal stands: a single bit that differs anywhere,
in numbers, names or footer, is an error. Parquet's page checksums would not cover names, types and metadata.
"""

import errno
import functools
import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from modlhmp.temporary import temporary_name
from modlhmp.version import __version__

_PROVENANCE = b"modlhmp"
SEAL, _UNSEALED = b"modlhmp.seal", b"0" * 64
VERSION = "modlhmp.version"  # the key under which a file says what wrote it
_NOT_AS_WRITTEN = "is not as it was written (its seal does not fit); delete it and make it again"
_SEAL_OF_TEXT = re.compile(rb'"modlhmp\.seal": ?"')  # what stands before the seal in JSON
_WIDTHS = {"BOOLEAN": 1, "INT32": 4, "FLOAT": 4}  # bytes of a value in memory; others have 8, or are held once
_ENCODINGS = {
    pa.float32(): "BYTE_STREAM_SPLIT", pa.int32(): "DELTA_BINARY_PACKED", pa.int64(): "DELTA_BINARY_PACKED"
}  # fmt: skip

MOST_HELD, MOST_TIMES = 400_000_000, 10  # bytes that a file may stand for, or times its own size, if that is more
MOST_MESSAGE = 4000  # characters
UNFORESEEN = "if it is as it should be, this is a fault of modlhmp: please report it"
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS}
_NO_SYNC = {errno.EINVAL, errno.ENOTSUP, errno.EACCES}  # of folders, on some network drives, or that may not be read


class DataError(ValueError):
    """Something is wrong with the user's data or settings; the message names file, row, value and remedy.

    A value may be a file's whole line: of a message without end the middle is left out.
    """

    def __init__(self, message: str = "") -> None:
        half = MOST_MESSAGE // 2
        super().__init__(message if len(message) <= MOST_MESSAGE else f"{message[:half]} [...] {message[-half:]}")


def no_folder(path: object) -> None:
    """`DataError` where a folder is given as a file; what is not there at all is told by who reads it."""
    if isinstance(path, str | Path) and os.path.isdir(path):
        raise DataError(f"{path}: a folder; name a file in it")


@contextmanager
def boundary(source: object, remedy: str) -> Iterator[None]:
    """What a library raises within, at something that others have written, as an error of ours that names `source`.

    What is foreseen has errors and remedies of its own, below this. Memory that does not suffice stays what it is.
    """
    try:
        yield
    except (DataError, MemoryError):
        raise
    except Exception as error:
        reason = (str(error).splitlines() or [""])[0][:200]
        raise DataError(f"{source}: {remedy} ({type(error).__name__}: {reason}); {UNFORESEEN}") from error


@contextmanager
def refused(told: str, *kinds: type[Exception], remedy: str = "") -> Iterator[None]:
    """Errors of such kinds that a library raises within as ours: what is `told`, the reason, the remedy.

    Errors of ours, which are ValueErrors too, stay as they are.
    """
    try:
        yield
    except DataError:
        raise
    except kinds as error:
        reason = getattr(error, "strerror", None) or (str(error).splitlines() or [type(error).__name__])[0]
        raise DataError(f"{told} ({reason}){remedy and '; '}{remedy}") from None


def write_parquet(table: pa.Table | Mapping[str, Any], path: str | Path, **provenance: Any) -> None:
    """Write a `pyarrow.Table` (or a dict of columns) to `path`, with `provenance` as JSON in the metadata."""
    write_pieces([pa.table(table) if isinstance(table, dict) else table], path, **provenance)


def write_pieces(tables: Iterable[pa.Table], path: str | Path, **provenance: Any) -> None:
    """Write tables of one form, of which there is at least one, as a single one; they are taken as they come."""
    tables = iter(tables)
    table = next(tables)
    schema = table.schema.with_metadata({**(table.schema.metadata or {}), **provenance_metadata(**provenance)})
    with atomic_path(path) as temporary:
        with pq.ParquetWriter(temporary, schema, **packing(schema)) as writer:
            while table is not None:
                writer.write_table(table.replace_schema_metadata(schema.metadata))
                table = next(tables, None)
            writer.add_key_value_metadata({SEAL: _UNSEALED})
        _seal(temporary)


def packing(schema: pa.Schema) -> dict[str, Any]:
    """Options of the Parquet writer that make our tables smallest.

    Bytes of float32 numbers are stored by place (files a fifth to a half smaller), whole numbers as differences.
    """
    encodings = {}
    for field in schema:
        is_list = pa.types.is_fixed_size_list(field.type)
        kind = field.type.value_type if is_list else field.type
        if kind in _ENCODINGS:
            encodings[f"{field.name}.list.element" if is_list else field.name] = _ENCODINGS[kind]
    others = [name for name in schema.names if not {name, f"{name}.list.element"} & encodings.keys()]
    return {"compression": "zstd", "use_dictionary": others, "column_encoding": encodings}


def column(table: pa.Table, name: str) -> np.ndarray:
    """A column without nulls as an array that may not be written to; of a column of lists, all their values.

    Not by `to_numpy`, which imports pandas: 0.15 s and 50 MB of every job.
    """
    values = table[name].combine_chunks()
    if values.null_count:
        raise DataError(f"column {name}: {values.null_count} of {len(values)} values are missing; remake the file")
    return np.from_dlpack(values.flatten() if pa.types.is_nested(values.type) else values)


def read_parquet(
    path: str | Path, columns: Sequence[str] | None = None, texts_once: Sequence[str] | None = None
) -> pa.Table:
    """Read a table; a missing or damaged file is a `DataError` that says how to get it back.

    Columns `texts_once` are read as dictionaries, where others may have written texts of any length.
    """
    with _damage(path):
        return open_parquet(path, texts_once).read(columns, use_threads=False)


def read_pieces(path: str | Path, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
    """Yield a table in the pieces in which it was written."""
    file = open_parquet(path)
    for group in range(file.num_row_groups):
        with _damage(path):
            piece = file.read_row_group(group, columns, use_threads=False)
        yield piece


def read_batches(
    path: str | Path, file: pq.ParquetFile, groups: Sequence[int], columns: Sequence[str]
) -> Iterator[pa.Table]:
    """Yield some pieces of an open file a few thousand rows at a time: reading a piece of lists takes ten times it."""
    with _damage(path):
        for batch in file.iter_batches(1 << 13, row_groups=groups, columns=columns, use_threads=False):
            yield pa.Table.from_batches([batch])


def open_parquet(path: str | Path, texts_once: Sequence[str] | None = None) -> pq.ParquetFile:
    """Open a file whose seal is whole, which one without our provenance has not, and that holds what can be held."""
    with _damage(path):
        status = os.stat(path)
        _check_seal(str(path), status.st_size, status.st_mtime_ns, status.st_ino)
        return pq.ParquetFile(path, read_dictionary=texts_once)


def check_held(path: str | Path, held: int) -> None:
    """`DataError` where a file stands for so many bytes that it was made, or damaged, to fill memory."""
    most = max(MOST_HELD, MOST_TIMES * os.stat(path).st_size)
    if held > most:
        raise DataError(
            f"{path}: stands for {held / 1e6:,.0f} MB, over {most / 1e6:,.0f} MB and {MOST_TIMES} times its size, as "
            "no measured numbers do; is it damaged? If it is meant, divide it"
        )


@contextmanager
def _damage(path: str | Path) -> Iterator[None]:
    """What reading a Parquet file raises, as an error of ours."""
    no_folder(path)
    try:
        yield
    except FileNotFoundError:
        raise DataError(f"{path}: no such file; if the workflow makes it, run the workflow again") from None
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise DataError(f"{path}: cannot be read as Parquet ({reason}); delete it and make it again") from None


@functools.lru_cache(maxsize=4096)
def _check_seal(path: str, size: int, changed_ns: int, inode: int) -> None:
    """`DataError` where a file of ours is not as it was written; a file is looked at once."""
    about, (digest, place) = pq.read_metadata(path), _digest(path)
    keys = about.metadata or {}
    if keys.get(SEAL, b"").decode("ascii", "replace") != digest and (place or _PROVENANCE in keys):
        raise DataError(f"{path}: {_NOT_AS_WRITTEN}")
    widths = [_WIDTHS.get(about.schema.column(place).physical_type, 8) for place in range(about.num_columns)]
    groups = (about.row_group(number) for number in range(about.num_row_groups))
    check_held(path, sum(wide * group.column(at).num_values for group in groups for at, wide in enumerate(widths)))


def _seal(path: Path) -> None:
    """Put a file's digest where its zeros stand."""
    digest, place = _digest(path)
    with open(path, "r+b") as file:
        file.seek(place)
        file.write(digest.encode())


def _digest(path: str | Path) -> tuple[str, int]:
    """SHA-256 of a file with zeros in place of its seal, and where that stands: 0 in a file without one."""
    with open(path, "rb") as file:
        end = file.seek(-8, os.SEEK_END)
        start = max(end - int.from_bytes(file.read(4), "little"), 0)
        file.seek(start)
        found = file.read().rfind(SEAL)
        # After the name come two bytes of Thrift: that a text follows, and its length of 64.
        place = start + found + len(SEAL) + 2 if found >= 0 else 0
        file.seek(0)
        digest, at = hashlib.sha256(), 0
        while block := file.read(1 << 18):
            low, high = max(place - at, 0), min(place + len(_UNSEALED) - at, len(block))
            if place and low < high:
                block = block[:low] + _UNSEALED[: high - low] + block[high:]
            digest.update(block)
            at += len(block)
    return digest.hexdigest(), place


def provenance_metadata(**provenance: Any) -> dict[bytes, str]:
    """Schema metadata that carries `provenance` as JSON, and the version that wrote it."""
    return {_PROVENANCE: json.dumps({VERSION: __version__, **provenance}, sort_keys=True)}


def read_metadata(path: str | Path) -> dict[str, Any]:
    """The provenance that a file carries (empty for a foreign file); `DataError` where it is damaged."""
    with _damage(path):
        described = (open_parquet(path).schema_arrow.metadata or {}).get(_PROVENANCE, b"{}")
    try:
        found = json.loads(described)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: its metadata are damaged ({error}); make it again") from None
    if not isinstance(found, dict):
        raise DataError(f"{path}: its metadata are damaged ({found!r} is not a mapping); make it again")
    return found


def write_json(path: str | Path, content: Mapping[str, Any]) -> None:
    """Write a mapping as JSON that only `read_json` needs to understand: seal and version come first."""
    text = json.dumps({**unsealed(), VERSION: __version__, **content}, indent=1) + "\n"
    with atomic_path(path) as temporary:
        temporary.write_bytes(sealed(text.encode()))


def read_json(path: str | Path) -> dict[str, Any]:
    """The mapping that `write_json` wrote; a missing or damaged file is a `DataError` that says how to get it back."""
    whole = read_sealed(path)
    try:
        content = json.loads(whole)
        del content[SEAL.decode()]
        content.pop(VERSION, None)  # it says who wrote the file, and is no part of what is written
    except (ValueError, TypeError, KeyError, RecursionError):
        raise DataError(f"{path}: is no JSON that modlhmp has written; delete it and make it again") from None
    return content


def unsealed() -> dict[str, str]:
    """The key of JSON that `sealed` fills; it comes before all that may hold any text."""
    return {SEAL.decode(): _UNSEALED.decode()}


def sealed(content: bytes) -> bytes:
    """JSON, or what begins with it, with the digest of all in place of the zeros of its key `modlhmp.seal`."""
    start, end = _seal_of(content)
    return content[:start] + hashlib.sha256(content).hexdigest().encode() + content[end:]


def read_sealed(path: str | Path) -> bytes:
    """The bytes of a file whose seal (`sealed`) is whole; `DataError` where it is not, or there is no such file."""
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise DataError(f"{path}: no such file; if the workflow makes it, run the workflow again") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from None
    start, end = _seal_of(content)
    if hashlib.sha256(content[:start] + _UNSEALED + content[end:]).hexdigest().encode() != content[start:end]:
        raise DataError(f"{path}: {_NOT_AS_WRITTEN}")
    return content


def _seal_of(content: bytes) -> tuple[int, int]:
    """Where the seal of JSON begins and ends: at the end of content that has none."""
    found = _SEAL_OF_TEXT.search(content)
    start = found.end() if found else len(content)
    return start, start + len(_UNSEALED)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


class atomic_path:  # noqa: N801 - reads as a verb in `with atomic_path(path) as temporary`
    """Context that yields a temporary name beside `path` and renames it on success, removes it on failure."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.temporary = temporary_name(self.path)

    def __enter__(self) -> Path:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._unwritten(error) from None
        return self.temporary

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        try:
            if value is None:
                put_in_place(self.temporary, self.path)
        except OSError as error:
            raise self._unwritten(error) from None
        finally:
            with suppress(OSError):
                self.temporary.unlink(missing_ok=True)
        if isinstance(value, OSError) and (value.errno in _NO_ROOM or str(self.temporary) == str(value.filename)):
            raise self._unwritten(value) from None

    def _unwritten(self, error: OSError) -> DataError:
        """Why the file could not be written, a full disk above all, with what to do."""
        remedy = "make room" if error.errno in _NO_ROOM else "see that the folder may be written to"
        reason = os.strerror(error.errno) if error.errno else str(error)
        return DataError(f"{self.path}: cannot be written ({reason}); {remedy}, then run again")


def put_in_place(temporary: Path, path: Path) -> None:
    """Give a written file, or a folder of files, its name, in place of what has it; the two are on one disk.

    Its bytes are on disk before and its name after: a loss of power leaves what was there, or the whole new file, and
    what is done stays done.
    """
    for written in (*temporary.glob("*"), temporary):
        _sync(written)
    temporary.replace(path)
    _sync(path.parent)


def _sync(path: Path) -> None:
    """Wait until a file, or what stands in a folder, is on disk."""
    try:
        handle = os.open(path, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    except OSError as error:
        if error.errno not in _NO_SYNC or not path.is_dir():
            raise
