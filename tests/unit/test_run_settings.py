"""The configuration of a run: what is shipped is valid, what is mistyped is named with its remedy."""

import dataclasses
import json
import os
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from planted import days_of_the_archive

from modlhmp.methods import Method
from modlhmp.options import ConstantVelocity, Episodes, Learning, NeuralMap, RollOut, Snippets, Tutr
from modlhmp.settings import as_plain, build
from modlhmp.splits import FOLDS
from modlhmp.storage import DataError
from modlhmp.study.configuration import check_maps, load_datasets, load_run
from modlhmp.study.layout import Layout
from modlhmp.study.plan import Plan
from modlhmp.study.settings import RunSettings

DATASETS = Path(__file__).parents[2] / "config/datasets"
FEW = settings(max_examples=30, deadline=None, derandomize=True)


def load(config):
    return load_run(config, DATASETS)


def refused(config):
    """The message for a configuration that is wrong."""
    with pytest.raises(DataError) as error:
        load(config)
    return str(error.value)


# --- what is shipped ----------------------------------------------------------------------------------------


def merged(base, overlay):
    """An overlay as the workflow applies it: mappings are merged, all else replaced."""
    both = dict(base)
    for key, value in overlay.items():
        both[key] = merged(base[key], value) if isinstance(value, dict) and key in base else value
    return both


def of_files(*files):
    """The configuration of several files, the later ones over the earlier ones."""
    both = {}
    for file in files:
        both = merged(both, yaml.safe_load(file.read_text()))
    return both


@pytest.fixture(scope="session")
def shipped(config_folder):
    """Every shipped configuration as it is run, by the file's name: those of lab/ over the real recordings'."""
    base = [config_folder / "budgets.yaml", config_folder / "config.yaml"]
    found = {"config.yaml": of_files(*base)}
    for file in sorted({*config_folder.glob("*.yaml"), *config_folder.glob("lab/*.yaml")} - set(base)):
        real = [config_folder / "real.yaml"] if file.parent.name == "lab" else []
        if file.stem == "likelihood_edinburgh":
            real.append(file.with_name("likelihood.yaml"))
        found[file.name] = of_files(*base, *real, file)
    return found


@pytest.fixture
def config(shipped):
    return json.loads(json.dumps(shipped["config.yaml"]))


def test_every_shipped_configuration_is_valid(shipped):
    assert {"config.yaml", "paper.yaml", "real.yaml", "tiny.yaml", "ladder.yaml", "networks.yaml"} <= shipped.keys()
    runs = [load(config).run for config in shipped.values()]
    assert len(set(runs)) == len(runs), "two configurations would write to the same folder"


def test_the_datasets_of_every_shipped_configuration_fit_it(shipped, tmp_path):
    """Labels, `tuned` options and the demo's name; no recording is needed, a published map is looked at."""
    for config in shipped.values():
        run = load(config)
        for name in filter(None, map(run.published, run.compare)):
            file = tmp_path / run.entries[name].file
            file.parent.mkdir(exist_ok=True)
            rows = [f"{x},0,{5.5 if x % 2 else 4.2},1.1,0.1,0,0,0.1,1,1,0.5" for x in range(9)]
            file.write_text("\n".join(rows) + "\n", encoding="utf-8")
        days_of_the_archive(tmp_path)
        found = load_datasets(run, DATASETS, tmp_path, "demo")
        if run.evaluate_on == "folds":
            assert list(found) == [f"{name}-{fold}" for name in run.datasets for fold in range(1, FOLDS + 1)]
        else:
            assert list(found) == list(run.datasets)


def test_the_run_as_plain_values_is_a_configuration_of_itself(shipped):
    """What jobs and the report are given, and what a job makes of it again."""
    for config in shipped.values():
        run = load(config)
        plain = json.loads(json.dumps(as_plain(run)))
        assert load(plain) == run
        assert build(RunSettings, plain) == run


PUBLISHED = ["trajectronpp", "mid", "tutr", "social_lstm", "lstm"]


def test_published_networks_are_trained_until_twice_the_windows_do_not_help_on_real_recordings(shipped):
    """Ours are trained once, and so are the demo's and those that show what one change or another seed does."""
    real, more = load(shipped["real.yaml"]), load(shipped["networks.yaml"])
    assert all(real.method(name).learning.doubling for name in PUBLISHED)
    assert {real.method(name).learning.most_minutes for name in PUBLISHED} == {60}
    assert not real.method("neural_map").learning.doubling
    for file, names in (
        ("config.yaml", PUBLISHED),
        ("networks.yaml", ["lstm_1", "lstm_full"]),
        ("real.yaml", ["lstm_axes", "trajectronpp_axes"]),
        ("ladder.yaml", ["neural_map_1"]),
    ):
        assert not any(load(shipped[file]).method(name).learning.doubling for name in names), file
    seeds = [(name, seed) for name in PUBLISHED for seed in (1, 2) if f"{name}_{seed}" in more.compare]
    assert {name for name, seed in seeds if seed == 1} == set(PUBLISHED)
    for name, seed in seeds:
        one, plain = more.method(f"{name}_{seed}"), real.method(name)
        assert one.options == dataclasses.replace(
            plain.options, windows=one.options.windows, patience=one.options.patience
        )
        assert one.learning == dataclasses.replace(plain.learning, seed=seed, doubling=False)


def test_the_full_budget_has_the_windows_and_iterations_of_the_originals(shipped):
    """Epochs of all 374,595 windows of the ATC day, to four digits; nothing stops them early."""
    full = {name: load(shipped["paper.yaml"]).method(name).options for name in PUBLISHED}
    for name, options in full.items():
        epochs = 25 if "lstm" in name else 100
        assert options.windows == round(epochs * 374_595, -4 if epochs == 100 else -3)
        assert options.patience == options.windows
    iterations = {name: round(options.windows / options.batch_size, -3) for name, options in full.items()}
    assert iterations == {
        "trajectronpp": 146_000, "mid": 146_000, "tutr": 293_000, "social_lstm": 1_171_000, "lstm": 1_171_000
    }  # fmt: skip


# --- configuration ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("path", "wrong", "right"),
    [
        ((), "compair", "compare"),
        ((), "data_rot", "data_root"),
        (("rollout",), "bata", "beta"),
        (("maps", "cliff"), "radius", "radius_m"),
        (("methods", "hybrid"), "knd", "kind"),
        (("learned",), "futurs", "futures"),
        (("budgets", "demo", "tutr"), "window", "windows"),
    ],
)
def test_a_mistyped_key_gets_a_hint(config, path, wrong, right):
    place = config
    for key in path:
        place = place.setdefault(key, {})
    place[wrong] = place.pop(right, 1)
    message = refused(config)
    assert message.startswith("configuration")
    assert f"unknown key '{wrong}', did you mean '{right}'" in message
    assert f"\n  {'.'.join(path) or 'top level'}: unknown key" in message


def test_a_key_like_no_other_gets_the_list(config):
    config["demo"] = {"zzz": 1}
    assert "demo: unknown key 'zzz' (known: seed, scale)" in refused(config)


WRONG_VALUES = [
    ("rollout", "k", 0),
    ("rollout", "k", 2.5),
    ("rollout", "beta", -1),
    ("rollout", "speed", "kernal"),
    ("demo", "scale", 0),
    ("demo", "seed", "one"),
    ("maps", "cliff", None),
    ("learned", "device", "gpu"),
    ("learned", "threads", 0),
    ("episodes", "pace", 2),
    ("episodes", "reach_m", 0),
    ("episodes", "persons", 0),
    ("snippets", "bandwidth_m", 0),
    ("snippets", "length_s", 0),
    ("snippets", "most", 0),
    ("snippets", "exits", "no way"),
    ("snippets", "heading_m", -1),
    ("rollout", "output", "median"),
    ("rollout", "velocity", "speeds"),
    ("rollout", "exits", 1),
]


@pytest.mark.parametrize(("section", "key", "value"), WRONG_VALUES)
def test_a_wrong_value_is_named_with_its_key(config, section, key, value):
    config.setdefault(section, {})[key] = value
    message = refused(config)
    assert message.startswith("configuration:\n")
    assert f"{section}.{key}: {value!r} is " in message


def test_a_budget_that_there_is_not_gets_a_hint(config):
    config["learned"] = {"budget": "economic"}
    assert "learned.budget: no budget named 'economic'; did you mean 'economical'" in refused(config)
    config["learned"] = {}
    config["methods"]["mine"] = {"kind": "tutr", "options": {"budget": "fulll"}}
    assert "methods.mine.options.budget: no budget named 'fulll'; did you mean 'full'" in refused(config)


@pytest.mark.parametrize(("kind", "wrong"), [("lstm", "beta"), ("tc_cliff", "windows")])
def test_an_option_of_another_kind_of_method_is_refused(config, kind, wrong):
    """A network has no beta, a map no windows."""
    config["methods"]["mine"] = {"kind": kind, "title": "Mine", "options": {wrong: 1}}
    assert f"methods.mine.options: unknown key '{wrong}'" in refused(config)


def test_a_network_s_settings_are_its_budget_s_and_its_own(config):
    """Its own options win; it may name another budget and other futures; threads are the rule's."""
    options = {"budget": "economical", "futures": "full", "windows": 7, "rotate": False}
    config["methods"]["mine"] = {"kind": "tutr", "title": "Mine", "options": options}
    run = load(config)
    mine = run.method("mine")
    assert mine.options == Tutr(**{**config["budgets"]["economical"]["tutr"], "windows": 7, "rotate": False})
    assert mine.learning == Learning(budget="economical", futures="full", device="auto", seed=0)
    assert run.method("tutr").options == Tutr(**config["budgets"]["demo"]["tutr"])
    assert (run.method("cvm").kind, run.method("cvm").options) == ("cvm", ConstantVelocity(velocity="dataset"))
    assert run.method("stef").options == RollOut()


def test_scenes_of_a_network_that_learns_a_map_cannot_be_turned(config):
    config["methods"]["mine"] = {"kind": "neural_map", "title": "Mine", "options": {"rotate": True}}
    assert "rotate: True is not one of False" in refused(config)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("snipets", "no method named 'snipets'; did you mean 'snippets'"),
        ("cvm", "cvm has no samples to score"),
        ("lstm", "lstm has no samples to score"),
        ("both", "both has no samples to score; methods that have some are of the kinds cliff, tc_cliff"),
    ],
)
def test_only_methods_with_samples_are_measured(config, name, message):
    """Maps have them, and MID; constant velocity, other networks and averages have not."""
    config["methods"]["both"] = {"kind": "average", "title": "Both", "options": {"of": ["cvm", "episodes"]}}
    config["uncertainty"] = {"methods": ["stef", name]}
    assert f"uncertainty.methods: {message}" in refused(config)


@pytest.mark.parametrize(
    ("method", "message"),
    [("cvm", "cvm has no map with samples"), ("mid", "mid has no map"), ("x", "no method named 'x'")],
)
def test_methods_whose_cells_are_studied_have_maps_and_samples(config, method, message):
    config["studies"] = {"occupied": {"methods": ["snippets", method]}}
    assert f"studies.occupied.methods: {message}" in refused(config)


def test_all_problems_are_told_at_once(config):
    config["rollout"] = {"k": 0}
    config["sedes"] = config.pop("seeds")
    del config["datasets"]
    message = refused(config)
    for part in ("rollout.k", "did you mean 'seeds'", "the key 'datasets' is required"):
        assert part in message


def test_problems_under_numbers_and_names_are_told_side_by_side(config):
    """YAML reads a method called 1 as a number."""
    config["methods"] = {1: {"kind": "none"}, "a": {"kind": "none"}}
    assert "methods.1: 1 is a number, not text; quote it" in refused(config)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("compare", ["tc_cliff", "clif"], "no method named 'clif'; did you mean 'cliff'"),
        ("comparisons", [["tc_cliff", "stf"]], "no method named 'stf'; did you mean 'stef'"),
        ("compare", ["zzz"], "no method named 'zzz'; known: cliff, tc_cliff, smoothed_cliff, stef"),
        ("compare", ["zzz"], "; is the package that adds it installed?"),
        ("datasets", ["demo_hal"], "no dataset named 'demo_hal'; did you mean 'demo_hall'"),
        ("datasets", ["zzz"], "no dataset named 'zzz'; known: "),
        ("datasets", ["demo_hall", "demo_hall"], "has non-unique elements"),
        ("seeds", [0, 0], "[0, 0] has non-unique elements"),
        ("comparisons", [["tc_cliff", "cliff"]] * 2, "tc_cliff and cliff stand there twice; name a pair once"),
        ("comparisons", [["tc_cliff", "cliff"], ["cliff", "tc_cliff"]], "cliff and tc_cliff stand there twice"),
        ("comparisons", [["cliff", "cliff"]], "cliff is compared with itself; name two methods"),
    ],
)
def test_an_unknown_name_gets_a_hint(config, key, value, message):
    config[key] = value
    assert f"configuration, {key}: " in refused(config)
    assert message in refused(config)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seeds": []}, "seeds: [] is too short, at least 1 needed"),
        ({"compare": []}, "compare: [] is too short, at least 1 needed"),
        ({"run": 202401}, "run: 202401 is a number, not text; quote it"),
        ({"run": 202401}, "`--config` drops quotes and takes `'run=!!str 2024_01'`"),
        ({"run": "a\n"}, r"run: 'a\n': a name of letters, digits, _ and - only"),
        ({"methods": {"a\n": {"kind": "cvm"}}}, r"methods: 'a\n': a name of letters, digits, _ and - only"),
        (
            {"methods": {"-a": {"kind": "cvm"}}},
            "methods: '-a': a name of letters, digits, _ and - only, and no - before",
        ),
        ({"run": "a/b"}, "run: 'a/b': a name of letters, digits, _ and - only"),
        ({"methods": {"a b": {"kind": "cvm"}}}, "methods: 'a b': a name of letters, digits, _ and - only"),
        ({"methods": {"cliff": {"kind": "clif"}}}, "methods.cliff.kind: no kind named 'clif'; did you mean 'cliff'"),
        ({"methods": {"mine": {"kind": "zzz"}}}, "; is the package that adds it installed?"),
        ({"methods": {"mine": {"title": "Mine"}}}, "methods.mine: say of which `kind` it is: cliff, tc_cliff"),
        ({"methods": {"mine": {"kind": "exits"}}}, "methods.mine.kind: no kind named 'exits'"),
        ({"rollout": {"speed": "fast"}}, "rollout.speed: 'fast' is not one of 'constant' or 'kernel'"),
        ({"comparisons": [["cliff", "lstn"]]}, "comparisons: no method named 'lstn'; did you mean 'lstm'"),
        ({"comparisons": [["cliff"]]}, "comparisons.0: ['cliff'] is too short, at least 2 needed"),
        ({"studies": {"method": "cvm"}}, "studies.method: cvm has no map to sample"),
        (
            {"methods": {"mine": {"kind": "cliff"}, "other": {"kind": "mine"}}},
            "methods.other.kind: mine is a method, no kind: write `inherits: mine`",
        ),
        ({"maps": {"clif": {}}}, "maps: no map named 'clif'; did you mean 'cliff'"),
        ({"budgets": {"demo": {"lstn": {}}}}, "budgets.demo: no network named 'lstn'; did you mean 'lstm'"),
    ],
)
def test_what_is_wrong_is_told_with_its_remedy(config, changes, message):
    assert message in refused({**config, **changes})


def test_nothing_is_asked_of_a_method_that_is_not_studied(config):
    """With no value to try it may be of any kind."""
    assert load({**config, "studies": {"method": "cvm", "beta": [], "sampling_radius_m": []}}).studies.method == "cvm"
    assert "leave both lists empty" in refused({**config, "studies": {"method": "cvm", "sampling_radius_m": []}})


# --- names of old -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rollout": {"velocity": "columns"}}, "rollout.velocity: 'columns' is now called 'dataset'"),
        ({"snippets": {"kernel_m": 1.2}}, "snippets: unknown key 'kernel_m': it is now called 'bandwidth_m'"),
        ({"methods": {"mine": {"kind": "cvm", "options": {"velocity": "columns"}}}},
         "velocity: 'columns' is now called 'dataset'"),
        ({"methods": {"mine": {"kind": "neural_map", "options": {"validation": "blocks"}}}},
         "unknown key 'validation': it is now called 'held_out'"),
        ({"learned": {"validation": "persons"}},
         "learned: unknown key 'validation': it is now called 'held_out'; it belongs to a kind of network: "
         "`budgets` in config/budgets.yaml, or a method's `options`"),
        ({"learned": {"windows": 9}}, "learned: unknown key 'windows': it belongs to a kind of network: `budgets` in"),
        ({"learned": {"epochs": 9}}, "learned: unknown key 'epochs': it is now called 'windows'; it belongs to a kind"),
        ({"budgets": {"demo": {"lstm": {"epochs": 9}}}},
         "budgets.demo.lstm: unknown key 'epochs': it is now called 'windows' (futures looked at in all, at most;"),
        ({"methods": {"mine": {"kind": "lstm", "options": {"epochs": 9}}}},
         "methods.mine.options: unknown key 'epochs': it is now called 'windows'"),
        ({"rollout": {"output": "geometric-median"}}, "rollout.output: 'geometric-median' is not one of"),
    ],
)  # fmt: skip
def test_an_old_configuration_is_told_the_new_names(config, changes, message):
    assert message in refused({**config, **changes})


# --- numbers ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["1e-3", "1E-3", "0.001"])
def test_numbers_in_any_notation(config, text):
    """Of YAML's 1e-3 the standard makes a text."""
    config["budgets"]["demo"]["lstm"] |= yaml.safe_load(f"learning_rate: {text}")
    config["methods"]["mine"] = {"kind": "neural_map", "options": yaml.safe_load(f"learning_rate: {text}")}
    config["rollout"] = yaml.safe_load(f"beta: {text}")
    run = load(config)
    assert run.method("lstm").options.learning_rate == 0.001
    assert run.method("mine").options.learning_rate == 0.001
    assert run.method("cliff").options.beta == 0.001


# --- maps with memory, averages, tuned options --------------------------------------------------------------


def averaging(config, *names, compare=True):
    """The configuration with a method `mean` of these; all are compared."""
    config["methods"]["mean"] = {"kind": "average", "title": "Mean", "options": {"of": list(names)}}
    config["compare"] = ["mean", *(dict.fromkeys(names) if compare else ())]
    config["ladder"] = {"rows": []}
    return config


@pytest.mark.parametrize("names", [("episodes", "snippets"), ("cvm", "episodes"), ("lstm", "tutr", "snippets")])
def test_methods_of_one_path_can_be_averaged(config, names):
    run = load(averaging(config, *names))
    assert run.members("mean") == names
    mean = run.method("mean")
    assert (mean.kind, mean.options.of, mean.futures) == ("average", names, 1)


def test_other_methods_average_nothing(config):
    run = load(config)
    others = [name for name in run.entries if run.kind(name).name != "average"]
    assert len(others) > 10
    assert {run.members(name) for name in others} == {()}


@pytest.mark.parametrize("name", ["cliff", "tc_cliff", "stef", "mid"])
def test_futures_of_equal_standing_have_no_path_to_average(config, name):
    message = refused(averaging(config, "episodes", name))
    said = f"methods.mean.options.of: {name} has no single path to be averaged; kinds that have one are average"
    assert said in message


def test_what_is_averaged_is_run_as_well(config):
    run = load(averaging(config, "episodes", "snippets", compare=False))
    assert set(run.methods_run) == {"mean", "episodes", "snippets"}
    assert run.compare == ("mean",)


def minimal(methods, compare, rows=(), reference="cvm", beside=()):
    """The settings of a run of nothing but these names; `methods` {name: those that it averages}."""
    entries = {
        name: {"kind": "average", "options": {"of": of}} if of else {"kind": "cvm"} for name, of in methods.items()
    }
    ladder = {"reference": reference, "rows": [[row, "a change"] for row in rows], "beside": list(beside)}
    return build(RunSettings, {"run": "a", "datasets": [], "methods": entries, "compare": compare, "ladder": ladder})


def test_what_runs_is_closed_under_averaging():
    """Averages of averages of averages bring their members, each once, after the names that were asked for."""
    methods = {"a": [], "b": [], "c": [], "d": [], "ab": ["a", "b"], "abc": ["ab", "c"], "all": ["abc", "ab", "d"]}
    assert minimal(methods, ["all", "c"]).methods_run == ["all", "c", "abc", "ab", "d", "a", "b"]
    assert minimal(methods, ["ab"]).methods_run == ["ab", "a", "b"]


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
    got = minimal(methods, asked).methods_run
    assert len(got) == len(set(got))
    assert set(got) == found
    assert got[:2] == asked


def test_rungs_and_what_they_are_compared_with_are_run_as_well():
    methods = {name: [] for name in ("a", "b", "reference", "one", "other", "unused")} | {"mean": ["a", "b"]}
    run = minimal(methods, ["mean"], ["a", "mean"], "reference", [["one", "other", "what differs"]])
    assert run.methods_run == ["mean", "a", "reference", "one", "other", "b"]


def test_a_ladder_whose_goal_is_not_compared_is_left_out():
    """So that a run without networks trains none."""
    methods = {name: [] for name in ("a", "reference", "goal")}
    assert minimal(methods, ["a"], ["a", "goal"], "reference", []).methods_run == ["a"]
    assert minimal(methods, ["goal"], ["a", "goal"], "reference", []).methods_run == ["goal", "a", "reference"]


def test_an_empty_ladder_needs_no_reference():
    """Nor the pairs beside it: without rungs there is no ladder."""
    methods = {name: [] for name in ("a", "reference", "one", "other")}
    assert minimal(methods, ["a"], [], "reference", [["one", "other", "what differs"]]).methods_run == ["a"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reference": "tc_clif"}, "ladder.reference: no method named 'tc_clif'; did you mean 'tc_cliff'"),
        ({"rows": [["cvn", "a line"]]}, "ladder.rows: no method named 'cvn'; did you mean 'cvm'"),
        ({"beside": [["cvm", "stf", "a map"]]}, "ladder.beside: no method named 'stf'; did you mean 'stef'"),
    ],
)
def test_an_unknown_rung_gets_a_hint(config, changes, message):
    config["ladder"] |= changes
    assert f"configuration, {message}" in refused(config)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("snipets", "studies.training.methods: no method named 'snipets'; did you mean 'snippets'"),
        ("tc_cliff", "studies.training: tc_cliff is of none of the kinds cliff, episodes, snippets"),
        ("neural_map", "studies.training: neural_map is of none of the kinds"),
        ("hybrid", "studies.training: hybrid is of none of the kinds"),
    ],
)
def test_only_maps_that_are_rebuilt_at_once_are_built_from_less(config, name, message):
    config["studies"] = {"training": {"methods": ["episodes", name]}}
    assert f"configuration, {message}" in refused(config)


@pytest.mark.parametrize("shares", [[0], [1.5], [0.1, 0.1], ["all"]])
def test_a_share_is_part_of_the_whole(config, shares):
    config["studies"] = {"training": {"shares": shares}}
    assert "studies.training.shares" in refused(config)


def test_averages_of_averages_are_made_of_what_forecasts(config):
    config["methods"]["inner"] = {"kind": "average", "title": "Inner", "options": {"of": ["lstm", "episodes"]}}
    run = load(averaging(config, "episodes", "inner"))
    assert run.averaged_parts("mean") == ["episodes", "lstm"]
    assert run.averaged_parts("lstm") == ["lstm"]
    assert set(run.methods_run) == {"mean", "inner", "episodes", "lstm"}


def test_an_average_of_itself_is_refused(config):
    config["methods"]["inner"] = {"kind": "average", "title": "Inner", "options": {"of": ["lstm", "mean"]}}
    message = refused(averaging(config, "episodes", "inner"))
    assert "of: mean of inner of mean averages itself" in message or "of: inner of mean of inner averages" in message


def test_a_mistyped_member_gets_a_hint(config):
    config = averaging(config, "episodes", "snipets")
    config["compare"] = ["mean", "snippets"]
    assert "methods.mean.options.of: no method named 'snipets'; did you mean 'snippets'" in refused(config)


@pytest.mark.parametrize(
    "options", [None, {}, {"of": []}, {"of": ["episodes"]}, {"of": "episodes"}, {"off": ["a", "b"]}]
)
def test_an_average_needs_two_members(config, options):
    method = {"kind": "average", "title": "Mean", "options": options}
    config["methods"]["mean"] = {key: value for key, value in method.items() if value is not None}
    assert "methods.mean.options" in refused(config)


@pytest.mark.parametrize(("kind", "of"), [("episodes", Episodes), ("snippets", Snippets)])
def test_options_of_a_map_with_memory_are_its_sections_and_its_own(config, kind, of):
    config[kind] = {"heading_m": 7.0, "pace": 0.25}
    config["methods"]["mine"] = {
        "kind": kind,
        "title": "Mine",
        "options": {"reach_m" if of is Episodes else "k": 3, "pace": 0.5},
    }
    run = load(config)
    assert run.method(kind).options == of(heading_m=7.0, pace=0.25)
    assert run.method("mine").options == of(heading_m=7.0, pace=0.5, **{"reach_m" if of is Episodes else "k": 3})


@pytest.mark.parametrize(("kind", "wrong"), [("episodes", "bandwidth_m"), ("snippets", "reach_m"), ("cvm", "k")])
def test_options_of_one_map_with_memory_are_not_the_others(config, kind, wrong):
    config["methods"]["mine"] = {"kind": kind, "title": "Mine", "options": {wrong: 1}}
    assert f"methods.mine.options: unknown key '{wrong}'" in refused(config)


@pytest.mark.parametrize("name", ["episodes", "snippets", "cliff", "cvm", "tutr"])
def test_tuned_options_win(config, name):
    """Over a method's own, and these over the section's or budget's; the rest stays."""
    own, first, second = {
        "cvm": ("velocity", "dataset", "differences"), "tutr": ("windows", 1, 2), "episodes": ("persons", 1, 2)
    }.get(name, ("k", 1, 2))  # fmt: skip
    config["methods"][name] = {"options": {own: first}}
    run = load(config)
    plain = run.method(name).plain()
    assert plain["options"][own] == first
    tuned = run.method(name, {name: {own: second}}).plain()
    assert tuned == {**plain, "options": {**plain["options"], own: second}}
    assert run.method(name).plain() == plain, "of other datasets they stay as they were"


def test_options_tuned_for_a_kind_hold_where_a_method_says_nothing(config):
    config["methods"]["mine"] = {"kind": "snippets", "title": "Mine", "options": {"length_s": 1}}
    config["methods"]["other"] = {"kind": "snippets", "title": "Other", "options": {"most": 10}}
    run = load(config)
    found = {name: run.method(name, {"snippets": {"length_s": 3}}).options for name in ("mine", "other", "episodes")}
    assert (found["mine"].length_s, found["other"].length_s, found["other"].most) == (1, 3, 10)
    assert found["episodes"] == Episodes()


def test_what_is_tuned_for_a_network_may_be_its_learning(config):
    found = load(config).method("neural_map", {"neural_map": {"seed": 3, "windows": 2}})
    assert (found.learning.seed, found.options.windows) == (3, 2)
    assert found.options == NeuralMap(**{**config["budgets"]["demo"]["neural_map"], "windows": 2})


# --- datasets of a run --------------------------------------------------------------------------------------


# --- inheritance ------------------------------------------------------------------------------------------------------


def test_a_method_starts_from_another_s_options_with_what_is_tuned_for_it(config):
    config["methods"] |= {
        "wide": {"inherits": "tc_cliff", "options": {"sampling_radius_m": 2.0}},
        "wider": {"inherits": "wide", "title": "Wider", "options": {"k": 7}},
    }
    run = load(config)
    tuned = {"wide": {"beta": 9.0}, "tc_cliff": {"exits": True}}
    base, wide, wider = (run.method(name, tuned).options for name in ("tc_cliff", "wide", "wider"))
    assert run.kind("wider").name == "tc_cliff"
    assert wide == dataclasses.replace(base, sampling_radius_m=2.0, beta=9.0)
    assert wider == dataclasses.replace(wide, k=7)


def test_across_kinds_what_both_have_is_inherited(config):
    config["methods"] |= {
        "many": {"kind": "tc_cliff", "options": {"k": 60, "exits": True, "output": "medoid"}},
        "pieces": {"kind": "snippets", "inherits": "many", "options": {"length_s": 1}},
    }
    found = load(config).method("pieces").options
    assert found == dataclasses.replace(
        load(config).method("snippets").options, k=60, exits=True, output="medoid", length_s=1
    )


def test_a_network_inherits_its_learning(config):
    config["methods"] |= {
        "one": {"kind": "lstm", "options": {"seed": 4, "hidden": 16}},
        "two": {"inherits": "one", "options": {"rotate": False}},
    }  # fmt: skip
    one, two = (load(config).method(name) for name in ("one", "two"))
    assert two.learning == one.learning
    assert two.options == dataclasses.replace(one.options, rotate=False)


@pytest.mark.parametrize(
    ("entry", "trained"),
    [
        ({"inherits": "one", "options": {"epoch": "last"}}, "one"),
        ({"inherits": "one"}, "one"),
        ({"inherits": "again", "options": {"epoch": "last"}}, "one"),
        ({"inherits": "one", "options": {"epoch": "last", "seed": 1}}, "two"),
        ({"inherits": "one", "options": {"rotate": False}}, "two"),
        ({"kind": "social_lstm", "inherits": "one", "options": {"epoch": "last"}}, "two"),
        ({"kind": "lstm", "options": {"epoch": "last"}}, "two"),
    ],
)
def test_another_epoch_is_no_training_of_its_own(config, entry, trained):
    config["methods"] |= {"one": {"kind": "lstm", "options": {"seed": 4}}, "again": {"inherits": "one"}, "two": entry}
    assert load(config).trained_as("two") == trained


@pytest.mark.parametrize(
    ("methods", "message"),
    [
        ({"a": {"inherits": "tc_clif"}}, "methods.a: say of which `kind` it is"),
        (
            {"a": {"kind": "cliff", "inherits": "tc_clif"}},
            "methods.a.inherits: no method named 'tc_clif'; did you mean",
        ),
        ({"a": {"kind": "cliff", "inherits": "b"}, "b": {"inherits": "a"}}, "inherits: a inherits from b, too"),
        ({"a": {"inherits": "a"}}, "methods.a"),
    ],
)
def test_what_cannot_be_inherited(config, methods, message):
    config["methods"] |= methods
    assert message in refused(config)


@pytest.fixture(params=["config.yaml", "ladder.yaml"])
def climbed(shipped, request):
    return load(shipped[request.param])


def datasets_tuned(config_folder, run):
    """What the file of each dataset of a run has tuned."""
    for name in run.datasets:
        yield name, yaml.safe_load((config_folder / f"datasets/{name}.yaml").read_text()).get("tuned", {})


def test_a_rung_changes_one_thing(climbed, config_folder):
    """Within a kind one option that the row names; between kinds the kind, and no option that both have."""
    rungs = [method for method, _ in climbed.rungs]
    assert rungs
    for above, rung in pairwise(rungs):
        if climbed.members(rung):
            continue  # a mean: what changes is who is averaged
        named = {}
        for dataset, tuned in datasets_tuned(config_folder, climbed):
            one, other = (climbed.method(name, tuned) for name in (above, rung))
            options = [as_plain(side.options) for side in (one, other)]
            changed = {key for key in options[0].keys() & options[1].keys() if options[0][key] != options[1][key]}
            own = {*climbed.methods[rung].options, *tuned.get(rung, {})} if rung in climbed.methods else changed
            if one.kind == other.kind and not climbed.members(above):
                assert changed <= own, (dataset, above, rung, changed)
                named[dataset] = own
                assert one.learning == other.learning
            else:
                assert not changed, (dataset, above, rung, changed)
        assert all(len(own) <= 1 for own in named.values()), (rung, named)
        assert not named or any(named.values()), f"{rung}: nothing changes in any dataset"


@pytest.fixture
def tuned(tmp_path, config_folder, config):
    """Function (options): the datasets of a run of one dataset, whose file has these `tuned`."""

    def of(options):
        text = (config_folder / "datasets/demo_hall.yaml").read_text()
        (tmp_path / "mine.yaml").write_text(f"{text}tuned: {json.dumps(options)}\n")
        run = load_run({**config, "datasets": ["mine"]}, tmp_path)
        return load_datasets(run, tmp_path, "nowhere", "demo")

    return of


def test_tuned_options_that_a_method_takes_are_accepted(tuned):
    options = {"snippets": {"bandwidth_m": 0.7, "exits": False}, "cvm": {"velocity": "differences"}}
    options |= {"lstm": {"windows": 3, "budget": "full"}}
    assert tuned(options)["mine"].tuned == options


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ({"snipets": {"k": 3}}, ["no kind or method named 'snipets'; did you mean 'snippets'"]),
        ({"snippets": {"bandwidth": 3}}, ["tuned.snippets: no option named 'bandwidth'; did you mean 'bandwidth_m'"]),
        ({"snippets": {"kernel_m": 3}}, ["tuned.snippets: no option named 'kernel_m'; it is now called 'bandwidth_m'"]),
        ({"cvm": {"velocity": "columns"}}, ["velocity: 'columns' is now called 'dataset'"]),
        ({"snippets": {"bandwidth_m": 0}}, ["bandwidth_m: 0 is not at least 0.01"]),
        ({"average": {"of": ["a", "b"]}}, ["no kind or method named 'average'"]),
        ({"cliff": {"reach_m": 3}}, ["tuned.cliff", "'reach_m'"]),
    ],
)
def test_tuned_options_that_are_none_are_refused(tuned, options, parts):
    with pytest.raises(DataError) as error:
        tuned(options)
    for part in ("mine.yaml, tuned", *parts):
        assert part in str(error.value)


def test_exhibits_of_two_datasets_do_not_overwrite_each_other(config):
    run = load({**config, "run": "two", "datasets": ["atc", "atc_1day"]})
    with pytest.raises(DataError, match="datasets atc, atc_1day: their exhibits carry the same `label`"):
        load_datasets(run, DATASETS, "nowhere", "demo")


def test_columns_of_two_datasets_do_not_overwrite_each_other(config, config_folder, tmp_path):
    """Tables have a column for a title, and tests of one are corrected together."""
    text = (config_folder / "datasets/demo_hall.yaml").read_text()
    for name in ("mine", "other"):
        (tmp_path / f"{name}.yaml").write_text(re.sub("(?m)^label: .*", f"label: {name}", text))
    run = load_run({**config, "datasets": ["mine", "other"]}, tmp_path)
    with pytest.raises(DataError, match="mine, other: their rows and columns of tables carry the same `title`"):
        load_datasets(run, tmp_path, "nowhere", "demo")


def test_two_methods_are_not_called_alike(config):
    """Rows of tables and curves are told apart by titles; a variant without one is called by its name."""
    config["methods"]["mine"] = {"inherits": "cliff", "options": {"k": 7}}
    config = {**config, "compare": ["cliff", "mine", "cvm"], "comparisons": [], "ladder": {"rows": []}}
    assert load(config).titles(["cliff", "mine"]) == {"cliff": "CLiFF", "mine": "mine"}
    config["methods"]["mine"]["title"] = "CLiFF"
    with pytest.raises(DataError, match="methods: cliff and mine have one `title`, CLiFF; give one another"):
        load(config)


def test_the_demo_s_name_is_the_demo_s(config):
    run = load({**config, "datasets": ["atc_1day"]})
    with pytest.raises(DataError, match="run: `demo` is for the demo's recordings; give your run another name"):
        load_datasets(run, DATASETS, "nowhere", "demo")


def test_a_run_on_a_validation_part_reads_no_test_recording(config, load_shipped):
    run = load({**config, "evaluate_on": "validation"})
    found = load_datasets(run, DATASETS, "nowhere", "nowhere")
    for name, dataset in found.items():
        whole = load_shipped(name, "nowhere")
        kept = {one.file for one in dataset.recordings}
        assert kept <= {one.file for one in whole.of_split("train")}
        assert not kept & {one.file for one in whole.of_split("test")}
        assert dataset.of_split("test")


def test_without_a_clock_there_are_no_maps_by_hours(config):
    run = load({**config, "run": "mine", "datasets": ["hotel"]})
    with pytest.raises(DataError, match=r"hotel\.yaml: its `clock` is unknown.*leave tc_cliff, .*stef"):
        load_datasets(run, DATASETS, "nowhere", "demo")


@pytest.mark.parametrize(
    ("studies", "fits"),
    [
        ({}, False),
        ({"method": "stef", "beta": []}, False),
        ({"method": "tc_radius", "sampling_radius_m": []}, False),
        ({"method": "cliff"}, True),
        ({"beta": [], "sampling_radius_m": []}, True),
        ({"method": "cliff", "occupied": {"methods": ["tc_cliff"]}}, True),  # asked of datasets with a clock alone
    ],
)
def test_without_a_clock_no_map_by_hours_is_studied(config, studies, fits):
    """Nor is any other planned: whatever is not refused has none."""
    listed = {**config, "run": "mine", "datasets": ["hotel"], "compare": ["cvm", "cliff", "episodes"]}
    run = load({**listed, "ladder": {"rows": []}, "studies": studies})
    try:
        datasets = load_datasets(run, DATASETS, "nowhere", "demo")
    except DataError as error:
        assert re.search(
            r"hotel\.yaml: its `clock` is unknown.*another `studies\.method` than \w+, or leave", str(error)
        )
        assert not fits
    else:
        plan = Plan(run, Layout("mine"), datasets)
        assert fits
        assert not plan.foretold
        assert not plan.studied or not run.kind(run.studies.method).hourly


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("{x}.csv", "the character '{'"), ("x}.csv", "the character '}'"), ("<wild>.csv", "the character '<'"),
        ("{day}/b.csv", "the character '{'"), ("new\nline.csv", r"the character '\n'"),
        (os.fsdecode(b"caf\xe9.csv"), r"the character '\udce9'"), ("ü" * 101 + ".csv", "at most 200 bytes"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("missing", [False, True], ids=["there", "missing"])
def test_names_that_the_workflow_cannot_take_are_refused(tmp_path, config, name, told, missing):
    """Its wildcards, ends of lines, bytes that are no text, and what leaves no room for a suffix."""
    if not missing:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("0,0,0,0\n")
    listed = {
        "title": "Own", "reader": "delimited", "timezone": "UTC", "horizon_s": 10, "velocity": "differences",
        "columns": {"t": 0, "track_id": 1, "x": 2, "y": 3}, "citation": "made up", "terms": "free",
        "recordings": [
            {"files": "a.txt", "day": "2010-07-01", "start": "09:00", "split": "train"},
            {"files": "caf*.csv" if "\udce9" in name else name, "day": "2010-07-02", "start": "09:00", "split": "test"},
        ],
    }  # fmt: skip
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(listed))
    run = load_run({**config, "run": "own", "datasets": ["mine"]}, tmp_path)
    if missing and "\udce9" in name:
        told = "no file matches"  # YAML cannot name such bytes
    with pytest.raises(DataError, match=r"mine\.yaml: ") as error:
        load_datasets(run, tmp_path, tmp_path, "demo")
    assert told in str(error.value)
    assert "\n" not in str(error.value)


# --- horizons -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("section", ["tables", "ladder"])
def test_horizons_of_which_a_dataset_has_none_are_refused(config, section, tmp_path):
    """At once, not after hours of a run; without any chosen ones every dataset has some."""
    config[section] = {**config.get(section, {}), "horizons_s": [90, 120]}
    with pytest.raises(DataError) as error:
        load_datasets(load(config), DATASETS, tmp_path, tmp_path)
    for part in (f"configuration, {section}.horizons_s", "demo_hall", "[90, 120]", "1 s", "60 s", "leave the key out"):
        assert part in str(error.value)
    config[section]["horizons_s"] = [20, 120]
    assert load_datasets(load(config), DATASETS, tmp_path, tmp_path)
    config[section]["horizons_s"] = None
    assert load_datasets(load(config), DATASETS, tmp_path, tmp_path)


def test_the_shipped_datasets_have_the_paper_s_horizons(config, tmp_path):
    run = load(config)
    plan = Plan(run, Layout(run.run), load_datasets(run, DATASETS, tmp_path, tmp_path))
    assert plan.horizons["demo_hall"] == [5, 10, 20, 30, 60]
    assert plan.horizons["demo_forum"] == plan.ladder_horizons["demo_forum"] == [5, 10, 20]
    assert plan.ladder_horizons["demo_hall"] == [5, 10, 20, 60]


def test_a_strict_run_makes_every_dataset_strict(config):
    for strict in (False, True):
        found = load_datasets(load({**config, "strict": strict}), DATASETS, "nowhere", "demo")
        assert {one.strict for one in found.values()} == {strict}


# --- published maps ---------------------------------------------------------------------------------------------------


MAP = "".join(f"{n},0,{0.2 * n:.1f},1.1,0.1,0,0.1,0.1,1,1,0.5\n" for n in range(30)).replace(",0.1,0,0.1,", ",0.1,0,0,")


def with_file(config, **entry):
    """The shipped configuration with a method `theirs`, and one that inherits from it, compared."""
    methods = {**config["methods"], "theirs": entry, "more": {"inherits": "theirs", "options": {"k": 9}}}
    return {**config, "methods": methods, "compare": ["theirs", "more", "cvm"], "ladder": {"rows": []},
            "comparisons": [], "uncertainty": {"methods": []}, "studies": {"training": {"shares": []}}}  # fmt: skip


def test_a_published_map_is_a_method_s_map(config, write, tmp_path):
    write(MAP, "maps/published.csv")
    run = load(with_file(config, kind="cliff", title="Published", file="maps/published.csv"))
    plan = Plan(run, Layout("theirs"), load_datasets(run, DATASETS, tmp_path, "demo"))
    of_theirs = plan.layout.published_map("demo_hall", "theirs", "cliff")
    assert plan.map_of("demo_hall", "theirs") == plan.map_of("demo_hall", "more") == of_theirs
    assert plan.map_of("demo_hall", "cliff") == plan.layout.map("demo_hall", "cliff")
    assert plan.published == ["theirs"]
    assert (run.title("theirs"), run.title("more")) == ("Published", "more")
    assert "cliff" not in plan.compared_kinds, "figures show maps that are built"
    assert plan.method("demo_hall", "more").published == "theirs"
    again = Method.of(plan.method("demo_hall", "more").plain())
    assert again == plan.method("demo_hall", "more")


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"kind": "cliff", "file": "maps/none.csv"}, "methods.theirs.file: .*none.csv: no such file.*`data_root`"),
        ({"kind": "cliff", "file": "maps"}, "methods.theirs.file: .*maps: a folder without a map"),
        ({"kind": "cvm", "file": "maps/a.csv"}, "methods.theirs.file: kind cvm has no map"),
        ({"kind": "stef", "file": "maps/a.csv"}, "a map of kind cliff, but the method is of kind stef"),
        ({"kind": "tc_cliff", "file": "maps/a.csv"}, "a map of kind cliff, but the method is of kind tc_cliff"),
        ({"kind": "cliff", "form": "matlab"}, "methods.theirs.form: there is no `file`"),
        ({"kind": "cliff", "file": "maps/a.csv", "form": "matlb"}, "methods.theirs.form: .*did you mean 'matlab'"),
        ({"kind": "stef", "file": "maps/a.csv", "form": "histogram"}, "methods.theirs.form: no form named 'histogram'"),
        ({"kind": "cliff", "file": "maps/lfs.csv"}, "methods.theirs.file: .*a pointer of Git LFS"),
        ({"kind": "cliff", "file": "maps/one_way.csv"}, "methods.theirs.file: .*is its form matlab .* or"),
        ({"kind": "cliff", "file": "maps/a b{c}.csv"}, "Snakemake cannot take the character '{'"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_published_map_is_told_before_the_run(config, write, tmp_path, entry, message):
    write(MAP, "maps/a.csv")
    write(MAP, "maps/a b{c}.csv")
    write("version https://git-lfs.github.com/spec/v1\n", "maps/lfs.csv")
    write(MAP[: MAP.index("5,0,1.0")], "maps/one_way.csv")
    with pytest.raises(DataError, match=message):
        load_datasets(load(with_file(config, **entry)), DATASETS, tmp_path, "demo")


def test_what_is_wrong_in_a_published_map_is_told_before_the_run(config, write, tmp_path):
    """Its content, in the frame of the recordings; a map that is fit says nothing."""
    write(MAP, "maps/a.csv")
    run = load(with_file(config, kind="cliff", file="maps/a.csv"))
    datasets = load_datasets(run, DATASETS, tmp_path, "demo")
    check_maps(run, datasets, tmp_path)
    first = MAP.splitlines()[0]
    for wrong, told in (("50000," + first.partition(",")[2], "10 km"), (first.replace(",1,1,", ",-1,1,"), "negative")):
        write(MAP.replace(first, wrong), "maps/a.csv")
        with pytest.raises(DataError, match=f"methods.theirs.file: .*a.csv.*{told}"):
            check_maps(run, datasets, tmp_path)


def test_a_published_map_is_not_built_from_less(config):
    wrong = with_file(config, kind="cliff", file="maps/a.csv")
    wrong["studies"] = {"training": {"methods": ["more"]}}
    assert "the map of more is a file" in refused(wrong)


def test_a_published_map_is_not_built_without_some_people(config):
    wrong = with_file(config, kind="cliff", file="maps/a.csv")
    wrong["studies"] = {"occupied": {"methods": ["theirs"]}}
    assert "studies.occupied.methods: the map of theirs is a file" in refused(wrong)


# --- forecasts from outside -------------------------------------------------------------------------------------------


def with_theirs(config, **entry):
    config["methods"]["theirs"] = {"kind": "forecasts", **entry}
    config["compare"] = ["cvm", "theirs"]
    config["comparisons"] = []
    return config


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, "methods.theirs.folder: name the folder of the forecasts"),
        ({"folder": "f", "options": {"flder": "f"}}, "unknown key 'flder', did you mean 'folder'?"),
        ({"folder": "f", "kind": "cvm"}, "methods.theirs.folder: 'f': a method of kind cvm has none; leave it out"),
    ],
)
def test_a_folder_of_forecasts_is_said_where_it_is_needed(config, change, message):
    assert message in refused(with_theirs(config, **change))


def test_a_method_of_forecasts_is_like_any_other_but_for_its_cost(config):
    """Compared, averaged with others, measured as a distribution; no rung, whose forecasts would be timed."""
    with_theirs(config, folder="f", title="Theirs")
    config["methods"]["both"] = {"kind": "average", "options": {"of": ["theirs", "cvm"]}}
    config["compare"] = ["cvm", "theirs", "both"]
    config["uncertainty"] = {"methods": ["theirs"]}
    config["ladder"] = {"rows": []}
    run = load(config)
    assert run.method("theirs").options.folder == "f" and run.title("theirs") == "Theirs"
    assert Plan(run, Layout(run.run), {}).handed_in == ["theirs"]
    for rung in ("theirs", "both"):
        config["ladder"] = {"rows": [["cvm", "straight"], [rung, "theirs"]]}
        assert f"ladder.rows: {rung}: the forecasts of theirs are not made here, so a rung" in refused(config)


def test_what_lies_in_the_folder_is_looked_at_before_any_job(config, tmp_path):
    """The pair of files, and the JSON; of each dataset in a folder of its name, or of the only one."""
    root, folder = tmp_path, tmp_path / "theirs"
    config["run"], config["datasets"] = "other", ["hotel"]
    config["ladder"], config["uncertainty"] = {"rows": []}, {"methods": []}
    with_theirs(config, folder="theirs")
    config["studies"] = {"method": "cliff", "training": {"shares": []}}

    def message():
        with pytest.raises(DataError) as error:
            load_datasets(load(config), DATASETS, root, "nowhere")
        return str(error.value)

    found = message()
    assert f"methods.theirs.folder: {folder}: no such folder" in found
    assert f"(`data_root` is {root})" in found  # as of a published map's `file`
    folder.mkdir()
    assert "one file of forecasts (.csv, .parquet, .ndjson) is needed" in message()
    (folder / "f.csv").write_text("track_id,step,x,y\n")
    (folder / "f.json").write_text("{task: 1}")
    assert "f.json: cannot be read as JSON" in message()
    (folder / "f.json").write_text('{"path": "mean"}')
    assert "f.json:\n  top level: the key 'task' is required" in message()
    (folder / "f.json").write_text('{"task": "0", "path": "mean"}')
    run = load(config)
    datasets = load_datasets(run, DATASETS, root, "nowhere")
    assert datasets.keys() == {"hotel"}
    pair = [str(folder / "f.csv"), str(folder / "f.json")]
    assert Plan(run, Layout("theirs"), datasets).hand_in_files("hotel", "theirs", root) == pair
    config["methods"]["theirs"]["folder"] = str(folder)  # or anywhere
    assert Plan(load(config), Layout("theirs"), datasets).hand_in_files("hotel", "theirs", "nowhere") == pair
