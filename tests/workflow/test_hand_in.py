"""Forecasts from outside through the whole workflow, and the tutorial as it stands."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from project import ROOT

from modlhmp.storage import column
from modlhmp.study.summary import read_errors, summarise

TINY = ("--configfile", "config/tiny.yaml")
DATASETS = ("demo_hall", "demo_forum")
PAGE = (ROOT / "docs/your-predictor.md").read_text()
HANDED = """
compare: [cvm, handed]
methods: {handed: {kind: forecasts, folder: handed}}
comparisons: []
ladder: {rows: []}
uncertainty: {methods: [handed]}
"""


def python(project, *arguments):
    """What a Python program prints in a project's folder; its messages, too."""
    done = subprocess.run(
        [sys.executable, *map(str, arguments)], cwd=project.folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def modlhmp(project, *arguments):
    return python(project, "-m", "modlhmp.cli", *arguments)


def export(project, dataset, to, *more):
    where = (f"config/datasets/{dataset}.yaml", "--data-root", "resources/demo/tiny")
    return modlhmp(project, "export-task", *where, "--to", to, *more)


@pytest.fixture(scope="module")
def handed(tiny_run):
    """CVM's own forecasts of the tiny run, exported from the command line and handed in as a method of that run."""
    for dataset in DATASETS:
        made = f"results/tiny/{dataset}/forecasts/cvm"
        export(tiny_run, dataset, f"resources/handed/{dataset}", "--forecasts", made)
    (tiny_run.folder / "handed.yaml").write_text(HANDED)
    files = [f"results/tiny/{name}/{what}/handed.parquet" for name in DATASETS for what in ("errors", "uncertainty")]
    tiny_run.snakemake("--cores", 2, *TINY, "handed.yaml", "--", *files)
    return tiny_run


@pytest.mark.parametrize("dataset", DATASETS)
def test_our_own_cvm_has_its_row_to_the_bit(handed, dataset):
    """Every track's errors under both protocols, and so every number of its row."""
    own, theirs = (handed.folder / f"results/tiny/{dataset}/errors/{name}.parquet" for name in ("cvm", "handed"))
    ours, again = pq.read_table(own), pq.read_table(theirs)
    assert ours.column_names == again.column_names and len(ours) > 100
    for name in ours.column_names:
        if name in ("ade", "fde", "infeasible"):
            np.testing.assert_array_equal(column(ours, name), column(again, name))
        else:
            assert ours[name].to_pylist() == again[name].to_pylist(), name
    rows = [summarise(dataset, "", read_errors(file), 1.0) for file in (own, theirs)]
    pd.testing.assert_frame_equal(*rows, check_exact=True)


def test_a_hand_in_of_another_task_is_refused(handed):
    """With the reason, in the job's log; nothing is scored."""
    sheet = handed.folder / "resources/handed/demo_forum/forecasts.json"
    other = json.loads((handed.folder / "resources/handed/demo_hall/forecasts.json").read_text())
    mine = sheet.read_text()
    sheet.write_text(json.dumps(other))
    try:
        target = "results/tiny/demo_forum/errors/handed.parquet"
        output = handed.snakemake("--cores", 1, *TINY, "handed.yaml", "--", target, fails=True)
    finally:
        sheet.write_text(mine)
    assert f"task {other['task']!r} is another than that of demo_forum here" in output
    assert "export the task again" in output and "Traceback" not in output


def test_a_folder_without_forecasts_is_told_before_any_job(handed):
    (handed.folder / "nothing.yaml").write_text(HANDED.replace("folder: handed", "folder: nowhere"))
    output = handed.snakemake("-n", *TINY, "nothing.yaml", "--", "paper_figures/tiny/results.csv", fails=True)
    assert "methods.handed.folder: resources/nowhere: no such folder; it holds forecasts such as" in output
    assert "Traceback" not in output


# --- the tutorial ---------------------------------------------------------------------------------------------------


def test_the_predictor_of_the_page_is_the_script():
    """In thirty lines, of numpy and pandas alone."""
    (shown,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert shown == (ROOT / "notebooks/predictor.py").read_text()
    assert len([line for line in shown.splitlines() if line.strip()]) <= 30
    assert set(re.findall(r"^(?:import|from) (\w+)", shown, re.M)) == {"json", "sys", "pathlib", "numpy", "pandas"}


@pytest.fixture(scope="module")
def theirs(tiny_run):
    """The tutorial's five steps: its predictor where modlhmp cannot be imported, its configuration's whole run."""
    (shown,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    (overlay,) = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (tiny_run.folder / "predictor.py").write_text(shown)
    (tiny_run.folder / "theirs.yaml").write_text(overlay)
    export(tiny_run, "demo_hall", "task", "--training")
    alone = "import runpy, sys; sys.modules['modlhmp'] = None; sys.argv = sys.argv[1:]; runpy.run_path(sys.argv[0])"
    python(tiny_run, "-c", alone, "predictor.py", "task", "resources/theirs")
    tiny_run.snakemake("--cores", 2, "--configfile", "theirs.yaml")
    return tiny_run


def test_it_is_in_every_table_and_figure(theirs):
    """Of those that show every compared method."""
    exhibits = theirs.folder / "paper_figures/theirs"
    results = pd.read_csv(exhibits / "results.csv")
    mine = results[results["method"] == "theirs"]
    assert set(mine["output"]) == {"likeliest"} and set(mine["protocol"]) == {"paper", "complete"}
    assert (mine.loc[mine["protocol"] == "complete", "n"] == mine.loc[mine["protocol"] == "complete", "eligible"]).all()
    tables = ("tab_expres", "tab_ttests", "tab_encounters")
    assert all("Theirs" in (exhibits / f"{name}.md").read_text() for name in tables)
    names = {path.stem: path for path in exhibits.glob("*.csv")}
    found = {name for name in names if re.search(r"\btheirs\b|Theirs", names[name].read_text())}
    assert {"atc_final", "coverage", "prediction_example"} <= found, found


def test_the_score_of_the_command_line_is_the_run_s(theirs):
    where = ("config/datasets/demo_hall.yaml", "--data-root", "resources/demo/tiny")
    printed = modlhmp(theirs, "score", "resources/theirs", "--tracks", *where)
    assert "72 of 72 tracks have a forecast" in printed
    results = pd.read_csv(theirs.folder / "paper_figures/theirs/results.csv")
    mine = results[results["method"] == "theirs"].set_index(["protocol", "horizon_s"])
    rows = [line.split(",") for line in printed.splitlines() if line.startswith(("paper,", "complete,"))]
    assert len(rows) == 10
    for protocol, _, horizon_s, ade, fde, n, eligible in rows:
        row = mine.loc[(protocol, float(horizon_s))]
        assert [float(ade), float(fde)] == pytest.approx([row["ade_m"], row["fde_m"]], rel=1e-4)
        assert (float(n), float(eligible)) == (row["n"], row["eligible"])


def test_the_script_does_it_from_the_command_line(theirs):
    """As CI and a reader run it, beside a run."""
    folder = theirs.folder / "notebooks"
    folder.mkdir(exist_ok=True)
    for name in ("bring_your_predictor.py", "predictor.py"):
        (folder / name).write_text((ROOT / "notebooks" / name).read_text())
    done = subprocess.run(
        [sys.executable, folder / "bring_your_predictor.py", theirs.folder / "given"],
        env={**os.environ, "MODLHMP_RUN": "tiny"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Demo data" in done.stdout and re.search(r"theirs( +\d+\.\d+){5}", done.stdout)
