"""Scoring: truth, errors, both protocols, statistics and tests against loops, and design examples by hand."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
import twins
from hypothesis import given, settings
from hypothesis import strategies as st

from modlhmp.floor_plan import OCCUPIED, FloorPlan, occupied_depth
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import read_forecasts, write_forecasts
from modlhmp.scoring.errors import displacement_errors, enters_occupied, ground_truth, is_idle
from modlhmp.scoring.horizons import scored_horizons
from modlhmp.scoring.protocols import PROTOCOLS, score
from modlhmp.scoring.recording import score_recording
from modlhmp.site import IdleFilter, PaperProtocol, Site
from modlhmp.storage import read_metadata, write_parquet, write_pieces
from modlhmp.study.summary import Errors, at_horizons, at_own_length, main_output, read_errors, summarise
from modlhmp.tracks import Tracks, concatenate, empty_tracks, usable_tracks

FEW = settings(max_examples=30, deadline=None, derandomize=True)
SEEDS = st.integers(0, 10**6)
STEPS = 12
SITE = Site(
    observed_rows=4, horizon_s=float(STEPS), time_step_s=1.0, timezone="Asia/Tokyo",
    paper_protocol=PaperProtocol(idle_filter=IdleFilter(rows=5, min_displacement_m=1.0)),
)  # fmt: skip


def track(rng, person, rows, step_s=1.0, jitter=0.03, speed=1.2):
    """A random walk of one person; clocks jitter as the sensors' do."""
    t = 1.9e9 + rng.uniform(0, 1000) + np.arange(rows) * step_s + rng.uniform(-jitter, jitter, rows)
    heading = np.cumsum(rng.normal(0, 0.4, rows))
    pace = speed * step_s * (rng.random(rows) < 0.9)
    x, y = rng.uniform(-20, 20, 2)[:, None] + np.cumsum([pace * np.cos(heading), pace * np.sin(heading)], axis=1)
    return Tracks(np.full(rows, person), t, x, y, np.full(rows, speed), heading)


def recording(rng, tracks=8, longest=25, step_s=1.0):
    """Tracks of random length; some are too short, some end within the horizon, every fourth one hardly moves."""

    def rows(n):
        return 4 if n == 0 else int(rng.integers(5 if n < 4 else 2, longest))

    return concatenate(track(rng, 100 + n, rows(n), step_s, speed=0.1 if n % 4 == 3 else 1.2) for n in range(tracks))


def random_forecast(rng, truth, k=3, output="ranked"):
    """Futures near the truth with random fitness, held and frozen from a random step on."""
    n, steps, _ = truth.shape
    xy = (np.nan_to_num(truth)[:, None] + rng.normal(0, 2, (n, k, steps, 2))).astype(np.float32)
    fitness = np.cumsum(rng.normal(-1, 1, (n, k, steps)), axis=-1).astype(np.float32)
    alive = rng.choice([0, 2, 5, steps, steps], (n, k)).astype(np.int32)
    for i, j in np.ndindex(n, k):
        held = alive[i, j]
        xy[i, j, held:] = xy[i, j, held - 1] if held else (7.0, 7.0)
        fitness[i, j, held:] = fitness[i, j, held - 1] if held else 0.0
    return Forecast(xy, fitness, alive, output)


# --- truth and errors ---------------------------------------------------------------------------------------


@FEW
@given(SEEDS, st.sampled_from([1.0, 0.4]))
def test_ground_truth_equals_the_loop(seed, step_s):
    rng = np.random.default_rng(seed)
    tracks = recording(rng, step_s=step_s)
    rows = usable_tracks(tracks, 4)
    xy, length = ground_truth(tracks, rows, 4, STEPS, step_s)
    assert xy.shape == (len(rows), STEPS, 2)
    for n, (first, last) in enumerate(rows):
        one = tracks.take(slice(first, last + 1))
        expected, steps = twins.ground_truth(one.t, one.x, one.y, 4, STEPS, step_s)
        assert length[n] == steps
        for got, at in zip(xy[n], expected, strict=True):
            np.testing.assert_allclose(got, (np.nan, np.nan) if at is None else at, atol=1e-6)


@pytest.mark.parametrize(
    ("end", "length"), [(6.94, 3), (6.96, 4), (7.0, 4), (7.94, 4), (3.5, 0), (3.96, 1), (30.0, 27)]
)
def test_clock_jitter_does_not_cost_the_last_step(end, length):
    t = np.array([0.0, 1.0, 2.0, 3.0, end])
    line = Tracks(np.ones(5, int), t, t.copy(), np.zeros(5), np.ones(5), np.zeros(5))
    xy, got = ground_truth(line, np.array([[0, 4]]), 4, 5)
    assert got.tolist() == [length]
    expected = [min(3.0 + h, end) if h <= length else np.nan for h in range(1, 6)]
    np.testing.assert_allclose(xy[0, :, 0], expected, atol=1e-9)


@FEW
@given(SEEDS)
def test_displacement_errors_equal_the_loop(seed):
    rng = np.random.default_rng(seed)
    truth = rng.normal(0, 5, (3, STEPS, 2))
    xy = rng.normal(0, 5, (3, 2, STEPS, 2))
    truth[1, 7:] = np.nan
    ade, fde = displacement_errors(xy, truth)
    for n, k, step in np.ndindex(3, 2, STEPS):
        if n == 1 and step >= 7:
            assert np.isnan(ade[n, k, step])
            assert np.isnan(fde[n, k, step])
        else:
            expected = twins.errors_at(xy[n, k], truth[n], step + 1)
            np.testing.assert_allclose((ade[n, k, step], fde[n, k, step]), expected, rtol=1e-12)


@FEW
@given(SEEDS, st.integers(1, 8), st.sampled_from([0.3, 1.0, 3.0]))
def test_idle_filter_equals_the_loop(seed, apart, displacement):
    rng = np.random.default_rng(seed)
    tracks = concatenate(track(rng, n, int(rng.integers(1, 14)), speed=rng.choice([0.1, 0.5, 1.5])) for n in range(10))
    bounds = tracks.bounds()
    rows = np.column_stack([bounds[:-1], bounds[1:] - 1])
    expected = []
    for first, last in rows:
        one = tracks.take(slice(first, last + 1))
        expected.append(twins.is_idle(one.x, one.y, apart, displacement))
    assert is_idle(tracks, rows, apart, displacement).tolist() == expected


def test_idle_filter_by_hand():
    x = np.array([0, 1, 2, 3, 4, 4.5, 4.8, 4.9, 4.9, 4.9, 4.9, 4.9])  # stands still at the end only
    table = Tracks(np.repeat([1, 2], [12, 5]), np.arange(17.0), np.append(x, np.zeros(5)), *np.zeros((3, 17)))
    rows = np.array([[0, 11], [12, 16]])
    assert is_idle(table, rows).tolist() == [True, False]  # five rows have no pair five apart
    assert is_idle(table, rows, apart=8).tolist() == [False, False]
    assert is_idle(table, np.array([[0, 8]])).tolist() == [False]  # |x[8] - x[3]| = 1.9
    assert is_idle(table, np.array([[0, 10]])).tolist() == [True]  # |x[9] - x[4]| = 0.9


# --- protocols ----------------------------------------------------------------------------------------------


@FEW
@given(SEEDS, st.sampled_from(["ranked", "mean", "single"]))
def test_score_equals_the_loop(seed, output):
    rng = np.random.default_rng(seed)
    n, k = 5, 1 if output == "single" else 4
    truth = rng.normal(0, 5, (n, STEPS, 2))
    length = rng.integers(0, STEPS + 5, n)
    truth[np.arange(1, STEPS + 1) > length[:, None]] = np.nan
    forecast = random_forecast(rng, truth, k, output)
    eligible = {"paper": np.where(rng.random(n) < 0.3, 0, length), "complete": length}
    got = score(forecast, truth, eligible)
    outputs = {"ranked": {"ranked", "mean"}, "mean": {"mean", "mean_path"}, "single": {"single"}}[output]
    assert set(got) == {(name, protocol) for name in outputs for protocol in PROTOCOLS}
    for (name, protocol), values in got.items():
        ade, fde = values["ade"], values["fde"]
        for i, step in np.ndindex(n, STEPS):
            futures = forecast.xy[i], forecast.log_fitness[i], forecast.steps_alive[i]
            expected = twins.score(protocol, name, *futures, truth[i], eligible[protocol][i], step + 1)
            np.testing.assert_allclose((ade[i, step], fde[i, step]), expected or (np.nan, np.nan), rtol=1e-6)


@FEW
@given(SEEDS)
def test_protocols_agree_where_everyone_is_alive(seed):
    rng = np.random.default_rng(seed)
    truth = rng.normal(0, 5, (6, STEPS, 2))
    forecast = random_forecast(rng, truth)
    forecast = forecast._replace(steps_alive=np.full((6, 3), STEPS, np.int32))
    length = np.full(6, STEPS)
    got = score(forecast, truth, {"paper": length, "complete": length})
    for output in ("ranked", "mean"):
        for metric, paper in got[output, "paper"].items():
            np.testing.assert_array_equal(paper, got[output, "complete"][metric])
            assert np.isfinite(paper).all()


def design_example(tmp_path, alive):
    """Errors of the worked example: truth of 12 s along x, two futures that are off by 1 m and by 2 m in y.

    The first is the better ranked. The horizon is 20 s.
    """
    t = 1.9e9 + np.arange(16.0)  # t0 is the fourth row, then 12 s
    walk = Tracks(np.full(16, 7), t, np.arange(16.0), np.zeros(16), np.ones(16), np.zeros(16))
    site = replace(SITE, horizon_s=20.0)
    steps = np.arange(1, 21)
    x = 3.0 + np.minimum(steps, np.array(alive)[:, None])  # held after the last alive step
    y = np.broadcast_to([[1.0], [2.0]], (2, 20))
    fitness = np.minimum(steps, np.array(alive)[:, None]) * np.array([[-0.1], [-0.5]])
    forecast = Forecast(np.stack([x, y], -1)[None].astype(np.float32), fitness[None].astype(np.float32),
                        np.array([alive], np.int32), "ranked")  # fmt: skip
    table = score_recording(walk, [(0, np.array([7]), forecast)], "day", site)
    write_parquet(table, tmp_path / "errors.parquet")
    errors = read_errors(tmp_path / "errors.parquet")
    rows = summarise("d", "m", errors, 1.0).set_index(["output", "protocol", "horizon_s"])
    return errors, rows


def test_design_example_with_one_future_alive(tmp_path):
    errors, rows = design_example(tmp_path, [9, 12])
    paper, complete = errors["ranked", "paper"], errors["ranked", "complete"]
    assert paper.fde[0, 0, 4] == pytest.approx(1.0)  # 5 s: both alive, the better ranked
    assert complete.fde[0, 0, 4] == pytest.approx(1.0)
    assert paper.fde[0, 0, 8] == pytest.approx(1.0)  # 9 s: alive still
    assert paper.fde[0, 0, 9] == pytest.approx(2.0)  # 10 s: only the second
    assert complete.fde[0, 0, 9] == pytest.approx(2.0)
    assert paper.ade[0, 0, 9] == pytest.approx(2.0)
    for h, there in ((12, 1), (13, 0), (20, 0)):  # the truth ends at 12 s
        assert tuple(rows.loc[("ranked", "paper", h), ["n", "eligible"]]) == (there, there)
        assert tuple(rows.loc[("ranked", "complete", h), ["n", "eligible"]]) == (there, there)


def test_design_example_with_no_future_alive(tmp_path):
    errors, rows = design_example(tmp_path, [9, 7])
    assert errors["ranked", "paper"].fde[0, 0, 4] == pytest.approx(1.0)
    assert np.isnan(errors["ranked", "paper"].fde[0, 0, 9])
    assert tuple(rows.loc[("ranked", "paper", 10.0), ["n", "eligible"]]) == (0, 1)
    assert math.isnan(rows.loc[("ranked", "paper", 10.0), "ade_m"])
    held = errors["ranked", "complete"]  # the first, held from second 9: 1 m behind at 10 s, and 1 m aside
    assert held.fde[0, 0, 9] == pytest.approx(math.sqrt(2))
    assert held.ade[0, 0, 9] == pytest.approx((9 * 1.0 + math.sqrt(2)) / 10)
    assert held.fde[0, 0, 11] == pytest.approx(math.sqrt(10))
    assert tuple(rows.loc[("ranked", "complete", 10.0), ["n", "eligible"]]) == (1, 1)
    mean = errors["mean", "complete"]  # of both: the second has been held since second 7
    assert mean.fde[0, 0, 9] == pytest.approx((math.sqrt(1 + 1) + math.sqrt(9 + 4)) / 2)
    assert np.isnan(errors["mean", "paper"].fde[0, 0, 9])


def test_ties_go_to_the_first_future():
    truth = np.zeros((1, 2, 2))
    xy = np.array([[[[1.0, 0], [1, 0]], [[2, 0], [2, 0]]]], np.float32)
    forecast = Forecast(xy, np.zeros((1, 2, 2), np.float32), np.full((1, 2), 2, np.int32), "ranked")
    both = {"paper": np.array([2]), "complete": np.array([2])}
    assert score(forecast, truth, both)["ranked", "paper"]["fde"].tolist() == [[1.0, 1.0]]


# --- scoring a recording ------------------------------------------------------------------------------------


def forecasts_of(tracks, seeds=(0, 1), k=3, output="ranked"):
    """Random forecasts of the usable tracks; each track's depend on the seed and the track only."""
    rows = usable_tracks(tracks, 4)
    truth, _ = ground_truth(tracks, rows, 4, STEPS)
    ids = tracks.track_id[rows[:, 0]]
    for seed in seeds:
        each = [random_forecast(np.random.default_rng([seed, i]), truth[n : n + 1], k) for n, i in enumerate(ids)]
        parts = [np.concatenate(part) for part in zip(*(one[:3] for one in each), strict=True)]
        yield seed, ids, Forecast(*parts, output)


def test_recording_is_scored_track_by_track():
    tracks = recording(np.random.default_rng(1), tracks=20)
    rows = usable_tracks(tracks, 4)
    assert 5 < len(rows) < 20
    table = score_recording(tracks, forecasts_of(tracks), "day", SITE).to_pandas()
    assert len(table) == len(rows) * 2 * 4  # seeds; outputs and protocols
    forecasts = {seed: forecast for seed, _, forecast in forecasts_of(tracks)}
    seen = set()
    for line in table.itertuples():
        n = int(np.flatnonzero(tracks.track_id[rows[:, 0]] == line.track_id)[0])
        one = tracks.take(slice(rows[n, 0], rows[n, 1] + 1))
        truth, length = twins.ground_truth(one.t, one.x, one.y, 4, STEPS, 1.0)
        idle = twins.is_idle(one.x, one.y, 5, 1.0)
        eligible = 0 if idle and line.protocol == "paper" else length
        futures = [part[n] for part in forecasts[line.seed][:3]]
        expected = [
            twins.score(line.protocol, line.output, *futures, truth, eligible, h) or (np.nan, np.nan)
            for h in range(1, STEPS + 1)
        ]
        np.testing.assert_allclose(np.column_stack([line.ade, line.fde]), expected, rtol=1e-5, atol=1e-6)
        assert line.eligible_steps == min(eligible, STEPS)
        assert line.scored_steps == np.isfinite(np.array(expected)[:, 0]).sum()
        reason = "no dynamics" if line.scored_steps < line.eligible_steps else ""
        assert line.why_not == ("idle" if idle and line.protocol == "paper" else reason)
        seen.add(line.why_not)
    assert seen == {"", "idle", "no dynamics"}


def test_every_eligible_track_is_scored_in_the_complete_protocol():
    tracks = recording(np.random.default_rng(2), tracks=30)
    table = score_recording(tracks, forecasts_of(tracks), "day", SITE).to_pandas()
    complete = table[table["protocol"] == "complete"]
    assert (complete["scored_steps"] == complete["eligible_steps"]).all()
    paper = table[table["protocol"] == "paper"]
    assert (paper["scored_steps"] < paper["eligible_steps"]).any()


def test_without_idle_filter_nobody_is_idle():
    tracks = recording(np.random.default_rng(3), tracks=20)
    site = replace(SITE, paper_protocol=PaperProtocol(idle_filter=None))
    table = score_recording(tracks, forecasts_of(tracks), "day", site).to_pandas()
    assert "idle" not in set(table["why_not"])
    by_protocol = {p: table[table["protocol"] == p].reset_index()["eligible_steps"] for p in PROTOCOLS}
    assert by_protocol["paper"].equals(by_protocol["complete"])


def test_hour_is_the_clock_hour_of_t0():
    t = 1917129600.0 + 3 * 3600 - 3.0 + np.arange(10)  # t0, the fourth row, is 03:00:00 UTC: noon in Japan
    walk = Tracks(np.full(10, 5), t, np.arange(10.0), np.zeros(10), np.ones(10), np.zeros(10))
    table = score_recording(walk, forecasts_of(walk), "day", SITE)
    assert set(table["hour"].to_pylist()) == {12}


def test_forecasts_of_other_tracks_are_refused():
    tracks = recording(np.random.default_rng(4), tracks=10)
    other = tracks._replace(track_id=tracks.track_id + 1)
    with pytest.raises(ValueError, match="other tracks"):
        score_recording(tracks, forecasts_of(other), "day", SITE)


@pytest.mark.parametrize("sizes", [(3, 3, 2), (1, 7), (8,)])
def test_forecasts_may_come_a_few_tracks_after_the_other(sizes):
    tracks = recording(np.random.default_rng(21), tracks=9)
    whole = list(forecasts_of(tracks, seeds=(0, 1)))
    assert len(whole[0][1]) == sum(sizes)
    edges = np.cumsum((0, *sizes))
    blocks = [
        (seed, ids[a:b], Forecast(*(part[a:b] for part in forecast[:3]), forecast.output))
        for seed, ids, forecast in whole
        for a, b in pairwise(edges)
    ]
    key = ["output", "protocol", "seed", "track_id"]
    got, expected = (
        score_recording(tracks, some, "day", SITE).to_pandas().sort_values(key, ignore_index=True)
        for some in (blocks, whole)
    )
    pd.testing.assert_frame_equal(got, expected)
    if len(sizes) > 1:
        with pytest.raises(ValueError, match="fewer tracks"):
            score_recording(tracks, blocks[:-1], "day", SITE)


@pytest.mark.parametrize("rows", [0, 1, 4])
def test_recording_without_a_usable_track_is_scored_as_empty(tmp_path, rows):
    tracks = track(np.random.default_rng(5), 1, rows) if rows else empty_tracks()
    nobody = Forecast(np.empty((0, 3, STEPS, 2), np.float32), np.empty((0, 3, STEPS), np.float32),
                      np.empty((0, 3), np.int32), "ranked")  # fmt: skip
    write_forecasts(tmp_path / "f.parquet", [(seed, np.empty(0, np.int64), nobody) for seed in (0, 1)])
    table = score_recording(tracks, read_forecasts(tmp_path / "f.parquet"), "day", SITE)
    assert table.num_rows == 0
    full = recording(np.random.default_rng(6))
    whole = score_recording(full, forecasts_of(full), "other", SITE)
    assert pa.concat_tables([table, whole]).unify_dictionaries().num_rows == whole.num_rows  # as all days are joined


# --- errors files and summary -------------------------------------------------------------------------------


def errors_table(seeds=(0, 1, 2)):
    """Errors of two recordings that share track ids."""
    days = {name: recording(np.random.default_rng(n), tracks=12) for n, name in enumerate(("day1", "day2"), 7)}
    return [score_recording(tracks, forecasts_of(tracks, seeds), name, SITE) for name, tracks in days.items()]


def saved(tables, path):
    """What `read_errors` makes of the tables written as one file."""
    write_parquet(pa.concat_tables(tables).unify_dictionaries(), path)
    return read_errors(path)


def test_a_file_in_pieces_is_read_as_one(tables, errors, tmp_path):
    whole = pa.concat_tables(tables)
    write_pieces([whole.slice(n, 17) for n in range(0, len(whole), 17)], tmp_path / "errors.parquet")
    pieces = read_errors(tmp_path / "errors.parquet")
    assert pieces.keys() == errors.keys()
    for key, one in errors.items():
        for part, other in zip(pieces[key], one, strict=True):
            np.testing.assert_array_equal(part, other)


def test_errors_at_horizons_keep_the_seeds(tables, errors, tmp_path):
    write_parquet(pa.concat_tables(tables).unify_dictionaries(), tmp_path / "errors.parquet")
    found = at_horizons(tmp_path / "errors.parquet", [2.0, 7.0], 1.0)
    for key, one in errors.items():
        for metric in ("ade", "fde"):
            np.testing.assert_array_equal(getattr(found[key], metric), getattr(one, metric)[:, :, [1, 6]])
        np.testing.assert_array_equal(found[key].eligible_steps, one.eligible_steps)


@pytest.fixture(scope="module")
def tables():
    return errors_table()


@pytest.fixture(scope="module")
def errors(tables, tmp_path_factory):
    return saved(tables, tmp_path_factory.mktemp("errors") / "errors.parquet")


def test_errors_file_is_read_as_written(tables, errors):
    rows = pd.concat([table.to_pandas() for table in tables])
    assert set(errors) == {(o, p) for o in ("ranked", "mean") for p in PROTOCOLS}
    seen = 0
    for line in rows.itertuples():
        one = errors[line.output, line.protocol]
        n = one.keys.tolist().index(f"{line.recording}/{line.track_id}")
        np.testing.assert_array_equal(one.ade[line.seed, n], line.ade)
        np.testing.assert_array_equal(one.fde[line.seed, n], line.fde)
        assert one.eligible_steps[n] == line.eligible_steps
        seen += 1
    assert seen == sum(one.ade.shape[0] * one.ade.shape[1] for one in errors.values())
    assert np.isnan(errors["ranked", "paper"].ade).any()


def test_summary_equals_the_loop(errors):
    summary = summarise("hall", "cliff", errors, 0.5)
    assert len(summary) == 4 * STEPS
    for line in summary.itertuples():
        one = errors[line.output, line.protocol]
        step = round(line.horizon_s / 0.5) - 1
        by_seed = {
            m: [[v for v in seed if not math.isnan(v)] for seed in getattr(one, m)[:, :, step]] for m in ("ade", "fde")
        }
        for metric, got_mean, got_sd in (("ade", line.ade_m, line.ade_sd_m), ("fde", line.fde_m, line.fde_sd_m)):
            assert got_mean == pytest.approx(twins.mean([twins.mean(s) for s in by_seed[metric] if s]), nan_ok=True)
            tracks = [[v for v in values if not math.isnan(v)] for values in getattr(one, metric)[:, :, step].T]
            per_track = [twins.mean(values) for values in tracks if values]
            assert got_sd == pytest.approx(twins.deviation(per_track), nan_ok=True)
            by_all = [twins.mean(values) for values in tracks if len(values) == len(one.ade)]
            assert getattr(line, f"all_{metric}_m") == pytest.approx(twins.mean(by_all), nan_ok=True)
            assert line.all_n == len(by_all)
        seed_means = [twins.mean(values) for values in by_seed["ade"] if values]
        assert line.ade_seed_sd_m == pytest.approx(twins.deviation(seed_means), nan_ok=True)
        assert line.n == pytest.approx(twins.mean([len(values) for values in by_seed["ade"]]))
        assert line.eligible == sum(steps > step for steps in one.eligible_steps)
        assert (line.dataset, line.method, line.seeds) == ("hall", "cliff", 3)


def test_summary_by_hand():
    nan = np.nan
    # two seeds, three tracks, one step; the second track is scored by one seed only, the third by none
    ade = np.array([[[1.0], [5.0], [nan]], [[3.0], [nan], [nan]]])
    one = Errors(
        np.array(["a/1", "a/2", "a/3"]), ade, 2 * ade, np.array([1, 1, 1]), np.zeros(3, bool), np.array(["a"] * 3)
    )
    (line,) = summarise("d", "m", {("ranked", "paper"): one}, 1.0).itertuples()
    assert (line.ade_m, line.fde_m) == (3.0, 6.0)  # the seeds' means are 3 and 3
    assert line.ade_sd_m == pytest.approx(3 / math.sqrt(2))  # of 2 and 5
    assert line.ade_seed_sd_m == pytest.approx(0.0)
    assert (line.n, line.eligible, line.seeds) == (1.5, 3, 2)
    assert (line.all_ade_m, line.all_n) == (2.0, 1)  # the first track only


@FEW
@given(SEEDS)
def test_the_mean_does_not_grow_with_the_number_of_seeds(seed):
    """Each seed scores the easier half of the tracks and some luck: the union over seeds takes in ever harder ones."""
    rng = np.random.default_rng(seed)
    hard = np.sort(rng.gamma(2, 2, 400))
    scored = rng.random((8, 400)) < np.linspace(0.9, 0.05, 400)
    ade = np.where(scored, hard, np.nan)[:, :, None]
    few, many = (
        summarise("d", "m", {("ranked", "paper"): Errors(np.arange(400).astype(str), ade[:k], ade[:k],
                  np.ones(400, int), np.zeros(400, bool), np.arange(400).astype(str))}, 1.0)
        for k in (2, 8)
    )  # fmt: skip
    assert many["ade_m"].item() == pytest.approx(few["ade_m"].item(), rel=0.1)
    union = np.nanmean(np.nanmean(ade[:, :, 0][:, scored.any(axis=0)], axis=0))
    assert union > 1.15 * many["ade_m"].item()


def test_order_of_tracks_recordings_and_shards_does_not_matter(tables, errors, tmp_path):
    shuffled = pa.concat_tables(tables[::-1]).unify_dictionaries()
    shuffled = shuffled.take(np.random.default_rng(9).permutation(shuffled.num_rows))
    shards = [shuffled.slice(0, 31), shuffled.slice(31)]
    again = saved(shards[::-1], tmp_path / "errors.parquet")
    assert set(again) == set(errors)
    for key, one in errors.items():
        for part, other in zip(one, again[key], strict=True):
            np.testing.assert_array_equal(part, other)
    pd.testing.assert_frame_equal(summarise("d", "m", again, 1.0), summarise("d", "m", errors, 1.0))


def test_order_of_the_tracks_in_a_recording_does_not_matter():
    tracks = recording(np.random.default_rng(10), tracks=12)
    persons = np.unique(tracks.track_id)
    rows = {person: tracks.take(tracks.track_id == person) for person in persons}
    order = np.random.default_rng(10).permutation(persons)
    mixed = concatenate(rows[person] for person in order)
    keys = ["track_id", "seed", "output", "protocol"]

    def table(recorded):
        scored = score_recording(recorded, forecasts_of(recorded), "day", SITE).to_pandas()
        return scored.astype(dict.fromkeys(keys, str)).sort_values(keys).reset_index(drop=True)

    one, other = table(tracks), table(mixed)
    pd.testing.assert_frame_equal(one.drop(columns=["ade", "fde"]), other.drop(columns=["ade", "fde"]))
    for metric in ("ade", "fde"):
        # Tracks are interpolated on a common axis, whose rounding depends on what was laid before: 1e-6 m.
        np.testing.assert_allclose(np.stack(other[metric]), np.stack(one[metric]), atol=1e-6)


# --- own lengths -----------------------------------------------------------------------------------------------


def test_own_length_by_hand():
    """Lengths 0, 2 and 9 steps: no value, the second step's from then on, and always the horizon's own."""
    values = np.arange(12.0).reshape(3, 4)
    got = at_own_length(values, np.array([0, 2, 9]))
    np.testing.assert_array_equal(got, [[np.nan] * 4, [4, 5, 5, 5], [8, 9, 10, 11]])


def test_infeasible_equals_the_loop():
    """Paths through a wall of 2 m: in it, beside it, started in it; held to the slow plain rule at every step."""
    cells = np.zeros((40, 40), np.uint8)
    cells[:, 20:30] = OCCUPIED  # x from 4 m to 6 m
    plan = FloorPlan(cells, 0.2, (0.0, 0.0), 0.0)
    depth = occupied_depth(plan)
    rng = np.random.default_rng(3)
    start = np.column_stack([rng.uniform(0, 8, 30), rng.uniform(1, 7, 30)])
    xy = start[:, None, None] + np.cumsum(rng.normal(0, 1, (30, 3, 8, 2)), axis=2)
    got = enters_occupied(plan, depth, start, xy)

    def deep(x, y):
        """In a cell whose centre is at least 0.3 m from each side of the wall; it ends with the plan."""
        across, along = ((np.floor(v / 0.2) + 0.5) * 0.2 for v in (x, y))
        return min(across - 4, 6 - across, along, 8 - along) >= 0.3 - 1e-6

    for i, k in np.ndindex(30, 3):
        visited = [deep(*point) for point in xy[i, k]]
        expected = [any(visited[: h + 1]) and not deep(*start[i]) for h in range(8)]
        assert got[i, k].tolist() == expected
    assert 0.1 < got[..., -1].mean() < 0.9


def test_infeasible_share_stands_beside_the_truth_s(tmp_path):
    """One walker stays in the corridor, the forecast goes through the wall: 1 and 0, at the horizon where it does."""
    cells = np.zeros((20, 20), np.uint8)
    cells[10:] = OCCUPIED  # y from 5 m
    plan = FloorPlan(cells, 0.5, (0.0, 0.0), 0.0)
    t = 1.9e9 + np.arange(STEPS + 4.0)
    walk = Tracks(np.full(len(t), 7), t, np.full(len(t), 2.0), np.full(len(t), 3.0), np.ones(len(t)), np.zeros(len(t)))
    y = 3.0 + np.arange(1, STEPS + 1)  # 0.5 m deep at step 3
    xy = np.stack([np.full(STEPS, 2.0), y], -1)[None, None].astype(np.float32)
    zeros = np.zeros((1, 1, STEPS), np.float32)
    forecast = Forecast(xy, zeros, np.full((1, 1), STEPS, np.int32), "single")
    table = score_recording(walk, [(0, np.array([7]), forecast)], "day", SITE, plan)
    write_parquet(table, tmp_path / "errors.parquet")
    rows = summarise("d", "m", read_errors(tmp_path / "errors.parquet"), 1.0)
    complete = rows[rows["protocol"] == "complete"]
    assert complete["infeasible"].tolist() == [0.0, 0.0] + [1.0] * (STEPS - 2)
    assert (complete["truth_infeasible"] == 0).all()


def test_main_output_is_ranked_before_mean_before_single():
    assert main_output({"mean", "ranked"}) == "ranked"
    assert main_output({"mean", "median"}) == "median"
    assert main_output({"mean"}) == "mean"
    assert main_output({"single"}) == "single"


def test_only_whole_steps_up_to_the_longest_horizon_are_scored():
    site = Site(time_step_s=0.4, horizon_s=8.0)
    assert scored_horizons([0.3, 1, 2, 4, 5, 8, 60], site) == [2, 4, 8]


# --- forecasts files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("output", ["ranked", "single"])
def test_forecasts_are_read_as_written(tmp_path, output):
    tracks = recording(np.random.default_rng(16), tracks=15)
    given_ = list(forecasts_of(tracks, seeds=(3, 0, 12), k=4, output=output))
    write_forecasts(tmp_path / "f.parquet", iter(given_), dataset="hall", method="cliff")
    got = list(read_forecasts(tmp_path / "f.parquet"))
    assert [seed for seed, _, _ in got] == [3, 0, 12]
    for (_, ids, forecast), (_, expected_ids, expected) in zip(got, given_, strict=True):
        np.testing.assert_array_equal(ids, expected_ids)
        assert forecast.output == output
        for part, other in zip(forecast[:3], expected[:3], strict=True):
            assert part.dtype == other.dtype
            np.testing.assert_array_equal(part, other)
    metadata = read_metadata(tmp_path / "f.parquet")
    assert (metadata["dataset"], metadata["method"], metadata["k"], metadata["steps"]) == ("hall", "cliff", 4, STEPS)
    assert [file.name for file in tmp_path.iterdir()] == ["f.parquet"]  # no half-written file is left


def test_failed_write_leaves_no_file(tmp_path):
    tracks = recording(np.random.default_rng(17))

    def interrupted():
        yield next(forecasts_of(tracks))
        raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        write_forecasts(tmp_path / "f.parquet", interrupted())
    assert list(tmp_path.iterdir()) == []
