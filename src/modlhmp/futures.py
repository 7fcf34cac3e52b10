"""Forecasts as the library gives them: futures with their ranks, who is still there, densities; and their scores."""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.ranking import RANKED, best_path, rank_order
from modlhmp.site import Site
from modlhmp.storage import DataError

if TYPE_CHECKING:
    from modlhmp.forecasting.modes import Modes
    from modlhmp.forecasting.occupancy import Occupancy

BANDWIDTH_CELLS = 1.0  # a sample's default spread in a density, in cells
MOST_CELLS = 50_000_000  # of a density or an occupancy; more is a wrong unit, and would not fit in memory
AROUND_BANDWIDTHS = 4.0  # how far a density's default extent reaches beyond the samples


def whole_steps(name: str, value_s: Any, site: Site, longest_s: float) -> int:
    """How many time steps a moment `value_s` is (1 or more); `DataError` where it is no whole number, or too late."""
    step_s, number = site.time_step_s, isinstance(value_s, Real) and not isinstance(value_s, bool)
    if number and 0.5 * step_s < value_s <= longest_s + 1e-6 and abs(value_s / step_s - round(value_s / step_s)) < 1e-6:
        return round(value_s / step_s)
    raise DataError(f"{name} {value_s!r}: give a multiple of {step_s:g} s from {step_s:g} to {longest_s:g}")


class Density(NamedTuple):
    """Probabilities [rows, columns], row 0 below, that sum to that of being in `extent` at all.

    `extent` = (x low, x high, y low, y high) in m.
    """

    probabilities: np.ndarray
    extent: tuple[float, float, float, float]


@dataclass(frozen=True)
class Futures:
    """The futures of n walkers, by the walker's `track_id` [n], after `t0` [n] (unix s).

    `forecast` is as the forecaster gave it (`forecasting.base`); `start` [n, 2] are the positions at t0 [m].
    """

    track_id: np.ndarray
    t0: np.ndarray
    start: np.ndarray
    forecast: Forecast
    site: Site

    @property
    def times_s(self) -> np.ndarray:
        """Seconds after t0 [T] of the positions."""
        return self.site.time_step_s * np.arange(1, self.forecast.xy.shape[2] + 1)

    @property
    def paths(self) -> np.ndarray:
        """The sampled futures, positions [n, k, T, 2] in m, held once they have stopped (see `known`)."""
        return self.forecast.samples.xy

    @property
    def alive(self) -> np.ndarray:
        """Whether each sampled future is still under way [n, k, T]: on the map, and not out of a door."""
        lived = self.forecast.samples.steps_alive[:, :, None]
        return lived >= np.arange(1, self.forecast.xy.shape[2] + 1)

    @property
    def known(self) -> np.ndarray:
        """Whether the map has dynamics where each walker stands [n]; who is unknown stands still, or walks straight."""
        return self.forecast.steps_alive.max(axis=1) > 0

    @property
    def best(self) -> np.ndarray:
        """The forecast as one path per walker, [n, T, 2] in m.

        Ranked futures: the best ranked at the longest horizon (paper Sec. III-D; the longest on the map first), and so
        for a medoid, the nearest to the others, and for modes, the likeliest. A method that gives a median or one path:
        that one. Futures of equal standing: their mean.
        """
        return self.forecast.xy.mean(axis=1) if self.forecast.output == "mean" else best_path(self.forecast)[0]

    @property
    def modes(self) -> "Modes":
        """Up to five distinct futures per walker, with probabilities, whatever the output: `forecasting.modes`.

            paths, probabilities, steps_alive = futures.modes

        `paths` [n, 5, T, 2] in m are samples, the likeliest first; `probabilities` [n, 5] are 0 where there are fewer.
        They are of the whole horizon: forecast to the one that is planned for.
        """
        from modlhmp.forecasting.modes import modes_of  # noqa: PLC0415 - a kernel, which few need

        return modes_of(self.forecast.samples)

    @property
    def ranks(self) -> np.ndarray:
        """Rank [n, k] of each sampled future at the longest horizon, 0 the best; all 0 where futures are not ranked."""
        samples = self.forecast.samples  # those behind modes are of equal standing
        n, k, steps = samples.xy.shape[:3]
        ranks = np.zeros((n, k), np.int64)
        if samples.output in RANKED:
            np.put_along_axis(ranks, rank_order(samples, steps), np.arange(k)[None], axis=1)
        return ranks

    def density(
        self,
        at_s: float,
        cell_m: float,
        walker: int = 0,
        extent: tuple[float, float, float, float] | None = None,
        bandwidth_m: float | None = None,
    ) -> Density:
        """Where a walker is after `at_s` seconds, if still there, as probabilities on a grid of `cell_m`.

        Each future that is still under way then (where none is, all at their last positions) is spread as a Gaussian of
        `bandwidth_m` (default: one cell). `extent` = (x low, x high, y low, y high) in m; by default the grid holds all
        of them, and probabilities sum to 1. Those of a box sum to the share of these futures that are in it.
        `DataError` for a moment that was not forecast or a walker that there is not.
        """
        from modlhmp.forecasting.density import density, edges_of  # noqa: PLC0415 - scipy's images, which few need

        step = self._step(at_s)
        if not isinstance(walker, Integral) or isinstance(walker, bool) or not 0 <= walker < len(self.track_id):
            raise DataError(f"walker {walker!r}: there are {len(self.track_id)}, counted from 0")
        for name, size_m in (("cell_m", cell_m), ("bandwidth_m", 1.0 if bandwidth_m is None else bandwidth_m)):
            if not isinstance(size_m, Real) or isinstance(size_m, bool) or not 0 < float(size_m) < np.inf:
                raise DataError(f"{name} {size_m!r}: a size in m above 0 is needed")
        there = self.alive[walker, :, step]
        positions = self.paths[walker, there if there.any() else slice(None), step].astype(float)
        spread = BANDWIDTH_CELLS * cell_m if bandwidth_m is None else bandwidth_m
        if extent is None:
            reach = AROUND_BANDWIDTHS * spread
            low, high = positions.min(axis=0) - reach, positions.max(axis=0) + reach
            low = np.floor(low / cell_m) * cell_m
            size = np.ceil((high - low) / cell_m) * cell_m
            extent = (float(low[0]), float(low[0] + size[0]), float(low[1]), float(low[1] + size[1]))
        if not _is_box(extent):
            raise DataError(f"extent {extent!r}: give (x low, x high, y low, y high) in m")
        if (cells := (extent[1] - extent[0]) * (extent[3] - extent[2]) / cell_m**2) > MOST_CELLS:
            raise DataError(f"cell_m {cell_m}: the density would have {cells:.2g} cells; give larger ones")
        y, x = edges_of(extent, cell_m)  # of whole cells, which may reach beyond what was asked for
        inside = ((positions >= (x[0], y[0])) & (positions <= (x[-1], y[-1]))).all(axis=1).mean()
        found = inside * density(positions, extent, cell_m, spread) if inside else np.zeros((len(y) - 1, len(x) - 1))
        return Density(found, (float(x[0]), float(x[-1]), float(y[0]), float(y[-1])))

    def left(self, at_s: float) -> np.ndarray:
        """Probability [n] that each walker has left by then: the share of the futures that have ended.

        1 from the start for walkers whom the map does not know; `known` tells them apart.
        """
        return 1.0 - self.alive[:, :, self._step(at_s)].mean(axis=1)

    def occupancy(self, cell_m: float = 1.0, extent: tuple[float, float, float, float] | None = None) -> "Occupancy":
        """Probability that a cell will be occupied, at every time step, by any of these walkers.

            p = futures.occupancy(extent=(0, 40, 0, 30)).probabilities  # [T, rows, columns]

        What occupied means, and what is assumed: `forecasting.occupancy`. Cells have their corners at multiples of
        `cell_m`; `extent` = (x low, x high, y low, y high) in m is what the grid covers, by default all samples. The
        walkers must have been seen at the same moment, as those of `Live` have; `DataError` where they were not.
        """
        from modlhmp.forecasting import occupancy  # noqa: PLC0415 - a kernel, which few need

        if not isinstance(cell_m, Real) or isinstance(cell_m, bool) or not 0 < float(cell_m) < np.inf:
            raise DataError(f"cell_m {cell_m!r}: a size in m above 0 is needed")
        if len(self.t0) and (apart := float(np.ptp(self.t0))) > 0.5 * self.site.time_step_s:
            raise DataError(
                f"occupancy: the walkers' t0 are {apart:.3g} s apart; forecast those who are there at one moment, as "
                "modlhmp.Live does"
            )
        if extent is not None and not _is_box(extent):
            raise DataError(f"extent {extent!r}: give (x low, x high, y low, y high) in m")
        box = occupancy.extent_of(self.forecast, cell_m) if extent is None else extent
        if (cells := (box[1] - box[0]) * (box[3] - box[2]) / cell_m**2 * len(self.times_s)) > MOST_CELLS:
            raise DataError(f"occupancy: {cells:.2g} cells and moments; give an `extent`, or a larger cell_m")
        t0 = float(self.t0.max()) if len(self.t0) else float("nan")
        return occupancy.occupancy(self.forecast, self.times_s, t0, box, float(cell_m))

    def _step(self, at_s: float) -> int:
        return whole_steps("at_s", at_s, self.site, self.times_s[-1]) - 1


def _is_box(extent: Any) -> bool:
    """Whether it is (x low, x high, y low, y high)."""
    four = isinstance(extent, Sequence | np.ndarray) and len(extent) == 4
    finite = four and all(isinstance(one, Real) and np.isfinite(float(one)) for one in extent)
    return bool(finite and extent[0] < extent[1] and extent[2] < extent[3])


@dataclass(frozen=True)
class Scores:
    """Errors of n walkers at T horizons under one protocol: `ade`, `fde` [n, T] in m, NaN where not scored.

    `horizons_s` [T]; `eligible` [n, T] says who counts at each horizon. `output`: how a path came out of the futures.
    """

    protocol: str
    output: str
    horizons_s: np.ndarray
    ade: np.ndarray
    fde: np.ndarray
    eligible: np.ndarray

    @property
    def n(self) -> np.ndarray:
        """How many walkers are scored at each horizon [T]; read every mean with it."""
        return np.isfinite(self.ade).sum(axis=0)

    def at(self, horizon_s: float) -> dict[str, float]:
        """Mean ADE and FDE [m] at one horizon, with n scored of the eligible; NaN where nobody is scored."""
        asked = horizon_s if isinstance(horizon_s, Real) else np.nan  # which is close to none
        found = np.flatnonzero(np.isclose(self.horizons_s, asked))
        if not len(found):
            step, longest = (self.horizons_s[0], self.horizons_s[-1]) if len(self.horizons_s) else (0, 0)
            raise DataError(
                f"horizon_s {horizon_s!r}: it was not forecast; give a multiple of {step:g} s up to {longest:g} s"
            )
        column = int(found[0])
        scored = np.isfinite(self.ade[:, column])
        means = [float(part[scored, column].mean()) if scored.any() else float("nan") for part in (self.ade, self.fde)]
        return {
            "ade_m": means[0],
            "fde_m": means[1],
            "n": int(scored.sum()),
            "eligible": int(self.eligible[:, column].sum()),
        }
