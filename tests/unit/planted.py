"""Made-up people on a square, written as any recorder might have, for tests that plant wrong declarations."""

import numpy as np

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "px": 0.025}
SPEEDS = {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001, "km/h": 1 / 3.6}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def people(number=12, rows=20, step_s=1.0, seed=3, standing=2):
    """Rows [n, 6] of person, t [s], x [m], y [m], speed [m/s], heading [rad]: straight walks in every direction.

    The last `standing` people stand, and only jitter.
    """
    rng = np.random.default_rng(seed)
    found = []
    for person in range(number):
        heading = rng.uniform(-np.pi, np.pi)
        speed = 0.02 if person >= number - standing else rng.normal(1.3, 0.2)
        t = 3.0 * person + step_s * np.arange(rows)
        x = 20 + rng.uniform(-8, 8) + speed * np.cos(heading) * (t - t[0]) + rng.normal(0, 0.01, rows)
        y = 15 + rng.uniform(-8, 8) + speed * np.sin(heading) * (t - t[0]) + rng.normal(0, 0.01, rows)
        headings = (heading + rng.normal(0, 0.1, rows) + np.pi) % (2 * np.pi) - np.pi
        found.append(np.column_stack([np.full(rows, person), t, x, y, np.full(rows, speed), headings]))
    return np.concatenate(found)


def write(path, table=None, time="s", length="m", speed="m/s", angle="rad", heading="from_x", rate=None, moving=True):
    """Write people as a CSV file with these units; `rate` [1/s] makes the times frame numbers."""
    person, t, x, y, v, h = (people() if table is None else table).T
    h = {"from_x": h, "from_x_clockwise": -h, "compass": np.pi / 2 - h, "backwards": h + np.pi}[heading]
    h = np.degrees(h) if angle == "deg" else h
    t = np.round(t * rate) if rate else t / SECONDS[time]
    columns = [person, t, x / LENGTHS[length], y / LENGTHS[length], v / SPEEDS[speed], h]
    names, forms = ["id", "t", "x", "y", "v", "th"], ["%d", "%.6f", "%.6f", "%.6f", "%.6f", "%.6f"]
    if rate or time != "s":
        forms[1] = "%d"
    count = 6 if moving else 4
    np.savetxt(path, np.column_stack(columns[:count]), forms[:count], ",", header=",".join(names[:count]), comments="")
    return path


PLACES = {"track_id": "id", "t": "t", "x": "x", "y": "y"}
MOVING = {**PLACES, "speed": "v", "heading": "th"}


def days_of_the_archive(root):
    """An empty file for each glob of config/datasets/atc_archive.yaml, which alone of all datasets needs some."""
    (root / "atc").mkdir(exist_ok=True)
    for day in (20121025, 20121030, 20121103, 20130101):
        (root / f"atc/atc-{day}.csv").touch()
