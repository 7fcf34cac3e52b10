"""Power that fails at any point leaves, under every name, what was there or the whole new file.

A small model of a file system: bytes are on disk once their file was synced, names once their folder was. What was not
synced is lost, but a rename since then may have survived, or not.
"""

import hashlib
import os
import stat
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import torch

from modlhmp import Futures, Site, ros, storage
from modlhmp.exchange.columns import write_columns
from modlhmp.forecasting.base import Forecast
from modlhmp.networks.training import save_checkpoint
from modlhmp.networks.weights import write_weights
from modlhmp.study import fetch

NEW = b"new " * 5000
TABLE = pa.table({"x": [0.5] * 1000, "name": ["a"] * 1000})
ABSENT = None


def content(path):
    """The bytes of a file, or of the files in a folder by their names."""
    return {file.name: file.read_bytes() for file in path.iterdir()} if path.is_dir() else path.read_bytes()


class Disk:
    """What may be found under the names in a folder after a loss of power, at every call of fsync and rename."""

    def __init__(self, folder, monkeypatch):
        self.folder, self.held, self.points = folder, [], 0
        self.bytes, self.names, self.renamed, self.whole = {}, {}, [], {}
        for path in filter(Path.is_file, folder.rglob("*")):
            self.names[path] = self._number(os.open(path, os.O_RDONLY))
            self.bytes[self.names[path]] = path.read_bytes()
            self.whole[path] = [path.read_bytes()]
        self.real = {name: getattr(os, name) for name in ("fsync", "replace", "rename")}
        monkeypatch.setattr(os, "fsync", self.fsync)
        for name in ("replace", "rename"):
            monkeypatch.setattr(os, name, partial(self.rename, name))

    def _number(self, handle):
        """The number of an open file; it is held open, so that no other file gets its number."""
        self.held.append(handle)
        return os.fstat(handle).st_ino

    def fsync(self, handle):
        self.look()
        self.real["fsync"](handle)
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            here = os.fstat(handle).st_ino
            self.names |= {path: number for path, number in self.renamed if path.parent.stat().st_ino == here}
            self.renamed = [one for one in self.renamed if one[0].parent.stat().st_ino != here]
            files = [file for file in Path(f"/proc/self/fd/{handle}").iterdir() if file.is_file()]
            self.bytes[self._number(os.dup(handle))] = {
                file.name: self.bytes.get(file.stat().st_ino, b"") for file in files
            }
        else:
            self.bytes[self._number(os.dup(handle))] = content(Path(f"/proc/self/fd/{handle}"))
        self.look()

    def rename(self, name, source, target):
        self.look()
        target = Path(target)
        if any(part.endswith(".part") for part in target.parts):  # a name that nobody will look under
            return self.real[name](source, target)
        self.whole.setdefault(target, [ABSENT]).append(content(Path(source)))
        self.renamed.append((target, self._number(os.open(source, os.O_RDONLY))))
        self.real[name](source, target)
        return self.look()

    def possible(self, path):
        """What may stand under a name after a loss of power now."""
        numbers = [number for target, number in self.renamed if target == path]
        left = [self.bytes.get(number, b"") for number in numbers]
        return [*left, self.bytes[self.names[path]] if path in self.names else ABSENT]

    def look(self):
        """Power fails: whatever the names may lead to was written under them in one piece, or nothing was."""
        self.points += 1
        for path, whole in self.whole.items():
            for left in self.possible(path):
                assert left in whole, f"{path.name}: {'nothing' if not left else f'{len(left)} bytes'} of it is left"

    def end(self):
        """All is written, and stays so; nothing was written under its own name."""
        self.look()
        for file in filter(Path.is_file, self.folder.rglob("*")):
            path = file.parent if file.parent in self.whole else file  # of a folder that was put in place
            assert path in self.whole, f"{path.name} was written under its own name"
            assert content(path) == self.whole[path][-1], f"{path.name} was changed under its own name"
            assert self.possible(path) == self.whole[path][-1:], f"{path.name} may be gone again"


@pytest.fixture
def disk(tmp_path, monkeypatch):
    """Function () -> the model, from now on."""
    disks = []

    def begin():
        disks.append(Disk(tmp_path, monkeypatch))
        return disks[0]

    yield begin
    monkeypatch.undo()
    for handle in disks[0].held:
        os.close(handle)


def download(path):
    """A file that is fetched, without a server."""

    def arrives(url, file, *_):
        file.write(NEW)
        file.flush()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fetch, "_download", arrives)
        fetch.fetch("http://x/y", path, hashlib.sha256(NEW).hexdigest(), progress=False)


def by_hand(path):
    with storage.atomic_path(path) as temporary:
        temporary.write_bytes(NEW[:100])
        with open(temporary, "ab") as file:
            file.write(NEW[100:])


WRITERS = {
    "atomic_path": by_hand,
    "write_parquet": lambda path: storage.write_parquet(TABLE, path, seed=1),
    "write_pieces": lambda path: storage.write_pieces(iter([TABLE, TABLE.slice(3)]), path),
    "write_json": lambda path: storage.write_json(path, {"a": list(range(1000))}),
    "write_text": lambda path: storage.write_text(path, "new " * 5000),
    "write_columns": lambda path: write_columns([TABLE], path.with_suffix(".csv")),
    "write_weights": lambda path: write_weights(path, {"w": torch.ones(99)}, {"kind": "lstm"}),
    "save_checkpoint": lambda path: save_checkpoint(path, {"weights": torch.ones(99)}),
    "fetch": download,
}


@pytest.fixture
def write_bag():
    """What writes a forecast, made before, as a bag at a path."""
    pytest.importorskip("rosbags", reason="rosbags is an extra: pip install 'modlhmp[ros]'")
    walked = np.ones((1, 1, 2, 2), np.float32)
    samples = Forecast(walked, np.zeros((1, 1, 2), np.float32), np.full((1, 1), 2, np.int32), "medoid")
    futures = Futures(np.array([7]), np.array([1.3e9]), np.zeros((1, 2)), samples, Site(horizon_s=2))
    return partial(ros.write_bag, futures, futures.occupancy(cell_m=1.0))


def test_a_bag_is_a_folder_of_whole_files_or_none(tmp_path, disk, write_bag):
    model = disk()
    write_bag(tmp_path / "bag")
    assert set(content(tmp_path / "bag")) == {"bag.mcap", "metadata.yaml"}
    assert model.points >= 8
    model.end()
    assert list(tmp_path.iterdir()) == [tmp_path / "bag"]


def test_the_model_finds_a_folder_of_which_only_the_name_is_on_disk(tmp_path, disk, monkeypatch, write_bag):
    model = disk()
    monkeypatch.setattr(ros, "put_in_place", folder_alone)
    with pytest.raises(AssertionError, match=r"bag: .* of it is left"):
        write_bag(tmp_path / "bag")
    assert model.points
    assert list(tmp_path.iterdir()) == [tmp_path / "bag"]


@pytest.mark.parametrize("there", [False, True], ids=["absent", "old"])
@pytest.mark.parametrize("name", WRITERS)
def test_every_writer(tmp_path, disk, name, there):
    path = tmp_path / ("file.csv" if name == "write_columns" else "file.parquet")
    if there and name != "fetch":  # which replaces nothing
        path.write_bytes(b"old")
    model = disk()
    WRITERS[name](path)
    assert model.points >= 6
    assert path.read_bytes() not in (b"old", b"")
    model.end()


def test_several_writes_of_one_name(tmp_path, disk):
    model = disk()
    for number in range(4):
        storage.write_json(tmp_path / "state.json", {"number": number})
        storage.write_text(tmp_path / "table.csv", f"{number}\n")
    model.end()


def test_a_write_that_fails_leaves_the_old_file(tmp_path, disk):
    path = tmp_path / "file.json"
    storage.write_json(path, {"a": 1})
    model = disk()
    with pytest.raises(RuntimeError, match="stopped"), storage.atomic_path(path) as temporary:
        temporary.write_bytes(NEW)
        raise RuntimeError("stopped")
    model.end()
    assert model.possible(path) == [path.read_bytes()]
    assert storage.read_json(path) == {"a": 1}


def renamed_first(temporary, path):
    temporary.replace(path)
    storage._sync(path)
    storage._sync(path.parent)


def never_synced(temporary, path):
    temporary.replace(path)
    storage._sync(path.parent)


def folder_never_synced(temporary, path):
    storage._sync(temporary)
    temporary.replace(path)


def folder_alone(temporary, path):
    storage._sync(temporary)
    temporary.replace(path)
    storage._sync(path.parent)


WRONG = {
    renamed_first: "nothing of it is left",
    never_synced: "nothing of it is left",
    folder_never_synced: "may be gone again",
}


@pytest.mark.parametrize("wrong", WRONG, ids=lambda one: one.__name__)
@pytest.mark.parametrize("there", [False, True], ids=["absent", "old"])
def test_the_model_finds_what_is_missing(tmp_path, disk, monkeypatch, wrong, there):
    path = tmp_path / "file.txt"
    if there:
        path.write_bytes(b"old")
    model = disk()
    monkeypatch.setattr(storage, "put_in_place", wrong)
    with pytest.raises(AssertionError, match=WRONG[wrong]):
        storage.write_text(path, "new")
        model.end()


def test_the_model_finds_what_is_written_under_its_own_name(tmp_path, disk):
    model = disk()
    (tmp_path / "file.txt").write_text("new")
    with pytest.raises(AssertionError, match="was written under its own name"):
        model.end()


@pytest.mark.parametrize("number", sorted(storage._NO_SYNC))
def test_a_folder_that_cannot_be_synced_is_written_to(tmp_path, monkeypatch, number):
    """Some network drives have no such call."""
    sync = os.fsync

    def refused(handle):
        if stat.S_ISDIR(os.fstat(handle).st_mode):
            raise OSError(number, os.strerror(number))
        sync(handle)

    monkeypatch.setattr(os, "fsync", refused)
    storage.write_text(tmp_path / "file.txt", "new")
    assert (tmp_path / "file.txt").read_text() == "new"


def test_a_disk_that_fails_is_told_of(tmp_path, monkeypatch):
    def broken(handle):
        raise OSError(5, os.strerror(5))

    (tmp_path / "file.txt").write_text("old")
    monkeypatch.setattr(os, "fsync", broken)
    with pytest.raises(storage.DataError, match=r"file\.txt: cannot be written \(Input/output error\)"):
        storage.write_text(tmp_path / "file.txt", "new")
    assert (tmp_path / "file.txt").read_text() == "old"
    assert list(tmp_path.iterdir()) == [tmp_path / "file.txt"]
