"""Columns of speed and heading: those that follow displacements, with their units."""

from typing import NamedTuple

import numpy as np

from modlhmp.file_format import FileFormat, Units
from modlhmp.inspection.roles import Columns, Values
from modlhmp.inspection.sheet import Sheet
from modlhmp.motion import Moves, moves, recorded_agreement
from modlhmp.readers.delimited import SECONDS, SPEED_MPS
from modlhmp.tracks import Tracks, usual_step

UNFIT = (0.25, 0.8)  # times between rows [s] of which the last one in every second is now early, now late
AGREES, FOLLOWS = 0.85, 0.4  # mean cosine of headings and displacements, correlation of speeds with theirs


class Velocities(NamedTuple):
    """Columns of speed and heading for `columns` and `units`, both empty where there are none, or why not."""

    columns: dict[str, int | str]
    units: dict[str, str]
    left_out: str = ""


def velocity_columns(
    form: FileFormat, sheet: Sheet, values: Values, columns: Columns, order: np.ndarray, rows: Tracks
) -> Velocities:
    """The columns of speed and heading; `rows` are the table's in the file's own units, `order` where they stand."""
    seconds = 1.0 / form.frame_rate if form.units.time == "frame" else SECONDS.get(form.units.time, 1.0)  # type: ignore[operator]
    rows = rows._replace(t=rows.t * seconds, x=rows.x * form.metres, y=rows.y * form.metres)
    step = usual_step(rows)
    around = moves(rows, max(2, 2 * round(0.5 / step)) if step > 0 else 2)
    taken = {columns.track_id, columns.t, columns.x, columns.y, *values.iso}
    of_column = {c: values.numbers[order, c] for c in set(range(values.numbers.shape[1])) - taken}
    if len(around.row) < 10:
        return Velocities({}, {})
    speed = _speed_column(of_column, around, columns.named.get("speed"))
    heading = _heading_column({c: part for c, part in of_column.items() if speed and c != speed[0]}, rows, around,
                              columns.named.get("heading"))  # fmt: skip
    if speed is None or heading is None:
        return Velocities({}, {})
    called = {"speed": sheet.called(speed[0]), "heading": sheet.called(heading[0])}
    if UNFIT[0] < step < UNFIT[1]:
        told = (
            f"columns {called['speed']!r} and {called['heading']!r} are speed and heading; they are left out, since "
            f"rows {step:.2g} s apart do not fit into steps of 1 s, where positions can be interpolated"
        )
        return Velocities({}, {}, told)
    units = {"speed": speed[1]} if SPEED_MPS[speed[1]] != form.metres else {}
    return Velocities(called, units | heading[1])


def _speed_column(of_column: dict[int, np.ndarray], around: Moves, named: int | None) -> tuple[int, str] | None:
    """The column of speeds and its unit: the one nearest to displacements that rises and falls with them."""
    found: list[tuple[float, int, str]] = []
    for column, part in of_column.items():
        here = part[around.row]
        known = np.isfinite(here)
        if (named is not None and column != named) or known.mean() < 0.8 or (here[known] < 0).any():
            continue
        if column != named and (
            np.std(here[known]) == 0 or np.corrcoef(here[known], around.speed[known])[0, 1] < FOLLOWS
        ):
            continue
        for unit, factor in SPEED_MPS.items():
            ratios = here[known] * factor / around.speed[known]
            off = float(np.median(np.abs(ratios - 1)))
            if 0.75 < np.median(ratios) < 1.33 and off < 0.25:
                found.append((off, column, unit))
    return min(found)[1:] if found else None


def _heading_column(
    of_column: dict[int, np.ndarray], rows: Tracks, around: Moves, named: int | None
) -> tuple[int, dict[str, str]] | None:
    """The column of headings, its unit and convention where they are not the defaults."""
    best: tuple[float, int, dict[str, str]] | None = None
    for column, part in of_column.items():
        if named is not None and column != named:
            continue
        known = part[np.isfinite(part)]
        if not len(known):
            continue
        angle = "deg" if np.abs(known).max() > 6.4 else "rad"
        headings = np.deg2rad(part) if angle == "deg" else part
        for convention in ("from_x", "from_x_clockwise", "compass"):
            meant = {"from_x": headings, "from_x_clockwise": -headings, "compass": np.pi / 2 - headings}[convention]
            units = Units(angle=angle, heading=convention)  # type: ignore[arg-type]
            cosine, _, _ = recorded_agreement(rows._replace(heading=meant), around, units)
            told = {"angle": angle} if angle == "deg" else {}
            told |= {"heading": convention} if convention != "from_x" else {}
            if cosine >= AGREES and (best is None or cosine > best[0] + 1e-6):
                best = (cosine, column, told)
    return best[1:] if best else None
