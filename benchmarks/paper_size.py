"""The complete workflow at the paper's volume, and how it grows: `make paper-size` -> results/paper-size.*.

Demo recordings as large as the paper's (10 ATC days of 500 MB, 45 Edinburgh days) and fractions of them, each in a
copy of the workflow in a scratch folder: every method but the learned ones, one seed, no parameter studies. Writing
the recordings is not counted. A run of 1/64 comes first and compiles the kernels; its time is told apart.

Snakemake's own benchmark files sample a long job only every 30 s and half the rules have none, so every job is
watched from here: its seconds, and its peak resident memory as the kernel has it.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import yaml
from tqdm import tqdm

from modlhmp.storage import write_text
from modlhmp.study import runtime
from modlhmp.study.configuration import load_run
from modlhmp.study.demo import write_recording
from modlhmp.study.exhibits.style import PAGE_MM, figure, method_style, save

ROOT = Path(__file__).parents[1]
OUT = ROOT / "results/paper-size"
RUN = "paper_size"
SIZES = (0.125, 0.25, 0.5, 1.0)
WARM_UP = 1 / 64
DAY_MB = 500  # the paper's raw ATC days
# The demo's site behind each dataset, and the scale of its days at size 1. A hall day is 25.5 to 26 MB at scale 1. A
# forum day has 500 tracks at scale 1; of the real raw days one has 1,262 in 2.3 MB, so 1,000 in 2.2 MB are like them.
SITES = {"atc": ("hall", 20.0), "edinburgh": ("forum", 2.0)}
FREE_MB = 8000  # at size 1: recordings of 5,300 MB, results, room to spare
# Of the workflow's scripts; the others are so short that nothing grows.
STAGES = {
    "clean_recording": "cleaning",
    "build_map": "maps",
    "forecast_method": "forecasts",
    "score_method": "scores",
    "measure_uncertainty": "distributions",
    "measure_likelihood": "likelihood",
    "measure_given": "likelihood",
    "measure_encounters": "moments",
    "study_occupied": "moments",
    "compare_methods": "tests, summaries",
    "read_protocol": "tests, summaries",
    "summarise_results": "tests, summaries",
    "draw_exhibit": "exhibits",
}
STAGE_NAMES = tuple(dict.fromkeys(STAGES.values()))
PEAK_MB = 2000  # no rule above
START = [sys.executable, "-c", "import modlhmp.methods, modlhmp.forecasting.recording, modlhmp.scoring.recording"]
WATCH_EVERY_S = 0.1


def main():
    """Run every size, smallest first; print the table and write what is known after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=float, nargs="+", default=SIZES, help="fractions of the paper's volume")
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--profile", type=Path, help="of a cluster, for a second run of each size (docs/clusters.md)")
    parser.add_argument("--scratch", type=Path, help="folder to work in, and to keep (default: a temporary one)")
    parser.add_argument("--keep", action="store_true", help="keep the recordings in --scratch, too")
    options = parser.parse_args()
    if options.keep and not options.scratch:
        parser.error("--keep needs --scratch DIR: a temporary folder is removed with all that is in it")
    OUT.parent.mkdir(exist_ok=True)
    start_up_s = start_up()
    scratch = nullcontext(options.scratch) if options.scratch else tempfile.TemporaryDirectory()
    with scratch as folder:
        check_disk(folder, max(options.sizes))
        warm_up = run_size(Path(folder) / "warm-up", WARM_UP, options, start_up_s)
        found = {"machine": machine(options.cores), "start_up_s": round(start_up_s, 2), "warm_up": warm_up, "sizes": []}
        for size in sorted(options.sizes):
            found["sizes"].append(run_size(Path(folder) / f"{size:g}", size, options, start_up_s))
            found["exponents"] = exponents(found["sizes"])
            write_text(OUT.with_suffix(".json"), json.dumps(found, indent=2) + "\n")
            write_text(OUT.with_suffix(".md"), report(found))
            draw(found)
    print(report(found))


def start_up():
    """What a job takes before it begins to work [s]: a fresh Python with the package's imports."""
    times = []
    for _ in range(3):
        start = time.perf_counter()
        subprocess.run(START, check=True)
        times.append(time.perf_counter() - start)
    return min(times)


def machine(cores):
    """Public features of the machine, and the cores that were used of it."""
    memory_gb = round(psutil.virtual_memory().total / 1e9, 1)
    return {**runtime.machine(), "cores_used": cores, "memory_gb": memory_gb}


def check_disk(folder, size):
    """Stop before hours of work that would end on a full disk."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    free_mb, needed_mb = shutil.disk_usage(folder).free / 1e6, FREE_MB * size
    if free_mb < needed_mb:
        sys.exit(f"{folder} has {free_mb:.0f} MB free of the {needed_mb:.0f} MB needed; name another: --scratch DIR")


def run_size(folder, size, options, start_up_s):
    """Everything about one size: recordings written, workflow run and measured, recordings removed."""
    try:
        folder.mkdir()
    except FileExistsError:
        sys.exit(f"{folder} exists: Snakemake would find its results there and do nothing; remove it")
    for name in ("workflow", "config", "profiles"):
        shutil.copytree(ROOT / name, folder / name)
    shutil.copy(ROOT / "Snakefile", folder)
    datasets = configure(folder)
    start = time.perf_counter()
    raw = write_recordings(folder / f"resources/demo/{RUN}", datasets, size, options.cores)
    made_s = time.perf_counter() - start
    smallest_mb = min(file.stat().st_size for file in raw["atc"]) / 1e6
    if size >= 1 and smallest_mb < DAY_MB * size:  # days of small sizes differ more
        sys.exit(f"an ATC day of {smallest_mb:.0f} MB at size {size:g}, less than {DAY_MB * size:g} MB: raise SITES")
    found = {
        "size": size,
        "smallest_atc_day_mb": round(smallest_mb, 1),
        "raw_mb": {name: megabytes(files) for name, files in raw.items()},
        "recordings_made_s": round(made_s, 1),
        **run_workflow(folder, options.cores, start_up_s),
        "results_mb": {
            kind: megabytes((folder / f"results/{RUN}").glob(f"*/{kind}/**/*"))
            for kind in ("tracks", "maps", "forecasts", "errors", "uncertainty")
        }
        | {"all": megabytes([*(folder / "results").rglob("*"), *(folder / "paper_figures").rglob("*")])},
    }
    if options.profile:
        found["queued"] = run_queued(folder, options.profile, found["wall_s"])
    if not options.keep:
        shutil.rmtree(folder / "resources")
    return found


def megabytes(paths):
    """Bytes of the files among some paths, 10^6."""
    return round(sum(path.stat().st_size for path in paths if path.is_file()) / 1e6, 2)


def configure(folder):
    """Turn the paper's two dataset files into demo ones, write the run's overlay; returns the datasets."""
    datasets = {}
    for name, (site, _) in SITES.items():
        file = folder / f"config/datasets/{name}.yaml"
        paper, demo = (yaml.safe_load(one.read_text()) for one in (file, file.with_name(f"demo_{site}.yaml")))
        kept = {key: value for key, value in paper.items() if key not in {"paper_results", "owner_page", "sources"}}
        kept |= {key: demo.get(key) for key in ("demo", "hours", "figure_hours", "floor_plan", "citation", "terms")}
        for recording in kept["recordings"]:
            if "start" in recording:
                recording["start"] = demo["recordings"][0]["start"]
        datasets[name] = {**kept, "title": f"{paper['title']}-sized demo"}
        file.write_text(yaml.safe_dump(datasets[name], sort_keys=False))
    config = {}
    for name in ("budgets", "config"):
        config |= yaml.safe_load((folder / f"config/{name}.yaml").read_text())
    run = load_run(config, folder / "config/datasets")
    overlay = {
        "run": RUN,
        "datasets": list(SITES),
        "compare": [name for name in run.compare if not is_learned(run, name)],
        "seeds": [0],
        "studies": {"beta": [], "sampling_radius_m": [], "training": {"shares": []}},
    }
    (folder / f"config/{RUN}.yaml").write_text(yaml.safe_dump(overlay, sort_keys=False))
    return datasets


def is_learned(run, name):
    """Whether a method is a network, or averages one."""
    return any(run.kind(part).learned for part in run.averaged_parts(name))


def write_recordings(root, datasets, size, cores):
    """Write every day, `cores` at a time; returns the files of each dataset."""
    days = {name: [(root / one["files"], str(one["day"])) for one in datasets[name]["recordings"]] for name in datasets}
    with ProcessPoolExecutor(cores) as pool:
        jobs = [
            pool.submit(write_recording, file, SITES[name][0], day, 0, SITES[name][1] * size)
            for name in days
            for file, day in days[name]
        ]
        for job in tqdm(jobs, desc=f"recordings of size {size:g}", unit="day"):
            job.result()
    return {name: [file for file, _ in days[name]] for name in days}


def start(folder, arguments, log):
    """Snakemake, started in a folder, and the file that it writes to."""
    environment = {key: value for key, value in os.environ.items() if key != "MODLHMP_DATA"}
    paths = [str(ROOT / "src"), *filter(None, [environment.get("PYTHONPATH")])]
    environment |= {"PYTHONPATH": os.pathsep.join(paths), "PYTHONHASHSEED": "0"}
    environment.setdefault("MODLHMP_CACHE_DIR", str(ROOT / ".cache/kernels"))
    command = [sys.executable, "-m", "snakemake", *arguments, "--configfile", f"config/{RUN}.yaml"]
    print(f"workflow of size {folder.name}: {log}", flush=True)
    with open(log, "w") as output:
        return subprocess.Popen(command, cwd=folder, env=environment, stdout=output, stderr=subprocess.STDOUT)


def ended(process, log, size):
    """What Snakemake has written; stops where it has failed."""
    text = log.read_text()
    if process.wait():
        sys.exit(f"{text[-3000:]}\nthe workflow of size {size} failed; the whole log is {log}")
    return text


def run_queued(folder, profile, wall_s):
    """The same run as jobs of a cluster: how many its queue got, wall time, and that above the local one's [%]."""
    for made in ("results", "paper_figures", ".snakemake"):
        shutil.rmtree(folder / made)
    log = OUT.with_name(f"{OUT.name}-{folder.name}-{profile.name}.log")
    began = time.perf_counter()
    text = ended(start(folder, ["--profile", profile.resolve()], log), log, folder.name)
    queued_s = time.perf_counter() - began
    submitted = len(re.findall(r"has been submitted with", text))
    return {
        "jobs": submitted,
        "wall_s": round(queued_s, 1),
        "overhead_percent": round(100 * (queued_s / wall_s - 1), 1),
    }


def run_workflow(folder, cores, start_up_s):
    """Run Snakemake in a folder and watch it: wall time, number of jobs, and what each rule took."""
    log = OUT.with_name(f"{OUT.name}-{folder.name}.log")
    began = time.perf_counter()
    process = start(folder, ["--cores", str(cores)], log)
    jobs = watch(process)
    wall_s = time.perf_counter() - began
    text = ended(process, log, folder.name)
    jobs["short"] = jobs.s < 2 * start_up_s
    jobs["stage"] = jobs.rule.map(STAGES)
    wanted = {"jobs": ("s", "size"), "s": ("s", "sum"), "shortest_s": ("s", "min"), "peak_mb": ("mb", "max")}
    rules, stages = (jobs.groupby(key).agg(**wanted, short=("short", "sum")).round(2) for key in ("rule", "stage"))
    return {
        "wall_s": round(wall_s, 1),
        "jobs": int(re.search(r"^total\s+(\d+)", text, re.MULTILINE)[1]) - 1,  # `all` is none
        "jobs_s": round(jobs.s.sum(), 1),
        "short": int(jobs.short.sum()),
        "peak_mb": rules.peak_mb.max(),
        "peak_rule": rules.peak_mb.idxmax(),
        "stages": stages.to_dict("index"),
        "rules": rules.to_dict("index"),
    }


def watch(process):
    """One row per job of a running Snakemake: rule (its script's name), seconds, peak memory [MB = 10^6 bytes]."""
    jobs = {}
    while process.poll() is None:
        for child in psutil.Process(process.pid).children(recursive=True):
            try:
                script = re.fullmatch(r".*/\.snakemake/scripts/[^/]*\.(\w+)\.py", "".join(child.cmdline()[1:2]))
                peak = re.search(r"VmHWM:\s+(\d+)", Path(f"/proc/{child.pid}/status").read_text())
                started = child.create_time() - psutil.boot_time()  # both lack the boot's fraction of a second
            except (psutil.Error, OSError):  # it has ended
                continue
            if script and peak:
                seconds = time.clock_gettime(time.CLOCK_BOOTTIME) - started
                jobs[script[0]] = script[1], seconds, int(peak[1]) * 1024 / 1e6
        time.sleep(WATCH_EVERY_S)
    return pd.DataFrame(jobs.values(), columns=["rule", "s", "mb"])


def exponents(runs):
    """Exponents of growth with their 95 % intervals, and of the last doubling alone, where start-up weighs least."""
    sizes = [run["size"] for run in runs]
    grown = {"wall time": [run["wall_s"] for run in runs], "time of all jobs": [run["jobs_s"] for run in runs]}
    for what, key in (("time", "s"), ("memory", "peak_mb")):
        grown |= {f"{what} of {stage}": [run["stages"][stage][key] for run in runs] for stage in STAGE_NAMES}
    return {
        name: {
            "exponent": runtime.exponent(sizes, values),
            "last_step": float(np.log(values[-1] / values[-2]) / np.log(sizes[-1] / sizes[-2])) if runs[1:] else np.nan,
        }
        for name, values in grown.items()
    }


def report(found):
    """Everything as Markdown: the sizes, the rules at the largest one, growth, and the verdicts."""
    runs, grown, used = found["sizes"], found["exponents"], found["machine"]
    last = runs[-1]
    disk = ("tracks", "maps", "forecasts", "errors", "uncertainty", "all")
    sizes = [
        (f"{run['size']:g}", f"{sum(run['raw_mb'].values()):.0f}", run["smallest_atc_day_mb"],
         f"{run['wall_s'] / 60:.1f}", f"{run['jobs_s'] / 60:.1f}", run["jobs"], f"{run['peak_mb']:.0f}",
         run["peak_rule"], *(f"{run['results_mb'][kind]:.1f}" for kind in disk))
        for run in runs
    ]  # fmt: skip
    rules = [
        (name, rule["jobs"], rule["short"], f"{rule['s']:.1f}", f"{rule['shortest_s']:.1f}", f"{rule['peak_mb']:.0f}")
        for name, rule in sorted(last["rules"].items(), key=lambda item: -item[1]["s"])
    ]
    growth = [
        (name, *(f"{number:.2f}" for number in (*one["exponent"], one["last_step"]))) for name, one in grown.items()
    ]
    judged = {
        "wall time [min]": (last["wall_s"] / 60, 30),
        f"memory of {last['peak_rule']} [MB]": (last["peak_mb"], PEAK_MB),
        "jobs": (last["jobs"], 399),
        "exponent of wall time": (grown["wall time"]["exponent"][0], 1.05),
        "exponent of the time of all jobs": (grown["time of all jobs"]["exponent"][0], 1.05),
        f"short jobs: at work for less than the {found['start_up_s']:.2f} s that they take to start": (
            last["short"],
            0,
        ),
    }
    if queued := last.get("queued"):
        judged |= {
            "overhead of the queue [%]": (queued["overhead_percent"], 20),
            "its jobs": (queued["jobs"], last["jobs"]),
        }
    verdicts = [
        (name, f"{value:.4g}", limit, "not known" if np.isnan(value) else "met" if value <= limit else "NOT MET")
        for name, (value, limit) in judged.items()
    ]
    return "\n".join([
        f"The complete workflow without learned methods, one seed, on {used['cores_used']} of {used['cores']} cores "
        f"({used['cpu']}, {used['memory_gb']} GB). A first run at 1/64 compiled what was not yet compiled, in "
        f"{found['warm_up']['wall_s']:.0f} s.",
        *table("size | raw MB | smallest ATC day MB | wall min | all jobs min | jobs | peak MB | of rule | "
               + " | ".join(f"{kind} MB" for kind in disk), sizes),
        *table(f"rule at size {last['size']:g} | jobs | of these short | s, all | s, shortest | peak MB", rules),
        *table("growth of | exponent | from | to (95 %) | last step alone", growth),
        *table(f"at size {last['size']:g} | found | at most | verdict", verdicts),
        "",
    ])  # fmt: skip


def table(header, rows):
    """Lines of a Markdown table."""
    lines = [header, " | ".join("---" for _ in header.split("|")), *(" | ".join(map(str, row)) for row in rows)]
    return ["", *(f"| {line} |" for line in lines)]


def draw(found):
    """Time and peak memory against size, by stage."""
    runs = found["sizes"]
    sizes = [run["size"] for run in runs]
    fig, (both,) = figure(1, 2, PAGE_MM, 88)
    numbers = pd.DataFrame({"size": sizes, "wall time": [run["wall_s"] for run in runs]})
    label = with_exponent("wall time", found["exponents"]["wall time"])
    both[0].plot(sizes, numbers["wall time"], color="black", linewidth=1.8, marker="o", markersize=3, label=label)
    for axes, what, key in zip(both, ("time", "memory"), ("s", "peak_mb"), strict=True):
        for position, stage in enumerate(STAGE_NAMES):
            name = f"{what} of {stage}"
            numbers[name] = [run["stages"][stage][key] for run in runs]
            label = with_exponent(stage, found["exponents"][name])
            axes.plot(sizes, numbers[name], **method_style(position), label=label)
    both[0].axhline(30 * 60, color="grey", linewidth=0.6, label="30 minutes")
    both[1].axhline(PEAK_MB, color="grey", linewidth=0.6, label="2 GB")
    both[0].set(ylabel="the run, and the sum of a stage's jobs [s]")
    both[1].set(ylabel="peak memory of a stage's jobs [MB]")
    for axes in both:
        axes.set(xscale="log", yscale="log", xlabel="size (1: ten ATC days of 500 MB and 45 Edinburgh days)")
        axes.set_xticks(sizes, [f"{size:g}" for size in sizes])
        axes.xaxis.minorticks_off()
        title = "exponent of growth (95 % interval)"
        place = {"loc": "upper center", "bbox_to_anchor": (0.45, -0.18), "ncols": 2}
        axes.legend(title=title, fontsize=5, title_fontsize=5, handlelength=2.5, columnspacing=1, **place)
    save(fig, OUT, numbers, demo=True)


def with_exponent(name, grown):
    """A name with its exponent of growth, if three sizes or more tell it."""
    slope, low, high = grown["exponent"]
    return name if np.isnan(slope) else f"{name} {slope:.2f} ({low:.2f} to {high:.2f})"


if __name__ == "__main__":
    main()
