"""Damaged, wrong and foreign files: a `DataError` that names the file and the remedy, or a counted drop."""

import bz2
import dataclasses
import gzip
import io
import itertools
import lzma
import re
import tarfile
import zipfile

import numpy as np
import pytest

from modlhmp.cleaning import clean_recording
from modlhmp.file_format import Columns, FileFormat, Recording
from modlhmp.readers import raw
from modlhmp.storage import DataError

LONDON = {"timezone": "Europe/London"}
FORUM = {**LONDON, "frame_rate": 9.0, "scale": 0.0247}
FORMS = {
    "atc": FileFormat(reader="atc", timezone="Asia/Tokyo"),
    "atc_1hz": FileFormat(reader="atc_1hz", timezone="Asia/Tokyo"),
    "edinburgh": FileFormat(reader="edinburgh", **FORUM),
    "edinburgh_rows": FileFormat(reader="edinburgh_rows", row_stride=4, **FORUM),
    "named": FileFormat(header=True, columns=Columns(t="time", track_id="person", x="x", y="y"), **LONDON),
    "positions": FileFormat(columns=Columns(t=0, track_id=1, x=2, y=3), **LONDON),
}
ATC_DAY, OTHER_DAY = Recording(day="2012-10-24"), Recording(day="2010-07-01", start="09:00")
RECORDINGS = {name: ATC_DAY if name.startswith("atc") else OTHER_DAY for name in FORMS}
T0 = 1_351_038_000  # 24 Oct 2012, 09:20 in Japan

STEPS = range(12)
GOOD = {
    "atc": "".join(f"{T0 + k}.25,{p},{900 * k},{p}00,1700,900.5,0.01,0.5\n" for k in STEPS for p in (7, 8)),
    "atc_1hz": "".join(f"{T0 + k}.25,{p},{k}.5,{p}.25,0.9,0.01\n" for k in STEPS for p in (7, 8)),
    "edinburgh": "% Total number of trajectories in file are  2 \n\n"
    + "".join(
        f"Properties.R{p}=[12 5 93 1.5 ];\n TRACK.R{p}=["
        + ";".join(f"[{20 + 40 * k} {100 * p} {5 + 8 * k}]" for k in STEPS)
        + "];\n"
        for p in (1, 2)
    ),
    "edinburgh_rows": "".join(f"{95 + k},{p},{20 + 20 * k},{100 * p}\n" for p in (1, 2) for k in STEPS),
    "named": "time,person,x,y\n" + "".join(f"{k}.5,{p},{k}.25,{p}\n" for p in (1, 2) for k in STEPS),
    "positions": "".join(f"{k}.5,{p},{k}.25,{p}\n" for p in (1, 2) for k in STEPS),
}
TABLES = [form for form in GOOD if form != "edinburgh"]


def clean(path, form, cleaning=("single_row", "gap_over_5s")):
    """Read and clean; whatever comes back must add up."""
    tracks, account = clean_recording(path, dataclasses.replace(FORMS[form], cleaning=cleaning), RECORDINGS[form])
    for kind in ("rows", "tracks"):
        assert account[kind]["read"] == account[kind]["kept"] + sum(account[kind]["dropped"].values())
        assert all(count > 0 for count in account[kind]["dropped"].values())
    assert account["rows_written"] == len(tracks.t) > 0
    assert account["tracks"]["kept"] == len(np.unique(tracks.track_id)) > 0
    assert np.isfinite([tracks.t, tracks.x, tracks.y]).all()
    assert np.isfinite(tracks.speed).any() or account["tracks"]["kept"] == len(tracks.t)
    return tracks, account


def refused(path, form, *parts):
    """The message with which a file is refused: it names the file and all of `parts`."""
    with pytest.raises(DataError) as error:
        clean(path, form)
    message = str(error.value)
    for part in (path.name, *parts):
        assert part in message
    return message


@pytest.mark.parametrize("form", GOOD)
def test_the_good_files_are_good(write, form):
    tracks, account = clean(write(GOOD[form]), form)
    assert account["tracks"] == {"read": 2, "kept": 2, "dropped": {}}
    assert account["rows"]["dropped"] == {}
    assert account["rows"]["read"] == 2 * len(STEPS)
    assert len(tracks.t) >= 10


# --- no file, no content ------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", GOOD)
def test_a_missing_file(tmp_path, form):
    refused(tmp_path / "nothing.csv", form, "no such file", "data_root")


@pytest.mark.parametrize("form", GOOD)
def test_a_folder_in_place_of_a_file(tmp_path, form):
    refused(tmp_path, form, "a folder; name a file in it")


@pytest.mark.parametrize("form", GOOD)
@pytest.mark.parametrize("suffix", ["", ".gz", ".bz2", ".zip"])
def test_an_empty_file(write, form, suffix):
    path = write(b"", f"day.csv{suffix}")
    refused(path, form, "cut off" if suffix in {".zip", ".bz2"} else "is empty")


@pytest.mark.parametrize("form", GOOD)
@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".zip"])
def test_a_packed_empty_file(tmp_path, form, suffix):
    refused(packed(tmp_path, b"", suffix), form, "is empty")


@pytest.mark.parametrize("form", GOOD)
@pytest.mark.parametrize("content", ["\n", "\n\n\n", "   \n", "\r\n\r\n"])
def test_blank_lines_only(write, form, content):
    refused(write(content), form)


def test_a_header_and_nothing_more(write):
    for content in ("time,person,x,y\n", "time,person,x,y"):
        refused(write(content), "named", "has no row")


def test_an_announcement_and_nothing_more(write):
    refused(write("% Total number of trajectories in file are  0 \n"), "edinburgh", "no usable point")
    refused(write("% Total number of trajectories in file are  3 \n"), "edinburgh", "announces 3", "fetch it again")


# --- cut off ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("last", ["line end", "in the last point", "in a number", "before TRACK", "in the keyword"])
@pytest.mark.parametrize("announced", [True, False])
def test_a_cut_edinburgh_text(write, last, announced):
    text = GOOD["edinburgh"] if announced else GOOD["edinburgh"].split("\n", 2)[2]
    final = text.rindex(" TRACK.R2")
    end = {
        "line end": text.index("Properties.R2"),
        "in the last point": len(text) - 6,
        "in a number": text.rindex("[", 0, len(text) - 30) + 2,
        "before TRACK": final,
        "in the keyword": final + 4,
    }[last]
    path = write(text[:end])
    if announced or last in {"in the last point", "in a number"}:
        refused(path, "edinburgh", "cut off")
    elif last == "line end":  # nothing in the file tells that there was more
        assert clean(path, "edinburgh")[1]["tracks"]["read"] == 1
    else:
        refused(path, "edinburgh", "cut off")  # Properties.R2 without its TRACK.R2


def test_a_damaged_track_line_is_named_by_its_number(write):
    text = GOOD["edinburgh"].replace("]];\nProperties.R2", "\nProperties.R2")
    refused(write(text), "edinburgh", "line 4:", "TRACK.R1", "cut off or damaged")


@pytest.mark.parametrize("form", TABLES)
def test_a_table_cut_in_a_row(write, form):
    """What the cut row still says cannot be trusted, but only a missing column can be seen."""
    whole = len(clean(write(GOOD[form]), form)[0].t)
    row = GOOD[form].splitlines()[-1]
    path = write(GOOD[form][: -len(row.split(",", 1)[1]) - 1])
    tracks, account = clean(path, form)
    assert account["rows"]["dropped"] == {"wrong_column_count": 1}
    assert account["first_seen"]["wrong_column_count"].startswith(f"row {len(GOOD[form].splitlines())}:")
    assert len(tracks.t) <= whole


def packed(folder, content, suffix, name="day.csv"):
    path = folder / f"{name}{suffix}"
    if suffix == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(name, content)
    else:
        path.write_bytes({".gz": gzip, ".bz2": bz2}[suffix].compress(content))
    return path


@pytest.mark.parametrize("form", GOOD)
@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".zip"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.99])
def test_a_packed_file_that_was_cut(tmp_path, form, suffix, share):
    path = packed(tmp_path, GOOD[form].encode(), suffix)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    refused(path, form, "fetch it again")


@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".zip"])
def test_a_large_packed_file_that_was_cut(tmp_path, suffix):
    """The damage shows after good rows were read: they must not pass for the whole recording."""
    rng = np.random.default_rng(1)
    lines = "".join(f"{t:.3f},1,{x:.6f},0.25\n" for t, x in zip(np.arange(20_000) / 2, rng.random(20_000), strict=True))
    path = packed(tmp_path, lines.encode(), suffix)
    content = path.read_bytes()
    path.write_bytes(content[: int(0.8 * len(content))])
    refused(path, "positions", "fetch it again")


@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".zip"])
@pytest.mark.parametrize(
    "content", [GOOD["atc_1hz"].encode(), b"\x00" * 300, b"PK\x03\x04 and no more", b"\x1f\x8b\x08"]
)
def test_a_suffix_that_is_not_true(write, suffix, content):
    refused(write(content, f"day.csv{suffix}"), "atc_1hz")


PLAIN = GOOD["atc_1hz"].encode()


def tarred(content):
    file = io.BytesIO()
    with tarfile.open(fileobj=file, mode="w") as archive:
        member = tarfile.TarInfo("day.csv")
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    return file.getvalue()


@pytest.mark.parametrize("form", [form for form in GOOD if form != "atc_1hz"])
@pytest.mark.parametrize(
    ("content", "name", "told"),
    [
        (lzma.compress(PLAIN), "day.csv.xz", "is packed by xz: unpack it"),
        (gzip.compress(PLAIN), "day.csv", "is packed by gzip: unpack it"),
        (bz2.compress(PLAIN), "day.csv", "is packed by bzip2: unpack it"),
        (gzip.compress(tarred(PLAIN)), "day.tar.gz", "is packed by tar: unpack it"),
        (b"SQLite format 3\0" + b"\1" * 90, "day.csv", "is SQLite (`reader: jupedsim`"),
        (b"1,2,3\0\0\0\n", "day.csv", "is not text, or text in UTF-16"),
        (PLAIN.decode().encode("utf-16"), "day.csv", "is UTF-16 text"),
    ],
)
def test_what_is_no_text_is_told_by_its_kind(write, form, content, name, told):
    """Not by `separator: ';'` and junk."""
    assert refused(write(content, name), form, told).isprintable()


@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".zip"])
def test_suffixes_may_be_in_capitals(tmp_path, suffix):
    path = packed(tmp_path, PLAIN, suffix)
    path = path.rename(tmp_path / path.name.upper())
    assert clean(path, "atc_1hz")[1]["rows"]["dropped"] == {}
    assert raw.stem_of(path) == "DAY"
    if suffix == ".zip":
        assert clean(path / "day.csv", "atc_1hz")[1]["rows"]["dropped"] == {}


# --- zip archives -------------------------------------------------------------------------------------------


def test_a_zip_with_several_members_asks_for_one(tmp_path):
    path = tmp_path / "days.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("a.csv", "sub/b.csv"):
            archive.writestr(name, GOOD["atc_1hz"])
    refused(path, "atc_1hz", "holds 2 files", "a.csv, sub/b.csv", "days.zip/<member>")
    assert clean(path / "sub/b.csv", "atc_1hz")[1]["tracks"]["kept"] == 2
    with pytest.raises(DataError, match=r"days\.zip: holds no member 'c\.csv'"):
        clean(path / "c.csv", "atc_1hz")


def test_a_zip_without_a_member(tmp_path):
    with zipfile.ZipFile(tmp_path / "days.zip", "w"):
        pass
    refused(tmp_path / "days.zip", "atc_1hz", "holds 0 files")


def test_a_zip_with_folders_is_a_zip_of_its_one_file(tmp_path):
    with zipfile.ZipFile(tmp_path / "day.zip", "w") as archive:
        archive.writestr("folder/", "")
        archive.writestr("folder/day.csv", GOOD["atc_1hz"])
    assert clean(tmp_path / "day.zip", "atc_1hz")[1]["tracks"]["kept"] == 2


def test_a_zip_whose_content_was_changed(tmp_path):
    path = tmp_path / "day.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("day.csv", GOOD["atc_1hz"])
    path.write_bytes(path.read_bytes().replace(b".25,7,", b".35,7,", 1))
    refused(path, "atc_1hz", "fetch it again")


def zip_with_header_bytes(path, offset, value):
    """A zip of one stored member with bytes of its two headers changed."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("day.csv", GOOD["atc_1hz"])
    content = bytearray(path.read_bytes())
    local, central = content.index(b"PK\x03\x04"), content.index(b"PK\x01\x02")
    content[local + offset : local + offset + 2] = value.to_bytes(2, "little")
    content[central + offset + 2 : central + offset + 4] = value.to_bytes(2, "little")
    path.write_bytes(content)
    return path


def test_a_zip_with_a_password(tmp_path):
    refused(zip_with_header_bytes(tmp_path / "day.zip", 6, 1), "atc_1hz")


def test_a_zip_packed_by_an_unknown_method(tmp_path):
    refused(zip_with_header_bytes(tmp_path / "day.zip", 8, 97), "atc_1hz")


# --- the wrong file -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("form", "other"), list(itertools.permutations(GOOD, 2)))
def test_a_file_of_another_form_is_refused_or_all_in_the_account(write, form, other):
    path = write(GOOD[other])
    if (form, other) == ("positions", "named"):
        refused(path, form, "row 1", "header")
    elif form == "edinburgh":
        refused(path, form, "`reader: edinburgh`")
    elif form in {"atc", "atc_1hz", "edinburgh_rows"} and other not in {"positions", "edinburgh_rows", "named"}:
        refused(path, form, "row 1")
    else:
        read_or_refused(path, form)


def read_or_refused(path, form, **options):
    """Clean a file that may be anything: it adds up (see `clean`), or a DataError names it."""
    try:
        return clean(path, form, **options)[1]
    except DataError as error:
        assert path.name in str(error)
        return None


@pytest.mark.parametrize("form", ["atc", "atc_1hz", "edinburgh_rows"])
def test_a_wrong_number_of_columns(write, form):
    rows = GOOD[form].splitlines()
    width = rows[0].count(",") + 1
    for changed, found in (
        ("".join(f"{row},9\n" for row in rows), width + 1),
        ("\n".join(r.rsplit(",", 1)[0] for r in rows), width - 1),
    ):
        refused(write(changed), form, "row 1", f"{found} columns", f"has {width}", "`reader`")


@pytest.mark.parametrize("form", ["atc", "atc_1hz", "edinburgh_rows", "positions"])
def test_a_header_where_none_is_expected(write, form):
    width = GOOD[form].splitlines()[0].count(",") + 1
    header = ",".join(f"column{k}" for k in range(width))
    refused(write(f"{header}\n{GOOD[form]}"), form, "row 1", "column0,column1", "`header: true`")


def test_no_header_where_one_is_expected(write):
    refused(write(GOOD["positions"]), "named", "row 1", "only numbers", "header: true")


@pytest.mark.parametrize("form", TABLES)
def test_a_day_that_is_not_the_files(write, form):
    content = GOOD[form]
    if RECORDINGS[form].start:  # these hold no date, but their clock can leave the day
        content = re.sub(r"^(\d+)", lambda m: str(int(m[1]) + 9 * 86_400), content, flags=re.M)
    path = write(content)
    with pytest.raises(DataError) as error:
        clean_recording(
            path,
            dataclasses.replace(FORMS[form], cleaning=()),
            dataclasses.replace(RECORDINGS[form], day="2012-10-25"),
        )
    assert path.name in str(error.value)
    assert "outside_day" in str(error.value)
    assert str(2 * len(STEPS)) in str(error.value)


# --- nothing good in it -------------------------------------------------------------------------------------


def field_replaced(position, text):
    def change(row):
        fields = row.split(",")
        return ",".join([*fields[:position], text, *fields[position + 1 :]])

    return change


BAD_TABLES = {
    "text_value": field_replaced(2, "abc"),
    "nan_value": field_replaced(2, "nan"),
    "infinite_value": field_replaced(2, "inf"),
    "absurd_value": field_replaced(2, "99999999"),
    "no_person": field_replaced(1, "-1"),
    "wrong_column_count": lambda row: row + ",1,2",
}


@pytest.mark.parametrize("form", TABLES)
@pytest.mark.parametrize("reason", BAD_TABLES)
def test_all_rows_bad(write, form, reason):
    """The first row is good where it must be looked at to know the columns: it alone is no track."""
    rows = GOOD[form].splitlines()
    start = 1 if form == "named" or reason == "wrong_column_count" else 0
    path = write("\n".join([*rows[:start], *map(BAD_TABLES[reason], rows[start:])]) + "\n")
    refused(path, form, reason)


@pytest.mark.parametrize("reason", ["text_value", "wrong_column_count"])
def test_all_points_bad(write, reason):
    bad = "[12 abc 3]" if reason == "text_value" else "[12 3]"
    path = write(re.sub(r"\[\d+ \d+ \d+\]", bad, GOOD["edinburgh"]))
    refused(path, "edinburgh", reason, "no usable point")


@pytest.mark.parametrize("form", GOOD)
def test_tracks_of_single_rows_only(write, form):
    if form == "edinburgh":
        content = re.sub(r"=\[(\[[^]]*\]).*\];", r"=[\1];", GOOD[form])
    else:
        rows = GOOD[form].splitlines()
        first = rows[:1] if form == "named" else []
        content = "\n".join(
            [*first, *(re.sub(r"^([^,]*),[^,]*", rf"\1,{k}", row) for k, row in enumerate(rows[len(first) :]))]
        )
    refused(write(content), form, "cleaning left no track", "single_row")


# --- not even text ------------------------------------------------------------------------------------------

GARBAGE = {
    "noise": np.random.default_rng(1).bytes(5000),
    "noise with line ends": np.random.default_rng(2).bytes(200_000),
    "zeros": bytes(3000),
    "one long line": b"x" * 300_000,
    "a picture": b"\x89PNG\r\n\x1a\n" + np.random.default_rng(3).bytes(3000),
    "separators": b"," * 5000 + b"\n,,,\n" * 50,
    "quotes": b'"' * 3001 + b'\n1,"2\n"3,4"\n' * 20,
    "utf-16": GOOD["atc_1hz"].encode("utf-16"),
    "a web page": b"<!DOCTYPE html>\n<html><head><title>404, not found</title></head></html>\n",
}


@pytest.mark.parametrize("form", GOOD)
@pytest.mark.parametrize("kind", GARBAGE)
def test_garbage(write, form, kind):
    refused(write(GARBAGE[kind]), form)


@pytest.mark.parametrize("form", GOOD)
def test_garbage_in_the_middle_is_counted(write, form):
    lines = GOOD[form].encode().splitlines(keepends=True)
    garbage = bytes(byte for byte in range(256) if byte not in b"\r\n")
    tracks, account = clean(write(b"".join([*lines[:7], garbage + b"\n", *lines[7:]])), form)
    expected = clean(write(GOOD[form], "good.csv"), form)[0]
    np.testing.assert_array_equal(tracks.x, expected.x)
    assert sum(account["rows"]["dropped"].values()) == (0 if form == "edinburgh" else 1)
