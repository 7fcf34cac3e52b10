"""Speed and memory against the project's goals: `make bench` prints a table and writes results/bench.json.

The recordings are the real ones where MODLHMP_DATA has them, else the demo's: the first line says which. One core
unless said; kernels are compiled before the clock starts. Where a slow plain twin of tests/reference does the same, it
is timed in the same run, on as little as it needs, and the last column says how many times longer it takes.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml

from modlhmp.cleaning import clean_recording
from modlhmp.datasets import load_dataset
from modlhmp.file_format import FileFormat, Recording
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.observe import current_velocity, observe
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.kinds import find
from modlhmp.maps import cliff, episodes, mean_shift, snippets, stef, swgmm
from modlhmp.maps.pieces import Metric
from modlhmp.methods import make_forecaster
from modlhmp.scoring.errors import ground_truth
from modlhmp.scoring.recording import score_recording
from modlhmp.settings import as_plain
from modlhmp.storage import column, read_parquet, write_parquet
from modlhmp.streams import stream_keys, uniforms
from modlhmp.study import runtime
from modlhmp.study.configuration import load_run
from modlhmp.study.demo import RECORDINGS, write_recording
from modlhmp.study.layout import Layout
from modlhmp.tracks import clock_hours, clock_time, concatenate, read_tracks, usable_tracks, write_tracks

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests/reference"))
import memory_twins  # noqa: E402 - not packages
import twins  # noqa: E402

CONFIG = {}
for file in ("budgets", "config"):
    CONFIG |= yaml.safe_load((ROOT / f"config/{file}.yaml").read_text())
RUN = load_run(CONFIG, ROOT / "config/datasets")
SIZES = (4, 16)  # of the raw ATC file: memory is to be the same
FIRST_FORECAST = """
import json, sys
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.methods import Method, make_forecaster
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.tracks import read_tracks, usable_tracks
task = json.load(open(sys.argv[1]))
method, site = Method.of(task["method"]), build(Site, task["dataset"])
forecaster = make_forecaster(method.kind, method.options, site, task["map"])
tracks = read_tracks(task["tracks"])
one = tracks.take(slice(0, usable_tracks(tracks)[0, 1] + 1))
list(forecast_recording(one, forecaster, site, ("a", "b", "c"), 5, [0]))
"""


class Row(NamedTuple):
    """A figure and its goals; `twin`: how many times longer the plain twin takes, None where there is none."""

    what: str
    value: float
    unit: str
    must: float = None
    stretch: float = None
    twin: float = None

    def reached(self):
        """Which goal is reached."""
        if self.must is None:
            return ""
        more_is_better = self.stretch > self.must
        for name, goal in (("stretch", self.stretch), ("must", self.must)):
            if self.value >= goal if more_is_better else self.value <= goal:
                return name
        return "NOT"


def main():
    """Measure everything; print it as it comes, then as a table."""
    with tempfile.TemporaryDirectory() as scratch:
        folder, rows = Path(scratch), []
        title, train, test, dataset = recordings(folder)
        write_tracks(train, folder / "train.parquet")
        write_tracks(test, folder / "test.parquet")
        stages = (
            lambda: cliff_maps(train, dataset, folder),
            lambda: other_maps(train, dataset, folder / "maps"),
            lambda: roll_outs(test, dataset, folder / "maps"),
            lambda: with_memory(train, test, dataset, folder / "maps"),
            lambda: reading(folder),
            lambda: scoring(test, dataset, folder / "maps"),
            lambda: jobs(test, dataset, folder),
        )
        for stage in stages:
            for row in stage():
                print(f"{row.what:60s} {row.value:10.4g} {row.unit}", flush=True)
                rows.append(row)
    machine = runtime.machine()
    print(f"\n{title}; {machine['cpu']}, {machine['cores']} cores, Python {machine['python']}\n")
    print("| what | measured | must | stretch | reached | plain twin takes |\n|---|---|---|---|---|---|")
    for row in rows:
        goals = ("" if goal is None else f"{goal:g}" for goal in (row.must, row.stretch))
        twin = "" if row.twin is None else f"{row.twin:,.0f} times longer"
        print(f"| {row.what} | {row.value:.3g} {row.unit} | {' | '.join(goals)} | {row.reached()} | {twin} |")
    out = ROOT / "results/bench.json"
    out.parent.mkdir(exist_ok=True)
    measured = [{**row._asdict(), "reached": row.reached()} for row in rows]
    out.write_text(json.dumps({"recordings": title, "machine": machine, "rows": measured}, indent=2) + "\n")


def recordings(folder):
    """Title, training tracks, test tracks and settings of an ATC day, real or made up."""
    name, data_root = "atc_1day", os.environ.get("MODLHMP_DATA")
    if not data_root or not (Path(data_root) / "atc").is_dir():
        name, data_root = "demo_hall", folder
        for recording in (r for r in RECORDINGS if r.site == "hall"):
            write_recording(folder / recording.file, recording.site, recording.day, seed=1)
    dataset = load_dataset(ROOT / f"config/datasets/{name}.yaml", data_root)
    by_split = {one.split: clean_recording(one.path, dataset, one)[0] for one in dataset.recordings}
    return dataset.title, by_split["train"], by_split["test"], dataset


def map_path(folder, kind):
    """Where a kind's map lies."""
    return Path(folder) / find(kind).map_file


def cliff_maps(train, dataset, folder):
    """CLiFF-maps: hour 13, whole day and all hours side by side in two processes, one hour's size on disk."""
    hours = clock_hours(train.t, dataset.timezone)
    hour = train.take(hours == 13)
    cliff.build(train.take(hours == np.unique(hours)[0]))  # compiles
    taken = seconds(cliff.build, hour)
    moving = hour.take(hour.speed != 0)
    _, members = cliff.neighbourhoods(moving.x, moving.y, 1.0, 1.0, 5)
    sizes = np.argsort([len(mine) for mine in members])
    some = [members[row] for row in sizes[:: len(sizes) // 12]]
    ours = seconds(lambda: [cliff.fit_location(moving.heading[mine], moving.speed[mine]) for mine in some])
    plain = seconds(lambda: [plain_location(moving.heading[mine], moving.speed[mine]) for mine in some], repeat=1)
    yield Row(f"CLiFF-map of hour 13, {len(hour.t):,} rows", taken, "s", 2.5, 1.0, plain / ours)
    start = time.perf_counter()
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        work = [(folder / "train.parquet", folder / "maps", kind, dataset.timezone) for kind in ("tc_cliff", "cliff")]
        list(pool.map(build_cliff, *zip(*work, strict=True)))
    name = f"all {1 + len(np.unique(hours))} CLiFF-maps of the day, 2 cores, with start"
    yield Row(name, time.perf_counter() - start, "s", 25, 10)
    size = np.mean([file.stat().st_size for file in map_path(folder / "maps", "tc_cliff").glob("*.parquet")])
    yield Row("one hourly CLiFF-map on disk", size / 1000, "kB", 80, 60)


def build_cliff(tracks, folder, kind, timezone):
    """Build and write the whole day's map or every hour's."""
    tracks = read_tracks(tracks)
    if kind == "cliff":
        write_parquet(cliff.build(tracks), map_path(folder, kind))
        return
    hours = clock_hours(tracks.t, timezone)
    for hour in np.unique(hours):
        write_parquet(cliff.build(tracks.take(hours == hour)), map_path(folder, kind) / f"{hour:02d}.parquet")


def plain_location(heading, speed):
    """`cliff.fit_location` by the plain twins."""
    labels, _ = twins.mean_shift(heading, speed, mean_shift.bandwidth_isotropic(heading, speed))
    start = [
        [np.mean(labels == j), *swgmm.moments(heading[labels == j], speed[labels == j])] for j in np.unique(labels)
    ]
    return twins.em(heading, speed, np.array(start))


def other_maps(train, dataset, folder):
    """STeF, episode and snippet maps."""
    built = []
    taken = seconds(lambda: built.append(stef.build(train, dataset)), repeat=3)
    for hour in np.unique(clock_hours(train.t, dataset.timezone)):
        evaluated = stef.evaluate(built[0], stef.middle_of_hour(hour))
        write_parquet(evaluated, map_path(folder, "stef") / f"{hour:02d}.parquet")
    cell = train.take((np.floor(train.x) == np.floor(train.x[0])) & (np.floor(train.y) == np.floor(train.y[0])))
    plain = seconds(plain_cell, cell, dataset.timezone, repeat=1) * built[0].num_rows / 8
    yield Row("STeF-map of the day", taken, "s", 2.0, 1.0, plain / taken)
    for kind, build in (("episodes", episodes.build), ("snippets", snippets.build)):
        taken = seconds(lambda build=build: build(train, dataset))
        write_parquet(build(train, dataset), map_path(folder, kind))
        yield Row(f"{kind} map of the day", taken, "s")


def plain_cell(rows, timezone):
    """One cell of a STeF-map by the plain twins."""
    times, signals = twins.stef_signals(zip(rows.t, rows.x, rows.y, rows.heading, strict=True), timezone, 8, 600.0)
    return [twins.fremen(times, signal, 2) for signal in signals.values()]


def roll_outs(test, dataset, folder):
    """Ranked roll-outs to the longest horizon, observing included, milliseconds per track."""
    for kind, goals in (("tc_cliff", (0.05, 0.02)), ("cliff", (None, None)), ("stef", (0.05, 0.02))):
        run, options = forecaster(test, kind, dataset, folder)
        taken = seconds(run) / run()
        path = map_path(folder, kind)
        plain = plain_roll_out(test, read_parquet(path / "13.parquet" if path.is_dir() else path), kind, dataset)
        name = f"roll-out {kind}, k = {options.k}, {dataset.horizon_s} s, per track"
        yield Row(name, 1e3 * taken, "ms", *goals, plain / taken)


def plain_roll_out(test, table, kind, dataset, tracks=20):
    """Seconds per track of the plain twin's roll-outs with one map."""
    observed = observe(test, usable_tracks(test)[:tracks])
    velocity, keys = current_velocity(observed, dataset.velocity), stream_keys(observed.track_id, 5, 0)
    if kind == "stef":
        shares = column(table, "probabilities").reshape(table.num_rows, -1)
        mod = twins.PlainStef(column(table, "x").tolist(), column(table, "y").tolist(), shares.tolist(), 1.0)
    else:
        mod = twins.PlainCliff({name: column(table, name) for name in cliff.COLUMNS}, 1.0)
    steps = dataset.steps
    draws = np.stack([uniforms(keys.ravel(), step, mod.draws) for step in range(steps)], axis=1)

    def run():
        for particle, track in enumerate(np.repeat(np.arange(len(observed.x)), 5)):
            state = observed.x[track, -1], observed.y[track, -1], velocity[0][track], velocity[1][track]
            twins.roll_out(mod, *state, draws[particle], 1.0, 1.0, "constant")

    return seconds(run, repeat=1) / len(observed.x)


def with_memory(train, test, dataset, folder):
    """Forecasts with episodes and snippets, milliseconds per track."""
    observed = observe(test, usable_tracks(test)[:1])
    seen = list(zip(observed.t[0], observed.x[0], observed.y[0], strict=True))
    steps, weights = dataset.steps, dataset.difference_weights

    def hours(t):
        return clock_time(np.array([t]), dataset.timezone)[0]

    for kind, goals in (("episodes", (0.5, 0.2)), ("snippets", (2.0, 1.0))):
        run, options = forecaster(test, kind, dataset, folder)
        taken = seconds(run, repeat=3) / run()
        metric = Metric.of(options)
        table = read_parquet(map_path(folder, kind))
        if kind == "episodes":
            futures = options.persons
            arguments = memory_twins.rows_of(table), seen, steps, dataset.time_step_s, futures, weights
            plain = seconds(memory_twins.replay, *arguments, metric, hours, repeat=1)
        else:
            futures, length = options.k, round(options.length_s / dataset.time_step_s)
            mod = memory_twins.PlainSnippets(table, weights, metric, hours, length)
            keys = stream_keys(observed.track_id, 10, 0)[0]

            def particles(mod=mod, keys=keys, options=options, length=length):
                for key in keys:
                    mod.particle(seen, key, steps, lambda row: row["stored"] <= length, options.bandwidth_m)

            plain = seconds(particles, repeat=1) * futures / len(keys)
        name = f"{kind}, k = {futures}, {dataset.horizon_s} s, per track"
        yield Row(name, 1e3 * taken, "ms", *goals, plain / taken)


def forecaster(test, kind, dataset, folder):
    """Function that forecasts all test tracks with the configuration's options, and those; it has run once.

    It returns the number of tracks. Like a job it keeps no forecast longer than it takes to write it.
    """
    options = RUN.method(kind, dataset.tuned).options
    made = make_forecaster(kind, options, dataset, map_path(folder, kind))

    def run():
        names, k = ("bench", kind, "test"), getattr(options, "k", 1)
        return sum(len(ids) for _, ids, _ in forecast_recording(test, made, dataset, names, k, [0]))

    run()
    return run, options


def reading(folder):
    """Raw files to clean 1 Hz Parquet, each in a process of its own with two threads; memory at two sizes."""
    peaks = []
    for scale in SIZES:
        path = folder / f"raw-{scale}.csv"
        write_recording(path, "hall", "2030-10-02", seed=1, scale=scale)
        taken, peak, size = read(path, "atc")
        path.unlink()
        peaks.append(peak)
        yield Row(f"raw ATC CSV of {size:.0f} MB to 1 Hz Parquet, 2 cores", size / taken, "MB/s", 100, 150)
    yield Row(f"its memory, at {SIZES[1] // SIZES[0]} times the size", peaks[1], "MB")
    yield Row("  times that at the smaller size", peaks[1] / peaks[0], "", 1.1, 1.05)
    real = Path(os.environ.get("MODLHMP_DATA", ""), "edinburgh/raw/tracks.01Jul.txt")
    if not real.is_file():
        real = folder / "tracks.07Oct.txt"
        write_recording(real, "forum", "2030-10-07", seed=1)
    taken, _, size = read(real, "edinburgh")
    yield Row(f"Edinburgh raw text of {size:.0f} MB, one day", taken, "s", 0.6, 0.3)


def read(path, reader):
    """Seconds, peak memory [MB] and size [MB] of `read_alone` in a process of its own."""
    command = [sys.executable, __file__, "read", path, reader]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return tuple(map(float, done.stdout.split()))


def read_alone(path, reader):
    """Clean one raw file, after a small one has loaded the kernels; print seconds, peak memory, size [MB]."""
    form = FileFormat(reader=reader, timezone="Asia/Tokyo", frame_rate=9.0, scale=0.0247)
    recording, path = Recording(day="2030-10-02", start=None if reader == "atc" else "08:00"), Path(path)
    with tempfile.TemporaryDirectory() as scratch:
        head = path
        if reader == "atc":
            head = Path(scratch, "head.csv")
            with open(path, "rb") as file:
                head.write_bytes(b"".join(file.readline() for _ in range(20_000)))
        for file in (head, path):
            start = time.perf_counter()
            tracks, _ = clean_recording(file, form, recording)
            write_tracks(tracks, Path(scratch, "tracks.parquet"))
            taken = time.perf_counter() - start
    print(taken, runtime.peak_mb(), path.stat().st_size / 1e6)


def scoring(test, dataset, folder, tracks=10_000):
    """Both protocols on so many tracks of five ranked futures each."""
    options = RUN.method("tc_cliff", dataset.tuned).options
    made = make_forecaster("tc_cliff", options, dataset, map_path(folder, "tc_cliff"))
    blocks = list(forecast_recording(test, made, dataset, ("bench", "tc_cliff", "test"), options.k, [0]))
    ids = np.concatenate([some for _, some, _ in blocks])
    forecast = Forecast(*map(np.concatenate, zip(*(one[:3] for *_, one in blocks), strict=True)), "ranked")
    times = -(-tracks // len(ids))
    shift = np.arange(times) * (test.track_id.max() + 1)
    usable = test.take(np.isin(test.track_id, ids))
    many = concatenate(usable._replace(track_id=usable.track_id + by) for by in shift)
    made = [(0, ids + by, forecast) for by in shift]
    taken = seconds(score_recording, many, made, "test", dataset) * tracks / (times * len(ids))
    rows, steps = usable_tracks(test)[:3], forecast.xy.shape[2]
    truth, length = ground_truth(test, rows, 4, steps)
    start = time.perf_counter()
    for n in range(len(rows)):
        paths, alive = forecast.xy[n].tolist(), forecast.steps_alive[n].tolist()
        fitness = forecast.log_fitness[n].tolist()
        for protocol in ("paper", "complete"):
            for output in ("ranked", "mean"):
                for h in range(1, steps + 1):
                    twins.score(protocol, output, paths, fitness, alive, truth[n].tolist(), length[n], h)
    plain = (time.perf_counter() - start) / len(rows) * tracks
    yield Row(f"scoring {tracks:,} tracks x 5 x {steps}, both protocols", taken, "s", 1.0, 0.5, plain / taken)


def jobs(test, dataset, folder):
    """What a forecasting process takes before and while it works, each in a process of its own."""
    layout = Layout("bench", root=str(folder))
    write_tracks(test, layout.tracks(dataset.name, "test"))
    shutil.copytree(map_path(folder / "maps", "tc_cliff"), layout.map(dataset.name, "tc_cliff"))
    method = RUN.method("tc_cliff", dataset.tuned)
    task = {
        "run": layout.run, "root": layout.root, "dataset": as_plain(dataset), "recordings": ["test"],
        "method": method.plain(), "max_tracks": 10_000,
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-m", runtime.__name__], input=json.dumps(task), capture_output=True, text=True, check=True
    )
    yield Row("resident memory while forecasting", json.loads(done.stdout)["memory_mb"], "MB", 250, 200)
    task |= {"map": layout.map(dataset.name, "tc_cliff"), "tracks": layout.tracks(dataset.name, "test")}
    (folder / "task.json").write_text(json.dumps(task))
    command = [sys.executable, "-c", FIRST_FORECAST, folder / "task.json"]
    taken = seconds(lambda: subprocess.run(command, check=True))
    yield Row("start of a job to its first forecast", taken, "s", 2.5, 1.5)


def seconds(function, *arguments, repeat=5):
    """Time of the shortest of some runs."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        function(*arguments)
        times.append(time.perf_counter() - start)
    return min(times)


if __name__ == "__main__":
    read_alone(*sys.argv[2:]) if sys.argv[1:2] == ["read"] else main()
