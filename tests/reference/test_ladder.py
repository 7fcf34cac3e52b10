"""The ladder: errors, differences and their intervals against loops."""

import math

import numpy as np
import pyarrow as pa
import pytest
import twins
from scipy import stats

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.storage import write_parquet
from modlhmp.study.ladder import differences, scores
from modlhmp.study.summary import at_horizons

STEP_S = 0.5
STEPS = 8
HORIZONS = [1.0, 2.5, 4.0]
AT = [2, 5, 8]  # their time steps
DAYS = {f"rec{n}": f"2030-01-{n + 1:02}" for n in range(6)}
ONE_DAY = dict.fromkeys(DAYS, "2030-01-01")
NAN = math.nan


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
                        row |= {"protocol": protocol, "eligible_steps": wanted, "alive_steps": int(person != 3)}
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
    """[{(recording, track): error} of each seed], of those that have one."""
    by = {}
    for row in rows:
        if (row["output"], row["protocol"]) == (output, protocol) and not math.isnan(row[metric][step - 1]):
            by.setdefault(row["seed"], {})[row["recording"], row["track_id"]] = float(row[metric][step - 1])
    return [by[seed] for seed in sorted(by)]


def mean_of_means(by_seed):
    return twins.mean([twins.mean(list(seed.values())) for seed in by_seed if seed])


def interval(by_seed, group):
    """95 % interval: the jackknife that leaves out one cluster after the other, t of clusters less one."""
    names = sorted({group(who) for seed in by_seed for who in seed})
    without = [
        mean_of_means([{who: value for who, value in seed.items() if group(who) != name} for seed in by_seed])
        for name in names
    ]
    number, middle = len(names), twins.mean(without)
    error = math.sqrt((number - 1) / number * math.fsum((mean - middle) ** 2 for mean in without))
    half = stats.t(number - 1).ppf(0.975) * error
    return mean_of_means(by_seed) - half, mean_of_means(by_seed) + half


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
        assert line.n == twins.mean([len(seed) for seed in ade])
        assert (line.ade_m, line.fde_m) == pytest.approx((mean_of_means(ade), mean_of_means(fde)), rel=1e-6)
        lengths = {
            (row["recording"], row["track_id"]): row["eligible_steps"]
            for row in rows[line.method]
            if row["protocol"] == line.protocol
        }
        assert line.eligible == sum(length >= step for length in lengths.values())
        expected = interval(ade, lambda who: days[who[0]] if days is DAYS else who)
        np.testing.assert_allclose([line.ade_low_m, line.ade_high_m], expected, rtol=1e-5)


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
        each = [
            {who: one[who] - other[who] for who in one.keys() & other.keys()}
            for one, other in zip(mine, theirs, strict=True)
        ]
        assert line.n == twins.mean([len(seed) for seed in each]) < len(mine[0])
        assert line.difference_m == pytest.approx(mean_of_means(each), rel=1e-5, abs=1e-6)
        level = mean_of_means([{who: other[who] for who in seed} for seed, other in zip(each, theirs, strict=True)])
        assert line.percent == pytest.approx(100 * mean_of_means(each) / level, rel=1e-5, abs=1e-5)
        expected = interval(each, lambda who: DAYS[who[0]])
        np.testing.assert_allclose([line.low_m, line.high_m], expected, rtol=1e-4, atol=1e-5)
        assert line.n_unknown == len({who for seed in each for who in seed if who[1] == 3}) > 0


def test_a_method_does_not_differ_from_itself(errors):
    table = differences("hall", errors, [("maps", "maps")], HORIZONS, DAYS)
    assert (table["n"] > 0).all()
    assert (table[["difference_m", "percent"]] == 0).all(axis=None)
    assert table[["low_m", "high_m"]].isna().all(axis=None), "nothing varies"


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
