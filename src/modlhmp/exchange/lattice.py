"""Where the locations of a foreign map lie: which rows belong to one, how far apart they are."""

from collections import Counter

import numpy as np

from modlhmp.exchange.components import Components
from modlhmp.maps.base import MAX_LATTICE
from modlhmp.storage import DataError

OFF_LATTICE = 0.1  # of a step: files round positions to 5 digits
FAR_M = 10_000.0  # from the origin; recordings lose rows there as well
SAMPLED = 20_000
SHIFT = (
    "give `origin_m` (`modlhmp map convert --origin X Y`), the x and y of a nearer origin in the file's frame, as the "
    "dataset file of the recordings does"
)


def locations_of(found: Components, repaired: Counter[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which components are kept (mask), the location of each of these, counted from 0, and the first row of each.

    A location whose rows stand in two places was appended by its builder: a repetition is left out, any other is
    refused.
    """
    new = np.ones(len(found.x), bool)
    new[1:] = (np.diff(found.x) != 0) | (np.diff(found.y) != 0)
    first = np.flatnonzero(new)
    ends = np.append(first[1:], len(found.x))
    seen: dict[tuple[float, float], int] = {}
    kept = np.ones(len(found.x), bool)
    for block, (start, end) in enumerate(zip(first, ends, strict=True)):
        before = seen.setdefault((found.x[start], found.y[start]), block)
        if before == block:
            continue
        if not _same(found, slice(first[before], ends[before]), slice(start, end)):
            raise DataError(
                f"{found.where}: {found.unit} {found.row[start]}: location ({found.x[start]:.10g}, "
                f"{found.y[start]:.10g}) "
                f"is described in {found.unit} {found.row[first[before]]} already, otherwise: two maps in one file? "
                "Builders append to a file that is there; keep one of the two, or sort the rows by location"
            )
        kept[start:end] = False
        repaired["locations that the file repeats, left out"] += 1
    location = np.cumsum(new[kept]) - 1
    return kept, location, np.flatnonzero(new[kept])


def _same(found: Components, one: slice, other: slice) -> bool:
    names = ("heading", "speed", "covariance", "weight", "extra")
    return all(np.array_equal(getattr(found, name)[one], getattr(found, name)[other]) for name in names)


def lattice_step(found: Components, first: np.ndarray, resolution_m: float | None) -> float:
    """Distance of neighbouring locations [m]: `resolution_m`, or the usual one along an axis (1 m of one location).

    `DataError` names the row of a location that is far away, or not on the lattice of the others.
    """
    x, y = found.x[first], found.y[first]
    far = (np.abs(found.x) > FAR_M) | (np.abs(found.y) > FAR_M)
    found.refuse(far, f"location ({{x}}, {{y}}) is more than 10 km from the origin; {SHIFT}")
    step = resolution_m or _usual_step(x, y)
    size = (np.ptp(x) / step + 1) * (np.ptp(y) / step + 1)
    if size > MAX_LATTICE:
        away = np.hypot(found.x - np.median(x), found.y - np.median(y))
        found.refuse(
            np.asarray(away == away.max()),
            f"location ({{x}}, {{y}}) is far from the others: with {step:g} m between neighbours the map has "
            f"{size:.2g} places; correct it, or give resolution_m",
        )
    off = np.zeros(len(found.x), bool)
    for values, of_location in ((found.x, x), (found.y, y)):
        apart = (values - _usual_offset(of_location, step)) / step
        off |= np.abs(apart - np.rint(apart)) > OFF_LATTICE
    remedy = "correct or remove it (left in another frame?)" if off.mean() < 0.1 else "give the right resolution_m"
    found.refuse(off, f"location ({{x}}, {{y}}) is not on the others' lattice of {step:g} m: {remedy}")
    nodes = np.column_stack([np.rint((part - part.min()) / step) for part in (x, y)])
    _, where = np.unique(nodes, axis=0, return_index=True)
    if len(where) < len(nodes):
        twice = np.setdiff1d(np.arange(len(nodes)), where)[0]
        bad = np.arange(len(found.x)) == first[twice]
        found.refuse(bad, f"location ({{x}}, {{y}}) falls on another with {step:g} m between them: give resolution_m")
    return step


def _usual_step(x: np.ndarray, y: np.ndarray) -> float:
    """The commonest distance between neighbouring values along the axes, to a tenth of a millimetre."""
    apart = np.concatenate([np.diff(np.unique(np.round(part, 4))) for part in (x, y)])
    if not len(apart):
        return 1.0
    steps, counts = np.unique(np.round(apart, 3), return_counts=True)
    usual = steps[np.argmax(counts)]
    return float(f"{np.mean(apart[np.abs(apart - usual) < 1e-3]):.4g}")


def _usual_offset(values: np.ndarray, step: float) -> float:
    """A value that is on the lattice of most."""
    part = np.mod(values, step) / step
    some = part[:: len(part) // SAMPLED + 1]  # of a large map: each is compared with 200
    near = np.abs((some[:, None] - part[None, :200] + 0.5) % 1 - 0.5) < OFF_LATTICE / 2
    return float(values[np.argmax(near.sum(axis=0))])
