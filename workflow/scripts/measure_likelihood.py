"""Rule measure_likelihood."""

import pyarrow as pa

from modlhmp.kinds import find
from modlhmp.logs import job_log
from modlhmp.origins import provenance
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.likelihood import Mapped, clusters_of, measure
from modlhmp.study.studies import sample_tracks
from modlhmp.tracks import numbered, read_people, read_tracks, together

with job_log(snakemake.log[0]) as log:
    params, dataset, files = snakemake.params, snakemake.wildcards.dataset, snakemake.input
    site = build(Site, params.dataset)
    training, person = read_people(files.training)
    tests = dict(zip(params.recordings, map(read_tracks, files.tracks), strict=True))
    tests = sample_tracks(tests, dataset, site, params.max_tracks)
    whose, recording = numbered([one.track_id for one in tests.values()], files.tracks)
    cluster = clusters_of(whose, recording, [params.days[name] for name in params.recordings])
    building = [
        plain if plain is None else build(find(kind).building, plain)
        for kind, plain in zip(params.kinds, params.buildings, strict=True)
    ]
    maps = [Mapped(*one) for one in zip(params.methods, params.kinds, files.maps, building, strict=True)]
    tables = measure(training, person, together(tests.values()), cluster, site, maps, params.clock)
    log.info("%d rows of test tracks, %d scores", len(whose), len(tables["scores"]))
    origin = provenance(dict(snakemake.wildcards), dict(params), files)
    for name, table in tables.items():
        write_parquet(pa.Table.from_pandas(table, preserve_index=False), snakemake.output[name], **origin)
