"""Prints a run's jobs as JSON instead of drawing its rules: what each needs, its code's modules, its priority.

    python job_graph.py SNAKEMAKE_ARGUMENTS

Each job is [rule, wildcards, modules, numbers of the jobs that it needs, priority].
"""

import json
import sys

from snakemake import cli, dag

from modlhmp.study import versions


def jobs_of(graph):
    """Takes the place of `DAG.rule_dot`."""
    jobs = list(graph.jobs)
    number = {job: place for place, job in enumerate(jobs)}
    listed = [
        [
            job.rule.name,
            job.wildcards_dict,
            job.params.get("code", "").split(),
            [number[one] for one in graph.dependencies[job]],
            job.rule.priority,
        ]
        for job in jobs
    ]
    return json.dumps(listed)


if __name__ == "__main__":
    versions.code_version = lambda script, *modules: " ".join(sorted(versions.modules_of(script, *modules)))
    dag.DAG.rule_dot = jobs_of
    cli.main(["--rulegraph", *sys.argv[1:]])
