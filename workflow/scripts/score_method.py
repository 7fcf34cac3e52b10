"""Rule score_method."""

from pathlib import Path

from modlhmp.floor_plan import load_floor_plan
from modlhmp.forecasting import read_forecasts
from modlhmp.logs import job_log, progress
from modlhmp.scoring import score_recording
from modlhmp.storage import DataError, provenance, write_pieces
from modlhmp.tracks import read_tracks


def scored(files, params, dataset, log):
    """Errors of one recording after the other; `DataError` if there are none at all."""
    plan, rows = load_floor_plan(files.floor_plan[0]) if files.floor_plan else None, 0
    for name, tracks in zip(params.recordings, progress(files.tracks, desc="recordings"), strict=True):
        forecasts = read_forecasts(Path(files.forecasts) / f"{name}.parquet")
        errors = score_recording(read_tracks(tracks), forecasts, name, params.dataset, plan)
        rows += errors.num_rows
        if errors.num_rows:
            yield errors
    if not rows:
        needed = params.dataset["observed_rows"] + 1
        raise DataError(f"{dataset}: no test track has {needed} rows without a gap over 5 s to score")
    log.info("%d rows of errors", rows)


with job_log(snakemake.log[0]) as log:
    errors = scored(snakemake.input, snakemake.params, snakemake.wildcards.dataset, log)
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_pieces(errors, snakemake.output[0], **origin)
