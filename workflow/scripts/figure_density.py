"""Rule figure_density."""

from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.study.exhibits.density_maps import draw

with job_log(snakemake.log[0]):
    params, folder = snakemake.params, Path(snakemake.input[0]).parents[2]  # results/{run}
    draw(
        folder, params.datasets, params.methods, params.shown, params.forecast_by, params.samples, params.seed,
        snakemake.output.csv.removesuffix(".csv"),
    )  # fmt: skip
