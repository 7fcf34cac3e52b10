"""CLiFF-map that is updated: histograms of velocities of every location, and their mixtures where they changed.

A row counts at every location within `radius_m`, as in `maps.cliff.build`: the map has the same locations with the same
counts. The mixtures come from the histograms (`cells`), so they are those of the rows but for the width of a bin.
"""

from typing import NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.kernels import kernel
from modlhmp.maps import cliff
from modlhmp.maps.updated.cells import bins_of, fit_cells
from modlhmp.maps.updated.counted import BIN_BITS, Counted, Slot, changes, packed, summed, unpacked
from modlhmp.tracks import Tracks, runs

LONG_MEMORY = 10.0  # rows that what is forgotten of a location counts for, at most, spread like all it ever saw


class Fitted(NamedTuple):
    """Mixtures of some sorted `cells` [n]: rows ever counted there, what these weigh now, and the components.

    `sizes` [n] are the numbers of components, which stand cell by cell.
    """

    cells: np.ndarray
    counts: np.ndarray
    weights: np.ndarray
    sizes: np.ndarray
    components: np.ndarray


NONE = np.empty(0, np.int64)
NOTHING = Fitted(NONE, NONE, np.empty(0), NONE, np.empty((0, 6)))


class CountedCliff(Counted):
    """A CLiFF-map of counts, for the whole day or (kind tc_cliff) also for every clock hour."""

    kinds = ("cliff", "tc_cliff")

    def code(self, tracks: Tracks) -> tuple[np.ndarray, np.ndarray]:
        """See `Counted`: the locations in reach, and the bin of the velocity."""
        size, radius = self.building.resolution_m, self.building.radius_m
        row, i, j = _reached(tracks.x, tracks.y, size, radius * (1 + 1e-12))
        return row, packed(i, j, bins_of(tracks.heading, tracks.speed)[row])

    def tables(self) -> tuple[pa.Table | None, dict[int, pa.Table]]:
        """See `Counted`; only mixtures of locations whose counts changed since the last time are fitted."""
        if self.kind == "cliff":
            return self._table(None), {}
        hours = self.site.listed_hours or sorted({number % self.per_day for number in self.slots})
        tables = {hour: self._table(hour) for hour in hours}
        return self._table(None), {hour: table for hour, table in tables.items() if table.num_rows}

    def _table(self, hour: int | None) -> pa.Table:
        """The table of a clock hour, or of the whole day."""
        slots = {number: one for number, one in self.slots.items() if hour in (None, number % self.per_day)}
        reader = self.readers.setdefault(hour, Reader())
        fitted = reader.read(self, slots)
        x, y, _ = unpacked(fitted.cells << BIN_BITS)
        size = self.building.resolution_m
        return cliff.table_of(
            np.column_stack([x, y]) * size, np.split(fitted.components, np.cumsum(fitted.sizes)[:-1]), fitted.counts,
            fitted.weights / fitted.weights.max(initial=0.0), size, self.building.radius_m,
        )  # fmt: skip

    @property
    def readers(self) -> dict[int | None, "Reader"]:
        """What was read last, by clock hour; None: of the whole day."""
        return self.__dict__.setdefault("_readers", {})


class Reader:
    """The mixtures of the locations of some slots, kept up to date."""

    def __init__(self) -> None:
        self.slots: dict[int, Slot] = {}
        self.half_life_h: float | None = None
        self.codes, self.counts = summed(np.empty(0, np.int64), np.empty(0, np.int64))
        self.fitted = NOTHING

    def read(self, of: CountedCliff, slots: dict[int, Slot]) -> Fitted:
        """Fit anew where the counts have changed; the same, to the bit, as if all had been fitted."""
        codes, counts = changes(self.slots, slots)
        self.codes, self.counts = summed(np.concatenate([self.codes, codes]), np.concatenate([self.counts, counts]))
        changed = np.unique(codes >> BIN_BITS)
        if of.half_life_h != self.half_life_h:
            changed = np.unique(np.concatenate([changed, self.codes >> BIN_BITS]))
        self.slots, self.half_life_h = dict(slots), of.half_life_h
        if len(changed):
            self.fitted = _spliced(self.fitted, changed, self._fit(of, changed))
        if of.half_life_h is None or not len(self.fitted.cells):
            return self.fitted
        # What is not seen keeps its shape, and loses only weight.
        return self.fitted._replace(weights=self._evidence(of))

    def _fit(self, of, changed):
        """`Fitted` of these cells: those that have ever had enough rows."""
        mine = np.flatnonzero(np.isin(self.codes >> BIN_BITS, changed))
        codes, counts = self.codes[mine], self.counts[mine]
        cells = codes >> BIN_BITS
        first = np.flatnonzero(np.diff(cells, prepend=-1))
        total = np.add.reduceat(counts, first) if len(first) else counts
        enough = np.repeat(total >= of.building.min_observations, np.diff(np.append(first, len(codes))))
        codes, counts, cells = codes[enough], counts[enough], cells[enough]
        total = total[total >= of.building.min_observations]
        first = np.flatnonzero(np.diff(cells, prepend=-1))
        starts = np.append(first, len(codes))
        weights = counts.astype(float)
        if of.half_life_h is not None and len(codes):
            decayed, size = self._decayed(of, codes), np.diff(starts)
            forgotten = np.minimum(total - np.add.reduceat(decayed, first), LONG_MEMORY)
            weights = decayed + weights * np.repeat(forgotten / total, size)
        sizes, components = fit_cells(starts, codes & ((1 << BIN_BITS) - 1), weights)
        return Fitted(cells[first], total, total.astype(float), np.diff(sizes), components)

    def _decayed(self, of, codes):
        """Rows of sorted `codes`, each halved by its age.

        Age counts from the last slot of the cell, so that what is seen elsewhere, or nowhere, changes no mixture.
        """
        cells = codes >> BIN_BITS
        newest, parts = np.full(len(codes), -1), []
        for number in sorted(self.slots):
            slot = self.slots[number]
            at = np.minimum(np.searchsorted(codes, slot.codes), len(codes) - 1)
            met = codes[at] == slot.codes
            parts.append((number, at[met], slot.counts[met]))
            newest[at[met]] = number
        first = np.flatnonzero(np.diff(cells, prepend=-1))
        of_cell = np.maximum.reduceat(newest, first)
        last = np.repeat(of_cell, np.diff(np.append(first, len(codes))))
        weights = np.zeros(len(codes))
        for number, at, counts in parts:  # in the order of time, whatever the order of updates
            weights[at] += counts * 0.5 ** (of.age_h(number, last[at]) / of.half_life_h)
        return weights

    def _evidence(self, of):
        """Rows of the fitted cells, each halved by its age, now."""
        weights, now = np.zeros(len(self.fitted.cells)), of.newest
        for number in sorted(self.slots):
            slot = self.slots[number]
            cells, counts = summed(slot.codes >> BIN_BITS, slot.counts)
            at = np.minimum(np.searchsorted(self.fitted.cells, cells), len(weights) - 1)
            met = self.fitted.cells[at] == cells
            weights[at[met]] += counts[met] * 0.5 ** (of.age_h(number, now) / of.half_life_h)
        return weights


def _spliced(before: Fitted, changed: np.ndarray, fitted: Fitted) -> Fitted:
    """`before` with the cells `changed` as they are in `fitted`, or without them where they are not."""
    kept = ~np.isin(before.cells, changed)
    parts = [np.concatenate([ours[kept], new]) for ours, new in zip(before[:4], fitted[:4], strict=True)]
    components = np.concatenate([before.components[np.repeat(kept, before.sizes)], fitted.components])
    cells, counts, weights, sizes = parts
    order = np.argsort(cells, kind="stable")
    start = (np.cumsum(sizes) - sizes)[order]
    chosen = components[runs(start, sizes[order])]
    return Fitted(cells[order], counts[order], weights[order], sizes[order], chosen)


@kernel
def _reached(x, y, size, radius):
    """(row, i, j) [m] of every location (i, j) * size within the radius of a position."""
    reach = int(np.ceil(radius / size)) + 1
    most = (2 * reach + 1) ** 2
    row, i, j = np.empty(len(x) * most, np.int64), np.empty(len(x) * most, np.int64), np.empty(len(x) * most, np.int64)
    m = 0
    for n in range(len(x)):
        a0, b0 = int(np.floor(x[n] / size)), int(np.floor(y[n] / size))
        for a in range(a0 - reach, a0 + reach + 1):
            for b in range(b0 - reach, b0 + reach + 1):
                if (a * size - x[n]) ** 2 + (b * size - y[n]) ** 2 <= radius * radius:
                    row[m], i[m], j[m] = n, a, b
                    m += 1
    return row[:m].copy(), i[:m].copy(), j[:m].copy()
