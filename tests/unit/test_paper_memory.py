"""Exhibits of maps with memory: errors against the share of training tracks, and what the maps hold near a walker."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from matplotlib import image
from matplotlib.collections import LineCollection

from modlhmp.forecasting import write_forecasts
from modlhmp.forecasting.base import Forecast
from modlhmp.maps import snippets
from modlhmp.scoring import score_recording
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import memory_maps, style, training_share
from modlhmp.tracks import Tracks, empty_tracks, write_tracks

HALL = {"name": "hall", "title": "Hall", "label": "atc", "reader": "atc", "observed_rows": 4, "horizon_s": 12.0,
        "time_step_s": 2.0, "timezone": "UTC", "floor_plan": [], "areas": [], "demo": True,
        "paper_protocol": {"idle_filter": None}}  # fmt: skip
YARD = {**HALL, "name": "yard", "title": "Yard", "label": "yard", "horizon_s": 4.0, "demo": False}
METHODS = {"episodes": "Episodes", "snippets": "Snippets"}
STEPS = 6


def walkers(rows, number=5, steps_m=2.0):
    """People who walk along x, a row each 2 s; person n walks at y = n."""
    ids = np.repeat(np.arange(1, number + 1), rows)
    x, t = np.tile(steps_m * np.arange(rows), number), np.tile(1.9e9 + 2.0 * np.arange(rows), number)
    return Tracks(ids, t, x, ids.astype(float), np.ones(len(ids)), np.zeros(len(ids)))


@pytest.fixture
def figures(monkeypatch):
    """Figures that have been drawn; they stay open."""
    shown = []
    monkeypatch.setattr(style.plt, "close", shown.append)
    yield shown
    monkeypatch.undo()
    for fig in shown:
        style.plt.close(fig)


# --- amount of training data --------------------------------------------------------------------------------


def errors_of(dataset, aside, rows=4 + STEPS, output="median"):
    """Errors of five people; one method's forecasts lie `aside` metres off, more for those with a larger id."""
    tracks = walkers(rows)
    steps = round(dataset["horizon_s"] / dataset["time_step_s"])
    ids = np.arange(1, 6)
    xy = np.zeros((5, 1, steps, 2), np.float32)
    xy[..., 0], xy[..., 1] = 6.0 + 2.0 * np.arange(1, steps + 1), (ids * (1 + aside))[:, None, None]
    forecast = Forecast(xy, np.zeros((5, 1, steps), np.float32), np.full((5, 1), steps, np.int32), output)
    return score_recording(tracks, [(seed, ids, forecast) for seed in (0, 1)], "day", dataset)


def study(folder, dataset, errors, shares=("0.1", "0.25", "1")):
    """Errors files of both methods; with share s and method m: m / s."""
    for m, method in enumerate(METHODS, 1):
        for share in shares:
            write_parquet(errors(dataset, m / float(share)), folder / dataset["name"] / method / f"{share}.parquet")
    return folder / dataset["name"]


def test_the_curves_are_the_mean_errors_of_each_share(tmp_path, figures):
    """On average the third person's: 3 m / s for the first method, twice as much for the second."""
    folder = study(tmp_path, HALL, errors_of)
    training_share.draw([folder], [HALL], METHODS, [4, 12, 60], str(tmp_path / "f"))
    table = pd.read_csv(tmp_path / "f.csv")
    assert set(table["protocol"]) == {"complete"}
    assert set(table["output"]) == {"median"}
    for m, method in enumerate(METHODS, 1):
        for share in (0.1, 0.25, 1.0):
            one = table[(table["method"] == method) & (table["share"] == share)]
            assert one["horizon_s"].tolist() == [2, 4, 6, 8, 10, 12]
            np.testing.assert_allclose(one["ade_m"], 3 * m / share, rtol=1e-5)
    panels = [ax for ax in figures[0].axes if ax.axison]
    assert [ax.get_title(loc="left") for ax in panels] == ["Hall: 4 s (n = 5)", "Hall: 12 s (n = 5)"]
    for panel in panels:
        curves = [line.get_xydata() for line in panel.lines]
        np.testing.assert_allclose(curves[0], [[10, 30], [25, 12], [100, 3]], rtol=1e-5)
        np.testing.assert_allclose(curves[1], [[10, 60], [25, 24], [100, 6]], rtol=1e-5)
    assert image.imread(tmp_path / "f.png").std() > 0


def test_datasets_have_a_row_each_with_their_own_horizons(tmp_path, figures):
    folders = [study(tmp_path, dataset, errors_of) for dataset in (HALL, YARD)]
    training_share.draw(folders, [HALL, YARD], METHODS, [4, 8, 12], str(tmp_path / "f"))
    titles = [ax.get_title(loc="left") for ax in figures[0].axes if ax.axison]
    assert titles == ["Hall: 4 s (n = 5)", "Hall: 8 s (n = 5)", "Hall: 12 s (n = 5)", "Yard: 4 s (n = 5)"]
    assert figures[0]._suptitle.get_text().startswith("Demo data")


def test_a_share_study_of_nobody_is_drawn_empty(tmp_path, figures):
    """No test track is usable: the file has no rows."""
    folder = study(tmp_path, HALL, lambda dataset, _: score_recording(empty_tracks(), [], "day", dataset))
    training_share.draw([folder], [HALL], METHODS, [4, 12], str(tmp_path / "f"))
    assert len(pd.read_csv(tmp_path / "f.csv")) == 0
    titles = [ax.get_title(loc="left") for ax in figures[0].axes if ax.axison]
    assert titles == ["Hall: 4 s (n = 0)", "Hall: 12 s (n = 0)"]


def test_a_horizon_that_no_track_reaches_has_no_curve(tmp_path, figures):
    folder = study(tmp_path, HALL, lambda dataset, aside: errors_of(dataset, aside, rows=4 + 3))
    training_share.draw([folder], [HALL], METHODS, [4, 12], str(tmp_path / "f"))
    titles = [ax.get_title(loc="left") for ax in figures[0].axes if ax.axison]
    assert titles == ["Hall: 4 s (n = 5)", "Hall: 12 s (n = 0)"]


# --- what maps with memory hold -----------------------------------------------------------------------------


def make_run(folder, dataset=HALL, rows=4 + STEPS, training=None):
    """Five people, forecasts of three futures by both methods, and a snippet map of other people.

    The forecast's first future is 1 m aside, times the person's id; the second leaves after 4 s, the third at once.
    """
    base, tracks, ids = folder / dataset["name"], walkers(rows), np.arange(1, 6 if rows > 4 else 1)
    write_tracks(tracks, base / "tracks/day.parquet")
    steps = round(dataset["horizon_s"] / dataset["time_step_s"])
    xy = np.zeros((len(ids), 3, steps, 2), np.float32)
    xy[..., 0] = 6.0 + 2.0 * np.arange(1, steps + 1)
    xy[..., 1] = (2 * ids)[:, None, None] + np.arange(3)[:, None]
    alive = np.tile(np.array([steps, 2, 0], np.int32), (len(ids), 1))
    forecast = Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, "median")
    for method in METHODS:
        (base / f"forecasts/{method}").mkdir(parents=True, exist_ok=True)
        write_forecasts(base / f"forecasts/{method}/day.parquet", [(0, ids, forecast)])
        write_parquet(score_recording(tracks, [(0, ids, forecast)], "day", dataset), base / f"errors/{method}.parquet")
    training = walkers(12, 9, 1.0) if training is None else training
    write_parquet(snippets.build(training, 2.0, length_s=6.0, past=3), base / "maps/snippets.parquet")


def draw(folder, figures, datasets=(HALL,)):
    """Draw; returns the figure and its numbers."""
    memory_maps.draw(folder, list(datasets), METHODS, str(folder / "f"))
    assert image.imread(folder / "f.png").std() > 0
    return figures[-1], pd.read_csv(folder / "f.csv")


def snippets_drawn(panel):
    """Paths of the snippets in a panel."""
    (lines,) = (one for one in panel.collections if isinstance(one, LineCollection))
    return [path.vertices for path in lines.get_paths()]


def test_the_median_and_the_samples_are_in_the_table(tmp_path, figures):
    """Of the median person, every future to where it left; truth and observation are said once."""
    make_run(tmp_path)
    _, table = draw(tmp_path, figures)
    assert set(table["track_id"]) == {3}
    for method in METHODS:
        futures = table[table["method"] == method]
        assert futures.groupby("rank")["step_s"].max().tolist() == [12, 4, 0]
        assert futures.groupby("rank")["left_map"].first().tolist() == [False, True, True]
        np.testing.assert_allclose(futures.loc[futures["step_s"] > 0, "y_m"].iloc[:STEPS], 6)
    assert table["what"].value_counts().to_dict() == {"forecast": 2 * (7 + 3 + 1), "truth": 7, "observed": 4}


def test_the_walker_s_panels_show_each_method(tmp_path, figures):
    make_run(tmp_path)
    fig, _ = draw(tmp_path, figures)
    titles = [ax.get_title(loc="left") or ax.get_title() for ax in fig.axes]
    assert titles == ["Hall: snippets that start here", "Episodes, 12 s", "Snippets, 12 s"]
    for panel in fig.axes[1:]:
        widths = [line.get_linewidth() for line in panel.lines]
        assert widths.count(memory_maps.MEDIAN["linewidth"]) == 1
        assert widths.count(memory_maps.SAMPLE["linewidth"]) == 2
        crosses = [line.get_xydata()[0].tolist() for line in panel.lines if line.get_marker() == "x"]
        assert crosses == [[10, 7], [6, 3]]  # where the second left, and t0's place


def test_snippets_are_those_that_start_within_reach(tmp_path, figures):
    """The walker's t0 is at (6, 3), people have walked a metre a step: each snippet from its own start."""
    make_run(tmp_path)
    fig, _ = draw(tmp_path, figures)
    starts = {tuple(path[0].tolist()) for path in snippets_drawn(fig.axes[0])}
    people = [(float(x), float(y)) for x in range(3, 11) for y in range(1, 10)]
    assert starts == {(x, y) for x, y in people if (x - 6) ** 2 + (y - 3) ** 2 <= 4}
    for path in snippets_drawn(fig.axes[0]):
        np.testing.assert_allclose(np.diff(path, axis=0), np.tile([1.0, 0.0], (len(path) - 1, 1)), atol=1e-5)


def test_a_snippet_ends_where_its_person_left(tmp_path, figures):
    """Its track ends at x = 8; the held rest of its path is not drawn."""
    make_run(tmp_path, training=walkers(9, 3, 1.0))
    fig, _ = draw(tmp_path, figures)
    drawn = {path[0, 0]: path[:, 0].tolist() for path in snippets_drawn(fig.axes[0])}
    assert drawn == {4: [4, 5, 6, 7], 5: [5, 6, 7, 8], 6: [6, 7, 8], 7: [7, 8]}  # the map stores three steps


def test_not_more_snippets_are_drawn_than_can_be_seen(tmp_path, figures, monkeypatch):
    make_run(tmp_path)
    monkeypatch.setattr(memory_maps, "MOST_DRAWN", 4)
    fig, _ = draw(tmp_path, figures)
    assert len(snippets_drawn(fig.axes[0])) == 4


@pytest.mark.parametrize("training", [walkers(12, 3)._replace(x=900.0 + np.tile(np.arange(12.0), 3)), empty_tracks()])
def test_a_walker_where_nobody_walked_has_no_snippets(tmp_path, figures, training):
    """All of the map is far away, or it is empty: the panel shows the walker alone."""
    make_run(tmp_path, training=training)
    fig, table = draw(tmp_path, figures)
    assert snippets_drawn(fig.axes[0]) == []
    assert set(table["track_id"]) == {3}


def test_nobody_is_long_enough(tmp_path, figures):
    """Labelled panels and an empty table, no crash; the other dataset is drawn."""
    make_run(tmp_path, rows=4 + STEPS - 2)
    make_run(tmp_path, YARD)
    fig, table = draw(tmp_path, figures, [HALL, YARD])
    assert [ax.texts[0].get_text() for ax in fig.axes[:3]] == ["Hall: no test track of 12 s"] * 3
    assert set(table["dataset"]) == {"yard"}


def test_nobody_at_all(tmp_path, figures):
    make_run(tmp_path, rows=4)
    _, table = draw(tmp_path, figures)
    assert len(table) == 0


def test_rows_of_a_sliced_map_keep_their_paths(tmp_path, figures):
    """A map in several row groups is the same map."""
    make_run(tmp_path)
    file = tmp_path / "hall/maps/snippets.parquet"
    before = snippets_drawn(draw(tmp_path, figures)[0].axes[0])
    pa.parquet.write_table(pa.parquet.read_table(file), file, row_group_size=7)
    after = snippets_drawn(draw(tmp_path, figures)[0].axes[0])
    assert len(before) == len(after)
    for path, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(path, other)
