"""Rule summarise_results."""

from pathlib import Path

import pandas as pd

from modlhmp.logs import job_log, progress
from modlhmp.storage import write_text
from modlhmp.study.summary import read_errors, summarise

with job_log(snakemake.log[0]) as log:
    tables = []
    for file in map(Path, progress(snakemake.input, desc="methods")):
        dataset, method = file.parts[-3], file.stem
        tables.append(summarise(dataset, method, read_errors(file), snakemake.params.time_steps[dataset]))
    results = pd.concat(tables, ignore_index=True)
    log.info("%d rows", len(results))
    write_text(snakemake.output[0], results.to_csv(index=False, float_format="%.6g"))
