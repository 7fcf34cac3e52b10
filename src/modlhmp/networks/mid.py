"""MID: the future's velocities are denoised step by step from Gaussian noise, given Trajectron++'s encoding.

T. Gu, G. Chen, J. Li, C. Lin, Y. Rao, J. Zhou, J. Lu, Stochastic trajectory prediction via motion indeterminacy
diffusion, CVPR 2022. Departures: no dropout while sampling, derivatives look backward only, steps that are not there
are neither attended to nor counted. At a forecast all steps are, so it is one for people who stay the whole horizon.
"""

import math
from collections.abc import Callable

import numpy as np
import torch
from scipy.special import ndtri
from torch import Tensor, nn

from modlhmp.networks.data import Scenes
from modlhmp.networks.network import Base, displacements, masked_mean, track_ade, trimmed, truth_of
from modlhmp.networks.trajectronpp import Encoder
from modlhmp.streams import uniforms

TIMES = 100  # diffusion times T
BETA_FIRST, BETA_LAST = 1e-4, 0.05
STRIDE = 20  # of DDIM: five denoising steps
CHUNK = 128  # paths denoised at once: few enough for a processor's cache
NoiseAt = Callable[[Tensor, Tensor], Tensor]  # (x_t, t) -> the noise in it


class Schedule:
    """beta_t, alpha_t and their running product abar_t for t = 0..T in float64; beta_0 = 0."""

    def __init__(self):
        rising = torch.linspace(BETA_FIRST, BETA_LAST, TIMES, dtype=torch.float64)
        self.beta = nn.functional.pad(rising, (1, 0))
        self.alpha = 1 - self.beta
        self.abar = self.alpha.cumprod(0)

    def posterior_sd(self, t: int) -> Tensor:
        """Standard deviation of x_{t-1} given x_t and x_0."""
        return torch.sqrt(self.beta[t] * (1 - self.abar[t - 1]) / (1 - self.abar[t]))


SCHEDULE = Schedule()


class Gated(nn.Module):
    """Linear layer that a context scales and shifts, the same for all steps of a path."""

    def __init__(self, inputs, outputs, context):
        super().__init__()
        self.linear = nn.Linear(inputs, outputs)
        self.gate = nn.Linear(context, outputs)
        self.shift = nn.Linear(context, outputs, bias=False)

    def forward(self, x: Tensor, context: Tensor) -> Tensor:
        """X [n, T, inputs], context [n, context]."""
        return self.linear(x) * torch.sigmoid(self.gate(context))[:, None] + self.shift(context)[:, None]


class Network(Base):
    """7,115,664 parameters with `context` = 256; `k` futures, whose errors are averaged."""

    output = "mean"
    turns = 24
    positions: Tensor

    def __init__(self, steps, observed_rows, step_s, context=256, heads=4, layers=3):
        super().__init__(steps, observed_rows, step_s)
        width, conditions = 2 * context, context + 3
        self.encoder = Encoder(context // 2, step_s)
        self.into = Gated(2, width, conditions)
        layer = nn.TransformerEncoderLayer(width, heads, 2 * width, dropout=0.1, batch_first=True)
        self.transformer = nn.TransformerEncoder(layer, layers, enable_nested_tensor=False)
        self.out = nn.ModuleList(
            Gated(i, o, conditions) for i, o in ((width, context), (context, context // 2), (context // 2, 2))
        )
        self.drop = nn.Dropout(0.1)
        self.register_buffer("positions", sinusoids(steps, width), persistent=False)

    def noise(self, x: Tensor, t: Tensor, context: Tensor, present: Tensor | None = None) -> Tensor:
        """Predicted noise [n, T, 2] in velocities x at diffusion times t [n]; steps not `present` are not looked at."""
        beta = SCHEDULE.beta.to(x)[t][:, None]
        conditions = torch.cat([beta, torch.sin(beta), torch.cos(beta), context], -1)
        h = self.drop(self.into(x, conditions) + self.positions[: x.shape[1]])
        h = self.transformer(h, src_key_padding_mask=None if present is None else ~present)
        for layer in self.out:
            h = layer(h, conditions)
        return h

    def loss(self, scenes: Scenes) -> Tensor:
        """Mean squared error of the predicted noise over the valid steps."""
        steps = trimmed(scenes)
        truth, mask = truth_of(scenes, steps)
        velocity = displacements(truth, mask) / self.step_s
        t = torch.randint(1, TIMES + 1, (len(truth),), device=truth.device)
        noise = torch.randn_like(velocity)
        context, _ = self.encoder(scenes.past, scenes.past_present)
        predicted = self.noise(torch.where(mask[..., None], diffused(velocity, t, noise), 0.0), t, context, mask)
        return masked_mean(((predicted - noise) ** 2).mean(-1), mask)

    def forecast(self, past: Tensor, present: Tensor, keys: Tensor, where: Tensor | None = None) -> Tensor:
        """The paths from the keys' noise by deterministic sampling (DDIM), the whole horizon at once."""
        (n, k), steps = keys.shape, self.steps
        start = torch.from_numpy(noise_of(keys.cpu().numpy().ravel(), steps)).to(past)
        context = self.encoder(past, present)[0].repeat_interleave(k, 0)
        parts = zip(start.split(CHUNK), context.split(CHUNK), strict=True)

        def denoised(x: Tensor, of: Tensor) -> Tensor:
            return ddim(lambda noisy, t: self.noise(noisy, t, of), x)

        velocity = torch.cat([denoised(x, of) for x, of in parts])
        return self.step_s * velocity.cumsum(1).view(n, k, steps, 2)

    def validation_error(self, scenes: Scenes) -> Tensor:
        """Of one future per track, its noise fixed by the track's place."""
        keys = torch.arange(len(scenes.past))[:, None]
        xy = self.forecast(scenes.past, scenes.past_present, keys)
        return track_ade(xy[:, 0], scenes.future[:, 0], scenes.future_present[:, 0])


def diffused(x0: Tensor, t: Tensor, noise: Tensor) -> Tensor:
    """x_t from x_0 [n, ...] at times t [n]."""
    abar = SCHEDULE.abar.to(x0)[t].view(-1, *[1] * (x0.ndim - 1))
    return torch.sqrt(abar) * x0 + torch.sqrt(1 - abar) * noise


def ddim(noise_at: NoiseAt, x: Tensor, stride: int = STRIDE) -> Tensor:
    """Sample from x_T = x with `noise_at`(x, t) by deterministic steps of `stride` down to 0 (DDIM, eta = 0)."""
    for t in range(TIMES, 0, -stride):
        now, then = (SCHEDULE.abar[time].item() for time in (t, max(t - stride, 0)))
        noise = noise_at(x, torch.full((len(x),), t, device=x.device))
        x0 = (x - math.sqrt(1 - now) * noise) / math.sqrt(now)
        x = math.sqrt(then) * x0 + math.sqrt(1 - then) * noise
    return x


def ddpm(noise_at: NoiseAt, x: Tensor, generator: torch.Generator | None = None) -> Tensor:
    """Sample from x_T = x by all T ancestral steps (DDPM)."""
    for t in range(TIMES, 0, -1):
        beta, alpha, abar = (values[t].item() for values in (SCHEDULE.beta, SCHEDULE.alpha, SCHEDULE.abar))
        noise = noise_at(x, torch.full((len(x),), t, device=x.device))
        x = (x - beta / math.sqrt(1 - abar) * noise) / math.sqrt(alpha)
        if t > 1:
            fresh = torch.randn(x.shape, generator=generator, dtype=x.dtype, device=x.device)
            x = x + SCHEDULE.posterior_sd(t).item() * fresh
    return x


def noise_of(keys: np.ndarray, steps: int) -> np.ndarray:
    """Standard normal numbers [n, steps, 2] of random streams: the same for a track whatever is forecast beside it."""
    return ndtri(uniforms(keys.astype(np.uint64), 0, 2 * steps)).reshape(len(keys), steps, 2)


def sinusoids(steps: int, width: int) -> Tensor:
    """Positional encoding [steps, width] of the transformer, base 10000."""
    angle = torch.arange(steps)[:, None] * torch.exp(torch.arange(0, width, 2) * (-math.log(10000.0) / width))
    return torch.stack([torch.sin(angle), torch.cos(angle)], -1).flatten(1)
