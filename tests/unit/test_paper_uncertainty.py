"""Exhibits of distributions: the table's cells, the bins behind the figures, the person that is shown."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from matplotlib import image

from modlhmp.forecasting.base import Forecast
from modlhmp.scoring import score_recording
from modlhmp.scoring.uncertainty import MEASURES
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import calibration, density_maps, uncertainty_table
from modlhmp.tracks import Tracks, write_tracks

HALL = {"name": "hall", "title": "Hall", "label": "atc", "reader": "atc", "observed_rows": 4, "horizon_s": 12.0,
        "time_step_s": 2.0, "timezone": "UTC", "floor_plan": [], "areas": [], "demo": True,
        "paper_protocol": {"idle_filter": None}}  # fmt: skip
STEPS = 6
METHODS = {"cvm": "CVM", "snippets": "Snippets", "tc_cliff": "TC-CLiFF"}
MEASURED = ["snippets", "tc_cliff"]


def write_measures(folder, method, horizons=(4.0, 12.0), tracks=60, factor=1.0, known=True):
    """A file of one seed: track n expects an error of n / 10 m and errs by `factor` times that; the odd ones left."""
    n = np.arange(tracks, dtype=np.float32)
    values = dict.fromkeys(MEASURES, n / 10 * factor) | {"expected_m": n / 10, "samples": n * 0 + 40}
    has_left = n % 2
    values = {name: np.where(has_left * known, np.nan, one) if known else one * np.nan for name, one in values.items()}
    values |= {"left": n / tracks, "has_left": has_left}
    lists = {
        name: pa.FixedSizeListArray.from_arrays(
            pa.array(np.repeat(one.astype(np.float32), len(horizons))), len(horizons)
        )
        for name, one in values.items()
    }
    table = pa.table({"recording": ["day"] * tracks, "track_id": n.astype(int), "seed": n.astype(int) * 0, **lists})
    write_parquet(table, folder / f"hall/uncertainty/{method}.parquet", horizons_s=list(horizons))


def test_the_table_s_cells_by_hand(tmp_path):
    write_measures(tmp_path, "tc_cliff", factor=2.0)
    write_measures(tmp_path, "snippets")
    uncertainty_table.write(tmp_path, [HALL], {m: METHODS[m] for m in MEASURED}, str(tmp_path / "t"))
    table = pd.read_csv(tmp_path / "t.csv")
    assert table["horizon [s]"].tolist() == [4, 4, 12, 12]
    assert table["method"].tolist() == ["Snippets", "TC-CLiFF"] * 2
    row = table.iloc[1]
    assert row["expected error [m]"] == pytest.approx(2.9)  # of the 30 even ones
    assert row["real error [m]"] == row["energy score [m]"] == pytest.approx(5.8)
    assert (row["real / expected"], row["n"], row["has left: n"], row["have left [%]"]) == (2.0, 30, 60, 50.0)
    n = np.arange(60)
    assert row["has left: Brier"] == pytest.approx(((n / 60 - n % 2) ** 2).mean(), abs=6e-4)
    assert row["base rate's Brier"] == 0.25
    text = (tmp_path / "t.md").read_text()
    assert "| **2.900** |" in text
    assert "**5.800**" not in text  # the best is bold
    for kind in ("md", "html", "tex"):
        assert "Demo data" in (tmp_path / f"t.{kind}").read_text()


def test_a_table_of_nobody_long_enough(tmp_path):
    """A dash and n 0, not a crash."""
    write_measures(tmp_path, "snippets", known=False)
    uncertainty_table.write(tmp_path, [HALL], {"snippets": "Snippets"}, str(tmp_path / "t"))
    table = pd.read_csv(tmp_path / "t.csv")
    assert set(table["energy score [m]"]) == set(table["real / expected"]) == {"–"}
    assert set(table["n"]) == {0}


def test_calibration_holds_its_bins(tmp_path):
    """All methods and horizons: ten bins of three tracks, twice too sure for the second; probabilities beside them."""
    write_measures(tmp_path, "snippets")
    write_measures(tmp_path, "tc_cliff", factor=2.0)
    calibration.draw(tmp_path, [HALL], METHODS, MEASURED, str(tmp_path / "f"))
    table = pd.read_csv(tmp_path / "f.csv")
    assert table.groupby(["what", "method", "horizon_s"]).size().tolist() == [10] * 8
    errors = table[table["what"] == "error"]
    assert set(errors["n"]) == {3}
    for method, factor in (("snippets", 1.0), ("tc_cliff", 2.0)):
        one = errors[errors["method"] == method]
        np.testing.assert_allclose(one["outcome"], factor * one["forecast"], rtol=1e-5)
    left = table[table["what"] == "left"]
    assert set(left["n"]) == {6}
    np.testing.assert_allclose(left["outcome"], 0.5)


def test_the_longest_horizon_and_one_near_a_third_are_shown():
    assert calibration.shown_horizons([5, 10, 20, 30, 60], 60) == [20, 60]
    assert calibration.shown_horizons([5, 10, 20], 20) == [5, 20]
    assert calibration.shown_horizons([12.0], 12.0) == [12.0]


@pytest.mark.parametrize("known", [True, False])
def test_calibration_of_one_horizon_or_of_nobody(tmp_path, known):
    """Panels that have nothing to show are left out, or say so."""
    write_measures(tmp_path, "snippets", horizons=[12.0], known=known)
    seen = []
    calibration.style.empty_panel, kept = (lambda ax, text: seen.append(text)), calibration.style.empty_panel
    try:
        calibration.draw(tmp_path, [HALL], METHODS, ["snippets"], str(tmp_path / "f"))
    finally:
        calibration.style.empty_panel = kept
    assert seen == ([] if known else ["Hall, 12 s\nno test track is as long"])


def make_run(folder, rows=4 + STEPS):
    """Five people who walk along x; CVM's errors, by which the third is the example."""
    ids = np.repeat(np.arange(1, 6), rows)
    x, t = np.tile(2.0 * np.arange(rows), 5), np.tile(1.9e9 + 2.0 * np.arange(rows), 5)
    tracks = Tracks(ids, t, x, ids.astype(float), np.ones(len(ids)), np.zeros(len(ids)))
    write_tracks(tracks, folder / "hall/tracks/day.parquet")
    xy = np.zeros((5, 1, STEPS, 2), np.float32)
    xy[..., 0], xy[..., 1] = 6.0 + 2.0 * np.arange(1, STEPS + 1), (2 * np.arange(1, 6))[:, None, None]
    line = Forecast(xy, np.zeros((5, 1, STEPS), np.float32), np.full((5, 1), STEPS, np.int32), "single")
    errors = score_recording(tracks, [(0, np.arange(1, 6), line)], "day", HALL)
    write_parquet(errors, folder / "hall/errors/cvm.parquet")


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


def draw(folder, methods=METHODS):
    by = {"hall": {"kind": "tc_cliff", "options": {}}}
    density_maps.draw(folder, [HALL], methods, "tc_cliff", by, 5, 0, str(folder / "f"))
    return pd.read_csv(folder / "f.csv")


def test_density_shows_the_samples_that_are_there(tmp_path, planted):
    """At a sixth, a third and the whole of the horizon; the median is of those who are there."""
    make_run(tmp_path)
    planted([6, 0, 1, 6, 2])
    table = draw(tmp_path)
    assert set(table["track_id"]) == {3}
    samples = table[table["what"] == "sample"]
    there = {step: group["rank"].tolist() for step, group in samples.groupby("step_s")}
    assert there == {2: [1, 3, 4, 5], 4: [1, 4, 5], 12: [1, 4]}
    np.testing.assert_allclose(samples["y_m"], samples["rank"] - 1)
    _, _, left = density_maps.example(tmp_path / "hall", HALL, METHODS, {"name": "tc_cliff"}, 5, 0)
    assert left == {1: pytest.approx(0.2), 2: pytest.approx(0.4), 6: pytest.approx(0.6)}
    median = table[table["what"] == "median"]
    assert median["step_s"].tolist() == [0, 2, 4, 6, 8, 10, 12]
    assert median["y_m"].iloc[2] == pytest.approx(3, abs=0.05)
    assert image.imread(tmp_path / "f.png").std() > 0


def test_density_of_nobody_there(tmp_path, planted):
    """All have left: their last positions are shown, and that they have left."""
    make_run(tmp_path)
    planted([0, 0, 0])
    table = draw(tmp_path)
    assert table[table["what"] == "sample"].groupby("step_s").size().tolist() == [3, 3, 3]


def test_density_without_a_long_track(tmp_path):
    """A labelled panel and an empty table, no crash."""
    make_run(tmp_path, rows=2 + STEPS)
    assert len(draw(tmp_path)) == 0
