"""Rule figure_stef_hours."""

from modlhmp.logs import job_log
from modlhmp.study.exhibits.stef_hours import draw

with job_log(snakemake.log[0]):
    draw(snakemake.input.maps[0], snakemake.params.dataset, snakemake.output.csv.removesuffix(".csv"))
