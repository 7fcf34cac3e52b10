"""A medoid and modes out of samples: against plain loops, planted groups, what must not matter; stored and scored."""

import math

import numpy as np
import pytest
import twins
from hypothesis import given, settings
from hypothesis import strategies as st

from modlhmp.forecasting.average import average_forecasts
from modlhmp.forecasting.base import MODES, Forecast
from modlhmp.forecasting.files import read_forecasts, write_forecasts
from modlhmp.forecasting.median import with_median
from modlhmp.forecasting.medoid import with_medoid
from modlhmp.forecasting.modes import ALIKE_M, modes_of, with_modes
from modlhmp.forecasting.outputs import kept, with_output
from modlhmp.forecasting.ranking import best_path, longest_lived, most_likely
from modlhmp.scoring.protocols import PROTOCOLS, score

FEW = settings(max_examples=30)
SEEDS = st.integers(0, 10**6)
STEPS = 8


def samples(seed, n=5, k=9, lives=(0, 2, 5, STEPS), steps=STEPS):
    """Random futures that are held from the end of their lives on; the last walker's never lived."""
    rng = np.random.default_rng(seed)
    start = rng.normal(0, 5, (n, 2))
    xy = (start[:, None, None] + np.cumsum(rng.normal(0.5, 1, (n, k, steps, 2)), axis=2)).astype(np.float32)
    alive = rng.choice(lives, (n, k)).astype(np.int32)
    alive[-1] = 0
    for i, j in np.ndindex(n, k):
        xy[i, j, alive[i, j] :] = xy[i, j, alive[i, j] - 1] if alive[i, j] else start[i]
    return Forecast(xy, np.zeros((n, k, steps), np.float32), alive, "ranked")


def walks(*headings_deg, alive=None, steps=STEPS):
    """One walker's futures, straight from the origin at 1 m/s, each into a direction, held once not alive."""
    alive = np.array([steps] * len(headings_deg) if alive is None else alive, np.int32)
    walked = np.minimum(np.arange(1, steps + 1), alive[:, None])
    angle = np.radians(headings_deg)[:, None]
    xy = np.stack([walked * np.cos(angle), walked * np.sin(angle)], axis=-1).astype(np.float32)
    return Forecast(xy[None], np.zeros((1, *walked.shape), np.float32), alive[None], "ranked")


def chosen(forecast):
    """Which future is the result [n, T]."""
    return most_likely(forecast.log_fitness, longest_lived(forecast.steps_alive, forecast.xy.shape[2]))


# --- the medoid ----------------------------------------------------------------------------------------------------


def distances_to_others(paths, alive, horizon, nearest):
    """{longest-lived sample: mean distance of its path from those of the others}, as it is written."""
    lived = [min(life, horizon) for life in alive]
    able = [j for j, life in enumerate(lived) if life == max(lived)]
    return {
        a: sum(math.dist(paths[a, s], paths[b, s]) for b in able[:nearest] for s in range(horizon)) / horizon
        for a in able
    }


@FEW
@given(SEEDS, st.sampled_from([None, 1, 3, 20]))
def test_the_medoid_equals_the_loop(seed, nearest):
    """At every horizon of the longest-lived up to it; where nobody lives as long, of those that lived longest."""
    futures = samples(seed)
    got = with_medoid(futures, nearest)
    best = chosen(got)
    assert got.output == "medoid"
    for i, step in np.ndindex(5, STEPS):
        mean = distances_to_others(futures.xy[i].astype(float), futures.steps_alive[i], step + 1, nearest)
        assert best[i, step] in mean
        assert mean[best[i, step]] == pytest.approx(min(mean.values()), rel=1e-5, abs=1e-6)


def test_the_samples_of_a_medoid_are_unchanged():
    futures = samples(1)
    got = with_medoid(futures)
    np.testing.assert_array_equal(got.xy, futures.xy)
    np.testing.assert_array_equal(got.steps_alive, futures.steps_alive)
    assert got.log_fitness.dtype == np.float32


def test_where_people_part_the_median_lies_between_and_the_medoid_does_not():
    """Two ways around a wall: half go left, half right. A median between them would go through it."""
    futures = walks(-42, -41, -40, 40, 41, 42)
    assert abs(with_median(futures).xy[0, 0, -1, 1]) < 1.0
    assert abs(best_path(with_medoid(futures))[0][0, -1, 1]) > 4.0


def test_the_dead_do_not_choose():
    """Five stop early to the left; of those who walk on to the right the middle one is the medoid at the end."""
    futures = walks(90, 91, 92, 93, 94, -10, 0, 30, alive=[2] * 5 + [STEPS] * 3)
    best = chosen(with_medoid(futures))[0]
    assert (best[:2] < 5).all()
    assert (best[2:] == 6).all()


@FEW
@given(SEEDS, st.floats(-3.1, 3.1))
def test_order_place_and_axes_do_not_change_the_medoid(seed, angle):
    rng = np.random.default_rng(seed)
    futures = samples(seed, n=3, lives=(5, STEPS))
    order = rng.permutation(9)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    other = Forecast((futures.xy[:, order] @ turn + 20).astype(np.float32), futures.log_fitness,
                     futures.steps_alive[:, order], "ranked")  # fmt: skip
    got, expected = (-with_medoid(one).log_fitness for one in (other, futures))
    np.testing.assert_allclose(got, expected[:, order], rtol=1e-4, atol=1e-4)


def test_a_shorter_horizon_has_the_same_medoid():
    futures = samples(2)
    short = Forecast(futures.xy[:, :, :3], futures.log_fitness[:, :, :3], np.minimum(futures.steps_alive, 3), "ranked")
    np.testing.assert_array_equal(with_medoid(short).log_fitness, with_medoid(futures).log_fitness[:, :, :3])


# --- modes -----------------------------------------------------------------------------------------------------------


def test_planted_groups_are_found_with_their_shares():
    """Four go straight on, three left, two right, one back: these, the likeliest first, each by one of its own."""
    futures = walks(91, 0, 1, -90, 2, 90, 180, 89, -91, -1)
    modes = modes_of(futures)
    np.testing.assert_allclose(modes.probabilities[0], [0.4, 0.3, 0.2, 0.1, 0.0])
    heading = np.degrees(np.arctan2(modes.paths[0, :4, -1, 1], modes.paths[0, :4, -1, 0]))
    assert abs(heading[0]) <= 1.1
    assert heading[1] == pytest.approx(90, abs=1.1)
    assert heading[2] == pytest.approx(-90, abs=1.1)
    assert abs(heading[3]) == pytest.approx(180, abs=0.1)
    assert modes.steps_alive[0].tolist() == [STEPS] * 4 + [0]
    np.testing.assert_array_equal(modes.paths[0, 4], modes.paths[0, 0])  # none: the likeliest again


def test_a_group_is_represented_by_its_middle_one():
    modes = modes_of(walks(0, 4, 10, 180))
    assert modes.probabilities[0].tolist()[:2] == [0.75, 0.25]
    np.testing.assert_allclose(modes.paths[0, 0], walks(4).xy[0, 0], atol=1e-6)


def test_who_left_early_counts_for_the_way_taken_but_does_not_stand_for_it():
    """Two of three on the way to the left leave after 4 s; the third is its path. All on the right leave."""
    modes = modes_of(walks(90, 91, 92, -90, -91, alive=[4, 4, STEPS, 3, 5]))
    np.testing.assert_allclose(modes.probabilities[0], [0.6, 0.4, 0, 0, 0])
    assert modes.steps_alive[0].tolist() == [STEPS, 5, 0, 0, 0]
    np.testing.assert_allclose(modes.paths[0, 1], walks(-91, alive=[5]).xy[0, 0], atol=1e-6)


def test_samples_that_are_alike_are_one_future():
    futures = walks(*np.linspace(-3, 3, 30))
    assert modes_of(futures).probabilities[0].tolist() == [1, 0, 0, 0, 0]
    alone = modes_of(walks(20))
    assert alone.probabilities[0].tolist() == [1, 0, 0, 0, 0]
    np.testing.assert_array_equal(alone.paths[0, 0], walks(20).xy[0, 0])


def groups(paths, alive):
    """[(share, index of the sample that stands for it)] as it is written: join the two groups that, joined, are least
    wide, while there are too many or these are alike.
    """
    k = len(paths)
    apart = np.zeros((k, k))
    for a, b in np.ndindex(k, k):
        common = max(min(alive[a], alive[b]), 1)
        apart[a, b] = sum(math.dist(paths[a, s], paths[b, s]) for s in range(common)) / common
    found = [[j] for j in range(k)]
    while len(found) > 1:
        width, one, two = min(
            (apart[np.ix_(a, b)].max(), m, n) for m, a in enumerate(found) for n, b in enumerate(found) if m < n
        )
        if len(found) <= MODES and width > ALIKE_M:
            break
        found[one] = sorted(found[one] + found.pop(two))
    found.sort(key=lambda group: (-len(group), group[0]))
    standing = []
    for group in found:
        able = [j for j in group if alive[j] == max(alive[g] for g in group)]
        standing.append(min(able, key=lambda j: sum(apart[j, g] for g in group)))
    return [(len(group) / k, j) for group, j in zip(found, standing, strict=True)]


@FEW
@given(SEEDS)
def test_modes_equal_the_loop(seed):
    futures = samples(seed, n=2, k=14, lives=(3, 5, STEPS))
    modes = modes_of(futures)
    expected = groups(futures.xy[0].astype(float), futures.steps_alive[0])
    share, index = zip(*expected, strict=True)
    np.testing.assert_allclose(modes.probabilities[0], [*share, *[0] * (MODES - len(share))])
    for place, j in enumerate(index):
        # Of two equally near to their group rounding decides, so their number of steps alive is compared.
        assert modes.steps_alive[0, place] == futures.steps_alive[0, j]
        if share[place] > 2 / 14:
            np.testing.assert_array_equal(modes.paths[0, place], futures.xy[0, j])
    assert modes.probabilities[1].tolist() == [1, 0, 0, 0, 0]  # who never lived has one place


@FEW
@given(SEEDS)
def test_the_order_of_the_samples_does_not_change_the_shares(seed):
    futures, order = samples(seed, k=20, lives=(5, STEPS)), np.random.default_rng(seed).permutation(20)
    other = Forecast(futures.xy[:, order], futures.log_fitness, futures.steps_alive[:, order], "ranked")
    one, two = modes_of(futures), modes_of(other)
    np.testing.assert_allclose(one.probabilities, two.probabilities)
    sure = one.probabilities[:, 0] > np.maximum(one.probabilities[:, 1], 2 / 20)
    np.testing.assert_array_equal(one.paths[sure, 0], two.paths[sure, 0])


def test_modes_stand_before_their_samples():
    futures = samples(4)
    got, modes = with_modes(futures), modes_of(futures)
    assert got.output == "modes"
    np.testing.assert_array_equal(got.results.xy, modes.paths)
    np.testing.assert_allclose(np.exp(got.results.log_fitness[:, :, 3]), modes.probabilities, rtol=1e-6)
    np.testing.assert_array_equal(got.samples.xy, futures.xy)
    np.testing.assert_array_equal(got.samples.steps_alive, futures.steps_alive)
    assert (chosen(got) < MODES).all()  # at no horizon a sample


# --- one place for all outputs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("output", ["geometric_median", "medoid", "modes"])
def test_an_output_is_of_the_samples_whatever_stood_before_them(output):
    futures = samples(5)
    for before in (futures, with_median(futures)):
        got = with_output(before, output)
        expected = {"geometric_median": with_median, "medoid": with_medoid, "modes": with_modes}[output](futures)
        for one, other in zip(got[:3], expected[:3], strict=True):
            np.testing.assert_array_equal(one, other)
        assert got.output == expected.output
    assert with_output(futures, "ranked") is futures


@pytest.mark.parametrize(("make", "before"), [(with_median, 1), (with_modes, MODES)])
def test_the_first_samples_are_kept_beside_a_result(make, before):
    forecast = make(samples(6))
    got = kept(forecast, 4)
    assert got.xy.shape[1] == before + 4
    np.testing.assert_array_equal(got.xy, forecast.xy[:, : before + 4])


def test_the_medoids_are_kept_of_a_medoid_s_samples():
    """As long as they are no more than are kept, the choice is the same at every horizon."""
    forecast = with_medoid(samples(7, n=30, k=40, steps=6, lives=(3, 6)))
    got = kept(forecast, 6)
    assert got.xy.shape[1] == 6
    rows, steps = np.arange(30)[:, None], np.arange(6)
    np.testing.assert_array_equal(got.xy[rows, chosen(got), steps], forecast.xy[rows, chosen(forecast), steps])
    few = kept(forecast, 2)
    np.testing.assert_array_equal(best_path(few)[0], best_path(forecast)[0])
    best = np.take_along_axis(few.steps_alive, chosen(few), axis=1)
    lived = np.minimum(forecast.steps_alive.max(axis=1)[:, None], steps + 1)
    assert (np.minimum(best, steps + 1) == lived).all()
    assert kept(few, 20) is few


@pytest.mark.parametrize("make", [with_medoid, with_modes])
def test_it_is_stored_and_read_again(tmp_path, make):
    forecast, ids = make(samples(8)), np.arange(5) + 50
    write_forecasts(tmp_path / "f.parquet", [(4, ids, forecast)])
    [(_, _, got)] = read_forecasts(tmp_path / "f.parquet")
    assert got.output == forecast.output
    for one, other in zip(got[:3], forecast[:3], strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("make", [with_medoid, with_modes])
def test_its_path_is_averaged_with_others(make):
    """That of the longest horizon, and not the first of its futures."""
    forecast, ids = make(walks(170, 10, 12, 11, 172, 13)), np.array([7])
    [(_, _, got)] = average_forecasts([[(0, ids, forecast)]] * 2)
    np.testing.assert_array_equal(got.xy[:, 0], best_path(forecast)[0])
    assert got.xy[0, 0, -1, 0] > 7


# --- scores ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("make", [with_medoid, with_modes])
def test_one_of_its_paths_is_scored_at_every_horizon(seed, make):
    """As ranked futures are, those that are no results left out; walls are of the same path."""
    rng, n = np.random.default_rng(seed), 12
    forecast = make(samples(seed, n=n))
    truth, length = rng.normal(0, 5, (n, STEPS, 2)), rng.integers(0, STEPS + 3, n)
    truth[np.arange(1, STEPS + 1) > length[:, None]] = np.nan
    walls = rng.random(forecast.steps_alive.shape)[:, :, None] * np.ones(STEPS)
    got = score(forecast, truth, {"paper": length, "complete": length}, walls)
    assert set(got) == {(forecast.output, protocol) for protocol in PROTOCOLS}
    number = {"medoid": 9, "modes": MODES}[forecast.output]
    for (_, protocol), values in got.items():
        for i, step in np.ndindex(n, STEPS):
            futures = forecast.xy[i, :number], forecast.log_fitness[i, :number], forecast.steps_alive[i, :number]
            expected = twins.score(protocol, "ranked", *futures, truth[i], length[i], step + 1)
            one = values["ade"][i, step], values["fde"][i, step]
            np.testing.assert_allclose(one, expected or (np.nan, np.nan), rtol=1e-5)
            if expected:
                assert values["infeasible"][i, step] == np.float32(walls[i, chosen(forecast)[i, step], step])
