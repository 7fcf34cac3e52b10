"""A file that is not as declared is refused in words that name what would mend it."""

import re

import pytest
from planted import PLACES, people

from modlhmp import read_tracks
from modlhmp.cleaning import clean_recording
from modlhmp.datasets import load_dataset
from modlhmp.file_format import FileFormat, Recording
from modlhmp.settings import check
from modlhmp.storage import DataError

ROWS = people(number=20)
BY_POSITION = {"track_id": 0, "t": 1, "x": 2, "y": 3}
UNIX = 1_772_442_000  # 2026-03-02 09:00 UTC


def file_of(path, line, header="", encoding="utf-8"):
    """A file with a line of each row, by a function of id, t, x, y."""
    rows = [line(int(person), t, x, y) for person, t, x, y, _, _ in ROWS]
    path.write_bytes("\n".join([header, *rows] if header else rows).encode(encoding))
    return path


def refusal(path, recording=None, **form):
    with pytest.raises(DataError) as error:
        clean_recording(path, check(FileFormat, form, "test"), recording or Recording(day=""))
    assert str(path) in str(error.value)
    return str(error.value)


def comma(person, t, x, y):
    return f"{person},{t:.2f},{x:.3f},{y:.3f}"


def test_a_header_and_nothing_else(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("id,t,x,y\n")
    assert "names its columns, but has no row" in refusal(path, header=True, columns=PLACES)


@pytest.mark.parametrize(
    ("line", "header"),
    [
        (lambda person, t, x, y: f"{person:6d} {t:8.1f} {x:9.3f} {y:9.3f}", False),
        (lambda person, t, x, y: f" {person} {t:.1f} {x:.3f} {y:.3f}", True),
    ],
    ids=["aligned", "a blank before"],
)
def test_one_blank_as_separator_where_there_are_several(tmp_path, line, header):
    path = file_of(tmp_path / "a.txt", line, "id t x y" if header else "")
    told = refusal(path, separator=" ", header=header, columns=PLACES if header else BY_POSITION)
    assert "use `reader: text`" in told


@pytest.mark.parametrize("mark", ["#", "%"])
def test_the_mark_of_comments_is_named_and_serves(tmp_path, mark):
    path = file_of(tmp_path / "a.csv", comma, f"{mark} id, t, x, y")
    told = refusal(path, columns=BY_POSITION)
    assert ("`reader: text`" in told) == (mark == "#")
    assert f"`comment: '{mark}'`" in told
    clean_recording(path, check(FileFormat, {"columns": BY_POSITION, "comment": mark}, "test"), Recording(day=""))


def test_times_of_a_twelve_hour_clock(tmp_path):
    path = file_of(
        tmp_path / "a.csv", lambda person, t, x, y: f"{person},2026-03-02 09:00:{t:04.1f} AM,{x:.3f},{y:.3f}"
    )
    told = refusal(path, columns=BY_POSITION, units={"time": "iso"})
    assert "2026-03-02T09:00:00 (ISO 8601" in told and "rewrite" in told


def test_unix_times_and_a_start(tmp_path):
    path = file_of(tmp_path / "a.csv", lambda person, t, x, y: comma(person, UNIX + t, x, y), "id,t,x,y")
    told = refusal(path, Recording(day="2026-03-02", start="09:00"), header=True, columns=PLACES)
    assert "2026-03-02 09:00 UTC" in told
    assert "leave out `start`" in told


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252"])
@pytest.mark.parametrize(
    ("columns", "more"),
    [
        ({**PLACES, "track_id": "Fußgänger"}, {}),
        (BY_POSITION, {}),
        ({**PLACES, "track_id": 4}, {"without": {"wo": ["Straßenbahn"]}}),
    ],
    ids=["name", "ids", "chosen rows"],
)
def test_text_that_is_not_utf_8(tmp_path, encoding, columns, more):
    def line(person, t, x, y):
        return f"Müller {person},{t:.1f},{x:.3f},{y:.3f},{person},Straße"

    path = file_of(tmp_path / "a.csv", line, "Fußgänger,t,x,y,number,wo", encoding)
    told = refusal(path, header=True, columns=columns, **more)
    assert "save it as UTF-8" in told
    assert told.count(str(path)) == 1


def test_other_columns_may_be_in_any_encoding(tmp_path):
    path = file_of(tmp_path / "a.csv", lambda *row: comma(*row) + ",Straße", "id,t,x,y,Fuß", "latin-1")
    tracks, account = clean_recording(path, check(FileFormat, {"header": True, "columns": PLACES}, "test"), Recording())
    assert len(tracks.t) == len(ROWS)
    assert not account["rows"]["dropped"]


@pytest.mark.parametrize(
    ("per", "begin", "told"),
    [(60.0, 0.0, "minutes"), (3600.0, 9.0, "hours"), (86_400.0, 46_083.375, "days"), (86_400.0, 0.0, "days")],
)
def test_times_in_units_of_spreadsheets(tmp_path, per, begin, told):
    path = file_of(tmp_path / "a.csv", lambda p, t, x, y: f"{p},{begin + t / per:.9f},{x:.3f},{y:.3f}", "id,t,x,y")
    found = re.search(r"they look like (\w+),[^)]*\) would give (\S+) m/s", refusal(path, header=True, columns=PLACES))
    assert found[1] == told
    assert 1.1 < float(found[2]) < 1.5


def test_feet(tmp_path):
    path = file_of(tmp_path / "a.csv", lambda p, t, x, y: comma(p, t, x / 0.3048, y / 0.3048), "id,t,x,y")
    assert "units: {length: px}, scale: 0.3048" in refusal(path, header=True, columns=PLACES)


def test_degrees_of_longitude_and_latitude(tmp_path):
    def line(person, t, x, y):
        return f"{person},{t:.1f},{15.2066 + x / 56_900:.8f},{59.2741 + y / 111_000:.8f}"

    told = refusal(file_of(tmp_path / "a.csv", line, "id,t,x,y"), header=True, columns=PLACES)
    assert "Project them to metres" in told


@pytest.mark.parametrize(
    ("mark", "told"),
    [(",", "`thousands: ','`, or `decimal: ','`"), ("'", '`thousands: "\'"`'), (" ", "`thousands: ' '`")],
)
def test_marks_of_thousands(tmp_path, mark, told):
    def line(person, t, x, y):
        return f"{person};{t:.0f};" + f"{1000 * x + 90_000:,.0f};{1000 * y + 90_000:,.0f}".replace(",", mark)

    path = file_of(tmp_path / "a.csv", line, "id;t;x;y")
    assert told in refusal(path, header=True, separator=";", columns=PLACES, units={"length": "mm"})


@pytest.mark.parametrize(
    ("mark", "decimal", "told"),
    [
        (",", ".", "`thousands: ','`"),
        (".", ",", "`thousands: '.'` and `decimal: ','`"),
        ("\u00a0", ",", "`thousands: ' '` and `decimal: ','`"),
        ("\u202f", ",", "`thousands: ' '` and `decimal: ','`"),
        ("\u2019", ".", '`thousands: "\'"`'),
        ("", ",", '`decimal: ","`'),
    ],
)
@pytest.mark.parametrize("share", [0.3, 0.7])
def test_marks_in_some_of_the_rows(tmp_path, caplog, mark, decimal, told, share):
    """Rows without a mark were read, and the others lost with a warning of something else."""
    high = iter(range(10**6))

    def line(person, t, x, y):
        above = 90_000 if next(high) % 10 < 10 * share else 0
        part = f"{1000 * x % 900 + above:,.1f}" if above else f"{1000 * x % 900:.0f}"
        part = part.translate({ord(","): mark, ord("."): decimal})
        return f"{person};{t:.0f};{part};{1000 * y:.0f}"

    path, form = file_of(tmp_path / "a.csv", line, "id;t;x;y"), {"header": True, "separator": ";", "columns": PLACES}
    form |= {"units": {"length": "mm"}, "accept": ["walking_speed", "jumps", "extent"]}
    if share > 0.5:
        assert told in refusal(path, **form)
    else:
        clean_recording(path, check(FileFormat, form, "test"), Recording())
        assert told in caplog.text
    marks = {"decimal": decimal, "thousands": {"\u00a0": " ", "\u202f": " ", "\u2019": "'"}.get(mark, mark or None)}
    _, account = clean_recording(path, check(FileFormat, {**form, **marks}, "test"), Recording())
    assert "text_value" not in account["rows"]["dropped"]


def test_a_decimal_comma_after_nought_is_no_thousands(tmp_path):
    path = file_of(
        tmp_path / "a.csv", lambda p, t, x, y: f"{p};{t};" + f"{0.9:.3f};{y:.3f}".replace(".", ","), "id;t;x;y"
    )
    told = refusal(path, header=True, separator=";", columns=PLACES)
    assert '`decimal: ","`' in told
    assert "thousands" not in told


def test_a_header_that_is_narrower_than_its_rows_is_no_preamble(tmp_path):
    path = file_of(tmp_path / "a.csv", lambda *row: comma(*row) + ",", "id,t,x,y")
    for columns in (PLACES, BY_POSITION):
        told = refusal(path, header=True, columns=columns)
        assert "has 4 columns in its header and 5 below" in told
        assert "skip_lines" not in told


def test_quoted_numbers_with_commas_between_commas(tmp_path):
    """As a German table calculation exports them: read where a header counts the columns, and asked about before."""

    def line(person, t, x, y):
        return ",".join(f'"{one:.3f}"'.replace(".", ",") if one % 1 else f"{one:.0f}" for one in (person, t, x, y))

    path = file_of(tmp_path / "a.csv", line, "id,t,x,y")
    assert '`decimal: ","`' in refusal(path, header=True, columns=PLACES).replace("'", '"')
    form = {"header": True, "columns": PLACES, "decimal": ","}
    tracks, account = clean_recording(path, check(FileFormat, form, "test"), Recording())
    assert account["rows"]["dropped"] == {}
    assert len(tracks.t) == len(ROWS)
    with pytest.raises(DataError, match=r"decimal ',' is also the separator.*save the file with ;"):
        read_tracks(path, columns=BY_POSITION, decimal=",")


def test_times_of_a_clock_and_a_start_in_a_dataset_file(tmp_path):
    path = tmp_path / "d.yaml"
    path.write_text(
        "title: T\nreader: delimited\nheader: true\ncolumns: {track_id: id, t: t, x: x, y: y}\ntimezone: UTC\n"
        "units: {time: iso}\nrecordings: [{files: a.csv, day: 2026-03-02, start: '09:00', split: {by: time}}]\n"
        "horizon_s: 10\nvelocity: differences\ncitation: c\nterms: t\n"
    )
    with pytest.raises(DataError, match=r"d\.yaml: recordings: start .09:00.: .*leave it out"):
        load_dataset(path, tmp_path)


@pytest.mark.parametrize("key", ["only", "without"])
@pytest.mark.parametrize("text", ["Pedestrian", "pedestrian ", "PEDESTRIAN"])
def test_a_text_to_choose_rows_by_that_the_file_writes_otherwise(tmp_path, key, text):
    """Cars that `without` misses would walk among the people."""
    path = file_of(
        tmp_path / "a.csv", lambda p, *row: comma(p, *row) + f",{'car' if p % 2 else 'pedestrian'}", "id,t,x,y,k"
    )
    told = refusal(path, header=True, columns=PLACES, **{key: {"k": [text]}})
    assert f"{key}: {{k: [{text}]}}" in told
    assert "writes 'pedestrian'" in told


@pytest.mark.parametrize("key", ["only", "without"])
@pytest.mark.parametrize(("text", "written"), [(2, "2.0"), (2, "02"), ("2.0", "2"), (20, "2.0e+01")])
def test_a_number_to_choose_rows_by_that_the_file_writes_otherwise(tmp_path, key, text, written):
    path = file_of(tmp_path / "a.csv", lambda p, *row: comma(p, *row) + f",{written if p % 2 else '1'}", "id,t,x,y,k")
    assert f"writes {written!r}" in refusal(path, header=True, columns=PLACES, **{key: {"k": [text]}})


@pytest.mark.parametrize(("texts", "told"), [(["car", 2], ["Car", "2.0"]), (["car", "Car", 2, "2.0", "CAR"], [])])
def test_a_text_that_the_file_writes_in_two_ways_is_asked_about_unless_both_are_said(tmp_path, caplog, texts, told):
    kinds = ["car", "Car", "2", "2.0", "walker"]
    path = file_of(tmp_path / "a.csv", lambda p, *row: comma(p, *row) + f",{kinds[p % 5]}", "id,t,x,y,k")
    form = check(FileFormat, {"header": True, "columns": PLACES, "without": {"k": texts}}, "test")
    clean_recording(path, form, Recording())
    asked = [one.getMessage() for one in caplog.records if "meant" in one.getMessage()]
    assert [one.partition("the file also has ")[2] for one in asked] == [
        f"{one!r}: is it meant as well?" for one in told
    ]


def test_a_text_to_choose_rows_by_that_no_row_has(tmp_path, caplog):
    path = file_of(tmp_path / "a.csv", lambda p, *row: comma(p, *row) + ",walker", "id,t,x,y,k")
    told = refusal(path, header=True, columns=PLACES, only={"k": ["adult", "child"]})
    assert "column 'k' holds 'walker'" in told
    for texts, near in ((["car", "bike"], ""), (["car", "walkers"], "walkers"), (["walk-in", "1"], "")):
        form = check(FileFormat, {"header": True, "columns": PLACES, "without": {"k": texts}}, "test")
        caplog.clear()
        tracks, _ = clean_recording(path, form, Recording())  # a recording without cars is one
        assert len(tracks.t) == len(ROWS)
        assert [one.getMessage() for one in caplog.records] == [
            f"{path}: without: {{k: [{text}]}}: no row has that text, but the file has 'walker': is it mistyped?"
            for text in [near]
            if text
        ]


@pytest.mark.parametrize(("key", "texts"), [("only", ["adult", "chidl"]), ("without", ["adult", "chidl"])])
def test_a_mistyped_text_is_told_beside_one_that_is_there(tmp_path, caplog, key, texts):
    """Children would be lost, or would walk among the people."""
    kinds = ("adult", "child", "staff")
    path = file_of(tmp_path / "a.csv", lambda p, *row: comma(p, *row) + f",{kinds[p % 3]}", "id,t,x,y,k")
    form = {"header": True, "columns": PLACES, key: {"k": texts}}
    clean_recording(path, check(FileFormat, form, "test"), Recording())
    assert f"{key}: {{k: [chidl]}}: no row has that text, but the file has 'child': is it mistyped?" in caplog.text


def test_numbers_to_choose_rows_by_are_not_taken_for_mistyped_ones(tmp_path, caplog):
    path = file_of(tmp_path / "a.csv", lambda p, *row: comma(p, *row) + ",1", "id,t,x,y,k")
    form = {"header": True, "columns": PLACES, "without": {"k": [11, 12]}}
    clean_recording(path, check(FileFormat, form, "test"), Recording())
    assert not caplog.records


def test_a_preamble_before_a_line_that_is_longer_than_what_is_looked_at(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("walks\n\n" + "id,t,x,y" + "," * 60_000 + "\n1,2,3,4\n")
    assert "set `skip_lines: 2`" in refusal(path, header=True, columns=PLACES)
