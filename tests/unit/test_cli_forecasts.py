"""The verbs that forecast, score and export a task, as a user calls them."""

import io
import json
import re
from datetime import datetime, timezone

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import modlhmp
from modlhmp.cli import app
from modlhmp.contract import crowd
from modlhmp.exchange.tracks import tracks_table
from modlhmp.tracks import write_tracks

CROWD = crowd(people=30, seconds=20)
DAYS = [datetime.fromtimestamp(CROWD.t[0] + shift, timezone.utc).date() for shift in (0, 86400)]


def said(*arguments, stdin=None):
    """Everything a command wrote to its output."""
    done = CliRunner().invoke(app, [str(one) for one in arguments], input=stdin)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done.stdout


def table(*arguments, stdin=None):
    return pd.read_csv(io.StringIO(said(*arguments, stdin=stdin)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A map, and tracks to forecast in a table of text ids and as the workflow keeps them."""
    made = tmp_path_factory.mktemp("hall")
    modlhmp.build_map("episodes", CROWD, modlhmp.Site(horizon_s=8)).save(made / "hall.parquet")
    of = tracks_table(CROWD).to_pandas().drop(columns=["speed", "heading"])
    of.assign(track_id="P" + of["track_id"].astype(str)).to_csv(made / "walks.csv", index=False)
    write_tracks(CROWD, made / "walks.parquet")
    return made


# --- forecast -------------------------------------------------------------------------------------------------------


def test_a_forecast_is_the_library_s(folder):
    """Whose, from when, by how many samples, where: as `modlhmp.forecast` has them."""
    at = float(CROWD.t[CROWD.track_id == 3][9])
    got = table("forecast", "--map", folder / "hall.parquet", "--tracks", folder / "walks.csv", "--at", at)
    seen = CROWD.seen_by(at, rows=4)._replace(speed=np.nan * CROWD.seen_by(at, rows=4).t)
    a_map = modlhmp.load_map(folder / "hall.parquet")
    expected = modlhmp.forecast(a_map, seen).forecast.samples
    assert got.columns.tolist() == ["track_id", "t0", "sample", "step", "t", "x", "y"]
    assert set(got["track_id"]) == {"P3"} and set(got["t0"]) == {at}
    for (sample, step), row in got.set_index(["sample", "step"]).iterrows():
        np.testing.assert_array_equal(row[["x", "y"]].to_numpy(np.float32), expected.xy[0, sample, step - 1])
    assert len(got) == expected.steps_alive.sum()


def test_one_path_for_each_person(folder):
    arguments = ("forecast", "--map", folder / "hall.parquet", "--tracks", folder / "walks.parquet", "--horizon", 5)
    best = table(*arguments, "--best")
    futures = modlhmp.forecast(modlhmp.load_map(folder / "hall.parquet"), CROWD, 5)
    assert best.groupby("track_id").size().le(5).all()
    assert sorted(best["track_id"].unique()) == sorted(futures.track_id[futures.known]) and not futures.known.all()
    told = CliRunner().invoke(app, [str(one) for one in (*arguments, "--best")]).stderr
    assert f"{(~futures.known).sum()} of 30 people have no forecast" in told
    ends = best[best["step"] == 5].set_index("track_id")
    for place, track_id in enumerate(futures.track_id):
        if track_id in ends.index:
            np.testing.assert_allclose(ends.loc[track_id, ["x", "y"]], futures.best[place, -1], rtol=1e-6)


def test_streams_and_files_hold_the_same(folder, tmp_path):
    """From standard input to standard output, and into each form of file; what is told goes beside it."""
    walks = (folder / "walks.csv").read_text()
    arguments = ("forecast", "--map", "cvm", "--horizon", 3)
    streamed = said(*arguments, "--tracks", "-", stdin=walks)
    assert streamed.startswith("track_id,t0,step,t,x,y\n")
    for suffix, tracks in (("csv", "walks.csv"), ("parquet", "walks.csv"), ("ndjson", "walks.parquet")):
        assert said(*arguments, "--tracks", folder / tracks, "--out", tmp_path / f"f.{suffix}") == ""
    assert (tmp_path / "f.csv").read_text() == streamed
    of_parquet = pd.read_parquet(tmp_path / "f.parquet")
    np.testing.assert_array_equal(of_parquet["x"], pd.read_csv(tmp_path / "f.csv")["x"].astype(np.float32))
    lines = [json.loads(line) for line in (tmp_path / "f.ndjson").read_text().splitlines()]
    assert sum("scene" in line for line in lines) == 30 and sum("track" in line for line in lines) == 90


def test_options_of_the_method(folder):
    arguments = ("forecast", "--map", folder / "hall.parquet", "--tracks", folder / "walks.csv", "--horizon", 3)
    few = table(*arguments, "--set", "persons=2")
    assert few["sample"].max() < table(*arguments)["sample"].max()
    modes = table(*arguments[:3], "--tracks", folder / "walks.parquet", *arguments[5:], "--set", "output=modes")
    futures = modlhmp.forecast(modlhmp.load_map(folder / "hall.parquet"), CROWD, 3, output="modes")
    _, shares, alive = futures.modes
    shares = shares * (alive > 0)  # what ends at once has no rows
    shares = shares[shares.any(axis=1)] / shares[shares.any(axis=1)].sum(axis=1, keepdims=True)
    np.testing.assert_allclose(modes.loc[modes["step"] == 1, "probability"], shares[shares > 0], rtol=1e-5)


def test_the_ways_out_of_a_map_that_is_sampled(folder, tmp_path):
    """They are a file, and the remedy that names it can be followed; without them a word says whether people leave."""
    for kind in ("cliff", "snippets", "exits"):
        modlhmp.build_map(kind, CROWD).save(tmp_path / f"{kind}.parquet")
    walks, cliff, exits = (folder / "walks.parquet", tmp_path / "cliff.parquet", tmp_path / "exits.parquet")
    arguments = ("forecast", "--tracks", walks, "--horizon", 5, "--map")
    futures = modlhmp.forecast(modlhmp.load_map(cliff), CROWD, 5, exits=modlhmp.load_map(exits))
    assert len(table(*arguments, cliff, "--exits", exits)) == futures.forecast.samples.steps_alive.sum()
    for words, told in (
        (("--set", "exits=true"), "needs the ways out: give a map of kind `exits`, .*--exits FILE"),
        (("--set", f"exits={exits}"), "--set exits=.*exits.parquet: here that is --exits FILE"),
        (("--set", "exits=false", "--exits", exits), "--set exits=False: here that is --exits FILE"),
        (("--exits", cliff), "give True, False, or a map of kind `exits`"),
    ):
        with pytest.raises(modlhmp.DataError, match=told):
            said(*arguments, cliff, *words)
    snippets = modlhmp.load_map(tmp_path / "snippets.parquet")
    stay = modlhmp.forecast(snippets, CROWD, 5, exits=False).forecast.samples.steps_alive.sum()
    assert len(table(*arguments, tmp_path / "snippets.parquet", "--set", "exits=false")) == stay


def test_texts_are_no_ids_of_trajnet(folder, tmp_path):
    """They would become numbers that are nobody's, and too large for most readers of JSON."""
    with pytest.raises(
        modlhmp.DataError, match=r"f\.ndjson: TrajNet.* has texts, such as 'P\d+': write CSV or Parquet"
    ):
        said("forecast", "--map", "cvm", "--tracks", folder / "walks.csv", "--out", tmp_path / "f.ndjson")
    assert not (tmp_path / "f.ndjson").exists()


def told(*arguments):
    return CliRunner().invoke(app, [str(one) for one in arguments]).stderr


def test_what_is_not_used_and_what_was_guessed_is_told(folder, tmp_path):
    """Speeds that are there, and of a file of others its columns and what only a human can decide."""
    arguments = ("forecast", "--map", "cvm", "--horizon", 3, "--tracks")
    assert "the speeds and headings in" in told(*arguments, folder / "walks.parquet")
    assert told(*arguments, folder / "walks.csv") == ""
    of = pd.read_csv(folder / "walks.csv").rename(columns={"x": "px", "y": "py"})
    of.to_csv(tmp_path / "f.csv", index=False)
    said_so = told(*arguments, tmp_path / "f.csv")
    assert "the speeds and headings" not in said_so  # those that cleaning has made are nobody's record
    assert "f.csv: read as track_id = track_id, t = t, x = px, y = py, brought to a row every 1 s" in said_so
    assert "decide" not in said_so
    of["class"] = 0
    of.loc[of["track_id"] == of["track_id"].iloc[-1], "class"] = 1
    of.to_csv(tmp_path / "f.csv", index=False)
    assert "f.csv: decide: column 'class' holds" in told(*arguments, tmp_path / "f.csv")


def test_a_picture_beside_the_file(folder, tmp_path):
    arguments = ("forecast", "--map", folder / "hall.parquet", "--tracks", folder / "walks.csv", "--horizon", 3)
    said(*arguments, "--out", tmp_path / "f.csv", "--plot")
    assert (tmp_path / "f.png").stat().st_size > 10_000


@pytest.mark.parametrize("way", [(1.2, 0.0), (0.0, 1.2), (0.8, 0.8)])
def test_a_picture_is_as_flat_as_what_it_shows_and_names_the_files(tmp_path, monkeypatch, way):
    """The panel fills the figure, and the title has the files' names, not their paths."""
    import matplotlib.figure  # noqa: PLC0415

    drawn = []
    saved = matplotlib.figure.Figure.savefig
    monkeypatch.setattr(
        matplotlib.figure.Figure,
        "savefig",
        lambda figure, *given, **more: [drawn.append(figure), saved(figure, *given, **more)],
    )
    walk = "".join(f"1,{t},{way[0] * t},{way[1] * t}\n" for t in range(9))
    (tmp_path / "walk.csv").write_text("track_id,t,x,y\n" + walk)
    said("forecast", "--map", "cvm", "--tracks", tmp_path / "walk.csv", "--horizon", 30, "--out", tmp_path / "f.csv",
         "--plot")  # fmt: skip
    (axes,) = drawn[0].axes
    assert axes.get_title() == "cvm, walk.csv\n30 s"
    shown = axes.get_position()
    assert shown.width * shown.height > 0.3
    assert drawn[0].get_size_inches().max() <= 9


def test_where_nobody_has_a_forecast_nothing_is_written(folder, tmp_path):
    """Of people far from the map: status 1, in place of a file of a header."""
    of = pd.read_csv(folder / "walks.csv")
    of.assign(x=of["x"] + 5e5).to_csv(tmp_path / "far.csv", index=False)
    with pytest.raises(
        modlhmp.DataError, match=r"far.csv: nobody has a forecast: the map tells nothing of where and when they are$"
    ):
        said(
            "forecast", "--map", folder / "hall.parquet", "--tracks", tmp_path / "far.csv", "--out", tmp_path / "f.csv"
        )
    assert not (tmp_path / "f.csv").exists()


def test_rows_at_a_higher_rate_are_brought_to_the_time_step(folder, tmp_path):
    """A table at 5 Hz gives about the forecast of the same walks at 1 Hz."""
    of = pd.read_csv(folder / "walks.csv")
    often = [
        pd.DataFrame({"track_id": name, "t": np.arange(one["t"].iloc[0], one["t"].iloc[-1] + 0.01, 0.2)}).assign(
            x=lambda fine, one=one: np.interp(fine["t"], one["t"], one["x"]),
            y=lambda fine, one=one: np.interp(fine["t"], one["t"], one["y"]),
        )
        for name, one in of.groupby("track_id", sort=False)
    ]
    pd.concat(often).to_csv(tmp_path / "often.csv", index=False)
    arguments = ("forecast", "--map", "cvm", "--horizon", 3, "--tracks")
    fine, coarse = (table(*arguments, file) for file in (tmp_path / "often.csv", folder / "walks.csv"))
    both = fine.merge(coarse, on=["track_id", "step"])
    assert len(both) == len(coarse) and np.abs(both["x_x"] - both["x_y"]).max() < 1e-4


def test_who_has_too_few_rows_is_left_out_and_told(folder, tmp_path):
    of = pd.read_csv(folder / "walks.csv")
    of.drop(of.index[3:20]).to_csv(tmp_path / "f.csv", index=False)
    done = CliRunner().invoke(app, ["forecast", "--map", "cvm", "--tracks", str(tmp_path / "f.csv"), "--horizon", "2"])
    assert "1 of 30 people have fewer than 4 rows: left out" in done.stderr
    assert '"P0"' not in done.stdout and '"P1"' in done.stdout


BAD_TRACKS = {
    "no such file": (None, "no such file"),
    "no columns": ("a,b,c,d\n1,2,3,4\n", "call the columns track_id, t, x, y"),
    "a word": ("track_id,t,x,y\n1,0,0,0\n1,1,one,0\n", "f.csv, row 3: x 'one' is not a number"),
    "NaN": ("track_id,t,x,y\n1,0,0,0\n1,1,nan,0\n", "f.csv, row 3: x is empty or NaN"),
    "twice": ("track_id,t,x,y\n1,0,0,0\n1,1,1,0\n1,1,1,0\n", "row 4: track 1 has a row at t 1 in row 3 already"),
    "empty": ("track_id,t,x,y\n", "f.csv: it has no rows, so nobody can be forecast"),
    "short": ("track_id,t,x,y\n1,0,0,0\n1,1,1,0\n", "nobody has 4 rows"),
    "feet": ("track_id,t,x,y\n" + "".join(f"1,{t},{40 * t},0\n" for t in range(6)), "are positions in m"),
}


@pytest.mark.parametrize("name", BAD_TRACKS)
def test_bad_tracks(tmp_path, name):
    text, told = BAD_TRACKS[name]
    if text is not None:
        (tmp_path / "f.csv").write_text(text)
    with pytest.raises(modlhmp.DataError, match=re.escape(told)):
        said("forecast", "--map", "cvm", "--tracks", tmp_path / "f.csv", "--horizon", 2)


@pytest.mark.parametrize("name", ["a", "a.csv", "a.yaml", "a.parquet"])
def test_a_folder_is_no_file_of_tracks(tmp_path, name):
    (tmp_path / name).mkdir()
    (tmp_path / "f.csv").write_text("track_id,t0,step,x,y\nP3,1300000129,1,0,0\n")
    for arguments in (("forecast", "--map", "cvm"), ("score", tmp_path / "f.csv")):
        assert refused(*arguments, "--tracks", tmp_path / name) == f"{tmp_path / name}: a folder; name a file in it"


def test_a_file_whose_form_is_in_doubt(tmp_path):
    """What is in doubt is said, and how to say it."""
    lines = [f"{frame} {person} {0.5 * frame + person:.2f} {0.01 * frame:.2f}" for person in range(9)
             for frame in range(20)]  # fmt: skip
    (tmp_path / "f.txt").write_text("\n".join(lines))
    with pytest.raises(modlhmp.DataError, match=r"is in doubt .*modlhmp inspect FILE > form\.yaml"):
        said("forecast", "--map", "cvm", "--tracks", tmp_path / "f.txt", "--horizon", 2)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--horizon", 2.5), "horizon_s 2.5: give a multiple of 1 s"),
        (("--plot",), "--plot: the picture lies beside the file"),
        (("--out", "f.txt"), "--out f.txt: the name must end in .csv, .parquet or .ndjson"),
        (("--set", "velo=1"), "unknown key 'velo', did you mean 'velocity'?"),
        (("--option", "velocity=maybe"), "velocity: 'maybe' is not one of"),  # the name it had
        (("--at", 5), "--at 5: nobody in"),
        (("--at", 5), f"its times are {CROWD.t.min():.0f} to {CROWD.t.max():.0f} s"),
        (("--seed", -1), "--seed -1: give a whole number"),
        (("--map", "stef"), "--map stef: a kind of map, not a map: build one by `modlhmp map build stef`"),
        (("--map", "hal.parquet"), "hal.parquet: no such file; give the file of a map, or its folder of hours"),
        (("--out", "f.frob", "--tracks", "nowhere.csv"), "--out f.frob: the name must end in"),  # before all else
    ],
)
def test_bad_arguments(folder, more, told):
    with pytest.raises(modlhmp.DataError, match=re.escape(told)):
        said("forecast", "--map", "cvm", "--tracks", folder / "walks.csv", *more)


def test_an_option_without_a_value(folder):
    words = ["forecast", "--map", "cvm", "--tracks", str(folder / "walks.csv"), "--set", "velocity"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2 and "--set 'velocity': give NAME=VALUE" in done.stderr


# --- score ----------------------------------------------------------------------------------------------------------


def test_scores_are_the_library_s(folder, tmp_path):
    """Of text ids and a moment of each, both protocols; a stream gives the same."""
    at = float(CROWD.t[CROWD.track_id == 3][9])
    made = said("forecast", "--map", "cvm", "--tracks", folder / "walks.csv", "--at", at, "--horizon", 8)
    (tmp_path / "f.csv").write_text(made)
    found = table("score", tmp_path / "f.csv", "--tracks", folder / "walks.csv")
    again = table("score", "-", "--tracks", folder / "walks.csv", stdin=made)
    pd.testing.assert_frame_equal(found, again)
    seen = CROWD.seen_by(at, rows=4)
    for protocol in ("paper", "complete"):
        expected = modlhmp.score(modlhmp.forecast("cvm", seen, 8), CROWD, protocol)
        for _, row in found[found["protocol"] == protocol].iterrows():
            for name, value in expected.at(row["horizon_s"]).items():
                assert row[name] == pytest.approx(value, rel=1e-5)
    assert set(found["output"]) == {"single"} and 8 in set(found["horizon_s"])


def test_the_path_out_of_samples_is_chosen(folder, tmp_path):
    at = float(CROWD.t[CROWD.track_id == 3][9])
    file = tmp_path / "f.csv"
    said("forecast", "--map", folder / "hall.parquet", "--tracks", folder / "walks.csv", "--at", at, "--out", file)
    outputs = {
        path: table("score", file, "--tracks", folder / "walks.csv", "--path", path)["output"].iloc[0]
        for path in ("likeliest", "mean", "geometric_median")
    }
    assert outputs == {"likeliest": "likeliest", "mean": "mean_path", "geometric_median": "median"}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda of: of.assign(track_id="Q9"), "row 2: track Q9: nobody of that id is in"),
        (lambda of: of.assign(t0=of["t0"] + 0.4), "that track has no row then"),
        (lambda of: of.iloc[:0], "it has no forecasts"),
        (lambda of: of.assign(probability=0.5), "the probabilities of track P3 at t0 1300000129 sum to 0.5"),
    ],
)
def test_forecasts_of_others(folder, tmp_path, change, told):
    at = float(CROWD.t[CROWD.track_id == 3][9])
    made = table("forecast", "--map", "cvm", "--tracks", folder / "walks.csv", "--at", at, "--horizon", 8)
    change(made).to_csv(tmp_path / "f.csv", index=False)
    with pytest.raises(modlhmp.DataError, match=re.escape(told)):
        said("score", tmp_path / "f.csv", "--tracks", folder / "walks.csv")


@pytest.mark.parametrize(("theirs", "ours"), [("3.0", "3"), ("3", "003")])
def test_ids_in_other_digits_are_told(tmp_path, theirs, ours):
    """As tables that are read by another program have them."""
    (tmp_path / "walks.csv").write_text("track_id,t,x,y\n" + "".join(f"{ours},{t},{t},0\n" for t in range(9)))
    (tmp_path / "f.csv").write_text(f"track_id,t0,step,x,y\n{theirs},3,1,4,0\n")
    told = refused("score", tmp_path / "f.csv", "--tracks", tmp_path / "walks.csv")
    assert f"track {theirs}: nobody of that id is in" in told and told.endswith(f"; write {ours}, as there")


def refused(*arguments):
    """What a command says that refuses, and that it has written nothing before."""
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert isinstance(done.exception, modlhmp.DataError) and done.stdout == ""
    return str(done.exception)


def test_forecasts_without_a_future_are_not_scored(folder, tmp_path):
    """Made at the last rows of the tracks that they are scored against."""
    file = tmp_path / "f.csv"
    said("forecast", "--map", "cvm", "--tracks", folder / "walks.csv", "--horizon", 8, "--out", file)
    told = refused("score", file, "--tracks", folder / "walks.csv")
    assert "f.csv: no forecast has a future in" in told and "modlhmp forecast --at SECONDS" in told


def test_what_cannot_be_scored_says_what_can(folder, tmp_path):
    said("forecast", "--map", "cvm", "--tracks", folder / "walks.parquet", "--out", tmp_path / "f.ndjson")
    told = refused("score", tmp_path / "f.ndjson", "--tracks", folder / "walks.csv")
    assert "lines have no clock and cannot be scored: write CSV or Parquet" in told
    told = refused("score", tmp_path, "--tracks", folder / "walks.csv")
    assert "is a folder, so a hand-in: give the dataset file that its task was exported from (.yaml)" in told


@pytest.mark.parametrize("step", ["0", "-1", "nan", "inf"])
def test_a_time_step_that_is_none(folder, tmp_path, step):
    (tmp_path / "f.csv").write_text("track_id,t0,step,x,y\nP3,1300000129,1,0,0\n")
    with pytest.raises(modlhmp.DataError, match=f"--time-step {step}: give the seconds between two steps, above 0"):
        said("score", tmp_path / "f.csv", "--tracks", folder / "walks.csv", "--time-step", step)


# --- export-task ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder with a dataset file of two days."""
    made = tmp_path_factory.mktemp("site")
    for day, shift in (("monday", 0), ("tuesday", 86400)):
        rows = tracks_table(CROWD._replace(t=CROWD.t + shift)).to_pandas().drop(columns=["speed", "heading"])
        rows.to_csv(made / f"{day}.csv", index=False)
    (made / "hall.yaml").write_text(f"""
title: Hall
reader: delimited
timezone: UTC
header: true
columns: {{track_id: track_id, t: t, x: x, y: y}}
time_step_s: 1.0
horizon_s: 8
velocity: differences
recordings:
  - {{files: monday.csv, day: {DAYS[0]}, split: train}}
  - {{files: tuesday.csv, day: {DAYS[1]}, split: test}}
citation: nobody
terms: none
""")
    return made


def export(site, to, *more):
    return CliRunner().invoke(
        app, ["export-task", str(site / "hall.yaml"), "--to", str(to), "--data-root", str(site), *more]
    )


def test_a_task_is_exported_forecast_and_scored(site, tmp_path):
    """By our own command line on the exported observations, as an outsider would by another program."""
    done = export(site, tmp_path, "--training", "--neighbours")
    assert done.exit_code == 0 and done.stdout == ""
    about = json.loads((tmp_path / "task.json").read_text())
    assert about["task"] in done.stderr and about["tasks"] == 30
    assert {file.name for file in tmp_path.iterdir()} == {
        "observations.csv", "neighbours.csv", "training.csv", "task.json",
    }  # fmt: skip
    file = tmp_path / "mine" / "f.csv"
    said("forecast", "--map", "cvm", "--tracks", tmp_path / "observations.csv", "--horizon", 8, "--out", file)
    file.with_suffix(".json").write_text(json.dumps({"task": about["task"]}))
    found = table("score", file.parent, "--tracks", site / "hall.yaml", "--data-root", site)
    tracks = modlhmp.read_tracks(site / "hall.yaml", data_root=site, split="test")
    history = tracks.take(np.arange(len(tracks.t)) % 20 < 4)
    expected = modlhmp.score(modlhmp.forecast("cvm", history, 8), tracks, "complete").at(8)
    last = found[(found["protocol"] == "complete") & (found["horizon_s"] == 8)].iloc[0]
    assert last["ade_m"] == pytest.approx(expected["ade_m"], rel=1e-5) and last["n"] == 30


def test_training_tracks_that_are_the_answers_are_not_given_away(site, tmp_path):
    done = export(site, tmp_path, "--training", "--split", "train")
    assert isinstance(done.exception, modlhmp.DataError) and not list(tmp_path.iterdir())
    assert "leave training out, or export split 'test'" in str(done.exception)


def test_a_table_and_a_hand_in_have_the_same_scores_under_both_protocols(site, tmp_path):
    """The dataset file's idle filter counts for both: here of half of the people."""
    hall, others = tmp_path / "hall.yaml", pd.read_csv(site / "monday.csv")
    idle = "paper_protocol: {idle_filter: {rows: 5, min_displacement_m: 6.0}}\n"
    hall.write_text((site / "hall.yaml").read_text() + idle)
    others.assign(track_id=others["track_id"] + 1000).to_csv(tmp_path / "monday.csv", index=False)
    (tmp_path / "tuesday.csv").write_bytes((site / "tuesday.csv").read_bytes())
    said("export-task", hall, "--to", tmp_path / "task", "--data-root", tmp_path)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "f.json").write_text(json.dumps({"task": json.loads((tmp_path / "task/task.json").read_text())["task"]}))
    tested = pd.read_csv(tmp_path / "tuesday.csv")
    tested.groupby("track_id").head(4).to_csv(tmp_path / "seen.csv", index=False)
    found = []
    for seen, out, handed in (
        ("task/observations.csv", mine / "f.csv", mine),
        ("seen.csv", *2 * (tmp_path / "g.csv",)),
    ):
        said("forecast", "--map", "cvm", "--tracks", tmp_path / seen, "--horizon", 8, "--out", out)
        found.append(table("score", handed, "--tracks", hall, "--data-root", tmp_path))
    by = ["protocol", "horizon_s"]
    both = found[0].merge(found[1], on=by, suffixes=("_of_hand_in", ""))
    assert len(both) == len(found[0]) == len(found[1])
    counted = both[both["horizon_s"] == 8].set_index("protocol")["n"]
    assert 0 < counted["paper"] < counted["complete"] == 30
    for name in ("n", "eligible", "ade_m", "fde_m"):
        np.testing.assert_allclose(both[name], both[f"{name}_of_hand_in"], rtol=1e-4)


def test_what_a_hand_in_or_a_table_does_not_ask_is_refused(site, folder, tmp_path):
    said("forecast", "--map", "cvm", "--tracks", folder / "walks.csv", "--horizon", 3, "--out", tmp_path / "f.csv")
    of_table = ("score", tmp_path / "f.csv", "--tracks", folder / "walks.csv", "--time-step", 1)
    assert "--split train: of a hand-in, a folder;" in refused(*of_table, "--split", "train")
    of_hand_in = ("score", tmp_path, "--tracks", site / "hall.yaml", "--data-root", site)
    for option, value in (("--path", "mean"), ("--time-step", 2.0)):
        assert f"{option} {value}: the hand-in {tmp_path} says that itself" in refused(*of_hand_in, option, value)


def test_the_split_is_chosen(site, tmp_path):
    """Validation is the last training days, or blocks of time; each is another task."""
    hashes = set()
    for split in ("test", "train", "validation"):
        done = export(site, tmp_path / split, "--split", split)
        assert done.exit_code == 0 or "no track" in str(done.exception)
        if done.exit_code == 0:
            hashes.add(json.loads((tmp_path / split / "task.json").read_text())["task"])
    assert len(hashes) >= 2


def test_a_recording_that_is_not_there(site, tmp_path):
    with pytest.raises(modlhmp.DataError, match=r"tuesday\.csv: no such file"):
        said("export-task", site / "hall.yaml", "--to", tmp_path, "--data-root", tmp_path)


def test_forecasts_of_something_else(site, tmp_path):
    done = export(site, tmp_path, "--forecasts", str(tmp_path))
    assert isinstance(done.exception, modlhmp.DataError) and "give the folder of a method's forecasts" in str(
        done.exception
    )


@pytest.mark.parametrize("verb", ["forecast", "score", "export-task"])
def test_help_teaches_by_example(verb):
    """Two calls or more that a user can copy, and where the rest is told."""
    text = said(verb, "--help")
    assert len(re.findall(rf"^    modlhmp {verb} ", text, re.M)) >= 2
    assert "docs/" in text


def of_steps(folder, step_s):
    """A dataset file in one folder of recordings in another, their rows `step_s` apart; returns that folder."""
    recordings = folder / "recordings"
    recordings.mkdir()
    rows = tracks_table(CROWD._replace(t=CROWD.t[0] + step_s * (CROWD.t - CROWD.t[0]))).to_pandas()
    for name, moved in (("before", 50_000), ("walks", 0)):
        of = rows.assign(track_id=rows["track_id"] + moved, t=rows["t"] - moved, x=step_s * rows["x"])
        of["y"] = step_s * (-rows["y"] if moved else rows["y"])  # others, in the same place
        of.drop(columns=["speed", "heading"], errors="ignore").to_csv(recordings / f"{name}.csv", index=False)
    (folder / "hall.yaml").write_text(f"""
title: Hall
reader: delimited
timezone: UTC
header: true
columns: {{track_id: track_id, t: t, x: x, y: y}}
clock: unknown
time_step_s: {step_s}
horizon_s: {8 * step_s}
velocity: differences
recordings:
  - {{files: before.csv, split: train}}
  - {{files: walks.csv, split: test}}
citation: nobody
terms: none
""")
    return recordings


@pytest.mark.parametrize("said_by", ["option", "environment", "place"])
def test_every_verb_finds_a_dataset_s_recordings_alike(tmp_path, monkeypatch, said_by):
    """By --data-root, by MODLHMP_DATA, or in data: not beside the dataset file."""
    recordings = of_steps(tmp_path, 1.0)
    monkeypatch.delenv("MODLHMP_DATA", raising=False)
    monkeypatch.chdir(tmp_path)
    more = ("--data-root", recordings) if said_by == "option" else ()
    if said_by == "environment":
        monkeypatch.setenv("MODLHMP_DATA", str(recordings))
    if said_by == "place":
        recordings.rename(tmp_path / "data")
    at = float(CROWD.t[CROWD.track_id == 3][9])
    said("inspect", "hall.yaml", "--to", "looked", *more)
    said("forecast", "--map", "cvm", "--tracks", "hall.yaml", "--at", at, "--horizon", 3, "--out", "f.csv", *more)
    assert len(table("score", "f.csv", "--tracks", "hall.yaml", *more))
    said("export-task", "hall.yaml", "--to", "task", *more)


def test_the_time_step_of_scores_is_the_dataset_file_s(tmp_path):
    """Steps of 0.4 s, as in ETH and UCY; another one that is said does not fit the rows."""
    recordings = of_steps(tmp_path, 0.4)
    tracks = modlhmp.read_tracks(tmp_path / "hall.yaml", data_root=recordings)
    seen = tracks.take(np.arange(len(tracks.t)) % 20 < 4)
    site = modlhmp.Site(time_step_s=0.4, horizon_s=3.2)
    expected = modlhmp.score(modlhmp.forecast("cvm", seen, site=site), tracks).at(3.2)
    last = seen.bounds()[1:] - 1
    shift = 0.4 * np.arange(1, 9)
    vx, vy = ((values[last] - values[last - 3]) / 1.2 for values in (seen.x, seen.y))
    pd.DataFrame({
        "track_id": np.repeat(seen.track_id[last], 8), "t0": np.repeat(seen.t[last], 8),
        "step": np.tile(np.arange(1, 9), len(last)), "x": (seen.x[last, None] + vx[:, None] * shift).ravel(),
        "y": (seen.y[last, None] + vy[:, None] * shift).ravel(),
    }).to_csv(tmp_path / "h.csv", index=False)  # fmt: skip
    arguments = ("score", tmp_path / "h.csv", "--tracks", tmp_path / "hall.yaml", "--data-root", recordings)
    found = table(*arguments)
    of = found[found["protocol"] == "complete"].set_index("horizon_s").loc[3.2]
    assert of["n"] == expected["n"] == 60
    assert of["ade_m"] == pytest.approx(table(*arguments, "--time-step", 0.4)["ade_m"].iloc[-1], rel=1e-6)
    assert "hall.yaml: its time step is 0.4 s, 1 s is needed" in refused(*arguments, "--time-step", 1)


@pytest.mark.parametrize("kind", ["dataset", "clean"])
def test_a_kind_without_a_map_has_the_time_step_of_the_tracks(tmp_path, kind):
    """Of a dataset file, its horizon, too; forecasts are scored by the same step, though no file of theirs says it."""
    recordings = of_steps(tmp_path, 0.4)
    file = tmp_path / "hall.yaml"
    tracks = modlhmp.read_tracks(file, data_root=recordings)
    if kind == "clean":
        file = tmp_path / "walks.parquet"
        write_tracks(tracks, file)
    at = float(tracks.t[tracks.track_id == 3][9])
    of = ("--tracks", file, "--data-root", recordings)
    said("forecast", "--map", "cvm", *of, "--at", at, "--horizon", 3.2, "--out", tmp_path / "f.csv")
    made = pd.read_csv(tmp_path / "f.csv")
    expected = modlhmp.forecast("cvm", tracks.seen_by(at, rows=4), 3.2).best
    np.testing.assert_allclose(made.loc[made["step"] == 8, ["x", "y"]], expected[:, 7], rtol=1e-5)
    assert table("score", tmp_path / "f.csv", *of)["horizon_s"].iloc[-1] == pytest.approx(3.2)
    if kind == "dataset":
        assert table("forecast", "--map", "cvm", *of)["step"].max() == 8


@pytest.mark.parametrize("way", ["csv", "parquet", "stream"])
def test_forecasts_say_how_long_their_steps_are(tmp_path, way):
    """Of a map of 0.4 s, scored against a table whose rows could be brought to any time step."""
    walks = of_steps(tmp_path, 0.4) / "walks.csv"
    tracks = modlhmp.read_tracks(tmp_path / "hall.yaml", data_root=walks.parent)
    a_map = modlhmp.build_map("snippets", tracks, modlhmp.Site(time_step_s=0.4, horizon_s=3.2))
    a_map.save(tmp_path / "map.parquet")
    at = float(tracks.t[tracks.track_id == 3][9])
    file = "-" if way == "stream" else tmp_path / f"f.{way}"
    made = said("forecast", "--map", tmp_path / "map.parquet", "--tracks", walks, "--at", at, "--best", "--out", file)
    arguments = ("score", file, "--tracks", walks)
    found = table(*arguments, stdin=made)
    of = found[found["protocol"] == "complete"].set_index("horizon_s")["ade_m"]
    after = np.flatnonzero((tracks.track_id == 3) & (tracks.t > at + 1e-6))[:8]
    best = modlhmp.forecast(a_map, tracks.seen_by(at, rows=4)).best[0]
    expected = np.hypot(best[:, 0] - tracks.x[after], best[:, 1] - tracks.y[after]).mean()
    assert of.index[-1] == pytest.approx(3.2) and of.iloc[-1] == pytest.approx(expected, rel=1e-4)
    done = CliRunner().invoke(app, [str(one) for one in (*arguments, "--time-step", 1)], input=made)
    assert "--time-step 1: a step of" in str(done.exception) and "is 0.4 s; leave it out" in str(done.exception)


@pytest.mark.parametrize("called", [{}, {"track_id": "person"}])
def test_a_time_step_that_nobody_says_is_asked_for(tmp_path, called):
    """Of forecasts without seconds, whose truth could be brought to any step; a step that is said is used."""
    walks = of_steps(tmp_path, 0.4) / "walks.csv"
    pd.read_csv(walks).rename(columns=called).to_csv(walks, index=False)
    (tmp_path / "f.csv").write_text("track_id,t0,step,x,y\n3,1300000004,1,0,0\n")
    told = refused("score", tmp_path / "f.csv", "--tracks", walks)
    assert "f.csv does not say how long its steps are: give --time-step, that of the forecasts" in told


@pytest.mark.parametrize("truth", ["walks.csv", "hall.yaml"])
@pytest.mark.parametrize(("change", "told"), [
    (lambda of: of.assign(step=of["step"] - 1), "row 2: t 0.4 s is not step 0 of 0.457143 s, as row 9 has them: steps"),
    (lambda of: of.assign(step=of["step"] - 1).iloc[:1], "row 2: t 0.4 s is not step 0 of"),
    (lambda of: of.assign(t=of["t"] - 0.4), "row 2: t 0 s is not step 1 of 0.35 s, as row 9 has"),
    (lambda of: of.assign(t=of["t"] + 50.2), "steps count from 1, t from t0"),
    (lambda of: of.assign(t=of["t"].where(of["step"] < 8, 9.0)), "of 1.125 s, as row 9 has them"),
    (lambda of: of.assign(step=of["step"] - 1, t=of["t"] - 0.4), "row 2: step 0: a future begins one time step after"),
    (lambda of: of.assign(t=of["t"] + of["t0"]), "row 2: t 1300000004.4: t is in seconds after t0"),
])  # fmt: skip
def test_seconds_that_are_not_those_of_the_steps_are_refused(tmp_path, truth, change, told):
    """The forecasts are blamed for it, not the tracks."""
    recordings = of_steps(tmp_path, 0.4)
    of = pd.DataFrame({"track_id": 3, "t0": 1300000004.0, "step": np.arange(1, 9), "x": 0, "y": 0})
    change(of.assign(t=np.round(of["step"] * 0.4, 2))).to_csv(tmp_path / "f.csv", index=False)
    tracks = next(tmp_path.rglob(truth))
    said_so = refused("score", tmp_path / "f.csv", "--tracks", tracks, "--data-root", recordings)
    assert "f.csv, row" in said_so and told in said_so


@pytest.mark.parametrize("called", [{}, {"track_id": "person"}])
def test_a_table_without_rows_has_no_forecasts(tmp_path, called):
    """Whoever reads it is not asked for its time step."""
    walks = of_steps(tmp_path, 0.4) / "walks.csv"
    pd.read_csv(walks).rename(columns=called).to_csv(walks, index=False)
    (tmp_path / "f.csv").write_text("track_id,t0,step,x,y\n")
    assert refused("score", tmp_path / "f.csv", "--tracks", walks).endswith("f.csv: it has no forecasts")


def test_a_map_of_another_time_step_is_refused(folder, tmp_path):
    recordings = of_steps(tmp_path, 0.4)
    told = refused(
        "forecast", "--map", folder / "hall.parquet", "--tracks", tmp_path / "hall.yaml", "--data-root", recordings
    )
    assert "hall.yaml: its time step is 0.4 s, 1 s is needed, that of the map" in told
    assert (
        "rows every 0.4 s, brought to a row every 1 s"
        in CliRunner()
        .invoke(app, ["forecast", "--map", str(folder / "hall.parquet"), "--tracks", str(recordings / "walks.csv")])
        .stderr
    )


# --- whose ids ------------------------------------------------------------------------------------------------------


def cut_in_two(file, to, ids):
    """A file of people called as `ids` says, who are away for a minute: each is two tracks."""
    rows = pd.read_csv(file)
    rows["t"] += 60.0 * (rows.groupby("track_id").cumcount() >= 10)
    rows.assign(track_id=rows["track_id"].map(ids)).to_csv(to, index=False)


@pytest.mark.parametrize("ids", ["{:d}", "P{:02d}"])
@pytest.mark.parametrize("given", ["dataset", "recording"])
def test_ids_are_the_owner_s_and_are_found_again(tmp_path, ids, given):
    """Of forecasts and their scores, for plain numbers and texts, and for tracks that were cut."""
    recordings = of_steps(tmp_path, 1.0)
    for name in ("before", "walks"):
        cut_in_two(recordings / f"{name}.csv", recordings / f"{name}.csv", ids.format)
    if given == "recording":  # more often than the time step, so that it is cleaned, and cut
        rows = pd.read_csv(recordings / "walks.csv")
        between = rows.assign(t=rows["t"] + 0.5, x=rows["x"] + 0.5 * rows.groupby("track_id")["x"].diff().shift(-1))
        both = pd.concat([rows, between.dropna()]).sort_values(["track_id", "t"])
        both.to_csv(recordings / "walks.csv", index=False)
    file = tmp_path / "hall.yaml" if given == "dataset" else recordings / "walks.csv"
    of = ("--tracks", file, "--data-root", recordings)
    known = set(pd.read_csv(recordings / "walks.csv", dtype=str)["track_id"])
    for hall in (4, 14):
        at = float(
            pd.read_csv(recordings / "walks.csv")
            .groupby("track_id")["t"]
            .nth(2 * hall if given == "recording" else hall)
            .iloc[5]
        )
        said("forecast", "--map", "cvm", *of, "--at", at, "--horizon", 3, "--out", tmp_path / "f.csv")
        made = set(pd.read_csv(tmp_path / "f.csv", dtype=str)["track_id"])
        assert made and {one.removesuffix(" #2") for one in made} <= known
        scored = table("score", tmp_path / "f.csv", *of)
        assert scored["n"].iloc[0] == len(made) and (scored["fde_m"] < 3).all()  # who walks straight, not another one
    assert any(one.endswith(" #2") for one in made)


def test_ids_that_two_recordings_share_have_the_recording_s_name(site, tmp_path):
    """The same number may be two people."""
    of = ("--tracks", site / "hall.yaml", "--data-root", site)
    at = float(CROWD.t[CROWD.track_id == 3][9]) + 86400
    said("forecast", "--map", "cvm", *of, "--at", at, "--horizon", 3, "--out", tmp_path / "f.csv")
    assert set(pd.read_csv(tmp_path / "f.csv")["track_id"]) == {"tuesday/3"}
    assert (table("score", tmp_path / "f.csv", *of)["n"] == 1).all()
    made = pd.read_csv(tmp_path / "f.csv")
    made.assign(track_id=3).to_csv(tmp_path / "g.csv", index=False)
    assert "track 3: nobody of that id is in" in refused("score", tmp_path / "g.csv", *of)
