"""Made-up people: when they come, which way they go, and how they walk."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from modlhmp.study.demo.sites import SPEEDS, Points, Site

SPEED_LIMITS = (0.5, 1.75)
WAIT_S = (10.0, 40.0)


def visits(rng: np.random.Generator, plan: Site, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


def defect_plan(rng: np.random.Generator, plan: Site, people: int, scale: float) -> dict[int, str]:
    """Which person gets which defect: {index of the person: name}, at most one per person."""
    names = [name for name, count in plan.defects.items() for _ in range(max(1, round(count * scale)))]
    return dict(zip(rng.permutation(people)[: len(names)].tolist(), names, strict=False))


def smooth_noise(rng: np.random.Generator, shape: int | tuple[int, ...], width: float, sd: float) -> np.ndarray:
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
    return smooth + smooth_noise(rng, smooth.shape, 1.8 / spacing, plan.left_sd / 5)


def walk(rng: np.random.Generator, plan: Site, points: Points, pace: float, rate: float) -> np.ndarray:
    """Positions [m] of one person at `rate` samples per second from door to door, shape [n, 2]."""
    line = _line(rng, plan, points)
    _share, mean, sd = SPEEDS[int(rng.random() > SPEEDS[0][0])]
    speed = np.clip(rng.normal(mean, sd), *SPEED_LIMITS) * pace
    samples = int(len(line) * 0.1 / speed * rate * 1.4)
    gone = np.cumsum(speed / rate * np.maximum(1 + smooth_noise(rng, samples, 2 * rate, 0.08), 0.5))
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
    return position + smooth_noise(rng, position.shape, 0.8 * rate, 0.015)
