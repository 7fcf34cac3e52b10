"""Rule average_forecasts."""

from modlhmp.forecasting.average import average_forecasts
from modlhmp.forecasting.files import read_forecasts, read_owners, read_t0, write_forecasts
from modlhmp.logs import job_log
from modlhmp.origins import provenance
from modlhmp.study.layout import Layout

with job_log(snakemake.log[0]):
    params, names = snakemake.params, snakemake.wildcards
    layout = Layout.around(params.run, snakemake.output[0])
    for recording in params.recordings:
        files = [layout.forecast(names.dataset, member, recording) for member in params.members]
        forecasts = average_forecasts([read_forecasts(file) for file in files])
        origin = provenance({**names, "recording": recording}, dict(params), files)
        file = layout.forecast(names.dataset, names.method, recording)
        write_forecasts(file, forecasts, read_t0(files[0]), read_owners(files[0]), **origin)
