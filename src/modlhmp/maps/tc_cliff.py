"""Time-conditioned CLiFF-map: a CLiFF-map for every clock hour that has training data (paper Sec. III-B.2)."""

import logging
from pathlib import Path

import pyarrow as pa

from modlhmp.maps import cliff
from modlhmp.options import CliffBuilding, RollOut
from modlhmp.site import Site
from modlhmp.tracks import Tracks, clock_hours


def build_hours(
    tracks: Tracks, site: Site, building: CliffBuilding | None = None
) -> tuple[pa.Table | None, dict[int, pa.Table]]:
    """(None, {hour: CLiFF-map}) of the site's hours; one with too few data has no map, and its forecasts none."""
    log, hours, maps = logging.getLogger("modlhmp"), clock_hours(tracks.t, site.timezone), {}
    for hour in range(*site.hours):
        table = cliff.build(tracks.take(hours == hour), site, building)
        log.info("hour %02d: %d rows of tracks, %d components", hour, (hours == hour).sum(), table.num_rows)
        if table.num_rows:
            maps[hour] = table
        else:
            log.info("hour %02d is skipped: too few training data; its forecasts will stop at once", hour)
    return None, maps


def load(path: str | Path | pa.Table, site: Site, options: RollOut) -> cliff.CliffMap:
    """Read an hour's map, which is a CLiFF-map."""
    return cliff.load(path, site, options)
