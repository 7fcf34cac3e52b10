"""Occupancy as ROS reads it: by map_server's rules, and back from a bag."""

import dataclasses
import sys

import numpy as np
import pytest
import yaml

from modlhmp import DataError, Futures, Live, Site
from modlhmp.floor_plan import FREE, OCCUPIED, UNKNOWN, load_floor_plan
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.occupancy import Occupancy
from modlhmp.ros import write_bag, write_map

T0 = 1.3e9 + 0.25
P = np.zeros((2, 3, 4), np.float32)
P[0, 0], P[0, 2, 3], P[1, 1, 2] = [0, 1, 0.257, 0.004], 0.5, 1
GRID = Occupancy(P, (-7.5, 2.0), 0.5, np.array([1.0, 2.0]), T0)


def map_server(path):
    """What map_server makes of a YAML file in mode raw: values of its grid, row 0 below, by its published rules."""
    said = yaml.safe_load(path.read_text())
    assert said["mode"] == "raw"
    _, _, size, depth, pixels = (path.parent / said["image"]).read_bytes().split(b"\n", 4)
    columns, rows = map(int, size.split())
    assert depth == b"255"
    values = np.frombuffer(pixels, np.uint8).reshape(rows, columns).astype(int)
    return np.where(values <= 100, values, -1)[::-1], said


def test_a_moment_as_a_map_of_map_server(tmp_path):
    image = write_map(GRID, tmp_path / "a 'map'.yaml", at_s=1)
    values, said = map_server(tmp_path / "a 'map'.yaml")
    assert values.tolist() == [[0, 100, 26, 0], [0] * 4, [0, 0, 0, 50]]
    assert (said["resolution"], said["origin"]) == (0.5, [-7.5, 2.0, 0.0])
    assert image == tmp_path / "a 'map'.pgm"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a 'map'.pgm", "a 'map'.yaml"]
    write_map(GRID._replace(times_s=0.4 * np.arange(2, 4)), tmp_path / "a 'map'.yaml", at_s=1.2)  # 0.4 * 3 is more
    assert map_server(tmp_path / "a 'map'.yaml")[0].max() == 100


def test_our_own_reader_takes_it(tmp_path, caplog):
    """Without a word, also where no cell is certain to be occupied."""
    write_map(GRID._replace(probabilities=0.8 * GRID.probabilities), tmp_path / "m.yaml", at_s=1)
    assert not (load_floor_plan(tmp_path / "m.yaml").cells == OCCUPIED).any()
    assert not caplog.messages
    write_map(GRID, tmp_path / "m.yml", at_s=1)
    plan = load_floor_plan(tmp_path / "m.yml")
    assert (plan.resolution, plan.origin, plan.yaw) == (0.5, (-7.5, 2.0), 0.0)
    assert plan.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN, FREE], [FREE] * 4, [FREE] * 3 + [UNKNOWN]]


@pytest.mark.parametrize(
    ("path", "at_s", "message"),
    [
        ("m.pgm", 1, "ends with .yaml"),
        ("m.yaml", 3, "from 1 to 2 s"),
        ("m.yaml", "1", "from 1 to 2"),
        ("", 1, "path ''"),
    ],
)
def test_a_map_that_cannot_be_written(tmp_path, monkeypatch, path, at_s, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match=message):
        write_map(GRID, path, at_s)
    assert not list(tmp_path.iterdir())


def forecast():
    """Two walkers seen at `T0`, one of them after text; the second leaves after one step."""
    xy = np.array([[[[1, 2], [2, 2]], [[1, 2], [2, 3]]], [[[5, 5], [5, 5]], [[5, 5], [5, 5]]]], np.float32)
    alive = np.array([[2, 2], [1, 1]], np.int32)
    start = np.array([[0.0, 2.0], [4.0, 5.0]])
    samples = Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, "medoid")
    return Futures(np.array([7, -3]), np.full(2, T0), start, samples, Site(horizon_s=2))


def test_a_bag_reads_back(tmp_path):
    rosbags = pytest.importorskip("rosbags.highlevel", reason="rosbags is an extra: pip install 'modlhmp[ros]'")
    futures = forecast()
    occupancy = futures.occupancy(extent=(0, 6, 0, 6))
    write_bag(futures, occupancy, tmp_path / "new" / "bag", frame="atc")
    assert sorted(one.name for one in (tmp_path / "new/bag").iterdir()) == ["bag.mcap", "metadata.yaml"]
    with rosbags.AnyReader([tmp_path / "new/bag"]) as bag:
        found = [
            (connection.topic, time, bag.deserialize(raw, connection.msgtype))
            for connection, time, raw in bag.messages()
        ]
    ns = 1_300_000_000_250_000_000
    assert [(topic, time - ns) for topic, time, _ in found] == [
        ("/modlhmp/path/person_7", 0), ("/modlhmp/path/person_m3", 0),
        ("/modlhmp/occupancy", 10**9), ("/modlhmp/occupancy", 2 * 10**9),
    ]  # fmt: skip
    paths, grids = [message for *_, message in found[:2]], [message for *_, message in found[2:]]
    assert {message.header.frame_id for message in (*paths, *grids)} == {"atc"}
    for grid, p in zip(grids, occupancy.probabilities, strict=True):
        assert (grid.info.width, grid.info.height, grid.info.resolution) == (6, 6, 1.0)
        assert (grid.info.origin.position.x, grid.info.origin.orientation.w) == (0, 1)
        np.testing.assert_array_equal(np.reshape(grid.data, (6, 6)), np.rint(100 * p))
    assert grids[0].header.stamp.sec == int(T0) + 1
    assert grids[0].header.stamp.nanosec == 250_000_000
    walked = [[(one.pose.position.x, one.pose.position.y) for one in path.poses] for path in paths]
    assert walked == [[(0, 2), (1, 2), (2, 2)], [(4, 5), (5, 5)]], "with the start, until they leave"
    assert [one.header.stamp.sec - int(T0) for one in paths[0].poses] == [0, 1, 2]
    assert paths[0].poses[-1].pose.orientation.w == 1


def test_a_bag_that_cannot_be_written(tmp_path, monkeypatch):
    futures, occupancy = forecast(), forecast().occupancy()
    (tmp_path / "there").mkdir()
    nobody = Live("cvm", 2, site=Site()).forecast(T0)
    late = dataclasses.replace(futures, t0=np.full(2, 3e9))
    for one, path, message in ((futures, "there", "exists"), (nobody, "new", "of nobody"), (late, "new", "t0 3")):
        with pytest.raises(DataError, match=message):
            write_bag(one, occupancy, tmp_path / path)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(DataError, match=r"pip install 'modlhmp\[ros\]'"):
        write_bag(futures, occupancy, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_numbers_are_written_so_that_yaml_and_ros_read_them(tmp_path):
    """`1e-05` would be text to YAML; a name may need quotes."""
    write_map(GRID._replace(origin=(1e-5, -123.456), cell_m=0.00001), tmp_path / "n.yaml", 1)
    said = yaml.safe_load((tmp_path / "n.yaml").read_text())
    assert [type(one) for one in (said["resolution"], *said["origin"])] == [float] * 4
    assert said["origin"][1] == -123.456
