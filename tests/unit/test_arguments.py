"""Wrong arguments of the library's public names: each is refused by name, with its value and the remedy."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import modlhmp
from modlhmp import DataError, Site
from modlhmp.contract import SITE, crowd

PEOPLE = crowd()
STRAIGHT = np.column_stack([np.arange(4.0), 1.2 * np.arange(4), np.zeros(4)])
CSV = "person;time;x;y\n" + "".join(f"{p};{k};{1.2 * k};{p}\n" for p in (1, 2) for k in range(9))
NAMED = {"columns": {"track_id": "person", "t": "time", "x": "x", "y": "y"}, "separator": ";"}
ODD = [[], {}, np.zeros(2), pd.DataFrame({"a": [1]}), None, 3, True]


def refused(message, call, *arguments, **named):
    with pytest.raises(DataError, match=message):
        call(*arguments, **named)


@pytest.fixture(scope="module")
def futures():
    return modlhmp.forecast("cvm", STRAIGHT, horizon_s=3)


@pytest.mark.parametrize("odd", ODD)
def test_arguments_of_a_wrong_type(futures, odd):
    refused("kind", modlhmp.build_map, odd, PEOPLE)
    refused("tracks are", modlhmp.build_map, "cliff", odd)
    refused("forecast by|kind", modlhmp.forecast, odd, STRAIGHT)
    refused("history", modlhmp.forecast, "cvm", odd)
    refused("futures are", modlhmp.score, odd, PEOPLE)
    refused("truth", modlhmp.score, futures, odd)
    refused("protocol", modlhmp.score, futures, STRAIGHT[None, :, 1:], odd)
    for call in (modlhmp.load_map, modlhmp.read_tracks):
        refused("give a file's path", call, odd)


@pytest.mark.parametrize("path", ["", "a\0b.csv", "a" * 300 + ".parquet", b"a.csv"])
def test_paths_that_no_file_has(path):
    for call in (modlhmp.load_map, modlhmp.read_tracks):
        refused("give a file's path", call, path)


@pytest.mark.parametrize(
    ("named", "message"),
    [
        ({"day": "abc"}, "day 'abc'"),
        ({"day": 3}, "day 3"),
        ({"day": "2026-03-02", "start": "25:00"}, "start '25:00'"),
        ({"cleaning": ["a"]}, "no rule named 'a'"),
        ({"cleaning": [{"min_points": {}}]}, "takes points; write it as {min_points: {points: 3}}"),
        ({"cleaning": [{"min_points": {"points": 3}, "b": {}}]}, "is not one rule"),
        ({"columns": pd.DataFrame()}, "columns"),
        ({"columns": {"track_id": 0, "t": 1, "x": 2, "y": -1}}, "columns.y: -1"),
        ({"columns": {**NAMED["columns"], "y": "x"}}, "x and y are both column 'x'"),
        ({"split": "test"}, "split='test'"),
        ({"data_root": "data"}, "data_root='data'"),
        ({"separator": 3}, "separator"),
        ({"timezone": 3}, "3 is a number, not text"),
    ],
)
def test_a_file_that_is_described_wrongly(write, named, message):
    refused(message, modlhmp.read_tracks, write(CSV), **{**NAMED, **named})


def test_what_a_clean_recording_and_a_dataset_file_say_themselves(write):
    refused("day='2026-03-02'", modlhmp.read_tracks, write("title: Mine\n", "mine.yaml"), day="2026-03-02")
    refused("separator=';'", modlhmp.read_tracks, "clean.parquet", separator=";")


def test_a_rule_with_polygons_in_metres(write):
    """Without a scale there are no pixels."""
    hall = [[-1, -1], [-1, 9], [20, 9], [20, -1]]
    tracks = modlhmp.read_tracks(write(CSV), **NAMED, cleaning=[{"start_end_margin": {"polygons": [hall]}}])
    assert len(tracks.bounds()) - 1 == 2


def test_an_unknown_place_on_earth():
    refused("timezone 'Mars'", modlhmp.build_map, "cliff", PEOPLE, Site(timezone="Mars"))
    refused("timezone '../etc'", modlhmp.forecast, "cvm", STRAIGHT, site=Site(timezone="../etc"))


@pytest.mark.parametrize(
    ("history", "message"),
    [
        (STRAIGHT.astype(complex), "they are complex128"),
        (STRAIGHT.astype(str), "they are <U"),
        (STRAIGHT.astype("datetime64[s]"), "they are datetime64"),
        (STRAIGHT.astype(str).astype(object), "they are object"),
        (STRAIGHT > 0, "they are bool"),
        (np.stack([STRAIGHT, STRAIGHT * [1, np.nan, 1]]), "walker 1: a position in the last 4 rows"),
        (STRAIGHT[:3], "walker 0 has 3 rows; .* give the last 4 rows or more"),
    ],
)
def test_a_history_that_is_none(history, message):
    refused(message, modlhmp.forecast, "cvm", history)


def test_a_gap_names_its_walker():
    late = STRAIGHT + np.array([[0, 0, 0]] * 2 + [[9, 0, 0]] * 2)
    refused("walker 1 has a gap", modlhmp.forecast, "cvm", np.stack([STRAIGHT, late, STRAIGHT]))


def test_networks_and_files_by_name():
    refused("the workflow trains it", modlhmp.build_map, "lstm", PEOPLE)
    refused("the workflow trains it", modlhmp.forecast, "lstm", STRAIGHT)
    refused("made of other methods' forecasts", modlhmp.forecast, "average", STRAIGHT)
    refused("modlhmp.load_map", modlhmp.forecast, "maps/cliff.parquet", STRAIGHT)


def test_maps_without_people_are_refused():
    refused("the map is empty", modlhmp.build_map, "cliff", PEOPLE, min_observations=10**6)
    refused("min_observations: 0 is not at least 3", modlhmp.build_map, "cliff", PEOPLE, min_observations=0)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (("cliff", Site(), None, {}), "is one table, `whole`"),
        (("cliff", None, pa.table({}), {}), "site is NoneType"),
        (("cliff", Site(), 3, {}), "must be pyarrow.Table"),
        (("tc_cliff", Site(), None, {9: 3}), "must be pyarrow.Table"),
        (("tc_cliff", Site(), None, None), "give {clock hour"),
        (("tc_cliff", Site(), None, {"9": pa.table({})}), "give {clock hour"),
        (("cvm", Site(), None, {}), "is not a map"),
    ],
)
def test_a_map_made_by_hand_is_checked(made, message):
    refused(message, modlhmp.Map, *made)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (b"resolution", b"zzz", "resolution b'zzz' is not a number"),
        (b"modlhmp", b"zzz", "metadata are damaged"),
        (b"modlhmp", b"[1]", "metadata are damaged"),
        (b"modlhmp", b'{"kind": "cliff", "site": {"time_step_s": -1}}', "its site"),
        (b"modlhmp", b'{"kind": "cliff", "site": 3}', "its site"),
        (b"modlhmp", b'{"kind": ["cliff"], "site": {}}', "kind"),
    ],
)
def test_a_map_with_damaged_metadata(tmp_path, key, value, message):
    path = tmp_path / "map.parquet"
    modlhmp.build_map("cliff", PEOPLE, SITE).save(path)
    table = pa.parquet.read_table(path)
    pa.parquet.write_table(table.replace_schema_metadata({**table.schema.metadata, key: value}), path)
    with pytest.raises(DataError, match=message):
        modlhmp.forecast(modlhmp.load_map(path), STRAIGHT)


def test_places_where_no_map_can_be_saved(tmp_path):
    (tmp_path / "file").write_text("")
    for kind in ("episodes", "tc_cliff"):
        made = modlhmp.build_map(kind, PEOPLE, SITE)
        refused("cannot be written", made.save, tmp_path / "file" / "map")
        refused("cannot be written", made.save, "/proc/modlhmp")


def test_forecasts_that_no_memory_holds():
    refused("k 1000000000000", modlhmp.forecast, modlhmp.build_map("cliff", PEOPLE), STRAIGHT, k=10**12)


@pytest.mark.parametrize(
    ("named", "message"),
    [
        *(({"walker": odd}, "walker") for odd in [*ODD[:5], "0", 0.5, -1]),
        *(({"extent": odd}, "extent") for odd in [3, "abcd", (1, 2), (0, 0, 1, 1), (0, np.nan, 0, 1), [[0]] * 4, {}]),
        *(({"cell_m": odd}, "cell_m") for odd in [True, "1", None]),
    ],
)
def test_a_density_of_nothing(futures, named, message):
    refused(message, futures.density, **{"at_s": 2, "cell_m": 0.5, **named})
