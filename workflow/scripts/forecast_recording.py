"""Rule forecast_recording."""

from modlhmp.forecasting import UNSEEDED, forecast_recording, make_forecaster, write_forecasts
from modlhmp.logs import job_log
from modlhmp.storage import provenance
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]):
    method, dataset, names = snakemake.params.method, snakemake.params.dataset, snakemake.wildcards
    forecaster = make_forecaster(
        method["kind"], method["options"], dataset, snakemake.input.get("map"), snakemake.input.get("exits")
    )
    forecasts = forecast_recording(
        read_tracks(snakemake.input.tracks),
        forecaster,
        dataset,
        (names.dataset, names.method, names.recording),
        method["options"].get("k", 1),
        snakemake.params.seeds[:1] if method["kind"] in UNSEEDED else snakemake.params.seeds,
    )
    origin = provenance(dict(names), dict(snakemake.params), snakemake.input)
    write_forecasts(snakemake.output[0], forecasts, **origin)
