"""Episode maps: what they find against brute force, replay against its plain twin, and planted walks."""

import functools

import crowds
import memory_twins
import numpy as np
import pytest

from modlhmp.forecasting.observe import observe
from modlhmp.forecasting.replay import replay
from modlhmp.maps import episodes
from modlhmp.maps.episodes import EpisodeMap
from modlhmp.maps.pieces import Metric, features
from modlhmp.methods import make_forecaster
from modlhmp.options import Episodes
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.streams import stream_keys
from modlhmp.tracks import clock_time, concatenate, empty_tracks, usable_tracks

METRIC = Metric(8.0, 8.0, 2.0, 0.0)
WEIGHTS = [0.48, 0.33, 0.19]
PAST = 3
STEPS = 12


def map_of(tracks, step_s=1.0, metric=METRIC, weights=WEIGHTS):
    return EpisodeMap(episodes.build(tracks, Site(time_step_s=step_s)), metric, weights, PAST, step_s, "UTC")


def walker(start, velocity, track_id=900, began=0.0, step_s=1.0):
    """One who is seen at four rows at constant velocity, the last of them at `start`."""
    first = np.array(start) - 3 * step_s * np.array(velocity)
    return observed(crowds.straight(track_id, first, velocity, 5, began, step_s))


def observed(tracks):
    return observe(tracks, usable_tracks(tracks, PAST + 1), PAST + 1)


def seen(walkers, n):
    return list(zip(walkers.t[n], walkers.x[n], walkers.y[n], strict=True))


def take(walkers, rows):
    return walkers._replace(**{name: part[rows] for name, part in walkers._asdict().items()})


def constant(walkers, n, steps=STEPS, step_s=1.0, weights=WEIGHTS):
    """Path at constant velocity, the vector mean of the last steps."""
    velocity = memory_twins.mean_velocity(memory_twins.seen_velocities(seen(walkers, n)), weights)
    return np.array(seen(walkers, n)[-1][1:]) + step_s * np.arange(1, steps + 1)[:, None] * np.array(velocity)


@functools.cache
def training(step_s=1.0):
    return crowds.crowd(11, people=120, size=7.0, most_rows=16, gaps=(1, 1, 1, 2), step_s=step_s)


@functools.cache
def walkers(step_s=1.0):
    return observed(crowds.crowd(12, people=25, size=7.0, most_rows=12, gaps=(1,), step_s=step_s))


@functools.cache
def default_map():
    return map_of(training())


# --- the map ------------------------------------------------------------------------------------------------


def test_the_map_holds_everybodys_rows():
    table = episodes.build(training(), Site(time_step_s=0.5))
    expected = memory_twins.resample(crowds.people_of(training()), 0.5)
    got = memory_twins.rows_of(table)
    assert [len(walk) for walk in got] == [len(walk) for walk in expected]
    for one, other in zip(got, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-5)


def test_only_rows_with_a_past_and_a_future_can_be_found():
    """Of a person of n rows the fourth to the last but one."""
    tracks = concatenate(crowds.straight(n, (n, 0), (1, 0), rows) for n, rows in enumerate([2, 4, 5, 7]))
    mod = map_of(tracks)
    assert mod.person[mod.rows].tolist() == [2, 3, 3, 3]
    assert (mod.rows - np.array([6, 11, 11, 11])).tolist() == [3, 3, 4, 5]
    np.testing.assert_allclose(mod.speed[mod.rows], 1.0, atol=1e-5)


@pytest.mark.parametrize("hour_m", [0.0, 5.0])
def test_the_nearest_are_those_of_brute_force(hour_m):
    metric = METRIC._replace(hour_m=hour_m)
    mod, table = map_of(training(), metric=metric), episodes.build(training(), Site())
    people = memory_twins.rows_of(table)
    rng = np.random.default_rng(1)
    asked = rng.uniform(0, 7, (40, 2)), rng.normal(0, 0.5, (40, 3, 2))
    points, _ = features(*asked, WEIGHTS, metric, np.full(40, 12.0))
    rows, distance = mod.nearest(points, 20)
    pieces = []
    for walk in people:
        for n in range(PAST, len(walk) - 1):
            before = memory_twins.velocities([row[1:] for row in walk[n - PAST : n + 1]], 1.0)
            hour = clock_time(np.array([walk[n][0]]), "UTC")[0]
            pieces.append(memory_twins.point(walk[n][1:], before, WEIGHTS, metric, hour)[0])
    away = np.sqrt(((points[:, None] - np.array(pieces)) ** 2).sum(axis=-1))
    assert away.shape == (40, len(mod.rows))
    np.testing.assert_allclose(distance, np.sort(away, axis=1)[:, :20], atol=1e-5)
    np.testing.assert_array_equal(np.searchsorted(mod.rows, rows), np.argsort(away, axis=1)[:, :20])


def test_fewer_than_asked_for_are_found_where_there_are_fewer():
    mod = map_of(crowds.straight(1, (0, 0), (1, 0), 7))
    rows, distance = mod.nearest(np.zeros((4, 8)), 200)
    assert rows.shape == distance.shape == (4, 3)


# --- replay against its twin --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"pace": 0.0},
        {"pace": 0.5, "k": 3},
        {"k": 1},
        {"reach_m": 2.0},
        {"exclude_s": 12.0},
        {"metric": Metric(3.0, 1.0, 4.0, 600.0)},
        {"weights": [1.0]},
        {"step_s": 0.5},
        {"step_s": 2.0, "k": 5},
        {"of_pieces": True},
        {"of_pieces": True, "k": 2, "reach_m": 2.0, "exclude_s": 12.0},
    ],
    ids=str,
)
def test_replay_equals_the_plain_one(options):
    """Walker by walker: whose pieces, who is still there at each second, where they are, and the samples."""
    options = {"metric": METRIC, "weights": WEIGHTS, "step_s": 1.0, "k": 7, "pace": 1.0, "reach_m": 4.0, **options}
    metric, weights, step_s, k = (options.pop(name) for name in ("metric", "weights", "step_s", "k"))
    asking = walkers(step_s)
    mod = map_of(training(step_s), step_s, metric, weights)
    people = memory_twins.rows_of(episodes.build(training(step_s), Site(time_step_s=step_s)))
    got = replay(mod, asking, STEPS, step_s, k, **options)
    assert got.output == "median"
    assert got.xy.shape == (len(asking.t), 1 + 4 * k, STEPS, 2)
    assert not got.log_fitness.any()

    def hours(t):
        return t % 86400 / 3600

    followed = 0
    for n in range(len(asking.t)):
        expected = memory_twins.replay(people, seen(asking, n), STEPS, step_s, k, weights, metric, hours, **options)
        if expected is None:
            assert not got.steps_alive[n].any()
            straight = constant(asking, n, STEPS, step_s, weights)
            np.testing.assert_allclose(got.xy[n], np.broadcast_to(straight, got.xy[n].shape), atol=1e-4)
            continue
        followed += 1
        for path, life, (plain, samples) in [
            (got.xy[n, 0], got.steps_alive[n, 0], (expected[0], None)),
            *((got.xy[n, 1 + j], got.steps_alive[n, 1 + j], (one, j)) for j, one in enumerate(expected[1])),
        ]:
            places, alive = memory_twins.held(plain, seen(asking, n)[-1][1:])
            assert life == alive, samples
            np.testing.assert_allclose(path, places, atol=2e-3)
    assert followed >= 5


# --- planted walks ------------------------------------------------------------------------------------------


def corner(track_id, speed=1.0, began=0.0, legs=(10.0, 10.0)):
    """East along the x axis to the corner, then north."""
    times = np.arange(0.0, sum(legs) / speed + 1e-9)
    s = speed * times
    return crowds.walk(track_id, began + times, np.column_stack([np.minimum(s, legs[0]), np.maximum(s - legs[0], 0.0)]))


def test_a_walker_turns_where_everyone_did():
    mod = map_of(concatenate(corner(n, began=n) for n in range(10)))
    got = replay(mod, walker((5, 0), (1, 0)), 12, 1.0, 5, 1.0, 10.0)
    expected = [(5 + min(s, 5), max(s - 5, 0)) for s in range(1, 13)]
    np.testing.assert_allclose(got.xy[0, 0], expected, atol=0.02)
    assert (got.steps_alive == 12).all()


@pytest.mark.parametrize(
    ("pace", "speed", "factor"), [(1.0, 1.5, 1.5), (0.0, 1.5, 1.0), (0.5, 1.44, 1.2), (1.0, 0.25, 0.5), (1.0, 3.0, 2.0)]
)
def test_a_path_is_walked_at_the_walkers_own_pace(pace, speed, factor):
    """Everyone walks at 1 m/s; pace 0 keeps that, 1 is the walker's, within half and twice."""
    mod = map_of(concatenate(corner(n, began=n, legs=(20.0, 20.0)) for n in range(10)))
    got = replay(mod, walker((5, 0), (speed, 0)), 10, 1.0, 5, pace, 100.0)
    gone = factor * np.arange(1, 11)
    expected = np.column_stack([5 + np.minimum(gone, 15), np.maximum(gone - 15, 0)])
    np.testing.assert_allclose(got.xy[0, 0], expected, atol=0.03)


@pytest.mark.parametrize(("own", "others"), [(0.15, 1.0), (1.0, 0.15)])
def test_whoever_hardly_moves_has_no_pace(own, others):
    mod = map_of(concatenate(crowds.straight(n, (0, 0.01 * n), (others, 0), 40) for n in range(5)))
    got = replay(mod, walker((2, 0), (own, 0)), 5, 1.0, 5, 1.0, 100.0)
    np.testing.assert_allclose(got.xy[0, 0, :, 0], 2 + others * np.arange(1, 6), atol=0.02)


def test_a_person_has_one_vote():
    """One stands about for ages, a hundred pieces just like the walker's; three walk off."""
    lingering = crowds.walk(1, np.arange(100.0), np.full((100, 2), 5.0))
    leaving = [
        crowds.walk(2 + n, np.arange(20.0), [(5.0, 5.0)] * 6 + [(5.0 + s, 5.0) for s in range(1, 15)]) for n in range(3)
    ]
    mod = map_of(concatenate([lingering, *leaving]))
    got = replay(mod, walker((5, 5), (0, 0)), 10, 1.0, 25, 1.0, 10.0)
    assert (got.steps_alive[0, 0], got.steps_alive.shape[1]) == (10, 101)
    assert got.xy[0, 0, -1, 0] > 10.0


def test_of_those_who_are_there_now_most_linger():
    """One stands about for 100 s, ten for 5: who is met standing is going to stay, although most who stood did not."""
    lingering = crowds.walk(1, np.arange(100.0), np.full((100, 2), 5.0))
    leaving = [
        crowds.walk(2 + n, np.arange(8.0), [(5.0, 5.0)] * 5 + [(5.0 + 2 * s, 5.0) for s in range(1, 4)])
        for n in range(10)
    ]
    mod, one = map_of(concatenate([lingering, *leaving])), walker((5, 5), (0, 0))
    pieces = [96.0, 10 * 2.0]  # rows with three before them, all at the same place: of the one, and of the ten
    for of_pieces, stay in ((True, pieces[0] / sum(pieces)), (False, 1 / 11)):
        got = replay(mod, one, 3, 1.0, 25, 1.0, 0.1, 0.0, of_pieces)
        assert (got.xy[0, 1:, -1, 0] < 5.1).mean() == pytest.approx(stay, abs=0.05)
    ours, theirs = (replay(mod, one, 3, 1.0, 25, 1.0, 10.0, 0.0, of_pieces) for of_pieces in (True, False))
    np.testing.assert_array_equal(ours.results.xy, theirs.results.xy)


def test_the_nearest_who_are_still_there_vote():
    """The two nearest leave after two seconds; then the next two count, although k is 2."""
    near = [crowds.straight(n, (0, 0.01 * n), (1, 0), 8) for n in range(2)]  # at x = 5 after 5 s, then 2 more
    far = [crowds.straight(2 + n, (0, 1.0), (1, 0.1), 30) for n in range(2)]
    got = replay(map_of(concatenate([*near, *far])), walker((5, 0), (1, 0)), 6, 1.0, 2, 1.0, 10.0)
    np.testing.assert_allclose(got.xy[0, 0, :2, 1], 0.0, atol=0.02)
    np.testing.assert_allclose(got.xy[0, 0, 2:, 1], 0.1 * np.arange(3, 7), atol=0.02)
    assert got.steps_alive[0, 0] == 6


@pytest.mark.parametrize(("pace", "alive"), [(0.0, 4), (1.0, 2)])
def test_after_everybody_has_left_the_path_is_held(pace, alive):
    """They walk for 4 s more; at twice their pace that is gone in 2 s."""
    mod = map_of(concatenate(crowds.straight(n, (0, 0), (1, 0), 8) for n in range(5)))
    got = replay(mod, walker((3, 0), (2, 0)), 9, 1.0, 5, pace, 100.0)
    assert (got.steps_alive == alive).all()
    expected = 3 + np.minimum(4, (1 + pace) * np.arange(1, 10))
    np.testing.assert_allclose(got.xy[0, :, :, 0], np.broadcast_to(expected, (21, 9)), atol=0.02)


def test_a_sample_is_one_persons_walk():
    """The nearest first, and in turn again where there are fewer than samples."""
    tracks = [crowds.straight(n, (0, n), (1, 0.1 * n), 30) for n in (1, 2, 3)]
    got = replay(map_of(concatenate(tracks)), walker((5, 0), (1, 0)), 8, 1.0, 2, 0.0, 100.0)
    for j in range(8):
        np.testing.assert_allclose(got.xy[0, 1 + j, :, 1], 0.1 * (j % 3 + 1) * np.arange(1, 9), atol=1e-4)


def test_contemporaries_can_be_left_out():
    """Those of the last minutes turn left; those of an hour ago go straight on."""
    today = [corner(n, began=3600.0 + n) for n in range(9)]
    before = [crowds.straight(20 + n, (0, 0.01), (1, 0), 30, began=n) for n in range(9)]
    mod, one = map_of(concatenate(today + before)), walker((5, 0), (1, 0), began=3605.0)
    assert replay(mod, one, 12, 1.0, 5, 1.0, 10.0).xy[0, 0, -1, 1] > 6.0
    without = replay(mod, one, 12, 1.0, 9, 1.0, 10.0, exclude_s=600.0)
    np.testing.assert_allclose(without.xy[0, 0, :, 1], 0.0, atol=0.02)
    assert without.steps_alive[0, 0] == 12
    alone = replay(mod, one, 12, 1.0, 5, 1.0, 10.0, exclude_s=7200.0)
    assert not alone.steps_alive.any()


def test_time_steps_of_half_a_second():
    mod = map_of(concatenate(crowds.straight(n, (0, 0.0), (1, 0), 60, step_s=0.5) for n in range(5)), 0.5)
    got = replay(mod, walker((5, 0), (1, 0), step_s=0.5), 10, 0.5, 5, 1.0, 10.0)
    np.testing.assert_allclose(got.xy[0, 0, :, 0], 5 + 0.5 * np.arange(1, 11), atol=0.02)
    np.testing.assert_allclose(mod.speed[mod.rows], 1.0, atol=1e-4)


# --- nobody to follow ---------------------------------------------------------------------------------------


def assert_constant_velocity(got, asking, step_s=1.0):
    assert not got.steps_alive.any()
    for n in range(len(asking.t)):
        expected = constant(asking, n, got.xy.shape[2], step_s)
        np.testing.assert_allclose(got.xy[n], np.broadcast_to(expected, got.xy[n].shape), atol=1e-4)


def test_far_from_everyone_a_walker_goes_straight_on():
    one = walker((500, 500), (0.7, -0.2))
    assert_constant_velocity(replay(default_map(), one, STEPS, 1.0, 5, 1.0, 10.0), one)


def test_against_everyone_a_walker_goes_straight_on():
    """Two units of heading are 16 m away."""
    mod, one = map_of(crowds.straight(1, (0, 0), (1, 0), 30)), walker((5, 0), (-1, 0))
    assert_constant_velocity(replay(mod, one, STEPS, 1.0, 5, 1.0, 15.9), one)
    assert replay(mod, one, STEPS, 1.0, 5, 1.0, 16.1).steps_alive[0, 0] == STEPS


@pytest.mark.parametrize("exclude_s", [0.0, 600.0])
@pytest.mark.parametrize(
    "tracks",
    [empty_tracks(), crowds.straight(1, (0, 0), (1, 0), 4), crowds.straight(1, (0, 0), (1, 0), 1)],
    ids=["nobody", "nobody long enough", "one row"],
)
def test_an_empty_map_leaves_constant_velocity(tracks, exclude_s):
    got = replay(map_of(tracks), walkers(), STEPS, 1.0, 5, 1.0, 10.0, exclude_s)
    assert got.xy.shape == (len(walkers().t), 21, STEPS, 2)
    assert_constant_velocity(got, walkers())


def test_one_person_can_be_followed():
    mod = map_of(corner(4))
    got = replay(mod, walker((5, 0), (1, 0)), 12, 1.0, 25, 1.0, 10.0)
    np.testing.assert_allclose(got.xy[0, 0], [(5 + min(s, 5), max(s - 5, 0)) for s in range(1, 13)], atol=1e-4)


def test_somebody_who_stands_still_has_a_finite_forecast():
    got = replay(default_map(), walker((3, 3), (0, 0)), STEPS, 1.0, 5, 1.0, 10.0)
    assert np.isfinite(got.xy).all()


def test_no_walkers_no_forecast():
    got = replay(default_map(), take(walkers(), slice(0, 0)), STEPS, 1.0, 5, 1.0, 10.0)
    assert got.xy.shape == (0, 21, STEPS, 2)
    assert got.steps_alive.shape == (0, 21)


# --- independence -------------------------------------------------------------------------------------------


def assert_same(one, other, rows=slice(None)):
    for a, b in zip(one[:3], other[:3], strict=True):
        np.testing.assert_array_equal(a, b[rows])


@pytest.mark.parametrize("rows", [[0], [7, 3], [*range(9, -1, -1)]], ids=str)
def test_order_and_company_of_the_walkers_do_not_matter(rows):
    whole = replay(default_map(), walkers(), STEPS, 1.0, 5, 1.0, 10.0)
    assert_same(replay(default_map(), take(walkers(), rows), STEPS, 1.0, 5, 1.0, 10.0), whole, rows)


def test_a_shorter_horizon_is_a_prefix():
    long = replay(default_map(), walkers(), STEPS, 1.0, 5, 1.0, 10.0)
    short = replay(default_map(), walkers(), 4, 1.0, 5, 1.0, 10.0)
    np.testing.assert_array_equal(short.xy, long.xy[:, :, :4])
    np.testing.assert_array_equal(short.steps_alive, np.minimum(long.steps_alive, 4))


def test_the_order_of_the_training_tracks_does_not_matter():
    tracks = training()
    order = np.random.default_rng(5).permutation(len(tracks.bounds()) - 1)
    one = replay(default_map(), walkers(), STEPS, 1.0, 5, 1.0, 10.0)
    other = replay(map_of(crowds.reordered(tracks, order)), walkers(), STEPS, 1.0, 5, 1.0, 10.0)
    np.testing.assert_array_equal(other.steps_alive, one.steps_alive)
    np.testing.assert_allclose(other.xy, one.xy, atol=2e-3)


def moved(tracks, shift=(0.0, 0.0), angle=0.0):
    """Tracks or walkers turned around the origin, then shifted."""
    x, y = tracks.x * np.cos(angle) - tracks.y * np.sin(angle), tracks.x * np.sin(angle) + tracks.y * np.cos(angle)
    return tracks._replace(x=x + shift[0], y=y + shift[1])


@pytest.mark.parametrize(("shift", "angle"), [((40.0, -64.0), 0.0), ((0.0, 0.0), 0.7), ((3.0, 2.0), 3.0)])
def test_moving_and_turning_map_and_walkers_moves_the_forecast(shift, angle):
    """Rotations too: an episode map has no cells."""
    one = replay(default_map(), walkers(), STEPS, 1.0, 5, 1.0, 10.0)
    mod = map_of(moved(training(), shift, angle))
    other = replay(mod, moved(walkers(), shift, angle), STEPS, 1.0, 5, 1.0, 10.0)
    np.testing.assert_array_equal(other.steps_alive, one.steps_alive)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    np.testing.assert_allclose(other.xy, one.xy @ turn + np.array(shift), atol=5e-3)


def test_the_forecaster_of_a_file_takes_the_methods_options(tmp_path):
    write_parquet(episodes.build(training(), Site()), tmp_path / "episodes.parquet")
    site = Site(difference_weights=tuple(WEIGHTS), observed_rows=4, time_step_s=1.0, timezone="UTC")
    options = Episodes(persons=4, pace=0.5, reach_m=6.0, exclude_s=5.0, **METRIC._asdict())
    forecaster = make_forecaster("episodes", options, site, tmp_path / "episodes.parquet")
    got = forecaster(walkers(), STEPS, stream_keys(walkers().track_id, 4, 0))
    assert_same(got, replay(map_of(training()), walkers(), STEPS, 1.0, 4, 0.5, 6.0, 5.0))
