"""Studies: the fixed sample of tracks, variants that differ by the parameter alone, maps from fewer tracks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from modlhmp.forecasting.recording import forecast_recording
from modlhmp.kinds import BUILT_IN, find
from modlhmp.maps import cliff, episodes, exits, snippets
from modlhmp.methods import Method, make_forecaster
from modlhmp.options import (
    CliffBuilding,
    Episodes,
    ExitBuilding,
    NoBuilding,
    Pooled,
    RollOut,
    SnippetBuilding,
    Snippets,
)
from modlhmp.scoring.recording import score_recording
from modlhmp.site import PaperProtocol, Site
from modlhmp.storage import write_parquet
from modlhmp.study import studies
from modlhmp.study.studies import sample_tracks, vary, vary_training
from modlhmp.tracks import Tracks

SITE = Site(
    observed_rows=4, horizon_s=8.0, time_step_s=1.0, timezone="UTC", velocity="as_recorded",
    paper_protocol=PaperProtocol(idle_filter=None), difference_weights=(0.48, 0.33, 0.19),
)  # fmt: skip
OPTIONS = RollOut(
    k=3, beta=1.0, sampling_radius_m=1.0, speed="constant", velocity="dataset", output="ranked", exits=False
)
METHOD = Method(name="cliff", kind="cliff", options=OPTIONS)


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
    assert sample_tracks(days, "hall", SITE, 50) is days


def test_a_sample_is_fixed_and_fair():
    """About the wanted number; the same tracks whatever the order of days or of tracks; whole tracks only."""
    days = {"a": people(1, 400), "b": people(500, 600)}
    sample = sample_tracks(days, "hall", SITE, 250)
    ids = {name: set(tracks.track_id.tolist()) for name, tracks in sample.items()}
    assert sum(map(len, ids.values())) == 250
    assert 60 < len(ids["a"]) < 140  # 100 expected of the 400
    turned = {"b": days["b"].take(np.argsort(-days["b"].track_id, kind="stable")), "a": days["a"]}
    again = sample_tracks(turned, "hall", SITE, 250)
    assert {name: set(tracks.track_id.tolist()) for name, tracks in again.items()} == ids
    assert all((np.diff(tracks.bounds()) == 16).all() for tracks in sample.values())


@pytest.mark.parametrize("leaves", [False, True])
def test_the_default_value_gives_the_main_run_s_errors(map_path, leaves):
    """Same random numbers, same forecasts: the study's row at the default is the table's, of methods with exits too."""
    day, method = people(1, 40), replace(METHOD, options=replace(OPTIONS, exits=leaves))
    ways_out = map_path.with_name("exits.parquet")
    write_parquet(exits.build(people(1000, 60), SITE), ways_out)
    variants = dict(
        vary("beta", [0.1, 1.0], method, {"day": day}, "hall", SITE, map_path, [0, 1], exits=ways_out if leaves else [])
    )
    forecaster = make_forecaster("cliff", method.options, SITE, map_path, ways_out)
    forecasts = forecast_recording(day, forecaster, SITE, ("hall", "cliff", "day"), 3, [0, 1])
    main = score_recording(day, forecasts, "day", SITE)
    for name in ("ade", "fde"):
        default, other, ours = (np.stack(table[name].to_numpy()) for table in (variants[1.0], variants[0.1], main))
        np.testing.assert_array_equal(default, ours)
        assert (other[np.isfinite(other) & np.isfinite(ours)] != ours[np.isfinite(other) & np.isfinite(ours)]).any()


def test_a_larger_radius_keeps_more_walkers_on_the_map(map_path):
    """The parameter reaches the map: with r_s = 3 m nobody is lost who was not with 0.5 m."""
    days = {"day": people(1, 40)}
    variants = dict(vary("sampling_radius_m", [0.5, 3.0], METHOD, days, "hall", SITE, map_path, [0]))
    scored = {value: table["scored_steps"].to_numpy().sum() for value, table in variants.items()}
    assert scored[3.0] > scored[0.5]


# --- less training data -------------------------------------------------------------------------------------

UNLIKE = {"heading_m": 8.0, "speed_m": 6.0, "change_m": 2.0, "hour_m": 0.0, "pace": 1.0, "exclude_s": 0.0}
THREE = [
    METHOD,
    Method(name="replay", kind="episodes", options=Episodes(persons=5, reach_m=10.0, **UNLIKE)),
    Method(
        name="chain",
        kind="snippets",
        options=Snippets(k=8, length_s=3.0, most=9, bandwidth_m=1.2, exits=True, **UNLIKE),
    ),
    Method(name="pool", kind="pooled", options=Pooled(k=8, persons=5)),
]
BUILDINGS = {
    "cliff": CliffBuilding(resolution_m=1.0, radius_m=1.0, min_observations=5, bandwidth="isotropic"),
    "episodes": NoBuilding(),
    "snippets": SnippetBuilding(cell_m=1.0, length_s=4.0, most=20),
    "pooled": NoBuilding(),
    "exits": ExitBuilding(cell_m=1.0),
}


def trained(shares, methods=THREE, training=None, day=None, seeds=(0, 1)):
    """{(share, method): errors} of maps from these shares."""
    training, day = people(1000, 60) if training is None else training, people(1, 25) if day is None else day
    kinds = {"exits", *(method.kind for method in methods)}
    buildings = {kind: building for kind, building in BUILDINGS.items() if kind in kinds}
    drawn = {method.name: find(method.kind).seeds(seeds) for method in methods}
    found = vary_training(shares, methods, training, {"day": day}, "hall", SITE, buildings, drawn)
    return {(share, name): errors for share, name, errors in found}


@pytest.fixture
def built(monkeypatch):
    """The tracks from which the episode map of each share is built, in their order."""
    seen, build = [], studies.build_map

    def build_and_note(kind, tracks, *rest):
        if kind == "episodes":
            seen.append(tracks)
        return build(kind, tracks, *rest)

    monkeypatch.setattr(studies, "build_map", build_and_note)
    return seen


def test_all_of_the_tracks_give_the_main_run_s_errors(tmp_path):
    """A share of 1 is the map itself: same random numbers, same errors, for every kind."""
    whole, day = people(1000, 60), people(1, 25)
    tables = {
        "cliff": cliff.build(whole, SITE, BUILDINGS["cliff"]),
        "episodes": episodes.build(whole, SITE),
        "snippets": snippets.build(whole, SITE, BUILDINGS["snippets"]),
        "pooled": episodes.build(whole, SITE),
    }
    study = trained([1.0], training=whole, day=day)
    for method in THREE:
        name, kind, options = method.name, method.kind, method.options
        write_parquet(tables[kind], tmp_path / f"{kind}.parquet")
        forecaster = make_forecaster(kind, options, SITE, tmp_path / f"{kind}.parquet")
        drawn = [0] if kind == "episodes" else [0, 1]
        forecasts = forecast_recording(day, forecaster, SITE, ("hall", name, "day"), getattr(options, "k", 1), drawn)
        assert study[1.0, name].equals(score_recording(day, forecasts, "day", SITE))


def test_the_ways_out_are_those_of_the_same_share():
    """A method that samples its map may use them: fewer of its particles are still there."""
    out = Method(name="out", kind="cliff", options=replace(OPTIONS, exits=True, output="geometric_median", k=20))
    stay = replace(out, name="stay", options=replace(out.options, exits=False))
    found = trained([0.5], [out, stay])
    ends = {name: np.stack(found[0.5, name]["fde"].to_numpy())[:, -1] for name in ("out", "stay")}
    assert np.isfinite(ends["out"]).any()
    assert not np.array_equal(ends["out"], ends["stay"], equal_nan=True)


def test_every_share_and_method_comes_once_with_its_seeds():
    found = trained([0.2, 1.0])
    assert list(found) == [(share, method.name) for share in (0.2, 1.0) for method in THREE]
    for (_, name), errors in found.items():
        assert set(errors["seed"].to_pylist()) == ({0} if name == "replay" else {0, 1})
        assert set(errors["track_id"].to_pylist()) == set(range(1, 26))


def test_a_larger_share_holds_all_that_a_smaller_one_does(built):
    """Whole tracks, about as many as asked for, the same ones whatever the other shares are; 1 is all."""
    training, shares = people(1000, 600, rows=6), [0.05, 0.3, 0.6, 1.0]
    trained(shares, THREE[1:2], training)
    ids = [set(tracks.track_id.tolist()) for tracks in built]
    assert all(smaller < larger for smaller, larger in pairwise(ids))
    for share, tracks, some in zip(shares, built, ids, strict=True):
        assert len(some) == pytest.approx(600 * share, abs=4 * np.sqrt(600 * share * (1 - share)))
        assert (np.diff(tracks.bounds()) == 6).all()
        for column, other in zip(tracks, training, strict=True):
            np.testing.assert_array_equal(column, other[np.isin(training.track_id, list(some))])
    built.clear()
    trained([0.3], THREE[1:2], training)
    assert set(built[0].track_id.tolist()) == ids[1]


def test_fewer_tracks_forecast_differently():
    """The share reaches every kind of map."""
    found = trained([0.1, 1.0])
    for method in THREE:
        few, all_ = (np.stack(found[share, method.name]["fde"].to_numpy()) for share in (0.1, 1.0))
        assert not np.array_equal(few, all_, equal_nan=True)


def test_a_share_of_nobody_still_has_errors():
    """An empty map: everybody is forecast by constant velocity in the complete protocol, or not at all."""
    found = trained([1e-12])
    for errors in found.values():
        rows = errors.to_pandas()
        complete = rows[rows["protocol"] == "complete"]
        assert (complete["scored_steps"] == complete["eligible_steps"]).all()


def test_every_kind_that_says_so_can_be_built_from_a_share():
    """The configuration asks the kind's record: what is tried above are all that it lets through."""
    assert {kind.name for kind in BUILT_IN if kind.from_share} == set(BUILDINGS)
    assert {name for name in BUILDINGS if find(name).forecasts} == {method.kind for method in THREE}
