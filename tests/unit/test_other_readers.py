"""Files of the field that are no plain table: TrajNet++'s, THOR-MAGNI's, JuPedSim's and the archive's HDF5."""

import json
import sqlite3
import sys

import numpy as np
import pytest

import modlhmp
from modlhmp.cleaning import clean_recording
from modlhmp.file_format import _READER_NEEDS, Columns, FileFormat, Recording, Split, Units, check_format
from modlhmp.ids import id_of
from modlhmp.plausibility import check_recording
from modlhmp.readers import read_recording
from modlhmp.scenes import Scenes, read_scenes
from modlhmp.storage import DataError
from modlhmp.tracks import write_tracks


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


def scene(p=3, s=0, e=50, **fields):
    return {"id": 7, "p": p, "s": s, "e": e, **fields}


def test_other_lines_of_json_are_counted(write):
    other = '{"map": {"id": 1}}\n\nno json\n[1]\n' + trajnet(prediction_number=0, rows=2)
    other += (
        '{"track": {"f": 1, "p": null, "x": 1, "y": 1}}\n{"track": {"f": 1, "p": 1, "x": 1' + "0" * 400 + ', "y": 1}}\n'
    )
    tracks, account = read_recording(write(other + trajnet()), FileFormat(reader="trajnet", frame_rate=25))
    assert len(tracks.t) == 24
    assert dict(account.dropped_rows) == {
        "other_object": 1, "blank_line": 1, "text_value": 2, "prediction": 4, "no_track_id": 1, "nan_value": 1,
    }  # fmt: skip
    assert account.scenes is None


def test_nobody_s_lines_of_json_are_dropped_as_in_a_table(write):
    nobody = trajnet([scene(p=-1, fps=2.5)], people=(-1, "-1.0"), rows=3) + trajnet(people=("NULL",), rows=2)
    path = write(nobody + trajnet([scene(fps=2.5)]))
    tracks, account = read_recording(path, FileFormat(reader="trajnet"))
    assert len(tracks.t) == 24
    assert dict(account.dropped_rows) == {"bad_scene": 1, "no_person": 6, "no_track_id": 2}


def test_a_person_is_the_same_with_and_without_a_point(write):
    path = write(
        trajnet([scene(p=1, fps=2.5)], people=(1.0, 2)) + trajnet([scene(p=2.0, fps=2.5)], people=(1,), rows=1)
    )
    tracks, account = read_recording(path, FileFormat(reader="trajnet"))
    assert set(tracks.track_id.tolist()) == {1, 2}
    assert account.scenes.track_id.tolist() == [1, 2]


BAD_SCENES = [
    *({"fps": 2.5}, scene(p=None), scene(s="0"), scene(s=50), scene(s=60), scene(e=float("inf"))),
    *(scene(fps=fps) for fps in (0, -1, "2.5", float("nan"), True)),
]


def test_scenes_are_whose_path_is_forecast_and_when(write):
    """Every row is kept, whoever is a primary; scenes without a person or frames are counted."""
    scenes = [scene(fps=2.5), scene(p="x", s=20, e=70), scene(s=40, e=110, fps=None), *BAD_SCENES]
    tracks, account = read_recording(write(trajnet(scenes)), FileFormat(reader="trajnet"), "2030-01-01", "09:00")
    nine = 1893488400.0
    assert account.scenes.track_id.tolist() == [3, id_of("x"), 3]
    np.testing.assert_allclose(account.scenes.begin - nine, [0, 0.8, 1.6], atol=1e-6)
    np.testing.assert_allclose(account.scenes.end - nine, [2, 2.8, 4.4], atol=1e-6)
    assert dict(account.dropped_rows) == {"bad_scene": len(BAD_SCENES)}
    assert account.rows_read == 24 + len(BAD_SCENES)
    assert len(tracks.t) == 24


def test_scenes_of_another_fps_are_read_where_their_frames_are_as_fast(write):
    """Every frame of one source, every tenth of another: 25 frames a second both."""
    other = trajnet([scene(p="y", e=11, fps=25)], step=1, people=("y",))
    path = write(trajnet([scene(fps=2.5)]) + other)
    tracks, account = read_recording(path, FileFormat(reader="trajnet"))
    steps = {one: np.diff(tracks.t[tracks.track_id == id_of(one)]).round(9).tolist() for one in ("3", "x", "y")}
    assert steps == {"3": [0.4] * 11, "x": [0.4] * 11, "y": [0.04] * 11}
    np.testing.assert_allclose(account.scenes.end, [2, 0.44])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (trajnet(), "none of its 0 scenes has an `fps`.*say the `frame_rate`"),
        (trajnet([scene()]), "none of its 1 scenes has an `fps`.*say the `frame_rate`"),
        (trajnet([scene(p=99, fps=2.5), scene(s=500, e=600, fps=2.5)]), "none of its 2 scenes.*two rows"),
        (trajnet([scene(fps=2.5)], rows=1), "none of its 1 scenes.*two rows of its primary"),
        (trajnet([scene(fps=2.5), scene(fps=2.5, s=50, e=110), {**scene(fps=25), "id": 8}]),
         r"scene 7 \(row 1\) says 2.5 `fps` and has a row every 10 frames \(25 per second\), scene 8 \(row 3\) says 25 "
         r"`fps` and has a row every 10 frames \(250\): put the scenes and tracks of each rate in a file of their own"),
        (trajnet([scene(fps=2.5)]) + trajnet([scene(p="y", e=11, fps=2.5)], 1, ("y",)), r"row every 1 frames \(2.5\)"),
        ("{}\n", "no usable row"),
        (trajnet(x=float("nan")), "no usable row"),
    ],
)  # fmt: skip
def test_json_lines_that_do_not_tell_are_refused(write, content, message):
    path = write(content)
    with pytest.raises(DataError, match=message) as error:
        read_recording(path, FileFormat(reader="trajnet"))
    assert str(path) in str(error.value)
    if "frame_rate" in str(error.value):
        assert len(read_recording(path, FileFormat(reader="trajnet", frame_rate=25))[0].t)


def test_files_of_json_lines_put_one_after_the_other_are_warned_of(write):
    """By frames, as the public files are."""
    rows = [json.loads(line) for line in trajnet(people=range(4), rows=40).splitlines()]
    rows = "".join(json.dumps(row) + "\n" for row in sorted(rows, key=lambda row: row["track"]["f"]))
    form = FileFormat(reader="trajnet", frame_rate=25)
    found = [check_recording(*read_recording(write(text), form), form) for text in (rows, rows + rows)]
    assert [[one.check for one in some] for some in found] == [[], ["glued_files"]]


# --- scenes, cleaned ----------------------------------------------------------------------------------------


def cleaned(write, scenes, people=(3, "x"), frames=range(0, 400, 10), **recording):
    rows = [{"track": {"f": f, "p": p, "x": 0.048 * f, "y": float(n)}} for n, p in enumerate(people) for f in frames]
    path = write("".join(json.dumps(line) + "\n" for line in [*({"scene": one} for one in scenes), *rows]))
    form = FileFormat(reader="trajnet", time_step_s=0.4)
    tracks, account = clean_recording(path, form, Recording(day="", **recording))
    return tracks, account, Scenes(*map(np.array, account["scenes"].values()))


def test_scenes_are_of_the_piece_that_is_there_at_their_begin(write, tmp_path):
    """A person who is away for 8 s is two: the scene over the gap is of the first, and that within it of nobody."""
    frames = [*range(0, 200, 10), *range(400, 600, 10)]
    spans = [(0, 50), (150, 450), (210, 450), (390, 450), (400, 450), (590, 700)]
    scenes = [scene(s=s, e=e, fps=2.5) for s, e in spans]
    tracks, account, found = cleaned(write, [*scenes, scene(p=99)], frames=frames)
    assert found.track_id.tolist() == [3, 3, id_of("3", 2)]
    assert (25 * found.begin).round().tolist() == [0, 150, 400]
    assert (account["notes"]["scenes"], account["notes"]["scenes_of_others"]) == (7, 4)
    write_tracks(tracks, tmp_path / "t.parquet", scenes=account["scenes"])
    for one, other in zip(read_scenes(tmp_path / "t.parquet"), found, strict=True):
        np.testing.assert_array_equal(one, other)
    write_tracks(tracks, tmp_path / "none.parquet")
    assert read_scenes(tmp_path / "none.parquet") is None


def test_each_side_of_a_split_has_its_own_people_s_scenes_and_all_their_rows(write):
    people = [f"p{n}" for n in range(30)]
    scenes = [scene(p=p, s=s, e=s + 200, fps=2.5) for p in people[::2] for s in (0, 50)]
    chosen, owners, sides = Split(by="person"), [], {}
    for side in ("train", "test"):
        tracks, _, found = cleaned(write, scenes, people, side=side, chosen=chosen)
        sides[side] = set(tracks.track_id.tolist())
        assert set(found.track_id.tolist()) == sides[side] & {id_of(p) for p in people[::2]}
        assert len(tracks.t) == 40 * len(sides[side])
        owners += found.track_id.tolist()
    assert sorted(owners) == sorted(2 * [id_of(p) for p in people[::2]])
    assert len(sides["train"] | sides["test"]) == 30


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


@pytest.mark.parametrize("ends", ["\n", "\r", "\r\n"])
@pytest.mark.parametrize("quote", ["", '"'])
def test_a_magni_file_that_a_table_calculation_wrote_again(write, ends, quote):
    lines = [",".join(f"{quote}{one}{quote}" for one in line.split(",")) for line in magni().splitlines()]
    found = read_recording(write(ends.join([*lines, ""]).encode()), FileFormat(reader="magni"))[0]
    expected = read_recording(write(magni(), "plain.csv"), FileFormat(reader="magni"))[0]
    np.testing.assert_array_equal(np.array(found), np.array(expected))


def test_a_body_out_of_sight_is_cut(write):
    path = write(magni(rows=1500, gap=range(300, 1000), repeated=4))
    _, account = read_recording(path, FileFormat(reader="magni"))
    assert dict(account.dropped_rows) == {"not_measured": 700, "duplicate_row": 8}
    clean = modlhmp.read_tracks(path, reader="magni")
    assert set(clean.track_id.tolist()) == {id_of("Helmet_1"), id_of("Helmet_1", 2), id_of("Helmet_2")}


@pytest.mark.parametrize("line", [b"1,2", b"1,\xfd", b"1," * 20])
def test_lines_of_another_length_are_counted(write, line):
    """They were left out without a word; one that is no text failed in Arrow, with a traceback beside the error."""
    whole = magni().encode()
    tracks, account = read_recording(write(whole + line + b"\n"), FileFormat(reader="magni"))
    expected, before = read_recording(write(whole, "whole.csv"), FileFormat(reader="magni"))
    assert dict(account.dropped_rows) == {**before.dropped_rows, "wrong_column_count": 2}
    assert account.rows_read == before.rows_read + 2
    np.testing.assert_array_equal(tracks.x, expected.x)


@pytest.mark.parametrize(
    "content", ["a,b\n1,2\n", "Frame,Time,LO1 Centroid_X\n1,0.0,3\n", "Frame,Time,Helmet_1 Centroid_X\n"]
)
def test_what_is_no_magni_file_is_refused(write, content):
    with pytest.raises(DataError, match=r"reader: magni|no row below"):
        read_recording(write(content), FileFormat(reader="magni"))


# --- what all readers have in common, and keys that they do not read ----------------------------------------

GRID = (691_000, 5_334_000)


@pytest.fixture
def somewhere(write, simulated, archived):
    """Function (x, y) -> {reader: a file whose people walk there [m]}."""

    def create(x, y):
        rows = [(i, f, x + a, y + b) for i, f, a, b in ROWS]
        lines = ["Frame,Time,Helmet_1 Centroid_X,Helmet_1 Centroid_Y"]
        lines += [f"{f},{f / 10},{1000 * a:.3f},{1000 * b:.3f}" for i, f, a, b in rows if i == 1]
        tracks = [{"track": {"f": f, "p": i, "x": a, "y": b}} for i, f, a, b in rows]
        seconds = [f"{f / 10},{i},{a},{b},1.2,0" for i, f, a, b in rows]
        return {
            "jupedsim": simulated(rows=rows), "hdf5": archived(rows), "magni": write("\n".join(lines), f"{x}.magni"),
            "trajnet": write("".join(json.dumps(one) + "\n" for one in tracks), f"{x}.ndjson"),
            "atc_1hz": write("\n".join(seconds), f"{x}.csv"),
        }  # fmt: skip

    return create


def test_every_reader_of_metres_moves_a_national_grid_to_its_origin_or_asks(somewhere):
    near, far = somewhere(0, 0), somewhere(*GRID)
    for reader, path in near.items():
        more = {"frame_rate": 10.0} if reader == "trajnet" else {}
        here = modlhmp.read_tracks(path, reader=reader, **more)
        moved = modlhmp.read_tracks(far[reader], reader=reader, origin_m=GRID, **more)
        np.testing.assert_allclose((moved.x, moved.y), (here.x, here.y), atol=1e-3)
        if reader != "atc_1hz":  # whose place is known
            with pytest.raises(DataError, match=r"set `origin_m: \[691000, 5334000\]`"):
                modlhmp.read_tracks(far[reader], reader=reader, **more)


def test_a_day_without_a_start_is_asked_about_where_times_count_from_0(somewhere):
    for reader, path in somewhere(0, 0).items():
        form = {"reader": reader, **({"frame_rate": 10.0} if reader == "trajnet" else {})}
        if reader != "atc_1hz":  # whose times are of a clock
            with pytest.raises(
                DataError, match=r'day .2026-03-02.: the file has no clock: say its `start` too, such as "'
            ):
                modlhmp.read_tracks(path, day="2026-03-02", **form)
            assert len(modlhmp.read_tracks(path, day="2026-03-02", start="09:00", **form).t)


def test_some_positions_far_away_are_counted_whoever_reads(somewhere, simulated):
    path = simulated(rows=[*ROWS, (2, 60, 1e7, 0.0)])
    tracks, account = read_recording(path, FileFormat(reader="jupedsim"))
    assert (len(tracks.t), account.dropped_rows) == (120, {"absurd_value": 1})
    assert account.beyond["distance"] == (1, 1e7)


@pytest.mark.parametrize("reader", ["trajnet", "magni", "jupedsim", "hdf5", "edinburgh", "edinburgh_rows", "atc"])
@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("only", {"k": ["car"]}), ("without", {"k": ["car"]}), ("missing", {"x": 0.0}), ("skip_lines", 1)),
        *(("columns", {"track_id": 0, "t": 1, "x": 2, "y": 3}), ("units", {"length": "cm"}), ("separator", ";")),
        ("homography", [[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
    ],
)
def test_a_key_that_a_reader_does_not_read_is_refused(write, reader, key, value):
    needed = {"frame_rate": 9.0, "scale": 0.02, "row_stride": 4}
    needed = {name: needed[name] for name in _READER_NEEDS.get(reader, ())}
    with pytest.raises(DataError, match=rf"reader '{reader}' does not read the key '{key}', only "):
        modlhmp.read_tracks(write("x"), reader=reader, **needed, **{key: value})


@pytest.mark.parametrize(
    ("reader", "said"),
    [
        *((reader, {"units": {"length": "px", "time": "frame"}}) for reader in ("edinburgh", "edinburgh_rows")),
        *((reader, {"units": {"length": "px"}, "separator": ","}) for reader in ("edinburgh", "edinburgh_rows")),
        *(("atc", {"units": units}) for units in ({"length": "mm"}, {"length": "mm", "speed": "mm/s"})),
        *((("atc_1hz", {"units": {"speed": "m/s"}}), ("magni", {"units": {"length": "mm"}}))),
        *((reader, {"units": {"time": "frame"}}) for reader in ("jupedsim", "hdf5", "trajnet")),
        *(("text", {"separator": mark, "columns": Columns(track_id=0, t=1, x=2, y=3)}) for mark in " \t"),
    ],
)
def test_what_a_reader_takes_for_granted_may_be_said(reader, said):
    needed = {"frame_rate": 9.0, "scale": 0.02, "row_stride": 4}
    needed = {name: needed[name] for name in _READER_NEEDS.get(reader, ()) if name != "columns"}
    units = {"units": Units(**said["units"])} if "units" in said else {}
    check_format(FileFormat(reader=reader, **{**needed, **said, **units}), "test")


def test_columns_between_tabs_are_text(write):
    path = write("".join(f"{who}\t{t}\t{t}\t{who}\n" for who in range(3) for t in range(9)))
    tracks = modlhmp.read_tracks(path, reader="text", separator="\t", columns={"track_id": 0, "t": 1, "x": 2, "y": 3})
    assert len(tracks.t) == 27


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


LARGE = [(2**53 + person, frame, 0.12 * frame, float(person)) for person in (0, 1) for frame in range(60)]


@pytest.fixture
def archived(tmp_path):
    """Function (rows=ROWS, kind of ids) -> an archive's file."""
    h5py = pytest.importorskip("h5py", reason="h5py is an extra: pip install 'modlhmp[hdf5]'")

    def create(rows=ROWS, kind="i8"):
        path = tmp_path / f"run{len(list(tmp_path.iterdir()))}.h5"
        columns = [("id", kind), ("frame", "i8"), ("x", "f8"), ("y", "f8"), ("z", "f8")]
        with h5py.File(path, "w") as file:
            file["trajectory"] = np.array([(*row, 1.7) for row in rows], columns)
            file["trajectory"].attrs["fps"] = "10.0"
        return path

    return create


def test_ids_that_floats_do_not_hold_are_people_of_their_own(simulated, archived):
    paths = {"jupedsim": [simulated(rows=LARGE)], "hdf5": [archived(LARGE), archived(LARGE, "u8")]}
    for reader, path in [(reader, path) for reader, some in paths.items() for path in some]:
        tracks, account = read_recording(path, FileFormat(reader=reader))
        assert set(tracks.track_id.tolist()) == {2**53, 2**53 + 1}
        assert account.rows_read == len(tracks.t) == 120


def test_ids_that_are_not_whole_are_refused(simulated, archived):
    bad = (1.5, 5, 0.0, 0.0)
    files = {simulated(rows=[*ROWS, bad]): "1.5", archived([*ROWS, bad], "f8"): "1.5"}
    files |= {archived([*ROWS, (2**24, 0, 0, 0)], "f4"): "16777216.0", archived(LARGE, "f8"): "9007199254740992"}
    files |= {archived([*ROWS, (2**63, 0, 0, 0)], "u8"): "9223372036854775808"}
    for path, told in files.items():
        row = "1" if "9007" in told else "121"
        with pytest.raises(DataError, match=rf"{path.name}, row {row}: id {told}.* is no whole number.*64 bits"):
            read_recording(path, FileFormat(reader="jupedsim" if path.suffix == ".sqlite" else "hdf5"))


def test_rows_without_an_id_and_nobody_s_are_counted_as_in_a_table(simulated, archived):
    here, lost = (5, 0.0, 0.0), (5, np.nan, 0.0)
    none, nobody, nowhere = [(None, *here), (None, *lost)], [(-1, *here)] * 3, [(1, *lost), (-1, *lost)]
    archive = [*ROWS, *((np.nan, *row[1:]) for row in none), *nobody, *nowhere]
    paths = {"jupedsim": simulated(rows=[*LARGE, *none, *nobody, *nowhere]), "hdf5": archived(archive, "f8")}
    for reader, path in paths.items():
        tracks, account = read_recording(path, FileFormat(reader=reader))
        assert len(tracks.t) == 120
        assert account.dropped_rows == {"no_track_id": 2, "no_person": 3, "nan_value": 2}
        assert account.rows_read == 127
        assert len(np.unique(tracks.track_id)) == 2


def test_what_is_no_jupedsim_file_is_refused(simulated, write):
    bad = {write("no database"): "cannot be read", simulated(fps=None): "no `fps`", simulated(rows=[]): "no rows"}
    for path, message in bad.items():
        with pytest.raises(DataError, match=message):
            read_recording(path, FileFormat(reader="jupedsim"))


def test_an_archive_s_file(archived):
    for kind in ("i8", "f8", "f4", "u2"):
        steady(modlhmp.read_tracks(archived(kind=kind), reader="hdf5"), 1.2)


def test_an_archive_s_file_without_h5py_names_the_extra(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(DataError, match=r"pip install 'modlhmp\[hdf5\]'"):
        read_recording(write("x"), FileFormat(reader="hdf5"))
