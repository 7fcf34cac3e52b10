"""Figure of the maps with memory: what they hold near a walker, and the futures that they give."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from matplotlib import image
from matplotlib.collections import LineCollection
from walking_hall import HALL, METHODS, STEPS, YARD, walkers

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import write_forecasts
from modlhmp.maps import snippets
from modlhmp.options import SnippetBuilding
from modlhmp.scoring.recording import score_recording
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import memory_maps
from modlhmp.tracks import empty_tracks, write_tracks


def make_run(layout, dataset=HALL, rows=4 + STEPS, training=None, output="median", lives=(None, 2, 0)):
    """Five people, forecasts of three futures by both methods, and a snippet map of other people.

    The forecast's first future is 1 m aside, times the person's id; the second leaves after 4 s, the third at once:
    `lives` in steps, None to the end.
    """
    tracks, ids = walkers(rows), np.arange(1, 6 if rows > 4 else 1)
    write_tracks(tracks, layout.tracks(dataset.name, "day"))
    steps = dataset.steps
    xy = np.zeros((len(ids), 3, steps, 2), np.float32)
    xy[..., 0] = 6.0 + 2.0 * np.arange(1, steps + 1)
    xy[..., 1] = (2 * ids)[:, None, None] + np.arange(3)[:, None]
    alive = np.tile(np.array([steps if life is None else life for life in lives], np.int32), (len(ids), 1))
    forecast = Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, output)
    for method in METHODS:
        write_forecasts(layout.forecast(dataset.name, method, "day"), [(0, ids, forecast)])
        errors = score_recording(tracks, [(0, ids, forecast)], "day", dataset)
        write_parquet(errors, layout.errors(dataset.name, method))
    training = walkers(12, 9, 1.0) if training is None else training
    table = snippets.build(training, dataset, SnippetBuilding(length_s=6.0))
    write_parquet(table, layout.map(dataset.name, "snippets"))


def draw(layout, figures, datasets=(HALL,)):
    """Draw; returns the figure and its numbers."""
    memory_maps.draw(layout, list(datasets), layout.exhibit("f"), METHODS)
    assert image.imread(f"{layout.exhibit('f')}.png").std() > 0
    return figures[-1], pd.read_csv(f"{layout.exhibit('f')}.csv")


def snippets_drawn(panel):
    """Paths of the snippets in a panel."""
    (lines,) = (one for one in panel.collections if isinstance(one, LineCollection))
    return [path.vertices for path in lines.get_paths()]


def test_the_median_and_the_samples_are_in_the_table(layout, figures):
    """Of the median person, every future to where it left; truth and observation are said once."""
    make_run(layout)
    _, table = draw(layout, figures)
    assert set(table["track_id"]) == {3}
    for method in METHODS:
        futures = table[table["method"] == method]
        assert futures.groupby("rank")["step_s"].max().tolist() == [12, 4, 0]
        assert futures.groupby("rank")["left_map"].first().tolist() == [False, True, True]
        np.testing.assert_allclose(futures.loc[futures["step_s"] > 0, "y_m"].iloc[:STEPS], 6)
    assert table["what"].value_counts().to_dict() == {"forecast": 2 * (7 + 3 + 1), "truth": 7, "observed": 4}


def test_a_medoid_is_drawn_first_wherever_it_stands(layout, figures):
    """Here the third, which alone lives on, the others after it and none twice."""
    make_run(layout, output="medoid", lives=(2, 0, STEPS))
    _, table = draw(layout, figures)
    futures = table[table["method"] == next(iter(METHODS))]
    assert futures.groupby("rank")["step_s"].max().tolist() == [12, 4, 0]


def test_the_walker_s_panels_show_each_method(layout, figures):
    make_run(layout)
    fig, _ = draw(layout, figures)
    titles = [ax.get_title(loc="left") or ax.get_title() for ax in fig.axes]
    assert titles == ["Hall: snippets that start here", "Episodes, 12 s", "Snippets, 12 s"]
    for panel in fig.axes[1:]:
        widths = [line.get_linewidth() for line in panel.lines]
        assert widths.count(memory_maps.RESULT["linewidth"]) == 1
        assert widths.count(memory_maps.SAMPLE["linewidth"]) == 2
        crosses = [line.get_xydata()[0].tolist() for line in panel.lines if line.get_marker() == "x"]
        assert crosses == [[10, 7], [6, 3]]  # where the second left, and t0's place


def test_snippets_are_those_that_start_within_reach(layout, figures):
    """The walker's t0 is at (6, 3), people have walked a metre per step: each snippet from its own start."""
    make_run(layout)
    fig, _ = draw(layout, figures)
    starts = {tuple(path[0].tolist()) for path in snippets_drawn(fig.axes[0])}
    people = [(float(x), float(y)) for x in range(3, 11) for y in range(1, 10)]
    assert starts == {(x, y) for x, y in people if (x - 6) ** 2 + (y - 3) ** 2 <= 4}
    for path in snippets_drawn(fig.axes[0]):
        np.testing.assert_allclose(np.diff(path, axis=0), np.tile([1.0, 0.0], (len(path) - 1, 1)), atol=1e-5)


def test_a_snippet_ends_where_its_person_left(layout, figures):
    """Its track ends at x = 8; the held rest of its path is not drawn."""
    make_run(layout, training=walkers(9, 3, 1.0))
    fig, _ = draw(layout, figures)
    drawn = {path[0, 0]: path[:, 0].tolist() for path in snippets_drawn(fig.axes[0])}
    assert drawn == {4: [4, 5, 6, 7], 5: [5, 6, 7, 8], 6: [6, 7, 8], 7: [7, 8]}  # the map stores three steps


def test_not_more_snippets_are_drawn_than_can_be_seen(layout, figures, monkeypatch):
    make_run(layout)
    monkeypatch.setattr(memory_maps, "MOST_DRAWN", 4)
    fig, _ = draw(layout, figures)
    assert len(snippets_drawn(fig.axes[0])) == 4


@pytest.mark.parametrize("training", [walkers(12, 3)._replace(x=900.0 + np.tile(np.arange(12.0), 3)), empty_tracks()])
def test_a_walker_where_nobody_walked_has_no_snippets(layout, figures, training):
    """All of the map is far away, or it is empty: the panel shows the walker alone."""
    make_run(layout, training=training)
    fig, table = draw(layout, figures)
    assert snippets_drawn(fig.axes[0]) == []
    assert set(table["track_id"]) == {3}


def test_nobody_is_long_enough(layout, figures):
    """Labelled panels and an empty table, no crash; the other dataset is drawn."""
    make_run(layout, rows=4 + STEPS - 2)
    make_run(layout, YARD)
    fig, table = draw(layout, figures, [HALL, YARD])
    assert [ax.texts[0].get_text() for ax in fig.axes[:3]] == ["Hall: no test track of 12 s"] * 3
    assert set(table["dataset"]) == {"yard"}


def test_nobody_at_all(layout, figures):
    make_run(layout, rows=4)
    _, table = draw(layout, figures)
    assert len(table) == 0


def test_rows_of_a_sliced_map_keep_their_paths(layout, figures, rewrite):
    """A map in several row groups is the same map."""
    make_run(layout)
    file = layout.map("hall", "snippets")
    before = snippets_drawn(draw(layout, figures)[0].axes[0])
    rewrite(file, pa.parquet.read_table(file), row_group_size=7)
    after = snippets_drawn(draw(layout, figures)[0].axes[0])
    assert len(before) == len(after)
    for path, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(path, other)
