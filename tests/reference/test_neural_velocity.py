"""The neural velocity map: planted flows come back, its density is one, and what it cannot know it does not claim."""

import subprocess
import sys

import numpy as np
import pytest
import torch

import modlhmp
from modlhmp import DataError, Site
from modlhmp.maps import density, every_hour
from modlhmp.maps.density import NoMap
from modlhmp.methods import build_map
from modlhmp.networks import neural_velocity, velocity_net
from modlhmp.options import NeuralVelocityBuilding
from modlhmp.storage import column
from modlhmp.tracks import Tracks

SITE = Site(timezone="Asia/Tokyo")
BUILDING = NeuralVelocityBuilding(epochs=15, resolution_m=1.0, radius_m=1.0)
MIDNIGHT = 1351004400.0  # 24 Oct 2012 in Tokyo
EAST_MORNING, EAST_EVENING = 0.9, 0.2  # planted shares of those who walk to the east
SLOW, FAST, SD = 0.9, 1.5, (0.15, 0.1)  # speeds to the east and to the west; SDs of heading and speed


def velocities(n, east, rng):
    """Headings and speeds [n] of a corridor, of whom a share walk to the east."""
    to_east = rng.random(n) < east
    heading = np.where(to_east, 0.0, np.pi) + rng.normal(0, SD[0], n)
    return np.mod(heading + np.pi, 2 * np.pi) - np.pi, np.where(to_east, SLOW, FAST) + rng.normal(0, SD[1], n)


def corridor(persons=600, rows=15, seed=0):
    """Tracks along a corridor of 30 m by 2 m, at 9 and at 18 o'clock; and one stray person far beside it."""
    rng, parts = np.random.default_rng(seed), []
    for person in range(persons):
        morning = person % 2 == 0
        t = MIDNIGHT + 3600.0 * (9 if morning else 18) + 5.0 * (person // 2) + np.arange(rows)
        heading, speed = velocities(rows, EAST_MORNING if morning else EAST_EVENING, rng)
        parts.append((np.full(rows, person), t, rng.uniform(0, 30, rows), rng.uniform(0, 2, rows), speed, heading))
    stray = np.linspace(0, 3, rows)
    t = MIDNIGHT + 3600.0 * 9 + np.arange(rows)
    parts.append((np.full(rows, persons), t, stray, 20 + 0 * stray, np.full(rows, 0.2), np.full(rows, 1.6)))
    return Tracks(*map(np.concatenate, zip(*parts, strict=True)))


@pytest.fixture(scope="module")
def tracks():
    return corridor()


@pytest.fixture(scope="module")
def built(tracks):
    return neural_velocity.build_hours(tracks, SITE, BUILDING)


@pytest.fixture(scope="module")
def no_map(tracks):
    return NoMap(tracks.speed)


def of_hour(built, hour, no_map):
    return density.load("neural_velocity", built[0] if hour is None else built[1][hour], SITE, no_map)


# --- what was planted comes back ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("hour", "east"), [(9, EAST_MORNING), (18, EAST_EVENING)])
def test_new_people_are_as_likely_as_under_what_was_planted(built, no_map, hour, east):
    rng, n = np.random.default_rng(5), 4000
    heading, speed = velocities(n, east, rng)
    x, y, t = rng.uniform(2, 28, n), rng.uniform(0.5, 1.5, n), np.full(n, MIDNIGHT + 3600.0 * hour)
    share, mean = np.where(abs(heading) < np.pi / 2, east, 1 - east), np.where(abs(heading) < np.pi / 2, SLOW, FAST)
    turn = np.mod(heading + np.pi / 2, np.pi) - np.pi / 2
    truth = np.log(share / (2 * np.pi * SD[0] * SD[1])) - 0.5 * ((turn / SD[0]) ** 2 + ((speed - mean) / SD[1]) ** 2)
    found = of_hour(built, hour, no_map).log_density(x, y, t, heading, speed)
    assert (truth - found).mean() == pytest.approx(0, abs=0.06)
    other = of_hour(built, 27 - hour, no_map).log_density(x, y, t, heading, speed)
    assert (found - other).mean() > 0.5  # the other hour's map says otherwise


def test_the_whole_day_is_between_its_hours(built):
    def east(table):
        there = (abs(column(table, "y") - 1) < 1.5) & (abs(column(table, "x") - 15) < 10)
        right = abs(column(table, "mean_heading")) < np.pi / 2
        return column(table, "weight")[there & right].sum() / column(table, "weight")[there].sum()

    whole, hours = built
    assert sorted(hours) == [9, 18]
    assert east(hours[9]) == pytest.approx(EAST_MORNING, abs=0.06)
    assert east(hours[18]) == pytest.approx(EAST_EVENING, abs=0.06)
    assert east(whole) == pytest.approx((EAST_MORNING + EAST_EVENING) / 2, abs=0.08)


def test_locations_and_counts_are_those_of_a_cliff_map(tracks, built):
    whole, hours = built
    like = modlhmp.build_map("cliff", tracks, SITE).whole

    def places(table):
        return {(x, y): n for x, y, n in zip(*(column(table, name) for name in ("x", "y", "count")), strict=True)}

    assert places(whole) == places(like)
    assert {place: sum(places(table)[place] for table in hours.values()) for place in places(like)} == places(like)
    assert column(whole, "p").max() == 1


# --- a density ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hour", [None, 9, 18])
def test_density_integrates_to_one(built, no_map, hour):
    """At 50 places, over one turn and all speeds up to 5 m/s (the background has a hair beyond)."""
    table = built[0] if hour is None else built[1][hour]
    places = np.unique(np.column_stack([column(table, "x"), column(table, "y")]), axis=0)
    places = places[np.linspace(0, len(places) - 1, 50).astype(int)]
    heading, speed = np.linspace(-np.pi, np.pi, 240, endpoint=False), np.arange(0.0125, 5, 0.025)
    grid = np.stack(np.meshgrid(heading, speed), -1).reshape(-1, 2)
    cell = (2 * np.pi / 240) * 0.025
    one = of_hour(built, hour, no_map)
    for x, y in places:
        n = len(grid)
        p = np.exp(one.log_density(np.full(n, x), np.full(n, y), np.zeros(n), *grid.T))
        assert p.sum() * cell == pytest.approx(1, abs=0.01)


def test_the_table_says_what_the_network_says():
    """The density that was trained is the density that is written, but for the speeds below 0 (under 1 %)."""
    torch.manual_seed(3)
    network = velocity_net.VelocityNet(4, 3, 16, 3).eval()
    with torch.no_grad():
        for weights in network.parameters():
            weights.add_(0.5 * torch.randn_like(weights))
        network.seen[:] = 100.0
    rng, n = np.random.default_rng(0), 500
    heading, speed = rng.uniform(-np.pi, np.pi, n), rng.uniform(0.05, 2.5, n)
    places = np.array([[0.0, 0.0], [10.0, 0.0]])
    no_map, which = NoMap(speed), rng.integers(0, 2, n)
    nodes, shares = torch.tensor([[0, 1, 2, 3], [3, 2, 1, 0]]), torch.tensor([[0.1, 0.2, 0.3, 0.4]] * 2)
    clock = torch.from_numpy(velocity_net.clock_of(np.array([9.5, 9.5])))
    columns = (
        shares[which],
        clock[which],
        heading,
        speed,
        no_map.log_density(heading, heading, heading, heading, speed),
    )
    rows = velocity_net.Rows(nodes[which], *(torch.as_tensor(one).float() for one in columns))
    with torch.no_grad():
        mixture = network(nodes, shares, clock)
        trained = velocity_net.log_density(network(rows.nodes, rows.shares, rows.clock), rows).numpy()
    of = every_hour.Walked(None, np.zeros(2), [], places, [np.arange(2)] * 2, {None: 1})
    table = every_hour.table(
        of, NeuralVelocityBuilding(), None, *neural_velocity._components(*(part.double().numpy() for part in mixture))
    )
    x, y = places[which].T
    written = density.load("neural_velocity", table, SITE, no_map).log_density(x, y, x, heading, speed)
    assert np.abs(written - trained).max() < 0.011


def test_where_nobody_walked_the_background_takes_over(built, tracks, no_map):
    """Where one person strayed, against the corridor; and at nodes without rows."""
    x, y, background = (column(built[0], name) for name in ("x", "y", "background"))
    inside = (y == 1) & (x > 0) & (x < 30)
    assert background[inside].max() < 0.1
    assert background[y > 10].min() > background[inside].max()
    node = torch.zeros(400, 4, dtype=torch.int64)  # rows are at the first node only
    rng = np.random.default_rng(0)
    heading, speed = velocities(400, 1.0, rng)
    columns = (
        np.full((400, 4), 0.25), velocity_net.clock_of(np.full(400, 9.0)), heading, speed,
        no_map.log_density(speed, speed, speed, heading, speed),
    )  # fmt: skip
    rows = velocity_net.Rows(node, *(torch.from_numpy(np.asarray(one, np.float32)) for one in columns))
    network = velocity_net.train(
        rows, np.arange(400) // 10, 10, {"features": 8, "width": 32, "components": 3}, epochs=60, seed=0
    )
    with torch.no_grad():
        said = torch.sigmoid(network(torch.tensor([[0] * 4, [5] * 4]), rows.shares[:2], rows.clock[:2]).background)
    assert said[0] < 0.1
    assert said[1] > 0.99


# --- as a map among others ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("flushed", [False, True])
def test_building_leaves_torch_as_it_was(tracks, flushed):
    """Its threads, and whether numbers below 1e-38 are zero, also where building fails."""
    threads, some = torch.get_num_threads(), tracks.take(tracks.track_id < 60)
    try:
        torch.set_num_threads(2)
        torch.set_flush_denormal(flushed)
        modlhmp.build_map("neural_velocity", some, SITE, epochs=1)
        with pytest.raises(AttributeError):
            velocity_net.train(None, np.empty(0), 1, {}, 1, 0)
        assert torch.get_num_threads() == 2
        assert (torch.tensor(1e-40).mul(1.0).item() == 0) == flushed
    finally:
        torch.set_num_threads(threads)
        torch.set_flush_denormal(False)


def test_same_rows_give_the_same_map_to_the_last_bit(tracks):
    """Whatever was drawn before; and the random numbers of others go on as if nothing had been."""
    some = tracks.take(tracks.track_id < 60)
    building = NeuralVelocityBuilding(epochs=3)
    torch.manual_seed(1)
    expected = torch.rand(3)
    torch.manual_seed(1)
    first = neural_velocity.build_hours(some, SITE, building)
    assert torch.equal(torch.rand(3), expected)
    again = neural_velocity.build_hours(some, SITE, building)
    assert first[0].equals(again[0])
    assert all(table.equals(again[1][hour]) for hour, table in first[1].items())
    other = neural_velocity.build_hours(some, SITE, NeuralVelocityBuilding(epochs=3, seed=1))
    assert not first[0].equals(other[0])


def test_it_forecasts_along_the_flow_of_the_hour_and_is_read_without_torch(tracks, built, tmp_path):
    whole, hours = built
    modlhmp.Map("neural_velocity", SITE, whole, hours).save(tmp_path / "map")
    ask = f"""
import sys
sys.modules["torch"] = None  # whoever imports it fails
import numpy as np, modlhmp
a_map = modlhmp.load_map({str(tmp_path / "map")!r})
for hour in (9, 18):
    t = {MIDNIGHT} + 3600.0 * hour + np.arange(4)
    x = 15 + 0.1 * (-1) ** np.arange(4)  # to and fro: no direction of their own
    seen = np.column_stack([t, x, np.full(4, 1.0)])
    futures = modlhmp.forecast(a_map, seen, 5.0, k=200, beta=0.0, velocity="differences")
    x = futures.forecast.xy[0, :, :2, 0]
    print((x[:, 1] > x[:, 0]).mean())  # the first step goes on, the second follows the map
"""
    said = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True).stdout.split()
    morning, evening = map(float, said)
    assert morning == pytest.approx(EAST_MORNING, abs=0.1)
    assert evening == pytest.approx(EAST_EVENING, abs=0.1)


def test_an_hour_without_rows_has_no_map(tracks):
    site = Site(timezone="Asia/Tokyo", hours=(9, 12))
    some = tracks.take(tracks.track_id < 60)
    _, hours = neural_velocity.build_hours(some, site, NeuralVelocityBuilding(epochs=1))
    assert sorted(hours) == [9]


# --- bad input ------------------------------------------------------------------------------------------------------


def test_too_few_persons_are_refused(tracks):
    few = tracks.take(tracks.track_id < 9)
    with pytest.raises(DataError, match=r"needs 10 persons who move, .*recordings have 9"):
        neural_velocity.build_hours(few, SITE)


def in_pieces(tracks):
    """The same rows, every person's later half being a track of its own; and whose each row is."""
    begin = tracks.t[tracks.bounds()[:-1]]
    later = tracks.t - np.repeat(begin, np.diff(tracks.bounds())) > 6
    both = tracks._replace(track_id=tracks.track_id + 10_000 * later)
    order = np.argsort(both.track_id, kind="stable")
    return both.take(order), tracks.track_id[order]


def test_who_was_cut_into_pieces_is_one_person(tracks):
    """Trained on or held out as a whole: the map is that of the uncut tracks; and one of the ten that are needed."""
    building, some = NeuralVelocityBuilding(epochs=2), tracks.take(tracks.track_id < 60)
    cut, person = in_pieces(some)
    found, like = (
        build_map("neural_velocity", *one) for one in ((cut, SITE, building, person), (some, SITE, building))
    )
    assert found[0].equals(like[0])
    assert all(table.equals(like[1][hour]) for hour, table in found[1].items())
    assert not build_map("neural_velocity", cut, SITE, building)[0].equals(like[0])
    cut, person = in_pieces(tracks.take(tracks.track_id < 9))
    with pytest.raises(DataError, match="recordings have 9"):
        build_map("neural_velocity", cut, SITE, building, person)


def test_those_who_stand_and_rows_without_a_velocity_do_not_count(tracks):
    building, some = NeuralVelocityBuilding(epochs=1), tracks.take(tracks.track_id < 60)
    nan, zero = np.full(len(some.t), np.nan), np.zeros(len(some.t))
    wider = [some._replace(track_id=some.track_id + 1000, x=some.x + 100, speed=zero),
             some._replace(track_id=some.track_id + 2000, y=some.y + 100, heading=nan)]  # fmt: skip
    both = Tracks(*map(np.concatenate, zip(some, *wider, strict=True)))
    assert neural_velocity.build_hours(both, SITE, building)[0].equals(
        neural_velocity.build_hours(some, SITE, building)[0]
    )
    with pytest.raises(DataError, match="have 0"):
        neural_velocity.build_hours(wider[0], SITE)


def test_components_far_from_each_other_never_lose_their_density():
    """A velocity that no component explains costs no more than the background: no infinity, no NaN in the gradient."""
    network = velocity_net.VelocityNet(1, 2, 8, 2)
    with torch.no_grad():
        network.layers[-1].bias[-1] = -30.0  # hardly any background
    velocity = torch.tensor([3.0]), torch.tensor([60.0])
    rows = velocity_net.Rows(
        torch.zeros(1, 4, dtype=torch.int64),
        torch.full((1, 4), 0.25),
        torch.zeros(1, 6),
        *velocity,
        torch.tensor([-20.0]),
    )
    loss = network.loss(rows)
    loss.backward()
    assert 20 < float(loss) < 60
    assert all(torch.isfinite(one.grad).all() for one in network.parameters())
