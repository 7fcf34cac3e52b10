"""Rule gather."""

from pathlib import Path

import pandas as pd

from modlhmp.logs import job_log
from modlhmp.study.exhibits.sites_table import write_sites

params = snakemake.params
with job_log(snakemake.log[0]):
    found = {site: pd.read_parquet(file) for site, file in zip(params.sites, snakemake.input, strict=True)}
    write_sites(found, params.reference, str(Path(snakemake.output[0]).parent), params.demo)
