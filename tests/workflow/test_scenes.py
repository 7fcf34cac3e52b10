"""TrajNet++'s scenes through the workflow: what is forecast, scored and shown is what the files ask for."""

import json

import numpy as np
import pandas as pd
import pytest
from project import Project

from modlhmp.ids import id_of
from modlhmp.tasks import export_task

DATASET = """
title: Plaza
reader: trajnet
timezone: UTC
clock: unknown
same_person: true
recordings:
  - {files: morning.ndjson, split: train}
  - {files: noon.ndjson, split: test}
time_step_s: 0.4
observed_rows: 9
horizon_s: 4.8
tuned: {cliff: {beta: 0.5, k: 7, exits: true}}
velocity: differences
citation: made up by a test
terms: free
"""
RUN = """
run: plaza
datasets: [plaza]
data_root: recordings
seeds: [0]
compare: [cliff, snippets]
comparisons: [[snippets, cliff]]
studies: {method: cliff, beta: [0.5, 1], sampling_radius_m: [], training: {shares: []}}
uncertainty: {methods: [snippets], samples: 40}
"""
HANDED = """
compare: [snippets, handed]
methods: {handed: {kind: forecasts, folder: handed}}
comparisons: []
ladder: {rows: []}
uncertainty: {methods: [handed]}
"""
TABLES = ("tab_expres", "tab_ttests", "tab_uncertainty", "tab_encounters", "readings-plaza")
FIGURES = ("density", "prediction_example", "parameter-plaza")
STEP, RATE, OBSERVED = 10, 25, 9  # frames between rows, frames per second, rows
AWAY = 20  # rows that some are not seen


def plaza(path, seed, people=60):
    """People who cross a plaza both ways, a row every 10 frames; two of three are primaries of scenes every 5 rows.

    Every sixth is away for 8 s, and so in two pieces. Some scenes are shorter than the horizon, some go on for longer.
    Returns the forecasts that the scenes ask for, {(piece's id, frame of t0): steps of truth}, and the number of rows.
    """
    rng = np.random.default_rng(seed)
    scenes, rows, asked = [], [], {}
    for person in range(people):
        whose, begin, length = f"p{person}", int(rng.integers(0, 600)), int(rng.integers(30, 80))
        away = range(25, 25 + AWAY) if person % 6 == 1 else range(0)
        way, speed, off = (1 if person % 2 else -1), rng.normal(1.2, 0.1), rng.normal(0, 1)
        for row in (row for row in range(length) if row not in away):
            walked = speed * 0.4 * row
            x, y = way * (walked - 8) + rng.normal(0, 0.02), way + 2 * np.sin(walked / 6) + off
            rows.append({"track": {"f": STEP * (begin + row), "p": whose, "x": round(x, 3), "y": round(y, 3)}})
        for first in range(5, length - OBSERVED, 5) if person % 3 else ():
            last = first + (20, 14, 30)[first % 3]
            fields = {"id": len(scenes), "p": whose, "s": STEP * (begin + first), "e": STEP * (begin + last)}
            scenes.append({"scene": {**fields, "fps": 2.5, "tag": [1, []]}})
            until, t0 = min(last, 24 if away and first < 25 else length - 1), first + OBSERVED - 1
            if first not in away and until > t0:
                piece = id_of(whose, 2 if away and first > 25 else 1)
                asked[piece, STEP * (begin + t0)] = min(until - t0, 12)
    with open(path, "w", encoding="utf-8") as file:
        file.writelines(json.dumps(line) + "\n" for line in [*scenes, *sorted(rows, key=lambda row: row["track"]["f"])])
    return asked, len(rows)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """(Project in which everything has been made of such recordings, the forecasts asked for, rows of the training)."""
    project = Project(tmp_path_factory.mktemp("plaza"))
    (project.folder / "config/datasets/plaza.yaml").write_text(DATASET)
    (project.folder / "plaza.yaml").write_text(RUN)
    (project.folder / "recordings").mkdir()
    _, training = plaza(project.folder / "recordings/morning.ndjson", 1)
    asked, _ = plaza(project.folder / "recordings/noon.ndjson", 2)
    wanted = [f"paper_figures/plaza/{name}.csv" for name in TABLES + FIGURES]
    project.snakemake("--cores", 2, "--configfile", "plaza.yaml", "--", *wanted)
    return project, asked, training


def of_results(made, name):
    return pd.read_parquet(made[0].folder / f"results/plaza/plaza/{name}.parquet")


def keys(table):
    return list(zip(table["track_id"].tolist(), (RATE * table["t0"]).round().astype(int).tolist(), strict=True))


@pytest.mark.parametrize("method", ["cliff", "snippets"])
def test_every_scene_is_a_forecast_and_nobody_else_is(made, method):
    _, asked, _ = made
    forecasts = of_results(made, f"forecasts/{method}/noon")
    assert keys(forecasts[forecasts["seed"] == 0]) == sorted(asked)
    errors = of_results(made, f"errors/{method}")
    one = errors[(errors["protocol"] == "complete") & (errors["output"] == errors["output"].iloc[0])]
    assert dict(zip(keys(one), one["eligible_steps"].tolist(), strict=True)) == asked
    assert len(set(asked.values())) > 5


def test_errors_are_distances_from_the_rows_of_the_scene(made):
    _, asked, _ = made
    tracks = of_results(made, "tracks/noon")
    forecasts = of_results(made, "forecasts/snippets/noon")
    errors = of_results(made, "errors/snippets")
    errors = errors[errors["protocol"] == "complete"].set_index(["track_id", "t0"])
    by_track = dict(list(tracks.groupby("track_id")))
    for row in forecasts.itertuples():
        track = by_track[row.track_id]
        xy, at = track[["x", "y"]].to_numpy(), int(np.argmin(np.abs(track["t"].to_numpy() - row.t0)))
        steps = asked[row.track_id, round(RATE * row.t0)]
        away = np.hypot(*(np.reshape(row.xy, (-1, 12, 2))[0, :steps] - xy[at + 1 : at + 1 + steps]).T)
        fde, ade = np.asarray(errors.loc[(row.track_id, row.t0), "fde"]), errors.loc[(row.track_id, row.t0), "ade"]
        np.testing.assert_allclose(fde[:steps], away, atol=1e-4)
        assert np.isnan(fde[steps:]).all()
        assert ade[steps - 1] == pytest.approx(away.mean(), abs=1e-4)


def test_everyone_trains_and_the_account_tells_of_scenes(made):
    project, asked, training = made
    assert len(of_results(made, "tracks/morning")) == training
    account = json.loads((project.folder / "results/plaza/plaza/tracks/noon.account.json").read_text())
    assert "scenes" not in account
    assert account["notes"]["scenes"] > account["notes"]["scenes_of_others"] + len(asked) > len(asked)


def test_clusters_are_persons_whose_pieces_are_together(made):
    project, asked, _ = made
    whose = {id_of(f"p{n}", piece): n for n in range(60) for piece in (1, 2)}
    ids = {one for one, _ in asked}
    persons = {whose[one] for one in ids}
    assert len(persons) < len(ids) < len(asked) / 2
    tests = pd.read_csv(project.folder / "paper_figures/plaza/tab_ttests.csv")
    tests = tests[(tests["protocol"] == "complete") & (tests["metric"] == "ADE")]
    first = tests[tests["horizon_s"] == tests["horizon_s"].min()]
    steps = round(first["horizon_s"].iloc[0] / 0.4)
    counted = [one for one, length in asked.items() if length >= steps]
    assert set(first["n"]) == {len(counted)}
    assert set(first["clusters"]) == {len({whose[one] for one, _ in counted})}


def test_tables_and_studies_count_scenes(made):
    project, asked, _ = made
    results = pd.read_csv(project.folder / "paper_figures/plaza/results.csv")
    shown = results[(results["method"] == "snippets") & (results["protocol"] == "complete")].set_index("horizon_s")["n"]
    assert shown.round().tolist() == [sum(length >= step for length in asked.values()) for step in range(1, 13)]
    text = (project.folder / "paper_figures/plaza/tab_expres.md").read_text()
    assert "Plaza: a forecast of each scene of its files, where they have scenes, and n counts these" in text
    read = of_results(made, "readings/cliff")
    assert set(read.loc[read["idle"] == "kept", "eligible"]) == {sum(length == 12 for length in asked.values())}
    measured = of_results(made, "uncertainty/snippets")
    assert keys(measured[measured["seed"] == 0]) == sorted(asked)
    main = of_results(made, "errors/cliff").reset_index(drop=True)
    study = of_results(made, "studies/beta/0.5").reset_index(drop=True)
    pd.testing.assert_frame_equal(study, main[study.columns])


def test_forecasts_from_outside_are_of_the_scenes(made):
    """Our own, exported and handed in as a method of the run, have their own errors."""
    project, asked, _ = made
    recordings, ours = project.folder / "recordings", project.folder / "results/plaza/plaza/forecasts/snippets"
    export_task(project.folder / "config/datasets/plaza.yaml", recordings / "handed", recordings, forecasts=ours)
    (project.folder / "handed.yaml").write_text(HANDED)
    wanted = "results/plaza/plaza/errors/handed.parquet"
    project.snakemake("--cores", 1, "--configfile", "plaza.yaml", "handed.yaml", "--", wanted)
    theirs, ours = (of_results(made, f"errors/{name}").drop(columns="output") for name in ("handed", "snippets"))
    assert sorted(set(keys(theirs))) == sorted(asked)
    pd.testing.assert_frame_equal(theirs, ours[theirs.columns], check_exact=True)


@pytest.mark.parametrize("name", ["prediction_example", "density"])
def test_figures_show_a_scene(made, name):
    """The example person's first one, which does not begin where her track does."""
    project, asked, _ = made
    table = pd.read_csv(project.folder / f"paper_figures/plaza/{name}.csv")
    errors = of_results(made, "errors/cliff")
    whose = int(errors.loc[errors["owner_id"] == table["track_id"].iloc[0], "track_id"].iloc[0])
    track = of_results(made, "tracks/noon").query(f"track_id == {whose}")
    t0 = min(frame for one, frame in asked if one == whose) / RATE
    observed = table[table["what"] == "observed"].drop_duplicates("step_s")
    assert observed["step_s"].tolist() == pytest.approx([-0.4 * n for n in range(8, -1, -1)])
    rows = track[(track["t"] > t0 - 3.3) & (track["t"] < t0 + 0.1)]
    np.testing.assert_allclose(observed[["x_m", "y_m"]], rows[["x", "y"]], atol=1e-6)


def test_recordings_with_and_without_scenes_are_not_scored_together(made):
    """One of the test files has no scene: its tracks would be counted once each among the other's scenes."""
    project, _, _ = made
    file = project.folder / "recordings/evening.ndjson"
    plaza(file, 3)
    file.write_text("".join(one for one in file.read_text().splitlines(keepends=True) if '"scene"' not in one))
    evening = "  - {files: evening.ndjson, split: test}\nframe_rate: 25\ntime_step_s"
    dataset = DATASET.replace("time_step_s", evening, 1)
    (project.folder / "config/datasets/mixed.yaml").write_text(dataset)
    (project.folder / "mixed.yaml").write_text(RUN.replace("plaza", "mixed"))
    checks, wanted = (f"results/mixed/mixed/{name}" for name in ("tracks/checks.json", "errors/cliff.parquet"))
    told = project.snakemake("--cores", 1, "--configfile", "mixed.yaml", "--", checks, fails=True)
    assert "test recording noon has scenes and evening has none" in told
    assert "set `forecast_every_s`" in told
    with open(project.folder / "config/datasets/mixed.yaml", "a", encoding="utf-8") as described:
        described.write("forecast_every_s: 2\n")
    project.snakemake("--cores", 1, "--configfile", "mixed.yaml", "--", checks, wanted)
    errors = pd.read_parquet(project.folder / wanted)
    assert set(errors["recording"]) == {"noon", "evening"}
