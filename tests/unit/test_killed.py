"""Jobs that the system kills, where memory runs out, are told apart from those that fail."""

import pytest

from modlhmp.study.killed import killed_jobs

LOG = """[Thu Nov 26 22:03:52 2026]
rule first:
    output: b.txt
    jobid: 2
    resources: tmpdir=/tmp, mem_mb=700, mem=700 MB, mem_mib=668

[Thu Nov 26 22:03:52 2026]
localrule climb:
    output: a.txt
    jobid: 1
    reason: Missing output files: a.txt
    resources: tmpdir=/tmp, mem_mb=500, mem=500 MB, mem_mib=477
RuleException:
CalledProcessError in file "Snakefile", line 6:
Command 'set -euo pipefail;  .venv/bin/python tmpccurl5h7.s.py' {how}.
[Thu Nov 26 22:03:54 2026]
Error in rule climb:
    message: None
    jobid: 1
    output: a.txt
Shutting down, this might take some time.
"""


@pytest.mark.parametrize(
    "how", ["died with <Signals.SIGKILL: 9>", "returned non-zero exit status 137", "returned non-zero exit status -9"]
)
def test_a_killed_job_is_named_with_the_memory_it_needs(tmp_path, how):
    (tmp_path / "log").write_text(LOG.format(how=how))
    for logs in (tmp_path / "log", [str(tmp_path / "log")]):
        (told,) = killed_jobs(logs)
        assert told.startswith("A job of rule climb was killed (signal 9)")
        assert "up to 500 MB" in told
        assert "--cores 1" in told


@pytest.mark.parametrize("how", ["returned non-zero exit status 1", "died with <Signals.SIGINT: 2>"])
def test_a_job_that_failed_or_was_interrupted_is_not(tmp_path, how):
    (tmp_path / "log").write_text(LOG.format(how=how))
    assert killed_jobs([tmp_path / "log", tmp_path / "missing"]) == []
