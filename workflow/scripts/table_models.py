"""Rule table_models."""

from modlhmp.logs import job_log
from modlhmp.study.exhibits.trainings import read_trainings, write_models

with job_log(snakemake.log[0]):
    params = snakemake.params
    trainings = read_trainings(snakemake.input)
    write_models(trainings, params.datasets, params.methods, snakemake.output.csv.removesuffix(".csv"))
