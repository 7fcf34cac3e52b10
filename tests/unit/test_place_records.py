"""Records of maps, forecasts and distributions: when a run makes them, of which methods, and of what."""

import dataclasses
from pathlib import Path

import pytest
import yaml

from modlhmp.study.configuration import load_datasets, load_run
from modlhmp.study.exhibits.of_places import EXHIBITS
from modlhmp.study.layout import Layout
from modlhmp.study.plan import Plan

CONFIG = Path(__file__).parents[2] / "config"
RECORDS = {exhibit.name: exhibit for exhibit in EXHIBITS}
MAPS = {"cliff-{label}-time", "stef-{label}-time", "cliff-{label}-time-one-location", "{label}_mod", "memory-maps"}
SCORED = {"density", "calibration", "tab_uncertainty"}


@pytest.fixture
def plan_of(tmp_path):
    """Function (changes of the demo's configuration) -> its plan, in the test's own folder."""

    def make(**changes):
        listed = {}
        for file in ("budgets", "config"):
            listed |= yaml.safe_load((CONFIG / f"{file}.yaml").read_text(encoding="utf-8"))
        run = load_run({**listed, "comparisons": [], **changes}, CONFIG / "datasets")
        layout = Layout(run.run, str(tmp_path))
        return Plan(run, layout, load_datasets(run, CONFIG / "datasets", "data", layout.demo))

    return make


def wanted(plan):
    """Names of the exhibits that a run makes."""
    return {exhibit.name for exhibit in EXHIBITS if exhibit.wanted(plan)}


def asks(name, plan):
    """What an exhibit of all datasets asks."""
    return RECORDS[name].asks(plan, list(plan.datasets.values()))


def needs(name, plan):
    """What it needs."""
    return RECORDS[name].needs(plan, list(plan.datasets.values()))


@pytest.mark.parametrize(
    ("compare", "maps"),
    [
        (["tc_cliff"], {"cliff-{label}-time"}),
        (["cliff", "stef"], {"stef-{label}-time"}),
        (["tc_cliff", "cliff"], {"cliff-{label}-time", "cliff-{label}-time-one-location"}),
        (["tc_cliff", "stef"], {"cliff-{label}-time", "stef-{label}-time", "{label}_mod"}),
        (["episodes", "cvm"], set()),
        (["episodes", "snippets"], {"memory-maps"}),
        (["tc_tuned"], {"cliff-{label}-time"}),  # a variant builds the map of its kind
    ],
)
def test_maps_are_drawn_where_they_are_built(plan_of, compare, maps):
    assert wanted(plan_of(compare=compare)) & MAPS == maps


def test_distributions_are_drawn_where_they_are_measured(plan_of):
    assert wanted(plan_of(compare=["tc_cliff"])) >= SCORED
    for changes in ({"compare": ["cvm"]}, {"compare": ["tc_cliff"], "uncertainty": {"methods": []}}):
        plan = plan_of(**changes)
        assert not SCORED & wanted(plan)
        assert asks("density", plan)["shown"] == {}  # a rule may ask nevertheless


def test_the_runtime_is_drawn_where_it_was_measured_on_every_dataset(plan_of):
    plan = plan_of(compare=["cvm"])
    for number, file in enumerate(needs("runtime", plan)):
        assert "runtime" not in wanted(plan), number
        Path(file).parent.mkdir(parents=True)
        Path(file).write_text("{}", encoding="utf-8")
    assert "runtime" in wanted(plan)


def test_memory_maps_show_one_method_of_each_kind(plan_of):
    """The episodes first, whatever the order; the kind's own name before its variants'."""
    own = {"fewer": {"kind": "snippets", "title": "Fewer", "options": {"k": 9}}}
    plan = plan_of(compare=["fewer", "snippets", "episodes"], methods=own, ladder={}, studies={}, likelihood={})
    assert asks("memory-maps", plan) == {"methods": {"episodes": "Episodes", "snippets": "Snippets"}}
    plan = plan_of(compare=["fewer", "episodes"], methods=own, ladder={}, studies={}, likelihood={})
    assert asks("memory-maps", plan) == {"methods": {"episodes": "Episodes", "fewer": "Fewer"}}


def test_density_shows_snippets_or_the_first_that_is_measured(plan_of):
    """With the options that the dataset has tuned, the map of that kind, and the ways out only if they are used."""
    for compare, shown in ((["tc_cliff", "snippets"], "snippets"), (["cvm", "episodes", "tc_cliff"], "episodes")):
        plan = plan_of(compare=compare)
        assert {one["name"] for one in asks("density", plan)["shown"].values()} == {shown}
        for name in plan.datasets:
            assert plan.layout.map(name, shown) in needs("density", plan)
            assert plan.layout.map(name, "exits") not in needs("density", plan)
    plan = plan_of(compare=["tc_cliff"], rollout={"exits": True})
    assert {plan.layout.map(name, "exits") for name in plan.datasets} <= set(needs("density", plan))
    plan = plan_of(compare=["mid"], ladder={}, uncertainty={"methods": ["mid"]})  # a network's are in a file
    assert {plan.layout.forecasts(name, "mid") for name in plan.datasets} <= set(needs("density", plan))


def test_people_are_in_the_explorer_only_where_they_may_be(plan_of):
    """Made-up ones, unless the run's owner says otherwise; without them neither test tracks nor forecasts are read."""
    for said, shown in ((None, True), (True, True), (False, False)):
        plan = plan_of(explorer={"tracks": said})
        assert asks("explorer", plan)["tracks"] == ["demo_hall", "demo_forum"] * shown
        read = needs("explorer", plan)
        assert (plan.layout.forecasts("demo_hall", "tc_cliff") in read) is shown
        assert set(plan.tracks("demo_hall", "train")) <= set(read)
        assert (set(plan.tracks("demo_hall", "test")) <= set(read)) is shown


def test_recorded_people_are_not_in_the_explorer(plan_of):
    plan = plan_of()
    recorded = [dataclasses.replace(one, demo=False) for one in plan.datasets.values()]
    assert RECORDS["explorer"].asks(plan, recorded)["tracks"] == []
    assert not [file for file in RECORDS["explorer"].needs(plan, recorded) if "forecasts" in file]
    said = plan_of(explorer={"tracks": True})
    assert RECORDS["explorer"].asks(said, recorded)["tracks"] == ["demo_hall", "demo_forum"]


def test_the_explorer_has_the_maps_that_are_built(plan_of):
    """Not those of files, nor of kinds that nobody compares."""
    assert asks("explorer", plan_of())["maps"] == ["cliff", "tc_cliff", "stef"]
    few = plan_of(compare=["cvm", "stef"])
    assert asks("explorer", few)["maps"] == ["stef"]
    assert RECORDS["explorer"].wanted(plan_of(compare=["cvm"]))
