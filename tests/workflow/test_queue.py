"""What a cluster's queue gets: few jobs, which ask for no less than they need and for not much more."""

import csv

TINY = ("--configfile", "config/tiny.yaml")
MARGIN = 1.5  # of memory, over the largest that a job of the rule has taken
SNAKEMAKE_MB = 700  # of the two processes of Snakemake that a queue's job has beside it: 320 MB each
SLOWER = 3  # than here a node may be


def test_the_demo_is_a_few_jobs_of_the_queue(project):
    """Trainings and what times itself stay alone, and what only collects is not queued."""
    jobs = project.jobs()
    together = {}
    for job in jobs:
        together.setdefault(job.submitted, []).append(job.rule)
    assert together.pop(None) == ["all"]
    assert len(jobs) > 150
    assert len(together) <= 40
    alone = {rules[0] for rules in together.values() if len(rules) == 1}
    assert {rule.partition("_")[0] for rule in alone} == {"train", "measure"}
    assert {rule for rule in alone if not rule.startswith("train_")} == {"measure_costs"}
    assert not [rules for rules in together.values() if len(rules) > 1 and "measure_costs" in rules]


def test_jobs_ask_for_what_they_were_measured_to_need(tiny_run):
    """Every job of a run has a benchmark, and its rule's memory and time hold it with a margin."""
    jobs = [job for job in tiny_run.jobs(*TINY) if job.rule != "all"]
    assert [job.rule for job in jobs if not job.benchmark] == []
    short = {}
    for job in jobs:
        with (tiny_run.folder / job.benchmark).open() as file:
            (row,) = csv.DictReader(file, delimiter="\t")
        took_mb = 0.0 if row["max_rss"] in {"-", "NA"} else float(row["max_rss"])  # "-": over before the first look
        needs = round(MARGIN * took_mb + SNAKEMAKE_MB), round(SLOWER * float(row["s"]) / 60, 1)
        if needs[0] > job.memory or needs[1] > job.runtime:
            short[job.benchmark] = {"needs": needs, "asks": (job.memory, job.runtime)}
    assert short == {}
