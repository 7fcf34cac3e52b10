"""Figure prediction_example: what every compared method forecast for one example track of each dataset."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import RESULTS, Forecast
from modlhmp.forecasting.ranking import rank_order
from modlhmp.study import lacks
from modlhmp.study.exhibits import paths, style
from modlhmp.study.exhibits.selection import errors_at, example_track
from modlhmp.study.layout import Layout

LONG_S = 60.0  # a dataset with a shorter horizon is shown at half of it; the paper: ATC 60 s, Edinburgh 10 of 20 s
SITE_MARGIN_M = 2.0


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """One panel per dataset; `methods` maps names to titles in table order."""
    fig, places = paths.sheet(datasets, 1 + len(methods), f"{paths.rule(methods)} ADE: complete protocol.")
    tables = []
    for (ax, key), dataset in zip(places, datasets, strict=True):
        table, text, box = example(layout, dataset, methods)
        if table is None:
            style.empty_panel(ax, f"{dataset.title}\n{text}")
            continue
        _panel(ax, key, dataset, table, text, methods, box)
        tables.append(table)
    style.save(fig, stem, paths.collect(tables), any(dataset.demo for dataset in datasets))


def shown_steps(dataset: Dataset) -> int:
    """Time steps to the horizon that is shown."""
    return dataset.steps if dataset.horizon_s >= LONG_S else max(dataset.steps // 2, 1)


def example(
    layout: Layout, dataset: Dataset, methods: Mapping[str, str]
) -> tuple[pd.DataFrame | None, str, np.ndarray | None]:
    """Plotted positions of a dataset's example (`paths.COLUMNS`), who it is, and the corners [2, 2] of the place [m].

    (None, why, None) where there is none. ADEs are those of the errors files.
    """
    name, steps = dataset.name, shown_steps(dataset)
    errors = {method: errors_at(layout.errors(name, method), steps) for method in methods}
    first = next(iter(errors.values()))
    track = example_track(first)
    if track is None:
        return None, lacks.NO_TRACK.text.format(horizon=steps * dataset.time_step_s), None
    person = paths.person_paths(layout.tracks(name, track.recording), track.track_id, dataset, steps)
    start, tables = paths.one_path(person, "truth")[0], [person]
    for method, rows in errors.items():
        forecast = paths.forecast_of(layout.forecast(name, method, track.recording), track.track_id)
        if forecast is not None:
            path = paths.forecast_paths(forecast, shown_futures(forecast, steps), steps, dataset.time_step_s, start)
            own = rows[(rows["recording"] == track.recording) & (rows["track_id"] == track.track_id)]
            tables.append(path.assign(method=method, ade_m=own["ade_m"].iloc[0]))
    box = paths.box_of(layout.tracks(name, recording) for recording in first["recording"].unique())
    return paths.of_example(dataset, track, tables), paths.who(track), box


def shown_futures(forecast: Forecast, steps: int) -> np.ndarray:
    """Indices of the futures that make a method's result: the best ranked, or all whose errors are averaged."""
    if forecast.output in {"mean", "single"}:
        return np.arange(len(forecast.xy))
    order = rank_order(forecast, steps)
    return order[order < RESULTS.get(forecast.output, len(order))][:1]


def _panel(ax, key, dataset, table, text, methods, box):
    low, high = box[0] - SITE_MARGIN_M, box[1] + SITE_MARGIN_M  # constant velocity may lead far out of it
    xy = np.clip(table[["x_m", "y_m"]].to_numpy(float), low, high)
    paths.frame(ax, dataset, xy, shown_steps(dataset) * dataset.time_step_s)
    paths.draw_person(ax, table)
    lines = [
        _draw_method(ax, table[table["method"] == method], title, position, len(methods))
        for position, (method, title) in enumerate(methods.items())
    ]
    paths.write_key(key, lines, text)


def _draw_method(ax, futures, title, position, number):
    """Draw a method's result, several paths thin; returns its entry of the key."""
    if futures.empty:
        return Line2D([], [], linestyle="none", label=f"{title}: no forecast")
    look = style.method_style(position)
    one_by_one = [path for _, path in futures.groupby("rank")]
    several = len(one_by_one) > 1
    for path in one_by_one:
        paths.draw_path(ax, path, look, linewidth=0.5 if several else 1.0, place=position / number)
    note = f", {len(one_by_one)} paths" if several else paths.end_note(ax, one_by_one[0])
    return Line2D([], [], label=f"{title}: ADE {futures['ade_m'].iloc[0]:.2f} m{note}", **look)
