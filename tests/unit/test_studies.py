"""Parameter studies: the fixed sample of tracks, and variants that differ by the parameter alone."""

import numpy as np
import pytest

from modlhmp.forecasting import forecast_recording, make_forecaster
from modlhmp.maps import cliff
from modlhmp.scoring import score_recording
from modlhmp.scoring.studies import sample_tracks, vary
from modlhmp.storage import write_parquet
from modlhmp.tracks import Tracks

DATASET = {"name": "hall", "observed_rows": 4, "horizon_s": 8.0, "time_step_s": 1.0, "timezone": "UTC",
           "velocity": "columns", "paper_protocol": {"idle_filter": None}}  # fmt: skip
OPTIONS = {
    "k": 3, "beta": 1.0, "sampling_radius_m": 1.0, "speed": "constant", "velocity": "columns", "output": "ranked",
    "exits": False,
}  # fmt: skip
METHOD = {"name": "cliff", "kind": "cliff", "options": OPTIONS}


def people(first, number, rows=16):
    """Walkers with a noisy heading."""
    rng = np.random.default_rng(first)
    ids = np.repeat(np.arange(first, first + number), rows)
    t = np.tile(1.9e9 + np.arange(rows), number)
    heading = rng.normal(0, 0.5, (number, rows))
    x, y = (np.cumsum(part(heading), axis=1).ravel() for part in (np.cos, np.sin))
    return Tracks(ids, t, x, y, np.ones(len(t)), heading.ravel())


@pytest.fixture
def map_path(tmp_path):
    """A CLiFF-map of 60 walkers."""
    write_parquet(cliff.build(people(1000, 60)), tmp_path / "cliff.parquet")
    return tmp_path / "cliff.parquet"


def test_all_tracks_if_they_are_few():
    days = {"a": people(1, 20), "b": people(50, 30)}
    assert sample_tracks(days, DATASET, 50) is days


def test_a_sample_is_fixed_and_fair():
    """About the wanted number; the same tracks whatever the order of days or of tracks; whole tracks only."""
    days = {"a": people(1, 400), "b": people(500, 600)}
    sample = sample_tracks(days, DATASET, 250)
    ids = {name: set(tracks.track_id.tolist()) for name, tracks in sample.items()}
    assert sum(map(len, ids.values())) == 250
    assert 60 < len(ids["a"]) < 140  # 100 expected of the 400
    turned = {"b": days["b"].take(np.argsort(-days["b"].track_id, kind="stable")), "a": days["a"]}
    again = sample_tracks(turned, DATASET, 250)
    assert {name: set(tracks.track_id.tolist()) for name, tracks in again.items()} == ids
    assert all((np.diff(tracks.bounds()) == 16).all() for tracks in sample.values())


def test_the_default_value_gives_the_main_run_s_errors(map_path):
    """Same random numbers, same forecasts: the study's row at the default is the table's."""
    day = people(1, 40)
    variants = dict(vary("beta", [0.1, 1.0], METHOD, {"day": day}, DATASET, map_path, [0, 1]))
    forecaster = make_forecaster("cliff", OPTIONS, DATASET, map_path)
    forecasts = forecast_recording(day, forecaster, DATASET, ("hall", "cliff", "day"), 3, [0, 1])
    main = score_recording(day, forecasts, "day", DATASET)
    for name in ("ade", "fde"):
        default, other, ours = (np.stack(table[name].to_numpy()) for table in (variants[1.0], variants[0.1], main))
        np.testing.assert_array_equal(default, ours)
        assert (other[np.isfinite(other) & np.isfinite(ours)] != ours[np.isfinite(other) & np.isfinite(ours)]).any()


def test_a_larger_radius_keeps_more_walkers_on_the_map(map_path):
    """The parameter reaches the map: with r_s = 3 m nobody is lost who was not with 0.5 m."""
    variants = dict(vary("sampling_radius_m", [0.5, 3.0], METHOD, {"day": people(1, 40)}, DATASET, map_path, [0]))
    scored = {value: table["scored_steps"].to_numpy().sum() for value, table in variants.items()}
    assert scored[3.0] > scored[0.5]
