"""The runtime study, without timing anything: what it counts and what it copies; and what a forecast costs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from job import run_job

from modlhmp.maps import cliff, exits, stef
from modlhmp.methods import Method, make_forecaster
from modlhmp.options import ConstantVelocity, RollOut
from modlhmp.settings import as_plain
from modlhmp.site import Site
from modlhmp.storage import DataError, write_parquet
from modlhmp.study.runtime import REPETITIONS, copied, exponent, measure, milliseconds_per_track, some_tracks
from modlhmp.tracks import Tracks, empty_tracks, usable_tracks, write_tracks

HALL = Site(horizon_s=12.0, velocity="as_recorded", hours=(17, 18))
OPTIONS = RollOut(k=3)


def people(number, rows=20):
    """Walkers with a noisy heading, all within one clock hour."""
    rng = np.random.default_rng(number)
    heading = rng.normal(0, 0.5, (number, rows))
    x, y = (np.cumsum(part(heading), axis=1).ravel() for part in (np.cos, np.sin))
    t = np.tile(1.9e9 + np.arange(rows), number)
    return Tracks(np.repeat(np.arange(number), rows), t, x, y, np.ones(len(t)), heading.ravel())


def task_of(layout, number, kind="tc_cliff"):
    """The task of measuring a kind with so many test people; its map is there already."""
    write_tracks(people(number), layout.tracks("hall", "day"))
    method = Method(name=kind, kind=kind, options=OPTIONS)
    return {"run": layout.run, "root": layout.root, "dataset": {"name": "hall", **as_plain(HALL)},
            "recordings": ["day"], "method": method.plain(), "max_tracks": 25}  # fmt: skip


def run(layout, number):
    """What its job, whose files lie elsewhere than in the working folder, measures for so many test people."""
    write_parquet(cliff.build(people(60), HALL), layout.map_hour("hall", "tc_cliff", 17))  # 1.9e9 is 17:46 UTC
    task = task_of(layout, number)
    del task["root"]
    found, log = layout.runtime("hall"), layout.log("measure_runtime", "hall")
    done = run_job("measure_runtime", input={"exits": []}, output={"it": found}, log={"it": log}, params=task)
    return done, json.loads(Path(found).read_text()) if done.returncode == 0 else None


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
    table = cliff.build(people(60), HALL)
    bigger = copied(table, 4)
    assert bigger.num_rows == 4 * table.num_rows
    assert len(np.unique(bigger["location"])) == 4 * len(np.unique(table["location"]))
    x = np.sort(np.unique(bigger["x"]))
    assert (np.diff(x) >= 99).sum() == 3
    assert bigger.slice(0, table.num_rows).equals(table)


def test_a_measurement(layout):
    """All quantities, with their units; counts exact; the copied maps gave the same forecasts, or it would fail."""
    done, result = run(layout, 40)
    assert result, done.stderr
    assert (result["tracks"], result["k"], result["maps"], result["horizon_s"]) == (25, 3, 1, 12.0)
    assert result["map_kb"] == pytest.approx(Path(layout.map_hour("hall", "tc_cliff", 17)).stat().st_size / 1000)
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


def test_a_stef_map_is_measured_alike(layout):
    table = stef.build(people(60), HALL)
    write_parquet(stef.evaluate(table, stef.middle_of_hour(17)), layout.map_hour("hall", "stef", 17))
    cells = table.num_rows // 8
    assert [row[0] for row in measure(task_of(layout, 20, "stef"))["growth"]["M"]] == [
        cells * copies for copies in (1, 2, 4, 8, 16)
    ]


@pytest.mark.parametrize("kind", ["tc_cliff", "stef"])
def test_a_map_by_hours_with_that_of_the_whole_day_grows_alike(layout, kind):
    """Both are copied; the hours' files alone are the map's size."""
    whole = cliff.build(people(60), HALL) if kind == "tc_cliff" else stef.build(people(60), HALL)
    hour = whole if kind == "tc_cliff" else stef.evaluate(whole, stef.middle_of_hour(17))
    write_parquet(hour, layout.map_hour("hall", kind, 17))
    write_parquet(whole, Path(layout.map_hour("hall", kind, 17)).with_name("day.parquet"))
    task = task_of(layout, 20, kind)
    uses = Method(name=kind, kind=kind, options=replace(OPTIONS, without_map="whole_day"))
    found, alone = measure({**task, "method": uses.plain()}), measure(task)
    assert len(found["growth"]["M"]) == 5 and np.isfinite(found["exponents"]["M"][0])
    assert (found["maps"], found["map_kb"]) == (alone["maps"], alone["map_kb"])


def test_a_copy_that_cannot_be_loaded_is_an_error(layout, monkeypatch):
    """It is none of the too large maps that end the measurement."""
    write_parquet(cliff.build(people(60), HALL), layout.map("hall", "cliff"))
    monkeypatch.setattr("modlhmp.study.runtime.copied", lambda table, copies: table.drop_columns(["weight"]))
    with pytest.raises(DataError, match="not a CLiFF-map, no column weight"):
        measure(task_of(layout, 20, "cliff"))


def test_ways_out_are_measured_with_the_method_that_uses_them(layout):
    """Its particles leave, so fewer steps are lived; copies out of reach are left alike, or it would fail."""
    write_parquet(cliff.build(people(60), HALL), layout.map("hall", "cliff"))
    write_parquet(exits.build(people(60, rows=3), HALL), layout.map("hall", "exits"))
    task, uses = task_of(layout, 20, "cliff"), Method(name="cliff", kind="cliff", options=replace(OPTIONS, exits=True))
    with_ways_out = {**task, "method": uses.plain(), "exits": layout.map("hall", "exits")}
    stays, leaves = (measure(one)["growth"]["T"][-1][2] for one in (task, with_ways_out))
    assert 0 < leaves < 0.8 * stays


def test_a_map_is_copied_until_it_is_as_wide_as_maps_may_be(layout, monkeypatch):
    table = cliff.build(people(60), HALL)
    write_parquet(table, layout.map("hall", "cliff"))
    wide, high = (np.ptp(table[name].to_numpy()) for name in ("x", "y"))
    monkeypatch.setattr("modlhmp.maps.base.MAX_LATTICE", (4 * (wide + 100) + 1) * (high + 1))  # 4 copies, not 8
    assert len(measure(task_of(layout, 20, "cliff"))["growth"]["M"]) == 3


def test_too_few_people(layout):
    """One track can be measured, its growth has no exponent in N; none at all is said."""
    _, result = run(layout, 1)
    assert result["tracks"] == 1
    assert np.isnan(result["exponents"]["N"][0])
    done, _ = run(layout, 0)
    assert done.returncode == 1
    assert "hall: no usable test track" in done.stderr
    assert "Traceback" not in done.stderr


# --- costs of the ladder ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("number", "expected"), [(4, 4), (10, 10), (13, 13), (25, 25), (26, 25), (500, 25)])
def test_some_tracks_are_so_many(number, expected):
    """Of 10 and 15 people; never more than asked for, all if there are fewer."""
    some = some_tracks([people(10), people(15)], HALL, number)
    assert len(usable_tracks(some, HALL.observed_rows)) == expected
    assert len(np.unique(some.track_id)) == expected


def test_some_tracks_are_whole_and_the_first():
    """Those of the first recording, in their order, then the next one's; who is too short to forecast is not timed."""
    first, second = people(10), people(15)
    short = np.isin(first.track_id, [1, 4]) & (np.tile(np.arange(20), 10) >= 4)
    some = some_tracks([first.take(~short), second], HALL, 12)
    for name in ("t", "x", "y"):
        expected = [getattr(first, name)[~np.isin(first.track_id, [1, 4])], getattr(second, name)[: 4 * 20]]
        np.testing.assert_array_equal(getattr(some, name), np.concatenate(expected))


def test_people_of_two_recordings_stay_two_people():
    """Ids start at 0 in both: nobody's track becomes part of another's."""
    some = some_tracks([people(3), people(3), people(3)], HALL)
    assert len(np.unique(some.track_id)) == 9
    assert (np.diff(some.bounds()) == 20).all()


def test_recordings_that_are_not_needed_are_not_read():
    """They are read one by one."""

    def recordings():
        yield people(5)
        raise AssertionError("enough were found")

    assert len(np.unique(some_tracks(recordings(), HALL, 5).track_id)) == 5


def test_a_cost_is_a_time_of_one_track(tmp_path):
    """Positive and finite, of a method with a map and of one without."""
    write_parquet(cliff.build(people(60), HALL), tmp_path / "cliff.parquet")
    for kind, options, path in (("cliff", OPTIONS, tmp_path / "cliff.parquet"), ("cvm", ConstantVelocity(), None)):
        forecaster = make_forecaster(kind, options, HALL, path)
        cost = milliseconds_per_track(forecaster, people(8), "hall", HALL, 3)
        assert 0 < cost < np.inf


def test_a_cost_is_shared_among_the_tracks(monkeypatch):
    """With a clock that says 2 s for every run: 250 ms for each of 8 people; the first run, which compiles, is free."""
    calls = []

    def forecaster(observed, steps, keys):
        calls.append((len(observed.track_id), keys.shape[1]))
        return make_forecaster("cvm", ConstantVelocity(), HALL)(observed, steps, keys)

    ticks = iter(range(0, 1000, 2))
    monkeypatch.setattr("time.perf_counter", lambda: float(next(ticks)))
    assert milliseconds_per_track(forecaster, people(8), "hall", HALL, 3) == pytest.approx(250)
    assert calls == [(8, 3)] * (1 + REPETITIONS)


def test_nobody_to_forecast_has_no_cost():
    """Neither a crash nor a number, where no test track is usable."""
    forecaster = make_forecaster("cvm", ConstantVelocity(), HALL)
    nobody = some_tracks([people(3, rows=4), empty_tracks()], HALL)
    assert np.isnan(milliseconds_per_track(forecaster, nobody, "hall", HALL, 1))
