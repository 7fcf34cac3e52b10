"""Files of the field that are no plain table: TrajNet++'s, THOR-MAGNI's, JuPedSim's and the archive's HDF5."""

import json
import sqlite3
import sys

import numpy as np
import pytest

import modlhmp
from modlhmp.file_format import FileFormat
from modlhmp.ids import id_of
from modlhmp.readers import read_recording
from modlhmp.storage import DataError


def steady(tracks, speed):
    known = np.isfinite(tracks.speed)
    np.testing.assert_allclose(tracks.speed[known], speed, rtol=1e-6)


# --- TrajNet++ ----------------------------------------------------------------------------------------------


def trajnet(scenes=(), step=10, people=(3, "x"), rows=12, **track):
    lines = [{"scene": scene} for scene in scenes]
    for n, person in enumerate(people):
        lines += [{"track": {"f": step * k, "p": person, "x": 0.48 * k, "y": float(n), **track}} for k in range(rows)]
    return "".join(json.dumps(line) + "\n" for line in lines)


@pytest.mark.parametrize("step", [1, 2, 10])
def test_scenes_say_how_many_rows_there_are_per_second(write, step):
    path = write(trajnet([{"id": 0, "p": 3, "s": 0, "e": 200, "fps": 2.5, "tag": 0}], step))
    tracks, account = read_recording(path, FileFormat(reader="trajnet"))
    assert set(tracks.track_id.tolist()) == {3, id_of("x")}
    np.testing.assert_allclose(np.diff(tracks.t[tracks.track_id == 3]), 0.4)
    assert account.rows_read == 24


def test_other_lines_of_json_are_counted(write):
    other = '{"map": {"id": 1}}\n\nno json\n[1]\n' + trajnet(prediction_number=0, rows=2)
    tracks, account = read_recording(write(other + trajnet()), FileFormat(reader="trajnet", frame_rate=25))
    assert len(tracks.t) == 24
    assert dict(account.dropped_rows) == {"other_object": 1, "blank_line": 1, "text_value": 2, "prediction": 4}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (trajnet(), "0 different `fps`; say the `frame_rate`"),
        (trajnet([{"fps": 2.5}, {"fps": 25}]), "2 different `fps`"),
        (trajnet([{"fps": 2.5}], rows=1), "give `frame_rate`"),
        ("{}\n", "no usable row"),
        (trajnet(x=float("nan")), "no usable row"),
    ],
)
def test_json_lines_that_do_not_tell_are_refused(write, content, message):
    with pytest.raises(DataError, match=message):
        read_recording(write(content), FileFormat(reader="trajnet"))


# --- THOR-MAGNI ---------------------------------------------------------------------------------------------


def magni(rows=500, gap=range(0), repeated=0):
    bodies = [f"{name} Centroid_{axis}" for name in ("Helmet_1", "Helmet_2", "LO1") for axis in "XY"]
    lines = [*(f"KEY_{n},value,{n}" for n in range(16)), ",".join(["Frame", "Time", "Helmet_1 - 1 X", *bodies])]
    for n in range(rows):
        first = ["", ""] if n in gap else [f"{12.0 * n:.3f}", "500"]
        lines.append(",".join([str(n + 1), f"{n / 100:.2f}", "", *first, f"{-12.0 * n:.3f}", "0", "7", "7"]))
        lines += [lines[-1]] * (n < repeated)
    return "\n".join(lines) + "\n"


def test_bodies_of_a_magni_file_are_people_in_metres(write):
    tracks = modlhmp.read_tracks(write(magni()), reader="magni", time_step_s=0.4)
    assert set(tracks.track_id.tolist()) == {id_of("Helmet_1"), id_of("Helmet_2")}  # a carried object is none
    steady(tracks, 1.2)
    assert set(tracks.y[tracks.track_id == id_of("Helmet_1")].tolist()) == {0.5}


def test_a_body_out_of_sight_is_cut(write):
    path = write(magni(rows=1500, gap=range(300, 1000), repeated=4))
    _, account = read_recording(path, FileFormat(reader="magni"))
    assert dict(account.dropped_rows) == {"not_measured": 700, "duplicate_row": 8}
    clean = modlhmp.read_tracks(path, reader="magni")
    assert set(clean.track_id.tolist()) == {id_of("Helmet_1"), id_of("Helmet_1", 2), id_of("Helmet_2")}


@pytest.mark.parametrize(
    "content", ["a,b\n1,2\n", "Frame,Time,LO1 Centroid_X\n1,0.0,3\n", "Frame,Time,Helmet_1 Centroid_X\n"]
)
def test_what_is_no_magni_file_is_refused(write, content):
    with pytest.raises(DataError, match=r"reader: magni|no row below"):
        read_recording(write(content), FileFormat(reader="magni"))


# --- JuPedSim and the archive -------------------------------------------------------------------------------

ROWS = [(person, frame, 0.12 * frame, float(person)) for person in (1, 2) for frame in range(60)]


@pytest.fixture
def simulated(tmp_path):
    """Function (fps="10", rows=ROWS) -> a JuPedSim file."""

    def create(fps="10", rows=ROWS):
        path = tmp_path / f"run{len(list(tmp_path.iterdir()))}.sqlite"
        with sqlite3.connect(path) as file:
            file.execute("CREATE TABLE trajectory_data (frame INTEGER, id INTEGER, pos_x REAL, pos_y REAL)")
            file.execute("CREATE TABLE metadata (key TEXT PRIMARY KEY, value TEXT)")
            file.executemany("INSERT INTO trajectory_data VALUES (?, ?, ?, ?)", [(f, i, x, y) for i, f, x, y in rows])
            if fps:
                file.execute("INSERT INTO metadata VALUES ('fps', ?)", (fps,))
        return path

    return create


def test_a_jupedsim_file(simulated):
    tracks = modlhmp.read_tracks(simulated(), reader="jupedsim")
    assert set(tracks.track_id.tolist()) == {1, 2}
    steady(tracks, 1.2)


def test_what_is_no_jupedsim_file_is_refused(simulated, write):
    bad = {write("no database"): "cannot be read", simulated(fps=None): "no `fps`", simulated(rows=[]): "no rows"}
    for path, message in bad.items():
        with pytest.raises(DataError, match=message):
            read_recording(path, FileFormat(reader="jupedsim"))


def test_an_archive_s_file(tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py is an extra: pip install 'modlhmp[hdf5]'")
    kind = [("id", "i8"), ("frame", "i8"), ("x", "f8"), ("y", "f8"), ("z", "f8")]
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["trajectory"] = np.array([(*row, 1.7) for row in ROWS], kind)
        file["trajectory"].attrs["fps"] = "10.0"
    steady(modlhmp.read_tracks(tmp_path / "run.h5", reader="hdf5"), 1.2)


def test_an_archive_s_file_without_h5py_names_the_extra(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(DataError, match=r"pip install 'modlhmp\[hdf5\]'"):
        read_recording(write("x"), FileFormat(reader="hdf5"))
