"""Which code a result depends on: a small package by hand, and the project's own scripts."""

import pytest

from modlhmp.study import versions
from modlhmp.study.versions import code_version, modules_of

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
    "maps/other.py": "",
    "storage.py": "from modlhmp import maps\n",  # a circle
    "deep/__init__.py": "from modlhmp import unused\n",
    "deep/inner.py": "",
    "unused.py": "",
}


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A made-up package of this name, and a script that uses it."""
    for name, text in PACKAGE.items():
        path = tmp_path / "modlhmp" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "script.py").write_text(SCRIPT)
    monkeypatch.setattr(versions, "PACKAGE", tmp_path / "modlhmp")
    versions._imports.cache_clear()
    yield tmp_path
    versions._imports.cache_clear()


def test_imports_are_followed(package):
    """Modules named directly, in functions, through packages and in circles; logs and what only they use are not."""
    assert modules_of(package / "script.py") == {
        *("modlhmp.maps", "modlhmp.maps.grid", "modlhmp.storage", "modlhmp.far", "modlhmp.deep.inner")
    }


@pytest.mark.parametrize(("name", "changes"), [(n, n in {"maps/__init__.py", "maps/grid.py", "storage.py", "far.py",
                                                         "deep/inner.py"}) for n in PACKAGE])  # fmt: skip
def test_an_edit_changes_the_version_of_those_who_need_it(package, name, changes):
    before = code_version(package / "script.py")
    with (package / "modlhmp" / name).open("a") as file:
        file.write("# an edit\n")
    assert (code_version(package / "script.py") != before) == changes


def test_the_project_s_scripts(config_folder):
    """Known dependencies of a few, and none that points back from scoring or maps to the figures."""
    scripts = config_folder.parent / "workflow/scripts"
    known = {file.stem: modules_of(file) for file in scripts.glob("*.py")}
    assert len(known) > 25
    assert "modlhmp.maps.mean_shift" in known["build_tc_cliff"]
    assert "modlhmp.study.runtime" in known["measure_runtime"]
    assert {"modlhmp.study.exhibits.style", "modlhmp.floor_plan"} <= known["figure_cliff_hours"]
    assert all(
        "modlhmp.study.exhibits.style" in modules for name, modules in known.items() if name.startswith("figure_")
    )
    for name, modules in known.items():
        if not name.startswith(("figure_", "table_")):
            assert not [module for module in modules if module.startswith("modlhmp.paper")], name
