"""CLiFF-maps as comma-separated text, in the three public orders of columns; one row a component.

* `matlab`, of CLiFF-map-matlab and of what CLiFF-LHMP and its like read: angle before speed, 11 columns, two of them
  p and q of the location;
* `online`, of the online update (online-mod): speed before angle, 10 columns, the last a count, or 11 with a decay;
* `nemo`, of neural maps sampled on a grid (nemo-map): with a header, a correlation in place of a covariance.

Nothing in the first two says which of them it is: speed and angle swap places, and covariances with them.
"""

import logging
import re

import numpy as np
import pyarrow as pa

from modlhmp.angles import TWO_PI
from modlhmp.exchange.components import Components, moved
from modlhmp.exchange.repair import cliff_table
from modlhmp.exchange.rows import Rows, Source, check_names, read_rows, table_text
from modlhmp.storage import DataError, column

NEMO = ("x", "y", "mean_speed", "mean_motion_angle", "var_speed", "var_motion_angle", "coef", "weight")
ORDERS = {  # columns of heading, speed and of the covariance: heading by heading, by speed, speed by heading, by speed
    "matlab": (2, 3, (4, 5, 6, 7)),
    "online": (3, 2, (7, 6, 5, 4)),
}
HEADERS = {
    "matlab": ("x", "y", "mean_heading", "mean_speed", "var_heading", "cov_heading_speed", "cov_speed_heading",
               "var_speed", "weight", "p", "q"),
    "online": ("x", "y", "mean_speed", "mean_heading", "var_speed", "cov_speed_heading", "cov_heading_speed",
               "var_heading", "weight", "count"),
}  # fmt: skip
_ANGLE_WORDS = ("angle", "heading", "theta", "direction", "orientation")
_SPEED_WORDS = ("speed", "velocity", "rho")
CLEAR = 0.05  # difference of two shares of rows that tells two columns apart ...
RARE = 0.01  # ... unless both are rarer
MANY_NEGATIVE, FEW_NEGATIVE = 0.2, 0.02
_LOG = logging.getLogger("modlhmp")


def order_named(rows: Rows) -> str:
    """`matlab`, `online` or "": which of columns 3 and 4 a header calls the angle, and which the speed."""
    said = [meaning(name.lower()) for name in rows.header[2:4]]
    return "matlab" if said == ["heading", "speed"] else "online" if said == ["speed", "heading"] else ""


def order_of(rows: Rows) -> tuple[str, str]:
    """(`matlab`, `online` or "" where it is not unmistakable, why): which of columns 3 and 4 is the angle.

    A header's names say it. Else the angle is the column that is above pi, a speed no person has, far more often; or,
    in a map of angles from -pi to pi, the one that is negative far more often.
    """
    if named := order_named(rows):
        return named, f"its header names columns 3 and 4 {' and '.join(rows.header[2:4])}"
    third, fourth = rows.values[:, 2], rows.values[:, 3]
    above = [float((part > np.pi).mean()) for part in (third, fourth)]
    below = [float((part < 0).mean()) for part in (third, fourth)]
    told = f"above pi are {above[0]:.1%} of column 3 and {above[1]:.1%} of column 4"
    for order, angle, speed in (("matlab", 0, 1), ("online", 1, 0)):
        if above[angle] - above[speed] >= CLEAR and above[angle] >= RARE:
            return order, told
        if below[angle] > MANY_NEGATIVE and below[speed] < FEW_NEGATIVE:
            return order, f"negative are {below[0]:.1%} of column 3 and {below[1]:.1%} of column 4"
    return "", told


def meaning(name: str) -> str:
    """What a column of that name in small letters is, whichever of its names it has; "" for one that is not plain."""
    words = set(re.findall("[a-z]+", name))
    angle, speed = (any(word in name for word in those) for those in (_ANGLE_WORDS, _SPEED_WORDS))
    if "std" in name:
        return ""  # the form has a variance there
    if any(word in name for word in ("var", "cov", "sigma")):
        return "covariance" if angle and speed else "var_heading" if angle else "var_speed" if speed else ""
    if angle != speed or "velocity" in name:  # a velocity has a direction
        return "heading" if angle else "speed"
    if "weight" in words or "mix" in name:
        return "weight"
    of_location = words & {"p", "q", "count", "ratio", "intensity"}
    return "of the location" if of_location else name if name in {"x", "y"} else ""


def read_order(source: Source, order: str, resolution_m: float | None) -> tuple[pa.Table, dict[str, int]]:
    """The table of a map in one of `ORDERS`, and what was repaired; `DataError` names the row."""
    rows, where = read_rows(source), source.name
    if rows.values.shape[1] not in {10, 11}:
        raise DataError(f"{where}: {rows.values.shape[1]} columns: a CLiFF-map of form {order} has 10 or 11")
    check_names(rows, order, HEADERS[order], meaning, where)
    seen, why = order_of(rows)
    if seen and seen != order:
        _LOG.warning("%s: read as `%s`, as was said, but it looks like `%s`: %s", where, order, seen, why)
    heading, speed, covariance = ORDERS[order]
    extra = rows.values[:, 9:] if order == "matlab" else rows.values[:, 9:10]  # a decay is nothing we have
    found = Components(
        where, "row", rows.number, *moved(rows.values[:, 0], rows.values[:, 1], source), rows.values[:, heading],
        rows.values[:, speed], rows.values[:, list(covariance)], rows.values[:, 8], extra,
    )  # fmt: skip
    return cliff_table(found, resolution_m)


def read_nemo(source: Source, resolution_m: float | None) -> tuple[pa.Table, dict[str, int]]:
    """The table of a map of form `nemo`, and what was repaired; `DataError` names the row."""
    rows, where = read_rows(source), source.name
    if missing := [name for name in NEMO if name not in rows.header]:
        raise DataError(f"{where}: no column {', '.join(missing)}: a map of form nemo has the header {','.join(NEMO)}")
    of = {name: rows.values[:, rows.header.index(name)] for name in NEMO}
    if (bad := ~(np.abs(of["coef"]) <= 1)).any():
        row = int(np.argmax(bad))
        raise DataError(f"{where}: row {rows.number[row]}: coef {of['coef'][row]:g} is no correlation, from -1 to 1")
    both = of["coef"] * np.sqrt(np.maximum(of["var_speed"], 0) * np.maximum(of["var_motion_angle"], 0))
    found = Components(
        where, "row", rows.number, *moved(of["x"], of["y"], source), of["mean_motion_angle"], of["mean_speed"],
        np.column_stack([of["var_motion_angle"], both, both, of["var_speed"]]), of["weight"], np.empty((len(both), 0)),
    )  # fmt: skip
    return cliff_table(found, resolution_m)


def write_order(table: pa.Table, order: str, header: bool) -> str:
    """A CLiFF-map's table as text in one of `ORDERS`; public readers take no header.

    `matlab` carries p, `online` the count, or p where counts are unknown.
    """
    x, y, heading, speed, vtt, vtr, vrr, weight, p, count = parts_of(table)
    if order == "matlab":
        columns = [x, y, heading, speed, vtt, vtr, vtr, vrr, weight, np.ones(len(x)), p]
    else:
        known = bool(len(count)) and count.min() > 0
        columns = [x, y, speed, heading, vrr, vtr, vtr, vtt, weight, count if known else p]
    return table_text(columns, HEADERS[order] if header else ())


def write_nemo(table: pa.Table) -> str:
    """A CLiFF-map's table as text of form `nemo`."""
    x, y, heading, speed, vtt, vtr, vrr, weight, *_ = parts_of(table)
    return table_text([x, y, speed, heading, vrr, vtt, vtr / np.sqrt(vtt * vrr), weight], NEMO)


def parts_of(table: pa.Table) -> tuple[np.ndarray, ...]:
    """x, y, heading in [0, 2 pi), speed, variance of heading, covariance, variance of speed, weight, p and count.

    Weights of a location sum to 1, as readers take for granted.
    """
    names = ("x", "y", "mean_speed", "var_heading", "cov_heading_speed", "var_speed", "p", "count")
    x, y, speed, vtt, vtr, vrr, p, count = (column(table, name).astype(float) for name in names)
    heading = np.array([float(f"{angle:.9g}") for angle in np.mod(column(table, "mean_heading").astype(float), TWO_PI)])
    heading[heading >= TWO_PI] = 0.0
    location, weight = column(table, "location"), column(table, "weight").astype(float)
    if len(weight):
        first = np.flatnonzero(np.diff(location, prepend=location[0] - 1))
        total = np.repeat(np.add.reduceat(weight, first), np.diff(np.append(first, len(weight))))
        weight = np.where(np.abs(total - 1) > 1e-6, weight / total, weight)  # what float32 rounds is as near as can be
    return x, y, heading, speed, vtt, vtr, vrr, weight, p, count
