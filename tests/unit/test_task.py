"""A task to give away, and forecasts that come back for it."""

import itertools
import json
import re

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from modlhmp import DataError, Site, Tracks
from modlhmp.contract import crowd
from modlhmp.exchange.forecasts import forecast_of, long_table, read_samples
from modlhmp.exchange.hand_in import read_hand_in, write_hand_in
from modlhmp.exchange.task import make_task, write_task
from modlhmp.forecasting.base import MODES, Forecast
from modlhmp.forecasting.cvm import forecaster
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.forecasting.windows import windows
from modlhmp.inspection import inspect_dataset
from modlhmp.options import ConstantVelocity
from modlhmp.recordings import clean
from modlhmp.scenes import Scenes
from modlhmp.scoring.recording import score_recording
from modlhmp.tasks import export_task, score_hand_in

SITE = Site(horizon_s=8)
STEPS, SEEN = 8, SITE.observed_rows
WALKS = crowd(people=12, seconds=20)
LATER = WALKS._replace(t=WALKS.t + 86400, x=WALKS.x + 3)
DAYS = {"monday": WALKS, "tuesday": LATER}


def task_of(days=DAYS, site=SITE, name="hall", neighbours=False, scenes=None):
    of = scenes or {}
    return make_task(
        ((day, tracks, of.get(day), [] if neighbours else None) for day, tracks in days.items()), site, name
    )


def late_scenes(times=1):
    """Scenes of every track, the first of 12 rows from its 7th on, then every 3 rows; {day: Scenes}."""
    found = {}
    for day, tracks in DAYS.items():
        row = (tracks.bounds()[:-1, None] + 6 + 3 * np.arange(times)).ravel()
        found[day] = Scenes(tracks.track_id[row], tracks.t[row], tracks.t[row] + 11)
    return found


@pytest.fixture(scope="module")
def task():
    return task_of()


def straight(task, samples=1):
    """The long form of constant velocity from the observations' last step, as a pandas user writes it."""
    seen = task.observed
    step = np.arange(1, STEPS + 1)
    rows = []
    for number, sample in itertools.product(range(task.about["tasks"]), range(samples)):
        x, y = seen.x[number], seen.y[number]
        turn = 0.1 * sample
        dx, dy = x[-1] - x[-2], y[-1] - y[-2]
        dx, dy = dx * np.cos(turn) - dy * np.sin(turn), dx * np.sin(turn) + dy * np.cos(turn)
        rows += [(number, sample, k, x[-1] + k * dx, y[-1] + k * dy) for k in step]
    return pd.DataFrame(rows, columns=["track_id", "sample", "step", "x", "y"])


def hand_in(folder, task, table, path="mean", suffix=".csv", sheet=None):
    """A folder with a table and its sheet, some of it changed."""
    folder.mkdir(exist_ok=True)
    table.to_csv(folder / "f.csv", index=False) if suffix == ".csv" else table.to_parquet(folder / "f.parquet")
    (folder / "f.json").write_text(json.dumps({"task": task.about["task"], "path": path, **(sheet or {})}))
    return folder


# --- the task -------------------------------------------------------------------------------------------------------


def test_it_holds_what_is_seen_and_nothing_later(task, tmp_path):
    """Every window once, with its own rows up to t0; t0 is 0; neither clock, day, order nor our ids."""
    write_task(task, tmp_path)
    table = pd.read_csv(tmp_path / "observations.csv")
    assert table.columns.tolist() == ["track_id", "t", "x", "y"]
    assert table["t"].min() == 1 - SEEN and table["t"].max() == 0
    assert table.groupby("track_id").size().eq(SEEN).all()
    for name, tracks in DAYS.items():
        wanted = windows(tracks, SITE)
        for number, row in zip(task.ids[name], wanted.row, strict=True):
            mine = table[table["track_id"] == number]
            these = slice(row - SEEN + 1, row + 1)
            np.testing.assert_array_equal(mine[["x", "y"]], np.column_stack([tracks.x[these], tracks.y[these]]))
            np.testing.assert_array_equal(mine["t"], tracks.t[these] - tracks.t[row])
    assert sorted(np.concatenate(list(task.ids.values()))) == list(range(24))
    assert {file.name for file in tmp_path.iterdir()} == {"observations.csv", "task.json"}
    about = json.loads((tmp_path / "task.json").read_text())
    assert (about["dataset"], about["steps"], about["time_step_s"], about["horizon_s"]) == ("hall", 8, 1.0, 8)
    assert about["leaks"] == [] and about["neighbours"] is False
    assert {"monday", "tuesday"}.isdisjoint(re.findall(r"\w+", (tmp_path / "task.json").read_text()))


def test_numbers_are_shuffled_anew_for_each_task(task):
    """Neither in the order of the recording nor in that of another task; made again they are the same."""
    numbers = np.concatenate(list(task.ids.values()))
    other = np.concatenate(list(task_of(name="forum").ids.values()))
    assert not np.array_equal(numbers, np.sort(numbers)) and not np.array_equal(numbers, other)
    assert abs(np.corrcoef(numbers, np.arange(24))[0, 1]) < 0.5
    np.testing.assert_array_equal(numbers, np.concatenate(list(task_of().ids.values())))


def test_the_order_cannot_be_found_from_what_is_seen():
    """Other futures, the same observations: the file says the same, but for the numbers."""
    tracks, last = DAYS["monday"], np.arange(len(WALKS.t)) % 20 >= SEEN
    turned = tracks._replace(y=tracks.y + np.where(last, np.linspace(0, 1, len(last)), 0))
    one, other = task_of({"monday": tracks}), task_of({"monday": turned})
    assert one.ids["monday"].tolist() != other.ids["monday"].tolist()
    for part in ("t", "x", "y"):
        mine, theirs = getattr(one.observed, part), getattr(other.observed, part)
        np.testing.assert_array_equal(mine[one.ids["monday"]], theirs[other.ids["monday"]])


def test_the_last_bit_decides_nothing(task):
    """Another machine's arithmetic gives the same numbers and the same hash; another walk does not."""
    nearly = {name: one._replace(x=np.nextafter(one.x, np.inf)) for name, one in DAYS.items()}
    again = task_of(nearly)
    assert again.about == task.about
    for name in DAYS:
        np.testing.assert_array_equal(again.ids[name], task.ids[name])
    moved = {**DAYS, "monday": WALKS._replace(x=WALKS.x + 0.001)}
    assert task_of(moved).about["task"] != task.about["task"]


def test_other_settings_are_another_task(task):
    hashes = {
        one.about["task"]
        for one in (task, task_of(site=Site(horizon_s=7)), task_of(site=Site(horizon_s=8, observed_rows=5)))
    }
    assert len(hashes) == 3


def test_recorded_velocities_are_given_and_derived_ones_are_not(tmp_path):
    recorded = task_of(site=Site(horizon_s=8, velocity="as_recorded"))
    write_task(recorded, tmp_path)
    table = pd.read_csv(tmp_path / "observations.csv")
    assert {"speed", "heading"} <= set(table.columns)
    number, row = int(recorded.ids["monday"][3]), windows(WALKS, SITE).row[3]
    mine = table[table["track_id"] == number]
    np.testing.assert_array_equal(mine["speed"], WALKS.speed[row - SEEN + 1 : row + 1])


def test_neighbours_come_on_request_with_what_they_give_away(tmp_path):
    """Who is near, numbered anew in each task; the leak is written down."""
    pair = WALKS.take(WALKS.track_id < 2)
    second = pair.track_id == 1
    shifted = pair.t - np.where(second, pair.t[second][0] - pair.t[0] + 2, 0)
    beside = pair._replace(t=shifted, x=np.where(second, pair.x[:20].tolist() * 2, pair.x), y=pair.y * 0)
    task = task_of({"monday": beside}, neighbours=True)
    write_task(task, tmp_path)
    near = pd.read_csv(tmp_path / "neighbours.csv")
    assert set(near["track_id"]) == {0, 1} and set(near["neighbour"]) == {0}
    assert near["t"].between(1 - SEEN, 0).all()
    about = json.loads((tmp_path / "task.json").read_text())
    assert about["neighbours"] is True and "matches positions learns futures" in about["leaks"][0]
    assert about["task"] == task_of({"monday": beside}).about["task"]


def test_later_forecasts_of_a_person_are_said_to_tell_of_earlier_ones(tmp_path):
    task = task_of(site=Site(horizon_s=8, forecast_every_s=5))
    assert task.about["tasks"] > 24
    write_task(task, tmp_path)
    assert "every 5 s" in json.loads((tmp_path / "task.json").read_text())["leaks"][0]


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_tracks_to_train_on_are_whole(task, tmp_path, form):
    write_task(task, tmp_path, form, training=[WALKS, LATER])
    read = pd.read_csv if form == "csv" else pd.read_parquet
    table = read(tmp_path / f"training.{form}")
    assert table["track_id"].nunique() == 24
    np.testing.assert_array_equal(table["x"], np.concatenate([WALKS.x, LATER.x]))
    np.testing.assert_array_equal(table["t"], np.concatenate([WALKS.t, LATER.t]))


def test_nobody_to_forecast(tmp_path):
    with pytest.raises(DataError, match=r"hall: no track \(or scene\) has 5 rows"):
        task_of({"monday": WALKS.take(slice(0, 3))})


# --- forecasts come back --------------------------------------------------------------------------------------------


def scores(handed, name):
    return score_recording(DAYS[name], handed.forecasts(name), name, SITE).to_pandas()


def cvm(name, site=SITE, scenes=None):
    names, own = ("h", "cvm", name), (scenes or {}).get(name)
    return forecast_recording(DAYS[name], forecaster(None, site, ConstantVelocity()), site, names, 1, [0], scenes=own)


@pytest.mark.parametrize("form", ["csv", "parquet", "ndjson"])
@pytest.mark.parametrize(
    ("every_s", "scenes"), [(None, None), (5, None), (None, late_scenes()), (None, late_scenes(2)), (5, late_scenes())]
)
def test_our_own_come_back_to_the_bit(tmp_path, form, every_s, scenes):
    site = Site(horizon_s=8, forecast_every_s=every_s)
    task = task_of(site=site, scenes=scenes)
    write_hand_in(tmp_path, task, {name: cvm(name, site, scenes) for name in DAYS}, form)
    handed = read_hand_in(tmp_path, task)
    assert handed.coverage().endswith(f"{len(task.observed.x)} of {len(task.observed.x)} tracks have a forecast")
    for name, tracks in DAYS.items():
        ours, theirs = list(cvm(name, site, scenes)), list(handed.forecasts(name))
        for (seed, ids, one), (_, other_ids, other) in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(ids, other_ids)
            for part, again in zip(one, other, strict=True):
                np.testing.assert_array_equal(part, again)
            assert (seed, other.output) == (0, "single")
        own = None if scenes is None else scenes[name]
        row = windows(tracks, site, own).row
        np.testing.assert_array_equal(task.start[task.ids[name]], np.column_stack([tracks.x[row], tracks.y[row]]))
        expected = score_recording(tracks, ours, name, site, scenes=own)
        again = score_recording(tracks, theirs, name, site, scenes=own)
        for column in expected.column_names:
            np.testing.assert_array_equal(*(np.array(one[column].to_pylist()) for one in (again, expected)))


def test_a_recording_with_scenes_asks_for_these(tmp_path):
    """Export, forecast and score by a dataset file; with one scene a track, nothing but t0 tells them from none."""
    begin, lines = 6, []
    for person in range(8):
        walked = np.maximum(np.arange(20) - begin, 0) * (1 + 0.1 * person)  # stands before its scene
        lines.append(
            {"scene": {"id": person, "p": person, "s": begin, "e": 19 if person else 15, "fps": 1.0, "tag": 0}}
        )
        lines += [{"track": {"f": f, "p": person, "x": x, "y": 3.0 * person}} for f, x in enumerate(walked.tolist())]
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (tmp_path / "noon.ndjson").write_text(text)
    (tmp_path / "morning.ndjson").write_text(text + "\n")
    sheet = tmp_path / "plaza.yaml"
    sheet.write_text(
        "{title: Plaza, reader: trajnet, timezone: UTC, clock: unknown, time_step_s: 1, horizon_s: 8, "
        "velocity: differences, citation: a test, terms: free, "
        "recordings: [{files: morning.ndjson, split: train}, {files: noon.ndjson, split: test}]}"
    )
    task, _ = export_task(sheet, tmp_path / "task", tmp_path)
    assert task.observed.x[:, -1] == pytest.approx(3 * (1 + 0.1 * task.start[:, 1] / 3))
    assert "in every scene" in json.loads((tmp_path / "task/task.json").read_text())["leaks"][0]
    hand_in(tmp_path / "theirs", task, straight(task))
    _, rows = score_hand_in(tmp_path / "theirs", sheet, tmp_path)
    assert max(row.fde_m for row in rows) < 1e-6
    counted = {row.horizon_s: row.n for row in rows if row.protocol == "complete"}
    assert counted[2] == 8 and counted[8] == 7
    told = dict(dict(inspect_dataset(sheet, tmp_path).tables)["The dataset"])
    assert told["forecasts by horizon"] == ", ".join(f"{horizon:g} s: {n}" for horizon, n in counted.items())


@pytest.mark.parametrize("form", ["csv", "parquet", "ndjson"])
@pytest.mark.parametrize("output", ["ranked", "medoid", "modes", "mean"])
def test_our_own_have_their_numbers_in_every_form(task, tmp_path, form, output):
    """At the longest horizon, whose order every form carries, under both protocols."""
    made = {}
    for seed, name in enumerate(DAYS):
        rng, some = np.random.default_rng(seed), futures(output, n=12, k=MODES + 3, steps=STEPS)
        xy, fitness, alive = (part[:, ::-1].copy() for part in some[:3])  # so that sample 0 is not the best
        if output == "mean":
            xy, alive = rng.normal(size=xy.shape).astype(np.float32), np.full_like(alive, STEPS)
        if output == "modes":
            alive[:] = STEPS
            fitness[:] = np.log([0.1, 0.05, 0.15, 0.4, 0.3, 1, 1, 1])[:, None]
        made[name] = [(0, windows(DAYS[name], SITE).track_id, Forecast(xy, fitness, alive, output))]
    write_hand_in(tmp_path, task, made, form)
    handed = read_hand_in(tmp_path, task)
    for name, forecasts in made.items():
        ours, theirs = (
            score_recording(DAYS[name], of, name, SITE).to_pandas() for of in (forecasts, handed.forecasts(name))
        )
        ours = ours[ours["output"] == ("mean_path" if output == "mean" else output)]
        for metric in ("ade", "fde"):
            last, own = (
                np.stack(table.sort_values(["protocol", "track_id"])[metric])[:, -1] for table in (theirs, ours)
            )
            np.testing.assert_allclose(last, own, atol=1e-5)
            assert np.isfinite(own).any()


@pytest.mark.parametrize("form", ["csv", "parquet", "ndjson"])
def test_our_own_stand_in_the_order_of_their_numbers(task, tmp_path, form):
    """That of the recordings would tell who came after whom."""
    file, _ = write_hand_in(tmp_path, task, {name: cvm(name) for name in DAYS}, form)
    if form == "ndjson":
        lines = [json.loads(line) for line in file.read_text().splitlines()]
        order = [one["scene"]["id"] if "scene" in one else one["track"]["scene_id"] for one in lines]
        steps = [one["track"]["f"] for one in lines if "track" in one]
    else:
        table = pd.read_csv(file) if form == "csv" else pd.read_parquet(file)
        order, steps = table["track_id"].tolist(), (table["track_id"] * 100 + table["step"]).tolist()
    assert order == sorted(order) and set(order) == set(range(24))
    assert steps == sorted(steps)


def test_an_earlier_export_leaves_nothing_behind(task, tmp_path):
    """What was asked for then may tell more than is asked for now; other people's files are theirs."""
    write_task(task, tmp_path, "ndjson")
    write_task(task_of(neighbours=True), tmp_path, training=[WALKS])
    write_hand_in(tmp_path, task, {name: cvm(name) for name in DAYS}, "parquet")
    assert (tmp_path / "training.csv").exists() and not (tmp_path / "observations.ndjson").exists()
    write_task(task, tmp_path)
    write_hand_in(tmp_path, task, {name: cvm(name) for name in DAYS})
    names = {"observations.csv", "task.json", "forecasts.csv", "forecasts.json"}
    assert {file.name for file in tmp_path.iterdir()} == names
    (tmp_path / "own").mkdir()
    (tmp_path / "own/training.csv").write_text("mine")
    write_task(task, tmp_path / "own")
    assert (tmp_path / "own/training.csv").read_text() == "mine"


def test_futures_that_begin_where_nobody_can_be_are_told(task, tmp_path, caplog):
    """Such as positions in mm: they are scored, but not without a word."""
    read_hand_in(hand_in(tmp_path, task, straight(task, 2)), task)
    assert not caplog.messages
    in_mm = straight(task, 2)
    in_mm[["x", "y"]] *= 1000
    read_hand_in(hand_in(tmp_path, task, in_mm), task)
    assert "f.csv: 24 of 24 tracks, first 0, have a step 1 that is up to" in caplog.messages[0]
    assert "is everything in m, in the recording's frame?" in caplog.messages[0]


def test_a_folder_for_each_dataset(task, tmp_path):
    hand_in(tmp_path / "hall", task, straight(task))
    assert len(read_hand_in(tmp_path, task).missing) == 0


def test_seconds_after_t0_instead_of_steps(task, tmp_path):
    table = straight(task).rename(columns={"step": "t"}).assign(t=lambda of: of["t"] + 0.04)
    other = read_hand_in(hand_in(tmp_path, task, table), task)
    expected = read_hand_in(hand_in(tmp_path, task, straight(task)), task)
    np.testing.assert_array_equal(other.samples.xy, expected.samples.xy)


def test_parquet_with_other_types(task, tmp_path):
    """Ids as text, whole numbers as small integers, positions as float32."""
    table = straight(task).astype({"track_id": str, "sample": "int8", "step": "int16", "x": "float32"})
    handed = read_hand_in(hand_in(tmp_path, task, table, suffix=".parquet"), task)
    assert handed.samples.most == 1 and len(handed.missing) == 0


def test_the_three_ways_to_one_path(task, tmp_path):
    """Of three samples with probabilities, against plain loops."""
    table = straight(task, 3)
    table["probability"] = table["sample"].map({0: 0.2, 1: 0.5, 2: 0.3})
    first = table[table["track_id"] == 0].pivot(index="step", columns="sample", values=["x", "y"])
    x, y, p = first["x"].to_numpy(), first["y"].to_numpy(), np.array([0.2, 0.5, 0.3])

    def result(path):
        (these,) = (one for one in task.ids if 0 in task.ids[one])
        _, _, one = next(read_hand_in(hand_in(tmp_path, task, table, path), task).forecasts(these))
        row = int(np.flatnonzero(task.ids[these] == 0)[0])
        return one.output, one.results.xy[row], one.samples.xy[row]

    output, of_mean, samples = result("mean")
    assert output == "mean_path" and samples.shape == (3, STEPS, 2)
    np.testing.assert_allclose(of_mean[0], np.column_stack([x @ p, y @ p]), rtol=1e-6)
    assert result("likeliest")[0] == "likeliest"
    output, of_median, _ = result("geometric_median")
    assert output == "median"

    def expected_error(at, step):
        return (p * np.hypot(x[step] - at[0], y[step] - at[1])).sum()

    around = [(dx, dy) for dx in (-0.05, 0, 0.05) for dy in (-0.05, 0, 0.05) if dx or dy]
    for step in range(STEPS):
        here = expected_error(of_median[0, step], step)
        assert all(expected_error(of_median[0, step] + move, step) > here - 1e-4 for move in around)
    table = table.drop(columns="probability")
    assert result("geometric_median")[0] == "median"
    np.testing.assert_allclose(result("mean")[1][0], np.column_stack([x.mean(axis=1), y.mean(axis=1)]), rtol=1e-6)


def test_a_median_does_not_depend_on_who_else_is_handed_in(task, tmp_path):
    """To the bit, whether the others have samples near each other or far apart, or more of them."""
    table = straight(task, 3)
    table["probability"] = table["sample"].map({0: 0.2, 1: 0.5, 2: 0.3})
    table["x"] += table["sample"] * table["track_id"] ** 2
    more = table[(table["track_id"] == 5) & (table["sample"] == 2)]
    table.loc[more.index, "probability"] = 0.15
    table = pd.concat([table, more.assign(sample=3, probability=0.15)])

    def medians(of):
        handed, paths = read_hand_in(hand_in(tmp_path, task, of, "geometric_median"), task), np.empty((24, STEPS, 2))
        for name, ids in task.ids.items():
            paths[ids] = np.concatenate([forecast.results.xy[:, 0] for _, _, forecast in handed.forecasts(name)])
        return paths

    everybody = medians(table)
    for number in (3, 5, 17):
        np.testing.assert_array_equal(medians(table[table["track_id"] == number])[number], everybody[number])


def test_the_likeliest_is_what_is_scored(task, tmp_path):
    table = straight(task, 3)
    table["probability"] = table["sample"].map({0: 0.2, 1: 0.5, 2: 0.3})
    only = table[table["sample"] == 1].drop(columns=["probability", "sample"])
    single = scores(read_hand_in(hand_in(tmp_path / "a", task, only), task), "monday")
    chosen = scores(read_hand_in(hand_in(tmp_path / "b", task, table, "likeliest"), task), "monday")
    assert set(chosen["output"]) == {"likeliest"} and set(single["output"]) == {"single"}
    assert chosen["ade"].map(tuple).tolist() == single["ade"].map(tuple).tolist()


def test_a_sample_that_ends(task, tmp_path):
    """The paper protocol leaves the track out from there, the complete one holds the position."""
    table = straight(task)
    number = int(task.ids["monday"][0])
    table = table[(table["track_id"] != number) | (table["step"] <= 3)]
    found = scores(read_hand_in(hand_in(tmp_path, task, table), task), "monday")
    mine = found[found["track_id"] == WALKS.track_id[windows(WALKS, SITE).row[0]]].set_index("protocol")
    assert (mine.loc["paper", "scored_steps"], mine.loc["complete", "scored_steps"]) == (3, 8)
    assert mine.loc["complete", "alive_steps"] == 3


def test_missing_tracks_are_counted_and_what_each_protocol_does_with_them(task, tmp_path):
    gone = task.ids["monday"][:2]
    table = straight(task)
    handed = read_hand_in(hand_in(tmp_path, task, table[~table["track_id"].isin(gone)]), task)
    assert sorted(handed.missing) == sorted(gone)
    assert "22 of 24 tracks have a forecast" in handed.coverage() and "standing still" in handed.coverage()
    found = scores(handed, "monday")
    ids = WALKS.track_id[windows(WALKS, SITE).row[:2]]
    mine = found[found["track_id"].isin(ids)].set_index("protocol")
    assert (mine.loc["paper", "scored_steps"] == 0).all() and (mine.loc["complete", "scored_steps"] == 8).all()
    assert (mine["alive_steps"] == 0).all()
    row = windows(WALKS, SITE).row[0]
    moved = np.hypot(WALKS.x[row + 8] - WALKS.x[row], WALKS.y[row + 8] - WALKS.y[row])
    assert mine.loc["complete", "fde"].iloc[0][-1] == pytest.approx(moved, abs=1e-5)


def test_samples_that_differ_in_number_count_by_their_share(task, tmp_path):
    table = straight(task, 2)
    table = table[(table["track_id"] != 5) | (table["sample"] == 0)]
    handed = read_hand_in(hand_in(tmp_path, task, table), task)
    assert not handed.samples.alike and np.allclose(np.bincount(
        np.repeat(np.arange(24), np.diff(handed.samples.first)), handed.samples.probability), 1)  # fmt: skip
    assert read_hand_in(hand_in(tmp_path, task, straight(task, 2)), task).samples.alike


# --- refused, with file, row, value and remedy ----------------------------------------------------------------------


def change(column, value, at=10):
    def changed(table):
        table[column] = table[column].astype(object)
        table.loc[at, column] = value
        return table

    return changed


def shares(first, second):
    return lambda table: table.assign(probability=table["sample"].map({0: first, 1: second}))


BAD = {
    "probabilities": (shares(0.5, 0.6), ["row 2: the probabilities of track 0 sum to 1.1", "divide them by their sum"]),
    "negative": (shares(-0.5, 1.5), ["row 2: probability -0.5 of sample 0 of track 0 is not from 0 to 1"]),
    "differing": (
        lambda table: change("probability", 0.4, 3)(shares(0.5, 0.5)(table)),
        ["row 5: probability 0.4 differs from that in the first row of sample 0 of track 0"],
    ),
    "nan": (change("x", np.nan), ["row 12: x is empty or NaN", "leave a row out"]),
    "inf": (change("y", "inf"), ["row 12: y inf is no finite number"]),
    "text": (change("x", "3,5 m"), ["row 12: x '3,5 m' is not a number"]),
    "twice": (
        lambda table: pd.concat([table, table.iloc[[4]]]),
        ["row 386: sample 0 of track 0 has step 5 twice, first in row 6; keep one"],
    ),
    "hole": (lambda table: table.drop(4), ["row 6: sample 0 of track 0 has step 6, but no step 5"]),
    "before t0": (
        lambda table: table.assign(step=table["step"] - 1),
        ["row 2: step 0: a future begins one time step after t0", "leave out what was observed"],
    ),
    "long before t0": (change("step", -3), ["row 12: step -3: a future begins one time step after t0"]),
    "half a step": (change("step", 2.5), ["row 12: step 2.5 is no whole number"]),
    "sample": (change("sample", -1), ["row 12: sample -1 is no whole number from 0"]),
    "longer": (
        lambda table: pd.concat([table, table.iloc[[7]].assign(step=9)]),
        ["track 0, from row 2 on, has step 9: the task's horizon is 8 steps of 1 s, 8 s"],
    ),
    "shorter": (
        lambda table: table[table["step"] < 6],
        ["no sample has a step beyond 5: the task's horizon is 8 steps of 1 s, 8 s; forecast up to it"],
    ),
    "clock instead of seconds": (
        lambda table: table.assign(t=1.35e9 + table["step"]).drop(columns="step"),
        ["row 2: t 1350000001: t is in seconds after t0", "looks like a clock's time: take that of t0 off"],
    ),
    "other steps": (
        lambda table: table.assign(t=table["step"] * 0.4).drop(columns="step"),
        ["row 2: t 0.4 is no multiple of the time step, 1 s", "interpolate"],
    ),
    "unknown track": (
        lambda table: table.replace({"track_id": {23: 24}}),
        ["row 370: track_id 24 is not in the task; its tracks are 0 to 23"],
    ),
    "ids of another kind": (
        lambda table: table.assign(track_id="P" + table["track_id"].astype(str)),
        ["row 2: track_id P0 is not in the task; its tracks are 0 to 23, as in its observations"],
    ),
    "ids with a point": (
        lambda table: table.assign(track_id=table["track_id"].astype(float)),
        ["row 2: track_id 0.0 is not in the task", "; write 0, as there"],
    ),
    "ids with zeros before them": (
        lambda table: table.assign(track_id="00" + table["track_id"].astype(str)),
        ["row 2: track_id 000 is not in the task", "; write 0, as there"],
    ),
    "a column without a value": (
        lambda table: table.assign(probability=np.nan),
        ["probability is empty or NaN in every row; fill it in, or leave the column out"],
    ),
    "clock": (lambda table: table.assign(t0=1.3e9), ["row 2: t0 1300000000: in a task t0 is 0"]),
    "column": (lambda table: table.rename(columns={"sample": "smaple"}), ["no column named 'smaple'", "'sample'"]),
    "no position": (lambda table: table.drop(columns="y"), ["no column y; it has track_id, sample, step, x"]),
    "neither step nor t": (lambda table: table.drop(columns="step"), ["one of the columns step and t is needed"]),
    "both, which differ": (
        lambda table: table.assign(t=2 * table["step"]),
        ["row 2: t 2 s is not step 1 of 1 s; leave"],
    ),
    "empty": (lambda table: table.iloc[:0], ["it has no forecasts"]),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_tables(task, tmp_path, name):
    spoil, told = BAD[name]
    folder = hand_in(tmp_path, task, spoil(straight(task, 2)))
    with pytest.raises(DataError) as error:
        read_hand_in(folder, task)
    for part in ("f.csv", *told):
        assert part in str(error.value)


def test_a_line_that_is_cut_off(task, tmp_path):
    folder = hand_in(tmp_path, task, straight(task))
    text = (folder / "f.csv").read_text().splitlines()
    (folder / "f.csv").write_text("\n".join([*text[:7], text[7][:5]]))
    with pytest.raises(DataError, match=r"f\.csv, row 8: 3 fields where the header has 5"):
        read_hand_in(folder, task)


@pytest.mark.parametrize(
    ("sheet", "told"),
    [
        ({"task": "0123"}, ["f.json: task '0123' is another than that of hall here", "export the task again"]),
        ({"path": "best"}, ["f.json", "path: 'best' is not one of 'likeliest', 'mean' or 'geometric_median'"]),
        ({"pth": "mean"}, ["f.json", "unknown key 'pth', did you mean 'path'?"]),
        ({"path": None}, ["up to 2 samples of a track; say how one path comes out of them"]),
    ],
)
def test_bad_sheets(task, tmp_path, sheet, told):
    folder = hand_in(tmp_path, task, straight(task, 2), sheet=sheet)
    with pytest.raises(DataError) as error:
        read_hand_in(folder, task)
    for part in told:
        assert part in str(error.value)


def test_a_folder_with_something_else(task, tmp_path):
    with pytest.raises(DataError, match=r"no such folder; it holds forecasts such as .*nowhere/forecasts\.csv"):
        read_hand_in(tmp_path / "nowhere", task)
    folder = hand_in(tmp_path / "two", task, straight(task))
    straight(task).to_parquet(folder / "f.parquet")
    with pytest.raises(DataError, match=r"there is f\.csv and f\.parquet"):
        read_hand_in(folder, task)
    (folder / "f.json").unlink()
    with pytest.raises(DataError, match=r"a JSON file of the same name beside it.* there is no such pair"):
        read_hand_in(folder, task)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ('{"track": {"f": 3, "p": 0, "x": 1, "y": 1, "prediction_number": 0, "scene_id": 0}}',
         "frame 3: the future of scene 0 begins one frame after t0 and lasts 8 frames, from 4 to 11"),
        ('{"track": {"f": 12, "p": 0, "x": 1, "y": 1, "prediction_number": 0, "scene_id": 0}}', "frame 12"),
        ('{"track": {"f": 4, "p": 0, "x": NaN, "y": 1, "prediction_number": 0, "scene_id": 0}}', "NaN"),
        ('{"track": {"f": 4, "p": 0, "x": "1", "y": 1, "prediction_number": 0, "scene_id": 0}}', "x '1' of a predic"),
        ('{"track": {"f": 4, "p": 0, "y": 1, "prediction_number": 0, "scene_id": 0}}', "x None of a prediction"),
        ("{track}", "'{track}' is no JSON object"),
        ('{"track": {"f": 4, "p": 0, "x": 1, "y": 1, "prediction_number": 0, "scene_id": 1e300}}', "1e+300 is not the"),
        ('{"track": {"f": 4, "p": 0, "x": 1, "y": 1, "prediction_number": 0, "scene_id": -1}}', "-1 is not the number"),
    ],
)  # fmt: skip
def test_bad_predictions(task, tmp_path, line, told):
    write_hand_in(tmp_path, task, {name: cvm(name) for name in DAYS}, "ndjson")
    file = tmp_path / "forecasts.ndjson"
    file.write_text(line + "\n" + file.read_text())
    with pytest.raises(DataError) as error:
        read_hand_in(tmp_path, task)
    assert "forecasts.ndjson, row 1: " in str(error.value) and told in str(error.value)


def test_predictions_of_nobody_whom_the_task_asks_for(task, tmp_path):
    """Every line is of a person with another number than the scene's."""
    write_hand_in(tmp_path, task, {name: cvm(name) for name in DAYS}, "ndjson")
    file = tmp_path / "forecasts.ndjson"
    file.write_text(re.sub(r'"p": \d+', '"p": 99', file.read_text()))
    with pytest.raises(DataError, match=r"row 2: p 99 of a prediction for scene 0, and likewise all: .* p = scene_id"):
        read_hand_in(tmp_path, task)


def test_columns_that_no_commas_separate(task, tmp_path):
    folder = hand_in(tmp_path, task, straight(task))
    (folder / "f.csv").write_text((folder / "f.csv").read_text().replace(",", ";"))
    with pytest.raises(DataError, match=r"f.csv: one column named 'track_id;.*separated by commas here, not by ';'"):
        read_hand_in(folder, task)


# --- the forms ------------------------------------------------------------------------------------------------------


def test_predictions_are_what_the_evaluator_of_trajnet_expects(task, tmp_path):
    """Frames of the first prediction are those after the observed ones, in order; others' rows do not count."""
    write_task(task, tmp_path, "ndjson")
    write_hand_in(tmp_path, task, {name: cvm(name) for name in DAYS}, "ndjson")
    seen, predicted = ([json.loads(line) for line in (tmp_path / f"{name}.ndjson").read_text().splitlines()]
                       for name in ("observations", "forecasts"))  # fmt: skip
    scenes = {one["scene"]["id"]: one["scene"] for one in seen if "scene" in one}
    assert {one["scene"]["id"]: one["scene"] for one in predicted if "scene" in one} == scenes
    assert len(scenes) == 24 and scenes[3]["e"] - scenes[3]["s"] == SEEN + STEPS - 1
    for number, scene in scenes.items():
        frames = [one["track"]["f"] for one in seen if "track" in one and one["track"]["p"] == number]
        future = [one["track"]["f"] for one in predicted if "track" in one and one["track"]["scene_id"] == number]
        assert [*frames, *future] == list(range(scene["s"], scene["e"] + 1))
    with (tmp_path / "forecasts.ndjson").open("a") as file:
        other = {"f": 4, "p": 99, "x": 1.0, "y": 1.0, "prediction_number": 0, "scene_id": 0}
        file.write(json.dumps({"track": other}) + "\n\n")
    assert len(read_hand_in(tmp_path, task).missing) == 0


def futures(output, n=3, k=4, steps=5):
    rng = np.random.default_rng(0)
    alive = rng.integers(1, steps + 1, (n, k)).astype(np.int32)
    alive[:, 0] = steps
    xy = rng.normal(size=(n, k, steps, 2)).astype(np.float32)
    xy = np.take_along_axis(xy, np.minimum(np.arange(steps), alive[..., None] - 1)[..., None], axis=2)
    return Forecast(xy, np.cumsum(rng.normal(size=(n, k, steps)), axis=2).astype(np.float32), alive, output)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_futures_come_back_from_the_long_form(tmp_path, suffix):
    """Every position to the bit, where each ended, whose and from when; ids as text, moments of a clock."""
    made, t0 = futures("mean"), np.array([1.3e9 + 0.25, 1.3e9 + 7.125, 1.3e9 + 9])
    table = long_table(np.array([5, 6, 7]), t0, made, {6: "P 06"})
    path = tmp_path / f"f.{suffix}"
    if suffix == "csv":
        table.to_pandas().to_csv(path, index=False)
    else:
        pq.write_table(table, path)
    found = read_samples(path, 1.0)
    names = [found.name(place) for place in range(3)]
    which = np.array([names.index(name) for name in ("5", "P 06", "7")])
    np.testing.assert_array_equal(found.t0[which], t0)
    again = forecast_of(found, which, np.zeros((3, 2)), 5, "likeliest")
    np.testing.assert_array_equal(again.xy, made.xy)
    np.testing.assert_array_equal(again.steps_alive, made.steps_alive)


def test_ranked_futures_are_written_in_the_order_of_their_ranks():
    made = futures("ranked")
    table = long_table(np.arange(3), np.zeros(3), made).to_pandas()
    for row in range(3):
        first = table[(table["track_id"] == row) & (table["sample"] == 0)]
        lived = made.steps_alive[row]
        best = max(np.flatnonzero(lived == lived.max()), key=lambda one: made.log_fitness[row, one, -1])
        np.testing.assert_array_equal(first[["x", "y"]].to_numpy(np.float32), made.xy[row, best, : lived[best]])


def test_modes_are_written_with_their_probabilities():
    made = futures("modes", k=MODES)
    shares = np.array([0.5, 0.3, 0.2, 0.0, 0.0])
    with np.errstate(divide="ignore"):
        fitness = np.log(np.broadcast_to(shares[:, None], (3, MODES, 5))).astype(np.float32)
    alive = np.where(shares > 0, 5, 0).astype(np.int32) * np.ones((3, 1), np.int32)
    table = long_table(np.arange(3), np.zeros(3), made._replace(log_fitness=fitness, steps_alive=alive)).to_pandas()
    of_first = table[(table["track_id"] == 0) & (table["step"] == 1)]
    np.testing.assert_allclose(of_first["probability"], shares[:3], rtol=1e-6)


def test_tables_of_arrow_are_what_they_say(task, tmp_path):
    """Observations as Parquet carry the task's hash in their metadata; columns as in CSV."""
    write_task(task, tmp_path, "parquet")
    table = pq.read_table(tmp_path / "observations.parquet")
    assert table.schema.names == ["track_id", "t", "x", "y"] and table.schema.field("x").type == pa.float64()
    assert task.about["task"] in str(table.schema.metadata)


def test_tracks_as_trajnet_lines_are_read_as_they_were(tmp_path, task):
    """By the library's own reader, on the grid of time steps."""
    from modlhmp import read_tracks  # noqa: PLC0415

    whole = WALKS._replace(t=np.rint(WALKS.t))
    write_task(task, tmp_path, "ndjson", training=[whole])
    read = read_tracks(tmp_path / "training.ndjson", reader="trajnet")
    assert isinstance(read, Tracks)
    np.testing.assert_allclose(np.column_stack([read.x, read.y]), np.column_stack([whole.x, whole.y]), atol=1e-9)


def lines_of(file):
    """Frame, person, x and y of every position of a file of TrajNet++."""
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    return pd.DataFrame([line["track"] for line in lines if "track" in line])


def test_trajnet_lines_are_at_whole_steps_of_each_track(tmp_path, task):
    """A track half a step off, with a row that is missing and a last one that is early; and one with a long gap."""
    t = np.array([0.0, 1, 2, 0.5, 1.5, 3.5, 4.5, 5.1, 0, 1, 21, 22])
    who = np.repeat([0, 1, 2], [3, 5, 4])
    unknown = np.full(12, np.nan)
    write_task(task, tmp_path, "ndjson", training=[Tracks(who, 1.3e9 + t, 1.0 * t, 0.0 * t, unknown, unknown)])
    found = lines_of(tmp_path / "training.ndjson")
    assert not found.duplicated(["p", "f"]).any()
    second, third = (found[found["p"] == one] for one in (1, 2))
    assert second["f"].diff().dropna().eq(1).all()
    np.testing.assert_allclose(second["x"], [0.5, 1.5, 2.5, 3.5, 4.5], atol=1e-6)
    assert third["f"].tolist() == [0, 1, 21, 22]


def test_observed_trajnet_lines_are_at_whole_steps(tmp_path):
    """A row is missing, which is no run: everyone walks at 1 m/s, and is where they are at t0."""
    t = np.array([0.0, 1, 3, 4, 5, 6, 7])
    unknown = np.full(7, np.nan)
    walk = Tracks(np.zeros(7, int), 1.3e9 + t, 1.0 * t, 0.0 * t, unknown, unknown)
    one = task_of({"monday": walk})
    write_task(one, tmp_path, "ndjson")
    found = lines_of(tmp_path / "observations.ndjson")
    assert found["f"].tolist() == list(range(SEEN)) and one.observed.x[0, -1] == found["x"].iloc[-1]
    np.testing.assert_allclose(found["x"].diff().dropna(), 1, atol=1e-6)


@pytest.mark.real
def test_a_real_recording_with_another_time_step(real_data, load_shipped, tmp_path):
    """ETH's hotel, 12 steps of 0.4 s: every track once, our own forecasts back to the bit."""
    hotel = load_shipped("hotel", real_data)
    days = {one.name: clean(hotel, one) for one in hotel.of_split("test")}
    task = make_task(((name, one, None, None) for name, one in days.items()), hotel, "hotel")
    assert task.about["time_step_s"] == 0.4 and task.about["tasks"] > 50
    assert np.abs(task.observed.t[:, -1]).max() == 0 and len(np.unique(task.observed.x, axis=0)) > 50
    made = {
        name: list(
            forecast_recording(one, forecaster(None, hotel, ConstantVelocity()), hotel, ("h", "c", name), 1, [0])
        )
        for name, one in days.items()
    }
    write_hand_in(tmp_path, task, made)
    handed = read_hand_in(tmp_path, task)
    for name, forecasts in made.items():
        for (_, _, one), (_, _, other) in zip(forecasts, handed.forecasts(name), strict=True):
            np.testing.assert_array_equal(one.xy, other.xy)
