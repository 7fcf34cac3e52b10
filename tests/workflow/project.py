"""A copy of the workflow in a temporary folder, and Snakemake run in it as a user would."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]


class Job(NamedTuple):
    """A job that is planned: its rule and wildcards, the modules of its code, numbers of the jobs it needs, priority.

    `submitted` numbers what a queue gets, which may be a group of jobs; None where none does. Memory is in MB, the
    runtime in minutes.
    """

    rule: str
    wildcards: dict[str, str]
    modules: frozenset[str]
    needs: list[int]
    priority: int
    submitted: int | None
    benchmark: str | None
    memory: int
    runtime: int


def rerun_after(jobs, module):
    """Numbers of the jobs whose code depends on a module, and of all behind them."""
    found = {number for number, job in enumerate(jobs) if module in job.modules}
    while more := {n for n, job in enumerate(jobs) if n not in found and found & set(job.needs)}:
        found |= more
    return found


def planned(output):
    """Jobs of each rule in a dry run's table."""
    lines = output.split("Job stats:")[-1].split("total")[0].splitlines()[3:] if "Job stats:" in output else []
    return {line.split()[0]: int(line.split()[1]) for line in lines if line.strip()}


class Project:
    """Snakefile, workflow, config and profiles under `folder`; the package is the installed one."""

    def __init__(self, folder):
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("workflow", "config", "profiles"):
            shutil.copytree(ROOT / name, folder / name)
        shutil.copy(ROOT / "Snakefile", folder)

    def snakemake(self, *arguments, fails=False, **environment):
        """Run Snakemake here; returns everything it printed."""
        return self._run(["-m", "snakemake", *map(str, arguments)], fails, environment)

    def jobs(self, *arguments):
        """Every job of a run, without a dry run's look at what is there: `Job`s."""
        printed = self._run([ROOT / "tests/workflow/job_graph.py", *arguments], False, {})
        listed = json.loads(next(line for line in printed.splitlines() if line.startswith("[[")))
        return [Job(rule, wildcards, frozenset(modules), *rest) for rule, wildcards, modules, *rest in listed]

    def _run(self, command, fails, environment):
        inherited = {key: value for key, value in os.environ.items() if key != "MODLHMP_DATA"}
        done = subprocess.run(
            [sys.executable, *command],
            cwd=self.folder,
            env={**inherited, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=900,
            check=False,
        )
        assert (done.returncode != 0) == fails, done.stdout[-5000:]
        return done.stdout
