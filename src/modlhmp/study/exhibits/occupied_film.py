"""Figure occupied-film: one moment with many people, which cells were said to be occupied then, and who was there."""

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, PowerNorm
from matplotlib.lines import Line2D

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits import paths, style
from modlhmp.study.layout import Layout
from modlhmp.study.occupied import CELL_M, FILM, film_steps

SHADES = LinearSegmentedColormap.from_list("occupied", ["#FFFFFF00", "#8FC7EA", "#0072B2", "#00243A"])
LEAST = 0.01  # probability that is drawn
BROAD = 0.6  # of height to width: panels of broader places stand one above the other
NOW: style.Look = {"marker": ".", "color": "#E69F00", "markersize": 2.5, "linestyle": "none", "zorder": 4}
TRUTH: style.Look = {**paths.TRUTH_END, "markersize": 3.5, "markerfacecolor": "none", "markeredgewidth": 0.7}


def draw(layout: Layout, dataset: Dataset, stem: str, title: str) -> None:
    """A sixth, a third and two thirds of the horizon after one moment; `title` is the method's."""
    table = read_parquet(layout.occupied(dataset.name, "film")).to_pandas()
    if table.empty:
        fig, ((ax,),) = style.figure(1, 1)
        style.empty_panel(ax, f"{dataset.title}\n{lacks.NOBODY}")
        style.save(fig, stem, table, dataset.demo)
        return
    wanted = np.array(film_steps(dataset.steps)) * dataset.time_step_s
    shown = table[np.isclose(table["at_s"].to_numpy()[:, None], [0.0, *wanted]).any(axis=1)]
    drawn = shown[(shown["p"] >= LEAST) | (shown["what"] == "person")]
    (low_x, low_y), (high_x, high_y) = ((getattr(drawn[["x", "y"]], end)()) for end in ("min", "max"))
    now = table[(table["what"] == "person") & (table["at_s"] == 0)]
    shape = (high_y - low_y + 4) / (high_x - low_x + 4)
    rows = len(FILM) if shape < BROAD else 1
    width_mm = (style.PAGE_MM - 22) * rows / len(FILM)
    fig, axes = style.figure(rows, len(FILM) // rows, style.PAGE_MM, rows * (width_mm * shape + 14) + 14)
    for ax, at_s in zip(axes.ravel(), wanted, strict=True):
        then = drawn[np.isclose(drawn["at_s"], at_s)]
        cells, people = then[then["what"] == "cell"], then[then["what"] == "person"]
        ax.set(xlim=(low_x - 2, high_x + 2), ylim=(low_y - 2, high_y + 2), aspect="equal")
        style.draw_floor_plan(ax, dataset)
        grid, extent = _image(cells, (low_x, high_x, low_y, high_y))
        limits = ax.get_xlim(), ax.get_ylim()
        image = ax.imshow(grid, origin="lower", extent=extent, cmap=SHADES, norm=PowerNorm(0.5, 0, 1), zorder=1.5)
        ax.plot(now["x"], now["y"], **NOW)
        ax.plot(people["x"], people["y"], **TRUTH)
        ax.set(xlim=limits[0], ylim=limits[1][:: -1 if style.image_coordinates(dataset) else 1])
        ax.set_title(
            f"after {at_s:g} s\n{cells['p'].sum():.1f} cells foretold, {len(people)} of {len(now)} still there"
        )
        ax.grid(False)
    for ax in axes[-1]:
        ax.set_xlabel("x [m]")
    for ax in axes[:, 0]:
        ax.set_ylabel("y [m]")
    fig.colorbar(image, ax=axes, shrink=0.5, label="probability of a cell")
    keys = [Line2D([], [], **NOW), Line2D([], [], **TRUTH)]
    note = f"{dataset.title}; {title}, with a map of people of other half-hours"
    fig.legend(keys, ["people at t0", "where they were then"], loc="outside lower center", ncols=2, title=note)
    style.save(fig, stem, shown, dataset.demo)


def _image(cells, box):
    """Probabilities [rows, columns] of cells within (x low, x high, y low, y high), and what they cover."""
    low, high = (np.floor(np.array(box[part::2]) / CELL_M).astype(int) for part in (0, 1))
    grid = np.zeros((high - low + 1)[::-1])
    column, row = (np.floor(cells[["x", "y"]].to_numpy() / CELL_M).astype(int) - low).T
    grid[row, column] = cells["p"]
    ends = np.stack([low, high + 1]) * CELL_M
    return grid, (*ends[:, 0], *ends[:, 1])
