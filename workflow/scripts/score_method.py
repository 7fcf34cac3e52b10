"""Rule score_method."""

from pathlib import Path

import pyarrow as pa

from modlhmp.floor_plan import load_floor_plan
from modlhmp.forecasting import read_forecasts
from modlhmp.logs import job_log, progress
from modlhmp.scoring import score_recording
from modlhmp.storage import DataError, provenance, write_parquet
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    plan = load_floor_plan(snakemake.input.floor_plan[0]) if snakemake.input.floor_plan else None
    tables = []
    for name, tracks in zip(
        snakemake.params.recordings, progress(snakemake.input.tracks, desc="recordings"), strict=True
    ):
        forecasts = read_forecasts(Path(snakemake.input.forecasts) / f"{name}.parquet")
        errors = score_recording(read_tracks(tracks), forecasts, name, snakemake.params.dataset, plan)
        tables.append(errors)
    errors = pa.concat_tables(tables).unify_dictionaries()
    if not errors.num_rows:
        rows = snakemake.params.dataset["observed_rows"] + 1
        raise DataError(f"{snakemake.wildcards.dataset}: no test track has {rows} rows without a gap over 5 s to score")
    log.info("%d rows of errors", errors.num_rows)
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_parquet(errors, snakemake.output[0], **origin)
