"""What LSTM and Social LSTM must be able to learn, each within half a minute: hand-made people, the real training."""

import logging
import math

import numpy as np
import pytest
import torch
from crowds import straight, walk

from modlhmp.forecasting.cvm import constant_velocity
from modlhmp.forecasting.observe import current_velocity, observe
from modlhmp.kinds import find
from modlhmp.networks import lstm, social_lstm
from modlhmp.networks.data import Scenes, day_of, scenes_at
from modlhmp.networks.network import cosine
from modlhmp.networks.training import train
from modlhmp.options import Learning, Lstm
from modlhmp.site import Site
from modlhmp.tracks import concatenate

pytestmark = pytest.mark.full

KINDS = pytest.mark.parametrize("kind", ["lstm", "social_lstm"])
NOISE_M = 0.02
OPTIONS = {"batch_size": 32, "learning_rate": 0.003, "schedule": "cosine", "patience": 1_000_000, "rotate": True}


@pytest.fixture
def learn(tmp_path):
    """Function (kind, tracks, steps, epochs, **options) -> a network trained so often on the tracks of one day."""

    def start(kind, tracks, steps, epochs, **options):
        site = Site(observed_rows=4, horizon_s=float(steps), time_step_s=1.0)
        learning = Learning(device="cpu", futures="masked", seed=0)
        options = Lstm(**{**OPTIONS, "windows": epochs * len(np.unique(tracks.track_id)), **options})
        checkpoint = tmp_path / f"{kind}.checkpoint"
        day = day_of(tracks, [], Site())
        return train(find(kind), options, [day], site, learning, checkpoint, logging.getLogger(), threads=1)[0]

    return start


def noisy(rng, xy):
    """Positions as a sensor would see them."""
    return xy + rng.normal(0, NOISE_M, np.shape(xy))


def forecast(network, tracks):
    """(network's, CVM's, true) paths [n, steps, 2] of all usable tracks from their first rows, around t0's position."""
    day = day_of(tracks, [], Site())
    scenes = scenes_at(day, *day.rows.T, network.steps, 4, 1.0)
    with torch.no_grad():
        seen = map(torch.from_numpy, scenes[:2])
        paths = network.eval().forecast(*seen, torch.zeros(len(day.rows), 1, dtype=torch.int64))[:, 0].numpy()
    observed = observe(day.tracks, day.rows)
    straight_on = constant_velocity(observed, current_velocity(observed, "differences"), network.steps).xy[:, 0]
    origin = np.stack([observed.x[:, -1:], observed.y[:, -1:]], -1)
    assert scenes.future_present[:, 0].all()
    return paths, straight_on - origin, scenes.future[:, 0]


def displacement(paths, truth):
    """(mean ADE, mean FDE) [m]."""
    away = np.linalg.norm(paths - truth, axis=-1)
    return away.mean(), away[:, -1].mean()


# --- one batch by heart -------------------------------------------------------------------------------------


def straight_and_curved(n=16, steps=12):
    """Scenes of `n` lone walkers at 0.5 to 1.5 m/s, every other one on an arc."""
    rng = np.random.default_rng(0)
    speed, heading = rng.uniform(0.5, 1.5, n), rng.uniform(-np.pi, np.pi, n)
    turn = np.where(np.arange(n) % 2, rng.choice([-1, 1], n) * rng.uniform(0.05, 0.15, n), 0.0)
    heading = heading[:, None] + turn[:, None] * np.arange(4 + steps)
    xy = (speed[:, None, None] * np.stack([np.cos(heading), np.sin(heading)], -1)).cumsum(1)
    xy = torch.tensor(xy - xy[:, 3:4], dtype=torch.float32)[:, None]
    present = torch.ones(n, 1, 4 + steps) > 0
    return Scenes(xy[:, :, :4], present[:, :, :4], xy[:, :, 4:], present[:, :, 4:], torch.zeros(n, 3))


def learnt_by_heart(network, scenes, loss, lr, iterations):
    """ADE [n] in m of each walker after training on these very scenes."""
    optimiser = torch.optim.Adam(network.parameters(), lr=lr)
    for iteration in range(iterations):
        optimiser.param_groups[0]["lr"] = lr * cosine(iteration / iterations)
        optimiser.zero_grad()
        loss(network, scenes).backward()
        optimiser.step()
    with torch.no_grad():
        return network.validation_error(scenes)


def squared_error(network, scenes):
    """100 times the mean squared error of the displacements, the TrajNet++ framework's other loss."""
    seen = scenes[:2] if isinstance(network, social_lstm.Network) else (scenes.past[:, 0],)
    future = scenes.future[:, 0]
    moved = future.diff(dim=1, prepend=torch.zeros_like(future[:, :1]))
    return 100 * ((network.roll_out(*seen, future.shape[1])[0] - moved) ** 2).mean()


@pytest.mark.parametrize("module", [lstm, social_lstm])
def test_one_batch_is_learnt_by_heart(module):
    torch.set_num_threads(1)
    torch.manual_seed(0)
    ade = learnt_by_heart(module.Network(12, 4, 1.0), straight_and_curved(), squared_error, 0.003, 400)
    assert ade.mean() < 0.05


@pytest.mark.parametrize(("module", "lr"), [(lstm, 0.003), (social_lstm, 0.001)])
def test_most_of_one_batch_is_learnt_by_heart_with_the_loss_that_saturates(module, lr):
    """The median only: at 1 Hz the robust loss gives up on single walkers, whose errors cost next to nothing more."""
    torch.set_num_threads(1)
    torch.manual_seed(0)
    ade = learnt_by_heart(module.Network(12, 4, 1.0), straight_and_curved(), module.Network.loss, lr, 600)
    assert ade.median() < 0.05


# --- what there is to learn ---------------------------------------------------------------------------------


def steady_walkers(seed, n=500, rows=16):
    """Constant velocities in all directions."""
    rng = np.random.default_rng(seed)
    tables = []
    for track_id in range(n):
        speed, heading = rng.uniform(0.5, 1.5), rng.uniform(-np.pi, np.pi)
        velocity = speed * math.cos(heading), speed * math.sin(heading)
        exact = straight(track_id, (0, 0), velocity, rows, began=100.0 * track_id)
        x, y = noisy(rng, [exact.x, exact.y])
        tables.append(exact._replace(x=x, y=y))
    return concatenate(tables)


@KINDS
def test_constant_velocity_is_learnt(kind, learn):
    network = learn(kind, steady_walkers(1), 12, epochs=40)
    paths, straight_on, truth = forecast(network, steady_walkers(2))
    assert displacement(paths, truth)[0] < 1.2 * displacement(straight_on, truth)[0]


def stopping_walkers(seed, n=400, rows=24, distance=8.0):
    """Half the distance at constant speed, then ever slower toward its end."""
    rng = np.random.default_rng(seed)
    tables = []
    for track_id in range(n):
        even, heading = rng.uniform(0.8, 1.6) * np.arange(rows), rng.uniform(-np.pi, np.pi)
        late = distance * (1 - 0.5 * np.exp(1 - even / (distance / 2)))
        covered = np.where(even < distance / 2, even, late)
        xy = covered[:, None] * np.array([math.cos(heading), math.sin(heading)])
        tables.append(walk(track_id, 100.0 * track_id + np.arange(rows), noisy(rng, xy)))
    return concatenate(tables)


@KINDS
def test_stopping_is_learnt(kind, learn):
    network = learn(kind, stopping_walkers(1), 20, epochs=30)
    paths, straight_on, truth = forecast(network, stopping_walkers(2))
    assert displacement(paths, truth)[1] < 0.1 * displacement(straight_on, truth)[1]


def evading_walkers(seed, n=400, rows=16):
    """Walkers who from t0 on drift away from a person beside them; those leave at t0, too early to be forecast."""
    rng = np.random.default_rng(seed)
    tables = []
    for pair in range(n):
        side, ahead = rng.choice([-1, 1]), rng.uniform(0.8, 1.2) * np.arange(rows)
        drift = -side * 0.2 * np.maximum(np.arange(rows) - 3, 0)
        times = 100.0 * pair + np.arange(rows)
        tables.append(walk(2 * pair, times, noisy(rng, np.column_stack([ahead, drift]))))
        beside = np.column_stack([ahead[:4] + 0.5, np.full(4, 1.5 * side)])
        tables.append(walk(2 * pair + 1, times[:4], noisy(rng, beside)))
    return concatenate(tables)


def test_only_the_social_lstm_learns_whom_to_avoid(learn):
    errors, right_side = {}, {}
    for kind in ("lstm", "social_lstm"):
        network = learn(kind, evading_walkers(1), 12, epochs=30, rotate=False)
        paths, _, truth = forecast(network, evading_walkers(2))
        errors[kind] = displacement(paths, truth)[0]
        right_side[kind] = (np.sign(paths[:, -1, 1]) == np.sign(truth[:, -1, 1])).mean()
    assert 0.4 < right_side["lstm"] < 0.6  # no better than chance
    assert right_side["social_lstm"] > 0.95
    assert errors["social_lstm"] < 0.25 * errors["lstm"]
