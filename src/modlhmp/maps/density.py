"""What a map says of the velocity of somebody who walks at a place and a time: a probability density, where it has one.

A `Density` answers three questions, for arrays x, y [m], t [unix s], heading [rad] and speed [m/s], all of shape [n]:

    log_density(x, y, t, heading, speed) -> [n]   nats, per rad and m/s
    log_heading(x, y, t, heading) -> [n]          nats, per rad: the same with the speed left open
    covered(x, y, t) -> bool [n]                  whether the map says anything there and then

The first two are NaN where the map does not cover, and -inf where it holds the velocity for impossible. Every density
integrates to 1 over headings of one turn and speeds of 0 and more. It is of people who walk: a row without a heading,
or with a speed of exactly 0, is no row of a map either.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import numpy as np
import pyarrow as pa

from modlhmp.angles import TWO_PI, unwrapped
from modlhmp.kernels import kernel
from modlhmp.maps import cliff, stef, swgmm
from modlhmp.maps.base import hour_files, read_map
from modlhmp.site import Site
from modlhmp.storage import DataError, column, read_parquet
from modlhmp.tracks import clock_hours

REACH_M = 1.0  # the nearest location counts, no farther than this (or half a cell's diagonal, if that is more)
TAIL_SD = 6.0  # a component's windings go so many standard deviations out
MOST_WINDINGS = 50  # by far enough for an even distribution; a foreign map's variance may be anything
SPEED_BIN_M_S, SPEED_BINS = 0.05, 60  # of the speed histogram; one more bin is for all faster ones

Source = str | Path | pa.Table


class Density(Protocol):
    """A density of velocities by place and time, as described above."""

    def log_density(
        self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> np.ndarray:
        """Log density of velocities [n], per rad and m/s."""

    def log_heading(self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """Log density of headings [n], per rad."""

    def covered(self, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Whether the map says anything at places and times [n]."""


def load(
    kind: str,
    source: Source | Mapping[int, Source],
    site: Site,
    no_map: "NoMap | None" = None,
    reach_m: float = REACH_M,
) -> Density:
    """The density of a map: `source` is its file or table, or its folder of hours or {clock hour: file or table}.

    The table's columns decide: a CLiFF-map's (whoever made it; a column `background` is the weight of `no_map` at the
    location), a STeF-map's, of the whole day or of an hour. `no_map` gives a STeF-map its speeds: without it only
    headings have a density. A map by hours has none in an hour without map; `site` has its clock. `DataError` for a
    map that holds no velocities of places.
    """
    if isinstance(source, (str, Path)) and Path(source).is_dir():
        source = hour_files(source)
        if not source:
            raise DataError(f"map {kind}: its folder has no hour's map, such as 09.parquet")
    if isinstance(source, Mapping):
        return ByHour({hour: _of(kind, one, no_map, reach_m) for hour, one in source.items()}, site.timezone)
    return _of(kind, source, no_map, reach_m)


def _of(kind, source, no_map, reach_m):
    """The density of one table."""
    table = source if isinstance(source, pa.Table) else read_parquet(source)
    names = set(table.column_names)
    if set(cliff.NEEDED) <= names:
        return Mixtures(read_map(source, "a CLiFF-map", cliff.NEEDED, ("resolution",)), no_map, reach_m)
    keys = ("resolution", "orientations")
    if "probabilities" in names:
        read_map(source, "an evaluated STeF-map", ("x", "y", "probabilities"), keys)
        return Directions(table, no_map, reach_m)
    if {"orientation", "mean"} <= names:
        read_map(source, "a STeF-map", ("x", "y", "orientation", "mean"), keys)
        return Directions(stef.mean_probabilities(table), no_map, reach_m)
    raise DataError(
        f"map {kind}: it has no density of velocities by place and time; those that have one are CLiFF- and STeF-maps, "
        f"and its columns are {', '.join(table.column_names)}"
    )


class NoMap:
    """What is known without a map: how fast people walk, by a histogram with one added to each bin; any heading.

    Bins are 0.05 m/s wide up to 3 m/s; those who are faster share one more, in which the density falls as 1 / speed^2.
    """

    def __init__(self, speed: np.ndarray) -> None:
        """`speed` [n] in m/s are those of the training data; 0 and NaN do not count."""
        speed = np.asarray(speed, float)
        speed = speed[np.isfinite(speed) & (speed > 0)]
        counts = 1.0 + np.bincount(_speed_bin(speed), minlength=SPEED_BINS + 1)
        self.log_p = np.log(counts / counts.sum())

    def log_speed(self, speed: np.ndarray) -> np.ndarray:
        """Log density [n] of speeds, per m/s."""
        top = SPEED_BINS * SPEED_BIN_M_S
        width = np.where(speed < top, np.log(SPEED_BIN_M_S), 2 * np.log(np.maximum(speed, top)) - np.log(top))
        return self.log_p[_speed_bin(speed)] - width

    def log_density(
        self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> np.ndarray:
        """See `Density`."""
        return self.log_speed(np.asarray(speed, float)) - np.log(TWO_PI)

    def log_heading(self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """See `Density`."""
        return np.full(len(x), -np.log(TWO_PI))

    def covered(self, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> np.ndarray:
        """See `Density`."""
        return np.ones(len(x), bool)


def _speed_bin(speed):
    """Bin of speeds [m/s] in `NoMap`; a rounding error does not count."""
    return np.minimum(speed / SPEED_BIN_M_S + 1e-9, SPEED_BINS).astype(np.int64)


class ByHour:
    """Densities of clock hours: each row is asked of that of its own hour; no hour, not covered."""

    def __init__(self, by_hour: Mapping[int, Density], timezone: str) -> None:
        self.by_hour, self.timezone = dict(by_hour), timezone

    def log_density(
        self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> np.ndarray:
        """See `Density`."""
        return self._each(np.nan, "log_density", x, y, t, heading, speed)

    def log_heading(self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """See `Density`."""
        return self._each(np.nan, "log_heading", x, y, t, heading)

    def covered(self, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> np.ndarray:
        """See `Density`."""
        return self._each(0.0, "covered", x, y, t).astype(bool)

    def _each(self, otherwise, question, x, y, t, *rest):
        hours, answer = clock_hours(t, self.timezone), np.full(len(x), otherwise)
        for hour, density in self.by_hour.items():
            rows = np.flatnonzero(hours == hour)
            if len(rows):
                answer[rows] = getattr(density, question)(*(np.asarray(part)[rows] for part in (x, y, t, *rest)))
        return answer


class Places:
    """Where a map says something: the nearest of its places within reach."""

    def __init__(self, x: np.ndarray, y: np.ndarray, reach_m: float) -> None:
        from scipy.spatial import cKDTree  # noqa: PLC0415 - 25 MB and 0.15 s that other uses of maps do not need

        self.tree, self.reach_m = cKDTree(np.column_stack([x, y])), reach_m

    def nearest(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Number [n] of the nearest place, -1 where none is in reach."""
        if not self.tree.n:
            return np.full(len(x), -1)
        # The bound itself is in reach, as for a map's builder.
        _, found = self.tree.query(np.column_stack([x, y]), distance_upper_bound=self.reach_m * (1 + 1e-9))
        return np.where(found < self.tree.n, found, -1)


def _reach(table, reach_m):
    """A place answers at least for its own cell."""
    return max(reach_m, float(table.schema.metadata[b"resolution"]) * np.sqrt(0.5))


class Directions:
    """Density of an evaluated STeF-map: even within each orientation's sector, at the speeds of `no_map`."""

    def __init__(self, table: pa.Table, no_map: NoMap | None = None, reach_m: float = REACH_M) -> None:
        probabilities = column(table, "probabilities").reshape(table.num_rows, -1)
        alive = probabilities.sum(axis=1) > 0
        self.no_map, self.orientations = no_map, probabilities.shape[1]
        self.places = Places(column(table, "x")[alive], column(table, "y")[alive], _reach(table, reach_m))
        with np.errstate(divide="ignore"):
            self.log_p = np.log(probabilities[alive]) - np.log(TWO_PI / self.orientations)

    def log_density(
        self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> np.ndarray:
        """See `Density`; `DataError` for a map that was loaded without speeds."""
        if self.no_map is None:
            raise DataError("a STeF-map knows no speeds: load its density with `no_map`, or ask for headings only")
        return self.log_heading(x, y, t, heading) + self.no_map.log_speed(np.asarray(speed, float))

    def log_heading(self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """See `Density`."""
        row = self.places.nearest(x, y)
        found, answer = row >= 0, np.full(len(x), np.nan)
        bins = stef.orientation_bin(np.asarray(heading)[found], self.orientations)
        answer[found] = self.log_p[row[found], bins]
        return answer

    def covered(self, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> np.ndarray:
        """See `Density`."""
        return self.places.nearest(x, y) >= 0


class Mixtures:
    """Density of a map in the form of a CLiFF-map: the mixture of the nearest location, of speeds of 0 and more.

    A semi-wrapped mixture has some of its mass at speeds below 0, which nobody walks: the rest is divided by its sum.
    As many windings are summed as a component's variance needs.
    """

    def __init__(self, table: pa.Table, no_map: NoMap | None = None, reach_m: float = REACH_M) -> None:
        location = column(table, "location")
        first = np.flatnonzero(np.diff(location, prepend=-1)) if len(location) else np.empty(0, np.int64)
        self.starts = np.append(first, len(location))
        self.places = Places(column(table, "x")[first], column(table, "y")[first], _reach(table, reach_m))
        components = np.column_stack([column(table, name).astype(float) for name in cliff.COLUMNS[3:9]])
        swgmm.floor_covariances(components)
        sd = np.sqrt(components[:, 3])
        self.windings = np.clip(np.ceil((TAIL_SD * sd / np.pi - 1) / 2), 1, MOST_WINDINGS).astype(np.int64)
        below = _below_0(components[:, 2], np.sqrt(components[:, 5]))
        if len(first):
            mass = np.add.reduceat(components[:, 0] * (1 - below), first)
            components[:, 0] /= np.repeat(mass, np.diff(self.starts))
        self.terms = swgmm.precompute(components)
        slope = components[:, 4] / components[:, 3]  # of the mean speed over the heading
        rest = np.sqrt(np.maximum(components[:, 5] - slope * components[:, 4], 1e-12))
        self.marginals = np.column_stack(
            [np.log(components[:, 0]) - 0.5 * np.log(TWO_PI * components[:, 3]), *components[:, 1:4].T, slope, rest]
        )
        self.no_map = no_map
        self.background = column(table, "background")[first] if "background" in table.column_names else None
        if self.background is not None and no_map is None:
            raise DataError("the map has a background of what is known without a map: load its density with `no_map`")

    def log_density(
        self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray, speed: np.ndarray
    ) -> np.ndarray:
        """See `Density`."""
        row, out = self.places.nearest(x, y), np.full(len(x), np.nan)
        heading, speed = (np.asarray(part, float) for part in (heading, speed))
        _log_joint(row, heading, speed, self.starts, self.terms, self.windings, out)
        return (
            out if self.background is None else self._with_background(row, out, "log_density", x, y, t, heading, speed)
        )

    def log_heading(self, x: np.ndarray, y: np.ndarray, t: np.ndarray, heading: np.ndarray) -> np.ndarray:
        """See `Density`."""
        row, out = self.places.nearest(x, y), np.full(len(x), np.nan)
        heading = np.asarray(heading, float)
        _log_marginal(row, heading, self.starts, self.marginals, self.windings, out)
        return out if self.background is None else self._with_background(row, out, "log_heading", x, y, t, heading)

    def covered(self, x: np.ndarray, y: np.ndarray, t: np.ndarray) -> np.ndarray:
        """See `Density`."""
        return self.places.nearest(x, y) >= 0

    def _with_background(self, row, log_p, question, *where):
        share = np.where(row >= 0, self.background[row], np.nan)
        with np.errstate(divide="ignore"):  # a share of exactly 0 or 1
            return np.logaddexp(np.log1p(-share) + log_p, np.log(share) + getattr(self.no_map, question)(*where))


def _below_0(mean, sd):
    """Probability [n] of normal distributions below 0."""
    from scipy.special import ndtr  # noqa: PLC0415 - likewise

    return ndtr(-mean / sd)


@kernel
def _log_joint(row, heading, speed, starts, terms, windings, out):
    """Log density of each velocity under the components of its location; rows of no location stay as they are."""
    for i in range(len(row)):
        if row[i] < 0:
            continue
        peak, total = -np.inf, 0.0
        for j in range(starts[row[i]], starts[row[i] + 1]):
            dr = speed[i] - terms[j, 2]
            for k in range(-windings[j], windings[j] + 1):
                dt = unwrapped(heading[i] - terms[j, 1], k)
                quadratic = terms[j, 3] * dt * dt + 2.0 * terms[j, 4] * dt * dr + terms[j, 5] * dr * dr
                peak, total = _plus(peak, total, terms[j, 0] - 0.5 * quadratic)
        out[i] = peak + np.log(total)


@kernel
def _log_marginal(row, heading, starts, marginals, windings, out):
    """The same of headings: a component's density there, times its chance of a speed above 0 given the heading."""
    for i in range(len(row)):
        if row[i] < 0:
            continue
        peak, total = -np.inf, 0.0
        for j in range(starts[row[i]], starts[row[i] + 1]):
            for k in range(-windings[j], windings[j] + 1):
                dt = unwrapped(heading[i] - marginals[j, 1], k)
                speed = marginals[j, 2] + marginals[j, 4] * dt
                above = 0.5 * math.erfc(-speed / marginals[j, 5] / np.sqrt(2.0))
                if above > 0.0:
                    exponent = marginals[j, 0] - 0.5 * dt * dt / marginals[j, 3] + np.log(above)
                    peak, total = _plus(peak, total, exponent)
        out[i] = peak + np.log(total)


@kernel(inline="always")
def _plus(peak, total, exponent):
    """A sum total * exp(peak) plus exp(exponent), in the same form."""
    if exponent > peak:
        return exponent, total * np.exp(peak - exponent) + 1.0
    return peak, total + np.exp(exponent - peak)
