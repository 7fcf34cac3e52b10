"""What the figures of maps share: panels of one extent over the floor plan, arrows, and the key of orientation."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from modlhmp import pictures
from modlhmp.datasets import Dataset
from modlhmp.maps.base import hour_files
from modlhmp.study.exhibits import style
from modlhmp.study.layout import Layout

ARROW_M_PER_MPS = 1.0  # an arrow shows where a walker is a second later
MARGIN_M = 1.0


def hours_drawn(layout: Layout, dataset: Dataset, kind: str) -> list[int]:
    """Hours whose maps are drawn: the dataset's `figure_hours`, or the first, a middle and the last with a map."""
    mapped = list(hour_files(layout.map(dataset.name, kind)))
    some = sorted({mapped[0], mapped[(len(mapped) - 1) // 2], mapped[-1]}) if mapped else [0]
    return list(dataset.figure_hours) or some


def panels(
    dataset: Dataset,
    positions: tuple[np.ndarray | pd.Series, np.ndarray | pd.Series],
    rows: int,
    columns: int,
    width_mm: float = style.PAGE_MM,
) -> tuple[Figure, np.ndarray]:
    """A figure and its axes [rows, columns], all over the extent of `positions` (x, y: arrays [n] in m).

    The floor plan lies beneath; y grows downwards where it does in the recordings.
    """
    x, y = positions
    has_data = len(x) > 0
    width = np.ptp(x) + 2 * MARGIN_M if has_data else 1.0
    height = np.ptp(y) + 2 * MARGIN_M if has_data else 0.6
    panel_mm = (width_mm - 26.0) / columns - 4.0
    height_mm = np.clip(rows * (panel_mm * height / width + 7.0) + 15.0, 48.0, 230.0)
    fig, axes = style.figure(rows, columns, width_mm, height_mm, sharex=True, sharey=True)
    if has_data:
        for ax in axes.flat:
            ax.set(xlim=(x.min() - MARGIN_M, x.max() + MARGIN_M), ylim=(y.min() - MARGIN_M, y.max() + MARGIN_M))
            ax.set_aspect("equal")
            ax.grid(False)
            style.draw_floor_plan(ax, dataset)
        if style.image_coordinates(dataset):
            axes[0, 0].invert_yaxis()
    for ax in axes[-1]:
        ax.set_xlabel("x [m]")
    for ax in axes[:, 0]:
        ax.set_ylabel("y [m]")
    return fig, axes


def arrows(ax: Axes, table: pd.DataFrame, alpha: np.ndarray | pd.Series | None = None) -> None:
    """One arrow per row of `table`: x, y [m], heading [rad], length [m]; `alpha` [n] in 0..1 makes it transparent."""
    x, y, heading, length = (table[name].to_numpy(float) for name in ("x", "y", "heading", "length"))
    pictures.arrows(ax, x, y, heading, length, None if alpha is None else np.asarray(alpha))


def orientation_key(fig: Figure, axes: np.ndarray, dataset: Dataset, note: str) -> None:
    """Key of orientation in the directions of the page, and a note below the panels."""
    key = fig.colorbar(style.orientation_scale(), ax=axes.ravel().tolist(), shrink=0.9, pad=0.01, aspect=25)
    names = ["right", "up", "left", "down", "right"]
    if style.image_coordinates(dataset):
        names = ["right", "down", "left", "up", "right"]
    key.set_ticks((np.arange(5) * np.pi / 2).tolist(), labels=names)
    key.ax.tick_params(labelsize=6)
    key.outline.set_linewidth(0.3)
    fig.supxlabel(note, fontsize=6)
