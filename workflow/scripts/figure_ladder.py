"""Rule figure_ladder."""

import pandas as pd

from modlhmp.logs import job_log
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits.ladder_figure import draw

with job_log(snakemake.log[0]):
    params = snakemake.params
    scored = pd.concat([read_parquet(file).to_pandas() for file in snakemake.input], ignore_index=True)
    stem = snakemake.output.csv.removesuffix(".csv")
    draw(scored, params.datasets, params.ladder, params.titles, params.with_memory, stem)
