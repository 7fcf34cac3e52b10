"""Floor plans in the form of ROS's map_server: a YAML file that names an image, its resolution and its origin."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from modlhmp.storage import DataError
from modlhmp.yaml_file import read_yaml

FREE, UNKNOWN, OCCUPIED = 0, 1, 2
_NEEDED = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")


class FloorPlan(NamedTuple):
    """A grid of `cells` (FREE, UNKNOWN or OCCUPIED, uint8) [rows, columns], row 0 at the bottom.

    A cell is `resolution` m wide; the lower left corner of the grid lies at `origin` = (x, y) [m], and the grid is
    turned about it by `yaw` [rad].
    """

    cells: np.ndarray
    resolution: float
    origin: tuple[float, float]
    yaw: float


def image_of(path: str | Path) -> Path:
    """Image file that a floor plan's YAML file names; `DataError` for a bad YAML file."""
    return Path(path).parent / str(_settings_of(path)["image"])


def load_floor_plan(path: str | Path) -> FloorPlan:
    """Load a `FloorPlan`; `DataError` names the file, the key and the value where something is wrong.

    A pixel of grey value v is occupied with p = (255 - v) / 255 (v / 255 with `negate`), OCCUPIED if p is above
    `occupied_thresh`, FREE if below `free_thresh`.
    """
    try:
        from PIL import Image  # noqa: PLC0415 - an extra: maps and forecasts do without it
    except ImportError:
        raise DataError(f'{path}: reading a floor plan needs Pillow: pip install "modlhmp[plans]"') from None
    settings = _settings_of(path)
    file = image_of(path)
    try:
        with Image.open(file) as image:
            grey = np.asarray(image.convert("RGB"), np.float64).mean(axis=2)
    except (OSError, Image.DecompressionBombError) as error:
        raise DataError(f"{path}: image {file} cannot be read ({error})") from None
    p = (grey if settings.get("negate") else 255.0 - grey) / 255.0
    cells = np.full(p.shape, UNKNOWN, np.uint8)
    cells[p > settings["occupied_thresh"]] = OCCUPIED
    cells[p < settings["free_thresh"]] = FREE
    x, y, yaw = map(float, settings["origin"])
    return FloorPlan(cells[::-1], float(settings["resolution"]), (x, y), yaw)


def occupied_depth(plan: FloorPlan) -> np.ndarray:
    """How far [m] each cell's centre lies inside occupied area, [rows, columns] float32; 0 elsewhere.

    What lies beyond the plan is not occupied.
    """
    from scipy.ndimage import distance_transform_edt  # noqa: PLC0415 - 16 MB that only plans need

    inside = distance_transform_edt(np.pad(plan.cells == OCCUPIED, 1))[1:-1, 1:-1]
    return (np.maximum(inside - 0.5, 0.0) * plan.resolution).astype(np.float32)


def value_at(plan: FloorPlan, grid: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Value of `grid` [rows, columns] in the cell of each position (x, y) [m], 0 beyond the plan and for NaN."""
    dx, dy = np.asarray(x, float) - plan.origin[0], np.asarray(y, float) - plan.origin[1]
    cos, sin = np.cos(plan.yaw), np.sin(plan.yaw)
    column, row = (dx * cos + dy * sin) / plan.resolution, (dy * cos - dx * sin) / plan.resolution
    rows, columns = grid.shape
    within = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)  # False for NaN
    i, j = np.where(within, row, 0).astype(np.int64), np.where(within, column, 0).astype(np.int64)
    return np.where(within, grid[i, j], grid.dtype.type(0))


def _settings_of(path):
    settings = read_yaml(path, "a floor plan")
    if missing := [key for key in _NEEDED if key not in settings]:
        raise DataError(f"{path}: the floor plan lacks {', '.join(missing)} (it is a map_server YAML file)")
    origin, occupied, free = (settings[key] for key in ("origin", "occupied_thresh", "free_thresh"))
    if not (isinstance(origin, list) and len(origin) == 3 and all(map(_is_number, origin))):
        raise DataError(f"{path}: origin {origin!r} is not [x, y, yaw] in m and rad")
    if not (_is_number(settings["resolution"]) and settings["resolution"] > 0):
        raise DataError(f"{path}: resolution {settings['resolution']!r} is not a positive number of metres per pixel")
    if not (_is_number(occupied) and _is_number(free) and 0 <= free <= occupied <= 1):
        raise DataError(f"{path}: thresholds must obey 0 <= free_thresh {free!r} <= occupied_thresh {occupied!r} <= 1")
    if settings.get("mode", "trinary") not in {"trinary", "scale"}:
        raise DataError(f"{path}: mode {settings['mode']!r} has no threshold of occupied; use trinary or scale")
    return settings


def _is_number(value):
    return type(value) in (int, float) and np.isfinite(value)
