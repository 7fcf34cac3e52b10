"""Rule study_occupied."""

import pyarrow as pa

from modlhmp.kinds import find
from modlhmp.logs import job_log
from modlhmp.methods import Method
from modlhmp.origins import provenance
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.occupied import measure
from modlhmp.tracks import read_people

with job_log(snakemake.log[0]):
    params, names = snakemake.params, snakemake.wildcards
    methods = [Method.of(one) for one in params.methods]
    buildings = {kind: build(find(kind).building, plain) for kind, plain in params.buildings.items()}
    tracks, person = read_people(snakemake.input.tracks)
    tables = measure(
        tracks,
        build(Site, params.dataset),
        methods,
        buildings,
        params.every_s,
        params.horizons,
        (params.seed, names.dataset),
        person,
    )
    origin = provenance(dict(names), dict(params), snakemake.input)
    for name, table in tables.items():
        write_parquet(pa.Table.from_pandas(table, preserve_index=False), snakemake.output[name], **origin)
