"""Time-conditioned CLiFF-map: a CLiFF-map for every clock hour that has training data (paper Sec. III-C.2)."""

import logging
from pathlib import Path

import pyarrow as pa

from modlhmp.maps import cliff
from modlhmp.maps.base import hours_mapped
from modlhmp.options import CliffBuilding, RollOut
from modlhmp.site import Site
from modlhmp.tracks import Tracks, clock_hours


def build_hours(
    tracks: Tracks, site: Site, building: CliffBuilding | None = None
) -> tuple[pa.Table | None, dict[int, pa.Table]]:
    """(the CLiFF-map of the whole day, {hour: its CLiFF-map}); an hour with too few data has none."""
    log, hours, maps = logging.getLogger("modlhmp"), clock_hours(tracks.t, site.timezone), {}
    for hour in hours_mapped(tracks, site):
        table = cliff.build(tracks.take(hours == hour), site, building)
        log.info("hour %02d: %d rows of tracks, %d components", hour, (hours == hour).sum(), table.num_rows)
        if table.num_rows:
            maps[hour] = table
        else:
            log.info("hour %02d is skipped: too few training data", hour)
    return cliff.build(tracks, site, building), maps


def load(path: str | Path | pa.Table, site: Site, options: RollOut) -> cliff.CliffMap:
    """Read an hour's map, which is a CLiFF-map."""
    return cliff.load(path, site, options)


load_whole = load  # as is that of the whole day
