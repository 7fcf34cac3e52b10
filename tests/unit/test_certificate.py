"""A certificate names every file of a run, and says what two runs differ in, and why."""

import json
import shutil
from pathlib import Path

import pandas as pd
import pytest
from job import run_job

from modlhmp.origins import file_sha256, provenance
from modlhmp.storage import read_metadata, write_json, write_parquet, write_text
from modlhmp.study import certificate as of
from modlhmp.study.claims import CLAIMS
from modlhmp.study.configuration import load_datasets, load_run
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout
from modlhmp.study.plan import Plan
from modlhmp.yaml_file import read_yaml

MAP = "".join(f"{n},0,{0.2 * n:.1f},1.1,0.1,0,0,0.1,1,1,0.5\n" for n in range(30))  # of a CLiFF-map


@pytest.fixture
def layout(tmp_path):
    """A small run: tracks, a training, costs, a log, two tables."""
    layout = Layout("r", str(tmp_path / "here"))
    write_parquet({"x": [1.0]}, layout.tracks("hall", "monday"), sources={"monday.csv": "ab12"})
    write_json(layout.training("hall", "lstm"), {"epochs": 3, "core_minutes": 2.5, "curve": [{"seconds": 1.0, "n": 2}]})
    write_json(layout.costs("hall"), {"cvm": 1.0})
    write_text(layout.log("clean"), "at noon")
    write_text(f"{layout.exhibit('ladder-hall')}.csv", "row,ms per track,ADE\na,0.1,2\n")
    write_text(f"{layout.exhibit('ladder-hall')}.md", "| a | 0.1 | 2 |")
    write_text(f"{layout.exhibit('results')}.md", "| a |")
    return layout


@pytest.fixture
def certified(layout, tmp_path):
    """The run with its certificate."""
    write_json(layout.certificate, of.certificate(layout, {"run": "r", "seeds": [0]}, tmp_path))
    return layout


def test_it_names_what_came_out_and_what_went_in(layout, tmp_path):
    made = of.certificate(layout, {"seeds": [0]}, tmp_path)
    assert made["outputs"].keys() == {
        "results/hall/tracks/monday.parquet",
        "results/hall/models/lstm.json",
        "paper_figures/ladder-hall.csv",
        "paper_figures/results.md",
    }
    assert made["inputs"] == {"hall/monday/monday.csv": "ab12"}
    assert made["configuration"].keys() == {"seeds"}
    assert made["environment"]["numpy"]
    assert "modlhmp/study/certificate.py" in made["code"]


def test_files_of_one_name_are_all_named(layout, tmp_path):
    """Also where results of several recordings, each of its own file, are put together, in whatever order and twice."""
    digests = []
    for part in ("s1", "s2", "s3"):
        raw = tmp_path / part / "tracks.csv"
        write_text(raw, f"of {part}")
        digests.append(file_sha256(raw))
        write_parquet({"x": [1.0]}, tmp_path / f"{part}.parquet", **provenance({}, {}, [raw]))
        assert read_metadata(tmp_path / f"{part}.parquet")["sources"] == {"tracks.csv": digests[-1]}
    assert set(provenance({}, {}, [tmp_path / f"s{n}/tracks.csv" for n in (1, 2)])["sources"].values()) == {
        *digests[:2]
    }

    def joined(name, *of):
        write_parquet({"x": [1.0]}, tmp_path / name, **provenance({}, {}, [tmp_path / one for one in of]))
        return read_metadata(tmp_path / name)["sources"]

    both = joined("both.parquet", "s1.parquet", "s2.parquet")
    assert both == {f"tracks.csv@{one[:12]}": one for one in digests[:2]}
    assert joined("again.parquet", "s2.parquet", "both.parquet", "s1.parquet") == both
    assert set(joined("all.parquet", "both.parquet", "s3.parquet").values()) == {*digests}


def test_published_maps_of_one_name_are_all_named(layout, tmp_path):
    """Whether they are one table or one for each hour, by the dataset's name."""
    before = of.inputs(layout)
    for dataset, method, kind, digest in [
        ("hall", "theirs", "cliff", "aa"), ("hall", "others", "cliff", "bb"), ("forum", "hours", "tc_cliff", "cc"),
    ]:  # fmt: skip
        path = Path(layout.published_map(dataset, method, kind))
        write_parquet({"x": [1.0]}, path if path.suffix else path / "09.parquet", sources={"map.csv": digest})
    assert of.inputs(layout) == {**before, "hall/map.csv@aa": "aa", "hall/map.csv@bb": "bb", "forum/map.csv": "cc"}


def test_forecasts_from_outside_and_floor_plans_are_named(layout):
    """By the results that hold them; a recording that these hand on is named once."""
    before = of.inputs(layout)
    for path, sources in [
        (layout.forecast("hall", "theirs", "monday"), {"forecasts.csv": "aa"}),
        (layout.forecast("hall", "others", "monday"), {"forecasts.csv": "bb"}),
        (layout.errors("hall", "theirs"), {"forecasts.csv": "aa", "hall.pgm": "cc"}),
        (layout.ttests("hall"), {"hall.pgm": "cc"}),
    ]:
        write_parquet({"x": [1.0]}, path, sources={"monday.csv": "ab12", **sources})
    more = {"hall/forecasts.csv@aa": "aa", "hall/forecasts.csv@bb": "bb", "hall/hall.pgm": "cc"}
    assert of.inputs(layout) == {**before, **more}


@pytest.fixture
def configured(tmp_path, config_folder):
    """Function of a data root, text and lines of the dataset file: the configuration of a run of it, by hashes."""
    default = read_yaml(config_folder / "config.yaml", "") | read_yaml(config_folder / "budgets.yaml", "")
    listed = {"datasets": ["plaza"], "compare": ["cvm"], "ladder": {"rows": []}, "run": "mine"}

    def digests(root, text="", **more):
        folder = tmp_path / root
        folder.mkdir(exist_ok=True)
        (folder / "walks.csv").write_text("1,0,0,0\n")
        (tmp_path / "plaza.yaml").write_text(f"""
title: Plaza
reader: delimited
timezone: UTC
recordings: [{{files: walks.csv, day: 2031-03-03, split: {{by: time}}}}]
columns: {{track_id: 0, t: 1, x: 2, y: 3}}
floor_plan: plan.yaml
velocity: differences
citation: made up
terms: free
{text}
""")
        run = load_run({**default, **listed, "data_root": str(folder), **more}, tmp_path)
        layout = Layout("mine")
        plan = Plan(run, layout, load_datasets(run, tmp_path, folder, layout.demo))
        return of.certificate(Layout("mine", str(tmp_path)), plan.configuration, tmp_path)["configuration"]

    return digests


def test_a_dataset_s_settings_count_and_where_its_files_lie_does_not(configured):
    ours = configured("here", "horizon_s: 10")
    assert ours == configured("there", "horizon_s: 10")

    def changed(text, **more):
        theirs = configured("here", text, **more)
        return {name for name in {*ours, *theirs} if ours.get(name) != theirs.get(name)}

    assert changed("horizon_s: 20") == {"datasets/plaza"}
    assert changed("horizon_s: 10\ntuned: {snippets: {k: 9}}") == {"datasets/plaza"}
    assert changed("horizon_s: 10", evaluate_on="validation") == {"datasets/plaza", "evaluate_on"}


def test_results_do_not_depend_on_where_files_lie(tmp_path):
    """Recordings of one file each person, and maps of others: their bytes and names count."""
    made = []
    for root in (tmp_path / "here", tmp_path / "there"):
        root.mkdir()
        files = [str(root / f"{name}.csv") for name in "ab"]
        for number, file in enumerate(files):
            write_text(file, "".join(f"{t},{0.5 * t},{number}\n" for t in range(20)))
        raw = {"file": "a.csv", "member": None, "day": "2031-03-03", "start": "09:00", "days": 1, "people": files}
        dataset = {"reader": "delimited", "file_is": "person", "columns": {"t": 0, "x": 1, "y": 2}, "timezone": "UTC"}
        log, layout = str(root / "log"), Layout("r", str(root))
        done = run_job(
            "clean_recording", input={"raw": files}, wildcards={"dataset": "hall", "recording": "a"}, log={"it": log},
            output={"tracks": layout.tracks("hall", "a"), "account": layout.account("hall", "a")},
            params={"dataset": dataset, "recording": raw, "sources": [], "sums": "sums", "code": "c"},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        theirs = str(root / "map.csv")
        write_text(theirs, MAP)
        done = run_job(
            "import_map", input={"map": [theirs], "tracks": [layout.tracks("hall", "a")]}, log={"it": log},
            output={"map": layout.published_map("hall", "theirs", "cliff")}, wildcards={"dataset": "hall"},
            params={"run": "r", "file": "map.csv", "form": None, "kind": "cliff", "sums": {theirs: "0"},
                    "origin_m": [0, 0], "dataset": {}, "code": "c"},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        made.append(of.outputs(layout))
    assert len(made[0]) == 3
    assert made[0] == made[1]


def test_times_do_not_count(layout):
    before = of.outputs(layout)
    write_json(layout.training("hall", "lstm"), {"epochs": 3, "core_minutes": 9.5, "curve": [{"seconds": 7.0, "n": 2}]})
    write_json(layout.costs("hall"), {"cvm": 2.0})
    write_text(layout.log("clean"), "at night")
    write_text(f"{layout.exhibit('ladder-hall')}.csv", "row,ms per track,ADE\na,0.7,2\n")
    assert of.outputs(layout) == before


def test_measured_claims_do_not_count_and_the_others_do(layout):
    """What the runtime study measures stands among the claims; without it their rows say that it is lacking."""
    rows = {"linear": [("needs the runtime study", "", "not tested")], "ranking": [("a gain", "1.5", "supported")]}

    def outputs(**changes):
        lines = [(CLAIMS[name].text, *row) for name, told in (rows | changes).items() for row in told]
        columns = ["claim", "our test", "measured", "verdict"]
        write_table(pd.DataFrame(lines, columns=columns), layout.exhibit("claims"), "Claims", False)
        return of.outputs(layout)

    before = outputs()
    assert outputs(linear=[("it is 1", "1.02", "not contradicted"), ("it is 1", "1.3", "grows faster")]) == before
    assert outputs(ranking=[("a gain", "1.6", "supported")]) != before


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("results/hall/tracks/monday.parquet", lambda one: write_parquet({"x": [2.0]}, one.tracks("hall", "monday"))),
        ("results/hall/models/lstm.json", lambda one: write_json(one.training("hall", "lstm"), {"epochs": 4})),
        (
            "paper_figures/ladder-hall.csv",
            lambda one: write_text(f"{one.exhibit('ladder-hall')}.csv", "row,ADE\na,3\n"),
        ),
        ("paper_figures/results.md", lambda one: write_text(f"{one.exhibit('results')}.md", "| b |")),
        ("paper_figures/new.md", lambda one: write_text(f"{one.exhibit('new')}.md", "| b |")),
    ],
)
def test_a_changed_result_is_named(certified, name, change):
    assert of.verify(certified, None) == ({}, "since the certificate was written: the same: all 4 outputs")
    change(certified)
    found, told = of.verify(certified, None)
    assert [line.split(":")[0] for line in found["outputs"]] == [name]
    assert told == "since the certificate was written: 1 of 4 outputs have changed"


def test_two_runs_differ_for_a_reason(certified, tmp_path, capsys):
    """In a file that was read, in a package, or for none that can be seen."""
    other = json.loads((tmp_path / "here/results/r/certificate.json").read_text())

    def against(**parts):
        changed = {key: {**other[key], **parts.get(key, {})} for key in (*of.REASONS, "outputs")}
        write_json(tmp_path / "other.json", {**{k: v for k, v in other.items() if k != "modlhmp.seal"}, **changed})
        return of.verify(certified, tmp_path / "other.json")

    assert against()[1].endswith("the same: all 4 outputs")
    wrong = {"paper_figures/results.md": "0" * 64}
    found, told = against(outputs=wrong, inputs={"hall/monday/monday.csv": "cd34"}, environment={"numpy": "0.1"})
    assert found.keys() == {"inputs", "environment", "outputs"}
    assert found["inputs"] == ["hall/monday/monday.csv: ab12 and cd34"]
    assert told.endswith("1 of 4 outputs differ, with other inputs and environment, which may be why")
    assert against(outputs=wrong)[1].endswith("nothing that went in does: please report this")
    assert against(environment={"numpy": "0.1"})[1].endswith("all 4 outputs, with other environment")
    assert against(outputs={"results/hall/maps/stef.parquet": "1" * 64})[0]["outputs"] == [
        "results/hall/maps/stef.parquet: only in the other"
    ]


def test_a_certificate_of_an_earlier_form_lacks_no_reason(certified, tmp_path):
    """It names less of what went in: only what both name is compared, and the project is not blamed."""
    ours = json.loads(Path(certified.certificate).read_text())
    earlier = {key: value for key, value in ours.items() if key not in ("modlhmp.seal", "form")}
    earlier["inputs"], earlier["configuration"] = {}, {"seeds": ours["configuration"]["seeds"], "data_root": "0" * 64}
    write_json(tmp_path / "earlier.json", earlier)
    assert of.verify(certified, tmp_path / "earlier.json")[1].endswith("the same: all 4 outputs")
    write_json(tmp_path / "earlier.json", {**earlier, "outputs": {}})
    found, told = of.verify(certified, tmp_path / "earlier.json")
    assert found.keys() == {"outputs"}
    assert told.endswith("4 of 4 outputs differ; a certificate of an earlier form does not name all that went in")
    write_json(tmp_path / "earlier.json", {**earlier, "outputs": {}, "configuration": {"seeds": "1" * 64}})
    assert (
        "with other configuration, which may be why; a certificate of"
        in of.verify(certified, tmp_path / "earlier.json")[1]
    )


def test_the_command_has_a_status(certified, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path / "here")
    assert of.main(["r"]) == 0
    shutil.copy("results/r/certificate.json", "theirs.json")
    assert of.main(["r", "theirs.json"]) == 0
    assert "theirs.json: the same: all 4 outputs" in capsys.readouterr().out
    (tmp_path / "here/paper_figures/r/results.md").write_text("other")
    assert of.main(["r", "theirs.json"]) == 1
    assert of.main(["s"]) == 1
    assert "results/s/certificate.json: no such file" in capsys.readouterr().err
