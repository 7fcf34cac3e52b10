"""Rule study_training."""

from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.storage import provenance, write_parquet
from modlhmp.study.studies import sample_tracks, vary_training
from modlhmp.tracks import read_tracks, together

with job_log(snakemake.log[0]) as log:
    params = snakemake.params
    recordings = {name: read_tracks(f) for name, f in zip(params.recordings, snakemake.input.tracks, strict=True)}
    recordings = sample_tracks(recordings, params.dataset, params.max_tracks)
    training = together(map(read_tracks, snakemake.input.training))
    origin = provenance(dict(snakemake.wildcards), dict(params), snakemake.input)
    for share, method, errors in vary_training(
        params.shares, params.methods, training, recordings, params.dataset, params.maps, params.seeds
    ):
        log.info("%s, %g of the training tracks: %d rows of errors", method, share, errors.num_rows)
        write_parquet(errors, Path(snakemake.output[0]) / method / f"{share:g}.parquet", **origin)
