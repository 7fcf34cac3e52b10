"""Raw days of the forum in Edinburgh's text of Properties and TRACK lines."""

from collections import Counter
from datetime import date
from typing import BinaryIO

import numpy as np

from modlhmp.study.demo.people import defect_plan, visits, walk
from modlhmp.study.demo.sites import LIFT_LOOP, METRES_PER_PIXEL, Site

FORUM_RATE = 9.0  # frames per second; frame 0 is 08:00
# Steps between the frames of a track, and how often: the camera misses some.
_FRAME_STEPS = np.array([1, 2, 3, 4, 5, 6, 8, 10, 11])
_FRAME_ODDS = np.array([0.972, 0.013, 0.005, 0.003, 0.002, 0.002, 0.001, 0.001, 0.001])


def _forum_track(rng, plan, route, pace, *, start_s, defect):
    """One track as integer rows x [px], y [px], frame [n, 3]; and how many rows or tracks `defect` makes."""
    if defect == "short_track":
        route = plan.routes[0]
    path = walk(rng, plan, LIFT_LOOP if defect == "lift_track" else route.points, pace, FORUM_RATE)
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


def write_forum(file: BinaryIO, rng: np.random.Generator, plan: Site, _day: date, scale: float) -> dict[str, int]:
    """Write a day of the forum, track by track in order of appearance; return what was planted."""
    starts, hours, routes = visits(rng, plan, scale)
    defects = defect_plan(rng, plan, len(starts), scale)
    planted = Counter({**dict.fromkeys(plan.defects, 0), "tracks": len(starts)})
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
