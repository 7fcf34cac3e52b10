"""The library's front door: what a notebook or a robot imports."""

import dataclasses
import json
import logging
import re
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

import modlhmp
from modlhmp import DataError, Site
from modlhmp.contract import SITE, crowd
from modlhmp.forecasting.base import OUTPUTS, Forecast
from modlhmp.forecasting.ranking import rank_order
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.kinds import find
from modlhmp.methods import make_forecaster
from modlhmp.options import Episodes, Pooled, RollOut, Snippets
from modlhmp.scoring.recording import score_recording
from modlhmp.site import IdleFilter, PaperProtocol
from modlhmp.storage import write_parquet
from modlhmp.tracks import usable_tracks, write_tracks

PEOPLE = crowd()
MAPS = ("cliff", "tc_cliff", "stef", "episodes", "snippets", "pooled")
FEW = {"episodes": {"persons": 3}}
OPTIONS = {"episodes": Episodes(), "snippets": Snippets(k=20), "pooled": Pooled(k=20)}


def seen(tracks, rows=4):
    """The first rows of every track: what a walker's history is in the workflow."""
    first = tracks.bounds()[:-1]
    return tracks.take((first[:, None] + np.arange(rows)).ravel())


@pytest.fixture(scope="module")
def maps():
    """A map of every kind, of the same people."""
    return {kind: modlhmp.build_map(kind, PEOPLE, SITE) for kind in MAPS}


def refused(message, call, *arguments, **named):
    with pytest.raises(DataError, match=message):
        call(*arguments, **named)


# --- the package itself ----------------------------------------------------------------------------------------------


def test_it_offers_about_a_dozen_documented_names():
    assert 10 <= len(modlhmp.__all__) <= 15
    for name in modlhmp.__all__:
        assert getattr(modlhmp, name).__doc__, name
    assert set(dir(modlhmp)) == {*modlhmp.__all__, "__version__"}
    with pytest.raises(AttributeError, match="forcast"):
        modlhmp.forcast  # noqa: B018


def test_importing_it_loads_nothing_else():
    heavy = "{'numpy', 'numba', 'pyarrow', 'pydantic'}"
    code = f"import sys; import modlhmp; print(sorted({{n.split('.')[0] for n in sys.modules}} & {heavy}))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


# --- tracks ----------------------------------------------------------------------------------------------------------


CSV = "person;time;x;y\n" + "".join(f"{p};{1000 * k};{120 * k};{50 * p}\n" for p in (1, 2) for k in range(9))
NAMED = {"columns": {"track_id": "person", "t": "time", "x": "x", "y": "y"}, "separator": ";"}


def test_any_file_by_columns_and_units(write):
    tracks = modlhmp.read_tracks(write(CSV), **NAMED, units={"time": "ms", "length": "cm"})
    assert np.diff(tracks.bounds()).tolist() == [9, 9]
    np.testing.assert_allclose(tracks.x[:3], [0, 1.2, 2.4])
    np.testing.assert_allclose(tracks.t[:3], [0, 1, 2])


def test_a_day_and_its_clock(write):
    path = write(CSV)
    tracks = modlhmp.read_tracks(path, **NAMED, units={"time": "ms", "length": "cm"}, day="2026-03-02", start="09:00")
    assert tracks.t[0] == 1772442000.0
    refused("say the `day`", modlhmp.read_tracks, path, **NAMED, start="09:00")
    for day in ("2026-03-02T05:00", "20260302", "2026-02-30"):
        refused("day .* date", modlhmp.read_tracks, path, **NAMED, day=day)
    for start in ("09:00-11:00", "09:00+05:00", "nine", 9):
        refused("start .*(clock time|offset)", modlhmp.read_tracks, path, **NAMED, day="2026-03-02", start=start)
    for day in (None, "2026-03-02"):
        refused("leave it out", modlhmp.read_tracks, path, **NAMED, units={"time": "iso"}, day=day, start="01:00")


def test_a_clean_recording_and_a_dataset_file(write, tmp_path):
    write_tracks(PEOPLE, tmp_path / "clean.parquet")
    for ours, theirs in zip(modlhmp.read_tracks(tmp_path / "clean.parquet"), PEOPLE, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    write(CSV, "a.csv")
    write(CSV + CSV.splitlines()[-1], "b.csv")  # a row twice: files with the same bytes are refused
    dataset = write(
        "title: Mine\nreader: delimited\ntimezone: Europe/London\nhours: [8, 18]\nheader: true\nseparator: ';'\n"
        "columns: {track_id: person, t: time, x: x, y: y}\nunits: {time: ms, length: cm}\nrecordings:\n"
        "  - {files: a.csv, day: 2020-03-02, start: '08:00', split: train}\n"
        "  - {files: b.csv, day: 2020-03-03, start: '08:00', split: test}\n"
        "horizon_s: 5\nvelocity: differences\ncitation: nobody\nterms: free\n",
        "mine.yaml",
    )
    assert len(modlhmp.read_tracks(dataset).bounds()) - 1 == 4
    assert len(modlhmp.read_tracks(dataset, split="test").bounds()) - 1 == 2


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("1,oops,5,0", "1 of 12 rows are faulty and dropped: 1 text_value (first: row 7: '1,oops,5,0')"),
        ("1,5,5,", "1 of 12 rows are faulty and dropped: 1 nan_value (first: row 7: track_id 1, t 5, x 5, y nan"),
        ("1,5,inf,0", "1 of 12 rows are faulty and dropped: 1 infinite_value (first: row 7: track_id 1, t 5, x inf"),
        ("1,5,5", "1 of 12 rows are faulty and dropped: 1 wrong_column_count (first: row 7: '1,5,5')"),
        ("1,5,5e9,0", "1 of 12 rows are faulty and dropped: 1 absurd_value (first: row 7: track_id 1, t 5, x 5e+09"),
        ("-1,5,5,0", "1 of 12 rows are nobody's by their id and dropped: 1 no_person (first: row 7: track_id -1"),
        ("1,86400,5,0", "1 of 12 rows are of another day and dropped: 1 outside_day (first: row 7: track_id 1, t 8"),
        (",5,5,0", "1 of 12 rows are faulty and dropped: 1 no_track_id (first: row 7: track id is empty)"),
        ("1,5,5,0", None),
    ],
)
def test_faulty_rows_are_told(write, caplog, row, told):
    rows = [f"1,{t},{t},0" for t in range(12)]
    rows[5] = row
    path = write("p,t,x,y\n" + "\n".join(rows))
    modlhmp.read_tracks(path, columns={"track_id": "p", "t": "t", "x": "x", "y": "y"}, day="1970-01-01")
    messages = [one.getMessage() for one in caplog.records]
    assert len(messages) == (told is not None) and all(one.startswith(f"{path}: {told}") for one in messages)


@pytest.mark.parametrize("late", [30, 90])
def test_rows_after_midnight_are_told_once(write, caplog, late):
    """By the check where they are many, and with their number and the first one where they are few."""
    rows = [f"{who},{86400 - 40 + n},{1.2 * n},{who}" for who in range(30) for n in range(20)]
    rows += [f"x{n // 10},{86400 + n % 10},{n % 10},0" for n in range(late)]
    path = write("p,t,x,y\n" + "\n".join(rows))
    modlhmp.read_tracks(path, columns={"track_id": "p", "t": "t", "x": "x", "y": "y"}, day="1970-01-01")
    told = [one.getMessage() for one in caplog.records if "outside_day" in one.getMessage()]
    assert len(told) == 1
    assert ("30 of 630 rows are of another day and dropped" in told[0]) == (late == 30)


@pytest.mark.parametrize(
    ("form", "message"),
    [
        ({}, "say which `columns`"),
        ({"columns": {"track_id": 0, "t": 1, "x": 2}}, "'y'"),
        ({"reader": "edinburgh"}, "reader 'edinburgh' needs the key 'frame_rate'"),
        ({**NAMED, "units": {"length": "px"}}, "units in 'px' need the key 'scale'"),
        ({**NAMED, "timezone": "Mars"}, "timezone 'Mars' is unknown"),
        ({"colums": {}}, "unknown key 'colums', did you mean 'columns'"),
        ({**NAMED, "units": {"length": "inch"}}, "'inch' is not one of"),
        ({**NAMED, "columns": {**NAMED["columns"], "x": "px"}}, "row 1: no column 'px' for x"),
    ],
)
def test_a_file_that_is_described_wrongly(write, form, message):
    refused(message, modlhmp.read_tracks, write(CSV), **form)


# --- maps ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", MAPS)
def test_a_map_is_saved_and_loaded(maps, tmp_path, kind):
    found: list[str] = []
    for name in ("a_map", "a_map.parquet", "v1.2"):
        path = tmp_path / name
        maps[kind].save(path)
        assert sorted(file.name for file in tmp_path.iterdir()) == sorted({path.name, *found}), "and nothing beside it"
        found.append(name)
    again = modlhmp.load_map(path)
    assert (again.whole is None) == (maps[kind].whole is None)
    assert (again.kind, again.site) == (kind, SITE)
    assert again.hours.keys() == maps[kind].hours.keys()
    history = seen(PEOPLE)
    ours, theirs = (modlhmp.forecast(one, history, **FEW.get(kind, {"k": 3})) for one in (maps[kind], again))
    np.testing.assert_array_equal(ours.paths, theirs.paths)


@pytest.mark.parametrize("kind", [name for name in MAPS if find(name).hourly])
@pytest.mark.parametrize("parts", [("whole",), ("hours",), ("whole", "hours")])
def test_any_part_of_a_map_by_hours_is_a_map(maps, tmp_path, kind, parts):
    """The whole day alone, as few people leave it, one hour alone, or both; never a day and hours of two maps."""
    ours = modlhmp.Map(kind, SITE, maps[kind].whole if "whole" in parts else None,
                       {8: maps[kind].hours[8]} if "hours" in parts else {})  # fmt: skip
    ours.save(tmp_path / "map")
    again = modlhmp.load_map(tmp_path / "map")
    assert (again.kind, again.hours.keys(), again.whole is None) == (kind, ours.hours.keys(), ours.whole is None)
    history = seen(PEOPLE)
    given = {"k": 3} if ours.whole is None else {"k": 3, "without_map": "whole_day"}
    np.testing.assert_array_equal(*(modlhmp.forecast(one, history, **given).paths for one in (ours, again)))
    if len(parts) > 1:
        other = modlhmp.Map(kind, dataclasses.replace(SITE, timezone="UTC"), maps[kind].whole, {})
        other.save(tmp_path / "other")
        (tmp_path / "other/day.parquet").rename(tmp_path / "map/day.parquet")
        refused("day.parquet: it is of another map", modlhmp.load_map, tmp_path / "map")
    refused("without a table; give `whole`, `hours` or both", modlhmp.Map, kind, SITE, None, {})


def test_few_people_make_a_map_of_the_whole_day_alone(tmp_path):
    apart = 3600.0 * (PEOPLE.track_id % 8)
    few = PEOPLE._replace(t=PEOPLE.t + apart).take(PEOPLE.track_id < 8)
    ours = modlhmp.build_map("tc_cliff", few, dataclasses.replace(SITE, hours=None))
    assert ours.whole.num_rows and not ours.hours
    for name, form in (("map", {}), ("xml", {"form": "xml"})):
        ours.save(tmp_path / name, **form)
        again = modlhmp.load_map(tmp_path / name, **({"site": ours.site, **form} if form else {}))
        assert (again.kind, again.whole.num_rows, again.hours) == ("tc_cliff", ours.whole.num_rows, {})


@pytest.mark.parametrize("kind", ["tc_cliff", "stef"])
def test_hours_without_any_data_are_refused(kind):
    """As where a time zone is wrong: the map of the hours that are asked for would be of nobody."""
    night = dataclasses.replace(SITE, hours=(22, 3))
    refused(
        r"tracks are of the hours 7, 8 of Europe/London, .*`hours` \[22, 3\] have none",
        modlhmp.build_map,
        kind,
        PEOPLE,
        night,
    )


def test_hours_are_those_of_the_training_data(maps):
    free = dataclasses.replace(SITE, hours=None)
    assert list(modlhmp.build_map("tc_cliff", PEOPLE, free).hours) == [7, 8]
    assert list(modlhmp.build_map("stef", PEOPLE, free).hours) == [7, 8]
    chosen = modlhmp.build_map("tc_cliff", PEOPLE, dataclasses.replace(SITE, hours=(8, 10)))
    assert list(chosen.hours) == [8], "an hour without data has no map"


@pytest.mark.parametrize("kind", ["tc_cliff", "stef"])
def test_in_an_hour_without_a_map_the_whole_day_s_may_serve(maps, tmp_path, kind):
    maps[kind].save(tmp_path / "map")
    at_night = seen(PEOPLE._replace(t=PEOPLE.t + 12 * 3600.0))
    for a_map in (maps[kind], modlhmp.load_map(tmp_path / "map")):
        assert modlhmp.forecast(a_map, at_night).left(1).min() == 1, "it stops at once"
        assert modlhmp.forecast(a_map, at_night, without_map="whole_day").left(1).mean() < 0.5
    hour, day = (modlhmp.forecast(maps[kind], seen(PEOPLE), without_map=one) for one in ("stop", "whole_day"))
    np.testing.assert_array_equal(hour.paths, day.paths)
    alone = modlhmp.Map(kind, SITE, None, maps[kind].hours)
    refused("has no map of the whole day", modlhmp.forecast, alone, at_night, without_map="whole_day")


def test_a_part_of_a_map_is_refused(maps, tmp_path):
    maps["tc_cliff"].save(tmp_path / "hours")
    refused("give the folder", modlhmp.load_map, next((tmp_path / "hours").iterdir()))
    (tmp_path / "day").mkdir()
    maps["cliff"].save(tmp_path / "day/09.parquet")
    refused("kind cliff is one file", modlhmp.load_map, tmp_path / "day")
    refused("a folder is there", maps["cliff"].save, tmp_path / "day")
    refused("a file is there", maps["stef"].save, tmp_path / "day/09.parquet")


@pytest.mark.parametrize(
    "site", [3, "UTC", {}, [], Site(time_step_s=0), Site(time_step_s="a"), Site(observed_rows=1),
             Site(velocity="columns"), Site(horizon_s=-1), Site(paper_protocol=3), Site(difference_weights=[])],
)  # fmt: skip
def test_what_is_no_site(site):
    refused("site", modlhmp.build_map, "cliff", PEOPLE, site)
    refused("site", modlhmp.forecast, "cvm", STRAIGHT, site=site)


def test_a_map_keeps_its_site(maps):
    refused("leave it out", modlhmp.forecast, maps["cliff"], seen(PEOPLE), site=Site(time_step_s=0.4))


@pytest.mark.parametrize("exits", ["a", 3, [], np.array([1, 2])])
def test_what_is_no_way_out(maps, exits):
    refused("give True, False", modlhmp.forecast, maps["snippets"], seen(PEOPLE), exits=exits)


def test_a_map_is_shown_in_a_line(maps):
    """Also where it is the wrong one: its kind and size, not its tables."""
    shown = repr(maps["cliff"])
    assert len(shown) < 120 and re.search(
        rf"cliff, {maps['cliff'].whole.num_rows} rows, a step 1 s, Europe/London", shown
    )
    assert "hours 9 10" in repr(modlhmp.Map("tc_cliff", SITE, None, dict.fromkeys((9, 10), maps["cliff"].whole)))
    refused(f"exits {shown}: give True, False", modlhmp.forecast, maps["snippets"], seen(PEOPLE), exits=maps["cliff"])


@pytest.mark.parametrize("name", modlhmp.Tracks._fields)
@pytest.mark.parametrize(
    "wrong", [list, lambda of: None, lambda of: of[:-1], lambda of: of.astype(str), lambda of: of[:, None]]
)
def test_tracks_made_by_hand_are_checked(name, wrong):
    made = PEOPLE._replace(**{name: wrong(getattr(PEOPLE, name))})
    refused("column", modlhmp.build_map, "cliff", made)
    refused("column", modlhmp.forecast, "cvm", made)


def test_tracks_of_one_row_each_are_no_map():
    refused("times in the unit", modlhmp.build_map, "snippets", PEOPLE._replace(track_id=np.arange(len(PEOPLE.t))))
    refused("a position is not a number", modlhmp.build_map, "cliff", PEOPLE._replace(x=np.full(len(PEOPLE.t), np.nan)))


def test_a_map_without_its_metadata_is_refused(maps, tmp_path):
    """Not read at 1 m and at 1 s."""
    path = tmp_path / "cliff.parquet"
    maps["cliff"].save(path)
    table = pq.read_table(path)
    pq.write_table(table.replace_schema_metadata({b"resolution": b"1.0"}), path)
    refused("lacks its kind and its site", modlhmp.load_map, path)
    write_parquet(table.replace_schema_metadata(None), path, **json.loads(table.schema.metadata[b"modlhmp"]))
    refused("no metadata resolution", modlhmp.forecast, modlhmp.load_map(path), seen(PEOPLE))


@pytest.mark.parametrize(
    ("arguments", "named", "message"),
    [
        (("clif", PEOPLE), {}, "did you mean 'cliff'"),
        (("cvm", PEOPLE), {}, "is not a map; maps are cliff"),
        (("cliff", PEOPLE), {"resolution": 2}, "unknown key 'resolution', did you mean 'resolution_m'"),
        (("cliff", PEOPLE), {"resolution_m": -1}, "resolution_m"),
        (("cliff", np.zeros((3, 3))), {}, "give modlhmp.Tracks"),
        (("snippets", "monday.csv"), {}, "tracks are str; .*: read 'monday.csv' with read_tracks first"),
        ((PEOPLE, "snippets"), {}, r"^kind: Tracks given; the kind comes first: build_map\('cliff', tracks\)$"),
        (("CLiFF", PEOPLE), {}, "did you mean 'cliff'"),
        (("zzz", PEOPLE), {}, "known: cliff, .*, snippets, pooled, exits; is the package"),  # no networks
        (("cliff", PEOPLE, Site(time_step_s=0.4)), {}, "a row every 1 s, the site's time_step_s is 0.4"),
        (("cliff", PEOPLE._replace(t=PEOPLE.t[::-1])), {}, "sort by track, then time"),
    ],
)
def test_a_map_that_cannot_be_built(arguments, named, message):
    refused(message, modlhmp.build_map, *arguments, **named)


@pytest.mark.parametrize("path", [None, 3, [1]])
def test_what_is_no_path(maps, path):
    for call in (modlhmp.load_map, modlhmp.read_tracks, maps["snippets"].save):
        refused("give a file's path", call, path)


@pytest.mark.parametrize("name", ["a.csv", "a.txt", "a.yaml", "a.parquet"])
def test_a_folder_is_no_recording(tmp_path, name):
    (tmp_path / name).mkdir()
    form = {"columns": dict(zip(("track_id", "t", "x", "y"), range(4), strict=True))}
    form = form if name in {"a.csv", "a.txt"} else {}
    refused(f"^{tmp_path / name}: a folder; name a file in it$", modlhmp.read_tracks, tmp_path / name, **form)


def test_a_folder_without_a_map(tmp_path):
    refused("a folder without a map", modlhmp.load_map, tmp_path)
    refused("no such file", modlhmp.load_map, tmp_path / "nothing.parquet")


# --- forecasts -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", MAPS)
def test_a_forecast_is_the_workflow_s_to_the_bit(maps, tmp_path, kind):
    """With its key; a walker alone as well as among all."""
    maps[kind].save(tmp_path / "map")
    options, key = OPTIONS.get(kind, RollOut()), ("hall", kind, "day1")
    forecaster = make_forecaster(kind, options, SITE, tmp_path / "map")
    history, k = seen(PEOPLE), getattr(options, "k", None)
    ((_, ids, expected),) = forecast_recording(PEOPLE, forecaster, SITE, key, k or 1, [2])
    got = modlhmp.forecast(maps[kind], history, seed=2, k=k, key=key)
    np.testing.assert_array_equal(got.track_id, ids)
    for ours, theirs in zip(got.forecast[:3], expected[:3], strict=True):
        np.testing.assert_array_equal(ours, theirs)
    alone = history.take(history.track_id == 7)
    np.testing.assert_array_equal(modlhmp.forecast(maps[kind], alone, seed=2, k=k, key=key).best[0], got.best[7])


def test_shapes_and_who_is_still_there(maps):
    futures = modlhmp.forecast(maps["snippets"], seen(PEOPLE), horizon_s=6, k=12)
    n = len(futures.track_id)
    assert futures.paths.shape == (n, 12, 6, 2)
    assert futures.alive.shape == (n, 12, 6)
    assert futures.best.shape == (n, 6, 2)
    np.testing.assert_array_equal(futures.times_s, np.arange(1, 7))
    left = futures.left(6)
    np.testing.assert_allclose(left, 1 - futures.alive[:, :, 5].mean(axis=1))
    ranked = modlhmp.forecast(maps["cliff"], seen(PEOPLE))
    assert sorted(ranked.ranks[0]) == [0, 1, 2, 3, 4]
    np.testing.assert_array_equal(ranked.best[3], ranked.paths[3, ranked.ranks[3].argmin()])


def usual_and(maps, kind, output):
    """A kind's few futures with its default output, and with this one."""
    few = FEW.get(kind, {"k": 7})
    return [modlhmp.forecast(maps[kind], seen(PEOPLE), **few, **one) for one in ({}, {"output": output})]


@pytest.mark.parametrize("kind", ["tc_cliff", "stef", "cliff"])
def test_hours_whose_time_zone_nobody_said_are_told(caplog, kind):
    caplog.set_level(logging.WARNING, "modlhmp")
    modlhmp.build_map(kind, PEOPLE, SITE)
    assert not caplog.records
    modlhmp.build_map(kind, PEOPLE)
    assert len(caplog.records) == (kind != "cliff")
    assert ("its hours are taken for those of UTC" in caplog.text) == ("modlhmp.Site(timezone=" in caplog.text)


@pytest.mark.parametrize("output", OUTPUTS)
def test_ranks_are_those_of_the_best_path_and_of_the_written_order(output):
    """Of any output that an outside kind may have: the future that ranks first is the best one, or none has a rank."""
    rng, (n, k, steps) = np.random.default_rng(0), (6, 1 if output == "single" else 8, 4)
    xy = rng.normal(size=(n, k, steps, 2)).astype(np.float32)
    given = Forecast(xy, rng.normal(size=(n, k, steps)).astype(np.float32), rng.integers(1, steps, (n, k)), output)
    futures = modlhmp.Futures(np.arange(n), np.zeros(n), np.zeros((n, 2)), given, modlhmp.Site(horizon_s=steps))
    assert futures.ranks.shape == futures.paths.shape[:2]
    if output in {"ranked", "medoid", "likeliest"}:
        np.testing.assert_array_equal(np.sort(futures.ranks), np.tile(np.arange(k), (n, 1)))
        np.testing.assert_array_equal(futures.best, futures.paths[np.arange(n), futures.ranks.argmin(axis=1)])
        np.testing.assert_array_equal(np.take_along_axis(futures.ranks, rank_order(given, steps), 1)[0], np.arange(k))
    else:
        assert not futures.ranks.any()


@pytest.mark.parametrize("kind", ["episodes", "snippets", "pooled", "cliff"])
def test_a_medoid_is_one_of_the_samples(maps, kind):
    """The samples are those of the default output; the best is one of them, and ranks first."""
    median, futures = usual_and(maps, kind, "medoid")
    np.testing.assert_array_equal(futures.paths, median.paths)
    np.testing.assert_array_equal(futures.alive, median.alive)
    rows = np.arange(len(futures.paths))
    np.testing.assert_array_equal(futures.best, futures.paths[rows, futures.ranks.argmin(axis=1)])
    assert modlhmp.score(futures, PEOPLE).output == "medoid"


@pytest.mark.parametrize("kind", ["episodes", "snippets", "pooled", "cliff"])
def test_modes_come_with_probabilities_whatever_the_output(maps, kind):
    usual, futures = usual_and(maps, kind, "modes")
    np.testing.assert_array_equal(futures.paths, usual.paths)
    for ours, theirs in zip(futures.modes, usual.modes, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    paths, probabilities, _ = futures.modes
    assert paths.shape == (len(futures.track_id), 5, 8, 2)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1)
    assert all((best == modes).all(axis=(1, 2)).any() for best, modes in zip(futures.best, paths, strict=True))
    assert modlhmp.score(futures, PEOPLE).output == "modes"
    assert futures.left(8).tolist() == usual.left(8).tolist()


def test_one_path_is_one_mode():
    paths, probabilities, alive = modlhmp.forecast("cvm", STRAIGHT, horizon_s=3).modes
    np.testing.assert_array_equal(paths[0, 0], modlhmp.forecast("cvm", STRAIGHT, horizon_s=3).best[0])
    assert probabilities.tolist() == [[1, 0, 0, 0, 0]]
    assert alive.tolist() == [[3, 0, 0, 0, 0]]


def test_a_density_sums_to_one_around_where_they_may_be(maps):
    futures = modlhmp.forecast(maps["snippets"], seen(PEOPLE), k=100)
    p, (x_low, x_high, y_low, y_high) = futures.density(at_s=4, cell_m=0.25, walker=5)
    assert p.sum() == pytest.approx(1)
    assert p.shape == (round((y_high - y_low) / 0.25), round((x_high - x_low) / 0.25))
    x = x_low + 0.25 * (np.arange(p.shape[1]) + 0.5)
    there = futures.alive[5, :, 3]
    assert (p.sum(axis=0) * x).sum() == pytest.approx(futures.paths[5, there, 3, 0].mean(), abs=0.1)
    fixed = futures.density(4, 0.5, 5, extent=(-20, 20, -5, 5))
    assert fixed.probabilities.shape == (20, 80)
    refused("give a multiple of 1 s from 1 to 8", futures.density, 9, 0.5)
    refused("at_s '4'", futures.density, "4", 0.5)
    refused("cell_m 0: a size", futures.density, 4, 0)
    refused("bandwidth_m nan: a size", futures.density, 4, 0.5, bandwidth_m=float("nan"))
    refused("give larger ones", futures.density, 4, 1e-9)
    refused("there are 80", futures.density, 4, 0.5, walker=80)


def test_a_density_of_a_box_holds_the_share_that_is_in_it(maps):
    """And of one that nobody reaches, nothing."""
    futures = modlhmp.forecast(maps["snippets"], seen(PEOPLE), k=100)
    x = futures.paths[5, futures.alive[5, :, 3], 3, 0]
    middle = np.floor(10 * np.median(x)) / 10
    assert 0 < (x < middle).mean() < 1
    low, high = (futures.density(4, 0.1, 5, extent=(*sides, -20, 20)) for sides in ((-40, middle), (middle, 40)))
    assert low.probabilities.sum() == pytest.approx((x < middle).mean())
    assert low.probabilities.sum() + high.probabilities.sum() == pytest.approx(1)
    nobody = futures.density(4, 0.5, extent=(500, 510, 0, 5.2))
    assert nobody.probabilities.shape == (11, 20)
    assert nobody.probabilities.sum() == 0
    assert nobody.extent == (500, 510, 0, 5.5)


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize(
    ("kind", "moved", "options", "told"),
    [
        ("tc_cliff", {}, {}, ""),
        ("tc_cliff", {"t": 6 * 3600}, {}, r"the map is of the hours 7, 8, .* are of 13 \(Europe/London\)"),
        ("tc_cliff", {"t": 6 * 3600}, {"without_map": "whole_day"}, ""),
        ("cliff", {"t": 6 * 3600}, {}, ""),
        ("cliff", {"x": 100}, {}, r"the map is of .* m, and all walkers are in 9\d.* m: another frame\?"),
        ("cliff", {"y": 7}, {}, "another frame"),
    ],
)
def test_why_nobody_is_known_is_told_once(maps, caplog, live, kind, moved, options, told):
    """A map of other hours, or of another place, of our own making too."""
    some = seen(PEOPLE).take(seen(PEOPLE).track_id < 3)
    some = some._replace(**{name: getattr(some, name) + by for name, by in moved.items()})
    some = some._replace(t=some.t - 40 * some.track_id)  # at one moment
    if live:
        stream = modlhmp.Live(maps[kind], k=2, **options)
        for row in np.lexsort((some.track_id, some.t)):
            stream.see(some.t[row], int(some.track_id[row]), some.x[row], some.y[row])
        known = [stream.forecast().known.any() for _ in range(3)]
    else:
        known = modlhmp.forecast(maps[kind], some, k=2, **options).known
    assert any(known) == (not told)
    messages = [one for one in caplog.messages if "positions alone" not in one]
    assert len(messages) == bool(told)
    assert all(re.search(told, one) for one in messages)


def test_a_place_where_the_map_knows_nobody_is_no_other_place(maps, caplog):
    """Nor is one among several who are known."""
    far = np.stack([STRAIGHT, STRAIGHT]) + np.array([1.3e9, -3, 0])
    far[1, :, 1] += 500
    assert modlhmp.forecast(maps["cliff"], far, k=2).known.tolist() == [True, False]
    assert not caplog.messages


def test_constant_velocity_needs_no_map():
    one = np.column_stack([np.arange(4.0), 1.2 * np.arange(4), np.zeros(4)])
    futures = modlhmp.forecast("cvm", one, horizon_s=3)
    np.testing.assert_allclose(futures.best[0], [[4.8, 0], [6.0, 0], [7.2, 0]], atol=1e-6)
    several = modlhmp.forecast("cvm", np.stack([one, one + np.array([0, 1, 0])]), horizon_s=3)
    np.testing.assert_allclose(several.best[1], futures.best[0] + [1, 0], atol=1e-6)


STRAIGHT = np.column_stack([np.arange(4.0), 1.2 * np.arange(4), np.zeros(4)])


@pytest.mark.parametrize(
    ("arguments", "named", "message"),
    [
        (("cvm", STRAIGHT), {"horizon_s": 2.5}, "horizon_s 2.5: give a multiple of 1 s from 1 to 3600"),
        (("cvm", STRAIGHT), {"horizon_s": 0}, "horizon_s 0"),
        (("cvm", STRAIGHT), {"horizon_s": float("nan")}, "horizon_s nan"),
        (("cvm", STRAIGHT), {"horizon_s": "10"}, "horizon_s '10'"),
        (("cvm", STRAIGHT), {"horizon_s": 60_000}, "horizon_s 60000"),
        (("cvm", STRAIGHT), {"key": "atc"}, "key 'atc': give names"),
        (("cvm", STRAIGHT), {"key": 3}, "key 3: give names"),
        (("cvm", [["a", "b", "c"]] * 4), {}, "history: give numbers"),
        (("cvm", [[[0, 0, 0]], [[1, 0]]]), {}, "history: give numbers"),
        (("cvm", np.full((4, 3), np.nan)), {}, "history: row 0: t nan"),
        (("cvm", STRAIGHT), {"seed": -1}, "seed -1"),
        (("cvm", STRAIGHT), {"beta": 1}, "unknown key 'beta'"),
        (("cvm", STRAIGHT[:3]), {}, "has 3 rows; observed_rows of the site is 4"),
        (("cvm", STRAIGHT[:, :2]), {}, "give Tracks, or \\[rows, 3\\]"),
        (("cvm", STRAIGHT * [0.4, 1, 1]), {"site": Site()}, "a row every 0.4 s, the site's time_step_s is 1"),
        (("cvm", np.array([[0, 0, 0], [1, 1, 0], [1.5, 2, 0], [3, 3, 0.0]])), {}, "the time step of the tracks is in"),
        (("cvm", STRAIGHT * [1, np.nan, 1]), {}, "is not a number"),
        (("cvm", STRAIGHT[:0]), {}, "no row"),
        (("snippets", STRAIGHT), {}, "give a Map"),
        (("cwm", STRAIGHT), {}, "did you mean 'cvm'"),
        ((3, STRAIGHT), {}, "give a Map"),
        (("cvm", STRAIGHT), {"site": Site(velocity="as_recorded")}, "no row of walker 0 before t0 has a speed"),
    ],
)
def test_a_forecast_that_cannot_be_made(arguments, named, message):
    refused(message, modlhmp.forecast, *arguments, **named)


@pytest.mark.parametrize(("kind", "options"), [("episodes", FEW["episodes"]), ("cliff", {"velocity": "differences"})])
def test_positions_are_enough_where_no_recorded_velocity_is_used(kind, options):
    """Although the site's recordings have some: a robot's tracker has none."""
    site = dataclasses.replace(SITE, velocity="as_recorded")
    a_map, history = modlhmp.build_map(kind, PEOPLE, site), seen(PEOPLE)
    bare = history._replace(speed=np.full(len(history.t), np.nan), heading=np.full(len(history.t), np.nan))
    ours, theirs = (modlhmp.forecast(a_map, one, **options) for one in (bare, history))
    np.testing.assert_array_equal(ours.paths, theirs.paths)
    if kind == "cliff":
        refused("use velocity='differences'", modlhmp.forecast, a_map, bare)


def test_who_stands_has_no_heading_and_is_forecast_as_in_the_workflow():
    """Nor counts the row at t0, or one that lacks its velocity beside others that have theirs."""
    site = dataclasses.replace(SITE, velocity="as_recorded")
    speed, heading, row = PEOPLE.speed.copy(), PEOPLE.heading.copy(), PEOPLE.bounds()[:-1]
    stands = row[3] + np.arange(4)
    speed[stands], heading[stands] = 0.02, np.nan
    speed[row[5] + 3] = heading[row[5] + 3] = heading[row[6] + 2] = np.nan
    people = PEOPLE._replace(speed=speed, heading=heading)
    a_map = modlhmp.build_map("cliff", people, site)
    forecaster = make_forecaster("cvm", find("cvm").options(), site, None)
    ((_, _, expected),) = forecast_recording(people, forecaster, site, ("h", "cvm", "day"), 1, [0])
    np.testing.assert_array_equal(modlhmp.forecast("cvm", seen(people), site=site).paths, expected.xy)
    assert len(modlhmp.forecast(a_map, seen(people), k=2).t0) == 80
    speed[stands] = 1.0
    refused("no row of walker 3 before t0 has a heading, though", modlhmp.forecast, a_map, seen(people))
    speed[stands] = np.nan
    refused("no row of walker 3 before t0 has a speed .1 of 80", modlhmp.forecast, a_map, seen(people))


def test_ways_out(maps):
    """A map that is sampled needs them as a map of their own; a snippet knows whether its person left."""
    exits, history = modlhmp.build_map("exits", PEOPLE, SITE), seen(PEOPLE)
    refused("needs the ways out", modlhmp.forecast, maps["cliff"], history, exits=True)
    refused("has no forecaster", modlhmp.forecast, exits, history)
    stay, leave = (modlhmp.forecast(maps["cliff"], history, exits=one, k=50) for one in (None, exits))
    assert leave.left(8).mean() > stay.left(8).mean()
    stay, leave = (modlhmp.forecast(maps["snippets"], history, exits=one, k=50) for one in (False, True))
    assert leave.left(8).mean() >= stay.left(8).mean()


def test_options_of_a_map_are_checked(maps):
    refused("unknown key 'beta'", modlhmp.forecast, maps["snippets"], seen(PEOPLE), beta=2)
    refused("beta", modlhmp.forecast, maps["cliff"], seen(PEOPLE), beta=-1)


# --- scores ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["tc_cliff", "snippets"])
@pytest.mark.parametrize("protocol", ["paper", "complete"])
def test_scores_are_the_workflow_s(maps, tmp_path, kind, protocol):
    site = Site(
        **{**vars(SITE), "paper_protocol": PaperProtocol(idle_filter=IdleFilter(rows=5, min_displacement_m=5.9))}
    )
    a_map = modlhmp.Map(kind, site, maps[kind].whole, maps[kind].hours)
    a_map.save(tmp_path / "map")
    options, key = OPTIONS.get(kind, RollOut()), ("hall", kind, "day1")
    forecasts = forecast_recording(
        PEOPLE, make_forecaster(kind, options, site, tmp_path / "map"), site, key, options.k, [0]
    )
    table = score_recording(PEOPLE, forecasts, "day1", site).to_pandas()
    output = "ranked" if kind == "tc_cliff" else "median"
    table = table[(table["protocol"] == protocol) & (table["output"] == output)]
    futures = modlhmp.forecast(a_map, seen(PEOPLE), k=options.k, key=key)
    scores = modlhmp.score(futures, PEOPLE, protocol)
    assert scores.output == output
    np.testing.assert_array_equal(scores.ade.astype(np.float32), np.stack(table["ade"]))
    np.testing.assert_array_equal(scores.fde.astype(np.float32), np.stack(table["fde"]))
    np.testing.assert_array_equal(scores.eligible.sum(axis=1), table["eligible_steps"].clip(upper=8))
    assert scores.at(5)["n"] == np.isfinite(scores.ade[:, 4]).sum() == scores.n[4]
    assert 0 < scores.eligible[:, 4].sum() < 80 if protocol == "paper" else True


def test_scores_against_positions():
    futures = modlhmp.forecast("cvm", STRAIGHT, horizon_s=3)
    truth = np.array([[[4.8, 3.0], [6.0, 4.0], [np.nan, np.nan]]])
    scores = modlhmp.score(futures, truth)
    np.testing.assert_allclose(scores.fde[0], [3, 4, np.nan], atol=1e-6)
    np.testing.assert_allclose(scores.ade[0], [3, 3.5, np.nan], atol=1e-6)
    assert scores.at(2) == pytest.approx({"ade_m": 3.5, "fde_m": 4.0, "n": 1, "eligible": 1}, abs=1e-6)


@pytest.mark.parametrize("horizon_s", [0, 3.5, 99, "2"])
def test_a_horizon_that_was_not_forecast(horizon_s):
    scores = modlhmp.score(modlhmp.forecast("cvm", seen(PEOPLE), 8), PEOPLE)
    refused("it was not forecast; give a multiple of 1 s up to 8 s", scores.at, horizon_s)


def test_scores_that_cannot_be_given():
    futures = modlhmp.forecast("cvm", STRAIGHT, horizon_s=3)
    refused("did you mean 'complete'", modlhmp.score, futures, STRAIGHT[None, :, 1:], "complet")
    refused("truth of shape", modlhmp.score, futures, STRAIGHT)
    refused("has no track", modlhmp.score, futures, PEOPLE._replace(track_id=PEOPLE.track_id + 5))
    refused("futures are NoneType", modlhmp.score, None, PEOPLE)
    scores = modlhmp.score(futures, STRAIGHT[None, :3, 1:])
    refused("it was not forecast", scores.at, 9)
    refused("horizon_s '3': it was not forecast", scores.at, "3")


def test_usable_histories_are_those_of_the_workflow():
    """The walkers of `seen` are the workflow's tracks, in its order."""
    rows = usable_tracks(PEOPLE)
    np.testing.assert_array_equal(PEOPLE.track_id[rows[:, 0]], np.unique(PEOPLE.track_id))


def test_importing_the_library_changes_nothing_in_the_process():
    """No environment variable, no folder, no setting of another library."""
    code = """
import os, warnings
import numpy as np, pyarrow as pa
before = dict(os.environ), pa.default_memory_pool().backend_name, np.geterr(), list(warnings.filters)
import modlhmp, modlhmp.api, modlhmp.datasets, modlhmp.contract, modlhmp.cli, modlhmp.networks
print((dict(os.environ), pa.default_memory_pool().backend_name, np.geterr(), list(warnings.filters)) == before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


def test_files_of_one_person_each_need_a_dataset_file(write):
    refused("described by a dataset file", modlhmp.read_tracks, write(CSV), columns={"t": 0, "x": 1, "y": 2},
            file_is="person")  # fmt: skip


def test_a_homography_that_takes_places_to_a_line_is_refused(write):
    flat = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    refused("homography: its rows depend on each other", modlhmp.read_tracks, write(CSV), **NAMED, homography=flat)


# --- the time step of tracks of which no site is given ----------------------------------------------------------------


@pytest.mark.parametrize("step_s", [0.04, 1 / 30, 0.4, 1.0, 2.5, 6.0])
def test_the_time_step_is_that_of_the_tracks(step_s):
    """Whatever is built or forecast without a word of it; paths are those of a site that says it."""
    tracks = PEOPLE._replace(t=PEOPLE.t[0] + step_s * (PEOPLE.t - PEOPLE.t[0]), x=step_s * PEOPLE.x)
    a_map = modlhmp.build_map("snippets", tracks)
    assert a_map.site.time_step_s == pytest.approx(step_s, abs=1e-6)
    futures = modlhmp.forecast("cvm", seen(tracks), horizon_s=5 * a_map.site.time_step_s)
    assert futures.times_s[-1] == pytest.approx(5 * step_s, abs=1e-5) and futures.paths.shape[2] == 5
    assert modlhmp.score(futures, tracks).n[-1] == len(futures.t0), "nobody's step is a gap"
    said = modlhmp.forecast("cvm", seen(tracks), 5 * a_map.site.time_step_s, site=a_map.site)
    np.testing.assert_array_equal(futures.paths, said.paths)
    assert modlhmp.forecast("cvm", seen(tracks)).times_s[-1] == pytest.approx(60, abs=step_s)


def test_clocks_that_jitter_and_rows_that_are_missing_leave_the_time_step():
    rng = np.random.default_rng(0)
    jittered = PEOPLE._replace(t=PEOPLE.t + rng.uniform(-0.04, 0.04, len(PEOPLE.t)))
    assert modlhmp.build_map("cliff", jittered).site.time_step_s == 1.0
    assert modlhmp.build_map("cliff", PEOPLE.take(rng.random(len(PEOPLE.t)) < 0.9)).site.time_step_s == 1.0


def test_a_time_step_in_doubt_is_asked_for():
    """People of two rates, of whom none is the recording's."""
    slow = PEOPLE.track_id % 2 == 0
    mixed = PEOPLE._replace(t=np.where(slow, PEOPLE.t, PEOPLE.t[0] + 0.43 * (PEOPLE.t - PEOPLE.t[0])))
    with pytest.raises(DataError, match=r"in doubt: their rows are .* s apart in the median, but \d+% of them are not"):
        modlhmp.build_map("cliff", mixed)
