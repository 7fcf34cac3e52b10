"""Rule measure_uncertainty."""

import pyarrow as pa

from modlhmp.forecasting import forecast_recording, make_forecaster, seeds_of
from modlhmp.logs import job_log, progress
from modlhmp.scoring.uncertainty import score_samples
from modlhmp.storage import DataError, provenance, write_parquet
from modlhmp.study.summary import scored_horizons
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, names = snakemake.params, snakemake.wildcards
    method, dataset = params.method, params.dataset
    forecaster = make_forecaster(
        method["kind"], method["options"], dataset, snakemake.input.get("map"), snakemake.input.get("exits")
    )
    seeds = seeds_of(method["kind"], params.seeds)
    horizons = scored_horizons(params.horizons, dataset) or [dataset["horizon_s"]]
    tables = []
    for name, file in zip(params.recordings, progress(snakemake.input.tracks, desc="recordings"), strict=True):
        tracks, k = read_tracks(file), method["options"]["k"]
        drawn = max(k, params.samples)
        forecasts = forecast_recording(tracks, forecaster, dataset, (names.dataset, names.method, name), drawn, seeds)
        tables.append(score_samples(tracks, forecasts, name, dataset, k, horizons))
    if not any(table.num_rows for table in tables):
        rows = dataset["observed_rows"] + 1
        raise DataError(f"{names.dataset}: no test track has {rows} rows without a gap over 5 s to measure")
    origin = provenance(dict(names), dict(params), snakemake.input)
    write_parquet(pa.concat_tables(tables).unify_dictionaries(), snakemake.output[0], **origin, horizons_s=horizons)
