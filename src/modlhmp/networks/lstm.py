"""LSTM (the TrajNet++ framework's vanilla LSTM): displacements in, a Gaussian of the next displacement out.

P. Kothari, S. Kreiss, A. Alahi, Human trajectory forecasting in crowds: a deep learning perspective, T-ITS 2021.
Departure: the first decoder step's input is the displacement predicted from the observed position at t0, not from the
network's own guess of that position.
"""

import math

import torch
from torch import Tensor, nn

from modlhmp.networks.data import Scenes
from modlhmp.networks.network import Base, displacements, masked_mean, trimmed, truth_of

EMBEDDING, START_TAGS = 62, 2  # the framework's two start tags are never set here
VELOCITY_SCALE = 4.0
WEIGHT_DECAY = 1e-4
OUTLIER, WIDE = 0.01, 0.20  # weights of the constant and of the wide Gaussian in the loss
WIDE_SIGMA_M = 3.0
Gaussians = tuple[Tensor, Tensor, Tensor]  # means [.., 2], standard deviations [.., 2], correlations [..]


class Network(Base):
    """Encoder and decoder cells with their own weights, one head; 199,487 parameters with `hidden` = 128.

    `sigma_scale` multiplies the framework's standard deviations, which were chosen for steps of 0.4 s.
    """

    looks_at_neighbours = False
    turns = 0

    def __init__(self, steps, observed_rows, step_s, hidden=128, sigma_scale=1.0, pooled=0):
        super().__init__(steps, observed_rows, step_s)
        self.sigma_scale = sigma_scale
        self.embed = nn.Linear(2, EMBEDDING)
        self.encoder = nn.LSTMCell(EMBEDDING + START_TAGS + pooled, hidden)
        self.decoder = nn.LSTMCell(EMBEDDING + START_TAGS + pooled, hidden)
        self.head = nn.Linear(hidden, 5)

    def embedded(self, displacement: Tensor) -> Tensor:
        """A cell's input from a displacement [n, 2] in m per step, the start tags unset."""
        return nn.functional.pad(torch.relu(self.embed(VELOCITY_SCALE * displacement)), (0, START_TAGS))

    def gaussian(self, hidden: Tensor) -> Gaussians:
        """Mean [.., 2], standard deviations [.., 2] and correlation [..] of the next displacement."""
        raw = self.head(hidden)
        sigma = self.sigma_scale * (0.01 + 0.2 * torch.sigmoid(raw[..., 2:4]))
        return raw[..., :2], sigma, 0.7 * torch.sigmoid(raw[..., 4])

    def roll_out(self, past: Tensor, steps: int) -> Gaussians:
        """Gaussians of `steps` displacements; each mean, without its gradient, is the next step's input."""
        zeros = past.new_zeros(len(past), self.encoder.hidden_size)
        state = (zeros, zeros)
        for displacement in past.diff(dim=1).unbind(1):
            state = self.encoder(self.embedded(displacement), state)
        hidden = [state[0]]
        while len(hidden) < steps:
            mean = self.head(state[0])[..., :2].detach()
            state = self.decoder(self.embedded(mean), state)
            hidden.append(state[0])
        return self.gaussian(torch.stack(hidden, dim=1))

    def loss(self, scenes: Scenes) -> Tensor:
        """Mean over the batch's valid steps of the robust negative log-likelihood of the displacements."""
        steps = trimmed(scenes)
        gaussians = self.roll_out(scenes.past[:, 0], steps)
        return displacement_loss(scenes, gaussians, steps, self.sigma_scale)

    def forecast(self, past: Tensor, present: Tensor, keys: Tensor, where: Tensor | None = None) -> Tensor:
        """The path of the means."""
        return self.roll_out(past[:, 0], self.steps)[0].cumsum(1)[:, None]

    def optimiser(self, lr: float) -> torch.optim.Optimizer:
        """Adam with coupled weight decay."""
        return torch.optim.Adam(self.parameters(), lr=lr, weight_decay=WEIGHT_DECAY)

    def decay(self, done: float) -> float:
        """A tenth after 10 of 25 epochs, a hundredth after 20."""
        return 0.1 ** (int(done >= 0.4) + int(done >= 0.8))


def displacement_loss(scenes: Scenes, gaussians: Gaussians, steps: int, sigma_scale: float) -> Tensor:
    """Mean robust loss over the valid steps of the predicted persons."""
    truth, mask = truth_of(scenes, steps)
    return masked_mean(robust_nll(displacements(truth, mask), *gaussians, sigma_scale), mask)


def robust_nll(
    displacement: Tensor, mean: Tensor, sigma: Tensor, correlation: Tensor, sigma_scale: float = 1.0
) -> Tensor:
    """-log(0.01 + 0.2 N(d; mean, 3 m, 3 m, 0) + 0.79 N(d; mean, sigma, correlation)), N the bivariate density."""
    wide = torch.full_like(sigma, WIDE_SIGMA_M * sigma_scale)
    density = (1 - OUTLIER - WIDE) * bivariate_density(displacement - mean, sigma, correlation)
    density = density + WIDE * bivariate_density(displacement - mean, wide, torch.zeros_like(correlation))
    return -torch.log(OUTLIER + density)


def bivariate_density(offset: Tensor, sigma: Tensor, correlation: Tensor) -> Tensor:
    """Density of a bivariate normal at `offset` [.., 2] from its mean."""
    (zx, zy), rest = (offset / sigma).unbind(-1), 1 - correlation**2
    exponent = (zx**2 + zy**2 - 2 * correlation * zx * zy) / (2 * rest)
    return torch.exp(-exponent) / (2 * math.pi * sigma.prod(-1) * torch.sqrt(rest))
