"""Where things that others have written come in, and where results go out: an error of ours, not a library's.

What no error was foreseen for is one as well (`storage.boundary`), which says so; the trials here meet none of those.
"""

import copy
import errno
import json
import logging
import os
import re
import resource
import zipfile
from datetime import datetime

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import modlhmp
from modlhmp.cli import main
from modlhmp.datasets import load_dataset
from modlhmp.exchange.maps import kind_in, read_tables
from modlhmp.exchange.tracks import read_tracks_table
from modlhmp.exchange.trajnet import read_predictions
from modlhmp.inspection.guess import guess
from modlhmp.logs import job_log
from modlhmp.recordings import clean
from modlhmp.storage import (
    UNFORESEEN,
    DataError,
    atomic_path,
    boundary,
    read_json,
    refused,
    sealed,
    unsealed,
    write_json,
    write_parquet,
    write_text,
)

ROWS = "".join(f"{k}.5,{person},{k}.25,{person}\n" for person in range(4) for k in range(12))
DATASET = {
    "title": "T", "reader": "delimited", "timezone": "UTC", "velocity": "differences", "citation": "c", "terms": "t",
    "horizon_s": 4, "observed_rows": 3, "columns": {"track_id": 1, "t": 0, "x": 2, "y": 3},
    "recordings": [{"files": "a.csv", "day": "1970-01-01", "split": {"by": "person", "test": 0.5}}],
}  # fmt: skip


def told(error):
    """A message that somebody foresaw."""
    assert UNFORESEEN not in str(error)
    return str(error)


def cleaned(folder, listed, rows=ROWS):
    """The message with which a dataset, or one of its recordings, is refused; None where all are read."""
    (folder / "own.yaml").write_text(yaml.safe_dump(listed) if isinstance(listed, dict) else listed)
    if rows is not None:
        (folder / "a.csv").write_text(rows)
    try:
        dataset = load_dataset(folder / "own.yaml", folder)
        for one in dataset.recordings:
            clean(dataset, one)
    except DataError as error:
        return told(error)
    return None


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder, whose files every example overwrites."""
    return tmp_path_factory.mktemp("boundary")


# --- what comes in ------------------------------------------------------------------------------------------

RECORDING = DATASET["recordings"][0]


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"columns": {"track_id": 1, "t": 0, "x": 2, "y": -1}}, "columns.y: -1 is not at least 0"),
        ({"separator": "é"}, "separator"),
        ({"separator": "ab"}, "separator: 'ab' is too long"),
        ({"separator": "e"}, "separator"),
        ({"separator": "."}, "decimal '.' is also the separator"),
        *(({"separator": one}, "separator .*: give one printable character of ASCII") for one in '，│\0"5-\n'),
        ({"comment": "1"}, "comment '1': give one printable character"),
        ({"missing": {"speed": 0}}, "missing: speed: `columns` names no speed"),
        ({"horizon_s": float("inf")}, "horizon_s: inf is not a finite number"),
        ({"horizon_s": 1e308}, r"1e\+308 time steps, at most 100000"),
        ({"observed_rows": 10**17}, r"1e\+17 time steps, at most 100000"),
        ({"observed_rows": 10**30}, "observed_rows: a whole number of more than 18 digits"),
        ({"time_step_s": 1e-9}, "time_step_s: 1e-09 is not at least 0.01"),
        ({"columns": [1, 2]}, r"columns: \[1, 2\] is not a mapping"),
        ({"recordings": {"files": "a.csv"}}, "recordings: .* is not a list"),
        ({"tuned": [1]}, r"tuned: \[1\] is not a mapping"),
        ({"floor_plan": "x" * 5000}, "correct `floor_plan`"),
        ({"label": "x" * 5000}, "at most 100"),
        ({"skip_lines": 10**17}, "skip_lines .*: there are 48 lines only"),
        ({"skip_lines": 10**30}, "skip_lines: a whole number of more than 18 digits"),
        ({"recordings": [{**RECORDING, "files": "/"}]}, "files '/'"),
        ({"recordings": [{**RECORDING, "files": "a\0.csv"}]}, "no such file"),
        ({"recordings": [{**RECORDING, "days": 10**9}]}, "days 1000000000: .* give a smaller number"),
        ({"recordings": [{**RECORDING, "split": {"by": "column", "column": 3, "test": ["a"]}}]}, "compared as text"),
    ],
)
def test_a_setting_that_some_library_cannot_take_is_refused_by_name(folder, changes, match):
    assert re.search(match, cleaned(folder, {**DATASET, **changes}))


@pytest.mark.parametrize("packing", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2, zipfile.ZIP_DEFLATED])
def test_a_damaged_archive_is_refused_however_it_is_packed(folder, packing):
    listed = {**DATASET, "recordings": [{**RECORDING, "files": "d.zip"}]}
    with zipfile.ZipFile(folder / "d.zip", "w", packing) as archive:
        archive.writestr("a.csv", ROWS)
    whole = (folder / "d.zip").read_bytes()
    for at in range(10, len(whole), 5):
        (folder / "d.zip").write_bytes(whole[:at] + b"\xff\x00\x7f" + whole[at + 3 :])
        cleaned(folder, listed, None)


@pytest.mark.parametrize(
    "files",
    [
        {"notes.txt": b"hi"}, {"09.csv": b"x"}, {"09.csv": b"\xff\xfe", "10.csv": b""},
        {"09.csv": None}, {"29.csv": b"1"}, {"day.csv": b"1,2"}, {"day.csv": None}, {"09.csv": b"\0" * 99},
        {"09.parquet": b"PAR1"}, {"09.parquet": None}, {"sub": None}, {},
    ],
)  # fmt: skip
@pytest.mark.parametrize("read", [kind_in, read_tables])
def test_a_map_folder_with_foreign_files_is_refused(tmp_path, files, read):
    for name, content in files.items():
        (tmp_path / name).mkdir() if content is None else (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError) as error:
        read(tmp_path)
    assert str(tmp_path) in told(error.value)


def test_the_good_dataset_is_good(folder):
    assert cleaned(folder, DATASET) is None


KEYS = """
columns units recordings separator decimal thousands comment skip_lines missing only without horizon_s time_step_s
observed_rows observed_s cleaning homography origin_m hours figure_hours areas tuned sources accept label scale
difference_weights paper_protocol timezone frame_rate reader max_gap_s max_jump_mps floor_plan
"""
SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 5), st.just(10**30), st.floats(), st.text(max_size=3),
    st.sampled_from(["a.csv", "person", "time", "x", "../x", "1", "\0", "é", "m", "s"]),
)  # fmt: skip
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["t", "x", "y", "by", "files", "test", "column", "track_id", "a", "0"]), inner, max_size=3
        )
    ),
    max_leaves=6,
)


@settings(max_examples=200, derandomize=True, deadline=None)
@given(key=st.sampled_from(KEYS.split()), value=VALUES, within=st.booleans())
def test_a_dataset_file_with_any_value_anywhere(folder, key, value, within):
    listed = copy.deepcopy(DATASET)
    if within and isinstance(listed.get(key), dict):
        listed[key][sorted(listed[key])[0]] = value
    elif within and key == "recordings":
        listed[key][0]["split"] = value
    else:
        listed[key] = value
    cleaned(folder, listed)


def test_what_nobody_foresaw_is_ours_and_says_so():
    with (
        pytest.raises(
            DataError, match=r"day\.csv: cannot be read \(KeyError: 'a'\); if it is as it should be"
        ) as error,
        boundary("day.csv", "cannot be read"),
    ):
        raise KeyError("a")
    assert isinstance(error.value.__cause__, KeyError)
    with pytest.raises(MemoryError), boundary("day.csv", "cannot be read"):
        raise MemoryError


def test_what_is_foreseen_is_told_and_errors_of_ours_stay():
    for error, told in [
        (ValueError("a\nb"), "day.csv: not a number (a); correct it"),
        (OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG)), "day.csv: not a number (File name too long); "),
        (DataError("day.csv: mine"), "day.csv: mine"),
    ]:
        with (
            pytest.raises(DataError, match=re.escape(told)),
            refused("day.csv: not a number", ValueError, OSError, remedy="correct it"),
        ):
            raise error
    with pytest.raises(KeyError), refused("day.csv: not a number", ValueError):
        raise KeyError


# --- what goes out ------------------------------------------------------------------------------------------


@pytest.fixture
def little_room():
    """A limit of 4 kB for files, which libraries meet like a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.json", lambda path: write_json(path, {"a": "x" * 9999})),
        ("a.txt", lambda path: write_text(path, "x" * 9999)),
        ("a.parquet", lambda path: write_parquet(pa.table({"a": np.random.default_rng(0).random(9999)}), path)),
    ],
)
def test_a_full_disk_is_told_and_leaves_the_file_of_before(tmp_path, little_room, name, write):
    path = tmp_path / name
    write_json(path, {"a": 1})
    with pytest.raises(DataError, match=rf"{name}: cannot be written \(.*\); make room, then run again"):
        write(path)
    assert read_json(path) == {"a": 1}
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "a").write_text("")
    with pytest.raises(DataError, match=r"b\.txt: cannot be written .* the folder may be written to, then run again"):
        write_text(tmp_path / "a/b.txt", "x")


def test_an_error_of_reading_while_writing_stays_one(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text((tmp_path / "missing").read_text())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("error", "match"),
    [
        (MemoryError("8 GB"), r"memory does not suffice \(8 GB\): this job had \d+ MB; run fewer jobs at once"),
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), "No space left on device: make room, then run again"),
    ],
)
def test_a_job_without_memory_or_room_ends_with_a_message(tmp_path, capsys, error, match):
    handlers = logging.getLogger().handlers[:]
    with pytest.raises(SystemExit), job_log(tmp_path / "log"):
        raise error
    for handler in set(logging.getLogger().handlers) - set(handlers):
        handler.close()
    logging.getLogger().handlers[:] = handlers
    assert re.search(match, (tmp_path / "log").read_text())
    assert "Traceback" not in (tmp_path / "log").read_text()


# --- found by fuzzing (test_fuzz.py), and mended as a kind ---------------------------------------------------


@pytest.mark.parametrize("field", ["f", "p", "x", "prediction_number", "scene_id"])
def test_a_whole_number_of_hundreds_of_digits_in_json(write, field):
    track = {"f": 4, "p": 0, "x": 1, "y": 1, "prediction_number": 0, "scene_id": 0, field: 10**400}
    with pytest.raises(DataError, match=r"f\.ndjson, row 1: .*NaN, or as large"):
        read_predictions(write(json.dumps({"track": track}), "f.ndjson"), 4, 8)


@pytest.mark.parametrize(
    "values",
    [pa.array([datetime(2012, 10, 24)]), pa.array([b"\xff"]), pa.array([True]), pa.array([2**60 + 1]), pa.array([[1]])],
)
@pytest.mark.parametrize("name", ["track_id", "x"])
def test_a_column_of_parquet_of_another_type(tmp_path, name, values):
    columns = {**dict.fromkeys(("track_id", "t", "x", "y"), pa.array([1.0])), name: values}
    pq.write_table(pa.table(columns), tmp_path / "t.parquet")
    try:
        read_tracks_table(tmp_path / "t.parquet")
    except DataError as error:
        assert re.search(rf"t\.parquet: column {name} is ", told(error))


@pytest.mark.parametrize("encoding", ["foo", "utf-7", "big5", "utf-16"])
def test_xml_in_another_encoding(write, encoding):
    path = write(f'<?xml version="1.0" encoding="{encoding}"?><map></map>', "m.xml")
    with pytest.raises(DataError, match=r"m\.xml: (cannot be decoded|line 1: not XML|no CLiFF-map)") as error:
        modlhmp.load_map(path, "xml", site=modlhmp.Site())
    told(error.value)


@pytest.mark.parametrize(
    ("form", "row"), [("stef_csv", "0,0,1e308,1e308\n"), ("matlab", "0,0,1,1,.1,0,0,.1,1e308,1,1\n" * 2)]
)
def test_weights_whose_sum_is_no_number(write, form, row):
    with pytest.raises(DataError, match=r"m\.csv: row 1: weight 1e\+308 is above 1e\+09"):
        modlhmp.load_map(write(row, "m.csv"), form, site=modlhmp.Site())


@pytest.mark.parametrize(
    "line", ["1", "[1]", '{"track": 1, "scene": {"fps": [1]}}', '{"scene": {"fps": {}}, "a": 1}', "[" * 9000]
)
def test_lines_of_json_that_are_no_tracks(write, line):
    with pytest.raises(DataError, match=r"a\.ndjson") as error:
        guess(write(f'{{"track": {{}}}}\n{line}\n{line}\n', "a.ndjson"))
    told(error.value)


def test_a_message_about_a_line_without_end_has_one():
    """It keeps its beginning, with the file's name, and its end, with the remedy."""
    message = str(DataError("a.csv: " + "b" * 100_000 + "; remedy"))
    assert len(message) < 5000
    assert message.startswith("a.csv: bb") and " [...] " in message and message.endswith("bb; remedy")


@pytest.mark.parametrize("content", ["[1]", '"a"', "{", "[" * 5000, "{}"])
def test_sealed_json_of_something_else(tmp_path, content):
    text = json.dumps(unsealed())[:-1] + ', "a": 1}' if content == "{}" else content
    (tmp_path / "a.json").write_bytes(sealed((f"{text} " + json.dumps(unsealed())).encode()))
    with pytest.raises(DataError, match=r"a\.json: is no JSON that modlhmp has written; delete it and make it again"):
        read_json(tmp_path / "a.json")


@pytest.mark.parametrize("value", ["[" * 5000, "2001-13-01", "{", "&a [*a]"])
def test_options_that_are_no_values(tmp_path, capsys, monkeypatch, value):
    rows = str(tmp_path / "rows")
    for verb in (["live", "--map", "no.parquet", rows], ["map", "info", "no.parquet"]):
        monkeypatch.setattr("sys.argv", ["modlhmp", *verb, "--set", f"k={value}"])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 1
        assert told(capsys.readouterr().err)
