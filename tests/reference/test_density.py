"""Densities of maps: against plain sums, closed forms and integrals; where they cover; what is refused."""

import math

import numpy as np
import pyarrow as pa
import pytest
import twins

from modlhmp.maps import cliff, density, stef
from modlhmp.maps.density import NoMap
from modlhmp.options import CliffBuilding, StefBuilding
from modlhmp.site import Site
from modlhmp.storage import DataError, write_parquet
from modlhmp.tracks import Tracks

TWO_PI = 2 * np.pi
TOKYO = Site(timezone="Asia/Tokyo")
NINE = 1351036800.0  # 24 October 2012, 9 o'clock in Tokyo
HEADINGS, SPEEDS = 180, 400
PLACES = 50


def mixture_table(mixtures, spacing=1.0, **more):
    """A CLiFF-map of mixtures [J, 6], one a location, in a row along x."""
    rows = [[n, spacing * n, 0.0, *one, 10, 1.0, 1.0] for n, mixture in enumerate(mixtures) for one in mixture]
    table = pa.table(dict(zip(cliff.COLUMNS, np.array(rows, float).T, strict=True)))
    table = table.set_column(0, "location", pa.array(np.array(rows)[:, 0].astype(np.int32)))
    for name, values in more.items():
        table = table.append_column(name, pa.array(values))
    return table.replace_schema_metadata({"resolution": "1.0"})


def random_mixtures(number, seed, most_sd=3.0):
    """Mixtures whose headings have standard deviations up to `most_sd`, some of their speeds with mass below 0."""
    rng = np.random.default_rng(seed)
    for _ in range(number):
        parts = rng.integers(1, 5)
        weight = rng.dirichlet(np.ones(parts))
        sd_heading, sd_speed = rng.uniform(0.05, most_sd, parts), rng.uniform(0.05, 0.5, parts)
        covariance = rng.uniform(-0.8, 0.8, parts) * sd_heading * sd_speed
        means = rng.uniform(-np.pi, np.pi, parts), rng.uniform(0.2, 1.6, parts)
        yield np.column_stack([weight, *means, sd_heading**2, covariance, sd_speed**2])


def people(n, seed=0, hours=1):
    """Rows of people who walk east or north within 4 m x 4 m, at all times of so many hours."""
    rng = np.random.default_rng(seed)
    heading = np.where(rng.random(n) < 0.7, 0.0, np.pi / 2) + rng.normal(0, 0.3, n)
    x, y = rng.uniform(0, 4, (2, n))
    t = NINE + np.sort(rng.uniform(0, 3600 * hours, n))
    return Tracks(np.arange(n), t, x, y, rng.gamma(20, 0.06, n), np.array([twins.wrap(a) for a in heading]))


def integral(one, x, y, t, top=8.0):
    """Integral of exp(log_density) over one turn and speeds from 0 to `top`, at one place and time."""
    heading = -np.pi + TWO_PI * (np.arange(HEADINGS) + 0.5) / HEADINGS
    speed = top * (np.arange(SPEEDS) + 0.5) / SPEEDS
    grid = [part.ravel() for part in np.meshgrid(heading, speed, indexing="ij")]
    where = [np.full(len(grid[0]), value) for value in (x, y, t)]
    return np.exp(one.log_density(*where, *grid)).sum() * TWO_PI / HEADINGS * top / SPEEDS


def heading_integral(one, x, y, t):
    """The same of exp(log_heading)."""
    heading = -np.pi + TWO_PI * (np.arange(HEADINGS) + 0.5) / HEADINGS
    where = [np.full(HEADINGS, value) for value in (x, y, t)]
    return np.exp(one.log_heading(*where, heading)).sum() * TWO_PI / HEADINGS


def plain_density(heading, speed, mixture):
    """A mixture's density for speeds of 0 and more, with far more windings than are needed."""
    total = mass = 0.0
    for component in mixture:
        sigma, mean = twins.covariance(component), component[1:3]
        mass += component[0] * 0.5 * math.erfc(-mean[1] / math.sqrt(2 * sigma[1, 1]))
        for k in range(-12, 13):
            d = np.array([heading + TWO_PI * k, speed]) - mean
            total += component[0] * math.exp(-0.5 * d @ np.linalg.inv(sigma) @ d) / (
                TWO_PI * math.sqrt(np.linalg.det(sigma))
            )  # fmt: skip
    return total / mass


def test_a_mixture_is_the_plain_sum_over_many_windings():
    mixtures = list(random_mixtures(20, 1))
    one = density.load("cliff", mixture_table(mixtures, 3.0), TOKYO)
    rng = np.random.default_rng(2)
    place, heading, speed = rng.integers(0, 20, 200), rng.uniform(-np.pi, np.pi, 200), rng.uniform(0, 2.5, 200)
    found = one.log_density(3.0 * place, np.zeros(200), np.zeros(200), heading, speed)
    expected = [plain_density(*each) for each in zip(heading, speed, [mixtures[p] for p in place], strict=True)]
    np.testing.assert_allclose(np.exp(found), expected, rtol=1e-5, atol=1e-8)
    turned = one.log_density(3.0 * place, np.zeros(200), np.zeros(200), heading + 6 * np.pi, speed)
    np.testing.assert_allclose(turned, found, rtol=1e-9)


def test_mixtures_integrate_to_1_and_their_headings_are_the_marginal():
    one = density.load("cliff", mixture_table(random_mixtures(PLACES, 3), 3.0), TOKYO)
    for place in range(PLACES):
        assert integral(one, 3.0 * place, 0.0, 0.0) == pytest.approx(1.0, abs=0.01)
        assert heading_integral(one, 3.0 * place, 0.0, 0.0) == pytest.approx(1.0, abs=0.01)
    speed = 8.0 * (np.arange(1000) + 0.5) / 1000
    for place, heading in ((4, 0.3), (11, -3.0), (37, 2.0)):
        where = [np.full(1000, value) for value in (3.0 * place, 0.0, 0.0, heading)]
        joint = np.exp(one.log_density(*where, speed)).sum() * 8.0 / 1000
        assert one.log_heading(*(part[:1] for part in where))[0] == pytest.approx(np.log(joint), abs=1e-3)


def test_built_maps_integrate_to_1_at_their_places():
    tracks = people(4000)
    no_map = NoMap(tracks.speed)
    maps = {
        "cliff": cliff.build(tracks, TOKYO, CliffBuilding(resolution_m=0.6, radius_m=0.6)),
        "stef": stef.build(tracks, TOKYO, StefBuilding(resolution_m=0.5)),
    }
    rng = np.random.default_rng(5)
    for kind, table in maps.items():
        one = density.load(kind, table, TOKYO, no_map)
        for x, y in rng.uniform(0.2, 3.8, (PLACES, 2)):
            # The speed histogram has 1 / 4061 beyond 3 m/s, of which 3 / 8 lies beyond 8 m/s.
            assert integral(one, x, y, NINE) == pytest.approx(1.0, abs=0.01), kind
            assert heading_integral(one, x, y, NINE) == pytest.approx(1.0, abs=0.01), kind


def test_without_a_map_speeds_are_a_histogram_and_any_heading_is_as_likely():
    speed = np.array([1.02, 1.03, 1.21, 0.0, np.nan, 4.0])
    one = NoMap(speed)
    where = [np.zeros(4)] * 4
    found = np.exp(one.log_density(*where, np.array([1.04, 1.22, 2.0, 6.0])))
    # 4 speeds count, and 61 bins have one each; above 3 m/s the density of the last bin is 3 / speed^2.
    expected = np.array([3 / 65 / 0.05, 2 / 65 / 0.05, 1 / 65 / 0.05, 2 / 65 * 3 / 36]) / TWO_PI
    np.testing.assert_allclose(found, expected)
    assert integral(one, 0, 0, 0) == pytest.approx(1 - 2 / 65 * 3 / 8, abs=1e-3)
    assert heading_integral(one, 0, 0, 0) == pytest.approx(1.0)
    assert NoMap(np.array([0.15])).log_p.argmax() == 3  # a border belongs to the bin above, whatever the rounding


def test_the_nearest_location_answers_within_a_metre():
    """Not the busiest, as when a map is sampled."""
    slow, fast = ([[1.0, 0.0, mean, 0.1, 0.0, 0.01]] for mean in (0.5, 1.5))
    table = mixture_table([slow, fast])
    one = density.load("cliff", table, TOKYO)
    x, zero = np.array([0.4, 0.6, -1.0, -1.001, 2.0, 2.01]), np.zeros(6)
    assert one.covered(x, zero, zero).tolist() == [True, True, True, False, True, False]
    found = one.log_density(x, zero, zero, zero, np.full(6, 1.5))
    assert (found[[1, 4]] > 1).all() and (found[[0, 2]] < -40).all() and np.isnan(found[[3, 5]]).all()
    assert np.isnan(one.log_heading(x, zero, zero, zero)).tolist() == np.isnan(found).tolist()


def test_hours_are_the_clocks_of_the_place():
    tables = {hour: mixture_table([[[1.0, 0.0, speed, 0.1, 0.0, 0.01]]]) for hour, speed in ((9, 0.5), (10, 1.5))}
    one = density.load("tc_cliff", tables, TOKYO)
    t, zero = NINE + np.array([0.0, 3599.0, 3600.0, 7200.0]), np.zeros(4)
    assert one.covered(zero, zero, t).tolist() == [True, True, True, False]
    found = one.log_density(zero, zero, t, zero, np.full(4, 0.5))
    assert (found[:2] > 1).all() and found[2] < -40 and np.isnan(found[3])


def test_a_background_is_mixed_in_with_its_weight():
    component = [[1.0, 0.0, 1.0, 0.1, 0.0, 0.01]]
    no_map = NoMap(np.array([1.0, 1.2]))
    plain = density.load("cliff", mixture_table([component]), TOKYO)
    mixed = density.load("cliff", mixture_table([component], background=[0.25]), TOKYO, no_map)
    where, velocity = [np.zeros(3)] * 3, (np.array([0.0, 3.0, 1.0]), np.array([1.0, 2.5, 1.0]))
    expected = 0.75 * np.exp(plain.log_density(*where, *velocity)) + 0.25 * np.exp(
        no_map.log_density(*where, *velocity)
    )
    np.testing.assert_allclose(np.exp(mixed.log_density(*where, *velocity)), expected)
    expected = 0.75 * np.exp(plain.log_heading(*where, velocity[0])) + 0.25 / TWO_PI
    np.testing.assert_allclose(np.exp(mixed.log_heading(*where, velocity[0])), expected)
    with pytest.raises(DataError, match=r"background.*no_map"):
        density.load("cliff", mixture_table([component], background=[0.25]), TOKYO)


def test_a_stef_map_is_even_in_a_sector_and_leaves_out_what_it_never_saw():
    table = pa.table({
        "x": [0.5, 1.5], "y": [0.5, 0.5],
        "probabilities": pa.FixedSizeListArray.from_arrays(pa.array([0.75, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 4),
    }).replace_schema_metadata({"resolution": "1.0", "orientations": "4"})  # fmt: skip
    one = density.load("stef", {9: table}, TOKYO, NoMap(np.array([1.0])))
    n, t = np.zeros(4), np.full(4, NINE)
    heading = np.array([-0.7, 0.7, 1.0, 3.0])
    found = one.log_heading(n + 0.5, n + 0.5, t, heading)
    np.testing.assert_allclose(np.exp(found), np.array([0.75, 0.75, 0.25, 0.0]) / (np.pi / 2))
    # The second cell has no dynamics: whoever stands in it asks the first, if that is near enough.
    assert one.covered(np.array([1.4, 1.6]), n[:2] + 0.5, t[:2]).tolist() == [True, False]
    headings_only = density.load("stef", table, TOKYO)
    with pytest.raises(DataError, match="knows no speeds"):
        headings_only.log_density(n + 0.5, n + 0.5, t, heading, n + 1)


def test_large_cells_answer_throughout():
    table = stef.build(people(2000), TOKYO, StefBuilding(resolution_m=4.0))
    one = density.load("stef", table, TOKYO)
    assert one.covered(np.array([0.01, 3.99]), np.array([0.01, 3.99]), np.zeros(2)).all()


def test_maps_are_read_from_files_and_folders_of_hours(tmp_path):
    table = mixture_table(random_mixtures(3, 7))
    for name in ("09.parquet", "day.parquet"):
        write_parquet(table, tmp_path / name)
    x, zero, t = np.arange(3.0), np.zeros(3), np.full(3, NINE)
    expected = density.load("cliff", table, TOKYO).log_density(x, zero, t, zero, zero + 1)
    for source in (tmp_path, tmp_path / "day.parquet", str(tmp_path / "09.parquet")):
        np.testing.assert_array_equal(
            density.load("tc_cliff", source, TOKYO).log_density(x, zero, t, zero, zero + 1), expected
        )
    assert not density.load("tc_cliff", tmp_path, TOKYO).covered(x, zero, t + 3600).any()


def test_maps_without_velocities_of_places_and_empty_folders_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"episodes.*no density.*person, t"):
        density.load("episodes", pa.table({"person": [1], "t": [0.0]}), TOKYO)
    with pytest.raises(DataError, match="no hour's map"):
        density.load("tc_cliff", tmp_path, TOKYO)


def test_a_map_without_locations_covers_nothing():
    one = density.load("cliff", cliff.build(people(3), TOKYO), TOKYO)
    assert not one.covered(np.zeros(2), np.zeros(2), np.zeros(2)).any()
    assert np.isnan(one.log_density(*[np.zeros(2)] * 5)).all()
