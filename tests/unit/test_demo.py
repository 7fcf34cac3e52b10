"""The demo recordings: same bytes for same arguments, true formats, counted defects, flows as planted."""

import math
import re
import tracemalloc
from collections import Counter
from datetime import datetime

import numpy as np
import pytest

from modlhmp.study import demo
from modlhmp.study.demo import sites

SEED = 3
HALL_DAY = next(r.day for r in demo.RECORDINGS if (r.site, r.split) == ("hall", "test"))
FORUM_DAY = next(r.day for r in demo.RECORDINGS if (r.site, r.split) == ("forum", "test"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("demo")


@pytest.fixture(scope="module")
def hall(folder):
    """One hall day: planted counts, the lines, and each line's (defect or None, numbers or None)."""
    path = folder / "hall.csv"
    planted = demo.write_recording(path, "hall", HALL_DAY, SEED, scale=0.7)
    lines = path.read_text().splitlines()
    return planted, lines, [classify(line.split(",")) for line in lines]


@pytest.fixture(scope="module")
def hall_rows(hall):
    """The good rows of the hall as floats, sorted by person and time: t, id, x, y, z, v, heading, facing."""
    rows = np.array([row for name, row in hall[2] if name is None])
    rows = rows[of_the_day(rows)]
    return rows[np.lexsort((rows[:, 0], rows[:, 1]))]


@pytest.fixture(scope="module")
def forum(folder):
    """One forum day: planted counts, {track number: list of points as text fields}."""
    path = folder / "forum.txt"
    planted = demo.write_recording(path, "forum", FORUM_DAY, SEED)
    return planted, path.read_text()


def classify(fields):
    """A hall line: the name of the defect that makes it no row (or None), and its numbers."""
    if len(fields) != 8:
        return "wrong_column_count", None
    try:
        row = [float(field) for field in fields]
    except ValueError:
        return "text_value", None
    if any(map(math.isnan, row)):
        return "nan_value", None
    if any(map(math.isinf, row)):
        return "infinite_value", None
    if row[1] == -1:
        return "no_person", None
    return ("absurd_value" if abs(row[2]) > 1e6 or row[5] > 20_000 else None), row


def of_the_day(rows):
    """Which hall rows were recorded on the day, in Japan: UTC + 9 h."""
    midnight = datetime.fromisoformat(HALL_DAY + "T00:00+09:00").timestamp()
    return (rows[:, 0] >= midnight) & (rows[:, 0] < midnight + 86_400)


def parse_forum(text):
    """{track: (points stated in Properties, first frame, last frame, list of points as text fields)}."""
    pattern = r"Properties\.R(\d+)=\[(\d+) (\d+) (\d+) [^\]]*\];\n TRACK\.R(\d+)=\[(.*)\];\n"
    found = re.findall(pattern, text)
    assert all(match[0] == match[4] for match in found)
    return {int(m[0]): (*map(int, m[1:4]), [point[1:-1].split(" ") for point in m[5].split(";")]) for m in found}


def split_tracks(rows):
    """Rows sorted by id, time -> one array a person."""
    return np.split(rows, np.flatnonzero(np.diff(rows[:, 1])) + 1)


def write(path, *arguments):
    demo.write_recording(path, *arguments)
    return path.read_bytes()


@pytest.mark.parametrize(("site", "day"), [("hall", HALL_DAY), ("forum", FORUM_DAY)])
def test_bytes_depend_on_seed_and_day_only(tmp_path, site, day):
    path = tmp_path / "sub" / "raw"
    first = write(path, site, day, 1, 0.1)
    assert write(path, site, day, 2, 0.1) != first
    assert write(path, site, "2030-01-01", 1, 0.1) != first
    assert write(path, site, day, 1, 0.1) == first
    assert [p.name for p in path.parent.iterdir()] == ["raw"], "a temporary file was left behind"


def test_write_all_writes_every_recording_in_any_order(tmp_path):
    planted = demo.write_all(tmp_path, SEED, scale=0.05)
    assert list(planted) == [r.file for r in demo.RECORDINGS]
    assert Counter((r.site, r.split) for r in demo.RECORDINGS) == Counter(
        {(site, split): 2 for site in ("hall", "forum") for split in ("train", "test")}
    )
    for r in reversed(demo.RECORDINGS):
        assert (tmp_path / r.file).read_bytes() == write(tmp_path / "again", r.site, r.day, SEED, 0.05)


@pytest.mark.parametrize(
    ("site", "day", "scale"),
    [
        ("station", "2030-01-01", 1),
        ("hall", "yesterday", 1),
        ("hall", HALL_DAY, 0),
        ("hall", HALL_DAY, math.nan),
    ],
)
def test_bad_arguments_are_refused(tmp_path, site, day, scale):
    with pytest.raises(ValueError, match=r"site|isoformat|scale"):
        demo.write_recording(tmp_path / "raw", site, day, SEED, scale)
    assert not list(tmp_path.iterdir())


def test_hall_lines_have_the_official_layout(hall):
    good = re.compile(r"\d{10}\.\d{3},\d+,-?\d+,-?\d+,\d+,\d+\.\d\d,-?[0-3]\.\d{3},-?[0-3]\.\d{3}")
    assert all(good.fullmatch(line) for line, (name, _) in zip(*hall[1:], strict=True) if name is None)


def test_hall_defects_are_as_reported(hall):
    planted, lines, classified = hall
    ids = {line.split(",")[1] for line in lines}
    counted = Counter(tracks=sum(name.isdigit() for name in ids), rows=len(lines))
    rows, latest = [], -math.inf
    for name, row in classified:
        if name is not None:
            counted[name] += 1
        else:
            rows.append(row)
            counted["unsorted"] += row[0] < latest
            latest = max(latest, row[0])
    rows = np.array(rows)
    counted["duplicate_row"] = len(rows) - len(np.unique(rows[:, :2], axis=0))
    counted["outside_day"] = int((~of_the_day(rows)).sum())
    rows = rows[of_the_day(rows)]
    for track in split_tracks(rows[np.lexsort((rows[:, 0], rows[:, 1]))]):
        counted["single_row_track"] += len(track) == 1
        counted["gap_track"] += bool((np.diff(track[:, 0]) > 5).any())
    assert counted == planted
    exact = len(lines) - len(set(lines))
    assert 0 < exact < planted["duplicate_row"], "both kinds of duplicates occur"


def test_hall_covers_its_hours_and_stays_inside(hall_rows):
    hours = (hall_rows[:, 0] / 3600 + 9) % 24
    assert sorted(set(hours.astype(int))) == list(sites.SITES["hall"].hours) == list(range(9, 21))
    x_min, x_max, y_min, y_max = sites.SITES["hall"].extent
    x, y = hall_rows[:, 2:4].T / 1000
    assert ((x > x_min) & (x < x_max) & (y > y_min) & (y < y_max)).all()
    assert distance_to_routes("hall", np.column_stack([x, y])[::10]).max() < 3.5, "people keep to the corridors"


def test_hall_tracker_runs_at_about_24_hz(hall_rows):
    step = np.concatenate([np.diff(track[:, 0]) for track in split_tracks(hall_rows)])
    step = step[(step > 0) & (step < 0.07)]
    assert 23 < 1 / step.mean() < 25
    assert step.std() > 0.002


def test_hall_speed_and_heading_columns_agree_with_the_positions(hall_rows):
    whole = [track for track in split_tracks(hall_rows) if len(track) > 480]
    for track in whole[::20]:
        t, xy = track[::24, 0], track[::24, 2:4] / 1000
        speed = np.hypot(*np.diff(xy, axis=0).T) / np.diff(t)
        assert speed.mean() == pytest.approx(track[:, 5].mean() / 1000, abs=0.08)
        middle = track[12::24, 6][: len(speed)]
        off = np.angle(np.exp(1j * (np.arctan2(*np.diff(xy, axis=0).T[::-1]) - middle)))
        assert np.median(np.abs(off[speed > 0.3])) < 0.15


def test_hall_has_plenty_of_long_walks(hall_rows):
    tracks = split_tracks(hall_rows)
    long = [track for track in tracks if track[-1, 0] - track[0, 0] > 64]
    assert len(long) > 0.25 * len(tracks)
    moving = 0
    for track in long:
        clock = np.arange(track[0, 0], track[-1, 0])
        x, y = (np.interp(clock, track[:, 0], track[:, k]) / 1000 for k in (2, 3))
        moving += np.hypot(x[5:] - x[:-5], y[5:] - y[:-5]).min() >= 1
    assert moving > 0.2 * len(tracks), "never under 1 m in 5 s"


def test_forum_text_is_complete(forum):
    planted, text = forum
    tracks = parse_forum(text)
    assert text.startswith(f"% Total number of trajectories in file are  {len(tracks)} \n\nProperties.R1=[")
    assert list(tracks) == list(range(1, len(tracks) + 1))
    assert len(text.splitlines()) == 2 + 2 * len(tracks)
    assert planted["tracks"] == len(tracks)
    assert planted["rows"] == sum(n for n, *_ in tracks.values())
    for count, first, last, points in tracks.values():
        assert (count, first, last) == (len(points), int(points[0][2]), int(points[-1][2]))


def test_forum_defects_are_as_reported(forum):
    planted, text = forum
    counted = Counter(tracks=planted["tracks"], rows=planted["rows"])
    gaps = []
    for *_, fields in parse_forum(text).values():
        points = np.array([list(map(int, p)) for p in fields if all(n.isdigit() for n in p)])
        counted["text_value"] += len(fields) - len(points)
        step = np.diff(points[:, 2])
        counted["frame_order_rows"] += int((step <= 0).sum())
        gaps.append(step.max())
        ends = points[[0, -1], :2]
        margin = (ends[:, 0] < 50) | (ends[:, 0] > 590) | (ends[:, 1] < 50) | (ends[:, 1] > 420)
        lift = (ends[:, 0] >= 487) & (ends[:, 1] <= 50)
        names = {"short_track": len(points) < 31, "margin_track": not margin.all(), "lift_track": lift.all()}
        assert sum(names.values()) <= 1
        counted.update(name for name, found in names.items() if found)
        assert ((points[:, :2] >= 0) & (points[:, :2] < (640, 480))).all()
    assert counted == planted
    assert 5 < max(gaps) <= 12


def test_forum_covers_its_hours_and_has_long_tracks(forum):
    tracks = parse_forum(forum[1]).values()
    assert {8 + first // (9 * 3600) for _, first, _, _ in tracks} == set(sites.SITES["forum"].hours)
    assert max(last for _, _, last, _ in tracks) < 8 * 3600 * 9
    long = sum(last - first >= 24 * 9 for _, first, last, _ in tracks)
    assert long > 0.1 * len(tracks)


def distance_to_routes(site, xy):
    """Distance [m] of points [n, 2] to the nearest route."""
    nearest = np.full(len(xy), np.inf)
    for route in sites.SITES[site].routes:
        points = np.array(route.points)
        for start, step in zip(points, np.diff(points, axis=0), strict=False):
            along = np.clip((xy - start) @ step / (step @ step), 0, 1)
            nearest = np.minimum(nearest, np.hypot(*(xy - start - along[:, None] * step).T))
    return nearest


@pytest.mark.parametrize("site", sites.SITES)
def test_planted_flows_are_well_formed(site):
    for hour in sites.SITES[site].hours:
        flows = sites.planted_flows(site, hour)
        assert {flow.place for flow in flows} == set(sites.SITES[site].places)
        for place in sites.SITES[site].places:
            assert sum(flow.share for flow in flows if flow.place == place) == pytest.approx(1)
        assert all(-math.pi < flow.heading <= math.pi for flow in flows)
    with pytest.raises(ValueError, match="open at"):
        sites.planted_flows(site, 3)


def check_flows(flows, moves, radius):
    """Compare planted flows with rows [n, 5] (x, y, heading, speed, person) within `radius` of their places.

    Each person counts once per direction, and each must follow a documented direction to 0.8 rad.
    """
    for place in {flow.place for flow in flows}:
        here = [flow for flow in flows if flow.place == place]
        near = moves[np.hypot(moves[:, 0] - here[0].x, moves[:, 1] - here[0].y) < radius]
        off = np.angle(np.exp(1j * (near[:, 2, None] - np.array([flow.heading for flow in here]))))
        which = np.abs(off).argmin(axis=1)
        assert (np.abs(off).min(axis=1) < 0.8).mean() > 0.98, f"{place}: undocumented flows"
        people = [len(np.unique(near[which == k, 4])) for k in range(len(here))]
        for k, flow in enumerate(here):
            # people are whole, and some have a defect
            assert people[k] / sum(people) == pytest.approx(flow.share, abs=0.04 + 1.5 / sum(people)), flow
            if people[k] >= 5:
                mean = np.angle(np.exp(1j * near[which == k, 2]).mean())
                assert abs(np.angle(np.exp(1j * (mean - flow.heading)))) < 0.1, flow
        spread = 0.05 + 0.8 / math.sqrt(sum(people))  # people's speeds have an SD of about 0.25 m/s
        assert near[:, 3].mean() == pytest.approx(here[0].mean_speed, abs=spread), place


@pytest.mark.parametrize("hour", [12, 18, 9])  # the busiest, the evening, the quietest
def test_hall_flows_are_there(hall_rows, hour):
    rows = hall_rows[::6]
    entered = {track[0, 1] for track in split_tracks(hall_rows) if int(track[0, 0] / 3600 + 9) % 24 == hour}
    rows = rows[np.isin(rows[:, 1], list(entered))]
    moves = np.column_stack([rows[:, 2:4] / 1000, rows[:, 6], rows[:, 5] / 1000, rows[:, 1]])
    check_flows(sites.planted_flows("hall", hour), moves, 3.0)


@pytest.mark.parametrize("hour", [12, 9, 15])
def test_forum_flows_are_there(forum, hour):
    moves = []
    for track, (count, first, _, fields) in parse_forum(forum[1]).items():
        points = np.array([list(map(float, p)) for p in fields if "abc" not in p])
        ordered = points[np.append(True, np.diff(np.maximum.accumulate(points[:, 2])) > 0)]
        if count < 31 or 8 + first // (9 * 3600) != hour:
            continue
        step = (ordered[9:] - ordered[:-9]) / (1 / 0.0247, 1 / 0.0247, 9)
        middle = ordered[4:-5, :2] * 0.0247
        heading, speed = np.arctan2(step[:, 1], step[:, 0]), np.hypot(step[:, 0], step[:, 1]) / step[:, 2]
        moves.append(np.column_stack([middle, heading, speed, np.full(len(step), track)]))
    check_flows(sites.planted_flows("forum", hour), np.concatenate(moves), 1.1)


def test_flows_change_over_the_day():
    share = {
        hour: next(f.share for f in sites.planted_flows("hall", hour) if f.place == "south" and f.heading == 0)
        for hour in (9, 20)
    }
    assert share[9] > 0.7
    assert share[20] < 0.3


def test_memory_does_not_grow_with_the_file(tmp_path):
    peaks = []
    for scale in (0.2, 0.6):
        tracemalloc.start()
        demo.write_recording(tmp_path / "raw", "hall", HALL_DAY, SEED, scale)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]
