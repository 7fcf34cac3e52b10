"""What the networks are shown: scenes against loops over people and steps, training windows, the validation split."""

from collections import Counter

import numpy as np
import pytest
import twins
from crowds import START, crowd, people_of, reordered, straight, walk

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.neighbours import MOST
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.ids import id_of
from modlhmp.networks.data import (
    Day,
    day_of,
    draw_windows,
    observed_scene,
    persons_held_out,
    scenes_at,
    training_data,
    training_windows,
)
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.streams import stream_keys
from modlhmp.tracks import concatenate, empty_tracks, usable_tracks

GAPS = (1, 1, 1, 1, 2)  # steps between rows, so that tracks are usable
SHAPE = (12, 4, 1.0)  # steps, observed rows, time step [s]


def speeding(track_id, rows, began=0.0, scale=1.0):
    """A person whose n-th row is at x = n^2 m: where a window begins shows in its displacements."""
    return walk(track_id, began + np.arange(rows), [(scale * n * n, 0.0) for n in range(rows)])


def first_row_of(scenes):
    """Row at which the windows of speeding people begin: their last displacement is 2 (row + 3) - 1."""
    return np.rint((-scenes.past[:, 0, -2, 0] + 1) / 2 - 3).astype(int)


def paced(ids, rows=20, began=0.0):
    """One person an id, at id / 100 m/s: the speed says who it is."""
    return concatenate([straight(n, (0, 0), (n / 100, 0), rows, began + 100.0 * n) for n in ids])


def who_is(scenes):
    """Ids of paced people, who come from everywhere along the x axis."""
    return np.rint(-100 * scenes.past[:, 0, -2, 0]).astype(int).tolist()


# --- scenes -------------------------------------------------------------------------------------------------


def plain_scene(people, who, start, steps, observed_rows, step_s):
    """(past, future) of one window: for the person and each neighbour a list of (x, y) or None, around t0's."""
    seen, t0 = people[who][start : start + observed_rows], people[who][start + observed_rows - 1][0]
    past = [[twins.position(seen, t0 - back * step_s) for back in range(observed_rows - 1, -1, -1)]]
    future = [twins.ground_truth(*zip(*people[who][start:], strict=True), observed_rows, steps, step_s)[0]]
    for person, positions in twins.find_neighbours(people, who, start + observed_rows - 1, observed_rows, step_s):
        end = people[person][-1][0] + 0.05 * step_s
        times = [t0 + n * step_s for n in range(1, steps + 1)]
        past.append(positions)
        future.append([twins.position(people[person], t) if t <= end else None for t in times])
    x0, y0 = seen[-1][1:]
    return [[[at and (at[0] - x0, at[1] - y0) for at in path] for path in part] for part in (past, future)]


@pytest.mark.parametrize(("seed", "shape"), [(1, (12, 4, 1.0)), (2, (5, 3, 1.0)), (3, (20, 4, 0.4)), (4, (3, 6, 2.5))])
def test_scenes_equal_loops_over_people_and_steps(seed, shape):
    steps, observed_rows, step_s = shape
    tracks = crowd(seed, step_s=step_s, gaps=GAPS)
    rows, people = usable_tracks(tracks, observed_rows), people_of(tracks)
    windows = [(start, last) for first, last in rows for start in range(first, last - observed_rows + 1)]
    starts, ends = np.array(windows).T
    scenes = scenes_at(Day(tracks, rows), starts, ends, *shape)
    assert scenes.past.shape == (len(starts), 1 + MOST, observed_rows, 2)
    assert scenes.future.shape == (len(starts), 1 + MOST, steps, 2)
    assert scenes.future_present[:, 1:].any()
    for n, start in enumerate(starts):
        who = np.searchsorted(tracks.bounds(), start, side="right") - 1
        plain = plain_scene(people, who, start - tracks.bounds()[who], *shape)
        for expected, got, present in zip(plain, (scenes.past, scenes.future), scenes[1:4:2], strict=True):
            known = np.array([[at is not None for at in path] for path in expected])
            np.testing.assert_array_equal(present[n, : len(known)], known)
            assert not present[n, len(known) :].any()
            xy = [[at or (0.0, 0.0) for at in path] for path in expected]
            np.testing.assert_allclose(got[n, : len(known)], xy, rtol=0, atol=2e-5)


def some_scenes(tracks, shape=SHAPE):
    """Scenes of the first windows of all usable tracks."""
    rows = usable_tracks(tracks, shape[1])
    return scenes_at(Day(tracks, rows), rows[:, 0], rows[:, 1], *shape)


def test_scenes_are_float32_and_0_where_nobody_is():
    scenes = some_scenes(crowd(5, gaps=GAPS))
    for xy, present in (scenes[:2], scenes[2:4]):
        assert xy.dtype == np.float32
        assert present.dtype == bool
        assert (xy[~present] == 0).all()
        assert np.isfinite(xy).all()
        assert not present.all()
    np.testing.assert_array_equal(scenes.past[:, 0, -1], 0.0)
    assert scenes.past_present[:, 0].all()
    own = scenes.future_present[:, 0]
    np.testing.assert_array_equal(own, np.arange(SHAPE[0]) < scenes.lengths()[:, None])  # contiguous from step 1


def test_only_where_says_where_in_the_building_scenes_are():
    tracks = crowd(6, gaps=GAPS)
    elsewhere = tracks._replace(x=tracks.x + 1000, y=tracks.y - 500)
    here, there = some_scenes(tracks), some_scenes(elsewhere)
    for one, other in zip(here[:4], there[:4], strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-6)
    np.testing.assert_allclose(there.where - here.where, np.tile([1000, -500, 0], (len(here.past), 1)), atol=1e-4)


def test_the_past_of_a_scene_does_not_depend_on_its_future():
    tracks, rng = crowd(7, gaps=GAPS), np.random.default_rng(7)
    for first, last in usable_tracks(tracks):
        late = tracks.t > tracks.t[first + 3]
        noise = tracks._replace(x=np.where(late, rng.normal(0, 50, len(late)), tracks.x))
        one, other = (
            scenes_at(Day(table, None), np.array([first]), np.array([last]), *SHAPE) for table in (tracks, noise)
        )
        np.testing.assert_array_equal(one.past, other.past)
        np.testing.assert_array_equal(one.past_present, other.past_present)


def test_a_forecast_sees_what_training_showed():
    own, other = (crowd(seed, gaps=GAPS) for seed in (8, 9))
    given = []

    def forecaster(observed, steps, keys):
        given.append(observed)
        return Forecast(
            np.zeros((*keys.shape, steps, 2)), np.zeros((*keys.shape, steps)), np.zeros(keys.shape), "single"
        )

    site = Site(observed_rows=4, horizon_s=12.0, time_step_s=1.0)
    list(forecast_recording(own, forecaster, site, ("data", "method", "day"), 1, [0], [other]))
    past, present, origin = observed_scene(given[0], 1.0)
    day = day_of(own, [other], Site())
    scenes = scenes_at(day, *day.rows.T, *SHAPE)
    assert scenes.past_present[:, 1:].any()
    np.testing.assert_array_equal(past, scenes.past)
    np.testing.assert_array_equal(present, scenes.past_present)
    np.testing.assert_allclose(origin, np.column_stack([own.x, own.y])[day.rows[:, 0] + 3], atol=1e-5)


def test_the_observed_past_is_that_of_the_observed_rows():
    """Rows 0.98 s apart span less than three steps: the first step is held, even if there is an earlier row."""
    times = 0.98 * np.arange(12)
    tracks = walk(1, times, np.column_stack([times, 0 * times]))
    early, later = (scenes_at(Day(tracks, None), np.array([n]), np.array([11]), *SHAPE) for n in (0, 3))
    np.testing.assert_allclose(early.past[0, 0, :, 0], [-2.94, -2, -1, 0], atol=1e-5)
    np.testing.assert_allclose(later.past, early.past, atol=1e-5)


def test_neighbours_come_from_all_recordings_of_the_day():
    own = concatenate([straight(4, (0, 0), (1, 0), 10), straight(8, (0, 1), (1, 0), 10)])
    day = day_of(own, [straight(4, (0, 3), (1, 0), 9), straight(2, (0, -2), (1, 0), 6)], Site())
    assert day.rows.tolist() == [[0, 9], [10, 19]]  # only the recording's own people are forecast
    scenes = scenes_at(day, *day.rows.T, *SHAPE)
    assert scenes.past_present[:, :, -1].sum(1).tolist() == [4, 4]
    np.testing.assert_allclose(scenes.past[0, :4, -1], [(0, 0), (0, 1), (0, -2), (0, 3)], atol=1e-5)
    assert scenes.future_present[0].sum(1).tolist() == [6, 6, 2, 5, 0, 0]


# --- training windows ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("futures", ["masked", "full"])
@pytest.mark.parametrize("shape", [(4, 4, 1.0), (1, 3, 1.0), (5, 4, 0.4)])
def test_training_windows_equal_loops(futures, shape):
    steps, observed_rows, step_s = shape
    tracks = crowd(10, step_s=step_s, gaps=GAPS)
    rows = usable_tracks(tracks, observed_rows)
    needed = steps if futures == "full" else 1
    expected = []
    for first, last in rows:
        starts = [
            start
            for start in range(first, last + 1)
            if start + observed_rows - 1 < last
            and tracks.t[last] - tracks.t[start + observed_rows - 1] >= (needed - 0.05) * step_s
        ]
        assert starts == list(range(first, first + len(starts)))
        expected.append(len(starts))
    got = training_windows(Day(tracks, rows), futures, *shape)
    assert got.tolist() == expected
    assert got.any()


def test_every_window_has_its_truth():
    tracks = crowd(11, gaps=GAPS)
    for futures, needed in (("masked", 1), ("full", SHAPE[0])):
        day = Day(tracks, usable_tracks(tracks))
        windows = training_windows(day, futures, *SHAPE)
        scenes = draw_windows([day], [windows], np.random.default_rng(0), *SHAPE)
        assert len(scenes.past) == (windows > 0).sum()
        assert scenes.lengths().min() >= needed


@pytest.mark.parametrize(("futures", "number"), [("masked", 16), ("full", 5)])
def test_half_of_the_windows_begin_with_the_track(futures, number):
    day = day_of(concatenate([speeding(n, 20, 100.0 * n) for n in range(2000)]), [], Site())
    windows = training_windows(day, futures, *SHAPE)
    assert (windows == number).all()
    starts = first_row_of(draw_windows([day], [windows], np.random.default_rng(12), *SHAPE))
    share = np.bincount(starts, minlength=number) / len(starts)
    assert len(share) == number
    expected = np.full(number, 0.5 / number) + 0.5 * (np.arange(number) == 0)
    np.testing.assert_allclose(share, expected, atol=0.04)


def test_windows_are_drawn_by_the_generator_alone():
    tracks = crowd(13, gaps=GAPS)
    days = [
        day_of(tracks, [], Site()),
        day_of(empty_tracks(), [tracks], Site()),
        day_of(crowd(14, gaps=GAPS), [], Site()),
    ]
    windows = [training_windows(day, "masked", *SHAPE) for day in days]
    one, same, other = (draw_windows(days, windows, np.random.default_rng(seed), *SHAPE) for seed in (1, 1, 2))
    for a, b in zip(one, same, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(one.past, other.past)
    assert len(one.past) == sum((number > 0).sum() for number in windows)


# --- training and validation --------------------------------------------------------------------------------


def training_people(data):
    """Ids of the tracks that are trained on, of all days."""
    return [int(n) for day in data.days for n in day.tracks.track_id[day.rows[:, 0]]]


def test_a_person_is_trained_on_or_held_out():
    data = training_data([day_of(paced(range(1000)), [], Site())], "masked", 0.1, 0, *SHAPE)
    trained, held_out = training_people(data), who_is(data.validation)
    assert sorted(trained + held_out) == list(range(1000))
    assert 70 <= len(held_out) <= 130
    assert data.tracks == len(trained)
    drawn = who_is(data.draw(np.random.default_rng(0)))
    assert drawn == trained


@pytest.mark.parametrize("share", [0.0, 0.1])
@pytest.mark.parametrize("people", [2, 3, 10, 25])
def test_somebody_is_held_out_even_of_few(people, share):
    days = [day_of(paced(range(people)), [], Site()), day_of(empty_tracks(), [], Site())]
    for seed in range(5):
        data = training_data(days, "masked", share, seed, *SHAPE)
        held_out = who_is(data.validation)
        assert len(held_out) == 1 if share == 0 else held_out
        assert sorted(training_people(data) + held_out) == list(range(people))


@pytest.mark.parametrize("held_out", ["persons", "blocks"])
def test_pieces_of_one_person_are_on_one_side(held_out):
    """Hours apart as well, and where the first piece is too short to be used."""
    pieces = {id_of(str(n), piece): n for n in range(200) for piece in (2, 3)}
    tracks = [straight(n, (0, 0), (n / 100, 0), 20 if n % 5 else 3, 100.0 * n) for n in range(200)]
    tracks += [straight(one, (0, 0), (n / 100, 0), 20, 100.0 * n + 9000 * (i + 1))
               for i, (one, n) in enumerate(sorted(pieces.items()))]  # fmt: skip
    days = [day_of(concatenate(tracks), [paced(range(5))], Site(), pieces=pieces)]
    for seed in range(3):
        data = training_data(days, "masked", 0.2, seed, *SHAPE, held_out=held_out)
        out, trained = Counter(who_is(data.validation)), Counter(who_is(data.draw(np.random.default_rng(0))))
        assert out
        assert not out.keys() & trained.keys()
        assert out + trained == {n: 3 if n % 5 else 2 for n in range(200)}


def test_where_nobody_was_cut_the_hash_of_the_track_decides():
    """Pieces of people who are not in the recording change nothing; nor does whether there are others."""
    for ids in (range(300), [id_of(f"P{n}") for n in range(300)]):
        tracks = concatenate([straight(n, (0, 0), (1, 0), 20) for n in sorted(ids)])
        for pieces in (None, {7 * 10**6: 5}):
            day = day_of(tracks, [], Site(), pieces=pieces)
            key = stream_keys(day.tracks.track_id[day.rows[:, 0]], 1, "validation", 4)[:, 0]
            np.testing.assert_array_equal(persons_held_out([day], 0.3, 4)[0], key <= np.uint64(0.3 * 2.0**64))


def test_nobody_is_held_out_of_nobody():
    data = training_data([day_of(empty_tracks(), [paced(range(5))], Site())], "masked", 0.1, 0, *SHAPE)
    assert data.tracks == len(data.validation.past) == 0


def test_the_split_depends_on_the_seed_and_not_on_the_order():
    tracks = paced(range(300))
    order = np.random.default_rng(1).permutation(300)
    one, other = (
        training_data([day_of(table, [], Site())], "masked", 0.1, 0, *SHAPE)
        for table in (tracks, reordered(tracks, order))
    )
    assert sorted(who_is(one.validation)) == sorted(who_is(other.validation))
    assert sorted(training_people(one)) == sorted(training_people(other))
    assert who_is(one.validation) != who_is(other.validation)  # the same people in another order
    reseeded = training_data([day_of(tracks, [], Site())], "masked", 0.1, 1, *SHAPE)
    assert set(who_is(reseeded.validation)) != set(who_is(one.validation))


def test_held_out_people_are_seen_from_their_first_row():
    days = [day_of(concatenate([speeding(n, 20, 100.0 * n) for n in range(200)]), [], Site()) for _ in range(2)]
    data = training_data(days, "full", 0.2, 0, *SHAPE)
    assert len(data.validation.past) > 40
    assert (first_row_of(data.validation) == 0).all()
    assert len(data.days) == len(data.windows) == 2
    assert first_row_of(data.draw(np.random.default_rng(0))).any()


def test_validation_takes_futures_of_any_length():
    """`full` restricts what is trained on, not what is validated on."""
    tracks = concatenate([straight(n, (0, 0), (n / 100, 0), 16 if n % 2 else 8, 100.0 * n) for n in range(400)])
    data = training_data([day_of(tracks, [], Site())], "full", 0.2, 0, *SHAPE)
    assert set(data.validation.lengths().tolist()) == {4, 12}
    assert data.tracks == sum(n % 2 for n in training_people(data))
    assert (data.draw(np.random.default_rng(0)).lengths() == 12).all()


def test_full_futures_need_a_track_that_goes_on_for_the_horizon():
    days = [day_of(paced(range(50), rows=15), [], Site())]  # 11 steps of truth
    assert training_data(days, "full", 0.1, 0, 11, 4, 1.0).tracks > 40
    with pytest.raises(DataError, match=r"whole horizon of 12 s.*`futures: masked`.*shorter horizon_s"):
        training_data(days, "full", 0.1, 0, *SHAPE)
    assert training_data(days, "masked", 0.1, 0, *SHAPE).tracks > 40


# --- held out by days or by hours ---------------------------------------------------------------------------

HOUR_S, DAY_S = 3600.0, 86400.0


def at_times(ids, times):
    """One paced person an id, who comes at that time [s after START]."""
    return concatenate([straight(n, (0, 0), (n / 100, 0), 20, t) for n, t in zip(ids, times, strict=True)])


def by_blocks(days, seed=0):
    return training_data(days, "masked", 0.1, seed, *SHAPE, held_out="blocks")


def trained_on(data):
    """Ids of the paced people who are trained on, of several days as well."""
    return who_is(data.draw(np.random.default_rng(0)))


@pytest.mark.parametrize(("number", "held_out"), [(2, 1), (3, 1), (5, 1), (8, 2), (10, 2)])
def test_the_last_fifth_of_several_days_is_held_out(number, held_out):
    begin = DAY_S - START % DAY_S  # of a day
    ids = np.arange(10 * number).reshape(number, 10)
    days = [day_of(at_times(i, begin + n * DAY_S + 1000 * np.arange(10)), [], Site()) for n, i in enumerate(ids)]
    for some in (days, days[::-1]):  # whatever the order of the recordings
        data = by_blocks(some)
        assert sorted(who_is(data.validation)) == ids[number - held_out :].ravel().tolist()
        assert sorted(trained_on(data)) == ids[: number - held_out].ravel().tolist()


def test_a_day_ends_at_midnight_of_its_own_clock():
    """Two recordings of one day in Tokyo, which are of two days in London."""
    begin = DAY_S - START % DAY_S
    tables = [at_times(range(n, n + 40), begin + hour * HOUR_S + 10 * np.arange(40)) for n, hour in ((0, -2), (40, 1))]
    there, here = (
        [day_of(table, [], Site(timezone=zone)) for table in tables] for zone in ("Asia/Tokyo", "Europe/London")
    )
    assert sorted(who_is(by_blocks(here).validation)) == list(range(40, 80))
    assert len(who_is(by_blocks(there).validation)) < 40


def test_half_hours_of_one_day_are_held_out_whole():
    begin = DAY_S - START % DAY_S
    times = np.random.default_rng(3).uniform(0, 12 * HOUR_S, 1000)
    tracks = at_times(range(1000), begin + times)
    held_out = {}
    for seed in (0, 1):
        data = by_blocks([day_of(tracks, [], Site()), day_of(empty_tracks(), [tracks], Site())], seed)
        out, rest = who_is(data.validation), trained_on(data)
        assert sorted(out + rest) == list(range(1000))
        blocks = [set((times[people] // 1800).tolist()) for people in (out, rest)]
        assert not blocks[0] & blocks[1]
        assert len(blocks[0]) == 4  # of 24
        held_out[seed] = blocks[0]
    assert held_out[0] != held_out[1]


@pytest.mark.parametrize("span", [1.0, 60.0, 1000.0])
def test_a_short_recording_has_shorter_blocks(span):
    data = by_blocks([day_of(at_times(range(200), span * np.arange(200) / 200), [], Site())])
    assert 5 <= len(who_is(data.validation)) <= 60
    assert sorted(who_is(data.validation) + trained_on(data)) == list(range(200))


def test_people_of_one_moment_cannot_be_held_out_by_time():
    with pytest.raises(DataError, match=r"begin at the same moment.*`held_out: persons`"):
        by_blocks([day_of(at_times(range(30), np.zeros(30)), [], Site())])
    nobody = by_blocks([day_of(empty_tracks(), [paced(range(5))], Site())])
    assert nobody.tracks == len(nobody.validation.past) == 0


# --- more than one window of a track ------------------------------------------------------------------------


def test_long_tracks_give_more_windows_if_asked_for():
    tables = [speeding(n, rows, 100.0 * n) for n, rows in enumerate([6, 14, 44] * 100)]
    days = [day_of(concatenate(tables), [], Site())]
    once, more = (training_data(days, "masked", 0.1, 0, *SHAPE, another_every=every) for every in (None, 10))
    assert once.drawn == once.tracks == more.tracks
    numbers = more.windows[0]
    assert set(numbers.tolist()) == {2, 10, 40}
    scenes = more.draw(np.random.default_rng(1))
    assert len(scenes.past) == more.drawn == (1 + numbers // 10).sum()
    ordinary = once.draw(np.random.default_rng(1))
    np.testing.assert_array_equal(scenes.past[: once.tracks], ordinary.past)
    starts = first_row_of(scenes)[once.tracks :]
    assert starts.max() == 39
    assert np.mean(starts == 0) < 0.1
    assert len(more.validation.past) == len(once.validation.past)
