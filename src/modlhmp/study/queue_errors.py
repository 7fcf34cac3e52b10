"""What to change in a cluster's profile, by what Slurm and the jobs in its queue have said: `docs/clusters.md`."""

import re
import shutil
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from modlhmp.storage import DataError

# What stands in the log of a run, or in that of one of its jobs, and the remedy; `profiles/slurm/config.yaml` has the
# keys that are named.
_REMEDIES = {
    r"invalid partition specified|[Ii]nvalid partition name": "There is no such partition: `slurm_partition`, under "
    "`default-resources`, has to be one of those that `sinfo` lists.",
    r"[Ii]nvalid account|account \S+ appears to be invalid": "The account may not be charged: `slurm_account`, under "
    "`default-resources`, has to be one of `sacctmgr show associations user=$USER`; `none` where the cluster has none.",
    r"Requested time limit is invalid": "A job asks for more minutes than its partition allows: another "
    "`slurm_partition`, fewer parts of a group in one job (`group-components`), or less `runtime` for a rule: "
    "`set-resources: {RULE: {runtime: MINUTES}}`.",
    r"Memory specification can not be satisfied|Requested node configuration is not available": "No node of the "
    "partition is as large as a job asks for: lower `cores` and `resources: mem_mb`, what a job may have at most, or "
    "name another `slurm_partition`.",
    r"SLURM status is: 'TIMEOUT'|DUE TO TIME LIMIT": "A job came to its time limit: more `runtime` for its rule, "
    "`set-resources: {RULE: {runtime: MINUTES}}`. What is finished is kept; a training goes on where it was.",
    r"SLURM status is: 'OUT_OF_MEMORY'|oom.kill|Exceeded job memory limit": "A job came to its memory limit: more "
    "`mem_mb` for its rule, `set-resources: {RULE: {mem_mb: MEGABYTES}}`, and `resources: mem_mb`, the most of a job, "
    "at least as large.",
    r"No space left on device|Disk quota exceeded|errno 28\b": "A disk is full: where it is the node's scratch, name "
    "another in `default-resources: {tmpdir: FOLDER}`; results need room in the run's folder.",
    r"No module named '?(?:modlhmp|snakemake)|(?:python\S*|snakemake): (?:command not found|No such file)|"
    r"SLURM status is: 'NODE_FAIL'": "A node failed or lacks the package: environment (`.venv`) and folder of the run "
    "have to lie on a disk that every node sees; `default-resources: {constraint: FEATURE}`, or `slurm-exclude-failed-"
    "nodes: NODE,NODE`, keeps jobs off nodes that do not.",
}  # fmt: skip

# Resources of a job, and the options of `sbatch` that ask for them.
_OPTIONS = {
    "slurm_partition": "partition", "slurm_account": "account", "qos": "qos", "constraint": "constraint",
    "mem_mb": "mem", "runtime": "time", "_cores": "cpus-per-task", "gres": "gres",
}  # fmt: skip


def remedies(logs: str | Path | Iterable[str | Path]) -> list[str]:
    """What to change in the profile, from the log of a run, or its logs; nothing where they say nothing of a queue."""
    files = [logs] if isinstance(logs, str | Path) else list(logs)
    text = "\n".join(Path(file).read_text(errors="replace") for file in files if Path(file).is_file())
    return _answers(text) if "SLURM run ID" in text else []


def check_queue(asked: Iterable[Mapping[str, Any]]) -> None:
    """`DataError` where Slurm would refuse a job, each given by the resources that it asks for.

    It is asked before the first is submitted: Snakemake keeps what `sbatch` says of a group to itself.
    """
    options = {tuple(f"--{_OPTIONS[key]}={one[key]}" for key in _OPTIONS if one.get(key) is not None) for one in asked}
    for option in sorted(options):
        command = ["sbatch", "--test-only", "--wrap=true", *option]
        told = subprocess.run(command, capture_output=True, text=True, check=False)
        answers = _answers(told.stderr) if told.returncode else []
        if answers:
            said = told.stderr.strip().splitlines()[-1]
            raise DataError(f"Slurm would refuse a job of {' '.join(option)}: {said}\n" + "\n".join(answers))


def check_status_command(command: str | None) -> None:
    """`DataError` where Slurm is asked for jobs by `sacct` and keeps no accounts: the run would wait for ever."""
    if command != "sacct" or not shutil.which("sacct"):
        return
    told = subprocess.run(["sacct", "--noheader"], capture_output=True, text=True, check=False)
    if told.returncode:
        raise DataError(
            f"profile, slurm-status-command: sacct says {(told.stderr or told.stdout).strip()!r}, and would never tell "
            "that a job has ended: set squeue"
        )


def _answers(text: str) -> list[str]:
    return [remedy for said, remedy in _REMEDIES.items() if re.search(said, text)]
