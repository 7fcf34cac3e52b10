"""Wrong units, rates and angles planted in real recordings and the demo's are noticed; as they are, they pass."""

import os
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from planted import MOVING, PLACES, write

from modlhmp.cleaning import clean_recording
from modlhmp.file_format import FileFormat, Recording
from modlhmp.motion import moves
from modlhmp.plausibility import check_recording
from modlhmp.readers import read_recording
from modlhmp.settings import check
from modlhmp.storage import DataError
from modlhmp.study.demo import write_recording

DATA = Path(os.environ.get("MODLHMP_DATA", "/nowhere"))
FRAMES = {"units": {"time": "frame"}}
SIX = {"t": 0, "track_id": 1, "x": 2, "y": 3, "speed": 4, "heading": 5}
GOOD = {  # files, clock, form
    "atc": ("atc/atc-20121024-1hz-*.csv", True, {"reader": "atc_1hz"}),
    "atc raw": ("atc/atc-20121024-raw-*.csv", True, {"reader": "atc"}),
    "edinburgh": ("edinburgh/days/*.csv", False,
                  {"reader": "edinburgh_rows", "frame_rate": 9.0, "row_stride": 4, "scale": 0.0247}),
    "edinburgh raw": ("edinburgh/raw/*.txt", False, {"reader": "edinburgh", "frame_rate": 9.0, "scale": 0.0247}),
    "hotel": ("eth_ucy/biwi_hotel.txt", False,
              {"reader": "text", "columns": {"t": 0, "track_id": 1, "x": 2, "y": 3}, **FRAMES, "frame_rate": 25.0}),
    "thor": ("thor1/exp-1-run-2.csv", False, {"columns": SIX}),
    "magni": ("magni/condition-A.csv", False,
              {"header": True, "columns": {"t": "Time", "track_id": "ag_id", "x": "x", "y": "y"}}),
    "magni with velocities": ("magni/condition-A.csv", False,
                              {"header": True, "columns": {"t": "Time", "track_id": "ag_id", "x": "x", "y": "y",
                                                           "speed": "speed", "heading": "theta_delta"}}),
    "hall": ("hall", True, {"reader": "atc"}),
    "forum": ("forum", False, {"reader": "edinburgh", "frame_rate": 9.0, "scale": 0.0247}),
}  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A function (name of a kind of recordings) -> its files; the demo's are made, others must be there."""

    @lru_cache
    def of(name):
        pattern = GOOD[name][0]
        if name in ("hall", "forum"):
            path = tmp_path_factory.mktemp(name) / "day.txt"
            write_recording(path, name, "2030-10-02", seed=1, scale=0.3)
            return [path]
        found = sorted(DATA.glob(pattern)) if DATA.is_dir() else []
        return found or pytest.skip(f"MODLHMP_DATA names no folder with {pattern}")

    return of


@pytest.mark.parametrize("name", GOOD)
def test_a_good_recording_passes(files, name):
    _, clock, keys = GOOD[name]
    form = check(FileFormat, keys, name)
    for path in files(name):
        rows, account = read_recording(path, form)
        assert check_recording(rows, account, form, clock) == [], path.name


def notice(path, keys):
    """Whether reading and cleaning stops, where warnings stop as well."""
    with pytest.raises(DataError) as error:
        clean_recording(path, check(FileFormat, {**keys, "strict": True}, "planted"), Recording(day=""))
    return str(error.value)


OWN = [  # what is declared wrongly about the files as they are
    *(("edinburgh", {"frame_rate": rate}) for rate in (90.0, 0.9, 25.0, 3.0, 18.0)),
    *(("edinburgh", {"scale": scale}) for scale in (0.247, 0.00247, 24.7, 1.0)),
    *(("edinburgh", {"row_stride": stride}) for stride in (1, 2, 9, 40)),
    *(("edinburgh raw", {"frame_rate": rate}) for rate in (90.0, 0.9, 25.0, 2.25)),
    *(("edinburgh raw", {"scale": scale}) for scale in (0.247, 0.00247, 24.7)),
    *(("hotel", {"frame_rate": rate}) for rate in (2.5, 250.0, 10.0, 50.0, 12.5)),
    *(("hotel", {**FRAMES, "units": {"time": unit}}) for unit in ("s", "ms")),
    *(("hotel", {"units": {"time": "frame", "length": unit}}) for unit in ("cm", "mm")),
    ("hotel", {"columns": {"t": 1, "track_id": 0, "x": 2, "y": 3}}),
    ("atc", {"reader": "delimited", "columns": {"t": 0, "track_id": 1, "x": 2, "y": 3, "speed": 5, "heading": 4}}),
    *(("forum", {"frame_rate": rate}) for rate in (90.0, 0.9, 25.0, 3.0)),
    *(("forum", {"scale": scale}) for scale in (0.247, 0.00247, 24.7, 1.0)),
]


@pytest.mark.parametrize(("name", "wrong"), OWN)
def test_a_wrong_declaration_of_a_file_is_noticed(files, name, wrong):
    notice(files(name)[0], {**GOOD[name][2], **wrong})


PLANTED = {  # as written, as declared
    "cm as m": ({"length": "cm", "moving": False}, {}),
    "mm as m": ({"length": "mm", "moving": False}, {}),
    "m as cm": ({"moving": False}, {"units": {"length": "cm"}}),
    "m as mm": ({"moving": False}, {"units": {"length": "mm"}}),
    "ms as s": ({"time": "ms", "moving": False}, {}),
    "s as ms": ({"moving": False}, {"units": {"time": "ms"}}),
    "us as ms": ({"time": "us", "moving": False}, {"units": {"time": "ms"}}),
    "frames as s": ({"rate": 25, "moving": False}, {}),
    "25 Hz as 2.5": ({"rate": 25, "moving": False}, {**FRAMES, "frame_rate": 2.5}),
    "25 Hz as 10": ({"rate": 25, "moving": False}, {**FRAMES, "frame_rate": 10}),
    "10 Hz as 25": ({"rate": 10, "moving": False}, {**FRAMES, "frame_rate": 25}),
    "30 Hz as 15": ({"rate": 30, "moving": False}, {**FRAMES, "frame_rate": 15}),
    "15 Hz as 30": ({"rate": 15, "moving": False}, {**FRAMES, "frame_rate": 30}),
    "all of cm as m": ({"length": "cm", "speed": "cm/s"}, {}),
    "all of mm as m": ({"length": "mm", "speed": "mm/s"}, {}),
    "all of m as mm": ({}, {"units": {"length": "mm", "speed": "mm/s"}}),
    "cm/s as m/s": ({"speed": "cm/s"}, {}),
    "mm/s as m/s": ({"speed": "mm/s"}, {}),
    "km/h as m/s": ({"speed": "km/h"}, {}),
    "m/s as km/h": ({}, {"units": {"speed": "km/h"}}),
    "seconds ten times too long": ({"seconds": 10}, {}),
    "degrees as radians": ({"angle": "deg"}, {}),
    "radians as degrees": ({}, {"units": {"angle": "deg"}}),
    "compass as from_x": ({"heading": "compass"}, {}),
    "compass in degrees as from_x": ({"heading": "compass", "angle": "deg"}, {"units": {"angle": "deg"}}),
    "from_x as compass": ({}, {"units": {"heading": "compass"}}),
    "clockwise as from_x": ({"heading": "from_x_clockwise"}, {}),
    "y down": ({"y": -1}, {}),
    "x and y exchanged": ({"exchange": True}, {}),
    "backwards": ({"heading": "backwards"}, {}),
}


@lru_cache
def table_of(path, name):
    """A recording's rows as `planted.write` takes them; speeds and headings of displacements where it has none."""
    _, _, keys = GOOD[name]
    rows, _ = read_recording(path, check(FileFormat, keys, name))
    rows = rows.take(slice(0, 60_000))
    around = moves(rows, 2)
    speed, heading = np.array(rows.speed), np.array(rows.heading)
    if not np.isfinite(speed).any():
        speed, heading = np.zeros(len(speed)), np.zeros(len(speed))
        speed[around.row], heading[around.row] = around.speed, around.direction
    whose = np.unique(rows.track_id, return_inverse=True)[1]
    return np.column_stack([whose, rows.t - rows.t.min(), rows.x, rows.y, speed, heading])


@pytest.mark.parametrize("planted", PLANTED)
@pytest.mark.parametrize("name", ["atc", "edinburgh", "hotel", "hall", "forum"])
def test_what_is_planted_in_a_recording_is_noticed(files, tmp_path, name, planted):
    table = table_of(files(name)[0], name).copy()
    written, declared = (dict(part) for part in PLANTED[planted])
    table[:, 3] *= written.pop("y", 1)
    if written.pop("exchange", False):
        table[:, 2:4] = table[:, [3, 2]]
    table[:, 1] *= written.pop("seconds", 1)
    path = write(tmp_path / "planted.csv", table, **written)
    columns = PLACES if written.get("moving") is False else MOVING
    notice(path, {"header": True, "columns": columns, **declared})


@pytest.mark.parametrize("name", ["atc", "edinburgh", "hotel", "hall", "forum"])
def test_nothing_planted_is_nothing_noticed(files, tmp_path, name):
    path = write(tmp_path / "planted.csv", table_of(files(name)[0], name))
    form = check(FileFormat, {"header": True, "columns": MOVING}, name)
    rows, account = read_recording(path, form)
    assert check_recording(rows, account, form) == []
