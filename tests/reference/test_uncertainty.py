"""Distributions: scores against loops and closed forms, what they expect against planted truth, leaving by hand."""

import math

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.density import density, level_that_holds
from modlhmp.forecasting.median import with_median
from modlhmp.forecasting.medoid import with_medoid
from modlhmp.forecasting.modes import with_modes
from modlhmp.forecasting.outputs import with_output
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.scenes import Scenes
from modlhmp.scoring.protocols import score
from modlhmp.scoring.uncertainty import (
    MEASURES,
    OF_MODES,
    energy_score,
    kde_nll,
    measures,
    own_output,
    repeats,
    samples_of,
    score_samples,
    still_there,
)
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.reliability import calibration, read_uncertainty, reliability, summarise
from modlhmp.tracks import Tracks, concatenate, with_persons

SEEDS = st.integers(0, 10**6)
STEPS = 6
SITE = Site(observed_rows=4, horizon_s=float(STEPS), time_step_s=1.0)


def futures(rng, n=4, m=7, output="ranked", steps=STEPS):
    """Random futures, held from a random step on, with a fitness that is held likewise."""
    xy = np.cumsum(rng.normal(0, 1, (n, m, steps, 2)), axis=2).astype(np.float32)
    fitness = np.cumsum(rng.normal(-1, 1, (n, m, steps)), axis=2).astype(np.float32)
    alive = rng.integers(0, steps + 1, (n, m)).astype(np.int32)
    for i, j in np.ndindex(n, m):
        last = alive[i, j] - 1
        xy[i, j, last + 1 :] = xy[i, j, last] if last >= 0 else 0.0
        fitness[i, j, last + 1 :] = fitness[i, j, last] if last >= 0 else 0.0
    return Forecast(xy, fitness, alive, output)


# --- the distribution ---------------------------------------------------------------------------------------


def test_the_distribution_is_of_the_first_samples_still_there():
    xy = np.arange(5, dtype=np.float32)[None, :, None, None] * np.ones((1, 5, 3, 2), np.float32)
    alive = np.array([[3, 1, 3, 2, 3]], np.int32)
    unlike = np.zeros((1, 5), bool)
    assert still_there(xy, alive, unlike, 3, most=4)[0, :3, 0].tolist() == [0, 2, 4]
    assert np.isnan(still_there(xy, alive, unlike, 3, most=4)[0, 3]).all()
    assert still_there(xy, alive, unlike, 2, most=2)[0, :, 0].tolist() == [0, 2]
    assert still_there(xy, alive, unlike, 1, most=9)[0, :, 0].tolist() == [0, 1, 2, 3, 4]
    nobody = np.zeros_like(alive)
    assert still_there(xy, nobody, unlike, 3, most=2)[0, :, 0].tolist() == [0, 1]  # held


def test_a_repeated_sample_counts_once():
    """The same way and the same end; to have been at the same place is not enough."""
    rng = np.random.default_rng(1)
    one, other = rng.normal(0, 1, (2, STEPS, 2)).astype(np.float32)
    parting = one.copy()
    parting[-1] += 1
    xy = np.stack([one, other, one, parting, one])[None]
    alive = np.array([[STEPS, STEPS, STEPS, STEPS, STEPS - 1]], np.int32)
    repeated = repeats(xy, alive)
    assert repeated.tolist() == [[False, False, True, False, False]]
    first = still_there(xy, alive, repeated, 1)[0]
    np.testing.assert_array_equal(first[:4], np.stack([one, other, parting, one])[:, 0])
    assert np.isfinite(first[:, 0]).sum() == 4


@given(SEEDS, st.integers(1, 7))
def test_the_output_is_that_of_the_complete_protocol(seed, k):
    """Ranked among the method's own futures, whatever else was drawn."""
    rng = np.random.default_rng(seed)
    forecast, truth = futures(rng), rng.normal(0, 1, (4, STEPS, 2))
    length = np.full(4, STEPS)
    expected = score(forecast.first(k), truth, {"paper": length, "complete": length})["ranked", "complete"]["fde"]
    output = own_output(forecast.first(k))
    np.testing.assert_allclose(np.hypot(*np.moveaxis(output - truth, -1, 0)), expected, rtol=1e-6)


def test_samples_of_a_median_are_the_others():
    forecast = with_median(futures(np.random.default_rng(2)))
    xy, alive = samples_of(forecast)
    np.testing.assert_array_equal(xy, forecast.xy[:, 1:])
    assert alive.shape == (4, 7)
    np.testing.assert_array_equal(own_output(forecast), forecast.xy[:, 0])


# --- energy score -------------------------------------------------------------------------------------------


def energy_loop(points, y):
    """The formula as it is written."""
    m = len(points)
    first = sum(math.dist(p, y) for p in points) / m
    pairs = sum(math.dist(points[i], points[j]) for i in range(m) for j in range(m) if i != j)
    return first - (pairs / (2 * m * (m - 1)) if m > 1 else 0.0)


@given(SEEDS)
def test_energy_score_equals_the_double_loop(seed):
    rng = np.random.default_rng(seed)
    points, truth = rng.normal(0, 3, (5, 8, 2)), rng.normal(0, 3, (5, 2))
    numbers = [1, 2, 3, 7, 8]
    for n, number in enumerate(numbers):
        points[n, number:] = np.nan
    expected = [energy_loop(points[n, :number].tolist(), truth[n]) for n, number in enumerate(numbers)]
    np.testing.assert_allclose(energy_score(points, truth), expected, rtol=1e-12)


def test_energy_score_of_normals_is_the_closed_form():
    """X, y ~ N(0, s^2) in the plane: E|X - 0| = s sqrt(pi/2), E|X - X'| = E|X - y| = s sqrt(pi)."""
    rng, s, n = np.random.default_rng(3), 2.0, 40_000
    points = rng.normal(0, s, (n, 5, 2))
    at_centre = energy_score(points, np.zeros((n, 2)))
    drawn = energy_score(points, rng.normal(0, s, (n, 2)))
    assert at_centre.mean() == pytest.approx(s * (math.sqrt(math.pi / 2) - math.sqrt(math.pi) / 2), abs=0.03)
    assert drawn.mean() == pytest.approx(s * math.sqrt(math.pi) / 2, abs=0.03)


def test_the_number_of_samples_does_not_bias_the_energy_score():
    rng, n = np.random.default_rng(4), 60_000
    truth, points = rng.normal(0, 1, (n, 2)), rng.normal(0, 1, (n, 6, 2))
    means = [energy_score(points[:, :m], truth).mean() for m in (2, 3, 6)]
    np.testing.assert_allclose(means, math.sqrt(math.pi) / 2, atol=0.02)


def test_the_true_distribution_has_the_best_energy_score():
    """Proper: neither the sure nor the unsure one beats it."""
    rng, n = np.random.default_rng(5), 20_000
    truth, points = rng.normal(0, 1, (n, 2)), rng.normal(0, 1, (n, 10, 2))
    right, sure, unsure = (energy_score(points * factor, truth).mean() for factor in (1.0, 0.5, 2.0))
    assert right < sure
    assert right < unsure


# --- all measures -------------------------------------------------------------------------------------------


@given(SEEDS, st.sampled_from(["ranked", "geometric_median", "medoid", "modes"]))
def test_measures_equal_the_loop(seed, output):
    """Of nine samples, and of the result of the method's own five, whatever comes out of nine."""
    rng = np.random.default_rng(seed)
    nine = futures(rng, m=9)
    forecast, own = with_output(nine, output), with_output(nine.first(5), output)
    length = rng.integers(1, STEPS + 3, 4)
    truth = rng.normal(0, 1, (4, STEPS, 2))
    truth[np.arange(1, STEPS + 1) > length[:, None]] = np.nan
    steps = np.array([1, 3, STEPS])
    got = measures(forecast, truth, length, steps, own)
    samples, alive = nine.xy, nine.steps_alive
    path = own_output(own)
    for i, (column, step) in ((i, pair) for i in range(4) for pair in enumerate(steps)):
        assert got["left"][i, column] == pytest.approx(sum(alive[i] < step) / 9)
        assert got["has_left"][i, column] == (length[i] < step)
        names = ("energy_m", "best_ade_m", "best_fde_m", "missed", "mean_ade_m", "mean_fde_m",
                 "expected_m", "real_m", "samples")  # fmt: skip
        values = [got[name][i, column] for name in names]
        if length[i] < step:
            assert np.isnan(values).all()
            continue
        distinct = [j for j in range(9) if not any(
            alive[i, j] == alive[i, e] and (samples[i, j] == samples[i, e]).all() for e in range(j)
        )]  # fmt: skip
        living = [j for j in distinct if alive[i, j] >= step] or distinct
        points, y = [samples[i, j, step - 1].astype(float) for j in living], truth[i, step - 1]
        errors = [[math.dist(samples[i, j, s], truth[i, s]) for s in range(step)] for j in range(9)]
        first, away = errors[:5], [math.dist(p, path[i, step - 1]) for p in points]
        others = len(away) - (output == "geometric_median" or 0 in away)  # but for the output itself
        expected = [
            energy_loop(points, y),
            min(sum(one) / step for one in first),
            min(one[-1] for one in first),
            float(min(one[-1] for one in first) > 2.0),
            sum(sum(errors[j]) / step for j in living) / len(living),
            sum(errors[j][-1] for j in living) / len(living),
            sum(away) / others if others else math.nan,
            math.dist(path[i, step - 1], y),
            len(points),
        ]
        np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-5)


@given(SEEDS, st.integers(3, 40))
def test_kde_nll_is_scipy_s(seed, m):
    rng, middle = np.random.default_rng(seed), np.array([5.0, -300.0])
    points, truth = middle + rng.normal(0, 1, (3, 45, 2)) * [2.0, 0.5], middle + rng.normal(0, 3, (3, 2))
    points[:, m:] = np.nan
    expected = [-max(stats.gaussian_kde(some[:m].T).logpdf(at)[0], -20) for some, at in zip(points, truth, strict=True)]
    np.testing.assert_allclose(kde_nll(points, truth), expected, rtol=1e-6, atol=1e-6)


def test_kde_nll_of_samples_that_have_no_density():
    """Three on a line, one again and again, none, two: as bad as may be, so that means are of the same people."""
    line = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])
    points = np.stack(
        [line, np.zeros((3, 2)), np.full((3, 2), np.nan), np.where(np.arange(3)[:, None] < 2, line, np.nan)]
    )
    assert kde_nll(points, np.ones((4, 2))).tolist() == [20.0] * 4
    assert np.isnan(kde_nll(points[:, :2], np.ones((4, 2)))).all(), "of a method that never has three"
    wide = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    assert kde_nll(wide, np.array([[1e6, 0.0]])).tolist() == [20.0], "one outlier does not decide a mean"


def test_kde_nll_where_fewer_than_three_are_still_there_is_that_of_the_held_ones():
    rng = np.random.default_rng(13)
    forecast, truth, length = futures(rng, n=3, m=6), rng.normal(0, 1, (3, STEPS, 2)), np.full(3, STEPS)
    forecast.steps_alive[:] = [[0] * 6, [6, 6, 0, 0, 0, 0], [6, 6, 6, 0, 0, 0]]
    got = measures(forecast, truth, length, np.array([STEPS]))["kde_nll"][:, 0]
    counted = (forecast.xy[0], forecast.xy[1], forecast.xy[2, :3])
    expected = [kde_nll(some[None, :, -1], at[None, -1])[0] for some, at in zip(counted, truth, strict=True)]
    np.testing.assert_allclose(got, expected, rtol=1e-6)


def test_errors_of_modes_equal_the_loop():
    """The least of those that there are; a mode of probability 0 is none, however near."""
    rng = np.random.default_rng(11)
    forecast, truth = with_modes(futures(rng, n=6, m=9)), rng.normal(0, 1, (6, STEPS, 2))
    truth[3] = forecast.xy[3, 0]  # the first mode comes true
    length, steps = np.array([6, 6, 6, 6, 6, 2]), np.array([1, 4, STEPS])
    got = measures(forecast, truth, length, steps)
    for i, (column, step) in ((i, pair) for i in range(6) for pair in enumerate(steps)):
        values = [got[name][i, column] for name in OF_MODES]
        if length[i] < step:
            assert np.isnan(values).all()
            continue
        modes = [(forecast.xy[i, j], math.exp(forecast.log_fitness[i, j, 0])) for j in range(5)]
        modes = [(path, p) for path, p in modes if p > 0]
        away = [[math.dist(path[s], truth[i, s]) for s in range(step)] for path, _ in modes]
        fde, p = min((one[-1], n) for n, one in enumerate(away))
        expected = [min(sum(one) / step for one in away), fde, fde + (1 - modes[p][1]) ** 2]
        np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-6)
    assert got["modes_fde_m"][3].tolist() == [0, 0, 0]
    other = measures(futures(rng), truth[:4], length[:4], steps)
    assert all(np.isnan(other[name]).all() for name in OF_MODES)


def test_the_output_of_a_medoid_and_of_modes_is_what_is_scored():
    rng = np.random.default_rng(12)
    truth, length = rng.normal(0, 1, (4, STEPS, 2)), np.full(4, STEPS)
    for forecast in (with_medoid(futures(rng)), with_modes(futures(rng))):
        scored = score(forecast, truth, {"paper": length, "complete": length})[forecast.output, "complete"]["fde"]
        got = measures(forecast, truth, length, np.arange(1, STEPS + 1))
        np.testing.assert_allclose(got["real_m"], scored, rtol=1e-5)
        assert got["left"].tolist() == measures(forecast.samples, truth, length, np.arange(1, 7))["left"].tolist()


def test_nothing_alive_and_one_sample():
    """Held where they ended: one distinct sample, whose energy score is its error, sure that the person has left."""
    xy, alive = np.full((1, 6, 2, 2), 3.0, np.float32), np.zeros((1, 6), np.int32)
    forecast = Forecast(xy, np.zeros((1, 6, 2), np.float32), alive, "ranked")
    got = measures(forecast, np.array([[[3.0, 4.0], [3.0, 5.0]]]), np.array([2]), np.array([1, 2]))
    assert got["energy_m"].tolist() == got["real_m"].tolist() == got["best_fde_m"].tolist() == [[1, 2]]
    assert got["best_ade_m"].tolist() == [[1, 1.5]]
    assert np.isnan(got["expected_m"]).all(), "one sample does not say what else may happen"
    assert got["samples"].tolist() == got["left"].tolist() == [[1, 1]]


def walkers(number, rows):
    """People who walk along x at 1 m/s, `rows[n]` rows each."""
    return concatenate(
        Tracks(np.full(r, 10 + n), 1.9e9 + np.arange(r), np.arange(r), np.full(r, n), np.ones(r), np.zeros(r))
        for n, r in zip(range(number), rows, strict=True)
    )


def test_a_recording_is_measured_in_parts(monkeypatch):
    """The same table as in one piece, tracks that are too short left out; more futures than the method's own."""
    tracks = walkers(7, [12, 5, 4, 9, 12, 12, 7])
    asked = []

    def forecaster(observed, steps, keys):
        asked.append(keys.shape)
        n, k = keys.shape
        noise = (keys >> np.uint64(40)).astype(np.float64)[..., None, None] * 2.0**-24
        xy = observed.x[:, None, None, -1:] + noise * np.ones((n, k, steps, 2))
        return Forecast(xy.astype(np.float32), np.zeros((n, k, steps), np.float32), np.full((n, k), steps), "ranked")

    def measured():
        forecasts = forecast_recording(tracks, forecaster, SITE, ("hall", "m", "day"), 30, [0, 3])
        return score_samples(tracks, forecasts, "day", SITE, [2.0, 6.0]).to_pandas()

    whole = measured()
    assert asked == [(6, 30)] * 2
    monkeypatch.setattr("modlhmp.forecasting.recording.TRACKS_AT_ONCE", 4)
    parts = measured()
    assert asked[2:] == [(4, 30), (2, 30)] * 2
    key = ["track_id", "seed"]
    parts, whole = (one.astype({"recording": str}).sort_values(key, ignore_index=True) for one in (parts, whole))
    pd.testing.assert_frame_equal(parts, whole)
    assert sorted(set(whole["track_id"])) == [10, 11, 13, 14, 15, 16]
    assert whole.loc[whole["track_id"] == 16, "has_left"].iloc[0].tolist() == [0, 1]


def test_the_result_is_that_of_the_forecasts_which_the_method_gives():
    """Of five samples, while their distribution is of nine; both are of the same tracks in the same blocks."""
    tracks, nine = walkers(3, [10, 10, 6]), futures(np.random.default_rng(14), n=3, m=9)
    ids = np.array([10, 11, 12])
    drawn, own = [(0, ids, nine)], with_median(nine.first(5))
    got = score_samples(tracks, drawn, "day", SITE, [2.0], given=[(0, ids, own)]).to_pandas()
    both = [score_samples(tracks, [(0, ids, one)], "day", SITE, [2.0]).to_pandas() for one in (own, nine)]
    assert got["real_m"].map(list).tolist() == both[0]["real_m"].map(list).tolist()
    assert got["energy_m"].map(list).tolist() == both[1]["energy_m"].map(list).tolist()
    for wrong in ([], [(1, ids, own)]):
        with pytest.raises(ValueError, match=r"not of the same tracks|other tracks"):
            score_samples(tracks, drawn, "day", SITE, [2.0], given=wrong)


@pytest.mark.parametrize("scenes", [None, Scenes(*np.empty((3, 0)))])
def test_a_recording_without_a_forecast_is_measured_as_empty(scenes):
    """As a file of forecasts gives it: no block at all; its table joins those of others."""
    tracks = walkers(6, [SITE.observed_rows if scenes is None else 20] * 6)
    nothing = score_samples(tracks, iter([]), "day", SITE, [2.0, 6.0], scenes)
    rng, others = np.random.default_rng(1), walkers(6, [20] * 6)
    of_others = None if scenes is None else Scenes(np.arange(10, 16), others.t[::20], others.t[19::20])
    made = [(0, np.arange(10, 16), futures(rng, n=6))]
    table = score_samples(others, made, "other", SITE, [2.0, 6.0], of_others)
    assert nothing.num_rows == 0 and table.num_rows == 6
    assert pa.concat_tables([with_persons(one, {15: 10}) for one in (nothing, table)]).num_rows == 6


def test_a_file_is_summarised_by_track_then_over_tracks(tmp_path):
    """Means over the seeds first; the Brier score of each seed; n beside all."""
    tracks, rng = walkers(3, [10, 10, 6]), np.random.default_rng(8)
    forecasts = [(seed, np.array([10, 11, 12]), futures(rng, n=3, m=8)) for seed in (0, 1)]
    table = score_samples(tracks, forecasts, "day", SITE, [2.0, 6.0])
    write_parquet(table, tmp_path / "m.parquet", horizons_s=[2.0, 6.0])
    horizons, by_track, person = read_uncertainty(tmp_path / "m.parquet")
    assert len(set(person.tolist())) == 3
    rows = summarise("hall", "m", horizons, by_track).set_index("horizon_s")
    frame = table.to_pandas()
    for column, horizon in enumerate((2.0, 6.0)):
        at = {name: frame.groupby("track_id")[name].apply(lambda one, c=column: np.mean([v[c] for v in one]))
              for name in ("energy_m", "expected_m", "real_m")}  # fmt: skip
        row = rows.loc[horizon]
        for name, one in at.items():
            assert row[name] == pytest.approx(one.dropna().mean(), rel=1e-6)
        both = pd.DataFrame(at).dropna()
        assert (row["ratio"], row["n_ratio"]) == (
            pytest.approx(both["real_m"].mean() / both["expected_m"].mean()),
            len(both),
        )
        brier = [(p[column] - o[column]) ** 2 for p, o in zip(frame["left"], frame["has_left"], strict=True)]
        assert row["brier"] == pytest.approx(np.mean(brier))
    assert rows["n"].tolist() == [3, 2]
    assert rows["n_left"].tolist() == [3, 3]
    assert rows.loc[6.0, "left_share"] == pytest.approx(1 / 3)
    assert rows.loc[6.0, "brier_base"] == pytest.approx(2 / 9)


# --- as announced? ------------------------------------------------------------------------------------------


def given_as(output, forecast):
    """Samples as a forecast of an output, whose standing, where it is not of their places, is random."""
    if output == "mean_path":
        mean = np.concatenate([forecast.xy.mean(axis=1, keepdims=True), forecast.xy], axis=1)
        return Forecast(mean, np.zeros(mean.shape[:3], np.float32), np.ones(mean.shape[:2], np.int32), output)
    made = {"median": with_median, "medoid": with_medoid, "modes": with_modes}.get(output)
    return made(forecast) if made else forecast._replace(output=output)


def planted(spread_of_samples, rng, output="median", n=6000, m=30):
    """Tracks of different uncertainty, whose truth is drawn with it and whose samples with a multiple of it."""
    sigma = rng.uniform(0.5, 4.0, (n, 1, 1, 1))
    xy = (spread_of_samples * sigma * rng.normal(0, 1, (n, m, 1, 2))).astype(np.float32)
    samples = Forecast(xy, rng.normal(0, 1, (n, m, 1)).astype(np.float32), np.ones((n, m), np.int32), "ranked")
    forecast = given_as(output, samples)
    truth = (sigma * rng.normal(0, 1, (n, 1, 1, 2)))[:, 0]
    return measures(forecast, truth, np.ones(n, int), np.array([1]), forecast.first(1))


def test_truth_of_the_samples_own_distribution_is_calibrated():
    """Ratio 1, over all and in each bin; samples of half the spread are twice too sure."""
    got = planted(1.0, np.random.default_rng(7))
    assert got["real_m"].mean() / got["expected_m"].mean() == pytest.approx(1.0, abs=0.03)
    bins = calibration(got["expected_m"][:, 0], got["real_m"][:, 0])
    assert bins["n"].tolist() == [600] * 10
    assert bins["forecast"].is_monotonic_increasing
    np.testing.assert_allclose(bins["outcome"], bins["forecast"], rtol=0.12)
    sure = planted(0.5, np.random.default_rng(8))
    assert sure["real_m"].mean() / sure["expected_m"].mean() == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("m", [5, 30])
@pytest.mark.parametrize("output", ["ranked", "likeliest", "mean", "median", "mean_path", "medoid", "modes"])
def test_every_output_expects_the_error_that_it_has(output, m):
    """However few its samples are; one that is chosen or made for its nearness to them seems a little nearer if few."""
    got = planted(1.0, np.random.default_rng(13), output, 2000 if output == "modes" else 8000, m)
    slack = {"medoid": 0.15, "modes": 0.06, "median": 0.05, "mean_path": 0.04}.get(output, 0.02) if m == 5 else 0.03
    assert got["real_m"].mean() / got["expected_m"].mean() == pytest.approx(1.0, abs=slack)
    if output == "mean":  # as errors are scored
        np.testing.assert_array_equal(got["real_m"], got["mean_fde_m"])


def test_the_ratio_is_of_tracks_that_have_both_errors():
    by_track = dict.fromkeys([*MEASURES, "brier"], np.zeros((3, 1)))
    by_track |= {"expected_m": np.array([[1.0], [2.0], [np.nan]]), "real_m": np.array([[2.0], [4.0], [9.0]])}
    row = summarise("hall", "m", [5.0], by_track).iloc[0]
    assert (row["ratio"], row["n_ratio"], row["n"], row["real_m"], row["expected_m"]) == (2.0, 2, 3, 5.0, 1.5)


def test_probabilities_that_come_true_are_reliable():
    rng = np.random.default_rng(9)
    probability = rng.uniform(0, 1, 20_000)
    bins = reliability(probability, (rng.uniform(0, 1, 20_000) < probability).astype(float))
    assert len(bins) == 10
    np.testing.assert_allclose(bins["forecast"], np.arange(10) / 10 + 0.05, atol=0.01)
    assert (abs(bins["outcome"] - bins["forecast"]) < 2 * (bins["high"] - bins["outcome"])).all()


def test_bins_by_hand():
    bins = reliability(np.array([0.0, 0.05, 0.95, 1.0, 0.31]), np.array([0.0, 1.0, 1.0, 1.0, 0.0]))
    assert bins[["bin", "outcome", "n"]].to_numpy().tolist() == [[1, 0.5, 2], [4, 0, 1], [10, 1, 2]]
    reach = np.tan(0.475 * np.pi) / 2  # Student's t of one degree of freedom is Cauchy's
    np.testing.assert_allclose(bins[["low", "high"]].iloc[0], [0.5 - reach, 0.5 + reach])
    assert bins[["low", "high"]].iloc[1:].isna().all(axis=None)  # one track, and two that are alike
    few = calibration(np.array([3.0, 1.0, np.nan, 2.0]), np.array([30.0, 10.0, 5.0, np.nan]))
    assert few[["forecast", "outcome", "n"]].to_numpy().tolist() == [[1, 10, 1], [3, 30, 1]]


def test_brier_by_hand():
    """Of four people one has left; said with 0.75 of that one, 0.25 of the others."""
    nothing = np.zeros((4, 1))
    by_track = dict.fromkeys(MEASURES, nothing)
    left, has_left = np.array([[0.75], [0.25], [0.25], [0.25]]), np.array([[1.0], [0], [0], [0]])
    by_track |= {"left": left, "has_left": has_left, "brier": (left - has_left) ** 2}
    row = summarise("hall", "m", [5.0], by_track).iloc[0]
    assert row["brier"] == pytest.approx(0.0625)
    assert row["brier_base"] == pytest.approx(0.1875)
    assert np.isnan(row["ratio"])


# --- density ------------------------------------------------------------------------------------------------


@given(SEEDS, st.sampled_from([0.1, 0.25, 1.0]))
def test_density_sums_to_one_about_the_samples(seed, cell_m):
    """Its mean is the samples', up to half a cell, and its variance theirs and the kernel's."""
    positions = np.random.default_rng(seed).normal([5.0, -2.0], [1.0, 0.5], (300, 2))
    p = density(positions, (-5, 15, -12, 8), cell_m, 0.5)
    assert p.shape == (round(20 / cell_m), round(20 / cell_m))
    assert p.sum() == pytest.approx(1.0)
    assert (p >= 0).all()
    x, y = -5 + cell_m * (np.arange(p.shape[1]) + 0.5), -12 + cell_m * (np.arange(p.shape[0]) + 0.5)
    mean = (p.sum(axis=0) @ x, p.sum(axis=1) @ y)
    np.testing.assert_allclose(mean, positions.mean(axis=0), atol=cell_m / 4)
    variance = p.sum(axis=0) @ (x - mean[0]) ** 2
    assert variance == pytest.approx(positions[:, 0].var() + 0.25, abs=0.02 + 0.2 * cell_m)


def test_density_of_one_sample_is_the_kernel():
    p = density([[1.0, 0.5]], (-4, 6, -4.5, 5.5), 0.1, 0.8)
    row, column = np.unravel_index(p.argmax(), p.shape)
    assert (row, column) in {(49, 49), (50, 50), (49, 50), (50, 49)}
    assert p.max() / 0.1**2 == pytest.approx(1 / (2 * math.pi * 0.8**2), rel=0.01)  # per m^2


def test_density_is_of_those_inside():
    """A sample outside or unknown does not count; at the edge nothing is lost; nobody inside is an error."""
    inside = density([[0.1, 0.1]], (0, 10, 0, 5), 0.5, 1.0)
    both = density([[0.1, 0.1], [11.0, 2.0], [np.nan, 1.0]], (0, 10, 0, 5), 0.5, 1.0)
    assert inside.shape == (10, 20)
    np.testing.assert_array_equal(both, inside)
    assert inside.sum() == pytest.approx(1.0)
    with pytest.raises(ValueError, match="none of 1 samples lies within"):
        density([[11.0, 2.0]], (0, 10, 0, 5), 0.5, 1.0)


def test_the_level_that_holds_a_share():
    p = np.array([[0.5, 0.3], [0.15, 0.05]])
    assert [level_that_holds(p, share) for share in (0.4, 0.5, 0.79, 0.9, 1.0)] == [0.5, 0.5, 0.3, 0.15, 0.05]
    spread = density([[0.0, 0.0]], (-5, 5, -5, 5), 0.05, 1.0)
    within = spread >= level_that_holds(spread, 0.5)
    # Half of a Gaussian lies within r = s sqrt(2 ln 2).
    assert within.sum() * 0.05**2 == pytest.approx(math.pi * 2 * math.log(2), rel=0.03)
