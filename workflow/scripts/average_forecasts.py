"""Rule average_forecasts."""

from pathlib import Path

from modlhmp.forecasting import average_forecasts, read_forecasts, write_forecasts
from modlhmp.logs import job_log
from modlhmp.storage import provenance

with job_log(snakemake.log[0]):
    for recording in snakemake.params.recordings:
        files = [Path(folder) / f"{recording}.parquet" for folder in snakemake.input]
        forecasts = average_forecasts([read_forecasts(file) for file in files])
        origin = provenance({**snakemake.wildcards, "recording": recording}, dict(snakemake.params), files)
        write_forecasts(Path(snakemake.output[0]) / f"{recording}.parquet", forecasts, **origin)
