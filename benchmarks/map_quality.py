"""Does a CLiFF-map lose anything by its short cuts? Held-out log-likelihood an observation, against exact methods.

    .venv/bin/python benchmarks/map_quality.py results/real/atc_1day/tracks/<recording>.parquet Asia/Tokyo 10 13 17

Exact is mean shift from every observation over all observations, and plain EM over every observation with three
windings (`tests/reference/twins.py`). Maps of the hours named are built both ways from 85 % of the persons and scored
on the others' velocities. Takes some minutes per hour of the day.
"""

import sys
import time
from pathlib import Path

import numpy as np
from mean_shift_kernel import held_out, validation_rows

from modlhmp.kernels import kernel
from modlhmp.maps import cliff, mean_shift
from modlhmp.tracks import clock_hours, read_tracks

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/reference"))
import twins

PART = 1e-5  # of the bandwidth: a climb that moves less has ended


@kernel
def ends(heading, speed, bandwidth):
    """Where every observation climbs to [n, 2]: what `twins.mean_shift` does, compiled."""
    at = np.column_stack((heading, speed))
    for n in range(len(at)):
        for _ in range(5000):
            mass = turn = up = 0.0
            for i in range(len(heading)):
                dt, dr = heading[i] - at[n, 0], speed[i] - at[n, 1]
                dt -= 2 * np.pi * np.rint(dt / (2 * np.pi))
                for k in range(-1, 2):
                    away = dt + 2 * np.pi * k
                    share = np.exp(-0.5 * ((away / bandwidth[0]) ** 2 + (dr / bandwidth[1]) ** 2))
                    mass += share
                    turn += share * away
                    up += share * dr
            at[n, 0] += turn / mass
            at[n, 1] += up / mass
            if abs(turn) < PART * bandwidth[0] * mass and abs(up) < PART * bandwidth[1] * mass:
                break
    return at


def fit_exactly(heading, speed, bandwidth):
    """`cliff.fit_location` without short cuts."""
    width = mean_shift.BANDWIDTHS[bandwidth](heading, speed)
    modes, labels = [], np.empty(len(heading), np.int64)
    for n, end in enumerate(ends(heading, speed, width)):
        near = [m for m, mode in enumerate(modes) if twins.cylinder_distance(end, mode, width) < mean_shift.MERGE]
        labels[n] = near[0] if near else len(modes)
        if not near:
            modes.append(end)
    start = cliff._components_of(heading, speed, cliff._merge_small(heading, speed, labels))
    components, _ = twins.em(heading, speed, start)
    return components[np.argsort(-components[:, 0], kind="stable")]


def main(path, timezone, *hours):
    """Print one line per hour and way of building."""
    tracks = read_tracks(path)
    validation, hour_of = validation_rows(tracks), clock_hours(tracks.t, timezone)
    ways = {"ours": cliff.fit_location, "exact": fit_exactly}
    for hour in map(int, hours):
        for name, fit in ways.items():
            cliff.fit_location, start = fit, time.perf_counter()
            total, n, components, locations = held_out(tracks.take(hour_of == hour), validation[hour_of == hour])
            print(
                f"{hour:02d} h {name:6s} {total / n:8.4f} nat/observation, n {n:.0f}, "
                f"{components / locations:.2f} components per location, {time.perf_counter() - start:.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
