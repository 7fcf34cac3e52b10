"""Rule figure_learning_curves."""

from modlhmp.logs import job_log
from modlhmp.paper.learning import draw_curves, read_trainings

with job_log(snakemake.log[0]):
    params = snakemake.params
    trainings = read_trainings(snakemake.input)
    draw_curves(trainings, params.datasets, params.methods, snakemake.output.csv.removesuffix(".csv"))
