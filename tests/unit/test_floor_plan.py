"""Floor plans: map_server's conventions by hand, the demo's plan against its people, bad files."""

import sys

import numpy as np
import pytest
from PIL import Image

from modlhmp.floor_plan import FREE, OCCUPIED, UNKNOWN, FloorPlan, load_floor_plan, occupied_depth, value_at
from modlhmp.readers import read_recording
from modlhmp.storage import DataError
from modlhmp.study.demo import RECORDINGS, write_recording
from modlhmp.study.demo.hall import write_floor_plan

YAML = (
    "image: plan.pgm\nresolution: 0.5\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


def plan_of(folder, grey, text=YAML):
    """A plan whose image has these grey values, top row first."""
    Image.fromarray(np.array(grey, np.uint8)).save(folder / "plan.pgm")
    (folder / "plan.yaml").write_text(text)
    return load_floor_plan(folder / "plan.yaml")


def test_thresholds_and_orientation(tmp_path):
    """Black is occupied, white free, grey unknown; the image's last row lies at the origin."""
    plan = plan_of(tmp_path, [[0, 127], [255, 254]])
    assert plan.cells.tolist() == [[FREE, FREE], [OCCUPIED, UNKNOWN]]
    assert value_at(plan, plan.cells, [-0.9, -0.9, -0.1], [2.6, 2.1, 2.9]).tolist() == [OCCUPIED, FREE, UNKNOWN]


def test_negate(tmp_path):
    """With `negate`, white is occupied."""
    plan = plan_of(tmp_path, [[0, 255]], YAML.replace("negate: 0", "negate: 1"))
    assert plan.cells.tolist() == [[FREE, OCCUPIED]]


def test_beyond_the_plan_nothing_is_occupied(tmp_path):
    """Nor where a position is not known."""
    plan = plan_of(tmp_path, [[0, 0], [0, 0]])
    x, y = np.array([-1.001, 0.001, np.nan, -0.5]), np.array([2.5, 2.5, 2.5, 3.001])
    assert value_at(plan, plan.cells, x, y).tolist() == [0, 0, 0, 0]


def test_a_turned_plan():
    """A quarter turn about the origin: the grid's first row runs up."""
    plan = FloorPlan(np.array([[OCCUPIED, FREE, UNKNOWN]], np.uint8), 1.0, (5.0, 5.0), np.pi / 2)
    assert value_at(plan, plan.cells, [4.5, 4.5, 4.5, 5.5], [5.5, 6.5, 7.5, 5.5]).tolist() == [2, 0, 1, 0]


def test_depth_of_a_wall():
    """Three cells of 1 m: their centres lie 0.5, 1.5 and 0.5 m deep."""
    cells = np.full((9, 5), FREE, np.uint8)
    cells[:, 1:4] = OCCUPIED
    depth = occupied_depth(FloorPlan(cells, 1.0, (0.0, 0.0), 0.0))
    np.testing.assert_allclose(depth[4], [0, 0.5, 1.5, 0.5, 0])
    np.testing.assert_allclose(depth[0], [0, 0.5, 0.5, 0.5, 0])  # beyond the plan is not occupied


def test_nobody_of_the_demo_walks_into_a_wall(tmp_path, load_shipped):
    """The demo hall's plan fits its people: all clean rows lie in free area."""
    write_floor_plan(tmp_path / "hall/hall.yaml")
    plan = load_floor_plan(tmp_path / "hall/hall.yaml")
    assert 0.3 < (plan.cells == FREE).mean() < 0.6
    assert set(np.unique(plan.cells)) == {FREE, OCCUPIED}
    made = RECORDINGS[0]
    write_recording(tmp_path / made.file, made.site, made.day, seed=1, scale=0.2)
    dataset = load_shipped("demo_hall", tmp_path)
    tracks, _account = read_recording(tmp_path / made.file, dataset, made.day)
    inside = (np.abs(tracks.x) < 36) & (np.abs(tracks.y) < 15)  # not the absurd rows
    assert inside.mean() > 0.99
    assert (value_at(plan, plan.cells, tracks.x, tracks.y)[inside] == FREE).mean() > 0.9999


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("just words", "mapping of keys"),
        ("image: [", "plan.yaml, line 1, column 9: not valid YAML"),
        (YAML.replace("resolution: 0.5\n", ""), "lacks resolution"),
        (YAML.replace("0.5", "0"), "resolution 0 is not"),
        (YAML.replace("0.5", "wide"), "resolution 'wide' is not"),
        (YAML.replace("[-1.0, 2.0, 0.0]", "[-1.0, 2.0]"), r"origin \[-1.0, 2.0\] is not"),
        (YAML.replace("-1.0", ".nan"), "origin"),
        (YAML.replace("0.65", "0.1"), "thresholds must obey"),
        (YAML + "mode: raw\n", "mode 'raw'"),
        (YAML.replace("plan.pgm", "nowhere.pgm"), "nowhere.pgm cannot be read"),
        (YAML.replace("plan.pgm", "plan.yaml"), "plan.yaml cannot be read"),
    ],
)
def test_a_bad_plan_is_named(tmp_path, text, message):
    """File, key and value."""
    with pytest.raises(DataError, match=message) as error:
        plan_of(tmp_path, [[0]], text)
    assert "plan.yaml" in str(error.value)


def test_without_pillow_the_extra_is_named(tmp_path, monkeypatch):
    """The library alone has no Pillow; a plan then says what to install."""
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(DataError, match=r'plan\.yaml: .*pip install "modlhmp\[plans\]"'):
        load_floor_plan(tmp_path / "plan.yaml")


def test_the_real_plan(real_data):
    """ATC's plan is imperfect: 30 % of the real tracks touch an occupied cell, fewer come 0.3 m inside."""
    plan = load_floor_plan(real_data / "maps/atc.yaml")
    assert plan.cells.shape == (1200, 2800)
    rows = np.loadtxt(real_data / "atc/atc-20121024-1hz-test.csv", delimiter=",", usecols=(1, 2, 3))
    touches = value_at(plan, plan.cells, rows[:, 1], rows[:, 2]) == OCCUPIED
    deep = value_at(plan, occupied_depth(plan), rows[:, 1], rows[:, 2]) >= 0.3
    people, person = np.unique(rows[:, 0], return_inverse=True)
    shares = [(np.bincount(person, one) > 0).sum() / len(people) for one in (touches, deep)]
    assert shares[0] == pytest.approx(0.30, abs=0.01)
    assert 0 < shares[1] < 0.1
