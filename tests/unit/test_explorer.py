"""The explorer's data: packed to their digits, true to the run's files, and of recorded people aggregates alone."""

import base64
import dataclasses
import gzip
import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from explored_run import HALL, LONE_Y, METHODS, YARD, crowd, forecasts, make_page
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import STORED, write_forecasts
from modlhmp.forecasting.medoid import with_medoid
from modlhmp.forecasting.modes import modes_of, with_modes
from modlhmp.forecasting.outputs import kept
from modlhmp.methods import build_map
from modlhmp.scoring.recording import score_recording
from modlhmp.storage import column, read_parquet, write_parquet
from modlhmp.study.explorer.look import ASSETS, SCRIPTS, page
from modlhmp.study.explorer.pack import Digits, packed, unpacked
from modlhmp.study.explorer.people import LEAST_SAMPLES, MOST_FUTURES, people
from modlhmp.study.explorer.places import LEAST_PEOPLE, Crowd, distinct, flow, likeliest, places, read_crowd
from modlhmp.study.layout import Layout
from modlhmp.study.summary import main_output, read_errors
from modlhmp.study.versions import assets_version
from modlhmp.tracks import Tracks, write_tracks


def data_of(path):
    """The tree that a page holds."""
    found = re.search(r'<script type="application/gzip" id="data">(.*?)</script>', Path(path).read_text(), re.DOTALL)
    return unpacked(base64.b64decode(found[1]))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """(layout, path of the page) of a run with a hall of made-up and a yard of recorded people."""
    layout = Layout("small", str(tmp_path_factory.mktemp("explored")))
    return layout, make_page(layout)


@pytest.fixture(scope="module")
def tree(run):
    return data_of(run[1])


# --- packing ----------------------------------------------------------------------------------------------------------


@given(
    arrays(float, st.integers(0, 40), elements=st.floats(-2e4, 2e4) | st.just(np.nan)), st.sampled_from([1, 0.5, 0.01])
)
def test_numbers_come_back_to_their_digits(values, step):
    """Within half a step, NaN as NaN."""
    (found,) = unpacked(packed([Digits(values, step)]))
    np.testing.assert_allclose(found, values, rtol=1e-12, atol=0.5 * step * (1 + 1e-9))


@given(arrays(float, st.tuples(st.integers(0, 5), st.just(7)), elements=st.floats(-300, 300)))
def test_paths_do_not_drift(paths):
    """What is kept as differences is rounded first, so that errors do not add up along a path."""
    (found,) = unpacked(packed([Digits(paths, 0.02, row=7)]))
    np.testing.assert_allclose(found.reshape(paths.shape), paths, atol=0.01 + 1e-9)


@pytest.mark.parametrize(("most", "width"), [(127, 1), (128, 2), (32767, 2), (32768, 4)])
def test_the_narrowest_type_is_used(most, width):
    """NaN has a value of its own in each."""
    values = np.array([most, -most, np.nan])
    data = packed({"a": values})
    np.testing.assert_array_equal(unpacked(data)["a"], values)
    assert f"[0,3,{width},".encode() in gzip.decompress(data)


def test_all_else_stays_as_it_is_and_bytes_are_the_same_every_time():
    tree = {"a": [1, None, {"b": "ä <script>", "c": True}], "d": {"e": np.arange(3)}}
    found = unpacked(packed(tree))
    assert found["a"] == tree["a"]
    assert found["d"]["e"].tolist() == [0, 1, 2]
    assert packed(tree) == packed(tree)


@pytest.mark.parametrize(
    "bad", [Digits([np.inf]), Digits([1.0, np.nan], row=2), Digits([1e12]), Digits([[-np.inf]], 0.1)]
)
def test_what_cannot_be_packed_is_refused(bad):
    with pytest.raises(ValueError, match=r"cannot be packed|more than 32 bits"):
        packed([bad])


# --- the page ---------------------------------------------------------------------------------------------------------


def test_the_page_is_one_file_that_asks_no_network(run):
    text = Path(run[1]).read_text()
    assert not re.findall(r"(?:src|href|url)\s*[=(]\s*[\"']?(?:https?:|//)", text)
    assert "fetch(" not in text
    assert "XMLHttpRequest" not in text
    assert "default-src 'none'" in text
    assert "@@" not in text
    assert len(text) < 10e6


def test_a_name_cannot_become_markup():
    assert "<b>" not in page("<b>", b"").split("</title>")[0]


def test_another_look_is_another_page(tmp_path):
    """Its files are none that an import tells of."""
    before = assets_version(ASSETS)
    for file in ASSETS.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    assert assets_version(tmp_path) == before
    (tmp_path / "view.js").write_text("//")
    assert assets_version(tmp_path) != before


def test_every_script_is_in_the_page_and_none_holds_markup():
    assert {f"{name}.js" for name in SCRIPTS} | {"explorer.html", "explorer.css"} == {
        one.name for one in ASSETS.iterdir()
    }
    for name in SCRIPTS:
        text = (ASSETS / f"{name}.js").read_text()
        assert "innerHTML" not in text
        assert "</script" not in text.replace(r"<\/script", "")


# --- places -----------------------------------------------------------------------------------------------------------


def test_components_are_those_of_the_map(run, tree):
    """Of made-up people every component of every hour, to its digits."""
    layout, hall = run[0], tree["sets"][0]
    assert hall["periods"] == [None, 9, 10]
    for position, hour in enumerate(hall["periods"]):
        path = layout.map("hall", "cliff") if hour is None else layout.map_hour("hall", "tc_cliff", hour)
        table, shown = read_parquet(path), hall["cliff"][position]
        np.testing.assert_allclose(shown["mean_heading"], column(table, "mean_heading"), atol=0.001)
        np.testing.assert_allclose(shown["weight"], column(table, "weight"), atol=0.001)
        np.testing.assert_array_equal(shown["x"][shown["location"].astype(int)], column(table, "x"))
        np.testing.assert_array_equal(shown["count"][shown["location"].astype(int)], column(table, "count"))


def test_people_of_a_component_are_those_likeliest_of_it():
    """By hand: two components, of headings near 0 and near a half turn, the seam between them."""
    components = np.array([[0.5, 0.0, 1.0, 0.1, 0.0, 0.1], [0.5, np.pi, 1.0, 0.1, 0.0, 0.1]])
    heading = np.array([0.1, -3.1, 3.1, -0.2])
    assert likeliest(heading, np.ones(4), components).tolist() == [0, 1, 1, 0]
    assert distinct(np.array([0, 1, 1, 0]), np.array([7, 7, 7, 8]), 3).tolist() == [2, 1, 0]


def test_pieces_of_a_cut_track_are_one_person(tmp_path):
    """Else one walker who was lost now and then would be a crowd."""
    tracks = crowd(number=3)
    write_tracks(tracks, tmp_path / "a.parquet", persons={"2": 1})
    write_tracks(tracks, tmp_path / "b.parquet")
    found = read_crowd([tmp_path / "a.parquet", tmp_path / "b.parquet"])
    assert len(np.unique(found.person)) == 3 + 4
    assert found.last.sum() == 8


def test_flow_by_hand():
    """Six people cross one cell eastwards, the last two end there; a seventh is alone in another."""
    x = np.r_[np.full(12, 0.4), np.full(6, 5.5)]
    y, ones, zeros = np.full(18, 0.5), np.ones(18), np.zeros(18)
    last = np.zeros(18, bool)
    last[[8, 11, 17]] = True
    tracks = Tracks(zeros, zeros, x, y, 2 * ones, zeros)
    person = np.r_[np.repeat(np.arange(6), 2), np.full(6, 6)]
    everyone = unpacked(packed(flow(Crowd(tracks, person, last), 1)))
    assert everyone["people"].tolist() == [6, 1]
    assert everyone["left"].tolist() == [2, 1]
    assert everyone["rows"].tolist() == [12, 6]
    assert everyone["vx"].tolist() == [2, 2]
    few = unpacked(packed(flow(Crowd(tracks, person, last), 5)))
    assert few["people"].tolist() == [6]
    assert np.isnan(few["left"]).all()


# --- recorded people --------------------------------------------------------------------------------------------------

AGGREGATES = {
    "name", "title", "demo", "flip", "estimated", "step", "horizon", "least", "cell", "citation", "terms", "plan",
    "periods", "cliff", "stef", "flow", "methods", "people",
}  # fmt: skip


def numbers_of(tree):
    """Every array below a tree."""
    if isinstance(tree, np.ndarray):
        yield tree
    elif isinstance(tree, dict | list):
        for one in tree.values() if isinstance(tree, dict) else tree:
            yield from numbers_of(one)


def test_of_recorded_people_there_are_aggregates_alone(tree):
    """The same walks are followed one by one in the hall, which is made up, and not in the yard."""
    hall, yard = tree["sets"]
    assert len(hall["people"]["names"]) == 25
    assert set(yard) == AGGREGATES
    assert yard["people"] is None
    assert yard["least"] == LEAST_PEOPLE == 5
    for kind, keys in {
        "cliff": {"x", "y", "count", "people", "p", "location", "by", "weight", "mean_heading", "mean_speed",
                  "var_heading", "cov_heading_speed", "var_speed"},
        "stef": {"size", "x", "y", "orientations", "share"},
        "flow": {"x", "y", "people", "rows", "left", "vx", "vy"},
    }.items():  # fmt: skip
        assert all(set(one) == keys for one in yard[kind] if one)


def test_no_recorded_position_is_in_the_page(tree):
    """Places are those of lattices and cells; of what was recorded to the centimetre no three in a row are there."""
    yard = tree["sets"][1]
    for kind in ("cliff", "stef", "flow"):
        for one in filter(None, yard[kind]):
            for axis in ("x", "y"):
                np.testing.assert_array_equal(one[axis] * 2, np.rint(one[axis] * 2))
    walks = pieces_of_walks(crowd()) | pieces_of_walks(crowd(seed=1))
    assert len(walks) > 500
    assert not walks & {piece for values in numbers_of(yard) for piece in pieces(values)}
    shown = {piece for values in numbers_of(tree["sets"][0]["people"]) for piece in pieces(values)}
    assert len(walks & shown) > 300  # where people are shown, they are found


def pieces(values):
    """Every three numbers in a row, to 2 cm."""
    whole = np.rint(np.nan_to_num(values) / 0.02).astype(int).tolist()
    return set(zip(whole, whole[1:], whole[2:], strict=False))


def pieces_of_walks(tracks):
    """Three positions in a row of every walk, x or y."""
    bounds = tracks.bounds()
    return {
        piece
        for first, end in itertools.pairwise(bounds)
        for axis in (tracks.x, tracks.y)
        for piece in pieces(axis[first:end])
    }


def test_nothing_is_shown_that_fewer_than_five_made(tree):
    """One person walks alone up and down, often enough for a map to have a location there; in the hall it is shown."""
    hall, yard = tree["sets"]
    for kind in ("cliff", "stef", "flow"):
        assert (hall[kind][1]["y"] > LONE_Y - 2).any(), kind
        for one in filter(None, yard[kind]):
            assert not (one["y"] > LONE_Y - 2).any(), kind
            assert len(one["x"])
    for one in filter(None, yard["cliff"]):
        assert one["people"].min() >= 5
        assert one["by"].min() >= 5
    for one in filter(None, yard["flow"]):
        assert one["people"].min() >= 5
        assert not ((one["left"] > 0) & (one["left"] < 5)).any()


def test_a_component_of_few_is_left_out_where_the_location_has_many(tmp_path):
    """Five walk east; two more, often enough for a component, west: the first component is shown, the second not."""
    layout = Layout("small", str(tmp_path))
    one, rng = crowd(number=1, rows=12), np.random.default_rng(0)
    shape = {"x": rng.uniform(-0.2, 0.2, 84), "y": rng.uniform(-0.2, 0.2, 84), "speed": rng.normal(1, 0.1, 84)}
    ids = np.repeat(np.arange(7), 12)
    heading = np.where(ids < 5, 0.0, 3.0) + rng.normal(0, 0.05, 84)
    t = one.t[0] + np.arange(84.0)
    tracks = one._replace(track_id=ids, t=t, heading=heading, **shape)
    write_parquet(build_map("cliff", tracks, YARD, None)[0], layout.map("yard", "cliff"))
    write_tracks(tracks, layout.tracks("yard", "day"))
    people = read_crowd([layout.tracks("yard", "day")])
    for least, number in ((1, 2), (5, 1)):
        found = unpacked(packed(places(people, YARD, {"cliff": layout.map("yard", "cliff")}, False, least)))
        (shown,) = found["cliff"]
        here = shown["location"] == 0
        assert here.sum() == number
        assert shown["by"][here].tolist() == [5, 2][:number]
        assert np.abs(shown["mean_heading"][here][0]) < 0.2


# --- made-up people ---------------------------------------------------------------------------------------------------


def test_a_person_is_who_was_recorded(tree):
    """Observed, truth and clock, to 2 cm."""
    people, tested = tree["sets"][0]["people"], crowd(seed=1)
    assert people["names"] == [str(one) for one in range(1, 26)]
    mine = tested.take(tested.track_id == 3)
    observed, truth = people["observed"].reshape(25, 2, 4), people["truth"].reshape(25, 2, HALL.steps)
    np.testing.assert_allclose(observed[2], [mine.x[:4], mine.y[:4]], atol=0.011)
    np.testing.assert_allclose(truth[2], [mine.x[4:16], mine.y[4:16]], atol=0.011)
    assert people["length"][2] == HALL.steps
    assert people["clock"][2] == pytest.approx(9 + 3 / 60 + 3 / 3600, abs=1e-3)


def assert_errors_are_those_of_tables(people, method, errors_file):
    """ADE of what the page calls the result is that of the errors file, complete protocol, at every step."""
    one, steps = people["methods"][method], HALL.steps
    paths = np.asarray(one["xy"]).reshape(25, one["futures"], 2, steps)
    errors = read_errors(errors_file)
    (of,) = (
        errors[key]
        for key in errors
        if key[1] == "complete" and key[0] == main_output({output for output, _ in errors})
    )
    by_key = {key: row for row, key in enumerate(of.keys)}
    truth = people["truth"].reshape(25, 2, steps)
    for person in range(24):
        row = by_key[f"tuesday/{person + 1}"]
        for step in (1, 5, steps):
            best = [int(one["best"].reshape(25, steps)[person, step - 1])]
            results = paths[person, slice(None) if one["output"] == "mean" else best]
            away = np.hypot(*np.moveaxis(results - truth[person], 1, 0))[:, :step].mean()
            assert away == pytest.approx(of.ade[0, row, step - 1], abs=0.03)


@pytest.mark.parametrize("method", METHODS)
def test_the_paths_shown_have_the_errors_of_the_tables(run, tree, method):
    assert_errors_are_those_of_tables(tree["sets"][0]["people"], method, run[0].errors("hall", method))


@pytest.mark.parametrize("output", ["ranked", "likeliest", "mean"])
def test_so_have_those_of_more_futures_than_are_shown(tmp_path, output):
    """Whichever is the best at a step is among them, though it be the last."""
    layout, rng = Layout("small", str(tmp_path)), np.random.default_rng(3)
    tested, k = crowd(seed=1), 2 * MOST_FUTURES
    ids, _ = forecasts(tested, "cvm")
    xy = np.cumsum(rng.normal(0, 1, (len(ids), k, HALL.steps, 2)), axis=2).astype(np.float32)
    fitness = np.cumsum(rng.normal(-1, 1, (len(ids), k, HALL.steps)), axis=2).astype(np.float32)
    many = Forecast(xy, fitness, rng.integers(1, HALL.steps + 1, (len(ids), k)).astype(np.int32), output)
    write_tracks(tested, layout.tracks("hall", "tuesday"))
    write_forecasts(layout.forecast("hall", "many", "tuesday"), [(7, ids, many)])
    write_parquet(score_recording(tested, [(7, ids, many)], "tuesday", HALL), tmp_path / "errors.parquet")
    found = unpacked(packed(people(layout, HALL, ["tuesday"], ["many"])))
    assert_errors_are_those_of_tables(found, "many", tmp_path / "errors.parquet")
    assert found["methods"]["many"]["futures"] == (k if output == "mean" else MOST_FUTURES)


def test_modes_are_samples_with_probabilities_that_sum_to_one(tree):
    one = tree["sets"][0]["people"]["methods"]["snippets"]
    assert one["modes"] == 5
    np.testing.assert_allclose(one["chance"].reshape(25, 5).sum(axis=1), 1, atol=0.005)
    assert one["mode"].min() >= 1  # the median is no sample
    assert tree["sets"][0]["people"]["methods"]["cvm"]["modes"] == 0


def many_samples(number=40, ways=3):
    """(ids, Forecast) of the tested people: many samples on a few ways, with lives of all lengths."""
    rng, (ids, _) = np.random.default_rng(3), forecasts(crowd(seed=1), "cvm")
    turn = rng.integers(0, ways, (len(ids), number, 1)) + rng.normal(0, 0.02, (len(ids), number, 1))
    step = np.arange(1, HALL.steps + 1)
    xy = np.stack([step * np.cos(turn), step * np.sin(turn)], axis=-1).astype(np.float32)
    lives = rng.integers(1, HALL.steps + 1, xy.shape[:2]).astype(np.int32)
    return ids, Forecast(xy, np.zeros(xy.shape[:3], np.float32), lives, "mean")


def shown_of(folder, ids, forecast, **facts):
    """What the page has of a method whose stored forecasts are those."""
    layout = Layout("small", str(folder))
    write_tracks(crowd(seed=1), layout.tracks("hall", "tuesday"))
    write_forecasts(layout.forecast("hall", "method", "tuesday"), [(7, ids, forecast)], **facts)
    return unpacked(packed(people(layout, HALL, ["tuesday"], ["method"])))["methods"]["method"]


def test_a_method_s_own_modes_are_shown(tmp_path):
    """They are of all its samples, of which the file keeps a few."""
    ids, samples = many_samples()
    found = shown_of(tmp_path, ids, kept(with_modes(samples), STORED))
    own = modes_of(samples)
    n, k = own.probabilities.shape
    np.testing.assert_allclose(found["chance"].reshape(n, k), own.probabilities, atol=1e-3)
    xy = found["xy"].reshape(n, found["futures"], 2, HALL.steps).swapaxes(2, 3)
    paths = np.take_along_axis(xy, found["mode"].reshape(n, k, 1, 1).astype(int), axis=1)
    np.testing.assert_allclose(paths, own.paths, atol=0.011)


@pytest.mark.parametrize("why", ["medoids", "the best of many", "probabilities"])
def test_futures_that_are_no_fair_samples_have_no_modes_or_chances(tmp_path, why):
    ids, samples = many_samples(30 if why == "the best of many" else 20 if why == "probabilities" else 40)
    stored, facts = {
        "medoids": (kept(with_medoid(samples), STORED), {}),
        "the best of many": (samples._replace(output="ranked"), {}),
        "probabilities": (samples, {"alike": False}),
    }[why]
    found = shown_of(tmp_path, ids, stored, **facts)
    assert found["unequal"] and not found["modes"]


@pytest.mark.parametrize("output", ["ranked", "likeliest", "medoid", "mean"])
def test_all_of_few_samples_have_modes_and_chances(tmp_path, output):
    ids, samples = many_samples(LEAST_SAMPLES)
    found = shown_of(tmp_path, ids, samples._replace(output=output), alike=True)
    assert found["modes"] and not found["unequal"]


def test_the_owner_may_show_recorded_people(tmp_path):
    """`explorer: {tracks: true}`; then nothing is left out either."""
    layout = Layout("small", str(tmp_path))
    (yard,) = data_of(make_page(layout, (YARD,), ("yard",)))["sets"]
    assert len(yard["people"]["names"]) == 25
    assert yard["least"] == 1


def test_a_dataset_without_a_clock_has_the_whole_day(tmp_path):
    layout = Layout("small", str(tmp_path))
    nowhen = dataclasses.replace(YARD, clock="unknown")
    (yard,) = data_of(make_page(layout, (nowhen,), ()))["sets"]
    assert yard["periods"] == [None]
    assert len(yard["flow"]) == len(yard["cliff"]) == len(yard["stef"]) == 1
