"""A published map in the workflow: `theirs: {kind: cliff, file: ...}` is forecast and scored like any method."""

import json

import numpy as np
import pandas as pd
import pytest
from project import Project, planned

import modlhmp
from modlhmp.origins import file_sha256
from modlhmp.storage import column, read_metadata

CONFIG = """
run: theirs
datasets: [demo_hall]
seeds: [0]
demo: {scale: 0.15}
compare: [theirs, theirs_many, their_hours, cvm]
methods:
  theirs: {kind: cliff, title: Published, file: maps/published.csv}
  theirs_many: {inherits: theirs, title: "Published, 9", options: {k: 9}}
  their_hours: {kind: tc_cliff, title: "Published, by hours", file: "maps/hall_{hour}_online.csv", form: online}
comparisons: [[theirs, cvm]]
ladder: {rows: []}
uncertainty: {methods: []}
studies: {method: theirs, beta: [], sampling_radius_m: [], training: {methods: [], shares: []}}
"""
RUN = ("--configfile", "theirs.yaml")
TABLES = ("paper_figures/theirs/results.csv", "paper_figures/theirs/tab_expres.md")
BUILT = ("results/theirs/demo_hall/maps/cliff.parquet", "results/theirs/demo_hall/maps/tc_cliff")
MAPS = "results/theirs/demo_hall/maps/published"


@pytest.fixture(scope="module")
def theirs(tmp_path_factory):
    """A project in which maps were built, given away as CSV, and then used as somebody's published maps."""
    project = Project(tmp_path_factory.mktemp("theirs"))
    before = CONFIG.replace("theirs, theirs_many, their_hours, ", "").replace("method: theirs", "method: cliff")
    (project.folder / "theirs.yaml").write_text(before.replace("[[theirs, cvm]]", "[]"))
    project.snakemake("--cores", 2, *RUN, "--", *BUILT)
    folder = project.folder / "resources/maps"
    modlhmp.load_map(project.folder / BUILT[0]).save(folder / "published.csv", form="matlab")
    modlhmp.load_map(project.folder / BUILT[1]).save(folder / "hours", form="online")
    for file in (folder / "hours").glob("[0-9]*.csv"):
        file.rename(folder / f"hall_{int(file.stem)}_online.csv")
    (project.folder / "theirs.yaml").write_text(CONFIG)
    project.snakemake("--cores", 2, *RUN, "--", *TABLES)
    return project


def test_it_is_in_every_table(theirs):
    results = pd.read_csv(theirs.folder / "paper_figures/theirs/results.csv")
    assert set(results["method"]) == {"theirs", "theirs_many", "their_hours", "cvm"}
    assert (results.groupby("method")["n"].max() > 0).all()
    assert "Published, by hours" in (theirs.folder / "paper_figures/theirs/tab_expres.md").read_text()


def test_the_map_is_imported_with_its_origin(theirs):
    """What was built comes back; the file is in the provenance of the map and of the forecasts made with it."""
    ours, imported = (modlhmp.load_map(theirs.folder / file) for file in (BUILT[0], f"{MAPS}/theirs.parquet"))
    for name in ("x", "y", "weight", "mean_speed", "var_heading", "var_speed"):
        np.testing.assert_array_equal(column(ours.whole, name), column(imported.whole, name), err_msg=name)
    assert ours.site == imported.site
    hours = modlhmp.load_map(theirs.folder / f"{MAPS}/their_hours")
    assert hours.hours.keys() == modlhmp.load_map(theirs.folder / BUILT[1]).hours.keys()
    assert hours.whole is None
    digest = file_sha256(theirs.folder / "resources/maps/published.csv")
    for method in ("theirs", "theirs_many"):
        files = sorted((theirs.folder / f"results/theirs/demo_hall/forecasts/{method}").glob("*.parquet"))
        for file in (theirs.folder / f"{MAPS}/theirs.parquet", *files):
            assert read_metadata(file)["sources"]["published.csv"] == digest
    metadata = imported.whole.schema.metadata
    assert json.loads(metadata[b"imported"]) == {
        "file": "published.csv", "sha256": digest, "form": "matlab", "repaired": {}
    }  # fmt: skip


def test_no_map_of_its_kind_is_built_for_it(theirs):
    rules = planned(theirs.snakemake("-n", "-F", *RUN, "--", *TABLES))
    assert {"import_theirs", "import_their_hours"} <= rules.keys()
    assert not {rule for rule in rules if rule.startswith("build_")}


def test_another_file_makes_its_forecasts_anew_and_no_others(theirs):
    file = theirs.folder / "resources/maps/published.csv"
    kept = file.read_text()
    try:
        file.write_text(kept.replace("1.", "1.1", 1))
        rules = planned(theirs.snakemake("-n", *RUN, "--", *TABLES))
    finally:
        file.write_text(kept)
    made = {"import_theirs": 1, "forecast_method": 2, "score_method": 2}
    assert made.items() <= rules.items()
    assert "import_their_hours" not in rules
