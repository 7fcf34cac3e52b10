"""The whole workflow on the tiny demo."""

import json
import re
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from project import ROOT, Project, planned

import modlhmp
from modlhmp.exchange.forms import find_form
from modlhmp.forecasting.files import STORED, read_forecasts
from modlhmp.storage import column, read_metadata
from modlhmp.study.exhibits import style
from modlhmp.study.summary import COLUMNS, OUTPUTS

TINY = ("--configfile", "config/tiny.yaml")
# What config/paper.yaml makes as well, and what it leaves out.
PAPER_TABLES = (
    *("tab_scenarios", "tab_expres", "tab_ttests", "tab_uncertainty", "tab_encounters", "claims", "tab_models"),
    *("readings-atc", "readings-edin"),
)
PAPER_FIGURES = (
    *("rank", "prediction_example", "rank-metrics", "coverage", "calibration", "density", "learning-curves"),
    *(
        name.format(label)
        for label in ("atc", "edin")
        for name in (
            "{}_final",
            "cliff-{}-time",
            "stef-{}-time",
            "cliff-{}-time-one-location",
            "{}_mod",
            "parameter-{}",
        )
    ),
)
TABLES = (*PAPER_TABLES, "ladder-atc", "ladder-edin", "tab_occupied", "tab_likelihood", "tab_likelihood_given")
FIGURES = (
    *(*PAPER_FIGURES, "ladder", "memory-maps", "prequential", "training-share"),
    *("occupied", "occupied-atc-film", "occupied-edin-film", "likelihood"),
)


def exhibits(tables, figures):
    """Files of these, and the long table of results."""
    return {
        *(f"{table}.{kind}" for table in tables for kind in ("csv", "md", "tex", "html")),
        *(f"{figure}.{kind}" for figure in figures for kind in ("csv", "pdf", "png")),
        "results.csv",
        "explorer.html",
        "report.html",
    }


EXHIBITS = exhibits(TABLES, FIGURES)


def test_every_exhibit_is_there(tiny_run):
    """The set of files is exactly the promised one, none empty."""
    files = list((tiny_run.folder / "paper_figures/tiny").iterdir())
    assert {file.name for file in files} == EXHIBITS
    assert all(file.stat().st_size > 100 for file in files)


def test_exhibits_say_demo(tiny_run):
    """Nobody can take the demo's tables for the paper's."""
    for table in TABLES:
        for kind in ("md", "html", "tex"):
            assert "Demo data" in (tiny_run.folder / f"paper_figures/tiny/{table}.{kind}").read_text()


def test_figures_have_their_printed_width(tiny_run):
    """A column's or a page's, in both forms; no PDF of a megabyte."""
    for figure in FIGURES:
        stem = tiny_run.folder / f"paper_figures/tiny/{figure}"
        width = Image.open(stem.with_suffix(".png")).size[0] / 300 * 25.4
        assert min(abs(width - style.COLUMN_MM), abs(width - style.PAGE_MM)) < 0.5, figure
        pdf = stem.with_suffix(".pdf").read_bytes()
        (box,) = set(re.findall(rb"/MediaBox \[ 0 0 ([0-9.]+) ", pdf))
        assert float(box) / 72 * 25.4 == pytest.approx(width, abs=0.5), figure
        assert len(pdf) < 1e6, figure


def test_walls_stand_beside_the_truth_s(tiny_run):
    """The hall has a plan, and nobody in it walks into a wall; the forum has none."""
    results = pd.read_csv(tiny_run.folder / "paper_figures/tiny/results.csv")
    hall, forum = (results[results["dataset"] == name] for name in ("demo_hall", "demo_forum"))
    assert (hall.loc[hall["n"] > 0, "truth_infeasible"] == 0).all()
    cvm = hall[(hall["method"] == "cvm") & (hall["horizon_s"] == 60) & (hall["protocol"] == "complete")]
    assert (cvm["infeasible"] > 0.3).all()
    assert forum[["infeasible", "truth_infeasible"]].isna().all(axis=None)


def test_the_study_s_default_is_the_table_s(tiny_run):
    """β = 1 and r_s = 1 m of the studies are the run's own TC-CLiFF, to the last digit written."""
    results = pd.read_csv(tiny_run.folder / "paper_figures/tiny/results.csv")
    main = results[(results["method"] == "tc_cliff") & (results["output"] == "ranked")]
    for label, dataset in (("atc", "demo_hall"), ("edin", "demo_forum")):
        study = pd.read_csv(tiny_run.folder / f"paper_figures/tiny/parameter-{label}.csv")
        for _, row in study[study["value"] == 1].iterrows():
            same = main[(main["dataset"] == dataset) & (main["protocol"] == row["protocol"])]
            same = same[same["horizon_s"] == row["horizon_s"]].iloc[0]
            np.testing.assert_equal([row["ade_m"], row["n"]], [same["ade_m"], same["n"]])


def test_distributions_are_those_of_the_run_s_forecasts(tiny_run):
    """Forecast again with more futures: the output's error is the results', the first futures are the stored ones."""
    exhibits = tiny_run.folder / "paper_figures/tiny"
    results = pd.read_csv(exhibits / "results.csv")
    results = results[results["output"].isin(["ranked", "median"]) & (results["protocol"] == "complete")]
    table = pd.read_csv(exhibits / "tab_uncertainty.csv", na_values="–")
    methods = {"TC-CLiFF": "tc_cliff", "Episodes": "episodes", "Snippets": "snippets"}
    others = table[table["horizon [s]"].isna()]
    assert set(others["method"]) >= {"CVM", "LSTM", "MID", "Hybrid"} and others["energy score [m]"].isna().all()
    table = table.drop(others.index)
    assert table["method"].tolist() == [*methods] * 8
    assert table["horizon [s]"].tolist() == [horizon for horizon in (5, 10, 20, 30, 60, 5, 10, 20) for _ in methods]
    names = {"Demo hall": "demo_hall", "Demo forum": "demo_forum"}
    for _, row in table.iterrows():
        same = results[(results["dataset"] == names[row["dataset"]]) & (results["method"] == methods[row["method"]])]
        same = same[same["horizon_s"] == row["horizon [s]"]].iloc[0]
        assert (row["real error [m]"], row["n"]) == (pytest.approx(same["fde_m"], abs=6e-4), same["n"])
    shown = pd.read_csv(exhibits / "density.csv")
    first = shown[(shown["what"] == "sample") & (shown["rank"] <= STORED)]
    for (dataset, recording, track), samples in first.groupby(["dataset", "recording", "track_id"]):
        file = tiny_run.folder / f"results/tiny/{dataset}/forecasts/snippets/{recording}.parquet"
        _, ids, forecast = next(iter(read_forecasts(file)))
        future, step = samples["rank"].to_numpy(int), samples["step_s"].to_numpy(int) - 1  # the median stands first
        stored = forecast.xy[np.flatnonzero(ids == track)[0], future, step]
        np.testing.assert_allclose(samples[["x_m", "y_m"]], stored, rtol=1e-5)


def test_the_ladder_s_errors_are_the_table_s(tiny_run):
    """Rung by rung, of both protocols, to the digits written; a rung may be a method that is not compared."""
    exhibits = tiny_run.folder / "paper_figures/tiny"
    results, ladder = pd.read_csv(exhibits / "results.csv"), pd.read_csv(exhibits / "ladder.csv")
    ranks = {output: place for place, output in enumerate(OUTPUTS)}
    main = results.loc[
        results.groupby(["dataset", "method"])["output"].transform(lambda o: min(o, key=ranks.get)) == results["output"]
    ]
    both = ladder.merge(main, on=["dataset", "protocol", "horizon_s", "method"], suffixes=("", "_table"))
    assert set(ladder["method"]) - set(both["method"]) == {"neural_map"}
    np.testing.assert_allclose(both["ade_m"], both["ade_m_table"], rtol=1e-4)
    np.testing.assert_allclose(both["fde_m"], both["fde_m_table"], rtol=1e-4)
    np.testing.assert_array_equal(both["eligible"], both["eligible_table"])
    known = ladder[ladder["n"] > 1]
    assert ((known["ade_low_m"] <= known["ade_m"]) & (known["ade_m"] <= known["ade_high_m"])).all()


def test_all_of_the_training_tracks_give_the_table_s_errors(tiny_run):
    """The study's maps from every track are the run's own."""
    exhibits = tiny_run.folder / "paper_figures/tiny"
    study, results = pd.read_csv(exhibits / "training-share.csv"), pd.read_csv(exhibits / "results.csv")
    keys = ["dataset", "method", "output", "protocol", "horizon_s"]
    both = study[study["share"] == 1].merge(results, on=keys, suffixes=("", "_table"))
    assert len(both) == (study["share"] == 1).sum() == 3 * (60 + 20)
    np.testing.assert_allclose(both["ade_m"], both["ade_m_table"], rtol=1e-5)
    np.testing.assert_array_equal(both["n"], both["n_table"])


def test_every_claim_has_a_verdict(tiny_run):
    """Those of learned methods too, since all five are compared."""
    claims = pd.read_csv(tiny_run.folder / "paper_figures/tiny/claims.csv")
    assert claims["verdict"].notna().all()
    assert set(claims["dataset"]) == {"Demo hall", "Demo forum"}
    assert not claims["our test"].str.contains("needs learned methods").any()


def test_results_have_the_promised_columns_and_hold_together(tiny_run):
    """Both protocols of every method at every horizon; more tracks are scored the shorter the horizon."""
    results = pd.read_csv(tiny_run.folder / "paper_figures/tiny/results.csv")
    assert tuple(results.columns) == (*COLUMNS, "version")
    maps, networks = {"tc_cliff", "cliff", "stef"}, {"trajectronpp", "mid", "tutr", "social_lstm", "lstm"}
    assert set(results["method"]) == {
        *maps,
        *networks,
        "tc_clean",
        "cvm",
        "cvm_clean",
        "episodes",
        "episodes_medoid",
        "snippets",
        "hybrid",
    }
    assert set(results.loc[results["method"] == "mid", "output"]) == {"mean", "mean_path"}
    steps = results.groupby(["dataset", "method", "output", "protocol"])["horizon_s"].agg(["min", "max", "size"])
    assert (steps["min"] == 1).all()
    assert (steps["max"] == steps["size"]).all()
    complete = results[results["protocol"] == "complete"]
    assert (complete["n"] == complete["eligible"]).all()
    assert (results["n"] <= results["eligible"]).all()
    assert (results[results["output"] == "single"]["seeds"] == 1).all()
    assert (results[results["output"] == "ranked"]["seeds"] == 2).all()
    seeds = results[results["output"] == "median"].groupby("method")["seeds"].unique()
    assert {method: list(number) for method, number in seeds.items()} == {"episodes": [1], "snippets": [2]}
    for _, curve in results.groupby(["dataset", "method", "output", "protocol"]):
        assert curve.sort_values("horizon_s")["eligible"].is_monotonic_decreasing


def test_accounts_add_up(tiny_run):
    """Every row and track read is kept or dropped by name."""
    accounts = list((tiny_run.folder / "results/tiny").glob("*/tracks/*.account.json"))
    assert len(accounts) == 8
    for file in accounts:
        account = json.loads(file.read_text())
        for kind in ("rows", "tracks"):
            assert account[kind]["read"] == account[kind]["kept"] + sum(account[kind]["dropped"].values())


def test_every_parquet_file_carries_its_provenance(tiny_run):
    """Dataset, settings, code and the raw files' hashes travel with each result."""
    files = list((tiny_run.folder / "results/tiny").rglob("*.parquet"))
    assert len(files) > 50
    for file in files:
        origin = read_metadata(file)
        assert {"dataset", "settings", "code", "sources"} <= set(origin), file
        assert origin["sources"], file
        assert all(len(digest) == 64 for digest in origin["sources"].values())


SAYS = {
    ".parquet": lambda file: read_metadata(file)["modlhmp.version"] == modlhmp.__version__,
    ".json": lambda file: json.loads(file.read_text())["modlhmp.version"] == modlhmp.__version__,
    ".safetensors": lambda file: f'modlhmp.version\\": \\"{modlhmp.__version__}'.encode() in file.read_bytes()[:4000],
    ".png": lambda file: Image.open(file).text["Software"] == f"modlhmp {modlhmp.__version__}",
    ".pdf": lambda file: f"/Creator (modlhmp {modlhmp.__version__})".encode() in file.read_bytes(),
    ".html": lambda file: f'<meta name="generator" content="modlhmp {modlhmp.__version__}">' in file.read_text(),
    ".md": lambda file: f"<!-- modlhmp {modlhmp.__version__} -->" in file.read_text(),
    ".tex": lambda file: f" modlhmp {modlhmp.__version__}\n" in file.read_text(),
    # A comment would break whoever reads a table, so a CSV has its version in the files of the same name.
    ".csv": lambda file: file.with_suffix(".pdf").exists() or file.with_suffix(".html").exists() or (
        set(pd.read_csv(file)["version"]) == {modlhmp.__version__}
    ),
}  # fmt: skip


def test_every_output_says_which_version_wrote_it(tiny_run):
    """All but what is no result: logs, times of jobs and checkpoints."""
    folders = (tiny_run.folder / "results/tiny", tiny_run.folder / "paper_figures/tiny")
    files = [file for folder in folders for file in folder.rglob("*") if file.is_file()]
    files = [file for file in files if file.suffix not in {".log", ".tsv", ".checkpoint"} and file.name[0] != "."]
    assert {file.suffix for file in files} == set(SAYS)
    assert [str(file) for file in files if not SAYS[file.suffix](file)] == []


def test_a_second_run_does_nothing(tiny_run):
    """All is up to date."""
    assert "Nothing to be done" in tiny_run.snakemake("--cores", 2, *TINY)


def test_one_core_gives_the_same_bits(tiny_run, project):
    """Results do not depend on cores or on the order of jobs: maps, of hours too, all kinds of forecasters, scores."""
    shutil.copytree(tiny_run.folder / "resources", project.folder / "resources")
    wanted = [f"errors/{method}.parquet" for method in ("tc_cliff", "snippets", "lstm")]
    wanted += ["maps/exits.parquet", "uncertainty/episodes.parquet"]
    files = [f"results/tiny/demo_hall/{name}" for name in wanted]
    project.snakemake("--cores", 1, *TINY, "--", *files)
    made = [file.relative_to(project.folder) for file in (project.folder / "results/tiny").rglob("*.parquet")]
    assert {str(file) for file in made} >= set(files)
    for part in (
        "tracks/",
        "maps/tc_cliff/",
        "maps/snippets",
        "maps/episodes",
        "forecasts/lstm/",
        "forecasts/snippets/",
    ):
        assert any(f"demo_hall/{part}" in str(file) for file in made), part
    for file in made:
        assert (project.folder / file).read_bytes() == (tiny_run.folder / file).read_bytes(), file


def test_report_holds_the_exhibits(tiny_run):
    """`--report` works offline: a front page, every exhibit with its caption, category and labels."""
    tiny_run.snakemake("--report", "report.html", *TINY)
    report = (tiny_run.folder / "report.html").read_text()
    shown = [f"paper_figures/tiny/{name}" for name in sorted(EXHIBITS) if name.endswith((".png", ".html"))]
    for path in shown:
        assert f"app.showResultInfo('{path}')" in report, f"the front page does not lead to {path}"
        entry = report[report.index(f'"{path}": {{') :][:6000]
        assert re.search(r'"caption": "<p>\w', entry), f"{path} has no caption"
        assert re.search(r'"labels": {"exhibit": "\w.*?", "dataset": "\w', entry), f"{path} lacks a label"
    categories = json.loads(re.search(r"var categories = ({.*?});?\n", report)[1])
    sorted_in = {path: name for name, group in categories.items() for paths in group.values() for path in paths}
    assert sorted_in.keys() == set(shown)
    assert set(sorted_in.values()) == {"Tables", "Figures", "Maps", "Forecasts", "Studies", "Explorer", "Report"}
    for text in ("Two protocols stand", "were made up by the project", "Which claims hold"):
        assert text in report
    assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=.https?:", report)


def test_the_run_reads_as_a_paper(tiny_run):
    """Every exhibit once, and the graph that Snakemake itself has of these jobs, exhibits of one form as one."""
    page = (tiny_run.folder / "paper_figures/tiny/report.html").read_text()
    shown = Counter(re.findall(r'data-exhibit="(?:paper_figures/tiny/)?([^"]+)"', page))
    assert shown == Counter({name.partition(".")[0] for name in EXHIBITS} - {"results", "report"})
    assert not re.findall(r"https?://", page.partition("</style>")[2].replace("http://www.w3.org", ""))
    many = {"table": "tables", "figure": "figures", "page": "pages"}
    jobs = tiny_run.jobs(*TINY, "--", "paper_figures/tiny/report.html")
    rules = Counter(many.get(job.rule.partition("_")[0], job.rule) for job in jobs if job.rule != "write_report")
    drawn = dict(re.findall(r"<text [^>]*>(\w+)(?: ×(\d+))?</text>", page))
    assert {rule: int(number or 1) for rule, number in drawn.items()} == rules


def edited(tiny_run, tmp_path, module):
    """Jobs of each rule that a dry run plans after an edit of a module."""
    shutil.copytree(ROOT / "src", tmp_path / "src", ignore=shutil.ignore_patterns("__pycache__"))
    with (tmp_path / "src/modlhmp" / module).open("a") as file:
        file.write("\n# an edit\n")
    return planned(tiny_run.snakemake("-n", *TINY, PYTHONPATH=str(tmp_path / "src")))


def test_an_edit_of_the_tests_code_compares_again(tiny_run, tmp_path):
    """Nothing else; `test_reruns` asks for the others without a dry run each."""
    rules = {"compare_methods": 2, "climb_ladder": 2, "table_ttests": 1, "table_claims": 1, "all": 1}
    rules |= {"table_ladder": 2, "figure_ladder": 1, "write_report": 1}
    rules |= {"measure_likelihood": 2, "table_likelihood": 1, "figure_likelihood": 1}
    rules |= {"measure_given": 2, "table_likelihood_given": 1, "figure_prequential": 1}
    rules |= {"figure_calibration": 1, "table_uncertainty": 1}  # `study.reliability` has the intervals
    assert edited(tiny_run, tmp_path, "scoring/ttests.py") == rules


def test_an_edit_of_a_forecaster_forecasts_its_kind_again(tiny_run, tmp_path):
    """Of the chain of snippets: two datasets' snippets, their scores, and what stands on them."""
    rules = edited(tiny_run, tmp_path, "forecasting/chain.py")
    of_snippets = {"forecast_method", "score_method", "measure_uncertainty", "measure_costs"}
    of_snippets |= {"study_training", "study_occupied", "measure_given"}
    assert {rule: rules.get(rule) for rule in of_snippets} == dict.fromkeys(of_snippets, 2)
    known = {"compare_methods", "climb_ladder", "summarise_results", "measure_encounters", "write_report", "all"}
    assert not [
        rule for rule in rules.keys() - {*of_snippets, *known} if not rule.startswith(("table_", "figure_", "page_"))
    ]


LOST = {"matlab": {"count"}, "online": set(), "nemo": {"p", "count"}, "xml": {"count"}, "stef_csv": set()}


def test_every_map_goes_out_in_every_form_and_comes_back(tiny_run, tmp_path):
    """To the digits of the form: float32 numbers are the same to the bit, but for headings, which go another way."""
    maps = sorted((tiny_run.folder / "results/tiny").glob("*/maps/*"))
    maps = [file for file in maps if file.name in {"cliff.parquet", "tc_cliff", "stef"}]
    assert len(maps) == 6
    for number, file in enumerate(maps):
        ours = modlhmp.load_map(file)
        for form in LOST if ours.kind != "stef" else ("stef_csv",):
            if ours.kind not in find_form(form).kinds:
                continue
            out = tmp_path / f"{number}-{form}"
            ours.save(out, form=form)
            theirs = modlhmp.load_map(out, form=form, site=ours.site)
            assert (theirs.kind, theirs.hours.keys()) == (ours.kind, ours.hours.keys())
            tables = [(ours.hours[hour], theirs.hours[hour]) for hour in ours.hours]
            for one, other in tables or [(ours.whole, theirs.whole)]:
                for name in one.column_names:
                    a, b = (column(table, name) for table in (one, other))
                    if name == "mean_heading":
                        np.testing.assert_allclose(np.angle(np.exp(1j * (a.astype(float) - b))), 0, atol=2e-7)
                    elif name not in LOST[form]:
                        exact = a.dtype != np.float64 and not (form == "nemo" and name.startswith("cov"))
                        np.testing.assert_allclose(a, b, rtol=0 if exact else 1e-8, atol=0 if exact else 1e-8)


def test_a_changed_option_reruns_what_reads_it(tiny_run):
    """Forecasts of sampled maps read beta; maps, the others' forecasts and networks do not."""
    (tiny_run.folder / "beta.yaml").write_text("rollout: {beta: 2.0}\n")
    rules = planned(tiny_run.snakemake("-n", "--configfile", "config/tiny.yaml", "beta.yaml"))
    assert rules["forecast_method"] == 2 * len(("cliff", "tc_cliff", "stef", "tc_clean"))
    assert not [rule for rule in rules if rule.startswith(("build_", "train_", "clean_", "forecast_with"))]


@pytest.mark.full
def test_the_paper_s_configuration_runs_on_recordings_laid_out_like_it(tmp_path):
    """config/paper.yaml, all 55 recordings, made up by the demo under the paper's names and days."""
    from modlhmp.study.demo import write_recording  # noqa: PLC0415 - only here

    project = Project(tmp_path / "project")
    for name, site in (("atc", "hall"), ("edinburgh", "forum")):
        import yaml  # noqa: PLC0415

        dataset = yaml.safe_load((ROOT / f"config/datasets/{name}.yaml").read_text())
        for recording in dataset["recordings"]:
            path = tmp_path / "data" / recording["files"]
            path.parent.mkdir(parents=True, exist_ok=True)
            scale = 0.2 if recording["split"] == "train" else 0.05  # a network wants 20 tracks
            write_recording(path, site, str(recording["day"]), seed=1, scale=scale)
    (project.folder / "one_seed.yaml").write_text("seeds: [0]\nlearned: {budget: demo}\n")
    arguments = ("--cores", 2, "--configfile", "config/paper.yaml", "one_seed.yaml")
    project.snakemake(*arguments, MODLHMP_DATA=str(tmp_path / "data"))
    paper = exhibits(PAPER_TABLES, PAPER_FIGURES)
    assert {file.name for file in Path(project.folder / "paper_figures/paper").iterdir()} == paper
