"""Rule read_protocol."""

import pyarrow as pa

from modlhmp.forecasting.files import read_forecasts
from modlhmp.logs import job_log
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.layout import Layout
from modlhmp.study.readings import readings
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]) as log:
    params, names = snakemake.params, snakemake.wildcards
    layout = Layout.around(params.run, snakemake.output[0])
    site = build(Site, params.dataset)
    recordings = (
        (read_tracks(file), read_forecasts(layout.forecast(names.dataset, names.method, recording)), read_scenes(file))
        for recording, file in zip(params.recordings, snakemake.input.tracks, strict=True)
    )
    table = readings(recordings, site)
    log.info("%d readings", len(table))
    origin = provenance(dict(names), dict(params), snakemake.input)
    write_parquet(pa.Table.from_pandas(table, preserve_index=False), snakemake.output[0], **origin)
