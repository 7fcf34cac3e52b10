"""Errors under every reading of the scoring rules, by hand and against both protocols' tables."""

import numpy as np
import pandas as pd
import pytest

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import Forecast
from modlhmp.scoring.recording import score_recording
from modlhmp.site import IdleFilter, PaperProtocol, Site
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import readings_table
from modlhmp.study.layout import Layout
from modlhmp.study.readings import COMMON, OWN, UNION, readings
from modlhmp.study.summary import read_errors, summarise
from modlhmp.tracks import Tracks

STEPS = 6
SITE = Site(horizon_s=STEPS, paper_protocol=PaperProtocol(idle_filter=IdleFilter()))


def walkers(number, idle=(), rows=12):
    """Walkers at 1 m/s along x; those of `idle` stand."""
    ids, t = np.repeat(np.arange(number), rows), np.tile(np.arange(float(rows)), number)
    x = np.where(np.isin(ids, idle), 0.0, t)
    return Tracks(ids, t, x, ids * 10.0, np.ones(len(t)), np.zeros(len(t)))


def forecasts(tracks, alive, off):
    """Two seeds of two futures each, `off` [n] m beside the truth; seed s lives `alive[s]` [n] steps."""
    rows = tracks.bounds()[:-1] + 3
    truth = np.stack([np.stack([tracks.x[r + 1 : r + 1 + STEPS], tracks.y[r + 1 : r + 1 + STEPS]], -1) for r in rows])
    for seed, lived in enumerate(alive):
        xy = np.repeat((truth + np.array([0, 1]) * off[:, None, None])[:, None], 2, axis=1).astype(np.float32)
        lives = np.repeat(np.array(lived)[:, None], 2, axis=1).astype(np.int32)
        yield seed, np.arange(len(rows)), Forecast(xy, np.zeros(xy.shape[:3], np.float32), lives, "ranked")


def test_readings_by_hand():
    """Five tracks, the last idle; seed 0 forecasts tracks 0, 1, 4 to the end, seed 1 tracks 0, 2, 4."""
    tracks, off = walkers(5, idle=[4]), np.array([1.0, 2.0, 3.0, 4.0, 10.0])
    alive = [[6, 6, 2, 0, 6], [6, 1, 6, 0, 6]]
    found = readings([(tracks, forecasts(tracks, alive, off), None)], SITE).set_index(["idle", "left", "tracks"])
    expected = {
        ("kept", "held", OWN): (4.0, 5, 5), ("kept", "dropped", OWN): ((13 / 3 + 14 / 3) / 2, 3, 5),
        ("kept", "dropped", UNION): (4.0, 4, 5), ("kept", "dropped", COMMON): (5.5, 2, 5),
        ("dropped", "held", OWN): (2.5, 4, 4), ("dropped", "dropped", OWN): ((1.5 + 2.0) / 2, 2, 4),
        ("dropped", "dropped", UNION): (2.0, 3, 4), ("dropped", "dropped", COMMON): (1.0, 1, 4),
    }  # fmt: skip
    assert found.index.tolist() == list(expected)
    for reading, (ade, n, eligible) in expected.items():
        row = found.loc[reading]
        assert (row["ade_m"], row["fde_m"]) == pytest.approx((ade, ade), rel=1e-6)
        assert (row["n"], row["eligible"]) == (n, eligible)


def test_both_protocols_are_among_them(tmp_path):
    """Held with all tracks is the complete protocol; dropped without idle ones, by seed, is the paper protocol."""
    rng = np.random.default_rng(2)
    tracks, off = walkers(40, idle=[3, 17]), rng.gamma(2, 1, 40)
    alive = rng.integers(0, 2 * STEPS, (2, 40)).clip(max=STEPS).tolist()
    found = readings([(tracks, forecasts(tracks, alive, off), None)], SITE).set_index(["idle", "left", "tracks"])
    write_parquet(score_recording(tracks, forecasts(tracks, alive, off), "day", SITE), tmp_path / "e.parquet")
    table = summarise("d", "m", read_errors(tmp_path / "e.parquet"), 1.0)
    table = table[(table["output"] == "ranked") & (table["horizon_s"] == STEPS)].set_index("protocol")
    for protocol, reading in (("complete", ("kept", "held", OWN)), ("paper", ("dropped", "dropped", OWN))):
        for name in ("ade_m", "fde_m", "n", "eligible"):
            assert found.loc[reading, name] == pytest.approx(table.loc[protocol, name], rel=1e-6)
    common = found.loc[("dropped", "dropped", COMMON)]
    assert (common["ade_m"], common["n"]) == pytest.approx(tuple(table.loc["paper", ["all_ade_m", "all_n"]]), rel=1e-6)


def test_recordings_are_taken_together_and_short_tracks_do_not_count():
    tracks, short, off = walkers(3), walkers(2, rows=8), np.ones(5)
    two = [(tracks, forecasts(tracks, [[6] * 3], off[:3]), None), (short, [(0, np.arange(2), _of(short))], None)]
    found = readings(two, SITE)
    assert set(found["eligible"]) == {3}


def test_a_recording_without_a_usable_track_says_nothing():
    tracks, off = walkers(3), np.ones(3)
    alone = readings([(tracks, forecasts(tracks, [[6] * 3] * 2, off), None)], SITE)
    beside = readings([(walkers(2, rows=3), [], None), (tracks, forecasts(tracks, [[6] * 3] * 2, off), None)], SITE)
    pd.testing.assert_frame_equal(alone, beside)


def _of(tracks):
    n = len(tracks.bounds()) - 1
    return Forecast(
        np.zeros((n, 1, STEPS, 2), np.float32), np.zeros((n, 1, STEPS), np.float32), np.full((n, 1), STEPS, np.int32),
        "ranked",
    )  # fmt: skip


def test_the_table_says_how_far_each_reading_is_from_the_paper(tmp_path):
    """And marks the nearest; a method without a published number has dashes."""
    layout = Layout("try", str(tmp_path))
    hall = Dataset(name="hall", title="Hall", label="atc", reader="atc", horizon_s=60, paper_results="atc", demo=True)
    rows = [("kept", "held", OWN, 10.664, 22.43, 40, 40), ("dropped", "dropped", OWN, 5.4, 11.3, 12.5, 30)]
    for method in ("tc_cliff", "net"):
        table = pd.DataFrame(rows, columns=["idle", "left", "tracks", "ade_m", "fde_m", "n", "eligible"])
        write_parquet(table.to_dict("list"), layout.readings("hall", method))
    readings_table.draw(layout, hall, str(tmp_path / "t"), {"tc_cliff": "TC", "net": "Net"},
                        {"tc_cliff": "tc_cliff", "net": "neural_map"})  # fmt: skip
    table = pd.read_csv(tmp_path / "t.csv")
    assert table["less the paper's [%]"].tolist() == ["'+100 / +100", "'+1 / +1", "–", "–"]
    assert table["n"].tolist()[:2] == ["40/40", "12.5/30"]
    text = (tmp_path / "t.md").read_text()
    assert "**5.400 / 11.300**" in text and "**10.664" not in text
    assert "Demo data" in text
