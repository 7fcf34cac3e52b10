"""How every exhibit looks: one place for sizes, colours, lines and the labels that keep results honest."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.floor_plan import coarser, load_floor_plan, moved
from modlhmp.pictures import made_by, orientation_colours
from modlhmp.storage import atomic_path, write_text
from modlhmp.study.csv_cells import csv_text

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from matplotlib.transforms import Affine2D

Look = dict[str, Any]  # options of lines and patches

MM = 1 / 25.4
COLUMN_MM, PAGE_MM = 88.0, 180.0
LEGEND_HANDLE_MM, LEGEND_LETTER_MM, LEGEND_ROW_MM = 9.0, 1.1, 3.0  # of a legend's entries at 6 points

# Okabe and Ito's palette, then Tol's: told apart by colour-blind people; lines and markers tell methods apart in grey.
_COLOURS = (
    *("#0072B2", "#D55E00", "#009E73", "#000000", "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F", "#8B4513"),
    *("#882255", "#332288", "#999933"),
)
_LINES = (
    *("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (7, 2)), (0, (2, 2))),
    *((0, (9, 1)), (0, (8, 2, 1, 2)), (0, (4, 1, 1, 1, 1, 1))),
)
_MARKERS = "osD^vPX*h<>p"

_PLAN_GREYS = (255, 240, 205)  # free, unknown, occupied
WALL_COLOUR = str(_PLAN_GREYS[2] / 255)
_PLAN_PIXELS = 600  # of a floor plan's shorter side, at least

ORIENTATION = orientation_colours()

mpl.rcParams.update(
    {
        "font.size": 7,
        "axes.titlesize": 7,
        "axes.labelsize": 7,
        "xtick.labelsize": 6,
        "ytick.labelsize": 6,
        "legend.fontsize": 6,
        "axes.linewidth": 0.5,
        "xtick.major.width": 0.5,
        "ytick.major.width": 0.5,
        "lines.linewidth": 1.0,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "legend.frameon": False,
        "figure.dpi": 100,
        "savefig.dpi": 300,
        "pdf.fonttype": 42,
        "figure.constrained_layout.use": True,
        "axes.grid": True,
        "grid.linewidth": 0.3,
        "grid.alpha": 0.4,
    }
)


def method_style(position: int) -> dict[str, Any]:
    """Line colour, style and marker of the method at a position of the tables, no two alike."""
    lap = position // len(_COLOURS)  # the colours come again, with other lines and markers
    return {
        "color": _COLOURS[position % len(_COLOURS)],
        "linestyle": _LINES[(position + 7 * lap) % len(_LINES)],
        "marker": _MARKERS[(position + 5 * lap) % len(_MARKERS)],
        "markersize": 2.5,
    }


def line_of(position: int) -> Line2D:
    """A line for legends in the style of a position."""
    return Line2D([], [], **method_style(position))


def figure(
    rows: int, columns: int, width_mm: float = COLUMN_MM, height_mm: float = 60.0, **options: Any
) -> tuple[Figure, np.ndarray]:
    """A figure of printed size and its axes [rows, columns]."""
    return plt.subplots(rows, columns, figsize=(width_mm * MM, height_mm * MM), squeeze=False, **options)


def plain_numbers(axis: Axis) -> None:
    """Label a logarithmic axis, once all is drawn, with numbers as people write them: 30, 50, 100."""
    low, high = axis.get_view_interval()
    decades = np.log10(high / low) if low > 0 else np.nan
    if decades < 0.5:
        axis.set_major_locator(MaxNLocator(4))
    elif decades < 2:
        axis.set_major_locator(LogLocator(subs=(1, 2, 3, 5) if decades < 1.5 else (1, 3)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def legend_below(fig: Figure, handles: Sequence[Any], labels: Sequence[str], note: str, most: int = 3) -> None:
    """A legend under the panels: as many columns as fit, `most` at most, the figure made higher by its rows."""
    width_mm, height_mm = (inches / MM for inches in fig.get_size_inches())
    column_mm = LEGEND_HANDLE_MM + LEGEND_LETTER_MM * max(map(len, labels))
    columns = int(np.clip(width_mm // column_mm, 1, most))
    rows = -(-len(labels) // columns)
    fig.set_size_inches(width_mm * MM, (height_mm + LEGEND_ROW_MM * rows) * MM)
    fig.legend(handles, labels, loc="outside lower center", ncols=columns, title=note, title_fontsize=6)


def heading_colour(heading: np.ndarray | pd.Series) -> np.ndarray:
    """Colours [n, 4] (RGBA) of headings [n] in rad."""
    return ORIENTATION(np.mod(np.asarray(heading) / (2 * np.pi), 1.0))


def orientation_scale() -> mpl.cm.ScalarMappable:
    """Mappable of the orientation colours, 0 to 2 pi, for colour keys."""
    return mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, 2 * np.pi), ORIENTATION)


def draw_floor_plan(axes: Axes, dataset: Dataset) -> None:
    """Draw a dataset's floor plan, if it has one, under the data of `axes`, whose limits it keeps."""
    if not dataset.floor_plan:
        return
    plan = moved(load_floor_plan(dataset.floor_plan[0]), dataset.origin_m)
    limits = axes.get_xlim(), axes.get_ylim()
    cells, width = coarser(plan, _PLAN_PIXELS)
    rows, columns = (size * width for size in cells.shape)
    shade = np.repeat(np.array(_PLAN_GREYS, np.uint8)[cells][..., None], 3, axis=-1)
    size = (0, columns * plan.resolution, 0, rows * plan.resolution)
    place = Affine2D().rotate(plan.yaw).translate(*plan.origin)
    axes.imshow(shade, origin="lower", extent=size, transform=place + axes.transData, interpolation="nearest", zorder=0)
    axes.set(xlim=limits[0], ylim=limits[1])


def image_coordinates(dataset: Dataset) -> bool:
    """Whether y grows downwards in a dataset's recordings, as in images."""
    return dataset.reader.startswith("edinburgh")


def empty_panel(axes: Axes, text: str) -> None:
    """A labelled empty panel where there is nothing to draw."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes, wrap=True)


def save(fig: Figure, stem: str, numbers: pd.DataFrame, demo: bool) -> None:
    """Save `stem`.pdf, .png and .csv (the plotted numbers); demo data are labelled as such."""
    if demo:
        fig.suptitle("Demo data (made-up people)", fontsize=7, color="#B03030")
    for suffix in ("pdf", "png"):
        with atomic_path(Path(f"{stem}.{suffix}")) as temporary:
            fig.savefig(temporary, format=suffix, metadata=made_by(suffix))
        fig.set_layout_engine("none")  # laid out once, which takes as long as drawing
    plt.close(fig)
    write_text(f"{stem}.csv", csv_text(numbers, float_format="%.6g"))
