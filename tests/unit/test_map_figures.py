"""Figures of maps of dynamics: what is drawn is what the map says, and missing pieces leave labelled panels."""

import dataclasses

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from PIL import Image

from modlhmp.datasets import Dataset
from modlhmp.maps import cliff
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import cliff_hours, map_panels, mod_comparison, one_location, stef_hours, style

HALL = Dataset(name="hall", title="Hall", label="atc", reader="atc", hours=(9, 12), figure_hours=(9, 10, 11), demo=True)


@pytest.fixture
def shown(monkeypatch):
    """The figures that are saved, before they are closed."""
    figures = []
    monkeypatch.setattr(style.plt, "close", figures.append)
    return figures


def texts(figure):
    """All text of a figure's panels."""
    return [text.get_text() for ax in figure.axes for text in [*ax.texts, ax.title]]


def write_cliff(path, components):
    """A CLiFF-map of (location, x, y, weight, heading, speed, count)."""
    rows = pd.DataFrame(components, columns=["location", "x", "y", "weight", "mean_heading", "mean_speed", "count"])
    rest = {"var_heading": 0.1, "cov_heading_speed": 0.0, "var_speed": 0.1, "p": 1.0, "q": 1.0}
    table = pa.Table.from_pandas(rows.assign(**rest)[list(cliff.COLUMNS)], preserve_index=False)
    write_parquet(table, path)


def write_stef(path, cells):
    """An hour's STeF-map of {(x, y): 4 probabilities}."""
    lists = pa.FixedSizeListArray.from_arrays(pa.array(np.ravel(list(cells.values()))), 4)
    x, y = np.array(list(cells), float).T
    table = pa.table({"x": x, "y": y, "probabilities": lists})
    write_parquet(table.replace_schema_metadata({"resolution": "1.0", "orientations": "4"}), path)


def test_heaviest_component_of_each_location(tmp_path, layout):
    """The CSV holds one row per location, the heaviest; an hour without a file leaves a labelled panel."""
    write_cliff(layout.map_hour("hall", "tc_cliff", 9), [(0, 1, 2, 0.3, 0.5, 1.0, 9), (0, 1, 2, 0.7, -2.0, 0.8, 9),
                                            (1, 4, 2, 1.0, 1.0, 1.1, 7)])  # fmt: skip
    cliff_hours.draw(layout, dataclasses.replace(HALL, figure_hours=(9, 10)), str(tmp_path / "f"))
    table = pd.read_csv(tmp_path / "f.csv")
    assert table[["hour", "x", "mean_heading", "weight"]].to_numpy().tolist() == [[9, 1, -2, 0.7], [9, 4, 1, 1]]


def test_an_hour_without_a_map_is_named(tmp_path, layout, shown):
    write_cliff(layout.map_hour("hall", "tc_cliff", 9), [(0, 1, 2, 1.0, 0.5, 1.0, 9)])
    cliff_hours.draw(layout, HALL, str(tmp_path / "f"))
    assert any("10:00–11:00\nno map" in text for text in texts(shown[0]))
    assert any("9:00–10:00, 1 locations" in text for text in texts(shown[0]))


@pytest.mark.parametrize("module", [cliff_hours, stef_hours])
def test_no_map_at_all(tmp_path, layout, module):
    module.draw(layout, HALL, str(tmp_path / "f"))
    assert (tmp_path / "f.pdf").stat().st_size > 1000
    assert len(pd.read_csv(tmp_path / "f.csv")) == 0


def test_dominant_orientation(tmp_path, layout):
    """Of 4 directions; ties go to the first, a cell without dynamics gets no arrow."""
    write_stef(layout.map_hour("hall", "stef", 9), {(0.5, 0.5): [0.1, 0.6, 0.2, 0.1], (1.5, 0.5): [0.0, 0.0, 0.5, 0.5],
                                           (2.5, 0.5): [0.0, 0.0, 0.0, 0.0]})  # fmt: skip
    stef_hours.draw(layout, HALL, str(tmp_path / "f"))
    table = pd.read_csv(tmp_path / "f.csv")
    assert table["x"].tolist() == [0.5, 1.5]
    np.testing.assert_allclose(table["heading"], [np.pi / 2, np.pi], rtol=1e-5)
    np.testing.assert_allclose(table["probability"], [0.6, 0.5])


def test_comparison_holds_all_components_and_orientations(tmp_path, layout):
    write_cliff(layout.map_hour("hall", "tc_cliff", 9), [(0, 1, 2, 0.3, 0.5, 1.0, 9), (0, 1, 2, 0.7, -2.0, 0.8, 9)])
    write_stef(layout.map_hour("hall", "stef", 9), {(0.5, 0.5): [0.1, 0.6, 0.3, 0.0]})
    mod_comparison.draw(layout, HALL, str(tmp_path / "f"))
    table = pd.read_csv(tmp_path / "f.csv")
    assert table.groupby("map")["weight"].apply(sorted).to_dict() == {"STeF": [0.1, 0.3, 0.6], "TC-CLiFF": [0.3, 0.7]}


def test_busy_location_by_hand(tmp_path, layout):
    """B is busier in sum, but its quietest hour has 3; A's has 5."""
    a, b = (1, 1.0, 1.0), (2, 5.0, 1.0)

    def write(hour, count_a, count_b):
        rows = [(*place, 1.0, 0.0, 1.0, count) for place, count in ((a, count_a), (b, count_b)) if count]
        write_cliff(layout.map_hour("hall", "tc_cliff", hour), rows)

    write(9, 6, 3)
    write(10, 5, 90)
    write_cliff(layout.map("hall", "cliff"), [(*a, 1.0, 0.0, 1.0, 11), (*b, 1.0, 0.0, 1.0, 93)])
    one_location.draw(layout, HALL, str(tmp_path / "f"))
    table = pd.read_csv(tmp_path / "f.csv")
    assert set(table["x"]) == {1.0}
    assert dict(zip(table["map"], table["count"], strict=True)) == {"9:00": 6, "10:00": 5, "whole day": 11}


def test_an_unmapped_hour_counts_nothing():
    """A place that an hour's map lacks is not the busiest in its quietest hour."""

    def table(rows):
        return pd.DataFrame(rows, columns=["x", "y", "count"])

    hours = {9: table([(0, 0, 50), (1, 0, 4)]), 10: table([(1, 0, 4)]), 11: table([])}
    assert one_location.busy_location(hours, table([(0, 0, 90), (1, 0, 8)])) == (1, 0)
    assert one_location.busy_location({9: table([])}, table([])) is None


def test_one_location_without_any_map(tmp_path, layout, shown):
    write_cliff(layout.map("hall", "cliff"), [])
    one_location.draw(layout, HALL, str(tmp_path / "f"))
    assert sum("no map here" in text for text in texts(shown[0])) == 4


def test_up_is_up_on_the_page(tmp_path, layout, shown):
    """Image coordinates grow downwards: a heading of -90 degrees points up there, +90 elsewhere."""
    write_cliff(layout.map_hour("hall", "tc_cliff", 9), [(0, 1, 2, 1.0, -np.pi / 2, 1.0, 9)])
    for reader, up in (("edinburgh", True), ("atc", False)):
        cliff_hours.draw(layout, dataclasses.replace(HALL, reader=reader), str(tmp_path / "f"))
        figure = shown.pop()
        ax = figure.axes[0]
        start, end = ax.transData.transform([(1, 2), (1, 1)])
        assert (end[1] > start[1]) == up
        key = figure.axes[-1]
        quarter = [label.get_text() for label in key.get_yticklabels()][3]  # 270 degrees
        assert quarter == ("up" if up else "down")


def test_printed_size(tmp_path, layout):
    """Page width at 300 dpi, whatever the extent."""
    write_cliff(layout.map_hour("hall", "tc_cliff", 9), [(n, n, 2, 1.0, 0.1 * n, 1.0, 9) for n in range(30)])
    cliff_hours.draw(layout, HALL, str(tmp_path / "f"))
    assert Image.open(tmp_path / "f.png").size[0] == pytest.approx(style.PAGE_MM / 25.4 * 300, abs=2)


def test_transparency_is_the_weight():
    fig, axes = map_panels.panels(HALL, (np.array([0.0, 5.0]), np.array([0.0, 5.0])), 1, 1)
    table = pd.DataFrame({"x": [0.0, 1.0], "y": [0.0, 1.0], "heading": [0.0, 1.0], "length": [1.0, 1.0]})
    map_panels.arrows(axes[0, 0], table, alpha=np.array([0.2, 1.7]))
    (quiver,) = axes[0, 0].collections
    np.testing.assert_allclose(quiver.get_facecolors()[:, 3], [0.2, 1.0])
    style.plt.close(fig)
