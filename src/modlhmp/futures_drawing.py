"""A picture of forecasts: what was seen of each person, the samples, and the one path."""

from pathlib import Path

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.ranking import best_path
from modlhmp.futures import Futures
from modlhmp.pictures import made_by
from modlhmp.storage import DataError, atomic_path
from modlhmp.tracks import Tracks

MOST_WALKERS, MOST_SAMPLES = 30, 50
PANEL_IN, BESIDE_IN = 6.0, 1.4  # the longer side of the panel; title, key and numbers beside it
FLATTEST = 0.2  # the shorter side of the panel by the longer


def draw_futures(futures: Futures, history: Tracks, title: str, path: str | Path) -> None:
    """Write a picture (PNG) of the futures of the first 30 walkers; paths are drawn until they end."""
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - only the study installs it
    except ImportError:
        raise DataError("drawing needs matplotlib: pip install 'modlhmp[study]'") from None
    figure = Figure(layout="constrained")
    axes = figure.add_subplot()
    forecast = futures.forecast
    result = futures.best if forecast.output == "mean" else best_path(forecast)[0]
    lived = forecast.steps_alive.max(axis=1) if forecast.output == "mean" else best_path(forecast)[1]
    shown = min(len(futures.track_id), MOST_WALKERS)
    for walker in range(shown):
        start = futures.start[walker]
        for xy, alive in list(_samples(forecast, walker))[:MOST_SAMPLES]:
            axes.plot(*np.vstack([start, xy[:alive]]).T, color="0.6", lw=0.5, alpha=0.5, zorder=1)
        mine = (history.track_id == futures.track_id[walker]) & (history.t <= futures.t0[walker])
        axes.plot(history.x[mine], history.y[mine], color="black", lw=1.2, zorder=3)
        axes.plot(*np.vstack([start, result[walker, : lived[walker]]]).T, color="#D55E00", lw=1.2, zorder=2)
        axes.plot(*start, "o", color="black", ms=3, zorder=4)
    for label, colour in (("seen", "black"), ("forecast", "#D55E00"), ("samples", "0.6")):
        axes.plot([], [], color=colour, label=label)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    axes.set_aspect("equal")
    of = f"{shown} of {len(futures.track_id)} people, " if shown < len(futures.track_id) else ""
    axes.set(xlabel="x / m", ylabel="y / m", title=f"{title}\n{of}{futures.times_s[-1]:g} s")
    limits = np.array([axes.get_xlim(), axes.get_ylim()])
    sides = np.ptp(limits, axis=1)
    sides = np.maximum(sides, FLATTEST * sides.max())
    limits = limits.mean(axis=1)[:, None] + np.outer(sides, [-0.5, 0.5])
    axes.set(xlim=limits[0], ylim=limits[1])
    figure.set_size_inches(*(PANEL_IN * sides / sides.max() + BESIDE_IN))
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=130, bbox_inches="tight", metadata=made_by("png"))


def _samples(forecast: Forecast, walker: int) -> zip:
    samples = forecast.samples
    return zip(samples.xy[walker], samples.steps_alive[walker], strict=True)
