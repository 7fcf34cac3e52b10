"""Rule table_results."""

import pandas as pd

from modlhmp.logs import job_log
from modlhmp.study.exhibits.tables import write_results

with job_log(snakemake.log[0]):
    results = pd.read_csv(snakemake.input.results)
    params, stem = snakemake.params, snakemake.output.csv.removesuffix(".csv")
    write_results(results, params.datasets, params.methods, params.horizons, stem)
