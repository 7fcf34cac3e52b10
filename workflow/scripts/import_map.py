"""Rules import_{method}."""

from pathlib import Path

import numpy as np

from modlhmp.exchange.maps import read_tables
from modlhmp.exchange.parquet import is_parquet, read_ours
from modlhmp.kinds import find
from modlhmp.logs import job_log
from modlhmp.maps.base import DAY, box_of, check_box
from modlhmp.origins import provenance, unchanged
from modlhmp.settings import as_plain, build
from modlhmp.site import Site
from modlhmp.storage import DataError, write_parquet
from modlhmp.study.layout import Layout
from modlhmp.tracks import read_tracks, together

with job_log(snakemake.log[0]) as log:
    params, kind, out = snakemake.params, find(snakemake.params.kind), Path(snakemake.output.map)
    site = build(Site, params.dataset)
    path = Layout.around(params.run, snakemake.output[0]).here(params.file)
    with unchanged(*snakemake.input.map) as hashes:
        if is_parquet(path, params.form):
            of_kind, _, whole, hours = read_ours(path)
        else:
            of_kind, whole, hours = read_tables(path, params.form, site, params.origin_m)
    if of_kind != kind.name:
        raise DataError(f"{path}: a map of kind {of_kind}; the method is of kind {kind.name}")
    tables = [*([] if whole is None else [whole]), *hours.values()]
    walkers = together(map(read_tracks, snakemake.input.tracks))
    share = check_box(path, box_of(tables), np.column_stack([walkers.x, walkers.y]))
    log.info("%s: %d rows; %.1f %% of the test rows lie in its box", path, sum(map(len, tables)), 100 * share)
    # Where files lie is no setting: their names and bytes are among the sources.
    settings = {key: value for key, value in params.items() if key not in ("file", "sums")}
    origin = provenance(dict(snakemake.wildcards), settings, snakemake.input.map, hashes)
    origin |= {"kind": kind.name, "site": as_plain(site)}
    if kind.hourly:
        out.mkdir(parents=True, exist_ok=True)
    if whole is not None:
        write_parquet(whole, out / DAY if kind.hourly else out, **origin)
    for hour, table in hours.items():
        write_parquet(table, out / f"{hour:02d}.parquet", hour=hour, **origin)
