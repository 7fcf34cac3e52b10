"""`modlhmp.Live` with an episode map: how long a tick takes, and whether memory stays flat.

    MODLHMP_DATA=/path/to/recordings python benchmarks/live.py [--ticks 20000] [--walker-ticks 1000000]

A tick takes a row of each person, forecasts everyone for 60 s with all samples, and makes the occupancy of the map at
every second. The crowd are 100 people and some who are too new, at 10 Hz; its 99th percentile of a tick is to stay
under 100 ms on one core. The walker is one person at 1 Hz, under 2 ms. People are the test persons of the real ATC day
(else of the demo's hall), who enter as others leave. Times are of the clock and of the processor: the first are worse
where the machine does other things, too. Memory is what the process holds; flat means that the last tenth of the ticks
holds at most 1 % more than the second tenth.
"""

import argparse
import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from run import ROOT, recordings

import modlhmp
from modlhmp.arguments import site_from
from modlhmp.logs import progress
from modlhmp.settings import as_plain
from modlhmp.study import runtime
from modlhmp.tracks import positions_at

PEOPLE, CROWD_HZ, LEAST_S = 116, 10, 20  # of them 16 have come within the last 3 s, and are too new
GOAL_MS = {"crowd": 100.0, "walker": 2.0}
FLAT = 1.01
LOOKS = 200  # at memory


def main():
    """Measure, print, and write results/live.json."""
    asked = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    asked.add_argument("--ticks", type=int, default=20_000)
    asked.add_argument("--walker-ticks", type=int, default=1_000_000)
    asked = asked.parse_args()
    with TemporaryDirectory() as scratch:
        title, train, test, dataset = recordings(Path(scratch))
    a_map = modlhmp.build_map("episodes", train, site_from(as_plain(dataset), "the dataset"))
    machine = runtime.machine()
    print(f"{title}; {machine['cpu']}, {machine['cores']} cores, Python {machine['python']}")
    tried = ("crowd", PEOPLE, asked.ticks, 1 / CROWD_HZ), ("walker", 1, asked.walker_ticks, 1.0)
    rows = [
        measure(what, a_map, walks(test, number, every_s), ticks, every_s)
        for what, number, ticks, every_s in tried
        if ticks
    ]
    out = ROOT / "results/live.json"
    out.parent.mkdir(exist_ok=True)
    out.write_text(json.dumps({"recordings": title, "machine": machine, "rows": rows}, indent=2) + "\n")


def measure(what, a_map, seen, ticks, every_s):
    """Time and memory of so many ticks; `seen` yields the rows (id, x, y) of each."""
    live = modlhmp.Live(a_map, 60)
    live.warm_up()
    clock, processor, memory, people = np.empty(ticks), np.empty(ticks), [], 0
    for tick in progress(range(ticks), desc=what):
        rows, t = next(seen), 1.3e9 + tick * every_s
        begun, used = time.perf_counter(), time.process_time()
        for who, x, y in rows:
            live.see(t, who, x, y)
        futures = live.forecast()
        futures.occupancy(1.0, live.extent)
        clock[tick], processor[tick] = time.perf_counter() - begun, time.process_time() - used
        people += len(futures.t0)
        if tick % max(ticks // LOOKS, 1) == 0:
            memory.append(held_mb())
    tenth = len(memory) // 10
    early, late = np.median(memory[tenth : 2 * tenth]), np.median(memory[-tenth:])
    found = {
        "what": what, "ticks": ticks, "people_a_tick": people / ticks,
        **{
            f"{name}_ms": {str(q): 1e3 * float(np.quantile(took[ticks // 100 :], q)) for q in (0.5, 0.99, 1.0)}
            for name, took in (("clock", clock), ("processor", processor))
        },
        "goal_ms": GOAL_MS[what], "memory_mb": [float(early), float(late)], "flat": bool(late <= FLAT * early),
        "counts": {name: number for name, number in live.counts.items() if number},
    }  # fmt: skip
    print(
        f"{what}: {ticks:,} ticks of {people / ticks:.1f} people; "
        + "; ".join(
            f"{name} {took['0.5']:.2f} ms, 99 % {took['0.99']:.2f}, most {took['1.0']:.2f}"
            for name, took in (("clock", found["clock_ms"]), ("processor", found["processor_ms"]))
        )
        + f"; goal {GOAL_MS[what]:g} ms; {early:.1f} -> {late:.1f} MB",
        flush=True,
    )
    return found


def held_mb():
    """Resident memory of this process [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) * 1024 / 1e6


def walks(tracks, number, step_s):
    """Yield the rows (id, x, y) of `number` people every `step_s`, linear between those of their tracks."""
    bounds = tracks.bounds()
    ends = np.column_stack([bounds[:-1], bounds[1:] - 1])
    ends = ends[tracks.t[ends[:, 1]] - tracks.t[ends[:, 0]] >= LEAST_S]
    length, rng, came = tracks.t[ends[:, 1]] - tracks.t[ends[:, 0]], np.random.default_rng(0), number
    who, whose = np.arange(number), rng.integers(len(ends), size=number)
    after = step_s * np.floor(rng.random(number) * length[whose] / 2 / step_s)  # not all begin together
    while True:
        for place in np.flatnonzero(after >= length[whose]):
            who[place], whose[place], after[place], came = came, rng.integers(len(ends)), 0.0, came + 1
        x, y = positions_at(tracks, ends[whose], after[:, None])[:, 0].T.tolist()
        yield list(zip(who.tolist(), x, y, strict=True))
        after += step_s


if __name__ == "__main__":
    main()
