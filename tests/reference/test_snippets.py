"""Snippet flow maps: building against a loop, chaining against its plain twin, and what is known of planted walks."""

import functools
import math
from collections import Counter, defaultdict

import crowds
import memory_twins
import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from modlhmp.forecasting.chain import chain
from modlhmp.forecasting.observe import observe
from modlhmp.maps import snippets
from modlhmp.maps.pieces import Metric
from modlhmp.maps.snippets import SnippetMap
from modlhmp.methods import make_forecaster
from modlhmp.options import SnippetBuilding, Snippets
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.streams import stream_keys, uniform, uniforms
from modlhmp.tracks import clock_time, concatenate, empty_tracks, usable_tracks

METRIC = Metric(8.0, 8.0, 2.0, 0.0)
WEIGHTS = [0.48, 0.33, 0.19]
PAST = 3
STEPS = 12
EVERY = 10**6  # as many snippets as there are


def built(tracks, step_s=1.0, seed=0, **building):
    """A map's table from tracks that are observed for as many rows as everywhere here."""
    site = Site(time_step_s=step_s, observed_rows=PAST + 1)
    return snippets.build(tracks, site, SnippetBuilding(**building), seed)


def map_of(tracks, length_s=5.0, most=EVERY):
    """A map of tracks, of which forecasts use snippets of `length_s` out of those of 10 s."""
    return SnippetMap(built(tracks, most=EVERY), METRIC, WEIGHTS, length_s, most)


def keys_of(walkers, k, seed=0):
    return stream_keys(walkers.track_id, k, seed, "hall", "snippets", "day1")


def observed(tracks):
    return observe(tracks, usable_tracks(tracks, PAST + 1), PAST + 1)


def walker(start, velocity, began=0.0, step_s=1.0):
    """One who is seen at four rows at constant velocity, the last of them at `start`."""
    first = np.array(start) - 3 * step_s * np.array(velocity)
    return observed(crowds.straight(900, first, velocity, 5, began, step_s))


def seen(walkers, n):
    return list(zip(walkers.t[n], walkers.x[n], walkers.y[n], strict=True))


def take(walkers, rows):
    return walkers._replace(**{name: part[rows] for name, part in walkers._asdict().items()})


def constant(walkers, n, steps=STEPS, step_s=1.0):
    """Path at constant velocity, the vector mean of the last steps."""
    velocity = memory_twins.mean_velocity(memory_twins.seen_velocities(seen(walkers, n)), WEIGHTS)
    return np.array(seen(walkers, n)[-1][1:]) + step_s * np.arange(1, steps + 1)[:, None] * np.array(velocity)


@functools.cache
def training(step_s=1.0):
    return crowds.crowd(21, people=150, size=7.0, most_rows=16, span=400, gaps=(1, 1, 1, 2), step_s=step_s)


@functools.cache
def walkers(step_s=1.0):
    return observed(crowds.crowd(22, people=20, size=7.0, most_rows=12, gaps=(1,), step_s=step_s))


@functools.cache
def default_map():
    return map_of(training())


# --- building -----------------------------------------------------------------------------------------------


def plain_snippets(tracks, step_s, length_s, cell_m):
    """{(i, j, bin): [(start, minute, steps, path)]}: every row with a past and a future, in its cell and heading."""
    found, length = defaultdict(list), round(length_s / step_s)
    for walk in memory_twins.resample(crowds.people_of(tracks), step_s):
        for n in range(PAST, len(walk) - 1):
            (_, xa, ya), (t, x, y) = walk[n - 1 : n + 1]
            speed, angle = math.hypot(x - xa, y - ya) / step_s, math.atan2(y - ya, x - xa)
            heading = round(angle / (math.pi / 4)) % 8 if speed >= 0.3 else 8
            steps = min(len(walk) - 1 - n, length + 1)
            path = [walk[n + min(m, steps)][1:] for m in range(-PAST, length + 1)]
            relative = [(px - x, py - y) for px, py in path]
            found[math.floor(x / cell_m), math.floor(y / cell_m), heading].append(((x, y), t // 60, steps, relative))
    return found


def by_bin(table):
    found = defaultdict(list)
    for row in table.to_pylist():
        found[row["i"], row["j"], row["bin"]].append(row)
    return found


@pytest.mark.parametrize(("step_s", "length_s", "cell_m"), [(1.0, 10.0, 1.0), (0.5, 4.0, 1.5), (2.0, 6.0, 0.7)])
def test_building_equals_the_loop(step_s, length_s, cell_m):
    tracks = training(step_s)
    expected = plain_snippets(tracks, step_s, length_s, cell_m)
    got = by_bin(built(tracks, step_s, length_s=length_s, cell_m=cell_m, most=EVERY))
    assert {name: len(rows) for name, rows in got.items()} == {name: len(rows) for name, rows in expected.items()}
    for name, rows in got.items():
        for row in rows:
            near = min(expected[name], key=lambda one: math.dist(one[0], (row["x"], row["y"])))
            np.testing.assert_allclose((row["x"], row["y"]), near[0], atol=1e-5)
            assert (row["minute"], row["steps"], row["stands_for"]) == (near[1], near[2], 1)
            np.testing.assert_allclose(np.reshape(row["path"], (-1, 2)), near[3], atol=1e-5)


def test_bins_are_in_order():
    table = built(training(), most=3)
    where = list(zip(*(table[name].to_pylist() for name in ("i", "j", "bin")), strict=True))
    assert where == sorted(where)


@pytest.mark.parametrize("most", [1, 2, 5])
def test_a_bin_keeps_some_that_stand_for_all(most):
    whole, few = by_bin(built(training(), most=EVERY)), by_bin(built(training(), most=most))
    assert set(few) == set(whole)
    assert max(map(len, whole.values())) > 5
    for name, rows in few.items():
        assert len(rows) == min(len(whole[name]), most)
        assert sum(row["stands_for"] for row in rows) == pytest.approx(len(whole[name]))
        starts = [(row["x"], row["y"]) for row in whole[name]]
        assert all((row["x"], row["y"]) in starts for row in rows)


def test_which_are_kept_is_the_seeds_choice():
    """Of a seed always the same, and fewer are some of the more; everyone is as likely to be kept."""
    tables = [built(training(), most=1, seed=seed) for seed in (0, 0, 1)]
    assert tables[0].equals(tables[1])
    assert not tables[0].equals(tables[2])
    for name, rows in by_bin(built(training(), most=3)).items():
        assert by_bin(tables[0])[name][0]["x"] == rows[0]["x"]
    crossing = concatenate(crowds.straight(n, (0.1, 0.1 + 0.1 * n), (1, 0), 5) for n in range(5))  # all in one bin
    kept = Counter(built(crossing, cell_m=9.0, most=1, seed=s)["y"][0].as_py() for s in range(500))
    assert len(kept) == 5
    assert stats.chisquare(list(kept.values())).pvalue > 0.001


def test_a_person_who_leaves_is_held_there():
    """Seven rows, of which the fourth to the sixth begin snippets; the last row does not."""
    table = built(crowds.straight(1, (0.5, 0.5), (1, 0), 7), length_s=2.0)
    rows = sorted(table.to_pylist(), key=lambda row: row["x"])
    assert [row["x"] for row in rows] == [3.5, 4.5, 5.5]
    paths = [row["path"][::2] for row in rows]
    np.testing.assert_allclose(paths, [[-3, -2, -1, 0, 1, 2], [-3, -2, -1, 0, 1, 2], [-3, -2, -1, 0, 1, 1]], atol=1e-5)


@pytest.mark.parametrize("length_s", [10.0, 3.0])
@pytest.mark.parametrize("most", [EVERY, 2])
def test_a_loaded_map_holds_the_tables_snippets(length_s, most):
    table = built(training(), most=4)
    mod, bins = SnippetMap(table, METRIC, WEIGHTS, length_s, most), by_bin(table)
    assert mod.arrays.path.shape[1:] == (PAST + 1 + length_s, 2)
    assert (mod.arrays.index >= 0).sum() == len(bins)
    for (i, j, heading), rows in bins.items():
        b = mod.arrays.index[i - mod.arrays.origin[0], j - mod.arrays.origin[1], heading]
        held = range(mod.arrays.starts[b], mod.arrays.starts[b + 1])
        assert len(held) == min(len(rows), most)
        assert mod.arrays.count[b] == pytest.approx(sum(row["stands_for"] for row in rows))
        for n, row in zip(held, rows, strict=False):
            assert mod.arrays.steps[n] == min(row["steps"], length_s)
            assert mod.arrays.minute[n] == row["minute"]
            path = np.reshape(row["path"], (-1, 2))
            np.testing.assert_allclose(mod.arrays.path[n], path[: mod.arrays.path.shape[1]], atol=1e-6)
            before = memory_twins.velocities(path[: PAST + 1].tolist(), 1.0)
            hour = clock_time(np.array([60.0 * row["minute"]]), "UTC")[0]
            expected, speed = memory_twins.point((row["x"], row["y"]), before, WEIGHTS, METRIC, hour)
            np.testing.assert_allclose(mod.arrays.points[n], expected, atol=1e-5)
            assert mod.arrays.speed[n] == pytest.approx(speed, abs=1e-6)


# --- random numbers -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("draws", [1, 3])
def test_the_numbers_of_a_kernel_are_those_of_arrays(draws):
    """The number-th of a key's numbers, in whatever portions an array takes them."""
    keys = stream_keys(np.array([3, -8, 2**40]), 5, 1, "a", "b", "c").ravel()
    for step in range(7):
        expected = uniforms(keys, step, draws)
        got = [[uniform(key, step * draws + draw) for draw in range(draws)] for key in keys]
        np.testing.assert_array_equal(got, expected)


# --- chaining against its twin ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"pace": 0.0},
        {"pace": 0.5, "bandwidth_m": 0.5},
        {"exits": False},
        {"exclude_s": 60.0},
        {"length_s": 1.0},
        {"length_s": 10.0, "exits": False},
        {"metric": Metric(3.0, 1.0, 4.0, 600.0)},
        {"metric": Metric(0.0, 8.0, 2.0, 0.0)},
        {"weights": [1.0]},
        {"weights": [0.4, 0.3, 0.2, 0.1]},
        {"cell_m": 2.5},
        {"kept": 2},
        {"step_s": 0.5},
        {"step_s": 2.0, "length_s": 6.0},
    ],
    ids=str,
)
def test_chaining_equals_the_plain_one_particle_by_particle(options):
    defaults = {"length_s": 5.0, "step_s": 1.0, "metric": METRIC, "weights": WEIGHTS, "kept": EVERY, "bandwidth_m": 1.5}
    options = {**defaults, **options}
    length_s, step_s, metric, weights, kept = (
        options.pop(name) for name in ("length_s", "step_s", "metric", "weights", "kept")
    )
    cell_m = options.pop("cell_m", 1.0)
    table = built(training(step_s), step_s, length_s=10.0, cell_m=cell_m, most=kept)
    mod = SnippetMap(table, metric, weights, length_s, EVERY)
    asking, k, length = walkers(step_s), 4, round(length_s / step_s)
    keys = keys_of(asking, k)
    got = chain(mod, asking, STEPS, keys, **options)
    assert got.output == "median"
    assert got.xy.shape == (len(asking.t), 1 + k, STEPS, 2)

    def hours(t):
        return t % 86400 / 3600

    plain = memory_twins.PlainSnippets(table, weights, metric, hours, length)
    lives = []
    for n in range(len(asking.t)):
        rows = seen(asking, n)
        plainly = [plain.particle(rows, key, STEPS, lambda row: leaves(row, length), **options) for key in keys[n]]
        paths = [memory_twins.held(path, rows[-1][1:]) for path in plainly]
        lives.append([alive for _, alive in paths])
        assert got.steps_alive[n].tolist() == [max(lives[-1]), *lives[-1]]
        if max(lives[-1]):  # else constant velocity, see below
            for j, (places, _) in enumerate(paths):
                np.testing.assert_allclose(got.xy[n, 1 + j], places, atol=1e-3)
            for step in range(max(lives[-1])):
                there = [places[step] for places, alive in paths if alive > step]
                np.testing.assert_allclose(got.xy[n, 0, step], memory_twins.median(there), atol=2e-3)
    assert np.ptp(lives) > 0 or not options.get("exits", True)
    assert np.count_nonzero(np.max(lives, axis=1)) >= 5


def leaves(row, length):
    """Whether a stored snippet's person has the last row within `length` steps: `steps` counts to one more."""
    return row["stored"] <= length


def one_bin(starts, stands_for=1.0, toward=1.0, at=(0, 0, 0), **columns):
    """Rows of a snippet table: eastward past of 1 m/s, then one step of their own, north by n times `toward`."""
    return [
        {
            **dict(zip(("i", "j", "bin"), at, strict=True)),
            **{"x": x, "y": y, "minute": 0, "stands_for": stands_for, "steps": 1},
            **{"path": [-3.0, 0.0, -2.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, toward * (n + 1)]},
            **columns,
        }
        for n, (x, y) in enumerate(starts)
    ]


def table_of(rows):
    """A snippet table of such rows, which lead one step on."""
    columns = {name: [row[name] for row in rows] for name in snippets.COLUMNS}
    columns["path"] = pa.FixedSizeListArray.from_arrays(pa.array(np.ravel(columns["path"])), 10)
    return pa.table(columns).replace_schema_metadata({"cell": "1.0", "past": "3", "step": "1.0"})


@pytest.mark.parametrize("bandwidth_m", [0.15, 0.3, 1.0])
def test_snippets_are_drawn_by_their_kernel_and_by_what_they_stand_for(bandwidth_m):
    """Probability of a snippet ~ exp(-d^2 / (2 bandwidth_m^2)) times the number of pieces it stands for."""
    starts = [(0.5, 0.5), (0.6, 0.5), (0.5, 0.8), (0.9, 0.9)]
    more = [(0.5, 1.2), (0.3, 1.1)]
    rows = one_bin(starts) + one_bin(more, 3.0, toward=-1.0, at=(0, 1, 0))
    mod, k = SnippetMap(table_of(rows), METRIC, WEIGHTS, 1.0, EVERY), 4000
    one = walker((0.5, 0.6), (1, 0))
    got = chain(mod, one, 1, keys_of(one, k), bandwidth_m)
    drawn = np.rint(got.xy[0, 1:, 0, 1] - 0.6).astype(int)
    weights = {
        **{n + 1: math.exp(-(math.dist((0.5, 0.6), at) ** 2) / (2 * bandwidth_m**2)) for n, at in enumerate(starts)},
        **{-n - 1: 3 * math.exp(-(math.dist((0.5, 0.6), at) ** 2) / (2 * bandwidth_m**2)) for n, at in enumerate(more)},
    }
    expected = np.array(list(weights.values())) / sum(weights.values()) * k
    found = np.array([np.count_nonzero(drawn == name) for name in weights])
    assert found.sum() == k
    often = expected >= 5
    assert often.sum() >= 3
    assert stats.chisquare(np.append(found[often], found[~often].sum() + 1e-9),
                           np.append(expected[often], expected[~often].sum() + 1e-9)).pvalue > 0.001  # fmt: skip


def test_where_none_is_alike_the_most_alike_is_drawn():
    rows = one_bin([(0.5, 0.5), (0.5, 0.9), (0.5, 0.2)])
    one = walker((0.5, 1.4), (1, 0))
    got = chain(SnippetMap(table_of(rows), METRIC, WEIGHTS, 1.0, EVERY), one, 1, keys_of(one, 50), 0.01)
    np.testing.assert_allclose(got.xy[0, 1:, 0], [(0.5, 3.4)] * 50, atol=1e-4)


@pytest.mark.parametrize(("cells", "alive"), [(1, True), (2, True), (3, True), (4, False)])
def test_snippets_are_looked_for_up_to_three_cells_away(cells, alive):
    one = walker((0.5 + cells, 0.5), (1, 0))
    got = chain(SnippetMap(table_of(one_bin([(0.5, 0.5)])), METRIC, WEIGHTS, 1.0, EVERY), one, 1, keys_of(one, 3), 1.5)
    assert (got.steps_alive[0] > 0).tolist() == [alive] * 4


@pytest.mark.parametrize("heading_m", [8.0, 0.5, 0.0])
@pytest.mark.parametrize("degrees", [0, 60, 90, 180, -90])
def test_only_snippets_of_about_the_same_heading_are_looked_at(degrees, heading_m):
    """However little headings count in the metric: of all eight bins those within 67.5 degrees."""
    rows = [row for h in range(8) for row in one_bin([(0.5, 0.5)], at=(0, 0, h), path=[0.0] * 8 + [float(h + 1), 0.0])]
    a = math.radians(degrees)
    one = walker((0.5, 0.5), (math.cos(a), math.sin(a)))
    mod = SnippetMap(table_of(rows), Metric(heading_m, 0.0, 0.0), WEIGHTS, 1.0, EVERY)
    got = chain(mod, one, 1, keys_of(one, 200), 100.0)
    drawn = set(np.rint(got.xy[0, 1:, 0, 0] - 0.5).astype(int) - 1)
    assert drawn == {h for h in range(8) if abs((45 * h - degrees + 180) % 360 - 180) <= 67.5}


# --- planted walks ------------------------------------------------------------------------------------------


def fork(track_id, side, began=0.0):
    """East along the x axis for 10 m, then 15 m to the left (side 1) or right (-1)."""
    s = np.arange(26.0)
    return crowds.walk(track_id, began + s, np.column_stack([np.minimum(s, 10), side * np.maximum(s - 10, 0)]))


@pytest.mark.parametrize("length_s", [1.0, 2.0, 5.0, 10.0])
def test_particles_part_as_people_did(length_s):
    """Of 100 people 70 turn left."""
    mod = map_of(concatenate(fork(n, 1 if n < 70 else -1) for n in range(100)), length_s)
    one, k = walker((5, 0), (1, 0)), 1000
    got = chain(mod, one, STEPS, keys_of(one, k), 1.5)
    assert (got.steps_alive == STEPS).all()
    left = np.count_nonzero(got.xy[0, 1:, -1, 1] > 2)
    assert left + np.count_nonzero(got.xy[0, 1:, -1, 1] < -2) == k
    assert abs(left - 0.7 * k) < 4 * math.sqrt(0.21 * k)
    assert got.xy[0, 0, -1, 1] > 3, "the median goes with the many"


def test_a_compact_map_still_leads_around_the_corner():
    mod = map_of(concatenate(fork(n, 1, began=n) for n in range(30)), most=1)
    one = walker((5, 0), (1, 0))
    got = chain(mod, one, STEPS, keys_of(one, 50), 1.5)
    np.testing.assert_allclose(got.xy[0, 0], [(5 + min(s, 5), max(s - 5, 0)) for s in range(1, 13)], atol=0.7)


@pytest.mark.parametrize(("pace", "factor"), [(1.0, 1.5), (0.0, 1.0)])
@pytest.mark.parametrize("length_s", [1.0, 4.0])
def test_particles_walk_at_the_walkers_own_pace(pace, factor, length_s):
    """Also after the first snippet, when it is the particle's."""
    mod = map_of(concatenate(crowds.straight(n, (0, 0.1 * n), (1, 0), 60) for n in range(9)), length_s)
    one = walker((5, 0.4), (1.5, 0))
    got = chain(mod, one, STEPS, keys_of(one, 50), 5.0, pace)
    expected = np.broadcast_to(5 + factor * np.arange(1, STEPS + 1), (51, STEPS))
    np.testing.assert_allclose(got.xy[0, :, :, 0], expected, atol=1e-3)


@functools.cache
def corridor(chance):
    """People who walk east at 1 m/s, of whom this share leaves after each second; from every metre 60 begin."""
    waits = np.ceil(np.log1p(-(np.arange(60) + 0.5) / 60) / np.log1p(-chance)).astype(int)  # geometric, by quota
    starts = [(start, wait) for start in range(-35, 15) for wait in waits]
    return concatenate(crowds.straight(n, (x, 0.5), (1, 0), 4 + wait) for n, (x, wait) in enumerate(starts))


@pytest.mark.parametrize("length_s", [1.0, 2.0, 5.0])
def test_particles_leave_as_people_did(length_s):
    """Of 10 people one leaves after each second, whatever length the snippets have."""
    mod, one, k = map_of(corridor(0.1), length_s), walker((0, 0.5), (1, 0)), 2000
    got = chain(mod, one, STEPS, keys_of(one, k), 1.5)
    share = (got.steps_alive[0, 1:, None] >= np.arange(1, STEPS + 1)).mean(axis=0)
    np.testing.assert_allclose(share, 0.9 ** np.arange(STEPS), atol=0.03)


def test_without_exits_particles_stay():
    """At the corridor's people, one after the other, for as long as there are any."""
    one = walker((0, 0.5), (1, 0))
    got = chain(map_of(corridor(0.1)), one, STEPS, keys_of(one, 100), 1.5, exits=False)
    assert (got.steps_alive == STEPS).all()
    np.testing.assert_allclose(got.xy[0, 1:, :, 0], np.broadcast_to(np.arange(1, STEPS + 1), (100, STEPS)), atol=1e-3)


def test_a_particle_that_left_is_held_and_the_median_with_the_last():
    """Everyone's last row is at x = 8."""
    mod = map_of(concatenate(crowds.straight(n, (0, 0), (1, 0), 9) for n in range(20)))
    one = walker((4, 0), (1, 0))
    got = chain(mod, one, STEPS, keys_of(one, 30), 0.5)
    assert (got.steps_alive > 1).all()
    assert got.steps_alive[0, 0] == got.steps_alive[0].max()
    for path, alive in zip(got.xy[0], got.steps_alive[0], strict=True):
        np.testing.assert_array_equal(path[alive:], np.broadcast_to(path[alive - 1], path[alive:].shape))


def test_contemporaries_can_be_left_out():
    """Those of the last minutes turn left, those of two hours ago right."""
    people = [fork(n, 1, 7200.0 + n) for n in range(9)] + [fork(20 + n, -1, n) for n in range(3)]
    mod, one = map_of(concatenate(people), length_s=10.0), walker((5, 0), (1, 0), began=7205.0)
    assert chain(mod, one, STEPS, keys_of(one, 100), 1.0).xy[0, 0, -1, 1] > 5
    assert chain(mod, one, STEPS, keys_of(one, 100), 1.0, exclude_s=600.0).xy[0, :, -1, 1].max() < -5
    assert not chain(mod, one, STEPS, keys_of(one, 9), 1.0, exclude_s=86400.0).steps_alive.any()


def test_whoever_is_left_out_as_a_contemporary_is_known_to_the_minute():
    """All within 600 s of t0, before and after, and nobody more than a minute beyond."""
    one = walker((0.5, 0.5), (1, 0))
    t0 = one.t[0, -1]
    for seconds in (-670, -660.5, *np.arange(-600, 600.5, 12.5), 660.5, 670):
        table = table_of(one_bin([(0.5, 0.5)], minute=int((t0 + seconds) // 60)))
        mod = SnippetMap(table, METRIC, WEIGHTS, 1.0, EVERY)
        got = chain(mod, one, 1, keys_of(one, 1), 1.5, exclude_s=600.0)
        assert got.steps_alive.any() == (abs(seconds) > 600), seconds


# --- nobody to follow ---------------------------------------------------------------------------------------


def assert_constant_velocity(got, asking):
    assert not got.steps_alive.any()
    for n in range(len(asking.t)):
        expected = constant(asking, n, got.xy.shape[2])
        np.testing.assert_allclose(got.xy[n], np.broadcast_to(expected, got.xy[n].shape), atol=1e-4)


@pytest.mark.parametrize("place", [(500.0, 500.0), (-80.0, 3.0)])
def test_off_the_map_a_walker_goes_straight_on(place):
    one = walker(place, (0.7, -0.2))
    assert_constant_velocity(chain(default_map(), one, STEPS, keys_of(one, 5), 1.5), one)


@pytest.mark.parametrize("tracks", [empty_tracks(), crowds.straight(1, (0, 0), (1, 0), 4)], ids=["nobody", "too short"])
def test_an_empty_map_leaves_constant_velocity(tracks):
    got = chain(map_of(tracks), walkers(), STEPS, keys_of(walkers(), 5), 1.5)
    assert got.xy.shape == (len(walkers().t), 6, STEPS, 2)
    assert_constant_velocity(got, walkers())


@pytest.mark.parametrize("tracks", [crowds.straight(1, (0, 0), (1, 0), 60), fork(1, 1)], ids=["long", "turning"])
def test_one_person_can_be_followed(tracks):
    """No track ends within a snippet's length, or one does."""
    one = walker((4, 0), (1, 0))
    got = chain(map_of(tracks, length_s=2.0), one, STEPS, keys_of(one, 20), 1.5)
    assert (got.steps_alive == STEPS).all()
    assert np.isfinite(got.xy).all()


@pytest.mark.parametrize("place", [(3.0, 3.0), (50.0, 50.0)])
def test_somebody_who_stands_still_has_a_finite_forecast(place):
    one = walker(place, (0, 0))
    assert np.isfinite(chain(default_map(), one, STEPS, keys_of(one, 5), 1.5).xy).all()


def test_people_who_stand_still_can_be_followed():
    """Their bin has no heading, so whoever strolls finds it, in any direction; one who walks past does not."""
    mod = map_of(crowds.walk(1, np.arange(60.0), np.full((60, 2), 2.5)))
    one = walker((2.5, 2.5), (0, 0.8))
    got = chain(mod, one, STEPS, keys_of(one, 5), 1.5)
    np.testing.assert_allclose(got.xy[0], np.full((6, STEPS, 2), 2.5), atol=1e-4)
    assert not chain(mod, walker((2.5, 2.5), (0, 1)), STEPS, keys_of(one, 5), 1.5).steps_alive.any()


@pytest.mark.parametrize("length_s", [0.1, 0.5])
def test_a_snippet_has_at_least_one_step(length_s):
    """Shorter ones would lead nowhere."""
    assert map_of(training(), length_s).arrays.path.shape[1] == PAST + 2
    assert built(training(), length_s=length_s)["path"].type.list_size == 2 * (PAST + 2)


def test_no_walkers_no_forecast():
    got = chain(default_map(), take(walkers(), slice(0, 0)), STEPS, np.empty((0, 5), np.uint64), 1.5)
    assert got.xy.shape == (0, 6, STEPS, 2)


# --- independence -------------------------------------------------------------------------------------------


def forecast(rows=slice(None), k=6, steps=STEPS, mod=None, seed=0):
    asking = take(walkers(), rows)
    return chain(mod or default_map(), asking, steps, keys_of(asking, k, seed), 1.5)


def assert_same(one, other, rows=slice(None)):
    for a, b in zip(one[:3], other[:3], strict=True):
        np.testing.assert_array_equal(a, b[rows])


@pytest.mark.parametrize("rows", [[0], [7, 3], [*range(9, -1, -1)]], ids=str)
def test_order_and_company_of_the_walkers_do_not_matter(rows):
    assert_same(forecast(rows), forecast(), rows)


def test_a_shorter_horizon_is_a_prefix():
    long, short = forecast(), forecast(steps=4)
    np.testing.assert_array_equal(short.xy, long.xy[:, :, :4])
    np.testing.assert_array_equal(short.steps_alive, np.minimum(long.steps_alive, 4))


def test_the_first_six_of_twenty_particles_are_the_six():
    six, twenty = forecast(), forecast(k=20)
    followed = (six.steps_alive[:, 0] > 0) & (twenty.steps_alive[:, 0] > 0)
    assert followed.sum() >= 5
    np.testing.assert_array_equal(twenty.xy[followed, 1:7], six.xy[followed, 1:])
    np.testing.assert_array_equal(twenty.steps_alive[:, 1:7], six.steps_alive[:, 1:])


def test_another_seed_draws_other_snippets():
    one, other = forecast(), forecast(seed=1)
    followed = one.steps_alive[:, 0] > 0
    assert (one.xy[followed] != other.xy[followed]).any(axis=(1, 2, 3)).mean() > 0.8


def test_moving_map_and_walkers_by_whole_cells_moves_the_forecast():
    shift = np.array([40.0, -64.0])
    tracks = training()._replace(x=training().x + shift[0], y=training().y + shift[1])
    asking = walkers()._replace(x=walkers().x + shift[0], y=walkers().y + shift[1])
    one, other = forecast(), chain(map_of(tracks), asking, STEPS, keys_of(asking, 6), 1.5)
    np.testing.assert_array_equal(other.steps_alive, one.steps_alive)
    np.testing.assert_allclose(other.xy, one.xy + shift, atol=1e-3)


def test_the_forecaster_of_a_file_takes_the_methods_options(tmp_path):
    write_parquet(built(training(), most=9), tmp_path / "snippets.parquet")
    site = Site(difference_weights=tuple(WEIGHTS), observed_rows=4, time_step_s=1.0, timezone="UTC")
    options = Snippets(k=6, length_s=3.0, most=4, bandwidth_m=0.9, pace=0.5, exits=False, exclude_s=60.0,
                       **METRIC._asdict())  # fmt: skip
    forecaster = make_forecaster("snippets", options, site, tmp_path / "snippets.parquet")
    keys = keys_of(walkers(), 6)
    mod = SnippetMap(built(training(), most=9), METRIC, WEIGHTS, 3.0, 4)
    assert_same(forecaster(walkers(), STEPS, keys), chain(mod, walkers(), STEPS, keys, 0.9, 0.5, False, 60.0))
