"""Rule figure_mod_comparison."""

from modlhmp.logs import job_log
from modlhmp.study.exhibits.mod_comparison import draw

with job_log(snakemake.log[0]):
    draw(*snakemake.input.maps, snakemake.params.dataset, snakemake.output.csv.removesuffix(".csv"))
