"""Rule table_parameters."""

from pathlib import Path

import numpy as np

from modlhmp.forecasting.observe import usable_tracks
from modlhmp.logs import job_log
from modlhmp.paper.tables import write_parameters
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]):
    params = snakemake.params
    lengths = {}
    for dataset in params.datasets:
        parts = []
        for file in (f for f in snakemake.input.tracks if Path(f).parts[-3] == dataset["name"]):
            tracks = read_tracks(file)
            rows = usable_tracks(tracks, dataset["observed_rows"])
            parts.append(tracks.t[rows[:, 1]] - tracks.t[rows[:, 0] + dataset["observed_rows"] - 1])
        lengths[dataset["name"]] = np.concatenate(parts)
    stem = snakemake.output.csv.removesuffix(".csv")
    write_parameters(params.datasets, params.rollout, params.maps["cliff"], params.maps["stef"], lengths, stem)
