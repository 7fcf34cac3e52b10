"""Rule table_uncertainty."""

from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.study.exhibits.uncertainty_table import write

with job_log(snakemake.log[0]):
    params, folder = snakemake.params, Path(snakemake.input[0]).parents[2]  # results/{run}
    write(folder, params.datasets, params.methods, snakemake.output.csv.removesuffix(".csv"))
