"""An outside package in one file: a map, a predictor and a network of its own for `modlhmp`."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from modlhmp.forecasting.base import Forecast
from modlhmp.kinds import NETWORK_FORECASTS, Kind
from modlhmp.maps.base import read_map
from modlhmp.options import RollOut, Training
from modlhmp.settings import Positive, WholeFrom1, option
from modlhmp.storage import column

# --- a map that is sampled at every step of a roll-out: the mean velocity of each cell --------------------------------


@dataclass(frozen=True, kw_only=True)
class Cells:
    """How the map is built."""

    cell_m: Positive = option(2.0, "size of a cell [m]")


def build(tracks, site, building=None):
    """One row per cell: its indices and the mean velocity there [m/s]."""
    size = (building or Cells()).cell_m
    known = np.isfinite(tracks.speed)
    cell = np.floor(np.column_stack([tracks.x, tracks.y])[known] / size).astype(np.int64)
    cells, which = np.unique(cell, axis=0, return_inverse=True)
    number = np.bincount(which.ravel())
    parts = (tracks.speed * np.cos(tracks.heading), tracks.speed * np.sin(tracks.heading))
    means = [np.bincount(which.ravel(), part[known]) / number for part in parts]
    table = pa.table(dict(zip(("i", "j", "vx", "vy"), (*cells.T, *means), strict=True)))
    return table.replace_schema_metadata({"cell": str(size)})


def load(path, site, options):
    """The map, ready to be sampled."""
    return MeanFlow(read_map(path, "a map of mean flow", ("i", "j", "vx", "vy"), ("cell",)))


class MeanFlow:
    """Contract: `modlhmp.maps.base`."""

    draws = 1

    def __init__(self, table):
        self.cell = float(table.schema.metadata[b"cell"])
        names = ("i", "j", "vx", "vy")
        rows = zip(*(column(table, name).tolist() for name in names), strict=True)
        self.velocity = {(i, j): (vx, vy) for i, j, vx, vy in rows}

    def sample(self, x, y, speed, heading, t, uniforms):
        """The mean velocity, turned a little at random; fitness falls with the turn."""
        keys = zip(*(np.floor(part / self.cell).astype(int).tolist() for part in (x, y)), strict=True)
        velocity = np.array([self.velocity.get(key, (np.nan, np.nan)) for key in keys]).reshape(-1, 2)
        found, turn = np.isfinite(velocity[:, 0]), uniforms[:, 0] - 0.5
        vx, vy = np.nan_to_num(velocity).T
        return np.hypot(vx, vy), np.arctan2(vy, vx) + turn, -np.abs(turn), found


MEAN_FLOW = Kind(
    name="mean_flow", title="Mean flow", options=RollOut, module=__name__, forecasts="modlhmp.forecasting.rollout",
    building=Cells, section="rollout",
)  # fmt: skip


# --- a predictor without a map: everybody stops -----------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Stopping:
    """How people stop."""

    after_s: WholeFrom1 = option(2, "seconds that a walker goes on for")


def forecaster(model, site, options):
    """Constant velocity for a while, then nothing."""

    def forecast(observed, steps, keys):
        start = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
        step = start - np.column_stack([observed.x[:, -2], observed.y[:, -2]])
        walked = np.minimum(np.arange(1, steps + 1), options.after_s / site.time_step_s)
        xy = (start[:, None] + step[:, None] * walked[:, None]).astype(np.float32)[:, None]
        n = len(start)
        return Forecast(xy, np.zeros((n, 1, steps), np.float32), np.full((n, 1), steps, np.int32), "single")

    return forecast


STANDING = Kind(
    name="standing", title="Standing still", options=Stopping, forecasts=__name__, random=False, one_path=True
)


# --- a network: a line whose direction is learned ---------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Line(Training):
    """How the network is trained."""

    windows: WholeFrom1 = option(100, "futures looked at in all, at most")


LINE = Kind(
    name="line", title="Learned line", options=Line, module="walking_network", forecasts=NETWORK_FORECASTS,
    learned=True, random=False, one_path=True,
)  # fmt: skip
