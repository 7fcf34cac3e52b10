"""Raw days of the hall in the ATC format of 8 columns, and its floor plan."""

import io
from collections import Counter
from datetime import date, datetime, time
from pathlib import Path
from typing import BinaryIO
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
from PIL import Image
from pyarrow import csv

from modlhmp.storage import atomic_path, write_text
from modlhmp.study.demo.people import defect_plan, smooth_noise, visits, walk
from modlhmp.study.demo.sites import SITES, Site

HALL_RATE = 24.0
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
_ROWS_PER_PERSON = 3  # rows with a defect, for each person who gets one
_BATCH = 32  # people made at a time


def _hall_rows(rng, position, *, person, start_ms, jitter):
    """A walk as integer rows [n, 10]; all people share the tracker's uneven clock (`jitter` [ms], cyclic)."""
    ticks = int(start_ms * HALL_RATE / 1000) + 1 + np.arange(len(position))
    velocity = np.gradient(position, 1 / HALL_RATE, axis=0)
    velocity += smooth_noise(rng, position.shape, 6, 0.03)
    seen = position + rng.normal(0, 0.008, position.shape)
    heading = np.arctan2(velocity[:, 1], velocity[:, 0])
    facing = heading + smooth_noise(rng, len(heading), HALL_RATE, 0.2)
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
    chosen = rng.choice(np.arange(24, len(rows) - 24, 48), _ROWS_PER_PERSON, replace=False)
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


def write_hall(file: BinaryIO, rng: np.random.Generator, plan: Site, day: date, scale: float) -> dict[str, int]:
    """Write a day of the hall in time order, a batch of people at a time; return what was planted."""
    starts, hours, routes = visits(rng, plan, scale)
    defects = defect_plan(rng, plan, len(starts), scale)
    midnight_ms = round(datetime.combine(day, time(), ZoneInfo(plan.timezone)).timestamp() * 1000)
    jitter = rng.integers(-6, 7, 997)
    planted = Counter({**dict.fromkeys(plan.defects, 0), "tracks": len(starts) + 2})
    pending = _other_days(rng, plan, len(starts), jitter)
    planted["outside_day"] = sum(map(len, pending))
    for index, start in enumerate(starts):
        steps = walk(rng, plan, plan.routes[routes[index]].points, plan.pace[hours[index]], HALL_RATE)
        rows = _hall_rows(rng, steps, person=_person(index), start_ms=start * 1000, jitter=jitter)
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
        steps = walk(rng, plan, plan.routes[0].points, 1.0, HALL_RATE)[:count]
        blocks.append(_hall_rows(rng, steps, person=_person(person), start_ms=start_ms, jitter=jitter))
    return blocks


PLAN_RESOLUTION = 0.1  # m per pixel
CORRIDOR_HALF_WIDTH = 3.0  # m from a route's line to the wall; people keep within `Site.half_width` of it


def write_floor_plan(path: str | Path) -> None:
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
