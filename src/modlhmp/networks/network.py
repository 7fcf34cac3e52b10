"""What a network must offer to be trained and to forecast; batches are `data.Scenes` of tensors.

Gradients, masks and random numbers of all networks follow the same rules: padded steps are taken out with
`torch.where` before anything non-linear, and a forecast's noise comes from the track's keys.
"""

import math

import torch
from torch import Tensor, nn

from modlhmp.networks.data import Scenes


class Base(nn.Module):
    """Contract of a network; `steps` and `observed_rows` are those of the dataset, `step_s` its time step [s]."""

    output = "single"  # how one result comes out of the k futures (forecasting.base)
    looks_at_neighbours = True  # where False, nobody else is in the scenes it is trained on
    turns: int | None = None  # augmentation: number of equal turns of a circle (0: any angle), None for none

    def __init__(self, steps: int, observed_rows: int, step_s: float) -> None:
        super().__init__()
        self.steps, self.observed_rows, self.step_s = steps, observed_rows, step_s
        self.planned_iterations = 0  # of the whole training, set before it starts

    def prepare(self, scenes: Scenes) -> None:
        """Look at one window of every training track before the first epoch, on the CPU."""

    def loss(self, scenes: Scenes) -> Tensor:
        """Mean loss of a batch, a scalar; draws from torch's global generator."""
        raise NotImplementedError

    def forecast(self, past: Tensor, present: Tensor, keys: Tensor, where: Tensor | None = None) -> Tensor:
        """Positions [n, k, steps, 2] relative to t0's from what was observed and the keys [n, k] of the futures.

        `where` [n, 3] (`data.Scenes`) is given to all; only a network that learns a map looks at it.
        """
        raise NotImplementedError

    def optimiser(self, lr: float) -> torch.optim.Optimizer:
        """The original's optimiser."""
        return torch.optim.Adam(self.parameters(), lr=lr)

    def decay(self, done: float) -> float:
        """The original's learning-rate factor after a share `done` of the training."""
        return 1.0

    def clip(self) -> None:
        """Bound the gradients, where the original does."""

    def validation_error(self, scenes: Scenes) -> Tensor:
        """ADE [n] in m of each track up to its own length; a network of several futures shows one."""
        keys = torch.zeros(len(scenes.past), 1, dtype=torch.int64)
        xy = self.forecast(scenes.past, scenes.past_present, keys, scenes.where)
        return track_ade(xy[:, 0], scenes.future[:, 0], scenes.future_present[:, 0])

    def parameter_count(self) -> int:
        """Number of trained numbers."""
        return sum(p.numel() for p in self.parameters() if p.requires_grad)


def cosine(done: float) -> float:
    """Learning-rate factor from 1 to 0.1 along half a cosine."""
    return 0.55 + 0.45 * math.cos(math.pi * done)


def track_ade(xy: Tensor, truth: Tensor, present: Tensor) -> Tensor:
    """ADE [n] of paths [n, T, 2] over the present steps."""
    distance = torch.linalg.vector_norm(xy[:, : truth.shape[1]] - truth, dim=-1)
    return torch.where(present, distance, 0.0).sum(-1) / present.sum(-1)


def masked_mean(values: Tensor, mask: Tensor) -> Tensor:
    """Mean of the values where the mask holds."""
    return torch.where(mask, values, 0.0).sum() / mask.sum()


def trimmed(scenes: Scenes) -> int:
    """The longest truth among the predicted persons, in steps: what is decoded of a batch."""
    return int(scenes.future_present[:, 0].sum(-1).max())


def truth_of(scenes: Scenes, steps: int) -> tuple[Tensor, Tensor]:
    """True positions [n, steps, 2] of the predicted persons, 0 where they have left, and where they are there."""
    present = scenes.future_present[:, 0, :steps]
    return torch.where(present[..., None], scenes.future[:, 0, :steps], 0.0), present


def displacements(truth: Tensor, present: Tensor) -> Tensor:
    """What is walked in each step [n, T, 2] from t0's position on, 0 where not present."""
    walked = truth - nn.functional.pad(truth, (0, 0, 1, 0))[:, :-1]
    return torch.where(present[..., None], walked, 0.0)


def turning(angle: Tensor) -> Tensor:
    """Rotations [n, 2, 2] by `angle` [n] in rad, for row vectors: multiply from the right."""
    c, s = torch.cos(angle), torch.sin(angle)
    return torch.stack([torch.stack([c, s], -1), torch.stack([-s, c], -1)], -2)


def rotated(scenes: Scenes, angle: Tensor) -> Scenes:
    """Scenes turned about t0's position by `angle` [n] in rad: past, future and neighbours alike."""
    turn = turning(angle)
    past, future = (torch.einsum("nmti,nij->nmtj", part, turn) for part in (scenes.past, scenes.future))
    return scenes._replace(past=past, future=future)
