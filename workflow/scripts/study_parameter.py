"""Rule study_parameter."""

from modlhmp.logs import job_log, progress
from modlhmp.methods import Method
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.layout import Layout
from modlhmp.study.studies import sample_tracks, vary
from modlhmp.tracks import person_ids, read_tracks, with_persons

with job_log(snakemake.log[0]) as log:
    params, dataset, parameter = snakemake.params, snakemake.wildcards.dataset, snakemake.wildcards.parameter
    layout = Layout.around(params.run, snakemake.output[0])
    site, method = build(Site, params.dataset), Method.of(params.method)
    recordings = {name: read_tracks(layout.tracks(dataset, name)) for name in params.recordings}
    persons = person_ids(*snakemake.input.tracks)
    recordings = sample_tracks(recordings, dataset, site, params.max_tracks)
    scenes = {name: read_scenes(layout.tracks(dataset, name)) for name in params.recordings}
    variants = vary(
        parameter, params.values, method, recordings, dataset, site, snakemake.input.map, params.seeds, scenes,
        snakemake.input.exits,
    )  # fmt: skip
    origin = provenance(dict(snakemake.wildcards), dict(params), snakemake.input)
    for value, errors in progress(variants, total=len(params.values), desc="values"):
        log.info("%s = %g: %d rows of errors", parameter, value, errors.num_rows)
        write_parquet(with_persons(errors, persons), layout.study_value(dataset, parameter, value), **origin)
