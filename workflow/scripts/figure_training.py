"""Rule figure_training."""

from modlhmp.logs import job_log
from modlhmp.study.exhibits.training_share import draw

with job_log(snakemake.log[0]):
    params, stem = snakemake.params, snakemake.output.csv.removesuffix(".csv")
    draw(list(snakemake.input), params.datasets, params.titles, params.horizons, stem)
