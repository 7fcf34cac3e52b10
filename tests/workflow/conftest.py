"""A fresh copy of the workflow, and one in which the tiny demo has run."""

import pytest
from project import Project


@pytest.fixture
def project(tmp_path):
    """A fresh copy."""
    return Project(tmp_path)


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory):
    """A copy in which the whole workflow has run on the tiny demo."""
    project = Project(tmp_path_factory.mktemp("tiny"))
    project.snakemake("--cores", 2, "--configfile", "config/tiny.yaml")
    return project
