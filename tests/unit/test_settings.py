"""Configuration and dataset files: what is shipped loads, what is mistyped is named with its remedy."""

import bz2
import copy
import gzip
import zipfile

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from modlhmp.cleaning import RULES
from modlhmp.readers import read_recording
from modlhmp.readers.raw import find_recording, open_raw
from modlhmp.settings import (
    averaged_parts,
    check,
    check_config,
    check_tuned,
    load_dataset,
    members,
    method_settings,
    methods_run,
    validation_part,
)
from modlhmp.storage import DataError

FEW = settings(max_examples=30, deadline=None, derandomize=True)
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
SHIPPED = ["atc", "atc_1day", "demo_forum", "demo_hall", "edinburgh", "edinburgh_25days"]


@pytest.fixture
def load(tmp_path, schemas):
    """Function (changes or YAML text) -> MINE with these keys changed (None: left out), written and loaded."""
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text(ROWS)

    def load_changed(text=None, root=tmp_path, **changes):
        settings = {key: value for key, value in {**copy.deepcopy(MINE), **changes}.items() if value is not None}
        path = tmp_path / "mine.yaml"
        path.write_text(yaml.safe_dump(settings) if text is None else text)
        return load_dataset(path, schemas["dataset"], root)

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


def merged(base, overlay):
    """An overlay as the workflow applies it: mappings are merged, all else replaced."""
    both = dict(base)
    for key, value in overlay.items():
        both[key] = merged(base[key], value) if isinstance(value, dict) and key in base else value
    return both


def test_every_shipped_configuration_is_valid(config_folder, schemas):
    files = sorted(config_folder.glob("*.yaml"))
    assert {"config.yaml", "paper.yaml", "real.yaml"} <= {file.name for file in files}
    base = yaml.safe_load((config_folder / "config.yaml").read_text())
    runs = []
    for file in files:
        config = merged(base, yaml.safe_load(file.read_text()))
        check(config, schemas["config"], file)
        check_config(config, config_folder / "datasets")
        runs.append(config["run"])
    assert len(set(runs)) == len(runs), "two configurations would write to the same folder"


def test_the_shipped_datasets_are_all_listed_here(config_folder):
    assert {file.stem for file in (config_folder / "datasets").glob("*.yaml")} >= set(SHIPPED)


def test_every_shipped_dataset_loads_without_its_files(config_folder, schemas, tmp_path):
    for file in sorted((config_folder / "datasets").glob("*.yaml")):
        dataset = load_dataset(file, schemas["dataset"], tmp_path)
        assert dataset["name"] == file.stem
        for recording in dataset["recordings"]:
            assert not recording["exists"]
            assert recording["path"] == str(tmp_path / recording["file"])
            assert isinstance(recording["day"], str)
        assert dataset["demo"] == file.stem.startswith("demo_")


@pytest.mark.parametrize(
    ("name", "train", "test"),
    [("atc", 1, 9), ("atc_1day", 1, 1), ("edinburgh", 5, 40), ("edinburgh_25days", 5, 20), ("demo_hall", 2, 2)],
)
def test_the_papers_days(load_shipped, tmp_path, name, train, test):
    splits = [recording["split"] for recording in load_shipped(name, tmp_path)["recordings"]]
    assert (splits.count("train"), splits.count("test")) == (train, test)


@pytest.mark.real
@pytest.mark.parametrize("name", ["atc_1day", "edinburgh_25days"])
def test_the_real_recordings_are_found(load_shipped, real_data, name):
    assert [r["path"] for r in load_shipped(name, real_data)["recordings"] if not r["exists"]] == []


# --- configuration ------------------------------------------------------------------------------------------


@pytest.fixture
def config(config_folder):
    return yaml.safe_load((config_folder / "config.yaml").read_text())


@pytest.mark.parametrize(
    ("path", "wrong", "right"),
    [
        ((), "compair", "compare"),
        ((), "data_rot", "data_root"),
        (("rollout",), "bata", "beta"),
        (("maps", "cliff"), "radius", "radius_m"),
        (("methods", "cvm"), "knd", "kind"),
        (("learned",), "futurs", "futures"),
        (("budgets", "demo", "tutr"), "epoch", "epochs"),
    ],
)
def test_a_mistyped_key_gets_a_hint(config, schemas, path, wrong, right):
    place = config
    for key in path:
        place = place[key]
    place[wrong] = place.pop(right, 1)
    with pytest.raises(DataError, match=f"unknown key '{wrong}', did you mean '{right}'") as error:
        check(config, schemas["config"], "my.yaml")
    assert str(error.value).startswith("my.yaml:")
    assert (".".join(path) or "top level") in str(error.value)


def test_a_key_like_no_other_gets_the_list(config, schemas):
    config["demo"]["zzz"] = 1
    with pytest.raises(DataError, match=r"demo: unknown key 'zzz' \(known: seed, scale\)"):
        check(config, schemas["config"], "my.yaml")


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("rollout", "k", 0),
        ("rollout", "k", 2.5),
        ("rollout", "beta", -1),
        ("rollout", "speed", "kernal"),
        ("demo", "scale", 0),
        ("demo", "seed", "one"),
        ("maps", "cliff", None),
        ("learned", "budget", "economic"),
        ("learned", "device", "gpu"),
        ("learned", "threads", 0),
        ("episodes", "pace", 2),
        ("episodes", "reach_m", 0),
        ("episodes", "k", 0),
        ("snippets", "kernel_m", 0),
        ("snippets", "length_s", 0),
        ("snippets", "most", 0),
        ("snippets", "exits", "no"),
        ("snippets", "heading_m", -1),
        ("rollout", "output", "median"),
        ("rollout", "velocity", "speeds"),
        ("rollout", "exits", 1),
    ],
)
def test_a_wrong_value_is_named_with_its_key(config, schemas, section, key, value):
    config[section][key] = value
    with pytest.raises(DataError, match=f"my.yaml:\n.*{section}.{key}: .*{value}"):
        check(config, schemas["config"], "my.yaml")


@pytest.mark.parametrize(("kind", "wrong"), [("lstm", "beta"), ("tc_cliff", "epochs")])
def test_an_option_of_another_kind_of_method_is_refused(config, schemas, kind, wrong):
    """A network has no beta, a map no epochs."""
    config["methods"]["mine"] = {"kind": kind, "title": "Mine", "options": {wrong: 1}}
    with pytest.raises(DataError, match=f"methods.mine.options: unknown key '{wrong}'"):
        check(config, schemas["config"], "my.yaml")


def test_a_network_s_settings_are_its_budget_s_and_its_own(config, schemas):
    """Its own options win; it may name another budget and other futures; threads are the rule's."""
    options = {"budget": "economical", "futures": "full", "epochs": 7, "rotate": False}
    config["methods"]["mine"] = {"kind": "tutr", "title": "Mine", "options": options}
    check(config, schemas["config"], "my.yaml")
    mine = method_settings(config, "mine")
    assert mine["options"] == {**config["budgets"]["economical"]["tutr"], "epochs": 7, "rotate": False}
    assert mine["learned"] == {"budget": "economical", "futures": "full", "device": "auto", "seed": 0}
    assert method_settings(config, "tutr")["options"] == config["budgets"]["demo"]["tutr"]
    assert method_settings(config, "cvm") == {"kind": "cvm", "options": {"velocity": "columns"}}
    assert method_settings(config, "stef")["options"] == config["rollout"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("snipets", "no method named 'snipets'; did you mean 'snippets'"),
        ("cvm", "cvm has no samples to score"),
        ("mid", "mid has no samples to score"),
        ("both", "both has no samples to score; methods that have are of the kinds cliff, tc_cliff"),
    ],
)
def test_only_methods_with_samples_are_measured(config, config_folder, name, message):
    """Maps have them; constant velocity, networks and averages have not."""
    config["methods"]["both"] = {"kind": "average", "title": "Both", "options": {"of": ["cvm", "episodes"]}}
    config["uncertainty"]["methods"] = ["stef", name]
    with pytest.raises(DataError, match=f"uncertainty.methods: {message}"):
        check_config(config, config_folder / "datasets")


def test_all_problems_are_told_at_once(config, schemas):
    config["rollout"]["k"] = 0
    config["sedes"] = config.pop("seeds")
    del config["demo"]
    with pytest.raises(DataError) as error:
        check(config, schemas["config"], "my.yaml")
    for part in ("rollout.k", "did you mean 'seeds'", "'seeds' is a required", "'demo' is a required"):
        assert part in str(error.value)


def test_problems_under_numbers_and_names_are_told_side_by_side(config, schemas):
    """YAML reads a method called 1 as a number."""
    config["methods"] = {1: {"kind": "none"}, "a": {"kind": "none"}}
    with pytest.raises(DataError, match="my config"):
        check(config, schemas["config"], "my config")


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("compare", ["tc_cliff", "clif"], "no method named 'clif'; did you mean 'cliff'"),
        ("comparisons", [["tc_cliff", "stf"]], "no method named 'stf'; did you mean 'stef'"),
        ("compare", ["zzz"], "no method named 'zzz'; known: tc_cliff, cliff, stef, trajectronpp"),
        ("datasets", ["demo_hal"], "no dataset named 'demo_hal'; did you mean 'demo_hall'"),
        ("datasets", ["zzz"], "no dataset named 'zzz'; known: "),
    ],
)
def test_an_unknown_name_gets_a_hint(config, config_folder, key, value, message):
    config[key] = value
    with pytest.raises(DataError, match=f"configuration, {key}: {message}"):
        check_config(config, config_folder / "datasets")


# --- maps with memory, averages, tuned options --------------------------------------------------------------


def averaging(config, *names, compare=True):
    """The configuration with a method `mean` of these; all are compared."""
    config["methods"]["mean"] = {"kind": "average", "title": "Mean", "options": {"of": list(names)}}
    config["compare"] = ["mean", *(dict.fromkeys(name for name in names if compare and name in config["methods"]))]
    config["ladder"]["rows"] = []
    return config


@pytest.mark.parametrize("names", [("episodes", "snippets"), ("cvm", "episodes"), ("lstm", "tutr", "snippets")])
def test_methods_of_one_path_can_be_averaged(config, schemas, config_folder, names):
    averaging(config, *names)
    check(config, schemas["config"], "my.yaml")
    check_config(config, config_folder / "datasets")
    assert members(config, "mean") == list(names)
    assert method_settings(config, "mean") == {"kind": "average", "options": {"of": list(names)}}


def test_other_methods_average_nothing(config):
    others = [name for name, method in config["methods"].items() if method["kind"] != "average"]
    assert {tuple(members(config, name)) for name in others} == {()}


@pytest.mark.parametrize("name", ["cliff", "tc_cliff", "stef", "mid"])
def test_futures_of_equal_standing_have_no_path_to_average(config, config_folder, name):
    averaging(config, "episodes", name)
    message = rf"methods\.mean\.options\.of: {name} has no single path to be averaged; kinds that have are average, cvm"
    with pytest.raises(DataError, match=message):
        check_config(config, config_folder / "datasets")


def test_what_is_averaged_is_run_as_well(config, config_folder):
    averaging(config, "episodes", "snippets", compare=False)
    check_config(config, config_folder / "datasets")
    assert set(methods_run(config)) >= {"mean", "episodes", "snippets"}
    assert "snippets" not in config["compare"]


def minimal(methods, compare, rows=(), reference="cvm", beside=()):
    """A configuration of nothing but these names; `methods` {name: those that it averages}."""
    kinds = {
        name: {"kind": "average", "options": {"of": of}} if of else {"kind": "cvm"} for name, of in methods.items()
    }
    ladder = {"reference": reference, "rows": [[row, "a change"] for row in rows], "beside": list(beside)}
    return {"methods": kinds, "compare": compare, "ladder": ladder}


def test_what_runs_is_closed_under_averaging():
    """Averages of averages of averages bring their members, each once, after the names that were asked for."""
    methods = {"a": [], "b": [], "c": [], "d": [], "ab": ["a", "b"], "abc": ["ab", "c"], "all": ["abc", "ab", "d"]}
    assert methods_run(minimal(methods, ["all", "c"])) == ["all", "c", "abc", "ab", "d", "a", "b"]
    assert methods_run(minimal(methods, ["ab"])) == ["ab", "a", "b"]


@FEW
@given(st.integers(0, 10**6))
def test_what_runs_is_the_closure_that_a_search_finds(seed):
    rng = np.random.default_rng(seed)
    names = [f"m{n}" for n in range(12)]
    methods = {name: rng.permutation(names[:n])[: rng.integers(0, 4)].tolist() for n, name in enumerate(names)}
    asked = rng.permutation(names)[:2].tolist()
    found, waiting = set(), list(asked)
    while waiting:
        name = waiting.pop()
        found.add(name)
        waiting += methods[name]
    got = methods_run(minimal(methods, asked))
    assert len(got) == len(set(got))
    assert set(got) == found
    assert got[:2] == asked


def test_rungs_and_what_they_are_compared_with_are_run_as_well():
    methods = {name: [] for name in ("a", "b", "reference", "one", "other", "unused")} | {"mean": ["a", "b"]}
    config = minimal(methods, ["mean"], ["a", "mean"], "reference", [["one", "other", "what differs"]])
    assert methods_run(config) == ["mean", "a", "reference", "one", "other", "b"]


def test_a_ladder_whose_goal_is_not_compared_is_left_out():
    """So that a run without networks trains none."""
    methods = {name: [] for name in ("a", "reference", "goal")}
    assert methods_run(minimal(methods, ["a"], ["a", "goal"], "reference", [])) == ["a"]
    assert methods_run(minimal(methods, ["goal"], ["a", "goal"], "reference", [])) == ["goal", "a", "reference"]


def test_an_empty_ladder_needs_no_reference():
    """Nor the pairs beside it: without rungs there is no ladder."""
    methods = {name: [] for name in ("a", "reference", "one", "other")}
    assert methods_run(minimal(methods, ["a"], [], "reference", [["one", "other", "what differs"]])) == ["a"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reference": "tc_clif"}, "ladder.reference: no method named 'tc_clif'; did you mean 'tc_cliff'"),
        ({"rows": [["cvn", "a line"]]}, "ladder.rows: no method named 'cvn'; did you mean 'cvm'"),
        ({"beside": [["cvm", "stf", "a map"]]}, "ladder.beside: no method named 'stf'; did you mean 'stef'"),
    ],
)
def test_an_unknown_rung_gets_a_hint(config, config_folder, changes, message):
    config["ladder"] |= changes
    with pytest.raises(DataError, match=f"configuration, {message}"):
        check_config(config, config_folder / "datasets")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("snipets", "studies.training.methods: no method named 'snipets'; did you mean 'snippets'"),
        ("tc_cliff", "studies.training: tc_cliff is not of a kind cliff, episodes, snippets"),
        ("neural_map", "studies.training: neural_map is not of a kind"),
        ("hybrid", "studies.training: hybrid is not of a kind"),
    ],
)
def test_only_maps_that_are_rebuilt_at_once_are_built_from_less(config, config_folder, name, message):
    config["studies"]["training"]["methods"] = ["episodes", name]
    with pytest.raises(DataError, match=f"configuration, {message}"):
        check_config(config, config_folder / "datasets")


@pytest.mark.parametrize("shares", [[0], [1.5], [0.1, 0.1], ["all"]])
def test_a_share_is_part_of_the_whole(config, schemas, shares):
    config["studies"]["training"]["shares"] = shares
    with pytest.raises(DataError, match=r"studies\.training\.shares"):
        check(config, schemas["config"], "my.yaml")


def test_averages_of_averages_are_made_of_what_forecasts(config, config_folder):
    averaging(config, "episodes", "inner")
    config["methods"]["inner"] = {"kind": "average", "title": "Inner", "options": {"of": ["lstm", "episodes"]}}
    check_config(config, config_folder / "datasets")
    assert averaged_parts(config, "mean") == ["episodes", "lstm"]
    assert averaged_parts(config, "lstm") == ["lstm"]
    assert set(methods_run(config)) >= {"mean", "inner", "episodes", "lstm"}


def test_an_average_of_itself_is_refused(config, config_folder):
    averaging(config, "episodes", "inner")
    config["methods"]["inner"] = {"kind": "average", "title": "Inner", "options": {"of": ["lstm", "mean"]}}
    with pytest.raises(DataError, match=r"methods\.mean\.options\.of: mean of inner of mean averages itself"):
        check_config(config, config_folder / "datasets")


def test_a_mistyped_member_gets_a_hint(config, config_folder):
    averaging(config, "episodes", "snipets")
    config["compare"].append("snippets")
    with pytest.raises(DataError, match="named 'snipets'; did you mean 'snippets'"):
        check_config(config, config_folder / "datasets")


@pytest.mark.parametrize(
    "options", [None, {}, {"of": []}, {"of": ["episodes"]}, {"of": "episodes"}, {"off": ["a", "b"]}]
)
def test_an_average_needs_two_members(config, schemas, options):
    method = {"kind": "average", "title": "Mean", "options": options}
    config["methods"]["mean"] = {key: value for key, value in method.items() if value is not None}
    with pytest.raises(DataError, match=r"methods\.mean"):
        check(config, schemas["config"], "my.yaml")


@pytest.mark.parametrize("kind", ["episodes", "snippets"])
def test_options_of_a_map_with_memory_are_its_sections_and_its_own(config, schemas, kind):
    config["methods"]["mine"] = {"kind": kind, "title": "Mine", "options": {"k": 3, "pace": 0.5}}
    check(config, schemas["config"], "my.yaml")
    assert method_settings(config, kind) == {"kind": kind, "options": config[kind]}
    assert method_settings(config, "mine") == {"kind": kind, "options": {**config[kind], "k": 3, "pace": 0.5}}


@pytest.mark.parametrize(("kind", "wrong"), [("episodes", "kernel_m"), ("snippets", "reach_m"), ("cvm", "k")])
def test_options_of_one_map_with_memory_are_not_the_others(config, schemas, kind, wrong):
    config["methods"]["mine"] = {"kind": kind, "title": "Mine", "options": {wrong: 1}}
    with pytest.raises(DataError, match=f"methods.mine.options: unknown key '{wrong}'"):
        check(config, schemas["config"], "my.yaml")


@pytest.mark.parametrize("name", ["episodes", "snippets", "cliff", "cvm", "tutr"])
def test_tuned_options_win(config, name):
    """Over a method's own, and these over the section's or budget's; the rest stays."""
    own = {"cvm": "velocity", "tutr": "epochs"}.get(name, "k")
    config["methods"][name]["options"] = {own: 1}
    plain = method_settings(config, name)
    assert plain["options"][own] == 1
    tuned = method_settings(config, name, {name: {own: 2}})
    assert tuned == {**plain, "options": {**plain["options"], own: 2}}
    assert config["methods"][name]["options"] == {own: 1}, "of other datasets they stay as they were"


def test_options_tuned_for_a_kind_hold_where_a_method_says_nothing(config):
    config["methods"]["mine"] = {"kind": "snippets", "title": "Mine", "options": {"length_s": 1}}
    config["methods"]["other"] = {"kind": "snippets", "title": "Other", "options": {"most": 10}}
    tuned = {"snippets": {"length_s": 3}}
    found = {name: method_settings(config, name, tuned)["options"] for name in ("mine", "other", "episodes")}
    assert (found["mine"]["length_s"], found["other"]["length_s"], found["other"]["most"]) == (1, 3, 10)
    assert "length_s" not in found["episodes"]


def tuned(**options):
    return {"mine": {"name": "mine", "tuned": options}}


def test_tuned_options_that_a_method_takes_are_accepted(config, schemas):
    datasets = tuned(snippets={"kernel_m": 0.7, "exits": False}, cvm={"velocity": "differences"}, lstm={"epochs": 3})
    before = copy.deepcopy(config)
    check_tuned(datasets, config, schemas["config"])
    assert config == before


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ({"snipets": {"k": 3}}, ["no kind or method named 'snipets'; did you mean 'snippets'"]),
        ({"snippets": {"kernel": 3}}, ["methods.snippets.options: unknown key 'kernel', did you mean 'kernel_m'"]),
        ({"snippets": {"kernel_m": 0}}, ["methods.snippets.options.kernel_m", "0"]),
        ({"average": {"of": ["a", "b"]}}, ["no kind or method named 'average'"]),
        ({"cliff": {"reach_m": 3}}, ["methods.cliff.options: unknown key 'reach_m'"]),
    ],
)
def test_tuned_options_that_are_none_are_refused(config, schemas, options, parts):
    with pytest.raises(DataError) as error:
        check_tuned(tuned(**options), config, schemas["config"])
    for part in ("config/datasets/mine.yaml, tuned", *parts):
        assert part in str(error.value)


def test_a_dataset_file_can_hold_tuned_options(load):
    assert load()["tuned"] == {}
    assert load(tuned={"snippets": {"k": 7}})["tuned"] == {"snippets": {"k": 7}}
    refused(load, "tuned.snippets", tuned={"snippets": 7})


# --- the validation part ------------------------------------------------------------------------------------


def training(*day_numbers):
    """A dataset of these training days, two recordings each, and a test day."""
    listed = [(f"{day}{half}", f"2020-03-{day:02}", "train") for day in day_numbers for half in "ab"]
    listed.append(("test", "2020-03-31", "test"))
    return {
        "label": "mine",
        "recordings": [
            {"name": name, "path": f"{name}.csv", "day": day, "split": split, "part": None}
            for name, day, split in listed
        ],
    }


@pytest.mark.parametrize(
    ("days_of_training", "held"), [((1, 2), 1), ((1, 2, 3), 1), ((1, 2, 3, 4), 2), (range(1, 11), 3), (range(1, 12), 4)]
)
def test_the_last_training_days_stand_in_for_the_test_set(days_of_training, held):
    """30 % of them, rounded up, whole days; the test recordings are gone."""
    dataset = training(*list(days_of_training)[::-1])
    got = validation_part(dataset)
    by_split = {split: {r["day"] for r in got["recordings"] if r["split"] == split} for split in ("train", "test")}
    in_order = [f"2020-03-{day:02}" for day in days_of_training]
    assert by_split == {"train": set(in_order[:-held]), "test": set(in_order[-held:])}
    assert [r["name"] for r in got["recordings"]] == [r["name"] for r in dataset["recordings"][:-1]]
    assert {r["part"] for r in got["recordings"]} == {None}
    assert got["label"] == "mine"


def test_a_single_training_day_is_cut_in_two():
    """Each of its recordings becomes two, of names of their own, read from the same file."""
    got = validation_part(training(4))["recordings"]
    parts = [(r["name"], r["path"], r["split"], r["part"]) for r in got]
    assert parts == [
        ("4a-fit", "4a.csv", "train", "fit"),
        ("4a-validation", "4a.csv", "test", "validation"),
        ("4b-fit", "4b.csv", "train", "fit"),
        ("4b-validation", "4b.csv", "test", "validation"),
    ]


@pytest.mark.parametrize("days_of_training", [(4,), (4, 5)])
def test_the_dataset_itself_is_not_changed(days_of_training):
    dataset = training(*days_of_training)
    before = copy.deepcopy(dataset)
    validation_part(dataset)
    assert dataset == before


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_dataset_has_a_validation_part(load_shipped, tmp_path, name):
    dataset = load_shipped(name, tmp_path)
    got = validation_part(dataset)["recordings"]
    names = [recording["name"] for recording in got]
    assert len(set(names)) == len(names)
    assert {recording["split"] for recording in got} == {"train", "test"}
    own = {recording["path"] for recording in dataset["recordings"] if recording["split"] == "train"}
    assert {recording["path"] for recording in got} == own


# --- dataset files ------------------------------------------------------------------------------------------


def test_a_dataset_file_gets_its_defaults(load):
    dataset = load()
    assert (dataset["name"], dataset["label"]) == ("mine", "mine")
    assert dataset["time_step_s"] == 1.0
    assert dataset["cleaning"] == ["single_row", "gap_over_5s"]
    assert [recording["name"] for recording in dataset["recordings"]] == ["a", "b"]
    assert all(recording["exists"] for recording in dataset["recordings"])


def test_a_loaded_dataset_can_be_read(load):
    dataset = load()
    tracks, _ = read_recording(dataset["recordings"][0]["path"], dataset, dataset["recordings"][0])
    assert tracks.t.tolist() == [1_583_136_000.0 + k for k in range(3)]


@pytest.mark.parametrize(
    ("wrong", "right"), [("readr", "reader"), ("timezon", "timezone"), ("citaton", "citation"), ("hour", "hours")]
)
def test_a_mistyped_key_of_a_dataset_gets_a_hint(load, wrong, right):
    refused(load, f"unknown key '{wrong}', did you mean '{right}'", **{wrong: MINE[right], right: None})


def test_a_mistyped_key_of_a_recording_gets_a_hint(load):
    recordings = [{**MINE["recordings"][0], "spilt": "train"}, MINE["recordings"][1]]
    refused(load, "recordings.0: unknown key 'spilt', did you mean 'split'", recordings=recordings)


@pytest.mark.parametrize("key", ["title", "reader", "timezone", "hours", "recordings", "horizon_s", "velocity"])
def test_a_missing_key_is_named(load, key):
    refused(load, f"'{key}' is a required property", **{key: None})


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
    assert load(cleaning=[{rule: options[rule]} if rule in options else rule])["cleaning"]


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
    refused(load, "recordings.0.start: 630 is not of type 'string'", "quoted", text=text)


def test_an_unquoted_day_is_a_date(load):
    text = text_with(day=("'2020-03-02'", "2020-03-02"))
    assert load(text=text)["recordings"][0]["day"] == "2020-03-02"


@pytest.mark.parametrize("start", ["8:00", "24:00", "29:59", "08:60", "noon", ""])
def test_a_start_that_is_no_clock_time_is_refused(load, start):
    recordings = [{**MINE["recordings"][0], "start": start}, MINE["recordings"][1]]
    refused(load, "start", start, recordings=recordings)


@pytest.mark.parametrize("day", ["2020-02-30", "2.3.2020", "yesterday", "2020-03-02T10:00", "2020-03-02 10:00:00"])
def test_a_day_that_is_no_date_is_refused(load, day):
    recordings = [{**MINE["recordings"][0], "day": day}, MINE["recordings"][1]]
    refused(load, "day", day, "2012-10-24", recordings=recordings)


@pytest.mark.parametrize("hours", [[9, 9], [17, 9], [24, 0]])
def test_empty_hours_are_refused(load, hours):
    refused(load, f"hours {hours} are empty", "one after the last", hours=hours)


@pytest.mark.parametrize("hours", [[9], [9, 25], [-1, 3], [9, 12, 15], ["9", "17"], 9])
def test_hours_that_are_none_are_refused(load, hours):
    refused(load, "hours", hours=hours)


@pytest.mark.parametrize(("horizon", "step"), [(10.5, 1.0), (1, 0.3), (0.5, 1.0)])
def test_the_horizon_is_a_number_of_steps(load, horizon, step):
    refused(load, "multiple of time_step_s", horizon_s=horizon, time_step_s=step)


def test_a_horizon_of_binary_fractions_is_fine(load):
    assert load(horizon_s=4.8, time_step_s=0.4)["horizon_s"] == 4.8


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"reader": "edinburgh", "scale": 0.02}, "needs the key 'frame_rate'"),
        ({"reader": "edinburgh", "frame_rate": 9.0}, "needs the key 'scale'"),
        ({"reader": "edinburgh_rows", "frame_rate": 9.0, "scale": 0.02}, "needs the key 'row_stride'"),
        ({"columns": None}, "needs the key 'columns'"),
        ({"units": {"length": "px"}}, "need the key 'scale'"),
        ({"units": {"time": "frame"}}, "need the key 'frame_rate'"),
        ({"velocity": "columns"}, "use velocity: differences"),
        ({"columns": {**MINE["columns"], "speed": 4}}, "both speed and heading"),
        ({"columns": {**MINE["columns"], "heading": 4}}, "both speed and heading"),
    ],
)
def test_what_a_reader_needs_is_named(load, changes, part):
    refused(load, part, **changes)


@pytest.mark.parametrize("split", ["train", "test"])
def test_both_splits_are_needed(load, split):
    other = [{**recording, "split": split} for recording in MINE["recordings"]]
    missing = {"train": "test", "test": "train"}[split]
    refused(load, f"no recording has `split: {missing}`", recordings=other)


def test_two_recordings_of_one_name_are_refused(load, tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.csv").write_text(ROWS)
    more = [*MINE["recordings"], {"files": "other/a.csv", "day": "2020-03-04", "split": "test"}]
    refused(load, "two recordings are named a;", "different names", recordings=more)


@pytest.mark.parametrize("text", ["", "just text", "- a\n- b\n", "42"])
def test_a_file_that_is_no_mapping_is_refused(load, text):
    refused(load, "mapping", text=text)


@pytest.mark.parametrize("text", ["a: [1, 2", "a: b: c", "\ttitle: x", "a: 1\n\x00"])
def test_a_file_that_is_no_yaml_is_refused(load, text):
    refused(load, "not valid YAML", text=text)


def test_a_file_in_another_encoding_is_refused(tmp_path, schemas):
    path = tmp_path / "mine.yaml"
    path.write_bytes("title: Café\n".encode("latin-1"))
    with pytest.raises(DataError, match=r"mine\.yaml"):
        load_dataset(path, schemas["dataset"], tmp_path)


# --- where recordings lie -----------------------------------------------------------------------------------


def days(folder, names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).write_text(ROWS)


def glob_entries(pattern, split="train"):
    return [{"files": pattern, "day": "2020-03-02", "split": split}, {**MINE["recordings"][1], "files": "b.csv"}]


def test_a_glob_stands_for_its_files_in_order(load, tmp_path):
    days(tmp_path / "days", ["0107.csv", "0106.csv", "0111.csv", "readme.txt"])
    dataset = load(recordings=glob_entries("days/01*.csv"))
    found = [r for r in dataset["recordings"] if r["split"] == "train"]
    assert [recording["name"] for recording in found] == ["0106", "0107", "0111"]
    assert all(recording["exists"] and recording["day"] == "2020-03-02" for recording in found)
    assert found[0]["file"] == "days/0106.csv"


def test_a_glob_without_a_file_is_refused(load):
    refused(load, "no file matches", "nothing/*.csv", "data_root", recordings=glob_entries("nothing/*.csv"))


def test_a_glob_works_below_a_folder_with_brackets(load, tmp_path):
    root = tmp_path / "data [2020]"
    days(root, ["a.csv", "b.csv"])
    assert [r["name"] for r in load(root=root, recordings=glob_entries("[a].csv"))["recordings"]] == ["a", "b"]


def test_a_glob_that_meets_a_file_twice_is_refused(load, tmp_path):
    days(tmp_path / "days", ["0106.csv"])
    (tmp_path / "days" / "0106.csv.gz").write_bytes(gzip.compress(ROWS.encode()))
    refused(load, "two recordings are named 0106", recordings=glob_entries("days/*"))


def test_a_missing_file_keeps_its_expected_place(load, tmp_path):
    (tmp_path / "a.csv").unlink()
    recording = load()["recordings"][0]
    assert not recording["exists"]
    assert recording["path"] == str(tmp_path / "a.csv")
    assert recording["name"] == "a"


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
    recording = load(recordings=[entry, MINE["recordings"][1]])["recordings"][0]
    assert (recording["exists"], recording["name"], recording["path"]) == (True, "a", str(path))
    with open_raw(recording["path"]) as file:
        assert file.read() == ROWS.encode()


def test_a_member_of_a_zip_is_found_and_read(load, tmp_path):
    zipped(tmp_path / "all.zip", {"day1.csv": "other", "sub/day2.csv": ROWS})
    entry = {**MINE["recordings"][0], "files": "all.zip/sub/day2.csv"}
    recording = load(recordings=[entry, MINE["recordings"][1]])["recordings"][0]
    assert (recording["exists"], recording["name"]) == (True, "day2")
    with open_raw(recording["path"]) as file:
        assert file.read() == ROWS.encode()


def test_the_plain_file_wins_over_a_compressed_one(tmp_path):
    (tmp_path / "a.csv").write_text(ROWS)
    (tmp_path / "a.csv.gz").write_bytes(gzip.compress(b"other"))
    assert find_recording(tmp_path / "a.csv") == tmp_path / "a.csv"
    assert find_recording(tmp_path / "nothing.csv") is None


def test_stems_keep_dots_that_are_no_suffix(load, tmp_path):
    days(tmp_path, ["tracks.01Jul.txt"])
    entry = {**MINE["recordings"][0], "files": "tracks.01Jul.txt"}
    assert load(recordings=[entry, MINE["recordings"][1]])["recordings"][0]["name"] == "tracks.01Jul"
