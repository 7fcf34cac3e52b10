"""STeF-map: in each cell, how likely people walk into each of a few directions, as periodic functions of time.

Paper Sec. III-C.3; S. Molina et al., The STeF-map, 2022. Detections are counted by direction and interval,
normalised by the busiest direction of that cell and interval, and each direction's signal goes through FreMEn.
"""

from pathlib import Path

import numpy as np
import pyarrow as pa

from modlhmp.kernels import kernel
from modlhmp.maps import fremen
from modlhmp.maps.base import Sampled, hours_mapped, lattice_index, read_map
from modlhmp.options import RollOut, StefBuilding
from modlhmp.site import Site
from modlhmp.storage import DataError, column
from modlhmp.tracks import Tracks, clock_offsets

DAY_S = 86400.0


def orientation_bin(heading: np.ndarray, orientations: int) -> np.ndarray:
    """Index of the direction i * 2 pi / orientations nearest to each heading [rad]; a border belongs to the lower."""
    return np.ceil(np.asarray(heading) * orientations / (2 * np.pi) - 0.5).astype(np.int64) % orientations


def used(tracks: Tracks) -> np.ndarray:
    """Which rows count, bool [n]: those with a heading that are not known to stand; their speed may be unknown."""
    return np.isfinite(tracks.heading) & (tracks.speed != 0.0)


def build(tracks: Tracks, site: Site, building: StefBuilding | None = None) -> pa.Table:
    """Build a STeF-map; returns a `pyarrow.Table`, one row per cell and orientation.

    Cells are [i, i + 1) * `resolution_m`; x, y are their centres. All intervals of every training day count, night
    included, and an interval without detections is 0. Times are seconds since the first local midnight.
    """
    building = building or StefBuilding()
    resolution_m, orientations = building.resolution_m, building.orientations
    interval_s = building.interval_s
    tracks = tracks.take(used(tracks))
    if not len(tracks.t):
        raise DataError("a STeF-map needs rows with a heading; the training recordings have none")
    cells, cell = np.unique(
        np.floor(np.column_stack([tracks.x, tracks.y]) / resolution_m).astype(np.int64),
        axis=0,
        return_inverse=True,
    )
    local = tracks.t + clock_offsets(tracks.t, site.timezone)
    days, day = np.unique(np.floor(local / DAY_S), return_inverse=True)
    per_day = int(np.ceil(DAY_S / interval_s))
    interval = day * per_day + (np.mod(local, DAY_S) // interval_s).astype(np.int64)
    times = ((days - days[0]) * DAY_S)[:, None] + (np.arange(per_day) + 0.5) * interval_s
    signals = _signals(cell.ravel(), orientation_bin(tracks.heading, orientations), interval,
                       len(cells), orientations, len(days) * per_day)  # fmt: skip
    return table_of(cells, fremen.analyse(times.ravel(), signals, building.order), building)


def table_of(
    cells: np.ndarray, parts: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], building: StefBuilding
) -> pa.Table:
    """The table of cells (i, j) [n, 2] with the `parts` that FreMEn finds in the signals of each one's directions."""
    mean, amplitude, phase, period = parts
    orientations = building.orientations
    centre = np.repeat((cells + 0.5) * building.resolution_m, orientations, axis=0)
    return pa.table(
        {
            "x": centre[:, 0],
            "y": centre[:, 1],
            "orientation": np.tile(np.arange(orientations), len(cells)),
            "mean": mean,
            "amplitudes": _lists(amplitude),
            "phases": _lists(phase),
            "periods": _lists(period),
        }
    ).replace_schema_metadata({"resolution": str(building.resolution_m), "orientations": str(orientations)})


def build_hours(
    tracks: Tracks, site: Site, building: StefBuilding | None = None
) -> tuple[pa.Table | None, dict[int, pa.Table]]:
    """(the STeF-map, {hour: its orientation probabilities in the middle of the hour})."""
    table = build(tracks, site, building)
    return table, {hour: evaluate(table, middle_of_hour(hour)) for hour in hours_mapped(tracks, site)}


def _signals(cell, orientation, interval, cells, orientations, intervals):
    """Share of each direction in the busiest direction's count: [cells * orientations, intervals]."""
    flat = (cell * orientations + orientation) * intervals + interval
    counts = np.bincount(flat, minlength=cells * orientations * intervals).reshape(cells, orientations, intervals)
    busiest = counts.max(axis=1, keepdims=True)
    return (counts / np.maximum(busiest, 1)).reshape(cells * orientations, intervals)


def evaluate(table: pa.Table, t: float) -> pa.Table:
    """Orientation probabilities at time `t` [s since local midnight]: a table with x, y and a list per cell.

    Each direction's prediction is divided by the sum over the cell's directions; a cell whose directions are all
    predicted 0 keeps zeros: it has no dynamics then.
    """
    parts = [column(table, name).reshape(table.num_rows, -1) for name in ("amplitudes", "phases", "periods")]
    return _normalised(table, fremen.predict(t, column(table, "mean"), *parts))


def mean_probabilities(table: pa.Table) -> pa.Table:
    """Orientation probabilities of the whole day, from each direction's mean; as `evaluate` gives them."""
    return _normalised(table, column(table, "mean"))


def _normalised(table, value):
    """Values of a map's rows as probabilities of each cell's orientations."""
    orientations = int(table.schema.metadata[b"orientations"])
    value = value.reshape(-1, orientations)
    total = value.sum(axis=1, keepdims=True)
    return pa.table(
        {
            "x": column(table, "x")[::orientations],
            "y": column(table, "y")[::orientations],
            "probabilities": _lists(np.divide(value, total, out=np.zeros_like(value), where=total > 0)),
        }
    ).replace_schema_metadata(table.schema.metadata)


def middle_of_hour(hour: int) -> float:
    """The time at which an hour's map is evaluated [s since local midnight]."""
    return (hour + 0.5) * 3600.0


def _lists(array):
    return pa.FixedSizeListArray.from_arrays(pa.array(np.ascontiguousarray(array).ravel()), array.shape[1])


def load(path: str | Path | pa.Table, site: Site, options: RollOut) -> "StefMap":
    """Read one hour's Parquet form; `DataError` where it is not one."""
    table = read_map(path, "an evaluated STeF-map", ("x", "y", "probabilities"), ("resolution", "orientations"))
    return StefMap(table, options.sampling_radius_m)


def load_whole(path: str | Path | pa.Table, site: Site, options: RollOut) -> "StefMap":
    """The map of the whole day, from the periodic functions: each direction's mean; `DataError` where it is not one."""
    table = read_map(path, "a STeF-map", ("x", "y", "orientation", "mean"), ("resolution", "orientations"))
    return StefMap(mean_probabilities(table), options.sampling_radius_m)


class StefMap:
    """A STeF-map evaluated at one time, ready for sampling (paper Alg. 3); contract in `maps.base`."""

    draws = 1

    def __init__(self, table, sampling_radius=1.0):
        self.radius = float(sampling_radius)
        self.resolution = float(table.schema.metadata[b"resolution"])
        self.x, self.y = column(table, "x"), column(table, "y")
        self.probabilities = column(table, "probabilities").reshape(table.num_rows, -1)
        self.origin = np.array([self.x.min(), self.y.min()])
        node = np.rint((np.column_stack([self.x, self.y]) - self.origin) / self.resolution).astype(np.int64)
        self.index = lattice_index(node[:, 0], node[:, 1], (0, 0), node.max(0) + 1)

    def sample(
        self, x: np.ndarray, y: np.ndarray, speed: np.ndarray, heading: np.ndarray, t: np.ndarray, uniforms: np.ndarray
    ) -> Sampled:
        """Draw a direction of the nearest cell in reach by its probabilities; the speed stays as it is."""
        new_heading, log_fitness, found = _sample(
            x,
            y,
            uniforms,
            self.index,
            self.origin,
            self.resolution,
            self.radius,
            self.x,
            self.y,
            self.probabilities,
        )
        return np.array(speed), new_heading, log_fitness, found  # line 3: rho_s = rho_{t-1}


@kernel
def _sample(x, y, uniforms, index, origin, resolution, radius, cell_x, cell_y, probabilities):
    """Algorithm 3 of the paper but for its line 3, for every particle."""
    n, orientations = len(x), probabilities.shape[1]
    heading, log_fitness, found = np.zeros(n), np.zeros(n), np.zeros(n, np.bool_)
    r = radius / resolution + 1e-9
    for i in range(n):
        u, v = (x[i] - origin[0]) / resolution, (y[i] - origin[1]) / resolution
        # Line 1: the nearest cell.
        row, nearest = -1, np.inf
        for a in range(max(int(np.ceil(u - r)), 0), min(int(np.floor(u + r)), index.shape[0] - 1) + 1):
            for b in range(max(int(np.ceil(v - r)), 0), min(int(np.floor(v + r)), index.shape[1] - 1) + 1):
                c = index[a, b]
                if c >= 0:
                    d = np.hypot(cell_x[c] - x[i], cell_y[c] - y[i])
                    if d <= radius and d < nearest:
                        row, nearest = c, d
        if row < 0 or probabilities[row].sum() == 0.0:
            continue
        found[i] = True
        # Line 2: one of its directions by their probabilities.
        chosen, rest = -1, uniforms[i, 0]
        for o in range(orientations):
            if probabilities[row, o] > 0.0:
                chosen = o
                rest -= probabilities[row, o]
                if rest <= 0.0:
                    break
        angle = chosen * 2.0 * np.pi / orientations  # theta_stef,i of Sec. III-C.3
        heading[i] = angle if angle <= np.pi else angle - 2.0 * np.pi
        log_fitness[i] = np.log(probabilities[row, chosen])
    return heading, log_fitness, found
