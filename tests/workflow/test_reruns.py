"""What an edit of the code reruns: the jobs whose result depends on it and those behind them, and no others.

Of a job's code its rule has a hash, which Snakemake compares; `test_run` sees it do so. Here the modules that enter
the hashes are asked for, in one process for all.
"""

import pytest
from project import Project, rerun_after

from modlhmp.kinds import BUILT_IN
from modlhmp.study.exhibits import EXHIBITS


@pytest.fixture(scope="module")
def jobs(tmp_path_factory):
    """Every job of the demo."""
    return Project(tmp_path_factory.mktemp("demo")).jobs()


BY_HOUR = {"tc_cliff", "tc_clean", "tc_middle"}


def rules_after(jobs, module):
    """Rules that an edit of a module reruns."""
    return {jobs[number].rule for number in rerun_after(jobs, f"modlhmp.{module}")}


def methods_after(jobs, module, rule="forecast_method"):
    """Methods that an edit of a module forecasts again with a rule."""
    again = [jobs[number] for number in rerun_after(jobs, f"modlhmp.{module}")]
    return {job.wildcards["method"] for job in again if job.rule == rule}


def test_the_demo_plans_all_that_it_promises(jobs):
    """A job of every rule that it needs, every exhibit of it, and code in every job but the ones that only collect."""
    rules = {job.rule for job in jobs}
    assert {"make_demo_recording", "clean_recording", "forecast_method", "forecast_with_network"} <= rules
    assert {"score_method", "climb_ladder", "measure_costs", "study_training", "average_forecasts"} <= rules
    assert {f"build_{name}" for name in ("cliff", "tc_cliff", "stef", "episodes", "snippets", "exits")} <= rules
    assert {f"train_{kind.name}" for kind in BUILT_IN if kind.learned} <= rules
    # The runtime study is a target of its own, folds are another way to evaluate, 2 s are for steps of 0.1 s.
    assert rules >= {exhibit.rule for exhibit in EXHIBITS if not exhibit.of_folds} - {"figure_runtime", "table_short"}
    assert {job.rule for job in jobs if not job.modules} == {"all"}


def test_pictures_of_maps_come_before_what_takes_long(jobs):
    """All that they need is started before the trainings, forecasts, scores and studies that could start, too."""
    pictures = {"figure_stef_time", "figure_cliff_time", "figure_mod"}
    needed = {number for number, job in enumerate(jobs) if job.rule in pictures}
    assert len(needed) == 2 * len(pictures)
    while more := {before for number in needed for before in jobs[number].needs} - needed:
        needed |= more
    long = ("train_", "forecast_", "score_", "read_", "measure_", "study_", "compare_", "climb_", "average_")
    others = [job.priority for job in jobs if job.rule.startswith(long) or job.rule == "figure_prequential"]
    assert min(jobs[number].priority for number in needed) > max(others)


@pytest.mark.parametrize(
    ("module", "rules"),
    [
        (
            "scoring.ttests",
            {
                *("compare_methods", "table_ttests", "table_claims", "climb_ladder", "table_ladder", "figure_ladder"),
                *("measure_likelihood", "table_likelihood", "figure_likelihood"),
                *("measure_given", "table_likelihood_given", "figure_prequential"),
                *("table_uncertainty", "figure_calibration"),
            },
        ),
        ("study.readings", {"read_protocol", "table_readings"}),
        ("scoring.encounters", {"measure_encounters", "table_encounters"}),
        ("study.exhibits.stef_hours", {"figure_stef_time", "figure_mod"}),
        ("study.claims", {"table_claims"}),
        ("study.exhibits.tables", {"table_scenarios", "table_expres", "table_ttests"}),
        ("study.reliability", {"table_uncertainty", "figure_calibration"}),
        ("study.exhibits.density_maps", {"figure_density"}),
        (
            "study.studies",
            {
                *("study_parameter", "figure_parameter", "study_training", "figure_training_share", "table_claims"),
                *("measure_likelihood", "table_likelihood", "figure_likelihood"),
            },
        ),
        ("scoring.next_velocity", {"measure_given", "table_likelihood_given"}),
        ("study.ladder", {"climb_ladder", "table_ladder", "figure_ladder"}),
        ("study.exhibits.ladder_figure", {"figure_ladder"}),
        ("study.exhibits.ladder_table", {"table_ladder"}),
        ("study.exhibits.memory_maps", {"figure_memory_maps"}),
        ("study.exhibits.training_share", {"figure_training_share"}),
        ("study.runtime", {"measure_costs", "table_ladder"}),  # its study is a target of its own
        ("logs", None),  # how jobs report
        ("settings", None),  # what settings say reaches a job through its parameters
        ("options", None),
        ("kinds", None),
        ("study.plan", None),
        ("study.describe", None),
        ("api", {"figure_prequential"}),  # maps that are updated are the library's
    ],
)
def test_an_edit_reruns_exactly_what_depends_on_it(jobs, module, rules):
    assert rules_after(jobs, module) == ({*rules, "write_report", "all"} if rules else set())


def test_an_edit_of_a_map_s_code_remakes_that_map(jobs):
    """And what was made with it, but neither recordings nor the other map."""
    rules = rules_after(jobs, "maps.mean_shift")
    assert {"build_cliff", "build_tc_cliff", "forecast_method", "figure_cliff_time", "table_claims"} <= rules
    assert not {"clean_recording", "build_stef", "build_snippets", "figure_stef_time", "table_scenarios"} & rules
    assert methods_after(jobs, "maps.mean_shift") == {"cliff", *BY_HOUR}


@pytest.mark.parametrize(
    ("module", "methods"),
    [
        ("forecasting.chain", {"snippets"}),
        ("forecasting.rollout", {"cliff", "stef", *BY_HOUR}),
        ("maps.stef", {"stef"}),
        ("maps.snippets", {"snippets"}),
    ],
)
def test_an_edit_of_a_kind_s_code_forecasts_its_methods_alone(jobs, module, methods):
    assert methods_after(jobs, module) == methods
    rules = rules_after(jobs, module)
    assert not {rule for rule in rules if rule.startswith("train_")}
    assert not {"clean_recording", "forecast_with_network"} & rules
    assert rules >= {"score_method", "table_expres"}
    assert methods_after(jobs, module, "score_method") >= methods


def test_an_edit_of_a_forecaster_draws_again_what_forecasts_with_it_itself(jobs):
    """The density shows more of snippets' futures than their files keep."""
    assert "figure_density" in rules_after(jobs, "forecasting.chain")


def test_an_edit_of_constant_velocity_is_one_of_those_who_fall_back_on_it(jobs):
    """Maps with memory do where they remember nobody."""
    assert "cvm" in methods_after(jobs, "forecasting.cvm")
    assert not {rule for rule in rules_after(jobs, "forecasting.cvm") if rule.startswith(("build_", "train_"))}


def test_an_edit_of_a_network_trains_that_network_alone(jobs):
    """And redoes what stands on its forecasts; MID has Trajectron++'s encoder, so an edit of that is one of both."""
    rules = rules_after(jobs, "networks.tutr")
    assert {"train_tutr", "forecast_with_network", "score_method", "table_models", "table_expres"} <= rules
    assert {rule for rule in rules if rule.startswith("train_")} == {"train_tutr"}
    assert methods_after(jobs, "networks.tutr", "forecast_with_network") == {"tutr"}
    assert not {"forecast_method", "build_cliff", "study_parameter", "clean_recording"} & rules
    both = rules_after(jobs, "networks.trajectronpp")
    assert {rule for rule in both if rule.startswith("train_")} == {"train_trajectronpp", "train_mid"}
    of_maps = rules_after(jobs, "networks.neural_map")
    assert {rule for rule in of_maps if rule.startswith("train_")} == {"train_neural_map"}


def test_the_style_is_that_of_all_figures(jobs):
    """Every rule that draws, the page included, depends on the one style module, and nothing else does."""
    drawing = {exhibit.rule for exhibit in EXHIBITS if exhibit.form != "table"} - {"figure_runtime"}
    assert len(drawing) >= 10
    assert rules_after(jobs, "study.exhibits.style") == {*drawing, "write_report", "all"}
