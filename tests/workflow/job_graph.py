"""Prints a run's jobs as JSON instead of drawing its rules: what each needs, and of which modules its code is.

    python job_graph.py SNAKEMAKE_ARGUMENTS

Each job is [rule, wildcards, modules, numbers of the jobs that it needs].
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
        [job.rule.name, job.wildcards_dict, job.params.get("code", "").split(), [number[one] for one in needed]]
        for job, needed in ((job, graph.dependencies[job]) for job in jobs)
    ]
    return json.dumps(listed)


if __name__ == "__main__":
    versions.code_version = lambda script, *modules: " ".join(sorted(versions.modules_of(script, *modules)))
    dag.DAG.rule_dot = jobs_of
    cli.main(["--rulegraph", *sys.argv[1:]])
