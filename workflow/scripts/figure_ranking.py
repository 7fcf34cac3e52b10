"""Rule figure_ranking."""

import pandas as pd

from modlhmp.logs import job_log
from modlhmp.study.exhibits.ranking_gain import draw

with job_log(snakemake.log[0]):
    results = pd.read_csv(snakemake.input.results)
    stem = snakemake.output.csv.removesuffix(".csv")
    draw(results, snakemake.params.datasets, "tc_cliff", snakemake.params.title, stem)
