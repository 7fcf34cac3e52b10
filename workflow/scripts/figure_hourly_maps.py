"""Rule figure_hourly_maps."""

from modlhmp.logs import job_log
from modlhmp.paper.hourly_maps import draw

with job_log(snakemake.log[0]):
    draw(snakemake.input.maps, snakemake.params.dataset, snakemake.output.csv.removesuffix(".csv"))
