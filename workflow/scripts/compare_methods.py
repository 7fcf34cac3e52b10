"""Rule compare_methods."""

from pathlib import Path

import pyarrow as pa

from modlhmp.logs import job_log, progress
from modlhmp.storage import provenance, write_parquet
from modlhmp.study.comparisons import compare
from modlhmp.study.summary import at_horizons, scored_horizons

with job_log(snakemake.log[0]) as log:
    dataset = snakemake.params.dataset
    horizons = scored_horizons(snakemake.params.horizons, dataset)
    errors = {
        Path(file).stem: at_horizons(file, horizons, dataset["time_step_s"])
        for file in progress(snakemake.input, desc="methods")
    }
    tests = compare(dataset["name"], errors, snakemake.params.pairs, horizons)
    log.info("%d tests", len(tests))
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_parquet(pa.Table.from_pandas(tests, preserve_index=False), snakemake.output[0], **origin)
