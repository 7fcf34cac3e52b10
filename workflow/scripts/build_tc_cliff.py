"""Rule build_tc_cliff."""

from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.maps import cliff
from modlhmp.storage import provenance, write_parquet
from modlhmp.tracks import clock_hours, concatenate, read_tracks

with job_log(snakemake.log[0]) as log:
    tracks = concatenate(map(read_tracks, snakemake.input.tracks))
    hours = clock_hours(tracks.t, snakemake.params.timezone)
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    Path(snakemake.output[0]).mkdir(parents=True)
    for hour in range(*snakemake.params.hours):
        table = cliff.build(tracks.take(hours == hour), **snakemake.params.options)
        log.info("hour %02d: %d rows of tracks, %d components", hour, (hours == hour).sum(), table.num_rows)
        if not table.num_rows:
            log.info("hour %02d is skipped: too few training data; its forecasts will stop at once", hour)
            continue
        write_parquet(table, Path(snakemake.output[0]) / f"{hour:02d}.parquet", hour=hour, **origin)
