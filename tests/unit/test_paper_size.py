"""`make paper-size` takes its times by the names of the workflow's scripts."""

import runpy
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_stage_is_measured_by_scripts_that_there_are():
    stages = runpy.run_path(str(ROOT / "benchmarks/paper_size.py"))["STAGES"]
    assert {file.stem for file in (ROOT / "workflow/scripts").glob("*.py")} >= set(stages)
