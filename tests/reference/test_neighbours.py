"""Who is near a walker at t0: against loops over everyone, and what nobody may know yet."""

from itertools import pairwise

import numpy as np
import pytest
import twins
from crowds import START, crowd, people_of, reordered, straight, walk
from hypothesis import given, settings
from hypothesis import strategies as st

from modlhmp.forecasting.neighbours import MOST, RADIUS_M, find_neighbours
from modlhmp.tracks import concatenate, empty_tracks, positions_at, together


def people_and_rows(tracks, own_row):
    """Which person each row belongs to, and which of that person's rows it is."""
    who = np.searchsorted(tracks.bounds(), own_row, side="right") - 1
    return list(zip(who.tolist(), (own_row - tracks.bounds()[who]).tolist(), strict=True))


def by_id(tracks, found):
    """[{track id: positions}] of each walker's neighbours, in their order."""
    ids = tracks.track_id[tracks.bounds()[:-1]]
    return [
        {int(ids[n]): xy for n, xy in zip(track, paths, strict=True) if n >= 0}
        for track, paths in zip(found.track, found.xy, strict=True)
    ]


def assert_same(one, other):
    """The same people in the same order at the same places, to the last bit."""
    assert [list(walker) for walker in one] == [list(walker) for walker in other]
    for a, b in zip(one, other, strict=True):
        for track_id in a:
            np.testing.assert_array_equal(a[track_id], b[track_id])


# --- against loops ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "rows", "step_s"), [(0, 4, 1.0), (1, 3, 1.0), (2, 4, 0.4), (3, 8, 2.5), (4, 4, 10.0)])
def test_equals_loops_over_everyone(seed, rows, step_s):
    tracks = crowd(seed, step_s=step_s)
    own_row = np.random.default_rng(seed).permutation(len(tracks.t))  # every row of everyone, in any order
    found, people = find_neighbours(tracks, own_row, rows, step_s), people_of(tracks)
    assert found.track.shape == (len(own_row), MOST)
    assert found.xy.shape == (len(own_row), MOST, rows, 2)
    counts = set()
    for n, (who, row) in enumerate(people_and_rows(tracks, own_row)):
        plain = twins.find_neighbours(people, who, row, rows, step_s)
        counts.add(len(plain))
        assert found.track[n].tolist() == [person for person, _ in plain] + [-1] * (MOST - len(plain))
        for m, (_, seen) in enumerate(plain):
            xy = [(np.nan, np.nan) if at is None else at for at in seen]
            np.testing.assert_allclose(found.xy[n, m], xy, rtol=0, atol=1e-5)
        assert np.isnan(found.xy[n, len(plain) :]).all()
    assert counts == set(range(MOST + 1))  # from nobody to more than are taken


@given(seed=st.integers(0, 10**6), n=st.integers(1, 8))
@settings(max_examples=40)
def test_positions_at_interpolates_each_track_by_itself(seed, n):
    rng = np.random.default_rng(seed)
    tracks = crowd(seed, people=n)
    bounds = tracks.bounds()
    rows = np.column_stack([bounds[:-1], bounds[1:] - 1])
    which = rng.permutation(n)[: rng.integers(1, n + 1)]  # some of the tracks, in any order
    whose = rng.integers(0, len(which), 12)
    when = rng.uniform(-10, 40, (12, 5))  # from before the first row to after the last
    got = positions_at(tracks, rows[which], when, whose)
    for one, at, track in zip(got, when, which[whose], strict=True):
        part = slice(rows[track, 0], rows[track, 1] + 1)
        since = tracks.t[part] - tracks.t[part][0]
        np.testing.assert_allclose(one[:, 0], np.interp(at, since, tracks.x[part]), rtol=0, atol=1e-5)
        np.testing.assert_allclose(one[:, 1], np.interp(at, since, tracks.y[part]), rtol=0, atol=1e-5)
    own = positions_at(tracks, rows[which], when[: len(which)])
    np.testing.assert_array_equal(own, positions_at(tracks, rows[which], when[: len(which)], np.arange(len(which))))


def test_positions_at_of_no_track():
    assert positions_at(empty_tracks(), np.empty((0, 2), int), np.empty((0, 5))).shape == (0, 5, 2)


# --- only what had been seen by t0 --------------------------------------------------------------------------


def moved(tracks, late, rng):
    """The rows `late` at other places."""
    x, y = (np.where(late, rng.uniform(-500, 500, len(late)), column) for column in (tracks.x, tracks.y))
    return tracks._replace(x=x, y=y)


def delayed(tracks, late, rng):
    """The rows `late` at other times: a person's still in order, and after those that are kept."""
    t, bounds = tracks.t.copy(), tracks.bounds()
    for first, end in pairwise(bounds):
        rows = np.arange(first, end)[late[first:end]]
        t[rows] += np.cumsum(rng.uniform(0, 5, len(rows)))
    return tracks._replace(t=t)


def cut(tracks, late, rng):
    """Without the rows `late`: whoever comes later is gone altogether."""
    return tracks.take(~late)


@pytest.mark.parametrize("change", [moved, delayed, cut])
def test_what_comes_after_t0_changes_nothing(change):
    tracks, rng = crowd(4), np.random.default_rng(5)
    for own_row in tracks.bounds()[:-1] + np.diff(tracks.bounds()) // 2:
        late = tracks.t > tracks.t[own_row]
        other = change(tracks, late, rng)
        same_row = np.flatnonzero((other.track_id == tracks.track_id[own_row]) & (other.t == tracks.t[own_row]))
        found, again = find_neighbours(tracks, np.array([own_row])), find_neighbours(other, same_row)
        assert_same(by_id(tracks, found), by_id(other, again))


def test_who_comes_a_moment_after_t0_is_not_seen():
    own, other = straight(1, (0, 0), (1, 0), 8), straight(2, (4, 1), (0, 0), 8, began=3.0 + 1e-3)
    assert (find_neighbours(concatenate([own, other]), np.array([3])).track == -1).all()
    assert find_neighbours(concatenate([own, other]), np.array([4])).track[0, 0] == 1


def test_positions_go_on_at_the_last_velocity():
    own = straight(1, (0, 0), (1, 0), 8)
    # Newest row 0.5 s before t0 = 3 s, half a step at (0.4, 0.2) m/s onward; then it turns round, unseen.
    other = walk(2, [1.5, 2.5, 3.5, 4.5], [(2.0, 1.0), (2.4, 1.2), (0.0, 0.0), (0.0, 0.0)])
    seen = find_neighbours(concatenate([own, other]), np.array([3])).xy[0, 0]
    np.testing.assert_allclose(seen[-1], (2.6, 1.3), atol=1e-6)
    np.testing.assert_allclose(seen[-2], (2.2, 1.1), atol=1e-6)
    assert np.isnan(seen[:2]).all()  # at 0 and 1 s the person was not there yet


@pytest.mark.parametrize(("before", "expected"), [(4.9, 2.0 + 0.5 / 4.9), (5.5, 2.0)])
def test_there_is_no_velocity_across_a_gap_or_from_one_row(before, expected):
    own = straight(1, (0, 0), (0, 0), 4, began=10.0)
    other = walk(2, [12.5 - before, 12.5], [(1.0, 0.0), (2.0, 0.0)])
    seen = find_neighbours(concatenate([own, other]), np.array([3])).xy[0, 0]
    np.testing.assert_allclose(seen[-1], (expected, 0.0), atol=1e-6)
    alone = find_neighbours(concatenate([own, other.take(slice(1, 2))]), np.array([3])).xy[0, 0]
    np.testing.assert_allclose(alone[-1], (2.0, 0.0), atol=1e-6)
    assert np.isnan(alone[:-1]).all()


@pytest.mark.parametrize(("age", "counts"), [(1.04, True), (1.06, False)])
@pytest.mark.parametrize("step_s", [1.0, 0.4])
def test_a_person_counts_whose_newest_row_is_about_a_step_old(age, counts, step_s):
    own = straight(1, (0, 0), (0, 0), 4, began=10.0, step_s=step_s)
    other = walk(2, [9.0, 10.0 + (3 - age) * step_s], [(1.0, 0.0), (1.0, 0.0)])
    found = find_neighbours(concatenate([own, other]), np.array([3]), step_s=step_s)
    assert (found.track[0, 0] == 1) == counts


@pytest.mark.parametrize(("late", "known"), [(0.04, True), (0.06, False)])
def test_early_times_are_absent_but_for_clock_jitter(late, known):
    own = straight(1, (0, 0), (1, 0), 6)
    other = straight(2, (1, 1), (1, 0), 6, began=1.0 + late)
    seen = find_neighbours(concatenate([own, other]), np.array([3])).xy[0, 0]
    assert np.isnan(seen[0]).all()
    assert np.isfinite(seen[1]).all() == known
    assert np.isfinite(seen[2:]).all()
    if known:
        np.testing.assert_allclose(seen[1], (1.0, 1.0), atol=1e-6)  # held at the first row


# --- who counts ---------------------------------------------------------------------------------------------


def test_the_order_of_the_tracks_does_not_matter():
    tracks = crowd(6)
    other = reordered(tracks, np.random.default_rng(7).permutation(len(tracks.bounds()) - 1))
    own_row = np.arange(len(tracks.t))
    same_row = np.lexsort((other.t, other.track_id))[np.argsort(np.lexsort((tracks.t, tracks.track_id)))]
    one, two = (by_id(table, find_neighbours(table, row)) for table, row in ((tracks, own_row), (other, same_row)))
    assert [list(walker) for walker in one] == [list(walker) for walker in two]
    for a, b in zip(one, two, strict=True):
        for track_id in a:
            np.testing.assert_allclose(a[track_id], b[track_id], rtol=0, atol=1e-9)


def test_the_nearest_are_taken_in_order_up_to_the_radius():
    distances = [5.9, 3.0, 6.1, 1.0, 4.0, 2.0, 5.0]
    others = [straight(10 + n, (0, d), (1, 0), 4) for n, d in enumerate(distances)]
    tracks = concatenate([straight(1, (0, 0), (1, 0), 4), *others])
    assert list(by_id(tracks, find_neighbours(tracks, np.array([3])))[0]) == [13, 15, 11, 14, 16]  # MOST of six
    few = concatenate([straight(1, (0, 0), (1, 0), 4), others[0], others[2]])
    assert list(by_id(few, find_neighbours(few, np.array([3])))[0]) == [10]  # 6.1 m is too far
    at_radius = concatenate([straight(1, (0, 0), (0, 0), 4), straight(2, (RADIUS_M, 0), (0, 0), 4)])
    assert find_neighbours(at_radius, np.array([3])).track[0, 0] == 1


def test_distance_is_that_at_t0():
    own = straight(1, (0, 0), (0, 0), 4)
    coming, leaving = straight(2, (12, 0), (-3, 0), 4), straight(3, (0, 1), (0, 3), 4)
    tracks = concatenate([own, coming, leaving])
    assert list(by_id(tracks, find_neighbours(tracks, np.array([3])))[0]) == [2]


def test_nobody_there():
    alone = straight(1, (0, 0), (1, 0), 6)
    for tracks in (alone, concatenate([alone, straight(2, (0, 0), (1, 0), 6, began=86400.0)])):
        found = find_neighbours(tracks, np.array([3]))
        assert (found.track == -1).all()
        assert found.xy.shape == (1, MOST, 4, 2)
        assert np.isnan(found.xy).all()
    for tracks in (alone, empty_tracks()):
        assert find_neighbours(tracks, np.empty(0, int)).xy.shape == (0, MOST, 4, 2)


def test_walkers_are_never_their_own_neighbours():
    tracks = crowd(8, people=60, size=3.0)
    own_row = np.arange(len(tracks.t))
    found = find_neighbours(tracks, own_row)
    who = np.array([person for person, _ in people_and_rows(tracks, own_row)])
    assert (found.track >= 0).any()
    assert not (found.track == who[:, None]).any()


def test_two_at_one_place_see_each_other():
    tracks = concatenate([straight(1, (0, 0), (1, 0), 4), straight(2, (0, 0), (1, 0), 4)])
    assert find_neighbours(tracks, np.array([3, 7])).track[:, 0].tolist() == [1, 0]


# --- people of several recordings ---------------------------------------------------------------------------


def test_together_keeps_ids_of_different_people_apart():
    own = concatenate([straight(5, (0, 0), (1, 0), 4), straight(9, (0, 1), (1, 0), 4)])
    others = [
        concatenate([straight(5, (0, 2), (1, 0), 4), straight(6, (0, 3), (1, 0), 4)]),
        empty_tracks(),
        straight(-3, (0, 4), (1, 0), 4),
    ]
    tracks = together([own, *others])
    assert len(set(tracks.track_id.tolist())) == 5
    assert len(tracks.bounds()) == 6  # no two people in a row run into one
    for column in ("t", "x", "y"):  # the recording's own rows come first, as they were
        np.testing.assert_array_equal(getattr(tracks, column)[: len(own.t)], getattr(own, column))
    found = find_neighbours(tracks, np.array([3]))
    assert found.track[0].tolist() == [1, 2, 3, 4, -1]
    np.testing.assert_array_equal(found.xy[0, :4, -1], [(3, 1), (3, 2), (3, 3), (3, 4)])


def test_together_without_anybody():
    own = straight(3, (0, 0), (1, 0), 4)
    assert len(together([own]).t) == len(together([own, empty_tracks()]).t) == 4
    assert len(together([empty_tracks()]).t) == 0
    assert together([empty_tracks(), own]).t[0] == START
