"""What Slurm refuses and ends is answered with the profile's key that helps."""

import pytest

from modlhmp.storage import DataError
from modlhmp.study.queue_errors import check_status_command, remedies

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


def sacct(folder, monkeypatch, accounts):
    """A command of this name, of a cluster with accounts or without."""
    program = folder / "sacct"
    program.write_text("#!/bin/sh\n" + ("" if accounts else "echo Slurm accounting storage is disabled >&2; exit 1\n"))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
