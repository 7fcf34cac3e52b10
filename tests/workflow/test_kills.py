"""A run that is killed goes on to the same bytes."""

import os
import random
import signal
import subprocess
import sys

import pytest
from project import Project

from modlhmp.study.certificate import outputs
from modlhmp.study.layout import Layout

TINY = ("--configfile", "config/tiny.yaml")
TARGETS = [f"results/tiny/demo_hall/errors/{method}.parquet" for method in ("tc_cliff", "snippets", "cvm")]


def killed(project, targets, jobs, after_s):
    """A run of some targets of which every process is killed so many seconds after so many jobs have ended."""
    command = [sys.executable, "-m", "snakemake", "--cores", "2", "--rerun-incomplete", *TINY, "--", *targets]
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


@pytest.mark.parametrize(
    ("kills", "targets"), [(3, TARGETS), pytest.param(50, ["all"], marks=pytest.mark.torture)], ids=["few", "all"]
)
def test_kills_leave_the_same_bytes(tiny_run, tmp_path, kills, targets):
    """As an undisturbed run has, and nothing of theirs stays."""
    chance, project = random.Random(kills), Project(tmp_path / "killed")
    for _ in range(kills):
        killed(project, targets, chance.randint(1, 4), chance.uniform(0.0, 2.0))
        project.snakemake("--unlock", *TINY)
    project.snakemake("--cores", 2, "--rerun-incomplete", *TINY, "--", *targets)
    undisturbed, found = (outputs(Layout("tiny", str(one.folder))) for one in (tiny_run, project))
    assert {name for name, digest in found.items() if digest != undisturbed.get(name)} == set()
    assert found.keys() >= {target.replace("results/tiny", "results") for target in TARGETS}
    assert targets != ["all"] or found.keys() == undisturbed.keys()
    assert list(project.folder.rglob("*.part")) == []
