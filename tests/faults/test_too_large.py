"""Small files made to fill memory or take for ever: each is refused by name, in time that is linear in its bytes."""

import contextlib
import gzip
import io
import sqlite3
import time
import tracemalloc
import zipfile

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

import modlhmp
from modlhmp import ids, storage
from modlhmp.cli import main
from modlhmp.exchange import cliff_xml, columns, rows, tracks
from modlhmp.exchange.forecasts import TYPES, read_samples
from modlhmp.exchange.hand_in import read_sheet
from modlhmp.exchange.tracks import read_tracks_table
from modlhmp.file_format import Columns, FileFormat
from modlhmp.floor_plan import load_floor_plan
from modlhmp.inspection.guess import guess
from modlhmp.readers import edinburgh, raw, read_recording
from modlhmp.readers.numerals import number
from modlhmp.readers.start import MOST_COLUMNS
from modlhmp.storage import DataError
from modlhmp.yaml_file import read_yaml

POSITIONS = Columns(t=0, track_id=1, x=2, y=3)
FORMS = {
    "csv": FileFormat(columns=POSITIONS, timezone="UTC"),
    "text": FileFormat(reader="text", columns=POSITIONS, timezone="UTC"),
    "edinburgh": FileFormat(reader="edinburgh", frame_rate=9.0, scale=0.0247, timezone="UTC"),
    "trajnet": FileFormat(reader="trajnet", frame_rate=1.0, timezone="UTC"),
    "magni": FileFormat(reader="magni", timezone="UTC"),
}
GOOD = b"".join(b"%d,1,%d.5,2\n" % (n, n) for n in range(9))


def refused(path, form, match):
    with pytest.raises(DataError, match=match):
        read_recording(path, FORMS[form])


def packed(path, pieces):
    """A .gz or .zip of bytes that come in pieces."""
    if path.suffix == ".gz":
        with gzip.open(path, "wb") as file:
            file.writelines(pieces)
    else:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("day.csv", "w") as file:
            for piece in pieces:
                file.write(piece)
    return path


@pytest.mark.parametrize("form", set(FORMS) - {"magni"})
def test_a_line_without_end_is_refused(write, form):
    start = b"TRACK.R1=[" if form == "edinburgh" else b""
    refused(write(start + b"[1 2 3];" * (raw.MOST_LINE_BYTES // 8 + 1)), form, "a line has more than 8 MiB")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("suffix", [".gz", ".zip"])
@pytest.mark.parametrize("byte", [b"\0", b"\n"])
def test_an_archive_that_holds_far_more_than_its_size_is_refused(tmp_path, monkeypatch, form, suffix, byte):
    monkeypatch.setattr(raw, "LEAST_BYTES", 1 << 20)
    path = packed(tmp_path / f"day.csv{suffix}", [byte * (1 << 20)] * 4)
    refused(
        path,
        form,
        r"day\.csv.*(more than 1 MB, over 250 times its own size|not text|no line)",
    )


def test_an_archive_of_text_is_read_however_small_it_becomes(tmp_path):
    path = packed(tmp_path / "day.csv.gz", [GOOD, b"\n" * 1_000_000])
    tracks, account = read_recording(path, FORMS["csv"])
    assert len(tracks.t) == 9
    assert account.dropped_rows == {"blank_line": 1_000_000}


def test_a_file_that_is_read_whole_has_a_limit(write, monkeypatch):
    monkeypatch.setattr(raw, "MOST_WHOLE_BYTES", 1000)
    refused(write(b"Frame,Time\n" * 200), "magni", "more than 0 MiB, which this form cannot have")


def test_columns_have_a_limit(write):
    refused(write(b",".join([b"1.5"] * (MOST_COLUMNS + 1)) + b"\n"), "csv", "row 1: 10001 columns; at most 10000")
    assert len(read_recording(write(b",".join([b"1"] * MOST_COLUMNS) + b"\n"), FORMS["csv"])[0].t) == 1


@pytest.mark.parametrize(
    "line",
    [
        b"TRACK.R1=[[1 2 3]" + b" " * 300_000 + b"x",
        b"TRACK.R1=[[" + b" " * 300_000 + b"1 2 3];[" + b" " * 300_000 + b"];",
        b"TRACK.R1" + b" " * 300_000 + b"=[",
        b"TRACK.R1=[" + b"]  " * 100_000 + b"x",
        b"Total number of trajectories in file are" + b" " * 300_000 + b"x",
    ],
)
def test_blanks_in_a_track_do_not_take_for_ever(write, line):
    """300 kB took ten minutes where time was quadratic; the bound is far from both."""
    began = time.process_time()
    with contextlib.suppress(DataError):
        read_recording(write(line + b"\n"), FORMS["edinburgh"])
    assert time.process_time() - began < 20


@pytest.mark.parametrize("digits", [19, 20, 5000])
@pytest.mark.parametrize("what", ["TRACK.R%s=[[1 2 3];[4 5 6]];", "Total number of trajectories in file are %s"])
def test_numbers_of_thousands_of_digits_are_refused(write, digits, what):
    refused(write((what % ("9" * digits)).encode() + b"\n"), "edinburgh", "line 1: .*64 bits|digits|announces 9+")


@pytest.mark.parametrize("form", ["csv", "text", "trajnet", "edinburgh"])
def test_blank_lines_by_the_million(write, form):
    """Where a first row is looked for, and after it."""
    began = time.process_time()
    for before in (b"", GOOD):
        try:
            read_recording(write(before + b"\n" * 400_000), FORMS[form])
        except DataError as error:
            assert "recording.csv" in str(error)
    assert time.process_time() - began < 20


BOMB = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 9)
)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (BOMB, r"a\.yaml: stands for .* values, by aliases"),
        ("a: &a {b: [*a]}\n", "alias .* within what it stands for"),
        ("a:\n b: " + "[" * 20_000, r"a\.yaml, line 2: nested too deep: at most 50 values within values"),
        ("a: " + "x" * 250_001, "more than 250000 characters"),
    ],
)
def test_yaml_that_stands_for_more_than_it_holds_is_refused(tmp_path, text, match):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(DataError, match=match):
        read_yaml(tmp_path / "a.yaml", "a dataset")


def test_yaml_as_deep_as_allowed_is_read(tmp_path):
    (tmp_path / "a.yaml").write_text("a: " + "[" * 48 + "]" * 48)
    assert str(read_yaml(tmp_path / "a.yaml", "a dataset")["a"]) == "[" * 48 + "]" * 48


def test_yaml_with_aliases_is_read(tmp_path):
    (tmp_path / "a.yaml").write_text("a: &a {b: 1}\nc: *a\nd: {<<: *a, e: 2}\n")
    assert read_yaml(tmp_path / "a.yaml", "a dataset") == {"a": {"b": 1}, "c": {"b": 1}, "d": {"b": 1, "e": 2}}


def test_a_plan_s_cells_do_not_depend_on_the_bands_it_is_read_in(tmp_path, monkeypatch):
    grey = np.random.default_rng(0).integers(0, 256, (50, 30, 2), np.uint8)
    Image.fromarray(grey, "LA").save(tmp_path / "plan.png")
    (tmp_path / "plan.yaml").write_text(
        "image: plan.png\nresolution: 0.5\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    whole = load_floor_plan(tmp_path / "plan.yaml").cells
    for pixels in (1, 70, 1000):
        monkeypatch.setattr("modlhmp.floor_plan._BAND_PIXELS", pixels)
        np.testing.assert_array_equal(load_floor_plan(tmp_path / "plan.yaml").cells, whole)


def test_colours_of_a_large_plan_are_not_all_held_at_once(tmp_path):
    """As numbers they take twenty bytes a pixel, four in the image and one in the plan."""
    Image.new("RGBA", (3000, 3000)).save(tmp_path / "plan.png")
    (tmp_path / "plan.yaml").write_text(
        "image: plan.png\nresolution: 0.5\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    load_floor_plan(tmp_path / "plan.yaml")
    tracemalloc.start()  # of numpy's arrays, not of Pillow's image
    load_floor_plan(tmp_path / "plan.yaml")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 7 * 3000 * 3000


@pytest.mark.parametrize(
    "text",
    [
        b"[" * 200_000 + b",x,y\n1,2,3\n",
        b"\n" * 200_000 + b"1,2,3\n",
        b" " * 200_000 + b"x\n",
        b"9" * 200_000 + b"x,1,2\n",
    ],
)
@pytest.mark.parametrize("end", [b"", GOOD])
def test_looking_at_a_file_takes_time_in_proportion(write, text, end):
    """Names, blanks and digits without end: their square was looked at."""
    began = time.process_time()
    with contextlib.suppress(DataError):
        guess(write(text + end))
    with contextlib.suppress(DataError):
        read_recording(write(text + end), FORMS["csv"])
    assert number("9" * 200_000 + "x") is None
    assert time.process_time() - began < 20


# --- maps, forecasts and tracks of others -------------------------------------------------------------------


def foreign_map(path, form):
    return modlhmp.load_map(path, form, site=modlhmp.Site())


def test_a_map_s_file_has_a_limit(write, monkeypatch):
    monkeypatch.setattr(rows, "MOST_BYTES", 1 << 20)
    for form in ("stef_csv", "xml", None):
        with pytest.raises(DataError, match=r"m\.csv: more than 1 MiB, .* give it as Parquet"):
            foreign_map(write(b"1,2,3,4\n" * 140_000, "m.csv"), form)


def test_a_map_from_a_stream_has_the_same_limit(monkeypatch, capsys):
    monkeypatch.setattr(rows, "MOST_BYTES", 1 << 10)
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"1,2,3,4\n" * 200)))
    monkeypatch.setattr("sys.argv", ["modlhmp", "map", "info", "-", "--form", "stef_csv"])
    with pytest.raises(SystemExit):
        main()
    assert "standard input: more than 0 MiB" in capsys.readouterr().err


def test_columns_of_a_map_have_a_limit(write):
    with pytest.raises(DataError, match=r"m\.csv: row 2 has 401 columns; at most 400 are read"):
        foreign_map(write(b"\n" + b",".join([b"1"] * 401) + b"\n", "m.csv"), "stef_csv")


def test_tags_of_a_map_have_a_limit(write, monkeypatch):
    monkeypatch.setattr(cliff_xml, "MOST_TAGS", 100)
    with pytest.raises(DataError, match=r"m\.xml: more than 100 tags: give so large a map as CSV or Parquet"):
        foreign_map(write(b"<map>" + b"<a/>" * 100 + b"</map>", "m.xml"), "xml")


@pytest.mark.parametrize(("header", "match"), [("a," * 5_000, "a"), ("x," * 5_000, "two columns are called x")])
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_columns_of_forecasts_are_looked_at_before_they_are_read(tmp_path, monkeypatch, suffix, header, match):
    path = tmp_path / f"f{suffix}"
    if suffix == ".csv":
        path.write_text(f"{header}\n")
        monkeypatch.setattr(columns.pc, "read_csv", None)
    else:
        names = header.split(",")[:-1]
        pq.write_table(pa.table([pa.array([1.0])] * len(names), names=names), path)
        monkeypatch.setattr(columns, "read_parquet", None)
    with pytest.raises(DataError, match=rf"{path.name}.*{match}"):
        read_samples(path, 1.0)


@pytest.mark.parametrize(
    ("header", "match"), [("a," * 5_000, "column named 'a'"), ("x," * 5_000, "two columns"), ("\xff", "column named")]
)
def test_columns_of_a_stream_are_looked_at_before_it_is_read(monkeypatch, header, match):
    rows = io.BytesIO(header.encode("latin-1") + b"\n")
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(rows))
    monkeypatch.setattr(columns.pc, "read_csv", None)
    with pytest.raises(DataError, match=f"-: .*{match}"):
        read_samples("-", 1.0)


def test_what_was_looked_at_of_a_stream_is_read_with_the_rest(monkeypatch):
    whole = b"\xef\xbb\xbftrack_id,step,x,y\n" + b"".join(b"1,%d,2,3\n" % step for step in range(1, 300_000))
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(whole)))
    assert columns.read_columns("-", TYPES).column("step").to_pylist() == list(range(1, 300_000))
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(whole + b"1,1,2,b\n")))
    with pytest.raises(DataError, match="-, row 300001: y 'b' is not a number"):
        columns.read_columns("-", TYPES)


def test_a_name_within_quotes_is_one_column(write):
    with pytest.raises(DataError, match=r"f\.csv.*x,y"):
        read_samples(write(b'track_id,step,"x,y"\n1,1,1\n', "f.csv"), 1.0)


def test_parquet_that_stands_for_more_than_can_be_held_is_refused(tmp_path):
    """Ten million times the same number are stored in a few kB."""
    path, ones = tmp_path / "f.parquet", pa.array(np.ones(15_000_000))
    pq.write_table(pa.table(dict.fromkeys(("track_id", "step", "x", "y"), ones)), path)
    assert path.stat().st_size < 1_000_000
    for read in (lambda: read_samples(path, 1.0), lambda: read_tracks_table(path), lambda: modlhmp.load_map(path)):
        with pytest.raises(DataError, match=r"f\.parquet: stands for 480 MB, over 400 MB and 10 times its size"):
            read()


def test_a_text_of_parquet_that_stands_for_many_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(columns, "MOST_TEXT_BYTES", 1 << 20)
    ones = pa.array(np.ones(9_000))
    for length in (10, 1_000):
        texts = pa.DictionaryArray.from_arrays(pa.array(np.zeros(9_000, np.int32)), pa.array(["a" * length]))
        table = {"track_id": texts.cast(pa.string()), "t": pa.array(np.arange(9_000.0)), "x": ones, "y": ones}
        pq.write_table(pa.table(table), tmp_path / "t.parquet")
        if length == 10:
            assert list(read_tracks_table(tmp_path / "t.parquet")[1].values()) == ["a" * 10]
    with pytest.raises(DataError, match=r"t\.parquet: column track_id has more than 1 MiB of text; shorten it"):
        read_tracks_table(tmp_path / "t.parquet")


def test_people_of_a_recording_have_a_limit(write, monkeypatch):
    """Four million names took 1.8 GB."""
    monkeypatch.setattr(ids, "MOST_PEOPLE", 3)
    for people in (3, 6):
        path = write("".join(f"{n},a{k},1,1\n" for k in range(people) for n in range(2)))
        if people == 3:
            assert len(read_recording(path, FORMS["csv"])[0].t) == 6
    refused(path, "csv", r"recording\.csv, row 9: more than 3 ids that are texts: divide the file by people")


def test_tracks_of_edinburgh_have_a_limit(write, monkeypatch):
    monkeypatch.setattr(edinburgh, "MOST_PEOPLE", 2)
    path = write("".join(f"TRACK.R{n}=[[1 2 3]];\n" for n in (1, 2, 3)))
    refused(path, "edinburgh", r"recording\.csv, line 3: more than 2 tracks; divide the file")


@pytest.mark.parametrize("read", [lambda path: read_samples(path, 1.0), read_tracks_table])
def test_people_have_a_limit(write, monkeypatch, read):
    monkeypatch.setattr(tracks, "MOST_PEOPLE", 2)
    for people in (2, 3):
        path = write("track_id,t,x,y\n" + "".join(f"a{n},1,1,1\n" for n in range(people)), "f.csv")
        if people == 2:
            read(path)
    with pytest.raises(DataError, match=r"f\.csv: 3 track ids; at most 2 of a file are read: divide it"):
        read(path)


@pytest.mark.parametrize("row", [b"\n", b"\r", b"1,1,1,1\n"])
@pytest.mark.parametrize("read", [lambda path: read_samples(path, 1.0), read_tracks_table])
def test_lines_of_forecasts_and_tracks_that_stand_for_more_than_can_be_held(write, monkeypatch, row, read):
    """Fifty megabytes of blank lines took two gigabytes: a line without anything in it is a row in memory."""
    monkeypatch.setattr(storage, "MOST_HELD", 120_000)
    path = write(b"track_id,t,x,y\n" + row * 40_000, "f.csv")
    monkeypatch.setattr(columns.pc, "read_csv", None)
    with pytest.raises(DataError, match=r"f\.csv: stands for 5 MB, over [03] MB and 10 times its size"):
        read(path)


def test_a_form_is_told_by_the_first_row_where_that_is_enough(write, monkeypatch):
    """All of a map was read to say that it has three columns."""
    seen = []
    monkeypatch.setattr(rows, "number", lambda text: seen.append(text) or number(text))
    with pytest.raises(DataError, match=r"m\.csv: 3 columns"):
        foreign_map(write(b"1,2,3\n" * 1000, "m.csv"), None)
    assert len(seen) <= 6


def test_a_sheet_has_a_limit(write):
    with pytest.raises(DataError, match=r"f\.json: more than 1,000,000 bytes"):
        read_sheet(write(b'{"task": [' + b"[]," * 400_000 + b"0]}", "f.json"))


# --- databases ----------------------------------------------------------------------------------------------

ENDLESS = (
    "CREATE VIEW trajectory_data AS WITH RECURSIVE c(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM c) "
    "SELECT n AS id, n AS frame, 0.0 AS pos_x, 0.0 AS pos_y FROM c"
)
WITHOUT_ROWS = ENDLESS + " WHERE n < 0"
COMPUTED = "CREATE TABLE trajectory_data (id INTEGER, frame INTEGER, pos_x REAL, pos_y AS (hex(zeroblob(400000000))))"


@pytest.mark.parametrize(
    ("made", "match"), [(ENDLESS, "interrupted"), (WITHOUT_ROWS, "interrupted"), (COMPUTED, "computed, not stored")]
)
def test_a_database_that_computes_its_rows_is_refused(tmp_path, made, match):
    began = time.process_time()
    with contextlib.closing(sqlite3.connect(tmp_path / "a.sqlite")) as file:
        file.execute("CREATE TABLE metadata (key TEXT, value TEXT)")
        file.execute("INSERT INTO metadata VALUES ('fps', '10')")
        file.execute(made)
        if made == COMPUTED:
            file.execute("INSERT INTO trajectory_data VALUES (1, 1, 1.0)")
        file.commit()
    with pytest.raises(DataError, match=rf"a\.sqlite: .*{match}"):
        read_recording(tmp_path / "a.sqlite", FileFormat(reader="jupedsim", timezone="UTC"))
    assert time.process_time() - began < 5


def test_rows_of_magni_that_stand_for_more_than_can_be_held(write, monkeypatch):
    """A row of eight bytes is a position of each body."""
    monkeypatch.setattr(storage, "MOST_HELD", 120_000)
    head = b"Frame,Time,Helmet_1 Centroid_X,Helmet_1 Centroid_Y\n"
    assert len(read_recording(write(head + b"1,1,1,1\n" * 1000), FORMS["magni"])[0].t) == 1
    with pytest.raises(DataError, match=r"recording\.csv: stands for 1 MB, over 1 MB and 10 times its size"):
        read_recording(write(head + b"1,1,1,1\n" * 8000), FORMS["magni"])


def test_columns_of_magni_have_a_limit(write):
    """Eight million of them took more than four gigabytes, and ended the process."""
    head = b"KEY,1\nFrame,Time,Helmet_1 Centroid_X,Helmet_1 Centroid_Y"
    refused(write(head + b",a" * MOST_COLUMNS + b"\n1,1,1,1\n"), "magni", "row 2: 10004 columns; at most 10000")


def test_fill_values_of_hdf5_are_not_made(tmp_path):
    kind = np.dtype([("id", "i8"), ("frame", "i8"), ("x", "f8"), ("y", "f8")])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("trajectory", (100_000_000,), kind, chunks=(1000,)).attrs["fps"] = 10.0
    with pytest.raises(DataError, match=r"a\.h5: stands for 12,000 MB, over 400 MB"):
        read_recording(tmp_path / "a.h5", FileFormat(reader="hdf5", timezone="UTC"))
