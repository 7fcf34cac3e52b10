"""A run that is killed goes on to the same bytes."""

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from project import Project

TINY = ("--configfile", "config/tiny.yaml")
TARGETS = [f"results/tiny/demo_hall/errors/{method}.parquet" for method in ("tc_cliff", "snippets", "cvm")]


def killed(project, jobs, after_s):
    """A run of `TARGETS` of which every process is killed so many seconds after so many jobs have ended."""
    command = [sys.executable, "-m", "snakemake", "--cores", "2", "--rerun-incomplete", *TINY, "--", *TARGETS]
    with subprocess.Popen(
        command, cwd=project.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as run:
        try:
            for line in run.stdout:
                jobs -= line.startswith("Finished jobid")
                if not jobs:
                    break
            run.wait(after_s)
        except subprocess.TimeoutExpired:
            pass
        finally:
            ended = run.poll()
            os.killpg(run.pid, signal.SIGKILL)
    assert ended is None, "the run was over before it was killed"


def left(folder, pattern="*"):
    """Bytes of a run's files but for logs and timings, by name."""
    files = (path for path in Path(folder).rglob(pattern) if path.is_file())
    named = {path.relative_to(folder).as_posix(): path for path in files}
    return {name: path.read_bytes() for name, path in named.items() if not name.startswith(("logs/", "benchmarks/"))}


@pytest.mark.parametrize("seed", [0])
def test_three_kills_leave_the_same_bytes(tiny_run, tmp_path, seed):
    """As an undisturbed run has, and nothing of theirs stays."""
    chance, project = random.Random(seed), Project(tmp_path / "killed")
    for jobs in (1, 3, 2):
        killed(project, jobs, chance.uniform(0.0, 2.0))
        project.snakemake("--unlock", *TINY)
    project.snakemake("--cores", 2, "--rerun-incomplete", *TINY, "--", *TARGETS)
    undisturbed, found = left(tiny_run.folder / "results/tiny"), left(project.folder / "results/tiny")
    assert {target.removeprefix("results/tiny/") for target in TARGETS} <= found.keys()
    assert [name for name, content in found.items() if content != undisturbed.get(name)] == []
    assert left(project.folder, "*.part") == {}
