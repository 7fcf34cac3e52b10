"""Histograms of velocities in cells, as a density: the plain rivals of a map, and smoothed ones.

Counts of (heading, speed) in a cell are shrunk to something broader, which takes the place of what is missing:

    p(bin | cell) = (n_bin + k q_bin) / (n + k)

At the first level q is what is known without a map (`density.NoMap`), so with k = the number of bins one is added to
each. At every further level q is the level before: a narrower neighbourhood is shrunk to a wider one, an hour to the
day (F. Jelinek, R. Mercer, Interpolated estimation of Markov source parameters, 1980). Within its bins a density is
even over headings, and over speeds as that of `NoMap`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from modlhmp.angles import TWO_PI
from modlhmp.maps.density import REACH_M, SPEED_BIN_M_S, SPEED_BINS, ByHour, NoMap, Places, speed_bin
from modlhmp.maps.stef import orientation_bin
from modlhmp.site import Site
from modlhmp.tracks import Tracks, clock_hours

FAR_SD = 2.5  # counts are spread so many standard deviations far


class Level(NamedTuple):
    """Counts at one width, and how many rows what is broader counts for."""

    weight: float  # k
    spread_m: float = 0.0  # a row counts in the cells around, by a Gaussian of this standard deviation; 0: in its own
    hourly: bool = False  # counts of the hour instead of the day


class Bins(NamedTuple):
    """Bins of headings and speeds, and how counts are spread over neighbouring ones."""

    headings: int = 8
    speed_m_s: float | None = None  # width; None: one for all speeds, whose shape is then that of `NoMap`
    spread_rad: float = 0.0  # standard deviations of the Gaussians by which a row counts in the bins around
    spread_m_s: float = 0.0


PLAIN = Bins()


def histogram(
    tracks: Tracks, site: Site, no_map: NoMap, cell_m: float, levels: Sequence[Level], bins: Bins = PLAIN
) -> "Histogram | ByHour":
    """The density of the velocities of `tracks`, counted in cells [i, i + 1) * `cell_m`, through `levels`.

    Rows that are no motion (speed 0, or without heading) do not count. Levels by the hour come last; with one of them
    each hour is a density of its own; one without rows is, by the same formula, as the day.
    """
    return Counts(tracks, site, no_map, cell_m, bins).density(levels)


class Counts:
    """Velocities of tracks counted in cells and bins, of which densities of several `levels` can be made."""

    def __init__(self, tracks: Tracks, site: Site, no_map: NoMap, cell_m: float, bins: Bins = PLAIN) -> None:
        tracks = tracks.take(tracks.moves())
        cells = np.floor(np.column_stack([tracks.x, tracks.y]) / cell_m).astype(np.int64).reshape(-1, 2)
        self.cells, cell = np.unique(cells, axis=0, return_inverse=True)
        self.cell_m, self.timezone, self.grid = cell_m, site.timezone, _Grid(no_map, bins)
        x, y = ((self.cells + 0.5) * cell_m).T
        self.places = Places(x, y, max(REACH_M, cell_m * np.sqrt(0.5)))
        self.row = cell.ravel() * self.grid.size + self.grid.bin_of(tracks.heading, tracks.speed)
        self.hour = clock_hours(tracks.t, site.timezone)
        self.of_day: dict[float, np.ndarray] = {}  # by spread: what several densities need

    def density(self, levels: Sequence[Level]) -> "Histogram | ByHour":
        """The density of these levels (`histogram`)."""
        p = self.grid.without_map().astype(np.float32)
        for level in levels:
            if not level.hourly:
                if level.spread_m not in self.of_day:
                    self.of_day[level.spread_m] = self._counted(slice(None), level.spread_m)
                p = _shrunk(self.of_day[level.spread_m], p, level.weight)
        by_hour, day = [level for level in levels if level.hourly], Histogram(self.places, self.grid, p)
        if not by_hour:
            return day
        found = {}
        for hour in np.unique(self.hour).tolist():
            of_hour = p
            for level in by_hour:
                of_hour = _shrunk(self._counted(self.hour == hour, level.spread_m), of_hour, level.weight)
            found[hour] = Histogram(self.places, self.grid, of_hour)
        return ByHour(found, self.timezone, day)

    def _counted(self, which: np.ndarray | slice, spread_m: float) -> np.ndarray:
        """Counts [cells, bins] of some rows, spread over cells and bins."""
        size = len(self.cells) * self.grid.size
        counts = self.grid.spread(np.bincount(self.row[which], minlength=size).astype(np.float32))
        return _neighbours(self.cells * self.cell_m, spread_m) @ counts if spread_m else counts


def _shrunk(n, p, weight):
    """Counts shrunk to probabilities that count for `weight` rows."""
    return (n + weight * p) / (n.sum(axis=1, keepdims=True) + weight)


def _neighbours(places, spread_m):
    """Weights [cells, cells], sparse: how much of a row of the one cell counts in the other."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - as in `density`

    tree = cKDTree(places)
    near = tree.sparse_distance_matrix(tree, FAR_SD * spread_m, output_type="coo_matrix").tocsr()
    near.data = np.exp(-0.5 * (near.data / spread_m) ** 2)
    # The distance of a cell from itself is 0, which a sparse matrix leaves out.
    near.setdiag(1.0)
    return near.astype(np.float32)


class _Grid:
    """Bins of velocities; the number of one is heading bin * speeds + speed bin."""

    def __init__(self, no_map, bins):
        self.no_map, self.headings, self.how = no_map, bins.headings, bins
        # Whole bins of the histogram without a map, so that its shape within each is known; the last holds the tail.
        self.per = SPEED_BINS + 1 if bins.speed_m_s is None else max(round(bins.speed_m_s / SPEED_BIN_M_S), 1)
        self.speeds = -(-(SPEED_BINS + 1) // self.per)
        self.size = self.headings * self.speeds
        fine = np.exp(no_map.log_p)
        self.p_speed = np.add.reduceat(fine, np.arange(0, len(fine), self.per))

    def without_map(self):
        """Probabilities [1, size] of the bins without a map."""
        return np.tile(self.p_speed / self.headings, self.headings)[None]

    def bin_of(self, heading, speed):
        """Bin [n] of each velocity."""
        return orientation_bin(heading, self.headings) * self.speeds + speed_bin(speed) // self.per

    def spread(self, counts):
        """Counts [cells * size] spread over the neighbouring bins, as [cells, size]."""
        counts = counts.reshape(-1, self.headings, self.speeds)
        width = TWO_PI / self.headings
        apart = np.arange(self.headings)
        around = np.minimum(apart, self.headings - apart) * width
        kernel = _normal(around[(apart[:, None] - apart) % self.headings], self.how.spread_rad)
        counts = np.einsum("chs,hg->cgs", counts, kernel, optimize=True)
        apart = np.arange(self.speeds) * self.per * SPEED_BIN_M_S
        kernel = _normal(apart[:, None] - apart, self.how.spread_m_s)
        return np.ascontiguousarray(counts @ kernel).reshape(len(counts), self.size)


def _normal(distance, sd):
    """Shares [bins, bins] in which a row of a bin counts in each; rows sum to 1."""
    shares = np.exp(-0.5 * (distance / sd) ** 2) if sd else (distance == 0).astype(float)
    return (shares / shares.sum(axis=1, keepdims=True)).astype(np.float32)


class Histogram:
    """A density of probabilities [cells, bins] of velocities in bins; contract in `maps.density`."""

    def __init__(self, places, grid, p):
        self.places, self.grid = places, grid
        self.p = np.broadcast_to(p, (places.tree.n, grid.size))
        self.log_width = np.log(TWO_PI / grid.headings)

    def log_density(
        self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> np.ndarray:
        """See `Density`."""
        row, answer = self.places.nearest(x, y), np.full(len(x), np.nan)
        found = row >= 0
        speed = np.asarray(speed, float)[found]
        within = self.grid.no_map.log_speed(speed) - np.log(self.grid.p_speed)[speed_bin(speed) // self.grid.per]
        bins = self.grid.bin_of(np.asarray(heading)[found], speed)
        with np.errstate(divide="ignore"):
            answer[found] = np.log(self.p[row[found], bins]) - self.log_width + within
        return answer

    def log_heading(self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """See `Density`."""
        row, answer = self.places.nearest(x, y), np.full(len(x), np.nan)
        found = row >= 0
        bins = orientation_bin(np.asarray(heading)[found], self.grid.headings)
        of_bin = self.p.reshape(-1, self.grid.headings, self.grid.speeds)[row[found], bins].sum(axis=1)
        with np.errstate(divide="ignore"):
            answer[found] = np.log(of_bin) - self.log_width
        return answer

    def covered(self, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> np.ndarray:
        """See `Density`."""
        return self.places.nearest(x, y) >= 0
