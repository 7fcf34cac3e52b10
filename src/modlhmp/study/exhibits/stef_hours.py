"""Figure stef-atc-time and its like: STeF-maps of a few hours, the dominant orientation of each cell."""

from pathlib import Path

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits import map_panels, style
from modlhmp.study.layout import Layout

ARROW_OF_CELL = 0.85  # length of an arrow, of a cell


def draw(layout: Layout, dataset: Dataset, stem: str) -> None:
    """Draw the STeF-maps of a few hours, one per panel."""
    hours = map_panels.hours_drawn(layout, dataset, "stef")
    tables = {hour: read_orientations(layout, dataset, hour) for hour in hours}
    tables = {hour: dominant(table) for hour, table in tables.items()}
    drawn = pd.concat(tables.values(), ignore_index=True)
    fig, axes = map_panels.panels(dataset, (drawn["x"], drawn["y"]), 1, len(hours))
    for ax, (hour, table) in zip(axes[0], tables.items(), strict=True):
        if table.empty:
            style.empty_panel(ax, f"{hour}:00–{hour + 1}:00\n{lacks.NO_CELL}")
            continue
        map_panels.arrows(ax, table)
        ax.set_title(f"{hour}:00–{hour + 1}:00, {len(table)} cells")
    map_panels.orientation_key(
        fig, axes, dataset,
        f"{dataset.title}, STeF-map in the middle of the hour: dominant orientation of each cell (colour); "
        "the map has no speed, all arrows are equally long",
    )  # fmt: skip
    style.save(fig, stem, drawn[["hour", "x", "y", "heading", "probability"]], dataset.demo)


def read_orientations(layout: Layout, dataset: Dataset, hour: int) -> pd.DataFrame:
    """An hour's STeF-map, one row per cell and orientation; empty where the hour has no map.

    Columns: hour, x, y [m], heading [rad], probability, length of its arrow [m].
    """
    path = Path(layout.map_hour(dataset.name, "stef", hour))
    if not path.exists():
        return pd.DataFrame(columns=["hour", "x", "y", "heading", "probability", "length"], dtype=float)
    table = read_parquet(path)
    probabilities = np.stack(table["probabilities"].to_numpy(zero_copy_only=False))
    cells, orientations = probabilities.shape
    heading = np.arange(orientations) * 2 * np.pi / orientations
    return pd.DataFrame(
        {
            "hour": hour,
            "x": np.repeat(table["x"].to_numpy(), orientations),
            "y": np.repeat(table["y"].to_numpy(), orientations),
            "heading": np.tile(np.where(heading > np.pi, heading - 2 * np.pi, heading), cells),
            "probability": probabilities.ravel(),
            "length": ARROW_OF_CELL * float(table.schema.metadata[b"resolution"]),
        }
    )


def dominant(table: pd.DataFrame) -> pd.DataFrame:
    """The likeliest orientation of each cell that has dynamics (ties: the first)."""
    alive = table[table["probability"] > 0]
    return alive.loc[alive.groupby(["x", "y"])["probability"].idxmax()]
