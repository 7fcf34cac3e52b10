"""Pictures of maps, which need matplotlib: the colours of orientation, and arrows where people walk."""

import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from modlhmp.floor_plan import OCCUPIED, load_floor_plan
from modlhmp.storage import DataError, atomic_path, column
from modlhmp.version import __version__

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Of the circle of orientations: east blue, north orange, west red, south green, and in between.
ORIENTATION_COLOURS = [
    "#0072B2", "#7A5FA8", "#E69F00", "#C8501E", "#B03030", "#6E7A3A", "#009E73", "#00838F", "#0072B2",
]  # fmt: skip
MOST_VECTORS = 1500  # more arrows in a panel become pixels in a PDF, which would be megabytes large
MOST_WALKS = 400  # drawn of a map that stores walks
ARROW_OF_CELL = 0.85  # length of an arrow without a speed, of a cell
MARGIN_M = 1.0
NEAR_M = 6.0  # of a path; what is farther is not shown
FORMATS = {".png", ".pdf", ".svg"}


def orientation_colours() -> Any:
    """The cyclic colour map of orientations, of a share of a turn from 0 to 1."""
    from matplotlib.colors import LinearSegmentedColormap  # noqa: PLC0415 - only the study installs it

    return LinearSegmentedColormap.from_list("orientation", ORIENTATION_COLOURS)


def arrows(
    ax: "Axes", x: np.ndarray, y: np.ndarray, heading: np.ndarray, length: np.ndarray, alpha: np.ndarray | None = None
) -> None:
    """Arrows from x, y [n] in m with a heading [rad] and a length [m]; `alpha` [n] in 0..1 makes them transparent."""
    colours = orientation_colours()(np.mod(np.asarray(heading) / (2 * np.pi), 1.0))
    if alpha is not None:
        colours[:, 3] = np.clip(alpha, 0.0, 1.0)
    extent = max(np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim()), 20.0)
    ax.quiver(
        x, y, length * np.cos(heading), length * np.sin(heading), color=colours, angles="xy", scale_units="xy",
        scale=1.0, units="xy", width=0.0025 * extent, headwidth=3.2, headlength=3.5, headaxislength=3.2, minlength=0,
        zorder=2, rasterized=len(x) > MOST_VECTORS,
    )  # fmt: skip


def draw_map(
    kind: str, table: pa.Table, path: str | Path, title: str = "", floor_plan: str | Path | None = None
) -> None:
    """Draw a map's table of one time to a PNG, PDF or SVG file.

    Of a CLiFF-map every component (length: metres in a second; paler: lighter), of a STeF-map the likeliest direction
    of each cell, of a map that stores walks some of them. `DataError` without matplotlib, or for what is not drawn.
    """
    figure, ax = new_figure(path, title)
    if kind in {"episodes", "pooled", "snippets"}:
        xy = _walks(ax, kind, table)
    else:
        x, y, heading, length, alpha = _arrows_of(kind, table)
        xy = _ends(x, y, heading, length)
        frame(ax, xy)
        arrows(ax, x, y, heading, length, alpha)
    frame(ax, xy)
    if floor_plan is not None:
        draw_walls(ax, floor_plan)
    orientation_key(figure, ax)
    save(figure, path)


def new_figure(path: str | Path, title: str) -> tuple["Figure", "Axes"]:
    """A figure with one panel in metres; `DataError` without matplotlib, or for a path of no known format."""
    if importlib.util.find_spec("matplotlib") is None:
        raise DataError('a picture needs matplotlib: pip install "modlhmp[study]"')
    if Path(path).suffix not in FORMATS:
        raise DataError(f"{path}: a picture is a file that ends in {', '.join(sorted(FORMATS))}")
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(9, 7), layout="constrained")
    ax = figure.add_subplot()
    ax.set(xlabel="x / m", ylabel="y / m", title=title)
    ax.set_aspect("equal")
    return figure, ax


def frame(ax: "Axes", xy: np.ndarray) -> None:
    """Limits around positions [n, 2], a margin included; `DataError` where there are none."""
    if not len(xy):
        raise DataError("the map is empty: there is nothing to draw")
    (left, low), (right, high) = xy.min(axis=0) - MARGIN_M, xy.max(axis=0) + MARGIN_M
    ax.set(xlim=(left, right), ylim=(low, high))


def orientation_key(figure: "Figure", ax: "Axes") -> None:
    """The key of the orientations' colours."""
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415
    from matplotlib.colors import Normalize  # noqa: PLC0415

    key = figure.colorbar(ScalarMappable(Normalize(0, 2 * np.pi), orientation_colours()), ax=ax, shrink=0.6)
    key.set_ticks((np.arange(5) * np.pi / 2).tolist(), labels=["+x", "+y", "-x", "-y", "+x"])


def draw_walls(ax: "Axes", floor_plan: str | Path) -> None:
    """Occupied cells of a floor plan of map_server, beneath the data of `ax`, whose limits stay."""
    from matplotlib.transforms import Affine2D  # noqa: PLC0415

    plan, limits = load_floor_plan(floor_plan), (ax.get_xlim(), ax.get_ylim())
    rows, columns = plan.cells.shape
    shade = np.where(plan.cells == OCCUPIED, 180, 255).astype(np.uint8)
    ax.imshow(
        np.repeat(shade[..., None], 3, axis=-1), origin="lower", interpolation="nearest", zorder=0,
        extent=(0, columns * plan.resolution, 0, rows * plan.resolution),
        transform=Affine2D().rotate(plan.yaw).translate(*plan.origin) + ax.transData,
    )  # fmt: skip
    ax.set(xlim=limits[0], ylim=limits[1])


_MADE_BY = {"png": ("Software", ""), "pdf": ("Creator", "CreationDate"), "svg": ("Creator", "Date")}


def made_by(suffix: str) -> dict[str, str | None]:
    """Metadata that say what made a picture, for `savefig`; without a date, so that the same one is the same bytes."""
    maker, date = _MADE_BY[suffix]
    return {maker: f"modlhmp {__version__}", **({date: None} if date else {})}


def save(figure: "Figure", path: str | Path) -> None:
    """Write a figure in the format that its name says."""
    try:
        with atomic_path(path) as temporary:
            suffix = Path(path).suffix[1:]
            figure.savefig(temporary, format=suffix, dpi=150, bbox_inches="tight", metadata=made_by(suffix))
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error})") from None


def _arrows_of(kind: str, table: pa.Table) -> tuple[np.ndarray, ...]:
    """x, y, heading, length and alpha of a map's arrows."""
    names = set(table.column_names)
    if {"mean_heading", "mean_speed"} <= names:
        x, y, heading, speed, weight = (
            column(table, name).astype(float) for name in ("x", "y", "mean_heading", "mean_speed", "weight")
        )
        return x, y, heading, speed, 0.15 + 0.85 * weight
    if "probabilities" not in names:
        raise DataError(f"a map of kind {kind} is not drawn; cliff, tc_cliff, stef, episodes, pooled and snippets are")
    found = column(table, "probabilities").reshape(table.num_rows, -1)
    found, x, y = (part[found.any(axis=1)] for part in (found, column(table, "x"), column(table, "y")))
    heading = found.argmax(axis=1) * 2 * np.pi / found.shape[1]
    length = np.full(len(x), ARROW_OF_CELL * float(table.schema.metadata[b"resolution"]))
    return x, y, heading, length, found.max(axis=1, initial=0)


def _ends(x: np.ndarray, y: np.ndarray, heading: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Where arrows begin, and their tips [2 n, 2]."""
    tips = np.column_stack([x + length * np.cos(heading), y + length * np.sin(heading)])
    return np.vstack([np.column_stack([x, y]), tips])


def _walks(ax: "Axes", kind: str, table: pa.Table) -> np.ndarray:
    """Draw some walks that a map stores, by the direction from first to last; returns their positions [n, 2]."""
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    start = np.column_stack([column(table, name).astype(float) for name in ("x", "y")])
    if "person" in table.column_names:
        person = column(table, "person")
        lines = np.split(start, np.flatnonzero(np.diff(person)) + 1)
    else:
        width = table.schema.field("path").type.list_size // 2
        lines = list(column(table, "path").reshape(-1, width, 2).astype(float) + start[:, None])
    chosen = np.linspace(0, len(lines) - 1, min(len(lines), MOST_WALKS)).astype(int)
    shown = [lines[at] for at in chosen]
    turn = [np.arctan2(*(line[-1] - line[0])[::-1]) / (2 * np.pi) % 1 for line in shown]
    ax.add_collection(LineCollection(shown, colors=orientation_colours()(turn), linewidths=0.7, alpha=0.7, zorder=2))
    return np.concatenate(shown) if shown else np.empty((0, 2))


def draw_path(
    cost: Any, kind: str, table: pa.Table, path: str | Path, title: str, floor_plan: str | Path | None = None
) -> None:
    """A `planning.PathCost` over its map, whose arrows are pale: colour is the upstream cost per metre."""
    figure, ax = new_figure(path, title)
    from matplotlib.collections import LineCollection  # noqa: PLC0415

    way = np.column_stack([cost.x, cost.y])
    half = 0.5 * cost.length[:, None] * np.column_stack([np.cos(cost.direction), np.sin(cost.direction)])
    x, y, heading, length, alpha = _arrows_of(kind, table)
    near = np.hypot(x[:, None] - way[::4, 0], y[:, None] - way[::4, 1]).min(axis=1) < NEAR_M
    x, y, heading, length, alpha = (part[near] for part in (x, y, heading, length, alpha))
    frame(ax, np.vstack([way, _ends(x, y, heading, length)]))
    arrows(ax, x, y, heading, length, 0.5 * alpha)
    if floor_plan is not None:
        draw_walls(ax, floor_plan)
    pieces, known = np.stack([way - half, way + half], axis=1), cost.mapped
    line = LineCollection(list(pieces[known]), cmap="inferno_r", linewidths=4, zorder=3)
    line.set_array(cost.upstream[known])
    line.set_clim(0, max(float(cost.upstream.max()), 0.1))
    ax.add_collection(line)
    if not known.all():
        beyond = np.where(known[:, None], np.nan, way)
        ax.plot(*beyond.T, "--", color="0.5", linewidth=3, zorder=3, label="the map knows nobody here")
        ax.legend(frameon=False)
    ax.plot(*way[0], "o", color="black", markersize=9, zorder=4)
    ax.plot(*way[-1], "X", color="black", markersize=11, zorder=4)
    figure.colorbar(line, ax=ax, shrink=0.6, label="upstream cost per metre (from o to x)")
    save(figure, path)
