"""Rule measure_runtime."""

import json
import subprocess
import sys

from modlhmp.logs import job_log
from modlhmp.storage import DataError, write_json
from modlhmp.study import runtime
from modlhmp.study.layout import Layout

with job_log(snakemake.log[0]) as log:
    params = snakemake.params
    task = {key: params[key] for key in ("run", "dataset", "recordings", "method", "max_tracks")}
    task["root"] = Layout.around(params.run, snakemake.output[0]).root
    task["exits"] = snakemake.input.exits
    command = [sys.executable, "-m", runtime.__name__]
    done = subprocess.run(command, input=json.dumps(task), capture_output=True, text=True, check=False)
    if done.returncode:
        raise DataError(done.stderr.strip())
    result = json.loads(done.stdout)
    log.info("%.3g s per track, %.0f MB", result["seconds_per_track"], result["memory_mb"])
    write_json(snakemake.output[0], result)
