"""What a path costs against the flow: published costs on flows that are known, and people met as in a simulation."""

import re

import numpy as np
import pyarrow as pa
import pytest

import modlhmp
from modlhmp import DataError, Site
from modlhmp.contract import SITE, crowd
from modlhmp.maps.cliff import COLUMNS


def cliff_map(*components, people=None, resolution=1.0, kind="cliff", nodes=21):
    """A map that is the same at every node of a square: components are (weight, heading, speed, vtt, vtr, vrr)."""
    rows = []
    for place, (x, y) in enumerate((i, j) for i in range(nodes) for j in range(nodes)):
        rows += [(place, x * resolution, y * resolution, *one, 0, 0.5, 1) for one in components]
    table = pa.table(dict(zip(COLUMNS, np.array(rows, float).T, strict=True)))
    metadata = {"resolution": str(resolution), "radius": str(resolution)}
    table = table.replace_schema_metadata(metadata | ({} if people is None else {"busiest": str(people)}))
    return modlhmp.Map(kind, Site(), *((table, {}) if kind == "cliff" else (None, {9: table})))


EAST = (1.0, 0.0, 1.2, 0.01, 0.0, 0.04)
WEST = (1.0, np.pi, 1.2, 0.01, 0.0, 0.04)
P = 0.5


def refused(message, *arguments, **named):
    with pytest.raises(DataError, match=message):
        modlhmp.path_cost(*arguments, **named)


@pytest.mark.parametrize(("way", "each"), [((10, 0), 0), ((-10, 0), 2), ((0, 10), 1), ((5, 5), 1 - np.sqrt(0.5))])
def test_upstream_is_nothing_along_the_flow_and_two_a_metre_against_it(way, each):
    start = np.array([10.0, 10.0]) - np.array(way) / 2
    cost = modlhmp.path_cost(cliff_map(EAST), [start, start + way])
    length = np.hypot(*way)
    assert cost.length_m == pytest.approx(length)
    assert cost.total("upstream") == pytest.approx(P * each * length, abs=1e-9)
    assert cost.mapped_share == 1


def test_upstream_of_two_ways():
    """Weights count: a quarter comes towards the robot."""
    both = cliff_map((0.75, *EAST[1:]), (0.25, *WEST[1:]))
    assert modlhmp.path_cost(both, [(5, 10), (15, 10)]).total("upstream") == pytest.approx(P * 0.25 * 2 * 10)


@pytest.mark.parametrize(
    ("speed", "turn", "distance"),
    [(1.2, 0.0, 0.0), (1.6, 0.0, 2.0), (1.2, 0.3, 3.0), (1.6, 0.3, np.sqrt(13)), (1.2, np.pi, 10.0)],
)
def test_down_the_cliff_is_the_mahalanobis_distance(speed, turn, distance):
    """Deviations of 0.1 rad and 0.2 m/s; it is limited, and headings are wrapped."""
    for mean in (0.0, 3.1, -3.1):
        flow = cliff_map((1.0, mean, *EAST[2:]))
        way = 6 * np.array([np.cos(mean + turn), np.sin(mean + turn)])
        cost = modlhmp.path_cost(flow, [(10, 10), way + 10], speed)
        assert cost.total("down_the_cliff") == pytest.approx(P * distance * 6, abs=1e-6)


def test_down_the_cliff_with_a_covariance():
    covariance = np.array([[0.09, 0.03], [0.03, 0.05]])
    flow = cliff_map((1.0, 0.0, 1.0, 0.09, 0.03, 0.05))
    away = np.array([0.2, -0.3])
    way = 6 * np.array([np.cos(away[0]), np.sin(away[0])])
    cost = modlhmp.path_cost(flow, [(10, 10), way + 10], 1.0 + away[1])
    wanted = np.sqrt(away @ np.linalg.inv(covariance) @ away)
    assert cost.total("down_the_cliff") == pytest.approx(P * wanted * 6)


def test_costs_do_not_depend_on_how_a_path_is_cut():
    flow = cliff_map((0.6, 0.3, 1.1, 0.2, 0.01, 0.05), (0.4, 2.5, 0.9, 0.4, 0.0, 0.1), people=0.3)
    ends = np.array([[1.0, 2.0], [17.0, 13.0]])
    cut = ends[0] + np.linspace(0, 1, 73)[:, None] ** 2 * (ends[1] - ends[0])
    once, often = (modlhmp.path_cost(flow, path) for path in (ends, np.repeat(cut, 2, axis=0)))
    for name in ("upstream", "down_the_cliff", "people"):
        assert once.total(name) == pytest.approx(often.total(name))
    assert once.time_s == pytest.approx(often.time_s)


def met_in_a_simulation(density, walk, way, speed, width, rng):
    """How many of people who are scattered evenly and walk alike come within half a width of the robot's middle line.

    In the robot's frame they move by the difference of the velocities, so those are met who start in the strip that a
    line of the robot's width sweeps: here they are walked through, step by step.
    """
    length = np.hypot(*way)
    seconds, robot = length / speed, speed * np.array(way) / length
    side = 60.0
    people = rng.uniform(-side, side, (rng.poisson(density * (2 * side) ** 2), 2))
    relative = np.array(walk) - robot
    ahead = relative / np.hypot(*relative)
    along, across = people @ ahead, people @ np.array([-ahead[1], ahead[0]])
    reached = (-along >= 0) & (-along <= np.hypot(*relative) * seconds)
    return ((np.abs(across) <= width / 2) & reached).sum()


@pytest.mark.parametrize("way", [(12, 0), (-12, 0), (0, 12), (8, -8)])
def test_people_met_are_those_of_a_simulation(way):
    people, speed, width = 2.0, 0.8, 1.0  # 2 within the radius of the busiest location, half as many here
    flow = cliff_map((1.0, 0.0, 1.2, 1e-3, 0.0, 1e-3), people=people)
    start = np.array([10.0, 10.0]) - np.array(way) / 2
    cost = modlhmp.path_cost(flow, [start, start + way], speed, width_m=width, delay_s=3)
    rng = np.random.default_rng(0)
    met = [met_in_a_simulation(P * people / np.pi, (1.2, 0), way, speed, width, rng) for _ in range(1500)]
    assert cost.total("people") == pytest.approx(np.mean(met), abs=4 * np.std(met) / np.sqrt(len(met)) + 0.01)
    assert cost.time_s == pytest.approx(np.hypot(*way) / speed + 3 * cost.total("people"))
    assert cost.free_s == pytest.approx(np.hypot(*way) / speed)


def test_nobody_is_met_where_the_map_knows_nobody():
    cost = modlhmp.path_cost(cliff_map(WEST, people=1.0), [(10.5, 10), (30.5, 10)])
    assert cost.mapped_share == pytest.approx(0.5, abs=0.02)
    assert cost.upstream[~cost.mapped].max() == cost.people[~cost.mapped].max() == 0
    assert cost.total("upstream") == pytest.approx(P * 2 * cost.length[cost.mapped].sum())


def test_a_map_that_does_not_say_how_many_people_there_are():
    path = [(5, 10), (15, 10)]
    cost = modlhmp.path_cost(cliff_map(WEST), path)
    assert np.isnan(cost.time_s)
    assert np.isfinite(cost.total("upstream"))
    said, known = (
        modlhmp.path_cost(cliff_map(WEST), path, people=0.7),
        modlhmp.path_cost(cliff_map(WEST, people=0.7), path),
    )
    assert said.time_s == known.time_s > cost.free_s


def test_a_map_without_speeds_takes_no_people(caplog):
    """Whoever meets a robot is known by the speeds, so that there is no time however many there are."""
    stef, path, at = modlhmp.build_map("stef", crowd(), SITE), [(-8, 0), (8, 0)], 1.3e9 + 1800
    refused("people 3.0: a map of kind stef has no speeds, so no time; leave it out", stef, path, 1.2, at, people=3.0)
    assert np.isnan(modlhmp.path_cost(stef, path, 1.2, at).time_s)
    assert "a map of kind stef has no speeds, so no time" in caplog.text and "give `people`" not in caplog.text


def test_maps_that_were_built(tmp_path):
    """People go both ways along y = 0: maps by hours and STeF-maps cost alike."""
    maps = {kind: modlhmp.build_map(kind, crowd(), SITE) for kind in ("cliff", "tc_cliff", "stef")}
    at = 1.3e9 + 1800
    along, across = [(-8, 0), (8, 0)], [(0, -2), (0, 2)]
    for kind, a_map in maps.items():
        when = None if kind == "cliff" else at
        one, other = (modlhmp.path_cost(a_map, path, 1.2, when) for path in (along, across))
        assert one.total("upstream") / one.length[one.mapped].sum() > 0.2
        assert one.mapped_share > 0.9
        assert np.isnan(one.total("down_the_cliff")) == (kind == "stef")
        assert np.isfinite(one.time_s) == (kind != "stef")
        assert other.length_m == pytest.approx(4)
        one.draw(tmp_path / f"{kind}.png")
        assert (tmp_path / f"{kind}.png").stat().st_size > 10_000
    whole = maps["cliff"]
    seen = crowd()
    within = np.hypot(seen.x, seen.y) <= 1  # of the location at the origin, about the busiest
    steps = len(np.unique(np.floor(seen.t)))
    assert float(whole.whole.schema.metadata[b"busiest"]) == pytest.approx(within.sum() / steps, rel=0.2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([(0, 0)],), "path of shape .1, 2.: give .n, 2."),
        (([(0, 0), (0, np.nan)],), "all finite"),
        (([(1, 1), (1, 1)],), "all points are the same"),
        (([(0, 0), (9e9, 0)],), "are x and y in m"),
        (("here",), "path: give numbers"),
        (([(0, 0), (1, 1)], 0), "speed_m_s 0: give a number above 0"),
        (([(0, 0), (1, 1)], "1"), "speed_m_s '1': give a number above 0"),
        (([(0, 0), (1, 1)], [1]), r"speed_m_s \[1\]: give a number above 0"),
    ],
)
def test_what_is_no_path(arguments, message):
    refused(message, cliff_map(EAST), *arguments)


@pytest.mark.parametrize("name", ["people", "delay_s"])
@pytest.mark.parametrize("value", [-1, np.nan, np.inf, "3", [1, 2]])
def test_people_and_delays_are_no_less_than_none(name, value):
    refused(f"path_cost: {name} .*: give a number of at least 0", cliff_map(EAST), [(0, 0), (1, 1)], **{name: value})


def test_a_path_that_the_map_hardly_knows_is_told(tmp_path, caplog):
    """Costs of 0 and times without a number look like a free way."""
    flow = cliff_map(WEST, people=1.0)
    modlhmp.path_cost(flow, [(5, 10), (25, 10)])
    assert not caplog.messages
    for path, share in (([(15.5, 10), (35.5, 10)], "26 %"), ([(100, 10), (120, 10)], "0 %")):
        modlhmp.path_cost(flow, path)
        assert f"the map knows {share} of the path; where it knows nobody, costs are 0" in caplog.messages[-1]
    caplog.clear()
    modlhmp.path_cost(cliff_map(WEST), [(5, 10), (15, 10)])
    assert "the map does not say how many people there are, so no time: give `people`" in caplog.messages[-1]


def test_what_the_map_does_not_know_is_drawn_apart(tmp_path, monkeypatch):
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    from modlhmp import pictures  # noqa: PLC0415

    drawn = []
    monkeypatch.setattr(pictures, "save", lambda figure, path: drawn.append(figure))
    cost = modlhmp.path_cost(cliff_map(WEST, people=1.0), [(10.5, 10), (30.5, 10)])
    cost.draw(tmp_path / "path.png")
    ax = drawn[0].axes[0]
    (known,) = (one for one in ax.collections if isinstance(one, LineCollection))
    (unknown,) = (one for one in ax.lines if one.get_linestyle() == "--")
    assert len(known.get_segments()) == len(known.get_array()) == cost.mapped.sum()
    (flow,) = (one for one in ax.collections if hasattr(one, "XY"))
    assert ax.get_xlim()[1] > (flow.XY[:, 0] + flow.U).max(), "arrows are whole"
    assert ax.get_ylim()[1] > flow.XY[:, 1].max(), "and those that are far away are left out"
    assert np.isfinite(unknown.get_xdata()).sum() == (~cost.mapped).sum() > 0
    assert np.nanmin(unknown.get_xdata()) > max(x for segment in known.get_segments() for x in segment[:, 0])


def test_a_cost_that_there_is_not():
    cost = modlhmp.path_cost(cliff_map(EAST), [(5, 10), (15, 10)])
    with pytest.raises(DataError, match="no cost named 'upsteam'; did you mean 'upstream'"):
        cost.total("upsteam")


def test_what_has_no_flow():
    path = [(0, 0), (1, 1)]
    refused("a map of kind exits holds no flows", modlhmp.build_map("exits", crowd(), SITE), path)
    refused("give a Map", "cliff", path)
    refused("is by hours: give the time", cliff_map(EAST, kind="tc_cliff"), path)
    refused("in hour 0, of which there is no map; there are .9.", cliff_map(EAST, kind="tc_cliff"), path, t=0)
    assert modlhmp.path_cost(cliff_map(EAST, kind="tc_cliff"), path, t=9 * 3600).mapped_share == 1
    for t in (np.nan, np.inf, 1e20, -1e20, 10**400, 1.35e12, "now", [0.0], True):
        refused(f"t {re.escape(repr(t))}: give a time in unix s", cliff_map(EAST, kind="tc_cliff"), path, t=t)
    refused("of which there is no map", cliff_map(EAST, kind="tc_cliff"), path, t=-9e10)
