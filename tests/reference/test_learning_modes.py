"""What Trajectron++, TUTR and MID must be able to learn, each within a minute and a half, from made-up people."""

import math

import pytest
import torch
from network_twins import OBSERVED, STEPS, without_dropout

from modlhmp.kinds import find
from modlhmp.networks.data import Scenes
from modlhmp.networks.network import rotated

pytestmark = pytest.mark.full

ROWS = OBSERVED + STEPS
NOISE_M = 0.02
SAMPLES = 5  # of MID

# Sizes, iterations of 64 walkers and learning rate.
TRAJECTRONPP = ("trajectronpp", {"decoder": 32, "modes": 10}, 500, 3e-3)
TUTR = ("tutr", {"width": 32, "modes": 12}, 600, 1e-3)
MID = ("mid", {"context": 32}, 500, 2e-3)
EVERY = pytest.mark.parametrize("settings", [TRAJECTRONPP, TUTR, MID], ids=lambda settings: settings[0])


def scenes_of(xy):
    """Scenes of positions [n, 1 + M, ROWS, 2], everybody always there."""
    xy = xy - xy[:, :1, OBSERVED - 1 : OBSERVED]
    present = torch.ones(xy.shape[:3], dtype=torch.bool)
    where = torch.zeros(len(xy), 3)
    return Scenes(xy[:, :, :OBSERVED], present[:, :, :OBSERVED], xy[:, :, OBSERVED:], present[:, :, OBSERVED:], where)


def along(covered, heading):
    """Vectors of lengths [n, T] toward headings [n, T] or [n, 1]."""
    return covered[..., None] * torch.stack([heading.cos(), heading.sin()], -1)


def path(heading, speed):
    """Positions [n, ROWS, 2] of walkers who make a step toward each heading [n, ROWS - 1]."""
    return torch.cat([torch.zeros(len(heading), 1, 2), along(speed, heading).cumsum(1)], 1)


def uniform(g, n, low, high):
    return low + (high - low) * torch.rand(n, 1, generator=g)


def noisy(g, xy):
    return xy + NOISE_M * torch.randn(xy.shape, generator=g)


def fit(net, scenes, iterations, lr, batch=None, turn=False):
    """Train on batches, or on all scenes at once; returns the losses.

    `turn`: by any angle, where the network is augmented at all.
    """
    net.prepare(scenes)
    torch.manual_seed(1)
    net.train()
    net.planned_iterations, losses, optimiser = iterations, [], net.optimiser(lr)
    for iteration in range(iterations):
        some = scenes.take(torch.randint(len(scenes.past), (batch,))) if batch else scenes
        if turn and net.turns is not None:
            some = rotated(some, 2 * math.pi * torch.rand(len(some.past)))
        optimiser.param_groups[0]["lr"] = lr * (1 + math.cos(math.pi * iteration / iterations)) / 2
        optimiser.zero_grad()
        loss = net.loss(some)
        loss.backward()
        net.clip()
        optimiser.step()
        losses.append(loss.item())
    net.eval()
    return losses


def learn(settings, scenes, turn=False):
    """A network of these settings, trained on the scenes."""
    kind, sizes, iterations, lr = settings
    torch.manual_seed(0)
    net = find(kind).implementation().Network(STEPS, OBSERVED, 1.0, **sizes)
    fit(net, scenes, iterations, lr, 64, turn)
    return net


def forecast(net, scenes):
    """Paths [n, k, STEPS, 2]."""
    n, k = len(scenes.past), SAMPLES if net.output == "mean" else 1
    with torch.no_grad():
        return net.forecast(scenes.past, scenes.past_present, torch.arange(n * k).view(n, k))


def errors(paths, truth):
    """Mean ADE and FDE [m] over tracks and samples, as they are scored."""
    away = torch.linalg.vector_norm(paths - truth[:, None], dim=-1)
    return away.mean().item(), away[..., -1].mean().item()


def constant_velocity(scenes):
    return (scenes.past[:, 0, -1] - scenes.past[:, 0, -2])[:, None] * torch.arange(1.0, STEPS + 1)[:, None]


# --- few walkers by heart -----------------------------------------------------------------------------------


def straight_and_curved():
    """16 walkers at 0.5 to 1.5 m/s, half of them straight on, half on arcs."""
    g = torch.Generator().manual_seed(2)
    bend = torch.cat([torch.zeros(8), torch.linspace(-0.15, 0.15, 8)])[:, None]
    heading = uniform(g, 16, -math.pi, math.pi) + bend * torch.arange(ROWS - 1.0)
    return scenes_of(path(heading, uniform(g, 16, 0.5, 1.5))[:, None])


def by_heart(kind, scenes, iterations, lr, **sizes):
    """A network trained on all these scenes at once with nothing dropped, and its losses."""
    torch.manual_seed(0)
    net = without_dropout(find(kind).implementation().Network(STEPS, OBSERVED, 1.0, **sizes))
    return net, fit(net, scenes, iterations, lr)


def test_tutr_learns_walkers_by_heart():
    scenes = straight_and_curved()
    net, _ = by_heart("tutr", scenes, 800, 1e-3, modes=8)
    assert errors(forecast(net, scenes), scenes.future[:, 0])[0] < 0.05


def test_trajectronpp_of_one_mode_learns_walkers_by_heart():
    scenes = straight_and_curved()
    net, _ = by_heart("trajectronpp", scenes, 2500, 3e-3, modes=1)
    assert errors(forecast(net, scenes), scenes.future[:, 0])[0] < 0.1


def test_trajectronpp_of_many_modes_has_one_close_to_each_walker():
    """Not the likeliest one: nothing in the loss forces that to be exact."""
    scenes = straight_and_curved()
    net, losses = by_heart("trajectronpp", scenes, 1000, 2e-3, decoder=64)
    assert losses[-1] < -10 < 50 < losses[0]
    with torch.no_grad():
        context, now = net.encoder(scenes.past, scenes.past_present)
        means, _, _ = net.decode(context, now, torch.arange(net.modes), STEPS, sample=False)
    away = torch.linalg.vector_norm(means.cumsum(2) - scenes.future[:, :1], dim=-1).mean(-1)
    assert away.amin(1).mean() < 0.5


def test_mid_learns_the_noise_of_walkers_by_heart():
    """Not their paths: velocities' remaining noise adds up along them."""
    four = straight_and_curved().take(slice(6, 10))
    many = Scenes(*(torch.cat([part] * 16) for part in four))
    net, losses = by_heart("mid", many, 1000, 1e-3, context=64)
    assert losses[0] == pytest.approx(1.0, abs=0.3)
    assert sum(losses[90:110]) / 20 < 0.35
    torch.manual_seed(3)
    with torch.no_grad():
        rest = sum(net.loss(many).item() for _ in range(20)) / 20
    assert rest < 0.04


# --- what there is to learn ---------------------------------------------------------------------------------


def steady(seed, n):
    """Constant velocities in all directions."""
    g = torch.Generator().manual_seed(seed)
    heading = uniform(g, n, -math.pi, math.pi).expand(n, ROWS - 1)
    return scenes_of(noisy(g, path(heading, uniform(g, n, 0.5, 1.5)))[:, None])


@pytest.mark.parametrize(
    "settings",
    [
        ("trajectronpp", {"decoder": 32, "modes": 3}, 2500, 3e-3),
        ("tutr", {"width": 32, "modes": 12}, 1500, 1e-3),
    ],
    ids=lambda settings: settings[0],
)
def test_constant_velocity_is_learnt(settings):
    net, scenes = learn(settings, steady(4, 500), turn=True), steady(5, 200)
    truth = scenes.future[:, 0]
    ade, of_cvm = (errors(paths, truth)[0] for paths in (forecast(net, scenes), constant_velocity(scenes)[:, None]))
    assert ade < 1.2 * of_cvm


def test_mid_learns_where_and_how_fast_people_walk():
    """Far from what a constant velocity yields: that takes MID much longer, as each sample's noise adds up."""
    net, scenes = learn(("mid", {"context": 32}, 1000, 2e-3), steady(4, 500), turn=True), steady(5, 200)
    truth, paths = scenes.future[:, 0], forecast(net, scenes)
    assert errors(paths, truth)[0] < 0.4 * errors(torch.zeros_like(paths), truth)[0]


def junction(seed, n):
    """Walkers along a corridor who turn right or left at its end, 70 of 100 right, and which of them do."""
    g = torch.Generator().manual_seed(seed)
    right = torch.rand(n, generator=g) < 0.7
    turns_at = torch.randint(OBSERVED, OBSERVED + 3, (n, 1), generator=g)
    heading = torch.where(right, -math.pi / 2, math.pi / 2)[:, None] * (torch.arange(ROWS - 1) >= turns_at)
    return scenes_of(noisy(g, path(heading, uniform(g, n, 0.9, 1.1)))[:, None]), right


@EVERY
def test_likelier_branch_of_a_junction(settings):
    net, (scenes, right) = learn(settings, junction(6, 600)[0]), junction(7, 200)
    assert right.float().mean().item() == pytest.approx(0.7, abs=0.07)
    across = forecast(net, scenes)[:, :, -1, 1]
    assert (across.abs() > 3).float().mean() > 0.75  # into one of them, not between
    share = (across < 0).float().mean().item()
    if net.output == "mean":
        assert share == pytest.approx(0.7, abs=0.1)  # its samples take both
    else:
        assert share > 0.9


def stopping(seed, n, distance=4.0):
    """Walkers in all directions who slow down and stop at a fixed distance from where they are at t0."""
    g = torch.Generator().manual_seed(seed)
    even = uniform(g, n, 0.7, 1.3) * torch.arange(1.0 - OBSERVED, STEPS + 1)
    covered = torch.where(even > 0, distance * (1 - torch.exp(-even / distance)), even)
    return scenes_of(noisy(g, along(covered, uniform(g, n, -math.pi, math.pi)))[:, None])


@EVERY
def test_stopping_is_learnt(settings):
    net, scenes = learn(settings, stopping(8, 400), turn=True), stopping(9, 200)
    truth = scenes.future[:, 0]
    fde, of_cvm = (errors(paths, truth)[1] for paths in (forecast(net, scenes), constant_velocity(scenes)[:, None]))
    assert fde < 0.25 * of_cvm


def evading(seed, n):
    """Walkers in all directions who from t0 on turn away from a person beside them.

    Also the paths away from the other side, and the directions across.
    """
    g = torch.Generator().manual_seed(seed)
    start, speed = uniform(g, n, -math.pi, math.pi), uniform(g, n, 0.8, 1.2)
    side = torch.where(torch.rand(n, 1, generator=g) < 0.5, 1.0, -1.0)
    bend = 0.15 * (torch.arange(ROWS - 1) - OBSERVED + 2).clamp(min=0)
    own, mirrored = (path(start - sign * side * bend, speed) for sign in (1, -1))
    across = along(side[:, 0], start[:, 0])[:, [1, 0]] * torch.tensor([-1.0, 1.0])
    beside = along(speed * torch.arange(float(ROWS)), start) + uniform(g, n, 1.0, 1.4)[..., None] * across[:, None]
    scenes = scenes_of(noisy(g, torch.stack([own, beside], 1)))
    return scenes, (mirrored - mirrored[:, OBSERVED - 1 : OBSERVED])[:, OBSERVED:], across


@pytest.mark.parametrize(
    ("settings", "share"),
    [
        (TRAJECTRONPP, 0.5),
        (
            ("tutr", {"width": 32, "modes": 1}, 500, 1e-3),
            0.5,
        ),  # with more, modes tell the side: scores are blind to others
        (MID, 0.8),
    ],
    ids=["trajectronpp", "tutr", "mid"],
)
def test_whom_to_avoid_is_learnt(settings, share):
    net, (scenes, mirrored, across) = learn(settings, evading(10, 600)[0], turn=True), evading(11, 200)
    truth, paths = scenes.future[:, 0], forecast(net, scenes)
    assert ((truth[:, -1] * across).sum(-1) < 0).all()
    right = (paths[:, :, -1] * across[:, None]).sum(-1) < 0
    assert right.float().mean() > 0.85
    # Blind to the other, nothing is better on the mean than half the distance between the two paths.
    blind = torch.linalg.vector_norm(truth - mirrored, dim=-1).mean().item() / 2
    assert errors(paths, truth)[0] < share * blind
