"""Rule forecast_with_network."""

from pathlib import Path

from modlhmp.forecasting import forecast_recording, write_forecasts
from modlhmp.logs import job_log
from modlhmp.networks.forecaster import network_forecaster
from modlhmp.storage import provenance
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, method = snakemake.params, snakemake.params.method
    learned = {**method["learned"], "threads": snakemake.threads}
    forecaster = network_forecaster(snakemake.input.weights, method["kind"], method["options"], params.dataset, learned)
    files = {Path(file).stem: file for file in snakemake.input.tracks}
    for name, others in params.recordings.items():
        made_of = [files[name], *(files[other] for other in others)]
        own, *rest = map(read_tracks, made_of)
        names, k = (*snakemake.wildcards, name), method["options"].get("k", 1)
        forecasts = forecast_recording(own, forecaster, params.dataset, names, k, params.seeds, rest)
        wildcards = dict(zip(("dataset", "method", "recording"), names, strict=True))
        origin = provenance(wildcards, dict(params), [*made_of, snakemake.input.summary])
        write_forecasts(Path(snakemake.output[0]) / f"{name}.parquet", forecasts, **origin)
        log.info("%s: forecast", name)
