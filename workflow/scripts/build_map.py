"""Rules build_{kind}."""

from pathlib import Path

from modlhmp.kinds import find
from modlhmp.logs import job_log
from modlhmp.maps.base import DAY
from modlhmp.methods import build_map
from modlhmp.origins import provenance
from modlhmp.settings import as_plain, build
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.tracks import read_people

with job_log(snakemake.log[0]) as log:
    params, kind = snakemake.params, find(snakemake.params.kind)
    (tracks, person), site = read_people(snakemake.input.tracks), build(Site, params.dataset)
    whole, hours = build_map(kind.name, tracks, site, build(kind.building, params.building), person)
    origin = provenance(dict(snakemake.wildcards), dict(params), snakemake.input)
    origin |= {"kind": kind.name, "site": as_plain(site)}
    if whole is not None:
        log.info("%d rows of tracks, %d rows of the map", len(tracks.t), whole.num_rows)
        write_parquet(whole, Path(snakemake.output.map, DAY) if kind.hourly else snakemake.output.map, **origin)
    if kind.hourly:
        Path(snakemake.output.map).mkdir(parents=True, exist_ok=True)
    for hour, table in hours.items():
        write_parquet(table, Path(snakemake.output.map) / f"{hour:02d}.parquet", hour=hour, **origin)
