"""Rule forecast_method."""

from pathlib import Path

from modlhmp.forecasting import STORED, forecast_recording, make_forecaster, seeds_of, write_forecasts
from modlhmp.logs import job_log
from modlhmp.storage import provenance
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, files, names = snakemake.params, snakemake.input, snakemake.wildcards
    kind, options = params.method["kind"], params.method["options"]
    forecaster = make_forecaster(kind, options, params.dataset, files.get("map"), files.get("exits"))
    seeds = seeds_of(kind, params.seeds)
    made_of = [file for file in (files.get("map"), files.get("exits")) if file]
    for recording, file in zip(params.recordings, files.tracks, strict=True):
        key = (names.dataset, names.method, recording)
        forecasts = forecast_recording(
            read_tracks(file), forecaster, params.dataset, key, options.get("k", 1), seeds, keep=1 + STORED
        )
        origin = provenance({**names, "recording": recording}, dict(params), [file, *made_of])
        write_forecasts(Path(snakemake.output[0]) / f"{recording}.parquet", forecasts, **origin)
        log.info("%s: forecast", recording)
