"""Episode map: pieces of training tracks, found by place, heading and speed.

It answers: who stood about here and walked about like this, and what did they do next? The forecast follows the answers
(`forecasting.replay`). The map stores real tracks, so share it as you would share the recording. Not in the paper.
"""

from pathlib import Path

import numpy as np
import pyarrow as pa

from modlhmp.maps.base import read_map
from modlhmp.maps.pieces import Metric, differences, features, resample
from modlhmp.options import Episodes, NoBuilding
from modlhmp.site import Site
from modlhmp.storage import column
from modlhmp.tracks import Tracks

COLUMNS = ("person", "t", "x", "y")


def build(tracks: Tracks, site: Site, building: NoBuilding | None = None) -> pa.Table:
    """Build an episode map; returns a `pyarrow.Table`, one row per person and time step, sorted by both."""
    pieces = resample(tracks, site.time_step_s)
    return pa.table(
        {
            "person": pieces.person.astype(np.int32),
            "t": pieces.t,
            **{name: part.astype(np.float32) for name, part in zip(("x", "y"), pieces.xy.T, strict=True)},
        }
    ).replace_schema_metadata({"step": str(site.time_step_s)})


def load(path: str | Path | pa.Table, site: Site, options: Episodes) -> "EpisodeMap":
    """Read the Parquet form; `DataError` where it is not one, or is of another time step."""
    table = read_map(path, "an episode map", COLUMNS, ("step",), site.time_step_s)
    metric, past = Metric.of(options), site.observed_rows - 1
    return EpisodeMap(table, metric, site.difference_weights, past, site.time_step_s, site.timezone)


class EpisodeMap:
    """An episode map ready to be asked who walked like a walker.

    `xy` [m, 2] float64, `t` [m], `person` [m], `last` [m] and `speed` [m] are of all rows, `rows` those that can be
    found: with as many rows before them as a walker is observed for, and at least one after them.
    """

    def __init__(self, table, metric, weights, past, step_s=1.0, timezone="UTC"):
        from scipy.spatial import cKDTree  # noqa: PLC0415 - 25 MB and 0.15 s that other maps do not need

        self.metric, self.weights, self.past, self.timezone = metric, weights, past, timezone
        person, self.t = (column(table, name) for name in ("person", "t"))
        self.xy = np.column_stack([column(table, name).astype(float) for name in ("x", "y")])
        first = np.flatnonzero(np.diff(person, prepend=-1))
        count = np.diff(np.append(first, len(person)))
        self.person = person.astype(np.int64)
        self.last = np.repeat(first + count - 1, count)
        row = np.arange(len(person))
        self.rows = np.flatnonzero((row - np.repeat(first, count) >= past) & (row < self.last))
        self.speed = np.zeros(len(person))
        steps = differences(self.xy, past, step_s)[self.rows]
        points, self.speed[self.rows] = features(
            self.xy[self.rows], steps, weights, metric, metric.hour(self.t[self.rows], timezone)
        )
        self.tree = cKDTree(points)

    def nearest(self, points: np.ndarray, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows [n, N] most like the `points` [n, 8], nearest first, and how far they are [n, N] in m; N <= `number`."""
        number = min(number, len(self.rows))
        if not number:  # the tree cannot be asked for none
            return np.empty((len(points), 0), np.int64), np.empty((len(points), 0))
        distance, found = self.tree.query(points, number)
        return self.rows[found].reshape(-1, number), distance.reshape(-1, number)  # it leaves an axis of one out
