"""Rule figure_one_location."""

from modlhmp.logs import job_log
from modlhmp.study.exhibits.one_location import draw

with job_log(snakemake.log[0]):
    draw(*snakemake.input.maps, snakemake.params.dataset, snakemake.output.csv.removesuffix(".csv"))
