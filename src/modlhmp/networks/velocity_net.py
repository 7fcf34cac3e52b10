"""The network of the neural velocity map, and its training: place and time of day to a mixture of velocities.

Its density is that of the table it is written to (`networks.neural_velocity`): a semi-wrapped Gaussian mixture over
(heading, speed), and a background, which knows neither the place nor the time, with a weight of its own at every place.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from modlhmp.logs import progress
from modlhmp.networks.training import flushing

HARMONICS = (1, 2, 3)  # of the day
FIRST_SD = 0.01  # of the features of a place: unseen ones say next to nothing
DECAY, DECAY_PLACE = 0.0, 0.1  # weight decay; of the features it is what smooths
RATE, RATE_PLACE = 4e-3, 3e-2
DAY_SHARE = 0.15  # of the rows, shown without their time: so it learns the whole day, too
EVEN = 10.0  # rows seen around a node at which the background is as likely as the flow, if the network has no view
NO_ROWS = 1e-6  # a place without any
HELD_OUT = 0.1  # of the persons
LEAST_STEPS = 64  # an epoch, as far as rows suffice
MOST_BATCH = 1024
LEAST_BATCH = 64
LEAST_HEADING, MOST_HEADING = 0.1, 1.6  # standard deviation [rad]; three windings hold 0.9999 of the widest
LEAST_SPEED = 0.05  # standard deviation [m/s]
ABOVE_0 = 2.4  # standard deviations that a mean speed is above 0 at least: over 0.99 of a component is there
MOST_CORRELATION = 0.95


class Rows(NamedTuple):
    """Velocities where and when they were seen, as tensors [n] or [n, ...]."""

    nodes: Tensor  # [n, 4] of the grid around the place
    shares: Tensor  # [n, 4] of these
    clock: Tensor  # [n, 6]: sine and cosine of the time of day; zeros for the whole day
    heading: Tensor
    speed: Tensor
    background: Tensor  # log density of the velocity there

    def take(self, which: Tensor) -> "Rows":
        """Some of them."""
        return Rows(*(part[which] for part in self))


class Mixture(NamedTuple):
    """Of n places and J components: [n, J] each, but the log odds of the background [n]."""

    log_weight: Tensor
    heading: Tensor
    speed: Tensor
    sd_heading: Tensor
    sd_speed: Tensor
    correlation: Tensor
    background: Tensor


def clock_of(hour: np.ndarray) -> np.ndarray:
    """The time of day in hours [n] as sines and cosines [n, 6]: seamless at midnight."""
    angle = np.asarray(hour, float)[:, None] * (2 * np.pi / 24) * np.array(HARMONICS)
    return np.concatenate([np.sin(angle), np.cos(angle)], axis=1).astype(np.float32)


class VelocityNet(nn.Module):
    """Learned features [nodes, features] of a grid of places, and a perceptron of two layers.

    How many rows were seen around each node is known, too: the odds of the background fall with it, from certainty
    where nobody was, and the network says the rest.
    """

    seen: Tensor

    def __init__(self, nodes: int, features: int, width: int, components: int) -> None:
        super().__init__()
        self.components = components
        self.register_buffer("seen", torch.zeros(nodes))
        self.place = nn.Parameter(FIRST_SD * torch.randn(nodes, features))
        last = nn.Linear(width, 6 * components + 1)
        self.layers = nn.Sequential(
            nn.Linear(features + 2 * len(HARMONICS), width), nn.SiLU(), nn.Linear(width, width), nn.SiLU(), last
        )
        with torch.no_grad():  # components begin apart, all round the circle
            last.weight *= 0.1
            last.bias.zero_()
            last.bias[components : 2 * components] = torch.arange(components) * (2 * math.pi / components)

    def forward(self, nodes: Tensor, shares: Tensor, clock: Tensor) -> Mixture:
        """The mixture of each place [n] and time."""
        place = _between(nodes, shares, self.place)
        seen = _between(nodes, shares, self.seen[:, None])[:, 0]
        said = self.layers(torch.cat([place, clock], -1))
        weight, heading, speed, wide, fast, correlation = said[:, :-1].view(len(said), 6, -1).unbind(1)
        mean = ABOVE_0 * LEAST_SPEED + nn.functional.softplus(speed + 1.0)
        return Mixture(
            torch.log_softmax(weight, -1),
            heading,
            mean,
            LEAST_HEADING + (MOST_HEADING - LEAST_HEADING) * torch.sigmoid(wide - 1.0),
            LEAST_SPEED + (mean / ABOVE_0 - LEAST_SPEED) * torch.sigmoid(fast),
            MOST_CORRELATION * torch.tanh(correlation),
            said[:, -1] + math.log(EVEN) - torch.log(seen + NO_ROWS),
        )

    def loss(self, rows: Rows) -> Tensor:
        """Mean negative log density [nat per m/s rad] of the velocities."""
        return -log_density(self(rows.nodes, rows.shares, rows.clock), rows).mean()


def _between(nodes, shares, values):
    """Values [nodes, features] of the grid, linear between its nodes."""
    return nn.functional.embedding_bag(nodes, values, per_sample_weights=shares, mode="sum")


def log_density(mixture: Mixture, rows: Rows) -> Tensor:
    """Log density [n] of the velocities under the mixtures and the background."""
    away = (rows.heading[:, None] - mixture.heading) / (2 * math.pi)
    turn = 2 * math.pi * (away - torch.round(away.detach()))
    rest = 1 - mixture.correlation**2
    fast = (rows.speed[:, None] - mixture.speed) / mixture.sd_speed
    scale = mixture.log_weight - torch.log(2 * math.pi * mixture.sd_heading * mixture.sd_speed) - 0.5 * torch.log(rest)
    terms = []
    for winding in (-1, 0, 1):
        wide = (turn + 2 * math.pi * winding) / mixture.sd_heading
        terms.append(scale - 0.5 * (wide**2 - 2 * mixture.correlation * wide * fast + fast**2) / rest)
    flow = torch.logsumexp(torch.cat(terms, -1), -1)
    own, other = nn.functional.logsigmoid(-mixture.background), nn.functional.logsigmoid(mixture.background)
    return torch.logaddexp(flow + own, rows.background + other)


@contextmanager
def one_thread() -> Iterator[None]:
    """Sums in one order: the same numbers to the last bit on any number of cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@one_thread()
@flushing()
def train(rows: Rows, person: np.ndarray, nodes: int, sizes: dict[str, int], epochs: int, seed: int) -> VelocityNet:
    """The network after the epoch that was best on held-out persons, of whom `person` [n] are the numbers.

    One thread, and random numbers of its own: the same rows give the same network to the last bit.
    """
    persons = np.unique(person)
    held = np.random.default_rng(seed).permutation(persons)[: max(round(HELD_OUT * len(persons)), 1)]
    other = torch.from_numpy(np.isin(person, held))
    fit, checked = rows.take(~other), rows.take(other)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = VelocityNet(nodes, **sizes)
        network.seen.index_add_(0, fit.nodes.ravel(), fit.shares.ravel())
        optimiser = torch.optim.AdamW(
            [
                {"params": network.layers.parameters(), "lr": RATE, "weight_decay": DECAY},
                {"params": [network.place], "lr": RATE_PLACE, "weight_decay": DECAY_PLACE},
            ]
        )
        number = len(fit.heading)
        size = min(max(number // LEAST_STEPS, LEAST_BATCH), MOST_BATCH)
        steps = max(number // size, 1)
        schedule = torch.optim.lr_scheduler.LambdaLR(
            optimiser, lambda step: 0.5 + 0.5 * math.cos(math.pi * step / (epochs * steps))
        )
        best, kept = math.inf, network.state_dict()
        bar = progress(range(epochs), desc="Neural velocity map", unit=" epochs")
        for _ in bar:
            order = torch.randperm(number)
            whole = torch.rand(number) < DAY_SHARE
            for step in range(steps):
                some = fit.take(order[step * size : (step + 1) * size])
                some.clock[whole[step * size : (step + 1) * size]] = 0.0
                optimiser.zero_grad()
                network.loss(some).backward()
                optimiser.step()
                schedule.step()
            error = held_out(network, checked)
            bar.set_postfix(held_out=f"{error:.3f} nat", refresh=False)
            if error < best:
                best, kept = error, {name: one.clone() for name, one in network.state_dict().items()}
    network.load_state_dict(kept)
    return network.eval()


def held_out(network: VelocityNet, rows: Rows) -> float:
    """Mean loss of held-out persons' rows."""
    with torch.no_grad():
        parts = [network.loss(Rows(*(p[i : i + 8192] for p in rows))) * min(8192, len(rows.heading) - i)
                 for i in range(0, len(rows.heading), 8192)]  # fmt: skip
    return float(sum(parts)) / len(rows.heading)
