"""Rule measure_encounters."""

import numpy as np
import pandas as pd
import pyarrow as pa

from modlhmp.forecasting.files import read_forecasts
from modlhmp.logs import job_log
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.scoring.encounters import encounters
from modlhmp.scoring.errors import nan_mean, seed_mean
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.layout import Layout
from modlhmp.tracks import read_tracks, together

with job_log(snakemake.log[0]) as log:
    params, names = snakemake.params, snakemake.wildcards
    layout = Layout.around(params.run, snakemake.output[0])
    site = build(Site, params.dataset)
    every = []
    for recording, others in params.recordings.items():
        tracks, *rest = (read_tracks(layout.tracks(names.dataset, one)) for one in (recording, *others))
        forecasts = read_forecasts(layout.forecast(names.dataset, names.method, recording))
        scenes = read_scenes(layout.tracks(names.dataset, recording))
        every.append(encounters(tracks, forecasts, together([tracks, *rest]), site, scenes))
    parts = [part for part in every if len(part[2])] or every[:1]  # one without tracks has no seeds either
    met = np.concatenate([part[0] for part in parts], axis=1)
    truth, length = (np.concatenate([part[column] for part in parts]) for column in (1, 2))
    rows = [
        (
            horizon,
            float(seed_mean(met[:, :, step])),
            float(nan_mean(truth[:, step], axis=0)),
            int((length > step).sum()),
        )
        for horizon in params.horizons
        for step in [round(horizon / site.time_step_s) - 1]
    ]
    table = pd.DataFrame(rows, columns=["horizon_s", "met", "truth_met", "n"])
    origin = provenance(dict(names), dict(params), snakemake.input)
    write_parquet(pa.Table.from_pandas(table, preserve_index=False), snakemake.output[0], **origin)
