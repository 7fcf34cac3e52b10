"""Figure prediction_example: what every compared method forecast for one example track of each dataset."""

from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D

from modlhmp.paper import paths, style
from modlhmp.paper.selection import errors_at, example_track

LONG_S = 60.0  # datasets with a shorter horizon are shown at half of it: ATC at 60 s, Edinburgh at 10 s
SITE_MARGIN_M = 2.0
RULE = (
    "Example tracks are chosen by rule: of the test tracks eligible at the horizon under the paper protocol, that of "
    "median ADE of {first} (complete protocol, first seed). ADE: complete protocol, held where it left the map."
)


def draw(folder, datasets, methods, stem):
    """One panel a dataset.

    `folder` is results/{run}, `datasets` a list of settings, `methods` maps names to titles in table order.
    """
    found = [example(Path(folder) / dataset["name"], dataset, methods) for dataset in datasets]
    tables = [table for table, _, _ in found if table is not None]
    fig, places = paths.sheet(datasets, len(methods), RULE.format(first=next(iter(methods.values()))))
    for (ax, key), dataset, (table, text, site) in zip(places, datasets, found, strict=True):
        if table is None:
            style.empty_panel(ax, f"{dataset['title']}\n{text}")
        else:
            _panel(ax, key, dataset, table, text, methods, site)
    style.save(fig, stem, paths.collect(tables), any(dataset["demo"] for dataset in datasets))


def shown_steps(dataset):
    """Time steps to the horizon that is shown."""
    steps = round(dataset["horizon_s"] / dataset["time_step_s"])
    return steps if dataset["horizon_s"] >= LONG_S else max(steps // 2, 1)


def example(folder, dataset, methods):
    """Plotted positions of a dataset's example (`paths.COLUMNS`), its title, and the corners of the site [2, 2].

    (None, why, None) where there is none. ADEs are those of the errors files.
    """
    steps = shown_steps(dataset)
    errors = {method: errors_at(folder / "errors" / f"{method}.parquet", steps) for method in methods}
    chosen_by = next(iter(errors.values()))
    track = example_track(chosen_by)
    if track is None:
        return None, f"no test track of {steps * dataset['time_step_s']:g} s", None
    file = f"{track.recording}.parquet"
    person = paths.person_paths(folder / "tracks" / file, track.track_id, dataset, steps)
    tables = [person]
    for method, rows in errors.items():
        forecast = paths.forecast_of(folder / "forecasts" / method / file, track.track_id)
        if forecast is not None:
            start = paths.one_path(person, "truth")[0]
            path = paths.forecast_paths(forecast, shown_futures(forecast, steps), steps, dataset["time_step_s"], start)
            own = rows[(rows["recording"] == track.recording) & (rows["track_id"] == track.track_id)]
            tables.append(path.assign(method=method, ade_m=own["ade_m"].iloc[0] if len(own) else np.nan))
    site = paths.site(folder / "tracks", chosen_by["recording"].unique())
    return paths.of_example(dataset, track, tables), f"{paths.title(dataset, track, steps)}\n{paths.who(track)}", site


def shown_futures(forecast, steps):
    """Indices of the futures that are a method's result: the best ranked, or all where the result is of all."""
    return paths.rank_order(forecast, steps)[:1] if forecast.output == "ranked" else np.arange(len(forecast.xy))


def _panel(ax, key, dataset, table, text, methods, site):
    low, high = site[0] - SITE_MARGIN_M, site[1] + SITE_MARGIN_M
    paths.frame(ax, dataset, np.clip(table[["x_m", "y_m"]].to_numpy(float), low, high))
    paths.draw_person(ax, table)
    lines = [
        _draw_method(ax, table[table["method"] == method], title, style.method_style(position), len(methods) - position)
        for position, (method, title) in enumerate(methods.items())
    ]
    ax.set_title(text)
    paths.write_key(key, lines, None)


def _draw_method(ax, futures, title, look, height):
    """Draw a method's result, several paths thin; returns its legend entry."""
    if futures.empty:
        return Line2D([], [], linestyle="none", label=f"{title}: no forecast")
    one_by_one = [path for _, path in futures.groupby("rank")]
    several = len(one_by_one) > 1
    for path in one_by_one:
        paths.draw_path(ax, path, {**look, "zorder": 3 + height / 100}, linewidth=0.5 if several else 1.0)
    note = f" ({len(one_by_one)} paths)" if several else paths.end_note(ax, one_by_one[0])
    return Line2D([], [], label=f"{title}: ADE {futures['ade_m'].iloc[0]:.2f} m{note}", **look)
