"""A trained network as a forecaster (contract: `forecasting.base`)."""

from pathlib import Path

import numpy as np
import torch

from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.observe import Observed
from modlhmp.kinds import Kind
from modlhmp.networks.data import observed_scene, whereabouts
from modlhmp.networks.network import Base
from modlhmp.networks.training import BATCH, choose_device, load_network
from modlhmp.options import Training
from modlhmp.site import Site


def load(path: str | Path, kind: Kind, options: Training, site: Site, device: str, threads: int) -> Base:
    """A trained network from its weights at `path`, on the device, for forecasts with so many threads."""
    torch.set_num_threads(threads)
    return load_network(path, kind, options, site).to(choose_device(device))


def forecaster(network: Base, site: Site, options: Training) -> Forecaster:
    """A function (observed, steps, keys) -> Forecast; its futures are always alive and have no fitness."""
    device = next(network.parameters()).device

    def forecast(observed: Observed, steps: int, keys: np.ndarray) -> Forecast:
        past, present, origin = observed_scene(observed, site.time_step_s)
        where = whereabouts(origin, observed.t[:, -1], site.timezone)
        parts = [np.empty((0, *keys.shape[1:], steps, 2))]
        with torch.no_grad():
            for start in range(0, len(past), BATCH):
                some = slice(start, start + BATCH)
                seen, there = (torch.from_numpy(part[some]).to(device) for part in (past, present))
                streams, place = torch.from_numpy(keys[some].view(np.int64)), torch.from_numpy(where[some]).to(device)
                parts.append(network.forecast(seen, there, streams, place).cpu().numpy())
        xy = np.concatenate(parts) + origin[:, None, None]
        n, k = keys.shape
        return Forecast(
            xy.astype(np.float32),
            np.zeros((n, k, steps), np.float32),
            np.full((n, k), steps, np.int32),
            network.output,
        )

    return forecast
