"""Rule compare_methods."""

import pyarrow as pa

from modlhmp.logs import job_log, progress
from modlhmp.origins import provenance
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study.comparisons import compare
from modlhmp.study.layout import Layout
from modlhmp.study.summary import at_horizons

with job_log(snakemake.log[0]) as log:
    params, dataset = snakemake.params, snakemake.wildcards.dataset
    layout = Layout.around(params.run, snakemake.output[0])
    site = build(Site, params.dataset)
    errors = {
        method: at_horizons(layout.errors(dataset, method), params.horizons, site.time_step_s)
        for method in progress(params.methods, desc="methods")
    }
    tests = compare(dataset, errors, params.pairs, params.horizons, params.days)
    log.info("%d tests", len(tests))
    origin = provenance(dict(snakemake.wildcards), dict(params), snakemake.input)
    write_parquet(pa.Table.from_pandas(tests, preserve_index=False), snakemake.output[0], **origin)
