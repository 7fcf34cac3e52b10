"""Rule gather."""

from modlhmp.logs import job_log
from modlhmp.storage import read_parquet
from modlhmp.study.sites import write_sites

with job_log(snakemake.log[0]) as log:
    params = snakemake.params
    files = zip(params.sites, snakemake.input, strict=True)
    found = {site: read_parquet(file).to_pandas() for site, file in files}
    write_sites(found, params.reference, params.folder, params.demo)
    log.info("%d sites", len(found))
