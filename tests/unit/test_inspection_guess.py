"""What `modlhmp inspect FILE` proposes beside columns and units: sentinels, classes, joint ids, boxes, persons."""

import gzip

import numpy as np
import pytest
import yaml
from planted import PLACES, people

from modlhmp.cleaning import clean_recording
from modlhmp.datasets import load_dataset
from modlhmp.inspection import inspect_file
from modlhmp.inspection.guess import guess, guess_people
from modlhmp.storage import DataError

ROWS = people(number=30, rows=25, standing=0)
PERSON, T, X, Y = ROWS[:, 0].astype(int), *ROWS[:, 1:4].T
FRAME = np.rint(25 * T).astype(int)
RNG = np.random.default_rng(1)
SOME = RNG.random(len(ROWS)) < 0.1


def file_of(path, line, header="", encoding="utf-8"):
    """A file with the lines that a function of the row's number gives."""
    rows = [line(row) for row in range(len(ROWS))]
    path.write_bytes(("\n".join([header, *rows] if header else rows) + "\n").encode(encoding))
    return path


def drafted(path, folder):
    """The draft's keys and text, and the clean tracks of both splits by it."""
    found = inspect_file(path, folder)
    (folder / "drafted.yaml").write_text(found.draft, encoding="utf-8")
    dataset = load_dataset(folder / "drafted.yaml", folder)
    tracks = [clean_recording(one.path, dataset, one)[0] for one in dataset.recordings]
    return yaml.safe_load(found.draft), found.draft, tracks


def line_of(draft, key):
    return next(line for line in draft.splitlines() if line.startswith(f"{key}:"))


def refused(path):
    with pytest.raises(DataError) as error:
        inspect_file(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("thousands", "decimal", "separator"),
    [(",", ".", ";"), (".", ",", ";"), ("'", ".", ","), (" ", ".", ";"), (" ", ",", "\t"), ("'", ",", ";")],
)
@pytest.mark.parametrize("digits", [0, 1])
def test_marks_of_thousands(tmp_path, thousands, decimal, separator, digits):
    def written(value, digits=digits):
        return f"{value:,.{digits}f}".translate(str.maketrans({",": thousands, ".": decimal}))

    def line(n):
        return separator.join([str(PERSON[n]), written(T[n], 1), written(1000 * X[n] + 5000), written(1000 * Y[n])])

    path = file_of(tmp_path / "a.csv", line, separator.join(["id", "t", "x", "y"]))
    keys, _, tracks = drafted(path, tmp_path)
    assert keys["thousands"] == thousands
    assert keys.get("decimal", ".") == decimal
    assert keys["units"] == {"length": "mm"}
    assert sum(len(part.t) for part in tracks) == len(ROWS)


@pytest.mark.parametrize(("separator", "marks"), [(",", ",."), (",", ".,"), (" ", ". ")])
def test_quoted_numbers_may_hold_the_separator(tmp_path, separator, marks):
    def written(value):
        return '"' + f"{value:,.1f}".translate(str.maketrans({",": marks[1], ".": marks[0]})) + '"'

    def line(n):
        return separator.join([str(PERSON[n]), *map(written, (T[n], 1000 * X[n], 1000 * Y[n]))])

    keys, _, tracks = drafted(file_of(tmp_path / "a.csv", line, separator.join(["id", "t", "x", "y"])), tmp_path)
    assert (keys.get("decimal", "."), keys["thousands"]) == tuple(marks)
    assert sum(len(part.t) for part in tracks) == len(ROWS)


def test_a_decimal_comma_with_three_digits_is_no_mark_of_thousands(tmp_path):
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]};{T[n]:.3f};{X[n]:.3f};{Y[n]:.3f}".replace(".", ","), "id;t;x;y"
    )
    keys, _, _ = drafted(path, tmp_path)
    assert "thousands" not in keys
    assert keys["decimal"] == ","


@pytest.mark.parametrize(
    ("unseen", "missing"),
    [
        ("-1,-1,1.7", {"x": -1, "y": -1}),
        ("0,0,0", {"x": 0, "y": 0}),
        ("9999,9999,9999", {"x": 9999, "y": 9999}),
        ("-999.0,-999.0,0", {"x": -999, "y": -999}),
        ("1e6,1e6,0", {"x": 1000000, "y": 1000000}),
    ],
)
def test_numbers_that_stand_for_not_seen(tmp_path, unseen, missing):
    def line(n):
        return f"{PERSON[n]},{T[n]:.1f}," + (unseen if SOME[n] else f"{X[n]:.3f},{Y[n]:.3f},1.7")

    keys, draft, tracks = drafted(file_of(tmp_path / "a.csv", line, "id,t,x,y,z"), tmp_path)
    assert keys["missing"] == missing
    assert "decide" in line_of(draft, "missing")
    assert "units" not in keys
    assert np.isfinite(tracks[0].x).all()
    assert max(np.ptp(part.x) for part in tracks) < 100


def test_rows_of_others_are_left_out(tmp_path):
    kind = np.array(["Pedestrian", "Biker", "car"])[PERSON % 3]
    fast = np.where(PERSON % 3, 4.0, 1.0)

    def line(n):
        return f"{PERSON[n]},{T[n]:.1f},{fast[n] * X[n]:.3f},{fast[n] * Y[n]:.3f},{kind[n]}"

    keys, draft, tracks = drafted(file_of(tmp_path / "a.csv", line, "id,t,x,y,label"), tmp_path)
    assert keys["only"] == {"label": ["Pedestrian"]}
    assert "decide" in line_of(draft, "only")
    assert sum(len(part.t) for part in tracks) == (PERSON % 3 == 0).sum()


def test_where_no_text_says_people_the_others_are_named(tmp_path):
    kind = np.array(["visitor", "staff", "forklift truck"])[PERSON % 3]
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f},{kind[n]}", "id,t,x,y,kind"
    )
    assert drafted(path, tmp_path)[0]["without"] == {"kind": ["forklift truck"]}


@pytest.mark.parametrize(
    ("name", "texts", "asked"),
    [
        ("set", ["train", "val", "test"], False),
        ("label", ["train", "val", "test"], True),
        ("", ["train", "val", "test"], False),
        ("destination", ["bus stop", "train platform", "exit"], True),
        ("activity", ["walking", "pushing cart", "walking with dog"], True),
        ("", ["walking", "pushing cart", "person"], True),
    ],
)
def test_people_stay_whatever_else_a_column_says_of_them(tmp_path, name, texts, asked):
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f},{texts[PERSON[n] % 3]}",
        f"id,t,x,y,{name}" if name else "",
    )
    keys, draft, tracks = drafted(path, tmp_path)
    assert not {"only", "without"} & keys.keys()
    assert (f"holds {', '.join(sorted(texts))}: if some are no people" in draft) == asked
    assert sum(len(part.t) for part in tracks) == len(ROWS)


def test_all_that_a_column_of_classes_leaves_out_is_named(tmp_path):
    kind = np.array(["pedestrian", "car", "child"])[PERSON % 3]
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f},{kind[n]}", "id,t,x,y,class"
    )
    keys, draft, _ = drafted(path, tmp_path)
    assert keys["only"] == {"class": ["pedestrian"]}
    assert "rows of car, child are left out" in line_of(draft, "only")


def test_other_classes_are_told_and_left_to_a_human(tmp_path):
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f},{PERSON[n] % 3}", "id,t,x,y,class"
    )
    keys, draft, _ = drafted(path, tmp_path)
    assert not {"only", "without"} & set(keys)
    assert "column 'class' holds 0, 1, 2" in draft


def test_an_id_that_stands_twice_at_a_time_belongs_to_another_column(tmp_path):
    def line(n):
        return "\n".join(f"s{c},{PERSON[n]},{T[n]:.1f},{X[n] + 9 * c:.3f},{Y[n]:.3f}" for c in (1, 2))

    keys, draft, tracks = drafted(file_of(tmp_path / "a.csv", line, "session,id,t,x,y"), tmp_path)
    assert keys["columns"]["track_id"] == ["id", "session"]  # beyond the first part, -1 may be a session
    assert "units" not in keys
    assert "decide" in line_of(draft, "columns")
    assert sum(len(part.t) for part in tracks) == 2 * len(ROWS)


def test_rows_of_nobody_stay_nobody_s_beside_a_second_part_of_the_id(tmp_path):
    def line(n):
        rows = [f"{floor},{PERSON[n]},{T[n]:.1f},{X[n] + 20 * floor:.3f},{Y[n]:.3f}" for floor in (-1, 0)]
        return "\n".join([*rows, *([f"0,-1,{T[n]:.1f},{n % 40},{n % 30}"] if SOME[n] else [])])

    _, _, tracks = drafted(file_of(tmp_path / "a.csv", line, "floor,id,t,x,y"), tmp_path)
    assert sum(len(part.t) for part in tracks) == 2 * len(ROWS)


@pytest.mark.parametrize("dates", ["20260302,20260303", "1772409600,1772496000", "2026-03-02,2026-03-03"])
def test_ids_and_times_that_begin_anew_every_day_belong_to_the_date(tmp_path, dates):
    lines = [
        f"{date},{PERSON[n]},{T[n]:.1f},{X[n] + 20 * day:.3f},{Y[n]:.3f}"
        for day, date in enumerate(dates.split(","))
        for n in range(len(ROWS))
    ]
    (tmp_path / "a.csv").write_text("\n".join(["date,id,t,x,y", *lines]) + "\n")
    keys, _, tracks = drafted(tmp_path / "a.csv", tmp_path)
    assert keys["columns"]["track_id"] == ["id", "date"]
    assert sum(len(part.t) for part in tracks) == 2 * len(ROWS)


FAST = people(number=20, rows=100, step_s=0.25)


@pytest.mark.parametrize("name", ["fraction", "subframe", "ms", "millis", "stamp_msec", "usec", "microseconds"])
@pytest.mark.parametrize("seconds", ["s", "iso"])
def test_a_fraction_of_a_second_makes_no_person(tmp_path, name, seconds):
    per = {"fraction": 1, "subframe": 4, "usec": 1e6, "microseconds": 1e6}.get(name, 1e3)
    lines = [
        f"{int(p)},{np.datetime64('2026-03-02T09:00:00') + int(t) if seconds == 'iso' else int(t)},{t % 1 * per:.12g},"
        f"{x:.3f},{y:.3f}"
        for p, t, x, y, _, _ in FAST
    ]
    (tmp_path / "a.csv").write_text("\n".join([f"id,timestamp,{name},x,y", *lines]) + "\n")
    told = refused(tmp_path / "a.csv")
    assert f"column {name!r}" in told
    assert "add " in told


@pytest.mark.parametrize(
    ("names", "times", "step_s"),
    [
        ("time_ms", lambda k, n: f"{40 * k}", 0.04),  # of many people: less than a second in all that is looked at
        ("frame,ms", lambda k, n: f"{k},{40 * k % 1000}", 0.04),
        ("t,ms", lambda k, n: f"{0.04 * k:.2f},{40 * k % 1000}", 0.04),
        ("t,ms", lambda k, n: f"{k},{8 + n % 22}", 1.0),  # how late a detector is
    ],
)
def test_milliseconds_that_are_no_fraction_of_the_times(tmp_path, names, times, step_s):
    rng = np.random.default_rng(4)
    start, way = rng.uniform(0, 40, (50, 2)), rng.uniform(0, 2 * np.pi, 50)
    moves = 1.3 * step_s * np.column_stack([np.cos(way), np.sin(way)])
    lines = [
        f"{times(k, 50 * k + n)},{n},{x:.3f},{y:.3f}"
        for k in range(20)
        for n, (x, y) in enumerate((start + k * moves).tolist())
    ]
    (tmp_path / "a.csv").write_text("\n".join([f"{names},id,x,y", *lines]) + "\n")
    assert guess(tmp_path / "a.csv").keys["columns"]["t"] == names.partition(",")[0]


def test_whole_seconds_since_1970_stay_such_where_people_are_slow(tmp_path):
    """A quarter of a metre per second in a large place; in ms and cm they would walk."""
    rows = [f"{1351042800 + k},{n},{0.24 * k + 2 * n:.3f},{30 + 2 * n % 31:.3f}" for k in range(60) for n in range(110)]
    (tmp_path / "a.csv").write_text("\n".join(["timestamp,id,x,y", *rows]) + "\n")
    found = guess(tmp_path / "a.csv")
    assert found.clock
    assert found.keys.get("units", {}).get("time", "s") == "s"


def test_every_reason_why_rows_are_left_out_is_told(tmp_path):
    def line(n):
        who = "robot_1" if PERSON[n] == 4 else PERSON[n]
        return f"{who},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f},{'Car' if PERSON[n] == 5 else 'Adult'},{int(n % 9 == 0)}"

    found = guess(file_of(tmp_path / "a.csv", line, "id,t,x,y,label,lost"))
    assert found.keys["without"] == {"label": ["Car"], "lost": ["1"], "id": ["robot_1"]}
    assert all(part in found.asks["without"] for part in ("Car", "lost from view", "robot_1"))


@pytest.mark.parametrize("constant", ["date", "zone"])
def test_a_column_that_changes_along_one_walk_makes_no_second_person(tmp_path, constant):
    for number in range(6):
        days = [f"2020-01-0{number + 1 + (number == 2 and k > 9)}" for k in range(60 + number)]
        rows = (f"{0.4 * k:.2f},{0.5 * k:.3f},{number + 0.1 * k:.3f},{day}" for k, day in enumerate(days))
        (tmp_path / f"p{number}.csv").write_text("\n".join([f"t,x,y,{constant}", *rows]) + "\n")
    assert guess_people(sorted(tmp_path.iterdir())) is not None


@pytest.mark.parametrize("names", ["time_s,time_us", "t,time_ms"])
def test_a_fraction_of_a_second_is_not_taken_for_the_time(tmp_path, names):
    """Though it has more values than the seconds beside it, as those of a clock that rows do not follow."""
    late = FAST[:, 1] + np.random.default_rng(2).uniform(0, 0.1, len(FAST))
    per = 1e6 if names.endswith("us") else 1e3
    lines = [
        f"{int(t)},{t % 1 * per:.0f},{int(row[0])},{row[2]:.3f},{row[3]:.3f}"
        for t, row in zip(late.tolist(), FAST.tolist(), strict=True)
    ]
    (tmp_path / "a.csv").write_text("\n".join([f"{names},id,x,y", *lines]) + "\n")
    assert "add them up" in refused(tmp_path / "a.csv")


def of_persons(folder, columns, line, other):
    """A folder with a file for each of five persons, and a smaller one with lines of its own."""
    for number in range(5):
        lines = [line(number, 0.4 * k, 0.5 * k, number + 0.1 * k) for k in range(60 + number)]
        (folder / f"p{number}.csv").write_text("\n".join([*columns, *lines]) + "\n")
    (folder / "p9.csv").write_text("\n".join(other) + "\n")
    return sorted(folder.iterdir())


@pytest.mark.parametrize("later_s", [0, 0.2])
def test_ids_without_a_name_that_take_turns_are_of_several_people(tmp_path, later_s):
    """At the same times or at times of their own; and the remedy is not what was just done."""

    def line(number, t, x, y):
        return f"{number},{t:.1f},{x:.3f},{y:.3f}"

    two = [line(who, 0.4 * k + later_s * (who == 8), 0.5 * k + 15 * (who == 8), 3) for k in range(15) for who in (7, 8)]
    assert guess_people(of_persons(tmp_path, [], line, two)) is None
    told = refused(tmp_path)
    assert "inspect its folder" not in told
    assert "a column `id`" in told


def test_a_zone_that_changes_where_a_time_stands_twice_makes_no_second_person(tmp_path):
    other = [f"{0.4 * (k - (k == 7)):.1f},{0.5 * k:.3f},{0.1 * k:.3f},{'yz'[k > 9]}" for k in range(30)]
    files = of_persons(
        tmp_path, ["t,x,y,zone"], lambda n, t, x, y: f"{t:.1f},{x:.3f},{y:.3f},{'abcde'[n]}", ["t,x,y,zone", *other]
    )
    assert guess_people(files) is not None


def test_a_file_of_fewer_columns_among_those_of_persons_is_told_by_its_name(tmp_path):
    of_persons(
        tmp_path,
        ["x,y,z,t"],
        lambda _, t, x, y: f"{x:.3f},{y:.3f},1.7,{t:.1f}",
        ["a,b,c", *(f"{k},1,2" for k in range(9))],
    )
    assert "p9.csv" in refused(tmp_path)


def test_times_in_milliseconds_and_whole_seconds_are_no_fractions(tmp_path):
    for name, of_time in (("t_ms", lambda n: f"{1000 * T[n]:.0f}"), ("t,ms", lambda n: f"{T[n]:.0f},0")):
        path = file_of(
            tmp_path / "a.csv", lambda n, of_time=of_time: f"{PERSON[n]},{of_time(n)},{X[n]:.3f},{Y[n]:.3f}",
            f"id,{name},x,y",
        )  # fmt: skip
        assert sum(len(part.t) for part in drafted(path, tmp_path)[2]) == len(ROWS)


def test_parts_of_a_body_are_one_person(tmp_path):
    def line(n):
        return "\n".join(f"{PERSON[n]},{T[n]:.1f},{part},{X[n] + dx:.3f},{Y[n]:.3f}"
                         for part, dx in (("head", 0), ("left", 0.2), ("right", -0.2)))  # fmt: skip

    told = refused(file_of(tmp_path / "a.csv", line, "id,t,marker,x,y"))
    assert "`only: {marker: [head]}`" in told


def test_boxes_of_a_tracker_are_frames_and_pixels(tmp_path):
    left, top = np.rint(40 * X + 800).astype(int), np.rint(20 * Y + 600).astype(int)
    by_frame = np.lexsort((PERSON, FRAME))

    def line(n):
        n = by_frame[n]
        return f"{FRAME[n] // 25 + 1},{PERSON[n]},{left[n]},{top[n]},21.5,60,1,-1,-1,-1"

    for header in ("", "frame,id,bb_left,bb_top,bb_width,bb_height,conf,x,y,z"):
        keys, draft, _ = drafted(file_of(tmp_path / "a.csv", line, header), tmp_path)
        names = {"track_id": "id", "t": "frame", "x": "bb_left", "y": "bb_top"}
        assert keys["columns"] == (names if header else {"track_id": 1, "t": 0, "x": 2, "y": 3})
        assert keys["units"] == {"time": "frame", "length": "px"}
        assert all("decide" in line_of(draft, key) for key in ("columns", "frame_rate", "scale"))
        assert "box" in line_of(draft, "columns")


def test_a_height_and_a_speed_beside_positions_are_no_box(tmp_path):
    """As in ATC's raw files, which have no header."""
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{1772442000 + T[n] + 0.25:.3f},{PERSON[n]},{1000 * X[n]:.0f},{1000 * Y[n]:.0f},1650,1200,0.3,0.3",
    )
    keys, draft, _ = drafted(path, tmp_path)
    assert keys["columns"] == {"track_id": 1, "t": 0, "x": 2, "y": 3}
    assert "boxes" not in draft


def test_boxes_with_lost_rows_and_classes(tmp_path):
    left, top = np.rint(30 * X + 500).astype(int), np.rint(30 * Y + 500).astype(int)
    kind = np.array(["Pedestrian", "Biker"])[PERSON % 2]

    def line(n):
        box = f"{left[n] - 10} {top[n] - 20} {left[n] + 10} {top[n] + 20}"
        return f'{PERSON[n]} {box} {FRAME[n]} {int(SOME[n])} 0 {n % 2} "{kind[n]}"'

    keys, _, _ = drafted(file_of(tmp_path / "annotations.txt", line), tmp_path)
    assert keys["columns"] == {"track_id": 0, "t": 5, "x": 1, "y": 2}
    assert keys["units"] == {"time": "frame", "length": "px"}
    assert keys["only"] == {"9": ["Pedestrian"]}
    assert keys["without"] == {"6": [1]} or keys["without"] == {"6": ["1"]}


@pytest.mark.parametrize(("seen", "lost"), [("0", "1"), ("0.0", "1.0"), ("False", "True"), ("no", "yes"), ("0", "2")])
def test_lost_boxes_are_left_out_however_that_is_written(tmp_path, seen, lost):
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f},{lost if SOME[n] else seen}",
        "id,t,x,y,lost",
    )
    keys, draft, tracks = drafted(path, tmp_path)
    if lost == "2":
        assert "decide: column 'lost' holds 0, 2" in draft
    else:
        assert keys["without"] == {"lost": [lost]}
        assert sum(len(part.t) for part in tracks) < len(ROWS)


@pytest.mark.parametrize("unit", ["s", "frame"])
def test_whole_numbers_are_asked_about(tmp_path, unit):
    """Seconds and centimetres, or frames and pixels: the file does not say it."""
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{int(T[n])},{100 * X[n]:.0f},{100 * Y[n] - 9000:.0f}",
        "id,frame,x,y" if unit == "frame" else "id,t,x,y",
    )  # fmt: skip
    _, draft, _ = drafted(path, tmp_path)
    assert "decide" in line_of(draft, "units")


@pytest.mark.parametrize("name", ["stamp_us", "t"])
@pytest.mark.parametrize(("unit", "per", "since"), [("us", 1e6, 0), ("us", 1e6, 987_654_321), ("ns", 1e9, 0)])
def test_times_since_a_computer_was_started(tmp_path, name, unit, per, since):
    """Whole numbers that by chance look like seconds since 1970, where nobody has two rows within a minute."""
    name = name.replace("us", unit)
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{T[n] * per + since:.0f},{X[n]:.3f},{Y[n]:.3f}", f"id,{name},x,y"
    )
    keys, _, tracks = drafted(path, tmp_path)
    assert keys["units"] == {"time": unit}
    assert keys["clock"] == "unknown"
    assert sum(len(np.unique(part.track_id)) for part in tracks) == 30


@pytest.mark.parametrize("name", ["stamp_ms", "t"])
def test_milliseconds_since_a_computer_was_started_days_ago(tmp_path, name):
    """As seconds, these are of 1982, and of rows that are half a minute apart."""
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{400_000_000 + 33 * T[n]:.0f},{X[n] / 30:.3f},{Y[n] / 30:.3f}",
        f"id,{name},x,y",
    )  # fmt: skip
    keys, _, _ = drafted(path, tmp_path)
    assert keys["units"] == {"time": "ms"}
    assert keys["clock"] == "unknown"


def test_a_name_s_unit_gives_way_to_one_by_which_people_walk(tmp_path):
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{1_772_442_000 + T[n]:.2f},{X[n]:.3f},{Y[n]:.3f}", "id,t_ms,x,y"
    )
    keys, _, _ = drafted(path, tmp_path)
    assert "units" not in keys
    assert str(keys["recordings"][0]["day"]) == "2026-03-02"


@pytest.mark.parametrize("name", ["timestamp", "time_ms", "seconds"])
def test_times_are_preferred_to_frames(tmp_path, name):
    factor, begin = {"timestamp": (1, 1_772_442_000), "time_ms": (1000, 0), "seconds": (1, 0)}[name]
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{PERSON[n]},{FRAME[n]},{begin + factor * T[n]:.2f},{X[n]:.3f},{Y[n]:.3f}",
        f"id,frame,{name},x,y",
    )
    keys, _, _ = drafted(path, tmp_path)
    assert keys["columns"]["t"] == name
    assert "frame_rate" not in keys


def test_a_height_is_not_a_position(tmp_path):
    height = 1.7 + RNG.normal(0, 0.03, len(ROWS))
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{height[n]:.3f},{Y[n]:.3f}", "id,t,x,y,z"
    )
    keys, draft, _ = drafted(path, tmp_path)
    assert keys["columns"] == {**PLACES, "y": "z"}
    assert "decide" in line_of(draft, "columns")


@pytest.mark.parametrize("length", ["m", "mm"])
def test_a_national_grid_gets_a_local_origin(tmp_path, length):
    per = {"m": 1, "mm": 1000}[length]
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{PERSON[n]},{T[n]:.1f},{per * (X[n] + 512_345):.3f},{per * (Y[n] + 6_570_123):.3f}",
        "id,t,x,y",
    )
    keys, draft, tracks = drafted(path, tmp_path)
    assert np.abs(np.subtract(keys["origin_m"], (512_345, 6_570_123))).max() < 100
    assert "decide" in line_of(draft, "origin_m")
    assert sum(len(part.t) for part in tracks) == len(ROWS)


def test_feet(tmp_path):
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n] / 0.3048:.3f},{Y[n] / 0.3048:.3f}",
        "id,t,x (ft),y (ft)",
    )
    keys, _, _ = drafted(path, tmp_path)
    assert (keys["units"], keys["scale"]) == ({"length": "px"}, 0.3048)


def test_names_in_another_encoding_are_called_by_position(tmp_path):
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{PERSON[n]};{T[n]:.1f};{X[n]:.3f};{Y[n]:.3f};Straße",
        "Fußgänger;Zeit;x;y;wo",
        "cp1252",
    )
    keys, _, tracks = drafted(path, tmp_path)
    assert keys["columns"]["track_id"] == 0
    assert sum(len(part.t) for part in tracks) == len(ROWS)


def test_quoted_ids_may_hold_the_separator(tmp_path):
    path = file_of(
        tmp_path / "a.csv", lambda n: f'"Smith, {PERSON[n]}",{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}', '"id","t","x","y"'
    )
    keys, _, tracks = drafted(path, tmp_path)
    assert keys["columns"] == PLACES
    assert sum(len(np.unique(part.track_id)) for part in tracks) == 30


@pytest.mark.parametrize(
    ("header", "line", "told"),
    [
        ("id,time,x,y", "{p},{days:.8f},{x:.3f},{y:.3f}", "days, as spreadsheets count them (2026-03-02 09:00"),
        ("id,minutes,x,y", "{p},{minutes:.6f},{x:.3f},{y:.3f}", "minutes"),
        ("id,t,x,y", "{p},{minutes:.6f},{x:.3f},{y:.3f}", "minutes"),
        ("id,t,lat,lon", "{p},{t:.1f},{lat:.8f},{lon:.8f}", "project them to metres"),
        ("id,t,x,y", "{p},{digits:08.1f},{x:.3f},{y:.3f}", "times such as 085913.0 are hours, minutes and seconds"),
        ("id,t,x,y", "{p},20260302{whole:06d},{x:.3f},{y:.3f}", "written as one number"),
        ("id,t,x,y", "{p},{thousandths:09.0f},{x:.3f},{y:.3f}", "written as one number"),
        ("id,t,x,y", "{p},{t:.1f},{lon:.8f},{lat:.8f}", "project them to metres"),
        ("", "{p},{t:.1f},{lat:.8f},{lon:.8f}", "project them to metres"),
        ("date,time,id,x,y", "2026-03-02,{clock},{p},{x:.3f},{y:.3f}", "write both into one column"),
        ("t,x1,y1,x2,y2,x3,y3", "{t:.1f},{x:.2f},{y:.2f},{y:.2f},{x:.2f},{y:.2f},{y:.2f}", "one row for each person"),
        ("t,id1,x1,y1,id2,x2,y2", "{t:.1f},{p},{x:.2f},{y:.2f},7,{y:.2f},{x:.2f}", "one row for each person"),
        ("t,a_x,a_y,b_x,b_y", "{n},{n:.2f},{y:.2f},{y:.2f},{n:.2f}", "or, where a line holds several people"),
        ("id,t,x,y", "{p},{t:.1f},{x:.3f} E,{y:.3f} N", "no numbers"),
        ("", '{p},{t:.1f},"{mm:,.0f}","{mm:,.0f}"', "with ; between columns"),
        ("id,Datum,x,y", "{p},02.03.2026 {clock},{x:.3f},{y:.3f}", "times such as '02.03.2026 09:00:00.0' are neither"),
        ("id;Uhrzeit;x;y", "{p};{clock};{x:.3f};{y:.3f}", "times such as '09:00:00.0' are neither"),
        ("id,date,x,y", "{p},2026/3/2 {clock},{x:.3f},{y:.3f}", "nor ISO 8601 (2026-03-02T09:00:00.5"),
        ("id,t,x,y", "{p},{unix:.6e},{x:.3f},{y:.3f}", "times written with all of their digits"),
        ("id,t,x,y", "{p},{slow:.0f},{x:.3f},{y:.3f}", "rows of a person are 200 s apart, read with times in frame"),
    ],
)
def test_what_no_option_reads_is_answered_with_the_remedy(tmp_path, header, line, told):
    def written(n):
        minutes, seconds = divmod(32_353 + 1.7 * T[n] + 9 * PERSON[n], 60)
        digits = minutes // 60 * 10_000 + minutes % 60 * 100 + seconds
        return line.format(
            digits=digits, whole=int(digits), thousandths=1000 * digits,
            n=n, p=PERSON[n], t=T[n], x=X[n], y=Y[n], days=46083.375 + T[n] / 86400, minutes=T[n] / 60,
            lat=59.2741 + Y[n] / 111_000, lon=15.2066 + X[n] / 56_900, mm=1000 * X[n],
            unix=1772442000 + T[n], slow=5000 * T[n], clock=f"09:{int(T[n]) // 60:02d}:{T[n] % 60:04.1f}",
        )  # fmt: skip

    assert told in refused(file_of(tmp_path / "a.csv", written, header))


def test_a_header_and_nothing_else(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("id,t,x,y\n")
    assert "no row" in refused(path)


def one_file_each(folder, header, text, suffix="csv"):
    folder.mkdir()
    for person in np.unique(PERSON):
        rows = [text(n) for n in np.flatnonzero(person == PERSON)]
        (folder / f"p{person:03d}.{suffix}").write_text("\n".join([header, *rows] if header else rows) + "\n")
    return folder


@pytest.mark.parametrize(
    ("header", "text", "columns"),
    [
        ("t,x,y", lambda n: f"{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}", {"t": "t", "x": "x", "y": "y"}),
        ("", lambda n: f"{T[n]:.1f} {X[n]:.3f} {Y[n]:.3f}", {"t": 0, "x": 1, "y": 2}),
        ("id,t,x,y", lambda n: f"7,{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}", {"t": "t", "x": "x", "y": "y"}),
        ("t;x;y;z", lambda n: f"{T[n]:.1f};{X[n]:.3f};{Y[n]:.3f};1.7", {"t": "t", "x": "x", "y": "y"}),
        ("# rate 1", lambda n: f"{T[n]:.1f} {X[n]:.3f} {Y[n]:.3f}", {"t": 0, "x": 1, "y": 2}),
        ("# rate 1\nt,x,y", lambda n: f"{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}", {"t": "t", "x": "x", "y": "y"}),
        ("# y,x,t", lambda n: f"{Y[n]:.3f},{X[n]:.3f},{T[n]:.1f}", {"t": 2, "x": 1, "y": 0}),
    ],
)
def test_a_folder_with_a_file_for_each_person(tmp_path, header, text, columns):
    folder = one_file_each(tmp_path / "persons", header, text)
    keys, _, tracks = drafted(folder, tmp_path)
    assert keys["file_is"] == "person"
    assert keys["columns"] == columns
    assert keys["recordings"][0]["files"] == "persons/*.csv"
    assert sum(len(part.t) for part in tracks) == len(ROWS)
    if not header.startswith("id"):
        assert "inspect its folder" in refused(folder / "p003.csv")


@pytest.mark.parametrize("header", ["id,t,x,y", "person,t,x,y", ""])
def test_a_small_file_of_several_people_makes_files_recordings(tmp_path, header):
    folder = one_file_each(tmp_path / "files", header, lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}")
    assert guess_people(sorted(folder.iterdir())) is not None
    few = [f"{p},{t:.1f},{x:.3f},{y:.3f}" for p in (40, 41) for t, x, y in ((0, 1, 2), (1, 2, 2), (2, 3, 2))]
    (folder / "p040.csv").write_text("\n".join([header, *few] if header else few) + "\n")
    assert guess_people(sorted(folder.iterdir())) is None


def test_a_column_that_tells_people_of_one_file_apart_is_asked_about_in_each_file(tmp_path):
    def text(n):
        return "\n".join(f"{T[n]:.1f},{X[n] + 20 * part:.3f},{Y[n]:.3f},{'ab'[part]}" for part in (0, 1))

    folder = one_file_each(tmp_path / "files", "t,x,y,who", text)
    assert guess_people(sorted(folder.iterdir())) is None


def test_files_of_one_name_in_several_folders_are_not_one_person(tmp_path):
    for part in ("g1", "g2"):
        (tmp_path / part).mkdir()
        one_file_each(tmp_path / part / "persons", "", lambda n: f"{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}")
    told = refused(tmp_path)
    assert all(f"{part}/persons/p000.csv" in told for part in ("g1", "g2"))
    assert drafted(tmp_path / "g1", tmp_path)[0]["recordings"][0]["files"] == "g1/**/*.csv"


def test_classes_in_a_file_for_each_person(tmp_path):
    kind = np.array(["Pedestrian", "Biker"])[PERSON % 2]
    for header in ("t,x,y,kind", ""):
        folder = one_file_each(
            tmp_path / f"persons{len(header)}", header, lambda n: f"{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f},{kind[n]}"
        )
        keys, _, tracks = drafted(folder, tmp_path)
        assert keys["only"] == {"kind" if header else "3": ["Pedestrian"]}
        assert sum(len(part.t) for part in tracks) == (PERSON % 2 == 0).sum()


def test_a_folder_of_recordings_lists_them(tmp_path):
    (tmp_path / "days").mkdir()
    for day, begin in enumerate((0, 86_400, 172_800)):
        file_of(
            tmp_path / f"days/{day}.csv",
            lambda n, begin=begin: (
                f"{PERSON[n]},{1_772_442_000 + begin + T[n]:.1f},{X[n] + begin / 1e5:.3f},{Y[n]:.3f}"
            ),
            "id,t,x,y",
        )
    keys, draft, tracks = drafted(tmp_path / "days", tmp_path)
    assert [(one["files"], str(one["day"]), one["split"]) for one in keys["recordings"]] == [
        ("days/0.csv", "2026-03-02", "train"), ("days/1.csv", "2026-03-03", "train"),
        ("days/2.csv", "2026-03-04", "test"),
    ]  # fmt: skip
    assert "2 other files" in draft
    assert len(tracks) == 3


@pytest.mark.parametrize("suffix", ["", ".gz"])
def test_days_of_a_folder_s_other_files_are_those_of_all_their_rows(tmp_path, suffix):
    (tmp_path / "days").mkdir()
    for number in range(2):
        rows = [
            f"{p + 1000 * k},{1_772_442_000 + 86_400 * (2 * number + k // 40) + t:.1f},{x:.3f},{y:.3f}"
            for k in range(80 - number)
            for p, t, x, y in zip(PERSON, T, X, Y, strict=True)
        ]
        text = ("\n".join(["id,t,x,y", *rows]) + "\n").encode()
        (tmp_path / f"days/{number}.csv{suffix}").write_bytes(gzip.compress(text) if suffix else text)
    keys = yaml.safe_load(inspect_file(tmp_path / "days", tmp_path).draft)
    assert [(str(one["day"]), one["days"]) for one in keys["recordings"]] == [("2026-03-02", 2), ("2026-03-04", 2)]


@pytest.mark.parametrize("text", ["1772528400000", "unknown"])
def test_a_folder_s_files_with_other_times_are_refused_by_name(tmp_path, text):
    (tmp_path / "days").mkdir()
    line = "{p},{t},{x:.3f},{y:.3f}"
    for name, times in (("a", 1_772_442_000 + T), ("b", [text] * 300)):
        rows = [line.format(p=PERSON[n], t=t, x=X[n], y=Y[n]) for n, t in enumerate(times)]
        (tmp_path / f"days/{name}.csv").write_text("\n".join(["id,t,x,y", *rows]) + "\n")
    told = refused(tmp_path / "days")
    assert "b.csv: times in column 't' are none in s" in told


def test_a_folder_without_a_recording_is_refused(tmp_path):
    (tmp_path / "nothing").mkdir()
    assert "no file" in refused(tmp_path / "nothing")


def test_a_path_under_the_data_root_is_relative_also_through_a_link(tmp_path, monkeypatch):
    (tmp_path / "disk").mkdir()
    file_of(tmp_path / "disk/a.csv", lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}", "id,t,x,y")
    (tmp_path / "data").mkdir()
    (tmp_path / "data/site").symlink_to(tmp_path / "disk")
    monkeypatch.chdir(tmp_path)
    for path in ("data/site/a.csv", tmp_path / "data/site/a.csv", "disk/../data/site/a.csv"):
        found = inspect_file(path, "data")
        assert yaml.safe_load(found.draft)["recordings"][0]["files"] == "site/a.csv"
    monkeypatch.setenv("HOME", str(tmp_path))
    assert yaml.safe_load(inspect_file("data/site/a.csv", "~/data").draft)["recordings"][0]["files"] == "site/a.csv"
    outside = inspect_file("disk/a.csv", "data")
    assert "decide" in next(line for line in outside.draft.splitlines() if "a.csv" in line)


# --- columns that are not what they may seem ----------------------------------------------------------------


@pytest.mark.parametrize("header", ["id,t,x,y", ""])
def test_a_row_number_is_no_position(tmp_path, header):
    """As pandas and R write it: with a header, that has a name less."""
    path = file_of(tmp_path / "a.csv", lambda n: f"{n},{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}", header)
    keys, _, _ = drafted(path, tmp_path)
    assert keys["columns"] == {"track_id": 1, "t": 2, "x": 3, "y": 4}


@pytest.mark.parametrize(
    ("names", "others"),
    [
        ("id,track_id", lambda n: n),  # the key of a database
        ("agent,id", lambda n: "pedestrian"),
        ("object,track_id", lambda n: "child" if PERSON[n] % 5 else "adult"),
        ("obj,id", lambda n: (7 * PERSON[n] + 11 * int(T[n])) % 30),  # a number of each detection at its time
        ("person,id", lambda n: PERSON[n]),
    ],
)
@pytest.mark.parametrize("axes", ["x,y", "e,n"])
def test_of_several_columns_that_are_called_as_ids_people_s_is_taken(tmp_path, names, others, axes):
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{others(n)},{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}", f"{names},t,{axes}"
    )
    keys, _, tracks = drafted(path, tmp_path)
    assert keys["columns"]["track_id"] == names.split(",")[not names.startswith("person")]
    assert sum(len(part.bounds()) - 1 for part in tracks) == 30
    assert sum(len(part.t) for part in tracks) == len(ROWS)


def test_a_row_number_that_is_called_as_ids_are_is_no_id(tmp_path):
    path = file_of(tmp_path / "a.csv", lambda n: f"{n},{T[n]:.1f},{PERSON[n]},{X[n]:.3f},{Y[n]:.3f}", "no,t,walker,x,y")
    assert drafted(path, tmp_path)[0]["columns"]["track_id"] == "walker"
    folder = one_file_each(tmp_path / "persons", "id,t,x,y", lambda n: f"{n},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}")
    assert drafted(folder, tmp_path)[0]["file_is"] == "person"


def test_a_second_time_is_no_position(tmp_path):
    path = file_of(tmp_path / "a.csv", lambda n: f"{FRAME[n]},{T[n]:.1f},{PERSON[n]},{X[n]:.3f},{Y[n]:.3f}")
    keys, _, _ = drafted(path, tmp_path)
    assert {role: keys["columns"][role] for role in ("track_id", "x", "y")} == {"track_id": 2, "x": 3, "y": 4}


def test_angles_are_no_positions(tmp_path):
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{PERSON[n]},{T[n]:.1f},{np.hypot(X[n], Y[n]):.3f},{np.arctan2(Y[n], X[n]):.4f}",
        "id,t,range,bearing",
    )
    assert "no choice of id, time, x and y" in refused(path)


@pytest.mark.parametrize("names", ["secs,nsecs", "stamp_sec,stamp_nanosec"])
def test_times_in_two_columns_of_seconds_and_less(tmp_path, names):
    rows = people(number=20, rows=60, step_s=0.2)
    lines = [f"{int(t)},{round(t % 1 * 1e9):d},{int(p)},{x:.3f},{y:.3f}" for p, t, x, y, _, _ in rows]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([f"{names},id,x,y", *lines]) + "\n")
    assert "add them up" in refused(path)


def test_a_first_row_that_was_not_measured_is_no_header(tmp_path):
    def line(n):
        return f"{PERSON[n]},{T[n]:.1f}," + ("NULL,NULL" if n % 7 == 0 else f"{X[n]:.3f},{Y[n]:.3f}")

    keys, _, _ = drafted(file_of(tmp_path / "a.csv", line, "id,t,x,y"), tmp_path)
    assert keys["columns"] == PLACES
    assert "skip_lines" not in keys


def test_robots_among_the_ids(tmp_path):
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{'Robot_1' if PERSON[n] == 4 else PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}",
        "id,t,x,y",
    )
    keys, draft, tracks = drafted(path, tmp_path)
    assert keys["without"] == {"id": ["Robot_1"]}
    assert "decide" in line_of(draft, "without")
    assert sum(len(part.t) for part in tracks) == (PERSON != 4).sum()


def test_names_of_people_that_hold_a_vehicle_s_word_are_asked_about(tmp_path):
    first = ["van der Berg", "anna", "train", "car driver"]
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{first[PERSON[n] % 4]} {PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}",
        "id,t,x,y",
    )
    keys, draft, tracks = drafted(path, tmp_path)
    assert "without" not in keys
    assert "decide: are ids such as car driver 11" in draft
    assert sum(len(part.t) for part in tracks) == len(ROWS)


@pytest.mark.parametrize("others", ["x_px,y_px", "px,py", "x [mm],y [mm]"])
def test_metres_are_preferred_to_other_lengths_beside_them(tmp_path, others):
    path = file_of(
        tmp_path / "a.csv",
        lambda n: f"{PERSON[n]},{T[n]:.1f},{900 * X[n]:.0f},{900 * Y[n]:.0f},{X[n]:.3f},{Y[n]:.3f}",
        f"id,t,{others},x_m,y_m",
    )
    keys, _, _ = drafted(path, tmp_path)
    assert keys["columns"] == {**PLACES, "x": "x_m", "y": "y_m"}
    assert "units" not in keys


@pytest.mark.parametrize("unit", ["km", "standing", "minutes of iso"])
def test_where_nothing_gives_a_walking_speed_positions_stay_metres_and_are_asked_about(tmp_path, unit):
    def line(n):
        if unit == "km":
            return f"{PERSON[n]},{T[n]:.2f},{X[n] / 1000:.6f},{Y[n] / 1000:.6f}"
        if unit == "standing":
            return f"{PERSON[n]},{T[n] + 0.01:.2f},{PERSON[n] + RNG.normal(0, 0.01):.3f},{RNG.normal(0, 0.01):.3f}"
        return f"{PERSON[n]},2026-03-02T09:{int(T[n]) // 60:02d},{X[n]:.3f},{Y[n]:.3f}"

    found = inspect_file(file_of(tmp_path / "a.csv", line, "id,t,x,y"), tmp_path)
    keys = yaml.safe_load(found.draft)
    assert "scale" not in keys
    assert keys["units"]["length"] == "m"
    assert "decide: positions have no unit, and no unit gives a walking speed" in line_of(found.draft, "units")


def test_kilometres_by_name(tmp_path):
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{T[n]:.1f},{X[n] / 1000:.6f},{Y[n] / 1000:.6f}", "id,t,x_km,y_km"
    )
    keys, _, _ = drafted(path, tmp_path)
    assert (keys["units"], keys["scale"]) == ({"length": "px"}, 1000.0)


def test_times_that_go_back_within_an_id_are_asked_about(tmp_path):
    """A clock that begins anew at midnight, or two recordings in one file."""
    by_time = np.lexsort((PERSON, T))
    midnight = file_of(
        tmp_path / "a.csv",
        lambda n: (
            f"{PERSON[by_time[n]]},{(86_350 + T[by_time[n]]) % 86_400:.1f},{X[by_time[n]]:.3f},{Y[by_time[n]]:.3f}"
        ),
        "id,t,x,y",
    )
    assert "times go back" in drafted(midnight, tmp_path)[1]
    for order in (np.arange(len(PERSON)), by_time, by_time[::-1], RNG.permutation(len(PERSON))):
        path = file_of(
            tmp_path / "b.csv",
            lambda n, order=order: f"{PERSON[order[n]]},{T[order[n]]:.1f},{X[order[n]]:.3f},{Y[order[n]]:.3f}",
            "id,t,x,y",
        )
        assert "times go back" not in drafted(path, tmp_path)[1]


def test_times_from_each_person_s_own_begin_are_asked_about(tmp_path):
    path = file_of(
        tmp_path / "a.csv", lambda n: f"{PERSON[n]},{T[n] - 3 * PERSON[n]:.1f},{X[n]:.3f},{Y[n]:.3f}", "id,t,x,y"
    )
    assert "begin at the same time" in drafted(path, tmp_path)[1]


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ('[{"id": 1, "t": 0.0, "x": 1.0, "y": 2.0},\n{"id": 1, "t": 1.0, "x": 2.0, "y": 2.0}]\n', "is JSON"),
        ('[{"id": 1, "t": 0.0, "x": 1.0, "y": 2.0}, {"id": 1, "t": 1.0, "x": 2.0, "y": 2.0}]', "is JSON"),
        ("id,t,x,y\n" + "".join(f"1,{n},\u0661,\u0662.\u0663\n" for n in range(20)), "of digits 0 to 9, as its time"),
        ("id,t,x,y\n" + "\u0661,\u0661,\u0661,\u0662\n" * 20, "digits other than 0 to 9, such as"),
        ("id,t,x,y\n" + "".join(f"1,{n},NaN,NaN\n" for n in range(20)), "has '0', 'NaN', 'NaN'"),
        ("id,t,x,y\n" + "".join(f"1,{n}s,{n}.5m,2.0m\n" for n in range(20)), "numbers with their units"),
    ],
)
def test_other_tables_are_refused_with_the_reason(tmp_path, content, told):
    path = tmp_path / "a.csv"
    path.write_text(content)
    assert told in refused(path)


# --- lines that are no rows, or other rows ------------------------------------------------------------------


def row_of(n):
    return f"{PERSON[n]},{T[n]:.1f},{X[n]:.3f},{Y[n]:.3f}"


@pytest.mark.parametrize("header", ["id,t,x,y", "id,t,x,y,note", ""])
@pytest.mark.parametrize(
    "line",
    [
        lambda n: row_of(n) + ",begun" * (n >= 200),
        lambda n: row_of(n) + ",ends" * (n < 200),
        lambda n: row_of(n) + ",a,b" * (n % 4 == 0),
        lambda n: row_of(n) + (',"two\nlines"' if n < 200 else ',"one"'),
    ],
)
def test_rows_of_many_widths_are_refused_and_never_skipped(tmp_path, header, line):
    told = refused(file_of(tmp_path / "a.csv", line, header))
    assert "write all rows with as many fields" in told or "write each row in one line" in told
    assert "such as" in told


def test_marks_that_end_lines_elsewhere_end_none_here(tmp_path):
    path = file_of(tmp_path / "a.csv", lambda n: row_of(n) + ",one\x0ctwo\u2028three", "by\x0bme\nid,t,x,y,note")
    keys, _, tracks = drafted(path, tmp_path)
    assert keys["skip_lines"] == 1
    assert sum(len(part.t) for part in tracks) == len(ROWS)


def test_a_few_rows_of_another_width_cost_no_header_and_are_told(tmp_path):
    """Before any of the others, too; in a preamble they may be no rows, so that is asked."""
    for odd in (range(2), range(48, 50)):
        path = file_of(tmp_path / "a.csv", lambda n, odd=odd: row_of(n) + ",x" * (n not in odd), "id,t,x,y,note")
        keys, draft, tracks = drafted(path, tmp_path)
        assert keys["columns"] == PLACES
        assert "skip_lines" not in keys
        assert f"decide: rows with other than 5 fields are not read: {len(odd)} " in draft
        assert sum(len(part.t) for part in tracks) == len(ROWS) - len(odd)
    _, draft, tracks = drafted(file_of(tmp_path / "a.csv", row_of, "30,2,2026\n0,0,1\nid,t,x,y"), tmp_path)
    assert "decide" in line_of(draft, "skip_lines")
    assert sum(len(part.t) for part in tracks) == len(ROWS)


def test_ids_that_begin_like_comments(tmp_path):
    path = file_of(tmp_path / "a.csv", lambda n: ("#" if PERSON[n] < 3 else "") + row_of(n), "id,t,x,y")
    assert "decide" in line_of(drafted(path, tmp_path)[1], "comment")
    for separator in (",", "  "):
        path = file_of(
            tmp_path / "b.csv",
            lambda n, mark=separator: "#" + row_of(n).replace(",", mark),
            "id,t,x,y".replace(",", separator),
        )
        keys, _, tracks = drafted(path, tmp_path)
        assert not keys.get("comment")
        assert sum(len(part.t) for part in tracks) == len(ROWS)
    keys, draft, _ = drafted(file_of(tmp_path / "c.csv", row_of, "# by: me\nid,t,x,y"), tmp_path)
    assert keys["comment"] == "#"
    assert "decide" not in line_of(draft, "comment")


@pytest.mark.parametrize("header", ["\nid,t,x,y", "\n  \n\nid,t,x,y", "\n", "id,t,x,y\n,,,\n,,,"])
def test_blank_lines_at_the_start(tmp_path, header):
    keys, _, tracks = drafted(file_of(tmp_path / "a.csv", row_of, header), tmp_path)
    assert "skip_lines" not in keys
    assert keys.get("header", False) == ("id" in header)
    assert sum(len(part.t) for part in tracks) == len(ROWS)


@pytest.mark.parametrize(
    "below", [",s,m,m", "[-],[s],[m],[m]", "(1),(sec),(metres),(metres)", "int,float,float,float", "ID,Zeit,Ort,Ort"]
)
def test_a_row_of_units_or_types_below_the_names_is_no_header(tmp_path, below):
    keys, _, tracks = drafted(file_of(tmp_path / "a.csv", row_of, f"id,t,x,y\n{below}"), tmp_path)
    assert keys["columns"] == PLACES
    assert "skip_lines" not in keys
    assert sum(len(part.t) for part in tracks) == len(ROWS)


@pytest.mark.parametrize("rows", [2, 3, 4])
def test_a_table_may_be_short(tmp_path, rows):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["id,t,x,y", *map(row_of, range(rows))]) + "\n")
    assert yaml.safe_load(inspect_file(path).draft)["columns"] == PLACES


def test_columns_of_nothing_are_no_table(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(",,,,\n" * 20)
    with pytest.raises(DataError, match="holds no table"):
        inspect_file(path)
