"""Accountings of likelihood: by hand, where they must agree, and what a planted truth must give."""

import numpy as np
import pytest

from modlhmp.maps.density import NoMap
from modlhmp.methods import build_map
from modlhmp.options import CliffBuilding, StefBuilding
from modlhmp.scoring import likelihood
from modlhmp.site import Site
from modlhmp.storage import DataError, write_parquet
from modlhmp.study.likelihood import (
    ALL_HOURS,
    DAY_BINS,
    HOUR_BINS,
    NO_MAP,
    SMOOTHED,
    Mapped,
    clusters_of,
    held_out,
    measure,
)
from modlhmp.tracks import Tracks

NAN, INF = np.nan, np.inf
TOKYO = Site(timezone="Asia/Tokyo", hours=(9, 11))
NINE = 1351036800.0  # 24 October 2012, 9 o'clock in Tokyo
ONE, OTHER, NONE = np.array([-1.0, NAN, -INF, -2.0]), np.array([-2.0, -3.0, -1.0, NAN]), np.full(4, -2.5)


def test_the_four_accountings_by_hand():
    found = likelihood.accounted({"a": ONE, "b": OTHER}, NONE, {"a": 0.1, "b": 0.2}, {"a": [OTHER]})
    least = np.log(1e-12)
    mixed = np.log(0.9 * np.exp([-1.0, -INF, -2.0]) + 0.1 * np.exp(-2.5))
    np.testing.assert_allclose(found["a", "background"], [mixed[0], -2.5, mixed[1], mixed[2]])
    np.testing.assert_allclose(found["a", "charged"], [-1.0, least, least, -2.0])
    np.testing.assert_allclose(found["a", "common"], [-1.0, NAN, least, NAN])
    np.testing.assert_allclose(found["b", "common"], [-2.0, NAN, -1.0, NAN])
    np.testing.assert_allclose(found["a", "fallback"], [-1.0, -3.0, least, -2.0])
    np.testing.assert_allclose(found["b", "fallback"], [-2.0, -3.0, -1.0, -2.5])


def test_a_map_that_covers_everything_is_the_same_in_all_but_its_background():
    rng = np.random.default_rng(0)
    log_p, none = rng.normal(-1, 1, 50), rng.normal(-2, 0.1, 50)
    found = likelihood.accounted({"a": log_p}, none, {"a": 0.01}, {})
    for accounting in ("common", "charged", "fallback"):
        np.testing.assert_array_equal(found["a", accounting], log_p)
    assert (found["a", "background"] >= np.minimum(log_p, none)).all()
    assert (found["a", "background"] <= np.maximum(log_p, none)).all()


def test_as_printed_is_three_times_the_density_but_for_what_is_charged():
    printed, charged = likelihood.as_printed(ONE), likelihood.charged(ONE)
    np.testing.assert_allclose((printed - charged)[[0, 3]], np.log(3))
    np.testing.assert_allclose((printed - charged)[[1, 2]], 0)


def test_the_weight_is_the_best_of_the_list_on_the_rows_given():
    """One row in twenty is of another law, so that more background suits them than the least."""
    rng = np.random.default_rng(1)
    log_p = np.where(rng.random(2000) < 0.05, -30.0, -1.0)
    found = likelihood.choose_weight(log_p, np.full(2000, -2.0))
    means = {w: np.log((1 - w) * np.exp(log_p) + w * np.exp(-2.0)).mean() for w in likelihood.WEIGHTS}
    assert found == max(means, key=means.get)
    assert likelihood.choose_weight(np.full(10, -1.0), np.full(10, -2.0)) == min(likelihood.WEIGHTS)


def test_intervals_are_over_persons_not_rows():
    """Rows of a person repeated ten times say no more than they did."""
    rng = np.random.default_rng(2)
    log_p, none = rng.normal(-1, 1, 60), np.full(60, -2.0)
    once = likelihood.summarise(log_p, none, np.arange(60))
    again = likelihood.summarise(np.repeat(log_p, 10), np.repeat(none, 10), np.repeat(np.arange(60), 10))
    np.testing.assert_allclose(again[:6], once[:6])
    assert (once[6], again[6], again[7]) == (60, 600, 60)
    assert once[3] == pytest.approx(-1 * (once[0] - 2.0))


def test_differences_are_of_every_pair_on_the_same_rows():
    log_p = {"a": np.array([-1.0, -2.0, -1.5]), "b": np.array([-2.0, -2.5, -1.0]), "c": np.zeros(3)}
    ours, theirs, difference, low, _, n = zip(*likelihood.differences(log_p, np.arange(3)), strict=True)
    assert list(zip(ours, theirs, strict=True)) == [("a", "b"), ("a", "c"), ("b", "c")]
    np.testing.assert_allclose(difference, [-1 / 3, 1.5, 11 / 6])
    assert (np.array(low) < difference).all()
    assert n == (3, 3, 3)


def test_clusters_are_days_where_there_are_five():
    person, recording = np.array([0, 0, 1, 2, 3, 4]), np.array([0, 0, 1, 2, 3, 4])
    assert clusters_of(person, recording, ["a", "b", "c", "d", "d"]).tolist() == person.tolist()
    assert clusters_of(person, recording, ["e", "b", "c", "d", "a"]).tolist() == [4, 4, 1, 2, 3, 0]


def walkers(people, seed):
    """Persons who walk east in the south and west in the north of 12 m x 4 m, 12 rows each, in two hours."""
    rng = np.random.default_rng(seed)
    person = np.repeat(np.arange(people), 12)
    north = rng.random(people) < 0.5
    start = NINE + rng.uniform(0, 7000, people)
    y = np.where(north, rng.uniform(2.2, 4, people), rng.uniform(0, 1.8, people))
    t = start[person] + np.tile(np.arange(12.0), people)
    x = np.tile(np.arange(12.0), people) + rng.uniform(0, 1, people)[person]
    x = np.where(north[person], 12 - x, x)
    heading = np.where(north[person], np.pi, 0.0) + rng.normal(0, 0.2, len(t))
    heading = np.angle(np.exp(1j * heading))
    return Tracks(person, t, x, y[person], rng.normal(1.2, 0.1, len(t)), heading), person


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """Tables of maps of 60 walkers on 30 others, some of whom stand."""
    (training, person), (test, whose) = walkers(60, 0), walkers(30, 1)
    test.speed[:12] = 0.0
    test.heading[12:15] = NAN
    folder = tmp_path_factory.mktemp("maps")
    maps = []
    for kind, building in (("cliff", CliffBuilding()), ("tc_cliff", CliffBuilding()), ("stef", StefBuilding())):
        whole, hours = build_map(kind, training, TOKYO, building)
        if not hours:
            write_parquet(whole, folder / f"{kind}.parquet")
        else:
            for name, table in {"day": whole, **{f"{hour:02d}": one for hour, one in hours.items()}}.items():
                write_parquet(table, folder / kind / f"{name}.parquet")
        maps.append(Mapped(kind, kind, str(folder / (kind if hours else f"{kind}.parquet")), building))
    return measure(training, person, test, whose, TOKYO, maps), (training, test)


def test_every_map_is_measured_on_the_rows_of_those_who_walk(measured):
    tables, _ = measured
    scores = tables["scores"]
    assert set(scores["map"]) == {NO_MAP, "cliff", "tc_cliff", "stef", DAY_BINS, HOUR_BINS, SMOOTHED}
    overall = scores[scores["hour"] == ALL_HOURS]
    assert set(overall["accounting"]) == {*likelihood.ACCOUNTINGS, likelihood.PRINTED}
    assert (overall.loc[overall["accounting"] != "common", "n"] == 30 * 12 - 15).all()
    hours = scores[(scores["hour"] != ALL_HOURS) & (scores["space"] == "joint")]
    assert hours.groupby("map")["n"].sum().eq(30 * 12 - 15).all() and set(hours["hour"]) == {9, 10}
    of_none = scores[scores["map"] == NO_MAP]
    printed = of_none["accounting"] == likelihood.PRINTED
    np.testing.assert_allclose(of_none["gain"], np.where(printed, np.log(3), 0), atol=1e-12)
    assert len(tables["pairs"]) == 2 * 7 * 6 / 2


def test_without_a_clock_nothing_is_chosen_nor_told_by_hours():
    (training, person), (test, whose) = walkers(60, 0), walkers(30, 1)
    scores = measure(training, person, test, whose, TOKYO, [], clock=False)["scores"]
    assert set(scores["map"]) == {NO_MAP, DAY_BINS, SMOOTHED} and set(scores["hour"]) == {ALL_HOURS}
    assert not scores["chosen"].str.contains("day").any()


def test_a_planted_flow_is_found_and_what_knows_no_place_is_the_last(measured):
    tables, (training, test) = measured
    scores = tables["scores"]
    headline = scores[(scores["accounting"] == "background") & (scores["hour"] == ALL_HOURS)]
    by_map = {space: group.set_index("map") for space, group in headline.groupby("space")}
    for space in ("joint", "heading"):
        gain = by_map[space]["gain"]
        assert (gain.drop(NO_MAP) > 0.5).all()
        assert (by_map[space]["gain_low"].drop(NO_MAP) > 0.3).all()
    # Headings of the walkers are normal with 0.2 rad about the way of their lane: no map can be much better.
    truth = 0.5 * np.log(2 * np.pi * np.e * 0.04)
    heading = by_map["heading"]["nll"]
    assert truth - 0.1 < heading["cliff"] < truth + 0.4
    assert heading[NO_MAP] == pytest.approx(np.log(2 * np.pi))
    rows = np.isfinite(test.heading) & (test.speed > 0)
    none = NoMap(training.speed).log_speed(test.speed[rows]).mean() - np.log(2 * np.pi)
    assert by_map["joint"].loc[NO_MAP, "nll"] == pytest.approx(-none)


def test_those_held_out_are_whole_persons_and_two_are_needed():
    person = np.repeat(np.arange(40), 5)
    held = held_out(person)
    assert held.reshape(40, 5).all(axis=1).sum() == held.sum() / 5 == 6
    assert held_out(np.array([0, 0, 1])).sum() in (1, 2)
    with pytest.raises(DataError, match="fewer than two persons"):
        held_out(np.zeros(4, int))
