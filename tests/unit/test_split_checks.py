"""People or contents in both splits, and test places where nobody trained, are noticed."""

import gzip
import json

import numpy as np
import pytest
from planted import PLACES, people, write

from modlhmp.file_format import Recording
from modlhmp.inspection import inspect_dataset
from modlhmp.site import Site
from modlhmp.split_checks import check_splits
from modlhmp.tracks import Tracks, concatenate

SITE = Site(horizon_s=10)


def tracks(number=12, shift_m=0.0, seed=3, first_id=0, begin=0.0, rows=20):
    person, t, x, y, v, h = people(number=number, seed=seed, rows=rows).T
    return Tracks(person.astype(np.int64) + first_id, t + begin, x + shift_m, y, v, h)


def recording(name, split, day="2026-03-02"):
    return Recording(day=day, split=split, name=name, path=name)


def found(*pairs, site=SITE):
    return {one.check: one for one in check_splits(pairs, site)}


def test_other_people_at_the_same_place_are_fine():
    train, test = tracks(number=60), tracks(number=20, seed=4, first_id=100)
    assert found((recording("a", "train"), train), (recording("b", "test"), test)) == {}


def test_ids_that_begin_anew_are_not_the_same_people():
    train, test = tracks(number=60), tracks(number=20, seed=4, begin=3600.0)
    for day in ("2026-03-02", "2026-03-03"):
        assert found((recording("a", "train"), train), (recording("b", "test", day), test)) == {}


def test_a_track_cut_between_the_splits_is_one_person():
    whole = tracks(number=60, rows=40)
    early = np.arange(len(whole.t)) % 40 < 20
    told = found((recording("a", "train"), whole.take(early)), (recording("b", "test"), whole.take(~early)))
    assert told["shared_people"].severity == "stop"
    assert "60 of 60" in told["shared_people"].text


@pytest.mark.parametrize(
    ("apart_s", "step_s", "one"), [(6, 1.0, False), (6, 3.0, True), (60, 30.0, True), (90, 30.0, False)]
)
def test_an_id_goes_on_within_what_is_no_gap(apart_s, step_s, one):
    early = tracks(number=60, rows=20)
    late = tracks(number=60, seed=4, rows=20)
    ends = np.repeat(early.t[np.flatnonzero(np.diff(early.track_id, append=-1))], 20)
    late = late._replace(t=ends + apart_s + late.t - np.repeat(late.t[::20], 20))
    told = found(
        (recording("a", "train"), early),
        (recording("b", "test"), late),
        site=Site(time_step_s=step_s, horizon_s=10 * step_s),
    )
    assert ("shared_people" in told) == one


def test_the_same_walks_under_other_ids_and_times():
    train = tracks(number=60)
    copied = tracks(number=60)._replace(track_id=train.track_id + 500, t=train.t + 86_400)
    told = found((recording("a", "train"), train), (recording("b", "test", "2026-03-03"), copied))
    assert told["shared_people"].severity == "stop"
    assert "a and b" in told["shared_people"].text


@pytest.mark.parametrize("split", ["train", "test"])
def test_a_recording_that_is_a_copy_of_another(split):
    """Of another day and with other ids, and as a part of a longer one."""
    rest = "test" if split == "train" else "train"
    longer = concatenate([tracks(number=20), tracks(number=40, seed=5, first_id=100)])
    copied = tracks(number=20)._replace(track_id=tracks(number=20).track_id + 500)
    others = (recording("a", split), longer), (recording("b", rest), tracks(number=40, seed=4, first_id=900))
    told = found(*others, (recording("c", split, "2026-03-03"), copied))["copied_recording"]
    assert told.severity == "stop" and "a and c" in told.text
    fresh = tracks(number=20, seed=6, first_id=2000)
    assert "copied_recording" not in found(*others, (recording("c", split), fresh))
    some = concatenate([tracks(number=3), fresh])
    assert found(*others, (recording("c", split), some))["copied_recording"].severity == "warn", "of an hour's border"


def test_a_copy_in_another_form_is_refused(tmp_path):
    """Packed, or with other ends of lines: its bytes are others, its people are not."""
    path = write(tmp_path / "a.csv", people(number=30), moving=False)
    with gzip.open(tmp_path / "b.csv.gz", "wb") as packed:
        packed.write(path.read_bytes().replace(b"\n", b"\r\n"))
    write(tmp_path / "c.csv", people(number=30, seed=5), moving=False)
    described = {
        "title": "Hall", "reader": "delimited", "header": True, "columns": PLACES, "timezone": "UTC",
        "clock": "unknown", "horizon_s": 5, "velocity": "differences", "citation": "none", "terms": "none",
        "recordings": [{"files": name, "split": "test" if name == "c.csv" else "train"}
                       for name in ("a.csv", "b.csv.gz", "c.csv")],
    }  # fmt: skip
    (tmp_path / "hall.yaml").write_text(json.dumps(described))
    told = [str(one) for _, one in inspect_dataset(tmp_path / "hall.yaml", tmp_path).findings]
    assert any(one.startswith("copied_recording: a and b") for one in told), told


def test_one_copied_walk_among_many_is_a_warning():
    train, test = tracks(number=200), tracks(number=200, seed=4, first_id=1000)
    one = train.track_id == 5
    test = Tracks(*(np.concatenate(pair) for pair in zip(test, train.take(one)._replace(
        track_id=np.full(one.sum(), 5000)), strict=True)))  # fmt: skip
    told = found((recording("a", "train"), train), (recording("b", "test", "2026-03-03"), test))
    assert told["shared_people"].severity == "warn"
    assert "1 of 201" in told["shared_people"].text


def test_people_who_stand_are_no_copies():
    train = tracks(number=30)
    still = train._replace(x=np.ones(len(train.t)), y=np.ones(len(train.t)))
    pairs = (recording("a", "train"), still), (recording("b", "test", "2026-03-03"), still)
    assert "shared_people" not in found(*pairs)


@pytest.mark.parametrize(("shift_m", "severity"), [(500.0, "stop"), (30.0, "warn"), (0.0, None)])
def test_a_place_where_nobody_trained(shift_m, severity):
    train, test = tracks(number=300), tracks(number=40, seed=4, first_id=1000, shift_m=shift_m)
    told = found((recording("a", "train"), train), (recording("b", "test"), test))
    assert (told["untrained_place"].severity if told else None) == severity


@pytest.mark.parametrize(("horizon_s", "longest"), [(16, None), (17, "16 s"), (60, "16 s")])
def test_a_horizon_that_nobody_reaches(horizon_s, longest):
    """20 rows, of which 4 are observed: 16 s are left."""
    train, test = tracks(number=60, rows=90), tracks(number=20, seed=4, first_id=100)
    pairs = (recording("a", "train"), train), (recording("b", "test"), test)
    told = found(*pairs, site=Site(horizon_s=horizon_s))
    assert set(told) == ({"horizon"} if longest else set())
    if longest:
        assert told["horizon"].severity == "warn"
        assert longest in told["horizon"].text
        assert "`horizon_s: 16`" in told["horizon"].remedy


def test_a_horizon_for_tracks_shorter_than_what_is_observed():
    pairs = (recording("a", "train"), tracks(number=60)), (recording("b", "test"), tracks(first_id=100, rows=3))
    told = found(*pairs)
    assert "no test track is long enough" in told["horizon"].text


NINE = 1_772_442_000.0  # 2026-03-02 09:00 UTC


@pytest.mark.parametrize(
    ("hours", "empty"), [(None, ""), ((9, 10), ""), ((8, 11), "8, 10"), ((22, 10), "22, 23, 0, 1, 2, 3, 4, 5, 6, 7, 8")]
)
def test_hours_in_which_nobody_trained(hours, empty):
    train, test = tracks(number=60, begin=NINE), tracks(number=20, seed=4, first_id=100, begin=NINE)
    pairs = (recording("a", "train"), train), (recording("b", "test"), test)
    told = found(*pairs, site=Site(horizon_s=10, hours=hours))
    assert set(told) == ({"hours"} if empty else set())
    if empty:
        assert f"in {empty} of `hours`" in told["hours"].text


def test_hours_of_an_unknown_clock_are_none():
    pairs = (recording("a", "train", ""), tracks(number=60)), (recording("b", "test", ""), tracks(first_id=100, seed=4))
    assert "hours" not in found(*pairs, site=Site(horizon_s=10, hours=(8, 11)))
