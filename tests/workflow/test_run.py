"""The whole workflow on the tiny demo."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest
from project import ROOT, Project

from modlhmp.scoring.summary import COLUMNS
from modlhmp.storage import read_metadata

pytestmark = pytest.mark.xdist_group("tiny")  # one worker makes the tiny run that all these tests look at
TINY = ("--configfile", "config/tiny.yaml")
EXHIBITS = {
    *(f"{table}.{kind}" for table in ("tab_scenarios", "tab_expres", "tab_ttests") for kind in ("csv", "md", "tex")),
    *(
        f"{figure}.{kind}"
        for figure in ("atc_final", "edin_final", "rank-metrics", "cliff-atc-time", "cliff-edin-time")
        for kind in ("csv", "pdf", "png")
    ),
    "results.csv",
}


def planned(output):
    """Rules of a dry run's job table."""
    lines = output.split("Job stats:")[-1].split("total")[0].splitlines()[3:] if "Job stats:" in output else []
    return {line.split()[0] for line in lines if line.strip()}


def test_every_exhibit_is_there(tiny_run):
    """The set of files is exactly the promised one, none empty."""
    files = list((tiny_run.folder / "paper_figures/tiny").iterdir())
    assert {file.name for file in files} == EXHIBITS
    assert all(file.stat().st_size > 100 for file in files)


def test_exhibits_say_demo(tiny_run):
    """Nobody can take the demo's tables for the paper's."""
    for table in ("tab_scenarios", "tab_expres", "tab_ttests"):
        assert "Demo data" in (tiny_run.folder / f"paper_figures/tiny/{table}.md").read_text()


def test_results_have_the_promised_columns_and_hold_together(tiny_run):
    """Both protocols of every method at every horizon; more tracks are scored the shorter the horizon."""
    results = pd.read_csv(tiny_run.folder / "paper_figures/tiny/results.csv")
    assert tuple(results.columns) == COLUMNS
    assert set(results["method"]) == {"tc_cliff", "cliff", "stef", "cvm"}
    steps = results.groupby(["dataset", "method", "output", "protocol"])["horizon_s"].agg(["min", "max", "size"])
    assert (steps["min"] == 1).all()
    assert (steps["max"] == steps["size"]).all()
    complete = results[results["protocol"] == "complete"]
    assert (complete["n"] == complete["eligible"]).all()
    assert (results["n"] <= results["eligible"]).all()
    assert (results[results["output"] == "single"]["seeds"] == 1).all()
    assert (results[results["output"] == "ranked"]["seeds"] == 2).all()
    for _, curve in results.groupby(["dataset", "method", "output", "protocol"]):
        assert curve.sort_values("horizon_s")["eligible"].is_monotonic_decreasing


def test_accounts_add_up(tiny_run):
    """Every row and track read is kept or dropped by name."""
    accounts = list((tiny_run.folder / "results/tiny").glob("*/tracks/*.account.json"))
    assert len(accounts) == 8
    for file in accounts:
        account = json.loads(file.read_text())
        for kind in ("rows", "tracks"):
            assert account[kind]["read"] == account[kind]["kept"] + sum(account[kind]["dropped"].values())


def test_every_parquet_file_carries_its_provenance(tiny_run):
    """Dataset, settings, code and the raw files' hashes travel with each result."""
    files = list((tiny_run.folder / "results/tiny").rglob("*.parquet"))
    assert len(files) > 50
    for file in files:
        origin = read_metadata(file)
        assert {"dataset", "settings", "code", "sources"} <= set(origin), file
        assert origin["sources"], file
        assert all(len(digest) == 64 for digest in origin["sources"].values())


def test_a_second_run_does_nothing(tiny_run):
    """All is up to date."""
    assert "Nothing to be done" in tiny_run.snakemake("--cores", 2, *TINY)


def test_one_core_gives_the_same_bits(tiny_run, project):
    """Results do not depend on cores or on the order of jobs."""
    shutil.copytree(tiny_run.folder / "resources", project.folder / "resources")
    project.snakemake("--cores", 1, *TINY)
    for name in ("results.csv", "tab_ttests.csv", "atc_final.csv"):
        ours, theirs = (p.folder / "paper_figures/tiny" / name for p in (tiny_run, project))
        assert ours.read_bytes() == theirs.read_bytes(), name
    for file in (tiny_run.folder / "results/tiny").rglob("*.parquet"):
        other = project.folder / file.relative_to(tiny_run.folder)
        assert file.read_bytes() == other.read_bytes(), file


def test_report_holds_the_exhibits(tiny_run):
    """`--report` works offline and has the figures, the tables and the front page."""
    tiny_run.snakemake("--report", "report.html", *TINY)
    report = (tiny_run.folder / "report.html").read_text()
    for text in ("atc_final.png", "rank-metrics.png", "cliff-edin-time.png", "tab_expres.md", "two protocols"):
        assert text in report, text


@pytest.mark.parametrize(
    ("module", "rerun", "untouched"),
    [
        ("scoring/ttests.py", {"compare_methods", "table_ttests"}, {"build_cliff", "forecast_recording"}),
        ("maps/mean_shift.py", {"build_cliff", "build_tc_cliff"}, {"clean_recording", "build_stef"}),
        ("paper/hourly_maps.py", {"figure_hourly_maps"}, {"figure_ranking", "build_tc_cliff"}),
    ],
)
def test_an_edit_reruns_what_depends_on_it(tiny_run, tmp_path, module, rerun, untouched):
    """A module's edit is seen by the rules whose result depends on it, and by no others."""
    shutil.copytree(ROOT / "src", tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    with (tmp_path / "src/modlhmp" / module).open("a") as file:
        file.write("\n# an edit\n")
    rules = planned(tiny_run.snakemake("-n", *TINY, PYTHONPATH=str(tmp_path / "src")))
    assert rerun <= rules
    assert not untouched & rules


def test_a_changed_option_reruns_what_reads_it(tiny_run):
    """Forecasts read beta , maps do not."""
    (tiny_run.folder / "beta.yaml").write_text("rollout: {beta: 2.0}\n")
    rules = planned(tiny_run.snakemake("-n", "--configfile", "config/tiny.yaml", "beta.yaml"))
    assert "forecast_recording" in rules
    assert not {"build_cliff", "clean_recording"} & rules


@pytest.mark.full
def test_the_paper_s_configuration_runs_on_recordings_laid_out_like_it(tmp_path):
    """config/paper.yaml, all 55 recordings, made up by the demo under the paper's names and days."""
    from modlhmp.demo import write_recording  # noqa: PLC0415 - only here

    project = Project(tmp_path / "project")
    for name, site in (("atc", "hall"), ("edinburgh", "forum")):
        import yaml  # noqa: PLC0415

        dataset = yaml.safe_load((ROOT / f"config/datasets/{name}.yaml").read_text())
        for recording in dataset["recordings"]:
            path = tmp_path / "data" / recording["files"]
            path.parent.mkdir(parents=True, exist_ok=True)
            write_recording(path, site, str(recording["day"]), seed=1, scale=0.05)
    (project.folder / "one_seed.yaml").write_text("seeds: [0]\n")
    arguments = ("--cores", 2, "--configfile", "config/paper.yaml", "one_seed.yaml")
    project.snakemake(*arguments, MODLHMP_DATA=str(tmp_path / "data"))
    assert {file.name for file in Path(project.folder / "paper_figures/paper").iterdir()} == EXHIBITS
