"""Rule figure_ranked_forecasts."""

from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.study.exhibits.ranked_forecasts import draw

with job_log(snakemake.log[0]):
    params, folder = snakemake.params, Path(snakemake.input[0]).parents[2]  # results/{run}
    draw(folder, params.datasets, params.methods, snakemake.output.csv.removesuffix(".csv"))
