"""Rule build_snippets."""

from modlhmp.logs import job_log
from modlhmp.maps import snippets
from modlhmp.storage import provenance, write_parquet
from modlhmp.tracks import read_tracks, together

with job_log(snakemake.log[0]) as log:
    dataset = snakemake.params.dataset
    tracks = together(map(read_tracks, snakemake.input.tracks))
    table = snippets.build(
        tracks, dataset["time_step_s"], past=dataset["observed_rows"] - 1, **snakemake.params.options
    )
    log.info("%d rows of tracks, %d snippets", len(tracks.t), table.num_rows)
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_parquet(table, snakemake.output[0], **origin)
