"""Figure density: where one person of each dataset may be at three moments, as the samples of a forecast say."""

import dataclasses
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.density import density, level_that_holds
from modlhmp.forecasting.outputs import with_output
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.kinds import find
from modlhmp.methods import Method, make_forecaster
from modlhmp.scenes import read_scenes
from modlhmp.scoring.uncertainty import samples_of
from modlhmp.study import lacks
from modlhmp.study.exhibits import paths, style
from modlhmp.study.exhibits.selection import Example, errors_at, example_track
from modlhmp.study.layout import Layout
from modlhmp.tracks import read_tracks

MOMENTS = (1 / 6, 1 / 3, 1.0)  # of the horizon
CELLS, BANDWIDTH = 300, 1 / 60  # cells of a panel's width, and the share of it by which a sample is spread
SHARES = (0.9, 0.5)
COLUMNS = paths.COLUMNS[:9]  # `rank` numbers the samples
SHADES = LinearSegmentedColormap.from_list(
    "probability",
    [(0.0, 0.45, 0.7, 0.0), (0.0, 0.45, 0.7, 0.55), "#00304A"],  # type: ignore[arg-type]  # any mixture of forms
)
CONTOUR: style.Look = {"colors": "#00304A", "linewidths": (0.5, 1.0)}  # wider around the likelier part
MEDIAN: style.Look = {"color": "#E69F00", "linewidth": 1.2, "zorder": 6}


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    methods: Mapping[str, str],
    shown: Mapping[str, Mapping[str, Any]],
    samples: int,
    seed: int,
) -> None:
    """One row per dataset, one column per moment.

    `methods` maps names to titles in table order, `shown` each dataset's name to the `Method.plain()` of the method
    that is shown, with what is tuned there; it makes `samples` futures at least, by `seed`.
    """
    height_mm = (style.PAGE_MM / 3 - 6.0) * paths.PANEL + 12.0
    fig, axes = style.figure(len(datasets), 3, style.PAGE_MM, height_mm * len(datasets) + 20.0)
    tables = []
    for line, dataset in zip(axes, datasets, strict=True):
        method = Method.of(shown[dataset.name])
        table, text, left = example(layout, dataset, methods, method, samples, seed)
        if table is None or left is None:
            for ax in line:
                ax.set_axis_off()
            style.empty_panel(line[1], f"{dataset.title}\n{text}")
            continue
        for ax, step in zip(line, moments(dataset), strict=True):
            _panel(ax, dataset, table, step * dataset.time_step_s, left[step])
        line[1].set_title(f"{dataset.title}, {text}\n{line[1].get_title()}")
        tables.append(table)
    numbers = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=COLUMNS)
    (name,) = {one["name"] for one in shown.values()}
    text = (
        f"Samples of {methods[name]} that are still there, each spread by 1/{1 / BANDWIDTH:.0f} of the panel's width: "
        "if still there, the person is inside the thick line with a probability of 50 %, inside the thin one with "
        f"90 %; p: probability of having left. {paths.rule(methods)}"
    )
    fig.legend(
        handles=_handles(datasets),
        loc="outside lower center",
        ncols=6,
        title="\n".join(textwrap.wrap(text, 150)),
        title_fontsize=6,
    )
    style.save(fig, stem, numbers, any(dataset.demo for dataset in datasets))


def moments(dataset: Dataset) -> list[int]:
    """Time steps to the three moments."""
    return [max(round(share * dataset.steps), 1) for share in MOMENTS]


def example(
    layout: Layout, dataset: Dataset, methods: Mapping[str, str], method: Method, samples: int, seed: int
) -> tuple[pd.DataFrame | None, str, dict[int, float]]:
    """Plotted positions of a dataset's example (`COLUMNS`), who it is, and {step: share of the samples that left}.

    (None, why, {}) where there is none. A sample has a row at each moment at which it is still there; where none
    is, all have their last position.
    """
    steps = dataset.steps
    track = example_track(errors_at(layout.errors(dataset.name, next(iter(methods))), steps))
    if track is None:
        return None, lacks.NO_TRACK.text.format(horizon=dataset.horizon_s), {}
    person = paths.person_paths(layout.tracks(dataset.name, track.recording), track.track_id, dataset, steps)
    forecast = forecast_again(layout, dataset, method, track, samples, seed)
    median = with_output(forecast, "geometric_median")
    step_s, start = dataset.time_step_s, paths.one_path(person, "truth")[0]
    path = np.vstack([start, median.xy[0, 0]])
    forecasts = [_rows("median", path, np.arange(steps + 1) * step_s)]
    xy, alive = (part[0] for part in samples_of(forecast))
    left = {}
    for step in moments(dataset):
        there = alive >= step
        left[step] = 1 - there.mean()
        if not there.any():
            there[:] = True
        at = _rows("sample", xy[there, step - 1], step * step_s)
        forecasts.append(at.assign(rank=np.flatnonzero(there) + 1))
    table = paths.of_example(dataset, track, [person, pd.concat(forecasts).assign(method=method.name)])
    return table[list(COLUMNS)], paths.who(track), left


def forecast_again(
    layout: Layout, dataset: Dataset, method: Method, track: Example, samples: int, seed: int
) -> Forecast:
    """The first `Forecast` of one track with `samples` futures at least, since files keep fewer.

    A network's and one from outside are as they are in the file.
    """
    if not find(method.kind).has_map:
        one = paths.forecast_of(layout.forecast(dataset.name, method.name, track.recording), track.track_id)
        assert one is not None
        return Forecast(*(part[None] for part in one[:3]), one.output)  # type: ignore[call-arg]
    exits = layout.map(dataset.name, "exits")
    path = layout.map_of(dataset.name, method)
    forecaster = make_forecaster(method.kind, method.options, dataset, path, exits)
    file = layout.tracks(dataset.name, track.recording)
    tracks = read_tracks(file)
    tracks = tracks.take(tracks.track_id == track.track_id)
    scenes = read_scenes(file) if dataset.forecast_every_s is None else None
    once = dataclasses.replace(dataset, forecast_every_s=None)
    keyed_by = (dataset.name, method.name, track.recording)
    k = max(method.futures, samples)
    found = forecast_recording(tracks, forecaster, once, keyed_by, k, [seed], scenes=scenes)
    xy, log_fitness, steps_alive, output = next(found)[2]
    return Forecast(xy[:1], log_fitness[:1], steps_alive[:1], output)


def _rows(what, xy, step_s):
    table = pd.DataFrame({"what": what, "step_s": step_s, "x_m": xy[:, 0], "y_m": xy[:, 1]})
    return table.reindex(columns=paths.COLUMNS[3:])


def _panel(ax, dataset, table, moment_s, left):
    samples = table[table["what"] == "sample"]
    known = [paths.one_path(table, what) for what in ("observed", "truth", "median")]
    for _, some in samples.groupby("step_s"):  # but for a few far away
        known.append(np.percentile(some[["x_m", "y_m"]].to_numpy(float), (2, 98), axis=0))
    paths.frame(ax, dataset, np.vstack(known), dataset.horizon_s)
    now = samples.loc[samples["step_s"] == moment_s, ["x_m", "y_m"]].to_numpy(float)
    extent = (*sorted(ax.get_xlim()), *sorted(ax.get_ylim()))
    _draw_density(ax, now, extent)
    ax.plot(*paths.one_path(table, "truth").T, **{**paths.TRUTH, "linewidth": 2.2})
    ax.plot(*paths.one_path(table, "observed").T, **{**paths.OBSERVED, "linewidth": 2.2})
    median = table[(table["what"] == "median") & (table["step_s"] <= moment_s)]
    ax.plot(median["x_m"], median["y_m"], **MEDIAN)
    ax.plot(*median[["x_m", "y_m"]].iloc[-1], marker="o", markersize=3.5, **MEDIAN)
    there = table[(table["what"] == "truth") & np.isclose(table["step_s"], moment_s)]
    ax.plot(there["x_m"], there["y_m"], **paths.TRUTH_END)
    ax.set_title(f"after {moment_s:g} s: has left with p = {left:.2f}")


def _draw_density(ax, positions, extent):
    x_low, x_high, y_low, y_high = extent
    inside = (positions >= [x_low, y_low]) & (positions <= [x_high, y_high])
    if not inside.all(axis=1).any():
        return
    cell_m = (x_high - x_low) / CELLS
    p = density(positions, extent, cell_m, BANDWIDTH * (x_high - x_low))
    rows, columns = p.shape
    covered = (x_low, x_low + columns * cell_m, y_low, y_low + rows * cell_m)
    limits = ax.get_xlim(), ax.get_ylim()
    ax.imshow(p, origin="lower", extent=covered, cmap=SHADES, interpolation="bilinear", zorder=1.5)
    x, y = x_low + cell_m * (np.arange(columns) + 0.5), y_low + cell_m * (np.arange(rows) + 0.5)
    ax.contour(x, y, p, [level_that_holds(p, share) for share in SHARES], zorder=3, **CONTOUR)
    ax.set(xlim=limits[0], ylim=limits[1])


def _handles(datasets):
    truth = {**paths.TRUTH, "linewidth": 2.2, "marker": paths.TRUTH_END["marker"], "markersize": 4}
    truth |= {"markerfacecolor": paths.TRUTH_END["color"], "markeredgecolor": paths.TRUTH_END["color"]}
    median = {**MEDIAN, "marker": "o", "markersize": 3.5}
    handles = [
        Line2D([], [], label="observed", **{**paths.OBSERVED, "linewidth": 2.2}),
        Line2D([], [], label="truth, and at that moment", **truth),
        Line2D([], [], label="median path, and at that moment", **median),
        Patch(label="probability per cell", color=SHADES(0.6)),
    ]
    if any(dataset.floor_plan for dataset in datasets):
        handles.append(Patch(label="occupied (floor plan)", color=style.WALL_COLOUR))
    return handles
