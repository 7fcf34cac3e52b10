"""TUTR: a transformer that scores general motion modes and turns the likeliest into a path.

L. Shi, L. Wang, S. Zhou, G. Hua, Trajectory unified transformer for pedestrian trajectory prediction, ICCV 2023.
Departures: modes, the closest mode and the losses look at the steps that are there; a neighbour counts if it was seen
all the time; modes come from k-means++ and at most 30 Lloyd steps over futures as they are, unsmoothed and unturned.
"""

import math

import torch
from torch import Tensor, nn

from modlhmp.networks.data import Scenes
from modlhmp.networks.network import Base, masked_mean, turning

NEAR_M = 2.0  # mean distance of a neighbour over the observation
SCALE_SD = 0.05
LLOYD_ITERATIONS = 30


class Block(nn.Module):
    """Post-norm attention and feed-forward; `crossed` gives queries and keys a hidden layer."""

    def __init__(self, width, heads, crossed=False):
        super().__init__()
        self.attention = nn.MultiheadAttention(width, heads, batch_first=True)
        self.query = nn.Sequential(nn.Linear(width, width), nn.ReLU()) if crossed else nn.Identity()
        self.key = nn.Sequential(nn.Linear(width, width), nn.ReLU()) if crossed else nn.Identity()
        self.feed_forward = nn.Sequential(nn.Linear(width, 2 * width), nn.ReLU(), nn.Linear(2 * width, width))
        self.norms = nn.ModuleList([nn.LayerNorm(width, eps=1e-6) for _ in range(2)])
        self.drop = nn.Dropout(0.1)

    def forward(self, x: Tensor, others: Tensor, absent: Tensor | None = None) -> Tensor:
        """Tokens x [n, Q, width] attending to others [n, S, width], of which those `absent` [n, S] do not count."""
        seen = self.attention(self.query(x), self.key(others), others, absent, need_weights=False)[0]
        x = self.drop(self.norms[0](x + seen))
        return self.drop(self.norms[1](x + self.feed_forward(x)))


class Network(Base):
    """463,737 parameters with `width` = 128 and 60 steps; its `modes` are centres of clusters of training futures."""

    modes: Tensor

    def __init__(self, steps, observed_rows, step_s, width=128, modes=50, heads=4):
        super().__init__(steps, observed_rows, step_s)
        self.mode_token = nn.Linear(2 * (observed_rows + steps), width)
        self.encoder = nn.ModuleList([Block(width, heads) for _ in range(2)])
        self.score = nn.Linear(width, 1)
        self.neighbour_token = nn.Linear(2 * observed_rows, width)
        self.decoder = Block(width, heads, crossed=True)
        self.path = nn.Linear(width, 2 * steps)
        self.register_buffer("modes", torch.zeros(modes, steps, 2))

    def prepare(self, scenes: Scenes) -> None:
        """Find the general motion modes."""
        frame = own_frame(scenes.past)
        self.modes.copy_(motion_modes(scenes.future[:, 0] @ frame, scenes.future_present[:, 0], len(self.modes)))

    def tokens(self, past: Tensor) -> tuple[Tensor, Tensor]:
        """Encoded mode tokens [n, K, width] and their logits [n, K] from observed positions in the walker's frame."""
        n, modes = len(past), len(self.modes)
        observed, of_mode = past.flatten(1), self.modes.flatten(1)
        weight, cut = self.mode_token.weight, observed.shape[1]
        x = (observed @ weight[:, :cut].T)[:, None] + of_mode @ weight[:, cut:].T + self.mode_token.bias
        for block in self.encoder:
            x = block(x, x)
        return x.view(n, modes, -1), self.score(x)[..., 0]

    def decode(self, token: Tensor, past: Tensor, present: Tensor) -> Tensor:
        """Paths [n, steps, 2] of one token each [n, width], seeing the neighbours; all in the walkers' frames."""
        distance = torch.linalg.vector_norm(past - past[:, :1], dim=-1)
        # The walker is the first of them, so that there is always somebody.
        absent = ~(present.all(-1) & (distance.mean(-1) < NEAR_M))
        others = self.neighbour_token(past.flatten(2))
        return self.path(self.decoder(token[:, None], others, absent)[:, 0]).view(-1, self.steps, 2)

    def loss(self, scenes: Scenes) -> Tensor:
        """Smooth L1 of the closest mode's path, plus cross-entropy of the scores against softened closeness."""
        frame = own_frame(scenes.past)
        scale = frame.new_ones(len(frame), 1, 1)
        if self.training:
            scale = scale + SCALE_SD * torch.randn(len(frame), 1, 1, device=frame.device)
        past = (scenes.past @ frame[:, None]) * scale[..., None]
        future, mask = (scenes.future[:, 0] @ frame) * scale, scenes.future_present[:, 0]
        distance = mode_distance(future, mask, self.modes)
        closest = distance.argmin(1)
        tokens, logits = self.tokens(past[:, 0])
        path = self.decode(tokens[torch.arange(len(tokens)), closest], past, scenes.past_present)
        error = nn.functional.smooth_l1_loss(path, torch.where(mask[..., None], future, 0.0), reduction="none").mean(-1)
        return masked_mean(error, mask) + nn.functional.cross_entropy(logits, torch.softmax(-distance, 1))

    def forecast(self, past: Tensor, present: Tensor, keys: Tensor, where: Tensor | None = None) -> Tensor:
        """The path of the highest score."""
        frame = own_frame(past)
        turned = past @ frame[:, None]
        tokens, logits = self.tokens(turned[:, 0])
        best = tokens[torch.arange(len(tokens)), logits.argmax(1)]
        return (self.decode(best, turned, present) @ frame.transpose(1, 2))[:, None]


def own_frame(past: Tensor) -> Tensor:
    """Rotations [n, 2, 2] for row vectors that turn each walker's first observed position onto the positive x axis."""
    first = past[:, 0, 0]
    return turning(-torch.atan2(first[:, 1], first[:, 0]))


def mode_distance(future: Tensor, mask: Tensor, modes: Tensor) -> Tensor:
    """Distance [n, K] of futures [n, T, 2] to modes over the present steps, scaled to the whole horizon."""
    weights = mask.to(future.dtype)
    future = torch.where(mask[..., None], future, 0.0)
    # |f - m|^2 summed over present steps, as products of matrices
    squared = (
        (future**2).sum((1, 2))[:, None] - 2 * future.flatten(1) @ modes.flatten(1).T + weights @ (modes**2).sum(-1).T
    )
    whole = mask.shape[1] / weights.sum(1, keepdim=True)
    return torch.sqrt(squared.clamp(min=0.0) * whole)


def motion_modes(future: Tensor, mask: Tensor, number: int) -> Tensor:
    """Centres [number, T, 2] of k-means over futures [n, T, 2], each compared over the steps it has.

    A centre at a step is the mean of its members that are there, or goes on as it moved if none is. Starts with
    k-means++ by a seed of its own.
    """
    generator = torch.Generator().manual_seed(1)
    filled = extended(future, mask)
    centres = filled[_first_centres(future, mask, filled, number, generator)]
    weights = mask.to(future.dtype)
    for _ in range(LLOYD_ITERATIONS):
        member = future.new_zeros(len(future), number).scatter_(
            1, mode_distance(future, mask, centres).argmin(1)[:, None], 1.0
        )
        present = member.T @ weights
        total = torch.einsum("nk,nti->kti", member, torch.where(mask[..., None], future, 0.0))
        mean = total / present.clamp(min=1.0)[..., None]
        moved = extended(mean, present > 0)
        centres_new = torch.where((present[:, :1] > 0)[..., None], moved, centres)  # an empty cluster stays
        if torch.equal(centres_new, centres):
            break
        centres = centres_new
    return centres


def extended(paths: Tensor, mask: Tensor) -> Tensor:
    """Paths whose steps after the last present one go on at its mean velocity from the origin; [n, T, 2]."""
    steps = torch.arange(1, paths.shape[1] + 1)
    last = torch.where(mask, steps, 0).amax(1).clamp(min=1)
    velocity = paths[torch.arange(len(paths)), last - 1] / last[:, None]
    return torch.where(mask[..., None], paths, velocity[:, None] * steps[:, None])


def _first_centres(future, mask, filled, number, generator):
    """Indices of futures for k-means++: each drawn by its squared distance to the nearest one chosen."""
    chosen = [int(torch.randint(len(future), (1,), generator=generator))]
    nearest = future.new_full((len(future),), math.inf)
    while len(chosen) < number:
        distance = mode_distance(future, mask, filled[chosen[-1:]])[:, 0]
        nearest = torch.minimum(nearest, distance**2)
        odds = nearest if nearest.sum() > 0 else torch.ones_like(nearest)
        chosen.append(int(torch.multinomial(odds, 1, generator=generator)))
    return torch.tensor(chosen)
