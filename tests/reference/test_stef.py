"""STeF-map: orientation bins, signals, FreMEn and sampling against plain twins and planted flows."""

import numpy as np
import pyarrow as pa
import pytest
import twins
from scipy import stats

from modlhmp.maps import fremen, stef
from modlhmp.options import RollOut
from modlhmp.site import Site
from modlhmp.storage import DataError, write_parquet
from modlhmp.study import demo
from modlhmp.study.demo.sites import planted_flows
from modlhmp.tracks import Tracks, concatenate

DAY = 86400.0
JAPAN = Site(timezone="Asia/Tokyo")
TWO_DAYS = (np.arange(288) + 0.5) * 600.0
ONE_DAY = TWO_DAYS[:144]


# --- FreMEn -------------------------------------------------------------------------------------------------


def cosines(times, mean, parts):
    """The signal mean + sum of a cos(2 pi t / T - phi) for (a, phi, T) of `parts`."""
    return mean + sum(a * np.cos(2 * np.pi * times / period - phase) for a, phase, period in parts)


def test_periods_are_a_day_and_its_24_harmonics():
    np.testing.assert_allclose(fremen.PERIODS_S, [DAY / i for i in range(1, 25)])


def test_known_cosines_are_recovered():
    parts = [(0.20, 0.7, DAY), (0.12, -2.5, DAY / 3)]
    mean, amplitude, phase, period = fremen.analyse(TWO_DAYS, cosines(TWO_DAYS, 0.45, parts), 2)
    assert mean == pytest.approx([0.45])
    np.testing.assert_allclose(period, [[DAY, DAY / 3]])
    np.testing.assert_allclose(2 * amplitude, [[0.20, 0.12]], atol=1e-9)  # a cosine's height is twice FreMEn's part
    np.testing.assert_allclose(phase, [[0.7, -2.5]], atol=1e-9)


@pytest.mark.parametrize("t", [0.0, 12_345.6, 5 * DAY + 777.0])
def test_prediction_of_known_cosines(t):
    parts = [(0.20, 0.7, DAY), (0.12, -2.5, DAY / 3)]
    spectrum = fremen.analyse(TWO_DAYS, cosines(TWO_DAYS, 0.45, parts), 2)
    assert fremen.predict(t, *spectrum) == pytest.approx([cosines(t, 0.45, parts)], abs=1e-9)


def test_only_the_strongest_parts_are_kept():
    parts = [(0.05, 0.1, DAY), (0.20, 1.0, DAY / 5), (0.10, 2.0, DAY / 2)]
    signal = cosines(TWO_DAYS, 0.5, parts)
    assert fremen.analyse(TWO_DAYS, signal, 2)[3].tolist() == [[DAY / 5, DAY / 2]]
    assert fremen.analyse(TWO_DAYS, signal, 1)[3].tolist() == [[DAY / 5]]
    assert fremen.analyse(TWO_DAYS, signal, 3)[3].tolist() == [[DAY / 5, DAY / 2, DAY]]


@pytest.mark.parametrize(
    ("times", "longest"),
    [
        (ONE_DAY, DAY / 2),  # 85 800 s hold 1.5 times 12 h, not 24 h
        (TWO_DAYS, DAY),
        (np.array([0.0, 1.0, 2.0, 1.5 * DAY]), DAY),  # just so
        (np.array([0.0, 1.0, 2.0, 1.5 * DAY - 1.0]), DAY / 2),
        (np.linspace(0, 42_600, 72), DAY / 4),  # 9 to 21 h only: 6 h and shorter
    ],
)
def test_a_period_must_fit_one_and_a_half_times(times, longest):
    rng = np.random.default_rng(1)
    _, amplitude, _, period = fremen.analyse(times, rng.random(len(times)), 24)
    assert period[amplitude > 0].max() == pytest.approx(longest)


def test_daily_rhythm_of_a_single_day_is_not_extrapolated():
    _, amplitude, _, period = fremen.analyse(ONE_DAY, cosines(ONE_DAY, 0.5, [(0.4, 0.0, DAY)]), 2)
    assert DAY not in period[amplitude > 1e-9]


@pytest.mark.parametrize("order", [1, 2, 5, 30])
@pytest.mark.parametrize("spacing", ["even", "uneven"])
def test_spectrum_equals_the_plain_transform(order, spacing):
    rng = np.random.default_rng(2)
    times = TWO_DAYS if spacing == "even" else np.sort(rng.uniform(0, 3 * DAY, 200))
    signals = rng.random((4, len(times)))
    mean, amplitude, phase, period = fremen.analyse(times, signals, order)
    assert amplitude.shape == phase.shape == period.shape == (4, order)
    for n, signal in enumerate(signals):
        expected_mean, parts = twins.fremen(times.tolist(), signal.tolist(), order)
        assert mean[n] == pytest.approx(expected_mean, abs=1e-12)
        got = list(zip(amplitude[n], phase[n], period[n], strict=True))
        real = [part for part in parts if part[0] > 0]
        np.testing.assert_allclose(got[: len(real)], real, atol=1e-9)
        assert (amplitude[n, len(real) :] == 0).all()
        for t in (0.0, 30_000.0, 100_000.0):
            value = fremen.predict(t, mean[n], amplitude[n], phase[n], period[n])
            assert value == pytest.approx(twins.fremen_value(t, expected_mean, parts), abs=1e-9)


@pytest.mark.parametrize("level", [0.0, 0.3, 1.0])
def test_constant_signal_is_its_mean(level):
    mean, amplitude, phase, period = fremen.analyse(TWO_DAYS, np.full(288, level), 2)
    np.testing.assert_allclose(amplitude, 0.0, atol=1e-12)
    np.testing.assert_allclose(fremen.predict(54_321.0, mean, amplitude, phase, period), [level], atol=1e-9)


@pytest.mark.parametrize(("t", "expected"), [(0.0, 1.0), (DAY / 2, 0.0), (DAY / 4, 0.5)])
def test_prediction_is_clipped(t, expected):
    # 0.5 + 2 * 0.4 cos(2 pi t / day) = 1.3, -0.3, 0.5
    part = (np.array([[v]]) for v in (0.4, 0.0, DAY))
    assert fremen.predict(t, np.array([0.5]), *part) == pytest.approx([expected], abs=1e-12)


# --- orientation bins and signals ---------------------------------------------------------------------------


@pytest.mark.parametrize("orientations", [4, 8, 12])
def test_every_angle_belongs_to_the_nearest_direction(orientations):
    heading = np.random.default_rng(3).uniform(-2 * np.pi, 4 * np.pi, 2000)
    expected = [twins.nearest_orientation(h, orientations) for h in heading]
    assert stef.orientation_bin(heading, orientations).tolist() == expected


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        (0, 0), (22.4, 0), (22.6, 1), (45, 1), (67.4, 1), (67.6, 2), (180, 4), (-180, 4), (-22.4, 0), (-22.6, 7),
        (-45, 7), (-90, 6), (-135, 5), (-157.6, 4), (202.4, 4), (202.6, 5), (337.4, 7), (337.6, 0), (350, 0),
        (359.9, 0), (360, 0), (382.6, 1),
    ],
)  # fmt: skip
def test_eight_bins_by_hand(degrees, expected):
    assert stef.orientation_bin(np.radians(degrees), 8) == expected


@pytest.mark.parametrize("border", range(8))
def test_a_border_belongs_to_one_of_its_two_neighbours(border):
    got = stef.orientation_bin(np.radians(22.5 + 45 * border), 8)
    assert got in {border, (border + 1) % 8}


def walks(seed, days, timezone_offset_h=9, n=300):
    """Rows on local days (offsets from 2030-10-02): t unix, x, y, heading in (-pi, pi]."""
    rng = np.random.default_rng(seed)
    midnight = 1917183600.0 - 86400.0  # 2030-10-02 00:00 in Japan
    assert (midnight + 9 * 3600) % DAY == 0
    t = midnight + rng.choice(days, n) * DAY + rng.uniform(0, DAY, n)
    t[:4] = midnight + days[0] * DAY + np.array([0.0, 600.0, 599.999, DAY - 0.001])  # borders of intervals
    x, y = rng.uniform(-1.5, 1.5, (2, n))
    x[:6] = [-1.0, 0.0, 1.0, -0.001, 0.999, 0.0]  # borders of cells
    return t, x, y, rng.uniform(-np.pi, np.pi, n)


def tracks_of(t, x, y, heading, speed=1.0):
    """A track table of single rows."""
    n = len(t)
    return Tracks(np.arange(n), np.asarray(t, float), x, y, np.broadcast_to(speed, n), heading)


@pytest.mark.parametrize("days", [[0], [0, 1], [0, 4]])
def test_built_map_equals_the_plain_twin(days):
    rows = walks(4, days)
    table = stef.build(tracks_of(*rows), JAPAN).to_pydict()
    times, signals = twins.stef_signals(list(zip(*rows, strict=True)), "Asia/Tokyo", 8, 600)
    assert len(times) == 144 * len(days)
    keys = [
        (int(np.floor(x)), int(np.floor(y)), o)
        for x, y, o in zip(table["x"], table["y"], table["orientation"], strict=True)
    ]
    assert keys == [(*cell, o) for cell, o in signals]
    assert {x % 1 for x in table["x"] + table["y"]} == {0.5}  # centres
    for n, signal in enumerate(signals.values()):
        mean, parts = twins.fremen(times, signal, 2)
        assert table["mean"][n] == pytest.approx(mean, abs=1e-12)
        for k, part in enumerate(parts):
            got = (table["amplitudes"][n][k], table["phases"][n][k], table["periods"][n][k])
            assert got[0] == pytest.approx(part[0], abs=1e-9)
            if part[0] > 1e-9:
                assert got[2] == part[2]
                assert np.angle(np.exp(1j * (got[1] - part[1]))) == pytest.approx(0.0, abs=1e-6)


def test_signals_are_shares_of_the_busiest_direction():
    # One cell, the first interval: 4 go east, 2 north; the second: 1 north. Mean over the day's 144 intervals.
    t0 = 1917183600.0
    t = t0 + np.array([1, 2, 3, 4, 5, 6, 601], float)
    heading = np.array([0, 0, 0, 0, 1, 1, 1]) * np.pi / 2
    table = stef.build(tracks_of(t, np.full(7, 0.5), np.full(7, 0.5), heading), JAPAN).to_pydict()
    np.testing.assert_allclose(np.array(table["mean"]) * 144, [1, 0, 1.5, 0, 0, 0, 0, 0], atol=1e-12)


def test_rows_without_motion_do_not_count():
    rows = walks(5, [0])
    moving = tracks_of(*rows)
    still = tracks_of(*walks(6, [0]), speed=0.0)
    unknown = tracks_of(*walks(7, [0])[:3], np.full(300, np.nan), np.nan)
    together = stef.build(concatenate([still, moving, unknown]), JAPAN)
    assert together.equals(stef.build(moving, JAPAN))


def test_days_without_data_are_left_out_and_times_keep_their_distance():
    rows = walks(8, [0, 4])
    table = stef.build(tracks_of(*rows), JAPAN).to_pydict()
    # Five calendar days from the first to the last interval: the daily period is admitted.
    assert max(map(max, table["periods"])) == DAY


def test_the_day_is_the_local_day():
    # 23:30 UTC is 08:30 of the next day in Japan: both rows are of one interval, and of one day.
    t = 1917129600.0 + 23.5 * 3600 + np.array([0.0, 60.0])
    assert 1917129600.0 % DAY == 0
    table = stef.build(tracks_of(t, np.full(2, 0.5), np.full(2, 0.5), np.zeros(2)), JAPAN)
    share = {hour: stef.evaluate(table, hour * 3600.0)["probabilities"][0].as_py()[0] for hour in (8.5, 20.5)}
    value = {
        hour: fremen.predict(hour * 3600, *(np.array(table[name][0].as_py()) for name in
                             ("mean", "amplitudes", "phases", "periods")))
        for hour in (8.5, 14.5)
    }  # fmt: skip
    assert value[8.5] > 3 * value[14.5]
    assert share[8.5] == 1.0


def test_build_needs_headings():
    with pytest.raises(DataError, match="heading"):
        stef.build(tracks_of(*walks(9, [0])[:3], np.full(300, np.nan)), JAPAN)


# --- probabilities ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hour", [3, 9, 14, 20])
def test_probabilities_equal_the_twin_and_sum_to_one_or_zero(hour):
    rows = walks(10, [0, 1])
    table = stef.build(tracks_of(*rows), JAPAN)
    t = stef.middle_of_hour(hour)
    assert t == hour * 3600 + 1800
    got = np.array(stef.evaluate(table, t)["probabilities"].to_pylist())
    times, signals = twins.stef_signals(list(zip(*rows, strict=True)), "Asia/Tokyo", 8, 600)
    values = np.array([twins.fremen_value(t, *twins.fremen(times, signal, 2)) for signal in signals.values()])
    values = values.reshape(-1, 8)
    total = values.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(got, np.where(total > 0, values / np.where(total > 0, total, 1), 0), atol=1e-9)
    sums = got.sum(axis=1)
    assert ((np.abs(sums - 1) < 1e-12) | (sums == 0)).all()


def test_cell_that_is_predicted_empty_keeps_zeros():
    columns = {"x": [0.5] * 8, "y": [0.5] * 8, "orientation": range(8), "mean": [0.1] * 8,
               "amplitudes": [[0.1, 0.0]] * 8, "phases": [[0.0, 0.0]] * 8, "periods": [[DAY, DAY]] * 8}  # fmt: skip
    table = pa.table(columns).replace_schema_metadata({"resolution": "1.0", "orientations": "8"})
    # 0.1 + 0.2 cos: -0.1, clipped to 0, at noon; 0.3 at midnight
    assert stef.evaluate(table, DAY / 2)["probabilities"].to_pylist() == [[0.0] * 8]
    assert stef.evaluate(table, 0.0)["probabilities"].to_pylist() == [[0.125] * 8]


# --- sampling -----------------------------------------------------------------------------------------------


def evaluated(x, y, probabilities, resolution=1.0):
    """A table as `stef.evaluate` gives it."""
    columns = {"x": x, "y": y, "probabilities": stef._lists(np.asarray(probabilities, float))}
    metadata = {"resolution": str(resolution), "orientations": str(len(probabilities[0]))}
    return pa.table(columns).replace_schema_metadata(metadata)


def grid_of_cells(seed, resolution=1.0, size=7):
    """Cells with holes; some have no dynamics, and some directions have none."""
    rng = np.random.default_rng(seed)
    cells = [(i, j) for i in range(size) for j in range(size) if rng.random() < 0.6]
    share = rng.random((len(cells), 8)) * (rng.random((len(cells), 8)) < 0.7)
    share[rng.random(len(cells)) < 0.2] = 0.0
    total = share.sum(axis=1, keepdims=True)
    share = np.where(total > 0, share / np.where(total > 0, total, 1), 0.0)
    x, y = ((np.array(cells) + 0.5) * resolution).T
    return x, y, share


@pytest.mark.parametrize("radius", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("resolution", [1.0, 0.5])
def test_sample_equals_the_plain_twin(radius, resolution):
    cells = grid_of_cells(11, resolution)
    mod = stef.StefMap(evaluated(*cells, resolution), radius)
    rng = np.random.default_rng(12)
    x, y = rng.uniform(-2, 9, (2, 400)) * resolution
    x[:100], y[:100] = rng.integers(-2, 18, (2, 100)) / 2 * resolution  # centres and corners of cells: ties
    uniforms = rng.uniform(size=(400, 1))
    speed = rng.uniform(0, 2, 400)
    got = mod.sample(x, y, speed, np.zeros(400), np.zeros(400), uniforms)
    plain = twins.PlainStef(*(part.tolist() for part in cells), radius)
    expected = [plain.sample(*particle) for particle in zip(x, y, speed, uniforms, strict=True)]
    found = got[3]
    assert found.tolist() == [e is not None for e in expected]
    assert 0 < found.sum() < 400
    np.testing.assert_allclose(np.column_stack(got[:3])[found], [e for e in expected if e is not None], atol=1e-12)


@pytest.mark.parametrize(("x", "found"), [(1.5, True), (1.500001, False), (-0.5, True), (-0.500001, False)])
def test_border_of_the_sampling_radius_is_inside(x, found):
    mod = stef.StefMap(evaluated([0.5], [0.5], [[0.125] * 8]), 1.0)
    ones = np.ones(1)
    assert mod.sample(np.array([x]), 0.5 * ones, ones, ones, ones, np.array([[0.5]]))[3].tolist() == [found]


def test_nearest_cell_without_dynamics_stops_the_walker():
    mod = stef.StefMap(evaluated([0.5, 1.5], [0.5, 0.5], [[0.0] * 8, [1.0] + [0.0] * 7]), 1.0)
    x, half = np.array([0.9, 1.1]), np.full(2, 0.5)
    assert mod.sample(x, half, half, half, half, np.full((2, 1), 0.5))[3].tolist() == [False, True]


def test_directions_get_their_shares_of_the_draws():
    share = np.array([0.3, 0.0, 0.25, 0.05, 0.2, 0.0, 0.1, 0.1])
    mod = stef.StefMap(evaluated([0.5], [0.5], [share]), 1.0)
    n = 20_000
    ones, uniforms = np.ones(n), np.random.default_rng(13).uniform(size=(n, mod.draws))
    speed, heading, log_fitness, found = mod.sample(0.5 * ones, 0.5 * ones, 1.3 * ones, ones, ones, uniforms)
    assert found.all()
    assert (speed == 1.3).all()
    assert heading.min() > -np.pi
    assert heading.max() <= np.pi
    drawn = np.rint(heading / (np.pi / 4)).astype(int) % 8
    np.testing.assert_allclose(np.angle(np.exp(1j * (heading - drawn * np.pi / 4))), 0.0, atol=1e-12)
    counts = np.bincount(drawn, minlength=8)
    assert counts[share == 0].tolist() == [0, 0]
    assert stats.chisquare(counts[share > 0], n * share[share > 0]).pvalue > 0.01
    np.testing.assert_allclose(log_fitness, np.log(share[drawn]), rtol=1e-12)


@pytest.mark.parametrize("u", [1e-17, 1 - 2**-53])
def test_extreme_draws_pick_a_direction_that_exists(u):
    share = [0.0, 0.1, 0.2, 0.3, 0.1, 0.2, 0.1, 0.0]
    mod = stef.StefMap(evaluated([0.5], [0.5], [share]), 1.0)
    ones = np.ones(1)
    _, heading, log_fitness, found = mod.sample(0.5 * ones, 0.5 * ones, ones, ones, ones, np.array([[u]]))
    assert found.all()
    assert heading[0] == pytest.approx(np.pi / 4 if u < 0.5 else -np.pi / 2)
    assert log_fitness[0] == pytest.approx(np.log(0.1))


def test_saved_map_samples_alike(tmp_path):
    table = stef.evaluate(stef.build(tracks_of(*walks(14, [0, 1])), JAPAN), stef.middle_of_hour(12))
    write_parquet(table, tmp_path / "12.parquet", dataset="test", hour=12)
    rng = np.random.default_rng(15)
    particles = (*rng.uniform(-4, 4, (2, 300)), np.ones(300), np.ones(300), np.ones(300), rng.uniform(size=(300, 1)))
    before = stef.StefMap(table, 1.0).sample(*particles)
    after = stef.load(tmp_path / "12.parquet", JAPAN, RollOut(sampling_radius_m=1.0)).sample(*particles)
    assert 0 < before[3].sum() < 300
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


# --- planted flows ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hall():
    """STeF-map of the demo hall's two training days."""
    days = [recording.day for recording in demo.RECORDINGS if (recording.site, recording.split) == ("hall", "train")]
    tables = [twins.demo_tracks(day) for day in days]
    later = tables[1]._replace(track_id=tables[1].track_id + 10**9)  # ids differ between the days
    return stef.build(concatenate([tables[0], later]), JAPAN)


def share_towards(table, hour, x, y, heading):
    """Probability of the directions within 45 degrees of `heading` around a place, mean over the cells with any."""
    hourly = stef.evaluate(table, stef.middle_of_hour(hour)).to_pydict()
    toward = np.cos(np.arange(8) * np.pi / 4 - heading) > 0.7
    shares = [
        np.array(p)[toward].sum()
        for cx, cy, p in zip(hourly["x"], hourly["y"], hourly["probabilities"], strict=True)
        if np.hypot(cx - x, cy - y) < 2.0 and sum(p) > 0
    ]
    assert len(shares) >= 4
    return np.mean(shares)


@pytest.mark.parametrize("place", ["west arm", "south", "north", "east arm", "west link", "east link"])
def test_planted_change_from_morning_to_evening_is_visible(hall, place):
    shares = {"morning": [], "evening": []}  # of the direction that is planted to prevail in the morning
    main = max((flow for flow in planted_flows("hall", 9) if flow.place == place), key=lambda flow: flow.share)
    for when, hours in (("morning", (9, 10)), ("evening", (19, 20))):
        for hour in hours:
            planted = {flow.heading: flow.share for flow in planted_flows("hall", hour) if flow.place == place}
            assert (planted[main.heading] > 0.7) == (when == "morning")
            shares[when].append(share_towards(hall, hour, main.x, main.y, main.heading))
    assert np.mean(shares["morning"]) > 0.65
    assert np.mean(shares["evening"]) < 0.45


def test_a_position_far_away_is_named_instead_of_filling_the_memory():
    certain = pa.array([[1.0], [1.0]], pa.list_(pa.float64(), 1))
    table = pa.table({"x": [0.5, 3000.5], "y": [0.5, 3000.5], "probabilities": certain})
    with pytest.raises(DataError, match="far away"):
        stef.StefMap(table.replace_schema_metadata({"resolution": "1.0", "orientations": "1"}))


def test_the_whole_day_is_the_mean_of_the_directions():
    """In a cell with 3 detections to the east at noon and 1 to the north at 18 h, both directions fill one interval."""
    tracks = concatenate(
        Tracks(
            np.full(n, n), 3600.0 * hour + np.arange(n), np.full(n, 0.5), np.full(n, 0.5), np.ones(n), np.full(n, way)
        )
        for n, hour, way in ((3, 12, 0.0), (1, 18, np.pi / 2))
    )
    table, hours = stef.build_hours(tracks, Site(), stef.StefBuilding(orientations=4))
    assert list(hours) == [12, 18]
    found = stef.load_whole(table, Site(), RollOut()).probabilities
    np.testing.assert_allclose(found, [[0.5, 0.5, 0, 0]])  # each interval counts alike, by its busiest direction
    with pytest.raises(DataError, match="not a STeF-map"):
        stef.load_whole(hours[12], Site(), RollOut())
