"""Rule figure_learning_curves."""

from modlhmp.logs import job_log
from modlhmp.study.exhibits.learning_curves import draw
from modlhmp.study.exhibits.trainings import read_trainings

with job_log(snakemake.log[0]):
    params = snakemake.params
    trainings = read_trainings(snakemake.input)
    draw(trainings, params.datasets, params.methods, snakemake.output.csv.removesuffix(".csv"))
