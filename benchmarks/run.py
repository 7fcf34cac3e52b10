"""Speed and memory of the stages: `make bench` -> results/bench.json.

Each line gives the measured figure and, where there is one, the ratio to the slow plain twin of tests/reference
measured in the same run. The recordings are the real ones where MODLHMP_DATA has them, else the demo's: the first
line says which. One core unless said; kernels are compiled before the clock starts.
"""

import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import yaml

from modlhmp.cleaning import clean_recording
from modlhmp.demo import RECORDINGS, write_recording
from modlhmp.forecasting import forecast_recording, make_forecaster
from modlhmp.forecasting.base import stream_keys, uniforms
from modlhmp.forecasting.observe import current_velocity, observe, usable_tracks
from modlhmp.forecasting.rollout import roll_out
from modlhmp.maps import cliff, episodes, map_path, mean_shift, snippets, swgmm
from modlhmp.maps.stef import build as build_stef
from modlhmp.maps.stef import evaluate, middle_of_hour
from modlhmp.scoring import score_recording
from modlhmp.settings import load_dataset, method_settings
from modlhmp.storage import read_parquet, write_parquet
from modlhmp.tracks import clock_hours

ROOT = Path(__file__).parents[1]
CONFIG = yaml.safe_load((ROOT / "config/config.yaml").read_text())


def main():
    """Measure everything, print it, write results/bench.json."""
    figures = {
        "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
    }
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        train, test, dataset = tracks(folder, figures)
        figures |= reading(folder)
        figures |= maps(train, dataset, folder / "maps")
        figures |= forecasts(test, dataset, folder / "maps")
        figures |= ratios(train, test, dataset, folder / "maps")
    for name, value in figures.items():
        print(f"{name:60s} {value}")
    out = ROOT / "results/bench.json"
    out.parent.mkdir(exist_ok=True)
    out.write_text(json.dumps(figures, indent=2) + "\n")


def tracks(folder, figures):
    """Training and test tracks of an ATC day, real or made up."""
    name, data_root = "atc_1day", os.environ.get("MODLHMP_DATA")
    if not data_root or not (Path(data_root) / "atc").is_dir():
        name, data_root = "demo_hall", folder
        for recording in (r for r in RECORDINGS if r.site == "hall"):
            write_recording(folder / recording.file, recording.site, recording.day, seed=1)
    schema = yaml.safe_load((ROOT / "workflow/schemas/dataset.schema.yaml").read_text())
    dataset = load_dataset(ROOT / f"config/datasets/{name}.yaml", schema, data_root)
    figures["recordings"] = dataset["title"]
    by_split = {r["split"]: clean_recording(r["path"], dataset, r)[0] for r in dataset["recordings"]}
    return by_split["train"], by_split["test"], dataset


def reading(folder):
    """Raw ATC CSV to clean 1 Hz tracks, 2 threads: speed, and peak memory at two sizes, each in its own process."""
    found = {}
    for scale in (4, 16):
        path = folder / f"raw-{scale}.csv"
        write_recording(path, "hall", "2030-10-02", seed=1, scale=scale)
        done = subprocess.run([sys.executable, __file__, "read", path], capture_output=True, text=True, check=True)
        seconds, peak_mb = map(float, done.stdout.split())
        size = path.stat().st_size / 1e6
        found[f"raw ATC CSV of {size:.0f} MB to 1 Hz [MB/s]"] = round(size / seconds, 1)
        found[f"raw ATC CSV of {size:.0f} MB, peak memory [MB]"] = round(peak_mb)
        path.unlink()
    return found


def read_alone(path):
    """Clean one raw file, after its first lines have loaded the kernels; print seconds and peak memory [MB]."""
    dataset = {"reader": "atc", "timezone": "Asia/Tokyo", "time_step_s": 1.0, "cleaning": ["single_row", "gap_over_5s"]}
    head = Path(f"{path}.head")
    with open(path, "rb") as file:
        head.write_bytes(b"".join(file.readline() for _ in range(20_000)))
    clean_recording(head, dataset, {"day": "2030-10-02"})
    head.unlink()
    start = time.perf_counter()
    clean_recording(path, dataset, {"day": "2030-10-02"})
    print(time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def maps(train, dataset, folder):
    """Build every map of the training recordings."""
    hours = clock_hours(train.t, dataset["timezone"])
    cliff.build(train.take(hours == np.unique(hours)[0]))  # compiles
    found, start = {}, time.perf_counter()
    write_parquet(cliff.build(train), map_path(folder, "cliff"))
    found["CLiFF-map of the whole recording [s]"] = time.perf_counter() - start
    start = time.perf_counter()
    for hour in np.unique(hours):
        write_parquet(cliff.build(train.take(hours == hour)), map_path(folder, "tc_cliff") / f"{hour:02d}.parquet")
    found["CLiFF-maps of all hours [s]"] = time.perf_counter() - start
    start = time.perf_counter()
    stef = build_stef(train, dataset["timezone"])
    found["STeF-map [s]"] = time.perf_counter() - start
    for hour in range(*dataset["hours"]):
        write_parquet(evaluate(stef, middle_of_hour(hour)), map_path(folder, "stef") / f"{hour:02d}.parquet")
    for kind, build in (("episodes", episodes.build), ("snippets", snippets.build)):
        start = time.perf_counter()
        write_parquet(build(train, dataset["time_step_s"]), map_path(folder, kind))
        found[f"{kind} map [s]"] = time.perf_counter() - start
    size = np.mean([file.stat().st_size for file in map_path(folder, "tc_cliff").glob("*.parquet")])
    found["one hourly CLiFF-map on disk [kB]"] = size / 1000
    return {name: round(value, 2) for name, value in found.items()}


def forecasts(test, dataset, folder):
    """Forecasts to the longest horizon with the configuration's options, and their scoring, milliseconds a track."""
    found = {}
    for kind in ("tc_cliff", "cliff", "stef", "episodes", "snippets"):
        options = method_settings(CONFIG, kind, dataset["tuned"])["options"]
        forecaster = make_forecaster(kind, options, dataset, map_path(folder, kind))

        def run(seeds, forecaster=forecaster, kind=kind, k=options["k"]):
            return list(forecast_recording(test, forecaster, dataset, ("bench", kind, "test"), k, seeds))

        run([0])
        start = time.perf_counter()
        made = run([1, 2, 3])
        tracks_made = sum(len(ids) for _, ids, _ in made)
        found[f"forecast {kind}, k = {options['k']}, {dataset['horizon_s']} s [ms a track]"] = (
            1e3 * (time.perf_counter() - start) / tracks_made
        )
        start = time.perf_counter()
        score_recording(test, made, "test", dataset)
        found[f"scoring {kind}, both protocols [ms a track]"] = 1e3 * (time.perf_counter() - start) / tracks_made
    return {name: round(value, 4) for name, value in found.items()}


def ratios(train, test, dataset, folder):
    """How many times faster than the plain twins, on a location of 300 observations and on 10 tracks."""
    sys.path.insert(0, str(ROOT / "tests/reference"))
    import twins  # noqa: PLC0415 - not a package

    moving = train.take(train.speed != 0)
    _, members = cliff.neighbourhoods(moving.x, moving.y, 1.0, 1.0, 300)
    heading, speed = moving.heading[members[0][:300]], moving.speed[members[0][:300]]
    bandwidth = mean_shift.bandwidth_isotropic(heading, speed)
    labels, _ = mean_shift.mean_shift(heading, speed, bandwidth)
    start = [[np.mean(labels == j), *swgmm.moments(heading[labels == j], speed[labels == j])] for j in set(labels)]
    found = {
        "mean shift": (
            seconds(mean_shift.mean_shift, heading, speed, bandwidth),
            seconds(twins.mean_shift, heading, speed, bandwidth),
        ),
        "EM": (seconds(swgmm.fit, heading, speed, start), seconds(twins.em, heading, speed, np.array(start))),
    }
    table = read_parquet(map_path(folder, "cliff"))
    observed = observe(test, usable_tracks(test)[:10])
    velocity, keys = current_velocity(observed, "columns"), stream_keys(observed.track_id, 5, 0)
    slow = twins.PlainCliff({name: table[name].to_numpy() for name in cliff.COLUMNS}, 1.0)
    draws = np.stack([uniforms(keys.ravel(), step, 3) for step in range(60)], axis=1)

    def plain():
        for particle, track in enumerate(np.repeat(np.arange(10), 5)):
            state = observed.x[track, -1], observed.y[track, -1], velocity[0][track], velocity[1][track]
            twins.roll_out(slow, *state, draws[particle], 1.0, 1.0, "constant")

    found["roll-out"] = seconds(roll_out, cliff.CliffMap(table), observed, velocity, 60, keys), seconds(plain)
    return {f"{name}: times faster than the plain twin": round(slow / fast) for name, (fast, slow) in found.items()}


def seconds(function, *arguments):
    """Shortest of three runs, after one that compiles."""
    times = []
    for _ in range(4):
        start = time.perf_counter()
        function(*arguments)
        times.append(time.perf_counter() - start)
        if sum(times) > 5.0:
            break
    return min(times[1:] or times)


if __name__ == "__main__":
    if sys.argv[1:2] == ["read"]:
        read_alone(sys.argv[2])
    else:
        main()
