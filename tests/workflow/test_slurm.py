"""The workflow as jobs of a real Slurm, of one node and for this test alone: `tests/cluster/slurm.sh`."""

import os
import shutil
import signal
import subprocess
import sys
import time
from importlib.util import find_spec

import pytest
from project import ROOT

from modlhmp.study.certificate import outputs
from modlhmp.study.layout import Layout

LACKS = 77  # status of slurm.sh where the programs cannot be had
WAIT_S = 220  # for the short form, which has four minutes
FEW = [f"results/tiny/demo_forum/errors/{method}.parquet" for method in ("tc_cliff", "lstm")]

pytestmark = pytest.mark.skipif(
    find_spec("snakemake_executor_plugin_slurm") is None, reason="the extra `cluster` is not installed"
)


def beside_slurm(project, command, wait_s):
    """Everything that a command prints beside a Slurm, and its status; the test is skipped where there is none."""
    with subprocess.Popen(
        ["timeout", "--signal=TERM", "--kill-after=15", str(wait_s), ROOT / "tests/cluster/slurm.sh", *command],
        cwd=project.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
    ) as run:  # fmt: skip
        try:
            printed, _ = run.communicate(timeout=wait_s + 30)
        finally:
            if run.poll() is None:
                os.killpg(run.pid, signal.SIGKILL)
    if run.returncode == LACKS:
        pytest.skip(f"no Slurm: {printed.strip()}")
    return printed, run.returncode


def snakemake(*arguments):
    return [
        *(sys.executable, "-m", "snakemake", "--profile", "profiles/slurm", "--latency-wait", "5"),
        *("--slurm-init-seconds-before-status-checks", "2", "--configfile", "config/tiny.yaml", *arguments),
    ]


def same_bytes(tiny_run, project, files=()):
    """Every file of a run is that of the plain one; returns their names."""
    plain, found = (outputs(Layout("tiny", str(one.folder))) for one in (tiny_run, project))
    assert {name for name, digest in found.items() if digest != plain.get(name)} == set()
    assert set(found) >= {file.replace("results/tiny/", "results/") for file in files}
    return set(found)


def test_jobs_of_slurm_give_the_same_bytes(tiny_run, project):
    """Recordings, a map, a training, forecasts and errors: three jobs of the queue, in the order of their needs."""
    printed, status = beside_slurm(project, snakemake("--", *FEW), WAIT_S)
    assert status == 0, printed[-5000:]
    assert printed.count("has been submitted with SLURM jobid") == 3
    same_bytes(tiny_run, project, FEW)


def test_a_job_that_fails_shows_its_log_and_a_refused_one_the_key_to_change(project):
    """Too few tracks to train on, which the log says; a partition that is not there, which Slurm says."""
    (project.folder / "few.yaml").write_text("demo: {scale: 0.02}\n")
    fails = snakemake("--configfile", "config/tiny.yaml", "few.yaml", "--", "results/tiny/demo_hall/models/lstm.json")
    refused = snakemake("--default-resources", "slurm_partition=nowhere", "slurm_account=none", "--", *FEW)
    both = " ; ".join(" ".join(f"'{word}'" for word in command) for command in (fails, refused))
    printed, status = beside_slurm(project, ["bash", "-c", both], WAIT_S)
    assert status != 0
    assert "results/tiny/logs/train/demo_hall/lstm.log" in printed
    assert "too few to train on" in printed
    assert "`slurm_partition`, under `default-resources`, has to be one of those that `sinfo` lists" in printed


STOP = """
"$@" & run=$!
until squeue --noheader --states=RUNNING --format=%o%k | grep -q train; do sleep 1; done
sleep 8; "$SLURM_NODE" stop; echo stopped
until sinfo --noheader --states=down --format=%D | grep -q 1; do sleep 1; done
squeue --noheader --format='requeued: %k %T'
"$SLURM_NODE" start
wait $run
"""


@pytest.mark.full
def test_a_node_that_stops_and_the_whole_run_end_with_the_same_bytes(tiny_run, project):
    """In the middle of a training all processes of the node are killed; the job is queued again and goes on."""
    began = time.monotonic()
    printed, status = beside_slurm(project, ["bash", "-c", STOP, "bash", *snakemake("--", "certify")], 3600)
    assert status == 0, printed[-5000:]
    assert "stopped" in printed and "requeued: group_trainings" in printed
    assert same_bytes(tiny_run, project) == same_bytes(tiny_run, tiny_run)
    print(f"{time.monotonic() - began:.0f} s")


def test_nothing_is_left(tmp_path):
    """Neither a process nor a file, also where the command is killed in the middle."""
    if not shutil.which("apt-get"):
        pytest.skip("not Debian")
    run = subprocess.run(
        ["timeout", "--signal=TERM", "20", ROOT / "tests/cluster/slurm.sh", "sleep", "300"],
        env={**os.environ, "TMPDIR": str(tmp_path)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if run.returncode == LACKS:
        pytest.skip(f"no Slurm: {run.stderr.strip()}")
    assert list(tmp_path.iterdir()) == []
    told = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True).stdout
    assert str(tmp_path) not in told
