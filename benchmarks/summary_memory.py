"""Memory and time of a run's summaries where errors are many: 92 days of ATC and five seeds, made up.

    python benchmarks/summary_memory.py [--days 92] [--seeds 5] [--tracks 4820] [--scratch DIR]

Two methods' errors are written as `score_method` writes them (one piece per day; every track, seed, output and protocol
a row of 60 steps), in lengths of which a tenth reaches 60 s. Then what `summarise_results`, `compare_methods` and
`climb_ladder` do, each in a process of its own whose peak the kernel tells.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pyarrow as pa
from tqdm import tqdm

from modlhmp.storage import write_pieces

STEPS, HORIZONS = 60, [5.0, 10.0, 20.0, 30.0, 60.0]
METHODS = ("a", "b")
GOAL_MB = 1000
TASKS = {
    "summarise_results, one method": "summarise('d', 'a', read_errors(files['a']), 1.0)",
    "compare_methods, one pair": "compare('d', errors, [('a', 'b')], HORIZONS, days)",
    "climb_ladder, two rungs": "scores('d', errors, HORIZONS, HORIZONS, days), differences('d', errors, [('a', 'b')], "
    "HORIZONS, days)",
}
JOB = """
from modlhmp.logs import job_log
from modlhmp.study.comparisons import compare
from modlhmp.study.ladder import differences, scores
from modlhmp.study.summary import at_horizons, read_errors, summarise
HORIZONS = {horizons}
files = {files}
days = {{f"day{{n:02d}}": f"day{{n:02d}}" for n in range({days})}}
with job_log({log!r}):  # as every job: it chooses how memory is given back
    errors = {{name: at_horizons(file, HORIZONS, 1.0) for name, file in files.items()}}
    {task}
"""


def main() -> None:
    """Write the files, run every task, print a table; status 1 where one needs more than the goal."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--days", type=int, default=92)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--tracks", type=int, default=4820, help="per day: as many as in the demo's days of ATC's size")
    parser.add_argument("--scratch", type=Path, help="folder for the files, which stay (default: a temporary one)")
    options = parser.parse_args()
    over = False
    with nullcontext(options.scratch) if options.scratch else tempfile.TemporaryDirectory() as folder:
        files = {name: str(Path(folder, f"{name}.parquet")) for name in METHODS}
        for number, file in enumerate(files.values()):
            if not Path(file).exists():
                days = tqdm(range(options.days), desc=f"errors of {METHODS[number]}", unit="day")
                write_pieces((made_up(day, number, options) for day in days), file)
        sizes = ", ".join(f"{Path(file).stat().st_size / 1e6:.0f} MB" for file in files.values())
        print(f"{options.days} days, {options.seeds} seeds, {options.tracks} tracks a day: files of {sizes}")
        log = str(Path(folder, "job.log"))
        for name, task in TASKS.items():
            seconds, peak = run(JOB.format(files=files, horizons=HORIZONS, days=options.days, task=task, log=log))
            over |= peak > GOAL_MB
            print(
                f"| {name} | {seconds:.0f} s | {peak:.0f} MB | {'met' if peak <= GOAL_MB else 'NOT MET'} |", flush=True
            )
    sys.exit(over)


def made_up(day, method, options):
    """Errors of a day's tracks: a walker's error grows with time, by other rates for every seed and method."""
    rng = np.random.default_rng([day, method])
    who = np.random.default_rng(day)  # the same people for both methods
    length = np.minimum(np.ceil(who.exponential(26.0, options.tracks)), STEPS).astype(np.int32)  # one in ten: 60 s
    ids, beyond = np.arange(1, options.tracks + 1) * 7919, np.arange(STEPS) >= length[:, None]
    parts = []
    for seed in range(options.seeds):
        rate = rng.gamma(2.0, 0.15 + 0.02 * method, (options.tracks, 1))
        for output in ("ranked", "mean"):
            for protocol in ("paper", "complete"):
                fde = (rate * np.arange(1, STEPS + 1) + rng.normal(0, 0.1, beyond.shape)).astype(np.float32)
                fde[beyond] = np.nan
                ade = np.cumsum(np.abs(fde), axis=1) / np.arange(1, STEPS + 1, dtype=np.float32)
                one = {"recording": f"day{day:02d}", "output": output, "protocol": protocol}
                parts.append(pa.table({
                    **{key: pa.array([value] * len(ids)).dictionary_encode() for key, value in one.items()},
                    "track_id": ids, "hour": np.full(len(ids), 12, np.int8), "alive_steps": length,
                    "seed": np.full(len(ids), seed, np.int32), "eligible_steps": length, "scored_steps": length,
                    "ade": lists(ade), "fde": lists(fde),
                }))  # fmt: skip
    return pa.concat_tables(parts).unify_dictionaries()


def lists(values):
    """A column of lists."""
    return pa.FixedSizeListArray.from_arrays(pa.array(values.astype(np.float32).ravel()), STEPS)


def run(job):
    """Seconds and peak resident memory [MB = 10^6 bytes] of a job in a process of its own."""
    told = "\nimport resource\nprint(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", job + told], stdout=subprocess.PIPE, text=True, check=True)
    return time.perf_counter() - start, int(done.stdout) * 1024 / 1e6


if __name__ == "__main__":
    main()
