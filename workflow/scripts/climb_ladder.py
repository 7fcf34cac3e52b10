"""Rule climb_ladder."""

from itertools import pairwise
from pathlib import Path

import pyarrow as pa

from modlhmp.logs import job_log, progress
from modlhmp.storage import provenance, write_parquet
from modlhmp.study.ladder import differences, scores
from modlhmp.study.summary import at_horizons, scored_horizons

with job_log(snakemake.log[0]) as log:
    dataset, ladder, days = snakemake.params.dataset, snakemake.params.ladder, snakemake.params.days
    horizons = scored_horizons(snakemake.params.horizons, dataset)
    step_s = dataset["time_step_s"]
    errors = {
        Path(file).stem: at_horizons(file, horizons, step_s) for file in progress(snakemake.input, desc="methods")
    }
    rungs = [method for method, _ in ladder["rows"]]
    pairs = [
        *((below, above) for above, below in pairwise(rungs)),
        *((method, ladder["reference"]) for method in rungs),
        *((method, against) for method, against, _ in ladder["beside"]),
    ]
    steps = [round(horizon / step_s) for horizon in horizons]
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    for table, path in (
        (scores(dataset["name"], errors, horizons, steps, days), snakemake.output.scores),
        (differences(dataset["name"], errors, pairs, horizons, days), snakemake.output.differences),
    ):
        log.info("%d rows", len(table))
        write_parquet(pa.Table.from_pandas(table, preserve_index=False), path, **origin)
