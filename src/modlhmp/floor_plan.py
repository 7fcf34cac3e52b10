"""Floor plans in the form of ROS's map_server: a YAML file that names an image, its resolution and its origin."""

import importlib.util
import logging
import math
import reprlib
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from modlhmp.storage import DataError, boundary
from modlhmp.yaml_file import read_yaml

FREE, UNKNOWN, OCCUPIED = 0, 1, 2
MOST_PIXELS = 80_000_000  # of an image, such as 400 m x 500 m at 0.05 m; a few bytes of a file can stand for more
_BAND_PIXELS = 1 << 20
_NEEDED = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")
_FLAGS = {"0": False, "1": True, "false": False, "true": True}
_MODES = {"trinary", "scale", "raw"}
_FORMATS = ("PNG", "PPM", "BMP", "TIFF", "GIF", "JPEG")  # not all of Pillow's: for some it starts other programs
_PHOTOMETRIC = 262  # the tag of a TIFF that says what 0 stands for
_SAVED_UNKNOWN = 205  # the grey of 255 that map_saver writes for unknown cells
_LOG = logging.getLogger("modlhmp")


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
    return Path(path).parent / _settings_of(path).image


def load_floor_plan(path: str | Path) -> FloorPlan:
    """Load a `FloorPlan`; `DataError` names the file, the key and the value where something is wrong.

    The rules are map_server's (ROS 2). A pixel's shade s is the mean of its colours, from 0, black, to 1, white; it is
    occupied with p = 1 - s, or s with `negate`.

    * `trinary`: OCCUPIED if p is above `occupied_thresh`, FREE if below `free_thresh`. Alpha, where there is any,
      counts as a fourth colour (opaque: 1).
    * `scale`: the same, but alpha is no colour, and whatever is not opaque is UNKNOWN. Between the thresholds
      map_server's grid has values from 1 to 99, which are UNKNOWN here.
    * `raw`: 255 s is the value of map_server's grid itself: OCCUPIED if 100, FREE if 0, else UNKNOWN. Thresholds,
      `negate` and alpha play no part.
    """
    if importlib.util.find_spec("PIL") is None:  # an extra: maps and forecasts do without it
        raise DataError(f'{path}: reading a floor plan needs Pillow: pip install "modlhmp[plans]"')
    with boundary(path, "cannot be read as a floor plan"):
        settings = _settings_of(path)
        parts, grey_is_free, graded = [], False, False
        for pixels in _bands(path, Path(path).parent / settings.image):
            parts.append(part := _cells_of(pixels, settings))
            if settings.mode == "raw":
                graded |= bool((np.abs(_raw(pixels) - 50) < 50).any())
            grey_is_free |= bool((part[255 * pixels.colour == _SAVED_UNKNOWN * pixels.white] == FREE).any())
        cells = np.concatenate(parts)
    if not (cells == OCCUPIED).any() and not graded:  # probabilities, of which none need be 1
        _LOG.warning("%s: no cell is occupied; check `mode`, `negate` and the thresholds", path)
    if grey_is_free and settings.mode == "trinary" and not settings.negate:
        remedy = "write free_thresh: 0.196" + (" and save the image without alpha" if pixels.alpha is not None else "")
        _LOG.warning(
            "%s: pixels of grey 205, map_saver's unknown, are free; if they should be unknown, %s", path, remedy
        )
    return FloorPlan(cells[::-1], settings.resolution, settings.origin, settings.yaw)


def coarser(plan: FloorPlan, pixels: int) -> tuple[np.ndarray, int]:
    """The cells [rows, columns] in blocks of so many by so many, the shorter side of at least `pixels` if it has them.

    A wall within a block makes it one; what is left of the last rows and columns is cut off.
    """
    width = max(min(plan.cells.shape) // pixels, 1)
    rows, columns = (size // width for size in plan.cells.shape)
    blocks = plan.cells[: rows * width, : columns * width].reshape(rows, width, columns, width)
    return blocks.max(axis=(1, 3)), width


def moved(plan: FloorPlan, origin_m: tuple[int, int] | None) -> FloorPlan:
    """The plan in a frame whose origin is at x, y [m] of its own, as recordings with `origin_m` are."""
    return plan._replace(origin=(plan.origin[0] - origin_m[0], plan.origin[1] - origin_m[1])) if origin_m else plan


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


class _Settings(NamedTuple):
    """What a YAML file says."""

    image: str
    resolution: float
    origin: tuple[float, float]
    yaw: float
    negate: bool
    occupied: float
    free: float
    mode: str


class _Pixels(NamedTuple):
    """A part of an image: `colour` [rows, columns] from 0, black, to `white`, row 0 at the top.

    `alpha` is None, or [rows, columns] from 0 to `white`, opaque.
    """

    colour: np.ndarray
    alpha: np.ndarray | None
    white: float


def _settings_of(path):
    listed = read_yaml(path, "a floor plan")
    if missing := [key for key in _NEEDED if key not in listed]:
        raise DataError(f"{path}: the floor plan lacks {', '.join(missing)} (it is a map_server YAML file)")
    image, negate, mode = listed["image"], listed.get("negate", 0), listed.get("mode", "trinary")
    if not (isinstance(image, str) and image and image.isprintable()):
        raise DataError(f"{path}: image {reprlib.repr(image)} is not the name of a file; quote a number")
    given = listed["origin"]
    origin = [_number(one) for one in given] if isinstance(given, list) else []
    if len(origin) != 3 or None in origin:
        raise DataError(f"{path}: origin {reprlib.repr(given)} is not [x, y, yaw] in m and rad")
    if abs(origin[2]) > math.tau:
        raise DataError(
            f"{path}: origin {reprlib.repr(given)}: a yaw of {origin[2]:g} rad is more than a whole turn; write "
            f"{math.radians(origin[2]):.5g} if it is in degrees"
        )
    resolution, occupied, free = (_number(listed[key]) for key in ("resolution", "occupied_thresh", "free_thresh"))
    if resolution is None or resolution <= 0:
        raise DataError(
            f"{path}: resolution {reprlib.repr(listed['resolution'])} is not a positive number of metres per pixel"
        )
    if occupied is None or free is None or not 0 <= free <= occupied <= 1:
        raise DataError(
            f"{path}: thresholds must obey 0 <= free_thresh {reprlib.repr(listed['free_thresh'])} <= occupied_thresh "
            f"{reprlib.repr(listed['occupied_thresh'])} <= 1"
        )
    if (negated := _FLAGS.get(str(negate).lower())) is None:
        raise DataError(
            f"{path}: negate {reprlib.repr(negate)} is not 0, 1, true or false; with 0 black is occupied, with 1 white"
        )
    if str(mode).lower() not in _MODES:
        raise DataError(f"{path}: mode {reprlib.repr(mode)} is not trinary, scale or raw")
    return _Settings(image, resolution, (origin[0], origin[1]), origin[2], negated, occupied, free, mode.lower())


def _number(value):
    """A finite number from what YAML made of it, None for anything else: 5e-2 is text to YAML, which wants 5.0e-2."""
    if type(value) not in (int, float, str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _read_image(path, file):
    """An image file, decoded; `DataError` that names it and the floor plan at `path`."""
    from PIL import Image  # noqa: PLC0415 - see load_floor_plan

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of metadata and of sizes, which are looked at here
            with Image.open(file, formats=_FORMATS) as image:
                if image.width * image.height > MOST_PIXELS:
                    raise Image.DecompressionBombError(f"{image.width} x {image.height} pixels")
                image.load()
    except Image.DecompressionBombError as error:
        raise DataError(
            f"{path}: image {file} is too large ({error}): at most {MOST_PIXELS // 10**6} million pixels are read; cut "
            "it, or make it coarser and `resolution` larger"
        ) from None
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError) as error:
        raise DataError(
            f"{path}: image {file} cannot be read ({error.strerror}); put it there, or correct `image`"
        ) from None
    except PermissionError as error:
        raise DataError(f"{path}: image {file} cannot be read ({error.strerror}); see that it may be read") from None
    except Exception as error:  # Pillow's decoders raise nearly anything at damaged bytes
        reason = str(error).replace(f" {str(file)!r}", "") or type(error).__name__
        raise DataError(f"{path}: image {file} cannot be read ({reason}); save it again as PNG or PGM") from None
    return image


def _bands(path, file):
    """Yield the `_Pixels` of an image file in bands of rows: what is computed of them takes many times their memory."""
    image = _read_image(path, file)
    wide = image.mode.startswith("I;16") or (image.mode == "I" and image.format in {"PNG", "PPM"})
    if image.mode == "I" and not wide:  # nothing says how large white is
        raise DataError(f"{path}: image {file} has 32 bit whole numbers; save it with 8 or 16 bit")
    # A TIFF may count from white; Pillow turns that around for 1 to 8 bit only.
    from_white = image.format == "TIFF" and image.mode not in {"1", "L"} and image.tag_v2.get(_PHOTOMETRIC) == 0
    rows = max(_BAND_PIXELS // max(image.width, 1), 1)
    for first in range(0, image.height, rows):
        pixels = _pixels(image.crop((0, first, image.width, min(first + rows, image.height))), wide)
        wrong = pixels.colour[(pixels.colour < 0) | (pixels.colour > pixels.white)]  # of floats; no number is unknown
        if wrong.size:
            raise DataError(
                f"{path}: image {file} holds {wrong[0]}; numbers with a point go from 0, black, to 1, white"
            )
        yield pixels._replace(colour=pixels.white - pixels.colour) if from_white else pixels


def _pixels(image, wide):
    """The `_Pixels` of a decoded image, of which `wide` says whether it has 16 bit.

    By hand for what has more than 8 bit, which Pillow would cut off at 255.
    """
    key = image.info.get("transparency")
    if wide:
        colour = np.asarray(image).astype(np.int32)
        return _Pixels(colour, None if key is None else np.where(colour == key, 0, 65535), 65535)
    if image.mode == "F":
        return _Pixels(np.asarray(image, np.float64), None, 1)
    if key is not None or image.mode in {"LA", "PA", "RGBA", "La", "RGBa"}:
        channels = np.asarray(image.convert("RGBA"))
        return _Pixels(channels[..., :3].sum(axis=2, dtype=np.int32), 3 * channels[..., 3].astype(np.int32), 765)
    if image.mode in {"1", "L"}:
        return _Pixels(np.asarray(image.convert("L")).astype(np.int32), None, 255)
    return _Pixels(np.asarray(image.convert("RGB")).sum(axis=2, dtype=np.int32), None, 765)


def _raw(image):
    """Values of map_server's grid [rows, columns] that an image of mode `raw` has."""
    return np.floor(255 * image.colour / image.white + 0.5)


def _cells_of(image, settings):
    """FREE, UNKNOWN or OCCUPIED for each pixel [rows, columns], see `load_floor_plan`."""
    shade, white = image.colour, image.white
    cells = np.full(shade.shape, UNKNOWN, np.uint8)
    if settings.mode == "raw":
        value = _raw(image)
        cells[value == 100], cells[value == 0] = OCCUPIED, FREE
        return cells
    if settings.mode == "trinary" and image.alpha is not None:
        shade, white = 3 * shade + image.alpha, 4 * white
    p = (shade if settings.negate else white - shade) / white
    cells[p > settings.occupied], cells[p < settings.free] = OCCUPIED, FREE
    if settings.mode == "scale" and image.alpha is not None:
        cells[image.alpha < white] = UNKNOWN
    return cells
