"""Which mean-shift bandwidth rule describes new people better? Held-out log-likelihood an observation.

    .venv/bin/python benchmarks/mean_shift_kernel.py results/real/atc_1day/tracks/<recording>.parquet Asia/Tokyo

Maps of every clock hour and of the whole recording are built from 85 % of the persons of a training recording
and scored on the others' velocities, at the location that a forecast would use.
"""

import sys

import numpy as np

from modlhmp.maps import cliff, swgmm
from modlhmp.maps.mean_shift import BANDWIDTHS
from modlhmp.options import CliffBuilding
from modlhmp.tracks import clock_hours, read_tracks


def held_out(tracks, validation, rule="isotropic"):
    """Sum of log densities, number of scored observations, components and locations of a map."""
    table = cliff.build(tracks.take(~validation), building=CliffBuilding(bandwidth=rule))
    mod = cliff.CliffMap(table)
    scored = tracks.take(validation & np.isfinite(tracks.heading) & (tracks.speed != 0))
    location = mod.locate(scored.x, scored.y)
    total = sum(
        swgmm.log_density(scored.heading[location == one], scored.speed[location == one], mod.mixture(one)).sum()
        for one in np.unique(location[location >= 0])
    )
    return np.array([total, (location >= 0).sum(), table.num_rows, len(mod.x)])


def validation_rows(tracks):
    """Rows of 15 % of the persons."""
    persons = np.unique(tracks.track_id)
    chosen = np.random.default_rng(1).permutation(persons)[: len(persons) * 15 // 100]
    return np.isin(tracks.track_id, chosen)


def main(path, timezone):
    """Print one line per hour and rule, and the whole recording's."""
    tracks = read_tracks(path)
    validation = validation_rows(tracks)
    hours = clock_hours(tracks.t, timezone)
    for rule in BANDWIDTHS:
        sums = np.zeros(4)
        for hour in np.unique(hours):
            sums += held_out(tracks.take(hours == hour), validation[hours == hour], rule)
        whole = held_out(tracks, validation, rule)
        for name, (total, n, components, locations) in (("hourly", sums), ("whole day", whole)):
            print(
                f"{rule:10s} {name:10s} {total / n:8.4f} nat/observation, n {n:.0f}, "
                f"{components / locations:.2f} components per location"
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
