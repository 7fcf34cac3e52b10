"""One example track as a table of positions, what the person did and what was forecast, and how both are drawn."""

import textwrap
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.compute as pc
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from modlhmp.forecasting import read_forecasts
from modlhmp.forecasting.base import Forecast
from modlhmp.scoring.errors import ground_truth
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits import style
from modlhmp.tracks import read_tracks

COLUMNS = ("dataset", "recording", "track_id", "method", "what", "rank", "step_s", "x_m", "y_m", "left_map", "ade_m")
WHOLE = {"rank": "Int64", "left_map": "boolean"}  # types that may be missing, where a row is not of a forecast
PANEL = 0.72  # height / width of a panel
MARGIN, SMALLEST_M = 1.08, 4.0  # a panel shows so many times what it must, and at least so far from its centre
LINE_MM = 3.0  # of a key

# Broad bands: what the person did. Forecasts are thin lines above them.
TRUTH = {"color": "#F0948C", "linewidth": 3.2, "solid_capstyle": "round", "zorder": 2}
OBSERVED = {"color": "#00703C", "linewidth": 3.2, "solid_capstyle": "butt", "zorder": 2}
TRUTH_END = {"marker": "s", "color": "#C00000", "markersize": 4, "linestyle": "none", "zorder": 7}
END = {"markersize": 5, "markeredgecolor": "white", "markeredgewidth": 0.4, "linestyle": "none"}
LEFT_MAP = {"marker": "x", "markersize": 5, "markeredgewidth": 1.2, "linestyle": "none"}


def person_paths(tracks_file, track_id, dataset, steps):
    """Observed rows and truth of a track, `COLUMNS` from `method` on; `step_s` counts from t0.

    The truth begins at t0 and is interpolated at the time steps, as for scoring.
    """
    tracks = read_tracks(tracks_file)
    track = tracks.take(tracks.track_id == track_id)
    seen, step_s = dataset["observed_rows"], dataset["time_step_s"]
    truth, _ = ground_truth(track, np.array([[0, len(track.t) - 1]]), seen, steps, step_s)
    observed = np.column_stack([track.x, track.y])[:seen]
    return pd.concat(
        [
            _positions("observed", observed, track.t[:seen] - track.t[seen - 1]),
            _positions("truth", np.vstack([observed[-1:], truth[0]]), np.arange(steps + 1) * step_s),
        ]
    )


def forecast_of(forecasts_file, track_id):
    """A track's `Forecast` by the first (smallest) seed, `xy` [k, T, 2] and so on; None if the file has none."""
    seeds = read_parquet(forecasts_file, ["seed"])["seed"]
    if not len(seeds):
        return None
    first = pc.min(seeds).as_py()
    for seed, ids, forecast in read_forecasts(forecasts_file):
        row = np.flatnonzero(ids == track_id)
        if seed == first and len(row):
            return Forecast(*(values[row[0]] for values in forecast[:3]), forecast.output)
    return None


def rank_order(forecast, steps):
    """Indices of the k futures of a track, best ranked first, by the complete protocol.

    First those with the most steps alive up to the horizon, among these the largest cumulative log fitness there
    (paper Sec. III-C); ties stay in their order.
    """
    lived = np.minimum(forecast.steps_alive, steps)
    return np.lexsort((-forecast.log_fitness[:, steps - 1], -lived))


def forecast_paths(forecast, order, steps, step_s, start):
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


def of_example(dataset, track, tables):
    """The tables of one example as one that says whose they are (`COLUMNS`)."""
    whose = {"dataset": dataset["name"], "recording": track.recording, "track_id": track.track_id}
    return pd.concat(tables, ignore_index=True).assign(**whose)[list(COLUMNS)].astype(WHOLE)


def rule(methods):
    """How example tracks are chosen, for the reader of a figure."""
    first = next(iter(methods.values()))
    return (
        "Example tracks are chosen by rule: of the test tracks eligible at the horizon under the paper protocol, the "
        f"one of median ADE of {first} (complete protocol, first seed)."
    )


def who(track):
    """Whose path a panel shows, and that the rule chose it."""
    return f"track {track.track_id} of {track.recording}: median of {track.of} tracks"


def collect(tables):
    """The numbers behind a figure: the tables of its panels in one."""
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=COLUMNS)


def one_path(table, what):
    """Positions [n, 2] of the table's rows of one kind."""
    return table.loc[table["what"] == what, ["x_m", "y_m"]].to_numpy(float)


def sheet(datasets, key_lines, text):
    """A figure with a panel a dataset, two a row, and under each an empty one for a key of `key_lines` lines.

    Below them stand `text` and the legend of what all panels share. Returns the figure and a list of (panel, key).
    """
    columns = min(len(datasets), 2)
    rows, width_mm = -(-len(datasets) // columns), style.PAGE_MM if columns == 2 else style.COLUMN_MM
    wrapped = textwrap.wrap(text, round(0.86 * width_mm))
    panel_mm, key_mm = (width_mm / columns - 13.0) * PANEL, 2.0 + LINE_MM * key_lines
    below_mm = 5.0 + LINE_MM * (len(wrapped) + 3 - columns) + 4.0 * any(dataset["demo"] for dataset in datasets)
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


def write_key(ax, handles, text):
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


def frame(ax, dataset, xy, horizon_s):
    """Show the extent of positions [n, 2] at equal scale over the floor plan, y downwards for images."""
    low, high = np.nanmin(xy, axis=0), np.nanmax(xy, axis=0)
    centre, half = (low + high) / 2, (high - low) / 2 * MARGIN
    half_width = max(half[0], half[1] / PANEL, SMALLEST_M)
    half = half_width * np.array([1.0, PANEL])
    ax.set(xlim=(centre[0] - half[0], centre[0] + half[0]), ylim=(centre[1] - half[1], centre[1] + half[1]))
    if style.image_coordinates(dataset):
        ax.invert_yaxis()
    ax.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title=f"{dataset['title']}, {horizon_s:g} s")
    ax.grid(False)
    ax.spines[:].set_visible(True)
    style.draw_floor_plan(ax, dataset["floor_plan"])


def draw_person(ax, table):
    """Truth and observation as broad bands; the truth's end is marked."""
    truth, observed = one_path(table, "truth"), one_path(table, "observed")
    ax.plot(*truth.T, **TRUTH)
    ax.plot(*observed.T, **OBSERVED)
    ax.plot(*truth[-1], **TRUTH_END)


def draw_path(ax, path, look, linewidth, place):
    """A forecast in the look of `style.method_style`, marked along it and at its end, x where it left the map.

    `place` in [0, 1) is its place among all: later ones are drawn above and marked further on, so that paths that
    coincide can be seen.
    """
    xy, end = path[["x_m", "y_m"]].to_numpy(float), dict(look)
    marked = np.rint((np.arange(4) + 0.25 + 0.5 * place) / 4 * (len(xy) - 1)).astype(int)
    marked = [step for step in marked.tolist() if 0 < step < len(xy) - 1]
    casing = [Stroke(linewidth=linewidth + 0.8, foreground="white", alpha=0.7), Normal()]  # seen on walls as well
    ax.plot(*xy.T, linewidth=linewidth, markevery=marked, path_effects=casing, zorder=3 + place, **look)
    end.update(LEFT_MAP if path["left_map"].iloc[0] else END)
    ax.plot(*xy[-1], zorder=5 + place, **end)


def end_note(ax, path):
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
    if any(dataset["floor_plan"] for dataset in datasets):
        handles.append(Patch(label="occupied (floor plan)", color=style.WALL_COLOUR))
    return handles


def site(folder, recordings):
    """Corners of the box of all positions [m] of these recordings of a folder of tracks: [[x, y] low, [x, y] high]."""
    corners = []
    for name in recordings:
        table = read_parquet(Path(folder) / f"{name}.parquet", ["x", "y"])
        span = [pc.min_max(table[axis]).as_py() for axis in ("x", "y")]
        corners.append([[one[end] for one in span] for end in ("min", "max")])
    corners = np.array(corners)
    return np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
