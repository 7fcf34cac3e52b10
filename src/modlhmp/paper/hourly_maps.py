"""Figure cliff-atc-time and its like: time-conditioned CLiFF-maps of a few hours, heaviest component of a location."""

from pathlib import Path

import numpy as np
import pandas as pd

from modlhmp.paper import style
from modlhmp.storage import read_parquet

ARROW_M_PER_MPS = 1.0  # an arrow shows where a walker is a second later


def draw(folder, dataset, stem):
    """Draw the maps of `dataset["figure_hours"]` from a folder of {hour}.parquet."""
    hours = dataset["figure_hours"]
    tables = {hour: _heaviest(Path(folder) / f"{hour:02d}.parquet") for hour in hours}
    drawn = pd.concat([table for table in tables.values() if table is not None] or [pd.DataFrame()])
    wide = drawn.empty or np.ptp(drawn["x"]) >= np.ptp(drawn["y"])
    fig, axes = style.figure(1, len(hours), style.PAGE_MM, 58.0 if wide else 75.0, sharex=True, sharey=True)
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
    _wheel(fig, flipped=dataset["reader"].startswith("edinburgh"))
    fig.supxlabel(
        f"{dataset['title']}: TC-CLiFF map, mean of the heaviest component; colour is orientation, "
        f"length is speed (1 m drawn = {1 / ARROW_M_PER_MPS:g} m/s)",
        fontsize=6,
    )
    style.save(fig, stem, drawn.reset_index(drop=True), dataset["demo"])


def arrows(ax, table):
    """One arrow a row: columns x, y [m], mean_heading [rad], mean_speed [m/s]."""
    length = table["mean_speed"] * ARROW_M_PER_MPS
    ax.quiver(
        table["x"], table["y"], length * np.cos(table["mean_heading"]), length * np.sin(table["mean_heading"]),
        color=style.heading_colour(table["mean_heading"]), angles="xy", scale_units="xy", scale=1.0,
        width=0.0035, headwidth=4, headlength=4, headaxislength=3.5,
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


def _wheel(fig, flipped):
    """Colour key: a small wheel of orientations, in the panels' own sense of rotation."""
    ax = fig.add_axes((0.925, 0.04, 0.07, 0.2), projection="polar")
    angle = np.linspace(0, 2 * np.pi, 73)
    ax.bar(angle, np.ones(73), width=2 * np.pi / 72, color=style.heading_colour(angle), bottom=0.6)
    ax.set_theta_direction(-1 if flipped else 1)
    ax.set_axis_off()
    ax.set_in_layout(False)
