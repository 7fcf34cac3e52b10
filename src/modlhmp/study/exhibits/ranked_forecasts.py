"""Figure rank: the k ranked forecasts of one example track of each dataset, at its longest horizon."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from modlhmp.datasets import Area, Dataset
from modlhmp.forecasting.ranking import rank_order
from modlhmp.scoring.errors import displacement_errors
from modlhmp.storage import read_metadata
from modlhmp.study import lacks
from modlhmp.study.exhibits import paths, style
from modlhmp.study.exhibits.selection import errors_at, example_track
from modlhmp.study.layout import Layout

SHOWN = "tc_cliff"  # the paper's choice; without it the first compared method that ranks its futures
AREA_COLOURS = {"green": "#009E73", "red": "#D55E00", "blue": "#0072B2", "orange": "#E69F00"}
HATCHES = ("....", "////", "\\\\\\\\", "xxxx")  # tell areas apart in grey
RANKED_BY = "Ranks and ADE: complete protocol (the longest on the map first, then by cumulative fitness)."


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """One panel per dataset; `methods` maps names to titles in table order."""
    found = [example(layout, dataset, methods) for dataset in datasets]
    tables = [table for table, _ in found if table is not None]
    ranks = max((int(table["rank"].max()) for table in tables), default=0)
    key_lines = 2 + ranks + max(len(dataset.areas) for dataset in datasets)
    fig, places = paths.sheet(datasets, key_lines, f"{paths.rule(methods)} {RANKED_BY}")
    for (ax, key), dataset, (table, text) in zip(places, datasets, found, strict=True):
        if table is None:
            style.empty_panel(ax, f"{dataset.title}\n{text}")
        else:
            _panel(ax, key, dataset, table, text, methods)
    style.save(fig, stem, paths.collect(tables), any(dataset.demo for dataset in datasets))


def example(layout: Layout, dataset: Dataset, methods: Mapping[str, str]) -> tuple[pd.DataFrame | None, str]:
    """Plotted positions of a dataset's example (`paths.COLUMNS`) and who it is; (None, why) where there is none."""
    name, steps = dataset.name, dataset.steps
    track = example_track(errors_at(layout.errors(name, next(iter(methods))), steps))
    if track is None:
        return None, lacks.NO_TRACK.text.format(horizon=dataset.horizon_s)
    files = {method: layout.forecast(name, method, track.recording) for method in methods}
    ranked = [method for method, file in files.items() if read_metadata(file).get("output") == "ranked"]
    method = SHOWN if SHOWN in ranked else next(iter(ranked), None)
    forecast = paths.forecast_of(files[method], track.track_id) if method else None
    if forecast is None:
        return None, lacks.NO_RANKS.text
    person = paths.person_paths(layout.tracks(name, track.recording), track.track_id, dataset, steps)
    truth = paths.one_path(person, "truth")
    order = rank_order(forecast, steps)
    futures = paths.forecast_paths(forecast, order, steps, dataset.time_step_s, truth[0])
    ade, _ = displacement_errors(forecast.xy[None, order, :steps], truth[None, 1:])
    futures = futures.assign(method=method, ade_m=ade[0, futures["rank"] - 1, -1])
    return paths.of_example(dataset, track, [person, futures]), paths.who(track)


def _panel(ax, key, dataset, table, text, methods):
    areas = [(area, _outline(area, dataset)) for area in dataset.areas]
    xy = [table[["x_m", "y_m"]].to_numpy(float), *(outline.vertices for _, outline in areas)]
    paths.frame(ax, dataset, np.vstack(xy), dataset.horizon_s)
    patches = [_draw_area(ax, area, outline, position) for position, (area, outline) in enumerate(areas)]
    paths.draw_person(ax, table)
    futures = table[table["what"] == "forecast"]
    lines = _draw_futures(ax, futures)
    mean = futures.groupby("rank")["ade_m"].first().mean()
    shown = f"{methods[futures['method'].iloc[0]]}; without ranking (mean of the {len(lines)}): ADE {mean:.2f} m"
    paths.write_key(key, [*lines, *patches], f"{text}\n{shown}")


def _draw_futures(ax, futures):
    """Draw the futures; returns their entries of the key. The best ranked is the widest, so it shows below others."""
    k, lines = int(futures["rank"].max()), []
    for rank, path in futures.groupby("rank"):
        look = {**style.method_style(int(rank) - 1), "color": shade(rank, k)}
        paths.draw_path(ax, path, look, linewidth=1.5 - 0.7 * (rank - 1) / k, place=(rank - 1) / k)
        label = f"rank {rank}: ADE {path['ade_m'].iloc[0]:.2f} m{paths.end_note(ax, path)}"
        lines.append(Line2D([], [], label=label, **look))
    return lines


def shade(rank: int, k: int) -> tuple[float, float, float, float]:
    """Blue of a rank of k, the darker the better ranked."""
    return colormaps["Blues"](1.0 - 0.58 * (rank - 1) / max(k - 1, 1))


def _outline(area: Area, dataset: Dataset) -> Outline:
    """All polygons of an area as one outline in metres, turned alike so that they unite where they overlap."""
    outlines, scale = [], 1.0 if dataset.scale is None else dataset.scale
    for polygon in area.polygons:
        corners = np.asarray(polygon, float) * scale
        x, y = corners.T
        if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0:
            corners = corners[::-1]
        outlines.append(Outline(np.vstack([corners, corners[:1]]), closed=True))
    return Outline.make_compound_path(*outlines)


def _draw_area(ax: Axes, area: Area, outline: Outline, position: int) -> Patch:
    """A light transparent patch; returns its entry of the key."""
    look: style.Look = {
        "facecolor": (AREA_COLOURS[area.colour], 0.15),
        "edgecolor": (AREA_COLOURS[area.colour], 0.35),
        "hatch": HATCHES[position % len(HATCHES)],
        "linewidth": 0.0,
    }
    ax.add_patch(PathPatch(outline, zorder=1, **look))
    return Patch(label=area.title, **look)
