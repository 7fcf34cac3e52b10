"""Demo data: seeded raw recordings of two made-up sites, in the true formats of ATC and Edinburgh.

Nothing here was measured: the days lie in 2030, the places do not exist. What is known exactly is what was
planted: the flows that pass a place at an hour (`planted_flows`), and every defect (see `write_recording`).

    hall    x -36..36 m, y -15..14 m, y up         forum    0..640 x 0..480 px (15.8 x 11.9 m), y DOWN

                   food (0, 13)                        stairs (110, 12)            lift (560, 12)
                        |                                   |                    ___---|
     y 7     +----------+--[north]-+-------- east           |       wander  __---      |
             |                     |       (35, 7)          |     .------.--          [lift lane]
        [west link]           [east link]                   |     |   _--              |
             |                     |                        |     '_--                 |
     y -7 ---+-[south]-----+-------+               front ---+-------+-----[lane]-------+------- atrium
     west                  |                    (15, 330)   |                          |   (625, 330)
   (-35, -7)          station (8, -14)                  garden (110, 455)         cafe (480, 455)

People enter at a door, follow a route of way-points to another door on a line of their own (left of its
centre), with their own speed and smooth turns; some stroll, some turn back, some wait for 10-40 s at a spot.
Routes have hourly weights: the hall flows in from the west in the morning and back in the evening, and to the
food corner at noon. In each hour the routes get their exact shares of the people (systematic sampling), so
even small files carry the planted shares. People are made as they come: memory does not grow with the file.
"""

import io
from collections import Counter
from datetime import date, datetime, time
from pathlib import Path
from typing import NamedTuple
from zlib import crc32
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
from PIL import Image
from pyarrow import csv
from scipy.ndimage import gaussian_filter1d

from modlhmp.storage import atomic_path, write_text

METRES_PER_PIXEL = 0.0247  # forum
FORUM_RATE = 9.0  # frames a second; frame 0 is 08:00
HALL_RATE = 24.0
SPEEDS = ((0.85, 1.25, 0.20), (0.15, 0.75, 0.10))  # share, mean and SD [m/s]: walkers, strollers
SPEED_LIMITS = (0.5, 1.75)
WAIT_S = (10.0, 40.0)


class Recording(NamedTuple):
    """One raw file of the demo; `file` is relative to the folder given to `write_all`."""

    site: str
    file: str
    day: str
    split: str


RECORDINGS = (
    Recording("hall", "hall/atc-20301002.csv", "2030-10-02", "train"),
    Recording("hall", "hall/atc-20301006.csv", "2030-10-06", "train"),
    Recording("hall", "hall/atc-20301009.csv", "2030-10-09", "test"),
    Recording("hall", "hall/atc-20301013.csv", "2030-10-13", "test"),
    Recording("forum", "forum/tracks.07Oct.txt", "2030-10-07", "train"),  # summer time
    Recording("forum", "forum/tracks.08Oct.txt", "2030-10-08", "train"),
    Recording("forum", "forum/tracks.04Nov.txt", "2030-11-04", "test"),  # winter time
    Recording("forum", "forum/tracks.05Nov.txt", "2030-11-05", "test"),
)


class Route(NamedTuple):
    """Way-points [m] from door to door, and the route's relative weight in each opening hour."""

    name: str
    points: tuple
    weights: tuple


class Site(NamedTuple):
    """A made-up place. Lengths in metres in the frame of the recording, hourly tuples follow `hours`."""

    timezone: str
    hours: range
    extent: tuple  # x_min, x_max, y_min, y_max
    people: tuple  # mean number of people an hour, on a day of scale 1
    pace: tuple  # factor on everyone's speed, an hour
    routes: tuple
    places: dict  # where `planted_flows` holds: name -> (x, y)
    spots: tuple  # shop windows, benches, meeting points: (x, y)
    wait_share: float  # of those who pass a spot
    left: float  # mean and SD of the offset from the route's line, to the left-hand side
    left_sd: float
    half_width: float  # of the corridors: largest offset
    turn: float  # smoothing length of corners
    defects: dict  # name -> number of people who get it, on a day of scale 1


class Flow(NamedTuple):
    """One direction of motion at a place (x, y) [m]: heading [rad], share of the passes, speed [m/s]."""

    place: str
    x: float
    y: float
    heading: float
    share: float
    mean_speed: float


def _both_ways(there, back, points, weights, weights_back):
    """A way and the same way walked from its end: two `Route`."""
    return Route(there, points, weights), Route(back, points[::-1], weights_back)


def _metres(points):
    """Pixels to metres, as nested tuples."""
    return tuple((float(x) * METRES_PER_PIXEL, float(y) * METRES_PER_PIXEL) for x, y in points)


# fmt: off
def _hall():
    """The shopping-centre hall: two promenades and two links that form a ring, four doors."""
    #            9 10 11 12 13 14 15 16 17 18 19 20 h
    inbound =   (9, 8, 6, 4, 3, 3, 3, 2, 2, 1, 1, 1)
    meals =     (0, 0, 2, 7, 4, 1, 0, 0, 1, 3, 2, 0)
    fed =       (0, 0, 0, 3, 7, 3, 1, 0, 0, 2, 3, 2)
    strolling = (0, 1, 1, 1, 1, 2, 2, 2, 2, 1, 1, 0)
    steady, outbound = (1,) * 12, inbound[::-1]
    west, east, station, food = (-35, -7), (35, 7), (8, -14), (0, 13)
    sw, se, nw, ne = (-20, -7), (20, -7), (-20, 7), (20, 7)
    routes = (
        *_both_ways("west-south-east", "east-south-west", (west, se, ne, east), inbound, outbound),
        *_both_ways("west-north-east", "east-north-west", (west, sw, nw, east), inbound, outbound),
        *_both_ways("west-food", "food-west", (west, sw, nw, (0, 7), food), meals, fed),
        *_both_ways("east-food", "food-east", (east, (0, 7), food), meals, fed),
        *_both_ways("station-east", "east-station", (station, (8, -7), se, ne, east), steady, steady),
        Route("ring", (west, se, ne, nw, sw, west), strolling),
        Route("turn-back", (west, (0, -7), west), steady),
    )
    return Site(
        timezone="Asia/Tokyo", hours=range(9, 21), extent=(-36.0, 36.0, -15.0, 14.0), routes=routes,
        people=(12, 17, 21, 31, 29, 21, 18, 18, 22, 27, 22, 14),
        pace=(1.08, 1.05, 1.0, 1.0, 0.95, 0.92, 0.92, 0.92, 0.95, 1.0, 1.0, 1.04),
        places={"west arm": (-28.0, -7.0), "south": (-8.0, -7.0), "west link": (-20.0, 0.0),
                "east link": (20.0, 0.0), "north": (10.0, 7.0), "east arm": (28.0, 7.0)},
        spots=((-14.0, -7.0), (2.0, -7.0), (14.0, -7.0), (-11.0, 7.0), (3.0, 7.0), (16.0, 7.0)),
        wait_share=0.15, left=0.5, left_sd=0.9, half_width=2.3, turn=1.2,
        defects={"text_value": 5, "nan_value": 4, "infinite_value": 3, "absurd_value": 5,
                 "wrong_column_count": 4, "no_person": 6, "duplicate_row": 5, "unsorted": 4,
                 "single_row_track": 5, "gap_track": 6},
    )


def _forum():
    """The atrium seen from above: a lane along the image, two lanes across, a diagonal; here in pixels."""
    #         8  9 10 11 12 13 14 15 h
    coming = (8, 7, 4, 3, 3, 4, 2, 1)
    lunch =  (1, 1, 2, 4, 8, 4, 2, 1)
    fed =    (1, 1, 1, 2, 6, 7, 3, 1)
    steady, going = (2,) * 8, coming[::-1]
    front, atrium, stairs, garden = (15, 330), (625, 330), (110, 12), (110, 455)
    lift, cafe = ((560, 12), (560, 60)), ((480, 420), (480, 455))
    routes = (
        *_both_ways("front-atrium", "atrium-front", (front, atrium), coming, going),
        *_both_ways("front-stairs", "stairs-front", (front, (110, 330), stairs), coming, going),
        *_both_ways("stairs-garden", "garden-stairs", (stairs, garden), lunch, fed),
        *_both_ways("lift-cafe", "cafe-lift", (*lift, *cafe), lunch, fed),
        *_both_ways("front-lift", "lift-front", (front, (220, 330), *lift[::-1]), coming, going),
        Route("wander", (front, (230, 330), (330, 190), (290, 80), (220, 190), (230, 330), front), steady),
        Route("turn-back", (atrium, (320, 330), atrium), steady),
    )
    lane, stairs_lane, lift_lane = _metres(((400, 330), (110, 170), (525, 217.5)))
    return Site(
        timezone="Europe/London", hours=range(8, 16), extent=(0.0, 15.808, 0.0, 11.856),
        routes=tuple(Route(r.name, _metres(r.points), r.weights) for r in routes),
        people=(45, 70, 60, 60, 90, 75, 55, 45), pace=(1.1, 1.08, 1.0, 1.0, 0.96, 0.96, 1.0, 1.04),
        places={"lane": lane, "stairs lane": stairs_lane, "lift lane": lift_lane},
        spots=_metres(((250, 320), (320, 250), (110, 400), (490, 375), (560, 330))),
        wait_share=0.2, left=0.2, left_sd=0.35, half_width=0.9, turn=0.5,
        defects={"short_track": 15, "margin_track": 12, "lift_track": 10, "frame_order_rows": 25,
                 "text_value": 4},
    )
# fmt: on


SITES = {"hall": _hall(), "forum": _forum()}
LIFT_LOOP = _metres(((560, 12), (560, 70), (430, 70), (560, 70), (560, 12)))  # the way of a `lift_track`


def planted_flows(site, hour):
    """The flows that pass each place of `site` at clock hour `hour`: a tuple of `Flow`.

    A place's shares sum to 1 and count the passes of people who enter in that hour, over the corridor's whole
    width; headings lie in (-pi, pi]. The mean speed is that of the rows (slow people leave more of them),
    waiting left out. Raises `ValueError` for an hour at which the site is closed.
    """
    plan = SITES[site]
    if hour not in plan.hours:
        raise ValueError(f"{site} is open at the hours {plan.hours[0]}-{plan.hours[-1]}, not at {hour}")
    index = plan.hours.index(hour)
    speed = plan.pace[index] / sum(share * (1 + (sd / mean) ** 2) / mean for share, mean, sd in SPEEDS)
    flows = []
    for name, place in plan.places.items():
        passes = Counter()
        for route in plan.routes:
            for heading in _headings_at(route.points, place):
                passes[heading] += route.weights[index]
        flows += [Flow(name, *place, h, n / passes.total(), speed) for h, n in sorted(passes.items()) if n]
    return tuple(flows)


def _headings_at(points, place, reach=0.3):
    """Headings [rad] with which the polyline `points` passes within `reach` metres of `place`, one a pass."""
    start = np.asarray(points[:-1], float)
    step = np.asarray(points[1:], float) - start
    along = np.einsum("sk,sk->s", place - start, step) / np.einsum("sk,sk->s", step, step)
    foot = start + np.clip(along, 0, 1)[:, None] * step
    near = np.hypot(*(place - foot).T) < reach
    return np.arctan2(step[near, 1], step[near, 0]).tolist()


# --- people -------------------------------------------------------------------------------------------------


def _visits(rng, plan, scale):
    """Everyone's start [s after local midnight], sorted, index of the opening hour and of the route."""
    starts, hours, routes = [], [], []
    for index, hour in enumerate(plan.hours):
        count = max(1, round(plan.people[index] * scale))
        span = 3600 if hour + 1 in plan.hours else 3240  # everyone has left when the doors close
        starts.append(hour * 3600 + np.sort(rng.uniform(0, span, count)))
        hours.append(np.full(count, index))
        edges = np.cumsum([route.weights[index] for route in plan.routes])
        drawn = np.searchsorted(edges, (np.arange(count) + rng.random()) / count * edges[-1], side="right")
        routes.append(rng.permutation(drawn))
    return np.concatenate(starts), np.concatenate(hours), np.concatenate(routes)


def _defect_plan(rng, plan, people, scale):
    """Which person gets which defect: {index of the person: name}, at most one each."""
    names = [name for name, count in plan.defects.items() for _ in range(max(1, round(count * scale)))]
    return dict(zip(rng.permutation(people)[: len(names)].tolist(), names, strict=False))


def _smooth_noise(rng, shape, width, sd):
    """Gaussian noise along axis 0, correlated over `width` samples, with standard deviation `sd`."""
    white = rng.standard_normal(shape)
    return gaussian_filter1d(white, width, axis=0) * sd * np.sqrt(2 * np.sqrt(np.pi) * width)


def _shifted(points, left):
    """The polyline `points` [n, 2] moved `left` metres to the left of its direction, sides kept parallel."""
    step = np.diff(points, axis=0)
    normal = np.column_stack([-step[:, 1], step[:, 0]]) / np.hypot(*step.T)[:, None]
    moved = [points[0] + left * normal[0]]
    for corner, before, after in zip(points[1:-1], normal[:-1], normal[1:], strict=True):
        if before @ after < -0.9:  # turning back: cross over to the other side
            moved += [corner + left * before, corner + left * after]
        else:
            moved.append(corner + left * (before + after) / (1 + before @ after))
    return np.array([*moved, points[-1] + left * normal[-1]])


def _line(rng, plan, points, spacing=0.1):
    """A person's own way along a route: positions [m] at every `spacing` metres, shape [n, 2]."""
    left = np.clip(rng.normal(plan.left, plan.left_sd), -plan.half_width, plan.half_width)
    corners = _shifted(np.asarray(points, float), left)
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    grid = np.arange(0, length[-1], spacing)
    line = np.column_stack([np.interp(grid, length, corners[:, k]) for k in (0, 1)])
    ends = int(4 * plan.turn / spacing)  # samples straight on beyond both ends: smoothing must not move them
    first, last = ((line[1] - line[0]) * k for k in (-1, 1))
    reach = np.arange(1, ends + 1)[:, None]
    line = np.concatenate([line[0] + reach[::-1] * first, line, line[-1] + reach * last])
    smooth = gaussian_filter1d(line, plan.turn / spacing, axis=0)[ends:-ends]
    return smooth + _smooth_noise(rng, smooth.shape, 1.8 / spacing, plan.left_sd / 5)


def _walk(rng, plan, points, pace, rate):
    """Positions [m] of one person at `rate` samples a second from door to door, shape [n, 2]."""
    line = _line(rng, plan, points)
    _share, mean, sd = SPEEDS[int(rng.random() > SPEEDS[0][0])]
    speed = np.clip(rng.normal(mean, sd), *SPEED_LIMITS) * pace
    samples = int(len(line) * 0.1 / speed * rate * 1.4)
    gone = np.cumsum(speed / rate * np.maximum(1 + _smooth_noise(rng, samples, 2 * rate, 0.08), 0.5))
    gone = gone[gone < (len(line) - 1) * 0.1]
    spots = np.array(plan.spots)
    distance = np.hypot(*(line[:, None] - spots).transpose(2, 0, 1))
    passed = np.flatnonzero(distance.min(axis=0) < plan.half_width + 0.3)
    if len(passed) and rng.random() < plan.wait_share:
        stop = distance[:, rng.choice(passed)].argmin() * 0.1 + rng.normal(0, 0.3)
        halt = np.clip(np.searchsorted(gone, stop), 1, len(gone) - 1)
        wait = np.full(int(rng.uniform(*WAIT_S) * rate), gone[halt])
        gone = np.concatenate([gone[:halt], wait, gone[halt:]])
        gone = gaussian_filter1d(gone, 0.4 * rate, mode="nearest")
    at = np.arange(len(line)) * 0.1
    position = np.column_stack([np.interp(gone, at, line[:, k]) for k in (0, 1)])
    return position + _smooth_noise(rng, position.shape, 0.8 * rate, 0.015)


# --- hall: ATC's 8 columns ----------------------------------------------------------------------------------

# Rows are int64 in units of the file's last digits: ms, id, mm, mm, mm, 0.01 mm/s, mrad, mrad; then the row's
# place in the file [ms], and the defect to write into its text (an index into _IN_TEXT).
_T, _ID, _X, _Y, _Z, _V, _HEADING, _FACING, _ORDER, _TEXT = range(10)
_DECIMALS = (3, 0, 0, 0, 0, 2, 3, 3)
_IN_TEXT = ("", "text_value", "nan_value", "infinite_value", "wrong_column_count")
_BAD = {  # which columns get which text
    "text_value": ((_T, _ID, _X, _Y, _V, _HEADING), (b"abc", b"", b"1.2.3")),
    "nan_value": ((_X, _Y, _V, _HEADING), (b"nan", b"NaN")),
    "infinite_value": ((_X, _Y, _V, _HEADING), (b"inf", b"-inf")),
}
_ROWS_A_PERSON = 3  # rows with a defect, for each person who gets one
_BATCH = 32  # people made at a time


def _hall_rows(rng, position, *, person, start_ms, jitter):
    """A walk as integer rows [n, 10]; all people share the tracker's uneven clock (`jitter` [ms], cyclic)."""
    ticks = int(start_ms * HALL_RATE / 1000) + 1 + np.arange(len(position))
    velocity = np.gradient(position, 1 / HALL_RATE, axis=0)
    velocity += _smooth_noise(rng, position.shape, 6, 0.03)
    seen = position + rng.normal(0, 0.008, position.shape)
    heading = np.arctan2(velocity[:, 1], velocity[:, 0])
    facing = heading + _smooth_noise(rng, len(heading), HALL_RATE, 0.2)
    rows = np.zeros((len(position), 10), np.int64)
    rows[:, _T] = np.rint(ticks * 1000 / HALL_RATE) + jitter[ticks % len(jitter)]
    rows[:, _ID] = person
    rows[:, _X : _Y + 1] = np.rint(seen * 1000)
    rows[:, _Z] = np.rint(rng.normal(1600, 90) + rng.normal(0, 10, len(rows)))
    rows[:, _V] = np.rint(np.hypot(*velocity.T) * 1e5)
    rows[:, _HEADING] = np.rint(heading * 1000)
    rows[:, _FACING] = np.rint(np.angle(np.exp(1j * facing)) * 1000)
    rows[:, _ORDER] = rows[:, _T]
    return rows


def _plant_in_hall(rng, rows, defect):
    """Plant `defect` into one person's rows: the new rows, and how many rows (or tracks) it makes."""
    if defect == "single_row_track":
        return rows[:1], 1
    if defect == "gap_track":
        lost = rows[len(rows) // 3, _T] + np.array([0, rng.integers(6000, 9000)])
        return rows[(rows[:, _T] < lost[0]) | (rows[:, _T] > lost[1])], 1
    chosen = rng.choice(np.arange(24, len(rows) - 24, 48), _ROWS_A_PERSON, replace=False)
    if defect == "absurd_value":
        rows[chosen[0], _X] = 10**9
        rows[chosen[1:], _V] = 99_000_00
    elif defect == "unsorted":
        rows[chosen, _ORDER] += rng.integers(100, 400, len(chosen))
    elif defect in _IN_TEXT:
        rows[chosen, _TEXT] = _IN_TEXT.index(defect)
    else:
        copies = rows[chosen]
        if defect == "no_person":
            copies[:, _ID] = -1
            copies[:, _Y] += 500
        else:  # duplicate_row: the first repeats a row as it is, the others only its time and id
            copies[1:, _X] += rng.integers(10, 60, len(copies) - 1)
        rows = np.concatenate([rows, copies])
    return rows, len(chosen)


def _hall_text(rng, rows, midnight_ms):
    """Rows as the bytes of CSV lines, with the defects that only text can carry."""
    columns = [rows[:, k] + (midnight_ms if k == _T else 0) for k in range(8)]
    table = pa.table({str(k): _decimals(columns[k], digits) for k, digits in enumerate(_DECIMALS)})
    text = io.BytesIO()
    csv.write_csv(table, text, csv.WriteOptions(include_header=False))
    lines = text.getvalue().split(b"\n")
    for row in np.flatnonzero(rows[:, _TEXT]):
        lines[row] = _broken(rng, lines[row], _IN_TEXT[rows[row, _TEXT]])
    return b"\n".join(lines)


def _decimals(values, digits):
    """int64 values as an Arrow decimal column with `digits` places (3: 50 -> 0.050): exact and fast."""
    if not digits:
        return pa.array(values)
    halves = np.column_stack([values, values >> 63])  # 128-bit two's complement
    buffers = [None, pa.py_buffer(halves)]
    return pa.Decimal128Array.from_buffers(pa.decimal128(18, digits), len(values), buffers)


def _broken(rng, line, defect):
    """One CSV line with a field that is no number, or with 7 or 9 columns."""
    fields = line.split(b",")
    if defect == "wrong_column_count":
        return b",".join(fields[:-1]) if rng.random() < 0.5 else line + b",0"
    columns, texts = _BAD[defect]
    fields[rng.choice(columns)] = texts[rng.integers(len(texts))]
    return b",".join(fields)


def _write_hall(file, rng, plan, day, scale):
    """Write a day of the hall in time order, a batch of people at a time; return what was planted."""
    starts, hours, routes = _visits(rng, plan, scale)
    defects = _defect_plan(rng, plan, len(starts), scale)
    midnight_ms = round(datetime.combine(day, time(), ZoneInfo(plan.timezone)).timestamp() * 1000)
    jitter = rng.integers(-6, 7, 997)
    planted = Counter(dict.fromkeys(plan.defects, 0), tracks=len(starts) + 2)
    pending = _other_days(rng, plan, len(starts), jitter)
    planted["outside_day"] = sum(map(len, pending))
    for index, start in enumerate(starts):
        walk = _walk(rng, plan, plan.routes[routes[index]].points, plan.pace[hours[index]], HALL_RATE)
        rows = _hall_rows(rng, walk, person=_person(index), start_ms=start * 1000, jitter=jitter)
        if index in defects:
            rows, count = _plant_in_hall(rng, rows, defects[index])
            planted[defects[index]] += count
        pending.append(rows)
        last = index == len(starts) - 1
        if index % _BATCH == _BATCH - 1 or last:
            rows = np.concatenate(pending)
            rows = rows[np.argsort(rows[:, _ORDER], kind="stable")]
            until = np.inf if last else starts[index + 1] * 1000 - 10  # nobody to come has a row before that
            ready = int(np.searchsorted(rows[:, _ORDER], until))
            file.write(_hall_text(rng, rows[:ready], midnight_ms))
            planted["rows"] += ready
            pending = [rows[ready:]]
    return dict(planted)


def _person(index):
    """Track id of the person with this index: unique over the day."""
    return 10_000_000 + 100 * index


def _other_days(rng, plan, people, jitter, count=4):
    """Rows of the evening before and of the morning after, one person each: a list of two row blocks."""
    blocks = []
    for person, start_ms in ((people, -20_000), (people + 1, 86_400_000 + 20_000)):
        walk = _walk(rng, plan, plan.routes[0].points, 1.0, HALL_RATE)[:count]
        blocks.append(_hall_rows(rng, walk, person=_person(person), start_ms=start_ms, jitter=jitter))
    return blocks


# --- forum: Edinburgh's Properties / TRACK text -------------------------------------------------------------

# Steps between the frames of a track, and how often: the camera misses some.
_FRAME_STEPS = np.array([1, 2, 3, 4, 5, 6, 8, 10, 11])
_FRAME_ODDS = np.array([0.972, 0.013, 0.005, 0.003, 0.002, 0.002, 0.001, 0.001, 0.001])


def _forum_track(rng, plan, route, pace, *, start_s, defect):
    """One track as integer rows x [px], y [px], frame [n, 3]; and how many rows or tracks `defect` makes."""
    if defect == "short_track":
        route = plan.routes[0]
    path = _walk(rng, plan, LIFT_LOOP if defect == "lift_track" else route.points, pace, FORUM_RATE)
    path = path / METRES_PER_PIXEL + rng.normal(0, 0.7, path.shape)
    path = np.clip(np.rint(path), (3, 3), (636, 456)).astype(int)
    if defect == "short_track":  # looks in and goes back
        path = np.concatenate([path[: (seen := rng.integers(6, 14))], path[seen::-1]])
    elif defect == "margin_track":  # lost in the middle
        inside = (path > (60, 60)).all(axis=1) & (path < (580, 410)).all(axis=1)
        inside &= (path[:, 0] > 165) | (path[:, 1] < 270)  # not at the front door
        path = path[: np.flatnonzero(inside)[-1] + 1]
    frames = np.arange(len(path))
    seen = np.cumsum(np.append(0, rng.choice(_FRAME_STEPS, len(path), p=_FRAME_ODDS)))
    seen = np.append(seen[seen < frames[-1]], frames[-1])
    if len(seen) < 35 or defect == "text_value":  # stays clear of 31 points and of gaps over 12 frames
        seen = frames
    first_frame = int((start_s - plan.hours[0] * 3600) * FORUM_RATE)
    rows = np.column_stack([path[seen], first_frame + seen])
    if defect != "frame_order_rows":
        return rows, int(defect is not None)
    after = np.sort(rng.choice(np.arange(5, len(rows) - 5, 4), rng.integers(1, 4), replace=False))
    shift = np.column_stack([rng.integers(-3, 4, (len(after), 2)), rng.integers(-1, 1, len(after))])
    return np.insert(rows, after + 1, rows[after] + shift, axis=0), len(after)


def _write_forum(file, rng, plan, _day, scale):
    """Write a day of the forum, track by track in order of appearance; return what was planted."""
    starts, hours, routes = _visits(rng, plan, scale)
    defects = _defect_plan(rng, plan, len(starts), scale)
    planted = Counter(dict.fromkeys(plan.defects, 0), tracks=len(starts))
    file.write(f"% Total number of trajectories in file are  {len(starts)} \n\n".encode())
    for index, start in enumerate(starts):
        defect = defects.get(index)
        route, pace = plan.routes[routes[index]], plan.pace[hours[index]]
        rows, count = _forum_track(rng, plan, route, pace, start_s=start, defect=defect)
        if defect:
            planted[defect] += count
        planted["rows"] += len(rows)
        text = [f"[{x} {y} {frame}]" for x, y, frame in rows.tolist()]
        if defect == "text_value":
            middle = len(rows) // 2
            text[middle] = f"[{rows[middle, 0]} abc {rows[middle, 2]}]"
        length = np.hypot(*np.diff(rows[:, :2], axis=0).T).sum()
        properties = f"{len(rows)} {rows[0, 2]} {rows[-1, 2]} {length:.2f} "
        number = index + 1
        file.write(f"Properties.R{number}=[{properties}];\n TRACK.R{number}=[{';'.join(text)}];\n".encode())
    return dict(planted)


# --- floor plan ---------------------------------------------------------------------------------------------

PLAN_RESOLUTION = 0.1  # m a pixel
CORRIDOR_HALF_WIDTH = 3.0  # m from a route's line to the wall; people keep within `Site.half_width` of it


def write_floor_plan(path):
    """Write the hall's floor plan, as map_server's YAML file at `path` and its image beside it (.pgm).

    All that lies within a corridor's half width of a route is free, the rest of the extent is wall; nobody in the
    recordings walks into a wall.
    """
    plan, path = SITES["hall"], Path(path)
    x_min, x_max, y_min, y_max = plan.extent
    x, y = (np.arange(a + PLAN_RESOLUTION / 2, b, PLAN_RESOLUTION) for a, b in ((x_min, x_max), (y_min, y_max)))
    free = np.zeros((len(y), len(x)), bool)
    for route in plan.routes:
        for (x0, y0), (x1, y1) in zip(route.points[:-1], route.points[1:], strict=True):
            across = (x > min(x0, x1) - CORRIDOR_HALF_WIDTH) & (x < max(x0, x1) + CORRIDOR_HALF_WIDTH)
            along = (y > min(y0, y1) - CORRIDOR_HALF_WIDTH) & (y < max(y0, y1) + CORRIDOR_HALF_WIDTH)
            free |= along[:, None] & across
    image = path.with_suffix(".pgm")
    with atomic_path(image) as temporary:
        Image.fromarray(np.where(free, 254, 0).astype(np.uint8)[::-1]).save(temporary, format="PPM")
    write_text(
        path,
        f"image: {image.name}\nresolution: {PLAN_RESOLUTION}\norigin: [{x_min}, {y_min}, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n",
    )


# --- files --------------------------------------------------------------------------------------------------


def write_recording(path, site, day, seed, scale=1.0):
    """Write the raw file of one day of `site` ("hall" or "forum"); its bytes depend on the arguments only.

    `day` is an ISO date, `seed` an integer >= 0, `scale` multiplies the number of people. Returns what was
    planted: {defect: tracks for names that end in _track, else rows}, each row and track under one name at
    most, plus "tracks" and "rows" of the whole file (defects included; person -1 is no track, the two people
    of other days are). `unsorted` rows are good rows in a wrong line; the other rows of a track with defect
    rows are good. Raises `ValueError` for an unknown site, a bad date or a scale that is not positive.
    """
    if site not in SITES:
        raise ValueError(f"no demo site {site!r}; there are {', '.join(SITES)}")
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale is {scale}; it must be a number above 0")
    when = date.fromisoformat(day)
    rng = np.random.default_rng(np.random.SeedSequence([seed, crc32(site.encode()), when.toordinal()]))
    write = {"hall": _write_hall, "forum": _write_forum}[site]
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        return write(file, rng, SITES[site], when, scale)


def write_all(folder, seed, scale=1.0):
    """Write all `RECORDINGS` below `folder`; returns {file: what `write_recording` returned}."""
    return {r.file: write_recording(Path(folder) / r.file, r.site, r.day, seed, scale) for r in RECORDINGS}
