"""Rule figure_parameters."""

from modlhmp.logs import job_log
from modlhmp.study.exhibits.parameter_study import draw

with job_log(snakemake.log[0]):
    params, stem = snakemake.params, snakemake.output.csv.removesuffix(".csv")
    draw(list(snakemake.input), params.dataset, params.method, params.chosen, params.horizons, stem)
