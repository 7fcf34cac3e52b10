"""Rule figure_calibration."""

from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.study.exhibits.calibration import draw

with job_log(snakemake.log[0]):
    params, folder = snakemake.params, Path(snakemake.input[0]).parents[2]  # results/{run}
    draw(folder, params.datasets, params.methods, params.measured, snakemake.output.csv.removesuffix(".csv"))
