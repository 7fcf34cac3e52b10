"""Maps scored hour by hour with what was known before: nothing of the future counts, and a reversal is followed."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from matplotlib import image
from walking_hall import HALL

from modlhmp.contract import SITE, crowd
from modlhmp.file_format import Recording
from modlhmp.study import lacks, prequential
from modlhmp.study.exhibits import prequential_hours
from modlhmp.tracks import clock_numbers, concatenate, write_tracks

HOURS = 6
DAY = dataclasses.replace(HALL, time_step_s=1.0, timezone=SITE.timezone, recordings=(Recording(name="day"),))


def people(hours=HOURS):
    """The same crowd in each hour, under ids of its own."""
    walked = crowd(people=40)
    walked = walked.take(walked.t < walked.t[0] + 3000)
    moving = np.abs(walked.x) < 10
    walked = walked.take(moving)
    return concatenate(
        walked._replace(t=walked.t + 3600.0 * hour, track_id=walked.track_id + 100 * hour) for hour in range(hours)
    )


PEOPLE = people()


@pytest.fixture(scope="module")
def reversal():
    """Scores of the planted reversal, and the number of its hour."""
    tracks, half, number = prequential.planted(PEOPLE, SITE.timezone)
    return prequential.scores(tracks, SITE, half)[0], number


def test_nothing_of_an_hour_or_after_it_counts():
    table, _ = prequential.scores(PEOPLE, SITE)
    hours = clock_numbers(PEOPLE.t, SITE.timezone)
    known = hours <= np.unique(hours)[3]
    before, _ = prequential.scores(PEOPLE.take(known), SITE)
    assert before["number"].tolist() == table[table["number"] <= 3]["number"].tolist()
    assert len(before) == 3 * (len(prequential.MAPS) + 1)
    pd.testing.assert_frame_equal(before, table[table["number"] <= 3].reset_index(drop=True))


def test_what_repeats_is_foretold_and_no_map_is_worse():
    table, overall = prequential.scores(PEOPLE, SITE)
    nll = overall.set_index("map")["nll"]
    assert (nll[[*prequential.MAPS]] < nll[prequential.NO_MAP] - 1.0).all()
    assert overall.set_index("map").loc[prequential.HISTORY, "worse"] == 0
    assert (table[table["map"] == prequential.NO_MAP]["covered"] == 0).all()
    assert (table[table["map"] != prequential.NO_MAP]["covered"] > 0.99).all()


def test_half_of_one_way_streets_turns_round():
    tracks, half, number = prequential.planted(PEOPLE, SITE.timezone)
    hours = clock_numbers(tracks.t, SITE.timezone)
    late = hours >= np.unique(hours)[number]
    way = np.sign(np.cos(tracks.heading))
    assert number == HOURS // 2 and 0.4 < half.mean() < 0.6
    assert len(np.unique(way[~(half & late)])) == 1 and (way[half & late] == -way[~half][0]).all()


def test_who_turns_back_and_forth_is_several_tracks():
    """A piece of a walk has a row at every step: maps that are updated refuse others."""
    zigzag = PEOPLE._replace(heading=np.where(np.arange(len(PEOPLE.t)) % 5 < 2, PEOPLE.heading, PEOPLE.heading + np.pi))
    tracks, half, _ = prequential.planted(zigzag, SITE.timezone)
    same = np.diff(tracks.track_id) == 0
    assert same.any() and (np.diff(tracks.t)[same] < 1.5 * SITE.time_step_s).all()
    assert not prequential.scores(tracks, SITE, half)[0].empty


def test_who_forgets_follows_sooner(reversal):
    table, number = reversal
    turned = table[(table["part"] == 1)].pivot(index="number", columns="map", values="nll")
    shock, next_hour = turned.loc[number], turned.loc[number + 1]
    assert (shock[[*prequential.MAPS]] > turned.loc[number - 1][[*prequential.MAPS]] + 1).all()
    assert next_hour["half-life 1 h"] < next_hour[prequential.HISTORY] < next_hour[prequential.NEVER]
    assert next_hour[prequential.LAST] < next_hour["half-life 12 h"]
    stays = table[table["part"] == 0].pivot(index="number", columns="map", values="nll")
    assert (stays.loc[number + 1] - stays.loc[number - 1]).abs().max() < 0.5


def test_the_figure_shows_every_map(layout, figures):
    write_tracks(PEOPLE, layout.tracks("hall", "day"))
    prequential_hours.draw(layout, [DAY], layout.exhibit("f"), {DAY.name: ["day"]})
    assert image.imread(f"{layout.exhibit('f')}.png").std() > 0
    table = pd.read_csv(f"{layout.exhibit('f')}.csv")
    assert set(table["part"]) == {*prequential_hours.PARTS, "all hours as recorded"}
    assert set(table["map"]) == {*prequential.MAPS, prequential.NO_MAP}
    assert len(figures[-1].axes[0].lines) == len(prequential.MAPS) + 1


def test_each_panel_has_the_hours_that_it_shows(layout, figures):
    """In the second hour all walk the other way, so that the planted reversal lacks it and counts one hour less."""
    second = clock_numbers(PEOPLE.t, SITE.timezone) == np.unique(clock_numbers(PEOPLE.t, SITE.timezone))[1]
    one_way = PEOPLE._replace(heading=np.where(second, np.pi, 0.0))
    write_tracks(one_way, layout.tracks("hall", "day"))
    prequential_hours.draw(layout, [DAY], layout.exhibit("f"), {DAY.name: ["day"]})
    table = pd.read_csv(f"{layout.exhibit('f')}.csv")
    for ax, part in zip(figures[-1].axes, prequential_hours.PARTS, strict=True):
        hour = table[table["part"] == part].drop_duplicates("number").set_index("number")["hour"].astype(int)
        ticks = dict(zip(ax.get_xticks(), (text.get_text() for text in ax.get_xticklabels()), strict=True))
        assert ticks == hour.astype(str).to_dict()
    assert len(hour) < table[table["part"] == prequential_hours.PARTS[0]]["number"].nunique()


def test_intervals_are_over_persons_also_where_tracks_were_cut(layout, figures):
    """Of tracks cut in two whose pieces are one person (`same_person`), as of the whole ones."""
    day = people(hours=2)
    late = np.concatenate([np.arange(n) >= n // 2 for n in np.diff(day.bounds())])
    cut = day._replace(track_id=2 * day.track_id + late)
    write_tracks(day, layout.tracks("hall", "day"))
    persons = {str(2 * one + 1): int(2 * one) for one in np.unique(day.track_id)}
    write_tracks(cut, layout.tracks("hall", "cut"), persons=persons)
    found = []
    for name in ("day", "cut"):
        prequential_hours.draw(layout, [DAY], layout.exhibit(name), {DAY.name: [name]})
        found.append(pd.read_csv(f"{layout.exhibit(name)}.csv").query("hour.isna()")[["worse", "low", "high"]])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9, atol=1e-12)


def test_without_a_clock_there_are_no_hours(layout, figures):
    unknown = dataclasses.replace(DAY, clock="unknown")
    prequential_hours.draw(layout, [unknown], layout.exhibit("f"), {DAY.name: ["day"]})
    assert pd.read_csv(f"{layout.exhibit('f')}.csv").empty
    assert {text.get_text() for ax in figures[-1].axes for text in ax.texts} == {f"{DAY.title}: {lacks.NO_CLOCK}"}


def test_one_hour_is_too_few(layout, figures):
    one_hour = PEOPLE.take(PEOPLE.t < (PEOPLE.t[0] // 3600 + 1) * 3600)
    write_tracks(one_hour, layout.tracks("hall", "day"))
    prequential_hours.draw(layout, [DAY], layout.exhibit("f"), {DAY.name: ["day"]})
    assert pd.read_csv(f"{layout.exhibit('f')}.csv").empty
