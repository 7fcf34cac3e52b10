"""How Snakemake goes about the jobs of a local run."""


def test_ready_jobs_are_looked_at_once_for_each_that_ends(project):
    """And not again every second for each of them, which costs more than the jobs in a run of hundreds."""
    files = [f"resources/demo/demo/hall/atc-203010{day}.csv" for day in ("02", "06", "09", "13")]
    larger = ("--config", "demo={scale: 2.0}")  # a second and more a job
    printed = project.snakemake("--cores", 1, "--verbose", *larger, "--", *files)
    assert printed.count("Ready jobs: ") == len(files)
