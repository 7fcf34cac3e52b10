"""Tables on disk: what is packed comes back to the bit, and small."""

import os
import subprocess
import sys
import time

import numpy as np
import pyarrow as pa
import pytest

from modlhmp import __version__
from modlhmp.storage import (
    VERSION,
    DataError,
    atomic_path,
    column,
    packing,
    read_metadata,
    read_parquet,
    read_pieces,
    write_parquet,
    write_pieces,
)
from modlhmp.temporary import _host, remove_leftovers


def table(n=5000, seed=0):
    """Columns of every kind that the project writes."""
    rng = np.random.default_rng(seed)
    lists = rng.normal(0, 10, (n, 4))
    return pa.table(
        {
            "id": np.arange(n) // 7 + 2**40,
            "small": rng.integers(-(2**31), 2**31 - 1, n, dtype=np.int32),
            "single": np.append(rng.normal(0, 1, n - 2), [np.nan, -np.inf]).astype(np.float32),
            "double": rng.normal(0, 1, n),
            "path": pa.FixedSizeListArray.from_arrays(lists.astype(np.float32).ravel(), 4),
            "doubles": pa.FixedSizeListArray.from_arrays(lists.ravel(), 4),
            "name": pa.array(rng.choice(["a", "b"], n)).dictionary_encode(),
        }
    )


def test_every_kind_of_column_comes_back_to_the_bit(tmp_path):
    written = table()
    write_parquet(written, tmp_path / "t.parquet", seed=1)
    got = read_parquet(tmp_path / "t.parquet")
    assert got.schema.equals(written.schema)
    for name in written.column_names:
        one, other = (t[name].combine_chunks() for t in (got, written))
        if name == "single":
            assert column(got, name).tobytes() == column(written, name).tobytes()
        else:
            assert one.equals(other)


@pytest.mark.parametrize("name", ["id", "small", "single", "double", "path", "doubles"])
def test_columns_are_arrays_of_their_type(name):
    of = table()
    values = of[name].to_numpy(zero_copy_only=False)
    expected = np.concatenate(values) if name in {"path", "doubles"} else values
    got = column(of, name)
    assert got.dtype == expected.dtype
    np.testing.assert_array_equal(got, expected)
    in_pieces = pa.concat_tables([of.slice(0, 17), of.slice(17)])
    np.testing.assert_array_equal(column(in_pieces, name), expected)


def test_pieces_make_one_table_and_are_taken_as_they_come(tmp_path):
    whole, taken = table(), []

    def pieces():
        for first, last in ((0, 1700), (1700, 1701), (1701, 5000)):
            taken.append(first)
            yield whole.slice(first, last - first)

    write_pieces(pieces(), tmp_path / "t.parquet", seed=3)
    assert taken == [0, 1700, 1701]
    got = read_parquet(tmp_path / "t.parquet")
    assert got.schema.equals(whole.schema)
    assert got["name"].to_pylist() == whole["name"].to_pylist()
    assert read_metadata(tmp_path / "t.parquet") == {"seed": 3, VERSION: __version__}
    again = list(read_pieces(tmp_path / "t.parquet", ["id", "path"]))
    assert [len(piece) for piece in again] == [1700, 1, 3299]
    for name in ("id", "path"):
        np.testing.assert_array_equal(np.concatenate([column(piece, name) for piece in again]), column(whole, name))


def test_pieces_that_fail_leave_no_file(tmp_path):
    def pieces():
        yield table()
        raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        write_pieces(pieces(), tmp_path / "t.parquet")
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, sys
from modlhmp.storage import atomic_path
with atomic_path(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), 9)
"""


def test_what_a_killed_writer_left_is_removed_and_nothing_else(tmp_path):
    path = tmp_path / "results/run/errors/cvm.parquet"
    done = subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert done.returncode == -9
    (left,) = path.parent.iterdir()
    elsewhere = left.name.replace(_host(), "h01234567")
    others = [
        path.parent / name for name in ("cvm.parquet", "day.csv.part", ".part", ".a.part", ".a.0.part", elsewhere)
    ]
    for file in others:
        file.touch()
    with atomic_path(path.parent / "other.csv") as temporary:
        temporary.touch()
        bag = left.with_name(left.name.replace("cvm.parquet", "bag"))
        (bag / "bag").mkdir(parents=True)
        assert remove_leftovers(tmp_path / "results", tmp_path / "nothing") == [bag, left]
        assert set(path.parent.iterdir()) == {*others, temporary}
    assert remove_leftovers(tmp_path) == []
    of_last_week = time.time() - 8 * 86400
    for file in others:
        os.utime(file, (of_last_week, of_last_week))
    assert remove_leftovers(tmp_path) == [path.parent / elsewhere], "whose host cannot be asked"


def test_a_column_with_gaps_is_refused():
    gaps = pa.table({"x": pa.array([1.0, None, 3.0])})
    with pytest.raises(DataError, match="column x: 1 of 3 values are missing"):
        column(gaps, "x")


def test_paths_take_less_than_plain_zstd(tmp_path):
    """Bytes of the same place of neighbouring positions are alike."""
    rng = np.random.default_rng(1)
    xy = np.cumsum(rng.normal(0, 0.5, (2000, 60)), axis=1).astype(np.float32)
    paths = pa.table({"xy": pa.FixedSizeListArray.from_arrays(xy.ravel(), 60)})
    write_parquet(paths, tmp_path / "packed.parquet")
    pa.parquet.write_table(paths, tmp_path / "plain.parquet", compression="zstd")
    assert (tmp_path / "packed.parquet").stat().st_size < 0.9 * (tmp_path / "plain.parquet").stat().st_size
    assert packing(paths.schema)["use_dictionary"] == []
