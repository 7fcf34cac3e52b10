"""Figure edin_mod and its like: time-conditioned CLiFF beside STeF, all components and orientations, a few hours."""

import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.study import lacks
from modlhmp.study.exhibits import map_panels, style
from modlhmp.study.exhibits.cliff_hours import read_components
from modlhmp.study.exhibits.stef_hours import read_orientations
from modlhmp.study.layout import Layout


def draw(layout: Layout, dataset: Dataset, stem: str) -> None:
    """One row per hour: TC-CLiFF left, STeF right; transparency is the weight."""
    hours = map_panels.hours_drawn(layout, dataset, "tc_cliff")
    cliff = pd.concat([read_components(layout, dataset, hour) for hour in hours], ignore_index=True)
    cliff = pd.DataFrame(
        {
            "hour": cliff["hour"], "map": "TC-CLiFF", "x": cliff["x"], "y": cliff["y"],
            "heading": cliff["mean_heading"], "length": cliff["mean_speed"] * map_panels.ARROW_M_PER_MPS,
            "weight": cliff["weight"],
        }
    )  # fmt: skip
    stef = pd.concat([read_orientations(layout, dataset, hour) for hour in hours], ignore_index=True)
    stef = stef[stef["probability"] > 0].rename(columns={"probability": "weight"}).assign(map="STeF")
    drawn = pd.concat([cliff, stef[cliff.columns]], ignore_index=True)
    fig, axes = map_panels.panels(dataset, (drawn["x"], drawn["y"]), len(hours), 2)
    for line, hour in enumerate(hours):
        for ax, name, what in zip(axes[line], ("TC-CLiFF", "STeF"), ("components", "orientations"), strict=True):
            table = drawn[(drawn["hour"] == hour) & (drawn["map"] == name)]
            if table.empty:
                style.empty_panel(ax, f"{name}, {hour}:00–{hour + 1}:00\n{lacks.NO_MAP}")
                continue
            map_panels.arrows(ax, table.sort_values("weight"), alpha=table["weight"].sort_values())
            ax.set_title(f"{name}, {hour}:00–{hour + 1}:00, {len(table)} {what}")
    map_panels.orientation_key(
        fig, axes, dataset,
        f"{dataset.title}; colour: orientation, lighter: smaller weight or probability; length: speed "
        f"({map_panels.ARROW_M_PER_MPS:g} m for 1 m/s; STeF has none)",
    )  # fmt: skip
    style.save(fig, stem, drawn, dataset.demo)
