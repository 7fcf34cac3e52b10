"""The smoothed CLiFF-map: an hour with many rows says what it saw, one with few what the day says."""

import numpy as np
import pytest

import modlhmp
from modlhmp import DataError, Site
from modlhmp.maps import density, smoothed_cliff, tc_cliff
from modlhmp.maps.density import NoMap
from modlhmp.options import SmoothedBuilding
from modlhmp.storage import column
from modlhmp.tracks import Tracks

SITE = Site(timezone="UTC")
SD = (0.15, 0.1)


def flow(persons, hour, east, seed, rows=10, x=(0.0, 6.0)):
    """Tracks in a corridor of 6 m by 2 m: a share of the rows goes to the east at 1 m/s, the others west at 1.4 m/s."""
    rng, n = np.random.default_rng(seed), persons * rows
    to_east = rng.random(n) < east
    heading = np.mod(np.where(to_east, 0, np.pi) + rng.normal(0, SD[0], n) + np.pi, 2 * np.pi) - np.pi
    speed = np.where(to_east, 1.0, 1.4) + rng.normal(0, SD[1], n)
    t = 3600.0 * hour + np.repeat(np.arange(persons), rows) * 4.0 + np.tile(np.arange(rows), persons)
    person = np.repeat(np.arange(persons), rows) + 1000 * hour + 100_000 * seed
    return Tracks(person, t, rng.uniform(*x, n), rng.uniform(0, 2, n), speed, heading)


def together(*parts):
    return Tracks(*map(np.concatenate, zip(*parts, strict=True)))


def east(table, x=None):
    """Share of the weight that goes to the east, over all locations or those in a span."""
    there = np.ones(table.num_rows, bool) if x is None else (column(table, "x") >= x[0]) & (column(table, "x") <= x[1])
    right = there & (abs(column(table, "mean_heading")) < np.pi / 2)
    return column(table, "weight")[right].sum() / column(table, "weight")[there].sum()


@pytest.fixture(scope="module")
def built():
    """Many people in hour 9 go east, many in hour 18 west; three persons in hour 12 go east."""
    tracks = together(flow(200, 9, 0.9, 1), flow(200, 18, 0.1, 2), flow(3, 12, 1.0, 3))
    return tracks, smoothed_cliff.build_hours(tracks, SITE)


def test_busy_hours_keep_what_they_saw_and_a_quiet_one_is_as_the_day(built):
    _, (whole, hours) = built
    assert sorted(hours) == [9, 12, 18]
    assert east(whole) == pytest.approx(0.5, abs=0.05)
    assert east(hours[9]) == pytest.approx(0.9, abs=0.08)
    assert east(hours[18]) == pytest.approx(0.1, abs=0.08)
    assert 0.48 < east(hours[12]) < 0.75  # of whose rows some seven say east, beside 20 of the day


@pytest.mark.parametrize(("day_rows", "close"), [(1e-6, 1.0), (1e6, 0.5)])
def test_how_much_an_hour_is_drawn_to_the_day_is_the_options(built, day_rows, close):
    tracks, _ = built
    _, hours = smoothed_cliff.build_hours(tracks, SITE, SmoothedBuilding(day_rows=day_rows))
    where = column(hours[12], "count") > 0
    assert where.any()
    right = where & (abs(column(hours[12], "mean_heading")) < np.pi / 2)
    weight = column(hours[12], "weight")
    assert weight[right].sum() / weight[where].sum() == pytest.approx(close, abs=0.06)


def test_weights_are_the_likeliest_given_the_prior():
    """No other weights have a higher posterior (Dirichlet of `strength` rows), by a search on a grid."""
    rng = np.random.default_rng(0)
    p, prior, strength = rng.gamma(0.5, size=(12, 3)), np.array([0.6, 0.3, 0.1]), 4.0

    def posterior(w):
        return np.log(p @ w).sum() + strength * (prior @ np.log(w))

    found = smoothed_cliff.reweighted(p, prior, strength)
    assert found.sum() == pytest.approx(1)
    grid = np.linspace(0.01, 0.98, 98)
    best = max(posterior(np.array([a, b, 1 - a - b])) for a in grid for b in grid if a + b < 0.995)
    assert posterior(found) > best - 1e-3
    assert smoothed_cliff.reweighted(np.empty((0, 3)), prior, strength) == pytest.approx(prior)


def test_components_are_the_days_and_only_their_weights_are_the_hours(built):
    """As a CLiFF-map of the whole day has them, but for the little that the background takes."""
    tracks, (whole, hours) = built
    like = modlhmp.build_map("cliff", tracks, SITE).whole
    shape = ["x", "y", "mean_heading", "mean_speed", "var_heading", "cov_heading_speed", "var_speed"]

    def rows(table, *columns):
        return np.array(sorted(zip(*(column(table, name).tolist() for name in (*shape, *columns)), strict=True)))

    assert all((rows(table) == rows(like)).all() for table in (whole, *hours.values()))
    assert abs(rows(whole, "weight")[:, -1] - rows(like, "weight")[:, -1]).max() < 0.05


def test_density_integrates_to_one_and_new_people_of_a_quiet_hour_are_likelier(built):
    """Than under the hour's own map, which knows three persons; the truth is that of the day."""
    tracks, (whole, hours) = built
    no_map, n = NoMap(tracks.speed), 2000
    rng = np.random.default_rng(9)
    to_east = rng.random(n) < 0.5
    heading = np.where(to_east, 0, np.pi) + rng.normal(0, SD[0], n)
    speed = np.where(to_east, 1.0, 1.4) + rng.normal(0, SD[1], n)
    x, y, t = rng.uniform(1, 5, n), rng.uniform(0.5, 1.5, n), np.full(n, 12.5 * 3600)
    smooth = density.load("smoothed_cliff", hours, SITE, no_map).log_density(x, y, t, heading, speed)
    own = density.load("tc_cliff", tc_cliff.build_hours(tracks, SITE)[1], SITE).log_density(x, y, t, heading, speed)
    both = np.isfinite(own) & np.isfinite(smooth)
    assert np.isfinite(smooth).all()
    assert (smooth - np.maximum(np.nan_to_num(own, nan=-np.inf), -27.6))[both].mean() > 1
    headings, speeds = np.linspace(-np.pi, np.pi, 240, endpoint=False), np.arange(0.0125, 5, 0.025)
    grid = np.stack(np.meshgrid(headings, speeds), -1).reshape(-1, 2).T
    for place in (0.0, 2.0, 5.0):
        at = np.full(grid.shape[1], place)
        for table in (whole, hours[12]):
            p = density.load("smoothed_cliff", table, SITE, no_map).log_density(at, np.ones_like(at), at, *grid)
            assert np.exp(p).sum() * (2 * np.pi / 240) * 0.025 == pytest.approx(1, abs=0.01)


def test_locations_counts_and_intensities_are_those_of_a_cliff_map(built):
    tracks, (whole, hours) = built
    like = modlhmp.build_map("cliff", tracks, SITE).whole

    def of(table):
        return {
            (x, y): (n, p) for x, y, n, p in zip(*(column(table, c) for c in ("x", "y", "count", "p")), strict=True)
        }

    assert of(whole) == of(like)
    assert all(sum(of(table)[place][0] for table in hours.values()) == n for place, (n, _) in of(whole).items())


def test_order_of_the_rows_hardly_matters_and_the_same_rows_give_the_same_bits(built):
    tracks, (whole, hours) = built
    again = smoothed_cliff.build_hours(tracks, SITE)
    assert again[0].equals(whole)
    assert all(again[1][hour].equals(table) for hour, table in hours.items())


def test_nobody_who_moves_is_an_empty_map():
    tracks = flow(5, 9, 0.5, 0)
    still = tracks._replace(speed=np.zeros(len(tracks.t)))
    whole, hours = smoothed_cliff.build_hours(still, SITE)
    assert whole.num_rows == 0
    assert not hours
    with pytest.raises(DataError, match="the map is empty"):
        modlhmp.build_map("smoothed_cliff", still, SITE)
