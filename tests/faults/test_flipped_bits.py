"""A file of ours in which a single bit differs is refused; a foreign one without a seal is read."""

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch

import modlhmp
from modlhmp.networks.training import load_checkpoint, save_checkpoint
from modlhmp.networks.weights import read_weights, write_weights
from modlhmp.origins import provenance
from modlhmp.storage import (
    VERSION,
    DataError,
    read_json,
    read_metadata,
    read_parquet,
    read_pieces,
    write_json,
    write_parquet,
    write_pieces,
)

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
    assert read_metadata(tmp_path / "a.parquet") == {VERSION: modlhmp.__version__, "dataset": "hall", "seed": 3}


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


def test_nothing_but_the_storage_layer_opens_parquet():
    """So that no reader goes around the seal."""
    source = Path(modlhmp.__file__).parent
    around = [
        file.name
        for file in source.rglob("*.py")
        if file.name != "storage.py"
        and any(way in file.read_text() for way in ("pyarrow.parquet", "pyarrow.dataset", "pd.read_parquet"))
    ]
    assert around == []


# --- JSON and weights ---------------------------------------------------------------------------------------

TOLD = {"minutes": 3.25, "curve": [{"epoch": 1, "what": 'ä "modlhmp.seal": "'}], "origin": {"code": "abc"}}
WEIGHTS = {
    "bias": torch.linspace(-1, 1, 5),
    "steps": torch.tensor(7),
    "weight": torch.arange(6, dtype=torch.float64).reshape(2, 3).t(),
    "none": torch.zeros(0, 4),
}
WRITE = {
    "json": lambda path: write_json(path, TOLD),
    "safetensors": lambda path: write_weights(path, WEIGHTS, {"kind": "lstm", "shape": [8, 4, 1.0]}),
}
READ = {"json": read_json, "safetensors": read_weights}


def test_json_is_read_as_it_was_written(tmp_path):
    write_json(tmp_path / "a.json", TOLD)
    assert read_json(tmp_path / "a.json") == TOLD
    assert json.loads((tmp_path / "a.json").read_text()).items() >= TOLD.items()


def test_weights_are_read_as_they_were_written(tmp_path):
    WRITE["safetensors"](tmp_path / "a.safetensors")
    weights, settings = read_weights(tmp_path / "a.safetensors")
    assert settings == {"kind": "lstm", "shape": [8, 4, 1.0]}
    assert weights.keys() == WEIGHTS.keys()
    for name, value in WEIGHTS.items():
        assert weights[name].dtype == value.dtype
        assert weights[name].shape == value.shape
        assert torch.equal(weights[name], value)


def test_the_same_weights_are_the_same_bytes(tmp_path):
    """In whatever order they come, and in other processes, in which sets have other orders."""
    code = "import sys, torch; from modlhmp.networks.weights import write_weights; "
    code += "write_weights(sys.argv[1], {'b': torch.ones(3), 'a': torch.zeros(2)}, {'x': 1, 'y': [2]})"
    for number in (1, 2):
        environment = {**os.environ, "PYTHONHASHSEED": str(number)}
        subprocess.run([sys.executable, "-c", code, tmp_path / f"{number}.safetensors"], env=environment, check=True)
    write_weights(tmp_path / "3.safetensors", {"a": torch.zeros(2), "b": torch.ones(3)}, {"y": [2], "x": 1})
    assert len({(tmp_path / f"{number}.safetensors").read_bytes() for number in (1, 2, 3)}) == 1


@pytest.mark.parametrize("form", WRITE)
def test_every_flipped_bit_of_json_and_weights_is_an_error_that_names_the_file(tmp_path, form):
    path = tmp_path / f"a.{form}"
    WRITE[form](path)
    written = path.read_bytes()
    for bit in range(8 * len(written)):
        damaged = bytearray(written)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        with pytest.raises(DataError, match=rf"a\.{form}: .*; delete it and make it again"):
            READ[form](path)


@pytest.mark.parametrize("form", WRITE)
def test_cut_emptied_and_longer_files_are_errors(tmp_path, form):
    path = tmp_path / f"a.{form}"
    WRITE[form](path)
    written = path.read_bytes()
    for content in (b"", written[:7], written[:-1], written[1:], written + b"\n", written[:200] + written):
        path.write_bytes(content)
        with pytest.raises(DataError, match="delete it and make it again"):
            READ[form](path)


def test_the_origin_of_damaged_json_is_not_taken(tmp_path):
    """Also where the damage hides what tells our files from others."""
    path = tmp_path / "a.json"
    write_json(path, TOLD)
    assert provenance({}, {}, [path])["sources"] == {}
    for mark in (b"modlhmp.seal", b"origin"):
        path.write_bytes(json.dumps({"modlhmp.seal": "0" * 64, **TOLD}).encode().replace(mark, b"x" * len(mark), 1))
        with pytest.raises(DataError, match="seal"):
            provenance({}, {}, [path])


def test_json_of_others_is_a_source(tmp_path):
    (tmp_path / "sheet.json").write_text('{"task": "abc"}')
    assert list(provenance({}, {}, [tmp_path / "sheet.json"])["sources"]) == ["sheet.json"]


def test_a_training_does_not_go_on_from_a_damaged_checkpoint(tmp_path):
    """Torch reads one in which numbers have changed without a word."""
    path, log = tmp_path / "a.checkpoint", logging.getLogger("checkpoint")
    save_checkpoint(path, {"fingerprint": "abc", "weights": WEIGHTS})
    assert load_checkpoint(path, "abc", log)["weights"]["steps"] == 7
    written = path.read_bytes()
    for byte in range(0, len(written), 23):
        path.write_bytes(written[:byte] + bytes([written[byte] ^ 16]) + written[byte + 1 :])
        assert load_checkpoint(path, "abc", log) is None
