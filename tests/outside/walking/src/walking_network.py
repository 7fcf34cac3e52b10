"""The network of `walking`; a module of its own, so that torch is imported where it is used."""

import torch
from torch import nn

from modlhmp.networks.network import Base, track_ade


class Network(Base):
    """The last displacement times a learned number, for ever."""

    looks_at_neighbours = False

    def __init__(self, steps, observed_rows, step_s):
        super().__init__(steps, observed_rows, step_s)
        self.factor = nn.Parameter(torch.tensor(0.5))

    def forecast(self, past, present, keys, where=None):
        """Contract: `modlhmp.networks.network.Base`."""
        step = past[:, 0, -1] - past[:, 0, -2]
        time = torch.arange(1, self.steps + 1, device=past.device)
        return (self.factor * step[:, None] * time[:, None])[:, None]

    def loss(self, scenes):
        """Mean distance from the truth."""
        xy = self.forecast(scenes.past, scenes.past_present, None)
        return track_ade(xy[:, 0], scenes.future[:, 0], scenes.future_present[:, 0]).mean()
