"""Small files made to fill memory or take for ever: each is refused by name, in time that is linear in its bytes."""

import contextlib
import gzip
import time
import zipfile

import numpy as np
import pytest
from PIL import Image

from modlhmp.file_format import Columns, FileFormat
from modlhmp.floor_plan import load_floor_plan
from modlhmp.readers import raw, read_recording
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
        r"day\.csv.*(more than 1 MB, over 250 times its own size|no column 1|no line)",
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
        ("a: " + "[" * 20_000, "nested too deep|not valid YAML"),
        ("a: " + "x" * 1_000_001, "more than 1000000 characters"),
    ],
)
def test_yaml_that_stands_for_more_than_it_holds_is_refused(tmp_path, text, match):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(DataError, match=match):
        read_yaml(tmp_path / "a.yaml", "a dataset")


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
