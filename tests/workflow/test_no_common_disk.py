"""Machines without a disk in common: what one needs of another goes through a store, here a folder; nothing else."""

import os
import shutil
import subprocess
from importlib.util import find_spec

import pytest
from project import ROOT, Project

from modlhmp.study.certificate import outputs
from modlhmp.study.layout import Layout

pytestmark = pytest.mark.skipif(
    find_spec("snakemake_storage_plugin_fs") is None, reason="the extra `cluster` is not installed"
)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """A PATH with rsync, which the plugin copies with; unpacked where the system has none."""
    if shutil.which("rsync"):
        return os.environ["PATH"]
    folder = tmp_path_factory.mktemp("rsync")
    done = subprocess.run(
        ["bash", ROOT / "tests/cluster/unpack.sh", folder, "rsync"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        pytest.skip(f"no rsync: {done.stderr.strip()}")
    return f"{folder}/bin:{os.environ['PATH']}"


def run(project, store, path, *targets):
    """A run that finds and leaves everything in the store; copies of what its jobs used stay to be looked at."""
    storage = ("--default-storage-provider", "fs", "--default-storage-prefix", store, "--shared-fs-usage", "none")
    return project.snakemake(
        *("--cores", 2, "--configfile", "config/tiny.yaml", *storage, "--keep-storage-local-copies", "--", *targets),
        PATH=path,
    )


def travelled(project, store):
    """Files of results that are in a machine's folder, by their names in the store."""
    copies = project.folder / f".snakemake/storage/fs/{str(store).lstrip('/')}"
    return {
        str(file.relative_to(copies))
        for file in copies.rglob("*")
        if file.is_file() and not file.name.startswith(".") and "/logs/" not in str(file) and file.suffix != ".tsv"
    }


def test_a_second_machine_goes_on_from_what_it_needs(tiny_run, tmp_path, path):
    """One cleans and builds a map, another forecasts with it: the bytes of one machine, no file that is not used."""
    store = tmp_path / "store"
    first, second = Project(tmp_path / "first"), Project(tmp_path / "second")
    run(first, store, path, "results/tiny/demo_forum/maps/stef")
    assert not (first.folder / "results").exists()
    run(second, store, path, "results/tiny/demo_forum/errors/stef.parquet")
    tracks = {str(file.relative_to(store)) for file in (store / "results/tiny/demo_forum/tracks").glob("*.parquet")}
    found = travelled(second, store)
    assert not [file for file in found if "maps/" in file and "maps/stef/" not in file]
    assert "results/tiny/demo_forum/errors/stef.parquet" in found
    assert len(tracks & found) == len(tracks) // 2  # those of the tests
    same_bytes(tiny_run, store)


@pytest.mark.full
def test_the_whole_run_is_the_same(tiny_run, tmp_path, path):
    """All exhibits, from a second machine that starts after the forecasts of a first."""
    store = tmp_path / "store"
    first, second = Project(tmp_path / "first"), Project(tmp_path / "second")
    run(first, store, path, *(f"results/tiny/{name}/errors/hybrid.parquet" for name in ("demo_hall", "demo_forum")))
    run(second, store, path, "certify")
    assert same_bytes(tiny_run, store) == set(outputs(Layout("tiny", str(tiny_run.folder))))


def same_bytes(tiny_run, store):
    """Every file in the store is that of the plain run; returns their names."""
    plain, found = (outputs(Layout("tiny", str(one))) for one in (tiny_run.folder, store))
    assert {name for name, digest in found.items() if digest != plain.get(name)} == set()
    return set(found)
