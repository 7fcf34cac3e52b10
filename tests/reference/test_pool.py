"""Whole walks and snippets of them as one distribution: its halves, its median, and where one of them is silent."""

import crowds
import numpy as np
import pytest

from modlhmp.forecasting.chain import chain
from modlhmp.forecasting.median import geometric_median, weighted_geometric_median
from modlhmp.forecasting.observe import observe
from modlhmp.forecasting.pool import _fill_medians, pool
from modlhmp.forecasting.replay import replay
from modlhmp.maps import pooled, snippets
from modlhmp.options import Pooled, SnippetBuilding
from modlhmp.site import Site
from modlhmp.streams import stream_keys
from modlhmp.tracks import concatenate, usable_tracks

SITE = Site()
STEPS, K = 12, 8


def crowd(seed=11, people=120):
    return crowds.crowd(seed, people=people, size=7.0, most_rows=16, gaps=(1,))


def map_of(tracks, **options):
    return pooled.load(pooled.build(tracks, SITE), SITE, Pooled(**options))


def observed(tracks):
    return observe(tracks, usable_tracks(tracks, 4), 4)


def walker(start, velocity):
    """One who is seen at four rows at constant velocity, the last of them at `start`."""
    return observed(crowds.straight(900, np.array(start) - 3 * np.array(velocity), velocity, 5, 0.0, 1.0))


def forecast(tracks, asking, steps=STEPS, k=K, **options):
    keys = stream_keys(asking.track_id, k, 0, "pool")
    return pool(map_of(tracks, **options), asking, steps, keys, SITE, Pooled(**options)), keys


def futures(paths, alive):
    """`xy` [1, 1 + 2 k, T, 2] and `alive` of futures that stand at places on the x axis, with room for the median."""
    xy = np.zeros((1, 1 + len(paths), 3, 2), np.float32)
    xy[0, 1:, :, 0] = np.array(paths)[:, None]
    return xy, np.array([[0, *alive]], np.int32)


def medians(xy, alive, different, most):
    _fill_medians(xy, alive, np.array([different]), np.array([most]))
    return xy[0, 0, :, 0], alive[0, 0]


# --- the map ----------------------------------------------------------------------------------------------------------


def test_the_snippets_are_those_of_the_same_tracks():
    """One file of walks serves both: the snippet flow map made of it is that of the tracks, but for float32."""
    mod = map_of(crowd())
    building = SnippetBuilding(length_s=5.0, most=50)
    own = snippets.load(snippets.build(crowd(), SITE, building), SITE, Pooled()).arrays
    assert len(own.path) > 300
    for name in ("index", "starts", "count", "steps", "leaves"):
        np.testing.assert_array_equal(getattr(mod.snippets.arrays, name), getattr(own, name))
    np.testing.assert_allclose(mod.snippets.arrays.path, own.path, atol=1e-5)
    np.testing.assert_allclose(mod.snippets.arrays.points, own.points, atol=1e-3)


# --- the samples ------------------------------------------------------------------------------------------------------


def test_samples_are_a_replay_and_a_particle_by_turns():
    asking = observed(crowds.crowd(12, people=25, size=7.0, most_rows=12, gaps=(1,)))
    got, keys = forecast(crowd(), asking)
    mod = map_of(crowd())
    walks = replay(mod.episodes, asking, STEPS, 1.0, 25, 1.0, 10.0)
    particles = chain(mod.snippets, asking, STEPS, keys, 1.2)
    both = (walks.steps_alive[:, 0] > 0) & (particles.steps_alive[:, 0] > 0)
    assert both.sum() > 15
    assert (got.output, got.xy.shape[1]) == ("median", 1 + 2 * K)
    for part in ("xy", "steps_alive"):
        futures, one, other = (getattr(of, part)[both] for of in (got, walks, particles))
        np.testing.assert_array_equal(futures[:, 1::2], one[:, 1 : 1 + K])
        np.testing.assert_array_equal(futures[:, 2::2], other[:, 1:])


def test_who_is_like_nobody_near_has_particles_alone():
    """Within reach there is nobody to follow; snippets look around. Nobody is said to have left for that."""
    tracks = concatenate(crowds.straight(n, (0, 0.3 * n), (1, 0), 40) for n in range(5))
    got, _ = forecast(tracks, walker((5, 0.1), (1, 0)), reach_m=0.01)
    np.testing.assert_array_equal(got.xy[:, 1::2], got.xy[:, 2::2])
    assert (got.steps_alive == STEPS).all()
    np.testing.assert_allclose(got.xy[0, 0, :, 0], 5 + np.arange(1, STEPS + 1), atol=0.05)


def test_far_from_everyone_a_walker_goes_straight_on():
    got, _ = forecast(crowd(), walker((500, 500), (0.7, -0.2)))
    assert not got.steps_alive.any()
    expected = np.array([500, 500]) + np.arange(1, STEPS + 1)[:, None] * np.array([0.7, -0.2])
    np.testing.assert_allclose(got.xy[0], np.broadcast_to(expected, got.xy[0].shape), atol=1e-3)


def test_it_depends_on_the_seed_by_its_particles_only():
    asking = observed(crowds.crowd(12, people=25, size=7.0, most_rows=12, gaps=(1,)))
    mod, options = map_of(crowd()), Pooled()
    one, other = (
        pool(mod, asking, STEPS, stream_keys(asking.track_id, K, seed, "pool"), SITE, options) for seed in (0, 1)
    )
    walks = replay(mod.episodes, asking, STEPS, 1.0, 25, 1.0, 10.0).steps_alive[:, 0] > 0
    np.testing.assert_array_equal(one.xy[walks, 1::2], other.xy[walks, 1::2])
    assert not np.array_equal(one.xy[:, 2::2], other.xy[:, 2::2])


# --- the median -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_a_share_is_worth_as_many_points(seed):
    """The median of points of whole shares is that of each so often."""
    rng = np.random.default_rng(seed)
    x, y, share = rng.normal(0, 3, 9), rng.normal(0, 3, 9), rng.integers(1, 5, 9)
    expected = geometric_median(np.repeat(x, share), np.repeat(y, share), share.sum())
    np.testing.assert_allclose(weighted_geometric_median(x, y, share / share.sum(), 9), expected, atol=0.01)


def test_each_half_weighs_the_same():
    """All two replays, and two of the five particles, stand at 0: 70 % of the weight, though most futures are at 9."""
    places = [0.0, 9.0, 0.0, 9.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0]  # replays and particles by turns
    path, alive = medians(*futures(places, [3] * 10), different=2, most=25)
    assert alive == 3
    np.testing.assert_allclose(path, 0.0, atol=0.05)
    path, _ = medians(*futures([0.0, 9.0] * 4 + [0.0, 0.0], [3] * 10), different=2, most=25)
    np.testing.assert_allclose(path, 0.0, atol=0.05)


def test_only_the_nearest_persons_under_way_count():
    """The nearest leaves after a step, the next after two; one counts, and no particle is left."""
    path, alive = medians(*futures([0.0, 0.0, 4.0, 0.0, 8.0, 0.0], [1, 0, 2, 0, 3, 0]), different=3, most=1)
    assert alive == 3
    np.testing.assert_allclose(path, [0.0, 4.0, 8.0], atol=1e-3)


def test_replays_that_come_again_count_once():
    """Two of three persons stand at 9; the other, at 0, comes twice again."""
    places = [0.0, 5.0, 9.0, 5.0, 9.0, 5.0, 0.0, 5.0, 0.0, 5.0]
    path, _ = medians(*futures(places, [3, 0] * 5), different=3, most=25)
    np.testing.assert_allclose(path, 9.0, atol=0.05)


def test_where_one_half_has_left_the_other_counts_alone():
    """Replays stand at 0 and leave after a step, particles at 9 after two; then the path is held."""
    path, alive = medians(*futures([0.0, 9.0] * 3, [1, 2] * 3), different=3, most=25)
    assert alive == 2
    np.testing.assert_allclose(path[1:], 9.0, atol=0.05)
    path, alive = medians(*futures([0.0, 9.0] * 3, [2, 1] * 3), different=3, most=25)
    np.testing.assert_allclose(path[1:], 0.0, atol=0.05)


def test_a_walker_turns_where_everyone_did():
    def corner(n):
        s = np.arange(21.0)
        return crowds.walk(n, n + s, np.column_stack([np.minimum(s, 10.0), np.maximum(s - 10.0, 0.0)]))

    got, _ = forecast(concatenate(corner(n) for n in range(10)), walker((5, 0), (1, 0)), steps=12)
    np.testing.assert_allclose(got.xy[0, 0], [(5 + min(s, 5), max(s - 5, 0)) for s in range(1, 13)], atol=0.1)
