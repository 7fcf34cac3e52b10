"""Rule measure_costs."""

from modlhmp.kinds import find
from modlhmp.logs import job_log
from modlhmp.methods import Method, make_forecaster
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_json
from modlhmp.study.layout import Layout
from modlhmp.study.runtime import milliseconds_per_track, some_tracks
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, dataset, costs = snakemake.params, snakemake.wildcards.dataset, {}
    layout = Layout.around(params.run, snakemake.output[0])
    site = build(Site, params.dataset)
    tracks = some_tracks(map(read_tracks, snakemake.input.tracks), site)
    for method in map(Method.of, params.methods):
        kind, device = find(method.kind), "auto"
        path = layout.map_of(dataset, method) if kind.has_map else None
        if kind.learned:
            path, device = layout.here(params.weights[method.name]), method.learning.device
        forecaster = make_forecaster(method.kind, method.options, site, path, snakemake.input.exits, device)
        costs[method.name] = milliseconds_per_track(forecaster, tracks, dataset, site, method.futures)
        log.info("%s: %.3g ms per track", method.name, costs[method.name])
    for name, parts in params.averages.items():
        costs[name] = sum(costs[part] for part in parts)
    write_json(snakemake.output[0], costs)
