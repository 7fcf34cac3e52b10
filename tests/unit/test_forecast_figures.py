"""Figures of example forecasts: the track that the rule chooses, the order of ranks, and what is missing."""

import dataclasses

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from modlhmp.cleaning import lift_loiterers
from modlhmp.datasets import Area, Dataset
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import write_forecasts
from modlhmp.forecasting.windows import windows
from modlhmp.scoring.recording import score_recording
from modlhmp.storage import read_parquet, write_parquet
from modlhmp.study.exhibits import example_forecasts, paths, ranked_forecasts, style
from modlhmp.study.exhibits.selection import Example, errors_at, example_track
from modlhmp.tracks import Tracks, concatenate, with_owners, write_tracks

HALL = Dataset(name="hall", title="Hall", label="atc", reader="atc", time_step_s=2.0, horizon_s=60.0, demo=True)
STEPS = 30
METHODS = {"tc_cliff": "TC-CLiFF", "cvm": "CVM"}


def walkers(number, rows):
    """People who walk along x, a row each 2 s; person n starts at y = n."""
    ids = np.repeat(np.arange(1, number + 1), rows)
    t = np.tile(1.9e9 + 2.0 * np.arange(rows), number)
    x = np.tile(7.0 * np.arange(rows), number)
    return Tracks(ids, t, x, ids.astype(float), np.full(len(ids), 3.5), np.zeros(len(ids)))


def make_run(layout, number=5, rows=4 + STEPS, k=3):
    """Tracks, forecasts and errors of two methods on one recording: person n is forecast n metres aside by TC-CLiFF."""
    tracks = walkers(number, rows)
    write_tracks(tracks, layout.tracks("hall", "day"))
    ids = np.arange(1, number + 1)
    x = 21.0 + 7.0 * np.arange(1, STEPS + 1)
    aside = ids[:, None] * np.arange(1, k + 1)  # the first future is the best
    xy = np.stack(np.broadcast_arrays(x, (ids[:, None] + aside)[..., None]), axis=-1).astype(np.float32)
    fitness = np.broadcast_to(-np.arange(1, k + 1, dtype=np.float32)[:, None], (number, k, STEPS)).copy()
    alive = np.full((number, k), STEPS, np.int32)
    ranked = Forecast(xy, fitness, alive, "ranked")
    line = Forecast(xy[:, :1] + np.float32([0, 5]), fitness[:, :1] * 0, alive[:, :1], "single")
    for method, forecast in (("tc_cliff", ranked), ("cvm", line)):
        file = layout.forecast("hall", method, "day")
        write_forecasts(file, [(0, ids, forecast), (1, ids, forecast)] if k > 1 else [(0, ids, forecast)])
        known = ids if rows > 4 else np.empty(0, int)
        errors = score_recording(tracks, [(0, known, forecast)] if rows > 4 else [], "day", HALL)
        write_parquet(errors, layout.errors("hall", method))


def test_the_median_track_by_hand():
    """Of 4 eligible ones the lower middle; ties by recording, then id; NaN and ineligible ones do not count."""
    errors = pd.DataFrame(
        [("b", 1, 2.0, True), ("a", 9, 2.0, True), ("a", 3, 2.0, True), ("a", 1, 7.0, True), ("a", 5, np.nan, True),
         ("a", 2, 0.1, False)],
        columns=["recording", "track_id", "ade_m", "eligible"],
    ).assign(owner="P1")  # fmt: skip
    assert example_track(errors) == Example("a", 9, 4, "P1")
    assert example_track(errors.iloc[::-1]) == Example("a", 9, 4, "P1")
    assert example_track(errors[errors["track_id"] == 5]) is None


def test_errors_are_read_from_the_file(layout):
    make_run(layout)
    errors = errors_at(layout.errors("hall", "tc_cliff"), STEPS)
    assert errors.sort_values("track_id")["ade_m"].tolist() == [1, 2, 3, 4, 5]
    assert errors["eligible"].all()
    assert example_track(errors) == Example("day", 3, 5, "3")


def test_the_owner_s_id_is_shown(layout):
    """Where a track id is a number of ours."""
    make_run(layout)
    file = layout.errors("hall", "tc_cliff")
    write_parquet(with_owners(read_parquet(file), {3: "P03 #2"}), file)
    assert paths.who(example_track(errors_at(file, STEPS))).startswith("track P03 #2 of day")


def test_ranked_figure_holds_its_numbers(tmp_path, layout):
    """The median person, three futures in their order, ADE 3, 6 and 9 m; truth and observation beside them."""
    make_run(layout)
    ranked_forecasts.draw(layout, [HALL], str(tmp_path / "f"), METHODS)
    table = pd.read_csv(tmp_path / "f.csv")
    assert set(table["track_id"]) == {3}
    futures = table[table["what"] == "forecast"]
    assert futures.groupby("rank")["ade_m"].first().round(4).tolist() == [3, 6, 9]
    assert (futures.groupby("rank")["step_s"].max() == 60).all()
    assert not futures["left_map"].any()
    assert table[table["what"] == "observed"]["step_s"].tolist() == [-6, -4, -2, 0]
    np.testing.assert_allclose(table[table["what"] == "truth"]["x_m"], 21 + 7 * np.arange(STEPS + 1), rtol=1e-5)


def test_a_future_that_left_the_map_ends_there():
    path = Forecast(np.ones((2, 5, 2)), np.zeros((2, 5)), np.array([5, 2]), "ranked")
    table = paths.forecast_paths(path, np.array([0, 1]), 5, 1.0, np.zeros(2))
    assert table.groupby("rank")["step_s"].max().tolist() == [5, 2]
    assert table.groupby("rank")["left_map"].first().tolist() == [False, True]


def test_all_methods_stand_in_one_figure(tmp_path, layout):
    """The best ranked path of TC-CLiFF and CVM's one, with the errors files' ADE."""
    make_run(layout)
    example_forecasts.draw(layout, [HALL], str(tmp_path / "f"), METHODS)
    table = pd.read_csv(tmp_path / "f.csv")
    ade = table[table["what"] == "forecast"].groupby("method")["ade_m"].first().to_dict()
    assert ade == {"tc_cliff": 3.0, "cvm": 8.0}
    assert (table[table["what"] == "forecast"].groupby("method")["rank"].nunique() == 1).all()


def test_half_the_horizon_where_it_is_short():
    assert example_forecasts.shown_steps(Dataset(horizon_s=20.0)) == 10
    assert example_forecasts.shown_steps(Dataset(horizon_s=60.0)) == 60


@pytest.mark.parametrize(
    ("output", "shown"),
    [("ranked", [1]), ("medoid", [1]), ("modes", [1]), ("median", [0]), ("mean", [0, 1, 2]), ("single", [0, 1, 2])],
)
def test_the_futures_that_make_the_result_are_shown(output, shown):
    """The best ranked; the median, which stands before its samples, all ranked alike; all whose errors are averaged."""
    fitness = np.zeros((3, 4))
    fitness[1] = output in {"ranked", "medoid", "modes"}
    forecast = Forecast(np.zeros((3, 4, 2)), fitness, np.full(3, 4), output)
    assert example_forecasts.shown_futures(forecast, 4).tolist() == shown


def test_a_median_outlives_its_samples():
    """It lives as long as the last of them, so it is the first in rank at every horizon."""
    alive = np.array([3, 1, 3, 0])
    forecast = Forecast(np.zeros((4, 5, 2)), np.zeros((4, 5)), alive, "median")
    assert [example_forecasts.shown_futures(forecast, steps).tolist() for steps in range(1, 6)] == [[0]] * 5


@pytest.mark.parametrize("module", [ranked_forecasts, example_forecasts])
def test_no_track_is_long_enough(tmp_path, layout, module):
    """A labelled panel and an empty table, no crash."""
    make_run(layout, rows=4 + STEPS - 6)
    seen = []
    module.style.empty_panel, kept = (lambda ax, text: seen.append(text)), module.style.empty_panel
    try:
        module.draw(layout, [HALL], str(tmp_path / "f"), METHODS)
    finally:
        module.style.empty_panel = kept
    assert any("no test track of" in text for text in seen)
    assert len(pd.read_csv(tmp_path / "f.csv")) == 0


def test_one_method_without_ranks(tmp_path, layout):
    """CVM alone: nothing to rank is said; its example is drawn."""
    make_run(layout)
    ranked_forecasts.draw(layout, [HALL], str(tmp_path / "r"), {"cvm": "CVM"})
    assert len(pd.read_csv(tmp_path / "r.csv")) == 0
    example_forecasts.draw(layout, [HALL], str(tmp_path / "e"), {"cvm": "CVM"})
    assert set(pd.read_csv(tmp_path / "e.csv")["method"].dropna()) == {"cvm"}


def test_one_future(tmp_path, layout):
    make_run(layout, k=1)
    ranked_forecasts.draw(layout, [HALL], str(tmp_path / "f"), METHODS)
    assert pd.read_csv(tmp_path / "f.csv")["rank"].max() == 1


@pytest.mark.parametrize("scale", [None, 0.5])
def test_an_area_is_where_cleaning_has_the_same_polygon(scale):
    """Also where tracks are moved to a local origin: both count from there."""
    corners = ((0, 0), (10, 0), (10, 20))
    dataset = dataclasses.replace(HALL, scale=scale, origin_m=(500, 700))
    outline = ranked_forecasts._outline(Area(title="lift", colour="red", polygons=(corners,)), dataset)
    people = [(8.0, 6.0), (4.0, 9.0), (508.0, 706.0), (2.0, 1.0)]
    tracks = concatenate(walkers(1, 2)._replace(track_id=np.full(2, n), x=np.full(2, x), y=np.full(2, y))
                         for n, (x, y) in enumerate(people))  # fmt: skip
    within = lift_loiterers(tracks, dataset, [corners]).tolist()
    assert outline.contains_points(people).tolist() == within == [scale is None, False, False, True]


def test_areas_and_image_coordinates(tmp_path, layout):
    """Polygons are in pixels, the figure in metres with y downwards."""
    area = Area(title="lift", colour="red", polygons=(((0, 0), (10, 0), (10, 20)),))
    dataset = dataclasses.replace(HALL, areas=(area,), scale=0.5, reader="edinburgh")
    outline = ranked_forecasts._outline(area, dataset)
    assert outline.vertices.max(axis=0).tolist() == [5, 10]
    make_run(layout)
    shown = []
    style.plt.close, kept = shown.append, style.plt.close
    try:
        ranked_forecasts.draw(layout, [dataset], str(tmp_path / "f"), METHODS)
    finally:
        style.plt.close = kept
    low, high = shown[0].axes[0].get_ylim()
    assert low > high
    texts = [text.get_text() for ax in shown[0].axes if ax.get_legend() for text in ax.get_legend().get_texts()]
    assert "lift" in texts


def test_a_forecasts_file_of_nobody(tmp_path):
    """None, not a crash, where a recording had no usable track."""
    floats = (np.empty(shape, np.float32) for shape in ((0, 3, 4, 2), (0, 3, 4)))
    nothing = Forecast(*floats, np.empty((0, 3), np.int32), "ranked")
    write_forecasts(tmp_path / "f.parquet", [(0, np.empty(0, int), nothing)])
    assert pa.parquet.read_table(tmp_path / "f.parquet").num_rows == 0
    assert paths.forecast_of(tmp_path / "f.parquet", 7) is None


def test_the_example_of_several_forecasts_of_a_track_is_its_first(layout):
    """The rule chooses among tracks, however often each is forecast; the figures show their first forecast."""
    often, tracks = dataclasses.replace(HALL, forecast_every_s=4), walkers(5, 10 + STEPS)
    later = windows(tracks, often)
    assert len(later.t0) > 20
    errors = []
    for name, wanted in (("often", later), ("once", windows(tracks, HALL))):
        aside = (wanted.track_id + 50 * (wanted.later_s > 0)).astype(np.float32)
        xy = np.zeros((len(aside), 1, STEPS, 2), np.float32)
        xy[..., 0], xy[..., 1] = 7.0, (wanted.track_id + aside)[:, None, None]
        forecast = Forecast(xy, np.zeros(xy.shape[:3], np.float32), np.full((len(aside), 1), STEPS, np.int32), "single")
        file, of = layout.forecast("hall", name, "day"), often if name == "often" else HALL
        write_forecasts(file, [(0, wanted.track_id, forecast)], wanted.t0 if name == "often" else None)
        write_parquet(score_recording(tracks, [(0, wanted.track_id, forecast)], "day", of), layout.errors("hall", name))
        errors.append(errors_at(layout.errors("hall", name), STEPS).reset_index(drop=True))
        assert paths.forecast_of(file, 3).xy[0, 0, 1] == 6.0
    pd.testing.assert_frame_equal(*errors)
    assert example_track(errors[0]) == example_track(errors[1])
