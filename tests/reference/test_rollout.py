"""Roll-out, current velocity and random numbers: against Algorithm 1 for one particle, and against what must hold."""

import math

import numpy as np
import pyarrow as pa
import pytest
import twins
from scipy import stats

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.cvm import constant_velocity
from modlhmp.forecasting.median import with_median
from modlhmp.forecasting.observe import Observed, current_velocity, observation_weights, observe
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.forecasting.rollout import roll_out
from modlhmp.maps.base import HourlyMod
from modlhmp.maps.cliff import COLUMNS as CLIFF_COLUMNS
from modlhmp.maps.cliff import CliffMap
from modlhmp.maps.stef import StefMap
from modlhmp.site import Site
from modlhmp.streams import stream_keys, uniforms
from modlhmp.tracks import Tracks, usable_tracks

NAMES = ("hall", "cliff", "day1")
SITE = Site(observed_rows=4, horizon_s=10.0, time_step_s=1.0)
STEPS = 25


def nobody(n):
    """No neighbours, for n walkers."""
    return np.empty((n, 0, 4, 2))


def walkers(seed, n=12):
    """Observed rows and velocities at t0 of `n` persons in the square [0, 8] m."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(1, 7, (2, n, 1)) + rng.normal(0, 0.1, (2, n, 4))
    speed, heading = rng.uniform(0.3, 1.6, (n, 4)), rng.uniform(-np.pi, np.pi, (n, 4))
    t = 1.9e9 + np.arange(4.0) + rng.uniform(0, 3600, (n, 1))
    observed = Observed(np.arange(100, 100 + n), t, x, y, speed, heading, nobody(n))
    return observed, (speed[:, -1], heading[:, -1])


def cliff_columns(seed, size=9, rotated=False):
    """Columns of a CLiFF-map of the square with a few holes; p differs everywhere. Rotated: by 90 degrees."""
    rng = np.random.default_rng(seed)
    columns = {name: [] for name in CLIFF_COLUMNS}
    nodes = [(i, j) for i in range(size) for j in range(size) if rng.random() > 0.12]
    for n, (i, j) in enumerate(nodes):
        x, y = (-j, i) if rotated else (i, j)
        p = (n + 1) * 37 % 101 / 101
        for weight in (0.7, 0.3):
            heading = twins.wrap(rng.uniform(-3, 3) + (np.pi / 2 if rotated else 0.0))
            mean_speed = rng.uniform(0.5, 1.5)
            values = (n, float(x), float(y), weight, heading, mean_speed, 0.15, 0.02, 0.05, 50, p, 1.0)
            for name, value in zip(CLIFF_COLUMNS, values, strict=True):
                columns[name].append(value)
    return columns


def cliff_map(columns, radius=1.0):
    """The package's map of such columns."""
    return CliffMap(pa.table(columns).replace_schema_metadata({"resolution": "1.0"}), radius)


def stef_cells(seed, size=9):
    """Cell centres of the square and their direction probabilities; some cells without dynamics."""
    rng = np.random.default_rng(seed)
    cells = np.array([(i + 0.5, j + 0.5) for i in range(size) for j in range(size) if rng.random() > 0.1])
    share = rng.random((len(cells), 8)) ** 3
    share[rng.random(len(cells)) < 0.05] = 0.0
    total = share.sum(axis=1, keepdims=True)
    return *cells.T, share / np.where(total > 0, total, 1.0)


def stef_map(x, y, share, radius=1.0):
    """The package's map of such cells."""
    lists = pa.FixedSizeListArray.from_arrays(pa.array(share.ravel()), 8)
    table = pa.table({"x": x, "y": y, "probabilities": lists})
    return StefMap(table.replace_schema_metadata({"resolution": "1.0", "orientations": "8"}), radius)


class Field:
    """A MoD written for a test: `velocity(x, y, speed, heading)` wherever `inside(x, y)`; records what it is given."""

    draws = 1

    def __init__(self, velocity, inside=lambda x, y: np.full(len(x), True)):
        self.velocity, self.inside, self.calls = velocity, inside, []

    def sample(self, x, y, speed, heading, t, draws):
        self.calls.append((x.copy(), y.copy(), t.copy(), draws.copy()))
        sampled = self.velocity(x, y, speed, heading)
        return *sampled, np.full(len(x), -0.5), self.inside(x, y)


def keys_of(observed, k, seed=0):
    return stream_keys(observed.track_id, k, seed, *NAMES)


def assert_same(one, other):
    """Two forecasts are equal to the last bit."""
    np.testing.assert_array_equal(one.xy, other.xy)
    np.testing.assert_array_equal(one.log_fitness, other.log_fitness)
    np.testing.assert_array_equal(one.steps_alive, other.steps_alive)


# --- Algorithm 1 --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed_rule", ["constant", "kernel"])
@pytest.mark.parametrize("beta", [0.0, 0.3, 1.0, 10.0])
@pytest.mark.parametrize("kind", ["cliff", "stef"])
def test_equals_algorithm_1_particle_by_particle(kind, beta, speed_rule):
    observed, velocity = walkers(1)
    radius, step_s, k = 0.8, 0.9, 3
    if kind == "cliff":
        columns = cliff_columns(2)
        mod, plain = cliff_map(columns, radius), twins.PlainCliff(columns, radius)
    else:
        cells = stef_cells(3)
        mod, plain = stef_map(*cells, radius), twins.PlainStef(*(part.tolist() for part in cells), radius)
    keys = keys_of(observed, k)
    got = roll_out(mod, observed, velocity, STEPS, keys, step_s, beta, speed_rule)
    assert got.output == "ranked"
    for n in range(len(keys)):
        for s in range(k):
            draws = [uniforms(keys[n, s : s + 1], step, plain.draws)[0] for step in range(STEPS)]
            start = observed.x[n, -1], observed.y[n, -1], velocity[0][n], velocity[1][n]
            path, fitness, alive = twins.roll_out(plain, *start, draws, step_s, beta, speed_rule)
            assert got.steps_alive[n, s] == alive
            np.testing.assert_allclose(got.xy[n, s], path, atol=1e-5)
            np.testing.assert_allclose(got.log_fitness[n, s], fitness, atol=1e-4)
    lived = got.steps_alive
    assert lived.min() < STEPS  # some leave the map
    assert lived.max() >= 5


def test_one_step_by_hand():
    observed, _ = walkers(4, n=2)
    velocity = np.array([1.0, 1.0]), np.array([0.0, np.pi - 0.1])
    field = Field(lambda x, y, v, h: (np.array([1.5, 0.5]), np.array([0.4, -np.pi + 0.1])))
    got = roll_out(field, observed, velocity, 2, keys_of(observed, 1), 1.0, 2.0, "kernel").xy[:, 0]
    start = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
    np.testing.assert_allclose(got[:, 0], start + np.array([[1, 0], [-math.cos(0.1), math.sin(0.1)]]), atol=1e-5)
    # heading + d exp(-beta d^2), d = 0.4 and, across the seam, 0.2; speed + (+-0.5) exp(-2 * 0.25)
    heading = [0.4 * math.exp(-0.32), np.pi - 0.1 + 0.2 * math.exp(-0.08)]
    speed = [1 + 0.5 * math.exp(-0.5), 1 - 0.5 * math.exp(-0.5)]
    second = [[v * math.cos(h), v * math.sin(h)] for v, h in zip(speed, heading, strict=True)]
    np.testing.assert_allclose(got[:, 1] - got[:, 0], second, atol=1e-5)


def test_position_moves_before_the_map_is_asked():
    observed, velocity = walkers(5)
    field = Field(lambda x, y, v, h: (v, h))
    got = roll_out(field, observed, velocity, 3, keys_of(observed, 2), 1.0, 1.0, "constant")
    assert len(field.calls) == 3  # once a step, never at t0
    for step, (x, y, t, draws) in enumerate(field.calls):
        np.testing.assert_allclose(got.xy[:, :, step].reshape(-1, 2), np.column_stack([x, y]), atol=1e-5)
        np.testing.assert_array_equal(t, np.repeat(observed.t[:, -1], 2))  # t0 picks the hour for the whole roll-out
        np.testing.assert_array_equal(draws, uniforms(keys_of(observed, 2).ravel(), step, 1))


@pytest.mark.parametrize("speed_rule", ["constant", "kernel"])
@pytest.mark.parametrize("step_s", [1.0, 0.4])
def test_map_that_knows_only_the_present_velocity_is_the_constant_velocity_model(speed_rule, step_s):
    observed, velocity = walkers(6)
    field = Field(lambda x, y, v, h: (v, h))
    got = roll_out(field, observed, velocity, STEPS, keys_of(observed, 2), step_s, 1.0, speed_rule)
    expected = constant_velocity(observed, velocity, STEPS, step_s)
    np.testing.assert_allclose(got.xy, np.repeat(expected.xy, 2, axis=1), atol=1e-4)
    assert (got.steps_alive == STEPS).all()
    assert (expected.steps_alive == STEPS).all()
    np.testing.assert_allclose(got.log_fitness[0, 0], -0.5 * np.arange(1, STEPS + 1), atol=1e-5)


def test_large_beta_is_the_constant_velocity_model():
    observed, velocity = walkers(7)
    away = Field(lambda x, y, v, h: (v + 1.0, h + 2.0))
    got = roll_out(away, observed, velocity, STEPS, keys_of(observed, 1), 1.0, 1e4, "kernel")
    np.testing.assert_allclose(got.xy, constant_velocity(observed, velocity, STEPS).xy, atol=1e-4)


def test_beta_zero_follows_the_map():
    observed, velocity = walkers(8)
    north = Field(lambda x, y, v, h: (np.full(len(x), 0.7), np.full(len(x), np.pi / 2)))
    got = roll_out(north, observed, velocity, 5, keys_of(observed, 1), 1.0, 0.0, "kernel").xy[:, 0]
    steps = np.diff(got, axis=1)
    np.testing.assert_allclose(steps, np.broadcast_to([0.0, 0.7], steps.shape), atol=1e-5)


def test_constant_speed_ignores_the_speed_of_the_map():
    observed, velocity = walkers(9)
    field = Field(lambda x, y, v, h: (v + 5.0, h + 0.3))
    got = roll_out(field, observed, velocity, STEPS, keys_of(observed, 1), 1.0, 1.0, "constant").xy[:, 0]
    lengths = np.hypot(*np.moveaxis(np.diff(got, axis=1), -1, 0))
    np.testing.assert_allclose(lengths, np.repeat(velocity[0][:, None], STEPS - 1, axis=1), atol=1e-4)


def test_constant_velocity_by_hand():
    observed, _ = walkers(10, n=1)
    got = constant_velocity(observed, (np.array([2.0]), np.array([np.pi / 6])), 3, 0.5)
    start = np.array([observed.x[0, -1], observed.y[0, -1]])
    expected = start + np.array([1, 2, 3])[:, None] * 0.5 * np.array([math.sqrt(3), 1.0])
    np.testing.assert_allclose(got.xy, expected[None, None], atol=1e-5)
    assert got.output == "single"


# --- stopping -----------------------------------------------------------------------------------------------


def test_without_dynamics_everyone_is_held_at_t0():
    observed, velocity = walkers(11)
    nowhere = Field(lambda x, y, v, h: (v, h), lambda x, y: np.full(len(x), False))
    got = roll_out(nowhere, observed, velocity, STEPS, keys_of(observed, 3))
    start = np.stack([observed.x[:, -1], observed.y[:, -1]], -1)[:, None, None].astype(np.float32)
    np.testing.assert_array_equal(got.xy, np.broadcast_to(start, got.xy.shape))
    assert not got.steps_alive.any()
    assert not got.log_fitness.any()


def test_stopped_particles_are_held_at_their_last_alive_position():
    observed, _ = walkers(12, n=2)
    velocity = np.array([1.0, 0.25]), np.zeros(2)  # eastward
    edge = observed.x[:, -1].max() + 3.5
    field = Field(lambda x, y, v, h: (v, h), lambda x, y: x <= edge)
    got = roll_out(field, observed, velocity, STEPS, keys_of(observed, 1))
    for n, speed in enumerate(velocity[0]):
        alive = min(math.floor((edge - observed.x[n, -1]) / speed), STEPS)
        assert got.steps_alive[n, 0] == alive
        steps = np.minimum(np.arange(1, STEPS + 1), alive)
        np.testing.assert_allclose(got.xy[n, 0, :, 0], observed.x[n, -1] + steps * speed, atol=1e-5)
        np.testing.assert_allclose(got.log_fitness[n, 0], -0.5 * steps, atol=1e-5)


def test_particle_that_stopped_does_not_come_back():
    observed, _ = walkers(13, n=1)
    start = observed.x[0, -1]
    gap = Field(lambda x, y, v, h: (v, h), lambda x, y: np.abs(x - start - 3) > 0.5)  # no dynamics at the third step
    got = roll_out(gap, observed, (np.ones(1), np.zeros(1)), 6, keys_of(observed, 1))
    assert got.steps_alive.tolist() == [[2]]
    assert len(gap.calls) == 3  # nobody is left to ask for


@pytest.mark.parametrize("kind", ["cliff", "stef"])
def test_held_after_the_stop_on_real_maps(kind):
    observed, velocity = walkers(14, n=30)
    mod = cliff_map(cliff_columns(2), 0.7) if kind == "cliff" else stef_map(*stef_cells(3), 0.7)
    got = roll_out(mod, observed, velocity, STEPS, keys_of(observed, 4))
    assert got.steps_alive.min() == 0
    assert 5 < got.steps_alive.max() < STEPS
    for xy, fitness, alive in zip(
        got.xy.reshape(-1, STEPS, 2), got.log_fitness.reshape(-1, STEPS), got.steps_alive.ravel(), strict=True
    ):
        if alive:
            assert (xy[alive - 1 :] == xy[alive - 1]).all()
            assert (fitness[alive - 1 :] == fitness[alive - 1]).all()
            assert (np.diff(fitness[:alive]) != 0).all()


def test_hour_of_t0_picks_the_map():
    observed, velocity = walkers(15, n=3)
    # 10:30:00, 23:59:59 and 0:00:00 of a day in London, in summer: one hour ahead of UTC.
    t0 = np.array([9.5 * 3600, 23 * 3600 - 1, 23 * 3600]) + 1912982400.0
    observed = observed._replace(t=t0[:, None] + np.arange(-3.0, 1.0))
    east = Field(lambda x, y, v, h: (v, np.zeros(len(x))))
    west = Field(lambda x, y, v, h: (v, np.full(len(x), np.pi)))
    mod = HourlyMod({10: east, 23: west}, "Europe/London")
    got = roll_out(mod, observed, velocity, 8, keys_of(observed, 2), beta=0.0)
    assert got.steps_alive.tolist() == [[8, 8], [8, 8], [0, 0]]  # no map at 0 h
    moved = got.xy[:, :, -1, 0] - got.xy[:, :, 0, 0]
    np.testing.assert_allclose(moved, 7 * velocity[0][:, None] * [[1, 1], [-1, -1], [0, 0]], atol=1e-4)


def test_an_hour_without_a_map_may_use_that_of_the_whole_day():
    observed, velocity = walkers(15, n=2)
    observed = observed._replace(t=np.array([[9.5 * 3600], [23 * 3600]]) + 1912982400.0 + np.arange(-3.0, 1.0))
    east = Field(lambda x, y, v, h: (v, np.zeros(len(x))))
    west = Field(lambda x, y, v, h: (v, np.full(len(x), np.pi)))
    got = roll_out(HourlyMod({10: east}, "Europe/London", west), observed, velocity, 8, keys_of(observed, 2), beta=0.0)
    assert (got.steps_alive == 8).all()
    moved = got.xy[:, :, -1, 0] - got.xy[:, :, 0, 0]
    np.testing.assert_allclose(moved, 7 * velocity[0][:, None] * [[1, 1], [-1, -1]], atol=1e-4)


# --- independence -------------------------------------------------------------------------------------------


@pytest.fixture(params=["cliff", "stef"])
def mod(request):
    return cliff_map(cliff_columns(2)) if request.param == "cliff" else stef_map(*stef_cells(3))


def take(observed, velocity, rows):
    return Observed(*(part[rows] for part in observed)), tuple(part[rows] for part in velocity)


def test_order_of_the_tracks_does_not_matter(mod):
    observed, velocity = walkers(16)
    whole = roll_out(mod, observed, velocity, STEPS, keys_of(observed, 5))
    order = np.random.default_rng(16).permutation(len(observed.t))
    mixed, mixed_velocity = take(observed, velocity, order)
    got = roll_out(mod, mixed, mixed_velocity, STEPS, keys_of(mixed, 5))
    assert_same(got, whole._replace(**{name: getattr(whole, name)[order] for name in whole._fields[:3]}))


@pytest.mark.parametrize("rows", [[0], [11], [3, 7], [0, 2, 4, 6, 8, 10]])
def test_a_shard_is_forecast_as_in_the_whole(mod, rows):
    observed, velocity = walkers(17)
    whole = roll_out(mod, observed, velocity, STEPS, keys_of(observed, 5))
    few, few_velocity = take(observed, velocity, rows)
    got = roll_out(mod, few, few_velocity, STEPS, keys_of(few, 5))
    assert_same(got, whole._replace(**{name: getattr(whole, name)[rows] for name in whole._fields[:3]}))


def test_the_first_five_of_twenty_are_the_five(mod):
    observed, velocity = walkers(18)
    five = roll_out(mod, observed, velocity, STEPS, keys_of(observed, 5))
    twenty = roll_out(mod, observed, velocity, STEPS, keys_of(observed, 20))
    assert_same(five, twenty._replace(**{name: getattr(twenty, name)[:, :5] for name in twenty._fields[:3]}))


def test_shorter_horizon_is_a_prefix(mod):
    observed, velocity = walkers(19)
    long = roll_out(mod, observed, velocity, STEPS, keys_of(observed, 4))
    short = roll_out(mod, observed, velocity, 7, keys_of(observed, 4))
    np.testing.assert_array_equal(short.xy, long.xy[:, :, :7])
    np.testing.assert_array_equal(short.log_fitness, long.log_fitness[:, :, :7])
    np.testing.assert_array_equal(short.steps_alive, np.minimum(long.steps_alive, 7))


@pytest.mark.parametrize(
    "names", [(1, *NAMES), (0, "other", *NAMES[1:]), (0, "hall", "stef", "day1"), (0, "hall", "cliff", "day2")]
)
def test_seed_dataset_method_and_recording_change_the_numbers(mod, names):
    observed, velocity = walkers(20)
    one = roll_out(mod, observed, velocity, STEPS, keys_of(observed, 5))
    other = roll_out(mod, observed, velocity, STEPS, stream_keys(observed.track_id, 5, *names))
    np.testing.assert_allclose(one.xy[:, :, 0], other.xy[:, :, 0])  # the first step is before the first draw
    both = (one.steps_alive > 2) & (other.steps_alive > 2)
    differ = (one.xy != other.xy).any(axis=(2, 3))
    assert both.sum() > 20
    assert differ[both].mean() > 0.9  # of few steps on a map of eight directions some are alike


def test_samples_of_a_track_differ_from_each_other(mod):
    observed, velocity = walkers(21)
    got = roll_out(mod, observed, velocity, STEPS, keys_of(observed, 2))
    both = (got.steps_alive > 3).all(axis=1)
    assert both.sum() >= 4
    assert (got.xy[both, 0] != got.xy[both, 1]).any(axis=(1, 2)).all()


def recording_of(observed, extra=6):
    """A track table of persons who walk on straight after the observed rows."""
    tracks = []
    for n, person in enumerate(observed.track_id):
        rows = np.arange(4 + extra)
        x = np.interp(rows, range(4), observed.x[n]) + 0.1 * np.maximum(rows - 3, 0)
        y = np.interp(rows, range(4), observed.y[n])
        velocity = (np.resize(part[n], len(rows)) for part in (observed.speed, observed.heading))
        tracks.append(Tracks(np.full(len(rows), person), observed.t[n, 0] + rows, x, y, *velocity))
    return tracks


def test_forecast_of_a_recording_does_not_depend_on_shards_or_on_other_seeds(mod):
    observed, _ = walkers(22, n=6)
    persons = recording_of(observed)

    def forecaster(observed, steps, keys):
        return roll_out(mod, observed, current_velocity(observed, "as_recorded"), steps, keys)

    def forecast(persons, seeds):
        table = Tracks(*map(np.concatenate, zip(*persons, strict=True)))
        return {
            (seed, person): [part[n] for part in result[:3]]
            for seed, ids, result in forecast_recording(table, forecaster, SITE, NAMES, 3, seeds)
            for n, person in enumerate(ids)
        }

    whole = forecast(persons, [0, 1, 7])
    assert set(whole) == {(seed, person) for seed in (0, 1, 7) for person in observed.track_id}
    parts = {
        **forecast(persons[:2], [7]),
        **forecast(persons[2:], [7]),
        **forecast(persons, [1]),
        **forecast(persons, [0]),
    }
    assert set(parts) == set(whole)
    for key, expected in whole.items():
        for one, other in zip(parts[key], expected, strict=True):
            np.testing.assert_array_equal(one, other)


def test_forecast_of_a_recording_does_not_depend_on_how_many_tracks_are_forecast_together(mod, monkeypatch):
    observed, _ = walkers(24, n=7)
    table = Tracks(*map(np.concatenate, zip(*recording_of(observed), strict=True)))
    asked = []

    def forecaster(observed, steps, keys):
        asked.append(len(keys))
        return with_median(roll_out(mod, observed, current_velocity(observed, "as_recorded"), steps, keys))

    ((_, ids, whole),) = forecast_recording(table, forecaster, SITE, NAMES, 4, [0])
    monkeypatch.setattr("modlhmp.forecasting.recording.TRACKS_AT_ONCE", 3)
    for keep, expected in ((None, whole), (1, whole.first(2))):
        asked.clear()
        blocks = list(forecast_recording(table, forecaster, SITE, NAMES, 4, [0, 1], keep=keep))
        assert asked == 2 * [3, 3, 1]
        assert [seed for seed, _, _ in blocks] == [0] * 3 + [1] * 3
        assert np.concatenate([some for _, some, _ in blocks[:3]]).tolist() == ids.tolist()
        joined = (np.concatenate(parts) for parts in zip(*(one[:3] for _, _, one in blocks[:3]), strict=True))
        assert_same(Forecast(*joined, "median"), expected)


def test_only_futures_behind_a_median_are_left_out(mod):
    observed, velocity = walkers(25, n=3)
    table = Tracks(*map(np.concatenate, zip(*recording_of(observed), strict=True)))

    def forecaster(observed, steps, keys):
        return roll_out(mod, observed, velocity, steps, keys)

    ((_, _, forecast),) = forecast_recording(table, forecaster, SITE, NAMES, 4, [0], keep=2)
    assert forecast.xy.shape[1] == 4


def test_unusable_tracks_are_not_forecast():
    observed, _ = walkers(23, n=4)
    persons = recording_of(observed)
    persons[0] = persons[0].take(slice(0, 4))  # nothing to predict
    persons[1] = persons[1].take(slice(0, 5))  # five rows are enough
    persons[2] = persons[2]._replace(t=persons[2].t + np.where(np.arange(10) > 6, 5.001, 0.0))  # a gap of 6.001 s
    persons[3] = persons[3]._replace(t=persons[3].t + np.where(np.arange(10) > 6, 4.0, 0.0))  # a gap of 5 s
    table = Tracks(*map(np.concatenate, zip(*persons, strict=True)))
    assert table.track_id[usable_tracks(table, 4)[:, 0]].tolist() == [101, 103]


# --- rotation -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed_rule", ["constant", "kernel"])
def test_quarter_turn_of_tracks_and_map_turns_the_forecast(speed_rule):
    observed, velocity = walkers(24)
    turned = observed._replace(x=-observed.y, y=observed.x, heading=observed.heading + np.pi / 2)
    keys = keys_of(observed, 5)
    one = roll_out(cliff_map(cliff_columns(2)), observed, velocity, STEPS, keys, speed_rule=speed_rule)
    turned_velocity = velocity[0], np.array([twins.wrap(h + np.pi / 2) for h in velocity[1]])
    turned_map = cliff_map(cliff_columns(2, rotated=True))
    other = roll_out(turned_map, turned, turned_velocity, STEPS, keys, speed_rule=speed_rule)
    np.testing.assert_array_equal(other.steps_alive, one.steps_alive)
    np.testing.assert_allclose(other.xy, np.stack([-one.xy[..., 1], one.xy[..., 0]], -1), atol=1e-4)
    np.testing.assert_allclose(other.log_fitness, one.log_fitness, atol=1e-3)


@pytest.mark.parametrize("angle", [0.3, 1.0, 3.0])
def test_any_turn_of_a_smooth_field_turns_the_forecast(angle):
    observed, velocity = walkers(25)

    def swirl(turn):
        def velocity_at(x, y, v, h):
            along, across = x * np.cos(turn) + y * np.sin(turn), -x * np.sin(turn) + y * np.cos(turn)
            return v, np.sin(along / 3) + 0.2 * across + turn

        return Field(velocity_at)

    def rotate(x, y):
        return x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)

    keys = keys_of(observed, 1)
    one = roll_out(swirl(0.0), observed, velocity, STEPS, keys)
    x, y = rotate(observed.x, observed.y)
    other = roll_out(swirl(angle), observed._replace(x=x, y=y), (velocity[0], velocity[1] + angle), STEPS, keys)
    np.testing.assert_allclose(other.xy, np.stack(rotate(one.xy[..., 0], one.xy[..., 1]), -1), atol=1e-3)


# --- random numbers -----------------------------------------------------------------------------------------


def test_uniforms_are_uniform_and_never_repeat():
    keys = stream_keys(np.arange(1000), 5, 0, *NAMES).ravel()
    numbers = np.concatenate([uniforms(keys, step, 4).ravel() for step in range(5)])
    assert len(numbers) == 100_000
    assert len(np.unique(numbers)) == 100_000
    assert numbers.min() > 0
    assert numbers.max() < 1
    assert stats.kstest(numbers, "uniform").pvalue > 0.01


@pytest.mark.parametrize("draw", range(3))
def test_each_draw_of_a_step_is_uniform_over_tracks(draw):
    keys = stream_keys(10_000_000 + 100 * np.arange(20_000), 1, 3, *NAMES)[:, 0]  # ids as the hall has them
    numbers = uniforms(keys, 0, 3)[:, draw]
    assert stats.kstest(numbers, "uniform").pvalue > 0.01


@pytest.mark.parametrize("neighbour", ["track", "sample", "step", "draw", "seed", "number"])
def test_neighbouring_streams_are_not_correlated(neighbour):
    n = 20_000
    ids = np.arange(n + 1)
    keys = stream_keys(ids, 2, 0, *NAMES)
    one = uniforms(keys[:-1, 0], 4, 3)[:, 0]
    other = {
        "track": lambda: uniforms(keys[1:, 0], 4, 3)[:, 0],
        "sample": lambda: uniforms(keys[:-1, 1], 4, 3)[:, 0],
        "step": lambda: uniforms(keys[:-1, 0], 5, 3)[:, 0],
        "draw": lambda: uniforms(keys[:-1, 0], 4, 3)[:, 1],
        "seed": lambda: uniforms(stream_keys(ids[:-1], 1, 1, *NAMES)[:, 0], 4, 3)[:, 0],
        "number": lambda: uniforms(keys[:-1, 0] + np.uint64(1), 4, 3)[:, 0],  # keys that differ by one
    }[neighbour]()
    assert abs(np.corrcoef(one, other)[0, 1]) < 3.5 / math.sqrt(n)
    table = np.histogram2d(one, other, bins=10, range=[[0, 1], [0, 1]])[0]
    assert stats.chisquare(table.ravel()).pvalue > 0.01


def test_keys_depend_on_nothing_else_than_their_names():
    ids = np.array([7, -1, 2**62, 0])
    whole = stream_keys(ids, 6, 0, *NAMES)
    for n, person in enumerate(ids):
        np.testing.assert_array_equal(stream_keys([person], 3, 0, *NAMES)[0], whole[n, :3])
    assert len(np.unique(whole)) == whole.size


def test_names_are_not_just_strung_together():
    assert stream_keys([1], 1, 1, "2a", "b", "c") != stream_keys([1], 1, 12, "a", "b", "c")
    assert stream_keys([1], 1, 0, "ab", "c", "d") != stream_keys([1], 1, 0, "a", "bc", "d")


# --- current velocity ---------------------------------------------------------------------------------------


def test_observation_weights_of_three_observed_steps():
    # g(t) = exp(-t^2 / (2 * 1.5^2)), normalised
    np.testing.assert_allclose(observation_weights(3), [0.594, 0.305, 0.101], atol=6e-4)
    g = [math.exp(-0.5 * (t / 1.5) ** 2) for t in range(1, 6)]
    np.testing.assert_allclose(observation_weights(5), np.array(g) / sum(g), rtol=1e-12)


def test_recorded_velocities_by_hand():
    speed, heading = [[1.0, 2.0, 3.0, 99.0]], [[0.1, 0.2, 0.3, 3.0]]  # the row of t0 itself does not count
    observed = Observed(np.array([1]), *np.zeros((3, 1, 4)), np.array(speed), np.array(heading), nobody(1))
    got_speed, got_heading = current_velocity(observed, "as_recorded")
    w = [0.594, 0.305, 0.101]
    assert got_speed[0] == pytest.approx(3.0 * w[0] + 2.0 * w[1] + 1.0 * w[2], abs=2e-3)
    assert got_heading[0] == pytest.approx(0.3 * w[0] + 0.2 * w[1] + 0.1 * w[2], abs=2e-3)


def test_headings_are_averaged_across_the_seam():
    heading = np.array([[-np.pi + 0.2, np.pi - 0.1, -np.pi + 0.1, 0.0]])
    observed = Observed(np.array([1]), *np.zeros((3, 1, 4)), np.ones((1, 4)), heading, nobody(1))
    speed, got = current_velocity(observed, "as_recorded")
    w = observation_weights(3)
    vector = w[0] * np.exp(1j * heading[0, 2]) + w[1] * np.exp(1j * heading[0, 1]) + w[2] * np.exp(1j * heading[0, 0])
    assert got[0] == pytest.approx(np.angle(vector), abs=1e-12)
    assert abs(twins.wrap(got[0] - np.pi)) < 0.1  # a linear mean would be near -1
    assert speed[0] == pytest.approx(1.0)


def test_differences_by_hand():
    # Displacements (2, 0) in 2 s, (0, 1) in 1 s, (-1, 1) in 1 s; the last one ends at t0 and weighs most.
    t, x, y = [[0.0, 2.0, 3.0, 4.0]], [[5.0, 7.0, 7.0, 6.0]], [[1.0, 1.0, 2.0, 3.0]]
    wrong = np.full((1, 4), 99.0)
    observed = Observed(np.array([1]), np.array(t), np.array(x), np.array(y), wrong, wrong, nobody(1))
    speed, heading = current_velocity(observed, "differences")
    w = observation_weights(3)
    assert speed[0] == pytest.approx(w[0] * math.sqrt(2) + w[1] * 1.0 + w[2] * 1.0, abs=1e-12)
    directions = np.exp(1j * np.array([0.75 * np.pi, 0.5 * np.pi, 0.0]))
    assert heading[0] == pytest.approx(np.angle(w @ directions), abs=1e-12)


@pytest.mark.parametrize("source", ["as_recorded", "differences"])
def test_walking_straight_is_seen_as_such(source):
    t = np.arange(4.0)[None] + 1.9e9
    x, y = 1.2 * np.cos(2.5) * (t - t[0, 0]), 1.2 * np.sin(2.5) * (t - t[0, 0])
    observed = Observed(np.array([1]), t, x, y, np.full((1, 4), 1.2), np.full((1, 4), 2.5), nobody(1))
    speed, heading = current_velocity(observed, source)
    np.testing.assert_allclose([speed[0], heading[0]], [1.2, 2.5], atol=1e-9)


def test_observe_takes_the_first_rows_only():
    observed, _ = walkers(26, n=3)
    table = Tracks(*map(np.concatenate, zip(*recording_of(observed), strict=True)))
    got = observe(table, usable_tracks(table, 4), 4)
    np.testing.assert_array_equal(got.track_id, observed.track_id)
    for one, other in zip(got[1:], observed[1:], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)


@pytest.mark.parametrize("source", ["as_recorded", "differences"])
def test_current_velocity_does_not_depend_on_the_other_tracks(source):
    rng = np.random.default_rng(3)
    n = 500
    t = np.arange(4.0) + np.zeros((n, 1))
    x, y = rng.normal(0, 1, (2, n, 4))
    observed = Observed(np.arange(n), t, x, y, rng.uniform(0, 2, (n, 4)), rng.uniform(-np.pi, np.pi, (n, 4)), nobody(n))
    together = current_velocity(observed, source)
    for one in range(0, n, 7):
        alone = current_velocity(Observed(*(column[one : one + 1] for column in observed)), source)
        assert [part[0] for part in alone] == [part[one] for part in together]
