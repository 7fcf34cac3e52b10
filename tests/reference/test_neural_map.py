"""The neural map: maps read by interpolation, what may be seen and what not, and a planted place that it must learn."""

import logging
import math
from dataclasses import replace

import network_twins as twins
import numpy as np
import pytest
import torch
from crowds import walk
from network_twins import walking
from scipy.interpolate import RegularGridInterpolator

from modlhmp.forecasting.observe import Observed, observation_weights
from modlhmp.kinds import find
from modlhmp.methods import make_forecaster
from modlhmp.networks.data import day_of, observed_scene, scenes_at, whereabouts
from modlhmp.networks.neural_map import Grid, Network, at_pace
from modlhmp.networks.training import load_network, save_network, train
from modlhmp.options import Learning, NeuralMap
from modlhmp.site import Site
from modlhmp.streams import stream_keys
from modlhmp.tracks import concatenate

CELL_M, HEADINGS, CHANNELS = 2.5, 8, 3


def some_grid(seed=0):
    """A map of random numbers of 20 x 12 m at (-10, 5)."""
    torch.manual_seed(seed)
    grid = Grid(CELL_M, HEADINGS, CHANNELS).double()
    grid.cover(torch.tensor([-10.0, 5.0]), torch.tensor([10.0, 17.0]))
    grid.numbers.data.normal_()
    return grid


def some_network(seed=0, scenes=None, **options):
    """A network with maps of random numbers where made-up walkers are."""
    torch.manual_seed(seed)
    net = Network(twins.STEPS, twins.OBSERVED, 1.0, **options).double()
    net.prepare(walking(seed, n=200) if scenes is None else scenes)
    for grid in net.maps:
        grid.numbers.data.normal_()
    return net.eval()


def forecast(net, scenes):
    with torch.no_grad():
        return net.forecast(scenes.past, scenes.past_present, None, scenes.where)[:, 0]


# --- reading a map ------------------------------------------------------------------------------------------


def test_a_map_covers_its_area_and_a_cell_more():
    grid = some_grid()
    assert grid.corner.tolist() == [-12.5, 2.5]
    rows, columns = grid.numbers.shape[2:]
    assert (columns - 1) * CELL_M - 12.5 >= 10 + CELL_M
    assert (rows - 1) * CELL_M + 2.5 >= 17 + CELL_M


def test_reading_equals_scipys_interpolation():
    grid, rng = some_grid(), np.random.default_rng(1)
    rows, columns = grid.numbers.shape[2:]
    circle = np.concatenate([grid.numbers.detach().numpy(), grid.numbers.detach().numpy()[:, :1]], 1)
    turns = np.arange(HEADINGS + 1) * 2 * math.pi / HEADINGS
    axes = (turns, 2.5 + CELL_M * np.arange(rows), -12.5 + CELL_M * np.arange(columns))
    xy = rng.uniform([-12.5, 2.5], [axes[2][-1], axes[1][-1]], (500, 2))
    heading = rng.uniform(-3 * math.pi, 3 * math.pi, 500)
    got = grid(torch.from_numpy(xy), torch.from_numpy(heading)).detach().numpy()
    for channel in range(CHANNELS):
        expected = RegularGridInterpolator(axes, circle[channel])(
            np.column_stack([heading % (2 * math.pi), xy[:, ::-1]])
        )
        np.testing.assert_allclose(got[:, channel], expected, atol=1e-9)


def test_a_node_says_its_own_number_whatever_the_turns():
    grid = some_grid()
    for turns in (-1, 0, 2):
        for heading, row, column in ((0, 0, 0), (3, 2, 5), (7, 1, 1)):
            xy = grid.corner + CELL_M * torch.tensor([column, row])
            angle = torch.tensor([2 * math.pi * (heading / HEADINGS + turns)], dtype=torch.float64)
            torch.testing.assert_close(grid(xy[None].double(), angle)[0], grid.numbers[:, heading, row, column])


def test_headings_close_round_the_circle():
    grid, xy = some_grid(), torch.tensor([[1.3, 8.1]], dtype=torch.float64)
    a, b = (grid(xy, torch.tensor([angle], dtype=torch.float64)) for angle in (-1e-9, 1e-9))
    torch.testing.assert_close(a, b, atol=1e-7, rtol=0)
    between = grid(xy, torch.tensor([-math.pi / HEADINGS], dtype=torch.float64))
    ends = [grid(xy, torch.tensor([angle], dtype=torch.float64)) for angle in (-2 * math.pi / HEADINGS, 0.0)]
    torch.testing.assert_close(between, sum(ends) / 2)


def test_a_map_fades_to_nothing_within_a_cell_of_its_border():
    grid = some_grid()
    edge = grid.corner + torch.tensor([0.0, CELL_M])
    away = [edge + torch.tensor([-share * CELL_M, 0.0]) for share in (0.0, 0.5, 1.0, 1.5, 1e6)]
    at_edge, half, *outside = (grid(xy[None].double(), torch.zeros(1).double()) for xy in away)
    torch.testing.assert_close(half, at_edge / 2)
    assert all(torch.allclose(said, torch.zeros(1).double(), atol=1e-9) for said in outside)


def test_strays_do_not_make_maps_large():
    scenes = walking(2, n=3000)
    usual = some_network(2, scenes)
    scenes.where[0, 0] = 1e6
    assert [grid.numbers.shape for grid in some_network(2, scenes).maps] == [g.numbers.shape for g in usual.maps]


# --- what is seen -------------------------------------------------------------------------------------------


def test_a_forecast_is_a_change_of_constant_velocity():
    scenes = walking(3)
    net = some_network(3)
    for part in (net.layers[-1].weight, net.layers[-1].bias):
        part.data.zero_()
    past = scenes.past[:, 0].numpy()
    steady = (np.diff(past, axis=1) * observation_weights(3)[::-1, None]).sum(1)
    np.testing.assert_allclose(forecast(net, scenes), steady[:, None] * np.arange(1, 13)[:, None], atol=1e-5)


def test_the_place_shows_only_where_there_are_maps():
    scenes = walking(4)
    elsewhere = scenes._replace(where=scenes.where + torch.tensor([1.0, 2.0, 0.0]))
    assert not torch.allclose(forecast(some_network(4), scenes), forecast(some_network(4), elsewhere), atol=1e-4)
    free = some_network(4, grids=[])
    assert torch.equal(forecast(free, scenes), forecast(free, elsewhere))


@pytest.mark.parametrize("time_of_day", [True, False])
def test_the_hour_shows_only_if_asked_for_and_midnight_is_one_moment(time_of_day):
    scenes, net = walking(5), some_network(5, time_of_day=time_of_day)

    def at(hour):
        return forecast(net, scenes._replace(where=torch.cat([scenes.where[:, :2], 0 * scenes.where[:, :1] + hour], 1)))

    assert torch.allclose(at(9.0), at(15.0), atol=1e-6) != time_of_day
    torch.testing.assert_close(at(0.0), at(24.0))


def test_whereabouts_are_place_and_local_clock():
    t0 = np.array([1351036800.0, 1351036800.0 + 5400])  # 2012-10-24 00:00 UTC
    got = whereabouts(np.array([[1.5, -2.0], [3.0, 4.0]]), t0, "Asia/Tokyo")
    np.testing.assert_allclose(got, [[1.5, -2.0, 9.0], [3.0, 4.0, 10.5]])
    assert got.dtype == np.float32


def moved(scenes, by):
    """The scenes in a place whose axes begin elsewhere."""
    return scenes._replace(where=scenes.where + torch.cat([by, torch.zeros(1)]))


def test_moving_everything_moves_the_forecasts():
    scenes, by = walking(6, n=200), torch.tensor([512.0, -96.0])
    here, there = some_network(6, scenes), some_network(6, moved(scenes, by))
    torch.testing.assert_close(forecast(there, moved(scenes, by)), forecast(here, scenes), atol=1e-6, rtol=0)


@pytest.mark.parametrize("distance", [30.0, 1e4, 1e9])
def test_a_walker_outside_the_maps_is_forecast_as_where_nothing_is_known(distance):
    scenes, net = walking(7), some_network(7)
    outside = moved(scenes, torch.tensor([distance + 100, 0.0]))
    paths = forecast(net, outside)
    assert paths.isfinite().all()
    for grid in net.maps:
        grid.numbers.data.zero_()
    torch.testing.assert_close(paths, forecast(net, scenes), atol=1e-6, rtol=0)


def test_the_loss_sees_only_truth_that_is_there():
    net, scenes = some_network(8), walking(8)

    def loss(some):
        torch.manual_seed(1)
        return net.loss(some)

    noise = torch.where(scenes.future_present[..., None], scenes.future, 1e3 * torch.randn_like(scenes.future))
    assert torch.equal(loss(scenes._replace(future=noise)), loss(scenes))
    assert not torch.equal(loss(scenes._replace(future=scenes.future + 0.1)), loss(scenes))


def test_nobody_else_is_looked_for():
    tracks = concatenate([walk(n, np.arange(12.0), np.arange(12.0)[:, None] * [1.0, 0.1 * n]) for n in range(5)])
    day = day_of(tracks, [], Site())
    with_others, alone = (scenes_at(day, *day.rows.T, 8, 4, 1.0, neighbours=n) for n in (True, False))
    assert with_others.past_present[:, 1:].any()
    assert alone.past.shape[1] == alone.future.shape[1] == 1
    for one, other in zip(with_others[:4], alone[:4], strict=True):
        np.testing.assert_array_equal(one[:, :1], other)
    np.testing.assert_array_equal(with_others.where, alone.where)


# --- augmentation -------------------------------------------------------------------------------------------


def test_another_pace_equals_interpolation_person_by_person():
    scenes, rng = walking(9, n=40), np.random.default_rng(9)
    truth, mask = scenes.future[:, 0], scenes.future_present[:, 0]
    scale = torch.from_numpy(rng.uniform(0.7, 1.5, 40))
    past, future, there = at_pace(scale, scenes.past[:, 0], truth, mask)
    for n in range(40):
        length = int(mask[n].sum())
        path = torch.cat([scenes.past[n, 0], truth[n, :length]]).numpy()
        times, pace = np.arange(-3, length + 1), min(scale[n].item(), length)
        for step, xy in zip(range(-3, twins.STEPS + 1), torch.cat([past[n], future[n]]), strict=True):
            at = pace * step
            if at > length:
                assert not there[n, step - 1]
                assert (xy == 0).all()
                continue
            expected = [np.interp(at, times, path[:, axis]) for axis in (0, 1)]
            if at < -3:
                expected = path[0] + (at + 3) * (path[1] - path[0])
            np.testing.assert_allclose(xy, expected, atol=1e-9)
    assert (there.sum(1) >= 1).all()


def test_the_real_pace_changes_nothing():
    scenes = walking(10)
    mask = scenes.future_present[:, 0]
    past, truth, there = at_pace(torch.ones(6).double(), scenes.past[:, 0], scenes.future[:, 0], mask)
    torch.testing.assert_close(past, scenes.past[:, 0])
    torch.testing.assert_close(truth, scenes.future[:, 0])
    assert torch.equal(there, mask)


# --- weights on disk ----------------------------------------------------------------------------------------

KIND = find("neural_map")
SITE = Site(horizon_s=12.0, time_step_s=1.0, observed_rows=4, timezone="UTC")


@pytest.mark.parametrize("options", [{}, {"grids": ()}, {"grids": (3.0,), "headings": 4, "time_of_day": True}])
def test_loaded_maps_give_the_same_forecasts(options, tmp_path):
    scenes = walking(11)
    net = some_network(11, **options).float()
    save_network(tmp_path / "map.st", KIND, NeuralMap(**options), SITE, net.state_dict())
    loaded = load_network(tmp_path / "map.st", KIND, NeuralMap(**options), SITE)
    scenes = scenes._replace(past=scenes.past.float(), where=scenes.where.float())
    assert torch.equal(forecast(loaded, scenes), forecast(net, scenes))
    method = make_forecaster("neural_map", NeuralMap(**options), SITE, tmp_path / "map.st", device="cpu", threads=1)
    xy = 3.0 + scenes.past[:, 0].double().numpy()
    t, unknown = 1.9e9 + np.tile(np.arange(4.0), (6, 1)), np.full((6, 4), np.nan)
    seen = Observed(np.arange(6), t, xy[..., 0], xy[..., 1], unknown, unknown, np.empty((6, 0, 4, 2)))
    past, present, origin = observed_scene(seen, 1.0)
    where = torch.from_numpy(whereabouts(origin, t[:, -1], "UTC"))
    with torch.no_grad():
        paths = net.forecast(torch.from_numpy(past), torch.from_numpy(present), None, where).numpy()
    got = method(seen, 12, stream_keys(np.arange(6), 1, 0, "hall"))
    np.testing.assert_allclose(got.xy, paths + origin[:, None, None], atol=1e-5)
    assert got.output == "single"


# --- learning -----------------------------------------------------------------------------------------------

OPTIONS = NeuralMap(
    windows=8000, batch_size=64, learning_rate=0.005, schedule="cosine", patience=8000, rotate=False, held_out="blocks",
    another_every=None,
)  # fmt: skip
LEARNING = Learning(device="cpu", futures="masked", seed=0)


def walkers_of_two_corridors(seed, people=240, span=7200.0):
    """Everybody comes along +x at 1 m/s: from corridor y = 0 they turn left at x = 0, from y = 30 they turn right."""
    rng, tables = np.random.default_rng(seed), []
    for n in range(people):
        first, side = rng.uniform(-8, -4), rng.integers(2)
        along = first + np.arange(16.0)
        xy = np.column_stack([np.minimum(along, 0), 30 * side + (1 - 2 * side) * np.maximum(along, 0)])
        tables.append(walk(n, rng.uniform(0, span) + np.arange(16.0), xy + rng.normal(0, 0.02, xy.shape)))
    return concatenate(tables)


def error_of(options, tmp_path, tracks, other):
    """ADE [m] on `other` people of a network trained on `tracks`."""
    day = day_of(tracks, [], Site())
    net = train(KIND, options, [day], SITE, LEARNING, tmp_path / "c", logging.getLogger(), threads=1)[0].eval()
    day = day_of(other, [], Site())
    scenes = scenes_at(day, *day.rows.T, 12, 4, 1.0, neighbours=False)
    with torch.no_grad():
        paths = net.forecast(*map(torch.from_numpy, scenes[:2]), None, torch.from_numpy(scenes.where))[:, 0].numpy()
    return np.linalg.norm(paths - scenes.future[:, 0], axis=-1).mean()


def test_a_map_learns_where_people_turn_and_a_network_without_one_cannot(tmp_path):
    tracks, others = walkers_of_two_corridors(1), walkers_of_two_corridors(2, 60)
    assert error_of(OPTIONS, tmp_path, tracks, others) < 0.7
    assert error_of(replace(OPTIONS, grids=()), tmp_path, tracks, others) > 1.5
