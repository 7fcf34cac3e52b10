"""Occupancy measured: how often cells were occupied that had been given some probability, at moments of whole days.

Everyone of a recording's days is forecast at moments every so many seconds, in half-hours dealt into folds, with maps
of people who were not recorded within ten minutes of them (`splits.in_part`). What came true is where these same people
were then; who came later does not count. Cells are those in which anybody was ever seen.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from modlhmp.forecasting.base import Forecaster
from modlhmp.forecasting.observe import Observed
from modlhmp.forecasting.occupancy import occupancy
from modlhmp.kinds import find
from modlhmp.logs import progress
from modlhmp.maps.base import lattice_box
from modlhmp.methods import Method, build_map, forecaster_of, model_of
from modlhmp.site import Site
from modlhmp.splits import BLOCK_S, FOLDS, in_part
from modlhmp.streams import stream_keys
from modlhmp.time_step import HERE, ending_at
from modlhmp.tracks import LATE_STEPS, Tracks, gap_limit, positions_at, runs

CELL_M = 1.0
BINS = 10
FILM = (1 / 6, 1 / 3, 2 / 3)  # of the horizon
ENOUGH, CLOSE = 200, 0.05  # cells of a bin that is judged, and how near to its probability is near enough
KEYS = ["step", "bin", "block", "cell"]


class Crowd(NamedTuple):
    """Who is there at a moment: what is observed of them, and where they are at M later ones [n, M, 2] (NaN: gone)."""

    t0: float
    observed: Observed
    truth: np.ndarray


class Grid(NamedTuple):
    """Cells of `CELL_M` from `low` [2] on, of which somebody was ever in `seen` [rows, columns]."""

    low: np.ndarray
    seen: np.ndarray

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(x low, x high, y low, y high) in m."""
        (x, y), (rows, columns) = (self.low * CELL_M).tolist(), self.seen.shape
        return x, x + columns * CELL_M, y, y + rows * CELL_M

    def occupied(self, xy: np.ndarray) -> np.ndarray:
        """Whether anybody is in each cell [rows, columns], of positions [n, 2]."""
        i, j = self.cell_of(xy[np.isfinite(xy).all(axis=1)]).T
        found = np.zeros(self.seen.shape, bool)
        found[j, i] = True
        return found

    def cell_of(self, xy: np.ndarray) -> np.ndarray:
        """Column and row [n, 2] of positions."""
        return np.floor(xy / CELL_M).astype(np.int64) - self.low


def grid_of(tracks: Tracks) -> Grid:
    """The cells of all rows."""
    cells = np.floor(np.column_stack([tracks.x, tracks.y]) / CELL_M).astype(np.int64)
    low, (columns, rows) = lattice_box(cells)
    grid = Grid(low, np.zeros((rows, columns), bool))
    return grid._replace(seen=grid.occupied(np.column_stack([tracks.x, tracks.y])))


def steps_of(site: Site, horizons_s: Sequence[float]) -> np.ndarray:
    """The time steps at which occupancy is measured: the first, the horizons', and those of the film."""
    return np.unique([1, *film_steps(site.steps), *(round(one / site.time_step_s) for one in horizons_s)])


def film_steps(steps: int) -> list[int]:
    """The time steps that the film shows, of a horizon of so many."""
    return [max(round(share * steps), 1) for share in FILM]


def crowds(tracks: Tracks, site: Site, every_s: float, fold: int, steps: np.ndarray) -> Iterator[Crowd]:
    """Everyone who is there, at multiples of `every_s` in the half-hours of a fold."""
    bounds = tracks.bounds()
    rows = np.column_stack([bounds[:-1], bounds[1:] - 1])
    begin, end = tracks.t[rows[:, 0]], tracks.t[rows[:, 1]]
    moments = np.arange(np.ceil(begin.min() / every_s), np.floor(end.max() / every_s) + 1) * every_s
    gap_s, late_s = gap_limit(site.time_step_s), LATE_STEPS * site.time_step_s
    for t0 in moments[(moments // BLOCK_S) % FOLDS == fold - 1].tolist():
        near = np.flatnonzero((begin <= t0) & (end >= t0 - gap_s))
        some = tracks.take(runs(rows[near, 0], rows[near, 1] - rows[near, 0] + 1))
        seen, state = ending_at(some, t0, site.time_step_s, site.observed_rows)
        here = near[state == HERE]
        if not len(here):
            continue
        parts = (part.reshape(len(here), -1) for part in seen[1:])
        nobody = np.empty((len(here), 0, site.observed_rows, 2))
        after = t0 + steps * site.time_step_s
        truth = positions_at(tracks, rows[here], after - begin[here, None])
        truth[after > end[here, None] + late_s] = np.nan
        observed = Observed(seen.track_id[:: site.observed_rows], *parts, nobody)  # type: ignore[call-arg]
        yield Crowd(t0, observed, truth)


def measure(
    tracks: Tracks,
    site: Site,
    methods: Sequence[Method],
    buildings: Mapping[str, Any],
    every_s: float,
    horizons_s: Sequence[float],
    names: tuple[object, object],
    person: np.ndarray | None = None,
) -> dict[str, pd.DataFrame]:
    """Tables {`bins`, `scores`, `film`} of methods on everyone's tracks; `buildings` are the maps' options by kind.

    `bins`: per method, horizon, bin of ten, half-hour and cell, of the cells that a sample reached: how many (`n`), the
    sum of `p`, and how many were `occupied`. `scores`: per method and horizon the moments, the people, the cells, the
    sum of `p`, how many were `occupied` and how many of these no sample reached (`unforeseen`), and Brier scores: the
    method's, that of the share of the other folds' moments at which a cell was occupied (`brier_cells`), and that of
    one share for all cells (`brier_flat`). `film`: the moment at which most people were there, by the first method:
    cells with their `p`, and where everybody was. Velocities are those of positions, as in a stream. `names` = (seed,
    dataset) key the random numbers, `person` [rows] says whose each row is (default: each track is a person).
    """
    person = tracks.track_id if person is None else person
    site, grid, steps = replace(site, velocity="differences"), grid_of(tracks), steps_of(site, horizons_s)
    came_true, moments = np.zeros((FOLDS, len(steps), *grid.seen.shape)), np.zeros(FOLDS, np.int64)
    found: dict[str, _Found] = {method.name: _Found(grid, len(steps)) for method in methods}
    film: tuple[Crowd, np.ndarray] | None = None
    times_s, counts = site.time_step_s * np.arange(1, site.steps + 1), np.diff(tracks.bounds())
    for fold in progress(range(FOLDS), desc="folds"):
        others = np.repeat(in_part(tracks, f"without-{fold + 1}", person[tracks.bounds()[:-1]]), counts)
        training = tracks.take(others)
        asked = {one.name: forecaster_on(training, site, one, buildings, person[others]) for one in methods}
        for crowd in crowds(tracks, site, every_s, fold + 1, steps):
            came = np.stack([grid.occupied(crowd.truth[:, step]) for step in range(len(steps))])
            came_true[fold] += came
            moments[fold] += 1
            for method in methods:
                keys = stream_keys(crowd.observed.track_id, method.futures, *names, method.name, "occupancy")
                futures = asked[method.name](crowd.observed, site.steps, keys)
                p = occupancy(futures, times_s, crowd.t0, grid.extent, CELL_M).probabilities[steps - 1]
                found[method.name].add(crowd, p, came)
                if method is methods[0] and (film is None or len(crowd.truth) > len(film[0].truth)):
                    film = crowd, p
    at_s = steps * site.time_step_s
    scores = [one.scores(_skill_free(came_true, moments, grid)) for one in found.values()]
    tables = {
        "bins": pd.concat([one.bins() for one in found.values()], keys=found, names=["method"]),
        "scores": pd.concat(scores, keys=found, names=["method"]),
    }
    tables = {name: table.reset_index("method").reset_index(drop=True) for name, table in tables.items()}
    for table in tables.values():
        table.insert(1, "horizon_s", at_s[table.pop("step")])
    return {**tables, "film": _film(grid, at_s, film)}


def forecaster_on(
    tracks: Tracks, site: Site, method: Method, buildings: Mapping[str, Any], person: np.ndarray
) -> Forecaster:
    """A method's forecaster with a map of these tracks, and with their ways out if it uses these."""
    kind, exits = find(method.kind), None
    if kind.sampled and method.options.exits:
        exits, _ = build_map("exits", tracks, site, buildings["exits"])
    tables = build_map(kind.name, tracks, site, buildings[kind.name], person)
    return forecaster_of(kind, model_of(kind.name, *tables, site, method.options), site, method.options, exits)


class _Found:
    """What came of one method's probabilities, summed."""

    def __init__(self, grid: Grid, steps: int) -> None:
        self.grid, self.moments, self.people = grid, 0, 0
        self.sums = {name: np.zeros(steps) for name in ("p", "occupied", "unforeseen", "brier")}
        self.waiting: list[pd.DataFrame] = []
        self.grouped: list[pd.DataFrame] = []
        self.block = -1

    def add(self, crowd: Crowd, p: np.ndarray, came: np.ndarray) -> None:
        """Take the probabilities and what was occupied, [M, rows, columns], of a moment."""
        block, seen = int(crowd.t0 // BLOCK_S), self.grid.seen
        self.moments, self.people = self.moments + 1, self.people + len(crowd.truth)
        self.sums["p"] += p[:, seen].sum(axis=1)
        self.sums["occupied"] += came[:, seen].sum(axis=1)
        self.sums["unforeseen"] += (came & (p == 0)).sum(axis=(1, 2))
        self.sums["brier"] += ((p - came)[:, seen] ** 2).sum(axis=1)
        step, row, column = np.nonzero((p > 0) & seen)
        chances = p[step, row, column].astype(float)
        if block != self.block:
            self._group()
            self.block = block
        self.waiting.append(pd.DataFrame({
            "step": step, "bin": np.minimum((chances * BINS + 1e-6).astype(int), BINS - 1), "block": block,
            "cell": row * seen.shape[1] + column, "n": 1, "p": chances, "occupied": came[step, row, column].astype(int),
        }))  # fmt: skip

    def _group(self) -> None:
        """Sum what has come of a half-hour, so that memory does not follow the recording."""
        if self.waiting:
            self.grouped.append(pd.concat(self.waiting).groupby(KEYS, as_index=False).sum())
            self.waiting = []

    def bins(self) -> pd.DataFrame:
        """See `measure`."""
        self._group()
        empty = pd.DataFrame(columns=[*KEYS, "n", "p", "occupied"], dtype=float).astype(dict.fromkeys(KEYS, int))
        return pd.concat(self.grouped, ignore_index=True) if self.grouped else empty

    def scores(self, skill_free: Mapping[str, np.ndarray]) -> pd.DataFrame:
        """See `measure`."""
        cells = self.moments * int(self.grid.seen.sum())
        brier = {"brier": self.sums["brier"], **skill_free}
        return pd.DataFrame({
            "step": np.arange(len(self.sums["p"])), "moments": self.moments, "people": self.people, "cells": cells,
            **{name: self.sums[name] for name in ("p", "occupied", "unforeseen")},
            **{name: total / max(cells, 1) for name, total in brier.items()},
        })  # fmt: skip


def _skill_free(came_true: np.ndarray, moments: np.ndarray, grid: Grid) -> dict[str, np.ndarray]:
    """Sums [M] of squared errors of shares that know no people; `came_true` [folds, M, rows, columns] are counts."""
    counts = came_true[:, :, grid.seen]
    others = counts.sum(axis=0) - counts
    share = others / np.maximum(moments.sum() - moments, 1)[:, None, None]
    found = {}
    for name, p in (("brier_cells", share), ("brier_flat", share.mean(axis=2, keepdims=True))):
        # A cell occupied c times of m has m p^2 - 2 c p + c.
        found[name] = (moments[:, None, None] * p**2 - 2 * counts * p + counts).sum(axis=(0, 2))
    return found


def _film(grid: Grid, at_s: np.ndarray, film: tuple[Crowd, np.ndarray] | None) -> pd.DataFrame:
    """Rows `what` (`cell`: its centre and p; `person`: where they are, `at_s` 0 at t0), `at_s`, `x`, `y`, `p`, `t0`."""
    if film is None:
        return pd.DataFrame(columns=["what", "at_s", "x", "y", "p", "t0"])
    crowd, p = film
    step, row, column = np.nonzero(p)
    centre = (np.column_stack([column, row]) + grid.low + 0.5) * CELL_M
    cells = pd.DataFrame(
        {"what": "cell", "at_s": at_s[step], "x": centre[:, 0], "y": centre[:, 1], "p": p[step, row, column]}
    )
    now = np.column_stack([crowd.observed.x[:, -1], crowd.observed.y[:, -1]])
    places = np.concatenate([now[:, None], crowd.truth], axis=1)
    people = pd.DataFrame({
        "what": "person", "at_s": np.tile(np.append(0.0, at_s), len(now)), "x": places[..., 0].ravel(),
        "y": places[..., 1].ravel(), "p": np.nan,
    })  # fmt: skip
    return pd.concat([cells, people[people["x"].notna()]], ignore_index=True).assign(t0=crowd.t0)


def reliability_of(bins: pd.DataFrame) -> pd.DataFrame:
    """Per method, horizon and bin of `measure`'s `bins`: `forecast` and `outcome` (means), `half`, `n`, `calibrated`.

    `half` is half the 95 % interval of the outcome, with the cells of a half-hour, and those of a place, as clusters
    (both: C. Cameron, J. Gelbach, D. Miller, J. Bus. Econ. Stat. 29, 2011). A bin of `ENOUGH` cells is calibrated if
    its outcome is within `CLOSE` of the forecast, or the forecast within the interval; of others nothing is said.
    """
    from scipy.special import stdtrit  # noqa: PLC0415 - 0.1 s that only tables of the bins need

    rows = []
    for (method, horizon_s, number), group in bins.groupby(["method", "horizon_s", "bin"], sort=False):
        n = int(group["n"].sum())
        forecast, outcome = group["p"].sum() / n, group["occupied"].sum() / n
        rest = group["occupied"] - group["n"] * outcome
        places = [rest.groupby(group[key]).sum() for key in ("block", "cell")]
        by_both = [(one**2).sum() * len(one) / max(len(one) - 1, 1) for one in places]
        variance = max(sum(by_both) - (rest**2).sum(), *by_both) / n**2
        clusters = min(map(len, places))
        half = float(stdtrit(clusters - 1, 0.975) * np.sqrt(variance)) if clusters > 1 else np.nan
        apart = abs(outcome - forecast)
        calibrated = bool(apart <= CLOSE or apart <= half) if n >= ENOUGH else None
        rows.append((method, horizon_s, number, forecast, outcome, half, n, calibrated))
    columns = ["method", "horizon_s", "bin", "forecast", "outcome", "half", "n", "calibrated"]
    return pd.DataFrame(rows, columns=columns).sort_values(["method", "horizon_s", "bin"], ignore_index=True)
