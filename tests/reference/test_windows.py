"""Several forecasts of a track: where they begin, that the first is the only one's, and that persons are clusters."""

from dataclasses import replace

import numpy as np
import pytest
from crowds import START, crowd, straight
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import modlhmp
from modlhmp.forecasting import cvm
from modlhmp.forecasting.average import average_forecasts
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import read_forecasts, read_t0, write_forecasts
from modlhmp.forecasting.neighbours import find_neighbours
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.forecasting.windows import in_order, windows
from modlhmp.maps.pieces import resample
from modlhmp.options import ConstantVelocity
from modlhmp.scenes import Scenes
from modlhmp.scoring.encounters import encounters
from modlhmp.scoring.errors import ground_truth, is_idle, lengths_counted, stands_about, truth_of
from modlhmp.scoring.recording import score_recording
from modlhmp.scoring.ttests import paired_test
from modlhmp.scoring.uncertainty import score_samples
from modlhmp.site import IdleFilter, PaperProtocol, Site
from modlhmp.storage import write_parquet
from modlhmp.streams import stream_keys, uniforms
from modlhmp.study.comparisons import clusters, compare, side_by_side, tracks_of
from modlhmp.study.ladder import scores
from modlhmp.study.readings import readings
from modlhmp.study.reliability import calibration, read_uncertainty
from modlhmp.study.summary import at_horizons
from modlhmp.tracks import Tracks, concatenate, empty_tracks, together, usable_tracks, with_persons

FEW = settings(max_examples=25, deadline=None, derandomize=True)
ONCE = Site(observed_rows=4, horizon_s=8.0, timezone="Asia/Tokyo")
OFTEN = replace(ONCE, forecast_every_s=5)
NAMES = ("hall", "m", "day")


def track(rng, person, rows, jitter=0.04):
    """A random walk with clock jitter; now and then a row is missing."""
    t = 1.9e9 + rng.uniform(0, 50) + np.arange(rows) + rng.uniform(-jitter, jitter, rows)
    x, y = rng.normal(0, 1, (2, rows)).cumsum(axis=1)
    one = Tracks(np.full(rows, person), t, x, y, rng.uniform(0, 2, rows), rng.uniform(-3, 3, rows))
    kept = rng.random(rows) < 0.9
    kept[:1] = True
    return one.take(kept)


def recording(seed=0, tracks=9, longest=40):
    rng = np.random.default_rng(seed)
    return concatenate(track(rng, 100 + n, int(rng.integers(2, longest))) for n in range(tracks))


def scattered(observed, steps, keys):
    """Three futures of random positions around t0's, that depend on the keys only."""
    n, k = keys.shape
    noise = uniforms(keys.ravel(), 0, 2 * steps).reshape(n, k, steps, 2)
    start = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
    xy = (start[:, None, None] + 4 * noise).astype(np.float32)
    return Forecast(xy, -np.cumsum(noise[..., 0], -1).astype(np.float32), np.full((n, k), steps, np.int32), "ranked")


def forecasts(tracks, site, seeds=(0, 1), k=3, forecaster=scattered, scenes=None):
    return forecast_recording(tracks, forecaster, site, NAMES, k, seeds, scenes=scenes)


def joined(tracks, site, seed=0, **options):
    """All positions of one seed, [n, k, T, 2]."""
    return np.concatenate([one.xy for _, _, one in forecasts(tracks, site, (seed,), **options)])


# --- where they begin ---------------------------------------------------------------------------------------


@FEW
@given(st.integers(0, 10**6), st.sampled_from([1.0, 0.4]), st.sampled_from([1, 3, 10]), st.sampled_from([2, 4, 8]))
def test_windows_equal_the_loop(seed, step_s, steps_apart, observed_rows):
    tracks = recording(seed)
    tracks = tracks._replace(t=1.9e9 + (tracks.t - 1.9e9) * step_s)
    site = Site(observed_rows=observed_rows, time_step_s=step_s, forecast_every_s=steps_apart * step_s, horizon_s=8)
    found, expected = windows(tracks, site), []
    for number, (first, last) in enumerate(usable_tracks(tracks, observed_rows)):
        begin, moment = first + observed_rows - 1, 0.0
        for row in range(begin, last):  # a row comes after it
            since = tracks.t[row] - tracks.t[begin]
            if since >= moment - 0.05 * step_s:
                expected.append((number, row))
                while since >= moment - 0.05 * step_s:
                    moment += steps_apart * step_s
    got = list(zip(found.of.tolist(), found.row.tolist(), strict=True))
    assert got == expected
    np.testing.assert_array_equal(found.t0, tracks.t[found.row])
    np.testing.assert_array_equal(found.track_id, tracks.track_id[found.row])
    assert (found.later_s >= 0).all()
    assert (np.bincount(found.of[found.later_s == 0], minlength=len(found.tracks)) == 1).all()


@pytest.mark.parametrize("step_s", [2.7, 10.0, 60.0])
def test_a_slow_clock_changes_nothing(step_s):
    """Who goes the same way in steps so long has the same paths, errors, neighbours, meetings and pieces.

    Gaps are of two steps, which are none, and of seven.
    """
    tracks = crowd(5, people=90, gaps=(1,) * 16 + (2, 7))
    begin = np.repeat(tracks.t[tracks.bounds()[:-1]], np.diff(tracks.bounds()))
    steps = begin - START + np.rint(tracks.t - begin)

    def found(step_s):
        site, slow = Site(time_step_s=step_s, horizon_s=8 * step_s), tracks._replace(t=START + step_s * steps)
        row = windows(slow, site).row
        futures = modlhmp.forecast("cvm", slow.take((row[:, None] + np.arange(-3, 1)).ravel()), site=site)
        scores = modlhmp.score(futures, slow)
        cvm_of = cvm.forecaster(None, site, ConstantVelocity())
        met = encounters(slow, forecasts(slow, site, (0,), 1, cvm_of), together([slow]), site)
        assert np.nanmax(met[0]) == 1 and np.isfinite(scores.fde).any()
        near, pieces = find_neighbours(slow, row, 4, step_s), resample(slow, step_s)
        return row, futures.paths, scores.ade, scores.fde, *met, *near, pieces.xy

    for ours, theirs in zip(found(step_s), found(1.0), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-4)


def test_a_walk_by_hand():
    """A row each second from 0 to 20, t0 of the first forecast at 3 s; at 20 s nothing comes after."""
    walk = straight(1, (0, 0), (1, 0), 21)
    first = walk.t[0]
    assert (windows(walk, ONCE).t0 - first).tolist() == [3]
    assert (windows(walk, OFTEN).t0 - first).tolist() == [3, 8, 13, 18]
    assert (windows(walk, replace(ONCE, forecast_every_s=17)).t0 - first).tolist() == [3]
    hole = walk.take(np.r_[0:8, 12:21])  # without the rows of 8 to 11 s, a gap of 5 s
    assert (windows(hole, OFTEN).t0 - first).tolist() == [3, 12, 13, 18]
    assert (windows(hole, replace(ONCE, forecast_every_s=1)).t0 - first).tolist() == [3, 4, 5, 6, 7, *range(12, 20)]


def test_a_recording_of_nobody_has_none():
    assert len(windows(empty_tracks(), OFTEN).t0) == 0
    assert len(windows(empty_tracks(), ONCE).t0) == 0


def test_without_the_option_each_usable_track_is_forecast_once():
    tracks = recording(3)
    found, usable = windows(tracks, ONCE), usable_tracks(tracks, 4)
    np.testing.assert_array_equal(found.tracks, usable)
    np.testing.assert_array_equal(found.row, usable[:, 0] + 3)
    np.testing.assert_array_equal(found.of, np.arange(len(usable)))
    assert not found.later_s.any()


# --- forecasts and truth ------------------------------------------------------------------------------------


def test_first_forecasts_are_those_of_once_a_track():
    """To the bit, whatever else is forecast: random numbers, truth, and errors."""
    tracks = recording(4)
    first = windows(tracks, OFTEN).later_s == 0
    assert 0 < first.sum() < len(first)
    np.testing.assert_array_equal(joined(tracks, OFTEN)[first], joined(tracks, ONCE))
    for part, other in zip(
        truth_of(tracks, windows(tracks, OFTEN), OFTEN), truth_of(tracks, windows(tracks, ONCE), ONCE), strict=True
    ):
        np.testing.assert_array_equal(part[first], other)
    often = score_recording(tracks, forecasts(tracks, OFTEN), "day", OFTEN).to_pandas()
    once = score_recording(tracks, forecasts(tracks, ONCE), "day", ONCE).to_pandas()
    assert "t0" not in once
    both = often.merge(once, on=["track_id", "seed", "output", "protocol"], suffixes=("", "_once"))
    both = both[both["t0"] == both.groupby("track_id")["t0"].transform("min")]
    assert len(both) == len(once)
    for name in ("ade", "fde"):
        np.testing.assert_array_equal(np.stack(both[name]), np.stack(both[f"{name}_once"]))


def test_a_later_forecast_is_that_of_the_track_from_there_on():
    """It observes the rows up to its own t0, and its truth is what follows."""
    tracks = recording(5)
    found, straight_on = windows(tracks, OFTEN), cvm.forecaster(None, OFTEN, ConstantVelocity())
    paths = joined(tracks, OFTEN, k=1, forecaster=straight_on)
    truth, length = truth_of(tracks, found, OFTEN)
    for number, row in enumerate(found.row):
        rest = tracks.take(slice(row - 3, found.tracks[found.of[number], 1] + 1))
        np.testing.assert_array_equal(paths[number : number + 1], joined(rest, ONCE, k=1, forecaster=straight_on))
        xy, steps = ground_truth(rest, np.array([[0, len(rest.t) - 1]]), 4, 8)
        np.testing.assert_allclose(truth[number], xy[0], rtol=0, atol=1e-9)
        assert length[number] == steps[0]


def test_every_forecast_has_random_numbers_of_its_own():
    """Which depend on its track and its time only: not on other tracks, and not on how many forecasts there are."""
    tracks = recording(6)
    found, paths = windows(tracks, OFTEN), joined(tracks, OFTEN)
    keys = stream_keys(found.track_id, 3, 0, *NAMES, later_s=found.later_s)
    assert len(np.unique(keys)) == keys.size
    half = np.isin(tracks.track_id, np.unique(tracks.track_id)[::2])
    mine = np.isin(found.track_id, np.unique(tracks.track_id[half]))
    np.testing.assert_array_equal(joined(tracks.take(half), OFTEN), paths[mine])
    rarer = windows(tracks, replace(OFTEN, forecast_every_s=10))
    same = [int(np.flatnonzero(found.row == row)[0]) for row in rarer.row if row in found.row]
    assert len(same) > len(rarer.tracks)
    shared = np.isin(rarer.row, found.row)
    np.testing.assert_array_equal(joined(tracks, replace(OFTEN, forecast_every_s=10))[shared], paths[same])


def test_neighbours_are_those_at_each_t0():
    tracks, others = recording(7), recording(8, tracks=30)
    seen = []

    def look(observed, steps, keys):
        seen.append(observed.neighbours)
        return scattered(observed, steps, keys)

    list(forecast_recording(tracks, look, OFTEN, NAMES, 1, [0], [others]))
    expected = find_neighbours(together([tracks, others]), windows(tracks, OFTEN).row, 4, 1.0)
    np.testing.assert_array_equal(np.concatenate(seen), expected.xy)
    assert np.isfinite(expected.xy).any()


# --- files --------------------------------------------------------------------------------------------------


def test_files_say_t0_where_a_track_is_forecast_several_times(tmp_path):
    tracks = recording(9)
    t0 = windows(tracks, OFTEN).t0
    write_forecasts(tmp_path / "often.parquet", forecasts(tracks, OFTEN), t0)
    write_forecasts(tmp_path / "once.parquet", forecasts(tracks, ONCE))
    np.testing.assert_array_equal(read_t0(tmp_path / "often.parquet"), t0)
    assert read_t0(tmp_path / "once.parquet") is None
    again = [(seed, ids.tolist()) for seed, ids, _ in read_forecasts(tmp_path / "often.parquet")]
    assert again == [(seed, windows(tracks, OFTEN).track_id.tolist()) for seed in (0, 1)]
    members = [read_forecasts(tmp_path / "often.parquet") for _ in range(2)]
    _, ids, mean = next(average_forecasts(members))
    assert len(ids) == len(mean.xy) == len(t0)


def test_forecasts_of_other_tracks_are_refused():
    tracks = recording(10)
    with pytest.raises(ValueError, match="day: the forecasts are of fewer tracks"):
        list(in_order([(0, np.array([], int), None)], windows(tracks, OFTEN), "day"))
    with pytest.raises(ValueError, match="other tracks"):
        list(in_order(forecasts(tracks, OFTEN), windows(tracks, ONCE)))
    with pytest.raises(ValueError, match=r"fewer tracks|other tracks"):
        list(in_order(forecasts(tracks, ONCE), windows(tracks, OFTEN)))


# --- scenes -------------------------------------------------------------------------------------------------


def scenes_of(tracks, rng, number=60):
    """Scenes of people who are there, at their rows or between them, too long or of nobody."""
    rows = rng.integers(0, len(tracks.t), number)
    begin = tracks.t[rows] + rng.choice([0, 0, 0.3, -0.02, -3], number)
    whose = np.where(rng.random(number) < 0.9, tracks.track_id[rows], 999)
    return Scenes(whose, begin, begin + rng.choice([2, 5, 11, 40], number))


@FEW
@given(st.integers(0, 10**6), st.sampled_from([2, 4, 8]))
def test_windows_of_scenes_equal_the_loop(seed, observed_rows):
    tracks, site, expected = recording(seed), replace(ONCE, observed_rows=observed_rows), {}
    scenes = scenes_of(tracks, np.random.default_rng(seed))
    found = windows(tracks, site, scenes)
    usable = {tracks.track_id[first]: (first, last) for first, last in usable_tracks(tracks, observed_rows)}
    for whose, begin, end in zip(*scenes, strict=True):
        if whose not in usable or tracks.t[usable[whose][0]] > begin + 0.05:
            continue
        rows = [row for row in range(*usable[whose]) if tracks.t[row] >= begin - 0.05]
        if len(rows) >= observed_rows:
            t0 = rows[observed_rows - 1]
            until = min(end, tracks.t[usable[whose][1]])
            if until - tracks.t[t0] >= 0.95:
                expected[whose, t0] = max(until, expected.get((whose, t0), 0))
    assert list(zip(found.track_id.tolist(), found.row.tolist(), strict=True)) == sorted(expected)
    assert found.until.tolist() == [expected[one] for one in sorted(expected)]
    assert (found.tracks[found.of, 0] + observed_rows - 1 <= found.row).all()
    _, length = truth_of(tracks, found, site)
    assert (length >= 1).all()
    ends = tracks.t[found.tracks[found.of, 1]]
    assert (length <= np.floor(ends - found.t0 + 0.05)).all()


def test_a_scene_is_nine_rows_and_twelve_steps():
    """As in the challenge: 21 rows of 0.4 s. What comes after the scene is neither forecast nor scored."""
    site = Site(observed_rows=9, time_step_s=0.4, horizon_s=6.0)
    walk = straight(7, (0, 0), (1, 0), 60, step_s=0.4)
    begin = walk.t[0] + 0.4 * np.array([0, 10, 30, 39, 51])
    found = windows(walk, site, Scenes(np.full(5, 7), begin, begin + 8.0))
    truth, length = truth_of(walk, found, site)
    assert found.row.tolist() == [8, 18, 38, 47]  # the last one has no row after it
    assert length.tolist() == [12, 12, 12, 12]
    assert np.isfinite(truth[:, :12]).all()
    assert np.isnan(truth[:, 12:]).all()
    np.testing.assert_allclose(truth[:, 11, 0], walk.x[[20, 30, 50, 59]])
    assert found.later_s.round(6).tolist() == [0.0, 4.0, 12.0, 15.6]
    assert found.several


def test_scenes_do_not_change_what_every_so_many_seconds_says():
    tracks = recording(15)
    scenes = scenes_of(tracks, np.random.default_rng(0))
    for one, other in zip(windows(tracks, OFTEN, scenes), windows(tracks, OFTEN), strict=True):
        np.testing.assert_array_equal(one, other)


def test_no_scene_is_no_forecast():
    nobody = Scenes(np.empty(0, np.int64), np.empty(0), np.empty(0))
    found = windows(recording(), ONCE, nobody)
    assert (len(found.t0), len(found.until), found.several) == (0, 0, True)
    assert len(windows(empty_tracks(), ONCE, nobody).t0) == 0


def test_a_scene_at_a_track_s_first_row_has_the_only_forecast_s_random_numbers():
    tracks = recording(16)
    usable = usable_tracks(tracks, 4)[:, 0]
    scenes = Scenes(tracks.track_id[usable], tracks.t[usable], tracks.t[usable] + 40)
    np.testing.assert_array_equal(joined(tracks, ONCE), joined(tracks, ONCE, scenes=scenes))
    later = scenes._replace(begin=scenes.begin + 1)
    assert not np.isin(joined(tracks, ONCE, scenes=later)[:, 0, 0], joined(tracks, ONCE)[:, 0, 0]).any()


def test_scores_are_of_scenes_and_clusters_of_persons(tmp_path):
    tracks = recording(17, tracks=12)
    scenes = scenes_of(tracks, np.random.default_rng(1))
    found, own = windows(tracks, ONCE, scenes), {"scenes": scenes}
    _, length = truth_of(tracks, found, ONCE)
    assert len(set(found.track_id.tolist())) < len(found.t0)
    table = score_recording(tracks, forecasts(tracks, ONCE, **own), "day", ONCE, **own)
    once = table.to_pandas().query("output == 'ranked' and protocol == 'complete' and seed == 0")
    assert (once["track_id"].tolist(), once["t0"].tolist()) == (found.track_id.tolist(), found.t0.tolist())
    assert once["eligible_steps"].tolist() == np.minimum(length, 8).tolist()
    write_parquet(table, tmp_path / "e.parquet")
    errors = at_horizons(tmp_path / "e.parquet", [1.0], 1.0)["ranked", "complete"]
    assert sorted(errors.person) == sorted(f"day/{track}" for track in found.track_id)
    _, _, steps = encounters(tracks, forecasts(tracks, ONCE, **own), tracks, ONCE, scenes)
    np.testing.assert_array_equal(steps, length)
    read = readings([(tracks, forecasts(tracks, ONCE, **own), scenes)], ONCE)
    assert set(read.loc[read["idle"] == "kept", "eligible"]) == {(length >= 8).sum()}
    measured = score_samples(tracks, forecasts(tracks, ONCE, **own), "day", ONCE, [2.0], scenes).to_pandas()
    assert measured.loc[measured["seed"] == 0, "t0"].tolist() == found.t0.tolist()
    with pytest.raises(ValueError, match=r"other tracks|fewer tracks"):
        score_recording(tracks, forecasts(tracks, ONCE, **own), "day", ONCE)


# --- scores and statistics ----------------------------------------------------------------------------------


def test_n_counts_forecasts_and_clusters_count_persons(tmp_path):
    tracks = recording(11, tracks=12)
    found, errors = windows(tracks, OFTEN), {}
    for shift, method in ((0, "good"), (1, "bad")):

        def moved(observed, steps, keys, shift=shift):
            one = scattered(observed, steps, keys)
            return one._replace(xy=one.xy + np.float32(shift))

        table = score_recording(tracks, forecasts(tracks, OFTEN, forecaster=moved), "day/half", OFTEN)
        write_parquet(table, tmp_path / f"{method}.parquet")
        errors[method] = at_horizons(tmp_path / f"{method}.parquet", [1.0, 5.0], 1.0)
    one = errors["good"]["ranked", "complete"]
    _, length = truth_of(tracks, found, OFTEN)
    assert len(one.keys) == len(set(one.keys)) == len(found.t0)
    assert set(tracks_of(one.keys)) == {f"day/half/{track}" for track in set(found.track_id.tolist())}
    assert sorted(clusters(one.person, {"day/half": "2030-01-01"})) == sorted(
        f"day/half/{track}" for track in found.track_id
    )
    tests = compare("hall", errors, [("good", "bad")], [1.0, 5.0], {"day/half": "2030-01-01"})
    for horizon, steps in ((1.0, 1), (5.0, 5)):
        of = tests[(tests["horizon_s"] == horizon) & (tests["protocol"] == "complete")]
        assert set(of["n"]) == {(length >= steps).sum()}
        assert set(of["clusters"]) == {len(set(found.track_id[length >= steps].tolist()))}
    days = {f"d{n}": f"2030-01-0{n}" for n in range(1, 6)}
    assert clusters(["d1/4", "d2/7"], days).tolist() == ["2030-01-01", "2030-01-02"]


@pytest.mark.parametrize("site", [ONCE, OFTEN], ids=["once", "often"])
def test_pieces_of_one_person_are_one_cluster_everywhere(tmp_path, site):
    """As if every forecast of hers were under one id: in tests, intervals of the ladder, calibration."""
    tracks, persons = recording(14, tracks=24), {100 + n: 100 + n - n % 4 for n in range(24) if n % 4}
    errors, horizons, days = {}, [2.0, 5.0], {"day": "2030-01-01"}
    for shift, method in ((0, "good"), (1, "bad")):

        def moved(observed, steps, keys, shift=shift):
            one = scattered(observed, steps, keys)
            return one._replace(xy=one.xy + np.float32(shift))

        table = score_recording(tracks, forecasts(tracks, site, forecaster=moved), "day", site)
        write_parquet(with_persons(table, persons), tmp_path / f"{method}.parquet")
        errors[method] = at_horizons(tmp_path / f"{method}.parquet", horizons, 1.0)
    alone = {
        method: {key: one._replace(person=tracks_of(one.keys)) for key, one in found.items()}
        for method, found in errors.items()
    }
    whole = {f"day/{track}": f"day/{persons.get(track, track)}" for track in range(100, 124)}
    for one in errors["good"].values():
        assert one.person.tolist() == [whole[key] for key in tracks_of(one.keys)]
    tests, apart = (compare("hall", one, [("good", "bad")], horizons, days) for one in (errors, alone))
    of = tests[(tests["horizon_s"] == 2.0) & (tests["protocol"] == "complete")]
    both = side_by_side(*(errors[name]["ranked", "complete"] for name in errors), "ade", days)
    expected = paired_test(
        both.ours[:, :, 0], both.theirs[:, :, 0], np.array([whole[one] for one in tracks_of(both.keys)])
    )
    assert (of["clusters"].iloc[0], of["ci_low_m"].iloc[0]) == (expected.clusters, expected.low)
    assert expected.clusters <= 6 < apart["clusters"].min()
    assert not np.allclose(tests["ci_low_m"], apart["ci_low_m"])
    intervals, lone = (scores("hall", one, horizons, [2, 5], days) for one in (errors, alone))
    assert (intervals["ade_m"] == lone["ade_m"]).all()
    assert not np.allclose(intervals["ade_low_m"], lone["ade_low_m"])
    measured = with_persons(score_samples(tracks, forecasts(tracks, site), "day", site, horizons), persons)
    write_parquet(measured, tmp_path / "u.parquet", horizons_s=horizons)
    _, _, person = read_uncertainty(tmp_path / "u.parquet")
    first = [persons.get(track, track) for track in windows(tracks, site).track_id.tolist()]
    assert len(person) == len(first)
    assert len(set(zip(person.tolist(), first, strict=True))) == len(set(first)) == len(set(person.tolist()))


def test_all_forecasts_of_an_idle_track_are_idle():
    """The filter looks at the whole track, so the same people are left out with and without the option."""
    still = straight(2, (0, 5), (0.01, 0), 30)
    tracks = concatenate([straight(1, (0, 0), (1, 0), 30), still])
    site = replace(OFTEN, paper_protocol=PaperProtocol(idle_filter=IdleFilter()))
    table = score_recording(tracks, forecasts(tracks, site), "day", site).to_pandas()
    paper = table[table["protocol"] == "paper"]
    assert (paper["why_not"] == "idle").tolist() == (paper["track_id"] == 2).tolist()
    assert lengths_counted([tracks], site, "paper").tolist() == [26]  # of tracks, from their first t0


def test_all_other_scores_count_forecasts(tmp_path):
    tracks = recording(12)
    found = windows(tracks, OFTEN)
    _, length = truth_of(tracks, found, OFTEN)
    met, truth_met, steps = encounters(tracks, forecasts(tracks, OFTEN), tracks, OFTEN)
    assert met.shape == (2, len(found.t0), 8)
    np.testing.assert_array_equal(steps, length)
    assert truth_met.shape == (len(found.t0), 8)
    table = readings([(tracks, forecasts(tracks, OFTEN), None)], OFTEN)
    assert set(table.loc[table["idle"] == "kept", "eligible"]) == {(length >= 8).sum()}
    measured = score_samples(tracks, forecasts(tracks, OFTEN), "day", OFTEN, [2.0, 8.0])
    write_parquet(measured, tmp_path / "u.parquet", horizons_s=[2.0, 8.0])
    _, by_track, person = read_uncertainty(tmp_path / "u.parquet")
    assert np.isfinite(by_track["real_m"]).sum(axis=0).tolist() == [(length >= 2).sum(), (length >= 8).sum()]
    counts = np.unique(person, return_counts=True)[1]
    assert sorted(counts) == sorted(np.bincount(found.of))


def test_bins_are_as_sure_as_their_persons_are_many():
    """Ten times the same person is one; without several of a person it is Student's interval of a mean."""
    rng = np.random.default_rng(0)
    expected, real = rng.uniform(1, 2, 400), rng.normal(5, 1, 400)
    alone = calibration(expected, real)
    members = np.argsort(expected, kind="stable")[:40]
    interval = stats.ttest_1samp(real[members], 0).confidence_interval()
    np.testing.assert_allclose(alone[["low", "high"]].iloc[0], interval)
    repeated = calibration(np.repeat(expected, 10), np.repeat(real, 10), np.repeat(np.arange(400), 10))
    np.testing.assert_allclose(repeated[["low", "high"]], alone[["low", "high"]])
    assert repeated["n"].tolist() == [400] * 10


def test_who_stands_about_is_asked_over_five_seconds():
    """Of rows 0.4 s apart as well, in which nobody walks a metre in five rows; on the paper's 1 s it is five rows."""
    eth = replace(ONCE, time_step_s=0.4)
    walker, waiter = straight(1, (0, 0), (0.4, 0), 40, step_s=0.4), straight(2, (0, 0), (0.1, 0), 40, step_s=0.4)
    both = concatenate([walker, waiter])
    assert stands_about(both, usable_tracks(both, 4), eth).tolist() == [False, True]
    tracks = recording(13)
    rows = usable_tracks(tracks, 4)
    np.testing.assert_array_equal(stands_about(tracks, rows, ONCE), is_idle(tracks, rows, 5, 1.0))
