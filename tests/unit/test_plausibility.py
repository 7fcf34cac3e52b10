"""Wrong units, rates and angles are noticed, and answered with the option that mends them; good recordings pass."""

import logging
import re
import typing
from typing import get_args

import numpy as np
import pytest
import yaml
from planted import MOVING, PLACES, people, write

import modlhmp
from modlhmp import plausibility
from modlhmp.account import Account
from modlhmp.cleaning import clean_recording
from modlhmp.file_format import _READER_NEEDS, CheckName, Columns, FileFormat, Recording, check_format, how_to_set
from modlhmp.inspection import inspect_file
from modlhmp.plausibility import CHECKS, check_recording
from modlhmp.readers import read_recording
from modlhmp.settings import check
from modlhmp.storage import DataError


def form(columns=MOVING, **keys):
    return check(FileFormat, {"header": True, "columns": columns, **keys}, "test")


def findings(path, described):
    rows, account = read_recording(path, described)
    return check_recording(rows, account, described)


@pytest.mark.parametrize(
    ("written", "declared"),
    [
        ({}, {}),
        ({"moving": False}, {}),
        ({"length": "cm"}, {"units": {"length": "cm", "speed": "m/s"}}),
        ({"length": "mm", "speed": "mm/s"}, {"units": {"length": "mm"}}),
        ({"length": "px", "moving": False}, {"units": {"length": "px"}, "scale": 0.025}),
        ({"time": "ms"}, {"units": {"time": "ms"}}),
        ({"time": "ns"}, {"units": {"time": "ns"}}),
        ({"rate": 25}, {"units": {"time": "frame"}, "frame_rate": 25}),
        ({"speed": "km/h"}, {"units": {"speed": "km/h"}}),
        ({"angle": "deg"}, {"units": {"angle": "deg"}}),
        ({"angle": "deg", "heading": "compass"}, {"units": {"angle": "deg", "heading": "compass"}}),
        ({"heading": "from_x_clockwise"}, {"units": {"heading": "from_x_clockwise"}}),
    ],
)
@pytest.mark.parametrize("step_s", [0.1, 0.4, 1.0])
def test_a_right_declaration_passes(tmp_path, written, declared, step_s):
    path = write(tmp_path / "a.csv", people(rows=round(20 / step_s), step_s=step_s), **written)
    columns = PLACES if written.get("moving") is False else MOVING
    assert findings(path, form(columns, **declared)) == []


FRAMES = {"units": {"time": "frame"}}
WRONG = [  # as written, as declared, the check that notices (None: the reader, which keeps no row), the answer
    # of positions and times
    ({"length": "cm", "moving": False}, {}, "walking_speed", "units: {length: cm}"),
    ({"length": "mm", "moving": False}, {}, None, "units: {length: mm}"),
    ({"length": "cm", "moving": False}, {"units": {"length": "mm"}}, "walking_speed", "units: {length: cm}"),
    ({"moving": False}, {"units": {"length": "cm"}}, "walking_speed", "units: {length: m}"),
    ({"moving": False}, {"units": {"length": "mm"}}, "walking_speed", "units: {length: m}"),
    ({"length": "px", "moving": False}, {}, "walking_speed", "units: {length: px}"),
    ({"time": "ms", "moving": False}, {}, "walking_speed", "units: {time: ms}"),
    ({"moving": False}, {"units": {"time": "ms"}}, "walking_speed", "units: {time: s}"),
    ({"time": "us", "moving": False}, {"units": {"time": "ms"}}, "walking_speed", "units: {time: us}"),
    ({"rate": 25, "moving": False}, {}, "walking_speed", "units: {time: frame}"),
    ({"rate": 25, "moving": False}, {**FRAMES, "frame_rate": 2.5}, "walking_speed", "frame_rate: 25"),
    ({"rate": 25, "moving": False}, {**FRAMES, "frame_rate": 250}, "walking_speed", "frame_rate: 25"),
    ({"rate": 25, "moving": False}, {**FRAMES, "frame_rate": 10}, "walking_speed", "frame_rate: 25"),
    ({"rate": 15, "moving": False}, {**FRAMES, "frame_rate": 25}, "walking_speed", "frame_rate: 15"),
    ({"rate": 10, "moving": False}, {**FRAMES, "frame_rate": 25}, "walking_speed", "frame_rate: 10"),
    # of the file's speeds
    ({"speed": "km/h"}, {}, "recorded_speed", "units: {speed: km/h}"),
    ({"speed": "cm/s"}, {}, "absurd_rows", "units: {speed: cm/s}"),
    ({"speed": "mm/s"}, {}, None, "units: {speed: mm/s}"),
    ({}, {"units": {"speed": "km/h"}}, "recorded_speed", "units: {speed: m/s}"),
    ({}, {"units": {"speed": "mm/s"}}, "recorded_speed", "units: {speed: m/s}"),
    ({"length": "cm"}, {"units": {"length": "cm"}}, "recorded_speed", "units: {speed: m/s}"),
    # of the file's headings
    ({"angle": "deg"}, {}, "recorded_heading", "units: {angle: deg}"),
    ({"angle": "deg", "heading": "compass"}, {}, "recorded_heading", "units: {angle: deg}"),
    ({}, {"units": {"angle": "deg"}}, "recorded_heading", "units: {angle: rad}"),
    ({"heading": "compass"}, {}, "recorded_heading", "units: {heading: compass}"),
    ({"heading": "from_x_clockwise"}, {}, "recorded_heading", "units: {heading: from_x_clockwise}"),
    ({"angle": "deg", "heading": "compass"}, {"units": {"angle": "deg"}}, "recorded_heading",
     "units: {heading: compass}"),
    ({}, {"units": {"heading": "compass"}}, "recorded_heading", "units: {heading: from_x}"),
    ({}, {"units": {"heading": "from_x_clockwise"}}, "recorded_heading", "units: {heading: from_x}"),
    ({"heading": "backwards"}, {}, "recorded_heading", "backwards"),
]  # fmt: skip


@pytest.mark.parametrize(("written", "declared", "name", "remedy"), WRONG)
@pytest.mark.parametrize("step_s", [0.4, 1.0])
def test_a_wrong_declaration_is_named_with_the_option(tmp_path, written, declared, name, remedy, step_s):
    path = write(tmp_path / "a.csv", people(rows=round(20 / step_s), step_s=step_s), **written)
    described = form(PLACES if written.get("moving") is False else MOVING, strict=True, **declared)
    with pytest.raises(DataError) as error:
        clean_recording(path, described, Recording(day=""))
    assert str(path) in str(error.value)
    assert remedy in str(error.value)
    if name is not None:
        assert f"accept: [{name}]" in str(error.value)
        assert [remedy in one.remedy for one in findings(path, described) if one.check == name] == [True]


def followed(told, keys, columns=None):
    """A form with what a message names first, refused if its reader does not take it; `columns` are for another one."""
    named = re.findall(r"`(\w+: .*?)`", told.split(" would give ")[0].split("; if it is right")[0])
    if "reader: delimited" in named:
        keys = {"columns": columns}
    for one in named:
        keys = keys | yaml.safe_load(re.sub(r", (?=scale|frame_rate)", "\n", one))
    found = check(FileFormat, keys, "test")
    check_format(found, "test")
    return found


@pytest.mark.parametrize(("written", "declared", "name", "remedy"), WRONG)
def test_a_remedy_is_accepted(tmp_path, written, declared, name, remedy):
    path = write(tmp_path / "a.csv", people(), **written)
    columns = PLACES if written.get("moving") is False else MOVING
    with pytest.raises(DataError) as error:
        clean_recording(path, form(columns, strict=True, **declared), Recording(day=""))
    followed(str(error.value), {"reader": "delimited", "header": True, "columns": columns, **declared})


def atc_file(path, degrees=False, kilometres=False):
    """People in the form of ATC at 1 Hz, maybe with headings in degrees, or speeds in km/h."""
    person, t, x, y, v, h = people().T
    h, v = np.degrees(h) if degrees else h, v * 3.6 if kilometres else v
    np.savetxt(path, np.column_stack([t, person, x, y, v, h]), "%.6f", ",")
    return path


@pytest.mark.parametrize("wrong", ["degrees", "kilometres"])
def test_a_remedy_that_a_reader_does_not_take_names_one_that_does(tmp_path, wrong):
    path = atc_file(tmp_path / "a.csv", **{wrong: True})
    with pytest.raises(DataError, match="reader 'atc_1hz' does not read units: read the file by") as error:
        clean_recording(path, check(FileFormat, {"reader": "atc_1hz"}, "test"), Recording(day=""))
    columns = {"t": 0, "track_id": 1, "x": 2, "y": 3, "speed": 4, "heading": 5}
    clean_recording(path, followed(str(error.value), {"reader": "atc_1hz"}, columns), Recording(day=""))


@pytest.mark.parametrize("reader", get_args(typing.get_type_hints(FileFormat)["reader"]))
def test_every_reader_takes_what_a_check_names_or_is_told_which_does(reader):
    places = {"track_id": 0, "t": 1, "x": 2, "y": 3}
    needed = {"columns": places, "frame_rate": 25, "scale": 0.025, "row_stride": 1}
    keys = {"reader": reader} | {key: needed[key] for key in _READER_NEEDS.get(reader, ())}
    described = check(FileFormat, keys, "test")
    for remedy in ("`units: {angle: deg}`", "`missing: {x: 0, y: 0}`", "`skip_lines: 2`", "`origin_m: [100, 200]`"):
        followed(remedy + how_to_set(remedy, described), keys, places)


def test_a_homography_is_corrected_instead_of_the_unit(tmp_path):
    path = write(tmp_path / "a.csv", people(), length="mm", moving=False)
    flat = [[1000, 0, 0], [0, 1000, 0], [0, 0, 1]]
    with pytest.raises(DataError, match="a `homography` takes positions to metres: correct its numbers instead"):
        clean_recording(path, form(PLACES, homography=flat), Recording(day=""))


@pytest.mark.parametrize(("written", "declared", "name", "remedy"), [one for one in WRONG if one[2]])
def test_some_tracks_of_a_large_recording_tell_the_same(tmp_path, monkeypatch, written, declared, name, remedy):
    columns = PLACES if written.get("moving") is False else MOVING
    path = write(tmp_path / "a.csv", people(rows=50, step_s=0.4), **written)
    every = findings(path, form(columns, **declared))
    monkeypatch.setattr(plausibility, "LOOKED_AT", 200)
    some = findings(path, form(columns, **declared))
    assert [(one.check, one.severity) for one in some] == [(one.check, one.severity) for one in every]
    assert any(one.check == name and remedy in one.remedy for one in some)


def test_the_public_eth_file_that_runs_too_fast_is_named(tmp_path):
    path = write(tmp_path / "biwi_eth.csv", rate=15, moving=False)
    (found,) = findings(path, form(PLACES, **FRAMES, frame_rate=25))
    assert found.severity == "warn"
    assert "biwi_eth.txt" in found.remedy
    assert "1.67 times" in found.remedy


def test_all_of_a_unit_wrong_at_once_is_told_once_for_each(tmp_path):
    """Cm and cm/s as m and m/s, degrees as radians: nearly every row is faster than anybody, and is dropped."""
    path = write(tmp_path / "a.csv", length="cm", speed="cm/s", angle="deg")
    with pytest.raises(DataError) as error:
        modlhmp.read_tracks(path, columns=MOVING)
    assert "units: {speed: cm/s}" in str(error.value)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_few_rows_are_no_evidence(tmp_path, rows):
    path = write(tmp_path / "a.csv", people(number=4, rows=rows), length="cm", moving=False)
    assert [one for one in findings(path, form(PLACES)) if one.severity != "note"] == []


def test_nobody_moves(tmp_path):
    path = write(tmp_path / "a.csv", people(number=4, standing=4))
    assert all(one.check != "recorded_heading" for one in findings(path, form()))


def test_who_knows_better_says_so(tmp_path):
    path = write(tmp_path / "a.csv", heading="backwards")
    tracks = modlhmp.read_tracks(path, columns=MOVING, accept=["recorded_heading"])
    assert len(tracks.t) > 100
    with pytest.raises(DataError, match="fast_walking"):
        modlhmp.read_tracks(path, columns=MOVING, accept=["fast_walking"])


def test_a_warning_is_loud_kept_and_stops_where_strict(tmp_path, caplog):
    table = people()
    table[:, 2:4] *= 1.9  # runners
    path = write(tmp_path / "a.csv", table, moving=False)
    described = form(PLACES)
    with caplog.at_level(logging.WARNING, logger="modlhmp"):
        _, account = clean_recording(path, described, Recording(day=""))
    assert any("walking_speed" in record.getMessage() for record in caplog.records)
    assert [one.partition(":")[0] for one in account["warnings"]] == ["walking_speed"]
    with pytest.raises(DataError, match="strict"):
        clean_recording(path, form(PLACES, strict=True), Recording(day=""))
    _, account = clean_recording(path, form(PLACES, strict=True, accept=["walking_speed"]), Recording(day=""))
    assert "warnings" not in account


def test_a_good_recording_has_no_warnings_in_its_account(tmp_path):
    _, account = clean_recording(write(tmp_path / "a.csv"), form(), Recording(day=""))
    assert "warnings" not in account


def test_rows_farther_apart_than_the_time_step(tmp_path):
    path = write(tmp_path / "a.csv", people(step_s=3.0), moving=False)
    (found,) = findings(path, form(PLACES))
    assert (found.check, found.severity) == ("time_step", "warn")
    assert "time_step_s: 3" in found.remedy


@pytest.mark.parametrize("step_s", [0.1, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("begin_s", [0, 8 * 3600 + 3000])
def test_clock_times_as_one_number_are_not_seconds(tmp_path, step_s, begin_s):
    """090000.5 for half a second after nine: each minute would begin 40 s late, each hour over an hour."""
    table = people(number=24, rows=round(30 / step_s), step_s=step_s)
    table[:, 1] = np.round(20 * table[:, 0] + begin_s + table[:, 1], 3)
    seconds = findings(write(tmp_path / "s.csv", table, moving=False), form(PLACES))
    assert "clock_digits" not in [one.check for one in seconds]
    hours, minutes, seconds = table[:, 1] // 3600, table[:, 1] % 3600 // 60, table[:, 1] % 60
    table[:, 1] = 10_000 * hours + 100 * minutes + seconds
    path = write(tmp_path / "a.csv", table, moving=False)
    with pytest.raises(DataError, match=r"clock_digits: .*of a clock, 09:00:00.*`units: \{time: iso\}`"):
        modlhmp.read_tracks(path, columns=PLACES)
    with pytest.raises(DataError, match="hours, minutes and seconds of a clock, written as one number"):
        inspect_file(path)


def test_a_recorder_that_paused_once_has_no_clock_times(tmp_path):
    table = people(number=12, rows=60)
    table[table[:, 1] >= 45, 1] += 40
    assert "clock_digits" not in [one.check for one in findings(write(tmp_path / "a.csv", table), form())]


@pytest.mark.parametrize(("apart_s", "said"), [(7, "`time_step_s: 7`"), (61, "every 60 s"), (128, "every 60 s")])
def test_rows_too_far_apart_get_an_answer_that_can_be_given(tmp_path, apart_s, said):
    """As a warning where gaps may be longer, and where no track is left."""
    path = write(tmp_path / "a.csv", people(step_s=apart_s), moving=False)
    (found,) = (one for one in findings(path, form(PLACES)) if one.check == "time_step")
    assert said in found.remedy
    with pytest.raises(DataError, match=rf"cleaning left no track.* {apart_s} s apart.*{said}"):
        modlhmp.read_tracks(path, columns=PLACES, accept=["walking_speed"])


def test_ids_that_jump(tmp_path):
    table = people(number=20)
    swapped = table.copy()
    for first in range(0, 18, 2):  # pairs of people change their ids every five rows
        for row in range(0, 20, 10):
            a, b = (slice(20 * person + row, 20 * person + row + 5) for person in (first, first + 1))
            swapped[a, 2:4], swapped[b, 2:4] = table[b, 2:4] + 40, table[a, 2:4] - 40
    found = findings(write(tmp_path / "a.csv", swapped, moving=False), form(PLACES))
    assert "jumps" in [one.check for one in found]


def test_several_people_under_one_id(tmp_path):
    table = people()
    table[:, 0] //= 4
    table[:, 1] %= 20
    found = findings(write(tmp_path / "a.csv", table, moving=False), form(PLACES))
    assert "repeated_rows" in [one.check for one in found]


def glued(tmp_path, columns, between="", by_time=True, later_s=0.0, others=0):
    """Two recordings of the same ids, the second of other people, one after the other in one file."""
    lines = []
    for seed in (3, 4):
        table = people(seed=seed)
        table[:, 0] += others * (seed == 4)
        table[:, 1] += later_s * (seed == 4)
        if by_time:
            table = table[np.argsort(table[:, 1], kind="stable")]
        header, *rows = write(tmp_path / "one.csv", table, moving=columns is MOVING).read_text().splitlines()
        lines += [*([header] if seed == 3 else [between.format(header)] if between else []), *rows]
    path = tmp_path / "glued.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("columns", [PLACES, MOVING])
@pytest.mark.parametrize(
    ("between", "by_time", "others", "told"),
    [
        (
            "{}",
            True,
            0,
            ["the header stands again in the middle (1 times, first: row 242: 'id,t,x,y", "240 rows with the id"],
        ),
        ("\ufeff{}", False, 0, ["the header stands again"]),
        ("{}", True, 100, ["the header stands again"]),  # nobody is lost, but two recordings are one
        ("", True, 0, ["times start anew in the middle (1 times)", "240 rows with the id and time of an earlier one"]),
    ],
)
def test_files_put_one_after_the_other_are_warned_of(tmp_path, caplog, columns, between, by_time, others, told):
    path, described = glued(tmp_path, columns, between, by_time, others=others), form(columns)
    with caplog.at_level(logging.WARNING, logger="modlhmp"):
        _, account = clean_recording(path, described, Recording(day=""))
    (message,) = [one for one in account["warnings"] if one.startswith("glued_files")]
    assert [part for part in told if part not in message] == []
    assert "Give each by itself" in message
    assert f"WARNING: {path}: {message}" in caplog.text
    assert not [one for one in account["warnings"] if one.startswith("repeated_rows")]
    with pytest.raises(DataError, match="glued_files"):
        clean_recording(path, form(columns, strict=True), Recording(day=""))
    assert account["rows"]["dropped"].get("header_again", 0) == (1 if between else 0)


@pytest.mark.parametrize("columns", [PLACES, MOVING])
@pytest.mark.parametrize("keys", [{"later_s": 3600}, {"others": 100}, {"by_time": False, "others": 100}])
def test_files_that_go_on_or_are_sorted_by_people_are_not(tmp_path, columns, keys):
    path = glued(tmp_path, columns, **keys)
    assert "glued_files" not in [one.check for one in findings(path, form(columns))]


def test_a_few_rows_twice_in_a_file_by_people_are_no_second_file(tmp_path):
    table = people()
    path = write(tmp_path / "a.csv", np.concatenate([table[:5], table]), moving=False)
    assert findings(path, form(PLACES)) == []


def test_times_that_start_anew_are_found_whatever_the_blocks():
    rng = np.random.default_rng(0)
    first, second = (np.sort(rng.uniform(0, 600, 300)) + rng.uniform(-0.2, 0.2, 300) for _ in range(2))
    for cuts in ([], [100], [299], [300], [301], [5, 300, 450]):
        account = Account()
        for part in np.split(np.concatenate([first, second, [700.0, 650.0]]), cuts):
            account.note_order(rng.integers(0, 9, len(part)), part)
        assert account.starts_anew == 1
        assert account.notes["rows_out_of_time_order"] > 290


@pytest.mark.parametrize("length", ["m", "cm"])
@pytest.mark.parametrize("values", [(0, 0), (-1, -1), (20, 15), (-999, -999)])
@pytest.mark.parametrize("runs", [1, 4])
def test_a_place_that_stands_for_not_seen(tmp_path, values, runs, length):
    """Also one in the middle of the place, where nobody would be cut for going there and back."""
    table = people(number=30, standing=0)
    if values == (20, 15):  # where some people walk
        table[:, 2:4] += [8, 6]
    unseen = np.repeat(np.random.default_rng(1).random(len(table) // runs + 1) < 0.1, runs)[: len(table)]
    metres = {"m": 1.0, "cm": 0.01}[length]
    table[unseen, 2:4] = np.multiply(values, metres)
    described = form(PLACES, units={"length": length})
    found = findings(write(tmp_path / "a.csv", table, length=length, moving=False), described)
    (told,) = [one for one in found if one.check in ("not_measured", "jumps")]
    assert (told.check, told.severity) == ("not_measured", "stop")
    assert f"`missing: {{x: {values[0]}, y: {values[1]}}}`" in told.remedy
    named = form(PLACES, units={"length": length}, missing={"x": values[0], "y": values[1]})
    assert findings(tmp_path / "a.csv", named) == []


def test_places_where_many_people_are_stand_for_nothing(tmp_path):
    table = people(number=40)
    rows = np.arange(len(table)) % 20
    at_door = table.copy()
    at_door[rows < 2, 2:4] = [20.0, 15.0]  # where everybody comes in, and is seen twice
    coarse = table.copy()
    coarse[:, 2:4] = np.round(coarse[:, 2:4])
    for number, one in enumerate((at_door, coarse)):
        found = findings(write(tmp_path / f"{number}.csv", one, moving=False), form(PLACES))
        assert "not_measured" not in [told.check for told in found]


def test_a_place_far_away_that_stands_for_not_seen(tmp_path):
    table = people(number=30)
    table[np.random.default_rng(1).random(len(table)) < 0.1, 2:4] = 9999
    (told,) = findings(write(tmp_path / "a.csv", table, moving=False), form(PLACES))
    assert told.check == "absurd_rows"
    assert "`missing`" in told.remedy


def test_longitude_and_latitude(tmp_path):
    table = people()
    table[:, 2] = 11.5 + table[:, 2] / 75_000
    table[:, 3] = 48.1 + table[:, 3] / 111_000
    path = tmp_path / "a.csv"
    np.savetxt(path, table[:, :4], ["%d", "%.3f", "%.9f", "%.9f"], ",", header="id,t,x,y", comments="")
    (found,) = [one for one in findings(path, form(PLACES)) if one.check == "walking_speed"]
    assert "longitude" in found.remedy


def test_rows_of_other_days_are_answered_with_the_unit_of_time(tmp_path):
    table = people()
    table[:, 1] += 1_772_438_400
    for time, declared, remedy in (("ms", "s", "units: {time: ms}"), ("s", "ms", "units: {time: s}")):
        path = write(tmp_path / f"{time}.csv", table, time=time, moving=False)
        with pytest.raises(DataError) as error:
            modlhmp.read_tracks(path, columns=PLACES, units={"time": declared}, day="2026-03-02")
        assert remedy in str(error.value)
    path = write(tmp_path / "relative.csv", moving=False)
    with pytest.raises(DataError, match="start"):
        modlhmp.read_tracks(path, columns=PLACES, day="2026-03-02")


def test_every_check_is_described_once():
    assert [one.name for one in CHECKS] == list(get_args(CheckName))
    assert all(one.compares and one.remedy and one.severity for one in CHECKS)


def test_an_account_without_rows_has_nothing_to_check():
    assert check_recording(modlhmp.Tracks(*(np.empty(0) for _ in range(6))), Account(), form()) == []


def test_a_flat_axis_is_asked_about(tmp_path):
    """The height of a three-dimensional export instead of its second direction."""
    rows = [(p, n, 1.2 * n + p, 0.0 if n % 2 else 0.01) for p in range(8) for n in range(20)]
    path = tmp_path / "flat.csv"
    path.write_text("id,t,x,y\n" + "".join(f"{p},{t},{x},{y}\n" for p, t, x, y in rows))
    form = FileFormat(columns=Columns(track_id="id", t="t", x="x", y="y"), header=True)
    found = {one.check: one for one in check_recording(*read_recording(path, form), form)}
    assert "all y are within 0.01 m" in found["extent"].text
    assert found["extent"].severity == "warn"


@pytest.mark.parametrize(("days", "told"), [(1, True), (2, False)])
def test_a_night_without_its_second_day_is_asked_about(tmp_path, days, told):
    rows = [(p, 600 * p + n, 1.2 * n, float(p % 5)) for p in range(18) for n in range(20)]  # three hours
    path = tmp_path / "night.csv"
    path.write_text("id,t,x,y\n" + "".join(f"{p},{t},{x},{y}\n" for p, t, x, y in rows))
    form = FileFormat(columns=Columns(track_id="id", t="t", x="x", y="y"), header=True)
    found = check_recording(*read_recording(path, form, "2030-01-01", "22:30", days), form)
    assert ("outside_day" in [one.check for one in found]) == told
    assert not told or "`days: 2`" in next(one.remedy for one in found if one.check == "outside_day")
