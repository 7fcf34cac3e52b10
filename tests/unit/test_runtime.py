"""The runtime study, without timing anything: what it counts, what it copies, and what becomes of its numbers."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from modlhmp.forecasting import make_forecaster
from modlhmp.maps import cliff, stef
from modlhmp.storage import write_parquet
from modlhmp.study import claims
from modlhmp.study.exhibits.runtime_figure import draw
from modlhmp.study.runtime import REPETITIONS, copied, exponent, measure, milliseconds_a_track, some_tracks
from modlhmp.tracks import Tracks, empty_tracks, usable_tracks, write_tracks

DATASET = {"name": "hall", "title": "Hall", "label": "atc", "observed_rows": 4, "horizon_s": 12.0, "time_step_s": 1.0,
           "timezone": "UTC", "velocity": "columns", "floor_plan": [], "demo": True}  # fmt: skip
OPTIONS = {"k": 3, "beta": 1.0, "sampling_radius_m": 1.0, "speed": "constant"}


def people(number, rows=20):
    """Walkers with a noisy heading, all within one clock hour."""
    rng = np.random.default_rng(number)
    heading = rng.normal(0, 0.5, (number, rows))
    x, y = (np.cumsum(part(heading), axis=1).ravel() for part in (np.cos, np.sin))
    t = np.tile(1.9e9 + np.arange(rows), number)
    return Tracks(np.repeat(np.arange(number), rows), t, x, y, np.ones(len(t)), heading.ravel())


def run(tmp_path, number):
    """What the module prints for so many test people."""
    write_parquet(cliff.build(people(60)), tmp_path / "tc_cliff/17.parquet")  # 1.9e9 is 17:46 UTC
    write_tracks(people(number), tmp_path / "day.parquet")
    task = {"map": str(tmp_path / "tc_cliff"), "kind": "tc_cliff", "options": OPTIONS, "dataset": DATASET,
            "tracks": [str(tmp_path / "day.parquet")], "max_tracks": 25}  # fmt: skip
    command = [sys.executable, "-m", "modlhmp.study.runtime"]
    return subprocess.run(command, input=json.dumps(task), capture_output=True, text=True, check=False, timeout=300)


def test_exponent_of_exact_powers():
    sizes = np.array([10, 20, 50, 100, 300])
    for power in (0.5, 1.0, 2.0):
        slope, low, high = exponent(sizes, 3e-4 * sizes**power)
        assert slope == pytest.approx(power, abs=1e-9)
        assert low <= slope <= high
    assert np.isnan(exponent([1, 2], [1.0, 2.0])).all()


def test_exponent_s_interval_covers_the_truth():
    """Noisy linear growth: about 95 % of the intervals hold 1."""
    rng = np.random.default_rng(0)
    sizes = np.geomspace(10, 1000, 6)
    held = [low <= 1 <= high for _, low, high in
            (exponent(sizes, sizes * np.exp(rng.normal(0, 0.1, 6))) for _ in range(400))]  # fmt: skip
    assert 0.9 < np.mean(held) < 0.99


def test_copies_of_a_map_are_out_of_reach():
    table = cliff.build(people(60))
    bigger = copied(table, 4)
    assert bigger.num_rows == 4 * table.num_rows
    assert len(np.unique(bigger["location"])) == 4 * len(np.unique(table["location"]))
    x = np.sort(np.unique(bigger["x"]))
    assert (np.diff(x) >= 99).sum() == 3
    assert bigger.slice(0, table.num_rows).equals(table)


def test_a_measurement(tmp_path):
    """All quantities, with their units; counts exact; the copied maps gave the same forecasts, or it would fail."""
    done = run(tmp_path, 40)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["tracks"], result["k"], result["maps"], result["horizon_s"]) == (25, 3, 1, 12.0)
    assert result["map_kb"] == pytest.approx((tmp_path / "tc_cliff/17.parquet").stat().st_size / 1000)
    assert 50 < result["memory_of_imports_mb"] < result["memory_mb"] < 1000
    low, high = result["seconds_per_track_range"]
    assert 0 < low <= result["seconds_per_track"] <= high
    locations = [row[0] for row in result["growth"]["M"]]
    assert locations == [locations[0] * copies for copies in (1, 2, 4, 8, 16)]
    lived = [row[2] for row in result["growth"]["T"]]
    assert lived == sorted(lived)
    assert 25 * 3 <= lived[-1] <= 25 * 3 * 12
    assert result["growth"]["N"][-1][0] == 25
    assert {"cpu", "cores", "python", "numba", "numpy"} == set(result["machine"])


def test_a_stef_map_is_measured_alike(tmp_path):
    table = stef.build(people(60), "UTC")
    write_parquet(stef.evaluate(table, stef.middle_of_hour(17)), tmp_path / "stef/17.parquet")
    write_tracks(people(20), tmp_path / "day.parquet")
    task = {"map": str(tmp_path / "stef"), "kind": "stef", "options": OPTIONS, "dataset": DATASET,
            "tracks": [str(tmp_path / "day.parquet")], "max_tracks": 25}  # fmt: skip
    cells = table.num_rows // 8
    assert [row[0] for row in measure(task)["growth"]["M"]] == [cells * copies for copies in (1, 2, 4, 8, 16)]


def test_a_map_is_copied_until_it_is_as_wide_as_maps_may_be(tmp_path, monkeypatch):
    table = cliff.build(people(60))
    write_parquet(table, tmp_path / "cliff.parquet")
    write_tracks(people(20), tmp_path / "day.parquet")
    task = {"map": str(tmp_path / "cliff.parquet"), "kind": "cliff", "options": OPTIONS, "dataset": DATASET,
            "tracks": [str(tmp_path / "day.parquet")], "max_tracks": 25}  # fmt: skip
    wide, high = (np.ptp(table[name].to_numpy()) for name in ("x", "y"))
    monkeypatch.setattr("modlhmp.maps.base.MAX_LATTICE", (4 * (wide + 100) + 1) * (high + 1))  # 4 copies, not 8
    assert len(measure(task)["growth"]["M"]) == 3


def test_too_few_people(tmp_path):
    """One track can be measured, its growth has no exponent in N; none at all is said."""
    result = json.loads(run(tmp_path, 1).stdout)
    assert result["tracks"] == 1
    assert np.isnan(result["exponents"]["N"][0])
    done = run(tmp_path, 0)
    assert done.returncode == 1
    assert "hall: no usable test track" in done.stderr
    assert "Traceback" not in done.stderr


def made_up(**changes):
    """A result of the study."""
    growth = {"N": [[1, 1e-3], [2, 2e-3], [4, 4e-3]], "T": [[1, 1e-3, 5], [2, 2e-3, 9]], "M": [[9, 1e-3], [18, 1e-3]]}
    return {
        "tracks": 7, "k": 5, "horizon_s": 60, "repetitions": 5, "seconds_per_track": 1e-4, "latency_s": 2e-3,
        "latency_90th_s": 3e-3, "seconds_per_track_range": [1e-4, 2e-4], "memory_mb": 200.0,
        "memory_of_imports_mb": 150.0, "map_kb": 160.0, "maps": 11, "growth": growth,
        "exponents": {"N": [1.0, 0.9, 1.1], "T": [0.5, 0.4, 0.6], "M": [0.0, -0.1, 0.1]},
        "machine": {"cpu": "a CPU", "cores": 2, "python": "3.11", "numba": "0.60", "numpy": "2.0"}, **changes,
    }  # fmt: skip


def test_figure_holds_the_numbers(tmp_path):
    nothing = [float("nan")] * 3
    other = made_up(exponents={"N": nothing, "T": nothing, "M": nothing})
    draw([made_up(), other], [DATASET, {**DATASET, "name": "own", "label": "own"}], "TC-CLiFF", str(tmp_path / "f"))
    table = pd.read_csv(tmp_path / "f.csv").set_index(["dataset", "quantity"])
    assert table.loc[("hall", "memory_mb"), "value"].item() == 200
    assert table.loc[("own", "seconds against N"), "value"].tolist() == [1e-3, 2e-3, 4e-3]


def test_claims_about_the_runtime():
    """Verdicts by hand: faster, linear in N, slower growth in T and M, less memory, a larger map."""
    one = claims.Evidence(DATASET, [12.0], {}, {}, np.empty(0), frozenset(), made_up())
    table = claims.test_claims([one], {}, {}).set_index("our test")["verdict"]
    assert table["at most 0.11 s a track, k = 5, 60 s (another machine)"] == "supported"
    assert table["the exponent of time in N is 1"] == "supported"
    assert table["the exponent of time in T is 1"] == table["the exponent of time in M is 1"] == "grows more slowly"
    assert (table["273 MB"], table["152 kB"]) == ("ours is smaller", "ours is larger")


def test_the_rate_is_that_of_a_track_alone():
    """What the paper gives; many at once are faster, which is no answer to it."""
    slow = made_up(latency_s=0.2, seconds_per_track=1e-4)
    one = claims.Evidence(DATASET, [12.0], {}, {}, np.empty(0), frozenset(), slow)
    row = (
        claims.test_claims([one], {}, {})
        .set_index("our test")
        .loc["at most 0.11 s a track, k = 5, 60 s (another machine)"]
    )
    assert (row["verdict"], row["measured"]) == ("contradicted", "200 ms")


def test_growth_of_fewer_than_three_sizes_is_not_tested():
    unknown = made_up(exponents={"N": [float("nan")] * 3, "T": [0.5, 0.4, 0.6], "M": [1.2, 1.1, 1.3]})
    one = claims.Evidence(DATASET, [12.0], {}, {}, np.empty(0), frozenset(), unknown)
    table = claims.test_claims([one], {}, {}).set_index("our test")["verdict"]
    verdicts = [table[f"the exponent of time in {name} is 1"] for name in "NTM"]
    assert verdicts == ["not tested", "grows more slowly", "grows faster"]


# --- costs of the ladder ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("number", "expected"), [(4, 4), (10, 10), (13, 13), (25, 25), (26, 25), (500, 25)])
def test_some_tracks_are_so_many(number, expected):
    """Of 10 and 15 people; never more than asked for, all if there are fewer."""
    some = some_tracks([people(10), people(15)], DATASET, number)
    assert len(usable_tracks(some, DATASET["observed_rows"])) == expected
    assert len(np.unique(some.track_id)) == expected


def test_some_tracks_are_whole_and_the_first():
    """Those of the first recording, in their order, then the next one's; who is too short to forecast is not timed."""
    first, second = people(10), people(15)
    short = np.isin(first.track_id, [1, 4]) & (np.tile(np.arange(20), 10) >= 4)
    some = some_tracks([first.take(~short), second], DATASET, 12)
    for name in ("t", "x", "y"):
        expected = [getattr(first, name)[~np.isin(first.track_id, [1, 4])], getattr(second, name)[: 4 * 20]]
        np.testing.assert_array_equal(getattr(some, name), np.concatenate(expected))


def test_people_of_two_recordings_stay_two_people():
    """Ids start at 0 in both: nobody's track becomes part of another's."""
    some = some_tracks([people(3), people(3), people(3)], DATASET)
    assert len(np.unique(some.track_id)) == 9
    assert (np.diff(some.bounds()) == 20).all()


def test_recordings_that_are_not_needed_are_not_read():
    """They are read one by one."""

    def recordings():
        yield people(5)
        raise AssertionError("enough were found")

    assert len(np.unique(some_tracks(recordings(), DATASET, 5).track_id)) == 5


def test_a_cost_is_a_time_of_one_track(tmp_path):
    """Positive and finite, of a method with a map and of one without."""
    write_parquet(cliff.build(people(60)), tmp_path / "cliff.parquet")
    options = {**OPTIONS, "velocity": "columns", "output": "ranked", "exits": False}
    for kind, path in (("cliff", tmp_path / "cliff.parquet"), ("cvm", None)):
        forecaster = make_forecaster(kind, options, DATASET, path)
        cost = milliseconds_a_track(forecaster, people(8), DATASET, 3)
        assert 0 < cost < np.inf


def test_a_cost_is_shared_among_the_tracks(monkeypatch):
    """With a clock that says 2 s for every run: 250 ms for each of 8 people; the first run, which compiles, is free."""
    calls = []

    def forecaster(observed, steps, keys):
        calls.append((len(observed.track_id), keys.shape[1]))
        return make_forecaster("cvm", {"velocity": "columns"}, DATASET)(observed, steps, keys)

    ticks = iter(range(0, 1000, 2))
    monkeypatch.setattr("time.perf_counter", lambda: float(next(ticks)))
    assert milliseconds_a_track(forecaster, people(8), DATASET, 3) == pytest.approx(250)
    assert calls == [(8, 3)] * (1 + REPETITIONS)


def test_nobody_to_forecast_has_no_cost():
    """Neither a crash nor a number, where no test track is usable."""
    forecaster = make_forecaster("cvm", {"velocity": "columns"}, DATASET)
    nobody = some_tracks([people(3, rows=4), empty_tracks()], DATASET)
    assert np.isnan(milliseconds_a_track(forecaster, nobody, DATASET, 1))
