"""Histograms of velocities as densities: counts by hand, plain twins of the smoothing, integrals, invariances."""

import numpy as np
import pytest
import twins

from modlhmp.maps.density import NoMap
from modlhmp.maps.histogram import Bins, Level, histogram
from modlhmp.site import Site
from modlhmp.tracks import Tracks

TWO_PI = 2 * np.pi
TOKYO = Site(timezone="Asia/Tokyo")
NINE = 1351036800.0  # 24 October 2012, 9 o'clock in Tokyo
ONE = np.zeros(1)


def rows(*each):
    """Tracks of rows (x, y, heading, speed[, hours after nine])."""
    x, y, heading, speed, hour = np.array([(*row, 0.0)[:5] for row in each], float).T
    return Tracks(np.arange(len(x)), NINE + 3600 * hour + 60, x, y, speed, heading)


def crowd(n, seed=0):
    """Rows of people within 5 m x 3 m and three hours, most of whom walk east."""
    rng = np.random.default_rng(seed)
    heading = np.array([twins.wrap(a) for a in rng.normal(0, 0.8, n)])
    t = NINE + rng.uniform(0, 3 * 3600, n)
    return Tracks(np.arange(n), t, rng.uniform(0, 5, n), rng.uniform(0, 3, n), rng.gamma(9, 0.13, n), heading)


def at(x, y, heading, speed=1.0, hour=0.0):
    """Arguments of `log_density` for one row."""
    return x + ONE, y + ONE, NINE + 3600 * hour + ONE, heading + ONE, speed + ONE


def test_one_is_added_to_each_of_eight_directions():
    seen = rows((0.2, 0.3, 0.0, 1.0), (0.9, 0.9, 0.39, 1.0), (0.5, 0.5, np.pi / 2, 1.0), (0.5, 0.5, 1.0, 0.0),
                (3.5, 0.5, np.pi, 1.0))  # fmt: skip
    no_map = NoMap(seen.speed)
    one = histogram(seen, TOKYO, no_map, 1.0, [Level(8.0)])
    for heading, count in ((0.1, 2), (-0.3, 2), (np.pi / 2, 1), (np.pi, 0)):
        expected = np.log((count + 1) / 11 / (TWO_PI / 8))
        x, y, t, heading_, speed = at(0.5, 0.5, heading)
        assert one.log_heading(x, y, t, heading_)[0] == pytest.approx(expected)
        assert one.log_density(x, y, t, heading_, speed)[0] == pytest.approx(expected + no_map.log_speed(speed)[0])
    assert one.covered(np.array([1.4, 1.6]), np.full(2, 0.5), np.full(2, NINE)).tolist() == [True, False]
    assert np.isnan(one.log_density(*at(1.6, 0.5, 0.0))[0])


def test_hours_are_shrunk_to_the_day():
    seen = rows((0.5, 0.5, 0.0, 1.0), (0.5, 0.5, 0.0, 1.0), (0.5, 0.5, np.pi, 1.0, 1.0))
    no_map = NoMap(seen.speed)
    one = histogram(seen, TOKYO, no_map, 1.0, [Level(8.0), Level(4.0, hourly=True)])
    day = {0.0: 3 / 11, np.pi: 2 / 11}
    for hour, n, counts in ((0.0, 2, {0.0: 2, np.pi: 0}), (1.0, 1, {0.0: 0, np.pi: 1})):
        for heading, count in counts.items():
            expected = (count + 4 * day[heading]) / (n + 4) / (TWO_PI / 8)
            assert np.exp(one.log_heading(*at(0.5, 0.5, heading, hour=hour)[:4]))[0] == pytest.approx(expected)
    for heading, p in day.items():  # no rows in that hour: (0 + k q) / (0 + k)
        found = np.exp(one.log_heading(*at(0.5, 0.5, heading, hour=2.0)[:4]))[0]
        assert found == pytest.approx(p / (TWO_PI / 8))


def plain(seen, no_map, cell_m, levels, headings, per, spread_rad, spread_m_s, x, y, hour):
    """Probabilities [headings, speeds] at a place, row by row; the cell must have somebody in it."""
    speeds = -(-61 // per)
    groups = [np.exp(no_map.log_p[per * g : per * (g + 1)]).sum() for g in range(speeds)]
    p = np.tile(np.array(groups) / headings, (headings, 1))
    here = np.floor(np.array([x, y]) / cell_m)
    for level in levels:
        n = np.zeros((headings, speeds))
        for row in zip(*seen, strict=True):
            if level.hourly and (row[1] - NINE) // 3600 != hour:
                continue
            cell = np.floor(np.array(row[2:4]) / cell_m)
            apart = np.hypot(*(cell - here)) * cell_m
            if apart > 2.5 * level.spread_m + 1e-9:
                continue
            share = np.exp(-0.5 * (apart / level.spread_m) ** 2) if level.spread_m else 1.0
            o = twins.nearest_orientation(row[5], headings)
            s = min(int(row[4] / 0.05 + 1e-9), 60) // per
            around = [min(abs(o - h), headings - abs(o - h)) * TWO_PI / headings for h in range(headings)]
            turn = np.array([np.exp(-0.5 * (a / spread_rad) ** 2) for a in around])
            up = np.array([np.exp(-0.5 * ((s - g) * per * 0.05 / spread_m_s) ** 2) for g in range(speeds)])
            n += share * np.outer(turn / turn.sum(), up / up.sum())
        p = (n + level.weight * p) / (n.sum() + level.weight)
    return p


def test_spread_counts_are_those_of_a_plain_loop():
    seen = crowd(300)
    no_map, levels = NoMap(seen.speed), [Level(20.0, 1.5), Level(5.0, 0.5), Level(3.0, 0.5, hourly=True)]
    one = histogram(seen, TOKYO, no_map, 0.5, levels, Bins(12, 0.2, 0.3, 0.15))
    for x, y, hour in ((1.3, 1.2, 0), (4.6, 2.9, 2)):
        p = plain(seen, no_map, 0.5, levels, 12, 4, 0.3, 0.15, x, y, hour)
        for heading, speed in ((0.0, 1.02), (-2.5, 0.3), (3.1, 2.5)):
            o, s = twins.nearest_orientation(heading, 12), int(speed / 0.05 + 1e-9) // 4
            group = np.exp(no_map.log_p[4 * s : 4 * s + 4]).sum()
            expected = np.log(p[o, s] / (TWO_PI / 12)) + no_map.log_speed(np.array([speed]))[0] - np.log(group)
            where = at(x, y, heading, speed, hour)
            assert one.log_density(*where)[0] == pytest.approx(expected, abs=1e-4)
            assert one.log_heading(*where[:4])[0] == pytest.approx(np.log(p[o].sum() / (TWO_PI / 12)), abs=1e-4)


@pytest.mark.parametrize("bins", [Bins(), Bins(36, 0.1, 0.15, 0.08), Bins(12, 0.35)], ids=["plain", "fine", "odd"])
def test_it_integrates_to_1_at_50_places(bins):
    seen = crowd(2000, 1)
    one = histogram(seen, TOKYO, NoMap(seen.speed), 0.5, [Level(8.0, 1.0), Level(4.0, 0.0, hourly=True)], bins)
    heading, speed = -np.pi + TWO_PI * (np.arange(144) + 0.5) / 144, 3.0 * (np.arange(120) + 0.5) / 120
    grid = [part.ravel() for part in np.meshgrid(heading, speed, indexing="ij")]
    beyond = 3.0 + 57.0 * (np.arange(600) + 0.5) / 600  # what is faster has a density that falls as 1 / speed^2
    for x, y, hour in np.random.default_rng(2).uniform((0, 0, 0), (5, 3, 3), (50, 3)):
        where = [np.full(len(grid[0]), value) for value in (x, y, NINE + 3600 * hour)]
        total = np.exp(one.log_density(*where, *grid)).sum() * TWO_PI / 144 * 3 / 120
        tail = [np.full(len(beyond), value) for value in (x, y, NINE + 3600 * hour)]
        for angle in TWO_PI * np.arange(bins.headings) / bins.headings:
            total += np.exp(one.log_density(*tail, np.full(len(beyond), angle), beyond)).sum() * 57 / 600 * (
                TWO_PI / bins.headings
            )  # fmt: skip
        assert total == pytest.approx(1.0, abs=0.01)


def test_turned_and_moved_people_make_a_turned_and_moved_map():
    seen = crowd(500, 3)
    turned = seen._replace(x=-seen.y + 7.0, y=seen.x - 4.0, heading=seen.heading + np.pi / 2)
    make = [Level(20.0, 1.0), Level(5.0, 0.5)], Bins(12, 0.2, 0.3, 0.15)
    no_map = NoMap(seen.speed)
    one, other = (histogram(people, TOKYO, no_map, 0.5, *make) for people in (seen, turned))
    # Headings within bins, so that a border falls to neither side.
    heading = TWO_PI * (np.arange(12) + 0.2) / 12
    x, y, t, speed = np.full(12, 2.3), np.full(12, 1.2), np.full(12, NINE), np.linspace(0.3, 2.0, 12)
    found = other.log_density(-y + 7.0, x - 4.0, t, heading + np.pi / 2, speed)
    np.testing.assert_allclose(found, one.log_density(x, y, t, heading, speed), atol=1e-4)


def test_a_planted_law_of_headings_and_speeds_is_found():
    """East and fast, or west and slow: with the right bins the likelihood is nearly that of the law itself."""
    rng = np.random.default_rng(4)

    def people(n):
        east = rng.random(n) < 0.5
        heading = np.where(east, 0.0, np.pi) + rng.normal(0, 0.2, n)
        speed = np.where(east, 1.6, 0.7) + rng.normal(0, 0.1, n)
        return Tracks(np.arange(n), np.full(n, NINE), *rng.uniform(0, 4, (2, n)), speed, heading)

    seen, new = people(20000), people(4000)
    no_map = NoMap(seen.speed)
    where = (new.x, new.y, new.t, new.heading, new.speed)
    law = 0.5 * sum(
        np.exp(-0.5 * (np.angle(np.exp(1j * (new.heading - turn))) / 0.2) ** 2 - 0.5 * ((new.speed - fast) / 0.1) ** 2)
        / (TWO_PI * 0.02)
        for turn, fast in ((0.0, 1.6), (np.pi, 0.7))
    )
    fine = histogram(seen, TOKYO, no_map, 1.0, [Level(20.0, 1.0)], Bins(36, 0.1, 0.08, 0.05))
    plain_bins = histogram(seen, TOKYO, no_map, 1.0, [Level(8.0)])
    best, ours, theirs, none = (one.mean() for one in (
        np.log(law), fine.log_density(*where), plain_bins.log_density(*where), no_map.log_density(*where)
    ))  # fmt: skip
    assert best - 0.12 < ours < best + 0.02
    assert none < theirs < ours - 0.5
