"""Which code a result depends on: a small package by hand, and the project's own scripts."""

import pytest

from modlhmp.kinds import all_kinds
from modlhmp.study import versions
from modlhmp.study.versions import code_version, modules_of, project_version

SCRIPT = """
from modlhmp.logs import job_log
from modlhmp.maps import load

def late():
    from modlhmp import far
"""
PACKAGE = {
    "__init__.py": "",
    "logs.py": "import modlhmp.alone\n",
    "alone.py": "",
    "far.py": "import numpy as np\nimport modlhmp.deep.inner\n",
    "maps/__init__.py": "from modlhmp.maps.grid import load\n",
    "maps/grid.py": "from modlhmp.storage import read, write\nX = 1\n",
    "maps/other.py": "X = 2\n",
    "storage.py": "from modlhmp import maps\n",  # a circle
    "deep/__init__.py": "from modlhmp import unused\n",
    "deep/inner.py": "",
    "unused.py": "",
    # What settings say reaches a result through its rule's parameters.
    "settings.py": "import modlhmp.unused\n",
    "options.py": "import modlhmp.unused\n",
    "kinds.py": "import modlhmp.unused\n",
    "chosen.py": "from modlhmp.settings import check\nfrom modlhmp import kinds, options\n",
}
OUTSIDE = {
    "strides/__init__.py": "from .model import KIND\n",
    "strides/model.py": "import numpy\nfrom modlhmp.far import X\nfrom . import helpers\nfrom .deep import one\n",
    "strides/helpers.py": "",
    "strides/unused.py": "",
    "strides/deep/__init__.py": "",
    "strides/deep/one.py": "from .. import KIND\nfrom ..helpers import x\nfrom . import two\n",
    "strides/deep/two.py": "",
    "pacing.py": "import pacing_more\nimport strides.unused\n",
    "pacing_more.py": "",
}


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A made-up package of this name, a script that uses it, and packages that extend it."""
    for name, text in {**{f"modlhmp/{name}": text for name, text in PACKAGE.items()}, **OUTSIDE}.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "script.py").write_text(SCRIPT)
    monkeypatch.setattr(versions, "PACKAGE", tmp_path / "modlhmp")
    monkeypatch.syspath_prepend(tmp_path)
    for cache in (versions._imports, versions._file):
        cache.cache_clear()
    yield tmp_path
    for cache in (versions._imports, versions._file):
        cache.cache_clear()


FOLLOWED = {"modlhmp.maps", "modlhmp.maps.grid", "modlhmp.storage", "modlhmp.far", "modlhmp.deep.inner"}
STRIDES = {"strides", "strides.model", "strides.helpers", "strides.deep.one", "strides.deep.two"}


def test_imports_are_followed(package):
    """Modules named directly, in functions, through packages and in circles; logs and what only they use are not."""
    assert modules_of(package / "script.py") == FOLLOWED


def test_settings_and_records_of_kinds_are_neutral(package):
    """Nor is anything that only they use."""
    assert modules_of(package / "script.py", "modlhmp.chosen") == FOLLOWED | {"modlhmp.chosen"}
    assert modules_of(package / "script.py", "modlhmp.kinds") == FOLLOWED


def test_modules_that_a_parameter_names_are_followed(package):
    assert modules_of(package / "script.py", "modlhmp.maps.other") == FOLLOWED | {"modlhmp.maps.other"}
    before = code_version(package / "script.py", "modlhmp.maps.other")
    assert before != code_version(package / "script.py")
    (package / "modlhmp/maps/other.py").write_text("# an edit\n")
    assert before != code_version(package / "script.py", "modlhmp.maps.other")


def test_modules_of_a_package_that_extends_this_one_count(package):
    """By relative imports of one and several levels too, and without importing it; what nobody imports does not."""
    assert modules_of(package / "script.py", "strides") == FOLLOWED | STRIDES
    assert modules_of(package / "script.py", "strides.model") == FOLLOWED | STRIDES


def test_of_several_outside_packages_only_the_named_ones_count(package):
    """A package of one file is one, too; what it imports of others is theirs, as libraries are."""
    assert modules_of(package / "script.py", "pacing") == FOLLOWED | {"pacing"}
    assert modules_of(package / "script.py", "pacing", "pacing_more") == FOLLOWED | {"pacing", "pacing_more"}


@pytest.mark.parametrize("name", OUTSIDE)
def test_an_edit_of_an_outside_module_changes_the_version_of_those_who_need_it(package, name):
    def version():
        versions._imports.cache_clear()
        return code_version(package / "script.py", "strides")

    before = version()
    with (package / name).open("a") as file:
        file.write("# an edit\n")
    module = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    assert (version() != before) == (module in STRIDES)


@pytest.mark.parametrize(("name", "changes"), [(n, n in {"maps/__init__.py", "maps/grid.py", "storage.py", "far.py",
                                                         "deep/inner.py"}) for n in PACKAGE])  # fmt: skip
def test_an_edit_changes_the_version_of_those_who_need_it(package, name, changes):
    before = code_version(package / "script.py")
    with (package / "modlhmp" / name).open("a") as file:
        file.write("# an edit\n")
    assert (code_version(package / "script.py") != before) == changes


def test_the_project_s_scripts(config_folder):
    """Known dependencies of a few, and none that points back from scoring or maps to the figures."""
    scripts = {file.stem: file for file in (config_folder.parent / "workflow/scripts").glob("*.py")}
    assert len(scripts) > 15
    assert "modlhmp.study.runtime" in modules_of(scripts["measure_runtime"])
    for name, file in scripts.items():
        of_exhibits = [module for module in modules_of(file) if module.startswith("modlhmp.study.exhibits")]
        assert not of_exhibits or name in {"write_report", "gather_sites"}, name


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("modlhmp/far.py", True),
        ("modlhmp/settings.py", True),
        ("modlhmp/schemas/config.schema.json", True),
        ("modlhmp/study/report/assets/report.html.jinja", True),
        ("modlhmp/study/explorer/assets/app.js", True),
        ("workflow/Snakefile", True),
        ("workflow/rules/maps.smk", True),
        ("workflow/scripts/build_map.py", True),
        ("workflow/report/exhibit.rst", True),
        ("Snakefile", True),
        ("modlhmp/__pycache__/far.cpython-311.pyc", False),
        ("modlhmp/.far.py.swp", False),
        ("workflow/scripts/__pycache__/build_map.cpython-311.pyc", False),
        ("docs/index.md", False),
    ],
)
def test_the_project_s_version_is_of_every_file_that_a_run_may_depend_on(package, name, counts):
    """New, edited and gone files; not what is left beside them."""
    seen = [project_version(package)]
    file = package / name
    before = file.read_text() if file.exists() else None
    file.parent.mkdir(parents=True, exist_ok=True)
    for text in ("one\n", "two\n"):
        file.write_text(text)
        seen.append(project_version(package))
    if before is None:
        file.unlink()
    else:
        file.write_text(before)
    assert len(set(seen)) == (3 if counts else 1)
    assert project_version(package) == seen[0]


def test_a_kind_s_code_is_its_own(config_folder):
    """Forecasts depend on the modules of their kind, and on those of no other."""
    scripts = config_folder.parent / "workflow/scripts"
    of = {name: modules_of(scripts / "forecast_method.py", *kind.code) for name, kind in all_kinds().items()}
    forecasters = {"cliff": "rollout", "snippets": "chain", "episodes": "replay", "cvm": "cvm"}
    for name, forecaster in forecasters.items():
        assert f"modlhmp.forecasting.{forecaster}" in of[name]
    rolled_out = {"cliff", "tc_cliff", "stef", "smoothed_cliff", "neural_velocity"}
    for own, users in {"chain": {"snippets", "pooled"}, "rollout": rolled_out}.items():
        assert {name for name in of if f"modlhmp.forecasting.{own}" in of[name]} == users
    networks = {name: kind for name, kind in all_kinds().items() if kind.learned}
    for name in networks:
        found = {other for other in networks if f"modlhmp.networks.{other}" in of[name]}
        assert found == {name, *{"social_lstm": ["lstm"], "mid": ["trajectronpp"]}.get(name, [])}, name
    others = set(of) - set(networks) - {"neural_velocity"}  # which is built by one
    assert not [name for name in others if any("networks" in module for module in of[name])]
    assert "modlhmp.maps.mean_shift" in modules_of(scripts / "build_map.py", "modlhmp.maps.tc_cliff")
    assert "modlhmp.maps.mean_shift" not in modules_of(scripts / "build_map.py", "modlhmp.maps.stef")
