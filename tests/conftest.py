"""What all tests share: the real recordings where there are any, shipped dataset files, small raw files."""

import os
from pathlib import Path

import hypothesis
import pytest
import yaml
from xdist.scheduler import LoadScopeScheduling

from modlhmp.settings import load_dataset

ROOT = Path(__file__).parents[1]

# Reproducible on every machine: the same examples in every run, and no time limits.
hypothesis.settings.register_profile("modlhmp", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("modlhmp")


@pytest.fixture(scope="session")
def real_data():
    """Folder of the real recordings, from the environment variable MODLHMP_DATA."""
    folder = os.environ.get("MODLHMP_DATA")
    if not folder:
        pytest.skip("MODLHMP_DATA is not set: it names the folder of the real recordings")
    if not Path(folder).is_dir():
        pytest.skip(f"MODLHMP_DATA is {folder}, but there is no such folder")
    return Path(folder)


@pytest.fixture(scope="session")
def config_folder():
    """The project's config/."""
    return ROOT / "config"


@pytest.fixture(scope="session")
def schemas():
    """The project's JSON schemas: {"config": ..., "dataset": ...}."""
    folder = ROOT / "workflow/schemas"
    return {n: yaml.safe_load((folder / f"{n}.schema.yaml").read_text()) for n in ("config", "dataset")}


@pytest.fixture(scope="session")
def load_shipped(config_folder, schemas):
    """Function (name, data_root) -> a shipped dataset file, loaded with the schema."""

    def load(name, data_root):
        return load_dataset(config_folder / "datasets" / f"{name}.yaml", schemas["dataset"], data_root)

    return load


@pytest.fixture(scope="session")
def recording_named():
    """Function (dataset, name) -> the recording of a loaded dataset."""

    def find(dataset, name):
        return next(recording for recording in dataset["recordings"] if recording["name"] == name)

    return find


@pytest.fixture
def write(tmp_path):
    """Function (content, name) -> path of a new file with these bytes or this text, line ends untouched."""

    def create(content, name="recording.csv"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return create


def pytest_collection_modifyitems(items):
    """The workflow's long tests first: beside them the other worker does all the short ones."""
    items.sort(key=lambda item: "/workflow/test_run" not in str(item.path))


class OneWorkerForTheTinyRun(LoadScopeScheduling):
    """Tests that look at the tiny run go to one worker, which makes it; all others to whoever is free.

    (pytest-xdist's own groups rename tests in a way that pytest 9.2 no longer allows.)
    """

    def _split_scope(self, nodeid):
        return "tiny" if nodeid.startswith(("tests/workflow/test_run", "tests/workflow/test_notebooks")) else nodeid


def pytest_xdist_make_scheduler(config, log):
    """How `-n` spreads the tests."""
    return OneWorkerForTheTinyRun(config, log)
