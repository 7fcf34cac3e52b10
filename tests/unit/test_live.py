"""Forecasts of a stream: what is known at t0 decides, and nothing that arrives makes it fail or grow."""

import dataclasses
import sys

import numpy as np
import pytest

import modlhmp
from modlhmp import DataError, Live
from modlhmp.contract import SITE, crowd
from modlhmp.live import MOST_ROWS
from modlhmp.live_clock import MOST_LATE, MOST_WAITING
from modlhmp.time_step import ending_at
from modlhmp.tracks import Tracks

T0 = 1.3e9


def present_crowd():
    """The people of `crowd`, all within half a minute, with rows at whole seconds."""
    people = crowd()
    began = people.t[people.bounds()[:-1]]
    later = np.repeat(began - T0 - 3.0 * (np.arange(len(began)) % 7), np.diff(people.bounds()))
    return people._replace(t=people.t - later)


PEOPLE = present_crowd()
METHODS = {
    "cliff": {"k": 3},
    "tc_cliff": {"k": 3},
    "stef": {"k": 3},
    "episodes": {"persons": 3},
    "snippets": {"k": 7},
    "pooled": {"k": 7},
    "cvm": {"site": SITE},
}


@pytest.fixture(scope="module")
def maps():
    return {kind: kind if kind == "cvm" else modlhmp.build_map(kind, PEOPLE, SITE) for kind in METHODS}


def fed(live, rows, order=None):
    """A live forecaster that has seen the rows of a track table, as they happened or in another order."""
    for row in np.argsort(rows.t, kind="stable") if order is None else order:
        live.see(rows.t[row], int(rows.track_id[row]), rows.x[row], rows.y[row])
    return live


def cvm(**asked):
    return Live("cvm", 5, site=SITE, **asked)


def walk(live, who, times, speed=1.2, y=0.0):
    """Somebody walks along the x axis, seen at these seconds after `T0`; what came of each row."""
    return [live.see(T0 + t, who, speed * t, y) for t in times]


def assert_same(ours, theirs, rows=slice(None)):
    """The same people, whatever their order, and every number of theirs to the bit."""
    by_id = [np.argsort(ours.track_id), np.arange(len(theirs.track_id))[rows][np.argsort(theirs.track_id[rows])]]
    pairs = [(ours.track_id, theirs.track_id), (ours.t0, theirs.t0), (ours.start, theirs.start)]
    for a, b in [*pairs, *zip(ours.forecast[:3], theirs.forecast[:3], strict=True)]:
        np.testing.assert_array_equal(a[by_id[0]], b[by_id[1]])
    assert ours.forecast.output == theirs.forecast.output


# --- what is known at t0 decides -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", METHODS)
def test_a_batch_forecast_of_a_track_cut_at_t0_is_the_same_to_the_bit(maps, kind):
    """And whoever else is there, in whatever order the rows came, and whatever comes after t0."""
    a_map, options = maps[kind], {"seed": 3, "key": ("a", "b", "c"), **METHODS[kind]}
    for at in (9.0, 18.0):
        t0, live = T0 + at, Live(a_map, 8, **options)
        past, more = PEOPLE.take(PEOPLE.t <= t0), PEOPLE.take(PEOPLE.t <= t0 + 1)
        site = {"site": SITE} if kind == "cvm" else {}
        batch = modlhmp.forecast(
            a_map, PEOPLE.seen_by(t0, rows=4), 8, seed=3, key=("a", "b", "c"), **live.options, **site
        )
        assert len(batch.track_id) > 10
        assert_same(fed(live, past).forecast(), batch)
        late = Live(a_map, 8, **options)
        fed(late, more, np.argsort(more.t + np.random.default_rng(1).uniform(0, 4, len(more.t))))
        assert late.counts["out_of_order"] > 50
        assert_same(late.forecast(t0), batch)
        some = [0, 4]
        chosen = past.take(np.isin(past.track_id, batch.track_id[some]))
        assert_same(fed(Live(a_map, 8, **options), chosen).forecast(t0), batch, some)


@pytest.mark.parametrize(("kind", "leave"), [
    ("cliff", None), ("cliff", "map"), ("episodes", None), ("snippets", False), ("snippets", True), ("cvm", None),
])  # fmt: skip
def test_the_options_are_all_that_are_used(maps, kind, leave):
    """Ways out among them: with the horizon, the seed, the key and the site they are the whole batch forecast."""
    asked = {} if leave is None else {"exits": leave}
    if leave == "map":
        asked = {"exits": modlhmp.build_map("exits", PEOPLE, SITE)}
    live = Live(maps[kind], 8, seed=2, **METHODS[kind] | asked)
    past = PEOPLE.take(PEOPLE.t <= T0 + 9)
    track, options = PEOPLE.seen_by(T0 + 9, rows=4), {"site": live.site, **live.options}
    assert_same(fed(live, past).forecast(), modlhmp.forecast(maps[kind], track, live.horizon_s, seed=2, **options))


@pytest.mark.parametrize("kind", ["episodes", "cliff"])
def test_rows_of_any_rate_lie_on_the_grid_that_ends_at_t0(maps, kind):
    rng, parts = np.random.default_rng(2), []
    for who in range(6):
        t = np.sort(rng.uniform(0, 14, int(rng.uniform(30, 150))))
        x, y = 1.2 * t - 8 + rng.normal(0, 0.02, len(t)), np.full(len(t), 0.1 * who)
        parts.append(Tracks(np.full(len(t), who), T0 + t, x, y, *np.full((2, len(t)), np.nan)))
    people = Tracks(*map(np.concatenate, zip(*parts, strict=True)))
    live = Live(maps[kind], 8, **METHODS[kind])
    past = people.take(people.t <= T0 + 12.3)
    ours = fed(live, past).forecast(T0 + 12.3)
    grid, state = ending_at(people, T0 + 12.3, 1.0, 4)
    assert live.present == {"here": 6, "new": 0, "gone": 0} and not state.any()
    theirs = modlhmp.forecast(maps[kind], grid, 8, **live.options)
    assert_same(ours, theirs)


def test_defaults_suit_a_stream_of_positions(maps, caplog):
    """Said in `options`, and a recorded velocity that nobody has is no reason to stop."""
    assert Live(maps["episodes"]).options["samples"] == "pieces"
    assert Live(maps["pooled"]).options["samples"] == "pieces"
    assert Live(maps["episodes"], samples="persons").options["samples"] == "persons"
    recorded = dataclasses.replace(SITE, velocity="as_recorded")
    a_map = modlhmp.Map("cliff", recorded, maps["cliff"].whole, {})
    assert Live(a_map).options["velocity"] == "differences"
    assert "positions alone" in caplog.text
    with pytest.raises(DataError, match="use velocity='differences'"):
        Live(a_map, velocity="dataset")


# --- who is there ----------------------------------------------------------------------------------------------------


def test_who_is_here_new_or_gone():
    live = cvm()
    walk(live, "ann", range(10))
    walk(live, 7, range(8, 10))
    walk(live, "P02", range(6))
    futures = live.forecast()
    assert live.now == T0 + 9
    assert live.present == {"here": 1, "new": 1, "gone": 1}
    assert [live.who[one] for one in futures.track_id] == ["ann"]
    np.testing.assert_allclose(futures.best[0, :, 0], 1.2 * np.arange(10, 15), atol=1e-5)
    walk(live, 7, range(10, 12))
    assert [live.who[one] for one in live.forecast().track_id] == [7], "a number stays one"
    assert live.present == {"here": 1, "new": 0, "gone": 2}


def test_ids_that_vanish_are_forgotten_and_begin_anew():
    live = cvm()
    walk(live, 1, range(10))
    walk(live, 2, range(30, 34))
    assert live.forecast().track_id.tolist() == [2]
    assert live.present == {"here": 1, "new": 0, "gone": 0}, "1 is forgotten"
    walk(live, 3, range(34, 38))
    walk(live, 2, range(37, 42))
    live.forecast()
    assert live.present["here"] == 1 and live.counts["cut_at_gap"] == 0, "a gap of 4 s is bridged"
    walk(live, 2, [48])
    live.forecast()
    assert live.present["new"] == 1 and live.counts["cut_at_gap"] == 1


def test_nobody():
    live = cvm()
    with pytest.raises(DataError, match="nobody has been seen yet"):
        live.forecast()
    assert live.forecast(T0).paths.shape == (0, 1, 5, 2)
    futures = live.forecast(T0)
    assert futures.occupancy(extent=(0, 3, 0, 2)).probabilities.sum() == 0
    assert futures.best.shape == (0, 5, 2)
    walk(live, 1, range(5))
    assert not len(live.forecast(T0 + 900).track_id)
    for t0 in (float("nan"), "now", True, 1e15, 10**400):
        with pytest.raises(DataError, match="give a time in unix s"):
            live.forecast(t0)
    with pytest.raises(DataError, match="before the newest row"):
        live.forecast(T0 + 2.5)
    for most in (0, True, 2.5, "10"):
        with pytest.raises(DataError, match="most_people"):
            cvm(most_people=most)
    with pytest.raises(DataError, match="unknown key 'beta'"):
        cvm(beta=1)


# --- rows as they come -----------------------------------------------------------------------------------------------


BAD = [
    (float("nan"), 1, 0, 0), (T0, 1, float("inf"), 0), (T0, 1, 0, None), ("now", 1, 0, 0), (T0 * 1000, 1, 0, 0),
    (T0, None, 0, 0), (T0, "", 0, 0), (T0, float("nan"), 0, 0), (T0, True, 0, 0), (T0, [1], 0, 0), (T0, 1, 1e9, 0),
    (T0, "NULL", 0, 0), (T0, -1, 0, 0), (T0, "-1.0", 0, 0),
    (T0, "\ud800", 0, 0), (True, 1, 0, 0), (T0, 1, "3", 0), (T0, 1, 0, 1j),
]  # fmt: skip


@pytest.mark.parametrize("row", BAD, ids=str)
def test_what_is_no_row_is_counted_and_changes_nothing(row):
    live = cvm()
    walk(live, 1, range(6))
    before = live.forecast()
    assert live.see(*row) == "bad"
    assert live.counts["bad"] == 1
    assert_same(live.forecast(), before)


def test_repeated_late_and_out_of_order_rows():
    straight, live = cvm(), cvm()
    walk(straight, 1, np.arange(0, 8, 0.5))
    mixed = [0, 1, 0.5, 2, 1.5, 2, 4, 3, 3.5, 2.5, 5, 6, 5.5, 4.5, 7, 6.5, 7.5]
    assert walk(live, 1, mixed).count("repeated") == 1
    assert live.counts["out_of_order"] == 8
    assert_same(live.forecast(), straight.forecast())
    live.see(T0 + 5, 1, 99.0, 99.0)
    assert_same(live.forecast(), straight.forecast())
    walk(live, 2, range(20, 24))
    assert walk(live, 1, [7.5 + 0.25]) == ["late"], "nothing at the newest moment needs it"
    assert live.counts["late"] == 1
    assert live.counts["taken"] == 16 + 4


def test_a_late_row_of_another_place_is_no_part_of_a_track():
    live = cvm()
    walk(live, 1, [0, 1, 2, 3, 5, 6])
    before = live.forecast()
    assert live.see(T0 + 4, 1, 80.0, 0.0) == "bad"
    assert_same(live.forecast(), before)


def test_a_jump_begins_a_track_anew():
    """As in a recording: an id that changes hands has no velocity of 100 m/s."""
    live = cvm()
    walk(live, 1, range(6))
    walk(live, 1, range(6, 9), y=80.0)
    live.forecast()
    assert live.present["new"] == 1
    assert live.counts["cut_at_jump"] == 1
    walk(live, 1, [9], y=80.0)
    np.testing.assert_allclose(live.forecast().best[0, :, 1], 80.0)


def test_time_that_passes_without_anybody():
    live = cvm()
    walk(live, 1, range(6))
    assert live.pass_time(T0 + 30) == ""
    assert (live.now, len(live.forecast().t0)) == (T0 + 30, 0)
    assert (live.pass_time(T0 + 8), live.pass_time(float("nan"))) == ("late", "bad")
    assert (live.counts["late"], live.counts["bad"]) == (1, 1)


@pytest.mark.parametrize("kind", METHODS)
def test_warming_up_changes_nothing(maps, kind):
    one, other = (Live(maps[kind], 8, **METHODS[kind]) for _ in range(2))
    one.warm_up()
    for live in (one, other):
        walk(live, 1, range(6))
    assert_same(one.forecast(), other.forecast())
    assert one.counts == other.counts


def test_a_clock_that_jumps():
    """Forward at once; back after ten rows from long ago, so that one sensor's late rows do not set it back."""
    live = cvm()
    walk(live, 1, range(6))
    walk(live, 1, range(3600, 3604))
    assert live.now == T0 + 3603
    assert live.forecast().track_id.tolist() == [1]
    came = walk(live, 1, np.arange(100, 104, 0.1))
    assert came == ["late"] * (MOST_LATE - 1) + [""] * (40 - MOST_LATE + 1)
    assert (live.counts["clock_set_back"], live.now) == (1, pytest.approx(T0 + 103.9))
    walk(live, 1, np.arange(104, 105, 0.1))
    assert live.forecast().track_id.tolist() == [1]
    other = cvm()
    for second in range(60):
        walk(other, 1, [100 + second])
        walk(other, 2, [second])  # half a minute late for good
    assert other.counts["clock_set_back"] == 0
    assert other.counts["late"] == 60
    assert other.forecast().track_id.tolist() == [1]


def ticks(live, people, ahead_s, first=False, number=100):
    """People seen at 10 Hz, and one beside them whose clock is ahead; how many a forecast of each tick has."""
    found = []
    for tick in range(number):
        t = T0 + tick / 10
        rows = [(t, who, 0.12 * tick, float(who)) for who in range(people)]
        rows.insert(0 if first else people, (t + ahead_s, "ahead", 0.0, 0.0))
        for row in rows:
            live.see(*row)
        found.append(len(live.forecast().t0))
    return found


@pytest.mark.parametrize(("people", "ahead_s"), [(12, 3600.0), (5, 3600.0), (2, 8.9), (1, 6.0)])
def test_one_person_whose_clock_is_ahead_silences_nobody(caplog, people, ahead_s):
    live = cvm()
    assert ticks(live, people, ahead_s)[30:] == [people] * 70
    assert (live.counts["clock_set_back"], live.counts["late"]) == (0, 0)
    assert (live.counts["ahead"], live.counts["taken"]) == (100, 100 * people)
    assert len(caplog.messages) == 1
    assert "Live: a row of 'ahead' is" in caplog.text


def test_nor_does_one_who_was_there_first():
    """Several who agree are believed, once ten rows of theirs are late; one against one is not decided."""
    live = cvm()
    assert ticks(live, 5, 3600.0, first=True)[40:] == [5] * 60
    assert (live.counts["clock_set_back"], live.counts["late"]) == (1, MOST_LATE - 1)


def test_a_single_row_from_ahead_costs_nothing():
    one, other = cvm(), cvm()
    for live in (one, other):
        walk(live, 1, range(6))
        walk(live, 2, range(6), y=1.0)
    assert walk(one, 2, [13.9], y=1.0) == [""]
    assert one.now == T0 + 5
    assert_same(one.forecast(), other.forecast())
    for live in (one, other):
        walk(live, 1, [6])
        walk(live, 2, [6], y=1.0)
    assert_same(one.forecast(), other.forecast())
    assert one.counts == {**other.counts, "ahead": 1}


def test_time_that_goes_on_loses_no_row():
    """For several at the second person's row; for one as soon as there could be a forecast, or if nobody else is."""
    several, one, lone = cvm(), cvm(), cvm()
    for live in (several, one):
        walk(live, 1, range(6))
        walk(live, 2, range(6), y=1.0)
    walk(several, 1, [60])
    assert (several.now, several.counts["ahead"]) == (T0 + 5, 1)
    walk(several, 2, [60], y=1.0)
    assert (several.now, several.counts["ahead"], several.counts["taken"]) == (T0 + 60, 0, 14)
    walk(one, 3, [60, 61, 62])
    assert one.now == T0 + 5
    walk(one, 3, [63])
    assert (one.now, one.forecast().track_id.tolist()) == (T0 + 63, [3])
    walk(lone, 1, range(6))
    walk(lone, 1, [60])
    assert lone.now == T0 + 60


@pytest.mark.parametrize("rows", [4, 8])
def test_who_comes_after_a_pause_is_new_from_the_first_row(rows):
    """And who has been silent is not `here`, whether one or two were there before."""
    for before in (1, 2):
        live = Live("cvm", 5, site=dataclasses.replace(SITE, observed_rows=rows))
        for t in range(20):
            for who in range(before):
                walk(live, who, [t])
            assert live.forecast().track_id.tolist() == (list(range(before)) if t >= rows - 1 else [])
        for t in range(80, 80 + rows - 1):
            walk(live, "b", [t])
            assert len(live.forecast().t0) == 0
            assert (live.present["here"], live.present["new"]) == (0, 1)
        walk(live, "b", [80 + rows - 1])
        assert [live.who[one] for one in live.forecast().track_id] == ["b"]
        assert (live.now, live.counts["ahead"], live.counts["late"]) == (T0 + 79 + rows, 0, 0)


def test_whose_clock_is_ahead_is_believed_once_though_a_forecast_is_asked_after_every_row():
    """A newcomer's wrong row costs a forecast before the next right one; that of somebody known costs nothing."""
    live, found = cvm(), []
    for tick in range(100):
        for who, ahead_s in ((1, 0.0), ("ahead", 3600.0), (2, 0.0)):
            live.see(T0 + tick / 10 + ahead_s, who, 0.12 * tick, 0.0)
            found.append(len(live.forecast().t0))
    assert found[93:] == [2] * 207
    assert (live.counts["late"], live.counts["ahead"], live.counts["taken"]) == (0, 100, 200)
    live, found = cvm(), []
    for tick in range(100):
        for who in (1, 2):
            live.see(T0 + tick / 10 + 30 * (tick == 80 and who == 2), who, 0.12 * tick, 0.0)
            found.append(len(live.forecast().t0))
    assert found[62:] == [2] * 138
    assert (live.counts["ahead"], live.counts["taken"]) == (1, 199)


def test_who_asks_for_a_later_time_says_that_it_is():
    live = cvm()
    for who in (1, 2):
        walk(live, who, range(6))
    walk(live, 3, [60.0, 60.5, 61.0])
    live.forecast(T0 + 61)
    assert (live.present, live.counts["ahead"]) == ({"here": 0, "new": 1, "gone": 0}, 0)
    walk(live, 1, [70])
    live.pass_time(T0 + 70)
    assert (live.now, live.counts["ahead"]) == (T0 + 70, 0)


# --- bounded memory --------------------------------------------------------------------------------------------------


def held(live):
    """Bytes of all rows, and how many people there are."""
    parts = [part for person in live._people.values() for part in person.rows]
    return sum(map(sys.getsizeof, parts)), len(live._people)


def test_people_are_bounded_and_the_known_go_on():
    live = cvm(most_people=50)
    for t in range(8):
        for who in range(80):
            live.see(T0 + t, who, 1.2 * t, float(who))
    assert held(live)[1] == 50
    assert live.counts["turned_away"] == 8 * 30
    assert live.forecast().track_id.tolist() == list(range(50))
    for who in range(100, 140):  # once the others are gone there is room again
        assert live.see(T0 + 60, who, 0.0, 0.0) == ""
    assert held(live)[1] == 40


def test_what_a_sensor_of_100_hz_tells_is_kept():
    live = cvm()
    assert set(walk(live, 1, np.arange(0, 60, 0.01))) == {""}
    assert live.counts["thinned"] == 0
    assert held(live)[0] <= 3 * 8 * MOST_ROWS * 1.3 + 500


def test_a_fast_sensor_is_thinned_and_forecast_all_the_same():
    live = cvm()
    times = np.arange(0, 30, 0.001)
    walk(live, 1, times)
    size, _ = held(live)
    assert size <= 3 * 8 * MOST_ROWS * 1.3 + 500
    assert live.counts["thinned"] > 20_000
    np.testing.assert_allclose(live.forecast().best[0, :, 0], 1.2 * (times[-1] + np.arange(1, 6)), atol=1e-4)


def test_memory_is_flat():
    """Of a walker for a day at 1 Hz, of ids that never come back, and of rows that are all refused."""
    live, sizes = cvm(), []
    for hour in range(6):
        walk(live, 1, np.arange(3600 * hour, 3600 * (hour + 1)), speed=0.0)
        sizes.append(held(live)[0])
    assert max(sizes) <= 2000
    for second in range(5000):
        live.see(T0 + 1e5 + second, f"once {second}", 0.0, 0.0)
    assert held(live)[1] < 30
    live.forecast()
    assert len(live.who) <= 30
    for one in range(3000):  # from ahead, all in a second
        live.see(T0 + 2e5 + one / 3000, "ahead", 0.0, 0.0)
    assert len(live.clock.waiting) == MOST_WAITING
    assert live.counts["ahead"] == 3000
