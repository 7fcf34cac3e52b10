"""Exhibits of occupied cells: the table's cells by hand, the panels, and a dataset of nobody."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from modlhmp.datasets import Dataset
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import occupied_figure, occupied_film, occupied_table

HALL = Dataset(name="hall", title="Hall", label="atc", reader="atc", time_step_s=1.0, horizon_s=12.0, demo=True)
TITLES = {"now": "Episodes, by pieces", "chained": "Snippets"}
HORIZONS = {"hall": [4.0, 12.0]}


def write(layout, name, table):
    write_parquet(pa.Table.from_pandas(table, preserve_index=False), layout.occupied("hall", name))


@pytest.fixture
def study(layout):
    """Two methods, two horizons; in the bin of 0.5, 400 cells in 40 half-hours, half of them occupied, or all."""
    rows, scores = [], []
    for method, share in (("now", 0.5), ("chained", 1.0)):
        for horizon_s in (4.0, 12.0):
            block = np.arange(40)
            rows.append(pd.DataFrame({
                "method": method, "horizon_s": horizon_s, "bin": 5, "block": block, "cell": block, "n": 10, "p": 5.2,
                "occupied": 10 * share,
            }))  # fmt: skip
            scores.append((method, horizon_s, 40, 80, 4000, 208.0, 400 * share, 20.0, 0.002 / share, 0.004, 0.005))
    write(layout, "bins", pd.concat(rows))
    write(layout, "scores", pd.DataFrame(scores, columns=[
        "method", "horizon_s", "moments", "people", "cells", "p", "occupied", "unforeseen", "brier", "brier_cells",
        "brier_flat",
    ]))  # fmt: skip
    return layout


def test_the_table_s_cells_by_hand(study, tmp_path):
    occupied_table.draw(study, [HALL], str(tmp_path / "t"), TITLES, HORIZONS, 60.0)
    table = pd.read_csv(tmp_path / "t.csv", dtype=str)
    assert table["horizon [s]"].tolist() == ["4"] * 4 + ["12"] * 4
    assert table["method"][:4].tolist() == [
        *TITLES.values(),
        "no skill: each cell's share",
        "no skill: one share for all",
    ]
    ours, theirs, cells, flat = table[:4].itertuples(index=False)
    assert ours[3:] == ("4.000", "0%", "5.20", "5.00", "10%", "1 of 1", "40")
    assert theirs[3:] == ("2.000", "50%", "5.20", "10.00", "5%", "0 of 1", "40")
    assert (cells[3], flat[3]) == ("4.000", "5.000")
    assert "every 60 s" in (tmp_path / "t.md").read_text()
    assert "Demo data" in (tmp_path / "t.md").read_text()


def test_a_panel_for_every_horizon(study, tmp_path, figures):
    occupied_figure.draw(study, [HALL], str(tmp_path / "f"), TITLES, HORIZONS)
    table = pd.read_csv(tmp_path / "f.csv")
    assert table[["method", "horizon_s", "n"]].to_numpy().tolist() == [
        [method, horizon_s, 400] for method in sorted(TITLES) for horizon_s in (4, 12)
    ]
    assert table["calibrated"].tolist() == [False, False, True, True]
    (fig,) = figures
    assert [ax.get_title() for ax in fig.axes if ax.axison] == ["Hall, 4 s", "Hall, 12 s"]
    assert sum(not ax.axison for ax in fig.axes) == occupied_figure.MOST_PANELS - 2


def film(width):
    """Somebody walks east along `width` m, where a cell is said to be occupied."""
    rows = [("person", 0.0, 0.5, 0.5, np.nan)]
    for at_s in (1, 2, 4, 8, 12):
        x = width * at_s / 12
        rows += [("person", at_s, x, 0.5, np.nan), ("cell", at_s, np.floor(x) + 0.5, 0.5, 0.5)]
        rows.append(("cell", at_s, np.floor(x) + 0.5, 3.5, 0.001))
    return pd.DataFrame(rows, columns=["what", "at_s", "x", "y", "p"]).assign(t0=1.3e9)


@pytest.mark.parametrize(("width", "rows"), [(24.0, 3), (2.0, 1)])
def test_a_film_of_three_moments(layout, tmp_path, figures, width, rows):
    write(layout, "film", film(width))
    occupied_film.draw(layout, HALL, str(tmp_path / "f"), "Episodes")
    (fig,) = figures
    panels = [ax for ax in fig.axes if ax.get_title()]
    assert [ax.get_title().splitlines()[0] for ax in panels] == ["after 2 s", "after 4 s", "after 8 s"]
    fig.canvas.draw()
    boxes = [ax.title.get_window_extent() for ax in panels]
    assert not any(one.overlaps(other) for one, other in pairwise(boxes)), "titles run into one another"
    assert {ax.get_gridspec().nrows for ax in panels} == {rows}
    assert [ax.get_xlabel() for ax in panels] == (["", "", "x [m]"] if rows == 3 else ["x [m]"] * 3)
    assert [ax.get_ylabel() for ax in panels] == (["y [m]"] * 3 if rows == 3 else ["y [m]", "", ""])
    for ax, at_s in zip(panels, (2, 4, 8), strict=True):
        (image,) = ax.images
        (row, column) = np.unravel_index(np.argmax(image.get_array()), image.get_array().shape)
        x_low, _, y_low, _ = image.get_extent()
        assert (x_low + column, y_low + row) == (np.floor(width * at_s / 12), 0), "the person is in the cell"
        assert np.allclose(ax.lines[-1].get_xydata(), [[width * at_s / 12, 0.5]])
    assert set(pd.read_csv(tmp_path / "f.csv")["at_s"]) == {0, 2, 4, 8}


def test_a_film_of_nobody(layout, tmp_path, figures):
    write(layout, "film", film(2.0)[:0])
    occupied_film.draw(layout, HALL, str(tmp_path / "f"), "Episodes")
    assert "nobody was there" in figures[0].axes[0].texts[0].get_text()
