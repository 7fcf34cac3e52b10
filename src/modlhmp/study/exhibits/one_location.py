"""Figure cliff-atc-time-one-location and its like: CLiFF at one busy place, hour by hour and for the whole day."""

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.maps.base import hour_files
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.cliff_hours import read_components
from modlhmp.study.layout import Layout

COLUMNS_OF_PANELS = 5


def draw(layout: Layout, dataset: Dataset, stem: str) -> None:
    """Panels of one location: its components in every hour's map, and in the whole day's."""
    hours = dataset.listed_hours or list(hour_files(layout.map(dataset.name, "tc_cliff")))
    by_hour = {hour: read_components(layout, dataset, hour) for hour in hours}
    day = read_parquet(layout.map(dataset.name, "cliff")).to_pandas()
    place = busy_location(by_hour, day)
    titles = {f"{hour}:00": table for hour, table in by_hour.items()} | {"whole day": day}
    here = {title: _at(table, place) for title, table in titles.items()}
    rows = -(-len(titles) // COLUMNS_OF_PANELS)
    fig, axes = style.figure(rows, COLUMNS_OF_PANELS, height_mm=14.0 + rows * 20.0)
    fastest = max([float(table["mean_speed"].max()) for table in here.values() if len(table)], default=1.0)
    for ax, (title, table) in zip(axes.flat, here.items(), strict=False):
        if table.empty:
            style.empty_panel(ax, f"{title}\n{lacks.NOT_HERE}")
        else:
            _panel(ax, table, 1.08 * fastest, style.image_coordinates(dataset))
            ax.set_title(f"{title}\nn {table['count'].iloc[0]}", fontsize=6)
    for ax in axes.flat[len(here) :]:
        ax.set_axis_off()
    where = f"{lacks.NO_LOCATION}" if place is None else f"({place[0]:g}, {place[1]:g}) m"
    fig.supxlabel(
        f"{dataset.title}, CLiFF at {where}: mean of each component;\n"
        "colour: orientation, lighter: smaller weight, circle: 1 m/s, n: observations",
        fontsize=6,
    )
    drawn = pd.concat([table.assign(map=title) for title, table in here.items()], ignore_index=True)
    style.save(fig, stem, drawn[["map", "x", "y", "mean_heading", "mean_speed", "weight", "count"]], dataset.demo)


def busy_location(by_hour: dict[int, pd.DataFrame], day: pd.DataFrame) -> tuple[float, float] | None:
    """(x, y) [m] of the location whose quietest hour is the busiest, by observations; None if there is none.

    An hour in which a location is not mapped counts 0; ties go to the busier whole day, then to the first.
    """
    counts = day.groupby(["x", "y"])["count"].first().to_frame("day")
    mapped = [table for table in by_hour.values() if len(table)]
    if counts.empty or not mapped:
        return None
    hourly = pd.concat([table.groupby(["x", "y"])["count"].first() for table in mapped], axis=1)
    counts["quietest"] = hourly.reindex(counts.index).fillna(0).min(axis=1)
    return counts.sort_values(["quietest", "day"], ascending=False, kind="stable").index[0]


def _at(table, place):
    if place is None or table.empty:
        return table.iloc[:0]
    return table[np.isclose(table["x"], place[0]) & np.isclose(table["y"], place[1])]


def _panel(ax, table, reach, flipped):
    """Arrows from the origin; the circle is 1 m/s."""
    table = table.sort_values("weight")
    colours = style.heading_colour(table["mean_heading"])
    colours[:, 3] = np.clip(table["weight"], 0.08, 1.0)
    u, v = (table["mean_speed"] * part(table["mean_heading"]) for part in (np.cos, np.sin))
    nothing = np.zeros(len(table))
    ax.quiver(nothing, nothing, u, v, color=colours, angles="xy", scale_units="xy", scale=1.0, units="width",
              width=0.045, headwidth=3.2, headlength=3.5, headaxislength=3.2, minlength=0)  # fmt: skip
    turn = np.linspace(0, 2 * np.pi, 90)
    ax.plot(np.cos(turn), np.sin(turn), color="0.6", linewidth=0.4)
    ax.set(xlim=(-reach, reach), ylim=(reach, -reach) if flipped else (-reach, reach), xticks=[], yticks=[])
    ax.set_aspect("equal")
    ax.grid(False)
    for side in ax.spines.values():
        side.set_visible(False)
