"""Rule table_parameters."""

from pathlib import Path

from modlhmp.forecasting.observe import seconds_after_t0
from modlhmp.logs import job_log
from modlhmp.study.exhibits.tables import write_parameters
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]):
    params = snakemake.params
    lengths = {}
    for dataset in params.datasets:
        mine = (read_tracks(file) for file in snakemake.input.tracks if dataset["name"] in Path(file).parts)
        lengths[dataset["name"]] = seconds_after_t0(mine, dataset["observed_rows"])
    stem = snakemake.output.csv.removesuffix(".csv")
    write_parameters(params.datasets, params.rollout, params.maps["cliff"], params.maps["stef"], lengths, stem)
