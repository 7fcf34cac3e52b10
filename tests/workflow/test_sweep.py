"""A list of sites: each a run of its own, one table across them, and one that fails loses none of the others."""

import numpy as np
import pandas as pd
import pytest
from project import Project, planned

DATASET = """
title: {name}
reader: delimited
timezone: Europe/Zurich
recordings: [{{files: {name}.csv, day: 2031-03-03, split: {{by: person, test: 0.5}}}}]
columns: {{track_id: person, t: time, x: x, y: y}}
header: true
horizon_s: 8
velocity: differences
citation: made up by a test
terms: free
"""
SITES = """
sweep: plazas
configfiles: [config/own.yaml]
reference: cvm
targets: []
shared:
  data_root: recordings
  seeds: [0]
  compare: [cvm, cvm_clean]
sites:
  north:
  broken:
"""
SWEEP = ("--snakefile", "workflow/sweep.smk", "--configfile", "sites.yaml", "--cores", 2, "--keep-going")


def people_csv(path, seed, people=24):
    """People who walk straight on, a row a second."""
    rng, pieces = np.random.default_rng(seed), []
    start = pd.Timestamp("2031-03-03 10:00", tz="Europe/Zurich").timestamp()
    for person in range(people):
        t = np.arange(14.0)
        x, y = 1.2 * t + rng.normal(0, 0.05, 14), rng.uniform(0, 5) + rng.normal(0, 0.05, 14)
        pieces.append(pd.DataFrame({"time": start + 20 * person + t, "person": person, "x": x, "y": y}))
    pd.concat(pieces).to_csv(path, index=False, float_format="%.3f")


@pytest.fixture(scope="module")
def plazas(tmp_path_factory):
    """(project, what was printed) of a sweep over a site and one whose recording has only two rows."""
    project = Project(tmp_path_factory.mktemp("plazas"))
    (project.folder / "sites.yaml").write_text(SITES)
    (project.folder / "recordings").mkdir()
    for seed, name in enumerate(("north", "broken")):
        (project.folder / f"config/datasets/{name}.yaml").write_text(DATASET.format(name=name))
        people_csv(project.folder / f"recordings/{name}.csv", seed)
    broken = project.folder / "recordings/broken.csv"
    broken.write_text("".join(broken.read_text().splitlines(keepends=True)[:3]))
    return project, project.snakemake(*SWEEP, fails=True)


def test_one_failing_site_loses_no_other(plazas):
    project, printed = plazas
    assert "site broken: its run failed: results/sweeps/plazas/logs/broken.log" in printed
    assert "1 of 2 sites are in paper_figures/sweeps/plazas/sites.md" in printed
    assert "broken" in (project.folder / "results/sweeps/plazas/logs/broken.log").read_text()
    table = pd.read_csv(project.folder / "paper_figures/sweeps/plazas/sites.csv")
    assert set(table["sites"]) == {1}
    assert table["left_out"].str.startswith("broken: its run failed").all()


def of_north(project):
    """The command for a list of the site that went well."""
    (project.folder / "north.yaml").write_text(SITES.replace("  broken:\n", ""))
    return [one.replace("sites.yaml", "north.yaml") if isinstance(one, str) else one for one in SWEEP]


def test_the_table_of_sites_that_all_went_well(plazas):
    """Is made by its rule, not after a failure."""
    project, _ = plazas
    command = of_north(project)
    table = project.folder / "paper_figures/sweeps/plazas/sites.csv"
    of_failed = table.read_text()
    table.unlink()
    project.snakemake(*command)
    assert pd.read_csv(table)["left_out"].isna().all()
    table.write_text(of_failed)


def test_the_table_is_of_the_site_s_own_run(plazas):
    project, _ = plazas
    table = pd.read_csv(project.folder / "paper_figures/sweeps/plazas/sites.csv")
    chosen = {"protocol": "complete", "horizon_s": 8.0, "metric": "ade", "method": "cvm_clean"}
    row = table[np.logical_and.reduce([table[name] == value for name, value in chosen.items()])].iloc[0]
    scores = pd.read_csv(project.folder / "paper_figures/plazas-north/results.csv")
    tests = pd.read_parquet(project.folder / "results/plazas-north/north/ttests.parquet").query("against == 'cvm'")
    score, test = (
        one[np.logical_and.reduce([one[name] == value for name, value in chosen.items() if name in one])]
        for one in (scores, tests)
    )
    assert (row["mean_m"], row["n"]) == (score["ade_m"].item(), score["n"].item())
    assert row["difference_m"] == pytest.approx(test["mean_difference_m"].item(), rel=1e-5)


def test_a_rerun_does_only_what_is_missing(plazas):
    project, _ = plazas
    assert planned(project.snakemake(*SWEEP, "--dry-run")) == {"gather": 1, "site": 1, "sweep": 1}


def test_a_change_of_the_default_configuration_runs_a_site_again(plazas):
    """Though the list of sites says the same."""
    project, _ = plazas
    file = project.folder / "config/config.yaml"
    text = file.read_text()
    assert "site" not in planned(project.snakemake(*of_north(project), "--dry-run"))
    file.write_text(text.replace('"CVM, positions"', '"CVM, of positions"'))
    assert planned(project.snakemake(*of_north(project), "--dry-run"))["site"] == 1
    file.write_text(text)


def test_a_site_s_job_reads_no_other_site(plazas):
    """Of a long list every job would read all."""
    project, _ = plazas
    file = project.folder / "config/datasets/broken.yaml"
    text = file.read_text()
    file.write_text("reader: nothing\n")
    job = ("--mode", "subprocess", "--dry-run", "--forcerun", "site", "--", "results/sweeps/plazas/north.parquet")
    assert "broken" not in project.snakemake(*SWEEP, *job)
    file.write_text(text)


def test_what_is_wrong_is_said_before_anything_runs(plazas):
    project, _ = plazas
    (project.folder / "wrong.yaml").write_text(SITES.replace("  broken:", "  nowhere:"))
    command = [one.replace("sites.yaml", "wrong.yaml") if isinstance(one, str) else one for one in SWEEP]
    printed = project.snakemake(*command, fails=True)
    assert "site nowhere: configuration, datasets: no dataset named 'nowhere'" in printed
