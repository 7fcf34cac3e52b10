"""Rule table_ladder."""

import json
from pathlib import Path

from modlhmp.logs import job_log
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits.ladder_table import write_ladder

with job_log(snakemake.log[0]):
    params, files = snakemake.params, snakemake.input
    scored, compared = (read_parquet(file).to_pandas() for file in (files.scores, files.differences))
    costs = json.loads(Path(files.costs).read_text())
    stem = snakemake.output.csv.removesuffix(".csv")
    write_ladder(scored, compared, costs, params.dataset, params.ladder, params.titles, params.days, stem)
