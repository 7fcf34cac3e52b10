"""One example track as a table of positions, what the person did and what was forecast, and how both are drawn."""

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.compute as pc
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import read_forecasts
from modlhmp.forecasting.windows import windows
from modlhmp.scenes import read_scenes
from modlhmp.scoring.errors import truth_of
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import Example
from modlhmp.tracks import read_tracks

COLUMNS = ("dataset", "recording", "track_id", "method", "what", "rank", "step_s", "x_m", "y_m", "left_map", "ade_m")
WHOLE = {"rank": "Int64", "left_map": "boolean"}  # types that may be missing, where a row is not of a forecast
PANEL = 0.72  # height / width of a panel
MARGIN, SMALLEST_M = 1.08, 4.0  # a panel shows this many times what it must, and at least this far from its centre
LINE_MM = 3.0  # of a key

# Broad bands: what the person did. Forecasts are thin lines above them.
TRUTH: style.Look = {"color": "#F0948C", "linewidth": 3.2, "solid_capstyle": "round", "zorder": 2}
OBSERVED: style.Look = {"color": "#00703C", "linewidth": 3.2, "solid_capstyle": "butt", "zorder": 2}
TRUTH_END: style.Look = {"marker": "s", "color": "#C00000", "markersize": 4, "linestyle": "none", "zorder": 7}
END: style.Look = {"markersize": 5, "markeredgecolor": "white", "markeredgewidth": 0.4, "linestyle": "none"}
LEFT_MAP: style.Look = {"marker": "x", "markersize": 5, "markeredgewidth": 1.2, "linestyle": "none"}


def person_paths(tracks_file: str | Path, track_id: int, dataset: Dataset, steps: int) -> pd.DataFrame:
    """Observed rows and truth of a track's first forecast, `COLUMNS` from `method` on; `step_s` counts from t0.

    The truth begins at t0 and is interpolated at the time steps, as for scoring.
    """
    tracks = read_tracks(tracks_file)
    track = tracks.take(tracks.track_id == track_id)
    wanted, step_s = windows(track, dataset, read_scenes(tracks_file)), dataset.time_step_s
    truth, t0 = truth_of(track, wanted, dataset)[0][0, :steps], wanted.row[0]
    rows = slice(t0 - dataset.observed_rows + 1, t0 + 1)
    observed = np.column_stack([track.x, track.y])[rows]
    return pd.concat(
        [
            _positions("observed", observed, track.t[rows] - track.t[t0]),
            _positions("truth", np.vstack([observed[-1:], truth]), np.arange(steps + 1) * step_s),
        ]
    )


def forecast_of(forecasts_file: str | Path, track_id: int) -> Forecast | None:
    """A track's first `Forecast` by the first (smallest) seed, `xy` [k, T, 2] and so on; None if the file has none."""
    seeds = read_parquet(forecasts_file, ["seed"])["seed"]
    if not len(seeds):
        return None
    first = pc.min(seeds).as_py()
    for seed, ids, forecast in read_forecasts(forecasts_file):
        row = np.flatnonzero(ids == track_id)
        if seed == first and len(row):
            xy, log_fitness, steps_alive, output = forecast
            return Forecast(xy[row[0]], log_fitness[row[0]], steps_alive[row[0]], output)
    return None


def forecast_paths(
    forecast: Forecast, order: Iterable[int], steps: int, step_s: float, start: np.ndarray
) -> pd.DataFrame:
    """Positions of the futures `order` from t0's position `start` [2] to the horizon, or to where they left the map.

    `rank` counts them in the order given. One that left the map ends at its last position on it.
    """
    paths = []
    for rank, index in enumerate(order, 1):
        lived = min(int(forecast.steps_alive[index]), steps)
        xy = np.vstack([start, forecast.xy[index, :lived]])
        path = _positions("forecast", xy, np.arange(lived + 1) * step_s)
        paths.append(path.assign(rank=rank, left_map=lived < steps))
    return pd.concat(paths)


def _positions(what, xy, step_s):
    table = pd.DataFrame({"what": what, "step_s": step_s, "x_m": xy[:, 0], "y_m": xy[:, 1]})
    return table.reindex(columns=COLUMNS[3:])


def of_example(dataset: Dataset, track: Example, tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """The tables of one example as one that says whose they are (`COLUMNS`)."""
    whose: dict[str, Any] = {"dataset": dataset.name, "recording": track.recording, "track_id": track.owner}
    return pd.concat(tables, ignore_index=True).assign(**whose)[list(COLUMNS)].astype(WHOLE)


def rule(methods: Mapping[str, str]) -> str:
    """How example tracks are chosen, for the reader of a figure."""
    first = next(iter(methods.values()))
    return (
        "Example tracks are chosen by rule: of the test tracks eligible at the horizon under the paper protocol, the "
        f"one of median ADE of {first} (complete protocol, first seed)."
    )


def who(track: Example) -> str:
    """Whose path a panel shows, and that the rule chose it."""
    return f"track {track.owner} of {track.recording}: median of {track.of} tracks"


def collect(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """The numbers behind a figure: the tables of its panels in one."""
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=COLUMNS)


def one_path(table: pd.DataFrame, what: str) -> np.ndarray:
    """Positions [n, 2] of the table's rows of one kind."""
    return table.loc[table["what"] == what, ["x_m", "y_m"]].to_numpy(float)


def sheet(datasets: Sequence[Dataset], key_lines: int, text: str) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """A figure with a panel per dataset, two in a row, and under each an empty one for a key of `key_lines` lines.

    Below them stand `text` and the legend of what all panels share. Returns the figure and a list of (panel, key).
    """
    columns = min(len(datasets), 2)
    rows, width_mm = -(-len(datasets) // columns), style.PAGE_MM if columns == 2 else style.COLUMN_MM
    wrapped = textwrap.wrap(text, round(0.86 * width_mm))
    panel_mm, key_mm = (width_mm / columns - 13.0) * PANEL, 2.0 + LINE_MM * key_lines
    below_mm = 5.0 + LINE_MM * (len(wrapped) + 3 - columns) + 4.0 * any(dataset.demo for dataset in datasets)
    height_mm = rows * (panel_mm + key_mm + 13.0) + below_mm
    fig, axes = style.figure(2 * rows, columns, width_mm, height_mm, height_ratios=[panel_mm, key_mm] * rows)
    for ax in [*axes[1::2].flat, *axes[::2].flat[len(datasets) :]]:
        ax.set_axis_off()
    fig.legend(
        handles=_shared_handles(datasets),
        loc="outside lower center",
        ncols=2 * columns,
        title="\n".join(wrapped),
        title_fontsize=6,
    )
    return fig, list(zip(axes[::2].flat, axes[1::2].flat, strict=True))[: len(datasets)]


def write_key(ax: Axes, handles: Sequence[Any], text: str) -> None:
    """The key of a panel, in the place that `sheet` keeps for it."""
    key = ax.legend(
        handles=handles,
        loc="upper center",
        borderaxespad=0,
        handlelength=3.2,
        title=text,
        title_fontsize=6,
        alignment="left",
    )
    key.set_in_layout(False)  # or a wide key would shrink the panels


def frame(ax: Axes, dataset: Dataset, xy: np.ndarray, horizon_s: float) -> None:
    """Show the extent of positions [n, 2] at equal scale over the floor plan, y downwards for images."""
    low, high = np.nanmin(xy, axis=0), np.nanmax(xy, axis=0)
    centre, half = (low + high) / 2, (high - low) / 2 * MARGIN
    half_width = max(half[0], half[1] / PANEL, SMALLEST_M)
    half = half_width * np.array([1.0, PANEL])
    ax.set(xlim=(centre[0] - half[0], centre[0] + half[0]), ylim=(centre[1] - half[1], centre[1] + half[1]))
    if style.image_coordinates(dataset):
        ax.invert_yaxis()
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=f"{dataset.title}, {horizon_s:g} s")
    ax.grid(False)
    ax.spines[:].set_visible(True)
    style.draw_floor_plan(ax, dataset)


def draw_person(ax: Axes, table: pd.DataFrame) -> None:
    """Truth and observation as broad bands; the truth's end is marked."""
    truth, observed = one_path(table, "truth"), one_path(table, "observed")
    ax.plot(*truth.T, **TRUTH)
    ax.plot(*observed.T, **OBSERVED)
    ax.plot(*truth[-1], **TRUTH_END)


def draw_path(ax: Axes, path: pd.DataFrame, look: Mapping[str, Any], linewidth: float, place: float) -> None:
    """A forecast in the look of `style.method_style`, marked along it and at its end, x where it left the map.

    `place` in [0, 1) is its place among all: later ones are drawn above and marked further on, so that paths that
    coincide can be seen.
    """
    xy, end = path[["x_m", "y_m"]].to_numpy(float), dict(look)
    places = np.rint((np.arange(4) + 0.25 + 0.5 * place) / 4 * (len(xy) - 1)).astype(int).tolist()
    marked = [step for step in places if 0 < step < len(xy) - 1]
    casing = [Stroke(linewidth=linewidth + 0.8, foreground="white", alpha=0.7), Normal()]  # seen on walls as well
    ax.plot(*xy.T, linewidth=linewidth, markevery=marked, path_effects=casing, zorder=3 + place, **look)
    end.update(LEFT_MAP if path["left_map"].iloc[0] else END)
    ax.plot(*xy[-1], zorder=5 + place, **end)


def end_note(ax: Axes, path: pd.DataFrame) -> str:
    """How a forecast ended, for keys, if not at the horizon or not in the panel."""
    if path["left_map"].iloc[0]:
        return f", left the map after {path['step_s'].max():g} s"
    (x, y), ((x0, x1), (y0, y1)) = path[["x_m", "y_m"]].iloc[-1], (sorted(ax.get_xlim()), sorted(ax.get_ylim()))
    return "" if x0 <= x <= x1 and y0 <= y <= y1 else ", ends outside the panel"


def _shared_handles(datasets):
    truth = {**TRUTH, "marker": TRUTH_END["marker"], "markersize": TRUTH_END["markersize"]}
    truth |= {"markerfacecolor": TRUTH_END["color"], "markeredgecolor": TRUTH_END["color"]}
    handles = [
        Line2D([], [], label="observed", **OBSERVED),
        Line2D([], [], label="truth, and its end", **truth),
        Line2D([], [], label="forecast left the map", color="black", **LEFT_MAP),
    ]
    if any(dataset.floor_plan for dataset in datasets):
        handles.append(Patch(label="occupied (floor plan)", color=style.WALL_COLOUR))
    return handles


def box_of(track_files: Iterable[str | Path]) -> np.ndarray:
    """Corners [2, 2] of the box of all positions of these recordings: low x and y, high x and y, in m."""
    corners = []
    for file in track_files:
        table = read_parquet(file, ["x", "y"])
        span = [pc.min_max(table[axis]).as_py() for axis in ("x", "y")]
        corners.append([[one[end] for one in span] for end in ("min", "max")])
    low, high = np.array(corners).swapaxes(0, 1)
    return np.array([low.min(axis=0), high.max(axis=0)])
