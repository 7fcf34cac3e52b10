"""The two made-up sites: their routes, and the flows that pass a place at an hour.

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

from collections import Counter
from typing import NamedTuple

import numpy as np

METRES_PER_PIXEL = 0.0247  # forum
SPEEDS = ((0.85, 1.25, 0.20), (0.15, 0.75, 0.10))  # share, mean and SD [m/s]: walkers, strollers
Points = tuple[tuple[float, float], ...]


class Route(NamedTuple):
    """Way-points [m] from door to door, and the route's relative weight in each opening hour."""

    name: str
    points: Points
    weights: tuple[int, ...]


class Site(NamedTuple):
    """A made-up place. Lengths in metres in the frame of the recording, hourly tuples follow `hours`."""

    timezone: str
    hours: range
    extent: tuple[float, float, float, float]  # x_min, x_max, y_min, y_max
    people: tuple[int, ...]  # mean number of people per hour, on a day of scale 1
    pace: tuple[float, ...]  # factor on everyone's speed, per hour
    routes: tuple[Route, ...]
    places: dict[str, tuple[float, float]]  # where `planted_flows` holds: name -> (x, y)
    spots: Points  # shop windows, benches, meeting points: (x, y)
    wait_share: float  # of those who pass a spot
    left: float  # mean and SD of the offset from the route's line, to the left-hand side
    left_sd: float
    half_width: float  # of the corridors: largest offset
    turn: float  # smoothing length of corners
    defects: dict[str, int]  # name -> number of people who get it, on a day of scale 1


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


def planted_flows(site: str, hour: int) -> tuple[Flow, ...]:
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
    for name, (x, y) in plan.places.items():
        passes: Counter[float] = Counter()
        for route in plan.routes:
            for heading in _headings_at(route.points, (x, y)):
                passes[heading] += route.weights[index]
        flows += [Flow(name, x, y, h, n / passes.total(), speed) for h, n in sorted(passes.items()) if n]
    return tuple(flows)


def _headings_at(points, place, reach=0.3):
    """Headings [rad] with which the polyline `points` passes within `reach` metres of `place`, one per pass."""
    start = np.asarray(points[:-1], float)
    step = np.asarray(points[1:], float) - start
    along = np.einsum("sk,sk->s", place - start, step) / np.einsum("sk,sk->s", step, step)
    foot = start + np.clip(along, 0, 1)[:, None] * step
    near = np.hypot(*(place - foot).T) < reach
    return np.arctan2(step[near, 1], step[near, 0]).tolist()
