"""Figure cliff-atc-time and its like: time-conditioned CLiFF-maps of a few hours, heaviest component of a location."""

from pathlib import Path

import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits import map_panels, style
from modlhmp.study.layout import Layout

COLUMNS = ["hour", "x", "y", "mean_heading", "mean_speed", "weight", "p"]


def draw(layout: Layout, dataset: Dataset, stem: str) -> None:
    """Draw the TC-CLiFF-maps of a few hours, one per panel."""
    hours = map_panels.hours_drawn(layout, dataset, "tc_cliff")
    tables = {hour: read_components(layout, dataset, hour) for hour in hours}
    tables = {hour: table.loc[table.groupby("location")["weight"].idxmax()] for hour, table in tables.items()}
    drawn = pd.concat(tables.values(), ignore_index=True)
    fig, axes = map_panels.panels(dataset, (drawn["x"], drawn["y"]), 1, len(hours))
    for ax, (hour, table) in zip(axes[0], tables.items(), strict=True):
        if table.empty:
            style.empty_panel(ax, f"{hour}:00–{hour + 1}:00\n{lacks.NO_MAP}")
            continue
        length = table["mean_speed"] * map_panels.ARROW_M_PER_MPS
        map_panels.arrows(ax, table.assign(heading=table["mean_heading"], length=length))
        ax.set_title(f"{hour}:00–{hour + 1}:00, {len(table)} locations")
    map_panels.orientation_key(
        fig, axes, dataset,
        f"{dataset.title}, TC-CLiFF-map: mean of the heaviest component of each location; "
        f"colour: orientation, length: speed ({map_panels.ARROW_M_PER_MPS:g} m drawn for 1 m/s)",
    )  # fmt: skip
    style.save(fig, stem, drawn[COLUMNS], dataset.demo)


def read_components(layout: Layout, dataset: Dataset, hour: int) -> pd.DataFrame:
    """One row per component of an hour's CLiFF-map, with its hour; empty where the hour has no map."""
    path = Path(layout.map_hour(dataset.name, "tc_cliff", hour))
    if not path.exists():
        return pd.DataFrame(columns=[*COLUMNS, "location", "count"], dtype=float)
    return read_parquet(path).to_pandas().assign(hour=hour)
