"""Components of a foreign CLiFF-map as our table: defects are repaired and counted, or refused by row.

Public files have defects of their own: covariances that rounding has made indefinite, weights that do not sum to 1,
components of weight 0, headings beyond one turn, locations that a builder has appended twice.
"""

from collections import Counter

import numpy as np
import pyarrow as pa

from modlhmp.angles import TWO_PI, wrap_angle
from modlhmp.exchange.components import Components
from modlhmp.exchange.lattice import lattice_step, locations_of
from modlhmp.maps import swgmm
from modlhmp.maps.cliff import COLUMNS, TYPES
from modlhmp.storage import DataError

MOST_TURNS = 4  # of a heading; what is beyond is in degrees
FASTEST_M_S = 20.0  # of a mean speed; beyond is another unit
USUAL_M_S = 5.0  # of half of the mean speeds
WIDEST = 1e4  # of a variance of headings [rad2] or speeds [m2/s2]; public maps have up to 22
MOST = 1e9  # of a weight, or of observations
UNEQUAL = 1e-3  # how far weights of a location may be from 1 in sum, by rounding
DIGITS = 1e-3  # of an angle that a file rounds
ROUNDING = 1e-6  # of what is stored as float32, relative


def cliff_table(
    found: Components, resolution_m: float | None = None, radius_m: float | None = None
) -> tuple[pa.Table, dict[str, int]]:
    """The table of a CLiFF-map (`maps.cliff.build`) from foreign components, and {defect: how many were repaired}.

    `resolution_m` is the distance of neighbouring locations, by default the usual one; `radius_m` that within which
    observations were taken. `DataError` names the file, the row, the value and the remedy.
    """
    repaired: Counter[str] = Counter()
    _check(found)
    found = _without_zeros(found, repaired)
    kept, location, first = locations_of(found, repaired)
    found = found.take(kept)
    step = lattice_step(found, first, resolution_m)
    columns = dict.fromkeys(COLUMNS, np.zeros(len(found.x)))
    columns |= {"location": location, "x": found.x, "y": found.y}
    columns["weight"] = _weights(found, location, first, repaired)
    columns["mean_heading"], columns["mean_speed"] = _means(found, repaired)
    components = np.column_stack([*(columns[name] for name in COLUMNS[3:6]), _symmetric(found, repaired)])
    _floor(components, repaired)
    columns |= dict(zip(COLUMNS[6:9], components[:, 3:].T, strict=True))
    columns["count"], columns["p"] = intensity(found, location, first, repaired)
    columns["q"] = np.ones(len(found.x))
    metadata = {"resolution": f"{step:.9g}", "radius": f"{radius_m or step:.9g}"}
    table = pa.table({name: values.astype(TYPES.get(name, float)) for name, values in columns.items()})
    return table.replace_schema_metadata(metadata), {what: number for what, number in repaired.items() if number}


def _check(found: Components) -> None:
    """Refuse what no repair can make right."""
    found.refuse(found.weight < 0, "weight {weight} is negative; are the numbers in another order?")
    found.refuse(found.weight > MOST, f"weight {{weight}} is above {MOST:g}; are the numbers in another order?")
    degrees = (
        "heading {heading} rad is more than 4 turns: in degrees? Speeds in mm/s or cm/s, so that they were taken for "
        "headings? Or are speed and heading in the other order?"
    )
    found.refuse(np.abs(found.heading) > MOST_TURNS * TWO_PI, degrees)
    unit = "mean speed {speed} m/s: in another unit, such as mm/s, or another number?"
    found.refuse(np.abs(found.speed) > FASTEST_M_S, unit)
    wide = np.asarray((np.abs(found.covariance) > WIDEST).any(axis=1))
    found.refuse(wide, "a covariance is larger than headings and speeds have; are the numbers in another order?")
    usual = float(np.median(np.abs(found.speed)))
    if usual > USUAL_M_S:
        raise DataError(f"{found.where}: half of the mean speeds are above {usual:.3g} m/s: in another unit than m/s?")
    if len(found.covariance) > 1 and not found.covariance.any():
        raise DataError(
            f"{found.where}: all covariances are 0: directions only, such as a STeF-map in the form of a CLiFF-map; "
            "it has no density to sample from"
        )


def _without_zeros(found: Components, repaired: Counter[str]) -> Components:
    empty = found.weight == 0
    repaired["components of weight 0, left out"] += int(empty.sum())
    if empty.all():
        raise DataError(f"{found.where}: all weights are 0: the map is empty")
    return found.take(~empty)


def _weights(found: Components, location: np.ndarray, first: np.ndarray, repaired: Counter[str]) -> np.ndarray:
    total = np.add.reduceat(found.weight, first)
    off = np.abs(total - 1)
    repaired["locations whose weights did not sum to 1, scaled"] += int((off > UNEQUAL).sum())
    return found.weight / np.where(off > ROUNDING / 2, total, 1.0)[location]


def _means(found: Components, repaired: Counter[str]) -> tuple[np.ndarray, np.ndarray]:
    """Headings in (-pi, pi] and speeds; a negative mean speed stays: it is sampled as the mixture says, then as 0."""
    beyond = (found.heading < -np.pi - DIGITS) | (found.heading > TWO_PI + DIGITS)
    repaired["headings beyond one turn, wrapped"] += int(beyond.sum())
    repaired["negative mean speeds, kept: their samples below 0 count as 0"] += int((found.speed < 0).sum())
    return wrap_angle(found.heading), found.speed


def _symmetric(found: Components, repaired: Counter[str]) -> np.ndarray:
    """Variance of heading, covariance, variance of speed [n, 3]."""
    a, b, c, d = found.covariance.T
    repaired["covariances that were not symmetric, averaged"] += int((~np.isclose(b, c, rtol=1e-4, atol=1e-9)).sum())
    return np.column_stack([a, (b + c) / 2, d])


def _floor(components: np.ndarray, repaired: Counter[str]) -> None:
    """Raise eigenvalues of covariances to the floor that maps of ours have, in place; those at it are left alone."""
    vtt, vtr, vrr = components[:, 3:].T
    indefinite = (vtt * vrr - vtr**2 <= 0) | (vtt <= 0) | (vrr <= 0)
    low = (vtt + vrr) / 2 - np.hypot((vtt - vrr) / 2, vtr)
    under = low < swgmm.MIN_EIGENVALUE - ROUNDING * np.abs(vtt + vrr)
    floored = components[under]
    swgmm.floor_covariances(floored)
    components[under] = floored
    repaired["covariances that were not positive definite, raised"] += int(indefinite.sum())
    narrow = f"narrow covariances, raised to eigenvalues of {swgmm.MIN_EIGENVALUE:g}"
    repaired[narrow] += int((under & ~indefinite).sum())


def intensity(
    found: Components, location: np.ndarray, first: np.ndarray, repaired: Counter[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Count and motion intensity p of each component's location, from whichever of the extra numbers says it.

    Sources call them p, q, ratio or count, and contradict each other; one of them is usually 1 everywhere. It is the
    last that varies; above 1 they are counts, and p their ratio to the largest. Without any p is 1. A count is 0 where
    it is unknown.
    """
    odd = np.asarray(((found.extra < 0) | (found.extra > MOST)).any(axis=1))
    found.refuse(odd, f"a p, q or count that is negative or above {MOST:g}; are the numbers in another order?")
    varying = [column for column in found.extra.T if np.ptp(column) > 0]
    if len(varying) > 1:
        repaired["components with two numbers of the location that vary, of which the last is p"] += len(found.x)
    chosen = varying[-1] if varying else found.extra[:, -1] if found.extra.shape[1] else np.ones(len(found.x))
    of_location = np.maximum.reduceat(chosen, first)
    differ = np.minimum.reduceat(chosen, first) < of_location
    repaired["locations whose rows differ in p, of which the largest counts"] += int(differ.sum())
    largest = of_location.max()
    counted = largest > 1 and bool((of_location == np.rint(of_location)).all())
    p = of_location / largest if largest > 1 else of_location if largest > 0 else np.ones(len(first))
    count = of_location if counted else np.zeros(len(first))
    return count[location], p[location]
