"""What all tests share: the real recordings where there are any, shipped dataset files, small raw files; no network."""

import ipaddress
import os
import sys
from pathlib import Path

import hypothesis
import pyarrow.parquet as pq
import pytest
from xdist.scheduler import LoadScopeScheduling

from modlhmp import storage
from modlhmp.datasets import load_dataset

ROOT = Path(__file__).parents[1]

# Reproducible on every machine: the same examples in every run, and no time limits.
hypothesis.settings.register_profile("modlhmp", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("modlhmp")


class NetworkError(RuntimeError):
    """A test asked for the network."""


def _only_this_machine(event, arguments):
    """Tests need no network: whoever looks a name up, or connects to another machine, is stopped."""
    if event in ("socket.connect", "socket.sendto") and isinstance(arguments[1], tuple):
        host = arguments[1][0]
    elif event in ("socket.getaddrinfo", "socket.gethostbyname"):
        host = arguments[0]
    else:
        return
    name = host.decode() if isinstance(host, bytes) else host
    if name in (None, "", "localhost"):
        return
    try:
        here = ipaddress.ip_address(name).is_loopback or ipaddress.ip_address(name).is_unspecified
    except ValueError:
        here = False
    if not here:
        raise NetworkError(f"{event}: {name}: tests use this machine only")


sys.addaudithook(_only_this_machine)


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
def load_shipped(config_folder):
    """Function (name, data_root) -> a shipped dataset file, loaded."""

    def load(name, data_root):
        return load_dataset(config_folder / "datasets" / f"{name}.yaml", data_root)

    return load


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


RUN_OF = {  # test file: the run that it looks at
    "tests/workflow/test_run.py": "tiny",
    "tests/workflow/test_notebooks.py": "tiny",
    "tests/workflow/test_hand_in.py": "tiny",
    "tests/workflow/test_reruns.py": "demo",
    "tests/workflow/test_outside.py": "walks",
    "tests/docs/test_blocks.py": "blocks",
    "tests/docs/test_site.py": "site",
    "tests/workflow/test_short_steps.py": "plaza",
}


class OneWorkerForARun(LoadScopeScheduling):
    """Tests that look at the same run of the workflow go to one worker, which makes it; all others to whoever is free.

    (pytest-xdist's own groups rename tests in a way that pytest 9.2 no longer allows.)
    """

    def _split_scope(self, nodeid):
        return RUN_OF.get(nodeid.partition("::")[0], nodeid)


def pytest_xdist_make_scheduler(config, log):
    """How `-n` spreads the tests."""
    return OneWorkerForARun(config, log)


@pytest.fixture
def rewrite():
    """Function (path, table, options) that writes a Parquet file anew, sealed, with just the metadata of the table."""

    def write(path, table, **options):
        kept = {key: value for key, value in (table.schema.metadata or {}).items() if key != storage.SEAL}
        with pq.ParquetWriter(path, table.schema.with_metadata(kept)) as writer:
            writer.write_table(table.replace_schema_metadata(kept), **options)
            writer.add_key_value_metadata({storage.SEAL: storage._UNSEALED})
        storage._seal(Path(path))

    return write
