"""Figure memory-maps: what the maps with memory hold around a walker, and how each forecasts (not in the paper)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import RESULTS
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits import paths, style
from modlhmp.study.exhibits.example_forecasts import shown_futures
from modlhmp.study.exhibits.selection import errors_at, example_track
from modlhmp.study.layout import Layout

SNIPPETS_M = 2.0  # snippets are drawn that start so near to the walker
MOST_DRAWN = 150
RESULT: style.Look = {"color": "#0072B2", "linewidth": 2.0, "zorder": 5}
SAMPLE: style.Look = {"color": "#0072B2", "linewidth": 0.6, "alpha": 0.5, "zorder": 3}
LEFT: style.Look = {
    "marker": "x",
    "markersize": 4,
    "markeredgewidth": 0.9,
    "linestyle": "none",
    "color": "#0072B2",
    "zorder": 4,
}


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """One row of panels per dataset: the snippets around an example walker, and the forecast of each map.

    `methods` maps the names of an `episodes` and a `snippets` method to their titles.
    """
    fig, axes = style.figure(len(datasets), 1 + len(methods), style.PAGE_MM, 46.0 * len(datasets) + 16)
    tables = [_row(line, layout, dataset, methods) for line, dataset in zip(axes, datasets, strict=True)]
    handles = [
        Line2D([], [], label="observed", **paths.OBSERVED),
        Line2D([], [], label="truth", **paths.TRUTH),
        Line2D([], [], label="result (default: geometric median)", **RESULT),
        Line2D([], [], label="single replays or particles (20 of them)", **{**SAMPLE, "alpha": 1}),
        Line2D([], [], label="left through an exit", **LEFT),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    style.save(fig, stem, paths.collect(tables), any(dataset.demo for dataset in datasets))


def _row(line: np.ndarray, layout: Layout, dataset: Dataset, methods: Mapping[str, str]) -> pd.DataFrame:
    """Draw one dataset's panels; returns the plotted positions."""
    name, steps = dataset.name, dataset.steps
    track = example_track(errors_at(layout.errors(name, next(iter(methods))), steps))
    if track is None:
        why = lacks.NO_TRACK.text.format(horizon=dataset.horizon_s)
        for panel in line:
            style.empty_panel(panel, f"{dataset.title}: {why}")
        return pd.DataFrame(columns=paths.COLUMNS)
    person = paths.person_paths(layout.tracks(name, track.recording), track.track_id, dataset, steps)
    start, tables = paths.one_path(person, "truth")[0], [person]
    futures = {}
    for method in methods:
        forecast = paths.forecast_of(layout.forecast(name, method, track.recording), track.track_id)
        assert forecast is not None  # every scored track was forecast
        result, samples = shown_futures(forecast, steps), np.arange(RESULTS.get(forecast.output, 0), len(forecast.xy))
        order = [*result, *np.setdiff1d(samples, result)]
        table = paths.forecast_paths(forecast, order, steps, dataset.time_step_s, start)
        futures[method] = table.assign(method=method)
        tables.append(futures[method])
    shown = pd.concat(tables)[["x_m", "y_m"]].to_numpy(float)
    _snippets(line[0], layout.map(name, "snippets"), start, dataset, person)
    for panel, (method, title) in zip(line[1:], methods.items(), strict=True):
        paths.frame(panel, dataset, shown, dataset.horizon_s)
        panel.set_title(f"{title}, {dataset.horizon_s:g} s")
        paths.draw_person(panel, person)
        for rank, path in futures[method].groupby("rank"):
            xy = path[["x_m", "y_m"]].to_numpy(float)
            panel.plot(*xy.T, **(RESULT if rank == 1 else SAMPLE))
            if rank > 1 and path["left_map"].iloc[0]:
                panel.plot(*xy[-1], **LEFT)
    return paths.of_example(dataset, track, tables)


def _snippets(panel, file, start, dataset, person):
    """The map's snippets that start near the walker, coloured by the direction of their first step."""
    table = read_parquet(file, ["x", "y", "steps", "path"])
    xy = np.column_stack([table["x"].to_numpy(), table["y"].to_numpy()]).astype(float)
    near = np.flatnonzero(np.hypot(*(xy - start).T) <= SNIPPETS_M)
    near = np.sort(np.random.default_rng(0).permutation(near)[:MOST_DRAWN])
    past = int(table.schema.metadata[b"past"])
    width = table.schema.field("path").type.list_size // 2
    path = table["path"].combine_chunks().flatten().to_numpy().reshape(-1, width, 2)[near, past:].astype(float)
    walked = table["steps"].to_numpy()[near]
    lines = [one[: steps + 1] + xy[row] for one, steps, row in zip(path, walked, near, strict=True)]
    extent = np.vstack([start[None], *lines])
    paths.frame(panel, dataset, extent, dataset.horizon_s)
    panel.set_title(f"{dataset.title}: snippets that start here")
    direction = np.array([np.arctan2(*(line[1] - line[0])[::-1]) for line in lines])
    panel.add_collection(LineCollection(lines, colors=style.heading_colour(direction), linewidths=0.6, zorder=3))
    panel.plot(*paths.one_path(person, "observed").T, **paths.OBSERVED)
