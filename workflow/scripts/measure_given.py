"""Rule measure_given."""

from dataclasses import replace

import numpy as np
import pyarrow as pa

from modlhmp.forecasting.files import check_alike, first_seed, read_forecasts
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.kinds import find
from modlhmp.logs import job_log, progress
from modlhmp.methods import Method, make_forecaster
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.scoring.next_velocity import STEP, score_next
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.layout import Layout
from modlhmp.study.likelihood import clusters_of
from modlhmp.study.likelihood_given import measure_given
from modlhmp.tracks import numbered, read_tracks

with job_log(snakemake.log[0]) as log:
    params, dataset, files = snakemake.params, snakemake.wildcards.dataset, snakemake.input
    layout = Layout.around(params.run, snakemake.output[0])
    site = build(Site, params.dataset)
    site, seed, scored = replace(site, horizon_s=STEP * site.time_step_s), params.seed, {}
    tests = zip(params.recordings, files.tracks, strict=True)
    recordings = [(name, read_tracks(file), read_scenes(file)) for name, file in tests]
    for name in progress(params.methods, desc="methods"):
        if plain := params.made.get(name):
            method = Method.of(plain)
            path = layout.map_of(dataset, method) if find(method.kind).has_map else None
            exits = files.exits[0] if files.exits else None
            asked = make_forecaster(method.kind, method.options, site, path, exits)
        scored[name] = []
        for recording, tracks, scenes in recordings:
            key = dataset, name, recording
            if plain:
                number = max(method.futures, params.samples)
                forecasts = forecast_recording(tracks, asked, site, key, number, [seed], scenes=scenes)
            else:
                check_alike(layout.forecast(*key), name, "likelihood.given")
                forecasts = first_seed(read_forecasts(layout.forecast(*key)))
            scored[name].append(score_next(tracks, forecasts, recording, site, scenes))
    first = scored[params.methods[0]]
    person, recording = numbered([one.track_id for one in first], files.tracks)
    cluster = clusters_of(person, recording, [params.days[name] for name in params.recordings])
    heading, speed = (np.concatenate([getattr(one, part) for one in first]) for part in ("heading", "speed"))
    log_p = {name: np.concatenate([one.log_p for one in parts]) for name, parts in scored.items()}
    tables = measure_given(log_p, heading, speed, person, cluster)
    log.info("%d next velocities of %d methods", len(speed), len(log_p))
    origin = provenance(dict(snakemake.wildcards), dict(params), files)
    for name, table in tables.items():
        write_parquet(pa.Table.from_pandas(table, preserve_index=False), snakemake.output[name], **origin)
