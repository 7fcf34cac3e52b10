"""What maps, forecasts and scores must know of the place and of the recordings: one small record."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from annotated_types import Ge, Le

from modlhmp.settings import From0, Positive, Seconds, WholeFrom1, option
from modlhmp.storage import DataError

Hour = Annotated[int, Ge(0), Le(24)]
MOST_STEP_S = 60.0
TimeStep = Annotated[float, Ge(0.01), Le(MOST_STEP_S)]

MOST_STEPS = 100_000  # of a forecast and of what it is made from: far above any, and what fits into memory


@dataclass(frozen=True, kw_only=True)
class IdleFilter:
    """The paper protocol leaves out tracks with two rows so many apart that are less than so many metres apart."""

    rows: WholeFrom1 = option(5, "how many rows apart")
    min_displacement_m: Positive = option(1.0, "closer than this is idle [m]")


@dataclass(frozen=True, kw_only=True)
class PaperProtocol:
    """What the paper protocol does on the recordings of one place."""

    idle_filter: IdleFilter | None = option(None, "which tracks it leaves out as idle; null: none")


@dataclass(frozen=True, kw_only=True)
class Site:
    """The clock, the time step and the velocities of one place; a `Dataset` is one, too."""

    timezone: str = option("UTC", "tz database name of the place, such as Asia/Tokyo")
    hours: tuple[Hour, Hour] | None = option(
        None, "clock hours that get a map, [first, one after the last]; null: all with training data"
    )
    time_step_s: TimeStep = option(1.0, "time step of the cleaned tracks and of forecasts [s]")
    observed_rows: int = option(4, "rows that a forecaster sees; the last one is at t0 (at least 2)")
    forecast_every_s: Seconds | None = option(
        None,
        "in the workflow another forecast of a track every so many seconds [s], each at its own t0; null: one, or one "
        "of each scene where the file has scenes (reader `trajnet`)",
    )
    horizon_s: Seconds = option(60.0, "longest horizon [s], a multiple of the time step")
    velocity: Literal["as_recorded", "differences"] = option(
        "differences", "where current velocities come from: the file's own columns, or differences of positions"
    )
    difference_weights: tuple[From0, ...] = option(
        (0.48, 0.33, 0.19), "weights of the last steps' velocities, newest first, for methods' `velocity: differences`"
    )
    paper_protocol: PaperProtocol = option(PaperProtocol(), "what the paper protocol does here")

    @property
    def listed_hours(self) -> list[int] | None:
        """The clock hours of `hours`, which may go on after midnight; None where they are not given."""
        if self.hours is None:
            return None
        first, end = self.hours
        return [hour % 24 for hour in range(first, end if end > first else end + 24)]

    @property
    def steps(self) -> int:
        """Time steps to the longest horizon."""
        return round(self.horizon_s / self.time_step_s)


def check_site(site: Site, where: str | Path) -> None:
    """Checks that types cannot say; `DataError` begins with `where`."""
    check_timezone(site.timezone, where)
    if site.hours and site.hours[0] in (site.hours[1], 24):
        raise DataError(f"{where}: hours {list(site.hours)} are empty; say [first, one after the last]")
    if (steps := max(site.horizon_s / site.time_step_s, site.observed_rows)) > MOST_STEPS:
        raise DataError(
            f"{where}: horizon_s {site.horizon_s:g} and observed_rows {site.observed_rows}: {steps:.3g} time steps, at "
            f"most {MOST_STEPS} are forecast"
        )
    if site.observed_rows < 2:
        raise DataError(f"{where}: observed_rows {site.observed_rows} is under 2; a velocity takes two rows")
    if not _whole(site.horizon_s / site.time_step_s):
        raise DataError(f"{where}: horizon_s {site.horizon_s} is not a multiple of time_step_s {site.time_step_s}")
    if site.forecast_every_s is not None and not _whole(site.forecast_every_s / site.time_step_s):
        raise DataError(
            f"{where}: forecast_every_s {site.forecast_every_s} is not a multiple of time_step_s {site.time_step_s}"
        )
    weights = site.difference_weights
    if not weights or min(weights) < 0 or not sum(weights):
        raise DataError(f"{where}: difference_weights {list(weights)} are not positive numbers, newest step first")
    if not sum(weights[: site.observed_rows - 1]):
        raise DataError(
            f"{where}: difference_weights {list(weights)} leave no weight for the steps of observed_rows "
            f"{site.observed_rows}; make one of the first {site.observed_rows - 1} larger, or observe more rows"
        )


def _whole(steps: float) -> bool:
    """Whether it is a whole number of time steps, one or more."""
    return abs(steps - round(steps)) <= 1e-9 and steps >= 1


def check_timezone(name: str, where: object) -> None:
    """`DataError` that begins with `where` unless it is a name of the tz database."""
    try:
        ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise DataError(f"{where}: timezone {name!r} is unknown; use a name such as Europe/London") from None
