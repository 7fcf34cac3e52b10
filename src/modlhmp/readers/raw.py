"""Open raw recordings wherever they lie: plain, .gz, .bz2, or a member of a .zip; and read them in blocks of lines."""

import bz2
import codecs
import contextlib
import csv
import gzip
import lzma
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, NamedTuple, cast

from tqdm.utils import CallbackIOWrapper

from modlhmp.logs import progress
from modlhmp.origins import check_unchanged, file_state
from modlhmp.storage import DataError

COMPRESSED = (".gz", ".bz2", ".zip")
SUFFIXES = {"csv", "txt", "tsv", "ndjson", "dat"}  # of text; whatever else follows a dot is part of a name
BLOCK_BYTES = 1 << 22
# Beyond these a file is no recording, or made to fill memory: 8 MiB of a line are half a million positions.
MOST_LINE_BYTES, MOST_WHOLE_BYTES = 1 << 23, 1 << 29
MOST_TIMES, LEAST_BYTES = 250, 1 << 26  # how much larger than its archive a text may be, if it has so many bytes
_DAMAGED = (
    EOFError, zlib.error, lzma.LZMAError, gzip.BadGzipFile, zipfile.BadZipFile, RuntimeError, NotImplementedError
)  # fmt: skip
# How files begin that are no text, and what they are.
_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"7z\xbc\xaf": "7-Zip", b"\x28\xb5\x2f\xfd": "zstd"}
_BINARY = {
    b"\x89HDF": "HDF5 (`reader: hdf5`, if it is of the Pedestrian Dynamics Data Archive)",
    b"SQLite format 3": "SQLite (`reader: jupedsim`, if it is JuPedSim's)", b"PAR1": "Parquet",
    b"PK\x03\x04": "a zip archive or a workbook", b"\x93NUMPY": "a numpy array", b"\x80": "a pickle",
    b"MATLAB": "a MATLAB file", b"ARROW1": "Arrow",
}  # fmt: skip
FILE_COLUMN = "file"  # what the column of people's files is called


def archive_and_member(path: str | Path) -> tuple[Path, str | None]:
    """Split `day.zip/member.csv` into (`day.zip`, `member.csv`); a plain path gives (path, None)."""
    path = Path(path)
    for parent in path.parents:
        if parent.suffix.lower() == ".zip" and parent.is_file():
            return parent, path.relative_to(parent).as_posix()
    return path, None


def stem_of(file: str | Path) -> str:
    """The name of a recording's file without its suffixes: `tracks.01Jul` of `days/tracks.01Jul.csv.gz`."""
    name = Path(file).name
    if name.lower().endswith(COMPRESSED):
        name = name.rpartition(".")[0]
    stem, _, suffix = name.rpartition(".")
    return stem if stem and suffix.lower() in SUFFIXES else name


def find_recording(path: str | Path) -> Path | None:
    """The file that holds a recording: `path` itself, `path` + .gz / .bz2 / .zip, or None."""
    file, member = archive_and_member(path)
    candidates = [file] if member else [file, *(file.with_name(file.name + suffix) for suffix in COMPRESSED)]
    found = next((candidate for candidate in candidates if candidate.is_file()), None)
    return found / member if found and member else found


@contextlib.contextmanager
def open_raw(path: str | Path) -> Iterator[IO[bytes]]:
    """Open a recording as a binary stream; `DataError` for a missing or damaged file, or one that changes meanwhile."""
    file, member = archive_and_member(path)
    state = file_state(file)
    try:
        with contextlib.ExitStack() as stack:
            raw = stack.enter_context(open(file, "rb"))
            bar = stack.enter_context(progress(total=file.stat().st_size, desc=file.name, unit="B", unit_scale=True))
            counted = CallbackIOWrapper(bar.update, raw)
            suffix = file.suffix.lower()
            if suffix == ".zip":
                archive = stack.enter_context(zipfile.ZipFile(counted))
                opened = stack.enter_context(archive.open(member or _only_member(file, archive)))
                yield cast(IO[bytes], CallbackIOWrapper(_unpacked(file), opened))
            elif suffix in {".gz", ".bz2"}:
                opened = stack.enter_context({".gz": gzip, ".bz2": bz2}[suffix].open(counted))
                yield cast(IO[bytes], CallbackIOWrapper(_unpacked(file), opened))
            else:
                yield cast(IO[bytes], counted)
    except FileNotFoundError:
        raise DataError(
            f"{file}: no such file; put the recording there, or correct the path (in the workflow: `data_root`)"
        ) from None
    except KeyError:
        raise DataError(f"{file}: holds no member {member!r}") from None
    except _DAMAGED as error:
        raise DataError(
            f"{file}: the archive is cut off or damaged, or locked ({error}); fetch it again, or unpack it"
        ) from None
    except OSError as error:
        raise DataError(f"{file}: cannot be read ({error})") from None
    check_unchanged(file, file_state(file) == state)


def _unpacked(file):
    """What is told how many more bytes came out of an archive; `DataError` where they are more than a text's."""
    most, seen = max(MOST_TIMES * file.stat().st_size, LEAST_BYTES), 0

    def more(size):
        nonlocal seen
        seen += size
        if seen > most:
            raise DataError(
                f"{file}: holds more than {most // 10**6} MB, over {MOST_TIMES} times its own size, which text does "
                "not: is it damaged? If it is meant, unpack it"
            )

    return more


def _check_text(path, content):
    """Whether a file that begins so is text; `DataError` that says what it is."""
    packed = next((name for start, name in _PACKED.items() if content.startswith(start)), None)
    packed = "tar" if content[257:262] == b"ustar" else packed
    if packed:
        raise DataError(f"{path}: is packed by {packed}: unpack it, or pack it as .gz, .bz2 or .zip and call it so")
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise DataError(f"{path}: is UTF-16 text; save it as UTF-8")
    kind = next((name for start, name in _BINARY.items() if content.startswith(start)), None)
    head = content[:4096]
    if kind or b"\0" in head.partition(b"\n")[0] or head.count(b"\0") > len(head) // 50:  # not a line of garbage
        what = kind or "not text, or text in UTF-16"
        raise DataError(f"{path}: is {what}; export it as CSV in UTF-8, one row for each person and time")


def _with_newlines(text):
    """Lines that end as old Macintosh files' do, or some of them, with newlines."""
    if b"\r" in text and text.count(b"\r") > text.count(b"\r\n"):
        return re.sub(rb"\r(?!\n)", b"\n", text)
    return text


def read_whole(path: str | Path) -> bytes:
    """The bytes of a text; `DataError` as `open_raw`, where it is none, and where they are too many to be held."""
    with open_raw(path) as file:
        content = file.read(MOST_WHOLE_BYTES + 1)
    if len(content) > MOST_WHOLE_BYTES:
        raise DataError(f"{path}: has more than {MOST_WHOLE_BYTES >> 20} MiB, which this form cannot have; divide it")
    _check_text(path, content)
    return _with_newlines(content)


def ids_of_people(files: Sequence[str | Path]) -> list[str]:
    """Whose each of the files of one person is: its name without suffixes; `DataError` for two files of one name."""
    found: dict[str, str | Path] = {}
    for file in files:
        name = stem_of(file).strip()  # as readers take ids
        if name in found:
            raise DataError(
                f"{found[name]} and {file}: a file's name is its person's id, and both are {name!r}: rename one, put "
                "the two together if they are of one person, or give each folder an entry of `recordings`"
            )
        found[name] = file
    return list(found)


class People(NamedTuple):
    """Files of one person each, read like one file whose first column is the person's name."""

    files: tuple[str, ...]
    separator: str
    header: bool
    skip_lines: int
    comment: str  # what a comment begins with; "": there are none
    columns: tuple[str, ...] = ()  # names that are read, which stand at one place in all files

    def __str__(self) -> str:
        return f"{Path(self.files[0]).parent} ({len(self.files)} files)"

    def lines(self) -> Iterator[bytes]:
        """Each file's lines, with the person's name before its rows, in pieces; the names of the columns once."""
        mark = self.separator.encode()
        first: tuple[str, dict[str, int]] | None = None  # file that names the columns, and where those are that count
        for file, name in zip(self.files, ids_of_people(self.files), strict=True):
            if {self.separator, *'"\t\r\n'} & set(name) or (self.comment and name.startswith(self.comment)):
                raise DataError(
                    f"{file}: its name is an id, so it may hold neither {self.separator!r} nor quotes, tabs and ends "
                    f"of lines, nor begin with a comment's {self.comment!r}: rename it"
                )
            lines = read_whole(file).removeprefix(codecs.BOM_UTF8).splitlines()[self.skip_lines :]
            begin = next((n for n, line in enumerate(lines) if self._is_row(line)), len(lines))
            yield b"".join(line + b"\n" for line in lines[:begin] if line.strip())
            if self.header and begin < len(lines):
                places = self._places(lines[begin])
                if first is None:
                    first = file, places
                    yield FILE_COLUMN.encode() + mark + lines[begin] + b"\n"
                if places != first[1]:
                    raise DataError(
                        f"{file}: its columns stand elsewhere than those of {first[0]}: write all files alike"
                    )
                begin += 1
            before = name.encode() + mark
            yield b"".join((before if self._is_row(line) else b"") + line + b"\n" for line in lines[begin:])

    def _places(self, line: bytes) -> dict[str, int]:
        """Where in a line of names those are that are read."""
        text = line.decode(errors="replace")
        names = text.split() if self.separator == " " else next(csv.reader([text], delimiter=self.separator), [])
        return {name.strip(): place for place, name in enumerate(names) if name.strip() in self.columns}

    def _is_row(self, line: bytes) -> bool:
        start = line.lstrip()
        return bool(start) and not (self.comment and start.startswith(self.comment.encode()))


def line_blocks(path: str | Path | People, size: int = BLOCK_BYTES) -> Iterator[bytes]:
    """Yield the file as byte blocks of whole lines, about `size` bytes each; `DataError` if it is empty or no text."""
    if isinstance(path, People):
        yield from _gathered(path.lines(), size)
        return
    rest, seen = b"", False
    with open_raw(path) as file:
        while chunk := file.read(size):
            if not seen:
                _check_text(path, chunk)
            seen = True
            text = _with_newlines(chunk + file.read(1) if chunk.endswith(b"\r") else chunk)
            cut = text.rfind(b"\n") + 1
            if cut:
                yield rest + text[:cut]
                rest = text[cut:]
            else:
                rest += text
            if len(rest) > MOST_LINE_BYTES:
                raise DataError(
                    f"{path}: a line has more than {MOST_LINE_BYTES >> 20} MiB ({rest[:40]!r} ...): is the file text, "
                    "with one row per line?"
                )
    if not seen:
        raise DataError(f"{path}: the file is empty")
    if rest:
        yield rest + b"\n"


def _gathered(pieces, size):
    """Pieces of whole lines put together to blocks of about `size` bytes."""
    waiting, length = [], 0
    for piece in pieces:
        waiting.append(piece)
        length += len(piece)
        if length >= size:
            yield b"".join(waiting)
            waiting, length = [], 0
    yield b"".join(waiting)


def _only_member(path, archive):
    members = [name for name in archive.namelist() if not name.endswith("/")]
    if len(members) != 1:
        listed = ", ".join(members[:5]) + (", ..." if len(members) > 5 else "")
        raise DataError(f"{path}: holds {len(members)} files ({listed}); name one as {path.name}/<member>")
    return members[0]
