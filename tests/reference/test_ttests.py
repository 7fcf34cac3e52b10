"""Paired tests over clusters against formulas, SciPy and sign flips; the table of t-tests against a loop."""

import itertools
import math

import numpy as np
import pytest
import twins
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.ttests import detectable, groups_test, holm, mean_test, paired_test
from modlhmp.study.comparisons import LEAST_DAYS, clusters, compare
from modlhmp.study.summary import Errors

FEW = settings(max_examples=20, deadline=None, derandomize=True)
SEEDS = st.integers(0, 10**6)
NAN = math.nan


def t_test_by_loop(differences, cluster):
    """(mean, low, high, t, p): the jackknife that leaves out one cluster after the other, t of G - 1."""
    known = [(d, c) for d, c in zip(differences, cluster, strict=True) if not math.isnan(d)]
    mean = twins.mean([d for d, _ in known])
    names = sorted({c for _, c in known})
    without = [twins.mean([d for d, c in known if c != name]) for name in names]
    number = len(names)
    error = math.sqrt((number - 1) / number * math.fsum((m - twins.mean(without)) ** 2 for m in without))
    half = stats.t(number - 1).ppf(0.975) * error
    return mean, mean - half, mean + half, mean / error, stats.t(number - 1).cdf(mean / error)


@FEW
@given(SEEDS, st.integers(2, 40), st.sampled_from([-0.5, 0.0, 0.5]))
def test_with_a_cluster_per_track_it_is_scipy_s_paired_test(seed, n, shift):
    rng = np.random.default_rng(seed)
    ours, theirs = rng.gamma(2, 1, n) + shift, rng.gamma(2, 1, n)
    got = paired_test(ours, theirs)
    expected = stats.ttest_rel(ours, theirs, alternative="less")
    assert (got.n, got.clusters) == (n, n)
    assert (got.t, got.p) == pytest.approx((expected.statistic, expected.pvalue), rel=1e-7)
    assert got.p_greater == pytest.approx(stats.ttest_rel(ours, theirs, alternative="greater").pvalue, rel=1e-7)
    interval = stats.ttest_rel(ours, theirs).confidence_interval(0.95)
    assert (got.low, got.high) == pytest.approx((interval.low, interval.high), rel=1e-7)
    d = ours - theirs
    assert (got.mean, got.effect) == pytest.approx((d.mean(), d.mean() / d.std(ddof=1)), rel=1e-7)


@FEW
@given(SEEDS, st.integers(3, 12))
def test_clusters_equal_the_loop(seed, days):
    rng = np.random.default_rng(seed)
    day = rng.integers(0, days, 80)
    difference = rng.normal(0, 1, 80) + rng.normal(0, 1, days)[day]
    difference[rng.random(80) < 0.2] = NAN
    got = paired_test(difference + 5.0, np.full(80, 5.0), day)
    expected = t_test_by_loop(difference.tolist(), day.tolist())
    np.testing.assert_allclose((got.mean, got.low, got.high, got.t, got.p), expected, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("shift", [0.0, -0.35, -0.7])
def test_p_is_that_of_flipped_signs_of_whole_days(shift):
    """Of 12 days with a share in common, all 4,096 sign flips: the share that is at most as large as what was seen."""
    rng = np.random.default_rng(5)
    day = np.repeat(np.arange(12), rng.integers(20, 40, 12))
    difference = rng.normal(0, 1, len(day)) + rng.normal(0, 0.8, 12)[day] + shift
    sums = np.bincount(day, difference)
    flips = np.array(list(itertools.product([-1, 1], repeat=12)))
    by_flips = (flips @ sums <= sums.sum() + 1e-9).mean()
    got = mean_test(difference, day)
    assert got.p == pytest.approx(by_flips, abs=0.02 if by_flips > 0.1 else 0.01)
    assert mean_test(difference).p < got.p or shift == 0.0, "taking tracks of a day as independent claims too much"


def test_under_no_difference_one_in_twenty_days_sets_is_significant():
    """20 days of unequal size: the test holds its level, and the one over tracks does not."""
    rng, by_day, by_track = np.random.default_rng(8), 0, 0
    for _ in range(1000):
        day = np.repeat(np.arange(20), rng.integers(5, 60, 20))
        difference = rng.normal(0, 1, len(day)) + rng.normal(0, 0.5, 20)[day]
        by_day += mean_test(difference, day).p < 0.05
        by_track += mean_test(difference).p < 0.05
    assert by_day / 1000 < 0.07
    assert by_track / 1000 > 0.15


def test_seeds_that_score_other_tracks_count_alike():
    """The mean is that of the seeds' means; a track in several seeds is one cluster, not several."""
    rng = np.random.default_rng(7)
    values = rng.normal(1, 1, (3, 30))
    values[0, :20] = NAN
    got = mean_test(values)
    assert got.mean == pytest.approx(np.mean([np.nanmean(seed) for seed in values]))
    assert got.n == pytest.approx((10 + 30 + 30) / 3)
    again = mean_test(np.repeat(rng.normal(1, 1, (1, 30)), 4, axis=0))
    assert (again.clusters, again.n) == (30, 30)
    alone = mean_test(np.repeat(values[1:2], 4, axis=0))
    assert alone.t == pytest.approx(mean_test(values[1]).t)


def test_a_seed_of_one_stands_beside_every_seed_of_the_other():
    rng = np.random.default_rng(8)
    ours, theirs = rng.gamma(2, 1, (4, 25)), rng.gamma(2, 1, 25)
    assert paired_test(ours, theirs) == paired_test(ours, np.tile(theirs, (4, 1)))


def test_only_tracks_that_both_scored_count():
    rng = np.random.default_rng(11)
    ours, theirs = rng.random(20), rng.random(20)
    ours[[0, 5]] = NAN
    theirs[[5, 7, 9]] = NAN
    both = np.isfinite(ours) & np.isfinite(theirs)
    assert paired_test(ours, theirs).n == 16
    np.testing.assert_allclose(paired_test(ours, theirs), paired_test(ours[both], theirs[both]), rtol=1e-12)


def test_smaller_errors_of_ours_are_significant_and_not_the_other_way_round():
    rng = np.random.default_rng(12)
    theirs = rng.gamma(4, 1, 60)
    ours = theirs - 0.3 + rng.normal(0, 0.2, 60)
    assert paired_test(ours, theirs).p < 1e-6
    assert paired_test(theirs, ours).p > 1 - 1e-6
    assert paired_test(theirs, ours).p_greater == pytest.approx(paired_test(ours, theirs).p)


@pytest.mark.parametrize(
    ("ours", "theirs", "n", "mean"),
    [([], [], 0, NAN), ([1.0], [3.0], 1, -2.0), ([NAN], [3.0], 0, NAN), ([1.0, 2.0], [2.0, 3.0], 2, -1.0)],
)
def test_too_little_to_test(ours, theirs, n, mean):
    got = paired_test(np.array(ours, float), np.array(theirs, float))
    assert got.n == n
    assert got.mean == pytest.approx(mean, nan_ok=True)
    assert np.isnan(got[3:]).all()


def test_one_cluster_only():
    got = mean_test(np.array([1.0, 2.0, 4.0]), np.array(["a", "a", "a"]))
    assert (got.n, got.clusters) == (3, 1)
    assert np.isnan(got[3:]).all()


@pytest.mark.parametrize("size", [1.0, 1e-3, 300.0])
def test_a_difference_that_is_constant_but_for_rounding_has_no_p(size):
    """Two methods of one path in float32, one a bit farther: not p = 0."""
    theirs = (size * np.random.default_rng(1).gamma(3, 1, 500)).astype(np.float32)
    ours = theirs + np.float32(0.1 * size)
    assert np.ptp(ours.astype(float) - theirs) > 0, "it does vary in the last bits"
    assert np.isnan(paired_test(ours, theirs)[3:]).all()
    assert paired_test(ours + size * np.random.default_rng(2).normal(0, 1e-3, 500), theirs).p_greater < 1e-9


@pytest.mark.parametrize("n", [8, 40])
def test_a_detectable_difference_is_found_in_four_of_five_tries(n):
    rng, found, asked = (
        np.random.default_rng(1),
        0,
        detectable(mean_test(np.random.default_rng(0).normal(0, 1, 20000)[:n])),
    )
    asked *= 1.0 / np.random.default_rng(0).normal(0, 1, 20000)[:n].std(ddof=1)  # of a spread of 1
    for _ in range(2000):
        found += mean_test(rng.normal(-asked, 1.0, n)).p < 0.05
    assert found / 2000 == pytest.approx(0.8, abs=0.03)
    assert np.isnan(detectable(mean_test(np.ones(5))))


@FEW
@given(SEEDS)
def test_groups_are_welch_s_test(seed):
    rng = np.random.default_rng(seed)
    values, first = rng.normal(0, 1, 400), np.arange(400) < 150
    got = groups_test(values, first, ~first)
    expected = stats.ttest_ind(values[first], values[~first], equal_var=False, alternative="less")
    assert got.mean == pytest.approx(values[first].mean() - values[~first].mean())
    assert got.t == pytest.approx(expected.statistic, rel=0.01)
    assert got.p == pytest.approx(expected.pvalue, abs=0.005)


def test_groups_of_the_same_days_share_what_the_days_have():
    """A day's luck falls on both groups and cancels: the interval over days is the narrower one."""
    rng = np.random.default_rng(3)
    day = np.repeat(np.arange(20), 40)
    values, first = rng.normal(0, 0.2, 800) + rng.normal(0, 3, 20)[day], np.arange(800) % 2 == 0
    by_day, by_track = groups_test(values, first, ~first, day), groups_test(values, first, ~first)
    assert by_day.high - by_day.low < 0.2 * (by_track.high - by_track.low)
    assert np.isnan(groups_test(values, np.arange(800) < 1, np.arange(800) >= 1)[3:]).all()


@FEW
@given(st.lists(st.floats(0, 1) | st.just(NAN), max_size=12))
def test_holm_equals_the_textbook(p):
    np.testing.assert_allclose(holm(p), twins.holm(p), rtol=1e-12)


def test_holm_by_hand():
    got = holm([0.04, 0.01, NAN, 0.03, 0.9])
    # sorted 0.01, 0.03, 0.04, 0.9 times 4, 3, 2, 1 = 0.04, 0.09, 0.08, 0.9; never falling: 0.04, 0.09, 0.09, 0.9
    np.testing.assert_allclose(got, [0.09, 0.04, NAN, 0.09, 0.9])


def test_few_days_leave_persons():
    """A recording's name may hold a slash, and recordings of one day are one day."""
    keys = ["a/x/1", "a/x/2", "b/1"]
    few = {"a/x": "2030-01-01", "b": "2030-01-02"} | {f"r{n}": f"2030-01-{n:02}" for n in range(2, LEAST_DAYS)}
    assert len(set(few.values())) == LEAST_DAYS - 1
    assert clusters(keys, few).tolist() == keys
    enough = few | {"c": "2030-01-20"}
    assert clusters(keys, enough).tolist() == ["2030-01-01", "2030-01-01", "2030-01-02"]


# --- the table ------------------------------------------------------------------------------------------------------

STEPS = 12
DAYS = {f"day{n}": f"2030-01-{n + 1:02}" for n in range(6)}


def made_up_errors(seed, tracks, outputs, offset, seeds=2):
    """Errors of a made-up method on some of the tracks 0..59 of six days; the first three it could not forecast."""
    rng = np.random.default_rng(seed)
    found = {}
    for output in outputs:
        for protocol in PROTOCOLS:
            ade = offset + rng.gamma(3, 1, (seeds, len(tracks), STEPS))
            ade[rng.random(ade.shape) < 0.2] = NAN
            keys = np.array([f"day{n % 6}/{n:02d}" for n in tracks])
            order = np.argsort(keys)
            unknown = np.arange(len(tracks)) < 3
            found[output, protocol] = Errors(
                keys[order], ade[:, order], 2 * ade[:, order], np.full(len(tracks), STEPS), unknown[order], keys[order]
            )
    return found


@pytest.mark.parametrize("days", [DAYS, dict.fromkeys(DAYS, "2030-01-01")], ids=["days", "persons"])
def test_compare_equals_the_loop(days):
    methods = {
        "maps": made_up_errors(13, range(50), ("ranked", "mean"), 0.0),
        "mid": made_up_errors(14, range(10, 60), ("mean",), 0.3),
        "line": made_up_errors(15, range(60), ("single",), 1.0, seeds=1),
    }
    pairs, horizons, outputs = [("maps", "mid"), ("maps", "line"), ("mid", "line")], [1.0, 3.0, 6.0], {}
    outputs = {"maps": "ranked", "mid": "mean", "line": "single"}
    at = {
        name: {
            key: one._replace(ade=one.ade[:, :, [1, 5, 11]], fde=one.fde[:, :, [1, 5, 11]])
            for key, one in errors.items()
        }
        for name, errors in methods.items()
    }
    table = compare("hall", at, pairs, horizons, days)
    assert len(table) == 2 * 3 * 2 * 3
    for line in table.itertuples():
        assert (line.dataset, line.output, line.output_against) == ("hall", outputs[line.method], outputs[line.against])
        sides = [methods[name][outputs[name], line.protocol] for name in (line.method, line.against)]
        column = round(line.horizon_s / 0.5) - 1
        by_seed = [], []
        for seed in range(2):
            values = []
            for one in sides:
                array = getattr(one, line.metric)
                values.append(dict(zip(one.keys.tolist(), array[min(seed, len(array) - 1), :, column], strict=True)))
            shared = [k for k in values[0] if k in values[1] and math.isfinite(values[0][k] + values[1][k])]
            for found, value in zip(by_seed, values, strict=True):
                found.append({key: value[key] for key in shared})
        means = [twins.mean([twins.mean(list(seed.values())) for seed in side]) for side in by_seed]
        assert (line.mean_m, line.mean_against_m) == pytest.approx(means, rel=1e-6)
        assert line.mean_difference_m == pytest.approx(means[0] - means[1], rel=1e-6, abs=1e-9)
        assert line.n == twins.mean([len(seed) for seed in by_seed[0]])
        both = set(by_seed[0][0]) | set(by_seed[0][1])
        assert line.clusters == len({days[key.split("/")[0]] for key in both} if days is DAYS else both)
        unknown = {key for one in sides for key, held in zip(one.keys.tolist(), one.unknown, strict=True) if held}
        assert line.n_unknown == len(unknown & both) > 0
    for protocol in PROTOCOLS:  # one family of tests per dataset and protocol, for each side
        family = table[table["protocol"] == protocol]
        for side in ("p", "p_greater", "p_known", "p_greater_known"):
            np.testing.assert_allclose(family[f"{side}_holm"], twins.holm(family[side].tolist()), rtol=1e-12)


def test_p_without_the_tracks_that_one_side_could_not_forecast():
    """A method that is level, but held at t0 on a tenth of the tracks."""
    rng = np.random.default_rng(5)
    keys, held = np.array([f"day0/{n:03d}" for n in range(100)]), np.arange(100) < 10
    ade = rng.gamma(3, 1, (1, 100, 1))
    level = ade + rng.normal(0, 0.01, (1, 100, 1))
    worse = np.where(held[None, :, None], level + 5, level)
    sides = {
        name: {("single", protocol): Errors(keys, one, one, np.ones(100, int), unknown, keys) for protocol in PROTOCOLS}
        for name, one, unknown in (("a", ade, np.zeros(100, bool)), ("b", worse, held))
    }
    table = compare("hall", sides, [("a", "b")], [1.0], {"day0": "2030-01-01"})
    assert (table["p"] < 0.01).all()
    assert (table["p_known"] > 0.05).all()
    assert (table["n_unknown"] == 10).all()


def test_no_pair_is_no_table():
    assert len(compare("hall", {}, [], [1.0], {})) == 0
