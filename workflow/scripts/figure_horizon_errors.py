"""Rule figure_horizon_errors."""

import pandas as pd

from modlhmp.logs import job_log
from modlhmp.study.exhibits.horizon_errors import draw

with job_log(snakemake.log[0]):
    results = pd.read_csv(snakemake.input.results)
    stem = snakemake.output.csv.removesuffix(".csv")
    draw(results, snakemake.params.dataset, snakemake.params.methods, stem)
