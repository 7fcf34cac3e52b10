"""Rule certify."""

from modlhmp.logs import job_log
from modlhmp.storage import write_json
from modlhmp.study.certificate import certificate
from modlhmp.study.layout import Layout

with job_log(snakemake.log[0]):
    params = snakemake.params
    layout = Layout.around(params.run, snakemake.output[0])
    write_json(snakemake.output[0], certificate(layout, params.config, params.root))
