"""Rule forecast_with_network."""

from modlhmp.baselines.forecaster import network_forecaster
from modlhmp.forecasting import forecast_recording, write_forecasts
from modlhmp.logs import job_log
from modlhmp.storage import provenance
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]):
    method, dataset, names = snakemake.params.method, snakemake.params.dataset, snakemake.wildcards
    learned = {**method["learned"], "threads": snakemake.threads}
    forecaster = network_forecaster(snakemake.input.weights, method["kind"], method["options"], dataset, learned)
    forecasts = forecast_recording(
        read_tracks(snakemake.input.tracks),
        forecaster,
        dataset,
        (names.dataset, names.method, names.recording),
        method["options"].get("k", 1),
        snakemake.params.seeds,
        [read_tracks(file) for file in snakemake.input.others],
    )
    made_of = [snakemake.input.tracks, *snakemake.input.others, snakemake.input.summary]
    write_forecasts(snakemake.output[0], forecasts, **provenance(dict(names), dict(snakemake.params), made_of))
