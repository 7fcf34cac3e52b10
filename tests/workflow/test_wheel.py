"""The library from its wheel, outside the checkout."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import modlhmp

ROOT = Path(__file__).parents[2]
TEN_LINES = """
import modlhmp
from modlhmp.contract import SITE, crowd
people = crowd(20)
a_map = modlhmp.build_map("cliff", people, SITE)
a_map.save("map.parquet")
futures = modlhmp.forecast(modlhmp.load_map("map.parquet"), people.take(people.t < 1.3e9 + 45), horizon_s=5)
print(modlhmp.__file__, futures.best.shape[1:], modlhmp.score(futures, people).at(3)["n"] > 0)
"""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of what is packed: building leaves files beside the sources."""
    copy = tmp_path_factory.mktemp("source") / "modlhmp"
    shutil.copytree(ROOT / "src", copy / "src", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    return copy


def wheel_of(source, folder):
    """The wheel of a folder or an sdist."""
    command = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "-w", folder, source]
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def wheel(source, tmp_path_factory):
    """The wheel, built from the repository."""
    return wheel_of(source, tmp_path_factory.mktemp("wheel"))


def test_it_holds_the_package_with_its_schemas(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    kinds = ("*.py", "*.json", "py.typed", "assets/*")
    files = [file for kind in kinds for file in (ROOT / "src/modlhmp").rglob(kind)]
    sources = {f"modlhmp/{file.relative_to(ROOT / 'src/modlhmp').as_posix()}" for file in files}
    assert sources <= set(names)
    assert "modlhmp/schemas/dataset.schema.json" in names


def test_the_sdist_makes_the_same_wheel(source, wheel, tmp_path):
    """Nothing that is needed to build it is left in the repository alone."""
    command = ["-m", "build", "--sdist", "--no-isolation", "--outdir", tmp_path, source]
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    (packed,) = tmp_path.glob("*.tar.gz")
    assert packed.name == f"modlhmp-{modlhmp.__version__}.tar.gz"
    (tmp_path / "wheel").mkdir()
    again = wheel_of(packed, tmp_path / "wheel")
    assert again.name == wheel.name
    of = [
        {name: zipfile.ZipFile(file).read(name) for name in zipfile.ZipFile(file).namelist()} for file in (wheel, again)
    ]
    assert of[0] == of[1]


def test_it_works_elsewhere_without_the_study_s_libraries(wheel, tmp_path):
    """With nothing but the wheel and what the library needs; the command is there as well."""
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    for name in ("matplotlib", "pandas", "snakemake", "torch", "PIL", "jsonschema"):
        (tmp_path / f"site/{name}.py").write_text("raise ImportError('not installed')")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}

    def run(*arguments):
        command = [sys.executable, *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert not done.returncode, done.stderr
        return done.stdout.splitlines()

    assert run("-c", TEN_LINES) == [f"{tmp_path}/site/modlhmp/__init__.py (5, 2) True"]
    assert run("-m", "modlhmp.cli", "--version") == [f"modlhmp {modlhmp.__version__}"]
    assert any(line.startswith("tc_cliff") for line in run("-m", "modlhmp.cli", "kinds"))
    assert any("sampling_radius_m = 1.0" in line for line in run("-m", "modlhmp.cli", "kinds", "cliff"))
