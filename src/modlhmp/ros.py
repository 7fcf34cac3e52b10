"""Forecasts in the forms of ROS, written and readable without it: map_server's YAML and image, and bags.

    p = futures.occupancy()
    write_map(p, "in-10-s.yaml", at_s=10)     # one moment, as a map that map_server serves
    write_bag(futures, p, "forecast")         # all moments and everyone's path, for RViz or Foxglove

Values of grids are per cent, as ROS has them. A bag is a folder with `metadata.yaml` and an MCAP file of
`nav_msgs/OccupancyGrid` and `nav_msgs/Path`, which are the same in every distribution of ROS 2 (rosbag2's version 8).
"""

import json
import shutil
from numbers import Real
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from modlhmp.arguments import path_of
from modlhmp.forecasting.occupancy import Occupancy
from modlhmp.forecasting.ranking import best_path
from modlhmp.futures import Futures
from modlhmp.storage import DataError, atomic_path, put_in_place, write_text
from modlhmp.temporary import temporary_name
from modlhmp.version import __version__

OCCUPANCY, PATH = "/modlhmp/occupancy", "/modlhmp/path/person_{}"  # topics
LATEST_S = 2.0**31  # a message's seconds have 32 bits


def write_map(occupancy: Occupancy, path: str | Path, at_s: float) -> Path:
    """Write what is occupied after `at_s` seconds as `path` (.yaml) and a PGM image beside it; returns the image.

    Its mode is `raw`: a pixel is the probability in per cent, which every map_server gives out as it is.
    """
    path = path_of("write_map", path)
    if path.suffix not in {".yaml", ".yml"}:
        raise DataError(f"write_map: path {str(path)!r}: give a name that ends with .yaml; the image lies beside it")
    known = isinstance(at_s, Real) and not isinstance(at_s, bool)
    moment = np.flatnonzero(np.isclose(occupancy.times_s, at_s if known else np.nan))
    if len(moment) != 1:
        first, last = occupancy.times_s[[0, -1]].tolist()
        raise DataError(f"write_map: at_s {at_s!r}: no moment of the forecast, which are from {first:g} to {last:g} s")
    image, grid = path.with_suffix(".pgm"), percent(occupancy)[moment[0]]
    (rows, columns), (x, y) = grid.shape, occupancy.origin
    about = f"Probability in per cent that a cell is occupied {at_s:g} s after {occupancy.t0:.3f} (unix s)"
    about += f", by modlhmp {__version__}"
    text = (
        f"# {about}.\nimage: {json.dumps(image.name)}\nmode: raw\nresolution: {_plain(occupancy.cell_m)}\n"
        f"origin: [{_plain(x)}, {_plain(y)}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    try:
        with atomic_path(image) as temporary:
            temporary.write_bytes(f"P5\n# {about}\n{columns} {rows}\n255\n".encode() + grid[::-1].tobytes())
        write_text(path, text)
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error})") from None
    return image


def write_bag(futures: Futures, occupancy: Occupancy, path: str | Path, frame: str = "map") -> None:
    """Write a forecast as a bag at `path`, a folder that is made: a grid for every moment, a path for every walker.

    A grid is stamped, and played back, at the time that it is of, a path at t0. Paths are `futures.best` for as long as
    the walker is there, headed the way they go. `frame` is the name of the frame of all positions.
    """
    path = path_of("write_bag", path)
    if path.exists():
        raise DataError(f"write_bag: {path} exists; give the name of a folder that does not, or remove it")
    if not len(futures.t0):
        raise DataError("write_bag: the forecast is of nobody, so there is nothing to write")
    t0 = float(futures.t0.max())
    if not 0 <= t0 < LATEST_S - occupancy.times_s[-1]:
        raise DataError(f"write_bag: t0 {t0}: ROS has times from 0 to {LATEST_S:.0f} s (unix)")
    rosbag2, store = _rosbags(path)
    part = temporary_name(path)
    try:
        part.mkdir(parents=True)
        with rosbag2.Writer(part / path.name, version=8, storage_plugin=rosbag2.StoragePlugin.MCAP) as bag:
            for who, one in zip(futures.track_id.tolist(), _paths(futures), strict=True):
                _write(bag, store, PATH.format(str(who).replace("-", "m")), _path(store, t0, one, frame), t0)
            for after_s, grid in zip(occupancy.times_s.tolist(), percent(occupancy), strict=True):
                _write(bag, store, OCCUPANCY, _grid(store, occupancy, grid, t0 + after_s, frame), t0 + after_s)
        put_in_place(part / path.name, path)
    except OSError as error:
        raise DataError(f"{path}: cannot be written ({error})") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)


def percent(occupancy: Occupancy) -> np.ndarray:
    """Probabilities in whole per cent, int8 [T, rows, columns], row 0 below."""
    return np.rint(100 * occupancy.probabilities).astype(np.int8)


def _plain(value: float) -> str:
    """A number without an exponent, which YAML takes for text, to all its digits."""
    return np.format_float_positional(value, trim="0")


def _rosbags(path: Path) -> tuple[ModuleType, Any]:
    """The writer's module, and the messages of the oldest ROS 2 that is in use."""
    try:
        from rosbags import rosbag2, typesys  # noqa: PLC0415 - an extra that few need
    except ImportError:
        raise DataError(f"{path}: bags need the package rosbags: pip install 'modlhmp[ros]'") from None
    return rosbag2, typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


def _write(bag: Any, store: Any, topic: str, message: Any, t: float) -> None:
    """Write a message at time `t` [unix s], on a topic that is made where there is none."""
    kind = message.__msgtype__
    made = [one for one in bag.connections if one.topic == topic]
    connection = made[0] if made else bag.add_connection(topic, kind, typestore=store)
    bag.write(connection, 10**9 * _stamp(t)[0] + _stamp(t)[1], store.serialize_cdr(message, kind))


def _paths(futures: Futures) -> list[np.ndarray]:
    """Every walker's path [steps + 1, 3], with the start: seconds after t0, x, y, as long as it is under way."""
    alive = best_path(futures.forecast)[1]
    steps = np.where(futures.known, alive, len(futures.times_s))
    after = np.append(0.0, futures.times_s)
    whole = np.concatenate([futures.start[:, None], futures.best], axis=1)
    return [np.column_stack([after, one])[: lived + 1] for one, lived in zip(whole, steps, strict=True)]


def _path(store: Any, t0: float, rows: np.ndarray, frame: str) -> Any:
    """A `nav_msgs/Path` of seconds after t0, x and y [m, 3]."""
    kinds = store.types
    ways = np.diff(rows[:, 1:], axis=0, append=2 * rows[-1:, 1:] - rows[-2:-1, 1:] if len(rows) > 1 else rows[-1:, 1:])
    poses = [
        kinds["geometry_msgs/msg/PoseStamped"](
            _header(store, t0 + after, frame), _pose(store, x, y, np.arctan2(dy, dx))
        )
        for (after, x, y), (dx, dy) in zip(rows.tolist(), ways.tolist(), strict=True)
    ]
    return kinds["nav_msgs/msg/Path"](_header(store, t0, frame), poses)


def _grid(store: Any, occupancy: Occupancy, grid: np.ndarray, t: float, frame: str) -> Any:
    """A `nav_msgs/OccupancyGrid` of one moment; its origin is the corner of the first cell."""
    header, (rows, columns) = _header(store, t, frame), grid.shape
    about = store.types["nav_msgs/msg/MapMetaData"](
        header.stamp, occupancy.cell_m, columns, rows, _pose(store, *occupancy.origin, 0.0)
    )
    return store.types["nav_msgs/msg/OccupancyGrid"](header, about, grid.ravel())


def _header(store: Any, t: float, frame: str) -> Any:
    return store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](*_stamp(t)), frame)


def _stamp(t: float) -> tuple[int, int]:
    """Seconds and nanoseconds; the product of all digits and 1e9 would be rounded."""
    return int(t), min(round(1e9 * (t - int(t))), 10**9 - 1)


def _pose(store: Any, x: float, y: float, yaw: float) -> Any:
    kinds = store.types
    turned = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))
    return kinds["geometry_msgs/msg/Pose"](kinds["geometry_msgs/msg/Point"](x, y, 0.0), turned)
