"""An outside package, installed beside the project, is run through the workflow without a change of the project."""

import os
import shutil
import subprocess
import sys

import pandas as pd
import pytest
from project import ROOT, Project, planned

CONFIG = """
run: walks
datasets: [demo_hall]
seeds: [0]
demo: {scale: 0.15}
compare: [mean_flow, standing, line, cvm]
comparisons: [[mean_flow, cvm]]
budgets: {demo: {line: {windows: 100}}}
ladder: {rows: []}
uncertainty: {methods: []}
studies: {beta: [], sampling_radius_m: [], training: {shares: []}}
"""
RUN = ("--configfile", "walks.yaml")
TABLES = ("paper_figures/walks/results.csv", "paper_figures/walks/tab_expres.md")


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Folder in which pip has put the package; it is built from a copy, so that nothing is left beside the original."""
    folder = tmp_path_factory.mktemp("walking")
    shutil.copytree(ROOT / "tests/outside/walking", folder / "source")
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--target", folder / "site", folder / "source"], check=True
    )
    return folder / "site"


@pytest.fixture(scope="module")
def walks(tmp_path_factory, installed):
    """Function (arguments): what Snakemake prints in a project where the package's methods have been compared."""
    project = Project(tmp_path_factory.mktemp("walks"))
    (project.folder / "walks.yaml").write_text(CONFIG)

    def snakemake(*arguments, site=installed, fails=False):
        path = os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])
        return project.snakemake(*arguments, fails=fails, PYTHONPATH=path)

    snakemake("--cores", 2, *RUN, "--", *TABLES)
    snakemake.folder = project.folder
    return snakemake


def test_its_methods_are_forecast_and_scored(walks):
    """A map, a predictor and a network, beside one of the project's own."""
    results = pd.read_csv(walks.folder / "paper_figures/walks/results.csv")
    assert set(results["method"]) == {"mean_flow", "standing", "line", "cvm"}
    assert (results.groupby("method")["n"].max() > 0).all()
    near = results[(results["horizon_s"] == 5) & (results["protocol"] == "complete")]
    assert near.groupby("method")["ade_m"].max().between(0.01, 20).all()


def test_its_titles_are_in_the_table(walks):
    """As its records have them."""
    table = (walks.folder / "paper_figures/walks/tab_expres.md").read_text()
    for title in ("Mean flow", "Standing still", "Learned line", "CVM"):
        assert title in table


def test_an_edit_of_it_reruns_what_it_makes_and_no_other(walks, installed, tmp_path):
    """Its map and the forecasts of its two kinds in that file; its network is in another."""
    shutil.copytree(installed, tmp_path / "site")
    with (tmp_path / "site/walking.py").open("a") as file:
        file.write("\n# an edit\n")
    rules = planned(walks("-n", *RUN, "--", *TABLES, site=tmp_path / "site"))
    made = {"build_mean_flow": 1, "forecast_method": 2, "score_method": 2}
    assert rules == {**made, "summarise_results": 1, "table_expres": 1}


def test_its_options_are_checked(walks):
    """A misspelt one is told with the nearest, a wrong value with what it means."""
    (walks.folder / "odd.yaml").write_text(
        "methods: {standing: {options: {aftr_s: 3}}}\nmaps: {mean_flow: {cell_m: 0}}"
    )
    output = walks("-n", *RUN, "odd.yaml", "--", *TABLES, fails=True)
    assert "maps.mean_flow.cell_m: 0 is not above 0 (size of a cell [m])" in output
    (walks.folder / "odd.yaml").write_text("methods: {standing: {options: {aftr_s: 3}}}\n")
    output = walks("-n", *RUN, "odd.yaml", "--", *TABLES, fails=True)
    assert "methods.standing.options: unknown key 'aftr_s', did you mean 'after_s'" in output
    assert "Traceback" not in output


def test_nothing_of_it_is_left_in_the_repository():
    """No build folder, no egg-info."""
    left = {file.name for file in (ROOT / "tests/outside/walking").rglob("*") if "__pycache__" not in str(file)}
    assert left == {"pyproject.toml", "src", "walking.py", "walking_network.py"}
