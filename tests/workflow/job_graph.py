"""Prints a run's jobs as JSON instead of drawing its rules: what each needs, its code's modules, its priority.

    python job_graph.py SNAKEMAKE_ARGUMENTS

Each job is [rule, wildcards, modules, numbers of the jobs that it needs, priority, a number for what profiles/slurm
submits it in (a group of jobs or it alone; None for what stays where Snakemake runs), its benchmark, mem_mb, runtime].
"""

import json
import sys
from pathlib import Path

import yaml
from snakemake import cli, dag, workflow
from snakemake.settings.types import ExecutionSettings, GroupSettings

from modlhmp.study import versions

PROFILE = "profiles/slurm/config.yaml"


def jobs_of(graph):
    """Takes the place of `DAG.rule_dot`."""
    jobs = list(graph.jobs)
    number = {job: place for place, job in enumerate(jobs)}
    components = dict(one.split("=") for one in yaml.safe_load(Path(PROFILE).read_text())["group-components"])
    graph.workflow.group_settings = GroupSettings(group_components={key: int(one) for key, one in components.items()})
    graph.workflow.execution_settings = ExecutionSettings()
    graph.update_groups()
    groups = {}
    for job in jobs:
        if not graph.workflow.is_local(job.rule):
            groups.setdefault(graph.get_job_group(job) or job, len(groups))
    listed = [
        [job.rule.name, job.wildcards_dict, job.params.get("code", "").split(), [number[one] for one in needed],
         job.rule.priority, groups.get(graph.get_job_group(job) or job), job.benchmark and str(job.benchmark),
         *(job.resources.get(name) for name in ("mem_mb", "runtime"))]
        for job, needed in ((job, graph.dependencies[job]) for job in jobs)
    ]  # fmt: skip
    return json.dumps(listed)


if __name__ == "__main__":
    versions.code_version = lambda script, *modules: " ".join(sorted(versions.modules_of(script, *modules)))
    dag.DAG.rule_dot = jobs_of
    workflow.Workflow.local_exec = property(lambda run: False)  # groups count, although nothing is submitted
    cli.main(["--rulegraph", *sys.argv[1:]])
