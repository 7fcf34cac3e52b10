"""Rule figure_prediction_examples."""

from modlhmp.logs import job_log
from modlhmp.paper.example_forecasts import draw

with job_log(snakemake.log[0]):
    params = snakemake.params
    draw(params.folder, params.datasets, params.methods, snakemake.output.csv.removesuffix(".csv"))
