"""Rule measure_runtime."""

import json
import subprocess
import sys

from modlhmp.logs import job_log
from modlhmp.storage import DataError, write_text
from modlhmp.study import runtime

with job_log(snakemake.log[0]) as log:
    task = {**snakemake.params.task, "map": snakemake.input.map, "tracks": list(snakemake.input.tracks)}
    command = [sys.executable, "-m", runtime.__name__]
    done = subprocess.run(command, input=json.dumps(task), capture_output=True, text=True, check=False)
    if done.returncode:
        raise DataError(done.stderr.strip())
    result = json.loads(done.stdout)
    log.info("%.3g s a track, %.0f MB", result["seconds_per_track"], result["memory_mb"])
    write_text(snakemake.output[0], done.stdout)
