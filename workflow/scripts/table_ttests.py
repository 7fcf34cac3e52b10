"""Rule table_ttests."""

import pandas as pd

from modlhmp.logs import job_log
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits.tables import write_ttests

with job_log(snakemake.log[0]):
    tests = pd.concat([read_parquet(file).to_pandas() for file in snakemake.input], ignore_index=True)
    stem = snakemake.output.csv.removesuffix(".csv")
    write_ttests(tests, snakemake.params.datasets, snakemake.params.methods, stem)
