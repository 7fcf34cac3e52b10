"""Ways out, and the other options of the roll-out: chances by hand, planted doors, velocities, medians."""

import math
from dataclasses import replace

import crowds
import memory_twins
import numpy as np
import pytest

from modlhmp.forecasting import rollout
from modlhmp.forecasting.median import with_median
from modlhmp.forecasting.observe import Observed, current_velocity, observe, velocity_at_t0
from modlhmp.forecasting.rollout import roll_out
from modlhmp.maps import exits
from modlhmp.maps.exits import PRIOR_ROWS, WithExits, with_exits
from modlhmp.methods import make_forecaster
from modlhmp.options import ConstantVelocity, ExitBuilding, RollOut
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.streams import stream_keys, uniforms
from modlhmp.tracks import concatenate, empty_tracks, usable_tracks

STEPS = 12
SITE = Site(velocity="differences", difference_weights=(0.6, 0.3, 0.1), time_step_s=1.0, timezone="UTC")
OPTIONS = RollOut(beta=1.0, speed="constant", velocity="dataset", output="ranked")


class Straight:
    """A MoD that knows the particle's own velocity everywhere and remembers the random numbers it got."""

    def __init__(self, draws=2):
        self.draws, self.given = draws, []

    def sample(self, x, y, speed, heading, t, draws):
        self.given.append(draws.copy())
        return speed, heading, np.full(len(x), -0.5), np.full(len(x), True)


class Swirl(Straight):
    """One whose particles turn at random."""

    def sample(self, x, y, speed, heading, t, draws):
        return speed, heading + draws[:, 0] - 0.5, *super().sample(x, y, speed, heading, t, draws)[2:]


def walkers(n=20, seed=1):
    """Observed rows of random walkers, and keys of four futures each."""
    tracks = crowds.crowd(seed, people=2 * n, most_rows=12, gaps=(1,))
    rows = usable_tracks(tracks, 4)[:n]
    rng = np.random.default_rng(seed)
    speed, heading = rng.uniform(0.5, 1.5, len(tracks.t)), rng.uniform(-3, 3, len(tracks.t))
    observed = observe(tracks._replace(speed=speed, heading=heading), rows, 4)
    return observed, stream_keys(observed.track_id, 4, 0, "hall", "cliff", "day1")


def asked(mod, x, y, speed=1.0, heading=0.0):
    return mod.leaving(*(np.array([float(part)]) for part in (x, y, speed, heading)))[0]


# --- building -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("step_s", "cell_m"), [(1.0, 1.0), (0.5, 2.0), (2.0, 0.7)])
def test_building_equals_the_loop(step_s, cell_m):
    """In every cell and heading bin, rows with one before them, and how many of these are the last of their person."""
    tracks = crowds.crowd(5, people=80, size=5.0, step_s=step_s)
    expected = {}
    for walk in memory_twins.resample(crowds.people_of(tracks), step_s):
        for n in range(1, len(walk)):
            (_, xa, ya), (_, x, y) = walk[n - 1 : n + 1]
            speed, angle = math.hypot(x - xa, y - ya) / step_s, math.atan2(y - ya, x - xa)
            name = (
                math.floor(x / cell_m),
                math.floor(y / cell_m),
                round(angle / (math.pi / 4)) % 8 if speed >= 0.3 else 8,
            )
            left, rows = expected.get(name, (0, 0))
            expected[name] = left + (n == len(walk) - 1), rows + 1
    table = exits.build(tracks, Site(time_step_s=step_s), ExitBuilding(cell_m=cell_m))
    got = {(row["i"], row["j"], row["bin"]): (row["left"], row["rows"]) for row in table.to_pylist()}
    assert got == expected
    assert any(left for left, _ in got.values())


# --- how likely somebody leaves -----------------------------------------------------------------------------


def door():
    """Ways out of eight who walk east along the x axis; six leave in cell 2, two walk on to x = 20."""
    rows = [3] * 6 + [21] * 2
    people = concatenate(crowds.straight(n, (0.5, 0.5), (1, 0), count) for n, count in enumerate(rows))
    return exits.build(people, SITE)


def test_the_chance_by_hand():
    """(left + 10 overall) / (rows + 10); overall 8 leave in 6 * 2 + 2 * 20 rows."""
    mod, overall = WithExits(Straight(), door()), 8 / 52
    assert PRIOR_ROWS == 10
    assert asked(mod, 1.5, 0.5) == pytest.approx((0 + 10 * overall) / (8 + 10))
    assert asked(mod, 2.5, 0.5) == pytest.approx((6 + 10 * overall) / (8 + 10))
    assert asked(mod, 3.5, 0.5) == pytest.approx((0 + 10 * overall) / (2 + 10))
    assert asked(mod, 20.5, 0.5) == pytest.approx((2 + 10 * overall) / (2 + 10))


@pytest.mark.parametrize(
    ("x", "y", "speed", "heading"),
    [
        (0.5, 0.5, 1.0, 0.0),  # nobody's second row
        (2.5, 1.5, 1.0, 0.0),
        (-90.0, 0.5, 1.0, 0.0),
        (2.5, 1e6, 1.0, 0.0),
        (2.5, 0.5, 1.0, math.pi),  # nobody walked west
        (2.5, 0.5, 1.0, 0.5),  # nor north-east
        (2.5, 0.5, 0.1, 0.0),  # nor stood there
    ],
)
def test_where_nobody_was_seen_the_chance_is_the_overall_one(x, y, speed, heading):
    assert asked(WithExits(Straight(), door()), x, y, speed, heading) == pytest.approx(8 / 52)


def test_without_tracks_nobody_leaves():
    assert asked(WithExits(Straight(), exits.build(empty_tracks(), SITE)), 1.0, 2.0) == 0.0


def test_the_chance_of_one_particle_does_not_depend_on_the_others():
    table, rng = exits.build(crowds.crowd(5, people=300, size=5.0), SITE), np.random.default_rng(1)
    mod = WithExits(Straight(), table)
    many = rng.uniform(-2, 11, 300), rng.uniform(-2, 11, 300), rng.uniform(0, 2, 300), rng.uniform(-3, 3, 300)
    whole = mod.leaving(*many)
    assert len(np.unique(whole)) > 5
    for n in range(0, 300, 13):
        assert mod.leaving(*(part[n : n + 1] for part in many)) == whole[n]


# --- a map with ways out ------------------------------------------------------------------------------------


def test_the_map_itself_gets_the_first_numbers_of_the_step():
    """One number more a step is drawn, the last, for leaving."""
    plain = Straight(draws=3)
    mod = WithExits(plain, door())
    assert mod.draws == 4
    observed, keys = walkers()
    roll_out(mod, observed, current_velocity(observed, "as_recorded"), 1, keys)
    np.testing.assert_array_equal(plain.given[0], uniforms(keys.ravel(), 0, 4)[:, :3])


def test_a_particle_leaves_where_its_last_number_is_below_the_chance():
    mod = WithExits(Straight(1), door())
    chance = asked(mod, 2.5, 0.5)
    last = np.array([0.0, chance - 1e-9, chance, chance + 1e-9, 1.0])
    at = np.full((3, 5), [[2.5], [0.5], [1.0]])
    *sampled, found = mod.sample(*at, np.zeros(5), np.zeros(5), np.column_stack([np.full(5, 0.5), last]))
    assert found.tolist() == [False, False, True, True, True]
    np.testing.assert_array_equal(sampled, [[1.0] * 5, [0.0] * 5, [-0.5] * 5])


def test_where_the_map_ends_a_particle_stops_as_without_ways_out():
    class Nowhere(Straight):
        def sample(self, x, y, speed, heading, t, draws):
            return *super().sample(x, y, speed, heading, t, draws)[:3], x < 0

    *_, found = WithExits(Nowhere(1), door()).sample(
        *np.array([[-9.0, 9.0], [0, 0], [1, 1], [0, 0], [0, 0]]), np.ones((2, 2))
    )
    assert found.tolist() == [True, False]


def test_particles_leave_at_the_rate_at_which_people_did():
    """In a corridor where one of 10 leaves after each second: of 2000 after h steps 0.9^h are left."""
    waits = np.ceil(np.log1p(-(np.arange(100) + 0.5) / 100) / np.log1p(-0.1)).astype(int)
    people = ((start, wait) for start in range(-25, 15) for wait in waits)
    walks = concatenate(crowds.straight(n, (x, 0.5), (1, 0), 1 + w) for n, (x, w) in enumerate(people))
    table = exits.build(walks, SITE)
    one = observe(tracks := crowds.straight(9, (-3, 0.5), (1, 0), 5), usable_tracks(tracks, 4), 4)
    keys = stream_keys(one.track_id, 2000, 0, "a", "b", "c")
    got = roll_out(WithExits(Straight(), table), one, (np.ones(1), np.zeros(1)), STEPS, keys)
    share = (got.steps_alive[0, :, None] >= np.arange(1, STEPS + 1)).mean(axis=0)
    np.testing.assert_allclose(share, 0.9 ** np.arange(1, STEPS + 1), atol=0.04)


def test_everyone_leaves_by_a_door_that_everyone_took():
    table = exits.build(concatenate(crowds.straight(n, (0.5, 0.5), (1, 0), 8) for n in range(3000)), SITE)
    one = observe(tracks := crowds.straight(9, (-2.5, 0.5), (1, 0), 5), usable_tracks(tracks, 4), 4)
    keys = stream_keys(one.track_id, 500, 0, "a", "b", "c")
    got = roll_out(WithExits(Straight(), table), one, (np.ones(1), np.zeros(1)), STEPS, keys)
    assert (got.steps_alive <= 7).mean() > 0.97
    assert (got.steps_alive >= 6).mean() > 0.97


def test_exits_of_a_file(tmp_path):
    write_parquet(door(), tmp_path / "exits.parquet")
    mod = with_exits(Straight(), tmp_path / "exits.parquet", SITE)
    np.testing.assert_array_equal(mod.probability, WithExits(Straight(), door()).probability)


# --- the other options of the roll-out ----------------------------------------------------------------------


def by_hand():
    """A walker with last velocities (2, 0), (0, 1) and (1, 1), newest first; the file says otherwise."""
    x, y = np.array([[0.0, 1.0, 1.0, 3.0]]), np.array([[0.0, 1.0, 2.0, 2.0]])
    speed, heading = np.array([[1.0, 1.0, 1.0, 9.0]]), np.full((1, 4), -0.5)
    return Observed(np.array([1]), np.arange(4.0)[None], x, y, speed, heading, np.empty((1, 0, 4, 2)))


def test_velocity_differences_is_a_vector_mean():
    speed, heading = velocity_at_t0(by_hand(), "differences", SITE)
    vector = 0.6 * 2 + 0.1 * 1, 0.3 * 1 + 0.1 * 1
    assert (speed[0], heading[0]) == pytest.approx((math.hypot(*vector), math.atan2(*vector[::-1])))


@pytest.mark.parametrize("source", ["as_recorded", "differences"])
def test_velocity_dataset_is_what_the_dataset_has(source):
    """As in the paper: means of speeds and of headings, of the file's columns where the dataset says so."""
    got = velocity_at_t0(by_hand(), "dataset", replace(SITE, velocity=source))
    assert got == current_velocity(by_hand(), source)
    assert (got[0][0] == pytest.approx(1.0)) == (source == "as_recorded")


def test_one_weight_is_the_last_step():
    speed, heading = velocity_at_t0(by_hand(), "differences", replace(SITE, difference_weights=(7.0,)))
    assert (speed[0], heading[0]) == pytest.approx((2.0, 0.0))


def test_cvm_walks_at_the_velocity_asked_for():
    forecaster = make_forecaster("cvm", ConstantVelocity(velocity="differences"), SITE)
    got = forecaster(by_hand(), 3, np.zeros((1, 1), np.uint64))
    expected = np.array([3.0, 2.0]) + np.arange(1, 4)[:, None] * np.array([1.3, 0.4])
    np.testing.assert_allclose(got.xy[0, 0], expected, atol=1e-5)


@pytest.mark.parametrize("velocity", ["dataset", "differences"])
def test_the_forecaster_of_a_map_hands_on_its_options(velocity):
    observed, keys = walkers()
    options = replace(OPTIONS, beta=0.4, speed="kernel", velocity=velocity)
    site = replace(SITE, velocity="as_recorded", time_step_s=0.5)
    got = rollout.forecaster(Swirl(), site, options)(observed, STEPS, keys)
    start = velocity_at_t0(observed, velocity, site)
    expected = roll_out(Swirl(), observed, start, STEPS, keys, 0.5, 0.4, "kernel")
    np.testing.assert_array_equal(got.xy, expected.xy)
    assert got.output == "ranked"
    other = rollout.forecaster(Swirl(), site, replace(options, beta=3.0))(observed, STEPS, keys)
    assert (other.xy != got.xy).any()


def test_output_geometric_median_is_that_of_the_same_futures():
    """Ways out included: whoever has left does not count."""
    observed, keys = walkers()
    mod = WithExits(Swirl(), exits.build(crowds.crowd(5), SITE))
    ranked = rollout.forecaster(mod, SITE, OPTIONS)(observed, STEPS, keys)
    got = rollout.forecaster(mod, SITE, replace(OPTIONS, output="geometric_median"))(observed, STEPS, keys)
    assert (ranked.output, got.output) == ("ranked", "median")
    for one, other in zip(got, with_median(ranked), strict=True):
        np.testing.assert_array_equal(one, other)
    assert got.steps_alive.min() < STEPS
