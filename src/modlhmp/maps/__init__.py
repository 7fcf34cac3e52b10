"""Maps of dynamics: built by their modules, loaded here by kind. A new map is a module and a line in `HOURLY`."""

from pathlib import Path

from modlhmp.maps.base import HourlyMod
from modlhmp.maps.cliff import CliffMap
from modlhmp.maps.stef import StefMap

# Maps with one file a clock hour, in a folder of their kind's name.
HOURLY = {"tc_cliff": CliffMap, "stef": StefMap}
KINDS = ("cliff", *HOURLY)


def map_path(folder, kind):
    """Where the files of a kind of map lie under a dataset's `maps` folder."""
    return Path(folder) / (kind if kind in HOURLY else f"{kind}.parquet")


def load_map(kind, path, timezone, sampling_radius):
    """Load the map of a kind from its file or folder of hours, ready for the roll-out."""
    if kind not in HOURLY:
        return CliffMap.load(path, sampling_radius)
    files = sorted(Path(path).glob("*.parquet"))
    return HourlyMod({int(file.stem): HOURLY[kind].load(file, sampling_radius) for file in files}, timezone)
