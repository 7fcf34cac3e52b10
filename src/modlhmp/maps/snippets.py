"""Snippet flow map: in every cell and heading bin, some displacements of a few seconds that people really made there.

CLiFF's memory is one velocity; a snippet keeps a few seconds of a real walk: its speed, its turns, its stops, or that
it ended in a way out. A forecast strings snippets together (`forecasting.chain`). A bin holds so many at most, drawn at
random, and how many they stand for: fewer make a compact map. Not in the paper.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.maps.base import lattice_box, read_map
from modlhmp.maps.pieces import HEADINGS, Metric, Pieces, cell_and_bin, features, resample
from modlhmp.options import SnippetBuilding, Snippets
from modlhmp.site import Site
from modlhmp.storage import column
from modlhmp.tracks import Tracks

COLUMNS = ("i", "j", "bin", "x", "y", "minute", "stands_for", "steps", "path")


def build(tracks: Tracks, site: Site, building: SnippetBuilding | None = None, seed: int = 0) -> pa.Table:
    """Build a snippet flow map; returns a `pyarrow.Table`, one row per snippet, sorted by cell and bin.

    `path` holds positions relative to the start: the `past` steps before it, oldest first, then up to `length_s`, held
    where the person left. `steps` says how many were walked, up to one more than the length: whoever walked no more
    than the length has left by then. A bin keeps at most `most` snippets, of which each stands for `stands_for`.
    """
    return of_pieces(resample(tracks, site.time_step_s), site, building or SnippetBuilding(), seed)


def of_pieces(pieces: Pieces, site: Site, building: SnippetBuilding, seed: int = 0) -> pa.Table:
    """What `build` says, of the `Pieces` of tracks at the time step."""
    row = whole(pieces, site)
    return table_of(pieces, row, np.random.default_rng(seed).random(len(row)), site, building)


def whole(pieces: Pieces, site: Site) -> np.ndarray:
    """Rows [n] at which a snippet can start: as many before as a walker is observed for, and one after them."""
    return np.flatnonzero((pieces.age >= site.observed_rows - 1) & (pieces.last > np.arange(len(pieces.person))))


def table_of(
    pieces: Pieces, row: np.ndarray, keys: np.ndarray, site: Site, building: SnippetBuilding,
    weights: np.ndarray | None = None,
) -> pa.Table:  # fmt: skip
    """The map of the snippets that start at `row` [n]: of each bin those with the smallest `keys` [n].

    `weights` [n] are what each counts for; default: 1.
    """
    step_s, cell_m, most, past = site.time_step_s, building.cell_m, building.most, site.observed_rows - 1
    length = max(round(building.length_s / step_s), 1)
    where = cell_and_bin(pieces, row, cell_m, step_s)
    order = np.lexsort((keys, *where.T[::-1]))
    row, where = row[order], where[order]
    new = np.ones(len(row), bool)
    new[1:] = (where[1:] != where[:-1]).any(axis=1)
    first = np.flatnonzero(new)
    number = np.diff(np.append(first, len(row)))
    count = number if weights is None or not len(row) else np.add.reduceat(weights[order], first)
    rank = np.arange(len(row)) - np.repeat(first, number)
    kept = rank < most
    stands_for = np.repeat(count / np.minimum(number, most), number)[kept]
    row, where = row[kept], where[kept]
    steps = np.minimum(pieces.last[row] - row, length + 1)
    ahead = np.minimum(np.arange(-past, length + 1), steps[:, None])
    path = pieces.xy[row[:, None] + ahead] - pieces.xy[row][:, None]
    return pa.table(
        {
            **dict(zip(("i", "j", "bin"), where.T.astype(np.int32), strict=True)),
            **{name: part.astype(np.float32) for name, part in zip(("x", "y"), pieces.xy[row].T, strict=True)},
            "minute": (pieces.t[row] // 60).astype(np.int32),
            "stands_for": stands_for.astype(np.float32),
            "steps": steps.astype(np.int16),
            "path": pa.FixedSizeListArray.from_arrays(path.astype(np.float32).ravel(), 2 * path.shape[1]),
        }
    ).replace_schema_metadata({"cell": str(cell_m), "past": str(past), "step": str(step_s)})


class SnippetArrays(NamedTuple):
    """What kernels see of a snippet flow map.

    Per snippet, sorted by bin: `points` [m, 8] in the metric (float32), `speed` [m] in m/s, `steps` [m] walked and
    whether the person `leaves` [m] then, `path` [m, past + 1 + L, 2] (float32) with the start as its row `past`,
    `minute` [m] of the start.
    Per bin b: snippets `starts[b]` to `starts[b + 1]`, which stand for `count[b]`. `index` [cells in x, cells in y,
    HEADINGS + 1] is a cell's bins, -1 where empty; `origin` is its first cell, `cell` its size in m. `weights` [past]
    are those of the last steps, `metric` the numbers of the `Metric`.
    """

    index: np.ndarray  # type: ignore[assignment]  # not a tuple's method
    origin: np.ndarray
    cell: float
    starts: np.ndarray
    count: np.ndarray  # type: ignore[assignment]
    points: np.ndarray
    speed: np.ndarray
    steps: np.ndarray
    leaves: np.ndarray
    minute: np.ndarray
    path: np.ndarray
    past: int
    step_s: float
    weights: np.ndarray
    metric: np.ndarray


def load(path: str | Path | pa.Table, site: Site, options: Snippets) -> "SnippetMap":
    """Read the Parquet form; `DataError` where it is not one, or is of another time step."""
    table = read_map(path, "a snippet flow map", COLUMNS, ("cell", "past", "step"), site.time_step_s)
    weights, metric = site.difference_weights, Metric.of(options)
    return SnippetMap(table, metric, weights, options.length_s, options.most, site.timezone)


class SnippetMap:
    """A snippet flow map ready to be chained: its `arrays`, and what a walker is compared by."""

    def __init__(self, table, metric, weights, length_s=10.0, most=50, timezone="UTC"):
        meta = table.schema.metadata
        cell, past, self.step_s = float(meta[b"cell"]), int(meta[b"past"]), float(meta[b"step"])
        self.metric, self.weights, self.timezone = metric, weights, timezone
        where = np.column_stack([column(table, name) for name in ("i", "j", "bin")]).astype(np.int64)
        new = np.ones(len(where), bool)
        new[1:] = (where[1:] != where[:-1]).any(axis=1)
        first = np.flatnonzero(new)
        held = np.diff(np.append(first, len(where)))
        kept = np.flatnonzero(np.arange(len(where)) - np.repeat(first, held) < most)
        x, y, minute, steps = (column(table, name)[kept] for name in ("x", "y", "minute", "steps"))
        width = table.schema.field("path").type.list_size // 2
        path = column(table, "path").reshape(-1, width, 2)[kept]
        length = min(max(round(length_s / self.step_s), 1), width - 1 - past)
        before = np.diff(path[:, : past + 1].astype(float), axis=1)[:, ::-1] / self.step_s
        minute, xy = minute.astype(np.int64), np.column_stack([x, y]).astype(float)
        points, speed = features(xy, before, weights, metric, metric.hour(60.0 * minute, timezone))
        cells = where[first]
        origin, size = lattice_box(cells[:, :2])
        index = np.full((*size, HEADINGS + 1), -1, np.int32)
        i, j = (cells[:, :2] - origin).T
        index[i, j, cells[:, 2]] = np.arange(len(first))
        used = np.zeros(past)
        used[: len(weights)] = weights[:past]
        self.arrays = SnippetArrays(
            index, origin, cell, np.append(0, np.cumsum(np.minimum(held, most))),
            held * column(table, "stands_for")[first].astype(float), points.astype(np.float32), speed,
            np.minimum(steps, length).astype(np.int64), steps <= length, minute,
            np.ascontiguousarray(path[:, : past + 1 + length]), past, self.step_s, used / used.sum(), np.array(metric),
        )  # fmt: skip
