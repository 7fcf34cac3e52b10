"""The files that a dataset's `recordings` stand for: found under the data root, named, and no two of them the same."""

import glob
import os
import re
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path

from modlhmp.file_format import Recording
from modlhmp.origins import file_sha256
from modlhmp.readers.raw import find_recording, stem_of
from modlhmp.storage import DataError, refused

IN_NAME = "in_name"  # a `day` that stands in the name of each file
_HEAD_BYTES = 1 << 16


def find_files(source: str | Path, listed: str, root: Path) -> list[Path]:
    """The files that a path or glob under `root` stands for, in order; one that does not exist where it is expected.

    What exists under exactly this name is meant, whatever its name holds, and so are the folders before a glob. There
    `**` stands for any number of folders, also none. `DataError` that names `source` for a glob without a file, for
    folders and for braces.
    """
    # A name that is too long or holds a null, a folder that may not be entered.
    with refused(f"{source}: files {listed!r}: cannot be looked for under {root}", OSError, ValueError):
        return _find(source, listed, root)


def _find(source: str | Path, listed: str, root: Path) -> list[Path]:
    path = root / listed
    found = find_recording(path)
    member = _stored(path)[1]
    if member and glob.has_magic(member):
        raise DataError(f"{source}: files {listed!r}: globs do not reach into archives; name the members one by one")
    if found is not None:
        return [found]
    if path.is_dir():
        raise DataError(f"{source}: files {listed!r} is a folder; name its files, such as {Path(listed, '**/*.csv')}")
    if re.search(r"\{[^{}]*,[^{}]*\}", listed):
        raise DataError(
            f"{source}: files {listed!r}: there is no such file, and braces stand for nothing else; write an entry for "
            "each name, or a glob with *, ? or [ab]"
        )
    if not glob.has_magic(listed):
        return [path]
    folder, parts = root, Path(listed).parts
    while len(parts) > 1 and (folder / parts[0]).is_dir():  # as it is written, also `run[1]`
        folder, parts = folder / parts[0], parts[1:]
    matches = [folder / one for one in glob.glob(str(Path(*parts)), root_dir=folder, recursive=True)]
    matches = sorted(one for one in matches if one.is_file())
    if not matches:
        raise DataError(f"{source}: no file matches {path}; correct `files`, or `data_root` in the configuration")
    return matches


def day_in_name(source: str | Path, path: Path) -> str:
    """The one day, as 20121024 or 2012-10-24, in the name of a file; `DataError` that names `source` else."""
    found = set(re.findall(r"(?<!\d)(\d{4})[-_.]?(\d\d)[-_.]?(\d\d)(?!\d)", path.name))
    if len(found) != 1:
        raise DataError(
            f"{source}: day: {IN_NAME}: {path.name!r} names {len(found) or 'no'} days and not one, such as 20121024 or "
            "2012-10-24; rename the file, or give its `day`"
        )
    return "-".join(found.pop())


def recording_at(path: Path, root: Path) -> Recording:
    """The recording of a file; its name depends on the others', its day and split on the dataset file."""
    stored, member = _stored(path)
    exists = find_recording(path) is not None
    file = os.path.relpath(stored, root)
    return Recording(path=str(path), stored=stored, member=member, file=file, exists=exists)


def names_of(source: str | Path, recordings: Sequence[Recording]) -> list[str]:
    """What each recording is called: its file's name without suffix or, where others have the same, its path.

    `day1/tracks.csv` beside `day2/tracks.csv` is `day1.tracks`: a dot for each slash, and two for each dot, so that no
    two paths are written alike. Files of one person each are called as their folder or, where others are, as the glob
    that lists them, without its `*?[]`: `walks/a_*.csv` is `walks.a_`. `DataError` for files that differ in nothing but
    their suffix.
    """
    stems, paths = [_stem(one) for one in recordings], [_path_name(one) for one in recordings]
    names, before = stems, None
    while names != before:  # again, for a name without suffix may be another's path
        before = names
        names = [path if before.count(name) > 1 else name for name, path in zip(before, paths, strict=True)]
    if twice := next((name for name in names if names.count(name) > 1), None):
        one, other, *_ = (number for number, name in enumerate(names) if name == twice)
        remedy = "give the files different names, not only suffixes, or leave one out"
        if recordings[one].people:
            remedy = "put the files of each entry into a folder of their own"
        raise DataError(
            f"{source}: two recordings are named {stems[one]}: {_told(recordings[one])} and "
            f"{_told(recordings[other])}; {remedy}"
        )
    return names


def check_different(source: str | Path, files: Iterable[Recording], recordings: Iterable[Recording]) -> None:
    """Whether no file is listed twice, and none holds the same bytes as another; `DataError` that names both.

    `files` are the recordings file by file. Files are read only where their sizes are the same, and beyond their
    beginnings only where these are; not those of one person each, of whom several may have no row, so that they are
    alike. What does not exist or cannot be read is somebody else's error.
    """
    for one, other in _alike(list(files), [_identity]):
        if _told(one) == _told(other):
            raise DataError(f"{source}: recordings: {_told(one)} is listed twice; leave one out, or narrow a glob")
        raise DataError(f"{source}: recordings: {_told(one)} and {_told(other)} are the same file; leave one out")
    plain = [one for one in recordings if one.exists and one.member is None and not one.people]
    for one, other in _alike(plain, [_size, _head, lambda one: file_sha256(one.stored)]):
        raise DataError(
            f"{source}: recordings: {_told(one)} and {_told(other)} hold the same bytes, so that the same people would "
            "count twice; leave one out, or put the right file there"
        )


def _alike(
    recordings: list[Recording], keys: list[Callable[[Recording], Hashable]]
) -> Iterable[tuple[Recording, Recording]]:
    """Pairs of recordings for which all keys agree; a key is asked of those only for which the ones before it do."""
    groups = [recordings]
    for key in keys:
        parted: dict[Hashable, list[Recording]] = defaultdict(list)
        for number, one in ((number, one) for number, group in enumerate(groups) for one in group):
            try:
                parted[number, key(one)].append(one)
            except OSError:
                continue
        groups = [group for group in parted.values() if len(group) > 1]
    return ((group[0], group[1]) for group in groups)


def _identity(recording: Recording) -> Hashable:
    if not recording.exists:
        return os.path.abspath(recording.path)
    found = os.stat(recording.stored)
    return found.st_dev, found.st_ino, recording.member


def _size(recording: Recording) -> Hashable:
    size = os.stat(recording.stored).st_size
    return size or recording.stored  # empty files are told apart, and refused by their reader


def _head(recording: Recording) -> Hashable:
    with open(recording.stored, "rb") as file:
        return file.read(_HEAD_BYTES)


def _stored(file: str | Path) -> tuple[str, str | None]:
    """The file on disk that holds a recording, and the member of it that `archive.zip/member.csv` names."""
    stored, *member = re.split(r"(?i)(?<=\.zip)/", str(file), maxsplit=1)
    return stored, member[0] if member else None


def _told(recording: Recording) -> str:
    """A recording's path under the data root, for messages; of several people the glob that lists them."""
    return os.path.normpath(os.path.join(recording.file, os.path.relpath(recording.path, recording.stored)))


def _stem(recording: Recording) -> str:
    """The name of a recording's file, or of the folder that its people's are in, without suffixes."""
    people = [Path(one).parent for one in recording.people]
    return stem_of(os.path.commonpath(people) if people else recording.path)


def _path_name(recording: Recording) -> str:
    """A recording's path under the data root, without its suffixes and slashes, nor the marks of a glob."""
    *folders, _ = Path(_told(recording)).parts
    parts = [*folders, stem_of(recording.path)]
    if recording.people:
        parts = [plain for part in parts if (plain := re.sub(r"[*?[\]]", "", part))]
    return ".".join(part.replace(".", "..") for part in parts)
