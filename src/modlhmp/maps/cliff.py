"""CLiFF-map: at each location a semi-wrapped Gaussian mixture over heading and speed, and its motion intensity.

Paper Sec. III-C.1, Alg. 2; T. Kucner et al., RA-L 2017. The time-conditioned CLiFF-map is this map for every
clock hour (`maps.base.HourlyMod`), Sec. III-C.2.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from modlhmp.angles import TWO_PI, unwrapped, wrapped
from modlhmp.kernels import kernel
from modlhmp.logs import progress
from modlhmp.maps import swgmm
from modlhmp.maps.base import Sampled, lattice_index, read_map
from modlhmp.maps.mean_shift import BANDWIDTHS, mean_shift
from modlhmp.options import CliffBuilding, RollOut
from modlhmp.site import Site
from modlhmp.storage import column
from modlhmp.tracks import Tracks

MIN_CLUSTER = 5  # smaller clusters are merged into the nearest; their data stay
COLUMNS = (
    "location", "x", "y", "weight", "mean_heading", "mean_speed",
    "var_heading", "cov_heading_speed", "var_speed", "count", "p", "q",
)  # fmt: skip
NEEDED = COLUMNS[:-1]  # q is 1 throughout: the sensors see everything, always
# The mixture's numbers are known to far fewer digits than float32 has.
TYPES = {"location": np.int32, "count": np.int32, **dict.fromkeys(COLUMNS[3:9], np.float32)}


def build(tracks: Tracks, site: Site | None = None, building: CliffBuilding | None = None) -> pa.Table:
    """Build a CLiFF-map from the velocities of a track table; returns a `pyarrow.Table`, one row per component.

    Locations are the multiples of `resolution_m` that have at least `min_observations` moving observations within
    `radius_m`, the border included. `count` is their number, `p` its ratio to the map's largest or, with `intensity:
    time`, the share of the time steps with people in which motion was seen there; `q` = 1 (the sensors see everything,
    always). An empty table says that there were too few data.
    """
    building = building or CliffBuilding()
    resolution_m = building.resolution_m
    step_s = site.time_step_s if site else 1.0
    observed = steps_observed(tracks.t, step_s)
    tracks = tracks.take(tracks.moves())
    locations, members = neighbourhoods(tracks.x, tracks.y, resolution_m, building.radius_m, building.min_observations)
    mixtures = [
        fit_location(tracks.heading[mine], tracks.speed[mine], building.bandwidth)
        for mine in progress(members, desc="CLiFF-map", unit=" locations")
    ]
    counts = np.array([len(mine) for mine in members], np.int64)
    # The motion intensity of Sec. III-C.1: of observations (public code), or of time as the paper writes.
    p = counts / counts.max(initial=1)
    if building.intensity == "time":
        seen = np.floor(tracks.t / step_s)
        p = np.array([len(np.unique(seen[mine])) for mine in members]) / observed
    return table_of(locations, mixtures, counts, p, resolution_m, building.radius_m, observed)


def steps_observed(t: np.ndarray, step_s: float) -> int:
    """How many time steps have people anywhere."""
    return len(np.unique(np.floor(t / step_s)))


def table_of(
    locations: np.ndarray,
    mixtures: Sequence[np.ndarray],
    counts: np.ndarray,
    p: np.ndarray,
    resolution_m: float,
    radius_m: float,
    observed: int = 0,
) -> pa.Table:
    """The table of locations [n, 2], each with a mixture [J, 6], the count of its observations, and its intensity p.

    `observed` are the time steps with people, 0 where that is not known.
    """
    sizes = [len(one) for one in mixtures]
    number = np.repeat(np.arange(len(locations)), sizes)
    components = np.concatenate(mixtures) if len(mixtures) else np.empty((0, 6))
    parts = (number, *locations[number].T, *components.T, counts[number], p[number], np.ones(len(number)))
    metadata = {"resolution": str(resolution_m), "radius": str(radius_m)}
    if observed and len(number):  # how many people walk within the radius of the busiest location, on average
        metadata["busiest"] = f"{counts.max() / observed:.6g}"
    return pa.table(
        {name: np.asarray(part).astype(TYPES.get(name, float)) for name, part in zip(COLUMNS, parts, strict=True)}
    ).replace_schema_metadata(metadata)


def neighbourhoods(
    x: np.ndarray, y: np.ndarray, resolution: float, radius: float, min_observations: int
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Lattice nodes [m, 2] with enough observations in their closed ball, and the observations' indices of each."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - 25 MB and 0.15 s, which only building needs

    if not len(x):
        return np.empty((0, 2)), []
    reach = int(np.ceil(radius / resolution))
    cells = np.unique(np.floor(np.column_stack([x, y]) / resolution).astype(np.int64), axis=0)
    offsets = np.stack(np.meshgrid(*[np.arange(-reach, reach + 2)] * 2), -1).reshape(-1, 2)
    nodes = np.unique((cells[:, None] + offsets).reshape(-1, 2), axis=0) * resolution
    found = cKDTree(np.column_stack([x, y])).query_ball_point(nodes, radius * (1 + 1e-12), return_sorted=True)
    enough = np.array([len(mine) >= min_observations for mine in found])
    return nodes[enough], [np.array(mine) for mine in found[enough]]


def fit_location(heading: np.ndarray, speed: np.ndarray, bandwidth: str = "isotropic") -> np.ndarray:
    """Mixture [J, 6] of one location: mean shift finds the clusters, EM fits them; heaviest component first."""
    labels, _ = mean_shift(heading, speed, BANDWIDTHS[bandwidth](heading, speed))
    components, _ = swgmm.fit(heading, speed, _components_of(heading, speed, _merge_small(heading, speed, labels)))
    return components[np.argsort(-components[:, 0], kind="stable")]


@kernel
def _merge_small(heading, speed, labels):
    """Give the members of clusters under `MIN_CLUSTER` to the nearest large one (the largest, if none is)."""
    number = labels.max() + 1
    counts, centres = np.zeros(number, np.int64), np.zeros((number, 2))
    for label in labels:
        counts[label] += 1
    for label in range(number):
        if counts[label] >= MIN_CLUSTER:
            found = _moments_of(label, heading, speed, labels)
            centres[label, 0], centres[label, 1] = found[1], found[2]
    if counts.max() < MIN_CLUSTER:
        return np.zeros_like(labels)
    merged = labels.copy()
    for i in range(len(labels)):
        if counts[labels[i]] < MIN_CLUSTER:
            nearest = np.inf
            for label in range(number):
                turn = unwrapped(heading[i] - centres[label, 0], 0)
                d2 = turn**2 + (speed[i] - centres[label, 1]) ** 2
                if counts[label] >= MIN_CLUSTER and d2 < nearest:
                    nearest, merged[i] = d2, label
    return merged


@kernel
def _components_of(heading, speed, labels):
    """Weight and moments [J, 6] of each cluster that has members, by rising label."""
    components, used = np.empty((labels.max() + 1, 6)), 0
    for label in range(len(components)):
        found = _moments_of(label, heading, speed, labels)
        if found[0] > 0.0:
            swgmm.copy_row(found, components[used])
            used += 1
    return components[:used].copy()


@kernel
def _moments_of(label, heading, speed, labels):
    """A cluster's share of the observations and its moments, [6]; a share of 0 where nobody is in it."""
    headings, speeds, n = np.empty(len(labels)), np.empty(len(labels)), 0
    for i in range(len(labels)):
        if labels[i] == label:
            headings[n], speeds[n] = heading[i], speed[i]
            n += 1
    found = np.zeros(6)
    if n:
        moments = swgmm.moments(headings[:n], speeds[:n])
        found[0] = n / len(labels)
        for i in range(5):
            found[1 + i] = moments[i]
    return found


def load(path: str | Path | pa.Table, site: Site, options: RollOut) -> "CliffMap":
    """Read the Parquet form; `DataError` where it is not one."""
    return CliffMap(read_map(path, "a CLiFF-map", NEEDED, ("resolution",)), options.sampling_radius_m)


class CliffMap:
    """A CLiFF-map ready for sampling (paper Alg. 2); see `maps.base` for the contract of `sample`."""

    draws = 3

    def __init__(self, table, sampling_radius=1.0):
        columns = {name: column(table, name) for name in NEEDED}
        self.radius = float(sampling_radius)
        self.resolution = float(table.schema.metadata[b"resolution"])
        first = np.flatnonzero(np.diff(columns["location"], prepend=-1))
        self.starts = np.append(first, len(columns["x"]))
        self.x, self.y, self.p = (columns[name][first] for name in ("x", "y", "p"))
        weight = columns["weight"]
        total = np.add.reduceat(weight, first) if len(first) else weight
        covariance = [columns[name] for name in ("var_heading", "cov_heading_speed", "var_speed")]
        components = np.column_stack(
            [
                weight / np.repeat(total, np.diff(self.starts)),
                columns["mean_heading"],
                columns["mean_speed"],
                *covariance,
            ]
        )
        swgmm.floor_covariances(components)
        self.components = components
        self.terms = swgmm.precompute(components)
        if len(first):
            self.origin = np.array([self.x.min(), self.y.min()])
            node = np.rint((np.column_stack([self.x, self.y]) - self.origin) / self.resolution).astype(np.int64)
            self.index = lattice_index(node[:, 0], node[:, 1], (0, 0), node.max(0) + 1)
        else:
            self.origin, self.index = np.zeros(2), np.full((1, 1), -1)

    def locate(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Row of the location used at each position: the largest p within the radius, -1 where there is none."""
        x, y = np.atleast_1d(x).astype(float), np.atleast_1d(y).astype(float)
        return _locate_many(x, y, self.index, self.origin, self.resolution, self.radius, self.x, self.y, self.p)

    def mixture(self, location: int) -> np.ndarray:
        """Components [J, 6] of a location (row as from `locate`)."""
        return self.components[self.starts[location] : self.starts[location + 1]]

    def sample(
        self, x: np.ndarray, y: np.ndarray, speed: np.ndarray, heading: np.ndarray, t: np.ndarray, uniforms: np.ndarray
    ) -> Sampled:
        """Draw from the mixture of the busiest location in reach; fitness = its log density at the draw."""
        return _sample(
            x, y, uniforms, self.index, self.origin, self.resolution, self.radius,
            self.x, self.y, self.p, self.starts, self.components, self.terms,
        )  # fmt: skip


@kernel(inline="always")  # a call that is handed arrays costs more than the search
def _locate(x, y, index, origin, resolution, radius, loc_x, loc_y, p):
    """Location with the largest p within `radius` (ties: the nearer, then the first); -1 if there is none."""
    best, best_p, best_d2 = -1, -1.0, np.inf
    u, v, r = (x - origin[0]) / resolution, (y - origin[1]) / resolution, radius / resolution + 1e-9
    for i in range(max(int(np.ceil(u - r)), 0), min(int(np.floor(u + r)), index.shape[0] - 1) + 1):
        for j in range(max(int(np.ceil(v - r)), 0), min(int(np.floor(v + r)), index.shape[1] - 1) + 1):
            row = index[i, j]
            if row >= 0 and p[row] >= best_p:
                d2 = (loc_x[row] - x) ** 2 + (loc_y[row] - y) ** 2
                if d2 <= radius * radius and (p[row] > best_p or d2 < best_d2):
                    best, best_p, best_d2 = row, p[row], d2
    return best


@kernel
def _locate_many(x, y, index, origin, resolution, radius, loc_x, loc_y, p):
    out = np.empty(len(x), np.int64)
    for n in range(len(x)):
        out[n] = _locate(x[n], y[n], index, origin, resolution, radius, loc_x, loc_y, p)
    return out


@kernel
def _sample(x, y, uniforms, index, origin, resolution, radius, loc_x, loc_y, p, starts, components, terms):
    """Algorithm 2 of the paper, for every particle."""
    n = len(x)
    speed, heading = np.zeros(n), np.zeros(n)
    log_fitness, found = np.zeros(n), np.zeros(n, np.bool_)
    for i in range(n):
        # Lines 1 and 2: the locations within r_s, and of them the one with the largest motion intensity.
        row = _locate(x[i], y[i], index, origin, resolution, radius, loc_x, loc_y, p)
        if row < 0:
            continue
        found[i] = True
        # Line 3: a component by its weight, then a velocity of it and its density in the mixture.
        j, rest = starts[row], uniforms[i, 0]
        while j < starts[row + 1] - 1 and rest > components[j, 0]:
            rest -= components[j, 0]
            j += 1
        mt, mr, vtt = components[j, 1], components[j, 2], components[j, 3]
        vtr, vrr = components[j, 4], components[j, 5]
        # Box-Muller, then the Cholesky factor of the component's covariance.
        r = np.sqrt(-2.0 * np.log(uniforms[i, 1]))
        z, w = r * np.cos(TWO_PI * uniforms[i, 2]), r * np.sin(TWO_PI * uniforms[i, 2])
        sd = np.sqrt(vtt)
        theta = mt + sd * z
        rho = mr + vtr / sd * z + np.sqrt(max(vrr - vtr * vtr / vtt, 0.0)) * w
        heading[i] = wrapped(theta)
        speed[i] = max(rho, 0.0)
        log_fitness[i] = swgmm.log_density_one(heading[i], speed[i], terms, starts[row], starts[row + 1])
    return speed, heading, log_fitness, found
