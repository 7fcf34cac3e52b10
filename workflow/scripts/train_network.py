"""Rules train_{method}."""

import json
from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.networks.data import day_of
from modlhmp.networks.training import save_network, train
from modlhmp.storage import provenance, write_text
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    method, dataset = snakemake.params.method, snakemake.params.dataset
    tracks = {Path(file).stem: read_tracks(file) for file in snakemake.input.tracks}
    days = [
        day_of(tracks[name], [tracks[other] for other in others], dataset["observed_rows"], dataset["timezone"])
        for name, others in snakemake.params.days.items()
    ]
    weights = Path(snakemake.output.weights)
    learned = {**method["learned"], "threads": snakemake.threads, "code": snakemake.params.code}
    checkpoint = weights.with_suffix(".checkpoint")
    network, curve, summary = train(method["kind"], method["options"], days, dataset, learned, checkpoint, log)
    save_network(weights, method["kind"], method["options"], dataset, network)
    origin = provenance(
        {**dict(snakemake.wildcards), "method": snakemake.params.name}, dict(snakemake.params), snakemake.input
    )
    content = {**summary, "budget": method["learned"]["budget"], "curve": curve, "origin": origin}
    write_text(snakemake.output.summary, json.dumps(content, indent=1))
    checkpoint.unlink()
