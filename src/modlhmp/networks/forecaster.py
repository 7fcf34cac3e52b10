"""A trained network as a forecaster (contract: `forecasting.base`)."""

import numpy as np
import torch

from modlhmp.forecasting.base import Forecast
from modlhmp.networks.data import observed_scene, whereabouts
from modlhmp.networks.training import BATCH, choose_device, load_network


def network_forecaster(path, kind, options, dataset, learned):
    """A function (observed, steps, keys) -> Forecast from the weights at `path`; always alive, no fitness."""
    torch.set_num_threads(learned["threads"])
    device = choose_device(learned["device"])
    network = load_network(path, kind, options, dataset).to(device)

    def forecast(observed, steps, keys):
        past, present, origin = observed_scene(observed, dataset["time_step_s"])
        where = whereabouts(origin, observed.t[:, -1], dataset["timezone"])
        parts = [np.empty((0, *keys.shape[1:], steps, 2))]
        with torch.no_grad():
            for start in range(0, len(past), BATCH):
                some = slice(start, start + BATCH)
                seen = (torch.from_numpy(part[some]).to(device) for part in (past, present))
                streams, place = torch.from_numpy(keys[some].view(np.int64)), torch.from_numpy(where[some]).to(device)
                parts.append(network.forecast(*seen, streams, place).cpu().numpy())
        xy = np.concatenate(parts) + origin[:, None, None]
        n, k = keys.shape
        return Forecast(
            xy.astype(np.float32),
            np.zeros((n, k, steps), np.float32),
            np.full((n, k), steps, np.int32),
            network.output,
        )

    return forecast
