"""Snakemake's lock: stale where the run that took it was killed, not where one is at work."""

import os
import subprocess
import sys

import pytest

from modlhmp.storage import DataError
from modlhmp.study import running

HOLD = """
import fcntl, sys, time
lock = open(sys.argv[1], "a")
fcntl.flock(lock, fcntl.LOCK_SH)
print("held", flush=True)
time.sleep(600)
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with a lock of Snakemake's."""
    (tmp_path / ".snakemake/locks").mkdir(parents=True)
    (tmp_path / ".snakemake/locks/0.input.lock").write_text("a\n")
    yield tmp_path
    running.leave()


def test_a_lock_that_nobody_is_left_of_is_stale(folder):
    assert "is stale" in running.join(folder)
    running.leave()
    assert "was stale" in running.unlock(folder)
    assert not (folder / ".snakemake/locks").exists()
    assert "is not locked" in running.unlock(folder)
    assert running.join(folder) == ""


def test_a_run_at_work_is_not_unlocked(folder):
    assert "is stale" in running.join(folder)
    with pytest.raises(DataError, match=rf"A run is at work \(process {os.getpid()}\) in .*: nothing was unlocked"):
        running.unlock(folder)
    assert (folder / ".snakemake/locks/0.input.lock").exists()


@pytest.mark.parametrize("others", [1, 2])
def test_a_killed_run_is_not_at_work(folder, others):
    """Also one of whose jobs another process is left, once that has ended."""
    command = [sys.executable, "-S", "-c", HOLD, str(folder / ".snakemake/modlhmp.lock")]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(others)]
    for process in processes:
        assert process.stdout.readline() == "held\n"
    for process in processes:
        told = running.join(folder)
        assert "its lock is not stale" in told
        assert str(process.pid) in told
        running.leave()
        with pytest.raises(DataError, match=str(process.pid)):
            running.unlock(folder)
        process.kill()
        process.communicate()
    assert "was stale" in running.unlock(folder)


def test_a_folder_that_may_not_be_written_to_has_no_lock(tmp_path):
    (tmp_path / ".snakemake").write_text("")
    assert running.join(tmp_path) == ""
    assert "is not locked" in running.unlock(tmp_path)
