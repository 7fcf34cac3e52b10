"""Runtime study (paper Sec. V-A): time, memory and their growth while forecasting with a map.

`python -m modlhmp.study.runtime` reads its task as JSON from standard input and prints the result as JSON: a fresh
process, so that its memory is that of forecasting and of nothing else.
"""

import functools
import json
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.forecasting import rollout
from modlhmp.forecasting.base import Forecast, Forecaster
from modlhmp.forecasting.observe import Observed, observe
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.forecasting.windows import usable
from modlhmp.kinds import find
from modlhmp.maps.base import TooWideError, day_file, hour_files
from modlhmp.maps.exits import with_exits
from modlhmp.methods import Method, load_map
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import DataError, column, read_parquet, write_parquet
from modlhmp.streams import stream_keys
from modlhmp.study.layout import Layout
from modlhmp.tracks import Tracks, read_tracks, together

REPETITIONS = 5
LATENCY_TRACKS = 200
COPIES = (1, 2, 4, 8, 16)  # of the map, for its growth
APART_M = 100.0  # copies of a map lie out of reach of every roll-out


def measure(task: Mapping[str, Any]) -> dict[str, Any]:
    """Measure one method whose map is sampled on one dataset.

    `task`: `run` and `root` of its `Layout`, `dataset` (its settings as plain values, with its `name`), `recordings`
    (names), at most `max_tracks` of whose tracks are used, and `method` (`Method.plain()`), with `exits` the file of
    the ways out if it uses them. Returns times in s, memory in MB (10^6 bytes), sizes in kB.
    """
    at_start_mb = peak_mb()
    layout, name = Layout(task["run"], task["root"]), task["dataset"]["name"]
    site, method = build(Site, task["dataset"]), Method.of(task["method"])
    if not find(method.kind).sampled:
        raise DataError(f"studies.method: {method.name} has no map to sample, so its runtime is not measured")
    k, steps = method.options.k, site.steps
    path = layout.map_of(name, method)

    def load(file: str | Path) -> Any:
        mod = load_map(method.kind, file, site, method.options)
        return with_exits(mod, task["exits"], site) if method.options.exits else mod

    mod = load(path)
    observed = _observed(layout, name, task["recordings"], site, task["max_tracks"])

    def forecast(some: Observed, horizon: int = steps, mod: Any = mod) -> Forecast:
        keys = stream_keys(some.track_id, k, 0, name)
        return rollout.forecaster(mod, site, method.options)(some, horizon, keys)

    reference = forecast(observed)  # compiles or loads the kernels
    seconds = _times(lambda: forecast(observed))
    memory_mb = peak_mb()
    n = len(observed.track_id)
    single = [_take(observed, [row]) for row in range(min(n, LATENCY_TRACKS))]
    forecast(single[0])
    latency = [_seconds(functools.partial(forecast, one)) for one in single]
    files = _map_files(path)
    growth = {
        **_growth(forecast, observed, reference, steps),
        "M": list(_with_copies(path, load, forecast, observed, reference)),
    }
    return {
        "tracks": n, "k": k, "horizon_s": site.horizon_s, "repetitions": REPETITIONS,
        "seconds_per_track": seconds[0] / n, "seconds_per_track_range": [s / n for s in seconds[1:]],
        "latency_s": float(np.median(latency)), "latency_90th_s": float(np.percentile(latency, 90)),
        "memory_mb": memory_mb, "memory_of_imports_mb": at_start_mb,
        "map_kb": float(np.mean([file.stat().st_size for file in files])) / 1000, "maps": len(files),
        "growth": growth,
        "exponents": {size: exponent([row[0] for row in rows], [row[1] for row in rows])
                      for size, rows in growth.items()},
        "machine": machine(),
    }  # fmt: skip


def some_tracks(recordings: Iterable[Tracks], site: Site, number: int = 500) -> Tracks:
    """The first `number` usable tracks of some recordings, as one table."""
    parts, found = [], 0
    for tracks in recordings:
        chosen = tracks.track_id[usable(tracks, site)[: number - found, 0]]
        parts.append(tracks.take(np.isin(tracks.track_id, chosen)))
        found += len(chosen)
        if found == number:
            break
    return together(parts)


def milliseconds_per_track(forecaster: Forecaster, tracks: Tracks, dataset: str, site: Site, k: int) -> float:
    """Median time [ms] of forecasting a track among all of a table, with observing, without compiling; NaN of none.

    `dataset` is the name that enters the random numbers.
    """
    names = (dataset, "cost", "cost")

    def run() -> int:
        return sum(len(ids) for _, ids, _ in forecast_recording(tracks, forecaster, site, names, k, [0], []))

    number = run()
    return 1000 * _times(run)[0] / number if number else float("nan")


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> list[float]:
    """Exponent of growth: log-log slope and its 95 % interval, [slope, low, high]; NaN for fewer than 3 sizes."""
    if len(sizes) < 3:
        return [float("nan")] * 3
    from scipy import stats  # noqa: PLC0415 - 40 MB, which forecasting does not need

    fit = stats.linregress(np.log(sizes), np.log(seconds))
    reach = stats.t.ppf(0.975, len(sizes) - 2) * fit.stderr
    return [float(fit.slope), float(fit.slope - reach), float(fit.slope + reach)]


def copied(table: pa.Table, copies: int) -> pa.Table:
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


def _growth(
    forecast: Callable[..., Forecast], observed: Observed, reference: Forecast, steps: int
) -> dict[str, list[list[float]]]:
    """Rows [tracks, seconds] of `N`, and [steps, seconds, steps alive of all futures] of `T`."""
    n = len(observed.track_id)
    sizes = np.unique(np.rint(np.geomspace(max(n / 32, 1), n, 6)).astype(int)).tolist()
    horizons = np.unique(np.rint(np.geomspace(max(steps / 16, 1), steps, 6)).astype(int)).tolist()
    lived = np.minimum(reference.steps_alive[..., None], horizons).sum(axis=(0, 1)).tolist()

    def first(number: int) -> Forecast:
        return forecast(_take(observed, slice(number)))

    return {
        "N": [[size, _times(functools.partial(first, size))[0]] for size in sizes],
        "T": [
            [horizon, _times(functools.partial(forecast, observed, horizon))[0], live]
            for horizon, live in zip(horizons, lived, strict=True)
        ],
    }


def _with_copies(
    path: str,
    load: Callable[[Path], Any],
    forecast: Callable[..., Forecast],
    observed: Observed,
    reference: Forecast,
) -> Iterator[list[float]]:
    """Yield [number of locations, seconds] with larger maps, up to the largest lattice; forecasts must be the same."""
    files = _map_files(path)
    tables = {file.relative_to(path): read_parquet(file) for file in (*files, *filter(None, [day_file(path)]))}
    locations = np.mean([_locations(tables[file.relative_to(path)]) for file in files])
    for copies in COPIES:
        with tempfile.TemporaryDirectory() as folder:
            larger = Path(folder, "map")
            for name, table in tables.items():
                write_parquet(copied(table, copies), larger / name)
            try:
                mod = load(larger)
            except TooWideError:
                return
        if not np.array_equal(forecast(observed, mod=mod).xy, reference.xy):
            raise RuntimeError("a map with locations out of reach gave other forecasts")
        yield [float(locations * copies), _times(functools.partial(forecast, observed, mod=mod))[0]]


def _locations(table: pa.Table) -> int:
    """How many locations, or cells, a map has."""
    return len(np.unique(column(table, "location"))) if "location" in table.column_names else table.num_rows


def _observed(layout: Layout, name: str, recordings: Sequence[str], site: Site, max_tracks: int) -> Observed:
    """Observed rows of the first usable tracks, `max_tracks` at most, in a fixed random order."""
    parts, found = [], 0
    for recording in recordings:
        tracks = read_tracks(layout.tracks(name, recording))
        rows = usable(tracks, site)
        if len(rows):
            parts.append(observe(tracks, rows, site.observed_rows))
            found += len(rows)
        if found >= max_tracks:
            break
    if not found:
        raise DataError(f"{name}: no usable test track to forecast, so no runtime to measure")
    everyone = Observed(*map(np.concatenate, zip(*parts, strict=True)))
    return _take(everyone, np.random.default_rng(0).permutation(found)[:max_tracks])


def _take(observed: Observed, rows: Any) -> Observed:
    return Observed(*(part[rows] for part in observed))


def _map_files(path: str) -> list[Path]:
    """The file of a map, or those of its hours; without that of the whole day, which stands in for hours that lack."""
    return list(hour_files(path).values()) if Path(path).is_dir() else [Path(path)]


def _seconds(call: Callable[[], Any]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _times(call: Callable[[], Any]) -> list[float]:
    """Median, lowest and highest of `REPETITIONS` times [s]."""
    times = [_seconds(call) for _ in range(REPETITIONS)]
    return [float(np.median(times)), min(times), max(times)]


def peak_mb() -> float:
    """Largest resident memory of this process so far [MB].

    From /proc: `getrusage` would give the parent's, if that is larger, since it survives the exec.
    """
    status = Path("/proc/self/status").read_text()
    (kibibytes,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return int(kibibytes) * 1024 / 1e6


def machine() -> dict[str, Any]:
    """Public features of the machine."""
    models = [line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
              if line.startswith("model name")]  # fmt: skip
    return {"cpu": models[0] if models else platform.processor(), "cores": len(models),
            "python": platform.python_version(), "numba": version("numba"), "numpy": version("numpy")}  # fmt: skip


if __name__ == "__main__":
    pa.set_memory_pool(pa.system_memory_pool())  # as a job does (`logs.job_log`)
    try:
        print(json.dumps(measure(json.load(sys.stdin)), indent=1))
    except DataError as error:
        sys.exit(str(error))
