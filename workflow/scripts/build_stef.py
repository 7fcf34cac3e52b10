"""Rule build_stef."""

from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.maps import stef
from modlhmp.storage import provenance, write_parquet
from modlhmp.tracks import concatenate, read_tracks

with job_log(snakemake.log[0]) as log:
    tracks = concatenate(map(read_tracks, snakemake.input.tracks))
    table = stef.build(tracks, snakemake.params.timezone, **snakemake.params.options)
    log.info("%d rows of tracks, %d cells and orientations", len(tracks.t), table.num_rows)
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_parquet(table, snakemake.output.spectra, **origin)
    for hour in range(*snakemake.params.hours):
        hourly = stef.evaluate(table, stef.middle_of_hour(hour))
        write_parquet(hourly, Path(snakemake.output.hours) / f"{hour:02d}.parquet", hour=hour, **origin)
