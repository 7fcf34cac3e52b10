"""A robot's loop: rows come in, forecasts of everyone go out, and the robot asks whether somebody will be in its way.

    python notebooks/forecast_in_a_loop.py results/demo/demo_hall/maps/episodes.parquet \
        results/demo/demo_hall/tracks/atc-20301006.parquet

The rows are those of a recording's busiest minutes; a tracker's go the same way. The robot stands where most people
pass, unless told where, and waits while one of the cells around it will be occupied, within five seconds, with a
probability above a third.
"""

import argparse

import numpy as np

import modlhmp

AROUND_M, AHEAD_S, CAREFUL, WINDOW_S = 1.5, 5.0, 1 / 3, 300.0


def main() -> None:
    """Walk through the minutes, a time step after the other; print when the robot waits and when it goes on."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("map", help="an episode map, or another")
    asked.add_argument("tracks", help="a clean recording, whose people the robot meets")
    asked.add_argument("--robot", nargs=2, type=float, metavar=("X", "Y"), help="where it stands [m]")
    asked = asked.parse_args()

    live = modlhmp.Live(modlhmp.load_map(asked.map))
    live.warm_up()  # load what is compiled before people come
    rows = busiest(modlhmp.read_tracks(asked.tracks))
    cells, counts = np.unique(np.floor(np.column_stack([rows.x, rows.y])), axis=0, return_counts=True)
    x, y = asked.robot or cells[counts.argmax()] + 0.5
    around = (x - AROUND_M, x + AROUND_M, y - AROUND_M, y + AROUND_M)
    step_s, waits, moments = live.site.time_step_s, False, 0
    begin = moment = np.ceil(rows.t.min() / step_s) * step_s
    for row in np.argsort(rows.t, kind="stable"):
        while rows.t[row] > moment:  # all rows up to the moment have come
            futures = live.forecast(moment)
            p = futures.occupancy(extent=around).probabilities[: round(AHEAD_S / step_s)].max()
            if (p > CAREFUL) != waits:
                waits = not waits
                print(f"{moment - begin:5.0f} s: {len(futures.t0)} people, p = {p:.2f}: {'wait' if waits else 'go on'}")
            moment, moments = moment + step_s, moments + 1
        live.see(rows.t[row], int(rows.track_id[row]), rows.x[row], rows.y[row])
    print(f"the robot at ({x:.1f}, {y:.1f}): {moments} moments, {live.counts['taken']} rows")


def busiest(tracks: modlhmp.Tracks) -> modlhmp.Tracks:
    """The rows of the minutes with most rows."""
    window = (tracks.t // WINDOW_S).astype(np.int64)
    which, counts = np.unique(window, return_counts=True)
    return tracks.take(window == which[counts.argmax()])


if __name__ == "__main__":
    main()
