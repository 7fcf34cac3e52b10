"""Rule measure_encounters."""

import numpy as np
import pyarrow as pa

from modlhmp.forecasting.files import read_forecasts
from modlhmp.logs import job_log, progress
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.scoring.encounters import encounters
from modlhmp.scoring.errors import nan_mean, seed_mean
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.layout import Layout
from modlhmp.tracks import read_tracks, together


def measured(method):
    """How often a method's forecasts meet somebody, by horizon."""
    every = []
    for recording, others in params.recordings.items():
        tracks, *rest = (read_tracks(layout.tracks(dataset, one)) for one in (recording, *others))
        forecasts = read_forecasts(layout.forecast(dataset, method, recording))
        scenes = read_scenes(layout.tracks(dataset, recording))
        every.append(encounters(tracks, forecasts, together([tracks, *rest]), site, scenes))
    parts = [part for part in every if len(part[2])] or every[:1]  # one without tracks has no seeds either
    met = np.concatenate([part[0] for part in parts], axis=1)
    truth, length = (np.concatenate([part[column] for part in parts]) for column in (1, 2))
    steps = [round(horizon / site.time_step_s) - 1 for horizon in params.horizons]
    return pa.table(
        {
            "horizon_s": params.horizons,
            "met": [float(seed_mean(met[:, :, step])) for step in steps],
            "truth_met": [float(nan_mean(truth[:, step], axis=0)) for step in steps],
            "n": [int((length > step).sum()) for step in steps],
        }
    )


with job_log(snakemake.log[0]):
    params, dataset = snakemake.params, snakemake.wildcards.dataset
    layout, site = Layout.around(params.run, snakemake.output[0]), build(Site, params.dataset)
    for method in progress(params.methods, desc="methods"):
        made_of = [*snakemake.input.tracks, layout.forecasts(dataset, method)]
        origin = provenance({"dataset": dataset, "method": method}, dict(params), made_of)
        write_parquet(measured(method), layout.encounters(dataset, method), **origin)
