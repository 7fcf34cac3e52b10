"""Rule study_parameter."""

from pathlib import Path

from modlhmp.logs import job_log, progress
from modlhmp.storage import provenance, write_parquet
from modlhmp.study.studies import sample_tracks, vary
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, files = snakemake.params, snakemake.input.tracks
    recordings = {name: read_tracks(file) for name, file in zip(params.recordings, files, strict=True)}
    recordings = sample_tracks(recordings, params.dataset, params.max_tracks)
    variants = vary(
        snakemake.wildcards.parameter, params.values, params.method, recordings, params.dataset, snakemake.input.map,
        params.seeds,
    )  # fmt: skip
    origin = provenance(dict(snakemake.wildcards), dict(params), snakemake.input)
    for value, errors in progress(variants, total=len(params.values), desc="values"):
        log.info("%s = %g: %d rows of errors", snakemake.wildcards.parameter, value, errors.num_rows)
        write_parquet(errors, Path(snakemake.output[0]) / f"{value:g}.parquet", **origin)
