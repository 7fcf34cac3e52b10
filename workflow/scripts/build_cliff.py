"""Rule build_cliff."""

from modlhmp.logs import job_log
from modlhmp.maps import cliff
from modlhmp.storage import provenance, write_parquet
from modlhmp.tracks import concatenate, read_tracks

with job_log(snakemake.log[0]) as log:
    tracks = concatenate(map(read_tracks, snakemake.input.tracks))
    table = cliff.build(tracks, **snakemake.params.options)
    log.info("%d rows of tracks, %d components", len(tracks.t), table.num_rows)
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_parquet(table, snakemake.output[0], **origin)
