"""What a map of dynamics (MoD) offers to the roll-out.

A MoD is an object with an attribute `draws`, how many random numbers a sample takes, and one method,

    sample(x, y, speed, heading, t, uniforms) -> (speed, heading, log_fitness, found)

vectorised over particles: `x`, `y` [m], `speed` [m/s], `heading` [rad] and `t` [unix s] are arrays of shape [n],
`uniforms` is [n, draws] in (0, 1). It returns the velocity sampled from the map at each position, the log of its
fitness for ranking, and whether the map has dynamics there. A map that is made of several, each for tracks of its own,
has a method `parts` instead. Nothing else of a map is known to the rest of the workflow.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa

from modlhmp.site import Site
from modlhmp.storage import DataError, column, read_parquet
from modlhmp.tracks import Tracks, clock_hours

DAY = "day.parquet"  # what a map by hours has for the whole day, in its folder
MAX_LATTICE = 1 << 22  # nodes of a map's bounding box: 2 km x 2 km at 1 m
EDGE_M = 5.0  # how far beyond a map's places a walker is still near it
Sampled = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # speed, heading, log fitness, found; [n] each


class TooWideError(DataError):
    """A map spans more nodes than `MAX_LATTICE`."""


class Mod(Protocol):
    """A map of dynamics that is sampled, as described above."""

    @property
    def draws(self) -> int:
        """Random numbers per sample."""

    def sample(
        self,
        x: np.ndarray,
        y: np.ndarray,
        speed: np.ndarray,
        heading: np.ndarray,
        t: np.ndarray,
        uniforms: np.ndarray,
    ) -> Sampled:
        """Velocities sampled at positions, their log fitness, and whether the map has dynamics there."""


def parts(mod: Any, t: np.ndarray) -> Iterable[tuple[Mod, np.ndarray]]:
    """(MoD, rows [m] of `t`) for the map, or each of the hourly maps, that serves tracks with t0 = `t` [n]."""
    return mod.parts(t) if hasattr(mod, "parts") else [(mod, np.arange(len(t)))]


class HourlyMod:
    """Several MoDs, one per clock hour: each track uses the map of its own t0.

    Tracks of hours without a map use `whole`, the map of the whole day; without that they have none.
    """

    def __init__(self, by_hour: Mapping[int, Mod], timezone: str, whole: Mod | None = None) -> None:
        self.by_hour = by_hour
        self.timezone = timezone
        self.whole = whole

    def parts(self, t: np.ndarray) -> list[tuple[Mod, np.ndarray]]:
        """See `parts`."""
        hours = clock_hours(t, self.timezone)
        rows_of = [(mod, np.flatnonzero(hours == hour)) for hour, mod in self.by_hour.items()]
        if self.whole is not None:
            rows_of.append((self.whole, np.flatnonzero(~np.isin(hours, list(self.by_hour)))))
        return [(mod, rows) for mod, rows in rows_of if len(rows)]


def hours_mapped(tracks: Tracks, site: Site) -> list[int]:
    """Clock hours that get a map: the site's, or those with rows of tracks."""
    return site.listed_hours or np.unique(clock_hours(tracks.t, site.timezone)).tolist()


def hour_files(folder: str | Path) -> dict[int, Path]:
    """{clock hour: file} of a map that lies in a folder by hours, such as 09.parquet."""
    files = {int(file.stem): file for file in sorted(Path(folder).glob("[0-2][0-9].parquet"))}
    return {hour: file for hour, file in files.items() if hour < 24}


def day_file(folder: str | Path) -> Path | None:
    """The file of the whole day of such a map; None where it has none."""
    return day if (day := Path(folder) / DAY).exists() else None


def read_map(
    source: str | Path | pa.Table,
    what: str,
    columns: Iterable[str],
    keys: Iterable[str] = (),
    step_s: float | None = None,
) -> pa.Table:
    """The table of a map, from its Parquet file or as it was built.

    `DataError` that it is not `what` without these columns and metadata keys, where a column holds anything but finite
    numbers, or where its time step is not `step_s`.
    """
    table = source if isinstance(source, pa.Table) else read_parquet(source)
    path = "a map" if isinstance(source, pa.Table) else source
    columns = list(columns)
    missing = [f"column {name}" for name in columns if name not in table.column_names]
    missing += [f"metadata {key}" for key in keys if key.encode() not in (table.schema.metadata or {})]
    if missing:
        raise DataError(f"{path}: not {what}, no {', no '.join(missing)}; delete it and make it again")
    for name in columns:
        _check_numbers(f"{path}: column {name}", table, name)
    for key in keys:
        value = table.schema.metadata[key.encode()]
        try:
            float(value)
        except ValueError:
            raise DataError(f"{path}: metadata {key} {value!r} is not a number; make it again") from None
    if step_s is not None and (built := float(table.schema.metadata[b"step"])) != step_s:
        raise DataError(f"{path}: {what} of time steps of {built:g} s cannot be used with steps of {step_s:g} s")
    return table


def _check_numbers(where, table, name):
    """`DataError` where a column, of numbers or of lists of them, holds anything else."""
    of = table.schema.field(name).type
    kind = of.value_type if pa.types.is_fixed_size_list(of) else of
    if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
        raise DataError(f"{where} is {of}, numbers are needed; make the map again")
    values = column(table, name) if not table[name].null_count else np.array([np.nan])
    if bad := values.size - np.isfinite(values).sum():
        raise DataError(f"{where}: values are missing, NaN or infinite ({bad} of {values.size}); make the map again")


def lattice_index(i: np.ndarray, j: np.ndarray, origin: Sequence[int], shape: Sequence[int] | np.ndarray) -> np.ndarray:
    """Dense lookup [shape] of lattice nodes (i, j): row of the node's entry, -1 where there is none."""
    check_lattice(len(i), shape)
    index = np.full(shape, -1, np.int64)
    index[i - origin[0], j - origin[1]] = np.arange(len(i))
    return index


def lattice_box(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First cell [2] and size [2] of the box that holds `cells` [n, 2]; of one cell where there are none."""
    if not len(cells):
        return np.zeros(2, np.int64), np.ones(2, np.int64)
    origin = cells.min(axis=0)
    size = cells.max(axis=0) - origin + 1
    check_lattice(len(cells), size)
    return origin, size


def check_lattice(number: int, shape: Sequence[int] | np.ndarray) -> None:
    """`TooWideError` if `number` locations spread over a box of so many nodes that some must be far away."""
    if np.prod(np.asarray(shape, float)) > MAX_LATTICE:
        raise TooWideError(
            f"a map of {number} locations spans {shape[0]} x {shape[1]} of them: some recorded positions are far away; "
            "look for them in the clean tracks, and at the units and `scale` of the dataset file"
        )


def box_of(tables: Iterable[pa.Table]) -> np.ndarray | None:
    """Lowest and highest x and y [2, 2] of the places of a map's tables, [m]; None of a map without such columns."""
    places = [np.column_stack([column(table, name).astype(float) for name in ("x", "y")])
              for table in tables if {"x", "y"} <= set(table.column_names) and table.num_rows]  # fmt: skip
    return np.array([np.min([p.min(0) for p in places], 0), np.max([p.max(0) for p in places], 0)]) if places else None


def check_box(where: str, box: np.ndarray | None, xy: np.ndarray) -> float:
    """The share of the positions `xy` [n, 2] of walkers that lie in the `box` [2, 2] of a map, `box_of`; None: all.

    Both in m; `DataError` that begins with `where` if none does.
    """
    if box is None or not len(xy):
        return 1.0
    share = float(((xy >= box[0] - EDGE_M) & (xy <= box[1] + EDGE_M)).all(axis=1).mean())
    if not share:
        spans = [
            " x ".join(f"{round(low, 2):.12g} to {round(high, 2):.12g}" for low, high in zip(*ends, strict=True))
            for ends in (box, (xy.min(axis=0), xy.max(axis=0)))
        ]
        raise DataError(
            f"{where}: the map is of {spans[0]} m, and all walkers are in {spans[1]} m: another frame? Move it by "
            "`origin_m` (`modlhmp map convert --origin X Y`), the origin of the walkers' frame in the map's"
        )
    return share
