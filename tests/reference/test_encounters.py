"""Forecasts that run into others: planted meetings, a slow loop, and who does not count."""

import math

import numpy as np
import pandas as pd
import pytest

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import Forecast
from modlhmp.scoring.encounters import TOUCH_M, encounters
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import encounters_table
from modlhmp.study.layout import Layout
from modlhmp.tracks import Tracks, concatenate, together

STEPS = 8
SITE = Site(horizon_s=STEPS)


def track(track_id, t, x, y):
    t, x, y = np.broadcast_arrays(np.asarray(t, float), x, y)
    return Tracks(np.full(len(t), track_id), t, x * 1.0, y * 1.0, np.ones(len(t)), np.zeros(len(t)))


def ahead(tracks, xy):
    """A forecast of one path per track."""
    n = len(xy)
    fitness, alive = np.zeros((n, 1, STEPS), np.float32), np.full((n, 1), STEPS, np.int32)
    return [(0, np.unique(tracks.track_id), Forecast(xy[:, None].astype(np.float32), fitness, alive, "single"))]


def test_a_planted_meeting():
    """Two who walk towards each other on lines 1 m apart; the forecast of the first swerves onto the other's line."""
    t = np.arange(12.0)
    both = concatenate([track(3, t, t, 0.0), track(5, t, 18.0 - t, 1.0)])
    straight = np.stack([np.column_stack([4.0 + np.arange(STEPS), np.zeros(STEPS)]),
                         np.column_stack([14.0 - np.arange(STEPS), np.ones(STEPS)])])  # fmt: skip
    swerving = straight.copy()
    swerving[0, :, 1] = 1.0  # at t = 9 both are at (9, 1)
    met, truth, length = encounters(both, ahead(both, swerving), together([both]), SITE)
    assert met.shape == (1, 2, STEPS)
    assert met[0].tolist() == [[0, 0, 0, 0, 0, 1, 1, 1], [0] * STEPS]
    assert not truth.any() and length.tolist() == [8, 8]
    met, _, _ = encounters(both, ahead(both, straight), together([both]), SITE)
    assert not met.any(), "nobody runs into oneself"


@pytest.mark.parametrize("step_s", [1.0, 6.0])
def test_people_of_other_recordings_count_and_gaps_do_not(step_s):
    """Somebody stands in the way, in another recording; one who is away for ten steps is nowhere in between."""
    t, site = np.arange(12.0), Site(horizon_s=STEPS * step_s, time_step_s=step_s)
    one = track(0, step_s * t, t, 0.0)
    path = np.column_stack([4.0 + np.arange(STEPS), np.zeros(STEPS)])[None]
    standing, absent = track(0, step_s * t, 7.0, 0.1), track(0, step_s * np.array([0.0, 1.0, 11.0]), 7.0, 0.0)
    met, truth, _ = encounters(one, ahead(one, path), together([one, standing]), site)
    assert met[0, 0].tolist() == truth[0].tolist() == [0, 0, 0, 1, 1, 1, 1, 1]
    met, _, _ = encounters(one, ahead(one, path), together([one, absent]), site)
    assert not met.any()


@pytest.mark.parametrize("seed", range(4))
def test_it_equals_the_loop(seed):
    rng = np.random.default_rng(seed)
    people = [
        track(n, rng.uniform(0, 6) + np.cumsum(rng.choice([0.5, 1.0, 1.3, 6.0], 12, p=[0.3, 0.4, 0.25, 0.05])),
              np.cumsum(rng.normal(0, 0.3, 12)), np.cumsum(rng.normal(0, 0.3, 12)))
        for n in range(10)
    ]  # fmt: skip
    tracks = concatenate(people)
    usable = [p for p in people if np.diff(p.t).max() <= 5.0]
    xy = rng.normal(0, 0.7, (len(usable), STEPS, 2))
    forecast = Forecast(xy[:, None].astype(np.float32), np.zeros((len(usable), 1, STEPS), np.float32),
                        np.full((len(usable), 1), STEPS, np.int32), "single")  # fmt: skip
    ids = np.array([p.track_id[0] for p in usable])
    met, _, length = encounters(tracks, [(0, ids, forecast)], together([tracks]), SITE)
    for row, own in enumerate(usable):
        touched = False
        for step in range(STEPS):
            now = own.t[3] + step + 1
            for other in people:
                if other.track_id[0] == own.track_id[0]:
                    continue
                for a in range(len(other.t) - 1):
                    if other.t[a] <= now < other.t[a + 1] and other.t[a + 1] - other.t[a] <= 5.0:
                        part = (now - other.t[a]) / (other.t[a + 1] - other.t[a])
                        there = [c[a] + part * (c[a + 1] - c[a]) for c in (other.x, other.y)]
                        touched |= math.dist(np.float32(xy[row, step]).tolist(), there) < TOUCH_M
            if step < length[row]:
                assert met[0, row, step] == touched
            else:
                assert math.isnan(met[0, row, step])


def test_seeds_and_no_tracks():
    t = np.arange(12.0)
    one = track(0, t, t, 0.0)
    path = np.column_stack([4.0 + np.arange(STEPS), np.zeros(STEPS)])[None]
    standing = track(0, t, 7.0, 0.1)
    (_, ids, forecast), = ahead(one, path)  # fmt: skip
    away = forecast._replace(xy=forecast.xy + 5)
    met, _, _ = encounters(one, [(0, ids, forecast), (1, ids, away)], together([one, standing]), SITE)
    assert met[:, 0, -1].tolist() == [1, 0]
    few = one.take(slice(0, 3))
    assert encounters(few, [], together([few]), SITE)[1].shape == (0, STEPS)


def test_the_table(tmp_path):
    layout = Layout("try", str(tmp_path))
    hall = Dataset(name="hall", title="Hall", label="atc", reader="atc", horizon_s=12, demo=True)
    rows = {"horizon_s": [5.0, 12.0], "met": [0.123, np.nan], "truth_met": [0.02, np.nan], "n": [40, 0]}
    write_parquet(rows, layout.encounters("hall", "cvm"))
    encounters_table.draw(layout, [hall], str(tmp_path / "t"), {"cvm": "CVM"})
    (row,) = pd.read_csv(tmp_path / "t.csv").to_dict("records")
    assert row == {"dataset": "Hall", "method": "CVM", "5 s": "12.3 (2.0; n 40)", "12 s": "– (n 0)"}
