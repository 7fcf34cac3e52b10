"""Rules train_{method}."""

from pathlib import Path

from modlhmp.kinds import find
from modlhmp.logs import job_log
from modlhmp.methods import Method
from modlhmp.networks.data import day_of
from modlhmp.networks.doubling import forget, train_long_enough
from modlhmp.networks.training import save_network
from modlhmp.origins import provenance
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_json
from modlhmp.study.layout import Layout
from modlhmp.tracks import person_ids, read_tracks

with job_log(snakemake.log[0]) as log:
    params, method, site = snakemake.params, Method.of(snakemake.params.method), build(Site, snakemake.params.dataset)
    kind = find(method.kind)
    layout = Layout.around(params.run, snakemake.output[0])
    dataset = snakemake.wildcards.dataset
    names = {name for own, others in params.days.items() for name in (own, *others)}
    tracks = {name: read_tracks(layout.tracks(dataset, name)) for name in sorted(names)}
    days = [
        day_of(tracks[name], [tracks[other] for other in others], site, person_ids(layout.tracks(dataset, name)))
        for name, others in params.days.items()
    ]
    weights = Path(snakemake.output.weights)
    trained = train_long_enough(
        kind, method.options, days, site, method.learning, weights, log, snakemake.threads, params.code
    )
    for file, found in ((weights, trained.network.state_dict()), (snakemake.output.last, trained.last)):
        save_network(file, kind, method.options, site, found)
    origin = provenance({**snakemake.wildcards, "method": method.name}, dict(params), snakemake.input)
    content = {**trained.summary, "budget": method.learning.budget, "curve": trained.curve, "origin": origin}
    write_json(snakemake.output.summary, content)
    forget(weights)
