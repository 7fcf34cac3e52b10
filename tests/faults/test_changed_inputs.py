"""A file that changes while it is read is refused: what was read is neither the old one nor the new one."""

import gzip
import os

import pytest

from modlhmp.origins import provenance, unchanged
from modlhmp.readers.raw import line_blocks
from modlhmp.storage import DataError

LINES = b"".join(b"%d,%d\n" % (n, n * n) for n in range(20_000))


def cut(path):
    with open(path, "r+b") as file:
        file.truncate(len(path.read_bytes()) // 2)


def longer(path):
    with open(path, "ab") as file:
        file.write(b"1,1\n")


def other(path):
    """As an editor saves: a new file under the old name."""
    path.with_name("new").write_bytes(path.read_bytes().replace(b"9", b"8"))
    os.replace(path.with_name("new"), path)


CHANGES = [cut, longer, other, lambda path: path.unlink()]


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("packed", [False, True])
def test_a_recording_that_changes_while_it_is_read_is_refused(tmp_path, change, packed):
    path = tmp_path / ("day.csv.gz" if packed else "day.csv")
    path.write_bytes(gzip.compress(LINES, 1) if packed else LINES)
    blocks = line_blocks(path, 1 << 12)
    assert b"".join([next(blocks), *line_blocks(path, 1 << 12)]).endswith(LINES)
    change(path)
    with pytest.raises(DataError, match=r"day\.csv.*(changed while it was read.*run again|cut off or damaged)"):
        list(blocks)


@pytest.mark.parametrize("change", CHANGES)
def test_an_input_that_changes_is_refused(tmp_path, change):
    path = tmp_path / "day.csv"
    path.write_bytes(LINES)
    with pytest.raises(DataError, match=r"day\.csv: changed while it was read"), unchanged(path):
        change(path)


def test_other_bytes_of_the_same_size_and_time_are_seen(tmp_path):
    """By their hash: some file systems keep a coarse time, or none for what is written through memory."""
    path = tmp_path / "day.csv"
    path.write_bytes(LINES)
    before = path.stat()
    with pytest.raises(DataError, match=r"day\.csv: changed while it was read"), unchanged(path):
        with open(path, "r+b") as file:
            file.write(b"7")
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_the_origin_is_that_of_the_bytes_that_were_read(tmp_path):
    path = tmp_path / "day.csv"
    path.write_bytes(LINES)
    with unchanged(path) as hashes:
        assert provenance({}, {}, [path], hashes)["sources"] == provenance({}, {}, [path])["sources"]
    assert hashes[path] in provenance({}, {}, [path])["sources"].values()


def test_an_error_within_is_told_as_it_is(tmp_path):
    path = tmp_path / "day.csv"
    path.write_bytes(LINES)
    with pytest.raises(DataError, match="first"), unchanged(path):
        longer(path)
        raise DataError("first")
