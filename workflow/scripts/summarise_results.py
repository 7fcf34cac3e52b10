"""Rule summarise_results."""

import pandas as pd

from modlhmp.logs import job_log, progress
from modlhmp.storage import write_text
from modlhmp.study.csv_cells import csv_text
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_errors, summarise
from modlhmp.version import __version__

with job_log(snakemake.log[0]) as log:
    params = snakemake.params
    layout = Layout.around(params.run, snakemake.output[0])
    wanted = [(dataset, method) for dataset in params.time_steps for method in params.methods]
    tables = [
        summarise(dataset, method, read_errors(layout.errors(dataset, method)), params.time_steps[dataset])
        for dataset, method in progress(wanted, desc="methods")
    ]
    results = pd.concat(tables, ignore_index=True).assign(version=__version__)  # the one CSV with nothing beside it
    log.info("%d rows", len(results))
    write_text(snakemake.output[0], csv_text(results, float_format="%.6g"))
