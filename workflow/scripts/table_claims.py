"""Rule table_claims."""

import json
from pathlib import Path

import numpy as np

from modlhmp.forecasting.observe import seconds_after_t0
from modlhmp.logs import job_log, progress
from modlhmp.study.claims import Evidence, claim_horizons, idle_keys, test_claims, write_claims
from modlhmp.study.summary import at_horizons
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, evidence = snakemake.params, []
    for dataset in params.datasets:
        mine = [Path(file) for file in snakemake.input if dataset["name"] in Path(file).parts]
        horizons = claim_horizons(dataset, params.horizons)

        def reduced(file, horizons=horizons, step_s=dataset["time_step_s"]):
            return at_horizons(file, horizons, step_s)

        errors = {file.stem: reduced(file) for file in progress(mine, desc="files") if file.parent.name == "errors"}
        studies = {
            folder.name: {float(file.stem): reduced(file) for file in folder.glob("*.parquet")}
            for folder in mine
            if folder.parent.name == "studies"
        }
        lengths, idle, seen = [], set(), dataset["observed_rows"]
        for file in (file for file in mine if file.parent.name == "tracks"):
            tracks = read_tracks(file)
            lengths.append(seconds_after_t0([tracks], seen))
            idle |= idle_keys(file.stem, tracks, seen)
        runtime = next((json.loads(file.read_text()) for file in mine if file.name == "runtime.json"), None)
        evidence.append(Evidence(dataset, horizons, errors, studies, np.concatenate(lengths), frozenset(idle), runtime))
    table = test_claims(evidence, params.titles, params.kinds)
    log.info("%s", table["verdict"].value_counts().to_dict())
    demo = any(dataset["demo"] for dataset in params.datasets)
    write_claims(table, demo, snakemake.output.csv.removesuffix(".csv"))
