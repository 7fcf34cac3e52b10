"""Prequential scores of maps that are updated: each hour is scored with what was known before it, then it is learned.

A. Dawid, Statistical theory: the prequential approach, J. R. Stat. Soc. A 147, 1984. A score is the mean negative log
density of the velocities of an hour's people, mixed with that of no map, so that places without dynamics count, too.
Beside the recordings as they are there is a planted reversal: of one-way streets, in half of the place, from some hour
on. How fast a map follows it there, and what it forgets meanwhile of the other half, can be read off.
"""

from typing import Any

import numpy as np
import pandas as pd

from modlhmp.maps import density
from modlhmp.scoring.likelihood import with_background
from modlhmp.scoring.ttests import mean_test
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, clock_numbers
from modlhmp.updates import UpdatedMap

HALF_LIVES_H = {"half-life 1 h": 1.0, "half-life 3 h": 3.0, "half-life 12 h": 12.0}
NEVER, HISTORY, LAST, NO_MAP = "never updated", "all history", "the last hour only", "no map"
MAPS = (NEVER, HISTORY, *HALF_LIVES_H, LAST)
WEIGHT = 0.05  # of the background: the same for all, so that none is chosen on what is scored
LEAST_ROWS = 100  # of an hour
COLUMNS = ("number", "hour", "map", "part", "nll", "covered", "n")


def scores(
    tracks: Tracks, site: Site, half: np.ndarray | None = None, person: np.ndarray | None = None
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Scores of each hour after the first by map and part of the place, and over all these hours.

    The first table has `COLUMNS`: `number` counts the hours, `hour` is the clock's; the second has for each map `nll`,
    `covered`, `n`, and by how much it is worse than all history, `worse`, with its 95 % interval by person `low`,
    `high` [nat]. `half` [n] says which rows are of part 1; default: none. `person` [n] says whose each row is; default:
    each track is a person. Tracks of several days have ids of their own.
    """
    person = tracks.track_id if person is None else person
    half = np.zeros(len(tracks.t), bool) if half is None else half
    hours, usable = clock_numbers(tracks.t, site.timezone), tracks.moves()
    maps = {NEVER: UpdatedMap("cliff", site), HISTORY: UpdatedMap("cliff", site)}
    maps |= {name: UpdatedMap("cliff", site, half_life_h) for name, half_life_h in HALF_LIVES_H.items()}
    rows: list[tuple[Any, ...]] = []
    pooled: list[pd.DataFrame] = []
    speeds: list[np.ndarray] = []
    for number, hour in enumerate(np.unique(hours[usable])):
        now = usable & (hours == hour)
        people, part = tracks.take(now), half[now]
        if number and len(people.t) >= LEAST_ROWS:
            asked = people.x, people.y, people.t, people.heading, people.speed
            without, mixed = density.NoMap(np.concatenate(speeds)).log_density(*asked), {}
            for name in (*MAPS, NO_MAP):
                known = _log_density(maps[name], site, asked) if name in maps else np.full(len(people.t), np.nan)
                mixed[name] = with_background(known, without, WEIGHT)
                for of in np.unique(part):
                    some = part == of
                    facts = -mixed[name][some].mean(), np.isfinite(known[some]).mean(), some.sum()
                    rows.append((number, hour % 24, name, int(of), *facts))
            pooled.append(pd.DataFrame({**mixed, "person": person[now]}))
        maps[LAST] = UpdatedMap("cliff", site)
        for name, one in maps.items():
            if name != NEVER or not number:
                one.add(people)
        speeds.append(people.speed)
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    return table, _overall(table, pd.concat(pooled) if pooled else None)


def _log_density(one: UpdatedMap, site: Site, asked: tuple[np.ndarray, ...]) -> np.ndarray:
    """Log densities [n] of a map as it is now; NaN of one that is empty, such as that of an hour of few people."""
    try:
        whole = one.written().whole
    except DataError:
        return np.full(len(asked[0]), np.nan)
    return density.load("cliff", whole, site).log_density(*asked)


def _overall(table, pooled):
    """The second table of `scores`."""
    rows = []
    for name in (*MAPS, NO_MAP) if pooled is not None else ():
        mine = table[table["map"] == name]
        worse = mean_test((pooled[HISTORY] - pooled[name]).to_numpy(), pooled["person"].to_numpy())
        rows.append((name, -pooled[name].mean(), np.average(mine["covered"], weights=mine["n"]), len(pooled),
                     worse.mean, worse.low, worse.high))  # fmt: skip
    return pd.DataFrame(rows, columns=["map", "nll", "covered", "n", "worse", "low", "high"])


def planted(tracks: Tracks, timezone: str) -> tuple[Tracks, np.ndarray, int]:
    """One-way streets of which half turn round: (rows, which of them [n] are in that half, the number of that hour).

    Of the tracks the pieces are taken that walk the way of most, each as a track of its own; from the middle hour on
    rows in the half of the place with the larger x (by rows) walk the opposite way.
    """
    heading = np.where(tracks.speed > 0, tracks.heading, np.nan)
    way = np.arctan2(np.nansum(np.sin(2 * heading)), np.nansum(np.cos(2 * heading))) / 2  # the axis of the place
    way += np.pi * (np.nansum(np.cos(heading - way)) < 0)
    kept = np.flatnonzero(np.cos(heading - way) > 0)
    piece = np.cumsum((np.diff(kept, prepend=-1) > 1) | (np.diff(tracks.track_id[kept], prepend=-1) != 0))
    tracks = tracks.take(kept)._replace(track_id=piece)
    hours = clock_numbers(tracks.t, timezone)
    known = np.unique(hours)
    half = tracks.x > np.median(tracks.x) if len(tracks.x) else np.zeros(0, bool)
    if not len(known):
        return tracks, half, 0
    number = len(known) // 2
    turned = half & (hours >= known[number])
    heading = np.where(turned, tracks.heading - np.pi * np.where(tracks.heading > 0, 1, -1), tracks.heading)
    return tracks._replace(heading=heading), half, number
