"""Rule figure_runtime."""

import json
from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.study.exhibits.runtime_figure import draw

with job_log(snakemake.log[0]):
    measured = [json.loads(Path(file).read_text()) for file in snakemake.input]
    stem = snakemake.output.csv.removesuffix(".csv")
    draw(measured, snakemake.params.datasets, snakemake.params.method, stem)
