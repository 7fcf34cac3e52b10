"""Drawings of a recording: where people walk, in the terminal and as a picture with their speeds and times."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.motion import moves
from modlhmp.pictures import made_by
from modlhmp.storage import atomic_path
from modlhmp.tracks import Tracks, usual_step

MOST_TRACKS = 600
_SHADES = " .:-=+*#%@"


def text_map(tracks: Tracks, columns: int = 64, most_rows: int = 24) -> str:
    """Where rows are, as characters of different darkness; y upwards, to scale where characters are twice as high."""
    if not len(tracks.t):
        return ""
    (left, right), (low, high) = (np.quantile(part, [0.002, 0.998]) for part in (tracks.x, tracks.y))
    wide, tall = max(right - left, 1e-9), max(high - low, 1e-9)
    size = max(wide / columns, tall / (2 * most_rows))
    counts, _, _ = np.histogram2d(
        tracks.y, tracks.x, (max(int(tall / size / 2), 1), max(int(wide / size), 1)), ((low, high), (left, right))
    )
    dark = np.log1p(counts) / max(np.log1p(counts.max()), 1e-9)
    shades = np.ceil(dark * (len(_SHADES) - 1)).astype(int)
    lines = ["".join(_SHADES[shade] for shade in row).rstrip() for row in shades[::-1]]
    return "\n".join([*lines, f"{wide:.3g} m x {tall:.3g} m, from x {left:.4g}, y {low:.4g} m"])


def some_tracks(tracks: Tracks, most: int = MOST_TRACKS) -> Tracks:
    """At most so many tracks, evenly chosen."""
    number = len(tracks.bounds()) - 1
    chosen = np.linspace(0, number - 1, min(most, number)).astype(int)
    return tracks.take(np.repeat(np.isin(np.arange(number), chosen), np.diff(tracks.bounds())))


def draw(tracks: Tracks, title: str, path: str | Path) -> None:
    """Write a picture of tracks: where they go, how fast people who move are, how many are there over time.

    `ImportError` without matplotlib.
    """
    from matplotlib.collections import LineCollection  # noqa: PLC0415 - only the study installs it
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(11, 6.5), layout="constrained")
    grid: Any = figure.add_gridspec(2, 2, width_ratios=(1.7, 1))
    place, speeds, times = (figure.add_subplot(grid[at]) for at in ((slice(None), 0), (0, 1), (1, 1)))
    shown = some_tracks(tracks)
    bounds = shown.bounds()
    paths = [np.column_stack([shown.x[a:b], shown.y[a:b]]) for a, b in itertools.pairwise(bounds)]
    towards = [np.arctan2(path[-1, 1] - path[0, 1], path[-1, 0] - path[0, 0]) for path in paths]
    lines = LineCollection(paths, cmap="hsv", alpha=0.6, linewidths=0.7)
    lines.set_array(np.array(towards))
    lines.set_clim(-np.pi, np.pi)
    place.add_collection(lines)
    place.autoscale()
    place.set_aspect("equal")
    place.set(xlabel="x / m", ylabel="y / m", title=f"{len(paths)} of {len(tracks.bounds()) - 1} tracks, by direction")
    bar = figure.colorbar(lines, ax=place, ticks=[-np.pi, -np.pi / 2, 0, np.pi / 2, np.pi], shrink=0.6)
    bar.set_ticklabels(["-x", "-y", "+x", "+y", "-x"])
    step = usual_step(tracks)
    walk = moves(tracks, max(1, round(1 / step)) if step > 0 else 1)
    if len(walk.speed):
        speeds.hist(walk.speed, 60, range=(0, 3 * float(np.median(walk.speed))), color="0.45")
        speeds.axvline(float(np.median(walk.speed)), color="C3")
        speeds.axvspan(0.8, 1.8, color="C2", alpha=0.12)
    speeds.set(xlabel="speed of those who move / (m/s)", ylabel="displacements")
    speeds.set_title("line: median; green: usual medians", fontsize="medium")
    if len(tracks.t):
        times.hist((tracks.t - tracks.t.min()) / 3600, 100, color="0.45")
    times.set(xlabel="time since the first row / h", ylabel="rows")
    figure.suptitle(title)
    with atomic_path(path) as temporary:
        figure.savefig(
            temporary, format="png", dpi=110, bbox_inches="tight", metadata=made_by("png")
        )  # a place may be narrow
