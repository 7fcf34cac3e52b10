"""How much faster is one more hour added to a map of the day than the day's map built anew? Ratios in one run.

    .venv/bin/python benchmarks/map_update.py results/real/atc_1day/tracks/<recording>.parquet Asia/Tokyo 13 --runs 10

The map holds all of the recording but the hour named; adding it, and writing the map out for forecasts, is timed in
turns with building the map of all rows at once, in seconds of one processor core, kernels compiled. Printed are the
medians and the median of the ratios with the 95 % interval of that median (M. Hollander, D. Wolfe, 1973), for CLiFF,
STeF and episodes; and how much the map holds.
"""

import argparse
import logging
import os
import tempfile
import time

import numpy as np

from modlhmp.api import build_map
from modlhmp.site import Site
from modlhmp.tracks import clock_hours, read_tracks
from modlhmp.updates import UpdatedMap


def timed(work):
    """Processor seconds of a call."""
    start = time.process_time()
    work()
    return time.process_time() - start


def compare(kind, tracks, site, hour, runs):
    """Seconds [runs, 3] to add the hour, to write the map out, and to build it of all rows."""
    mine = clock_hours(tracks.t, site.timezone) == hour
    before = UpdatedMap(kind, site)
    before.add(tracks.take(~mine))
    before.written()
    day, seconds = str(np.datetime64(int(tracks.t[0] + 9 * 3600), "s"))[:10], []
    with tempfile.NamedTemporaryFile(suffix=".parquet") as file:
        before.save(file.name)
        for _ in range(runs):
            told = UpdatedMap.load(file.name)
            told.written()  # what an hour before had read
            added = timed(lambda told=told: told.add(tracks.take(mine)))
            written = timed(told.written)
            seconds.append((added, written, timed(lambda: build_map(kind, tracks, site))))
        told.save(file.name)
        size = os.path.getsize(file.name)
    print(f"{kind:9s} {mine.sum()} of {len(tracks.t)} rows, state of {day} {size / 1e6:.1f} MB")
    return np.array(seconds)


def main():
    """Print one line a kind."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("tracks")
    asked.add_argument("timezone")
    asked.add_argument("hour", type=int)
    asked.add_argument("--runs", type=int, default=10)
    asked.add_argument("--kinds", default="cliff,stef,episodes")
    given = asked.parse_args()
    logging.disable()
    tracks, site = read_tracks(given.tracks), Site(timezone=given.timezone)
    few = tracks.take(slice(0, 2000))
    for kind in given.kinds.split(","):
        UpdatedMap(kind, site).add(few)
        build_map(kind, few, site)
        seconds = compare(kind, tracks, site, given.hour, given.runs)
        ratio = np.sort(seconds[:, 2] / seconds[:, :2].sum(axis=1))
        low = max(int(np.floor((len(ratio) - 1.96 * np.sqrt(len(ratio))) / 2)), 0)
        added, written, built = np.median(seconds, axis=0)
        print(f"          add {added:.3f} s, write {written:.3f} s, build anew {built:.3f} s: {np.median(ratio):.1f} "
              f"times faster ({ratio[low]:.1f} to {ratio[-1 - low]:.1f}, {given.runs} runs)", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
