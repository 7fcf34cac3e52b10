"""Maps that are updated: what equals what to the bit, what each is written out as, and what is refused."""

import dataclasses
import itertools
import json
import math
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

import modlhmp
from modlhmp.cli import app
from modlhmp.contract import SITE, crowd
from modlhmp.exchange.maps import kind_in
from modlhmp.kinds import find
from modlhmp.live_map import Learner
from modlhmp.maps import cliff, swgmm
from modlhmp.maps.updated import cells
from modlhmp.maps.updated.counted import packed, unpacked
from modlhmp.site import Site
from modlhmp.storage import DataError, column
from modlhmp.tracks import Tracks, concatenate
from modlhmp.updates import STATES, UpdatedMap

KINDS = list(STATES)
COUNTS = ["cliff", "tc_cliff", "stef"]
MONDAY = crowd(people=24)
DAY_S = 86400.0


def on_day(number, people=24):
    """Other people's tracks, so many days after `MONDAY`."""
    walked = crowd(people=people)
    return walked._replace(t=walked.t + number * DAY_S, x=-walked.x, track_id=walked.track_id + 1000 * number)


def made(kind, *batches, half_life_h=None, **building):
    """A map that was told of batches, all of recording `hall`."""
    found = UpdatedMap(kind, SITE, half_life_h, **building)
    for batch in batches:
        found.add(batch, "hall")
    return found


def assert_same(ours, theirs):
    """Both hold, and are written out as, the same to the bit."""
    assert ours._state.state().equals(theirs._state.state())
    mine, its = ours.written(), theirs.written()
    assert mine.hours.keys() == its.hours.keys()
    pairs = [(mine.whole, its.whole), *((mine.hours[hour], its.hours[hour]) for hour in mine.hours)]
    assert all(one.equals(other, check_metadata=True) for one, other in pairs)


def in_pieces(tracks, number, seed=0):
    """Pieces of five rows dealt out at random to so many batches: persons and hours are torn apart."""
    of = np.random.default_rng(seed).integers(0, number, len(tracks.t) // 5 + 1).repeat(5)[: len(tracks.t)]
    return [tracks.take(of == one) for one in range(number)]


# --- what equals what -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("half_life_h", [None, 1.5])
@pytest.mark.parametrize("kind", KINDS)
def test_one_batch_is_many_in_any_order(kind, half_life_h):
    whole = concatenate([MONDAY, on_day(1)])
    one = made(kind, whole, half_life_h=half_life_h)
    cut = np.array_split(np.argsort(whole.t, kind="stable"), 7)
    pieces = [whole.take(np.sort(rows)) for rows in cut]
    for order in (range(7), [4, 0, 6, 2, 5, 1, 3]):
        assert_same(made(kind, *(pieces[piece] for piece in order), half_life_h=half_life_h), one)


@pytest.mark.parametrize("kind", KINDS)
def test_reading_between_updates_changes_nothing(kind):
    told = UpdatedMap(kind, SITE, 1.0)
    for piece in (MONDAY, on_day(2), on_day(1)):
        told.add(piece, "hall")
        told.written()
    told.forget(2.0)
    told.written()
    told.forget(1.0)
    assert_same(told, made(kind, MONDAY, on_day(1), on_day(2), half_life_h=1.0))


@pytest.mark.parametrize("kind", KINDS)
def test_merged_maps_are_the_map_of_both(kind):
    both = made(kind, MONDAY, on_day(1))
    for first, second in itertools.permutations([MONDAY, on_day(1)]):
        merged = made(kind, first)
        merged.written()
        assert merged.merge(made(kind, second)) == 0
        assert_same(merged, both)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_added_can_be_removed(kind):
    before, after = made(kind, MONDAY), made(kind, MONDAY)
    after.add(on_day(1), "hall")
    after.written()
    used = after.remove(day=_day_of(on_day(1)))
    assert used == (int((on_day(1).speed > 0).sum()) if kind in COUNTS else len(on_day(1).t))
    assert_same(after, before)


@pytest.mark.parametrize("half_life_h", [None, 3.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_map_that_holds_nobody_is_not_written(kind, half_life_h, tmp_path):
    """New, emptied again, or of one row: with it a forecaster would know nobody, and not say so."""
    told = made(kind, MONDAY, half_life_h=half_life_h)
    told.remove(day=_day_of(MONDAY))
    of_a_row = [] if kind in {"episodes", "stef"} else [made(kind, MONDAY.take([0]), half_life_h=half_life_h)]
    for empty in (told, made(kind, half_life_h=half_life_h), *of_a_row):
        with pytest.raises(DataError, match=f"the map of kind {kind} is empty: .*; add tracks first"):
            empty.written()
        empty.save(tmp_path / "state.parquet")
        assert UpdatedMap.load(tmp_path / "state.parquet").kind == kind


def _day_of(tracks):
    return str(np.datetime64(int(tracks.t[0]), "s").astype("datetime64[D]"))


@pytest.mark.parametrize("kind", KINDS)
def test_it_is_saved_and_goes_on(kind, tmp_path):
    first = made(kind, MONDAY, half_life_h=3.0)
    first.save(tmp_path / "state.parquet")
    again = UpdatedMap.load(tmp_path / "state.parquet")
    assert (again.kind, again.site, again.half_life_h) == (kind, SITE, 3.0)
    assert_same(again, first)
    again.add(on_day(1), "hall")
    assert_same(again, made(kind, MONDAY, on_day(1), half_life_h=3.0))


@pytest.mark.parametrize("kind", ["episodes", "snippets", "exits"])
def test_a_person_is_taken_out_of_a_kept_map(kind):
    without = made(kind, MONDAY.take(MONDAY.track_id != 5))
    told = made(kind, MONDAY)
    assert told.remove(person=5, recording="hall") == 20
    assert_same(told, without)
    with pytest.raises(DataError, match=r"person 5: the map has nobody of that number in recording 'hall'; .*'hall'"):
        told.remove(person=5, recording="hall")


# --- what it is written out as ----------------------------------------------------------------------------------------


def test_stef_equals_what_is_built_at_once():
    tracks = concatenate([MONDAY, on_day(1), on_day(3)])
    built, ours = modlhmp.build_map("stef", tracks, SITE), made("stef", *in_pieces(tracks, 3)).written()
    assert built.hours.keys() == ours.hours.keys() and built.whole.schema.equals(ours.whole.schema, check_metadata=True)
    for one, other in ((built.whole, ours.whole), *((built.hours[hour], ours.hours[hour]) for hour in built.hours)):
        for name in one.column_names:
            np.testing.assert_allclose(column(other, name), column(one, name), rtol=0, atol=1e-9)


def test_a_map_that_waits_for_its_hours_is_told(tmp_path, caplog):
    """By the command that writes it, once; `Live` tells once that it knows nobody, though it reads it every hour.

    It may be written before these come, where a map that is built at once would be a mistake.
    """
    site = dataclasses.replace(SITE, hours=(9, 12))
    told = UpdatedMap("tc_cliff", site)
    told.add(MONDAY, "hall")
    assert told.written().hours == {}
    with pytest.raises(DataError, match="of which the site's `hours`"):
        modlhmp.build_map("tc_cliff", MONDAY, site)
    told.save(tmp_path / "state.parquet")
    done = CliRunner().invoke(app, ["map", "update", str(tmp_path / "state.parquet"), "--out", str(tmp_path / "hours")])
    assert done.exit_code == 0 and "none of the hours 9, 10, 11 of its site yet" in done.output
    live = modlhmp.Live(told, 3.0)
    for _, rows in frames(MONDAY):
        for row in rows:
            live.see(*row)
        live.forecast()
    said = [one for one in caplog.messages if "hour" in one]
    assert live._learner.version > 1 and len(said) == 1
    assert "it has no map of an hour yet" in said[0] and "time zone" not in said[0]


@pytest.mark.parametrize("hours", [None, (7, 8), (8, 10), (22, 9)])
@pytest.mark.parametrize("kind", [name for name in KINDS if find(name).hourly])
def test_it_has_the_hours_of_what_is_built_at_once(kind, hours):
    """Those that the site lists, and no others; of rows of which some lie outside these, too."""
    site = dataclasses.replace(SITE, hours=hours)
    built, told = modlhmp.build_map(kind, MONDAY, site), UpdatedMap(kind, site)
    for batch in in_pieces(MONDAY, 2):
        told.add(batch, "hall")
        told.written()
    ours = told.written()
    assert list(ours.hours) == list(built.hours)
    for one, other in ((built.whole, ours.whole), *((built.hours[hour], ours.hours[hour]) for hour in built.hours)):
        assert {*zip(column(one, "x"), column(one, "y"), strict=True)} == {
            *zip(column(other, "x"), column(other, "y"), strict=True)
        }


@pytest.mark.parametrize("interval_s", [3600.0, 450.0, 240.0])
def test_stef_has_the_hours_of_what_is_built_at_once(interval_s):
    """Of rows of one hour alone, at its very ends, too."""
    site, hour = dataclasses.replace(SITE, hours=None), 3600.0 * np.floor(MONDAY.t[0] / 3600.0)
    for from_s in (0.0, 1800.0, 3580.0):
        rows = MONDAY.take(MONDAY.track_id == 0)
        rows = rows._replace(t=rows.t - rows.t[0] + hour + from_s)
        ours = UpdatedMap("stef", site, interval_s=interval_s)
        ours.add(rows)
        assert list(ours.written().hours) == list(modlhmp.build_map("stef", rows, site, interval_s=interval_s).hours)


@pytest.mark.parametrize("interval_s", [7200.0, 5000.0, 4500.0, 2400.0, 7.0])
def test_an_interval_divides_an_hour(interval_s):
    """Counts of one over several hours do not say of which; that is a matter of the map that is built at once."""
    with pytest.raises(DataError, match=rf"interval_s {interval_s}: .*divides an hour.*such as 600.*build_map"):
        UpdatedMap("stef", SITE, interval_s=interval_s)


@pytest.mark.parametrize("kind", ["episodes", "exits"])
def test_kept_maps_equal_what_is_built_at_once(kind):
    built = modlhmp.build_map(kind, MONDAY, SITE).whole
    assert made(kind, *in_pieces(MONDAY, 3)).written().whole.equals(built, check_metadata=True)


def test_snippets_are_a_fair_choice_of_those_built_at_once():
    """The same bins with the same numbers; with room for all, the same snippets."""
    for most, compared in ((1000, None), (3, ("i", "j", "bin", "stands_for"))):
        built = modlhmp.build_map("snippets", MONDAY, SITE, most=most, cell_m=4.0).whole
        ours = made("snippets", *in_pieces(MONDAY, 3), most=most, cell_m=4.0).written().whole
        rows = [sorted(map(str, table.select(compared or table.column_names).to_pylist())) for table in (built, ours)]
        assert rows[0] == rows[1]


def test_a_cliff_map_has_the_locations_and_counts_of_the_rows():
    for building in ({}, {"resolution_m": 0.7, "radius_m": 1.3, "min_observations": 9}):
        built = modlhmp.build_map("cliff", MONDAY, SITE, **building).whole
        ours = made("cliff", *in_pieces(MONDAY, 3), **building).written().whole
        assert ours.schema.equals(built.schema)
        places = [set(zip(*(table[name].to_pylist() for name in ("x", "y", "count", "p")), strict=True))
                  for table in (built, ours)]  # fmt: skip
        assert places[0] == places[1]
        assert column(ours, "count").dtype == np.int32


@pytest.mark.parametrize("kind", KINDS)
def test_every_forecaster_reads_it(kind):
    told = made(kind, MONDAY, on_day(1), half_life_h=10.0).written()
    if kind == "exits":
        told, exits = modlhmp.build_map("cliff", MONDAY, SITE), told
        assert modlhmp.forecast(told, MONDAY.seen_by(MONDAY.t[10], 4), 3.0, exits=exits).forecast.xy.shape[2] == 3
    else:
        assert modlhmp.forecast(told, MONDAY.seen_by(MONDAY.t[10], 4), 3.0).forecast.xy.shape[2] == 3


# --- histograms -------------------------------------------------------------------------------------------------------


def test_codes_are_cells_and_bins():
    i, j, bins = np.array([-5, 0, 5_400_000]), np.array([7, -1, -900_000]), np.array([0, 4095, 17])
    assert all(np.array_equal(*pair) for pair in zip(unpacked(packed(i, j, bins)), (i, j, bins), strict=True))
    with pytest.raises(DataError, match="are positions in m"):
        packed(np.array([1 << 24]), np.array([0]), np.array([0]))


def test_em_of_a_histogram_is_em_of_its_rows():
    """Every row at the middle of its bin: where the EM of rows leads, in fewer steps."""
    rng = np.random.default_rng(3)
    heading, speed = rng.normal(0.4, 0.6, 3000), np.abs(rng.normal(1.4, 0.4, 3000))
    bins, counts = np.unique(cells.bins_of(heading, speed), return_counts=True)
    middle = (bins // cells.SPEEDS + 0.5) * cells.HEADING_STEP, (bins % cells.SPEEDS + 0.5) * cells.SPEED_STEP
    start = np.array([[0.5, 0.0, 1.0, 0.3, 0.0, 0.1], [0.5, 1.0, 1.6, 0.3, 0.0, 0.1]])
    ours = start.copy()
    cells._em(*middle, counts.astype(float), ours)
    rows = [np.repeat(part, counts) for part in middle]
    theirs, log_likelihood = swgmm.fit(*rows, start)
    assert swgmm.log_density(*rows, ours).sum() > log_likelihood - 3e-4 * len(rows[0])
    np.testing.assert_allclose(ours, theirs, atol=0.05)
    assert ours[:, 0].sum() == pytest.approx(1)


@pytest.mark.parametrize("ways", [[0.3], [0.3, 0.3 + np.pi], [3.1, 1.4, -1.8]])
def test_a_histogram_describes_new_people_as_their_rows_do(ways):
    """Within 0.01 nat, over many draws of 900 rows."""
    lost = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        rows, new = (
            (np.concatenate([rng.normal(way, 0.25, n) for way in ways]), rng.normal(1.3, 0.25, n * len(ways)))
            for n in (900 // len(ways), 1000)
        )
        bins, counts = np.unique(cells.bins_of(*rows), return_counts=True)
        _, found = cells.fit_cells(np.array([0, len(bins)]), bins, counts.astype(float))
        exact = cliff.fit_location(*rows)
        lost.append(swgmm.log_density(*new, exact).mean() - swgmm.log_density(*new, found).mean())
    assert np.mean(lost) < 0.01


def test_what_is_not_seen_keeps_its_shape():
    """Of a location that nobody passes, only the weight of its evidence falls."""
    west = MONDAY.take(MONDAY.x < -4)
    told = made("cliff", MONDAY, half_life_h=2.0)
    before = told.written().whole
    told.add(on_day(1)._replace(x=-np.abs(on_day(1).x) - 4.0), "hall")
    after = told.written().whole
    at = {side: np.flatnonzero(column(table, "x") > 5) for side, table in (("before", before), ("after", after))}
    assert len(at["before"]) and len(west.t)
    for name in ("weight", "mean_heading", "var_speed", "count"):
        assert np.array_equal(column(before, name)[at["before"]], column(after, name)[at["after"]])
    assert (column(after, "p")[at["after"]] < 0.01 * column(before, "p")[at["before"]]).all()


def test_what_is_new_counts_more():
    """People turn round after a day: with a half-life of an hour nearly all go the new way, without one half do."""
    turned = MONDAY._replace(
        t=MONDAY.t + DAY_S, heading=MONDAY.heading - np.pi * np.sign(MONDAY.heading), track_id=MONDAY.track_id + 1000
    )
    one_way = np.abs(MONDAY.heading) < 1
    old, new = MONDAY.take(one_way), turned.take(one_way)

    def eastward(half_life_h):
        table = made("cliff", old, new, half_life_h=half_life_h).written().whole
        east = np.cos(column(table, "mean_heading")) > 0
        return column(table, "weight")[east].sum() / column(table, "weight").sum()

    assert eastward(None) == pytest.approx(0.5, abs=0.1)
    assert eastward(1.0) < 0.4


# --- bad input --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_rows_that_come_again_count_once_and_are_told(kind, caplog):
    told = made(kind, MONDAY)
    again = told.add(concatenate([MONDAY, on_day(1)]).take(slice(100, 700)), "hall")
    assert again.repeated > 300 and again.taken > 100
    assert f"{again.repeated} repeated" in caplog.text
    assert_same(told, made(kind, concatenate([MONDAY, on_day(1)]).take(slice(0, 700))))


@pytest.mark.parametrize("kind", KINDS)
def test_rows_may_come_out_of_order_and_twice(kind, caplog):
    told, order = UpdatedMap(kind, SITE), np.random.default_rng(0).permutation(len(MONDAY.t))
    update = told.add(MONDAY.take(np.concatenate([order, order[:50]])), "hall")
    assert update.repeated == 50 and update.out_of_order > 0
    assert "out_of_order" in caplog.text
    assert_same(told, made(kind, MONDAY))


@pytest.mark.parametrize("kind", KINDS)
def test_merged_maps_may_overlap(kind):
    told = made(kind, MONDAY)
    assert told.merge(made(kind, MONDAY, on_day(1))) > 0
    assert_same(told, made(kind, MONDAY, on_day(1)))


def test_counts_that_share_some_rows_cannot_be_merged():
    some = MONDAY.take(MONDAY.track_id % 3 != 0)
    told = made("cliff", some)
    with pytest.raises(DataError, match=r"2011-\d\d-\d\d \d\d:00: the maps share \d+ of \d+ and \d+ rows, .*remove"):
        told.merge(made("cliff", MONDAY.take(MONDAY.track_id % 3 != 1)))
    assert_same(told, made("cliff", some))


@pytest.mark.parametrize("kind", KINDS)
def test_nobody_is_at_two_places(kind):
    told, elsewhere = made(kind, MONDAY), MONDAY._replace(x=MONDAY.x + 0.5)
    with pytest.raises(DataError, match=r"track \d+ .*at t 13\d{8}\.\d{3} is at \([-\d.]+, [-\d.]+\) m.*recording"):
        told.add(elsewhere, "hall")
    told.add(elsewhere, "another hall")  # other people
    one = elsewhere.take(np.array([0, 1, 1]))
    with pytest.raises(DataError, match=r"row 2: track 0 .* and in row 1 at .*: leave one out"):
        told.add(one._replace(x=np.array([0.0, 1.0, 1.5])), "third")


@pytest.mark.parametrize("kind", KINDS)
def test_an_update_tells_of_the_rows_that_are_new(kind):
    """Not of those that came again with them, or only some hours of a batch would be counted as changed."""
    walk = MONDAY.take(MONDAY.track_id == MONDAY.track_id[0])
    hours = [walk._replace(t=walk.t + 3600.0 * hour, track_id=walk.track_id + 1000 * hour) for hour in range(3)]
    after = walk._replace(t=walk.t + 600.0, track_id=walk.track_id + 9000)
    kept, plain = (made(kind, concatenate([hours[0], hours[2]])) for _ in range(2))
    alone = plain.add(after, "hall")
    told = kept.add(concatenate([hours[0], hours[2], after]), "hall")
    assert told.repeated > 0
    assert (told.taken, told.late, told.changed) == (alone.taken, alone.late, alone.changed)
    assert alone.late == alone.taken > 0
    assert kept.add(concatenate([hours[0], hours[1]]), "hall").changed == plain.add(hours[1], "hall").changed


@pytest.mark.parametrize(("later_s", "farther_m", "same"), [
    (0.0, 1e-7, True), (2e-4, 0.0, True), (2e-4, 3e-4, True), (0.0, 2e-3, False), (2e-4, 0.5, False),
])  # fmt: skip
@pytest.mark.parametrize("kind", KINDS)
def test_the_same_row_is_the_same_in_one_batch_and_in_two(kind, later_s, farther_m, same):
    """A person's time to the ms and place to the mm; at another place it contradicts."""
    rows = MONDAY._replace(t=np.round(MONDAY.t), x=np.round(MONDAY.x, 2), y=np.round(MONDAY.y, 2))
    again = rows._replace(t=rows.t + later_s, x=rows.x + farther_m).take([7])
    both = concatenate([again, rows])
    one, two = UpdatedMap(kind, SITE), made(kind, rows)
    if same:
        assert one.add(both, "hall").repeated == two.add(again, "hall").repeated == 1
        assert_same(one, two)
        assert_same(two, made(kind, rows))
        return
    before = two._state.state()
    for told, batch in ((one, both), (two, again)):
        with pytest.raises(DataError, match=r"track 0 .*at t 13"):
            told.add(batch, "hall")
    assert two._state.state().equals(before) and not len(one._state.state())


@pytest.mark.parametrize("kind", KINDS)
def test_another_frame_or_step_is_refused(kind):
    told = made(kind, MONDAY)
    with pytest.raises(
        DataError, match=r"row 0: \([\d.]+, [-\d.]+\) m: no row is within 5 m of the map.*another frame"
    ):
        told.add(on_day(1)._replace(x=on_day(1).x + 5000.0), "hall")
    with pytest.raises(DataError, match=r"a row every 0.4 s, the site's time_step_s is 1"):
        told.add(on_day(1)._replace(t=on_day(1).t[0] + 0.4 * (on_day(1).t - on_day(1).t[0])), "hall")
    nowhere = on_day(1)._replace(y=np.where(np.arange(len(on_day(1).t)) == 7, np.nan, on_day(1).y))
    with pytest.raises(DataError, match=r"row 7: track 1000 at t .* has a position that is not a number"):
        told.add(nowhere, "hall")
    assert_same(told, made(kind, MONDAY))


@pytest.mark.parametrize("kind", KINDS)
def test_an_hour_without_data_leaves_the_map_of_before(kind, caplog):
    told = made(kind, MONDAY, half_life_h=1.0)
    before = told.written()
    update = told.add(MONDAY.take(slice(0, 0)), "hall")
    assert update.changed == 0 and "the map is that of before" in caplog.text
    assert told.written().whole.equals(before.whole)


@pytest.mark.parametrize("wrong", [0, -1.0, float("nan"), float("inf"), True, "3"])
def test_a_half_life_is_above_zero(wrong):
    with pytest.raises(DataError, match=r"half_life_h .*: give hours above 0, such as 3; None forgets nothing"):
        UpdatedMap("cliff", SITE, wrong)


@pytest.mark.parametrize("kind", COUNTS)
def test_counts_cannot_forget_a_person(kind):
    with pytest.raises(DataError, match=f"person 5: a map of kind {kind} holds counts of rows, not whose"):
        made(kind, MONDAY).remove(person=5, recording="hall")


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (lambda: UpdatedMap("cliff", SITE, resolution_m=0.5), "resolution_m 1.0 and 0.5: maps of other cells"),
        (lambda: UpdatedMap("stef", SITE), "kind 'cliff' and 'stef'"),
        (lambda: UpdatedMap("cliff", Site(timezone="UTC")), "time zone 'Europe/London' and 'UTC'"),
        (lambda: UpdatedMap("cliff", Site(timezone="Europe/London", time_step_s=0.5)), r"time step \[s\] 1.0 and 0.5"),
        (lambda: made("cliff", MONDAY).written(), "merge: Map: give an UpdatedMap"),
    ],
)
def test_only_maps_of_the_same_cells_are_merged(other, message):
    with pytest.raises(DataError, match=message):
        made("cliff", MONDAY).merge(other())


@pytest.mark.parametrize("kind", KINDS)
def test_a_day_that_is_not_there_cannot_be_removed(kind):
    told = made(kind, MONDAY)
    with pytest.raises(DataError, match=f"day 2001-01-01: the map has {_day_of(MONDAY)}"):
        told.remove(day="2001-01-01")
    with pytest.raises(DataError, match="day 'yesterday': give an ISO date"):
        told.remove(day="yesterday")
    with pytest.raises(DataError, match="give a day, such as '2012-10-24', or a person's track id"):
        told.remove()


def test_what_needs_rows_is_refused():
    with pytest.raises(DataError, match="intensity 'time' needs the rows, which are not held: use 'count'"):
        UpdatedMap("cliff", SITE, intensity="time")
    with pytest.raises(DataError, match="lstm"):
        UpdatedMap("lstm", SITE)


def test_only_a_state_is_loaded(tmp_path):
    modlhmp.build_map("cliff", MONDAY, SITE).save(tmp_path / "built.parquet")
    with pytest.raises(DataError, match=r"built.parquet: it holds no counts to be updated"):
        UpdatedMap.load(tmp_path / "built.parquet")


def test_tracks_that_are_none_are_refused():
    with pytest.raises(DataError, match="tracks are list"):
        UpdatedMap("cliff", SITE).add([1, 2, 3])
    ragged = Tracks(*MONDAY[:2], MONDAY.x[:5], *MONDAY[3:])
    with pytest.raises(DataError, match="column x has 5 rows"):
        UpdatedMap("cliff", SITE).add(ragged)


# --- live -------------------------------------------------------------------------------------------------------------


def streamed(tracks, every_s=1.0):
    """Rows (t, who, x, y) of tracks in the order of time, at another rate than theirs."""
    rows = []
    for first, end in itertools.pairwise(tracks.bounds()):
        t = tracks.t[first] + np.arange(0, tracks.t[end - 1] - tracks.t[first] + 1e-6, every_s)
        x, y = (np.interp(t, tracks.t[first:end], part[first:end]) for part in (tracks.x, tracks.y))
        rows += zip(t, np.full(len(t), tracks.track_id[first]), x, y, strict=True)
    return sorted(rows)


@pytest.mark.parametrize("every_s", [1.0, 0.25])
def test_live_keeps_its_map_up_to_date(every_s):
    """At the full hour the map is that of before and of all rows of the hour, at whatever rate these came."""
    kept = made("episodes", on_day(-1))
    live = modlhmp.Live(kept, 3.0)
    for t, who, x, y in streamed(MONDAY, every_s):
        live.see(float(t), int(who), float(x), float(y))
    live.pass_time(MONDAY.t.max() + 3600.0)
    live.forecast()
    rows = kept._state.rows.take(kept._state.rows.t >= MONDAY.t.min())
    assert len(rows.t) == len(MONDAY.t)
    np.testing.assert_allclose(np.sort(rows.x), np.sort(MONDAY.x), atol=1e-6)
    before, number = kept.written().whole, live.counts["forecasts"]
    live.pass_time(MONDAY.t.max() + 3 * 3600.0)  # hours without anybody
    live.forecast()
    assert kept.written().whole.equals(before) and live.counts["forecasts"] == number + 1


@pytest.mark.parametrize("late_s", [3.5, 6.0, 8.5])
def test_rows_that_come_late_cost_nobody_an_hour(late_s, caplog):
    """All that `Live` takes: they are left to the forecasts, and what was interpolated stays."""
    kept, t0 = made("episodes", on_day(-1)), MONDAY.t.max()
    live = modlhmp.Live(kept, 3.0)
    for t in (0, 1, 2, *range(4, 20)):
        live.see(t0 + t, "ann", float(t), 0.0)
        live.see(t0 + t, "bob", float(t), 3.0)
        if t == 3 + math.floor(late_s):
            assert live.see(t0 + t - late_s, "ann", t - late_s + 0.3, 0.0) == ""
    before = len(kept._state.rows.t)
    assert live.counts["out_of_order"] == 1 and len(live.updated()._state.rows.t) == before + 40
    assert "not learned" not in caplog.text


def test_a_row_that_is_left_to_the_forecasts_is_no_reason_to_learn():
    """One of the hour before: there is nothing of it to tell the map."""
    learner, hour = Learner(made("episodes", MONDAY)), 3600.0 * 400_000
    for t in range(-3, 5):
        learner.see(hour + t, "ann", float(t), 0.0)
    learner.learn(hour + 4)
    learner.see(hour - 1.5, "ann", 0.0, 0.0)
    assert not learner.due(hour + 5) and learner.due(hour + 3600)


@pytest.mark.parametrize("most_late_s", [2.0, 5.0, 8.9])
def test_rows_in_any_order_are_learned(most_late_s, caplog):
    """As far as `Live` takes them; who walks along stands at whole steps, once each."""
    kept, rng = made("episodes", MONDAY), np.random.default_rng(0)
    live = modlhmp.Live(kept, 3.0)
    rows = [(MONDAY.t.max() + 0.5 * n, who, 0.5 * n, who + 0.2 * (n % 3)) for n in range(120) for who in range(8)]
    for row in sorted(rows, key=lambda row: row[0] + rng.uniform(0, most_late_s)):
        live.see(*row)
    held = live.updated()._state.rows
    held = held.take(held.recording == 1)
    assert live.counts["out_of_order"] > 200 and "not learned" not in caplog.text
    assert len(held.t) > 200
    np.testing.assert_allclose(held.t - MONDAY.t.max(), held.x, atol=1e-6)


@pytest.mark.parametrize("step_s", [1.0, 0.4, 0.1, 0.04])
def test_rows_at_whole_steps_are_learned_as_they_are(step_s):
    """Though a unix time is a multiple of a step only to 2.4e-7 s."""
    kept = UpdatedMap("episodes", dataclasses.replace(SITE, time_step_s=step_s))
    learner, number = Learner(kept), round(1.35e9 / step_s)
    for who in range(200):
        for n in range(number + who, number + who + 3):
            learner.see(round(n * step_s, 6), who, 0.01 * n * step_s, 0.0)
    learner.learn(1.35e9 + 3600)
    assert len(kept._state.rows.t) == 600


@pytest.mark.parametrize("kind", ["cliff", "episodes"])
@pytest.mark.parametrize(("step_s", "jump_m"), [(1.0, 20.0), (1.0, 115.0), (0.04, 5.0), (0.04, 300.0)])
def test_an_id_that_jumps_is_learned_as_two_people(kind, step_s, jump_m, caplog):
    """As cleaning cuts a recording: nobody walked between, whatever the rate, and nobody else loses the hour."""
    site = dataclasses.replace(SITE, time_step_s=step_s)
    kept, t0 = UpdatedMap(kind, site), 1.35e9
    learner = Learner(kept)
    for n in range(40):
        for who in range(5):
            learner.see(t0 + n * step_s, who, n * step_s, float(who))
        learner.see(t0 + n * step_s, "x", n * step_s + jump_m * (n >= 20), 9.0)
    learner.learn(t0 + 40 * step_s)
    assert "not learned" not in caplog.text
    if kind == "cliff":  # without a velocity at first, and after the jump
        assert sum(len(slot.keys) for slot in kept._state.slots.values()) == 5 * 39 + 38
    else:
        walks = kept.written().whole
        assert len(set(column(walks, "person"))) == 7
        x, y = (column(walks, axis) for axis in ("x", "y"))
        assert ((x[y == 9] < 20 * step_s - 1e-6) | (x[y == 9] > jump_m)).all() and len(x) == 240


def test_a_person_who_jumps_in_a_stream_costs_nobody_an_hour(caplog):
    """What `Live` cuts is cut in the map, and there and back again are three walks."""
    kept, t0 = made("episodes", on_day(-1)), MONDAY.t.max()
    live, before = modlhmp.Live(kept, 3.0), len(set(column(kept.written().whole, "person")))
    for t in range(20):
        live.see(t0 + t, "ann", float(t), 0.0)
        live.see(t0 + t, "x", t + 120.0 * (8 <= t < 12), 3.0)
    assert live.counts["cut_at_jump"] == 2
    assert len(set(column(live.updated().written().whole, "person"))) == before + 4
    assert "not learned" not in caplog.text


def frames(tracks, hours=3):
    """[(t, rows)] of people who come again every hour as others."""
    seen = {}
    for hour in range(hours):
        for t, who, x, y in streamed(tracks):
            seen.setdefault(t + 3600.0 * hour, []).append((t + 3600.0 * hour, int(who) + 1000 * hour, x, y))
    return sorted(seen.items())


@pytest.mark.parametrize("kind", ["cliff", "episodes"])
def test_what_live_learns_does_not_depend_on_who_asks_for_forecasts(kind):
    """After every frame the map is what it is where each is forecast: learned before the first forecast of an hour."""
    kept, asked = [made(kind, on_day(-1)) for _ in range(4)], (1, 7, 400)
    lives, plain = [modlhmp.Live(one, 3.0) for one in kept[:3]], Learner(kept[3])
    learned_at = []
    for number, (now, rows) in enumerate(frames(MONDAY)):
        for live in lives:
            for row in rows:
                live.see(*row)
        for row in rows:
            plain.see(*row)
        if plain.due(now) and plain.learn(now).changed:
            learned_at.append(now)
        paths = [live.forecast().paths for live, each in zip(lives, asked, strict=True) if number % each == 0]
        assert all(np.array_equal(paths[0], one) for one in paths[1:])
        if not lives[0].clock.waiting:  # who comes alone after others waits for a few rows
            assert kept[0]._state.state().equals(kept[3]._state.state())
    assert len(learned_at) >= 3
    states = [live.updated()._state.state() for live in lives]
    assert all(one.equals(states[0]) for one in states[1:])


def test_what_waits_to_be_learned_is_an_hour_s():
    live = modlhmp.Live(made("episodes", on_day(-1)), 3.0)
    most = [0, 0]
    for number in range(6 * 3600):
        t = MONDAY.t.max() + number
        live.see(t, number // 60, number % 60, 0.0)
        if number == 5 * 3600:
            live.updated()
        most = [max(one, len(of)) for one, of in zip(most, (live._learner._ids, live._learner._last), strict=True)]
    assert most[0] <= 3601 and most[1] <= 3
    before = live._predictor
    live.forecast()
    assert live._predictor is not before
    waiting = len(live._learner._ids)
    for number in range(20):  # the clock is set back: what waits is learned, and nobody of before goes on
        live.see(MONDAY.t.max() - 7200.0 + number, 359, 0.0, 0.0)
    assert waiting and len(live._learner._ids) <= 20 and len(live._learner._last) == 1


def test_rows_that_wait_are_learned_when_the_stream_ends():
    """Not those of a person whose clock is ahead: what has been shown to be wrong is no time of the map."""
    kept = made("episodes", on_day(-1))
    live, t0 = modlhmp.Live(kept, 3.0), MONDAY.t.max()
    for t in range(6):
        for who, later in (("a", 0.0), ("ahead", 7000.0)):
            live.see(t0 + t + later, who, t, 0.0)
    before = len(kept._state.rows.t)
    assert len(live.updated()._state.rows.t) == before + 6 and live.now == t0 + 5
    for t in (60, 61, 62):
        live.see(t0 + t, "b", t - 60, 0.0)
    assert live.clock.waiting and len(live.updated()._state.rows.t) == before + 9


def test_live_forecasts_with_what_it_has_learned():
    kept = made("episodes", on_day(-1).take(on_day(-1).track_id == -1000))
    live = modlhmp.Live(kept, 3.0)
    before = live._predictor
    for t, who, x, y in streamed(MONDAY):
        live.see(float(t), int(who), float(x), float(y))
        if who == 0:
            live.forecast()
    assert live._predictor is before
    live.pass_time(MONDAY.t.max() + 3600.0)
    live.forecast()
    assert live._predictor is not before
    with pytest.raises(DataError, match=r"Live: the map of kind cliff is empty: .*; add tracks first"):
        modlhmp.Live(UpdatedMap("cliff", SITE))


@pytest.mark.parametrize("kind", ["cliff", "tc_cliff"])
def test_a_state_in_place_of_a_map_says_how_to_write_it_out(tmp_path, kind):
    """Wherever a map is read or asked for; what is refused is worth weeks of recordings."""
    kept, path = made(kind, MONDAY), tmp_path / "state.parquet"
    kept.save(path)
    for call in (modlhmp.load_map, kind_in):
        with pytest.raises(
            DataError, match=rf"state, .*of kind {kind} .*map update .*state.parquet --out MAP.*written"
        ):
            call(path)
    for call in (modlhmp.forecast, modlhmp.path_cost):
        with pytest.raises(DataError, match=r"UpdatedMap: give a Map \(build_map, load_map, or UpdatedMap.written\)"):
            call(kept, np.zeros((4, 3 if call is modlhmp.forecast else 2)) + np.arange(4)[:, None])


def test_what_live_has_learned_is_kept(tmp_path):
    """`modlhmp live --keep`: the state of before and all rows that were seen."""
    made("episodes", on_day(-1)).save(tmp_path / "state.parquet")
    rows = [{"t": float(t), "id": int(who), "x": float(x), "y": float(y)} for t, who, x, y in streamed(MONDAY)]
    (tmp_path / "rows.jsonl").write_text("\n".join(map(json.dumps, rows[:300])), encoding="utf-8")
    command = ["live", str(tmp_path / "rows.jsonl"), "--horizon", "2", "--keep", str(tmp_path / "after.parquet")]
    done = CliRunner().invoke(app, [*command, "--map", str(tmp_path / "state.parquet"), "--recording", "robot-2"])
    assert done.exit_code == 0, done.output
    held = UpdatedMap.load(tmp_path / "after.parquet")._state
    assert held.names == ["hall", "robot-2"] and (held.rows.recording == 1).sum() == 300
    modlhmp.build_map("episodes", MONDAY, SITE).save(tmp_path / "finished.parquet")
    done = CliRunner().invoke(app, [*command, "--map", str(tmp_path / "finished.parquet")])
    assert "is a finished map: give the state that" in str(done.exception)
    done = CliRunner().invoke(app, [*command[:-2], "--map", "cvm", "--recording", "robot-2"])
    assert "recording 'robot-2': its map does not learn" in str(done.exception)


def test_what_live_has_learned_is_kept_though_it_ends_with_an_error(tmp_path, monkeypatch):
    made("episodes", on_day(-1)).save(tmp_path / "state.parquet")
    rows = [{"t": MONDAY.t.max() + t, "id": 1, "x": float(t), "y": 0.0} for t in range(9)]
    (tmp_path / "rows.jsonl").write_text("\n".join(map(json.dumps, rows)), encoding="utf-8")

    def full(sink, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("modlhmp.live_lines.write_all", full)
    command = ["live", str(tmp_path / "rows.jsonl"), "--every", "5", "--horizon", "2"]
    state, after = tmp_path / "state.parquet", tmp_path / "after.parquet"
    done = CliRunner().invoke(app, [*command, "--map", str(state), "--keep", str(after)])
    assert "No space left" in str(done.exception)
    assert "live" in UpdatedMap.load(after)._state.names


def test_what_live_has_learned_is_kept_though_it_is_terminated(tmp_path):
    """As services end a robot's processes."""
    state, after = tmp_path / "state.parquet", tmp_path / "after.parquet"
    made("episodes", on_day(-1)).save(state)
    command = [sys.executable, "-m", "modlhmp", "live", "--horizon", "2", "--map", str(state), "--keep", str(after)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        for t in range(9):
            process.stdin.write(
                json.dumps({"t": MONDAY.t.max() + t, "id": 1, "x": float(t), "y": 0.0}).encode() + b"\n"
            )
        process.stdin.flush()
        assert process.stdout.readline()
        process.terminate()
        assert process.wait(60) == 130
    assert "live" in UpdatedMap.load(after)._state.names


@pytest.mark.parametrize("kind", ["cliff", "episodes"])
@pytest.mark.parametrize("later_s", [0.0, 11.0])
def test_streams_of_two_robots_have_names(kind, later_s):
    """Ids that both give are two people, at the same time and one soon after the other."""
    kept = []
    for name, start, x in (("robot-1", 0.0, 0.0), ("robot-2", later_s, 15.0)):
        live = modlhmp.Live(made(kind, on_day(-1)), 3.0, recording=name)
        for t in range(8):
            live.see(MONDAY.t.max() + start + t, 1, x + 0.5 * t, 0.0)
        kept.append(live.updated())
    assert kept[0].merge(kept[1]) == len(on_day(-1).t) - (kind == "cliff") * len(set(on_day(-1).track_id))
    if kind == "episodes":
        people = len(set(column(made(kind, on_day(-1)).written().whole, "person")))
        assert len(set(column(kept[0].written().whole, "person"))) == people + 2


def test_a_stream_is_named_by_a_text_and_where_it_is_learned_alone():
    with pytest.raises(DataError, match=r"Live: recording 3: give a name"):
        modlhmp.Live(made("episodes", MONDAY), 3.0, recording=3)
    with pytest.raises(DataError, match=r"Live: recording 'b': its map does not learn: give an UpdatedMap"):
        modlhmp.Live("cvm", 3.0, recording="b")
