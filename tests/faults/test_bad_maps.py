"""Maps with memory: damaged, foreign and empty files, and training recordings with hardly anybody in them."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from modlhmp.forecasting.recording import forecast_recording
from modlhmp.maps import episodes, exits, snippets
from modlhmp.methods import make_forecaster
from modlhmp.options import Episodes, Snippets
from modlhmp.site import Site
from modlhmp.storage import DataError, write_parquet
from modlhmp.tracks import Tracks, concatenate, write_tracks

SITE = Site(
    difference_weights=(0.48, 0.33, 0.19), observed_rows=4, time_step_s=1.0, horizon_s=8.0, timezone="Europe/London",
    velocity="differences",
)  # fmt: skip
METRIC = {"heading_m": 8.0, "speed_m": 8.0, "change_m": 2.0, "hour_m": 1.0, "pace": 1.0, "exclude_s": 0.0}
OPTIONS = {
    "episodes": Episodes(persons=5, reach_m=10.0, **METRIC),
    "snippets": Snippets(k=5, length_s=5.0, most=50, bandwidth_m=1.5, exits=True, **METRIC),
}
BUILD = {"episodes": episodes.build, "snippets": snippets.build, "exits": exits.build}
NAMES = {"episodes": "an episode map", "snippets": "a snippet flow map", "exits": "a map of ways out"}
FORMS = list(BUILD)


class Anywhere:
    """A map of dynamics to give ways out to."""

    draws = 1


def people(number, rows=12, began=1.3e9, apart=1.0):
    """So many people who walk east side by side, one after the other."""
    unknown = np.full(rows, np.nan)
    return concatenate(
        Tracks(np.full(rows, n), began + apart * n + np.arange(rows), 1.2 * np.arange(rows), np.full(rows, 0.3 * n),
               unknown, unknown)
        for n in range(number)
    )  # fmt: skip


def load(form, path):
    """The forecaster of a map's file, or the map with ways out."""
    if form == "exits":
        return exits.with_exits(Anywhere(), path, SITE)
    return make_forecaster(form, OPTIONS[form], SITE, path)


def refused(form, path, *parts):
    """The message with which a map's file is refused: it names the file and all of `parts`."""
    with pytest.raises(DataError) as error:
        load(form, path)
    for part in (path.name, *parts):
        assert part in str(error.value)


def forecast(form, path, tracks):
    """Forecast of the usable tracks of a recording with a map's file."""
    seeds = forecast_recording(tracks, load(form, path), SITE, ("a", form, "b"), 5, [0])
    return next(seeds)[2]


@pytest.fixture
def good(tmp_path):
    """Folder of a good map of each form, named after it."""
    for form, build in BUILD.items():
        write_parquet(build(people(9), SITE), tmp_path / f"{form}.parquet")
    return tmp_path


@pytest.mark.parametrize("form", FORMS)
def test_the_good_files_are_good(good, form):
    load(form, good / f"{form}.parquet")


@pytest.mark.parametrize("form", FORMS)
def test_a_missing_map(tmp_path, form):
    refused(form, tmp_path / "nothing.parquet", "no such file", "run the workflow again")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("damage", ["empty", "cut", "text", "changed"])
def test_a_damaged_map(good, form, damage):
    path = good / f"{form}.parquet"
    content = path.read_bytes()
    path.write_bytes({
        "empty": b"",
        "cut": content[:-100],
        "text": b"person,t,x,y\n1,2,3,4\n",
        "changed": content[:60] + b"\x00" * 200 + content[260:],
    }[damage])  # fmt: skip
    refused(form, path, "not as it was written" if damage == "changed" else "cannot be read", "delete it and make")


@pytest.mark.parametrize(("form", "other"), [(a, b) for a in FORMS for b in (*FORMS, "tracks") if a != b])
def test_a_map_of_another_form(good, form, other):
    write_tracks(people(9), good / "tracks.parquet")
    refused(form, good / f"{other}.parquet", f"not {NAMES[form]}", "no column")


@pytest.mark.parametrize(
    ("form", "lost"), [("episodes", ["step"]), ("snippets", ["cell", "step"]), ("exits", ["cell", "step"])]
)
def test_a_map_that_has_lost_its_metadata(tmp_path, form, lost):
    """As another program may have written it: nothing tells its time step, or how large its cells are."""
    table = BUILD[form](people(9), SITE)
    write_parquet(table.replace_schema_metadata(None), tmp_path / "map.parquet")
    refused(form, tmp_path / "map.parquet", f"not {NAMES[form]}", *lost)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("value", [np.nan, np.inf, None, "a"])
@pytest.mark.parametrize("rows", ["one", "all"])
def test_a_map_of_what_is_no_number(tmp_path, form, value, rows):
    table = BUILD[form](people(9), SITE)
    at, name = next((at, name) for at, name in enumerate(table.column_names) if name in {"x", "left"})
    values = [value, *([value] * (len(table) - 1) if rows == "all" else table[name].to_pylist()[1:])]
    values = [str(one) for one in values] if value == "a" else values
    write_parquet(table.set_column(at, name, pa.array(values)), tmp_path / "map.parquet")
    refused(form, tmp_path / "map.parquet", f"column {name}")


@pytest.mark.parametrize("form", FORMS)
def test_a_map_of_another_time_step(tmp_path, form):
    """Its steps would be taken for the forecast's."""
    write_parquet(BUILD[form](people(9), replace(SITE, time_step_s=0.5)), tmp_path / "map.parquet")
    refused(form, tmp_path / "map.parquet", NAMES[form], "steps of 0.5 s", "steps of 1 s")


@pytest.mark.parametrize("form", OPTIONS)
@pytest.mark.parametrize("chunks", ["one", "none"])
def test_an_empty_map_leaves_constant_velocity(tmp_path, form, chunks):
    table = BUILD[form](people(9), SITE).slice(0, 0)
    if chunks == "none":
        columns = [pa.chunked_array([], field.type) for field in table.schema]
        table = pa.table(columns, schema=table.schema)
    write_parquet(table, tmp_path / "map.parquet")
    got = forecast(form, tmp_path / "map.parquet", people(3))
    assert not got.steps_alive.any()
    np.testing.assert_allclose(got.xy[:, 0, :, 0], np.broadcast_to(3.6 + 1.2 * np.arange(1, 9), (3, 8)), atol=1e-4)


def test_an_empty_map_of_ways_out_lets_everyone_stay(tmp_path):
    write_parquet(exits.build(people(9), SITE).slice(0, 0), tmp_path / "map.parquet")
    mod = load("exits", tmp_path / "map.parquet")
    assert mod.leaving(*np.zeros((4, 5))).tolist() == [0.0] * 5


@pytest.mark.parametrize("form", OPTIONS)
@pytest.mark.parametrize(
    "training",
    [people(3), people(1), people(5, rows=4), people(300, apart=12.0)],
    ids=["three", "one", "short", "an hour"],
)
def test_a_training_recording_with_hardly_anybody_is_enough(tmp_path, form, training):
    """Also where all were there within one clock hour, or nobody for long enough."""
    write_parquet(BUILD[form](training, SITE), tmp_path / "map.parquet")
    got = forecast(form, tmp_path / "map.parquet", people(3))
    assert np.isfinite(got.xy).all()
    assert (got.steps_alive > 0).any() == (len(training.t) != 20)
    np.testing.assert_allclose(got.xy[:, 0, 0, 0], 4.8, atol=0.05)


@pytest.mark.parametrize("form", FORMS)
def test_a_position_far_away_is_explained(tmp_path, form):
    """One person kilometres off must not fill the memory: a lattice is refused, an episode map has none."""
    far = people(9)
    far = far._replace(x=np.where(far.track_id == 8, far.x + 9e6, far.x), y=np.where(far.track_id == 8, 9e6, far.y))
    write_parquet(BUILD[form](far, SITE), tmp_path / "map.parquet")
    if form == "episodes":
        load(form, tmp_path / "map.parquet")
    else:
        with pytest.raises(DataError, match="some recorded positions are far away"):
            load(form, tmp_path / "map.parquet")
