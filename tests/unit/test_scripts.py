"""The scripts of notebooks/ run as they stand, in a folder of their own."""

import subprocess
import sys
from pathlib import Path

import pytest

import modlhmp

SCRIPTS = Path(__file__).parents[2] / "notebooks"


@pytest.fixture
def run(tmp_path):
    """Function (name, arguments): what a script prints."""

    def call(name, *arguments):
        command = [sys.executable, SCRIPTS / name, *arguments]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return call


def test_a_published_map(run, tmp_path):
    """Of made-up people, then with its own file as that of somebody else."""
    told = run("take_a_published_map.py")
    assert "form matlab, repaired: nothing" in told
    assert all(part in told for part in ("in 10 s: (", "there: ", "back: ", "upstream cost"))
    ours = modlhmp.load_map(tmp_path / "published.parquet")
    assert ours.whole.num_rows == modlhmp.load_map(tmp_path / "published.xml").whole.num_rows > 100
    (tmp_path / "theirs.csv").write_text((tmp_path / "published.csv").read_text())
    assert "theirs.csv: " in run("take_a_published_map.py", "theirs.csv")
