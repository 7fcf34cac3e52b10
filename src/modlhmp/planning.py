"""A robot's view of a map: what a path costs against the flow of people, and how long it is likely to take.

Costs are those that published planners sum over their paths, here integrated over the length [m], so that they do not
depend on how finely a path is cut:

* upstream, how much the path goes against people: sum_j w_j (1 - cos(mu_j - alpha)) of the components' mean headings
  mu_j and the path's direction alpha, from 0 (all walk along) to 2 (all come towards it), times the motion intensity p
  (C. Swaminathan et al., Benchmarking the utility of maps of dynamics for human-aware motion planning, Front. Robot. AI
  9:916153, 2022; after the upstream criterion of I. Ko, B. Kim, F. Park, Randomized path planning on vector fields,
  IJRR 33(13), 2014, which L. Palmieri et al. extended to CLiFF-maps, ICRA 2017);
* Down-the-CLiFF, how unlike the robot moves: sum_j w_j min(d_j, 10) times p, with d_j the Mahalanobis distance of the
  robot's (direction, speed) from component j, whose difference of headings is wrapped here (C. Swaminathan et al.,
  Down the CLiFF: flow-aware trajectory planning under motion pattern uncertainty, IROS 2018).

Time is that of the way plus so many seconds for every person met, as a public tour planner on CLiFF-maps has it
(S. Bernagozzi et al., Congestion-aware robot tour planning in crowded environments, arXiv 2606.19031, 2026: 10 s for
each person on an edge). How many are met follows from relative motion: of people who walk with velocity u at a density
d [1/m2], a robot of velocity v and width w meets d w |v - u| a second: few who walk along, many who come towards it.
"""

import dataclasses
import logging
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.angles import TWO_PI, wrap_angle
from modlhmp.api import Map
from modlhmp.arguments import A_MAP, numbers, unix_time
from modlhmp.maps import stef
from modlhmp.maps.comparison import check_flows, direction_shares
from modlhmp.settings import unknown
from modlhmp.storage import DataError, column
from modlhmp.tracks import clock_hours

FARTHEST = 10.0  # Mahalanobis distance; what is farther counts as much
PIECE_M = 0.25  # a path is cut into pieces of at most this length
DIRECTIONS = 36  # of people whom a robot meets
MOST_PIECES = 1_000_000
COSTS = ("upstream", "down_the_cliff", "people")
HALF = 0.5  # of a path: a map that knows less of it is told
_LOG = logging.getLogger("modlhmp")


@dataclass(frozen=True)
class PathCost:
    """What a path costs, piece by piece: arrays [n] of its pieces, and totals.

    `upstream`, `down_the_cliff` (NaN for maps without speeds) and `people` (met, NaN where the map has no speeds
    or does not say how many there are) are per metre at `x`, `y`; where a piece is not `mapped`, the map knows nobody
    and they are 0.
    """

    x: np.ndarray
    y: np.ndarray
    direction: np.ndarray
    length: np.ndarray
    mapped: np.ndarray
    upstream: np.ndarray
    down_the_cliff: np.ndarray
    people: np.ndarray
    speed_m_s: float
    delay_s: float
    shown: Any = dataclasses.field(repr=False)  # (kind, table) of the map

    def total(self, name: str) -> float:
        """The integral of `upstream`, `down_the_cliff` or `people` over the path."""
        if name not in COSTS:
            raise DataError(unknown("PathCost.total", "cost", name, COSTS))
        return float((getattr(self, name) * self.length).sum())

    @property
    def length_m(self) -> float:
        """Length of the path."""
        return float(self.length.sum())

    @property
    def mapped_share(self) -> float:
        """The share of the path where the map has dynamics."""
        return float(self.length[self.mapped].sum() / self.length.sum())

    @property
    def free_s(self) -> float:
        """Time to cross with nobody there [s]."""
        return self.length_m / self.speed_m_s

    @property
    def time_s(self) -> float:
        """Expected time to cross [s]; NaN where the map has no speeds, or does not say how many people there are."""
        return self.free_s + self.delay_s * self.total("people")

    def draw(self, path: str | Path, floor_plan: str | Path | None = None) -> None:
        """A picture of the path over the map, coloured by its upstream cost per metre; `DataError` as in `pictures`."""
        from modlhmp.pictures import draw_path  # noqa: PLC0415 - matplotlib

        told = f"{self.length_m:.1f} m, upstream cost {self.total('upstream'):.2f} m"
        if np.isfinite(self.time_s):
            told += f", {self.total('people'):.1f} people met, {self.time_s:.0f} s ({self.free_s:.0f} s alone)"
        kind, table = self.shown
        draw_path(self, kind, table, path, told, floor_plan)


def path_cost(
    a_map: Map,
    path: Any,
    speed_m_s: float = 1.0,
    t: float | None = None,
    *,
    people: float | None = None,
    delay_s: float = 10.0,
    width_m: float = 1.0,
) -> PathCost:
    """The cost of a path against the flow that a CLiFF- or STeF-map, or one of their forms, has learned.

        there = modlhmp.path_cost(a_map, [(0, 0), (12, 3)], speed_m_s=0.8)
        print(there.total("upstream"), there.time_s)
        there.draw("there.png")

    `path` is [n, 2] of x, y in m, joined by straight lines; `speed_m_s` the robot's. `t` [unix s] chooses the map of a
    kind by hours. `people` is how many walk within the radius of the busiest location on average, which maps that were
    built here know; each that comes within `width_m` of the robot's middle line costs `delay_s`. A STeF-map has no
    speeds, so that nobody knows how many are met: it has no time, and takes no `people`.
    """
    xy = numbers("path", path)
    if xy.ndim != 2 or xy.shape[1] != 2 or len(xy) < 2 or not np.isfinite(xy).all():
        raise DataError(f"path of shape {xy.shape}: give [n, 2] of x, y in m, two points or more, all finite")
    for name, value in (("speed_m_s", speed_m_s), ("width_m", width_m)):
        if not (isinstance(value, Real) and 0 < value < 100):
            raise DataError(f"path_cost: {name} {value!r}: give a number above 0 and below 100")
    for name, value in (("people", 0 if people is None else people), ("delay_s", delay_s)):
        if not (isinstance(value, Real) and 0 <= value < np.inf):
            raise DataError(f"path_cost: {name} {value!r}: give a number of at least 0")
    x, y, direction, length = _pieces(xy)
    kind, table = _table_at(a_map, t)
    places = _Places(table, kind)
    at = places.nearest(x, y)
    mapped = at >= 0
    costs = np.zeros((3, len(x)))
    no_time = f"a map of kind {kind} has no speeds, so no time"
    if not places.has_speeds:
        costs[1] = np.nan
        if people is not None:
            raise DataError(f"path_cost: people {people!r}: {no_time}; leave it out")
    crowd = places.people if people is None else people
    for piece in np.flatnonzero(mapped):
        found = places.costs(int(at[piece]), float(direction[piece]), speed_m_s)
        costs[:, piece] = found
    costs[2] *= crowd * width_m / (np.pi * places.radius**2) / speed_m_s
    upstream, down, met = costs
    cost = PathCost(x, y, direction, length, mapped, upstream, down, met, speed_m_s, delay_s, (kind, table))
    if cost.mapped_share < HALF:
        _LOG.warning(
            "path_cost: the map knows %.0f %% of the path; where it knows nobody, costs are 0: see `mapped`",
            100 * cost.mapped_share,
        )
    if not places.has_speeds:
        _LOG.warning("path_cost: %s", no_time)
    elif np.isnan(crowd):
        _LOG.warning("path_cost: the map does not say how many people there are, so no time: give `people`")
    return cost


def _pieces(xy: np.ndarray) -> tuple[np.ndarray, ...]:
    """Middle, direction [rad] and length [m] of pieces of at most `PIECE_M`; points that repeat are left out."""
    steps = np.diff(xy, axis=0)
    lengths = np.hypot(*steps.T)
    if not lengths.any():
        raise DataError("path: all points are the same; give a path that goes somewhere")
    counts = np.ceil(lengths / PIECE_M).astype(int)
    if counts.sum() > MOST_PIECES:
        raise DataError(f"path: {lengths.sum():.4g} m long: are x and y in m?")
    which = np.repeat(np.arange(len(steps)), counts)
    part = (np.concatenate([np.arange(n) for n in counts]) + 0.5) / counts[which]
    x, y = (xy[which] + part[:, None] * steps[which]).T
    return x, y, np.arctan2(steps[which, 1], steps[which, 0]), lengths[which] / counts[which]


def _table_at(a_map: Map, t: float | None) -> tuple[str, pa.Table]:
    """Kind and table of the map that serves the time `t`."""
    if not isinstance(a_map, Map):
        raise DataError(f"path_cost: {type(a_map).__name__}: give {A_MAP}")
    check_flows("path_cost", a_map.kind)
    if not a_map.hours:
        table = a_map.whole
        assert table is not None
        return a_map.kind, stef.mean_probabilities(table) if a_map.kind == "stef" else table
    if t is None:
        raise DataError(f"path_cost: a map of kind {a_map.kind} is by hours: give the time `t` in unix s")
    hour = int(clock_hours(np.array([unix_time("path_cost: t", t)]), a_map.site.timezone)[0])
    if hour not in a_map.hours:
        raise DataError(f"path_cost: t {t}: it is in hour {hour}, of which there is no map; there are {[*a_map.hours]}")
    return a_map.kind, a_map.hours[hour]


class _Places:
    """Locations or cells of a map, and what going through one costs."""

    def __init__(self, table: pa.Table, kind: str) -> None:
        metadata = table.schema.metadata
        self.step = float(metadata[b"resolution"])
        self.radius = float(metadata.get(b"radius", metadata[b"resolution"]))
        self.people = float(metadata.get(b"busiest", b"nan"))
        self.has_speeds = kind != "stef"
        if not table.num_rows:
            raise DataError("path_cost: the map is empty")
        if kind == "stef":
            shares = column(table, "probabilities").reshape(table.num_rows, -1)
            self.xy = np.column_stack([column(table, name) for name in ("x", "y")])[shares.any(axis=1)]
            self.shares = shares[shares.any(axis=1)]
            self.headings = np.arange(shares.shape[1]) * TWO_PI / shares.shape[1]
            return
        names = ("weight", "mean_heading", "mean_speed", "var_heading", "cov_heading_speed", "var_speed", "x", "y", "p")
        self.of = {name: column(table, name).astype(float) for name in names}
        first = np.flatnonzero(np.diff(column(table, "location"), prepend=-1))
        self.ends = np.append(first, table.num_rows)
        self.xy = np.column_stack([self.of["x"], self.of["y"]])[first]
        self.towards = direction_shares(self.of["mean_heading"], self.of["var_heading"], DIRECTIONS)

    def nearest(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The place [n] in whose cell a position is, -1 where there is none."""
        from scipy.spatial import cKDTree  # noqa: PLC0415 - 25 MB and 0.15 s that nothing else here needs

        reach = self.step * np.sqrt(0.5) * (1 + 1e-9)
        apart, at = cKDTree(self.xy).query(np.column_stack([x, y]), distance_upper_bound=reach)
        return np.where(np.isfinite(apart), at, -1)

    def costs(self, place: int, direction: float, speed: float) -> tuple[float, float, float]:
        """Upstream and Down-the-CLiFF cost per metre, and p times the mean relative speed of people [m/s]."""
        if not self.has_speeds:
            against = 1 - np.cos(self.headings - direction)
            return float(self.shares[place] @ against), np.nan, np.nan
        rows = slice(self.ends[place], self.ends[place + 1])
        part = {name: values[rows] for name, values in self.of.items()}
        weight, p = part["weight"] / part["weight"].sum(), part["p"][0]
        turn, faster = wrap_angle(direction - part["mean_heading"]), speed - part["mean_speed"]
        vtt, vtr, vrr = part["var_heading"], part["cov_heading_speed"], part["var_speed"]
        squared = (vrr * turn**2 - 2 * vtr * turn * faster + vtt * faster**2) / (vtt * vrr - vtr**2)
        towards = np.arange(DIRECTIONS) * TWO_PI / DIRECTIONS - direction
        walked = np.maximum(part["mean_speed"], 0)[:, None]
        relative = np.sqrt(speed**2 + walked**2 - 2 * speed * walked * np.cos(towards))
        return (
            float(p * weight @ (1 - np.cos(turn))),
            float(p * weight @ np.minimum(np.sqrt(squared), FARTHEST)),
            float(p * weight @ (self.towards[rows] * relative).sum(axis=1)),
        )
