"""STeF-maps as text: weights of directions per cell, and the histograms that stefmap_ros learns from.

* `stef_csv`: one row a cell, x, y of its centre and a weight for each direction i * 2 pi / n, anticlockwise from east;
  a file is of one time, such as an hour;
* `histogram`: one line an interval, its start in unix seconds, then a number for every cell of a box and direction:
  x slowest, then y, then directions. The file does not say what box that is.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.exchange.components import Components, moved
from modlhmp.exchange.lattice import lattice_step
from modlhmp.exchange.repair import MOST
from modlhmp.exchange.rows import Rows, Source, check_names, finite, lines_of, read_rows, table_text
from modlhmp.maps import fremen
from modlhmp.maps.stef import DAY_S, evaluate, middle_of_hour
from modlhmp.site import Site
from modlhmp.storage import DataError, column
from modlhmp.tracks import clock_offsets

SHARES = 10_000  # a histogram that we write counts so many in a cell; readers hold them in 16 bits
MOST_HEADINGS = 360
HOUR_S = 3600
UNDATED = 1  # of a file of ours, days from 1 January 1970: hours of a map have no date
LATEST_S = 1e11  # of a time in unix s: the year 5138
Hours = dict[int, pa.Table]


def read_csv(source: Source, resolution_m: float | None) -> tuple[pa.Table, dict[str, int]]:
    """An hour's orientation probabilities (`maps.stef.evaluate`), and what was repaired; `DataError` names the row."""
    rows, where = read_rows(source), source.name
    orientations = rows.values.shape[1] - 2
    if not 2 <= orientations <= MOST_HEADINGS:
        raise DataError(f"{where}: {orientations + 2} columns: give x, y and a weight for each of 2 directions or more")
    names = _names(orientations)
    check_names(rows, "stef_csv", names, lambda name: name if name in names else "", where)
    weights = rows.values[:, 2:]
    _check_weights(rows, weights, where)
    cells = _cells(rows, source)
    first = np.arange(len(cells.x))
    step = lattice_step(cells, first, resolution_m)
    total = weights.sum(axis=1)
    empty = total == 0
    off = int((~empty & (np.abs(total - 1) > 1e-3)).sum())
    repaired = {"cells whose weights did not sum to 1, scaled": off} if off else {}
    # What is a probability to the file's digits stays as it is; all-zero cells stay, too, as ours do.
    scale = np.where(empty | (np.abs(total - 1) <= 1e-6), 1.0, total)
    return _table(cells.x, cells.y, weights / scale[:, None], step), repaired


def write_csv(table: pa.Table, header: bool) -> str:
    """Orientation probabilities as text; readers of others take 8 directions and no header."""
    probabilities = _probabilities(table)
    x, y = column(table, "x"), column(table, "y")
    return table_text([x, y, *probabilities.T], _names(probabilities.shape[1]) if header else ())


def _names(orientations: int) -> tuple[str, ...]:
    """The columns of such text."""
    return ("x", "y", *(f"theta_{i + 1}" for i in range(orientations)))


def constant(table: pa.Table) -> pa.Table:
    """A map of the whole day (`maps.stef.build`) that says at any time what `table` says."""
    probabilities = _probabilities(table)
    cells, orientations = probabilities.shape
    nothing = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(cells * orientations)), 1)
    period = pa.FixedSizeListArray.from_arrays(pa.array(np.full(cells * orientations, DAY_S)), 1)
    return pa.table(
        {
            "x": np.repeat(column(table, "x"), orientations),
            "y": np.repeat(column(table, "y"), orientations),
            "orientation": np.tile(np.arange(orientations), cells),
            "mean": probabilities.ravel(),
            "amplitudes": nothing,
            "phases": nothing,
            "periods": period,
        }
    ).replace_schema_metadata(table.schema.metadata)


def read_histograms(source: Source, box: Any, site: Site) -> tuple[pa.Table, Hours, dict[str, int]]:
    """The STeF-map that FreMEn makes of histograms, its hours, and what was left out.

    `box` says `x` and `y` (first and last edge, m), `resolution_m`, `orientations` and the `order` of FreMEn. -1 is
    "never seen". Each interval's numbers count by the largest of their cell, as where a map is built from tracks. The
    hours of a file without a date, as `write_histograms` makes it, stay as they are, whichever the site lists.
    """
    shape = (*(round((high - low) / box.resolution_m) for low, high in (box.x, box.y)), box.orientations)
    times, counts = _histogram_lines(source, shape, box)
    seen = np.maximum(counts, 0).reshape(len(times), -1, box.orientations)
    used = seen.any(axis=(0, 2))
    if not used.any():
        raise DataError(f"{source.name}: all numbers are 0: the map is empty")
    signals = seen[:, used] / np.maximum(seen[:, used].max(axis=2, keepdims=True), 1)
    local = times + clock_offsets(times, site.timezone)
    undated = bool((np.floor(local / DAY_S) == UNDATED).all())
    if len(times) < 2 and not undated:
        raise DataError(f"{source.name}: 1 interval, whose length nothing tells: give two or more")
    # Lines without a date are hours; hours that have no map have no line, so their distance may be more than that.
    local += (HOUR_S if undated else np.diff(times).min()) / 2
    local -= np.floor(local[0] / DAY_S) * DAY_S
    parts = fremen.analyse(local, signals.reshape(len(times), -1).T, box.order)
    i, j = np.divmod(np.flatnonzero(used), shape[1])
    x, y = ((at + 0.5) * box.resolution_m + low for at, low in ((i, box.x[0]), (j, box.y[0])))
    x, y = moved(x, y, source)
    lists = [pa.FixedSizeListArray.from_arrays(pa.array(np.ascontiguousarray(p).ravel()), box.order) for p in parts[1:]]
    whole = pa.table(
        {
            "x": np.repeat(x, box.orientations),
            "y": np.repeat(y, box.orientations),
            "orientation": np.tile(np.arange(box.orientations), len(x)),
            "mean": parts[0],
            **dict(zip(("amplitudes", "phases", "periods"), lists, strict=True)),
        }
    ).replace_schema_metadata({"resolution": str(box.resolution_m), "orientations": str(box.orientations)})
    of_hour = (local % DAY_S // HOUR_S).astype(int)
    if not undated:
        hours = site.listed_hours or sorted(set(of_hour[seen.any(axis=(1, 2))].tolist()))
        return whole, {hour: evaluate(whole, middle_of_hour(hour)) for hour in hours}, {}
    counted = {hour: seen[of_hour == hour][:, used].sum(axis=0) for hour in sorted(set(of_hour.tolist()))}
    shares = {hour: one / np.maximum(one.sum(axis=1, keepdims=True), 1) for hour, one in counted.items()}
    return whole, {hour: _table(x, y, one, box.resolution_m) for hour, one in shares.items()}, {}


def _histogram_lines(source: Source, shape: tuple[int, ...], box: Any) -> tuple[np.ndarray, np.ndarray]:
    """Starts [T] and counts [T, cells of x * cells of y * orientations] of a file's lines."""
    where, starts, counts = source.name, [], []
    wanted = int(np.prod(shape))
    for row, line in lines_of(source):
        if (found_here := line.count(",")) != wanted:
            raise DataError(
                f"{where}: row {row} has {found_here} numbers after its time: x {list(box.x)}, y {list(box.y)}, "
                f"resolution_m {box.resolution_m:g} and {box.orientations} orientations make "
                f"{' x '.join(map(str, shape))} = {wanted}; give the box that the file was made with"
            )
        start, *fields = line.split(",")
        try:
            found = np.array(fields, np.int32)
        except (ValueError, OverflowError):
            raise DataError(f"{where}: row {row}: a count is not a whole number") from None
        if found.min() < -1:
            raise DataError(f"{where}: row {row}: count {found.min()} is negative; only -1 is known, for never seen")
        starts.append(finite(start, f"{where}: row {row}, column 1"))
        if not 0 <= starts[-1] < LATEST_S:
            raise DataError(f"{where}: row {row}: it begins at {start}, which is no time in unix s")
        if len(starts) > 1 and starts[-1] <= starts[-2]:
            raise DataError(f"{where}: row {row}: it begins at {start} s, not after the row before")
        counts.append(found)
    if not starts:
        raise DataError(f"{where}: no intervals: give two or more")
    return np.array(starts), np.array(counts)


def write_histograms(hours: Mapping[int, pa.Table], site: Site) -> tuple[str, dict[str, Any]]:
    """A line for each hour of a map, its probabilities as shares of `SHARES`, and the box that a reader must be told.

    The lines begin on 2 January 1970 by the clock of the site: the hours have no date.
    """
    tables = list(hours.values())
    step = float(tables[0].schema.metadata[b"resolution"])
    orientations = int(tables[0].schema.metadata[b"orientations"])
    edges = []
    for name in ("x", "y"):
        values = np.concatenate([column(table, name) for table in tables])
        edges.append((float(values.min() - step / 2), float(values.max() + step / 2)))
    size = [round((high - low) / step) for low, high in edges]
    midnight = UNDATED * DAY_S - clock_offsets(np.full(1, DAY_S), site.timezone)[0]
    lines = []
    for hour, table in sorted(hours.items()):
        counts = np.zeros((*size, orientations), np.int64)
        i, j = (
            np.rint((column(table, name) - low) / step - 0.5).astype(int)
            for name, (low, _) in zip(("x", "y"), edges, strict=True)
        )
        counts[i, j] = np.rint(_probabilities(table) * SHARES)
        lines.append(",".join(map(str, [round(midnight + HOUR_S * hour), *counts.ravel().tolist()])))
    box = {"x": edges[0], "y": edges[1], "resolution_m": step, "orientations": orientations}
    return "\n".join([*lines, ""]), box


def _table(x: np.ndarray, y: np.ndarray, probabilities: np.ndarray, step: float) -> pa.Table:
    lists = pa.FixedSizeListArray.from_arrays(
        pa.array(np.ascontiguousarray(probabilities).ravel()), probabilities.shape[1]
    )
    metadata = {"resolution": f"{step:.9g}", "orientations": str(probabilities.shape[1])}
    return pa.table({"x": x, "y": y, "probabilities": lists}).replace_schema_metadata(metadata)


def _probabilities(table: pa.Table) -> np.ndarray:
    return column(table, "probabilities").reshape(table.num_rows, -1)


def _cells(rows: Rows, source: Source) -> Components:
    """The places of rows, for the checks that all maps have in common."""
    nothing = np.zeros(len(rows.values))
    x, y = moved(rows.values[:, 0], rows.values[:, 1], source)
    return Components(
        source.name, "row", rows.number, x, y, nothing, nothing, nothing[:, None], nothing, nothing[:, None]
    )


def _check_weights(rows: Rows, weights: np.ndarray, where: str) -> None:
    for bad, what in ((weights < 0, "negative"), (weights > MOST, f"above {MOST:g}")):
        if bad.any():
            row, at = np.argwhere(bad)[0]
            raise DataError(f"{where}: row {rows.number[row]}: weight {weights[row, at]:g} is {what}")
