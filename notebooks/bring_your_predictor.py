"""Give a task of the demo to a program that knows nothing of modlhmp, and score what comes back beside CVM.

    .venv/bin/snakemake --cores 2
    .venv/bin/python notebooks/bring_your_predictor.py task

The first makes the demo's recordings (MODLHMP_RUN names those of another run), `task` is a folder for what is written.
"""

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pandas as pd

HERE = Path(__file__).parent
DATASET = HERE.parent / "config/datasets/demo_hall.yaml"
RECORDINGS = HERE.parent / "resources/demo" / os.environ.get("MODLHMP_RUN", "demo")


def run(*command):
    """What a Python program writes to its output; its progress goes to the terminal."""
    return subprocess.run([sys.executable, *map(str, command)], check=True, stdout=subprocess.PIPE, text=True).stdout


def main(folder):
    """Export, forecast twice, score both."""
    modlhmp, where = ("-m", "modlhmp.cli"), ("--data-root", RECORDINGS)
    run(*modlhmp, "export-task", DATASET, "--to", folder, "--training", *where)
    run(HERE / "predictor.py", folder, folder / "theirs")
    straight = folder / "straight/forecasts.csv"
    horizon_s = json.loads((folder / "task.json").read_text())["horizon_s"]
    observed = ("--tracks", folder / "observations.csv", "--horizon", horizon_s)
    run(*modlhmp, "forecast", "--map", "cvm", *observed, "--out", straight)
    straight.with_suffix(".json").write_text((folder / "theirs/forecasts.json").read_text())
    scores = {
        name: pd.read_csv(io.StringIO(run(*modlhmp, "score", folder / name, "--tracks", DATASET, *where)))
        for name in ("theirs", "straight")
    }
    both = pd.concat(scores, names=["method"]).query("protocol == 'complete'")
    print("Demo data (made-up people). ADE [m], complete protocol:")
    print(both.pivot_table("ade_m", "method", "horizon_s").round(2).to_string())


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "task"))
