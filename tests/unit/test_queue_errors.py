"""What Slurm refuses and ends is answered with the profile's key that helps."""

import pytest

from modlhmp.storage import DataError
from modlhmp.study.queue_errors import check_queue, check_status_command, remedies

STARTED = "SLURM run ID: 5a85b8b3\n"
REFUSED = "SLURM sbatch failed. The error message was 'sbatch: error: Batch job submission failed: {}'."
FAILED = "SLURM-job '12' failed, SLURM status is: '{}'. Detailed failure reason unavailable"


@pytest.mark.parametrize(
    ("said", "key"),
    [
        (REFUSED.format("Invalid account or account/partition combination specified"), "slurm_account"),
        ("The given account me appears to be invalid. Available accounts:", "slurm_account"),
        ("sbatch: error: invalid partition specified: nowhere\n" + REFUSED.format("Invalid partition name specified"),
         "slurm_partition"),
        (REFUSED.format("Requested time limit is invalid (missing or exceeds some limit)"), "runtime: MINUTES"),
        (REFUSED.format("Memory specification can not be satisfied"), "resources: mem_mb"),
        (REFUSED.format("Requested node configuration is not available"), "resources: mem_mb"),
        (FAILED.format("TIMEOUT"), "runtime: MINUTES"),
        (FAILED.format("OUT_OF_MEMORY"), "mem_mb: MEGABYTES"),
        ("OSError: [Errno 28] No space left on device: '/scratch/a.part'", "tmpdir"),
        ("ModuleNotFoundError: No module named 'modlhmp'", "every node sees"),
        ("/bin/sh: 1: /opt/.venv/bin/python: No such file or directory", "every node sees"),
        (FAILED.format("NODE_FAIL"), "every node sees"),
    ],
)  # fmt: skip
def test_the_remedy_names_the_key(tmp_path, said, key):
    (tmp_path / "log").write_text(STARTED + said)
    (told,) = remedies([tmp_path / "log", tmp_path / "missing"])
    assert key in told


@pytest.mark.parametrize("said", [STARTED + FAILED.format("FAILED"), FAILED.format("TIMEOUT")])
def test_a_plain_failure_and_a_run_without_a_queue_need_none(tmp_path, said):
    (tmp_path / "log").write_text(said)
    assert remedies(tmp_path / "log") == []


@pytest.mark.parametrize(("accounts", "command"), [(True, "sacct"), (False, "squeue"), (False, None)])
def test_accounts_are_asked_for_only_where_they_are_needed(tmp_path, monkeypatch, accounts, command):
    sacct(tmp_path, monkeypatch, accounts)
    check_status_command(command)


def test_a_cluster_without_accounts_is_told_before_the_first_job(tmp_path, monkeypatch):
    sacct(tmp_path, monkeypatch, accounts=False)
    with pytest.raises(DataError, match=r"slurm-status-command: sacct says 'Slurm .* disabled'.*: set squeue"):
        check_status_command("sacct")


ASKED = {"slurm_partition": "main", "slurm_account": "none", "mem_mb": 3000, "runtime": 90, "_cores": 2, "tmpdir": "/t"}


@pytest.mark.parametrize(
    ("said", "key"),
    [("Requested time limit is invalid (missing or exceeds some limit)", "group-components"),
     ("Requested node configuration is not available", "`cores`"),
     ("Invalid account or account/partition combination specified", "slurm_account")],
)  # fmt: skip
def test_slurm_is_asked_for_every_job_before_the_first(tmp_path, monkeypatch, said, key):
    """With the job's own numbers; what it says of one that it would refuse is answered."""
    refused = f'case "$*" in *--mem=9*) echo "allocation failure: {said}" >&2; exit 1;; esac'
    command(tmp_path, monkeypatch, "sbatch", f'echo "$@" >> {tmp_path}/asked\n{refused}\n')
    check_queue([ASKED, ASKED])
    options = "--test-only --wrap=true --partition=main --account=none --mem=3000 --time=90 --cpus-per-task=2"
    assert (tmp_path / "asked").read_text() == options + "\n"
    with pytest.raises(DataError, match="--mem=9000") as told:
        check_queue([ASKED, ASKED | {"mem_mb": 9000}])
    assert said in str(told.value) and key in str(told.value)


def test_a_queue_that_cannot_say_is_not_in_the_way(tmp_path, monkeypatch):
    """Nodes that are down today are no fault of the profile."""
    command(tmp_path, monkeypatch, "sbatch", "echo allocation failure: Required node not available >&2; exit 1\n")
    check_queue([ASKED])


def sacct(folder, monkeypatch, accounts):
    """A command of this name, of a cluster with accounts or without."""
    command(folder, monkeypatch, "sacct", "" if accounts else "echo Slurm accounting storage is disabled >&2; exit 1\n")


def command(folder, monkeypatch, name, script):
    """A shell script as a command of this name."""
    program = folder / name
    program.write_text(f"#!/bin/sh\n{script}")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
