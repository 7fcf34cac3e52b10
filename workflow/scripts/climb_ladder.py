"""Rule climb_ladder."""

from itertools import pairwise

import pyarrow as pa

from modlhmp.logs import job_log, progress
from modlhmp.origins import provenance
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.ladder import differences, scores
from modlhmp.study.layout import Layout
from modlhmp.study.summary import at_horizons

with job_log(snakemake.log[0]) as log:
    params, dataset = snakemake.params, snakemake.wildcards.dataset
    layout = Layout.around(params.run, snakemake.output[0])
    site, ladder = build(Site, params.dataset), params.ladder
    horizons, step_s = params.horizons, site.time_step_s
    errors = {
        method: at_horizons(layout.errors(dataset, method), horizons, step_s)
        for method in progress(params.methods, desc="methods")
    }
    rungs = [method for method, _ in ladder["rows"]]
    pairs = [
        *((below, above) for above, below in pairwise(rungs)),
        *((method, ladder["reference"]) for method in rungs),
        *((method, against) for method, against, _ in ladder["beside"]),
    ]
    steps = [round(horizon / step_s) for horizon in horizons]
    origin = provenance(dict(snakemake.wildcards), dict(params), snakemake.input)
    for table, path in (
        (scores(dataset, errors, horizons, steps, params.days), snakemake.output.scores),
        (differences(dataset, errors, pairs, horizons, params.days), snakemake.output.differences),
    ):
        log.info("%d rows", len(table))
        write_parquet(pa.Table.from_pandas(table, preserve_index=False), path, **origin)
