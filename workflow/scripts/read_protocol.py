"""Rule read_protocol."""

import pyarrow as pa

from modlhmp.forecasting.files import read_forecasts
from modlhmp.logs import job_log, progress
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.layout import Layout
from modlhmp.study.readings import readings
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, dataset = snakemake.params, snakemake.wildcards.dataset
    layout, site = Layout.around(params.run, snakemake.output[0]), build(Site, params.dataset)
    for method in progress(params.methods, desc="methods"):
        recordings = (
            (read_tracks(file), read_forecasts(layout.forecast(dataset, method, recording)), read_scenes(file))
            for recording, file in zip(params.recordings, snakemake.input.tracks, strict=True)
        )
        table = readings(recordings, site)
        log.info("%s: %d readings", method, len(table))
        made_of = [*snakemake.input.tracks, layout.forecasts(dataset, method)]
        origin = provenance({"dataset": dataset, "method": method}, dict(params), made_of)
        write_parquet(pa.Table.from_pandas(table, preserve_index=False), layout.readings(dataset, method), **origin)
