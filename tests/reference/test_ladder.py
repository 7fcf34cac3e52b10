"""The ladder: bootstrap intervals against closed forms, SciPy and a loop; errors and differences against loops."""

import math
import tracemalloc

import numpy as np
import pyarrow as pa
import pytest
import twins
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.storage import write_parquet
from modlhmp.study.ladder import LEAST_DAYS, bootstrap, clusters, differences, scores
from modlhmp.study.summary import at_horizons

FEW = settings(max_examples=20, deadline=None, derandomize=True)
SEEDS = st.integers(0, 10**6)
STEP_S = 0.5
STEPS = 8
HORIZONS = [1.0, 2.5, 4.0]
AT = [2, 5, 8]  # their time steps
DAYS = {f"rec{n}": f"2030-01-{n + 1:02}" for n in range(6)}
ONE_DAY = dict.fromkeys(DAYS, "2030-01-01")
NAN = math.nan


def persons(n):
    """Everybody is a cluster of their own."""
    return np.array([f"day/{i}" for i in range(n)])


def bootstrap_by_loop(values, cluster, resamples=1500):
    """Ends of the interval: draw as many clusters as there are, pool their values, take the mean; over and over."""
    by = {}
    for value, name in zip(values, cluster, strict=True):
        if not math.isnan(value):
            by.setdefault(str(name), []).append(value)
    names, rng, means = sorted(by), np.random.default_rng(99), []
    for _ in range(resamples):
        pooled = [value for pick in rng.integers(0, len(names), len(names)) for value in by[names[pick]]]
        means.append(math.fsum(pooled) / len(pooled))
    return np.percentile(means, [2.5, 97.5])


# --- bootstrap ----------------------------------------------------------------------------------------------


@FEW
@given(SEEDS, st.integers(1, 60), st.integers(1, 9))
def test_the_mean_is_that_of_all_values(seed, n, days):
    rng = np.random.default_rng(seed)
    values, cluster = rng.gamma(2, 3, n), rng.integers(0, days, n)
    mean, low, high = bootstrap(values, cluster)
    assert mean == pytest.approx(math.fsum(values) / n, rel=1e-12)
    assert math.isnan(low) == math.isnan(high) == (len(set(cluster.tolist())) < 2)
    assert math.isnan(low) or low <= mean + 1e-9
    assert math.isnan(low) or high >= mean - 1e-9


@pytest.mark.parametrize("n", [40, 400])
def test_the_interval_over_persons_is_scipy_s(n):
    """Both resample at random, so their ends differ by a small part of the standard error."""
    values = np.random.default_rng(n).gamma(2, 3, n)
    _, low, high = bootstrap(values, persons(n))
    other = stats.bootstrap((values,), np.mean, n_resamples=4000, method="percentile", rng=np.random.default_rng(5))
    error = values.std() / math.sqrt(n)
    np.testing.assert_allclose([low, high], other.confidence_interval, atol=0.2 * error)


def test_the_interval_over_persons_is_the_normal_one_of_many():
    """1.96 standard errors to both sides, by the central limit theorem."""
    values = np.random.default_rng(1).exponential(2, 2000)
    mean, low, high = bootstrap(values, persons(2000))
    error = values.std() / math.sqrt(2000)
    np.testing.assert_allclose([low, high], [mean - 1.96 * error, mean + 1.96 * error], atol=0.15 * error)


def test_the_interval_over_days_of_equal_size_is_that_of_their_means():
    """Days of as many people each: a sample of days is a sample of daily means."""
    values = np.random.default_rng(2).normal(0, 1, (40, 25)) + np.random.default_rng(3).normal(5, 2, (40, 1))
    got = bootstrap(values.ravel(), np.repeat(np.arange(40), 25))
    np.testing.assert_allclose(got, bootstrap(values.mean(axis=1), np.arange(40)), rtol=1e-12)


@pytest.mark.parametrize("sizes", [(5, 5, 5, 5, 5, 5), (1, 2, 3, 10, 20, 60, 7, 4)])
def test_the_interval_over_days_of_any_size_is_the_loop_s(sizes):
    rng = np.random.default_rng(len(sizes))
    cluster = np.repeat([f"2030-01-{n + 10}" for n in range(len(sizes))], sizes)
    values = rng.normal(0, 1, sum(sizes)) + np.repeat(rng.normal(8, 2, len(sizes)), sizes)
    _, low, high = bootstrap(values, cluster)
    expected = bootstrap_by_loop(values, cluster)
    np.testing.assert_allclose([low, high], expected, atol=0.1 * (expected[1] - expected[0]))


def test_days_that_differ_widen_the_interval():
    """50 people per day share the day's effect, so 20 days are worth little more than 20 people."""
    rng = np.random.default_rng(4)
    values, day = rng.normal(0, 0.3, 1000) + np.repeat(rng.normal(5, 1, 20), 50), np.repeat(np.arange(20), 50)
    (_, *by_day), (_, *by_person) = bootstrap(values, day), bootstrap(values, persons(1000))
    assert np.diff(by_day) > 4 * np.diff(by_person)


def test_days_that_do_not_differ_leave_it_about_as_wide():
    """People in days at random: both intervals estimate the same error."""
    values, day = np.random.default_rng(5).normal(5, 1, 3000), np.repeat(np.arange(60), 50)
    (_, *by_day), (_, *by_person) = bootstrap(values, day), bootstrap(values, persons(3000))
    assert 0.7 < np.diff(by_day) / np.diff(by_person) < 1.3


def test_the_interval_covers_the_truth_about_as_often_as_it_says():
    rng = np.random.default_rng(6)
    held = []
    for _ in range(150):
        values = np.repeat(rng.normal(7, 1, 30), 4) + rng.normal(0, 1, 120)
        _, low, high = bootstrap(values, np.repeat(np.arange(30), 4))
        held.append(low <= 7 <= high)
    assert 0.88 < np.mean(held) < 0.99


@pytest.mark.parametrize(
    ("values", "cluster"), [([3.0, 5.0, 7.0], ["a", "a", "a"]), ([5.0], ["a"]), ([5.0, NAN], ["a", "b"])]
)
def test_one_cluster_has_a_mean_and_no_interval(values, cluster):
    mean, low, high = bootstrap(np.array(values), np.array(cluster))
    assert mean == 5.0
    assert math.isnan(low)
    assert math.isnan(high)


@pytest.mark.parametrize("values", [[], [NAN, NAN]])
def test_nobody_has_neither(values):
    assert np.isnan(bootstrap(np.array(values, float), persons(len(values)))).all()


def test_who_was_not_scored_does_not_count():
    """Their clusters are gone as well, as if they had never been given."""
    rng = np.random.default_rng(7)
    values, cluster = rng.normal(5, 1, 60), np.repeat(np.arange(12), 5)
    values[rng.random(60) < 0.3] = NAN
    values[cluster == 4] = NAN
    known = np.isfinite(values)
    assert bootstrap(values, cluster) == bootstrap(values[known], cluster[known])


def test_it_is_the_same_every_time():
    values = np.random.default_rng(8).normal(5, 1, 50)
    assert bootstrap(values, persons(50)) == bootstrap(values, persons(50))


@FEW
@given(SEEDS)
def test_the_order_of_tracks_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    values, cluster, order = rng.normal(5, 1, 80), rng.integers(0, 9, 80), rng.permutation(80)
    np.testing.assert_allclose(
        bootstrap(values[order], cluster[order]), bootstrap(values, cluster), rtol=1e-12, atol=1e-12
    )


@FEW
@given(SEEDS, st.floats(-5, 5), st.floats(0.1, 9))
def test_shift_scale_and_sign_carry_over(seed, shift, scale):
    """The draws are of clusters alone: metres or feet, a difference or its opposite, the interval follows."""
    rng = np.random.default_rng(seed)
    values, cluster = rng.normal(0, 1, 80), rng.integers(0, 9, 80)
    mean, low, high = bootstrap(values, cluster)
    np.testing.assert_allclose(
        bootstrap(scale * values + shift, cluster),
        [scale * mean + shift, scale * low + shift, scale * high + shift],
        atol=1e-9,
    )
    np.testing.assert_allclose(bootstrap(-values, cluster), [-mean, -high, -low], atol=1e-9)


def test_people_counted_twice_within_their_days_tell_nothing_new():
    """The days are the sample; with persons as clusters the interval would shrink."""
    rng = np.random.default_rng(9)
    values, cluster = rng.normal(5, 1, 80), np.repeat(np.arange(8), 10)
    twice = bootstrap(np.tile(values, 2), np.tile(cluster, 2))
    np.testing.assert_allclose(twice, bootstrap(values, cluster), rtol=1e-12)


def test_where_all_are_alike_the_interval_is_a_point():
    np.testing.assert_allclose(bootstrap(np.full(30, 2.5), persons(30)), 2.5, rtol=1e-12)


def test_many_people_need_little_memory():
    """A day of ATC has tens of thousands, whose resamples must not all be held at once."""
    values = np.random.default_rng(12).normal(5, 1, 3000)
    tracemalloc.start()
    bootstrap(values, np.arange(3000))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 300 * 8 * len(values)


# --- clusters -----------------------------------------------------------------------------------------------


def test_few_days_leave_persons():
    """A recording's name may hold a slash, and recordings of one day are one day."""
    keys = ["a/x/1", "a/x/2", "b/1"]
    few = {"a/x": "2030-01-01", "b": "2030-01-02"} | {f"r{n}": f"2030-01-{n:02}" for n in range(2, LEAST_DAYS)}
    assert len(set(few.values())) == LEAST_DAYS - 1
    assert clusters(keys, few).tolist() == keys
    enough = few | {"c": "2030-01-20"}
    assert clusters(keys, enough).tolist() == ["2030-01-01", "2030-01-01", "2030-01-02"]


# --- errors and differences ---------------------------------------------------------------------------------


def made_up(rng, outputs, people=25, seeds=2):
    """Rows of an errors file: persons of all recordings, with random errors, lengths and gaps in the paper protocol."""
    rows = []
    for name in DAYS:
        for person in range(people):
            length = min(int(rng.integers(0, 2 * STEPS)), STEPS)
            if rng.random() < 0.1:
                continue  # this method does not know them
            for output in outputs:
                for seed in range(seeds):
                    off = rng.gamma(2, 1, STEPS)
                    for protocol in PROTOCOLS:
                        idle = protocol == "paper" and person % 4 == 0
                        wanted = 0 if idle else length
                        alive = wanted if protocol == "complete" else min(wanted, int(rng.integers(0, 3 * STEPS)))
                        fde = np.where(np.arange(STEPS) < alive, off, NAN)
                        ade = np.where(np.arange(STEPS) < alive, np.cumsum(off) / np.arange(1, STEPS + 1), NAN)
                        row = {"recording": name, "track_id": person, "seed": seed, "output": output}
                        row |= {"protocol": protocol, "eligible_steps": wanted}
                        rows.append(row | {"ade": ade.astype(np.float32), "fde": fde.astype(np.float32)})
    return rows


def as_errors(rows, path):
    """What the workflow's step makes of such a file."""
    columns = {name: [row[name] for row in rows] for name in rows[0] if name not in {"ade", "fde"}}
    for metric in ("ade", "fde"):
        values = pa.array(np.concatenate([row[metric] for row in rows]))
        columns[metric] = pa.FixedSizeListArray.from_arrays(values, STEPS)
    write_parquet(pa.table(columns), path)
    return at_horizons(path, HORIZONS, STEP_S)


def errors_of(rows, output, protocol, metric, step):
    """{(recording, track): error}, seeds averaged first, of those that have one."""
    by = {}
    for row in rows:
        if (row["output"], row["protocol"]) == (output, protocol) and not math.isnan(row[metric][step - 1]):
            by.setdefault((row["recording"], row["track_id"]), []).append(float(row[metric][step - 1]))
    return {who: twins.mean(values) for who, values in by.items()}


METHODS = {
    "maps": ("ranked", ["ranked", "mean"]),
    "net": ("mean", ["mean_path", "mean"]),
    "line": ("single", ["single"]),
}


@pytest.fixture(scope="module")
def rows():
    """Three methods' rows; each stands by another output, and each misses other people."""
    rng = np.random.default_rng(10)
    return {name: made_up(rng, outputs) for name, (_, outputs) in METHODS.items()}


@pytest.fixture(scope="module")
def errors(rows, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ladder")
    return {name: as_errors(rows[name], folder / f"{name}.parquet") for name in rows}


@pytest.mark.parametrize("days", [DAYS, ONE_DAY], ids=["days", "persons"])
def test_scores_equal_the_loop(rows, errors, days):
    table = scores("hall", errors, HORIZONS, AT, days)
    assert len(table) == len(PROTOCOLS) * len(METHODS) * len(HORIZONS)
    assert set(table["dataset"]) == {"hall"}
    for line in table.itertuples():
        output, step = METHODS[line.method][0], AT[HORIZONS.index(line.horizon_s)]
        ade, fde = (errors_of(rows[line.method], output, line.protocol, m, step) for m in ("ade", "fde"))
        assert line.n == len(ade)
        assert line.ade_m == pytest.approx(twins.mean(list(ade.values())), rel=1e-6)
        assert line.fde_m == pytest.approx(twins.mean(list(fde.values())), rel=1e-6)
        lengths = {
            (row["recording"], row["track_id"]): row["eligible_steps"]
            for row in rows[line.method]
            if row["protocol"] == line.protocol
        }
        assert line.eligible == sum(length >= step for length in lengths.values())
        groups = [days[name] if days is DAYS else f"{name}/{person}" for name, person in ade]
        expected = bootstrap_by_loop(list(ade.values()), groups)
        width = expected[1] - expected[0]
        np.testing.assert_allclose([line.ade_low_m, line.ade_high_m], expected, atol=0.12 * width)


def test_everybody_eligible_counts_in_the_complete_protocol_only(errors):
    table = scores("hall", errors, HORIZONS, AT, DAYS).set_index("protocol")
    assert (table.loc["complete", "n"] == table.loc["complete", "eligible"]).all()
    assert (table.loc["paper", "n"] < table.loc["paper", "eligible"]).any()


PAIRS = [("maps", "line"), ("net", "line"), ("maps", "net"), ("line", "maps")]


def test_differences_equal_the_loop(rows, errors):
    """Over the people that both scored, by the output that stands for each; percent of the other's error there."""
    table = differences("hall", errors, PAIRS, HORIZONS, DAYS)
    assert len(table) == len(PROTOCOLS) * len(PAIRS) * 2 * len(HORIZONS)
    for line in table.itertuples():
        step = AT[HORIZONS.index(line.horizon_s)]
        mine, theirs = (
            errors_of(rows[method], METHODS[method][0], line.protocol, line.metric, step)
            for method in (line.method, line.against)
        )
        both = sorted(set(mine) & set(theirs))
        assert line.n == len(both) < min(len(mine), len(theirs))
        each = [mine[who] - theirs[who] for who in both]
        assert line.difference_m == pytest.approx(twins.mean(each), rel=1e-5, abs=1e-6)
        share = 100 * twins.mean(each) / twins.mean([theirs[who] for who in both])
        assert line.percent == pytest.approx(share, rel=1e-5, abs=1e-5)
        expected = bootstrap_by_loop(each, [DAYS[name] for name, _ in both])
        np.testing.assert_allclose([line.low_m, line.high_m], expected, atol=0.12 * (expected[1] - expected[0]))


def test_a_method_does_not_differ_from_itself(errors):
    table = differences("hall", errors, [("maps", "maps")], HORIZONS, DAYS)
    assert (table["n"] > 0).all()
    assert (table[["difference_m", "low_m", "high_m", "percent"]] == 0).all(axis=None)


def test_the_other_way_round_the_sign_turns(errors):
    """The ends change places, and the same people count."""
    one, other = (differences("hall", errors, [pair], HORIZONS, DAYS) for pair in (("maps", "net"), ("net", "maps")))
    assert one["n"].equals(other["n"])
    np.testing.assert_allclose(one["difference_m"], -other["difference_m"], rtol=1e-9)
    np.testing.assert_allclose(one["low_m"], -other["high_m"], rtol=1e-9)


def test_a_pair_asked_for_twice_is_compared_once(errors):
    """The rung above may be the reference."""
    table = differences("hall", errors, [PAIRS[0], PAIRS[1], PAIRS[0]], HORIZONS, DAYS)
    assert len(table) == len(PROTOCOLS) * 2 * 2 * len(HORIZONS)


def test_a_planted_shift_is_found_with_its_sign(rows, tmp_path):
    """Half a metre better for everybody, give or take: found with its share, beyond doubt, in every row."""
    rng = np.random.default_rng(11)
    line = rows["line"]
    better = [
        row | {m: row[m] - np.float32(0.5) + rng.normal(0, 0.2, STEPS).astype(np.float32) for m in ("ade", "fde")}
        for row in line
    ]
    errors = {
        name: as_errors(some, tmp_path / f"{name}.parquet") for name, some in (("better", better), ("line", line))
    }
    found = differences("hall", errors, [("better", "line")], HORIZONS, DAYS)
    assert ((found["low_m"] <= -0.5) & (found["high_m"] >= -0.5)).mean() > 0.6
    assert (found["high_m"] < -0.3).all()
    assert (found["low_m"] > -0.7).all()
    scored = scores("hall", errors, HORIZONS, AT, DAYS).set_index(["method", "protocol", "horizon_s"])
    for row in found[found["metric"] == "ade"].itertuples():
        level = scored.loc[("line", row.protocol, row.horizon_s), "ade_m"]
        assert row.percent == pytest.approx(100 * row.difference_m / level, rel=1e-5)


def test_pairing_removes_what_people_have_in_common(errors, rows, tmp_path):
    """A paired interval is far narrower than that of an error, where both err on the same people."""
    near = [row | {m: row[m] + np.float32(0.005 * row["track_id"]) for m in ("ade", "fde")} for row in rows["line"]]
    both = {"near": as_errors(near, tmp_path / "near.parquet"), "line": errors["line"]}
    paired = differences("hall", both, [("near", "line")], HORIZONS, ONE_DAY)
    paired = paired[paired["metric"] == "ade"]
    alone = scores("hall", {"near": both["near"]}, HORIZONS, AT, ONE_DAY)
    assert paired["horizon_s"].tolist() == alone["horizon_s"].tolist()
    assert ((paired["high_m"] - paired["low_m"]).to_numpy() * 5 < (alone["ade_high_m"] - alone["ade_low_m"])).all()


def test_nobody_in_common_is_n_0(rows, tmp_path):
    """No number, and no warning that a run would hide."""
    halves = [[row for row in rows["line"] if (row["track_id"] % 2 == 0) == even] for even in (True, False)]
    errors = {name: as_errors(some, tmp_path / f"{name}.parquet") for name, some in zip("ab", halves, strict=True)}
    table = differences("hall", errors, [("a", "b")], HORIZONS, DAYS)
    assert (table["n"] == 0).all()
    assert table[["difference_m", "low_m", "high_m", "percent"]].isna().all(axis=None)


def test_a_horizon_that_nobody_reaches_has_a_row_without_numbers(rows, tmp_path):
    short = []
    for row in rows["line"]:
        cut = {m: np.where(np.arange(STEPS) < 5, row[m], np.float32(NAN)) for m in ("ade", "fde")}
        short.append(row | cut | {"eligible_steps": min(row["eligible_steps"], 5)})
    table = scores("hall", {"line": as_errors(short, tmp_path / "f.parquet")}, HORIZONS, AT, DAYS)
    last = table[table["horizon_s"] == HORIZONS[-1]]
    assert (last[["n", "eligible"]] == 0).all(axis=None)
    assert last[["ade_m", "ade_low_m", "ade_high_m", "fde_m"]].isna().all(axis=None)
