"""Rule study_training."""

from modlhmp.kinds import find
from modlhmp.logs import job_log
from modlhmp.methods import Method
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.layout import Layout
from modlhmp.study.studies import sample_tracks, vary_training
from modlhmp.tracks import person_ids, read_tracks, together, with_persons

with job_log(snakemake.log[0]) as log:
    params, dataset = snakemake.params, snakemake.wildcards.dataset
    layout = Layout.around(params.run, snakemake.output[0])
    site, methods = build(Site, params.dataset), [Method.of(one) for one in params.methods]
    recordings = {name: read_tracks(layout.tracks(dataset, name)) for name in params.recordings}
    persons = person_ids(*snakemake.input.tracks)
    recordings = sample_tracks(recordings, dataset, site, params.max_tracks)
    scenes = {name: read_scenes(layout.tracks(dataset, name)) for name in params.recordings}
    training = together(map(read_tracks, snakemake.input.training))
    buildings = {kind: build(find(kind).building, plain) for kind, plain in params.buildings.items()}
    origin = provenance(dict(snakemake.wildcards), dict(params), snakemake.input)
    for share, method, errors in vary_training(
        params.shares, methods, training, recordings, dataset, site, buildings, params.seeds, scenes
    ):
        log.info("%s, %g of the training tracks: %d rows of errors", method, share, errors.num_rows)
        write_parquet(with_persons(errors, persons), layout.training_share(dataset, method, share), **origin)
