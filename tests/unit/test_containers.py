"""The container recipes, as far as they can be read without an engine: what they copy and call is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_image_is_of_the_locked_python_and_of_a_user_without_rights():
    """From the lock, through the Makefile; nothing runs as root once the system's packages are in."""
    lines = (ROOT / "Dockerfile").read_text().splitlines()
    steps = [line.split(maxsplit=1) for line in lines if line and not line.startswith("#")]
    assert steps[0] == ["FROM", "python:3.11-slim"]
    user = steps.index(["USER", "walker"])
    assert ["RUN", "make environment"] in steps[user:]
    assert not [step for step in steps[user:] if "apt-get" in step[1]]
    assert steps[-1] == ["CMD", '["make", "reproduce"]']


def test_what_stays_outside_of_the_image_is_not_needed_in_it():
    """A `.dockerignore` that left out a source would show only where somebody builds."""
    ignored = (ROOT / ".dockerignore").read_text().split()
    assert not {name.strip("/") for name in ignored} & {"src", "workflow", "config", "profiles", "environment.lock"}
    assert {".venv", "results", "data"} <= set(ignored)


def test_both_call_rules_of_the_makefile():
    """`environment` and `reproduce`."""
    made = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for recipe in ("Dockerfile", "apptainer.def"):
        called = re.findall(r'\bmake(?:", "| -C /modlhmp | )([a-z]+)\b(?! rsync)', (ROOT / recipe).read_text())
        assert "environment" in called
        assert set(called) - {"rsync"} <= made


def test_apptainer_copies_files_that_are_there():
    """And all that the environment and the workflow are made of: what is installed, what is run."""
    text = (ROOT / "apptainer.def").read_text()
    copied = re.search(r"%files\n((?: .*\n)+)", text)[1].split()[::2]
    assert [name for name in copied if not (ROOT / name).exists()] == []
    assert set(copied) >= {"Makefile", "environment.lock", "pyproject.toml", "src", "Snakefile", "workflow", "config"}
    assert "README.md" in copied and "LICENSE" in copied  # pyproject.toml names them
