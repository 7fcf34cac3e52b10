"""Many sites: what a list of sites may say, and one table across them whose tests are by site."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy import stats

from modlhmp.datasets import load_dataset
from modlhmp.storage import DataError, write_parquet
from modlhmp.study.configuration import load_datasets, load_run
from modlhmp.study.exhibits.sites_table import write_sites
from modlhmp.study.layout import Layout
from modlhmp.study.sites import KEYS, gather, site_rows
from modlhmp.study.sweep import load_sweep
from modlhmp.yaml_file import read_yaml

DATASET = """
title: {0}
reader: delimited
timezone: UTC
recordings: [{{files: {0}.csv, day: 2031-03-03, split: {{by: time}}}}]
columns: {{track_id: 0, t: 1, x: 2, y: 3}}
horizon_s: 10
velocity: differences
citation: made up by a test
terms: free
"""


@pytest.fixture
def listed(tmp_path, monkeypatch, config_folder):
    """Function that loads a list of sites, in a folder with the datasets north and south."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("MODLHMP_DATA", raising=False)
    for name in ("north", "south"):
        (tmp_path / f"{name}.yaml").write_text(DATASET.format(name))
        (tmp_path / f"{name}.csv").write_text(f"1,0,0,{len(name)}\n{name}\n")
    configs = [config_folder / "budgets.yaml", config_folder / "config.yaml"]
    shared = {"data_root": ".", "compare": ["cvm", "cliff"], "ladder": {"rows": []}}

    def load(sites, **more):
        settings = {"sweep": "two", "reference": "cvm", "shared": shared, "sites": sites, **more}
        return load_sweep(settings, configs, [tmp_path])

    return load


def test_a_site_is_a_run_of_its_dataset_with_every_method_against_the_reference(listed):
    sweep = listed({"north": None, "s-2": {"datasets": ["south"], "seeds": [7]}})
    sweep.check()
    site = sweep.site("s-2")
    assert (site.plan.run.run, site.plan.run.seeds, site.dataset.name) == ("two-s-2", (7,), "south")
    assert ["cliff", "cvm"] in site.plan.tested_pairs
    assert sweep.site("north").plan.run.seeds == (0, 1, 2)  # of config.yaml
    assert set(sweep.files("s-2")) == {"south.csv", str(sweep.folders[0] / "south.yaml")}


def test_the_reference_may_stand_on_either_side_of_a_configured_pair(listed):
    """Also with the shipped configuration, in which `cliff` stands first and `tc_cliff`, too."""
    shared = {"data_root": ".", "ladder": {"rows": []}}
    for reference, *others in (("cliff", "cvm", "tc_cliff"), ("tc_cliff", "cliff"), ("cvm", "cliff")):
        sweep = listed({"north": None}, reference=reference, shared={**shared, "compare": [reference, *others]})
        sweep.check()
        pairs = [pair for pair in sweep.site("north").plan.tested_pairs if reference in pair]
        assert sorted(pairs) == [[other, reference] for other in others]


def test_a_site_s_files_are_all_that_its_run_reads_and_does_not_make(listed, tmp_path):
    """So that a change of any runs it again."""
    dataset = tmp_path / "north.yaml"
    dataset.write_text(dataset.read_text() + "floor_plan: plan.yaml\n")
    (tmp_path / "plan.yaml").write_text(
        "image: plan.pgm\nresolution: 1.0\norigin: [0, 0, 0]\noccupied_thresh: 0.6\nfree_thresh: 0.3\n"
    )
    others = ["plan.yaml", "plan.pgm", "theirs.parquet", "given/forecasts.csv", "given/forecasts.json"]
    (tmp_path / "given").mkdir()
    for name in others[1:]:
        (tmp_path / name).touch()
    write_parquet({"x": np.zeros(1)}, tmp_path / "theirs.parquet", kind="cliff", site={})
    (tmp_path / "given/forecasts.json").write_text('{"task": "one"}')
    methods = {"theirs": {"inherits": "cliff", "file": "theirs.parquet"}}
    methods["handed"] = {"kind": "forecasts", "folder": "given"}
    sweep = listed({"north": {"compare": ["cvm", *methods], "methods": methods}})
    assert {Path(file).name for file in sweep.files("north")} == {
        *(Path(name).name for name in others), "north.csv", "north.yaml",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("sites", "more", "said"),
    [
        ({"north": {}, "North": {}}, {}, "north and North are one name"),
        ({"no rth": {}}, {}, "'no rth': a name of letters"),
        ({}, {}, "sites"),
        ({"north": {}}, {"sweep": "a-b"}, "'a-b': a name of letters, digits and _ only"),
        ({"north": {}}, {"refrence": "cvm"}, "did you mean 'reference'?"),
        ({"north": {"run": "x"}}, {}, "leave the key out"),
    ],
)
def test_a_wrong_list_is_refused_with_an_example(listed, sites, more, said):
    with pytest.raises(DataError) as error:
        listed(sites, **more)
    assert said in str(error.value)


def test_nothing_at_all_is_answered_with_an_example():
    with pytest.raises(DataError, match=r"sites\.yaml:\n\n    sweep: plazas"):
        load_sweep({}, [], [])


@pytest.mark.parametrize(
    ("sites", "more", "said"),
    [
        ({"nowhere": {}}, {}, "site nowhere: configuration, datasets: no dataset named 'nowhere'"),
        ({"north": {"seed": [1]}}, {}, "unknown key 'seed', did you mean 'seeds'?"),
        ({"north": {"data_root": "elsewhere"}}, {}, "elsewhere/north.csv: no such file; put it there, or correct"),
        ({"north": {}}, {"reference": "stef"}, "stef is not compared there, but cvm, cliff"),
        ({"b": {"datasets": ["north", "south"]}}, {}, "a site is one dataset, and this is 2"),
        ({"north": {}, "again": {"datasets": ["north"]}}, {}, "sites north and again: both test"),
        ({"north": {"test_days": ["2031-05-01", "2031-05-02"]}}, {}, "no test recording from 2031-05-01"),
    ],
)
def test_every_wrong_site_is_named_before_anything_runs(listed, sites, more, said):
    sweep = listed({"south": {}, **sites}, **more)
    with pytest.raises(DataError) as error:
        sweep.check()
    assert said in str(error.value)


@pytest.mark.parametrize("root", [".", "there", "linked", "hard"])
def test_a_recording_that_two_sites_test_is_found_by_whatever_name(listed, tmp_path, root):
    """By its whole path, or through a link to its folder or to itself; the demo's settings are no matter."""
    (tmp_path / "linked").symlink_to(tmp_path)
    (tmp_path / "hard").mkdir()
    os.link(tmp_path / "north.csv", tmp_path / "hard/north.csv")
    again = {"datasets": ["north"], "data_root": str(tmp_path) if root == "there" else root, "demo": {"seed": 7}}
    with pytest.raises(DataError, match=r"sites north and again: both test .*north\.csv"):
        listed({"north": {}, "south": {}, "again": again}).check()


def test_a_run_of_the_same_name_is_not_overwritten(listed, tmp_path):
    (tmp_path / "results/two-north").mkdir(parents=True)
    sweep = listed({"north": {}})
    with pytest.raises(DataError, match="results/two-north is there already and not of this sweep"):
        sweep.check()
    (tmp_path / "results/sweeps/two").mkdir(parents=True)
    (tmp_path / "results/sweeps/two/north.yaml").touch()
    sweep.check()


# --- the table across sites ---------------------------------------------------------------------------------


def of_site(name, errors, horizons=(5.0,), clusters=4, unknown=0, n=10):
    """What a site adds, of errors {method: ADE}; FDE is twice as much."""
    scores, tests = [], []
    for protocol in ("paper", "complete"):
        for horizon in horizons:
            for method, ade in errors.items():
                scores.append((method, "single", protocol, horizon, ade, 2 * ade, n, 12))
                for metric, factor in (("ade", 1), ("fde", 2)):
                    less = factor * (ade - errors["cvm"])
                    interval = (less - 1, less + 1) if clusters > 1 else (np.nan, np.nan)
                    tests.append((protocol, horizon, metric, method, "cvm", n, clusters, less, *interval, unknown))
    columns = ["method", "output", "protocol", "horizon_s", "ade_m", "fde_m", "n", "eligible"]
    tested = ["protocol", "horizon_s", "metric", "method", "against", "n", "clusters", "mean_difference_m",
              "ci_low_m", "ci_high_m", "n_unknown"]  # fmt: skip
    frames = pd.DataFrame(scores, columns=columns), pd.DataFrame(tests, columns=tested)
    return site_rows(name, *frames, "cvm", horizons)


def line(table, method, protocol="complete", horizon=5.0, metric="ade"):
    wanted = dict(zip(KEYS, (protocol, horizon, metric, method), strict=True))
    return table[np.logical_and.reduce([table[name] == value for name, value in wanted.items()])].iloc[0]


def test_the_unit_of_the_test_is_the_site():
    ours, theirs = np.array([1.0, 1.5, 1.1, 2.0]), np.array([1.4, 1.6, 1.9, 2.1])
    sizes = [10, 1000, 3, 77]  # which do not count
    sites = zip(ours, theirs, sizes, strict=True)
    found = {f"s{n}": of_site(f"s{n}", {"cvm": b, "map": a}, n=size) for n, (a, b, size) in enumerate(sites)}
    table, _ = gather(found, "cvm")
    row, wanted = line(table, "map"), stats.ttest_rel(ours, theirs, alternative="less")
    assert (row.sites, row.sites_paired, row.n) == (4, 4, sum(sizes))
    np.testing.assert_allclose([row.mean_m, row.sd_m], [ours.mean(), ours.std(ddof=1)])
    np.testing.assert_allclose([row.p, row.p_greater], [wanted.pvalue, 1 - wanted.pvalue])
    interval = stats.ttest_rel(ours, theirs).confidence_interval()
    np.testing.assert_allclose([row.ci_low_m, row.ci_high_m], interval)
    np.testing.assert_allclose(row.p_holm, 2 * row.p)  # of two tests of the protocol that have the same p
    assert np.isnan(line(table, "cvm").p)
    assert line(table, "cvm").against == ""


def test_what_a_site_lacks_is_a_dash_with_its_reason(tmp_path):
    found = {
        "whole": of_site("whole", {"cvm": 2.0, "map": 1.0}, (5.0, 10.0), unknown=3),
        "short": of_site("short", {"cvm": 3.0, "map": 1.0}),
        "single": of_site("single", {"cvm": 2.5}, (5.0, 10.0), clusters=1),
        "broken": "its run failed: results/sweeps/x/logs/broken.log",
    }
    table, by_site = gather(found, "cvm")
    row = line(table, "map", horizon=10.0)
    assert (row.sites, row.mean_m, row.sites_unknown) == (1, 1.0, 1)
    assert np.isnan([row.sd_m, row.ci_low_m, row.p]).all()  # of one site there is no test
    assert "short: no horizon of 10 s there (the longest is 5 s)" in row.left_out
    assert "single: not compared there" in row.left_out
    assert "broken: its run failed: results/sweeps/x/logs/broken.log" in row.left_out
    assert len(by_site) == len(table) * len(found)
    assert by_site[by_site["mean_m"].isna()]["why"].ne("").all()
    one = of_site("one", {"cvm": 2.0, "map": 1.0}, clusters=1)
    assert line(one, "map").why == "one person or day only: no interval within the site"
    assert line(gather({"one": one}, "cvm")[0], "map").left_out == ""  # its mean counts all the same
    write_sites(found, "cvm", str(tmp_path), demo=False)
    text = (tmp_path / "sites.md").read_text()
    assert "# 3 of 4 sites" in text
    assert "| broken | its run failed: results/sweeps/x/logs/broken.log |" in text
    assert "| complete | 10 | ADE | map | 1 | 1.000 | 10 / 12 | -1.000 † 1 | – |" in text


def test_a_difference_says_of_how_many_sites_it_is(tmp_path):
    """Two of three sites have tracks that both scored; the third is named with its reason."""
    found = {name: of_site(name, {"cvm": 2.0, "map": ade}) for name, ade in (("a", 1.0), ("b", 1.5))}
    found["c"] = of_site("c", {"cvm": 2.0, "map": np.nan}).assign(mean_m=9.0, why="no track that cvm scored, too")
    table, _ = gather(found, "cvm")
    row = line(table, "map")
    assert (row.sites, row.sites_paired, row.left_out) == (3, 2, "")
    assert row.not_paired == "c: no track that cvm scored, too"
    assert line(table, "cvm").not_paired == ""
    write_sites(found, "cvm", str(tmp_path), demo=False)
    text = (tmp_path / "sites.md").read_text()
    assert text.count("(2 sites)") == 4  # protocols and metrics
    assert "## In the means, not in the differences" in text
    assert "| complete | 5.0 | map | c: no track that cvm scored, too |" in text


def test_no_forecast_scored_is_no_number():
    nothing = of_site("a", {"cvm": np.nan, "map": np.nan}, n=0)
    assert line(nothing, "map").why == "no forecast is scored"
    table, _ = gather({"a": nothing, "b": "not run yet"}, "cvm")
    row = line(table, "map")
    assert row.sites == 0
    assert np.isnan(row.mean_m)


def test_tables_of_no_site_are_empty(tmp_path):
    write_sites({"a": "not run yet"}, "cvm", str(tmp_path), demo=False)
    assert "| a | not run yet |" in (tmp_path / "sites.md").read_text()


# --- days ---------------------------------------------------------------------------------------------------


@pytest.fixture
def archive(tmp_path):
    """92 empty files named as the days of the ATC archive might be."""
    days = pd.date_range("2012-10-24", "2013-11-29", freq="D")
    days = [day for day in days if day.day_of_week in (2, 6)]
    (tmp_path / "atc").mkdir()
    for number, day in enumerate(days[:92]):
        (tmp_path / f"atc/atc-{day:%Y%m%d}.csv").write_text(f"{number}\n")
    return tmp_path


def test_the_archive_s_92_days_are_planned(archive, config_folder):
    config = read_yaml(config_folder / "config.yaml", "") | {
        "budgets": read_yaml(config_folder / "budgets.yaml", "")["budgets"]
    }
    run = load_run(config | read_yaml(config_folder / "archive.yaml", ""), config_folder / "datasets")
    (dataset,) = load_datasets(run, config_folder / "datasets", archive, Layout("archive").demo).values()
    assert [len(dataset.of_split(split)) for split in ("train", "test")] == [1, 91]
    assert dataset.of_split("train")[0].day == "2012-10-24"
    assert len(set(dataset.days("test").values())) == 91
    few = load_run(config | read_yaml(config_folder / "archive.yaml", "") | {"test_days": ["2012-11-01", "2012-11-08"]},
                   config_folder / "datasets")  # fmt: skip
    (dataset,) = load_datasets(few, config_folder / "datasets", archive, Layout("archive").demo).values()
    assert list(dataset.days("test").values()) == ["2012-11-04", "2012-11-07"]
    assert len(dataset.of_split("train")) == 1


@pytest.mark.parametrize(("name", "said"), [("plaza.csv", "names no days"), ("20310303_20310304.csv", "names 2 days"),
                                            ("a-20311399.csv", "'2031-13-99' is not a date")])  # fmt: skip
def test_a_name_without_one_day_is_refused(tmp_path, name, said):
    (tmp_path / name).write_text("1,0,0,0\n")
    text = DATASET.format("plaza").replace("plaza.csv", f'"{name}"').replace("2031-03-03", "in_name")
    (tmp_path / "plaza.yaml").write_text(text)
    with pytest.raises(DataError, match=said):
        load_dataset(tmp_path / "plaza.yaml", tmp_path)


@pytest.mark.parametrize("name", ["2031-03-04.csv", "plaza_20310304_morning.csv", "x.2031.03.04.csv"])
def test_the_day_in_a_name_is_taken(tmp_path, name):
    (tmp_path / name).write_text("1,0,0,0\n")
    text = DATASET.format("plaza").replace("plaza.csv", f'"{name}"').replace("2031-03-03", "in_name")
    (tmp_path / "plaza.yaml").write_text(text)
    assert {one.day for one in load_dataset(tmp_path / "plaza.yaml", tmp_path).recordings} == {"2031-03-04"}


def test_days_may_be_written_as_yaml_writes_them(config_folder):
    """Snakemake reads dates of a configuration as dates."""
    config = read_yaml(config_folder / "config.yaml", "") | {
        "budgets": read_yaml(config_folder / "budgets.yaml", "")["budgets"]
    }
    days = yaml.safe_load("test_days: [2012-11-01, 2012-11-08]")
    assert load_run(config | days, config_folder / "datasets").test_days == ("2012-11-01", "2012-11-08")
