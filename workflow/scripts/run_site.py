"""Rule site."""

import subprocess
import sys

import pandas as pd
import pyarrow as pa
import yaml

from modlhmp.logs import job_log
from modlhmp.origins import provenance
from modlhmp.storage import DataError, write_parquet, write_text
from modlhmp.study.layout import Layout
from modlhmp.study.sites import site_rows
from modlhmp.study.summary import read_scores

params, site = snakemake.params, snakemake.wildcards.site
with job_log(snakemake.log.job) as log:
    layout, (dataset,) = Layout(params.configuration["run"]), params.configuration["datasets"]
    write_text(params.written, yaml.safe_dump(params.configuration, sort_keys=False, allow_unicode=True))
    log.info("the run %s, configured by %s", layout.run, params.written)
    # No lock: no other site has these files, and the sweep runs each site once at a time.
    command = [
        *(sys.executable, "-m", "snakemake", "--snakefile", f"{params.root}/Snakefile", "--nolock"),
        *("--executor", "local", "--cores", str(snakemake.threads), "--configfile", params.written, "--"),
        *(layout.scores, layout.ttests(dataset), *params.targets),
    ]
    with open(snakemake.log.run, "w") as output:
        done = subprocess.run(command, stdout=output, stderr=subprocess.STDOUT, check=False)
    if done.returncode:
        raise DataError(f"site {site}: its run failed (status {done.returncode}): {snakemake.log.run}")
    tests = pd.read_parquet(layout.ttests(dataset))
    rows = site_rows(site, read_scores(layout.scores), tests, params.reference, params.horizons)
    origin = provenance(dict(snakemake.wildcards), dict(params), snakemake.input)
    write_parquet(pa.Table.from_pandas(rows, preserve_index=False), snakemake.output[0], **origin)
