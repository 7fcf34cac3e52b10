"""Which options make a map true? Likelihood of persons held out of the training data, option by option.

    .venv/bin/python benchmarks/map_options.py results/real/atc_1day/tracks/<training recording>.parquet Asia/Tokyo

Maps of the whole day and of its hours are built from 85 % of the persons with one option changed at a time, and scored
on the others' velocities by place and time only: negative log density with the background that suits it best, less that
of the line above it that is not indented. Then the same with half-hours held out, so that nobody's companions are in
the map. Takes many minutes; names given after the time zone choose lines that begin so.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from modlhmp.maps import cliff, stef, tc_cliff
from modlhmp.maps.density import Density, NoMap, load
from modlhmp.maps.histogram import Bins, Level, histogram
from modlhmp.options import CliffBuilding, StefBuilding
from modlhmp.scoring.likelihood import choose_weight, with_background
from modlhmp.scoring.ttests import mean_test
from modlhmp.site import Site
from modlhmp.splits import in_validation_blocks
from modlhmp.study.likelihood import EIGHT, held_out
from modlhmp.tracks import Tracks, read_tracks

Make = Callable[[Tracks, NoMap], Density]
FINE = Bins(36, 0.1, 0.15, 0.08)


def cliff_maps(site: Site) -> Iterator[tuple[str, Make]]:
    """CLiFF-maps of the day, one option changed at a time."""
    base = CliffBuilding()
    ways = {
        "CLiFF, day": base,
        "  bandwidth kucner": replace(base, bandwidth="kucner"),
        "  at least 10 observations": replace(base, min_observations=10),
        "  at least 20 observations": replace(base, min_observations=20),
        "  radius 0.5 m": replace(base, radius_m=0.5),
        "  radius 0.75 m": replace(base, radius_m=0.75),
        "  radius 1.5 m": replace(base, radius_m=1.5),
        "  lattice 0.5 m": replace(base, resolution_m=0.5),
        "  lattice 0.5 m, radius 0.5 m": replace(base, resolution_m=0.5, radius_m=0.5),
    }
    for name, building in ways.items():
        yield name, lambda tracks, no_map, how=building: load("cliff", cliff.build(tracks, site, how), site)
    for least in (3, 10, 20):
        yield f"  clusters of at least {least}", lambda tracks, no_map, n=least: clusters(n, tracks, site)
    yield "TC-CLiFF, hours", lambda tracks, no_map: load("tc_cliff", tc_cliff.build_hours(tracks, site)[1], site)


def clusters(least: int, tracks: Tracks, site: Site) -> Density:
    """A CLiFF-map whose smaller clusters are merged; the limit is a constant of compiled code, so this runs plain."""
    compiled, usual = cliff._merge_small, cliff.MIN_CLUSTER
    cliff._merge_small, cliff.MIN_CLUSTER = compiled.py_func, least
    try:
        return load("cliff", cliff.build(tracks, site), site)
    finally:
        cliff._merge_small, cliff.MIN_CLUSTER = compiled, usual


def other_maps(site: Site) -> Iterator[tuple[str, Make]]:
    """STeF-maps and histograms."""
    for name, building in {
        "STeF, hours": StefBuilding(),
        "  interval 3600 s": StefBuilding(interval_s=3600.0),
        "  order 5": StefBuilding(order=5),
    }.items():
        yield (
            name,
            lambda tracks, no_map, how=building: load("stef", stef.build_hours(tracks, site, how)[1], site, no_map),
        )
    for name, levels in {
        "8 directions, day": [Level(EIGHT)],
        **{f"  hours, k {k:g}": [Level(EIGHT), Level(k, hourly=True)] for k in (2.0, 8.0, 32.0, 128.0)},
    }.items():
        yield name, lambda tracks, no_map, how=levels: histogram(tracks, site, no_map, 1.0, how)
    wide = Level(20.0, 2.0)
    fine = {
        "smoothed, day, 0.6 m": (0.5, [wide, Level(20.0, 0.6)], FINE),
        "  0.4 m": (0.5, [wide, Level(20.0, 0.4)], FINE),
        "  cells 0.25 m, 0.25 m": (0.25, [wide, Level(20.0, 0.6), Level(20.0, 0.25)], FINE),
        "  wider bins": (0.5, [wide, Level(20.0, 0.6)], Bins(36, 0.1, 0.25, 0.15)),
        "  sharper bins": (0.5, [wide, Level(20.0, 0.6)], Bins(36, 0.1, 0.1, 0.05)),
        "  k 100": (0.5, [Level(100.0, 2.0), Level(100.0, 0.6)], FINE),
        "  hours, day as 32": (0.5, [wide, Level(20.0, 0.6), Level(32.0, 0.6, hourly=True)], FINE),
        "  hours, day as 128": (0.5, [wide, Level(20.0, 0.6), Level(128.0, 0.6, hourly=True)], FINE),
    }
    for name, how in fine.items():
        yield name, lambda tracks, no_map, how=how: histogram(tracks, site, no_map, *how)


def log_densities(one: Density, rows: Tracks, no_map: NoMap) -> tuple[np.ndarray, np.ndarray]:
    """Log densities [n] with a background, of headings with speeds and of headings alone."""
    where = rows.x, rows.y, rows.t
    found = []
    for question, velocity in (("log_density", (rows.heading, rows.speed)), ("log_heading", (rows.heading,))):
        log_p, without = (getattr(each, question)(*where, *velocity) for each in (one, no_map))
        found.append(with_background(log_p, without, choose_weight(log_p, without)))
    return found[0], found[1]


def main(path: str, timezone: str, *only: str) -> None:
    """Print a line per way of holding out and option; `only` those whose name begins so, if any are given."""
    tracks, site = read_tracks(path), Site(timezone=timezone)
    by_block = np.repeat(in_validation_blocks(tracks), np.diff(tracks.bounds()))
    for held, how in ((held_out(tracks.track_id), "persons"), (by_block, "blocks")):
        walks = tracks.moves()
        fit, tried = tracks.take(walks & ~held), tracks.take(walks & held)
        no_map, first = NoMap(fit.speed), None
        print(f"{how}: {len(fit.t)} rows in maps, {len(tried.t)} rows held out")
        for name, make in (("no map", lambda tracks, no_map: no_map), *cliff_maps(site), *other_maps(site)):
            if only and name != "no map" and not name.strip().startswith(only):
                continue
            found = log_densities(make(fit, no_map), tried, no_map)
            first = found if first is None or not name.startswith(" ") else first
            change = mean_test(first[0] - found[0], tried.track_id)
            print(
                f"{how:8s} {name:28s} joint {-found[0].mean():.4f} {change.mean:+.4f} [{change.low:+.4f}, "
                f"{change.high:+.4f}]  headings {-found[1].mean():.4f}",
                flush=True,
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
