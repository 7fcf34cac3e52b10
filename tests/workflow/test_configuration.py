"""Configurations: every shipped one plans, wrong ones are refused in plain words, own recordings work."""

import http.server
import json
import os
import subprocess
import threading
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from PIL import Image

from modlhmp.origins import file_sha256
from modlhmp.storage import read_metadata
from modlhmp.temporary import temporary_name

OWN_DATASET = """
title: Own recording
reader: delimited
timezone: Asia/Kolkata
hours: [9, 12]
figure_hours: [9, 10, 11]
recordings:
  - {files: monday.csv, day: 2031-03-03, start: "09:30", split: train}
  - {files: tuesday.csv, day: 2031-03-04, start: "09:30", split: test}
columns: {track_id: person, t: time, x: x, y: y}
header: true
separator: ";"
units: {time: ms, length: cm}
horizon_s: 30
velocity: differences
citation: made up by a test
terms: free
"""


def own_csv(path, seconds, seed):
    """People who walk along a corridor in both directions, 2.5 rows per second; time in ms, lengths in cm."""
    rng = np.random.default_rng(seed)
    pieces = []
    for person in range(60):
        t = np.arange(0, seconds, 0.4)
        way = 1 if person % 2 else -1
        x = way * 1.2 * t - way * 10 + rng.normal(0, 0.02, len(t))
        y = way * 0.8 + rng.normal(0, 0.2) + rng.normal(0, 0.02, len(t))
        pieces.append(pd.DataFrame({"time": 1000 * (t + person * 20), "person": person, "x": 100 * x, "y": 100 * y}))
    pd.concat(pieces).to_csv(path, sep=";", index=False, float_format="%.3f")


@pytest.fixture
def own(project):
    """A project with a dataset of its own beside the shipped ones."""
    (project.folder / "config/datasets/own.yaml").write_text(OWN_DATASET)
    (project.folder / "own.yaml").write_text("run: own\ndatasets: [own]\ndata_root: recordings\nseeds: [0]\n")
    (project.folder / "recordings").mkdir()
    return project


OWN = ("--cores", 2, "--configfile", "own.yaml")


@pytest.mark.parametrize("overlays", [("paper",), ("real", "lab/validation"), ("real", "lab/ladder")])
def test_every_shipped_configuration_plans(project, overlays):
    """A dry run at the root plans jobs without recordings.

    The demo is planned in `test_reruns`, tiny.yaml run in `test_run`; `choices` and `seeds` of lab/ have nothing that
    these have not.
    """
    output = project.snakemake("-n", "--configfile", *(f"config/{overlay}.yaml" for overlay in overlays))
    assert "forecast_method" in output
    assert "table_expres" in output


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("sedes=[1]", "configuration:\n  top level: unknown key 'sedes', did you mean 'seeds'"),
        ("run=2024_01", "run: 202401 is a number, not text; quote it"),
        ('run="2024_01"', "`--config` drops quotes and takes `'run=!!str 2024_01'`"),
        ("datasets=[atc_1day]", "give your run another name"),
    ],
)
def test_a_wrong_setting_stops_with_its_name(project, setting, message):
    """No typo passes silently; `test_run_settings` has all the others."""
    output = project.snakemake("-n", "--config", setting, fails=True)
    assert message in output
    assert "Traceback" not in output


@pytest.mark.parametrize("name", ["budgets", "config"])
def test_a_configuration_that_is_no_yaml_is_named_with_its_line(project, name):
    with open(project.folder / f"config/{name}.yaml", "a") as file:
        file.write("maps: {cliff: [\n")
    output = project.snakemake("-n", fails=True)
    assert f"config/{name}.yaml, line " in output
    assert "not valid YAML" in output


def test_an_average_on_the_ladder_is_timed_by_its_members(project):
    """Which may be no rungs themselves: their maps and weights are asked for all the same."""
    (project.folder / "short.yaml").write_text(
        "compare: [cvm, all_three]\nladder: {reference: cvm, rows: [[cvm, a line], [all_three, a mean]], beside: []}\n"
    )
    target = "results/demo/demo_hall/costs.json"
    output = project.snakemake("-n", "--quiet", "rules", "--configfile", "short.yaml", "--", target)
    for rule in ("build_episodes", "build_snippets", "train_neural_map"):
        assert rule in output


def test_a_missing_recording_is_asked_for(project):
    """Without sources: the file, the folder and the owner's page."""
    target = "results/real/atc_1day/tracks/atc-20121024-1hz-test.parquet"
    output = project.snakemake("--cores", 1, "--configfile", "config/real.yaml", "--", target, fails=True)
    assert "atc-20121024-1hz-test.csv" in output
    assert "ATC_dataset" in output
    assert "Traceback" not in output


def test_a_run_removes_what_a_killed_one_left(project):
    """A dry run removes nothing."""
    killed = subprocess.Popen(["true"])
    killed.wait()
    left = [
        project.folder / folder / temporary_name(Path("half.csv")).name.replace(f".{os.getpid()}.", f".{killed.pid}.")
        for folder in ("results/demo/demo_hall/errors", "paper_figures/demo", "resources/demo/demo")
    ]
    for file in left:
        file.parent.mkdir(parents=True)
        file.touch()
    target = "resources/demo/demo/hall/atc-20301009.csv"
    project.snakemake("-n", "--", target)
    assert all(file.exists() for file in left)
    project.snakemake("--cores", 1, "--", target)
    assert not any(file.exists() for file in left)


def test_a_recording_of_one_s_own(own):
    """Any CSV: from its description to the results; hours without data and a long horizon do no harm.

    One network stands for all, which share what reads recordings and trains.
    """
    with (own.folder / "own.yaml").open("a") as file:
        file.write("compare: [tc_cliff, cliff, stef, lstm, cvm, episodes, snippets]\n")
        file.write("budgets: {demo: {lstm: {windows: 1}}}\nstudies: {sampling_radius_m: [], beta: [1, 2]}\n")
    for name, seed in (("monday", 1), ("tuesday", 2)):
        own_csv(own.folder / "recordings" / f"{name}.csv", 16, seed)
    own.snakemake(*OWN)
    results = pd.read_csv(own.folder / "paper_figures/own/results.csv")
    at = results.set_index(["method", "output", "protocol", "horizon_s"])
    assert at.loc[("cliff", "ranked", "complete", 10), "n"] == 60
    # They walk straight on: constant velocity is right up to the noise.
    assert at.loc[("cvm", "single", "complete", 10), "ade_m"] < 0.5
    # No track is as long as the horizon: no number, and no crash.
    assert at.loc[("cvm", "single", "complete", 30), "eligible"] == 0
    assert np.isnan(at.loc[("cvm", "single", "complete", 30), "ade_m"])
    table = (own.folder / "paper_figures/own/tab_expres.md").read_text()
    assert "– / – (n 0/0)" in table
    assert "hour 11 is skipped" in (own.folder / "results/own/logs/build_tc_cliff/own.log").read_text()


def test_a_broken_dataset_file_is_named(own):
    """No traceback; `test_datasets` has what else may be wrong with it."""
    (own.folder / "config/datasets/own.yaml").write_text(OWN_DATASET.replace("reader: delimited", "reader: csv"))
    output = own.snakemake("-n", *OWN, fails=True)
    assert "own.yaml" in output
    assert "reader: 'csv' is not one of" in output
    assert "Traceback" not in output


ONE_METHOD = """
run: own
datasets: [own]
data_root: recordings
seeds: [0]
compare: [cvm]
comparisons: []
studies: {beta: [], sampling_radius_m: []}
"""


def test_one_method_without_a_map_and_a_floor_plan(own):
    """No map is built, no figure of one is drawn, claims say what they need; walls are counted and drawn."""
    (own.folder / "own.yaml").write_text(ONE_METHOD)
    with (own.folder / "config/datasets/own.yaml").open("a") as file:
        file.write("floor_plan: plan.yaml\n")
    for name, seed in (("monday", 1), ("tuesday", 2)):
        own_csv(own.folder / "recordings" / f"{name}.csv", 60, seed)  # they walk up to 72 m
    plan = (
        "image: plan.png\nresolution: 1.0\norigin: [-60, -60, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    (own.folder / "recordings/plan.yaml").write_text(plan)
    cells = np.full((120, 120), 255, np.uint8)
    cells[:, 80:90] = 0  # a wall at x from 20 m to 30 m, which they walk through
    Image.fromarray(cells).save(own.folder / "recordings/plan.png")
    own.snakemake(*OWN)
    exhibits = {file.name for file in (own.folder / "paper_figures/own").iterdir()}
    assert {"own_final.png", "coverage.png", "prediction_example.pdf", "rank.png", "claims.md"} <= exhibits
    of_maps = ("cliff-", "stef-", "parameter-", "rank-metrics", "tab_uncertainty", "calibration", "density")
    assert not [name for name in exhibits if name.startswith(of_maps)]
    assert not (own.folder / "results/own/own/maps").exists()
    results = pd.read_csv(own.folder / "paper_figures/own/results.csv")
    last = results[(results["horizon_s"] == 30) & (results["protocol"] == "complete")].iloc[0]
    assert last["n"] == 60
    assert last["infeasible"] == pytest.approx(last["truth_infeasible"], abs=0.05)
    assert last["truth_infeasible"] == pytest.approx(0.5, abs=0.01)  # those who walk towards it
    claims = pd.read_csv(own.folder / "paper_figures/own/claims.csv")
    assert set(claims["verdict"]) == {"not tested"}


def test_a_floor_plan_that_is_missing_or_bad(own):
    """Asked for like a recording, with the way out; a bad one is named with its key."""
    for name, seed in (("monday", 1), ("tuesday", 2)):
        own_csv(own.folder / "recordings" / f"{name}.csv", 16, seed)
    with (own.folder / "config/datasets/own.yaml").open("a") as file:
        file.write("floor_plan: plan.yaml\n")
    target = "results/own/own/errors/cvm.parquet"
    output = own.snakemake(*OWN, "--", target, fails=True)
    assert "plan.yaml is missing" in output
    assert "write `floor_plan: null`" in output
    (own.folder / "recordings/plan.yaml").write_text("image: plan.png\nresolution: none\n")
    output = own.snakemake("-n", *OWN, fails=True)
    assert "plan.yaml: the floor plan lacks origin, occupied_thresh, free_thresh" in output
    assert "Traceback" not in output


def test_a_file_put_there_during_the_run_is_kept(project):
    """Snakemake removes outputs before it makes them; a recording of the user's is not one."""
    sources = [{"url": "http://127.0.0.1:9/never", "file": "tuesday.csv"}]
    (project.folder / "config/datasets/own.yaml").write_text(f"{OWN_DATASET}\nsources: {json.dumps(sources)}\n")
    rule = project.folder / "workflow/scripts/fetch_recording.py"
    # A user who is quicker than the job: the file appears after planning, before the script looks.
    rule.write_text(
        "from pathlib import Path\n"
        "for path in (Path('recordings/tuesday.csv'), Path('recordings/monday.csv')):\n"
        "    path.parent.mkdir(exist_ok=True)\n"
        "    path.exists() or path.write_text('time;person;x;y\\n')\n" + rule.read_text()
    )
    (project.folder / "own.yaml").write_text("run: own\ndatasets: [own]\ndata_root: recordings\nseeds: [0]\n")
    project.snakemake(*OWN, "--", "recordings/monday.csv", "recordings/tuesday.csv")
    assert (project.folder / "recordings/monday.csv").read_text() == "time;person;x;y\n"
    assert (project.folder / "recordings/tuesday.csv").read_text() == "time;person;x;y\n"


def test_a_bad_recording_ends_with_a_message(own):
    """The log names file, row and remedy; there is no traceback."""
    own_csv(own.folder / "recordings/monday.csv", 16, 1)
    (own.folder / "recordings/tuesday.csv").write_text("time;person;x\n1;2;3\n")
    output = own.snakemake(*OWN, fails=True)
    assert "tuesday.csv, row 1: no column 'y' for y" in output
    assert "Traceback" not in output


def test_each_person_s_file_is_checked_against_its_own_source(own):
    """The first one's sum is known, that of the second is recorded, the others are of no source."""
    folder = own.folder / "recordings/people"
    folder.mkdir()
    own_csv(own.folder / "all.csv", 16, 1)
    for person, rows in pd.read_csv(own.folder / "all.csv", sep=";").groupby("person"):
        rows.drop(columns="person").to_csv(folder / f"{person:02}.csv", sep=";", index=False)
    sources = [
        {"url": "http://127.0.0.1:9/00", "file": "people/00.csv", "sha256": file_sha256(folder / "00.csv")},
        {"url": "http://127.0.0.1:9/01", "file": "people/01.csv"},
    ]
    listed = yaml.safe_load(OWN_DATASET)
    del listed["columns"]["track_id"]
    entry = {"files": "people/*.csv", "day": "2031-03-03", "start": "09:30", "split": {"by": "person"}}
    listed |= {"file_is": "person", "recordings": [entry], "sources": sources}
    (own.folder / "config/datasets/own.yaml").write_text(yaml.safe_dump(listed))
    tracks = "results/own/own/tracks/people-train.parquet"
    own.snakemake(*OWN, "--", tracks)
    assert f"{file_sha256(folder / '01.csv')}  people/01.csv" in (own.folder / "resources/SHA256SUMS").read_text()
    assert len(read_metadata(own.folder / tracks)["sources"]) == 60
    with (folder / "01.csv").open("a") as file:
        file.write("999999;1;1\n")
    assert "people/01.csv: expected SHA-256" in own.snakemake(*OWN, "--", tracks, fails=True)


def test_sources_are_fetched_and_checked_ever_after(own):
    """A dataset file's `sources`: downloaded once, recorded, and a changed file is refused."""
    served = own.folder / "served"
    served.mkdir()
    for name, seed in (("monday", 1), ("tuesday", 2)):
        own_csv(served / f"{name}.csv", 16, seed)

    class Handler(http.server.SimpleHTTPRequestHandler):
        def __init__(self, *arguments):
            super().__init__(*arguments, directory=served)

        def log_message(self, *arguments):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        url = f"http://127.0.0.1:{server.server_port}"
        sources = [
            {"url": f"{url}/monday.csv", "file": "monday.csv", "sha256": file_sha256(served / "monday.csv")},
            {"url": f"{url}/tuesday.csv", "file": "tuesday.csv"},
        ]
        file = own.folder / "config/datasets/own.yaml"
        file.write_text(f"{OWN_DATASET}\nsources: {json.dumps(sources)}\n")
        tracks = [f"results/own/own/tracks/{name}.parquet" for name in ("monday", "tuesday")]
        own.snakemake(*OWN, "--", *tracks)
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
    assert (own.folder / "recordings/monday.csv").read_bytes() == (served / "monday.csv").read_bytes()
    with (own.folder / "recordings/tuesday.csv").open("a") as file:
        file.write("999999;7;1;1\n")
    output = own.snakemake(*OWN, "--", tracks[1], fails=True)
    assert "tuesday.csv" in output
    assert "sha" in output.lower()
