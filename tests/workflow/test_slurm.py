"""The workflow as jobs of a real Slurm, of one node and for this test alone: `tests/cluster/slurm.sh`."""

import os
import re
import shutil
import signal
import subprocess
import sys
from importlib.util import find_spec

import pytest
from project import ROOT, Project

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
log=results/tiny/logs/train/demo_forum/lstm.log
await() { until eval "$1" 2>/dev/null; do kill -0 $run || exit 1; sleep 0.2; done; }
"$@" & run=$!
await "grep -q 'epoch 3 ' $log"
scontrol requeue $(squeue --noheader --states=RUNNING --format=%i)
await "grep -q 'continues after' $log && grep -q 'epoch 8 ' $log"
grep continues $log
"$SLURM_NODE" stop
await "sinfo --noheader --states=down --format=%D | grep -q 1"
squeue --noheader --format='queued again: %k'
"$SLURM_NODE" start
wait $run && grep continues $log
"""


@pytest.mark.full
def test_a_training_that_gives_way_and_loses_its_node_ends_with_the_same_weights(tiny_run, tmp_path):
    """It is put back into the queue, as preemption does, and later all processes of its node are killed."""
    plain, project = Project(tmp_path / "plain"), Project(tmp_path / "slurm")
    for one in (plain, project):
        shutil.copytree(
            tiny_run.folder / "results/tiny/demo_forum/tracks", one.folder / "results/tiny/demo_forum/tracks"
        )
        shutil.copytree(tiny_run.folder / "resources", one.folder / "resources")
        (one.folder / "long.yaml").write_text("budgets: {demo: {lstm: {windows: 40000}}}\n")
    wanted = ("--configfile", "config/tiny.yaml", "long.yaml", "--", "results/tiny/demo_forum/models/lstm.json")
    plain.snakemake("--cores", 1, *wanted)
    printed, status = beside_slurm(project, ["bash", "-c", STOP, "bash", *snakemake(*wanted)], 1500)
    assert status == 0, printed[-5000:]
    assert re.search("queued again: .*trainings", printed)
    assert len(set(re.findall(r"continues after epoch (\d+)", printed))) == 2
    for name in ("lstm.safetensors", "lstm.last.safetensors"):
        file = f"results/tiny/demo_forum/models/{name}"
        assert (project.folder / file).read_bytes() == (plain.folder / file).read_bytes()


@pytest.mark.full
def test_the_whole_run_gives_the_same_bytes(tiny_run, project):
    """Every result, table and figure of the tiny demo."""
    printed, status = beside_slurm(project, snakemake("--", "certify"), 3600)
    assert status == 0, printed[-5000:]
    assert same_bytes(tiny_run, project) == set(outputs(Layout("tiny", str(tiny_run.folder))))


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
