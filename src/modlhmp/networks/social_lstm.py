"""Social LSTM: every person's LSTM also sees the hidden states of those around, sum-pooled on a grid.

A. Alahi, K. Goel, V. Ramanathan, A. Robicquet, L. Fei-Fei, S. Savarese, Social LSTM, CVPR 2016, as in TrajNet++
(P. Kothari et al., T-ITS 2021). The paper's "pooling size 32" and "8 x 8 sum pooling" are read as 32 x 32 cells of
0.25 m summed to `CELLS` x `CELLS` of 2 m. Departures: hidden states are added straight onto the coarse grid, and
people out of range or absent leave it alone.
"""

import torch
from torch import Tensor, nn

from modlhmp.networks import lstm
from modlhmp.networks.data import Scenes
from modlhmp.networks.network import trimmed

CELLS, CELL_M = 4, 2.0  # the grid is 8 m wide, axes those of the world, its middle the person
LATENT, POOLED = 16, 256


class Crowd:
    """The people of a batch in one row each (those present at t0), and all ordered pairs of a scene's people."""

    def __init__(self, past, present):
        self.scene, self.slot = torch.nonzero(present[:, :, -1], as_tuple=True)
        self.primary = torch.nonzero(self.slot == 0)[:, 0]
        members = torch.bincount(self.scene, minlength=len(past))
        partners = members[self.scene]
        self.ego = torch.repeat_interleave(torch.arange(len(self.scene), device=past.device), partners)
        first = torch.cumsum(members, 0) - members
        within = torch.arange(len(self.ego), device=past.device) - torch.repeat_interleave(
            torch.cumsum(partners, 0) - partners, partners
        )
        self.other = first[self.scene[self.ego]] + within
        apart = self.ego != self.other
        self.ego, self.other = self.ego[apart], self.other[apart]

    def take(self, values: Tensor) -> Tensor:
        """Values [n, 1 + M, ...] of the people, [people, ...]."""
        return values[self.scene, self.slot]


class Network(lstm.Network):
    """The LSTM with a pooled grid beside its input; 529,487 parameters with `hidden` = 128."""

    looks_at_neighbours = True

    def __init__(self, steps, observed_rows, step_s, hidden=128, sigma_scale=1.0):
        super().__init__(steps, observed_rows, step_s, hidden, sigma_scale, pooled=POOLED)
        self.latent = nn.Linear(hidden, LATENT)
        self.grid = nn.Linear(LATENT * CELLS**2, POOLED)

    def step_all(
        self,
        cell: nn.LSTMCell,
        displacement: Tensor,
        position: Tensor,
        here: Tensor,
        state: tuple[Tensor, ...],
        crowd: Crowd,
    ) -> tuple[Tensor, ...]:
        """Advance everybody who is `here` [people] and has moved; the states of others stay as they are."""
        grid = pool(self.latent(state[0]), position, here, crowd)
        new = cell(torch.cat([self.embedded(displacement), torch.relu(self.grid(grid))], -1), state)
        return tuple(torch.where(here[:, None], after, before) for after, before in zip(new, state, strict=True))

    def roll_out(  # type: ignore[override]  # the others' positions, too
        self,
        past: Tensor,
        present: Tensor,
        steps: int,
        future: Tensor | None = None,
        future_present: Tensor | None = None,
    ) -> lstm.Gaussians:
        """Gaussians of the predicted persons' displacements.

        With `future`, neighbours move as they did and leave when they did (training); without, everyone present at t0
        stays and moves as predicted.
        """
        crowd = Crowd(past, present)
        xy, here = crowd.take(past), crowd.take(present)
        zeros = xy.new_zeros(len(xy), self.encoder.hidden_size)
        state: tuple[Tensor, ...] = (zeros, zeros)
        for t in range(1, self.observed_rows):
            moved = here[:, t] & here[:, t - 1]
            displacement = torch.where(moved[:, None], xy[:, t] - xy[:, t - 1], 0.0)
            state = self.step_all(self.encoder, displacement, xy[:, t], moved, state, crowd)
        hidden = [state[0][crowd.primary]]
        position, present_now = xy[:, -1], here[:, -1]
        if future is not None and future_present is not None:
            truth, staying = crowd.take(future), crowd.take(future_present)
            own = torch.zeros_like(present_now)
            own[crowd.primary] = True
        while len(hidden) < steps:
            displacement = self.head(state[0])[..., :2].detach()
            if future is not None:
                k = len(hidden) - 1
                before = truth[:, k - 1] if k else xy[:, -1]
                displacement = torch.where(own[:, None], displacement, truth[:, k] - before)
                present_now = own | (present_now & staying[:, k])
            displacement = torch.where(present_now[:, None], displacement, 0.0)
            position = position + displacement
            state = self.step_all(self.decoder, displacement, position, present_now, state, crowd)
            hidden.append(state[0][crowd.primary])
        return self.gaussian(torch.stack(hidden, dim=1))

    def loss(self, scenes: Scenes) -> Tensor:
        """As the LSTM's, of the predicted persons only."""
        steps = trimmed(scenes)
        gaussians = self.roll_out(scenes.past, scenes.past_present, steps, scenes.future, scenes.future_present)
        return lstm.displacement_loss(scenes, gaussians, steps, self.sigma_scale)

    def forecast(self, past: Tensor, present: Tensor, keys: Tensor, where: Tensor | None = None) -> Tensor:
        """The path of the means, everyone present at t0 moving along."""
        return self.roll_out(past, present, self.steps)[0].cumsum(1)[:, None]


def grid_cell(offset: Tensor) -> Tensor:
    """Cell [..] of a neighbour at `offset` [.., 2] m, x-major; CELLS^2 where out of range."""
    cell = torch.floor(offset / CELL_M + CELLS / 2).long()
    inside = ((cell >= 0) & (cell < CELLS)).all(-1)
    return torch.where(inside, cell[..., 0] * CELLS + cell[..., 1], CELLS**2)


def pool(latent: Tensor, position: Tensor, here: Tensor, crowd: Crowd) -> Tensor:
    """Sum of the others' latent states [people, LATENT] in each cell around each person: [people, LATENT * CELLS^2].

    Channel first. Absent people pool nothing and are pooled by nobody.
    """
    people, last = len(latent), CELLS**2
    cell = grid_cell(position[crowd.other] - position[crowd.ego])
    cell = torch.where(here[crowd.other] & here[crowd.ego], cell, last)
    flat = latent.new_zeros(people * (last + 1), LATENT)
    flat = flat.index_add(0, crowd.ego * (last + 1) + cell, latent[crowd.other])
    return flat.view(people, last + 1, LATENT)[:, :last].transpose(1, 2).flatten(1)
