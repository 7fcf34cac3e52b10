# Many sites: one run of the workflow for each, and one table across them with tests by site (docs/sweeps.md).
#
#     snakemake --snakefile workflow/sweep.smk --configfile sites.yaml --cores 2 --keep-going
#
# INPUTS   sites.yaml (an example: run this without one), dataset files and recordings of every site
# OUTPUTS  each site's run, results/<sweep>-<site>; paper_figures/sweeps/<sweep>/: sites.*, by_site.csv
# STEPS    site: a Snakemake within a job, which is one job of a cluster; gather, also of those that did not fail
import sys
from pathlib import Path

import pandas as pd
from snakemake.exceptions import WorkflowError
from snakemake.utils import min_version

from modlhmp.settings import as_plain
from modlhmp.storage import DataError
from modlhmp.study.exhibits.sites_table import write_sites
from modlhmp.study.sweep import load_sweep
from modlhmp.study.versions import project_version
from modlhmp.yaml_file import read_yaml

min_version("9.0")

ROOT = Path(workflow.current_basedir.get_path_or_uri(secret_free=True)).parent
CONFIGS = [
    str(next(filter(Path.exists, (Path(file), ROOT / file)), ROOT / file))
    for file in ("config/budgets.yaml", "config/config.yaml")
]

try:
    for file in map(str, workflow.overwrite_configfiles):
        read_yaml(file, "a list of sites")
    SWEEP = load_sweep(config, CONFIGS, ("config/datasets", ROOT / "config/datasets"))
    if workflow.is_main_process:  # jobs read their own site
        SWEEP.check()
except DataError as error:
    raise WorkflowError(f"\n{error}") from None


# As of workflow/Snakefile.
container: "docker://localhost/modlhmp"


wildcard_constraints:
    site="|".join(SWEEP.names),


def gathered():
    """The numbers of every site, or why it has none."""
    for site in SWEEP.names:
        numbers, log = SWEEP.numbers(site), SWEEP.log(site)
        failed = f"its run failed: {log}" if Path(log).exists() else "not run yet"
        yield site, pd.read_parquet(numbers) if Path(numbers).exists() else failed


def is_demo():
    return any(SWEEP.site(site).dataset.demo for site in SWEEP.names)


def write_gathered():
    """Write the table of what there is, and return why the other sites are not in it."""
    found = dict(gathered())
    write_sites(found, SWEEP.settings.reference, SWEEP.exhibits, is_demo())
    return {site: why for site, why in found.items() if isinstance(why, str)}


onerror:
    failed = write_gathered()
    for site, why in failed.items():
        print(f"site {site}: {why}", file=sys.stderr)
    print(
        f"{len(SWEEP.names) - len(failed)} of {len(SWEEP.names)} sites are in {SWEEP.exhibits}/sites.md; the same "
        "command runs the others again.",
        file=sys.stderr,
    )


rule sweep:
    """All sites, and the table: also where the table of those that did not fail is there already."""
    default_target: True
    input:
        [SWEEP.numbers(site) for site in SWEEP.names],
        f"{SWEEP.exhibits}/sites.csv",


rule gather:
    """One table across all sites."""
    input:
        [SWEEP.numbers(site) for site in SWEEP.names],
    output:
        multiext(f"{SWEEP.exhibits}/sites", ".csv", ".md", ".html", ".tex"),
        f"{SWEEP.exhibits}/by_site.csv",
    log:
        SWEEP.log("gather.sites"),
    resources:
        mem_mb=500,
        runtime=10,
    params:
        sites=SWEEP.names,
        reference=SWEEP.settings.reference,
        demo=lambda wildcards: is_demo(),  # asked of all sites, so not by jobs of one
        code=project_version(ROOT),
    message:
        "The table across {SWEEP.settings.sweep}'s sites"
    script:
        "scripts/gather_sites.py"


rule site:
    """The run of a site."""
    input:
        lambda wildcards: SWEEP.files(wildcards.site),
    output:
        SWEEP.numbers("{site}"),
    log:
        run=SWEEP.log("{site}"),
        job=SWEEP.log("{site}.job"),
    threads: 1
    resources:
        mem_mb=3000,
        runtime=240,
    params:
        configuration=lambda wildcards: SWEEP.site(wildcards.site).configuration,
        run=lambda wildcards: as_plain(SWEEP.site(wildcards.site).plan.run),  # with what is in the default files
        written=lambda wildcards: SWEEP.configuration(wildcards.site),
        horizons=lambda wildcards: [
            seconds
            for each in SWEEP.site(wildcards.site).plan.horizons.values()
            for seconds in each
        ],
        reference=SWEEP.settings.reference,
        targets=list(SWEEP.settings.targets),
        root=str(ROOT),
        code=project_version(ROOT),
    message:
        "Site {wildcards.site}"
    script:
        "scripts/run_site.py"
