"""Rule measure_costs."""

import json
from pathlib import Path

from modlhmp.forecasting import make_forecaster
from modlhmp.logs import job_log
from modlhmp.maps import KINDS, map_path
from modlhmp.networks import KINDS as LEARNED_KINDS
from modlhmp.storage import write_text
from modlhmp.study.runtime import milliseconds_a_track, some_tracks
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, costs = snakemake.params, {}
    tracks = some_tracks(map(read_tracks, snakemake.input.tracks), params.dataset)
    maps = Path(snakemake.input.exits).parent
    weights = {Path(file).stem: file for file in snakemake.input.weights}
    for name, method in params.methods.items():
        if method["kind"] in LEARNED_KINDS:
            from modlhmp.networks.forecaster import network_forecaster

            learned = {**method["learned"], "threads": 1}
            forecaster = network_forecaster(weights[name], method["kind"], method["options"], params.dataset, learned)
        else:
            path = map_path(maps, method["kind"]) if method["kind"] in KINDS else None
            forecaster = make_forecaster(method["kind"], method["options"], params.dataset, path, snakemake.input.exits)
        costs[name] = milliseconds_a_track(forecaster, tracks, params.dataset, method["options"].get("k", 1))
        log.info("%s: %.3g ms a track", name, costs[name])
    for name, parts in params.averages.items():
        costs[name] = sum(costs[part] for part in parts)
    write_text(snakemake.output[0], json.dumps(costs, indent=1))
