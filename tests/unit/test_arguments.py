"""Wrong arguments of the library's public names: each is refused by name, with its value and the remedy."""

import dataclasses
from importlib.metadata import EntryPoint

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

import modlhmp
from modlhmp import DataError, Site, kinds
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


# --- by meaning -----------------------------------------------------------------------------------------------------


def test_a_path_may_begin_at_home(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    a_map = modlhmp.build_map("episodes", PEOPLE, SITE)
    a_map.save("~/map.parquet")
    assert (tmp_path / "map.parquet").is_file()
    assert modlhmp.load_map("~/map.parquet").kind == "episodes"
    (tmp_path / "a.csv").write_text(CSV)
    assert len(modlhmp.read_tracks("~/a.csv", **NAMED).t) == 18
    monkeypatch.chdir(tmp_path)
    a_map.save("~nobody_of_this_name")  # as a shell does it: a file of that name
    assert (tmp_path / "~nobody_of_this_name").is_file()


def test_a_map_by_hours_replaces_what_lay_in_its_folder(tmp_path):
    hours = modlhmp.build_map("stef", PEOPLE, SITE)
    hours.save(tmp_path / "map")
    modlhmp.build_map("tc_cliff", PEOPLE, Site(timezone="Europe/London", hours=(7, 8), horizon_s=8)).save(
        tmp_path / "map"
    )
    assert sorted(file.name for file in (tmp_path / "map").iterdir()) == ["07.parquet", "day.parquet"]
    assert modlhmp.load_map(tmp_path / "map").kind == "tc_cliff"


def test_hours_of_different_maps_are_no_map(tmp_path):
    modlhmp.build_map("stef", PEOPLE, SITE).save(tmp_path / "map")
    (tmp_path / "map/08.parquet").rename(tmp_path / "map/09.parquet")
    refused("09.parquet: it is of another map, or of another hour", modlhmp.load_map, tmp_path / "map")
    modlhmp.build_map("tc_cliff", PEOPLE, SITE).save(tmp_path / "other")
    (tmp_path / "map/09.parquet").unlink()
    (tmp_path / "other/08.parquet").rename(tmp_path / "map/08.parquet")
    refused("08.parquet: it is of another map", modlhmp.load_map, tmp_path / "map")


def test_numbers_of_numpy_are_numbers(tmp_path):
    site = Site(timezone="Europe/London", horizon_s=np.int64(8), observed_rows=np.int32(4), time_step_s=np.float32(1))
    a_map = modlhmp.build_map("tc_cliff", PEOPLE, dataclasses.replace(site, hours=np.array([7, 9])))
    a_map.save(tmp_path / "map")
    assert modlhmp.load_map(tmp_path / "map").site == a_map.site == dataclasses.replace(SITE, hours=(7, 9))
    modlhmp.Map("tc_cliff", SITE, None, {np.int64(8): a_map.hours[8]}).save(tmp_path / "one")
    plain = modlhmp.build_map("episodes", PEOPLE, dataclasses.replace(site, observed_rows="4", time_step_s="1"))
    assert plain.site == dataclasses.replace(SITE, hours=None)


@pytest.mark.parametrize("hours", [(-1, 24), (0, 25), (7, 2000), (9, 9)])
def test_hours_of_no_day(hours):
    refused("hours", modlhmp.build_map, "stef", PEOPLE, Site(hours=hours))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": PEOPLE.t * 1e3}, "is it in ms"),
        ({"t": (PEOPLE.t - PEOPLE.t[0]) * 1e3}, "are the times in ms"),
        ({"x": PEOPLE.x * 100, "y": PEOPLE.y * 100}, "are positions in m"),
        ({"heading": np.degrees(PEOPLE.heading)}, "headings in rad"),
        ({"speed": -PEOPLE.speed}, "speeds are from 0"),
        ({"track_id": PEOPLE.track_id % 2}, "stands in several places"),
    ],
)
def test_tracks_in_other_units(changes, message):
    for kind in ("cliff", "snippets"):
        refused(message, modlhmp.build_map, kind, PEOPLE._replace(**changes))
    refused(message, modlhmp.forecast, "cvm", PEOPLE._replace(**changes))


def test_a_truth_of_other_people_or_with_gaps():
    """Walkers of an array are numbered from 0, whoever they are."""
    rows = PEOPLE.track_id == 7
    seven = np.column_stack([PEOPLE.t[rows], PEOPLE.x[rows], PEOPLE.y[rows]])[:4]
    futures = modlhmp.forecast("cvm", seven, horizon_s=3)
    truth = PEOPLE._replace(t=PEOPLE.t - PEOPLE.t[0] + seven[0, 0])  # so that track 0 is there at that time
    refused("walker 0 .* starts .* m from where that track is", modlhmp.score, futures, truth)
    hole = PEOPLE._replace(x=np.where(np.arange(len(PEOPLE.t)) % 9 == 6, np.nan, PEOPLE.x))
    refused("positions that are not numbers", modlhmp.score, modlhmp.forecast("cvm", PEOPLE.take(_first(4))), hole)


def _first(rows):
    return (PEOPLE.bounds()[:-1][:, None] + np.arange(rows)).ravel()


def test_walkers_that_a_map_does_not_know_can_be_told_apart():
    far = PEOPLE._replace(x=PEOPLE.x + 500).take(_first(4))
    for kind in ("cliff", "snippets"):
        a_map = modlhmp.build_map(kind, PEOPLE, SITE)
        assert not modlhmp.forecast(a_map, far).known.any()
        assert modlhmp.forecast(a_map, PEOPLE.take(_first(4))).known.mean() > 0.9


def test_a_density_says_what_its_cells_cover(futures):
    found = futures.density(2, 0.5, extent=(-10.0, 10.0, -3, 3.2))
    assert found.extent == (-10, 10, -3, 3.5)
    assert found.probabilities.shape == (13, 40)


def test_an_unknown_split_and_an_odd_data_root(write):
    write(CSV, "a.csv")
    write(CSV, "b.csv")
    dataset = write(
        "title: Mine\nreader: delimited\ntimezone: Europe/London\nheader: true\nseparator: ';'\n"
        "columns: {track_id: person, t: time, x: x, y: y}\nhorizon_s: 5\nvelocity: differences\ncitation: n\nterms: f\n"
        "recordings:\n  - {files: a.csv, day: 2020-03-02, start: '08:00', split: train}\n"
        "  - {files: b.csv, day: 2020-03-03, start: '08:00', split: test}\n", "mine.yaml"
    )  # fmt: skip
    for split in ("Train", 1, True, ["train"]):
        refused("split", modlhmp.read_tracks, dataset, split=split)
    for root in (5, True, ["a"]):
        refused("data_root", modlhmp.read_tracks, dataset, data_root=root)


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [("track_id", pa.array(["a"] * 3), "whole numbers"), ("x", pa.array([[1.0]] * 3), "numbers are needed"),
     ("t", pa.array([0, 1, 2], pa.timestamp("s")), "timestamp"), ("track_id", pa.array([1.0] * 3), "whole numbers")],
)  # fmt: skip
def test_a_clean_recording_of_other_types(tmp_path, name, values, message):
    columns = dict.fromkeys(modlhmp.Tracks._fields, pa.array([1.0, 2.0, 3.0])) | {"track_id": pa.array([1, 1, 1])}
    pa.parquet.write_table(pa.table(columns | {name: values}), tmp_path / "t.parquet")
    refused(f"column {name} is .*{message}", modlhmp.read_tracks, tmp_path / "t.parquet")


def test_a_broken_package_is_named(monkeypatch):
    broken = EntryPoint("mine", "no_such_module:KIND", kinds.GROUP)
    monkeypatch.setattr(kinds, "entry_points", lambda group: [broken])
    kinds.all_kinds.cache_clear()
    try:
        refused("entry point mine = no_such_module:KIND .* cannot be loaded", modlhmp.build_map, "mine", PEOPLE)
    finally:
        kinds.all_kinds.cache_clear()


@pytest.mark.parametrize("t", [np.datetime64("2026-01-01"), "0", None, True, float("nan"), [1]])
def test_a_moment_that_is_none(t):
    refused("seen_by: t", PEOPLE.seen_by, t)
    refused("numpy array", modlhmp.Tracks(*(column.tolist() for column in PEOPLE)).seen_by, 1.0)


@pytest.mark.parametrize("day", [0, "", [], {}, "9999-12-31", np.array([1, 2])])
def test_days_that_are_none(write, day):
    refused("day", modlhmp.read_tracks, write(CSV), **NAMED, day=day)


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
        (
            (STRAIGHT + np.array([1.3e9, 0, 0])).astype(np.float32),
            "row 1: t .* give float64: unix times have more digits",
        ),
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
    refused("name it in `compare` of a run's configuration", modlhmp.build_map, "lstm", PEOPLE)
    refused("name it in `compare` of a run's configuration", modlhmp.forecast, "lstm", STRAIGHT)
    refused("made of other methods' forecasts", modlhmp.forecast, "average", STRAIGHT)
    for by in ("maps/cliff.parquet", "cliff.parquet"):
        refused("give the map that lies there, modlhmp.load_map", modlhmp.forecast, by, STRAIGHT)
        refused("give the map that lies there, modlhmp.load_map", modlhmp.Live, by)


def test_maps_without_people_are_refused():
    refused("the map is empty", modlhmp.build_map, "cliff", PEOPLE, min_observations=10**6)
    refused("min_observations: 0 is not at least 3", modlhmp.build_map, "cliff", PEOPLE, min_observations=0)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (("cliff", Site(), None, {}), "is one table, `whole`"),
        (("cliff", None, pa.table({}), {}), "site is None"),
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
def test_a_map_with_damaged_metadata(tmp_path, rewrite, key, value, message):
    path = tmp_path / "map.parquet"
    modlhmp.build_map("cliff", PEOPLE, SITE).save(path)
    table = pa.parquet.read_table(path)
    rewrite(path, table.replace_schema_metadata({**table.schema.metadata, key: value}))
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
    for digits in (18, 400, 5000):  # more than a float, and than Python writes out, hold
        for k in (10**digits, -(10**digits), "9" * digits + "9"):
            refused(
                "k: a whole number of more than 18", modlhmp.forecast, modlhmp.build_map("cliff", PEOPLE), STRAIGHT, k=k
            )


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
