"""Ways out: how likely a person leaves within a time step, by place and heading.

Any map of dynamics can be given them (`WithExits`): a particle that leaves is no longer there, instead of walking on
through a door that the map knows nothing about. Not in the paper.
"""

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.maps.base import Sampled, lattice_box, parts, read_map
from modlhmp.maps.pieces import Pieces, cell_and_bin, heading_bin, resample
from modlhmp.options import ExitBuilding
from modlhmp.site import Site
from modlhmp.storage import column
from modlhmp.tracks import Tracks

PRIOR_ROWS = 10.0  # a bin with fewer rows leans on the rate of the whole map
COLUMNS = ("i", "j", "bin", "left", "rows")


def build(tracks: Tracks, site: Site, building: ExitBuilding | None = None) -> pa.Table:
    """Count rows and last rows of tracks by cell and heading bin (`pieces.heading_bin`); returns a `pyarrow.Table`."""
    pieces = resample(tracks, site.time_step_s)
    return table_of(pieces, counted(pieces), site, building or ExitBuilding())


def counted(pieces: Pieces) -> np.ndarray:
    """The rows [n] that have a heading."""
    return np.flatnonzero(pieces.age >= 1)


def table_of(
    pieces: Pieces, row: np.ndarray, site: Site, building: ExitBuilding, weights: np.ndarray | None = None
) -> pa.Table:
    """The counts of rows `row` [n] of pieces; with `weights` [n], what each counts for, they are no whole numbers."""
    step_s, cell_m = site.time_step_s, building.cell_m
    bins, which = np.unique(cell_and_bin(pieces, row, cell_m, step_s), axis=0, return_inverse=True)
    ends, number = (row == pieces.last[row]).astype(float), np.int32 if weights is None else np.float64
    weights = np.ones(len(row)) if weights is None else weights
    counts = {
        "left": np.bincount(which.ravel(), ends * weights, len(bins)).astype(number),
        "rows": np.bincount(which.ravel(), weights, len(bins)).astype(number),
    }
    table = pa.table({**dict(zip(COLUMNS, bins.astype(np.int32).T, strict=False)), **counts})
    return table.replace_schema_metadata({"cell": str(cell_m), "step": str(step_s)})


def with_exits(mod: Any, path: str | Path | pa.Table, site: Site) -> "WithExits":
    """A MoD with the ways out of a file; `DataError` where that is not one, or is of another time step."""
    return WithExits(mod, read_map(path, "a map of ways out", COLUMNS, ("cell", "step"), site.time_step_s))


class WithExits:
    """A MoD (contract: `maps.base`) whose particles may also leave: they then find no dynamics."""

    def __init__(self, mod, table):
        self.mod = mod
        self.cell = float(table.schema.metadata[b"cell"])
        cells, bins = np.column_stack([column(table, "i"), column(table, "j")]), column(table, "bin")
        left, rows = (column(table, name).astype(float) for name in ("left", "rows"))
        rate = left.sum() / max(rows.sum(), 1.0)
        self.origin, size = lattice_box(cells)
        self.probability = np.full((*size, int(bins.max(initial=0)) + 1), rate)
        i, j = (cells - self.origin).T
        self.probability[i, j, bins] = (left + PRIOR_ROWS * rate) / (rows + PRIOR_ROWS)
        self.elsewhere = rate

    def parts(self, t: np.ndarray) -> Iterator[tuple["WithExits", np.ndarray]]:
        """See `maps.base`: the same ways out for all maps of the MoD."""
        for mod, rows in parts(self.mod, t):
            one = copy.copy(self)
            one.mod = mod
            yield one, rows

    @property
    def draws(self) -> int:
        """One more than the MoD's."""
        return self.mod.draws + 1

    def sample(
        self, x: np.ndarray, y: np.ndarray, speed: np.ndarray, heading: np.ndarray, t: np.ndarray, uniforms: np.ndarray
    ) -> Sampled:
        """See `maps.base`; the last uniform decides whether the particle leaves."""
        *sampled, found = self.mod.sample(x, y, speed, heading, t, uniforms[:, :-1])
        return *sampled, found & (uniforms[:, -1] >= self.leaving(x, y, speed, heading))

    def leaving(self, x: np.ndarray, y: np.ndarray, speed: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Probability [n] to leave within a time step."""
        cell = np.floor(np.column_stack([x, y]) / self.cell).astype(np.int64) - self.origin
        bins = heading_bin(np.column_stack([speed * np.cos(heading), speed * np.sin(heading)]))
        size = np.array(self.probability.shape)
        inside = ((cell >= 0) & (cell < size[:2])).all(axis=1) & (bins < size[2])
        at = np.where(inside[:, None], cell, 0)
        return np.where(inside, self.probability[at[:, 0], at[:, 1], np.where(inside, bins, 0)], self.elsewhere)
