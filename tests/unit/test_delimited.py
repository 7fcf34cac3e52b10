"""Delimited recordings: what was written is read back, and every row is kept or dropped under its name."""

import itertools
from collections import Counter
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from modlhmp.cleaning import clean_recording
from modlhmp.file_format import Columns, FileFormat, Recording
from modlhmp.ids import id_of
from modlhmp.plausibility import check_recording
from modlhmp.readers import atc, columns, delimited, raw, read_recording
from modlhmp.readers.numerals import number
from modlhmp.readers.raw import line_blocks
from modlhmp.storage import DataError
from modlhmp.study import demo

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "px": 0.0247}
SECONDS = {"s": 1.0, "ms": 0.001, "frame": 1 / 9}
COUNTER = itertools.count()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder that also hypothesis tests may write to."""
    return tmp_path_factory.mktemp("delimited")


@pytest.fixture
def cut(monkeypatch):
    """Function (size): from now on files are read in blocks of about `size` bytes."""

    def set_size(size):
        monkeypatch.setattr(columns, "line_blocks", partial(raw.line_blocks, size=size))

    return set_size


def saved(folder, content):
    path = folder / f"{next(COUNTER)}.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read(path, layout=atc.ONE_HZ_LAYOUT, **options):
    """Read, and check that the account adds up: (Tracks, {reason: rows dropped}, Account)."""
    tracks, account = delimited.read_delimited(path, layout, **options)
    assert account.rows_read == len(tracks.t) + sum(account.dropped_rows.values())
    order = np.lexsort((tracks.t, tracks.track_id))
    assert (order == np.arange(len(order))).all(), "rows are sorted by track, then time"
    return tracks, dict(account.dropped_rows), account


# --- what was written is read back --------------------------------------------------------------------------


@st.composite
def tables(draw):
    """A clean table: {field: list of numbers as text}, units, and its rows in (track, time) order."""
    units = {
        "time": draw(st.sampled_from(list(SECONDS))),
        "length": draw(st.sampled_from(list(METRES))),
        "angle": draw(st.sampled_from(["rad", "deg"])),
    }
    keys = draw(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 86_000)), min_size=1, max_size=12, unique=True))
    keys.sort()
    clock = {"s": lambda s: f"{s}.25", "ms": lambda s: f"{1000 * s + 7}", "frame": lambda s: f"{9 * s + 2}"}
    reach = 0.999 / METRES[units["length"]]  # sizes of a hall, of a person's speed
    number = st.floats(-10 * reach, 10 * reach).map(repr)
    half_turn = 3.14159 if units["angle"] == "rad" else 179.999
    columns = {
        "track_id": [str(key[0]) for key in keys],
        "t": [clock[units["time"]](key[1]) for key in keys],
    }
    fields = {"x": number, "y": number}
    if draw(st.booleans()):
        fields["speed"] = st.floats(0, 10 * reach).map(repr)
        fields["heading"] = st.floats(-half_turn, half_turn).map(repr)
    for field, values in fields.items():
        columns[field] = draw(st.lists(values, min_size=len(keys), max_size=len(keys)))
    return columns, units


@settings(max_examples=150)
@given(
    table=tables(),
    separator=st.sampled_from(",;\t"),
    header=st.booleans(),
    by_name=st.booleans(),
    extra=st.lists(st.sampled_from(["7.5", "a word", "", "nan"]), max_size=3),
    origin=st.sampled_from([0.0, 1_277_971_200.0]),
    random=st.randoms(use_true_random=False),
)
def test_a_clean_table_is_read_back(folder, table, separator, header, by_name, extra, origin, random):
    columns, units = table
    rows = len(columns["t"])
    written = {**columns, **{f"extra {k}": [text] * rows for k, text in enumerate(extra)}}
    names = random.sample(list(written), len(written))
    lines = [separator.join(written[name][row] for name in names) for row in range(rows)]
    random.shuffle(lines)
    content = [separator.join(names)] * header + lines
    layout = {
        "columns": {f: f if header and by_name else names.index(f) for f in columns},
        "separator": separator,
        "header": header,
        "units": units,
        "scale": 0.0247,
        "frame_rate": 9.0,
        "origin": origin,
    }
    tracks, dropped, _account = read(saved(folder, "\n".join(content) + "\n"), layout)
    assert dropped == {}
    number = {field: np.array([float(text) for text in texts]) for field, texts in columns.items()}
    metres = METRES[units["length"]]
    assert tracks.track_id.tolist() == number["track_id"].astype(int).tolist()
    assert tracks.t.tolist() == (number["t"] * SECONDS[units["time"]] + origin).tolist()
    assert tracks.x.tolist() == (number["x"] * metres).tolist()
    assert tracks.y.tolist() == (number["y"] * metres).tolist()
    if "speed" in columns:
        assert tracks.speed.tolist() == (number["speed"] * metres).tolist()
        radians = number["heading"] * (np.pi / 180 if units["angle"] == "deg" else 1)
        np.testing.assert_allclose(tracks.heading, radians, rtol=0, atol=1e-12)
    else:
        assert np.isnan(tracks.speed).all()
        assert np.isnan(tracks.heading).all()


def test_headings_are_wrapped(folder):
    path = saved(folder, "0,1,0,0,1,270\n1,1,0,0,1,-180\n2,1,0,0,1,450\n")
    tracks, _, _ = read(path, {**atc.ONE_HZ_LAYOUT, "units": {"angle": "deg"}})
    np.testing.assert_allclose(tracks.heading, [-np.pi / 2, np.pi, np.pi / 2], atol=1e-12)


def test_raw_atc_layout_is_in_millimetres(folder):
    tracks, _, _ = read(saved(folder, "1.5,9,-1500,250,1700,1250,-1.5,3.0\n"), atc.RAW_LAYOUT)
    assert [column[0] for column in tracks] == pytest.approx([9, 1.5, -1.5, 0.25, 1.25, -1.5], abs=1e-12)


@pytest.mark.parametrize("track_id", [9_190_700, 2**53 - 1, 2**53 + 1, 20_121_024_093_000_123, 2**63 - 1])
def test_long_ids_are_never_merged(folder, track_id):
    """Two persons whose ids differ in a digit that a float has not are kept apart, or refused."""
    ids = [track_id - 1, track_id]
    path = saved(folder, "".join(f"{k},{n},{k},{k},1,0\n" for k in range(3) for n in ids))
    try:
        tracks, _, _ = read(path)
    except DataError as error:
        assert track_id > 2**53
        assert "no_track_id" in str(error)
    else:
        assert tracks.track_id.tolist() == np.repeat(ids, 3).tolist()


# --- last sample of each second -----------------------------------------------------------------------------


def last_of_second(rows):
    """The slow twin: the latest row of each person and second, the first in the file where times are equal."""
    latest = {}
    for row in rows:
        key = (row[1], int(np.floor(row[0])))
        if key not in latest or row[0] > latest[key][0]:
            latest[key] = row
    return sorted(latest.values(), key=lambda row: (row[1], row[0]))


def lines_of(rows):
    return "".join(",".join(map(repr, row)) + "\n" for row in rows)


def as_rows(tracks):
    columns = (tracks.t, tracks.track_id, tracks.x, tracks.y, tracks.speed)
    return [tuple(row) for row in zip(*map(np.ndarray.tolist, columns), strict=True)]


SAMPLES = st.tuples(st.integers(0, 3), st.integers(0, 5000), st.integers(0, 3))


@settings(max_examples=100)
@given(
    samples=st.lists(SAMPLES, min_size=1, max_size=60),
    size=st.sampled_from([1, 10, 37, 200, 1 << 24]),
    distinct=st.booleans(),
)
def test_one_sample_a_second_whatever_the_order_and_the_blocks(folder, samples, size, distinct):
    if distinct:
        samples = list({sample[:2]: sample for sample in samples}.values())
    rows = [(ms / 1000, person, float(n), float(x), 1.0, 0.5) for n, (person, ms, x) in enumerate(samples)]
    expected = last_of_second(rows)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(columns, "line_blocks", partial(raw.line_blocks, size=size))
        tracks, dropped, _ = read(saved(folder, lines_of(rows)))
    assert as_rows(tracks) == [row[:5] for row in expected]
    assert set(dropped) <= ({"downsampled"} if distinct else {"downsampled", "duplicate_row"})
    assert sum(dropped.values()) == len(rows) - len(expected)


@pytest.mark.parametrize(("step_s", "rate"), [(0.1, 10), (0.4, 2.5), (0.5, 2), (2.0, 0.5)])
@pytest.mark.parametrize("start", [0.0, 1_351_038_000.0])
def test_rows_that_come_once_a_step_are_all_kept(folder, step_s, rate, start):
    """A recording that already has the time step loses nothing, though its times are not exact in binary."""
    rows = [(round(start + k / rate, 3), 1, float(k), 0.0, 1.0, 0.0) for k in range(500)]
    tracks, dropped, _ = read(saved(folder, lines_of(rows)), step_s=step_s)
    assert dropped == {}
    assert len(tracks.t) == 500


def test_without_velocities_nothing_is_downsampled(folder):
    content = "".join(f"{k / 10},1,{k},0\n" for k in range(50))
    layout = {"columns": {"t": 0, "track_id": 1, "x": 2, "y": 3}}
    tracks, dropped, _ = read(saved(folder, content), layout)
    assert tracks.x.tolist() == list(range(50))
    assert dropped == {}


# --- bad rows -----------------------------------------------------------------------------------------------

DAY = (1000.0, 2000.0)
CLEAN = [f"{1000 + k},{k % 3},{k}.5,-{k}.25,1.0,0.5" for k in range(30)]
FULL = {"t": "1015.5", "track_id": "1", "x": "1.5", "y": "2.5", "speed": "1.0", "heading": "0.5"}

MEASURED = [field for field in FULL if field != "track_id"]
NO_IDS = ["", "  ", "nan", "inf", "-inf", "1.7", "1e300", "99999999999999999999"]


def with_value(field, text):
    return ",".join({**FULL, field: text}.values())


BAD_ROWS = [
    *((f"text in {f}", with_value(f, "abc"), "text_value") for f in FULL),
    *((f"two points in {f}", with_value(f, "1.2.3"), "text_value") for f in FULL),
    *((f"{text!r} as {f}", with_value(f, text), "nan_value") for f in MEASURED for text in ("", "  ", "nan", "NaN")),
    *((f"{text} as {f}", with_value(f, text), "infinite_value") for f in MEASURED for text in ("inf", "-inf")),
    *((f"{text!r} as id", with_value("track_id", text), "no_track_id") for text in NO_IDS),
    ("far away", with_value("x", "1e6"), "absurd_value"),
    ("far below", with_value("y", "-10001"), "absurd_value"),
    ("too fast", with_value("speed", "15.5"), "absurd_value"),
    ("negative speed", with_value("speed", "-0.5"), "absurd_value"),
    ("a column too few", "1015.5,1,1.5,2.5,1.0", "wrong_column_count"),
    ("a column too many", "1015.5,1,1.5,2.5,1.0,0.5,7", "wrong_column_count"),
    ("a trailing separator", "1015.5,1,1.5,2.5,1.0,0.5,", "wrong_column_count"),
    ("one word", "hello", "wrong_column_count"),
    ("person -1", with_value("track_id", "-1"), "no_person"),
    ("a repeated row", CLEAN[14], "duplicate_row"),
    ("a repeated time", "1014,2,99.5,99.5,1.0,0.5", "duplicate_row"),
    ("an empty line", "", "blank_line"),
    ("a line of spaces", "   ", "blank_line"),
    ("the day before", with_value("t", "999.999"), "outside_day"),
    ("the next day's first instant", with_value("t", "2000"), "outside_day"),
]


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(("line", "reason"), [b[1:] for b in BAD_ROWS], ids=[b[0] for b in BAD_ROWS])
@pytest.mark.parametrize("end", ["\n", "\r\n"], ids=["LF", "CRLF"])
def test_a_bad_row_is_dropped_under_its_name(folder, line, reason, end):
    clean, _, _ = read(saved(folder, "\n".join(CLEAN)), day=DAY)
    path = saved(folder, end.join([*CLEAN[:17], line, *CLEAN[17:]]) + end)
    tracks, dropped, account = read(path, day=DAY)
    assert dropped == {reason: 1}
    assert account.rows_read == len(CLEAN) + 1
    assert as_rows(tracks) == as_rows(clean)
    if reason != "duplicate_row":
        assert account.first_seen[reason].startswith("row 18:")


def test_the_day_begins_with_its_first_instant(folder):
    tracks, dropped, _ = read(saved(folder, "1000,1,0,0,1,0\n1999.999,1,0,0,1,0\n"), day=DAY)
    assert tracks.t.tolist() == [1000.0, 1999.999]
    assert dropped == {}


def test_a_missing_value_has_one_name_whatever_stands_near_it(folder):
    """NA is nan_value to the fast parser: so it is to the slow one, which a neighbour's text calls in."""
    alone = [*CLEAN[:10], with_value("x", "NA"), *CLEAN[10:]]
    _, dropped_alone, _ = read(saved(folder, "\n".join(alone)), day=DAY)
    _, dropped, _ = read(saved(folder, "\n".join([*alone, with_value("x", "abc"), ""])), day=DAY)
    assert dropped == {**dropped_alone, "text_value": dropped_alone.get("text_value", 0) + 1}


@pytest.mark.parametrize("size", [1, 50, 333, 4000, 1 << 24])
def test_the_account_does_not_depend_on_the_blocks(folder, cut, size):
    """Also where a block holds bad rows only. Duplicates stand side by side, and may still be parted."""
    bad = [(line, reason) for _name, line, reason in BAD_ROWS if reason != "duplicate_row"]
    lines = [*CLEAN[:15], *(line for line, _reason in bad), *CLEAN[15:]]
    expected, _, _ = read(saved(folder, "\n".join(CLEAN)), day=DAY)
    cut(size)
    tracks, dropped, _ = read(saved(folder, "\n".join(lines)), day=DAY)
    assert as_rows(tracks) == as_rows(expected)
    assert dropped == Counter(reason for _line, reason in bad)


def test_the_example_of_a_reason_is_its_first_row(folder):
    """Also where a later block has such a row too."""
    lines = [*CLEAN[:4], with_value("x", ""), *CLEAN[4:9], with_value("y", ""), *CLEAN[9:]]
    _, dropped, account = read(saved(folder, "\n".join(lines)), day=DAY)
    assert dropped == {"nan_value": 2}
    assert account.first_seen["nan_value"].startswith("row 5:")


@pytest.mark.parametrize("size", [1, 30, 1 << 24])
@pytest.mark.parametrize("field", ["speed", "heading"])
def test_rows_without_a_velocity_are_dropped_even_if_a_block_holds_no_other(folder, cut, size, field):
    lines = [*CLEAN[:10], *[with_value(field, "nan")] * 5, *CLEAN[10:]]
    cut(size)
    tracks, dropped, _ = read(saved(folder, "\n".join(lines)), day=DAY)
    assert dropped == {"nan_value": 5}
    assert np.isfinite(tracks.speed).all()


def test_bad_rows_anywhere_in_a_long_file(folder):
    """Long enough that blocks are halved again and again; row numbers stay those of the file."""
    rng = np.random.default_rng(4)
    lines = [f"{1000 + k / 100},{k % 7},{k % 40}.125,{k % 9}.5,1.25,0.5" for k in range(20_000)]
    bad = np.sort(rng.choice(len(lines), 60, replace=False))
    for row in bad:
        lines[row] = ["", "1,2,3", with_value("y", "oops")][row % 3]
    clean = saved(folder, "\n".join(line for k, line in enumerate(lines) if k not in set(bad)))
    expected, before, _ = read(clean, day=DAY)
    tracks, dropped, account = read(saved(folder, "\n".join(lines)), day=DAY)
    names = np.array(["blank_line", "wrong_column_count", "text_value"])[bad % 3]
    assert dropped == {**before, **Counter(names.tolist())}
    assert as_rows(tracks) == as_rows(expected)
    for name in set(names.tolist()):
        assert account.first_seen[name].startswith(f"row {1 + bad[names == name][0]}:")


def test_a_line_longer_than_the_careful_piece_is_one_bad_row(folder):
    lines = [*CLEAN[:5], "x" * 100_000, *CLEAN[5:]]
    tracks, dropped, _ = read(saved(folder, "\n".join(lines)), day=DAY)
    assert dropped == {"wrong_column_count": 1}
    assert len(tracks.t) == len(CLEAN)


def test_rows_out_of_time_order_are_noted_and_kept(folder):
    lines = CLEAN[:]
    lines[10], lines[11] = lines[11], lines[10]
    tracks, dropped, account = read(saved(folder, "\n".join(lines)), day=DAY)
    assert account.notes["rows_out_of_time_order"] == 1
    assert dropped == {}
    assert len(tracks.t) == len(CLEAN)


@pytest.mark.parametrize("t", ["inf", "1e12", "nan"])
def test_a_bad_time_does_not_put_the_rest_out_of_order(folder, t):
    lines = [*CLEAN[:10], with_value("t", t), *CLEAN[10:]]
    _, _, account = read(saved(folder, "\n".join(lines)), day=DAY)
    assert account.notes["rows_out_of_time_order"] == 0


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_demo_day_is_accounted_to_the_row(folder, load_shipped, seed):
    path = folder / "hall" / "atc-20301009.csv"
    planted = demo.write_recording(path, "hall", "2030-10-09", seed, scale=0.4)
    dataset = load_shipped("demo_hall", folder)
    tracks, account = clean_recording(path, dataset, dataset.recording("atc-20301009"))
    dropped = dict(account["rows"]["dropped"])
    assert account["rows"]["read"] == planted["rows"]
    assert account["rows"]["kept"] == account["rows_written"] == len(tracks.t)
    # The generator counts an empty field as text, the reader as a missing value; and it counts what the id of
    # a row lacks under the id's own name.
    fields = [line.split(",") for line in path.read_text().splitlines()]
    empty = sum("" in line for line in fields)
    no_id = Counter(line[1] for line in fields if line[1] in {"", "inf", "-inf"})
    assert dropped.pop("text_value", 0) == planted["text_value"] - empty
    assert dropped.pop("nan_value", 0) == planted["nan_value"] + empty - no_id[""]
    assert dropped.pop("infinite_value", 0) == planted["infinite_value"] - no_id["inf"] - no_id["-inf"]
    assert dropped.pop("no_track_id", 0) == no_id.total()
    for name in ("absurd_value", "wrong_column_count", "no_person", "duplicate_row"):
        assert (name, dropped.pop(name)) == (name, planted[name])
    assert dropped.pop("outside_day") == planted["outside_day"]
    assert account["notes"]["rows_out_of_time_order"] == planted["unsorted"]
    assert account["tracks"]["dropped"] == {
        "single_row": planted["single_row_track"],
        "gap_over_5s": planted["gap_track"],
    }
    assert account["tracks"]["read"] == planted["tracks"] - 2  # but the two people of other days
    assert set(dropped) == {"downsampled", "single_row", "gap_over_5s"}


# --- forms of text ------------------------------------------------------------------------------------------

BOM = b"\xef\xbb\xbf"
NAMED = {
    "columns": {"t": "time", "track_id": "person", "x": "x", "y": "y", "speed": "v", "heading": "a"},
    "header": True,
}
HEADER = "time,person,x,y,v,a"


@pytest.mark.parametrize("bad", [False, True], ids=["clean", "with a bad row"])
@pytest.mark.parametrize("layout", [atc.ONE_HZ_LAYOUT, NAMED], ids=["no header", "header"])
@pytest.mark.parametrize("form", ["crlf", "no last newline", "bom", "bom crlf", "quoted", "spaced"])
def test_forms_of_text(folder, form, layout, bad):
    """All of these are the same table, with or without a row that calls in the careful parser."""
    rows = [*CLEAN[:8], *["1007.5,1,oops,1,1,1"] * bad, *CLEAN[8:]]
    lines = [HEADER] * (layout is NAMED) + rows
    if form == "quoted":
        lines = [",".join(f'"{field}"' for field in line.split(",")) for line in lines]
    if form == "spaced":
        lines = [line.replace(",", ", ") for line in lines]
    text = ("\r\n" if "crlf" in form else "\n").join(lines)
    content = BOM * ("bom" in form) + text.encode() + b"" * (form == "no last newline")
    if form != "no last newline":
        content += b"\r\n" if "crlf" in form else b"\n"
    expected, _, _ = read(saved(folder, "\n".join(CLEAN)))
    tracks, dropped, account = read(saved(folder, content), layout)
    assert as_rows(tracks) == as_rows(expected)
    assert dropped == ({"text_value": 1} if bad else {})
    assert account.rows_read == len(rows)


@pytest.mark.parametrize("bad", [False, True], ids=["clean", "with a bad row"])
def test_a_quoted_field_may_hold_the_separator(folder, bad):
    layout = {"columns": {"t": 1, "track_id": 2, "x": 3, "y": 4}}
    rows = [f'"Hall, east",{k},1,{k}.5,0' for k in range(6)]
    rows.insert(3, '"Hall, east",3.5,1,oops,0') if bad else None
    tracks, dropped, _ = read(saved(folder, "\n".join(rows)), layout)
    assert tracks.x.tolist() == [k + 0.5 for k in range(6)]
    assert dropped == ({"text_value": 1} if bad else {})


def test_a_header_is_a_line_of_the_file(folder):
    path = saved(folder, "\n".join([HEADER, *CLEAN[:4], "a,b,c,d,e,f", *CLEAN[4:]]))
    _, dropped, account = read(path, NAMED)
    assert dropped == {"text_value": 1}
    assert account.rows_read == len(CLEAN) + 1
    assert account.first_seen["text_value"].startswith("row 6:")


def test_columns_of_the_same_name_do_no_harm_unless_wanted(folder):
    content = "time,note,person,note,x,y\n1,7,1,8,0.5,0.25\n2,7,1,8,1.5,0.25\n"
    layout = {"columns": {"t": "time", "track_id": "person", "x": "x", "y": "y"}, "header": True}
    tracks, dropped, _ = read(saved(folder, content), layout)
    assert tracks.x.tolist() == [0.5, 1.5]
    assert dropped == {}


def test_a_wanted_name_that_stands_twice_is_refused(folder):
    content = "time,person,x,x,y\n1,1,0.5,8,0.25\n2,1,1.5,8,0.25\n"
    layout = {"columns": {"t": "time", "track_id": "person", "x": "x", "y": "y"}, "header": True}
    with pytest.raises(DataError, match="x"):
        read(saved(folder, content), layout)


def test_one_column_may_serve_two_fields(folder):
    """Rare, but a recording along a line has one position."""
    layout = {"columns": {"t": 0, "track_id": 1, "x": 2, "y": 2}}
    tracks, _, _ = read(saved(folder, "1,1,0.5\n2,1,1.5\n"), layout)
    assert tracks.x.tolist() == tracks.y.tolist() == [0.5, 1.5]


def test_a_missing_column_is_named_with_those_there_are(folder):
    layout = {**NAMED, "columns": {**NAMED["columns"], "x": "pos_x"}}
    with pytest.raises(DataError, match=r"row 1: no column 'pos_x' for x; it has time, person, x"):
        read(saved(folder, "\n".join([HEADER, *CLEAN])), layout)


def test_start_clock_and_day_of_a_recording(folder):
    """Seconds since a start clock become unix times; the day is the place's own, changes of the clock and all."""
    form = FileFormat(timezone="Europe/London", columns=Columns(t=0, track_id=1, x=2, y=3))
    path = saved(folder, "0,1,0,0\n57599,1,1,0\n57600,1,2,0\n")
    tracks, account = read_recording(path, form, "2010-10-31", "08:00")  # winter time since 02:00
    assert tracks.t.tolist() == [1_288_512_000.0, 1_288_512_000.0 + 57_599]
    assert account.dropped_rows == {"outside_day": 1}


# --- what strangers' files look like ------------------------------------------------------------------------

BY_NAME = {"track_id": "id", "t": "t", "x": "x", "y": "y"}
MOVING = {**BY_NAME, "speed": "v", "heading": "h"}


def stranger(write, content, columns=None, **layout):
    """A file as `read_recording` reads it where its dataset file says `delimited`."""
    path = write(content)
    return delimited.read_delimited(path, {"columns": columns or BY_NAME, "header": True, "ids": "text", **layout})


def test_ids_of_several_columns_belong_together(write):
    content = "id,role,t,x,y\nh1,A,0,0,0\nh1,B,0,5,5\nh1,A,1,1,0\nh1,B,1,6,5\n"
    tracks, account = stranger(write, content, {**BY_NAME, "track_id": ["id", "role"]})
    assert set(tracks.track_id.tolist()) == {id_of("h1/A"), id_of("h1/B")}
    assert account.owners.text(id_of("h1/B")) == "h1/B"


def test_ids_of_several_columns_are_the_same_however_they_are_written_and_never_another_s(write):
    """Quotes and blanks are no part of an id; nobody's rows are nobody's; a slash within a part is no border."""
    rows = ["c1, 7,0", '"c1", 7,1', '"c1","7",2', "a/b,c,0", "a,b/c,0", "a\\,/b,0", "a,\\//b,0"]
    rows += ["c1,-1,0", "c1,None,0"]  # a floor, or a group that is none: -1 is nobody's in the first column alone
    nobody = [",,0", ',"",1', "c1,,2", "NaN,7,3", "c1,NAN,4", "NULL,7,5", "-1.0,-1,6", "-1,7,7"]
    content = "\n".join(["cam,id,t,x,y", *(f"{row},0,0" for row in [*rows, *nobody]), ""])
    tracks, account = stranger(write, content, {**BY_NAME, "track_id": ["cam", "id"]})
    assert (tracks.track_id == id_of("c1/7")).sum() == 3
    assert len(set(tracks.track_id.tolist())) == 7
    assert dict(account.dropped_rows) == {"no_track_id": 6, "no_person": 2}


def test_rows_of_others_and_what_was_not_measured_are_left_out(write):
    content = "id,class,t,x,y\n1,walker,0,3,4\n2,car,0,1,1\n1,walker,1,0,0\n1,walker,2,4,4\n"
    tracks, account = stranger(write, content, only={"class": ["walker"]}, missing={"x": 0, "y": 0})
    assert tracks.t.tolist() == [0, 2]
    assert dict(account.dropped_rows) == {"other_class": 1, "not_measured": 1}


def test_nobody_s_rows(write):
    tracks, account = stranger(write, "id,t,x,y\n,0,1,1\nNaN,0,1,1\n-1,0,1,1\na,0,1,1\n-5,0,1,1\n")
    assert tracks.track_id.tolist() == [-5, id_of("a")]
    assert dict(account.dropped_rows) == {"no_track_id": 2, "no_person": 1}
    assert account.first_seen["no_track_id"] == "row 2: track id is empty"


@pytest.mark.parametrize("beside", ["a", "7", '"7"'])  # rows with these are read as texts, as numbers, line by line
def test_nobody_s_rows_are_nobody_s_however_they_are_written(write, beside):
    words = ["NULL", "none", "NAN", "<NA>", r"\N", "-"]
    rows = [f"{word},{t},5,5" for t, word in enumerate([*words, "-1.0", "-1.0000e+00"])] + [f"{beside},0,1,1"]
    tracks, account = stranger(write, "\n".join(["id,t,x,y", *rows, ""]))
    assert len(tracks.t) == 1
    assert dict(account.dropped_rows) == {"no_track_id": 6, "no_person": 2}
    assert set(account.owners.known) <= {id_of("a")}


@pytest.mark.parametrize("block", [None, 40])
def test_plain_and_other_ids_in_one_file_are_what_each_is(write, monkeypatch, block):
    """Blocks of plain numbers are read as numbers, others as text: nobody's number depends on who shares the block."""
    if block:
        monkeypatch.setattr(columns, "line_blocks", lambda path: line_blocks(path, block))
    ids = ["7"] * 6 + ["007", "x", "7", '"7"', str(2**60), "12", "+7"]
    content = "id,t,x,y\n" + "".join(f"{one},{t},{t},0\n" for t, one in enumerate(ids))
    tracks, _ = stranger(write, content)
    in_time = tracks.track_id[np.argsort(tracks.t)].tolist()
    assert in_time == [id_of(one.strip('"')) for one in ids]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("1_000", None),
        ("١", None),
        ("1 000", None),
        ("0x1", None),
        ("1e3", 1000.0),
        ("", np.nan),
        (".5", 0.5),
        ("1.", 1.0),
        ("-inf", -np.inf),
        ("+nan", np.nan),
        ("--inf", None),
        ("-+nan", None),
        ("--1", None),
        *((text, np.nan) for text in ("NA", "n/a", "NULL", "None", "-", "NaN")),
        *((text, None) for text in ("-NA", "--", "none seen", "N")),
    ],
)
def test_numbers_are_read_strictly(text, found):
    np.testing.assert_equal(number(text), found)


@pytest.mark.parametrize("text", ["NA", "N/A", "null", "None", "-", "nan", "<NA>", r"\N"])
def test_positions_that_were_not_seen_may_be_written_as_words(tmp_path, text):
    """Two of three rows, as R and pandas write a table in which everyone has a row at every time."""
    read = []
    for word in ("", text):
        rows = [
            f"{who},{t},{t if who * 20 <= t < who * 20 + 20 else word},{who if who * 20 <= t < who * 20 + 20 else word}"
            for t in range(60)
            for who in range(3)
        ]
        path, form = tmp_path / "all.csv", FileFormat(header=True, columns=Columns(**BY_NAME))
        path.write_text("\n".join(["id,t,x,y", *rows, ""]))
        read.append(read_recording(path, form))
        assert "unreadable_rows" not in [one.check for one in check_recording(*read[-1], form)]
    (blank, blank_account), (named, account) = read
    np.testing.assert_equal(tuple(named), tuple(blank))
    assert account.dropped_rows == blank_account.dropped_rows == {"nan_value": 120}


@pytest.mark.parametrize(
    ("text", "found"),
    [("1.234,5", 1234.5), ("12.34,5", None), ("1.234.567", 1234567.0), ("-1.234,0", -1234.0), ("7,5", 7.5)],
)
def test_thousands_stand_between_groups_of_three(text, found):
    assert number(text, ",", ".") == found


def test_thousands_of_a_file(write):
    tracks, _ = stranger(write, "id;t;x;y\na;0;1.234,5;0\na;1;1.235,5;0\n", separator=";", decimal=",", thousands=".")
    assert tracks.x.tolist() == [1234.5, 1235.5]


@pytest.mark.parametrize(
    ("heading", "angle"), [("from_x", 0.3), ("from_x_clockwise", -0.3), ("compass", np.pi / 2 - 0.3)]
)
def test_headings_are_counted_as_the_units_say(write, heading, angle):
    content = f"id,t,x,y,v,h\n1,0,0,0,3.6,{np.rad2deg(0.3)}\n1,1,1,0,3.6,{np.rad2deg(0.3)}\n"
    units = {"angle": "deg", "heading": heading, "speed": "km/h"}
    tracks, _ = stranger(write, content, MOVING, units=units)
    np.testing.assert_allclose(tracks.heading, angle)
    np.testing.assert_allclose(tracks.speed, 1.0)


@pytest.mark.parametrize("reader", ["atc", "atc_1hz", "delimited"])
def test_below_the_least_speed_there_is_no_heading_whoever_reads(write, reader):
    content = "0,1,1,2,0.03,0.5\n1,1,2,2,0.9,0.5\n"
    if reader == "atc":
        content = "0,1,1000,2000,0,30,0.5,0\n1,1,2000,2000,0,900,0.5,0\n"
    columns = Columns(t=0, track_id=1, x=2, y=3, speed=4, heading=5) if reader == "delimited" else None
    for least, known in ((0.05, [False, True]), (0.0, [True, True])):
        form = FileFormat(reader=reader, columns=columns, min_heading_mps=least)
        tracks, _ = read_recording(write(content), form)
        assert np.isfinite(tracks.heading).tolist() == known
        assert tracks.speed.tolist() == pytest.approx([0.03, 0.9])


def test_a_homography_takes_pixels_to_metres(write):
    matrix = [[0.02, 0.0, -3.0], [0.0, -0.03, 9.0], [0.0, 0.001, 1.0]]
    tracks, _ = stranger(write, "id,t,x,y\n1,0,100,50\n1,1,110,60\n", homography=matrix)
    for row, (x, y) in enumerate([(100, 50), (110, 60)]):
        u, v, w = np.array(matrix) @ [x, y, 1]
        assert (tracks.x[row], tracks.y[row]) == pytest.approx((u / w, v / w))


def test_a_national_grid_is_moved_to_its_origin_or_asked_about(write):
    content = "id,t,x,y\n1,0,691000.5,5334000.25\n1,1,691001.5,5334000.25\n"
    with pytest.raises(DataError, match=r"set `origin_m: \[691000, 5334000\]`"):
        stranger(write, content)
    tracks, _ = stranger(write, content, origin_m=[691000, 5334000])
    assert (tracks.x.tolist(), tracks.y.tolist()) == ([0.5, 1.5], [0.25, 0.25])


def test_local_times_without_zone(write):
    content = "id,t,x,y\n1,2026-07-01 09:00:00,0,0\n1,2026-07-01T09:00:01.5,1,0\n1,never,2,0\n"
    tracks, account = stranger(write, content, units={"time": "iso"}, timezone="Europe/Berlin")
    assert tracks.t.tolist() == [1782889200.0, 1782889201.5]
    assert dict(account.dropped_rows) == {"text_value": 1}


@pytest.mark.parametrize("person", ["1", "a", '"1"'])  # read as numbers, as texts, line by line
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2026-10-25 02:30:00", "exists twice, as clocks were put back: write it with its offset from UTC ("),
        ("2026-03-29 02:30:00", "does not exist, as clocks were put forward: write it with its offset from UTC ("),
    ],
)
def test_a_local_time_that_is_not_one_moment_is_named_with_its_row(write, person, text, message):
    """Of the second block as well; a blank line counts as a row."""
    rows = [f"{person},2026-07-01 09:00:{n:02},{n},0" for n in range(4)]
    path = write("\n".join(["id,t,x,y", *rows, "", f"{person},{text},0,0", f"{person},{text},0,0", ""]))
    with pytest.raises(DataError) as error:
        stranger(write, path.read_text(), units={"time": "iso"}, timezone="Europe/Berlin")
    assert f"{path}, row 7: {text} in Europe/Berlin {message}" in str(error.value)


@pytest.mark.parametrize("size", [60, 1 << 20])
@pytest.mark.parametrize("person", ["1", "a", '"1"'])
@pytest.mark.parametrize(("first", "other"), [("", "+00:00"), ("Z", "")])
def test_times_with_and_without_a_zone_are_not_mixed(write, cut, size, person, first, other):
    """They may be hours apart; the first row of each is named, of the second block as well."""
    cut(size)
    times = [f"2026-07-01 09:00:0{n}{zone}" for n, zone in enumerate([first, first, other, first, other])]
    lines = [f"{person},{time},{n},0" for n, time in enumerate(times)]
    with pytest.raises(DataError) as error:
        stranger(write, "\n".join(["id,t,x,y", *lines, ""]), units={"time": "iso"}, timezone="Europe/Stockholm")
    assert all(f"row {n + 2}" in str(error.value) and repr(times[n]) in str(error.value) for n in (0, 2))


def test_a_start_that_is_not_one_moment_is_named_with_its_file(write):
    path = write("id,t,x,y\n1,0,0,0\n")
    form = FileFormat(columns=Columns(**BY_NAME), header=True, timezone="Europe/Berlin")
    with pytest.raises(DataError) as error:
        read_recording(path, form, "2026-10-25", "02:30")
    assert f"{path}: start '02:30': 2026-10-25 02:30:00 in Europe/Berlin exists twice" in str(error.value)
    assert len(read_recording(path, form, "2026-10-25", "02:30+01:00")[0].t) == 1


@pytest.mark.parametrize("size", [200, 1 << 20])
@pytest.mark.parametrize("by_time", [True, False])
def test_an_id_that_jumps_is_cut_whether_or_not_the_file_says_how_fast_it_is(write, cut, size, by_time):
    """12 m in 0.1 s, after which somebody goes on for a second or longer: at steps of 1 s both look like a walk."""
    cut(size)
    rows = [
        (who, k / 10, 3.0 * who + 12 * (k >= 45 + who) * (who % 2), 0.13 * k) for who in range(6) for k in range(80)
    ]
    rows.sort(key=lambda row: row[1] if by_time else row[0])
    path = write("id,t,x,y,v,h\n" + "".join(f"{who},{t},{x},{y:.2f},1.3,1.5708\n" for who, t, x, y in rows))
    found = []
    for moving in ({}, {"speed": "v", "heading": "h"}):
        form = FileFormat(columns=Columns(**BY_NAME, **moving), header=True)
        tracks, account = clean_recording(path, form, Recording())
        assert account["notes"]["cut_at_jump"] == 3
        found.append({int(who): tracks.t[tracks.track_id == who].min() for who in np.unique(tracks.track_id)})
        assert all(np.ptp(tracks.x[tracks.track_id == who]) == 0 for who in found[-1])
    assert found[0].keys() == found[1].keys(), "the pieces have the same ids"
    assert all(abs(found[0][who] - found[1][who]) <= 1 for who in found[0])
    still, _ = clean_recording(path, replace(form, max_jump_mps=None), Recording())
    assert len(np.unique(still.track_id)) == 6


@pytest.mark.parametrize("size", [None, 64])
@pytest.mark.parametrize("header", [True, False])
def test_blank_lines_before_the_first_row_are_no_row(folder, cut, size, header):
    cut(size) if size else None
    table = "id,t,x,y\n" * header + "1,0,0.5,0\n1,1,1.5,0\n"
    layout = {"columns": BY_NAME if header else {"track_id": 0, "t": 1, "x": 2, "y": 3}, "header": header}
    for before in ("\n", "  \r\n\r\n", "\n" * 500):
        tracks, dropped, account = read(saved(folder, before + table), layout)
        assert tracks.x.tolist() == [0.5, 1.5]
        assert (dropped, account.rows_read) == ({}, 2)


@pytest.mark.parametrize("header", [True, False])
def test_ids_that_begin_as_comments_do_are_told_of_and_kept_if_wanted(write, caplog, header):
    """Twenty people became seventeen without a word."""
    rows = [f"{'#' * (n % 3 == 0)}{n} {t} {t}.5 {n}" for n in range(9) for t in range(3)]
    path = write("\n".join(["# made up", *["id t x y"] * header, *rows, "# 1 commented out", "#note 1 2", ""]))
    form = FileFormat(reader="text", header=header, columns=Columns(track_id=0, t=1, x=2, y=3))
    tracks, account = read_recording(path, form)
    assert len(tracks.t) == 18
    assert dict(account.dropped_rows) == {"row_as_comment": 9, "comment_line": 2}
    assert "9 lines that begin with '#' are dropped as comments, but are rows else" in caplog.text
    path.write_text(path.read_text().removeprefix("# made up\n"))
    tracks, account = read_recording(path, replace(form, comment=""))
    assert len(set(tracks.track_id.tolist())) == 9
    assert dict(account.dropped_rows) == {"text_value": 1, "wrong_column_count": 1}


def test_comments_and_aligned_columns(write):
    content = "# made up\n\n  1   0\t 0.5  1.0\n# restarted\n 1   1  1.5   1.0  \n"
    tracks, account = delimited.read_delimited(
        write(content),
        {"columns": {"track_id": 0, "t": 1, "x": 2, "y": 3}, "ids": "text", "separator": None, "comment": "#"},
    )
    assert tracks.x.tolist() == [0.5, 1.5]
    assert dict(account.dropped_rows) == {"comment_line": 1}


@pytest.mark.parametrize("ends", ["\r", "\n\r", "\r\n\r", "\r\n", "\n"])
@pytest.mark.parametrize("block", [7, 30, 1 << 20])
def test_lines_end_in_any_way_and_in_several(write, monkeypatch, ends, block):
    """Files are put together from others: what ended in CR alone after a line end of another kind was lost."""
    monkeypatch.setattr(columns, "line_blocks", lambda path: line_blocks(path, block))
    kinds = ["\r\n" if ends.startswith("\r\n") else ends[0], ends[-1] if ends != "\r\n" else ends]
    rows = ["id,t,x,y", *(f"a,{n},{n},0" for n in range(12))]
    content = "".join(row + kinds[n > 6] for n, row in enumerate(rows))
    path = write("")
    path.write_bytes(content.encode())
    tracks, account = delimited.read_delimited(path, {"columns": BY_NAME, "header": True, "ids": "text"})
    assert tracks.t.tolist() == list(range(12))
    assert account.rows_read == 12
