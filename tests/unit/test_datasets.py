"""Dataset files: what is shipped loads, what is mistyped is named with its remedy, recordings are found."""

import bz2
import copy
import gzip
import json
import re
import zipfile
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml

from modlhmp.cleaning import RULES, clean_recording, source_of
from modlhmp.datasets import REQUIRED, Dataset, DatasetFile, folds, load_dataset, validation_part
from modlhmp.file_format import Columns, FileFormat, Recording
from modlhmp.ids import id_of
from modlhmp.readers import files, read_recording
from modlhmp.readers.raw import find_recording, ids_of_people, open_raw
from modlhmp.recordings import clean
from modlhmp.settings import as_plain, build, json_schema
from modlhmp.splits import FOLDS
from modlhmp.storage import DataError
from modlhmp.yaml_file import read_yaml

ROWS = "0,1,0,0\n1,1,1,0\n2,1,2,0\n"
MINE = {
    "title": "My hall",
    "reader": "delimited",
    "columns": {"t": 0, "track_id": 1, "x": 2, "y": 3},
    "timezone": "Europe/London",
    "hours": [8, 18],
    "recordings": [
        {"files": "a.csv", "day": "2020-03-02", "start": "08:00", "split": "train"},
        {"files": "b.csv", "day": "2020-03-03", "start": "08:00", "split": "test"},
    ],
    "horizon_s": 10,
    "velocity": "differences",
    "citation": "nobody, 2020",
    "terms": "free",
}
SHIPPED = [
    *("atc", "atc_1day", "demo_forum", "demo_hall", "edinburgh", "edinburgh_25days"),
    *("eth", "eth_fast", "eth_obsmat", "hotel", "juelich", "magni", "magni_a", "thor1", "trajnetpp"),
]


def rows_of(name):
    """A recording unlike those of other names: equal ones are refused."""
    return f"{ROWS}# {name}\n"


@pytest.fixture
def load(tmp_path):
    """Function (changes or YAML text) -> MINE with these keys changed (None: left out), written and loaded."""
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(rows_of(name))

    def load_changed(text=None, root=tmp_path, **changes):
        listed = {key: value for key, value in {**copy.deepcopy(MINE), **changes}.items() if value is not None}
        path = tmp_path / "mine.yaml"
        path.write_text(yaml.safe_dump(listed) if text is None else text)
        return load_dataset(path, root)

    return load_changed


def refused(load, *parts, **changes):
    """The message with which a changed dataset is refused: it names the file and all of `parts`."""
    with pytest.raises(DataError) as error:
        load(**changes)
    message = str(error.value)
    for part in ("mine.yaml", *parts):
        assert part in message
    return message


# --- what is shipped ----------------------------------------------------------------------------------------


def test_the_shipped_datasets_are_all_listed_here(config_folder):
    assert {file.stem for file in (config_folder / "datasets").glob("*.yaml")} >= set(SHIPPED)


def test_every_shipped_dataset_loads_without_its_files(config_folder, tmp_path):
    for file in sorted((config_folder / "datasets").glob("*.yaml")):
        if file.stem == "atc_archive":  # found by globs: nobody can list what is missing
            with pytest.raises(DataError, match=r"no file matches .*atc-2012102\[5-9\]\.csv"):
                load_dataset(file, tmp_path)
            continue
        dataset = load_dataset(file, tmp_path)
        assert dataset.name == file.stem
        for recording in dataset.recordings:
            assert not recording.exists
            assert recording.path == str(tmp_path / recording.file)
            assert isinstance(recording.day, str)
        assert dataset.demo == file.stem.startswith("demo_")


@pytest.mark.parametrize(
    ("name", "train", "test"),
    [("atc", 1, 9), ("atc_1day", 1, 1), ("edinburgh", 5, 40), ("edinburgh_25days", 5, 20), ("demo_hall", 2, 2)],
)
def test_the_papers_days(load_shipped, tmp_path, name, train, test):
    splits = [recording.split for recording in load_shipped(name, tmp_path).recordings]
    assert (splits.count("train"), splits.count("test")) == (train, test)


@pytest.mark.real
@pytest.mark.parametrize("name", ["atc_1day", "edinburgh_25days"])
def test_the_real_recordings_are_found(load_shipped, real_data, name):
    assert [r.path for r in load_shipped(name, real_data).recordings if not r.exists] == []


def test_a_dataset_file_can_hold_tuned_options(load):
    assert load().tuned == {}
    assert load(tuned={"snippets": {"k": 7}}).tuned == {"snippets": {"k": 7}}
    refused(load, "tuned.snippets", tuned={"snippets": 7})


# --- the validation part ------------------------------------------------------------------------------------


def training(*day_numbers):
    """A dataset of these training days, two recordings each, and a test day."""
    listed = [(f"{day}{half}", f"2020-03-{day:02}", "train") for day in day_numbers for half in "ab"]
    listed.append(("test", "2020-03-31", "test"))
    recordings = [Recording(name=name, path=f"{name}.csv", day=day, split=split) for name, day, split in listed]
    return Dataset(label="mine", recordings=tuple(recordings))


@pytest.mark.parametrize(
    ("days_of_training", "held"), [((1, 2), 1), ((1, 2, 3), 1), ((1, 2, 3, 4), 2), (range(1, 11), 3), (range(1, 12), 4)]
)
def test_the_last_training_days_stand_in_for_the_test_set(days_of_training, held):
    """30 % of them, rounded up, whole days; the test recordings are gone."""
    dataset = training(*list(days_of_training)[::-1])
    got = validation_part(dataset)
    by_split = {split: {r.day for r in got.recordings if r.split == split} for split in ("train", "test")}
    in_order = [f"2020-03-{day:02}" for day in days_of_training]
    assert by_split == {"train": set(in_order[:-held]), "test": set(in_order[-held:])}
    assert [r.name for r in got.recordings] == [r.name for r in dataset.recordings[:-1]]
    assert {r.part for r in got.recordings} == {None}
    assert got.label == "mine"


def test_a_single_training_day_is_cut_in_two():
    """Each of its recordings becomes two, of names of their own, read from the same file."""
    got = validation_part(training(4)).recordings
    parts = [(r.name, r.path, r.split, r.part) for r in got]
    assert parts == [
        ("4a-fit", "4a.csv", "train", "fit"),
        ("4a-validation", "4a.csv", "test", "validation"),
        ("4b-fit", "4b.csv", "train", "fit"),
        ("4b-validation", "4b.csv", "test", "validation"),
    ]


def test_test_days_are_dealt_into_folds(load):
    """Each is tested once, from all other days; who was there on a fold's days without being tested is left out."""
    days = [f"2020-03-{day:02}" for day in range(1, 13)]
    split = {day: "train" if day < "2020-03-03" else "test" for day in days}
    recordings = [Recording(name=day, path="", file="", stored="", day=day, split=split[day]) for day in days]
    recordings.append(Recording(name="others", path="", file="", stored="", day=days[4], split="train"))
    dataset = replace(load(), recordings=tuple(recordings))
    found = folds(dataset)
    assert [one.name for one in found] == [f"mine-{n}" for n in range(1, FOLDS + 1)]
    assert len({one.label for one in found}) == FOLDS
    assert {one.fold_of for one in found} == {dataset.title}
    tested = [recording.name for one in found for recording in one.of_split("test")]
    assert sorted(tested) == days[2:]
    for one in found:
        out = {recording.day for recording in one.of_split("test")}
        assert {recording.day for recording in one.of_split("train")} == set(days) - out
        assert ("others" in {recording.name for recording in one.recordings}) == (days[4] not in out)


def test_one_day_is_dealt_by_blocks_of_time():
    """The test recordings' parts by turns; what trains is that day's people outside those blocks, and other days'."""
    dataset = training(4, 31)
    found = folds(dataset)
    assert len(found) == FOLDS
    for fold, one in enumerate(found, 1):
        whole, parts = ([r for r in one.of_split("train") if bool(r.part) is cut] for cut in (False, True))
        assert [r.name for r in whole] == ["4a", "4b"]
        assert {(r.name, r.path, r.part) for r in parts} == {
            (f"{n}-without-{fold}", f"{n}.csv", f"without-{fold}") for n in ("31a", "31b", "test")
        }
        assert [(r.name, r.part) for r in one.of_split("test")] == [(f"test-fold-{fold}", f"fold-{fold}")]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_dataset_has_a_validation_part(load_shipped, tmp_path, name):
    dataset = load_shipped(name, tmp_path)
    got = validation_part(dataset).recordings
    names = [recording.name for recording in got]
    assert len(set(names)) == len(names)
    assert {recording.split for recording in got} == {"train", "test"}
    own = {recording.path for recording in dataset.recordings if recording.split == "train"}
    assert {recording.path for recording in got} == own


# --- dataset files ------------------------------------------------------------------------------------------


def test_a_dataset_file_gets_its_defaults(load):
    dataset = load()
    assert (dataset.name, dataset.label) == ("mine", "mine")
    assert dataset.time_step_s == 1.0
    assert dataset.cleaning == ("single_row",)
    assert (dataset.gaps, dataset.gap_s, dataset.max_jump_mps) == ("split", 5.0, 15.0)
    assert dataset.figure_hours == ()
    assert load(hours=None).hours is None
    assert dataset.floor_plan == ()
    assert dataset.paper_protocol.idle_filter is None
    assert [recording.name for recording in dataset.recordings] == ["a", "b"]
    assert all(recording.exists for recording in dataset.recordings)


def test_a_recording_that_is_not_there_is_told_with_the_file_that_names_it(load, tmp_path):
    (tmp_path / "a.csv").unlink()
    dataset = load()
    with pytest.raises(DataError, match=r"a\.csv: no such file; .* `files` in mine\.yaml"):
        clean(dataset, next(one for one in dataset.recordings if one.path.endswith("a.csv")))


def test_a_loaded_dataset_can_be_read(load):
    dataset = load()
    first = dataset.recordings[0]
    tracks, _ = read_recording(first.path, dataset, first.day, first.start)
    assert tracks.t.tolist() == [1_583_136_000.0 + k for k in range(3)]


@pytest.mark.parametrize(
    ("wrong", "right"), [("readr", "reader"), ("timezon", "timezone"), ("citaton", "citation"), ("hour", "hours")]
)
def test_a_mistyped_key_of_a_dataset_gets_a_hint(load, wrong, right):
    refused(load, f"unknown key '{wrong}', did you mean '{right}'", **{wrong: MINE[right], right: None})


def test_a_mistyped_key_of_a_recording_gets_a_hint(load):
    recordings = [{**MINE["recordings"][0], "spilt": "train"}, MINE["recordings"][1]]
    refused(load, "recordings.0: unknown key 'spilt', did you mean 'split'", recordings=recordings)


@pytest.mark.parametrize("key", REQUIRED)
def test_a_missing_key_is_named(load, key):
    refused(load, f"top level: the key '{key}' is required", **{key: None})


def test_all_problems_of_a_file_are_told_at_once(load):
    """What is missing, mistyped or of no use, each on a line of its own."""
    recordings = [{"files": "a.csv", "day": "2020-03-02", "split": "trian"}, MINE["recordings"][1]]
    told = ["'title' is required", "did you mean 'timezone'", "horizon_s: -1", "recordings.0.split: 'trian'"]
    changes = {"title": None, "timezon": "UTC", "horizon_s": -1, "recordings": recordings}
    assert len(refused(load, *told, **changes).splitlines()) == 1 + len(told)


def test_an_unknown_reader_gets_the_known_ones(load):
    refused(load, "reader: 'edinburg' is not one of", "edinburgh_rows", "delimited", reader="edinburg")


@pytest.mark.parametrize(
    "zone", ["Europe/Lundon", "", "Japan time", "../London", "/etc/localtime", "Europe", "America"]
)
def test_an_unknown_timezone_is_refused(load, zone):
    refused(load, f"timezone {zone!r} is unknown", "Europe/London", timezone=zone)


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_is_accepted_with_its_options(load, rule):
    triangle = {"polygons": [[[0, 0], [50, 0], [0, 50.5]]]}
    options = {"min_points": {"points": 31}, "start_end_margin": triangle, "lift_loiterers": triangle}
    assert load(cleaning=[{rule: options[rule]} if rule in options else rule]).cleaning


@pytest.mark.parametrize(
    ("entry", "parts"),
    [
        ("single_rwo", ["no rule named 'single_rwo'; did you mean 'single_row'"]),
        ("zzz", ["no rule named 'zzz'; known: ", *RULES]),
        ({"min_point": {"points": 3}}, ["did you mean 'min_points'"]),
        ("min_points", ["min_points takes points"]),
        ({"min_points": {"point": 3}}, ["min_points takes points", "'point'"]),
        ({"single_row": {"rows": 3}}, ["single_row takes no option", "'rows'"]),
        ({"min_points": 31}, ["cleaning.0"]),
        ({"min_points": {"points": "many"}}, ["min_points", "many"]),
        ({"min_points": {"points": None}}, ["min_points", "points"]),
        ({"lift_loiterers": {"polygons": [[487, -1], [641, 50]]}}, ["lift_loiterers", "polygons"]),
        ({"lift_loiterers": {"polygons": 5}}, ["lift_loiterers", "polygons"]),
        ({"start_end_margin": {"polygons": [[["a", 1], [2, 3], [4, 5]]]}}, ["start_end_margin", "polygons"]),
    ],
)
def test_a_wrong_cleaning_rule_is_refused(load, entry, parts):
    refused(load, *parts, cleaning=[entry])


def text_with(**replaced):
    """MINE as a person may type it, with the value of some keys replaced by this text."""
    text = yaml.safe_dump(MINE, default_flow_style=None, width=1000)
    for old, new in replaced.values():
        assert old in text
        text = text.replace(old, new)
    return text


def test_an_unquoted_start_after_ten_is_explained(load):
    """YAML takes 10:30 for a number in base 60."""
    text = text_with(start=("split: train, start: '08:00'", "split: train, start: 10:30"))
    refused(load, "line 7: 10:30 is 630 to YAML: quote it", text=text)


def test_an_unquoted_day_is_a_date(load):
    text = text_with(day=("'2020-03-02'", "2020-03-02"))
    assert load(text=text).recordings[0].day == "2020-03-02"


def test_a_date_that_does_not_exist_is_refused(load):
    """YAML itself fails on it where it is not quoted."""
    refused(load, "not valid YAML", text=text_with(day=("'2020-03-02'", "2020-02-30")))


@pytest.mark.parametrize(
    "clock",
    [
        {"reader": "edinburgh", "frame_rate": 9.0, "scale": 0.02, "columns": None, "header": False},
        {"units": {"time": "frame", "length": "m"}, "frame_rate": 9.0},
        *({"reader": reader, "columns": None} for reader in ("trajnet", "magni", "jupedsim", "hdf5")),
    ],
    ids=["px", "frames", "trajnet", "magni", "jupedsim", "hdf5"],
)
def test_files_without_a_clock_need_a_start(load, clock):
    recordings = [
        {key: value for key, value in MINE["recordings"][0].items() if key != "start"},
        *MINE["recordings"][1:],
    ]
    refused(load, "every entry of `recordings` needs a `start`", recordings=recordings, **clock)


@pytest.mark.parametrize("start", ["8:00", "24:00", "29:59", "08:60", "noon", ""])
def test_a_start_that_is_no_clock_time_is_refused(load, start):
    recordings = [{**MINE["recordings"][0], "start": start}, MINE["recordings"][1]]
    refused(load, "start", start, recordings=recordings)


@pytest.mark.parametrize("day", ["2020-02-30", "2.3.2020", "yesterday", "2020-03-02T10:00", "2020-03-02 10:00:00"])
def test_a_day_that_is_no_date_is_refused(load, day):
    recordings = [{**MINE["recordings"][0], "day": day}, MINE["recordings"][1]]
    refused(load, "day", day, "2012-10-24", recordings=recordings)


@pytest.mark.parametrize("hours", [[9, 9], [24, 0], [24, 3]])
def test_empty_hours_are_refused(load, hours):
    refused(load, f"hours {hours} are empty", "one after the last", hours=hours)


@pytest.mark.parametrize(
    ("hours", "listed"), [([22, 2], [22, 23, 0, 1]), ([9, 11], [9, 10]), ([0, 24], list(range(24))), ([23, 0], [23])]
)
def test_hours_may_go_on_after_midnight(load, hours, listed):
    assert load(hours=hours).listed_hours == listed


def test_a_recording_may_go_on_after_midnight(load, tmp_path):
    (tmp_path / "data").mkdir(exist_ok=True)
    late = {"files": "a.csv", "day": "2020-03-02", "start": "23:59", "days": 2, "split": "train"}
    dataset = load(recordings=[late, MINE["recordings"][1]])
    rows = "".join(f"{n},1,{n / 10},0\n" for n in range(0, 200, 10))
    path = tmp_path / "night.csv"
    path.write_text(rows)
    for days, kept in ((1, 6), (2, 20)):
        tracks, account = read_recording(path, dataset, "2020-03-02", "23:59", days)
        assert len(tracks.t) == kept
        assert account.dropped_rows["outside_day"] == 20 - kept


def test_without_a_clock_there_is_no_day(load):
    bare = [{"files": one["files"], "split": one["split"]} for one in MINE["recordings"]]
    dataset = load(recordings=bare, clock="unknown", hours=None)
    assert {one.day for one in dataset.recordings} == {""}
    assert dataset.days("test") == {"b": "b"}
    assert dataset.same_day("a") == []
    refused(load, "the `clock` is unknown, so there is no day or start", clock="unknown")
    refused(load, "give the `day`, such as 2012-10-24, or set `clock: unknown`", recordings=bare)


@pytest.mark.parametrize("split", [{"by": "time"}, {"by": "person", "test": 0.5, "seed": 3}])
def test_one_file_of_both_splits(load, split):
    dataset = load(recordings=[{**MINE["recordings"][0], "split": split}])
    assert [(one.name, one.split) for one in dataset.recordings] == [("a-train", "train"), ("a-test", "test")]
    assert dataset.same_day("a-train") == ["a-test"]


@pytest.mark.parametrize(
    ("split", "message"),
    [
        ({"by": "column", "test": ["x"]}, "needs `column`"),
        ({"by": "column", "column": "set"}, "needs `column`, and in `test` the texts"),
        ({"by": "time", "test": ["x"]}, "give a share, such as 0.25"),
        ({"by": "day"}, "there is one day only, 2020-03-02"),
        ({"by": "time", "test": 1.5}, "split"),
        ("both", "split"),
    ],
)
def test_splits_that_are_none_are_refused(load, split, message):
    refused(load, message, recordings=[{**MINE["recordings"][0], "split": split}])


def test_a_split_by_column_needs_a_table(load):
    """Where the reader has no columns everybody was trained and tested on."""
    split = {"by": "column", "column": "set", "test": ["x"]}
    plain = {"reader": "jupedsim", "columns": None, "header": False}
    refused(load, "{by: column} is for", "jupedsim", recordings=[{**MINE["recordings"][0], "split": split}], **plain)


@pytest.mark.parametrize("left_out", [{"without": {"set": ["b", "y"]}}, {"only": {"set": ["a", "x"]}}])
def test_a_split_by_a_text_that_the_dataset_leaves_out_is_refused(load, left_out):
    split = {"by": "column", "column": "set", "test": ["x", "y"]}
    key = next(iter(left_out))
    told = f"test [y]: `{key}: {{set: ...}}` leaves these rows out"
    refused(load, told, recordings=[{**MINE["recordings"][0], "split": split}], **left_out)


@pytest.mark.parametrize("hours", [[9], [9, 25], [-1, 3], [9, 12, 15], ["9", "late"], [8.5, 17], [True, 17], 9])
def test_hours_that_are_none_are_refused(load, hours):
    refused(load, "\n  hours", "clock hours that get a map", hours=hours)


def test_numbers_may_be_quoted(load):
    dataset = load(hours=["9", "17"], horizon_s="1e1", time_step_s="0.5")
    assert (dataset.hours, dataset.horizon_s, dataset.time_step_s) == ((9, 17), 10.0, 0.5)


@pytest.mark.parametrize("figure_hours", [[24], [-1], [8, 9, 10, 11, 12], 9])
def test_hours_without_a_map_are_not_drawn(load, figure_hours):
    refused(load, "\n  figure_hours", figure_hours=figure_hours)


@pytest.mark.parametrize(("horizon", "step"), [(10.5, 1.0), (1, 0.3), (0.5, 1.0)])
def test_the_horizon_is_a_number_of_steps(load, horizon, step):
    refused(load, "multiple of time_step_s", horizon_s=horizon, time_step_s=step)


def test_a_horizon_of_binary_fractions_is_fine(load):
    assert load(horizon_s=4.8, time_step_s=0.4).horizon_s == 4.8


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"reader": "edinburgh", "scale": 0.02}, "needs the key 'frame_rate'"),
        ({"reader": "edinburgh", "frame_rate": 9.0}, "needs the key 'scale'"),
        ({"reader": "edinburgh_rows", "frame_rate": 9.0, "scale": 0.02}, "needs the key 'row_stride'"),
        ({"columns": None}, "needs the key 'columns'"),
        ({"units": {"length": "px"}}, "need the key 'scale'"),
        ({"units": {"time": "frame"}}, "need the key 'frame_rate'"),
        ({"velocity": "as_recorded"}, "use velocity: differences"),
        ({"columns": {**MINE["columns"], "speed": 4}}, "both speed and heading"),
        ({"columns": {**MINE["columns"], "heading": 4}}, "both speed and heading"),
    ],
)
def test_what_a_reader_needs_is_named(load, changes, part):
    refused(load, part, **changes)


def test_the_old_name_of_recorded_velocities_is_explained(load):
    refused(load, "velocity: 'columns' is now called 'as_recorded'", velocity="columns")


@pytest.mark.parametrize("source", [{"url": "ftp://x/a.csv"}, {"url": "https://x/a.csv", "sha256": "abc"}])
def test_what_cannot_be_fetched_is_refused(load, source):
    refused(load, "sources: ", list(source.values())[-1], sources=[{"file": "a.csv", **source}])


@pytest.mark.parametrize("file", ["../a.csv", "/etc/cron.d/a.csv", "days/../../a.csv"])
def test_a_download_goes_nowhere_but_below_data_root(load, file):
    """Whoever wrote the dataset file would else write anywhere."""
    refused(load, f"sources: file {file!r} is not below `data_root`", sources=[{"file": file, "url": "https://x/a"}])


@pytest.mark.parametrize("polygons", [[], [[[0, 0], [1, 1]]], [[[0, 0], [1, 1], [2]]], [[0, 0], [1, 1], [2, 0]]])
def test_an_area_is_made_of_corners(load, polygons):
    refused(load, "area door: polygons must be", areas=[{"title": "door", "colour": "red", "polygons": polygons}])


@pytest.mark.parametrize(
    ("weights", "told"),
    [
        ([], "difference_weights [] are not"),
        ([0, 0], "difference_weights [0.0, 0.0] are not"),
        ([0.5, -0.1], "difference_weights.1: -0.1 is not at least 0"),
    ],
)
def test_difference_weights_are_positive(load, weights, told):
    refused(load, told, difference_weights=weights)


def test_a_velocity_takes_two_rows(load):
    refused(load, "observed_rows 1 is under 2", observed_rows=1)
    refused(load, "observed_s 1 is 1 row of 1 s", "two rows", observed_s=1)


@pytest.mark.parametrize(("step_s", "observed_s", "rows"), [(0.4, 3.2, 8), (1.0, 4, 4), (0.1, 0.3, 3)])
def test_an_observation_in_seconds_is_rows_by_their_step(load, step_s, observed_s, rows):
    """As the field counts: 8 frames of 0.4 s are 3.2 s, though only 2.8 s lie between the first and the last."""
    assert load(time_step_s=step_s, horizon_s=12 * step_s, observed_s=observed_s).observed_rows == rows


def test_an_observation_is_given_once_and_in_whole_steps(load):
    eth = {"time_step_s": 0.4, "horizon_s": 4.8}
    refused(load, "observed_s 3 ", "observed_rows: 8", "keep one", **eth, observed_s=3, observed_rows=8)
    refused(load, "observed_s 3 is no whole number of steps of 0.4 s", "2.8 or 3.2", **eth, observed_s=3)
    refused(load, "observed_s", "above 0", **eth, observed_s=-1)


def test_the_newest_steps_must_count(load):
    """With two observed rows there is one step, whose weight would be all."""
    refused(load, "difference_weights [0.0, 1.0]", "observed_rows 2", observed_rows=2, difference_weights=[0, 1])
    assert load(observed_rows=3, difference_weights=[0, 1])


@pytest.mark.parametrize("label", ["two words", "a/b", "ü"])
def test_a_label_can_be_part_of_a_file_name(load, label):
    refused(load, "letters, digits, _ and - only", label=label)


@pytest.mark.parametrize("split", ["train", "test"])
def test_both_splits_are_needed(load, split):
    other = [{**recording, "split": split} for recording in MINE["recordings"]]
    missing = {"train": "test", "test": "train"}[split]
    refused(load, f"no recording has `split: {missing}`", recordings=other)


@pytest.mark.parametrize("text", ["", "just text", "- a\n- b\n", "42"])
def test_a_file_that_is_no_mapping_is_refused(load, text):
    refused(load, "mapping", text=text)


@pytest.mark.parametrize("text", ["a: [1, 2", "a: b: c", "\ttitle: x", "a: 1\n\x00"])
def test_a_file_that_is_no_yaml_is_refused(load, text):
    refused(load, "not valid YAML", text=text)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: 1\nb: {x: 1\nc: 2\n", ", line 3, column 2: not valid YAML: expected ',' or '}', but got ':', in what "
         "begins in line 2; look for brackets, quotes, colons and tabs"),
        ("a: b: c", ", line 1, column 5: not valid YAML: mapping values are not allowed here; look for brackets"),
        ("a: 1\n\x00", ": not valid YAML (unacceptable character #x0000: special characters are not allowed)"),
        ("day: 2012-13-45", ": not valid YAML (month must be in 1..12)"),
    ],
)  # fmt: skip
def test_what_is_no_yaml_is_told_with_its_line(write, text, told):
    path = write(text, "mine.yaml")
    with pytest.raises(DataError) as error:
        read_yaml(path, "a dataset file")
    assert str(error.value).startswith(f"{path}{told}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "meant"),
    [("012", 10), ("1_0", 10), ("1:10", 70), ("0x1A", 26), ("0b11", 3), ("1:00.5", 60.5), ("685_23.15", 68523.15)],
)
def test_a_number_that_yaml_takes_for_another_is_refused(write, text, meant):
    path = write(f"a: 1\nonly: {{code: [7, {text}]}}\n", "mine.yaml")
    with pytest.raises(DataError, match=rf"mine\.yaml, line 2: {text} is {meant} to YAML: quote it .* decimal digits"):
        read_yaml(path, "a dataset file")


def test_numbers_that_are_what_they_say_and_quoted_ones_are_read(write):
    path = write("a: [0, -5, 1_690_000, 685_230.15, 0.05, '012', '1:10', 1e-3]\n", "mine.yaml")
    assert read_yaml(path, "a dataset file")["a"] == [0, -5, 1690000, 685230.15, 0.05, "012", "1:10", "1e-3"]


def test_a_file_in_another_encoding_is_refused(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_bytes("reader: atc\ntitle: Café\n".encode("latin-1"))
    with pytest.raises(DataError, match=r"mine\.yaml, line 2: not valid YAML: not UTF-8"):
        load_dataset(path, tmp_path)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(DataError, match=r"nothing\.yaml: cannot be read"):
        load_dataset(tmp_path / "nothing.yaml", tmp_path)


# --- as plain data and as a JSON schema ---------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_a_dataset_comes_back_from_its_plain_form(load_shipped, tmp_path, name):
    """So it reaches the jobs of the workflow, through JSON."""
    dataset = load_shipped(name, tmp_path)
    assert build(Dataset, json.loads(json.dumps(as_plain(dataset)))) == dataset


@pytest.mark.parametrize("name", SHIPPED)
def test_the_json_schema_takes_what_is_shipped(config_folder, name):
    schema = json_schema(DatasetFile, REQUIRED)
    listed = read_yaml(config_folder / f"datasets/{name}.yaml", "a dataset file")
    jsonschema.Draft202012Validator(schema).validate(listed)
    for wrong in ({**listed, "zzz": 1}, {k: v for k, v in listed.items() if k != "terms"}, {**listed, "hours": 9}):
        assert list(jsonschema.Draft202012Validator(schema).iter_errors(wrong))


# --- where recordings lie -----------------------------------------------------------------------------------


def days(folder, names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(rows_of(f"{folder.name}/{name}"))


def glob_entries(pattern, split="train"):
    return [{"files": pattern, "day": "2020-03-02", "split": split}, {**MINE["recordings"][1], "files": "b.csv"}]


def test_a_glob_stands_for_its_files_in_order(load, tmp_path):
    days(tmp_path / "days", ["0107.csv", "0106.csv", "0111.csv", "readme.txt"])
    dataset = load(recordings=glob_entries("days/01*.csv"))
    found = [r for r in dataset.recordings if r.split == "train"]
    assert [recording.name for recording in found] == ["0106", "0107", "0111"]
    assert all(recording.exists and recording.day == "2020-03-02" for recording in found)
    assert found[0].file == "days/0106.csv"


def test_a_glob_without_a_file_is_refused(load):
    refused(load, "no file matches", "nothing/*.csv", "data_root", recordings=glob_entries("nothing/*.csv"))


def test_two_stars_stand_for_any_number_of_folders(load, tmp_path):
    """Also none: `mon/**/*.csv` finds what lies in `mon` itself. A folder is no recording, whatever its name."""
    days(tmp_path / "mon", ["1.csv", "early/2.csv", "late/evening/3.csv", "late/notes.txt"])
    (tmp_path / "mon/folder.csv").mkdir()
    found = [one for one in load(recordings=glob_entries("mon/**/*.csv")).recordings if one.split == "train"]
    assert [one.file for one in found] == ["mon/1.csv", "mon/early/2.csv", "mon/late/evening/3.csv"]
    found = load(recordings=glob_entries("mon/*/*.csv")).recordings
    assert [one.name for one in found] == ["2", "b"]


@pytest.mark.parametrize("name", ["x[1].csv", "star*.csv", "what?.csv", "[ab].csv", "**.csv", "{a,b}.csv", "{x}.csv"])
@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_a_file_of_exactly_this_name_is_meant(load, tmp_path, name, suffix):
    """Whatever it would stand for as a glob; also where it is compressed."""
    days(tmp_path, ["x1.csv", "stars.csv", "whats.csv", name])
    if suffix:
        (tmp_path / name).rename(tmp_path / f"{name}.gz")
    found = load(recordings=glob_entries(name)).recordings
    assert [one.file for one in found] == [name + suffix, "b.csv"]
    assert found[0].name == name.removesuffix(".csv")
    assert found[0].exists


def test_braces_stand_for_nothing(load, tmp_path):
    days(tmp_path, ["monday.csv", "tuesday.csv"])
    refused(load, "files '{monday,tuesday}.csv'", "an entry for each", recordings=glob_entries("{monday,tuesday}.csv"))
    refused(load, "files 'days/{1,2}*.csv'", "an entry for each", recordings=glob_entries("days/{1,2}*.csv"))


def test_a_folder_is_no_recording(load, tmp_path):
    (tmp_path / "mon").mkdir()
    refused(load, "files 'mon' is a folder", "mon/**/*.csv", recordings=glob_entries("mon"))


def test_globs_do_not_reach_into_archives(load, tmp_path):
    zipped(tmp_path / "all.zip", {"1.csv": ROWS, "2.csv": ROWS})
    refused(load, "files 'all.zip/*.csv'", "into archives", "one by one", recordings=glob_entries("all.zip/*.csv"))


def test_a_name_that_no_file_can_have_is_refused(load):
    refused(load, "cannot be looked for", "too long", recordings=glob_entries("a" * 300))


@pytest.mark.parametrize(
    "name", ["a b.csv", "Ölberg, früh.csv", "日曜.csv", "q'u\"o.csv", "$(touch x).csv", "-rf.csv", "100%.csv"]
)
def test_any_other_name_is_fine(load, tmp_path, name):
    days(tmp_path, [name])
    one = load(recordings=glob_entries(name)).recordings[0]
    assert (one.name, one.file, one.exists) == (name.removesuffix(".csv"), name, True)


def test_a_tilde_is_the_home_folder(load, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    days(tmp_path / "walks", ["a.csv", "b.csv"])
    for root in ("~/walks", Path("~/walks")):
        assert [one.path for one in load(root=root).recordings] == [str(tmp_path / f"walks/{n}.csv") for n in "ab"]
    assert load(root="~nobody_of_this_name/walks").recordings[0].path == "~nobody_of_this_name/walks/a.csv"


def test_recordings_may_not_be_written_to(load, tmp_path):
    """Finding, comparing and reading leaves the folder as it is."""
    root = tmp_path / "locked"
    days(root, ["a.csv", "b.csv"])
    before = {file: file.stat().st_mtime_ns for file in (root, *root.iterdir())}
    root.chmod(0o555)
    try:
        for one in load(root=root).recordings:
            read_recording(one.path, load(), one.day, one.start)
    finally:
        root.chmod(0o755)
    assert {file: file.stat().st_mtime_ns for file in (root, *root.iterdir())} == before


# --- what recordings are called, and which are the same -------------------------------------------------------------


def named(load, *files):
    """{file: name} of training recordings in these files."""
    entries = [{"files": file, "day": "2020-03-02", "split": "train"} for file in files]
    found = load(recordings=[*entries, {**MINE["recordings"][1], "files": "b.csv"}]).recordings
    return {(f"{one.file}/{one.member}" if one.member else one.file): one.name for one in found}


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["day1/tracks.csv", "day2/walks.csv"], ["tracks", "walks"]),
        (["day1/tracks.csv", "day2/tracks.csv"], ["day1.tracks", "day2.tracks"]),
        (["day1/tracks.csv", "day2/tracks.csv", "day2/x.csv"], ["day1.tracks", "day2.tracks", "x"]),
        (["tracks.csv", "day1/tracks.csv"], ["tracks", "day1.tracks"]),
        (["1.3/t.csv", "1/3.t.csv", "2/t.csv"], ["1..3.t", "3.t", "2.t"]),
        (["1.3/t.csv", "1/3.t.csv", "2/t.csv", "2/3.t.csv"], ["1..3.t", "1.3..t", "2.t", "2.3..t"]),
        (["day1/t.csv", "day2/t.csv", "day1.t.csv"], ["day1.t", "day2.t", "day1..t"]),
        (["day1/t.csv", "day2/t.csv", "day1.t.csv", "x/day1..t.csv"], ["day1.t", "day2.t", "day1..t", "x.day1....t"]),
        (["day1/t.csv", "day2/t.txt"], ["day1.t", "day2.t"]),
    ],
)
def test_the_name_is_the_files_or_its_path(load, tmp_path, files, names):
    """The stem, which keys the random numbers, wherever it is unique; no two recordings share a name."""
    days(tmp_path, files)
    assert named(load, *files) == {**dict(zip(files, names, strict=True)), "b.csv": "b"}


def test_members_of_archives_are_named_likewise(load, tmp_path):
    for name in ("x.zip", "y.zip"):
        zipped(tmp_path / name, {"t.csv": rows_of(name), "u.csv": rows_of(f"{name}u")})
    files = ["x.zip/t.csv", "y.zip/t.csv", "x.zip/u.csv"]
    assert [named(load, *files)[file] for file in files] == ["x..zip.t", "y..zip.t", "u"]


@pytest.mark.parametrize("other", ["a.txt", "a.csv.gz"])
def test_files_that_only_their_suffix_tells_apart_are_refused(load, tmp_path, other):
    (tmp_path / other).write_text("something else\n")
    more = [*MINE["recordings"], {**MINE["recordings"][1], "files": other}]
    refused(load, "two recordings are named a: a.csv and", other, "different names", recordings=more)


@pytest.mark.parametrize(
    "twice", [("a.csv", "a.csv"), ("a.csv", "*a.csv"), ("new.csv", "new.csv"), ("x.zip/t.csv",) * 2]
)
def test_a_file_listed_twice_is_refused(load, tmp_path, twice):
    """Also under another day and split: its people would be in both."""
    zipped(tmp_path / "x.zip", {"t.csv": ROWS})
    entries = [{**one, "files": file} for one, file in zip(MINE["recordings"], twice, strict=True)]
    refused(load, f"{twice[0]} is listed twice; leave one out", recordings=entries)


@pytest.mark.parametrize("link", ["symlink_to", "hardlink_to"])
def test_a_file_with_two_names_is_refused(load, tmp_path, link):
    (tmp_path / "b.csv").unlink()
    getattr(tmp_path / "b.csv", link)(tmp_path / "a.csv")
    refused(load, "a.csv and b.csv are the same file; leave one out")


def test_a_copy_of_a_file_is_refused(load, tmp_path):
    (tmp_path / "b.csv").write_text(rows_of("a.csv"))
    refused(load, "a.csv and b.csv hold the same bytes", "leave one out")


def test_only_what_is_alike_is_read(load, tmp_path, monkeypatch):
    """Sizes first, then beginnings; the whole of a file only where these are the same. What is missing is not read."""
    hashed = []
    monkeypatch.setattr(files, "_HEAD_BYTES", 4)
    monkeypatch.setattr(files, "file_sha256", lambda path: hashed.append(Path(path).name) or path)
    texts = {
        "a.csv": "same1",
        "b.csv": "same2",
        "c.csv": "same, but longer",
        "d.csv": "other",
        "e.csv": "",
        "f.csv": "",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    load(recordings=[{**MINE["recordings"][0], "files": name} for name in (*texts, "missing.csv")] + [
        {**MINE["recordings"][1], "files": "missing too.csv"}
    ])  # fmt: skip
    assert sorted(hashed) == ["a.csv", "b.csv"]


def test_a_file_that_cannot_be_read_is_its_readers_matter(load, monkeypatch):
    def forbidden(_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(files, "_head", forbidden)
    assert len(load().recordings) == 2


def test_a_glob_works_below_a_folder_with_brackets(load, tmp_path):
    root = tmp_path / "data [2020]"
    days(root, ["a.csv", "b.csv"])
    assert [r.name for r in load(root=root, recordings=glob_entries("[a].csv")).recordings] == ["a", "b"]


def test_a_glob_in_a_folder_with_brackets_does_not_stand_for_another(load, tmp_path):
    days(tmp_path / "run[1]", ["t.csv"])
    days(tmp_path / "run1", ["u.csv"])
    assert [one.name for one in load(recordings=glob_entries("run[1]/*.csv")).recordings] == ["t", "b"]
    assert [one.name for one in load(recordings=glob_entries("run[12]/*.csv")).recordings] == ["u", "b"]


def test_a_glob_that_meets_a_file_twice_is_refused(load, tmp_path):
    days(tmp_path / "days", ["0106.csv"])
    (tmp_path / "days" / "0106.csv.gz").write_bytes(gzip.compress(ROWS.encode()))
    refused(load, "two recordings are named 0106", recordings=glob_entries("days/*"))


def test_a_missing_file_keeps_its_expected_place(load, tmp_path):
    (tmp_path / "a.csv").unlink()
    recording = load().recordings[0]
    assert not recording.exists
    assert recording.path == str(tmp_path / "a.csv")
    assert recording.name == "a"


def zipped(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(name, text)


@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".zip"])
@pytest.mark.parametrize("named", [False, True], ids=["found", "named"])
def test_a_compressed_recording_is_found_and_read(load, tmp_path, suffix, named):
    (tmp_path / "a.csv").unlink()
    path = tmp_path / f"a.csv{suffix}"
    if suffix == ".zip":
        zipped(path, {"inside/a.csv": ROWS})
    else:
        path.write_bytes({".gz": gzip, ".bz2": bz2}[suffix].compress(ROWS.encode()))
    entry = {**MINE["recordings"][0], "files": path.name if named else "a.csv"}
    recording = load(recordings=[entry, MINE["recordings"][1]]).recordings[0]
    assert (recording.exists, recording.name, recording.path) == (True, "a", str(path))
    with open_raw(recording.path) as file:
        assert file.read() == ROWS.encode()


def test_a_member_of_a_zip_is_found_and_read(load, tmp_path):
    zipped(tmp_path / "all.zip", {"day1.csv": "other", "sub/day2.csv": ROWS})
    entry = {**MINE["recordings"][0], "files": "all.zip/sub/day2.csv"}
    recording = load(recordings=[entry, MINE["recordings"][1]]).recordings[0]
    assert (recording.exists, recording.name) == (True, "day2")
    with open_raw(recording.path) as file:
        assert file.read() == ROWS.encode()


def test_the_plain_file_wins_over_a_compressed_one(tmp_path):
    (tmp_path / "a.csv").write_text(ROWS)
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"other"))
    assert find_recording(tmp_path / "a.csv") == tmp_path / "a.csv"
    assert find_recording(tmp_path / "nothing.csv") is None


def test_stems_keep_dots_that_are_no_suffix(load, tmp_path):
    days(tmp_path, ["tracks.01Jul.txt"])
    entry = {**MINE["recordings"][0], "files": "tracks.01Jul.txt"}
    assert load(recordings=[entry, MINE["recordings"][1]]).recordings[0].name == "tracks.01Jul"


# --- one file a person --------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["header", "plain", "text"])
def test_files_of_one_person_each_are_one_recording(tmp_path, form):
    folder = tmp_path / "people"
    folder.mkdir()
    for n, name in enumerate(["000002", "P 7" if form != "text" else "P7", "12"]):
        rows = [(k, 1.2 * k, float(n)) for k in range(8)]
        mark = " " if form == "text" else ","
        lines = [mark.join(map(str, row)) for row in rows]
        (folder / f"{name}.txt").write_text("\r\n".join([*(["t,x,y"] if form == "header" else []), *lines, ""]))
    columns = {"t": "t", "x": "x", "y": "y"} if form == "header" else {"t": 0, "x": 1, "y": 2}
    listed = {
        **MINE, "file_is": "person", "reader": "text" if form == "text" else "delimited", "header": form == "header",
        "columns": columns, "clock": "unknown", "hours": None,
        "recordings": [{"files": "people/*.txt", "split": {"by": "person", "test": 0.4}}],
    }  # fmt: skip
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(listed))
    dataset = load_dataset(tmp_path / "mine.yaml", tmp_path)
    assert [one.name for one in dataset.recordings] == ["people-train", "people-test"]
    whole = replace(dataset.recordings[0], chosen=None)
    tracks, account = clean_recording(whole.path, dataset, whole)
    ids = {"000002", "P 7" if form != "text" else "P7", "12"}
    assert set(tracks.track_id.tolist()) == {id_of(one) for one in ids}
    assert account["rows"] == {"read": 24, "kept": 24, "dropped": {}}
    np.testing.assert_allclose(tracks.speed[np.isfinite(tracks.speed)], 1.2)


def of_people(folder, files, **keys):
    """The dataset whose recording is files of one person each, {path: text}."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    listed = {
        **MINE, "file_is": "person", "columns": {"t": 0, "x": 1, "y": 2}, "clock": "unknown", "hours": None,
        "recordings": [{"files": "**/*.csv*", "split": {"by": "person", "test": 0.4}}], **keys,
    }  # fmt: skip
    (folder / "mine.yaml").write_text(yaml.safe_dump(listed))
    return load_dataset(folder / "mine.yaml", folder)


def people_rows(dataset):
    """The rows of all people of its first file, and their account."""
    one = dataset.recordings[0]
    return read_recording(source_of(one.path, dataset, one), dataset)


LINES = [f"{k},{1.2 * k},2" for k in range(6)]


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (("1.csv", "2.csv"), ["1", "2"]),
        (("p.1.csv", "p.2.csv", "p.csv"), ["p.1", "p.2", "p"]),
        (("g1/1.CSV", "g2/01.csv.gz", "g2/1.xyz"), ["1", "01", "1.xyz"]),
        (("g1/1.csv", "g2/1.csv"), None),
        (("1.csv", "1.csv.gz"), None),
        (("1.csv", "1 .csv"), None),  # readers take ids without blanks around them
    ],
)
def test_a_file_s_name_is_one_person(files, names):
    if names is not None:
        assert ids_of_people(files) == names
    else:
        with pytest.raises(DataError, match=f"{re.escape(f'{files[0]} and {files[1]}')}: .* both are '1': rename one"):
            ids_of_people(files)


def test_people_of_one_name_are_refused_and_of_others_kept(tmp_path):
    text = "\n".join(LINES)
    with pytest.raises(DataError, match=r"g1/1\.csv and .*g2/1\.csv: a file's name is its person's id"):
        of_people(tmp_path, {"g1/1.csv": text, "g2/1.csv": text + "\n", "g2/2.csv": text})
    (tmp_path / "g2/1.csv").unlink()
    tracks, _ = people_rows(of_people(tmp_path, {"p.1.csv": text, "p.2.csv": text}))
    assert set(tracks.track_id.tolist()) == {1, 2, id_of("p.1"), id_of("p.2")}


def test_each_folder_may_have_people_of_one_name(tmp_path):
    """As the message says: an entry each."""
    text, split = "\n".join(LINES), {"by": "person", "test": 0.4}
    entries = [{"files": f"g{n}/*.csv", "split": split} for n in (1, 2)]
    files = {"g1/1.csv": text, "g2/1.csv": text + "\n"}
    found = of_people(tmp_path, files, recordings=entries)
    assert [one.name for one in found.recordings] == ["g1-train", "g1-test", "g2-train", "g2-test"]


@pytest.mark.parametrize(
    ("globs", "names"),
    [
        (("walks/a_*.csv", "walks/b_*.csv"), ["walks.a_", "walks.b_"]),
        (("walks/[a]_*.csv", "walks/sub/c_?.csv"), ["walks", "sub"]),
        (("walks/*_1.csv", "*/*_2.csv", "walks/sub/*.csv"), ["walks._1", "_2", "sub"]),
    ],
)
def test_people_of_one_folder_may_be_several_recordings(tmp_path, globs, names):
    """Which are no neighbours of each other, unless they are of one day."""
    files = {f"walks/{one}.csv": "\n".join(LINES) + "\n" * n for n, one in enumerate(["a_1", "a_2", "b_1", "b_2"])}
    files["walks/sub/c_1.csv"] = "\n".join(LINES[:5])
    sides = ["train", "test", "test"]
    entries = [{"files": one, "split": side} for one, side in zip(globs, sides, strict=False)]
    found = of_people(tmp_path, files, recordings=entries)
    assert [one.name for one in found.recordings] == names
    assert not any(found.same_day(name) for name in names)
    dated = [{**one, "day": "2020-03-02"} for one in entries]
    found = of_people(tmp_path, files, recordings=dated, clock="recorded")
    assert all(len(found.same_day(name)) == len(names) - 1 for name in names)


@pytest.mark.parametrize(
    ("globs", "message"),
    [
        (("walks/*.csv", "walks/b_*.csv"), "walks/b_1.csv is listed twice; leave one out, or narrow a glob"),
        (("walks/**/*.csv", "walks/sub/*.csv"), "walks/sub/c_1.csv is listed twice"),
        (("walks/*1.csv", "walks/1*.csv"), r"named walks: walks/\*1.csv and walks/1\*.csv; .* a folder of their own"),
    ],
)
def test_nobody_is_of_two_recordings(tmp_path, globs, message):
    files = {f"walks/{one}.csv": "\n".join(LINES) for one in ["a_1", "b_1", "1_c", "sub/c_1"]}
    entries = [{"files": one, "split": side} for one, side in zip(globs, ["train", "test"], strict=True)]
    with pytest.raises(DataError, match=message):
        of_people(tmp_path, files, recordings=entries)


@pytest.mark.parametrize("reader", ["delimited", "text"])
@pytest.mark.parametrize("header", [False, True])
def test_people_s_files_read_as_one_file_with_ids(tmp_path, reader, header):
    """With comments and blank lines where they may be; only the names of columns stand once."""
    mark = " " if reader == "text" else ","
    rows = [line.replace(",", mark) for line in LINES]
    top = ["# frame rate 25", "", *([mark.join("txy")] if header else [])]
    within = [*rows[:3], "# he turns", "", "#", "  ", *rows[3:], "", "   # the end"]
    files = {f"p{n}.csv": "\n".join([*top, *within]) + "\n" for n in range(3)}
    columns = {name: name if header else n for n, name in enumerate("txy")}
    keys = {"reader": reader, "header": header, "comment": "#" if reader == "delimited" else None}
    tracks, account = people_rows(of_people(tmp_path / "people", files, **keys, columns=columns))

    named = [f"p{n}{mark}{line}" if line in rows else line for n in range(3) for line in within]
    one = tmp_path / "one.csv"
    one.write_text("\n".join([*top[:2], *([mark.join(["id", *"txy"])] if header else []), *named]) + "\n")
    ids = {"track_id": "id", **columns} if header else {"track_id": 0, "t": 1, "x": 2, "y": 3}
    given = {key: value for key, value in keys.items() if value is not None}
    plain, also = read_recording(one, FileFormat(**given, columns=Columns(**ids)))
    np.testing.assert_array_equal(np.array(tracks), np.array(plain))
    assert len(tracks.t) == 3 * len(LINES)
    assert account.dropped_rows - also.dropped_rows == {"comment_line": 2}  # above the rows of all but the first
    assert also.dropped_rows - account.dropped_rows == {}


def test_people_s_files_have_the_same_columns(tmp_path):
    """Those that are read, however they are quoted; another may be named after the person."""
    rows = "".join(f"{line},0\n" for line in LINES)
    files = {"1.csv": "", "2.csv": f"t,x,y,helmet 2\n{rows}", "3.csv": f't, x,"y",helmet 3\n{rows}'}
    keys = {"header": True, "columns": {"t": "t", "x": "x", "y": "y"}}
    tracks, _ = people_rows(of_people(tmp_path, files, **keys))
    assert set(tracks.track_id.tolist()) == {2, 3}
    for names in ("t,y,x,helmet 4", "t,x,z,helmet 4", "helmet 4,t,x,y"):
        (tmp_path / "4.csv").write_text(f"{names}\n{rows}")
        with pytest.raises(DataError, match=r"4\.csv: its columns stand elsewhere than those of .*2\.csv"):
            people_rows(load_dataset(tmp_path / "mine.yaml", tmp_path))


def test_who_a_row_is_of_is_said_once(load):
    without = {name: column for name, column in MINE["columns"].items() if name != "track_id"}
    refused(load, "no track_id: say whose a row is, or set `file_is: person`", columns=without)
    refused(load, "a track_id: leave it out", file_is="person")


def test_forecasts_of_a_track_are_whole_steps_apart(load):
    assert load().forecast_every_s is None
    assert load(forecast_every_s=10).forecast_every_s == 10
    refused(load, "forecast_every_s 2.5 is not a multiple of time_step_s 1.0", forecast_every_s=2.5)
    refused(load, "forecast_every_s", "above 0", forecast_every_s=0)
