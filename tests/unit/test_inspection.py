"""`modlhmp inspect`: what it guesses of a file, the draft that it prints, and what it says of a dataset."""

import html.parser
import json
import shutil
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from planted import MOVING, PLACES, people, write
from typer.testing import CliRunner

from modlhmp.cleaning import clean_recording
from modlhmp.cli import app
from modlhmp.datasets import load_dataset
from modlhmp.inspection import inspect_dataset, inspect_file
from modlhmp.inspection.guess import guess
from modlhmp.inspection.page import page
from modlhmp.inspection.picture import text_map
from modlhmp.storage import DataError
from modlhmp.study.demo import write_recording
from modlhmp.tracks import empty_tracks

CASES = Path(__file__).parents[1] / "cases"
NUMBERED = {"track_id": 1, "t": 0, "x": 2, "y": 3}


def draft_of(path, folder):
    """The draft for a file, written as a dataset file; its keys, and the dataset as loaded."""
    found = inspect_file(path, folder)
    dataset = folder / "drafted.yaml"
    dataset.write_text(found.draft, encoding="utf-8")
    return yaml.safe_load(found.draft), load_dataset(dataset, folder)


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize(
    ("written", "units"),
    [
        ({}, {}),
        ({"length": "cm", "speed": "cm/s"}, {"length": "cm"}),
        ({"length": "mm", "speed": "m/s"}, {"length": "mm", "speed": "m/s"}),
        ({"time": "ms"}, {"time": "ms"}),
        ({"speed": "km/h", "angle": "deg"}, {"speed": "km/h", "angle": "deg"}),
        ({"heading": "compass", "angle": "deg"}, {"heading": "compass", "angle": "deg"}),
        ({"heading": "from_x_clockwise"}, {"heading": "from_x_clockwise"}),
    ],
)
def test_a_draft_reads_what_was_written(tmp_path, written, units, moving):
    truth = people(number=30, rows=20)
    path = write(tmp_path / "monday.csv", truth, moving=moving, **written)
    keys, dataset = draft_of(path, tmp_path)
    if not moving:
        units = {name: unit for name, unit in units.items() if name in ("length", "time")}
    assert keys.get("units", {}) == units
    assert keys["columns"] == (MOVING if moving else PLACES)
    assert keys["velocity"] == ("as_recorded" if moving else "differences")
    rows = sum(len(clean_recording(one.path, dataset, one)[0].t) for one in dataset.recordings)
    assert rows == len(truth)
    for one in dataset.recordings:
        tracks, account = clean_recording(one.path, dataset, one)
        assert "warnings" not in account
        assert np.nanmedian(tracks.speed) == pytest.approx(1.3, abs=0.3)


def test_positions_that_were_not_seen_may_be_words(tmp_path):
    """Two of three rows, as R writes a table in which everyone has a row at every time."""
    truth, drafts = people(number=30, rows=20), []
    for word in ("", "NA", "null"):
        rows = [f"{p:.0f},{t:.2f},{x:.3f},{y:.3f}" for p, t, x, y, _, _ in truth]
        rows += [f"{p:.0f},{t + later:.2f},{word},{word}" for later in (500, 900) for p, t, *_ in truth]
        path = tmp_path / "monday.csv"
        path.write_text("id,t,x,y\n" + "\n".join(rows))
        drafts.append(draft_of(path, tmp_path)[0])
    assert drafts[0]["columns"] == PLACES
    assert drafts[1] == drafts[2] == drafts[0]


def test_columns_are_found_without_a_header_in_any_order(tmp_path):
    person, t, x, y, v, h = people(number=30).T
    order = np.argsort(t, kind="stable")
    height = np.random.default_rng(1).normal(1.7, 0.1, len(t))
    table = np.column_stack([t, person + 100, x, y, height, v, h])[order]
    np.savetxt(tmp_path / "a.txt", table, "%.4f", "\t")
    found = guess(tmp_path / "a.txt")
    assert found.keys["columns"] == {**NUMBERED, "speed": 5, "heading": 6}
    np.savetxt(tmp_path / "b.txt", np.column_stack([person, np.round(25 * t), x, y]), ["%d", "%d", "%.3f", "%.3f"])
    found = guess(tmp_path / "b.txt")
    assert found.keys["reader"] == "text"
    assert found.keys["columns"] == {"track_id": 0, "t": 1, "x": 2, "y": 3}
    assert found.keys["units"] == {"time": "frame"}
    assert found.keys["frame_rate"] == 25
    assert "frame_rate" in found.asks


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("01-underscore-ids/n-dates.csv", {"columns": PLACES, "header": True}),
        ("03-standing-nan-heading/empty.csv", {"columns": MOVING}),
        ("04-degrees-as-radians/data.csv", {"columns": MOVING, "units": {"angle": "deg"}}),
        ("05-juelich-txt/data.txt", {"reader": "text", "frame_rate": 10.0, "units": {"time": "frame"},
                                     "columns": {"track_id": 0, "t": 1, "x": 2, "y": 3}}),
        ("05-juelich-txt/comments-inside.csv", {"comment": "#", "columns": PLACES}),
        ("06-eth-obsmat/tabs.txt", {"separator": "\t", "columns": NUMBERED, "units": {"time": "frame"}}),
        ("07-decimal-comma/data.csv", {"separator": ";", "decimal": ",", "columns": PLACES}),
        ("08-iso-time/data.csv", {"units": {"time": "iso"}}),
        ("09-nanoseconds/data.csv", {"units": {"time": "ns"}}),
        ("10-text-ids/data.csv", {"columns": PLACES}),
        ("13-bom-crlf/data.csv", {"separator": ";", "header": True, "columns": PLACES}),
        ("13-bom-crlf/cr-only.csv", {"columns": PLACES}),
        ("14-big-ids/data.csv", {"columns": PLACES}),
        ("15-time-order/data.csv", {"columns": PLACES}),
        ("17-viswalk-preamble/data.pp", {"separator": ";", "skip_lines": 4, "header": True, "columns": {
            "track_id": "NO", "t": "$PEDESTRIAN:SIMSEC", "x": "COORDCENTX", "y": "COORDCENTY"}}),
        ("18-pixels/data.csv", {"units": {"time": "frame", "length": "px"}, "columns": {**PLACES, "t": "frame"}}),
        ("19-ndjson/data.ndjson", {"reader": "trajnet", "frame_rate": 10.0}),
    ],
)  # fmt: skip
def test_what_strangers_bring_is_guessed(name, expected):
    keys = guess(CASES / name).keys
    assert {key: keys.get(key) for key in expected} == expected


@pytest.mark.parametrize("name", ["16-slow-recorder/data.csv", "16-slow-recorder/six.csv", "20-dst/autumn-unix.csv",
                                  "11-id-reused/data.csv", "02-id-switch/data.csv"])  # fmt: skip
def test_a_draft_of_a_small_file_is_one_that_loads(tmp_path, name):
    path = shutil.copy(CASES / name, tmp_path / "a.csv")
    keys, _ = draft_of(path, tmp_path)
    step = {"16-slow-recorder/data.csv": 10, "16-slow-recorder/six.csv": 6}.get(name)
    assert keys.get("time_step_s") == step


def simulated(path, away):
    """A simulator's database of people so far from the origin (x, y)."""
    person, t, x, y = people(number=30).T[:4]
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE trajectory_data (frame INTEGER, id INTEGER, pos_x REAL, pos_y REAL)")
        file.execute("CREATE TABLE metadata (key TEXT, value TEXT)")
        file.execute("INSERT INTO metadata VALUES ('fps', '10')")
        columns = (10 * t).astype(int), person.astype(int), x + away[0], y + away[1]
        file.executemany(
            "INSERT INTO trajectory_data VALUES (?, ?, ?, ?)", zip(*(one.tolist() for one in columns), strict=True)
        )
    file.close()
    return path


def test_a_simulator_s_database(tmp_path):
    keys, dataset = draft_of(simulated(tmp_path / "run.sqlite", (0, 0)), tmp_path)
    assert keys["reader"] == "jupedsim"
    assert keys["clock"] == "unknown"
    assert "origin_m" not in keys
    assert sum(len(clean_recording(one.path, dataset, one)[0].t) for one in dataset.recordings) == 600


@pytest.mark.parametrize("kind", ["sqlite", "h5", "ndjson", "ndjson without fps"])
def test_a_national_grid_gets_a_local_origin_in_known_forms(tmp_path, kind):
    path = tmp_path / f"run.{kind.split()[0]}"
    person, t, x, y = people(number=30).T[:4]
    x, y = x + 512_345, y + 6_570_123
    if kind == "sqlite":
        simulated(path, (512_345, 6_570_123))
    elif kind == "h5":
        h5py = pytest.importorskip("h5py")
        rows = np.rec.fromarrays([person.astype(int), (10 * t).astype(int), x, y], names="id,frame,x,y")
        with h5py.File(path, "w") as file:
            file.create_dataset("trajectory", data=rows).attrs["fps"] = 10.0
    else:
        fps = {} if "without" in kind else {"fps": 1.0}  # of rows, every 10 frames
        lines = [{"scene": {"id": 0, "p": 0, "s": 0, "e": 190, **fps}}]
        lines += [{"track": {"f": round(10 * f), "p": int(p), "x": e, "y": n}}
                  for p, f, e, n in zip(person, t, x, y, strict=True)]  # fmt: skip
        path.write_text("\n".join(map(json.dumps, lines)) + "\n")
    found = inspect_file(path, tmp_path)
    keys, dataset = draft_of(path, tmp_path)
    assert np.abs(np.subtract(keys["origin_m"], (512_345, 6_570_123))).max() <= 100
    assert "origin_m" in next(line for line in found.draft.splitlines() if "whole metres" in line)
    assert sum(len(clean_recording(one.path, dataset, one)[0].t) for one in dataset.recordings) > 500


@pytest.mark.parametrize(("site", "reader"), [("hall", "delimited"), ("forum", "edinburgh")])
def test_the_demo_s_raw_files(tmp_path, site, reader):
    path = tmp_path / "day.txt"
    write_recording(path, site, "2030-10-02", seed=1, scale=0.1)
    keys, dataset = draft_of(path, tmp_path)
    assert keys["reader"] == reader
    (tmp_path / "mac.txt").write_bytes(path.read_bytes().replace(b"\n", b"\r"))
    assert guess(tmp_path / "mac.txt").keys == guess(path).keys
    if site == "hall":
        assert keys["columns"] == {**NUMBERED, "speed": 5, "heading": 6}
        assert keys["units"] == {"length": "mm"}
        assert str(keys["recordings"][0]["day"]).startswith("2030-10-0")
    for one in dataset.recordings:
        clean_recording(one.path, dataset, one)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "the file is empty"),
        (b"PAR1\0\0", "Parquet"),
        (b"PK\x03\x04....", "a zip archive or a workbook"),
        ("t,id,x,y\n0,1,2,3\n".encode("utf-16"), "UTF-16"),
        (b"Dear Sir or Madam,\n\nplease find enclosed\n", "holds no table"),
        (b"a,b,c,d\n" + b"1,2,3,4\n5,1,8,2\n" * 20, "no choice of id, time, x and y"),
        (b"\0" * 100, "not text"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(tmp_path, content, told):
    path = tmp_path / "odd.csv"
    path.write_bytes(content)
    with pytest.raises(DataError) as error:
        inspect_file(path)
    assert told in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def dataset_file(folder, **keys):
    listed = {
        "title": "Here", "reader": "delimited", "timezone": "UTC", "header": True, "columns": PLACES, "horizon_s": 10,
        "velocity": "differences", "citation": "none", "terms": "none",
        "recordings": [{"files": "a.csv", "day": "2026-03-02", "start": "09:00", "split": "train"},
                       {"files": "b.csv", "day": "2026-03-03", "start": "09:00", "split": "test"}],
        **keys,
    }  # fmt: skip
    path = folder / "here.yaml"
    path.write_text(yaml.safe_dump(listed), encoding="utf-8")
    return path


def recordings(folder, **form):
    write(folder / "a.csv", people(number=200), moving=False, **form)
    write(folder / "b.csv", people(number=60, seed=4), moving=False, **form)


def test_a_good_dataset(tmp_path):
    recordings(tmp_path)
    found = inspect_dataset(dataset_file(tmp_path), tmp_path)
    assert not found.findings
    assert not found.stops
    told = found.summary()
    for text in ("200 to train on, 60 to test on", "Nothing looks wrong", "a run takes", "clock hours 9", "m/s"):
        assert text in told


def test_a_dataset_in_a_wrong_unit_names_every_recording(tmp_path):
    recordings(tmp_path, length="cm")
    found = inspect_dataset(dataset_file(tmp_path), tmp_path)
    assert found.stops
    assert {of for of, one in found.findings if one.check == "walking_speed"} == {"a", "b"}
    assert "units: {length: cm}" in found.summary()
    accepted = inspect_dataset(dataset_file(tmp_path, accept=["walking_speed", "untrained_place"]), tmp_path)
    assert not accepted.stops
    assert "(accepted)" in accepted.summary()


def test_the_same_walks_in_both_splits(tmp_path):
    write(tmp_path / "a.csv", people(number=60), moving=False)
    renamed = people(number=60)
    renamed[:, 0] += 1000
    write(tmp_path / "b.csv", renamed, moving=False)
    found = inspect_dataset(dataset_file(tmp_path), tmp_path)
    assert [one.check for _, one in found.findings] == ["shared_people"]


def run(*arguments):
    return CliRunner().invoke(app, ["inspect", *map(str, arguments)])


def test_the_command_prints_a_draft_and_writes_a_picture_and_a_page(tmp_path):
    path = write(tmp_path / "monday.csv", people(number=30), moving=False)
    result = run(path, "--to", tmp_path, "--data-root", tmp_path)
    assert result.exit_code == 0
    assert yaml.safe_load(result.stdout)["recordings"][0]["files"] == "monday.csv"
    assert "walking speed" in result.stderr
    assert (tmp_path / "monday.inspect.png").read_bytes().startswith(b"\x89PNG")
    text = (tmp_path / "monday.inspect.html").read_text(encoding="utf-8")
    assert "data:image/png;base64," in text
    assert "http" not in text
    assert "split: {by:" in text


def test_the_command_s_status_says_whether_a_run_would_stop(tmp_path):
    recordings(tmp_path)
    assert run(dataset_file(tmp_path), "--to", tmp_path, "--data-root", tmp_path).exit_code == 0
    recordings(tmp_path, length="cm")
    assert run(dataset_file(tmp_path), "--to", tmp_path, "--data-root", tmp_path).exit_code == 1
    (tmp_path / "a.csv").unlink()
    result = run(dataset_file(tmp_path), "--to", tmp_path, "--data-root", tmp_path)
    assert isinstance(result.exception, DataError)
    assert "--data-root" in str(result.exception)


def test_without_matplotlib_there_is_a_page_all_the_same(tmp_path, monkeypatch):
    for module in ("matplotlib", "matplotlib.figure", "matplotlib.collections"):
        monkeypatch.setitem(sys.modules, module, None)
    path = write(tmp_path / "monday.csv", people(number=30), moving=False)
    result = run(path, "--to", tmp_path)
    assert result.exit_code == 0
    assert "pip install 'modlhmp[study]'" in result.stderr
    assert not (tmp_path / "monday.inspect.png").exists()
    assert (tmp_path / "monday.inspect.html").exists()


def test_the_page_shows_text_as_text():
    made = page("<b>&", [("<i>", [("<script>", "a<b")])], [("warn", "<u>", "1 < 2 & 3")], None, "<draft>")
    seen = []

    class Reader(html.parser.HTMLParser):
        def handle_starttag(self, tag, attrs):
            seen.append(tag)

    Reader().feed(made)
    assert not {"script", "i", "u", "draft"} & set(seen)


def test_a_narrow_place_leaves_no_empty_half(tmp_path):
    """Columns of the picture that are white, beside the corridor's panel."""
    plt = pytest.importorskip("matplotlib.pyplot")
    path = tmp_path / "a.csv"
    steps = "".join(f"{p},{t},{0.1 * p:.1f},{1.3 * t + p:.1f}\n" for p in range(20) for t in range(20))
    path.write_text("id,t,x,y\n" + steps)
    picture, _ = inspect_file(path, tmp_path).write(tmp_path, "a")
    dark = (plt.imread(picture)[..., :3] < 0.9).any(axis=(0, 2))
    assert np.argmax(dark) < 0.05 * len(dark)
    assert np.argmax(dark[::-1]) < 0.05 * len(dark)


def test_nobody_is_drawn_as_nothing():
    assert text_map(empty_tracks()) == ""


@pytest.mark.parametrize(
    "time", ["03/02/2026 08:00:{n:02d}", "02.03.2026 08:00:{n:02d}", "08:00:{n:02d}.200", "8:00 AM CET {n}"]
)
def test_times_that_are_none_of_ours_are_shown(tmp_path, time):
    path = tmp_path / "a.csv"
    rows = [f"p{p},{time.format(n=n)},{1.2 * n},{p}" for n in range(20) for p in range(5)]
    path.write_text("id,time,x,y\n" + "\n".join(rows) + "\n")
    with pytest.raises(DataError, match=r"2026-03-02T09:00:00|no choice of id, time, x and y"):
        inspect_file(path)


def heading_of(found, text):
    """The one table whose heading holds a text, as a dict."""
    (rows,) = [rows for heading, rows in found.tables if text in heading]
    return dict(rows)


@pytest.mark.parametrize("by", ["time", "person"])
def test_a_file_that_holds_both_splits_is_told_once(tmp_path, by):
    """Of 60 people who come 3 s apart and stay 19 s, those who are there at a moment are on neither side."""
    write(tmp_path / "a.csv", people(number=60, standing=0), moving=False)
    listed = [{"files": "a.csv", "split": {"by": by, "test": 0.5}}]
    found = inspect_dataset(dataset_file(tmp_path, recordings=listed, clock="unknown"), tmp_path)
    headings = [heading for heading, _ in found.tables]
    assert len(headings) == 2
    told = heading_of(found, "a (divided")
    assert sum("walking speed" in name for name in told) == 1
    counts = {side: int(told[side].split()[0]) for side in ("train, once clean", "test, once clean")}
    if by == "time":
        assert told["on neither side"].endswith(f" {60 - sum(counts.values())}")
        assert 60 - sum(counts.values()) in (6, 7)
    else:
        assert sum(counts.values()) == 60
        assert "on neither side" not in told


def test_ids_that_are_on_both_sides_of_a_time_are_counted(tmp_path):
    """Like helmets, which others wear later: seven ids come again after a long pause."""
    table = people(number=40, standing=0)
    table[:, 0] %= 7
    again = table.copy()
    again[:, 1] += 1000
    write(tmp_path / "a.csv", np.concatenate([table, again]), moving=False)
    listed = [{"files": "a.csv", "split": {"by": "time", "test": 0.5}}]
    path = dataset_file(tmp_path, recordings=listed, clock="unknown", accept=["repeated_rows"])
    told = heading_of(inspect_dataset(path, tmp_path), "a (divided")
    assert told["ids on both sides"].startswith("7,")


def test_forecasts_are_counted_by_horizon_and_hours_without_maps_named(tmp_path):
    recordings(tmp_path)
    entries = [{"files": "a.csv", "day": "2026-03-02", "start": "09:00", "split": "train"},
               {"files": "b.csv", "day": "2026-03-03", "start": "11:00", "split": "test"}]  # fmt: skip
    found = inspect_dataset(dataset_file(tmp_path, recordings=entries, horizon_s=30, hours=[9, 12]), tmp_path)
    told = heading_of(found, "The dataset")
    assert told["forecasts by horizon"] == "5 s: 60, 10 s: 60, 20 s: 0, 30 s: 0"
    assert told["hours"] == "trained in 9; tested in 11, without a map of their own in 11"
    assert {one.check for _, one in found.findings} >= {"horizon", "hours"}
    assert not found.stops


def test_a_side_of_a_split_with_nobody_is_what_stops_a_run(tmp_path):
    rows = [f"{p},{n},{1.2 * n},{p}" for p in range(6) for n in range(30)]
    (tmp_path / "a.csv").write_text("id,t,x,y\n" + "\n".join(rows) + "\n")
    (tmp_path / "d.yaml").write_text(
        "title: T\nreader: delimited\nheader: true\ncolumns: {track_id: id, t: t, x: x, y: y}\ntimezone: UTC\n"
        "clock: unknown\nrecordings:\n  - {files: a.csv, split: {by: time, test: 0.25}}\nhorizon_s: 10\n"
        "velocity: differences\ncitation: c\nterms: t\n"
    )
    found = inspect_dataset(tmp_path / "d.yaml", tmp_path)
    assert found.stops
    assert "Nothing looks wrong" not in found.summary()
    assert "nobody is left for this side of `split`" in found.summary()
