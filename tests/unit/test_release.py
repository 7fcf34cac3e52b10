"""What a release consists of: one version everywhere, and files that others' tools read."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import tomllib
import yaml
from PIL import Image

import modlhmp
from modlhmp.contract import SITE, crowd
from modlhmp.storage import read_json, read_metadata, write_json

ROOT = Path(__file__).parents[2]
VERSION = modlhmp.__version__


def loaded(name):
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_the_version_stands_in_one_place():
    """pyproject.toml asks the package; the citation and the changelog speak of the same."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" not in project["project"] and "version" in project["project"]["dynamic"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "modlhmp.version.__version__"}
    assert loaded("CITATION.cff")["version"] == VERSION
    versions = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert VERSION in versions and set(versions) - {"Unreleased"} <= {one for one in versions if re.match(r"\d", one)}


def test_the_changelog_is_by_kind():
    kinds = re.findall(r"^### (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert kinds and set(kinds) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_the_citation_has_what_its_format_requires():
    """The keys that CFF 1.2.0 requires, of the work and of every reference."""
    found = loaded("CITATION.cff")
    assert {"cff-version", "message", "title", "authors"} <= set(found)
    assert found["cff-version"] == "1.2.0" and found["type"] == "software"
    for work in (found, *found["references"]):
        assert {"title", "type", "authors"} <= set(work)
        for one in work["authors"]:
            assert "name" in one or {"family-names", "given-names"} <= set(one)


def test_the_catalog_knows_how_the_workflow_is_used():
    usage = loaded(".snakemake-workflow-catalog.yml")["usage"]
    assert set(usage) == {"mandatory-flags", "software-stack-deployment", "report"}
    assert set(usage["mandatory-flags"]) == {"desc", "flags"}


@pytest.mark.parametrize("name", ["wrong-number", "recording-does-not-load"])
def test_an_issue_s_form_asks_for_the_version(name):
    form = loaded(f".github/ISSUE_TEMPLATE/{name}.yml")
    assert {"name", "description", "body"} <= set(form)
    asked = {one["id"]: one for one in form["body"] if one["type"] != "markdown"}
    assert len(asked) >= 4
    assert asked["version"]["validations"]["required"] is True
    assert all(one["attributes"]["label"] for one in asked.values())


def test_what_the_library_writes_says_its_version(tmp_path):
    """A map, its picture in each format, and an occupancy map for robots: those of the study `test_run` looks at."""
    people = crowd(20)
    a_map = modlhmp.build_map("cliff", people, SITE)
    a_map.save(tmp_path / "map.parquet")
    assert read_metadata(tmp_path / "map.parquet")["modlhmp.version"] == VERSION
    from modlhmp.pictures import draw_map  # noqa: PLC0415 - matplotlib
    from modlhmp.ros import write_map  # noqa: PLC0415

    for suffix in ("png", "pdf", "svg"):
        draw_map("cliff", a_map.whole, tmp_path / f"map.{suffix}")
        assert f"modlhmp {VERSION}".encode() in (tmp_path / f"map.{suffix}").read_bytes()
    assert Image.open(tmp_path / "map.png").text["Software"] == f"modlhmp {VERSION}"
    futures = modlhmp.forecast(a_map, people.take(np.arange(4)), horizon_s=5)  # of one person
    image = write_map(futures.occupancy(cell_m=1.0), tmp_path / "there.yaml", 5)
    assert f"by modlhmp {VERSION}" in (tmp_path / "there.yaml").read_text()
    assert f"by modlhmp {VERSION}".encode() in image.read_bytes()


def test_a_sealed_file_gives_back_what_was_written(tmp_path):
    """The version is in the file, and no part of what is read."""
    write_json(tmp_path / "a.json", {"b": 1})
    assert json.loads((tmp_path / "a.json").read_text())["modlhmp.version"] == VERSION
    assert read_json(tmp_path / "a.json") == {"b": 1}
