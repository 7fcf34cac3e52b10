"""Rule measure_uncertainty."""

import pyarrow as pa

from modlhmp.forecasting.files import check_alike, read_forecasts
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.logs import job_log, progress
from modlhmp.methods import Method, make_forecaster
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.scoring.uncertainty import score_samples
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import DataError, write_parquet
from modlhmp.study.layout import Layout
from modlhmp.tracks import gap_limit, person_ids, read_tracks, with_persons

with job_log(snakemake.log[0]) as log:
    params, files, names = snakemake.params, snakemake.input, snakemake.wildcards
    method, site = Method.of(params.method), build(Site, params.dataset)
    layout = Layout.around(params.run, snakemake.output[0])
    if params.drawn_again:
        forecaster = make_forecaster(method.kind, method.options, site, files.get("map"), files.get("exits"))
    tables, k, persons = [], max(method.futures, params.samples), person_ids(*files.tracks)
    for name, file in zip(params.recordings, progress(files.tracks, desc="recordings"), strict=True):
        tracks, scenes, key = read_tracks(file), read_scenes(file), (names.dataset, names.method, name)
        stored = layout.forecast(*key)
        check_alike(stored, names.method, "uncertainty.methods")
        drawn, given = read_forecasts(stored), None
        if params.drawn_again:  # more samples than the method's own, and its result, which is among these
            drawn, given = forecast_recording(tracks, forecaster, site, key, k, params.seeds, scenes=scenes), drawn
        scored = score_samples(tracks, drawn, name, site, params.horizons, scenes, given)
        tables.append(with_persons(scored, persons))
    if not any(table.num_rows for table in tables):
        rows = site.observed_rows + 1
        gap_s = gap_limit(site.time_step_s)
        raise DataError(
            f"{names.dataset}: no test track (or scene) has {rows} rows without a gap over {gap_s:g} s to measure"
        )
    origin = provenance(dict(names), dict(params), files) | {"horizons_s": params.horizons}
    write_parquet(pa.concat_tables(tables).unify_dictionaries(), snakemake.output[0], **origin)
