"""Rule figure_coverage."""

import pandas as pd

from modlhmp.logs import job_log
from modlhmp.study.exhibits.coverage import draw

with job_log(snakemake.log[0]):
    results = pd.read_csv(snakemake.input.results)
    draw(results, snakemake.params.datasets, snakemake.params.methods, snakemake.output.csv.removesuffix(".csv"))
