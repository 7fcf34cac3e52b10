"""Figure of a forecast's density: whose samples it shows, and the moments."""

import numpy as np
import pandas as pd
import pytest
from matplotlib import image

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import write_forecasts
from modlhmp.maps import snippets
from modlhmp.methods import Method
from modlhmp.options import HandedIn, RollOut, SnippetBuilding, Snippets
from modlhmp.scoring.recording import score_recording
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import density_maps
from modlhmp.tracks import Tracks, write_tracks

HALL = Dataset(name="hall", title="Hall", label="atc", reader="atc", time_step_s=2.0, horizon_s=12.0, demo=True)
STEPS = 6
METHODS = {"cvm": "CVM", "snippets": "Snippets", "tc_cliff": "TC-CLiFF", "theirs": "Theirs"}
SHOWN = Method(name="tc_cliff", kind="tc_cliff", options=RollOut())


def make_run(layout, rows=4 + STEPS):
    """Five people who walk along x; CVM's errors, by which the third is the example."""
    ids = np.repeat(np.arange(1, 6), rows)
    x, t = np.tile(2.0 * np.arange(rows), 5), np.tile(1.9e9 + 2.0 * np.arange(rows), 5)
    tracks = Tracks(ids, t, x, ids.astype(float), np.ones(len(ids)), np.zeros(len(ids)))
    write_tracks(tracks, layout.tracks("hall", "day"))
    xy = np.zeros((5, 1, STEPS, 2), np.float32)
    xy[..., 0], xy[..., 1] = 6.0 + 2.0 * np.arange(1, STEPS + 1), (2 * np.arange(1, 6))[:, None, None]
    line = Forecast(xy, np.zeros((5, 1, STEPS), np.float32), np.full((5, 1), STEPS, np.int32), "single")
    errors = score_recording(tracks, [(0, np.arange(1, 6), line)], "day", HALL)
    write_parquet(errors, layout.errors("hall", "cvm"))


@pytest.fixture
def planted(monkeypatch):
    """Function (steps_alive): the example's forecast has such futures, future m at y = m."""

    def plant(steps_alive):
        m = len(steps_alive)
        xy = np.zeros((1, m, STEPS, 2), np.float32)
        xy[..., 0], xy[..., 1] = 6.0 + 2.0 * np.arange(1, STEPS + 1), np.arange(m)[:, None]
        forecast = Forecast(xy, np.zeros((1, m, STEPS), np.float32), np.array([steps_alive]), "ranked")
        monkeypatch.setattr(density_maps, "forecast_again", lambda *_: forecast)

    return plant


def draw(layout, method=SHOWN):
    """The plotted numbers."""
    density_maps.draw(layout, [HALL], layout.exhibit("f"), METHODS, {"hall": method.plain()}, 5, 0)
    return pd.read_csv(f"{layout.exhibit('f')}.csv")


def test_density_shows_the_samples_that_are_there(layout, planted):
    """At a sixth, a third and the whole of the horizon; the median is of those who are there."""
    make_run(layout)
    planted([6, 0, 1, 6, 2])
    table = draw(layout)
    assert set(table["track_id"]) == {3}
    samples = table[table["what"] == "sample"]
    there = {step: group["rank"].tolist() for step, group in samples.groupby("step_s")}
    assert there == {2: [1, 3, 4, 5], 4: [1, 4, 5], 12: [1, 4]}
    np.testing.assert_allclose(samples["y_m"], samples["rank"] - 1)
    _, _, left = density_maps.example(layout, HALL, METHODS, SHOWN, 5, 0)
    assert left == {1: pytest.approx(0.2), 2: pytest.approx(0.4), 6: pytest.approx(0.6)}
    median = table[table["what"] == "median"]
    assert median["step_s"].tolist() == [0, 2, 4, 6, 8, 10, 12]
    assert median["y_m"].iloc[2] == pytest.approx(3, abs=0.05)
    assert image.imread(f"{layout.exhibit('f')}.png").std() > 0


def test_density_of_nobody_there(layout, planted):
    """All have left: their last positions are shown, and that they have left."""
    make_run(layout)
    planted([0, 0, 0])
    table = draw(layout)
    assert table[table["what"] == "sample"].groupby("step_s").size().tolist() == [3, 3, 3]


def test_density_without_a_long_track(layout):
    """A labelled panel and an empty table, no crash."""
    make_run(layout, rows=2 + STEPS)
    assert len(draw(layout)) == 0


def test_the_forecast_is_made_again_with_more_samples(layout):
    """By the method's own map and options; a snippet map of people who all walk on leaves nobody behind."""
    make_run(layout)
    ids = np.repeat(np.arange(9), 30)
    x, t = np.tile(2.0 * np.arange(30), 9), np.tile(1.8e9 + 2.0 * np.arange(30), 9)
    people = Tracks(ids, t, x, ids.astype(float), np.ones(len(ids)), np.zeros(len(ids)))
    write_parquet(snippets.build(people, HALL, SnippetBuilding(length_s=8.0)), layout.map("hall", "snippets"))
    table = draw(layout, Method(name="snippets", kind="snippets", options=Snippets(k=3)))
    samples = table[table["what"] == "sample"]
    assert samples.groupby("step_s").size().to_dict() == {2: 5, 4: 5, 12: 5}
    np.testing.assert_allclose(samples["x_m"], 6 + samples["step_s"], atol=1e-4)


def test_the_forecast_of_others_is_the_one_that_they_made(layout):
    """From outside, as of a network: samples of the run's file, which nothing here could make again."""
    make_run(layout)
    xy = np.zeros((5, 4, STEPS, 2), np.float32)
    xy[..., 0], xy[..., 1] = 6.0 + 2.0 * np.arange(1, STEPS + 1), np.arange(4)[None, :, None] + 10
    made = Forecast(xy, np.zeros((5, 4, STEPS), np.float32), np.full((5, 4), STEPS, np.int32), "likeliest")
    write_forecasts(layout.forecast("hall", "theirs", "day"), [(0, np.arange(1, 6), made)])
    table = draw(layout, Method(name="theirs", kind="forecasts", options=HandedIn(folder="theirs")))
    samples = table[table["what"] == "sample"]
    assert samples.groupby("step_s").size().to_dict() == {2: 4, 4: 4, 12: 4}
    np.testing.assert_allclose(samples["y_m"], samples["rank"] + 9)
