"""A copy of the workflow in a temporary folder, and Snakemake run in it as a user would."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


class Project:
    """Snakefile, workflow, config and profiles under `folder`; the package is the installed one."""

    def __init__(self, folder):
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("workflow", "config", "profiles"):
            shutil.copytree(ROOT / name, folder / name)
        shutil.copy(ROOT / "Snakefile", folder)

    def snakemake(self, *arguments, fails=False, **environment):
        """Run Snakemake here; returns everything it printed."""
        inherited = {key: value for key, value in os.environ.items() if key != "MODLHMP_DATA"}
        done = subprocess.run(
            [sys.executable, "-m", "snakemake", *map(str, arguments)],
            cwd=self.folder,
            env={**inherited, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=900,
            check=False,
        )
        assert (done.returncode != 0) == fails, done.stdout[-5000:]
        return done.stdout
