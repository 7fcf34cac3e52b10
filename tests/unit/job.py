"""A rule's script, run with what Snakemake would give it, but without a run around it."""

import json
import subprocess
import sys
from pathlib import Path

SCRIPTS = Path(__file__).parents[2] / "workflow/scripts"
RUN = """
import json, runpy, sys
from types import SimpleNamespace
from snakemake.iocontainers import Namedlist

given = {}
for part, values in json.load(sys.stdin).items():
    given[part] = Namedlist()
    for name, value in values.items():
        several = part == "input" and isinstance(value, list)
        start = len(given[part])
        given[part].extend(value if several else [value])
        given[part]._set_name(name, start, end=len(given[part]) if several else None)
runpy.run_path(sys.argv[1], {"snakemake": SimpleNamespace(**given)})
"""


def run_job(script, **given):
    """The finished process of a script; `given` are its `input`, `output`, `params` and so on, by their names."""
    return subprocess.run(
        [sys.executable, "-c", RUN, SCRIPTS / f"{script}.py"], input=json.dumps(given), capture_output=True, text=True,
        check=False, timeout=300,
    )  # fmt: skip
