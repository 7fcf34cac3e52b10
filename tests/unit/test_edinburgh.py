"""The Edinburgh forum's two forms: raw text, and days of every 4th frame as rows."""

import dataclasses
from functools import partial

import numpy as np
import pytest

from modlhmp.cleaning import clean_recording, tell_of_faults
from modlhmp.file_format import Recording
from modlhmp.readers import edinburgh, raw
from modlhmp.storage import DataError
from modlhmp.study import demo

RATE, SCALE, ORIGIN = 9.0, 0.0247, 1_277_971_200.0


def text_of(tracks, announce=True):
    """Raw text of {number: [(x, y, frame), ...]}; a point may also be text."""
    lines = [f"% Total number of trajectories in file are  {len(tracks)} ", ""] if announce else []
    for number, points in tracks.items():
        texts = [p if isinstance(p, str) else "[" + " ".join(map(str, p)) + "]" for p in points]
        lines += [f"Properties.R{number}=[{len(texts)} 1 2 3.45 ];", f" TRACK.R{number}=[{';'.join(texts)}];"]
    return "\n".join(lines) + "\n"


def read_raw(path):
    """Read, and check that the account adds up."""
    tracks, account = edinburgh.read_raw(path, RATE, SCALE, ORIGIN)
    assert account.rows_read == len(tracks.t) + sum(account.dropped_rows.values())
    kept = len(np.unique(tracks.track_id))
    assert account.tracks_read == kept + sum(account.dropped_tracks.values())
    return tracks, account


def straight(start, end, frames, first=0):
    """Points (x, y, frame) from `start` to `end` px, rounded, a frame apart."""
    xy = np.rint(np.linspace(start, end, frames)).astype(int)
    return [(x, y, first + k) for k, (x, y) in enumerate(xy.tolist())]


# --- raw text -----------------------------------------------------------------------------------------------


def test_points_become_metres_and_seconds(write):
    path = write(text_of({1: [(10, 20, 90), (14, 24, 99)], 7: [(600, 400, 9)]}))
    tracks, account = read_raw(path)
    assert tracks.track_id.tolist() == [1, 1, 7]
    assert tracks.x.tolist() == pytest.approx([0.247, 0.3458, 14.82])
    assert tracks.y.tolist() == pytest.approx([0.494, 0.5928, 9.88])
    assert tracks.t.tolist() == [ORIGIN + 10, ORIGIN + 11, ORIGIN + 1]
    assert np.isnan([tracks.speed, tracks.heading]).all()
    assert (account.rows_read, account.tracks_read) == (3, 2)


def test_tracks_are_sorted_by_their_number(write):
    tracks, _ = read_raw(write(text_of({12: [(1, 1, 5)], 3: [(2, 2, 9)], 100: [(3, 3, 1)]})))
    assert tracks.track_id.tolist() == [3, 12, 100]


@pytest.mark.parametrize("change", ["crlf", "no last newline", "no announcement", "no indent", "spaces"])
def test_harmless_forms_of_the_text(write, change):
    planted = {1: [(10, 20, 1), (11, 21, 2)], 2: [(30, 40, 3)]}
    text = text_of(planted, announce=change != "no announcement")
    text = {
        "crlf": text.replace("\n", "\r\n"),
        "no last newline": text.rstrip("\n"),
        "no indent": text.replace(" TRACK", "TRACK"),
        "spaces": text.replace("=[[", " = [ [").replace("];[", "] ; ["),
    }.get(change, text)
    expected, _ = read_raw(write(text_of(planted), "plain.txt"))
    tracks, account = read_raw(write(text, "changed.txt"))
    assert [c.tolist() for c in tracks[:4]] == [c.tolist() for c in expected[:4]]
    assert dict(account.dropped_rows) == {}


@pytest.mark.parametrize(
    ("frames", "kept"),
    [
        ([5, 6, 6, 7], [5, 6, 7]),
        ([5, 6, 6, 6, 6], [5, 6]),
        ([5, 9, 6, 7, 9, 10], [5, 9, 10]),  # later than all before, not than the one before
        ([5, 4, 3, 2], [5]),
        ([5, 16, 28], [5, 16, 28]),
    ],
)
def test_repeated_and_decreasing_frames_are_dropped(write, frames, kept):
    path = write(text_of({1: [(100 + k, 50, frame) for k, frame in enumerate(frames)], 2: [(1, 1, 1)]}))
    tracks, account = read_raw(path)
    assert ((tracks.t[tracks.track_id == 1] - ORIGIN) * RATE).tolist() == pytest.approx(kept, abs=1e-5)
    assert account.dropped_rows.get("frame_not_increasing", 0) == len(frames) - len(kept)


@pytest.mark.parametrize(
    ("point", "reason"),
    [
        ("[11 abc 2]", "text_value"),
        ("[11 21]", "wrong_column_count"),
        ("[11 21 2 2]", "wrong_column_count"),
        ("[]", "wrong_column_count"),
        ("[nan 21 2]", "nan_value"),
        ("[11 NaN 2]", "nan_value"),
        ("[11 inf 2]", "infinite_value"),
        ("[11 21 -inf]", "infinite_value"),
        ("[1e12 21 2]", "absurd_value"),
        ("[11 -999999999 2]", "absurd_value"),
    ],
)
def test_a_bad_point_is_dropped_under_its_name(write, point, reason):
    path = write(text_of({4: [(10, 20, 1), point, (12, 22, 3)], 5: [(1, 1, 1), (2, 2, 2)]}))
    tracks, account = read_raw(path)
    assert dict(account.dropped_rows) == {reason: 1}
    assert tracks.track_id.tolist() == [4, 4, 5, 5]
    assert tracks.x[1] == pytest.approx(12 * SCALE)
    assert account.first_seen[reason].startswith("line 4")


def test_two_bad_points_whose_numbers_add_up_are_not_mixed(write):
    """Two numbers and four make six, but not two points."""
    path = write(text_of({1: [(10, 20, 1), "[11 2]", "[12 22 3 3]", (13, 23, 4)]}))
    tracks, account = read_raw(path)
    assert dict(account.dropped_rows) == {"wrong_column_count": 2}
    assert (tracks.x / SCALE).tolist() == pytest.approx([10, 13])


def test_a_track_without_a_usable_point_is_counted(write):
    tracks, account = read_raw(write(text_of({1: ["[a b c]"], 2: [(1, 1, 1)]})))
    assert tracks.track_id.tolist() == [2]
    assert dict(account.dropped_tracks) == {"no_usable_point": 1}
    assert dict(account.dropped_rows) == {"text_value": 1}  # nothing is named that was not dropped


def test_a_second_track_of_the_same_number_is_counted(write):
    text = text_of({1: [(10, 20, 1), (11, 20, 2)], 2: [(1, 1, 1)]}).replace(".R2=", ".R1=")
    tracks, account = read_raw(write(text))
    assert tracks.x.tolist() == pytest.approx([10 * SCALE, 11 * SCALE])
    assert (account.dropped_tracks, account.dropped_rows) == ({"repeated_track_id": 1}, {"repeated_track_id": 1})


@pytest.mark.parametrize("size", [1, 60, 1 << 24])
def test_blocks_change_neither_points_nor_line_numbers(write, monkeypatch, size):
    planted = {n: [(10 * n, 20, 3 * n), (10 * n + 1, 20, 3 * n + 1)] for n in range(1, 9)}
    planted[8][1] = "[81 x 25]"
    monkeypatch.setattr(edinburgh, "line_blocks", partial(raw.line_blocks, size=size))
    tracks, account = read_raw(write(text_of(planted)))
    assert tracks.track_id.tolist() == sorted([*range(1, 9), *range(1, 8)])
    assert account.first_seen["text_value"].startswith("line 18:")


# --- days of every 4th frame --------------------------------------------------------------------------------


def read_rows(path, stride=4, day=None):
    tracks, account = edinburgh.read_rows(path, RATE, stride, SCALE, ORIGIN, day)
    assert account.rows_read == len(tracks.t) + sum(account.dropped_rows.values())
    return tracks, account


@pytest.mark.parametrize("stride", [1, 4, 5])
def test_the_clock_trap(write, stride):
    """The frame column counts rows after the first: true time is (first + stride * k) / rate."""
    firsts = {3: 95, 8: 97, 11: 5000}
    content = "".join(f"{first + k},{n},{100 + k},{200 - k}\n" for n, first in firsts.items() for k in range(6))
    tracks, _ = read_rows(write(content), stride)
    expected = [ORIGIN + (first + stride * k) / RATE for first in firsts.values() for k in range(6)]
    np.testing.assert_allclose(tracks.t, expected, rtol=0, atol=1e-6)
    assert tracks.x[:2].tolist() == pytest.approx([100 * SCALE, 101 * SCALE])
    assert tracks.y[:2].tolist() == pytest.approx([200 * SCALE, 199 * SCALE])


def test_a_lost_row_leaves_a_gap_and_does_not_shift_the_rest(write):
    content = "".join(f"{95 + k},3,{100 + k},200\n" for k in range(8) if k not in {3, 4})
    tracks, _ = read_rows(write(content))
    np.testing.assert_allclose((tracks.t - ORIGIN) * RATE, [95, 99, 103, 115, 119, 123], atol=1e-5)


@pytest.mark.parametrize("first", ["95,3,nan,200", "95,3,,200", "95,3,1e9,200", "95,3,x,200"])
def test_a_lost_first_row_does_not_shift_the_rest(write, first):
    """Where its frame and track can be read, they count; of the other track nothing changes."""
    good = [f"{n + k},{track},{100 + k},200" for track, n in ((2, 50), (3, 95)) for k in range(5)]
    tracks, account = read_rows(write("\n".join([*good[:5], first, *good[6:]])))
    expected, _ = read_rows(write("\n".join(good), "good.csv"))
    assert account.dropped_rows.total() == 1
    assert tracks.t.tolist() == np.delete(expected.t, 5).tolist()


@pytest.mark.parametrize("first", ["x,3,100,200", "95", "?"])
def test_a_track_whose_first_frame_nobody_can_know_is_dropped_and_counted(write, first):
    good = [f"{n + k},{track},{100 + k},200" for track, n in ((2, 50), (3, 95)) for k in range(5)]
    tracks, account = read_rows(write("\n".join([*good[:5], first, *good[6:]])))
    assert set(tracks.track_id) == {2} and account.dropped_tracks == {"first_row_lost": 1}
    assert account.tracks_read == 2 and account.dropped_rows["first_row_lost"] == 4


@pytest.mark.parametrize("garbage", ["x,3,100,200", None])
def test_blank_lines_are_no_lost_first_rows(write, garbage):
    """Wherever they are, whatever else cannot be read; but the line before them may be one."""
    tracks = [[f"{95 + k},{track},{100 + k},200" for k in range(4)] for track in (3, 2, 5)]
    expected, _ = read_rows(write("\n".join("\n".join(one) for one in tracks), "plain.csv"))
    if garbage:
        tracks[0].insert(2, garbage)
    found, account = read_rows(write("\n \n" + "\n\n".join("\n".join(one) for one in tracks)))
    assert [column.tolist() for column in found[:4]] == [column.tolist() for column in expected[:4]]
    tracks[1].append("garbage")
    found, account = read_rows(write("\n\n\n".join("\n".join(one) for one in tracks)))
    assert set(found.track_id) == {2, 3} and account.dropped_tracks == {"first_row_lost": 1}


def test_a_track_that_is_dropped_for_its_lost_first_row_is_told(write, load_shipped, caplog):
    lines = [f"{95 + k},{track},{100 + k},200" for track in (3, 2) for k in range(40)]
    file = write("\n".join([*lines[:40], "?", *lines[41:]]))
    form = dataclasses.replace(load_shipped("edinburgh_25days", file.parent), cleaning=())
    _, account = clean_recording(file, form, Recording(day="2010-07-01", start="09:00"))
    tell_of_faults(file, account)
    assert "39 first_row_lost (first: track 2: the line before its first row cannot be read)" in caplog.text


def test_a_row_of_another_day_is_no_lost_first_row(write):
    lines = [f"{95 + k},{track},{100 + k},200" for track in (3, 2) for k in range(-1, 5)]
    file = write("\n".join([*lines[:6], "900,3,106,200", *lines[6:]]))
    tracks, account = read_rows(file, day=(ORIGIN + 95 / RATE - 0.01, ORIGIN + 90))
    assert set(tracks.track_id) == {2, 3} and account.dropped_rows == {"outside_day": 3}


def test_a_repeated_frame_is_a_duplicate(write):
    tracks, account = read_rows(write("95,3,100,200\n96,3,101,200\n96,3,150,200\n97,3,102,200\n"))
    assert account.dropped_rows == {"duplicate_row": 1}
    assert (tracks.x / SCALE).tolist() == pytest.approx([100, 101, 102])


def test_rows_in_any_order(write):
    lines = [f"{95 + k},{n},{100 + k},200" for n in (2, 1) for k in range(5)]
    expected, _ = read_rows(write("\n".join(lines), "one.csv"))
    tracks, _ = read_rows(write("\n".join(lines[::-1]), "two.csv"))
    assert [c.tolist() for c in tracks[:4]] == [c.tolist() for c in expected[:4]]


# --- the three removal rules --------------------------------------------------------------------------------

KEPT = {
    1: straight((20, 330), (620, 330), 40),  # left to right
    2: straight((300, 20), (300, 440), 40),  # top to bottom
    3: straight((110, 330), (600, 20), 31),  # the front door to the lift, as short as may be
    4: straight((560, 20), (500, 440), 40),  # from the lift
}
DROPPED = {
    "min_points": {11: straight((20, 330), (620, 330), 30), 12: straight((300, 300), (310, 310), 2)},
    "single_row": {13: straight((20, 330), (20, 330), 1)},
    "start_end_margin": {
        14: straight((320, 240), (620, 330), 40),  # starts in the middle
        15: straight((20, 330), (320, 240), 40),  # ends there
        16: straight((200, 330), (620, 330), 40),  # right of the front door
        17: straight((20, 330), (300, 410), 40),  # above the bottom margin
    },
    "lift_loiterers": {
        18: straight((560, 10), (500, 40), 40),
        19: [*straight((560, 10), (300, 300), 40), *straight((300, 300), (600, 30), 40, first=40)],
    },
    "gap_over_5s": {20: [*straight((20, 330), (320, 330), 20), *straight((320, 330), (620, 330), 20, first=65)]},
}


def test_the_rules_on_made_up_tracks(write, load_shipped):
    planted = {**KEPT, **{number: t for tracks in DROPPED.values() for number, t in tracks.items()}}
    path = write(text_of(planted), "tracks.01Jul.txt")
    dataset = load_shipped("edinburgh", path.parent)
    tracks, account = clean_recording(path, dataset, Recording(day="2010-07-01", start="09:00"))
    assert np.unique(tracks.track_id).tolist() == list(KEPT)
    assert account["tracks"]["dropped"] == {reason: len(found) for reason, found in DROPPED.items()}
    assert account["rows"]["dropped"] == {r: sum(map(len, found.values())) for r, found in DROPPED.items()}
    assert account["rows"]["kept"] == sum(map(len, KEPT.values()))


def test_clean_tracks_stand_on_a_grid_of_seconds(write, load_shipped):
    """Frames 1/9 s apart become rows 1 s apart, from the track's first frame; headings follow y downwards."""
    path = write(text_of({1: straight((20, 330), (20 + 45 * 12, 330 + 45 * 3), 46, first=45)}), "tracks.01Jul.txt")
    dataset = dataclasses.replace(load_shipped("edinburgh", path.parent), cleaning=())
    tracks, account = clean_recording(path, dataset, Recording(day="2010-07-01", start="09:00"))
    nine = 1_277_971_200.0  # 08:00 UTC, summer time
    np.testing.assert_allclose(tracks.t, nine + 5 + np.arange(6), atol=1e-6)
    np.testing.assert_allclose(tracks.x / SCALE, 20 + 108 * np.arange(6), atol=1e-3)
    np.testing.assert_allclose(tracks.y / SCALE, 330 + 27 * np.arange(6), atol=1e-3)
    assert np.isnan(tracks.speed[0])
    np.testing.assert_allclose(tracks.speed[1:], np.hypot(108, 27) * SCALE, atol=1e-5)
    np.testing.assert_allclose(tracks.heading[1:], np.arctan2(27, 108), atol=1e-5)
    assert account["rows_written"] == 6


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_demo_day_is_accounted_to_the_row(tmp_path, load_shipped, seed):
    path = tmp_path / "forum" / "tracks.04Nov.txt"
    planted = demo.write_recording(path, "forum", "2030-11-04", seed, scale=0.4)
    dataset = load_shipped("demo_forum", tmp_path)
    _, account = clean_recording(path, dataset, dataset.recording("tracks.04Nov"))
    assert account["rows"]["read"] == planted["rows"]
    assert account["tracks"]["read"] == planted["tracks"]
    assert account["rows"]["dropped"]["frame_not_increasing"] == planted["frame_order_rows"]
    assert account["rows"]["dropped"]["text_value"] == planted["text_value"]
    assert account["tracks"]["dropped"] == {
        "min_points": planted["short_track"],
        "start_end_margin": planted["margin_track"],
        "lift_loiterers": planted["lift_track"],
    }


# --- real recordings ----------------------------------------------------------------------------------------


def day_rows(real_data, load_shipped, name):
    """A day of rows: its clean ids, and (Tracks, Account) as read."""
    dataset = load_shipped("edinburgh_25days", real_data)
    recording = dataset.recording(name)
    if not recording.exists:
        pytest.skip(f"{recording.path} is not there")
    clean, account = clean_recording(recording.path, dataset, recording)
    return clean, account


def raw_day(real_data, load_shipped, file, month_day):
    """A raw day after the rules of config/datasets/edinburgh.yaml."""
    path = real_data / "edinburgh/raw" / file
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    dataset = load_shipped("edinburgh", real_data)
    return clean_recording(path, dataset, Recording(day=f"2010-{month_day}", start="09:00"))


@pytest.mark.real
def test_the_rules_keep_the_authors_tracks_of_1_july(real_data, load_shipped):
    raw_tracks, account = raw_day(real_data, load_shipped, "tracks.01Jul.txt", "07-01")
    day, _ = day_rows(real_data, load_shipped, "0701")
    assert account["tracks"]["read"] == 1262
    ours, authors = set(raw_tracks.track_id.tolist()), set(day.track_id.tolist())
    assert len(authors) == 1142
    assert authors - ours == set()
    assert len(ours - authors) == 2


@pytest.mark.real
def test_both_forms_of_1_july_agree(real_data):
    """Same clock, same pixels: the day's rows are every 4th raw frame, filled in where the camera missed one."""
    paths = [real_data / "edinburgh" / name for name in ("raw/tracks.01Jul.txt", "days/0701.csv")]
    if not all(path.is_file() for path in paths):
        pytest.skip(f"{paths[0]} or {paths[1]} is not there")
    raw_tracks, _ = edinburgh.read_raw(paths[0], RATE, SCALE, ORIGIN)
    day, _ = edinburgh.read_rows(paths[1], RATE, 4, SCALE, ORIGIN)

    def points(tracks):
        """{(track, frame): (x, y) [px]}"""
        columns = (tracks.track_id, (tracks.t - ORIGIN) * RATE, tracks.x / SCALE, tracks.y / SCALE)
        number, frame, x, y = (np.rint(column).astype(int).tolist() for column in columns)
        return dict(zip(zip(number, frame, strict=True), zip(x, y, strict=True), strict=True))

    ours, theirs = points(raw_tracks), points(day)
    common = ours.keys() & theirs.keys()
    assert len(common) > 0.95 * len(day.t)
    assert [key for key in common if ours[key] != theirs[key]] == []


@pytest.mark.real
def test_1_july_as_rows_is_accounted_for(real_data, load_shipped):
    _, account = day_rows(real_data, load_shipped, "0701")
    assert account["tracks"] == {"read": 1142, "kept": 1142, "dropped": {}}
    assert account["rows"]["dropped"] == {}


@pytest.mark.real
def test_1_august_raw(real_data, load_shipped):
    _, account = raw_day(real_data, load_shipped, "tracks.01Aug.txt", "08-01")
    assert account["tracks"]["read"] == 146


@pytest.mark.real
def test_a_real_file_that_was_cut_off_is_refused(real_data, write):
    path = real_data / "edinburgh/raw/tracks.01Aug.txt"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    content = path.read_bytes()
    lines = content.splitlines(keepends=True)
    for short in (content[: len(content) // 2], b"".join(lines[: len(lines) // 2])):
        with pytest.raises(DataError, match="cut off"):
            edinburgh.read_raw(write(short), RATE, SCALE, ORIGIN)
