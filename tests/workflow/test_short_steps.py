"""The setting of the ETH and UCY recordings: steps of 0.4 s, 8 rows in, 12 steps out, several forecasts of a track."""

import numpy as np
import pandas as pd
import pytest
from project import Project

DATASET = """
title: Plaza
reader: delimited
timezone: Europe/Zurich
recordings:
  - {files: morning.csv, day: 2031-03-03, start: "10:05", split: train}
  - {files: noon.csv, day: 2031-03-04, start: "10:10", split: test}
columns: {track_id: person, t: time, x: x, y: y}
header: true
time_step_s: 0.4
observed_s: 3.2
horizon_s: 4.8
forecast_every_s: 2
velocity: differences
citation: made up by a test
terms: free
"""
RUN = """
run: plaza
datasets: [plaza]
data_root: recordings
seeds: [0]
compare: [tc_cliff, cvm, snippets]
comparisons: [[tc_cliff, cvm], [snippets, cvm]]
ladder: {reference: cvm, rows: [[cvm, a line], [tc_cliff, a map], [snippets, a map with memory]], beside: []}
studies: {beta: [], sampling_radius_m: [], training: {shares: []}}
uncertainty: {methods: [snippets], samples: 40}
"""
TABLES = ("tab_expres", "tab_scenarios", "tab_ttests", "tab_uncertainty", "tab_encounters", "claims", "ladder-plaza")
HORIZONS = ["1.2", "2.4", "3.6", "4.8"]
FEW_ROWS = 3  # people who are seen for less than an observation


def plaza_csv(path, seed, people=70):
    """People who cross a plaza of 16 m by 10 m on bent ways, both directions, a row every 0.4 s; every fifth waits."""
    rng = np.random.default_rng(seed)
    pieces = []
    for person in range(people):
        rows = FEW_ROWS if person % 10 == 9 else int(rng.integers(18, 60))
        t = 0.4 * np.arange(rows)
        way, speed = (1.0 if person % 2 else -1.0), rng.normal(1.2, 0.15)
        walked = speed * np.where(t > 6, np.maximum(t - 3, 6), t) if person % 5 == 0 else speed * t
        x = way * (walked - 8) + rng.normal(0, 0.02, rows)
        y = way + 2.5 * np.sin(walked / 6) + rng.normal(0, 0.3) + rng.normal(0, 0.02, rows)
        pieces.append(pd.DataFrame({"time": t + rng.uniform(0, 300), "person": person, "x": x, "y": y}))
    pd.concat(pieces).to_csv(path, index=False, float_format="%.3f")


@pytest.fixture(scope="module")
def plaza(tmp_path_factory):
    """Folder in which the tables have been made of such recordings."""
    project = Project(tmp_path_factory.mktemp("plaza"))
    (project.folder / "config/datasets/plaza.yaml").write_text(DATASET)
    (project.folder / "plaza.yaml").write_text(RUN)
    (project.folder / "recordings").mkdir()
    for name, seed in (("morning", 1), ("noon", 2)):
        plaza_csv(project.folder / f"recordings/{name}.csv", seed)
    wanted = [f"paper_figures/plaza/{name}.csv" for name in TABLES]
    project.snakemake("--cores", 2, "--configfile", "plaza.yaml", "--", *wanted)
    return project.folder


def table(plaza, name):
    return pd.read_csv(plaza / f"paper_figures/plaza/{name}.csv")


def test_tables_are_full_at_horizons_of_the_dataset_s_own(plaza):
    """Every method has a number at each of them, under both protocols, in Markdown as well."""
    results = table(plaza, "results")
    complete = results[results["protocol"] == "complete"]
    at = complete.set_index(["method", "output", "horizon_s"])
    assert sorted(set(results["horizon_s"])) == [round(0.4 * step, 1) for step in range(1, 13)]
    assert complete["n"].min() > 0
    assert at.loc[("cvm", "single", 4.8), "n"] < at.loc[("cvm", "single", 1.2), "n"]
    text = (plaza / "paper_figures/plaza/tab_expres.md").read_text()
    assert "Plaza, 4.8 s" in text
    assert "| method | 1.2 s | 2.4 s | 3.6 s | 4.8 s |" in text
    assert "(n 0" not in text
    assert "a forecast of each track every 2 s" in text
    parameters = table(plaza, "tab_scenarios").set_index("parameter")["Plaza"]
    assert parameters["prediction time step Δt [s]"] == 0.4
    assert parameters["observed rows, the last at t0"] == 8


@pytest.mark.parametrize("name", ["tab_uncertainty", "tab_ttests"])
def test_every_horizon_has_its_rows(plaza, name):
    column = "horizon [s]" if name == "tab_uncertainty" else "horizon_s"
    found = [one for one in table(plaza, name)[column].astype(str) if one != "–"]
    assert sorted(set(found)) == HORIZONS


def test_every_horizon_has_its_column(plaza):
    found = table(plaza, "tab_encounters")
    assert [name for name in found if name.endswith(" s")] == [f"{horizon} s" for horizon in HORIZONS]
    assert not found.isna().any(axis=None)
    ladder = (plaza / "paper_figures/plaza/ladder-plaza.md").read_text()
    assert all(f"{horizon} s" in ladder for horizon in HORIZONS)


def test_n_counts_forecasts_and_clusters_are_persons(plaza):
    """There are fewer persons than forecasts, whose errors have their t0."""
    tests = table(plaza, "tab_ttests")
    one = tests[(tests["horizon_s"] == 1.2) & (tests["protocol"] == "complete") & (tests["metric"] == "ADE")]
    assert (one["clusters"] < one["n"] / 3).all()
    errors = pd.read_parquet(plaza / "results/plaza/plaza/errors/cvm.parquet")
    persons = errors["track_id"].nunique()
    assert 40 < persons <= 63
    assert set(one["clusters"]) == {persons}
    once = errors[(errors["output"] == "single") & (errors["protocol"] == "complete") & (errors["seed"] == 0)]
    apart = once.groupby("track_id")["t0"].diff().dropna()
    assert apart.min() == apart.max() == pytest.approx(2.0, abs=1e-6)
    assert len(once) >= one["n"].iloc[0]
    forecasts = pd.read_parquet(plaza / "results/plaza/plaza/forecasts/snippets/noon.parquet", columns=["t0", "seed"])
    assert forecasts.loc[forecasts["seed"] == 0, "t0"].tolist() == once["t0"].tolist()


def test_a_run_without_networks_says_so_in_the_claims(plaza):
    """And no claim is lost for want of a horizon."""
    claims = table(plaza, "claims")
    assert len(set(claims["claim"])) == 16
    text = claims[["our test", "verdict"]].astype(str).agg(" ".join, axis=1)
    assert text.str.contains("needs a horizon over 30 s not tested").any()
    assert text.str.contains("ADE TC-CLiFF < CVM, 4.8 s").any()
