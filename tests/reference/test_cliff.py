"""CLiFF-map: neighbourhoods, building, location choice and sampling against plain twins and planted flows."""

import math

import numpy as np
import pyarrow as pa
import pytest
import twins
from scipy import stats

from modlhmp.maps import cliff
from modlhmp.options import CliffBuilding, RollOut
from modlhmp.site import Site
from modlhmp.storage import DataError, write_parquet
from modlhmp.study.demo.sites import planted_flows
from modlhmp.tracks import Tracks, clock_hours, concatenate


def tracks_at(x, y, speed, heading):
    """A track table of single observations."""
    n = len(x)
    columns = (np.broadcast_to(np.asarray(v, float), n) for v in (x, y, speed, heading))
    return Tracks(np.arange(n), np.arange(n, dtype=float), *columns)


def crowd(seed, n=400, extent=4.0):
    """Observations in a square, half of them eastward, half of them northward."""
    rng = np.random.default_rng(seed)
    heading = rng.normal(np.where(np.arange(n) % 2, np.pi / 2, 0.0), 0.2)
    return tracks_at(*rng.uniform(-extent / 2, extent / 2, (2, n)), rng.normal(1.2, 0.15, n), heading)


def table_of(locations, mixtures, p, resolution=1.0, count=50):
    """A CLiFF-map's table from locations [m, 2], their mixtures (lists of six numbers) and their p."""
    rows = [
        (n, *at, *component, count, p[n], 1.0)
        for n, (at, mixture) in enumerate(zip(locations, mixtures, strict=True))
        for component in mixture
    ]
    columns = dict(zip(cliff.COLUMNS, map(list, zip(*rows, strict=True)), strict=True))
    return pa.table(columns).replace_schema_metadata({"resolution": str(resolution)})


def lattice_map(seed, resolution=1.0, origin=(0.0, 0.0), size=8, holes=0.3, levels=4):
    """A map with holes and many equal p, two components per location."""
    rng = np.random.default_rng(seed)
    nodes = [(i, j) for i in range(size) for j in range(size) if rng.random() > holes]
    locations = [(origin[0] + i * resolution, origin[1] + j * resolution) for i, j in nodes]
    mixtures = [
        [
            (0.6, rng.uniform(-3, 3), 1.2, 0.1, 0.01, 0.03),
            (0.4, rng.uniform(-3, 3), 0.8, 0.2, -0.02, 0.05),
        ]
        for _ in locations
    ]
    return table_of(locations, mixtures, rng.integers(1, levels + 1, len(locations)) / levels, resolution)


# --- neighbourhoods and building ----------------------------------------------------------------------------


@pytest.mark.parametrize(("resolution", "radius"), [(1.0, 1.0), (1.0, 0.5), (1.0, 2.0), (0.5, 1.0), (2.0, 1.0)])
def test_neighbourhoods_are_closed_balls_around_the_lattice(resolution, radius):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-3, 3, (2, 150))
    # Quarters of a metre are exact in binary: many of these lie on the border of a ball, and on lattice points.
    x[:75], y[:75] = rng.integers(-12, 13, (2, 75)) / 4
    expected = twins.neighbourhoods(x, y, resolution, radius, 5)
    nodes, members = cliff.neighbourhoods(x, y, resolution, radius, 5)
    got = {tuple(node): sorted(mine) for node, mine in zip(nodes.tolist(), members, strict=True)}
    assert len(got) == len(nodes)
    assert got == expected


def test_border_of_the_ball_is_inside():
    x, y = np.array([1.0] * 3 + [-0.6] * 2), np.array([0.0] * 3 + [0.8] * 2)  # all at distance 1 from (0, 0)
    nodes, members = cliff.neighbourhoods(x, y, 1.0, 1.0, 5)
    assert nodes.tolist() == [[0.0, 0.0]]
    assert members[0].tolist() == [0, 1, 2, 3, 4]


def test_locations_are_whole_multiples_of_the_resolution():
    nodes, _ = cliff.neighbourhoods(*np.random.default_rng(2).uniform(100.3, 103.3, (2, 300)), 1.0, 1.0, 5)
    np.testing.assert_array_equal(nodes, np.round(nodes))
    assert len(nodes) > 9


def test_build_counts_and_intensity():
    tracks = crowd(3)
    expected = twins.neighbourhoods(tracks.x, tracks.y, 1.0, 1.0, 5)
    table = cliff.build(tracks).to_pandas()
    assert tuple(table.columns) == cliff.COLUMNS
    first = table.groupby("location").first()
    got = {(x, y): n for x, y, n in zip(first["x"], first["y"], first["count"], strict=True)}
    assert got == {node: len(mine) for node, mine in expected.items()}
    largest = max(map(len, expected.values()))
    np.testing.assert_allclose(table["p"], table["count"] / largest, rtol=1e-12)
    assert table["p"].max() == 1.0
    assert (table["q"] == 1.0).all()
    assert (table.groupby("location")[["x", "y", "count", "p"]].nunique() == 1).all(axis=None)
    assert table["location"].tolist() == sorted(table["location"])
    assert sorted(set(table["location"])) == list(range(len(expected)))


def test_build_makes_proper_mixtures():
    table = cliff.build(crowd(4)).to_pandas()
    np.testing.assert_allclose(table.groupby("location")["weight"].sum(), 1.0, atol=1e-9)
    assert (table["weight"] > 0).all()
    assert table["mean_heading"].between(-np.pi, np.pi).all()
    for row in table.itertuples():
        sigma = [[row.var_heading, row.cov_heading_speed], [row.cov_heading_speed, row.var_speed]]
        assert np.linalg.eigvalsh(sigma).min() >= 1e-4 - 1e-8  # float32 entries
    for _, mixture in table.groupby("location"):
        assert (np.diff(mixture["weight"]) <= 0).all()  # the heaviest first


def test_build_finds_both_planted_directions_at_every_busy_location():
    table = cliff.build(crowd(5, n=1500)).to_pandas()
    busy = table[table["count"] > 150]
    assert busy["location"].nunique() >= 9
    for _, mixture in busy.groupby("location"):
        for planted in (0.0, np.pi / 2):
            near = mixture[np.abs(mixture["mean_heading"] - planted) < 0.5]
            assert near["weight"].sum() == pytest.approx(0.5, abs=0.15)
            mean = np.average(near["mean_heading"], weights=near["weight"])
            assert mean == pytest.approx(planted, abs=0.15)
            assert np.average(near["mean_speed"], weights=near["weight"]) == pytest.approx(1.2, abs=0.1)


@pytest.mark.parametrize("sd", [0.3, 0.03, 0.003])
def test_location_of_one_flow_has_one_direction(sd):
    rng = np.random.default_rng(6)
    heading, speed = rng.normal(0.5, sd, 100), rng.normal(1.2, sd, 100)
    components = cliff.fit_location(heading, speed)
    main = components[0]
    # However many parts the fit needs, they are of one flow: nobody walks elsewhere.
    assert np.abs(components[:, 1] - 0.5).max() < 4 * sd
    assert main[1] == pytest.approx(0.5, abs=1.5 * sd)
    assert np.average(components[:, 2], weights=components[:, 0]) == pytest.approx(speed.mean(), abs=1e-3)


def test_rows_without_motion_do_not_count():
    moving = crowd(7)
    idle = tracks_at(*np.random.default_rng(8).uniform(-2, 2, (2, 300)), 0.0, 1.0)
    unknown = tracks_at(moving.x, moving.y, np.nan, np.nan)
    table = cliff.build(moving)
    assert cliff.build(concatenate([idle, moving, unknown])).equals(table)
    crawling = idle._replace(speed=np.full(300, 1e-3))  # slow is not still
    assert not cliff.build(concatenate([crawling, moving])).equals(table)


def test_intensity_of_time_is_the_share_of_the_steps_with_motion():
    """Ten walk at one place in the same second, one at another in each of five: more rows there, more time here."""
    rng = np.random.default_rng(12)
    many = tracks_at(np.zeros(10), 0.0, rng.normal(1.2, 0.1, 10), 0.3)._replace(t=np.full(10, 3.0))
    steady = tracks_at(np.full(5, 10.0), 0.0, rng.normal(1.2, 0.1, 5), 0.3)._replace(t=np.arange(5.0) + 10.25)
    still = tracks_at(np.full(4, 20.0), 0.0, 0.0, 0.3)._replace(t=np.arange(4.0) + 100)  # observed, without motion
    tracks = concatenate([many, steady, still])
    by_time, by_count = (
        cliff.build(tracks, Site(), CliffBuilding(intensity=one)).to_pandas().groupby("x")["p"].first()
        for one in ("time", "count")
    )
    assert by_time.to_dict() == pytest.approx(
        {0.0: 1 / 10, 10.0: 5 / 10} | {x: by_time[x] for x in (-1, 1, 9, 11) if x in by_time}
    )
    assert by_count.to_dict()[0.0] == 1.0 and by_count.to_dict()[10.0] == 0.5


@pytest.mark.parametrize(("observations", "locations"), [(0, 0), (4, 0), (5, 1)])
def test_location_needs_five_observations(observations, locations):
    rng = np.random.default_rng(9)
    corner = tracks_at(np.full(observations, 0.9), 0.0, rng.normal(1.2, 0.1, observations), 0.3)
    # (0.9, 0) is in reach of the nodes (0, 0) and (1, 0); one more walker stands still there and does not count.
    still = tracks_at(np.full(1, 0.9), 0.0, 0.0, 0.3)
    table = cliff.build(concatenate([corner, still]), building=CliffBuilding(min_observations=5))
    nodes = set(zip(table["x"].to_pylist(), table["y"].to_pylist(), strict=True))
    assert nodes == ({(0.0, 0.0), (1.0, 0.0)} if locations else set())
    assert set(table["count"].to_pylist()) == ({observations} if locations else set())


def test_small_clusters_join_the_nearest_large_one_with_their_data():
    rng = np.random.default_rng(10)
    east, west = rng.normal(0.0, 0.1, 40), rng.normal(np.pi - 0.1, 0.1, 3)  # three people are no flow
    heading, speed = np.concatenate([east, west]), rng.normal(1.2, 0.1, 43)
    components = cliff.fit_location(heading, speed)
    assert components[:, 0].sum() == pytest.approx(1.0, abs=1e-9)
    # EM on all 43: the mixture's mean heading vector is that of all data, the three included.
    assert (np.abs(components[:, 1]) < 1.0).all()
    mean_speed = np.average(components[:, 2], weights=components[:, 0])
    assert mean_speed == pytest.approx(speed.mean(), abs=1e-6)


def test_order_of_the_rows_does_not_matter():
    tracks = crowd(11)
    order = np.random.default_rng(11).permutation(len(tracks.t))
    a, b = cliff.build(tracks).to_pandas(), cliff.build(tracks.take(order)).to_pandas()
    np.testing.assert_allclose(b.to_numpy(), a.to_numpy(), atol=1e-6)


# --- choosing a location ------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize(("resolution", "origin"), [(1.0, (-3.0, 2.0)), (0.5, (0.0, 0.0)), (1.0, (0.906, 0.246))])
def test_locate_is_the_busiest_location_in_reach(radius, resolution, origin):
    table = lattice_map(12, resolution, origin)
    columns = table.to_pydict()
    first = [n for n, number in enumerate(columns["location"]) if n == 0 or number != columns["location"][n - 1]]
    locations = [(columns["x"][n], columns["y"][n]) for n in first]
    p = [columns["p"][n] for n in first]
    rng = np.random.default_rng(13)
    reach = 8 * resolution + 2 * radius
    points = np.asarray(origin) - radius + rng.uniform(0, reach, (400, 2))
    # Half of them at nodes and midway between nodes, where distances and p tie.
    points[:200] = np.asarray(origin) + rng.integers(-4, 20, (200, 2)) * resolution / 2
    expected = [twins.locate(*point, locations, p, radius) for point in points]
    got = cliff.CliffMap(table, radius).locate(*points.T)
    assert got.tolist() == expected
    assert -1 in expected
    assert len(set(expected)) > 5


@pytest.mark.parametrize(("x", "row"), [(1.0, 1), (0.999999, 1), (-1.0, 0), (-1.000001, -1), (2.0, 1), (2.000001, -1)])
def test_border_of_the_sampling_radius_is_inside(x, row):
    one = (1.0, 0.0, 1.0, 0.1, 0.0, 0.1)
    table = table_of([(0.0, 0.0), (1.0, 0.0)], [[one], [one]], p=[0.5, 1.0])
    assert cliff.CliffMap(table, 1.0).locate(x, 0.0).tolist() == [row]


def test_ties_in_intensity_go_to_the_nearer():
    one = (1.0, 0.0, 1.0, 0.1, 0.0, 0.1)
    mod = cliff.CliffMap(table_of([(0.0, 0.0), (1.0, 0.0)], [[one], [one]], p=[0.7, 0.7]), 1.0)
    assert mod.locate([0.4, 0.6, 0.5], [0.0, 0.0, 0.0]).tolist() == [0, 1, 0]


def test_map_without_locations_finds_nothing():
    empty = cliff.build(tracks_at(np.zeros(3), 0.0, 1.0, 0.0))
    assert empty.num_rows == 0
    mod = cliff.CliffMap(empty)
    assert mod.locate([0.0, 1.0], [0.0, 5.0]).tolist() == [-1, -1]
    ones = np.ones(2)
    assert not mod.sample(ones, ones, ones, ones, ones, np.full((2, 3), 0.5))[3].any()


# --- sampling -----------------------------------------------------------------------------------------------

DRAWS = 20_000
# Far enough apart that a draw tells its component; the second one lies across the seam.
MIXTURE = np.array([
    [0.5, 0.0, 1.3, 0.04, 0.015, 0.02],
    [0.3, 3.1, 1.0, 0.09, -0.010, 0.01],
    [0.2, -1.6, 0.7, 0.03, 0.000, 0.005],
])  # fmt: skip


def sample_one_location(mixture, seed=14, n=DRAWS):
    """(speed, heading, log fitness) of `n` draws from a map of one location."""
    mod = cliff.CliffMap(table_of([(0.0, 0.0)], [[tuple(c) for c in mixture]], p=[1.0]))
    ones = np.ones(n)
    uniforms = np.random.default_rng(seed).uniform(size=(n, mod.draws))
    speed, heading, log_fitness, found = mod.sample(0.3 * ones, 0.2 * ones, ones, ones, ones, uniforms)
    assert found.all()
    return speed, heading, log_fitness


@pytest.fixture(scope="module")
def drawn():
    return sample_one_location(MIXTURE)


def nearest_component(heading):
    """Index of the component of `MIXTURE` each heading belongs to."""
    away = np.angle(np.exp(1j * (heading[:, None] - MIXTURE[:, 1])))
    return np.abs(away).argmin(axis=1)


def test_components_get_their_shares_of_the_draws(drawn):
    counts = np.bincount(nearest_component(drawn[1]), minlength=3)
    assert stats.chisquare(counts, DRAWS * MIXTURE[:, 0]).pvalue > 0.01


def test_headings_follow_the_wrapped_mixture(drawn):
    heading = drawn[1]
    assert (heading > -np.pi).all()
    assert (heading <= np.pi).all()

    def cdf(angle):  # P(-pi < heading <= angle): sum over components and windings
        total = np.zeros_like(angle)
        for w, mean, _, var, _, _ in MIXTURE:
            for k in (-1, 0, 1):
                part = stats.norm(mean + 2 * np.pi * k, math.sqrt(var))
                total += w * (part.cdf(angle) - part.cdf(-np.pi))
        return total

    assert stats.kstest(heading, cdf).pvalue > 0.01


def test_speeds_follow_their_component_given_the_heading(drawn):
    speed, heading, _ = drawn
    component = MIXTURE[nearest_component(heading)]
    away = np.angle(np.exp(1j * (heading - component[:, 1])))
    slope = component[:, 4] / component[:, 3]
    rest = component[:, 5] - component[:, 4] * slope
    standard = (speed - component[:, 2] - slope * away) / np.sqrt(rest)
    assert stats.kstest(standard, "norm").pvalue > 0.01
    assert abs(np.corrcoef(standard, away)[0, 1]) < 3.5 / math.sqrt(DRAWS)


def test_log_fitness_is_the_log_density_of_the_draw(drawn):
    speed, heading, log_fitness = (part[:2000] for part in drawn)
    expected = np.log(twins.swgmm_density(heading, speed, MIXTURE))
    np.testing.assert_allclose(log_fitness, expected, rtol=1e-9, atol=1e-9)


def test_negative_speeds_become_zero_and_are_judged_as_zero():
    slow = np.array([[1.0, 0.5, 0.0, 0.05, 0.01, 0.25]])
    speed, heading, log_fitness = sample_one_location(slow, n=4000)
    assert (speed >= 0).all()
    assert (speed == 0).mean() == pytest.approx(0.5, abs=0.03)  # not drawn anew
    expected = np.log(twins.swgmm_density(heading, speed, slow))
    np.testing.assert_allclose(log_fitness, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.0])
def test_sample_equals_the_plain_twin(radius):
    table = lattice_map(15)
    rng = np.random.default_rng(16)
    x, y = rng.uniform(-2, 10, (2, 300))
    uniforms = rng.uniform(size=(300, 3))
    ones = np.ones(300)
    speed, heading, log_fitness, found = cliff.CliffMap(table, radius).sample(x, y, ones, ones, ones, uniforms)
    plain = twins.PlainCliff(table.to_pydict(), radius)
    expected = [plain.sample(*particle, 1.0, u) for *particle, u in zip(x, y, uniforms, strict=True)]
    assert found.tolist() == [e is not None for e in expected]
    assert 0 < found.sum() < 300
    got = np.column_stack([speed, heading, log_fitness])[found]
    np.testing.assert_allclose(got, [e for e in expected if e is not None], atol=1e-9)


def test_weights_of_a_foreign_map_are_normalised_and_covariances_repaired():
    # Published maps have weights that sum to 0.333 and, by rounding, covariances that are none (facts of ATC).
    broken = [(0.2, 0.0, 1.0, 0.1, 0.0, 0.1), (0.1, 2.0, 1.0, 0.01, 0.02, 0.01)]
    mod = cliff.CliffMap(table_of([(0.0, 0.0)], [broken], p=[1.0]))
    mixture = mod.mixture(0)
    np.testing.assert_allclose(mixture[:, 0], [2 / 3, 1 / 3], rtol=1e-12)
    repaired = twins.floored(np.array([[0.01, 0.02], [0.02, 0.01]]), 1e-4)
    np.testing.assert_allclose(mixture[1, 3:], [repaired[0, 0], repaired[0, 1], repaired[1, 1]], rtol=1e-9)


@pytest.mark.parametrize(("resolution", "radius"), [(1.0, 1.0), (0.5, 0.8)])
def test_saved_map_samples_alike(tmp_path, resolution, radius):
    table = cliff.build(crowd(17), building=CliffBuilding(resolution_m=resolution))
    write_parquet(table, tmp_path / "map.parquet", dataset="test", seed=1)
    rng = np.random.default_rng(18)
    x, y = rng.uniform(-4, 4, (2, 500))
    ones, uniforms = np.ones(500), rng.uniform(size=(500, 3))
    before = cliff.CliffMap(table, radius).sample(x, y, ones, ones, ones, uniforms)
    loaded = cliff.load(tmp_path / "map.parquet", Site(), RollOut(sampling_radius_m=radius))
    after = loaded.sample(x, y, ones, ones, ones, uniforms)
    assert 0 < before[3].sum() < 500
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


def test_loading_another_table_is_refused(tmp_path):
    write_parquet(pa.table({"x": [1.0], "y": [2.0]}), tmp_path / "other.parquet")
    with pytest.raises(DataError, match="mean_heading"):
        cliff.load(tmp_path / "other.parquet", Site(), RollOut())


def test_a_map_that_does_not_say_how_far_apart_its_locations_are_is_refused(tmp_path):
    write_parquet(lattice_map(19).replace_schema_metadata(None), tmp_path / "map.parquet")
    with pytest.raises(DataError, match=r"not a CLiFF-map, no metadata resolution"):
        cliff.load(tmp_path / "map.parquet", Site(), RollOut())


# --- planted flows ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hall():
    """Clean tracks of a demo hall day, three times as busy, and their clock hours."""
    tracks = twins.demo_tracks("2030-10-02", scale=3.0)
    return tracks, clock_hours(tracks.t, "Asia/Tokyo")


def mixture_at(tracks, x, y):
    """Components of the map's location (x, y); the observations around it are all that its mixture depends on."""
    table = cliff.build(tracks.take(np.hypot(tracks.x - x, tracks.y - y) < 1.5)).to_pandas()
    return table[(table["x"] == x) & (table["y"] == y)]


def share_towards(mixture, heading):
    """Weight of the components whose mean heading is within 45 degrees of `heading`."""
    return mixture["weight"][np.cos(mixture["mean_heading"] - heading) > np.cos(np.pi / 4)].sum()


@pytest.mark.parametrize("hour", [9, 10, 17, 18, 19, 20])
def test_hourly_demo_maps_lean_as_planted(hall, hour):
    tracks, hours = hall
    main_flows = [flow for flow in planted_flows("hall", hour) if flow.share >= 0.65]
    assert len(main_flows) >= 2
    for flow in main_flows:
        mixture = mixture_at(tracks.take(hours == hour), flow.x, flow.y)
        assert share_towards(mixture, flow.heading) > 0.5, f"{flow.place}: {mixture}"


def test_hourly_demo_maps_show_the_planted_headings_shares_and_speeds(hall):
    tracks, hours = hall
    checked = 0
    for hour in range(9, 21):
        for flow in (flow for flow in planted_flows("hall", hour) if flow.share >= 0.65):
            around = (hours == hour) & (np.hypot(tracks.x - flow.x, tracks.y - flow.y) <= 1.0)
            against = (np.cos(tracks.heading[around] - flow.heading) < 0).sum()
            if around.sum() < 20 or against < cliff.MIN_CLUSTER:
                continue  # too few for a share, or too few against the flow for a component of their own
            mixture = mixture_at(tracks.take(hours == hour), flow.x, flow.y)
            heaviest = mixture.iloc[0]
            where = f"{flow.place} at {hour} h: {mixture}"
            assert abs(twins.wrap(heaviest["mean_heading"] - flow.heading)) < 0.15, where
            assert share_towards(mixture, flow.heading) == pytest.approx(flow.share, abs=0.2), where
            assert heaviest["mean_speed"] == pytest.approx(flow.mean_speed, abs=0.3), where
            checked += 1
    assert checked >= 8


def test_whole_day_demo_map_shows_both_directions_of_every_corridor(hall):
    tracks, _ = hall
    flows = planted_flows("hall", 13)
    assert len({flow.place for flow in flows}) == 6
    for flow in flows:
        mixture = mixture_at(tracks, flow.x, flow.y)
        assert mixture["count"].iloc[0] > 100
        away = np.abs(np.angle(np.exp(1j * (mixture["mean_heading"] - flow.heading))))
        towards = mixture.iloc[np.argmax(np.where(away < np.pi / 4, mixture["weight"], -1))]
        assert abs(twins.wrap(towards["mean_heading"] - flow.heading)) < 0.1
        assert 0.2 < share_towards(mixture, flow.heading) < 0.8  # morning and evening even out
