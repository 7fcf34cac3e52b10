"""A file of ours in which a single bit differs is refused; a foreign one without a seal is read."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from modlhmp.storage import DataError, read_metadata, read_parquet, read_pieces, write_parquet, write_pieces

TABLE = pa.table(
    {"track_id": np.arange(40), "x": np.linspace(0, 1, 40, dtype=np.float32), "who": [f"P{i}" for i in range(40)]}
)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("sealed") / "table.parquet"
    write_parquet(TABLE, path, dataset="hall", seed=3)
    return path.read_bytes()


def test_what_is_written_is_read(written, tmp_path):
    (tmp_path / "a.parquet").write_bytes(written)
    assert read_parquet(tmp_path / "a.parquet").equals(TABLE)
    assert read_metadata(tmp_path / "a.parquet") == {"dataset": "hall", "seed": 3}


def test_every_flipped_bit_is_an_error_that_names_the_file(written, tmp_path):
    path = tmp_path / "a.parquet"
    for bit in range(8 * len(written)):
        damaged = bytearray(written)
        damaged[bit // 8] ^= 1 << bit % 8
        path.unlink(missing_ok=True)
        path.write_bytes(damaged)
        for read in (read_parquet, read_metadata):
            with pytest.raises(DataError, match=r"a\.parquet: .*; delete it and make it again"):
                read(path)


@pytest.mark.parametrize("kept", [0, 3, 7, 8, 100, -1])
def test_a_cut_file_is_an_error(written, tmp_path, kept):
    path = tmp_path / "a.parquet"
    path.write_bytes(written[:kept])
    with pytest.raises(DataError, match=r"a\.parquet: .*; delete it and make it again"):
        read_parquet(path)


def test_added_bytes_are_an_error(written, tmp_path):
    path = tmp_path / "a.parquet"
    path.write_bytes(b"PAR1" + written)
    with pytest.raises(DataError, match="seal"):
        read_parquet(path)


def test_a_file_written_in_pieces_is_sealed(tmp_path):
    path = tmp_path / "a.parquet"
    write_pieces([TABLE, TABLE], path)
    assert pa.concat_tables(read_pieces(path)).equals(pa.concat_tables([TABLE, TABLE]))
    damaged = bytearray(path.read_bytes())
    damaged[40] ^= 4
    path.unlink()
    path.write_bytes(damaged)
    with pytest.raises(DataError, match="seal"):
        list(read_pieces(path))


def test_the_same_table_is_the_same_bytes(written, tmp_path):
    write_parquet(TABLE, tmp_path / "b.parquet", dataset="hall", seed=3)
    assert (tmp_path / "b.parquet").read_bytes() == written


def test_a_foreign_file_has_no_seal_and_is_read(tmp_path):
    pq.write_table(TABLE, tmp_path / "a.parquet")
    assert read_parquet(tmp_path / "a.parquet").equals(TABLE)
    assert read_metadata(tmp_path / "a.parquet") == {}


def test_our_own_file_without_its_seal_is_refused(tmp_path):
    """As one of before there were seals, or one that somebody has rewritten."""
    pq.write_table(TABLE.replace_schema_metadata({b"modlhmp": b"{}"}), tmp_path / "a.parquet")
    with pytest.raises(DataError, match="seal"):
        read_parquet(tmp_path / "a.parquet")
