"""Small recordings of the kinds that strangers bring (tests/cases): read as meant, or refused with a remedy."""

from pathlib import Path

import numpy as np
import pytest

import modlhmp
from modlhmp.ids import id_of
from modlhmp.storage import DataError

CASES = Path(__file__).parents[1] / "cases"
PLAIN = {"track_id": "id", "t": "t", "x": "x", "y": "y"}
MOVING = {**PLAIN, "speed": "v", "heading": "th"}
PLACES = {"track_id": 1, "t": 0, "x": 2, "y": 3}
VISWALK = {"track_id": "NO", "t": "$PEDESTRIAN:SIMSEC", "x": "COORDCENTX", "y": "COORDCENTY"}


def read(name, columns=None, **form):
    return modlhmp.read_tracks(CASES / name, columns=columns or PLAIN, **form)


@pytest.mark.parametrize(
    ("name", "ids", "form"),
    [
        ("01-underscore-ids/n-dates.csv", ["2026_03_02", "20_260_302"], {}),
        ("01-underscore-ids/n-plus.csv", ["7", "007"], {}),
        ("06-eth-obsmat/tabs.txt", ["1.0", "2.0"],
         {"columns": PLACES, "separator": "\t", "units": {"time": "frame"}, "frame_rate": 15}),
        ("06-eth-obsmat/tabs.txt", ["1.0", "2.0"],
         {"columns": PLACES, "reader": "text", "units": {"time": "frame"}, "frame_rate": 15}),
        ("07-decimal-comma/data.csv", ["1", "2"], {"separator": ";", "decimal": ","}),
        ("08-iso-time/data.csv", ["1", "2"], {"units": {"time": "iso"}}),
        ("09-nanoseconds/data.csv", ["1", "2"], {"units": {"time": "ns"}}),
        ("13-bom-crlf/data.csv", ["1", "2"], {"separator": ";"}),
        ("13-bom-crlf/cr-only.csv", ["1", "2"], {}),
        ("14-big-ids/data.csv", ["5", "20121024093000124", "20121024093000125"], {}),
        ("15-time-order/data.csv", ["1", "2"], {}),
        ("16-slow-recorder/data.csv", ["1", "2"], {"time_step_s": 10}),
        ("16-slow-recorder/six.csv", ["1", "2"], {"time_step_s": 6}),
        ("17-viswalk-preamble/data.pp", ["1", "2"], {"separator": ";", "skip_lines": 4, "columns": VISWALK}),
        ("18-pixels/data.csv", ["1", "2"],
         {"columns": {**PLAIN, "t": "frame"}, "units": {"time": "frame", "length": "px"}, "frame_rate": 12,
          "scale": 0.025}),
        ("20-dst/autumn-unix.csv", ["1", "2", "3"], {"day": "2026-10-25", "timezone": "Europe/Berlin"}),
    ],
)  # fmt: skip
def test_people_are_kept_apart_and_walk_as_people_do(name, ids, form):
    tracks = read(name, **form)
    assert set(tracks.track_id.tolist()) == {id_of(text) for text in ids}
    speed = tracks.speed[np.isfinite(tracks.speed)]
    assert 0.3 < np.median(speed) < 2.0


def test_text_ids():
    assert set(read("10-text-ids/data.csv").track_id.tolist()) <= {
        id_of(text) for text in ("ped_01", "ped_02", "P01", "Helmet_1", "Helmet_2")
    }


def test_a_jump_cuts_a_track():
    tracks = read("02-id-switch/data.csv")
    assert {id_of("1"), id_of("1", 2)} < set(tracks.track_id.tolist())
    assert np.nanmax(tracks.speed) < 2


def test_an_id_that_comes_again_after_long_is_somebody_else():
    tracks = read("11-id-reused/data.csv")
    assert set(tracks.track_id.tolist()) == {id_of("7"), id_of("8"), id_of("7", 2)}
    same = np.diff(tracks.track_id) == 0
    assert np.diff(tracks.t)[same].max() <= 5


@pytest.mark.parametrize("name", ["empty.csv", "short-stop.csv"])
def test_who_stands_needs_no_heading(name):
    tracks = read(f"03-standing-nan-heading/{name}", MOVING)
    assert set(tracks.track_id.tolist()) == {1}
    assert (np.diff(tracks.t) == 1).all()
    standing = tracks.speed < 0.05
    assert standing.any()
    assert np.isnan(tracks.heading[standing]).all()
    assert np.isfinite(tracks.heading[~standing]).all()


@pytest.mark.parametrize(
    ("name", "form", "remedy"),
    [
        ("05-juelich-txt/data.txt", {"columns": {"track_id": 0, "t": 1, "x": 2, "y": 3}}, "use `reader: text`"),
        ("06-eth-obsmat/tabs.txt", {"columns": PLACES}, "set `separator: '\\\\t'`"),
        ("07-decimal-comma/data.csv", {"separator": ";"}, 'set `decimal: ","`'),
        ("07-decimal-comma/data.csv", {}, "set `separator: ';'`"),
        ("08-iso-time/data.csv", {}, "set `units: {time: iso}`"),
        ("16-slow-recorder/data.csv", {}, "set `time_step_s: 10`"),
        ("16-slow-recorder/six.csv", {}, "set `time_step_s: 6`"),
        ("17-viswalk-preamble/data.pp", {"separator": ";", "columns": PLACES}, "set `skip_lines: 4`"),
        ("19-ndjson/data.ndjson", {}, "use `reader: trajnet`"),
        ("20-dst/spring-relative.csv", {"day": "2026-03-29", "start": "02:30", "timezone": "Europe/Berlin"},
         "does not exist, as clocks were put forward: write it with its offset from UTC"),
    ],
)  # fmt: skip
def test_a_wrong_declaration_is_answered_with_the_option(name, form, remedy):
    with pytest.raises(DataError) as error:
        read(name, **form)
    assert remedy.replace("\\\\", "\\") in str(error.value)
    assert len(str(error.value)) < 600


def test_json_lines_of_trajnet():
    tracks = modlhmp.read_tracks(CASES / "19-ndjson/data.ndjson", reader="trajnet", frame_rate=10)
    assert set(tracks.track_id.tolist()) == {1, 2}
    assert np.nanmedian(tracks.speed) == pytest.approx(1.2)
