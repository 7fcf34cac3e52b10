"""Cleaning: the removal rules one by one, the common time step, the account."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.path import Path as Polygon

from modlhmp import read_tracks
from modlhmp.angles import circular_difference
from modlhmp.cleaning import RULES, clean_recording, inside_polygons
from modlhmp.file_format import Columns, FileFormat, Recording
from modlhmp.ids import id_of
from modlhmp.splits import BLOCK_S, CONTEMPORARIES_S, FOLDS, VALIDATION_SHARE, in_part, in_validation_blocks
from modlhmp.storage import DataError
from modlhmp.time_step import backward_differences, interpolate
from modlhmp.tracks import Tracks, concatenate, empty_tracks, usable_tracks

SCALE = 0.0247
T0 = 1_277_971_200.0
LEFT, RIGHT = [[0, 0], [50, 0], [50, 480], [0, 480]], [[590, 0], [640, 0], [640, 480], [590, 480]]


def track(track_id, t, x=None, y=None):
    """One track without velocities; positions [m]."""
    t = np.asarray(t, float)
    x, y = (np.zeros(len(t)) if v is None else np.asarray(v, float) for v in (x, y))
    unknown = np.full(len(t), np.nan)
    return Tracks(np.full(len(t), track_id, np.int64), t, x, y, unknown, unknown)


def pixels(track_id, *points):
    x, y = np.array(points, float).T * SCALE
    return track(track_id, np.arange(len(points)), x, y)


def dropped_by(rule, tracks, **options):
    """Ids of the tracks that a rule drops."""
    mask = RULES[rule](tracks, FileFormat(scale=SCALE), **options)
    ids = tracks.track_id[tracks.bounds()[:-1]]
    assert mask.shape == ids.shape
    return ids[mask].tolist()


# --- polygons -----------------------------------------------------------------------------------------------


def matplotlib_inside(points, polygon):
    """The reference: matplotlib, whose radius grows or shrinks a polygon by its sense of rotation."""
    return np.logical_or(*(Polygon(polygon).contains_points(points, radius=radius) for radius in (1e-9, -1e-9)))


def distance_to_border(points, polygon):
    corners = np.asarray(polygon, float)
    edges = np.roll(corners, -1, axis=0) - corners
    away = points[:, None] - corners
    along = np.clip((away * edges).sum(-1) / np.maximum((edges**2).sum(-1), 1e-300), 0, 1)
    return np.linalg.norm(away - along[..., None] * edges, axis=-1).min(axis=1)


@st.composite
def simple_polygons(draw):
    """Corners by their direction from a centre: convex or not, never across itself, either way round."""
    number = draw(st.integers(3, 9))
    turns = np.arange(number) + np.array(draw(st.lists(st.floats(0, 0.8), min_size=number, max_size=number)))
    radii = np.array(draw(st.lists(st.floats(5, 300), min_size=number, max_size=number)))
    centre = np.array(draw(st.tuples(st.floats(-700, 700), st.floats(-700, 700))))
    angles = turns * 2 * np.pi / number * draw(st.sampled_from([1, -1]))
    return centre + radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])


whole = st.integers(-6, 6)


@given(simple_polygons(), st.integers(0, 2**32 - 1))
def test_inside_is_matplotlibs(polygon, seed):
    """At random, at corners, on edges, just off the edges."""
    rng = np.random.default_rng(seed)
    edge = rng.integers(0, len(polygon), 60)
    start, end = polygon[edge], np.roll(polygon, -1, axis=0)[edge]
    on_edges = start + rng.random((60, 1)) * (end - start)
    across = (end - start)[:, ::-1] * [1, -1] / np.linalg.norm(end - start, axis=1, keepdims=True)
    off_edges = on_edges + across * rng.choice([-1e-3, -1e-6, -1e-7, 1e-7, 1e-6, 1e-3], (60, 1))
    spread = polygon.min(axis=0) - 20 + rng.random((100, 2)) * (np.ptp(polygon, axis=0) + 40)
    points = np.concatenate([spread, polygon, on_edges, off_edges])
    np.testing.assert_array_equal(inside_polygons(points, [polygon]), matplotlib_inside(points, polygon))
    assert inside_polygons(np.concatenate([polygon, on_edges]), [polygon]).all()


@given(st.lists(st.tuples(whole, whole), min_size=3, max_size=8), st.floats(-0.45, 0.45), st.floats(-0.45, 0.45))
def test_inside_of_crossed_edges_is_matplotlibs(polygon, dx, dy):
    """Any corners, edges that cross or repeat: the same but on the border, where matplotlib is undecided."""
    x, y = np.meshgrid(np.arange(-7, 8) + dx, np.arange(-7, 8) + dy)
    points = np.column_stack([x.ravel(), y.ravel()])
    points = points[distance_to_border(points, polygon) > 1e-6]
    np.testing.assert_array_equal(inside_polygons(points, [polygon]), matplotlib_inside(points, polygon))


def test_inside_of_several_polygons():
    """Their union; the border counts, a polygon may name its first corner again, unknown positions are outside."""
    points = [[10, 10], [50, 3], [50 + 1e-10, 3], [50.001, 3], [300, 200], [600, 480], [640.001, 480], [np.nan, 3]]
    expected = [True, True, True, False, False, True, False, False]
    assert inside_polygons(points, [LEFT, RIGHT]).tolist() == expected
    assert inside_polygons(points, [[*RIGHT, RIGHT[0]], LEFT[::-1]]).tolist() == expected
    assert inside_polygons(points, []).tolist() == [False] * 8
    assert inside_polygons(np.zeros((0, 2)), [LEFT]).tolist() == []


# --- rules --------------------------------------------------------------------------------------------------


def test_single_row():
    tracks = concatenate([track(1, [0]), track(2, [0, 1]), track(3, [5]), track(4, [0, 1, 2])])
    assert dropped_by("single_row", tracks) == [1, 3]


@pytest.mark.parametrize(("points", "dropped"), [(1, []), (2, [1]), (31, [1, 2]), (32, [1, 2, 3])])
def test_min_points(points, dropped):
    tracks = concatenate([track(1, [0]), track(2, range(30)), track(3, range(31)), track(4, range(32))])
    assert dropped_by("min_points", tracks, points=points) == dropped


def test_gap_over_5s():
    tracks = concatenate([
        track(1, [0, 5, 10]),
        track(2, [0, 1, 6.5, 7]),
        track(3, [100, 101]),  # the step from track 2 is no gap
        track(4, [0, 60]),
        track(5, [7]),
        track(6, [0, 1, 2, 7.001]),
    ])  # fmt: skip
    assert dropped_by("gap_over_5s", tracks) == [2, 4, 6]


@pytest.mark.parametrize("thousandths", [0, 1, 77, 123, 400, 512, 999])
def test_a_gap_of_5s_is_not_over_5s(thousandths):
    """At times with milliseconds, whose difference in binary may be a little over 5."""
    times = [[T0 + k + thousandths / 1000, T0 + k + 5 + thousandths / 1000] for k in range(200)]
    tracks = concatenate(track(k, t) for k, t in enumerate(times))
    assert dropped_by("gap_over_5s", tracks) == []


def test_gap_of_45_frames_at_9_a_second_is_not_over_5s():
    tracks = concatenate(track(k, [T0 + k / 9, T0 + (k + 45) / 9]) for k in range(200))
    assert dropped_by("gap_over_5s", tracks) == []


def test_start_end_margin():
    tracks = concatenate([
        pixels(1, (20, 100), (300, 200), (620, 100)),  # from side to side
        pixels(2, (300, 200), (620, 100)),  # starts in the middle
        pixels(3, (20, 100), (300, 200)),  # ends there
        pixels(4, (20, 100), (300, 200), (20, 300)),  # back to its side
        pixels(5, (300, 200), (20, 100), (310, 200)),
        pixels(6, (49, 479), (591, 1)),
        pixels(7, (51, 479), (591, 1)),
    ])  # fmt: skip
    assert dropped_by("start_end_margin", tracks, polygons=[LEFT, RIGHT]) == [2, 3, 5, 7]
    assert dropped_by("start_end_margin", tracks, polygons=[LEFT]) == [1, 2, 3, 5, 6, 7]


def test_lift_loiterers():
    lift = [[487, -1], [641, -1], [641, 50], [487, 50]]
    tracks = concatenate([
        pixels(1, (560, 10), (300, 300), (500, 40)),  # leaves the area, and comes back
        pixels(2, (560, 10), (300, 300)),
        pixels(3, (300, 300), (560, 10)),
        pixels(4, (300, 300), (560, 10), (310, 300)),
        pixels(5, (600, 5)),
    ])  # fmt: skip
    assert dropped_by("lift_loiterers", tracks, polygons=[lift]) == [1, 5]


POLYGON_FORMS = [LEFT, LEFT[::-1], [*LEFT, LEFT[0]], LEFT[2:] + LEFT[:2]]


@pytest.mark.parametrize("rule", ["start_end_margin", "lift_loiterers"])
def test_polygons_may_be_listed_either_way_round_and_closed(rule):
    tracks = concatenate(pixels(k, point) for k, point in enumerate([(49, 240), (51, 240), (25, 479), (25, 481)]))
    expected = [0, 2] if rule == "lift_loiterers" else [1, 3]
    assert [dropped_by(rule, tracks, polygons=[polygon]) for polygon in POLYGON_FORMS] == [expected] * 4


def test_a_pixel_on_the_border_is_inside_or_outside_however_the_polygon_is_listed():
    tracks = concatenate(pixels(k, (50, y)) for k, y in enumerate(range(1, 480)))
    found = [dropped_by("lift_loiterers", tracks, polygons=[polygon]) for polygon in POLYGON_FORMS]
    assert found == [found[0]] * 4
    assert len(found[0]) in {0, 479}, "all pixels of a side are treated alike"


RULE_OPTIONS = {
    "min_points": {"points": 3},
    "start_end_margin": {"polygons": [LEFT]},
    "lift_loiterers": {"polygons": [LEFT]},
}


@pytest.mark.parametrize("rule", RULES)
def test_rules_on_no_tracks(rule):
    assert dropped_by(rule, empty_tracks(), **RULE_OPTIONS.get(rule, {})) == []


# --- the common time step -----------------------------------------------------------------------------------

STEPS = st.lists(st.integers(1, 60), max_size=8)  # in 1/16 s: exact in binary
PLACES = st.floats(-50, 50)


@st.composite
def tables(draw):
    tracks = []
    for number in range(draw(st.integers(1, 4))):
        t = T0 + draw(st.integers(0, 9999)) / 16 + np.cumsum([0, *draw(STEPS)]) / 16
        x, y = (draw(st.lists(PLACES, min_size=len(t), max_size=len(t))) for _ in range(2))
        tracks.append(track(number, t, x, y))
    return tracks


@given(tables(), st.sampled_from([0.25, 0.5, 1.0, 2.0]))
def test_interpolation_is_that_of_each_track_alone(tracks, step_s):
    result = interpolate(concatenate(tracks), step_s)
    for one in tracks:
        found = result.take(result.track_id == one.track_id[0])
        grid = one.t[0] + step_s * np.arange(len(found.t))
        assert found.t.tolist() == grid.tolist()
        assert -0.05 * step_s <= one.t[-1] - grid[-1] < step_s  # the last row may be a little early
        np.testing.assert_allclose(found.x, np.interp(grid, one.t, one.x), atol=1e-6)
        np.testing.assert_allclose(found.y, np.interp(grid, one.t, one.y), atol=1e-6)
        assert np.isnan([found.speed[0], found.heading[0]]).all()
        dx, dy = np.diff(found.x), np.diff(found.y)
        np.testing.assert_allclose(found.speed[1:], np.hypot(dx, dy) / step_s, atol=1e-9)
        np.testing.assert_allclose(found.heading[1:], np.arctan2(dy, dx))


@pytest.mark.parametrize(
    ("times", "rows"),
    [([0, 2, 4], 3), ([0, 2, 3.9375], 3), ([0, 2, 3.875], 2), ([0, 2, 3.5, 3.9375], 2), ([0, 2, 3.5, 4], 3), ([0], 1)],
)
def test_a_last_row_may_be_early_where_rows_are_as_far_apart_as_steps(times, rows):
    found = interpolate(track(1, T0 + np.array(times), np.array(times)), 2.0)
    assert (found.t - T0).tolist() == [0, 2, 4][:rows]


@given(tables(), st.randoms(use_true_random=False))
def test_interpolation_does_not_depend_on_the_order_of_tracks(tracks, random):
    straight = interpolate(concatenate(tracks), 1.0)
    shuffled = tracks[:]
    random.shuffle(shuffled)
    other = interpolate(concatenate(shuffled), 1.0)
    other = other.take(np.argsort(other.track_id, kind="stable"))
    for a, b in zip(straight, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-6)


def test_a_row_on_the_last_grid_point_is_kept():
    """9 frames per second: the times are not exact in binary, the grid must not lose its end."""
    for first in range(50):
        found = interpolate(track(1, T0 + (first + np.arange(0, 28)) / 9, np.arange(28)), 1.0)
        np.testing.assert_allclose(found.x, [0, 9, 18, 27], atol=1e-4)


@pytest.mark.parametrize(("step_s", "jitter_s"), [(0.4, 1e-4), (0.4, 5e-3), (1.0, 0.02), (0.1, 0.0), (0.04, 0.0)])
def test_a_clock_that_ticks_unevenly_takes_no_last_row(step_s, jitter_s):
    """Rows a step apart: as many come out, where the clock is late or early, and where unix times are rounded."""
    rng = np.random.default_rng(3)
    people = [
        track(
            who,
            T0 + 7.3 * who + step_s * np.arange(20) + rng.uniform(-jitter_s, jitter_s, 20),
            np.arange(20) + 50 * who,
        )
        for who in range(200)
    ]
    found = interpolate(concatenate(people), step_s)
    assert np.diff(found.bounds()).tolist() == [20] * 200
    places = found.x.reshape(200, 20) - 50 * np.arange(200)[:, None]
    assert np.abs(places - np.arange(20)).max() <= 2 * jitter_s / step_s + 1e-3
    assert (places[:, -1] <= 19 + 1e-3).all(), "nobody goes on towards the next one"


def test_rows_between_the_steps_make_no_row_of_their_own():
    """At a tracker's rate the last whole step is the last row: nothing is lost, and none is made up."""
    found = interpolate(track(1, T0 + 0.03 * np.arange(100), np.arange(100)), 1.0)
    assert found.t.tolist() == [T0, T0 + 1, T0 + 2]


def test_interpolation_keeps_a_far_neighbour_out():
    """The end of one track is not drawn towards the start of the next, however far that is."""
    near, far = track(1, T0 + np.arange(28) / 9), track(2, T0 + np.arange(28) / 9, np.full(28, 9e3))
    found = interpolate(concatenate([near, far]), 1.0)
    assert set(found.x[found.track_id == 1]) == {0.0}
    assert set(found.x[found.track_id == 2]) == {9e3}


def test_a_track_of_one_row_stays():
    found = interpolate(track(1, [T0 + 0.3], [1.0], [2.0]), 1.0)
    assert (found.t.tolist(), found.x.tolist(), found.y.tolist()) == ([T0 + 0.3], [1.0], [2.0])


def test_interpolating_nothing():
    assert len(interpolate(empty_tracks(), 1.0).t) == 0


def test_gaps_of_hours_do_not_fill_the_memory():
    with pytest.raises(DataError, match="max_gap_s"):
        interpolate(track(1, [T0, T0 + 1e9]), 1.0)


def test_backward_differences():
    ids = np.array([1, 1, 1, 2, 2])
    t = np.array([0.0, 1.0, 3.0, 0.0, 0.5])
    x, y = np.array([0.0, 3.0, 3.0, 9.0, 8.0]), np.array([0.0, 4.0, 2.0, 9.0, 9.0])
    speed, heading = backward_differences(ids, t, x, y)
    np.testing.assert_allclose(speed, [np.nan, 5.0, 1.0, np.nan, 2.0])
    np.testing.assert_allclose(heading, [np.nan, np.arctan2(4, 3), -np.pi / 2, np.nan, np.pi])


@given(st.integers(3, 20), st.floats(-3.1, 3.1), st.floats(0.1, 2.0))
def test_backward_differences_of_steady_walking(n, direction, pace):
    t = T0 + np.arange(n, dtype=float)
    x, y = pace * np.cos(direction) * np.arange(n), pace * np.sin(direction) * np.arange(n)
    speed, heading = backward_differences(np.ones(n), t, x, y)
    np.testing.assert_allclose(speed[1:], pace, atol=1e-9)
    np.testing.assert_allclose(circular_difference(heading[1:], direction), 0, atol=1e-9)


# --- a whole recording --------------------------------------------------------------------------------------


def clean(write, content, part=None, **changes):
    form = FileFormat(**{"columns": Columns(t=0, track_id=1, x=2, y=3), "gaps": "drop", **changes})
    return clean_recording(write(content), form, Recording(day="1970-01-01", part=part))


MIXED = "0,1,0,0\n1,1,1,0\n2,1,2,0\n0,2,5,5\n0,3,0,0\n9,3,1,1\n-5,4,0,0\n0,4,x,0\n0.5,5,0,0\n2,5,3,0\n0,6,0,0\n"


def test_the_account_of_a_recording(write):
    tracks, account = clean(write, MIXED)
    assert account["rows"] == {
        "read": 11,
        "kept": 5,
        "dropped": {"gap_over_5s": 2, "outside_day": 1, "single_row": 2, "text_value": 1},
    }
    assert account["tracks"] == {"read": 5, "kept": 2, "dropped": {"gap_over_5s": 1, "single_row": 2}}
    assert account["rows_written"] == len(tracks.t) == 5
    assert tracks.track_id.tolist() == [1, 1, 1, 5, 5]
    assert tracks.x.tolist() == pytest.approx([0, 1, 2, 0, 2])


def test_rules_count_in_the_order_of_the_dataset_file(write):
    _, account = clean(write, MIXED, cleaning=({"min_points": {"points": 3}}, "single_row", "gap_over_5s"))
    assert account["tracks"]["dropped"] == {"min_points": 4}


def test_file_velocities_are_kept_and_positions_not_interpolated(write):
    columns = Columns(t=0, track_id=1, x=2, y=3, speed=4, heading=5)
    tracks, _ = clean(write, "0.2,1,0,0,7,1\n1.9,1,1,0,8,2\n", columns=columns)
    assert (tracks.t.tolist(), tracks.speed.tolist()) == ([0.2, 1.9], [7.0, 8.0])


@pytest.mark.parametrize("gaps", ["drop", "split"])
@pytest.mark.parametrize("recorded", [False, True])
@pytest.mark.parametrize(
    ("allowed", "whole"),
    [({}, [1, 4]), ({"max_gap_s": 3}, [1]), ({"max_gap_s": 10}, [1, 4, 8]), ({"time_step_s": 5}, [1, 4, 8])],
)
def test_a_gap_is_what_the_dataset_says_and_who_is_kept_is_used(write, allowed, whole, recorded, gaps):
    """People pause for as many seconds as their id says; dropped or cut, the account tells of those who are used."""
    times = {pause: [*range(6), *range(5 + pause, 11 + pause)] for pause in (1, 4, 8, 11)}
    path = write("".join(f"{t},{who},{t},0,1,0\n" for who, walk in times.items() for t in walk))
    columns = {"track_id": 1, "t": 0, "x": 2, "y": 3, **({"speed": 4, "heading": 5} if recorded else {})}
    form = {"columns": columns, "day": "1970-01-01", "gaps": gaps, **allowed}
    if recorded and "max_gap_s" in allowed and allowed["max_gap_s"] > 5:
        with pytest.raises(DataError, match=r"max_gap_s 10: .* not interpolated.* set 5 or less"):
            read_tracks(path, **form)
        return
    tracks = read_tracks(path, **form)
    kept = tracks.track_id[tracks.bounds()[:-1]]
    assert len(kept) == len(whole) + (0 if gaps == "drop" else 2 * (len(times) - len(whole)))
    assert set(kept) >= set(whole) and (gaps == "split" or set(kept) == set(whole))
    assert len(usable_tracks(tracks, 1, allowed.get("time_step_s", 1.0))) == len(kept)


def test_rules_that_leave_nothing_name_the_file_and_what_they_dropped(write):
    with pytest.raises(DataError, match=r"recording\.csv: cleaning left no track.*min_points.*`cleaning`"):
        clean(write, MIXED, cleaning=({"min_points": {"points": 50}},))


def test_that_most_rows_are_of_another_day_is_told_where_nobody_is_left(write):
    rows = "".join(f"{86400 + k},1,{k},0\n" for k in range(-1, 9))
    form = FileFormat(columns=Columns(t=0, track_id=1, x=2, y=3))
    with pytest.raises(DataError, match=r"left no track.*'outside_day': 9.*of another day: are `day`, `days`, `start`"):
        clean_recording(write(rows), form, Recording(day="1970-01-01"))


@pytest.mark.parametrize("same_person", [False, True])
def test_pieces_are_told_to_be_one_person_where_they_are(write, same_person):
    rows = [f"{t},{who},{t},0" for who in ("7", "P01", "009") for t in (0, 1, 20, 21, 40, 41) if who != "009" or t < 20]
    _, account = clean(write, "\n".join(rows), gaps="split", same_person=same_person)
    assert account["tracks"]["kept"] == 7
    whose = {str(id_of(who, piece)): id_of(who) for who in ("7", "P01") for piece in (2, 3)}
    assert account.get("persons", {}) == (whose if same_person else {})


# --- the validation part of a recording ---------------------------------------------------------------------


def day(starts):
    """Tracks of three rows that begin at these seconds."""
    return concatenate(track(n, start + np.arange(3.0)) for n, start in enumerate(starts))


@given(st.lists(st.floats(0, 40_000), min_size=1, max_size=40), st.integers(0, 5))
def test_tracks_are_held_out_by_the_half_hour_they_begin_in(starts, seed):
    """About 15 % of the half-hours with people, at least one, with everyone who comes in them."""
    starts = [0.0, *starts, 20_000.0]  # long enough for half-hours
    held = in_validation_blocks(day(starts), seed)
    assert held.shape == (len(starts),)
    blocks = [int(start // BLOCK_S) for start in starts]
    out = {block for block, one in zip(blocks, held, strict=True) if one}
    assert [block in out for block in blocks] == held.tolist()
    assert len(out) == max(round(VALIDATION_SHARE * len(set(blocks))), 1)


def test_which_half_hours_are_held_out_is_the_seeds_choice():
    tracks = day(np.arange(0, 20 * BLOCK_S, 300.0))
    held = [in_validation_blocks(tracks, seed) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(held[0], held[1])
    assert (held[0] != held[2]).any()
    assert {part.mean() for part in held} == {0.15}


def test_nobody_is_held_out_of_nothing():
    assert in_validation_blocks(empty_tracks()).shape == (0,)


def hours(number, per_hour=6):
    """A recording of so many hours, with tracks that the rules drop, as text."""
    rows = []
    for n in range(int(number * per_hour)):
        began = n * 3600 // per_hour
        rows += [f"{began + s},{n},{s},{n}" for s in range(1 if n % 5 == 4 else 4)]
    return "\n".join(rows) + "\n"


def test_every_clean_track_is_in_exactly_one_part(write):
    """Those and no others; each part's account adds up, and says how much is in the other."""
    whole, account = clean(write, hours(10))
    parts = {part: clean(write, hours(10), part) for part in ("fit", "validation")}
    ids = {part: set(tracks.track_id) for part, (tracks, _) in parts.items()}
    assert not ids["fit"] & ids["validation"]
    assert ids["fit"] | ids["validation"] == set(whole.track_id)
    assert 0 < len(ids["validation"]) < 0.3 * len(set(whole.track_id))
    for part, (tracks, own) in parts.items():
        other = parts["validation" if part == "fit" else "fit"][1]
        for kind in ("rows", "tracks"):
            assert own[kind]["read"] == account[kind]["read"]
            assert own[kind]["read"] == own[kind]["kept"] + sum(own[kind]["dropped"].values())
            assert own[kind]["dropped"]["other_part"] == other[kind]["kept"]
            assert own[kind]["dropped"]["single_row"] == account[kind]["dropped"]["single_row"]
        expected = whole.take(np.isin(whole.track_id, tracks.track_id))
        for one, column in zip(tracks, expected, strict=True):
            np.testing.assert_array_equal(one, column)


@given(st.lists(st.tuples(st.floats(0, 40_000), st.floats(1, 3000)), min_size=1, max_size=30), st.integers(1, FOLDS))
def test_a_fold_s_contemporaries_are_not_in_what_is_without_it(spans, fold):
    """Each track is in one fold; those without it have nothing within ten minutes of its half-hours."""
    tracks = concatenate(track(n, start + np.array([0.0, lasts])) for n, (start, lasts) in enumerate(spans))
    inside, without = in_part(tracks, f"fold-{fold}"), in_part(tracks, f"without-{fold}")
    for (start, lasts), is_in, is_out in zip(spans, inside, without, strict=True):
        assert is_in == (start // BLOCK_S % FOLDS == fold - 1)
        blocks = [block for block in range(-2, 40) if block % FOLDS == fold - 1]
        near = any(
            start - CONTEMPORARIES_S < (block + 1) * BLOCK_S and start + lasts + CONTEMPORARIES_S >= block * BLOCK_S
            for block in blocks
        )
        assert is_out == (not near)
    assert sum(in_part(tracks, f"fold-{one}").astype(int) for one in range(1, FOLDS + 1)).tolist() == [1] * len(spans)


@given(
    st.lists(st.tuples(st.floats(0, 40_000), st.floats(1, 3000), st.integers(0, 9)), min_size=1, max_size=30),
    st.sampled_from([("validation", "fit"), ("fold-1", "without-1"), ("fold-4", "without-4")]),
)
def test_nobody_is_tested_and_trained_on(spans, parts):
    """Of a person of whom any track is left out, all are; which are tested does not depend on whose they are."""
    tracks = concatenate(track(n, start + np.array([0.0, lasts])) for n, (start, lasts, _) in enumerate(spans))
    whose = np.array([person for *_, person in spans])
    tested, trained = (in_part(tracks, part, whose) for part in parts)
    alone = in_part(tracks, parts[1])
    np.testing.assert_array_equal(tested, in_part(tracks, parts[0]))
    assert not set(whose[tested]) & set(whose[trained])
    assert trained.tolist() == [all(alone[whose == person]) for person in whose]
    np.testing.assert_array_equal(in_part(tracks, parts[1], np.arange(len(spans))), alone)


@pytest.mark.parametrize("same_person", [False, True])
def test_who_comes_back_is_in_one_part(write, same_person):
    """Whatever comes of them, where the pieces are one person."""
    rows = "".join(f"{n * 700 + later + s},{n},{s},{n}\n" for n in range(60) for later in (0, 9000) for s in range(4))
    whose = [
        {account.get("persons", {}).get(str(one), one) for one in tracks.track_id.tolist()}
        for tracks, account in (
            clean(write, rows, part, gaps="split", same_person=same_person) for part in ("fit", "validation")
        )
    ]
    assert len(whose[0] | whose[1]) == (60 if same_person else 120)
    assert not whose[0] & whose[1]


def test_without_a_part_nobody_is_left_out(write):
    assert "other_part" not in clean(write, hours(3))[1]["tracks"]["dropped"]


@given(st.integers(7, 10_000), st.integers(0, 1_900_000_000), st.integers(0, 5))
def test_of_a_short_recording_a_shorter_block_is_held_out(lasts, began, seed):
    """About 15 % of its people, who come one after the other; the others are there to fit."""
    starts = began + np.linspace(0, lasts, 300)
    held = np.flatnonzero(in_validation_blocks(day(starts), seed))
    assert 0 < len(held) <= VALIDATION_SHARE * 300 + 1
    np.testing.assert_array_equal(np.diff(held), 1)


@given(st.sets(st.integers(0, 20_000), min_size=2, max_size=5), st.integers(0, 5))
def test_whoever_comes_at_two_times_can_be_fitted_and_validated(starts, seed):
    held = in_validation_blocks(day(sorted(starts)), seed)
    assert held.any() and not held.all()


@pytest.mark.parametrize(
    ("part", "content", "takes"),
    [
        ("fit", "0,1,0,0\n1,1,1,0\n", "people who come at different times"),
        ("fold-5", hours(2), "2.5 hours or more, or 5 test days"),
        ("without-1", hours(0.5), "2.5 hours or more, or 5 test days"),
    ],
)
def test_who_has_nobody_left_for_a_part_is_told_why(write, part, content, takes):
    """Not that the rules are too strict."""
    with pytest.raises(DataError, match=f"nobody is left for `{part}`: .* {takes}; use longer recordings or more days"):
        clean(write, content, part)


def test_who_is_alone_is_validated(write):
    assert clean(write, hours(1, per_hour=1), "validation")[1]["tracks"]["kept"] == 1
