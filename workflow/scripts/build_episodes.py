"""Rule build_episodes."""

from modlhmp.logs import job_log
from modlhmp.maps import episodes
from modlhmp.storage import provenance, write_parquet
from modlhmp.tracks import read_tracks, together

with job_log(snakemake.log[0]) as log:
    tracks = together(map(read_tracks, snakemake.input.tracks))
    table = episodes.build(tracks, snakemake.params.dataset["time_step_s"])
    log.info("%d rows of tracks, %d rows", len(tracks.t), table.num_rows)
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_parquet(table, snakemake.output[0], **origin)
