"""Rule average_forecasts."""

from modlhmp.forecasting import average_forecasts, read_forecasts, write_forecasts
from modlhmp.logs import job_log
from modlhmp.storage import provenance

with job_log(snakemake.log[0]):
    forecasts = average_forecasts([list(read_forecasts(file)) for file in snakemake.input])
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_forecasts(snakemake.output[0], forecasts, **origin)
