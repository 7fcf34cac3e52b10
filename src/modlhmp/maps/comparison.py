"""Which way people walk and how fast, as two maps say it: a common form of maps of cells, and how far two differ."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.angles import TWO_PI
from modlhmp.kinds import all_kinds, find
from modlhmp.storage import DataError, column

DIRECTIONS = 8  # of 45 degrees, the first centred on east
WINDINGS = 4  # turns on each side; a wider normal distribution is even all around


class Flows(NamedTuple):
    """Places of a map: positions `x`, `y` [n] in m, shares [n, 8] of directions, `speed` [n] in m/s (NaN: unknown).

    `p` [n] is the motion intensity, 1 for a map without one; `step` is the distance of neighbouring places [m].
    """

    x: np.ndarray
    y: np.ndarray
    shares: np.ndarray
    speed: np.ndarray
    p: np.ndarray
    step: float


def check_flows(what: str, kind: str) -> None:
    """`DataError` about `what` was asked of a kind of map that does not say of places which ways people go there."""
    if not find(kind).has_flows:
        known = ", ".join(one.name for one in all_kinds().values() if one.has_flows)
        raise DataError(f"{what}: a map of kind {kind} holds no flows of places; kinds that do: {known}")


def flows(kind: str, table: pa.Table) -> Flows:
    """The places of a map of one time: a CLiFF-map, or orientation probabilities of a STeF-map (`stef.evaluate`).

    `DataError` for a kind of map that does not say so of places.
    """
    check_flows("compare", kind)
    step = float(table.schema.metadata[b"resolution"])
    if find(kind).tables == "stef":
        found = column(table, "probabilities").reshape(table.num_rows, -1)
        alive = found.any(axis=1)
        centres = np.arange(found.shape[1]) * TWO_PI / found.shape[1]
        bins = np.floor(np.mod(centres + np.pi / DIRECTIONS, TWO_PI) * DIRECTIONS / TWO_PI).astype(int)
        shares = np.zeros((table.num_rows, DIRECTIONS))
        np.add.at(shares.T, bins, found.T)
        x, y = (column(table, name)[alive] for name in ("x", "y"))
        return Flows(x, y, shares[alive], np.full(len(x), np.nan), np.ones(len(x)), step)
    names = ("location", "x", "y", "weight", "mean_heading", "mean_speed", "var_heading", "p")
    location, x, y, weight, heading, speed, variance, p = (column(table, name).astype(float) for name in names)
    first = np.flatnonzero(np.diff(location, prepend=-1))
    if not len(first):
        return Flows(x, y, np.empty((0, DIRECTIONS)), speed, p, step)
    of_component = direction_shares(heading, variance, DIRECTIONS)
    total = np.add.reduceat(weight, first)
    shares = np.add.reduceat(weight[:, None] * of_component, first) / total[:, None]
    return Flows(x[first], y[first], shares, np.add.reduceat(weight * speed, first) / total, p[first], step)


def direction_shares(heading: np.ndarray, variance: np.ndarray, directions: int) -> np.ndarray:
    """Shares [n, directions] of directions, the first centred on east, of wrapped normal distributions [n] in rad."""
    from scipy.special import ndtr  # noqa: PLC0415 - only this needs it

    edges = (np.arange(directions + 1) - 0.5) * TWO_PI / directions
    turned = edges + TWO_PI * np.arange(-WINDINGS, WINDINGS + 1)[:, None]
    below = ndtr((turned - heading[:, None, None]) / np.sqrt(variance)[:, None, None])
    shares = np.diff(below, axis=2).sum(axis=1)
    return shares / shares.sum(axis=1, keepdims=True)


def compare(ours: Flows, theirs: Flows) -> Mapping[str, np.ndarray]:
    """Places of one map that the other has, too, as columns [n].

    `x`, `y` [m] of ours; `apart_m` to theirs, the nearest within half of the larger step; `direction`, how much of the
    probability goes elsewhere (half of the sum of absolute differences of the shares, from 0 to 1); `speed_m_s`,
    theirs less ours; `p` and `p_theirs`.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415 - likewise

    if not (len(ours.x) and len(theirs.x)):
        raise DataError("a map is empty, so there is nothing to compare")
    places = np.column_stack([theirs.x, theirs.y])
    reach = max(ours.step, theirs.step) * np.sqrt(0.5) * (1 + 1e-9)
    apart, at = cKDTree(places).query(np.column_stack([ours.x, ours.y]), distance_upper_bound=reach)
    both = np.flatnonzero(np.isfinite(apart))
    at = at[both]
    return {
        "x": ours.x[both],
        "y": ours.y[both],
        "apart_m": apart[both],
        "direction": np.abs(ours.shares[both] - theirs.shares[at]).sum(axis=1) / 2,
        "speed_m_s": theirs.speed[at] - ours.speed[both],
        "p": ours.p[both],
        "p_theirs": theirs.p[at],
    }
