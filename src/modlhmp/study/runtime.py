"""Runtime study (paper Sec. V-A): time, memory and their growth while forecasting with a map.

`python -m modlhmp.study.runtime` reads its task as JSON from standard input and prints the result as JSON: a fresh
process, so that its memory is that of forecasting and of nothing else.
"""

import json
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pyarrow as pa

from modlhmp.forecasting import forecast_recording
from modlhmp.forecasting.observe import Observed, current_velocity, observe
from modlhmp.forecasting.rollout import roll_out
from modlhmp.maps import KINDS, load_map
from modlhmp.maps.base import HourlyMod
from modlhmp.storage import DataError, column, read_parquet
from modlhmp.streams import stream_keys
from modlhmp.tracks import read_tracks, together, usable_tracks

REPETITIONS = 5
LATENCY_TRACKS = 200
COPIES = (1, 2, 4, 8, 16)  # of the map, for its growth
APART_M = 100.0  # copies of a map lie out of every roll-out's reach


def measure(task):
    """Measure one map-based method on one dataset.

    `task`: `map` (file or folder), `kind`, `options` of the roll-out, `tracks` (files), `dataset` (its settings), at
    most `max_tracks` of whose tracks are used. Returns a dict: times in s, memory in MB (10^6 bytes), sizes in kB.
    """
    at_start_mb = peak_mb()
    dataset, options = task["dataset"], task["options"]
    mod = load_map(task["kind"], task["map"], dataset["timezone"], options["sampling_radius_m"])
    observed = _observed(task["tracks"], dataset, task["max_tracks"])
    steps = round(dataset["horizon_s"] / dataset["time_step_s"])

    def forecast(some, horizon=steps, mod=mod):
        keys = stream_keys(some.track_id, options["k"], 0, dataset["name"])
        velocity = current_velocity(some, dataset["velocity"])
        arguments = (horizon, keys, dataset["time_step_s"], options["beta"], options["speed"])
        return roll_out(mod, some, velocity, *arguments)

    reference = forecast(observed)  # compiles or loads the kernels
    seconds = _times(lambda: forecast(observed))
    memory_mb = peak_mb()
    n = len(observed.track_id)
    single = [_take(observed, [row]) for row in range(min(n, LATENCY_TRACKS))]
    forecast(single[0])
    latency = [_seconds(lambda one=one: forecast(one)) for one in single]
    sizes = np.unique(np.rint(np.geomspace(max(n / 32, 1), n, 6)).astype(int))
    horizons = np.unique(np.rint(np.geomspace(max(steps / 16, 1), steps, 6)).astype(int))
    lived = np.minimum(reference.steps_alive[..., None], horizons).sum(axis=(0, 1))
    growth = {
        "N": [[int(size), _times(lambda size=size: forecast(_take(observed, slice(size))))[0]] for size in sizes],
        "T": [[int(h), _times(lambda h=h: forecast(observed, h))[0], int(live)]
              for h, live in zip(horizons, lived, strict=True)],
        "M": list(_with_copies(task, forecast, observed, reference)),
    }  # fmt: skip
    files = _map_files(task["map"])
    return {
        "tracks": n, "k": options["k"], "horizon_s": dataset["horizon_s"], "repetitions": REPETITIONS,
        "seconds_per_track": seconds[0] / n, "seconds_per_track_range": [s / n for s in seconds[1:]],
        "latency_s": float(np.median(latency)), "latency_90th_s": float(np.percentile(latency, 90)),
        "memory_mb": memory_mb, "memory_of_imports_mb": at_start_mb,
        "map_kb": float(np.mean([file.stat().st_size for file in files])) / 1000, "maps": len(files),
        "growth": growth,
        "exponents": {name: exponent([row[0] for row in rows], [row[1] for row in rows])
                      for name, rows in growth.items()},
        "machine": machine(),
    }  # fmt: skip


def some_tracks(recordings, dataset, number=500):
    """The first `number` usable tracks of some recordings, as one table."""
    parts, found = [], 0
    for tracks in recordings:
        usable = tracks.track_id[usable_tracks(tracks, dataset["observed_rows"])[: number - found, 0]]
        parts.append(tracks.take(np.isin(tracks.track_id, usable)))
        found += len(usable)
        if found == number:
            break
    return together(parts)


def milliseconds_a_track(forecaster, tracks, dataset, k):
    """Median time [ms] of forecasting a track among all of a table, with observing, without compiling; NaN of none."""
    names = (dataset["name"], "cost", "cost")

    def run():
        return sum(len(ids) for _, ids, _ in forecast_recording(tracks, forecaster, dataset, names, k, [0], []))

    number = run()
    return 1000 * _times(run)[0] / number if number else float("nan")


def exponent(sizes, seconds):
    """Exponent of growth: log-log slope and its 95 % interval, [slope, low, high]; NaN for fewer than 3 sizes."""
    if len(sizes) < 3:
        return [float("nan")] * 3
    from scipy import stats  # noqa: PLC0415 - 40 MB, which forecasting does not need

    fit = stats.linregress(np.log(sizes), np.log(seconds))
    reach = stats.t.ppf(0.975, len(sizes) - 2) * fit.stderr
    return [float(fit.slope), float(fit.slope - reach), float(fit.slope + reach)]


def copied(table, copies):
    """A map's table with `copies` of its locations (or cells), the others so far away that nobody reaches them."""
    x = column(table, "x")
    parts = []
    for number in range(copies):
        shift = number * (np.ceil(np.ptp(x)) + APART_M)
        moved = table.set_column(table.schema.get_field_index("x"), "x", pa.array(x + shift))
        if "location" in table.column_names:
            location = column(table, "location")
            location = pa.array(location + number * (location.max() + 1), table.schema.field("location").type)
            moved = moved.set_column(moved.schema.get_field_index("location"), "location", location)
        parts.append(moved)
    return pa.concat_tables(parts)


def _with_copies(task, forecast, observed, reference):
    """Yield [number of locations, seconds] with larger maps, up to the largest lattice; forecasts must be the same."""
    mod_class, hourly = KINDS[task["kind"]]
    tables = {file.stem: read_parquet(file) for file in _map_files(task["map"])}
    locations = np.mean([_locations(table) for table in tables.values()])
    for copies in COPIES:
        try:
            larger = {stem: mod_class(copied(table, copies), task["options"]["sampling_radius_m"])
                      for stem, table in tables.items()}  # fmt: skip
        except DataError:  # such a map is wider than any may be
            return
        mod = next(iter(larger.values()))
        if hourly:
            mod = HourlyMod({int(stem): one for stem, one in larger.items()}, task["dataset"]["timezone"])
        if not np.array_equal(forecast(observed, mod=mod).xy, reference.xy):
            raise RuntimeError("a map with locations out of reach gave other forecasts")
        yield [float(locations * copies), _times(lambda mod=mod: forecast(observed, mod=mod))[0]]


def _locations(table):
    """How many locations, or cells, a map has."""
    return len(np.unique(column(table, "location"))) if "location" in table.column_names else table.num_rows


def _observed(files, dataset, max_tracks):
    """Observed rows of the first usable tracks, `max_tracks` at most, in a fixed random order."""
    parts, found = [], 0
    for file in files:
        tracks = read_tracks(file)
        rows = usable_tracks(tracks, dataset["observed_rows"])
        if len(rows):
            parts.append(observe(tracks, rows, dataset["observed_rows"]))
            found += len(rows)
        if found >= max_tracks:
            break
    if not found:
        raise DataError(f"{dataset['name']}: no usable test track to forecast, so no runtime to measure")
    together = Observed(*map(np.concatenate, zip(*parts, strict=True)))
    return _take(together, np.random.default_rng(0).permutation(found)[:max_tracks])


def _take(observed, rows):
    return Observed(*(column[rows] for column in observed))


def _map_files(path):
    path = Path(path)
    return sorted(path.glob("*.parquet")) if path.is_dir() else [path]


def _seconds(call):
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _times(call):
    """Median, lowest and highest of `REPETITIONS` times [s]."""
    times = [_seconds(call) for _ in range(REPETITIONS)]
    return [float(np.median(times)), min(times), max(times)]


def peak_mb():
    """Largest resident memory of this process so far [MB].

    From /proc: `getrusage` would give the parent's, if that is larger, since it survives the exec.
    """
    status = Path("/proc/self/status").read_text()
    (kibibytes,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return int(kibibytes) * 1024 / 1e6


def machine():
    """Public features of the machine."""
    models = [line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
              if line.startswith("model name")]  # fmt: skip
    return {"cpu": models[0] if models else platform.processor(), "cores": len(models),
            "python": platform.python_version(), "numba": version("numba"), "numpy": version("numpy")}  # fmt: skip


if __name__ == "__main__":
    try:
        print(json.dumps(measure(json.load(sys.stdin)), indent=1))
    except DataError as error:
        sys.exit(str(error))
