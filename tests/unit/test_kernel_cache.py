"""Where compiled kernels are kept: a folder of their own for every version of their sources."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import modlhmp

PACKAGE = Path(modlhmp.__file__).parent
ASK = "import os, modlhmp; print(modlhmp.__file__, os.environ['NUMBA_CACHE_DIR'])"
CHILD = f"import subprocess, sys, modlhmp; subprocess.run([sys.executable, '-c', {ASK!r}], check=True)"


@pytest.fixture
def package(tmp_path):
    """Function (name) -> a copy of the package under this name, where it can be edited."""

    def copy(name="one"):
        folder = tmp_path / name / "modlhmp"
        shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__"))
        return folder

    return copy


def cache_of(package, base, code=ASK):
    """The folder that a process with this copy of the package uses, when told the folder `base` (None: nothing)."""
    inherited = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    told = {} if base is None else {"NUMBA_CACHE_DIR": str(base)}
    environment = {**inherited, **told, "PYTHONPATH": str(package.parent), "HOME": str(package.parent)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    file, folder = done.stdout.split()
    assert Path(file).parent == package  # the copy, not the installed one
    return Path(folder)


def edit(file):
    """Change a source file a little."""
    file.write_text(file.read_text() + "\n# an edit\n")


def test_the_same_sources_have_the_same_folder_wherever_they_lie(package, tmp_path):
    assert cache_of(package("one"), tmp_path / "cache") == cache_of(package("two"), tmp_path / "cache")


@pytest.mark.parametrize("name", ["forecasting/base.py", "maps/swgmm.py", "scoring/uncertainty.py"])
def test_an_edited_kernel_has_another(package, tmp_path, name):
    """Also one that other kernels only call; taken back, the old machine code is found again."""
    copy = package()
    before, source = cache_of(copy, tmp_path / "cache"), (copy / name).read_text()
    edit(copy / name)
    assert cache_of(copy, tmp_path / "cache") != before
    (copy / name).write_text(source)
    assert cache_of(copy, tmp_path / "cache") == before


def test_an_edited_constant_of_kernels_has_another(package, tmp_path):
    """Numba compiles the values of globals in: those that the snippets' kernels import stand in a file without any."""
    copy = package()
    before, file = cache_of(copy, tmp_path / "cache"), copy / "maps/pieces.py"
    assert "@kernel" not in file.read_text()
    file.write_text(file.read_text().replace("SLOW_M_S = 0.3", "SLOW_M_S = 0.4"))
    assert cache_of(copy, tmp_path / "cache") != before


@pytest.mark.parametrize("name", ["settings.py", "study/exhibits/style.py", "networks/lstm.py"])
def test_an_edit_elsewhere_compiles_nothing_again(package, tmp_path, name):
    copy = package()
    before = cache_of(copy, tmp_path / "cache")
    edit(copy / name)
    assert cache_of(copy, tmp_path / "cache") == before


def test_it_lies_in_the_folder_that_was_named(package, tmp_path):
    copy = package()
    folder = cache_of(copy, tmp_path / "cache")
    assert folder.parent == tmp_path / "cache"
    assert cache_of(copy, tmp_path / "other") == tmp_path / "other" / folder.name


def test_without_a_name_it_lies_in_the_home_folder(package):
    copy = package()
    assert cache_of(copy, None).parent == copy.parent / ".cache/modlhmp"


@pytest.mark.parametrize("named", ["a file", "nowhere"])
def test_where_nothing_may_be_written_it_lies_with_the_temporary_files(package, tmp_path, monkeypatch, named):
    """A read-only installation, or a home folder that is none."""
    (tmp_path / "a file").touch()
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    base = tmp_path / named / "cache" if named == "a file" else Path("/proc/nowhere")
    copy = package()
    folder = cache_of(copy, base)
    assert folder.parent.parent == tmp_path / "tmp"
    assert folder.is_dir()
    assert cache_of(copy, base, CHILD) == folder


COMPILE = """
from modlhmp.maps.swgmm import floor_covariance
floor_covariance(0.1, 0.0, 0.1)
print(len(floor_covariance.stats.cache_misses))
"""


def started(environment, code):
    """A process that calls a kernel and prints how often it had to compile it."""
    return subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True)


def test_jobs_that_start_together_compile_a_kernel_once(package, tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(package().parent)}
    jobs = [started(environment, COMPILE) for _ in range(4)]
    compiled = [int(job.communicate(timeout=300)[0]) for job in jobs]
    assert sorted(compiled) == [0, 0, 0, 1]  # the others found what that one had compiled


def test_types_that_are_compiled_at_once_do_not_take_each_other_s_place(package, tmp_path):
    """Numba's index of a kernel is read, changed and written again: without a lock the last writer wins."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(package().parent)}
    calls = [COMPILE.replace("0.1, 0.0, 0.1", values) for values in ("0.1, 0.0, 0.1", "1, 0, 1", "1.0, 0, 1")]
    jobs = [started(environment, call) for call in calls]
    assert [int(job.communicate(timeout=300)[0]) for job in jobs] == [1, 1, 1]
    again = [int(started(environment, call).communicate(timeout=300)[0]) for call in calls]
    assert again == [0, 0, 0]


def test_a_child_process_has_its_parent_s(package, tmp_path):
    """Not a folder within it, at any depth: what one has compiled, all find."""
    copy = package()
    assert cache_of(copy, tmp_path / "cache", CHILD) == cache_of(copy, tmp_path / "cache")
    grandchild = f"import subprocess, sys, modlhmp; subprocess.run([sys.executable, '-c', {CHILD!r}], check=True)"
    assert cache_of(copy, tmp_path / "cache", grandchild) == cache_of(copy, tmp_path / "cache")


def test_this_process_uses_it():
    """Numba was told before it was imported."""
    from numba.core import config  # noqa: PLC0415 - read when it is asked

    assert Path(config.CACHE_DIR) == Path(os.environ["NUMBA_CACHE_DIR"]) == modlhmp._kernel_cache()
