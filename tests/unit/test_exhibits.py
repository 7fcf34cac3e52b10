"""Records of exhibits: each is drawn by something, and asks for and needs only what its rule can give."""

import dataclasses
import inspect
import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
import yaml

from modlhmp.settings import as_plain
from modlhmp.study.configuration import load_datasets, load_run
from modlhmp.study.exhibits import EXHIBITS
from modlhmp.study.exhibits.words import SEED_MEANS
from modlhmp.study.layout import Layout
from modlhmp.study.plan import Plan

CONFIG = Path(__file__).parents[2] / "config"
# What of the paper's tables and figures is made, by its labels.
PAPER = {
    *(
        "tab:scenarios",
        "tab:expres",
        "fig:atc_final",
        "fig:edin_final",
        "fig:rank-metrics",
        "fig:parameter",
        "fig:rank",
    ),
    *("fig:prediction_example", "fig:cliff-atc-time", "fig:stef-atc-time", "fig:cliff-atc-time-one-location"),
    "fig:edin_mod",
}
NAMES = [exhibit.name for exhibit in EXHIBITS]


def plan_of(**changes):
    """A plan of the demo; `changes` replace keys of its configuration."""
    listed = {}
    for file in ("budgets", "config"):
        listed |= yaml.safe_load((CONFIG / f"{file}.yaml").read_text(encoding="utf-8"))
    run = load_run({**listed, **changes}, CONFIG / "datasets")
    layout = Layout(run.run)
    return Plan(run, layout, load_datasets(run, CONFIG / "datasets", "data", layout.demo))


@pytest.fixture(scope="module")
def plan():
    """The demo's."""
    return plan_of()


def calls(exhibit, plan):
    """The (datasets, asks) of each time that an exhibit is drawn."""
    labels = [dataset.label for dataset in plan.datasets.values()] if exhibit.per_dataset else [None]
    return [(shown, exhibit.asks(plan, shown)) for shown in (exhibit.shown(plan, label) for label in labels)]


def without(plan, *names):
    """Names of the exhibits that a run does not make, of these."""
    wanted = {exhibit.name for exhibit in EXHIBITS if exhibit.wanted(plan)}
    return set(names) - wanted


def test_the_parameters_are_those_of_the_paper_s_maps_as_the_run_has_them():
    """Also where they have options of their own, or a dataset has tuned ones; of each map where they differ."""
    parameters = next(exhibit for exhibit in EXHIBITS if exhibit.name == "tab_scenarios")
    listed = yaml.safe_load((CONFIG / "config.yaml").read_text(encoding="utf-8"))
    own = {**listed["methods"], "tc_cliff": {**listed["methods"].get("tc_cliff", {}), "options": {"beta": 2}}}
    plan = plan_of(methods=own, compare=["tc_cliff", "cliff", "cvm", "cliff_many"], comparisons=[])
    hall, *others = plan.datasets
    tuned = dataclasses.replace(plan.datasets[hall], tuned={"tc_cliff": {"k": 60}, "cliff": {"k": 60}})
    plan = dataclasses.replace(plan, datasets={**plan.datasets, hall: tuned})
    found = parameters.asks(plan, list(plan.datasets.values()))["sampled"]
    assert found[hall] == {"sampling_radius_m": "1", "beta": "TC-CLiFF 2, CLiFF 1", "k": "60"}
    assert [found[other]["k"] for other in others] == ["5"]
    none = plan_of(compare=["cvm", "cliff_many"], comparisons=[])
    assert parameters.asks(none, list(none.datasets.values()))["sampled"][hall]["k"] == "–"


def test_names_and_rules_are_unique():
    for names in (NAMES, [exhibit.rule for exhibit in EXHIBITS]):
        assert len(set(names)) == len(names)


def test_files_are_unique(plan):
    files = [file for exhibit in EXHIBITS for file in exhibit.files(plan)]
    assert len(set(files)) == len(files)


def test_the_paper_s_exhibits_are_there():
    assert {label for exhibit in EXHIBITS for label in exhibit.paper.split(", ")} >= PAPER


@pytest.mark.parametrize("exhibit", EXHIBITS, ids=NAMES)
def test_what_draws_it_takes_what_it_asks(exhibit, plan):
    """The function exists, and its arguments are the layout, the dataset or datasets, the stem and the asks."""
    arguments = inspect.signature(getattr(import_module(exhibit.module), exhibit.function))
    for shown, asks in calls(exhibit, plan):
        bound = arguments.bind(plan.layout, shown[0] if exhibit.per_dataset else shown, "stem", **asks)
        assert len(bound.arguments) == 3 + len(asks)


@pytest.mark.parametrize("exhibit", EXHIBITS, ids=NAMES)
def test_it_asks_for_plain_data(exhibit, plan):
    """What JSON gives back as it was: mappings with text as keys, lists, scalars."""
    for _, asks in calls(exhibit, plan):
        assert json.loads(json.dumps(asks)) == asks


@pytest.mark.parametrize("exhibit", EXHIBITS, ids=NAMES)
def test_it_needs_files_of_the_run(exhibit, plan):
    """Paths that the layout knows, or files of a dataset's own, each as text and once."""
    plans = {file for dataset in plan.datasets.values() for file in dataset.floor_plan}
    for shown, _ in calls(exhibit, plan):
        needs = exhibit.needs(plan, shown)
        assert len(set(needs)) == len(needs)
        for file in needs:
            assert isinstance(file, str)
            assert file in known(plan) | plans


def known(plan):
    """Every path that the layout gives for a plan's datasets, methods, recordings and parameters."""
    layout, found = plan.layout, {plan.layout.scores}
    for name, dataset in plan.datasets.items():
        found |= {layout.ttests(name), layout.runtime(name), layout.costs(name)}
        found |= {layout.ladder(name, part) for part in ("scores", "differences")}
        found |= {layout.occupied(name, part) for part in ("bins", "scores", "film")}
        found |= {layout.likelihood(name, part) for part in ("scores", "pairs", "given", "given_pairs")}
        found |= {layout.study(name, parameter) for parameter in ("beta", "sampling_radius_m", "training")}
        found |= {layout.tracks(name, one.name) for one in dataset.recordings}
        found |= {layout.map(name, kind) for kind in ("cliff", "tc_cliff", "stef", "episodes", "snippets", "exits")}
        for method in plan.run.methods_run:
            paths = (
                layout.errors,
                layout.forecasts,
                layout.uncertainty,
                layout.training,
                layout.weights,
                layout.readings,
                layout.encounters,
            )
            found |= {path(name, method) for path in paths}
    return found


@pytest.mark.parametrize("exhibit", EXHIBITS, ids=NAMES)
def test_it_has_a_caption_and_a_title(exhibit, plan):
    caption = exhibit.caption_in(plan)
    assert caption[0].isupper()
    assert caption.endswith(".")
    assert "{" not in caption
    assert exhibit.title


def test_captions_say_what_the_run_says():
    """Numbers of the configuration, and titles of its methods."""
    plan = plan_of(seeds=[0, 1, 2], studies={"max_tracks": 77})
    captions = {exhibit.name: exhibit.caption_in(plan) for exhibit in EXHIBITS}
    assert f"{SEED_MEANS}, over 3 seeds" in captions["tab_expres"]
    assert "At most 77 test tracks" in captions["parameter-{label}"]
    assert captions["parameter-{label}"].startswith("ADE of TC-CLiFF ")


def test_a_study_varies_what_is_tuned_for_the_dataset():
    """The dotted line of its figure stands where the table's method is."""
    plan = plan_of(studies={"method": "tc_tuned"})
    for name, beta in (("demo_hall", 64.0), ("demo_forum", 2.0)):
        plan.datasets[name] = dataclasses.replace(plan.datasets[name], tuned={"tc_tuned": {"beta": beta}})
    study = next(exhibit for exhibit in EXHIBITS if exhibit.name == "parameter-{label}")
    chosen = {shown[0].name: asks["chosen"]["beta"] for shown, asks in calls(study, plan)}
    assert chosen == {name: plan.method(name, "tc_tuned").options.beta for name in plan.datasets}
    assert chosen == {"demo_hall": 64.0, "demo_forum": 2.0}


@pytest.mark.parametrize(
    "compare",
    [["cliff", "cvm"], ["stef", "neural_map"], ["episodes_medoid", "snippets_medoid"], ["episodes", "snippets"]],
)
def test_captions_name_no_method_that_a_run_has_not(plan, compare):
    """But for the paper's claims, which are about the paper's."""
    studies = {"method": "cliff", "occupied": {"methods": ["episodes"]}}
    rungs = {"reference": compare[0], "rows": [[name, "a change"] for name in compare]}
    run = plan_of(compare=compare, comparisons=[], ladder=rungs, studies=studies)
    named = {run.run.title(name) for name in (*compare, "cliff", "episodes")}
    others = {entry.title for entry in plan.run.entries.values()} - named
    captions = {one.name: one.caption_in(run) for one in EXHIBITS if one.made_in(run) and one.section != "claims"}
    for name, caption in captions.items():
        assert not [title for title in others if re.search(rf"(?<![\w-]){re.escape(title)}(?![\w-])", caption)], name
    assert ("geometric median" in captions.get("memory-maps", "")) == ("episodes" in compare)


def test_captions_have_the_titles_of_a_run(plan):
    methods = as_plain(plan.run)["methods"]
    methods["tc_cliff"] = {"title": "Ours"}
    methods["position_free"]["title"] = "Blind"
    rungs = {"reference": "tc_cliff", "rows": [["tc_cliff", "a map"], ["position_free", "none"]]}
    run = plan_of(methods=methods, compare=["tc_cliff", "position_free"], comparisons=[], ladder=rungs)
    captions = {one.name: one.caption_in(run) for one in EXHIBITS}
    assert captions["rank-metrics"].startswith("ADE of Ours ")
    assert '"Blind" knows only' in captions["ladder"]


def test_a_run_makes_what_its_methods_and_studies_allow(plan):
    """Of the demo all but timings and what is of steps of 0.1 s; else nothing that shows what a run has not."""
    assert without(plan, *NAMES) <= {"runtime", "tab_short"}
    no_studies = {"beta": [], "sampling_radius_m": [], "training": {"shares": []}}
    few = plan_of(compare=["cliff", "cvm"], comparisons=[], studies=no_studies)
    gone = {"tab_models", "learning-curves", "ladder", "ladder-{label}", "parameter-{label}", "training-share"}
    gone |= {"rank-metrics"}
    assert without(few, *gone) == gone
    assert not without(few, "tab_expres", "tab_ttests", "claims", "coverage", "{label}_final", "tab_scenarios")


def test_claims_look_at_studies_of_tc_cliff_only(plan):
    """And at runtimes that have been measured only."""
    claims = next(exhibit for exhibit in EXHIBITS if exhibit.name == "claims")
    ((_, asks),) = calls(claims, plan)
    assert set(asks["studies"]) == {"beta", "sampling_radius_m"}
    assert asks["measured"] == []
    other = plan_of(studies={"method": "cliff"})
    ((shown, asks),) = calls(claims, other)
    assert asks["studies"] == {}
    assert not [file for file in claims.needs(other, shown) if "studies" in file]


def test_a_run_measured_before_has_its_runtime_in_the_claims(tmp_path):
    """Only of the datasets that have been measured."""
    demo = plan_of()
    plan = Plan(demo.run, Layout("demo", str(tmp_path)), demo.datasets)
    file = Path(plan.layout.runtime("demo_hall"))
    file.parent.mkdir(parents=True)
    file.write_text("{}")
    claims = next(exhibit for exhibit in EXHIBITS if exhibit.name == "claims")
    ((shown, asks),) = calls(claims, plan)
    assert asks["measured"] == ["demo_hall"]
    assert str(file) in claims.needs(plan, shown)
    assert plan.layout.runtime("demo_forum") not in claims.needs(plan, shown)


def test_of_many_methods_curves_leave_the_variants_to_the_tables(plan):
    """Those that inherit from another compared one; the caption says so. Of a few, all are drawn."""
    few = plan_of(compare=["cliff", "cvm", "cvm_clean"], comparisons=[])
    assert few.drawn == few.titles
    assert len(plan.run.compare) > 12
    assert plan.drawn.keys() == plan.titles.keys() - {"tc_clean", "cvm_clean", "episodes_medoid"}
    for name in ("{label}_final", "coverage"):
        exhibit = next(one for one in EXHIBITS if one.name == name)
        assert all(asks["methods"] == plan.drawn for _, asks in calls(exhibit, plan))
        assert "Variants" in exhibit.caption_in(plan)
        assert "Variants" not in exhibit.caption_in(few)


def test_a_job_that_draws_does_not_load_what_only_tests_need():
    """scipy.stats takes a second, as long as many a figure."""
    modules = ", ".join(sorted({exhibit.module for exhibit in EXHIBITS}))
    code = f"import sys, {modules}; print('scipy.stats' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
