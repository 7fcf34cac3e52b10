"""How people of one file are divided between training and test."""

from collections import Counter
from dataclasses import replace
from datetime import date, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from planted import days_of_the_archive
from test_cleaning import track

from modlhmp.cleaning import clean_recording
from modlhmp.datasets import Dataset, divided, folds, validation_part
from modlhmp.file_format import Columns, FileFormat, Recording, Split
from modlhmp.ids import Owners
from modlhmp.split_checks import check_splits
from modlhmp.splits import BLOCK_S, CONTEMPORARIES_S, FOLDS, in_split
from modlhmp.storage import DataError
from modlhmp.tracks import concatenate

TRAIN, TEST = (Recording(day="", side=side) for side in ("train", "test"))


def sides(tracks, chosen, owners=None):
    return [in_split(tracks, replace(side, chosen=chosen), owners) for side in (TRAIN, TEST)]


@given(st.sets(st.integers(0, 10_000), min_size=1, max_size=60), st.sampled_from([0.1, 0.25, 0.5]), st.integers(0, 3))
def test_by_person_each_is_on_one_side_whoever_else_is_there(ids, share, seed):
    chosen = Split(by="person", test=share, seed=seed)
    people = {one: track(one, [0.0, 1.0]) for one in sorted(ids)}
    train, test = sides(concatenate(people.values()), chosen)
    np.testing.assert_array_equal(train, ~test)
    alone = [sides(people[one], chosen)[1][0] for one in people]
    assert alone == test.tolist()


def test_by_person_the_share_is_about_what_is_asked_for_and_the_seed_chooses():
    people = concatenate(track(one, [0.0, 1.0]) for one in range(4000))
    first, second = (sides(people, Split(by="person", test=0.25, seed=seed))[1] for seed in (0, 1))
    assert first.mean() == pytest.approx(0.25, abs=0.03)
    assert second.mean() == pytest.approx(0.25, abs=0.03)
    assert (first != second).mean() > 0.3


def test_pieces_are_different_people_unless_they_are_said_to_be_one():
    owners = Owners()
    ids = np.array([[owners.number(f"p{n}", piece) for piece in (1, 2, 3)] for n in range(60)])
    people = concatenate(track(one, [0.0, 1.0]) for one in ids.ravel())
    apart, together = (sides(people, Split(by="person"), known)[1].reshape(60, 3) for known in (None, owners))
    assert (together == together[:, :1]).all()
    assert not (apart == apart[:, :1]).all()


def test_by_time_nobody_who_comes_back_is_trained_and_tested():
    """Who walks before and after the moment is there at it: in neither, unless the pieces are different people."""
    owners = Owners()
    spans = {("p", 1): 0.0, ("p", 2): 900.0, ("q", 1): 10.0, ("q", 2): 100.0, ("r", 1): 800.0, ("r", 2): 990.0}
    people = concatenate(track(owners.number(*piece), [begin, begin + 10]) for piece, begin in spans.items())
    for known, trained, tested in ((owners, "qq", "rr"), (None, "pqq", "prr")):
        found = sides(people, Split(by="time", test=0.5), known)
        who = np.array([owners.text(int(one)) for one in people.track_id[people.bounds()[:-1]]])
        assert ["".join(sorted(who[side])) for side in found] == [trained, tested]


@given(st.lists(st.tuples(st.floats(0, 1000), st.floats(1, 200)), min_size=2, max_size=40), st.sampled_from([0.2, 0.5]))
def test_by_time_no_trained_person_is_there_with_a_tested_one(spans, share):
    people = concatenate(track(n, [start, start + lasts]) for n, (start, lasts) in enumerate(spans))
    train, test = sides(people, Split(by="time", test=share))
    assert not (train & test).any()
    ends = [start + lasts for start, lasts in spans]
    if train.any() and test.any():
        assert max(np.array(ends)[train]) < min(start for (start, _), one in zip(spans, test, strict=True) if one)


def test_by_what_the_file_says(write):
    content = "id,set,t,x,y\n" + "".join(f"{n},{'ab'[n % 2]},{t},{t},{n}\n" for n in range(6) for t in range(5))
    form = FileFormat(columns=Columns(track_id="id", t="t", x="x", y="y"), header=True)
    chosen = Split(by="column", column="set", test=("b",))
    path, found = write(content), {}
    for side in ("train", "test"):
        tracks, account = clean_recording(path, form, Recording(day="", side=side, chosen=chosen))
        found[side] = set(tracks.track_id.tolist())
        assert account["rows"]["read"] == 30
    assert found == {"train": {0, 2, 4}, "test": {1, 3, 5}}


@pytest.mark.parametrize("column", ["set", 1])
@pytest.mark.parametrize(
    "chosen", [{"without": {"set": ["val"]}}, {"only": {"set": ["train", "test"]}}, {"without": {"1": ["val"]}}]
)
def test_rows_that_the_dataset_leaves_out_are_of_neither_side(write, column, chosen):
    sets = ("train", "test", "val")
    path = write("id,set,t,x,y\n" + "".join(f"{n},{sets[n % 3]},{t},{t},{n}\n" for n in range(6) for t in range(5)))
    form = FileFormat(columns=Columns(track_id="id", t="t", x="x", y="y"), header=True, **chosen)
    split = Split(by="column", column=column, test=("test",))
    for side, people in (("train", {0, 3}), ("test", {1, 4})):
        tracks, _ = clean_recording(path, form, Recording(day="", side=side, chosen=split))
        assert set(tracks.track_id.tolist()) == people


def test_a_divided_file_is_a_recording_of_each_split():
    one, other = Recording(day="", name="hall", chosen=Split(by="time")), Recording(day="", name="plain", split="test")
    found = divided("d.yaml", [one, other])
    assert [(part.name, part.split, part.side) for part in found] == [
        ("hall-train", "train", "train"),
        ("hall-test", "test", "test"),
        ("plain", "test", ""),
    ]


def test_whole_days_are_divided(write):
    days = [Recording(day=f"2030-01-{n:02}", name=str(n), chosen=Split(by="day", test=0.3)) for n in range(1, 6)]
    assert [one.split for one in divided("d.yaml", days)] == ["train"] * 3 + ["test"] * 2
    with pytest.raises(DataError, match=r"d\.yaml: split: \{by: day\}: there is one day only, 2030-01-01"):
        divided("d.yaml", days[:1])


@pytest.mark.parametrize("number", [2, 7, 25, 50, 75, 100])
def test_shares_of_days_are_rounded_up_as_written(number):
    """And not as floats have them: 0.28 of 25 is 7.000000000000001."""
    names = [str(date(2030, 1, 1) + timedelta(n)) for n in range(number)]

    def tested(recordings):
        return sum(one.split == "test" for one in recordings)

    for hundredths in range(1, 100):
        chosen = Split(by="day", test=hundredths / 100)
        days = [Recording(day=name, name=name, chosen=chosen) for name in names]
        assert tested(divided("d.yaml", days)) == min(-(-hundredths * number // 100), number - 1), hundredths
    training = Dataset(recordings=tuple(Recording(day=name, name=name) for name in names))
    assert tested(validation_part(training).recordings) == -(-3 * number // 10)


# --- parts of files that hold both splits -----------------------------------------------------------------------

EACH_WAY = [Split(by="person"), Split(by="time"), Split(by="column", column="set", test=("b",))]


def of_both_sides(write, chosen, days):
    """A dataset of so many days, a file each, with 90 persons of their own, who come every 400 s for 9 s."""
    recordings = []
    for day in range(1, days + 1):
        lines = (
            f"{100 * day + n},{'abaa'[n % 4]},{400 * n + t},{n + t},{7 * n + 0.3 * day}"
            for n in range(90) for t in range(10)
        )  # fmt: skip
        path = write("id,set,t,x,y\n" + "\n".join(lines) + "\n", f"{day}.csv")
        date = f"2030-03-{day:02}"
        recordings.append(Recording(name=str(day), path=str(path), day=date, start="09:00", chosen=chosen))
    columns = Columns(track_id="id", t="t", x="x", y="y")
    return Dataset(columns=columns, header=True, timezone="UTC", recordings=divided("d.yaml", recordings))


def cleaned(dataset):
    """[(recording, its clean tracks)]; nobody is in two of them, as the dataset's own checks see it."""
    found = [(one, clean_recording(one.path, dataset, one)[0]) for one in dataset.recordings]
    assert not {one.check for one in check_splits(found, dataset)} & {"shared_people", "copied_recording"}
    return found


def persons(found, split):
    """How often each person, [id, begin, end], is in a split's recordings."""
    tracks = [tracks for one, tracks in found if one.split == split]
    return Counter(
        (int(one.track_id[first]), float(one.t[first]), float(one.t[last - 1]))
        for one in tracks for first, last in zip(one.bounds()[:-1], one.bounds()[1:], strict=True)
    )  # fmt: skip


@pytest.mark.parametrize("days", [1, 3])
@pytest.mark.parametrize("chosen", EACH_WAY, ids=lambda one: one.by)
def test_a_validation_part_reads_nobody_of_the_test_side(write, chosen, days):
    """And everybody else of the same file once, to fit or to validate."""
    dataset = of_both_sides(write, chosen, days)
    whole, part = cleaned(dataset), cleaned(validation_part(dataset))
    fit, held = persons(part, "train"), persons(part, "test")
    assert fit and held
    assert fit + held == persons(whole, "train")


@pytest.mark.parametrize("days", [1, 3, FOLDS + 1])
@pytest.mark.parametrize("chosen", EACH_WAY, ids=lambda one: one.by)
def test_in_folds_everyone_of_the_test_side_is_tested_once_and_trains_otherwise(write, chosen, days):
    """So does the training side; but nobody within ten minutes of the fold's half-hours, or on its days."""
    dataset = of_both_sides(write, chosen, days)
    whole = cleaned(dataset)
    test, everyone = persons(whole, "test"), persons(whole, "train") + persons(whole, "test")
    tested = Counter()
    for fold, dealt in enumerate(map(cleaned, folds(dataset))):

        def apart(begin, end, fold=fold, dealt=dealt):
            if days >= FOLDS:
                return begin // 86400 not in {t // 86400 for _, t, _ in persons(dealt, "test")}
            near = np.arange((begin - CONTEMPORARIES_S) // BLOCK_S, (end + CONTEMPORARIES_S) // BLOCK_S + 1)
            return fold not in near % FOLDS

        tested += persons(dealt, "test")
        assert persons(dealt, "train") == Counter(one for one in everyone if apart(*one[1:]))
    assert tested == test


BY_PERSON = {"atc_1day": {"2012-10-24"}}  # a day of which one file has some people and another one the others


def test_no_day_and_no_file_of_a_shipped_dataset_trains_and_tests(config_folder, load_shipped, tmp_path):
    """But where its file says by which moment, or by whom, it is divided."""
    files = sorted((config_folder / "datasets").glob("*.yaml"))
    assert len(files) > 12
    days_of_the_archive(tmp_path)
    shared = {}
    for file in files:
        recordings = load_shipped(file.stem, tmp_path).recordings
        train, test = ([one for one in recordings if one.split == side] for side in ("train", "test"))
        assert train and test, file.stem
        shared[file.stem] = {one.day for one in train if one.day} & {one.day for one in test}
        assert all(
            one.chosen is not None and one.chosen == other.chosen
            for one in train for other in test if one.path == other.path
        ), file.stem  # fmt: skip
    assert {name: days for name, days in shared.items() if days} == BY_PERSON
