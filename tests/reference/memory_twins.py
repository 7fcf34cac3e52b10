"""Slow, plain twins of the maps with memory: one walker, one person, one particle at a time.

People are lists of rows (t, x, y), as `crowds.people_of` gives them; `rows_of` makes them of an episode map.
"""

import math
from bisect import bisect_right
from itertools import pairwise

import numpy as np
from twins import position

from modlhmp.streams import uniforms

HEADINGS, SLOW, STROLL, PACED, LIMITS = 8, 0.3, 0.9, 0.2, (0.5, 2.0)


def resample(people, step_s, max_gap_s=5.0):
    """Rows a time step apart of whoever has two rows and no gap over 5 s; a 20th of a step too short is long enough."""
    result = []
    for walk in people:
        if len(walk) > 1 and all(b[0] - a[0] <= max_gap_s for a, b in pairwise(walk)):
            number = math.floor((walk[-1][0] - walk[0][0]) / step_s + 0.05)
            times = [walk[0][0] + n * step_s for n in range(number + 1)]
            result.append([(t, *position(walk, t)) for t in times])
    return result


def rows_of(table):
    """The people of an episode map."""
    people = {}
    for row in table.to_pylist():
        people.setdefault(row["person"], []).append((row["t"], row["x"], row["y"]))
    return list(people.values())


def velocities(places, step_s):
    """Velocities between places (x, y), the newest first."""
    return [((b[0] - a[0]) / step_s, (b[1] - a[1]) / step_s) for a, b in pairwise(places)][::-1]


def seen_velocities(seen):
    """Velocities between rows (t, x, y) by their own clock, the newest first."""
    return [((b[1] - a[1]) / (b[0] - a[0]), (b[2] - a[2]) / (b[0] - a[0])) for a, b in pairwise(seen)][::-1]


def mean_velocity(steps, weights):
    """The sum of w v over the sum of w, over as many of the newest velocities as there are weights."""
    both = list(zip(steps, weights, strict=False))
    total = sum(w for _, w in both)
    return tuple(sum(w * v[axis] for v, w in both) / total for axis in range(2))


def point(place, steps, weights, metric, hour):
    """Place; heading_m v / max(|v|, 0.3 m/s); speed_m |v|; change_m (newest - oldest velocity); hour_m hour."""
    v = mean_velocity(steps, weights)
    speed = math.hypot(*v)
    heading = [metric.heading_m * part / max(speed, SLOW) for part in v]
    change = [metric.change_m * (steps[0][axis] - steps[-1][axis]) for axis in range(2)]
    return [*place, *heading, metric.speed_m * speed, *change, metric.hour_m * hour], speed


def pace_factor(own, other, pace):
    """(own / other)^pace within [1/2, 2]; 1 if either hardly moves."""
    return 1.0 if min(own, other) <= PACED else min(max((own / other) ** pace, LIMITS[0]), LIMITS[1])


def median(points):
    """Weiszfeld's iteration from the mean: weights 1 / (distance + 1 cm), until it moves less than 1 mm."""
    at = [sum(p[axis] for p in points) / len(points) for axis in range(2)]
    for _ in range(50):
        weights = [1.0 / (math.dist(p, at) + 0.01) for p in points]
        to = [sum(w * p[axis] for w, p in zip(weights, points, strict=True)) / sum(weights) for axis in range(2)]
        moved, at = abs(to[0] - at[0]) + abs(to[1] - at[1]), to
        if moved < 1e-3:
            break
    return tuple(at)


def replay(
    people, seen, steps, step_s, k, weights, metric, hours, pace=1.0, reach_m=10.0, exclude_s=0.0, of_pieces=False
):
    """([(x, y) or None] * T, [[(x, y) or None] * T] * 4k) of a walker seen at rows (t, x, y); None if nobody is near.

    None in a path: gone. `hours(t)` is the clock time. The 8 k most alike pieces are looked up; of a person the most
    alike counts, in the samples every piece if they are `of_pieces`.
    """
    past, (t0, *here) = len(seen) - 1, seen[-1]
    walker, speed = point(here, seen_velocities(seen), weights, metric, hours(t0))
    pieces = []
    for person, walk in enumerate(people):
        for row in range(past, len(walk) - 1):
            before = velocities([at[1:] for at in walk[row - past : row + 1]], step_s)
            other, pace_of = point(walk[row][1:], before, weights, metric, hours(walk[row][0]))
            pieces.append((math.dist(walker, other), person, row, pace_of))
    usable, followed = [], {}
    for distance, person, row, other in sorted(pieces)[: 8 * k]:
        excluded = exclude_s and abs(people[person][row][0] - t0) <= exclude_s
        if distance <= reach_m and not excluded:
            usable.append((person, row, pace_factor(speed, other, pace)))
            followed.setdefault(person, usable[-1])
    if not followed:
        return None

    def at(piece, step):
        person, row, rate = piece
        walk, on = people[person], row + step * rate
        if on > len(walk) - 1:
            return None
        whole = min(math.floor(on), len(walk) - 2)
        part = on - whole
        return tuple(
            here[axis] + (1 - part) * walk[whole][1 + axis] + part * walk[whole + 1][1 + axis] - walk[row][1 + axis]
            for axis in range(2)
        )

    sampled = usable if of_pieces else list(followed.values())
    samples = [[at(sampled[n % len(sampled)], step) for step in range(1, steps + 1)] for n in range(4 * k)]
    path = []
    for step in range(1, steps + 1):
        there = [place for place in (at(piece, step) for piece in followed.values()) if place is not None][:k]
        path.append(median(there) if there else None)
    return path, samples


def held(path, start):
    """(places, steps alive) of a path with None from some step on: held there."""
    alive = path.index(None) if None in path else len(path)
    return [path[min(n, alive - 1)] if alive else tuple(start) for n in range(len(path))], alive


class PlainSnippets:
    """A snippet flow map as lists: the rows of its table by cell and bin, and how many each bin stands for."""

    def __init__(self, table, weights, metric, hours, length):
        meta = table.schema.metadata
        self.cell, self.past, self.step_s = float(meta[b"cell"]), int(meta[b"past"]), float(meta[b"step"])
        self.weights, self.metric, self.hours = weights, metric, hours
        self.bins = {}
        for row in table.to_pylist():
            path = list(zip(row["path"][::2], row["path"][1::2], strict=True))
            steps = min(row["steps"], length)
            before = velocities(path[: self.past + 1], self.step_s)
            place = row["x"], row["y"]
            at, speed = point(place, before, weights, metric, hours(60.0 * row["minute"]))
            one = {**row, "path": path, "stored": row["steps"], "steps": steps, "point": at, "speed": speed}
            self.bins.setdefault((row["i"], row["j"], row["bin"]), []).append(one)

    def around(self, place, velocity):
        """Bins (cell, heading) near a particle: cells up to 1 away, or else up to 3; headings within 1.5 bins.

        Whoever hardly moves is near in any heading, and of interest to all but those who walk.
        """
        angle, speed = math.atan2(velocity[1], velocity[0]) * HEADINGS / (2 * math.pi), math.hypot(*velocity)
        turns = [abs((h - angle + HEADINGS / 2) % HEADINGS - HEADINGS / 2) for h in range(HEADINGS)]
        near = [h for h, turn in enumerate(turns) if speed < SLOW or turn <= 1.5]
        if speed < STROLL:
            near.append(HEADINGS)
        ci, cj = (math.floor(part / self.cell) for part in place)
        for ring in (1, 3):
            cells = [(i, j) for i in range(ci - ring, ci + ring + 1) for j in range(cj - ring, cj + ring + 1)]
            found = [(i, j, h) for i, j in cells for h in near if (i, j, h) in self.bins]
            if found:
                return found
        return []

    def draw(self, number, at, velocity, minute, bandwidth_m, exclude_s):
        """A snippet by rejection, or the most alike of 50 tries; None where there is none. `number()`: in (0, 1)."""
        bins = self.around(at[:2], velocity)
        if not bins:
            return None
        upto, total = [], 0.0
        for name in bins:
            total += sum(row["stands_for"] for row in self.bins[name])
            upto.append(total)
        best, nearest = None, math.inf
        for _ in range(50):
            at_count, accept = number() * total, number()
            place = bisect_right(upto, at_count)
            rows = self.bins[bins[place]]
            counted = sum(row["stands_for"] for row in rows)
            row = rows[min(int((upto[place] - at_count) / counted * len(rows)), len(rows) - 1)]
            earliest, latest = 60.0 * (row["minute"] - minute), 60.0 * (row["minute"] + 1 - minute)  # than t0, in s
            if exclude_s and earliest <= exclude_s and latest > -exclude_s:
                continue
            distance = math.dist(at, row["point"])
            if accept < math.exp(-(distance**2) / (2 * bandwidth_m**2)):
                return row
            if distance < nearest:
                best, nearest = row, distance
        return best

    def particle(self, seen, key, steps, leaves, bandwidth_m=1.5, pace=1.0, exits=True, exclude_s=0.0):
        """[(x, y) or None] * T of one particle of a walker seen at rows (t, x, y).

        `leaves(row)`: whether a snippet ends because its person left.
        """
        drawn = iter(range(10**6))

        def number():
            return uniforms(np.array([key]), next(drawn), 1)[0, 0]

        (t0, *here), steps_before = seen[-1], seen_velocities(seen)
        path, began = [], 0.0
        while len(path) < steps:
            at, speed = point(here, steps_before, self.weights, self.metric, self.hours(t0))
            velocity = mean_velocity(steps_before, self.weights)
            row = self.draw(number, at, velocity, t0 / 60.0, bandwidth_m, exclude_s)
            if row is None:
                break
            rate = pace_factor(speed, row["speed"], pace)
            while len(path) < steps and (len(path) + 1 - began) * rate <= row["steps"]:
                on = self.past + (len(path) + 1 - began) * rate
                whole = min(math.floor(on), len(row["path"]) - 2)
                part, a, b = on - whole, *row["path"][whole : whole + 2]
                path.append(tuple(here[x] + (1 - part) * a[x] + part * b[x] for x in range(2)))
            if exits and leaves(row):
                break
            began += row["steps"] / rate
            end = self.past + row["steps"]
            before = velocities(row["path"][end - self.past : end + 1], self.step_s)
            steps_before = [(rate * v[0], rate * v[1]) for v in before]
            here = [here[x] + row["path"][end][x] for x in range(2)]
        return path + [None] * (steps - len(path))
