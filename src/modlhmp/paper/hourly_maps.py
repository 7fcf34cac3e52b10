"""Figure cliff-atc-time and its like: time-conditioned CLiFF-maps of a few hours, heaviest component of a location."""

from pathlib import Path

import numpy as np
import pandas as pd

from modlhmp.paper import style
from modlhmp.storage import read_parquet

ARROW_M_PER_MPS = 1.0  # an arrow shows where a walker is a second later
ARROW_WIDTH = 0.0025  # of the drawn extent


def draw(folder, dataset, stem):
    """Draw the maps of `dataset["figure_hours"]` from a folder of {hour}.parquet."""
    hours = dataset["figure_hours"]
    tables = {hour: _heaviest(Path(folder) / f"{hour:02d}.parquet") for hour in hours}
    drawn = pd.concat([table for table in tables.values() if table is not None] or [pd.DataFrame()])
    fig, axes = style.figure(1, len(hours), style.PAGE_MM, _height_mm(drawn, len(hours)), sharex=True, sharey=True)
    for ax, hour in zip(axes[0], hours, strict=True):
        if tables[hour] is None:
            style.empty_panel(ax, f"{hour}:00\nno map: too few training data")
            continue
        arrows(ax, tables[hour])
        ax.set_title(f"{hour}:00–{hour + 1}:00, {len(tables[hour])} locations")
        ax.set_xlabel("x [m]")
    axes[0, 0].set_ylabel("y [m]")
    if dataset["reader"].startswith("edinburgh") and not drawn.empty:
        axes[0, 0].invert_yaxis()  # image coordinates: y grows downwards
    _colour_key(fig, axes, flipped=dataset["reader"].startswith("edinburgh"))
    fig.supxlabel(
        f"{dataset['title']}: TC-CLiFF map, mean of the heaviest component of each location; "
        f"colour: orientation, length: speed ({ARROW_M_PER_MPS:g} m drawn for 1 m/s)",
        fontsize=6,
    )
    style.save(fig, stem, drawn.reset_index(drop=True), dataset["demo"])


def arrows(ax, table):
    """One arrow a row: columns x, y [m], mean_heading [rad], mean_speed [m/s]."""
    length = table["mean_speed"] * ARROW_M_PER_MPS
    ax.quiver(
        table["x"], table["y"], length * np.cos(table["mean_heading"]), length * np.sin(table["mean_heading"]),
        color=style.heading_colour(table["mean_heading"]), angles="xy", scale_units="xy", scale=1.0,
        width=ARROW_WIDTH * max(np.ptp(table["x"]), np.ptp(table["y"]), 30.0), units="xy",
        headwidth=3.2, headlength=3.5, headaxislength=3.2, minlength=0,
    )  # fmt: skip
    ax.set_aspect("equal")
    ax.margins(0.03)
    ax.grid(False)


def _heaviest(path):
    if not path.exists():
        return None
    table = read_parquet(path).to_pandas()
    rows = table.loc[table.groupby("location")["weight"].idxmax()]
    return rows.assign(hour=int(path.stem))[["hour", "x", "y", "mean_heading", "mean_speed", "weight", "p"]]


def _height_mm(drawn, panels):
    """Height of the page that a row of panels of equal aspect needs."""
    if drawn.empty:
        return 50.0
    width = (style.PAGE_MM - 30.0) / panels
    return float(np.clip(width * np.ptp(drawn["y"]) / max(np.ptp(drawn["x"]), 1.0) + 24.0, 45.0, 160.0))


def _colour_key(fig, axes, flipped):
    """Colour key of orientation, in the directions of the page."""
    ax = fig.colorbar(style.orientation_scale(), ax=list(axes[0]), shrink=0.9, pad=0.01, aspect=25)
    names = ["right", "down", "left", "up", "right"] if flipped else ["right", "up", "left", "down", "right"]
    ax.set_ticks(np.arange(5) * np.pi / 2, labels=names)
    ax.outline.set_linewidth(0.3)
