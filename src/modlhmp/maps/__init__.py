"""Maps of dynamics: built by their modules, loaded here by kind.

A new map is a module with a class like these (contract: `maps.base`), a line in `KINDS`, and a rule that builds it. A
map with memory is not sampled step by step: it has a forecaster of its own in `forecasting`, and stands in `FOLLOWED`.
"""

from pathlib import Path

from modlhmp.maps.base import HourlyMod
from modlhmp.maps.cliff import CliffMap
from modlhmp.maps.episodes import EpisodeMap
from modlhmp.maps.snippets import SnippetMap
from modlhmp.maps.stef import StefMap

# kind: class, and whether there is one map a clock hour, each a file of a folder of the kind's name
KINDS = {
    "cliff": (CliffMap, False),
    "tc_cliff": (CliffMap, True),
    "stef": (StefMap, True),
    "episodes": (EpisodeMap, False),
    "snippets": (SnippetMap, False),
}
FOLLOWED = ("episodes", "snippets")
SAMPLED = tuple(kind for kind in KINDS if kind not in FOLLOWED)


def map_path(folder, kind):
    """Where the files of a kind of map lie under a dataset's `maps` folder."""
    hourly = KINDS[kind][1]
    return Path(folder) / (kind if hourly else f"{kind}.parquet")


def load_map(kind, path, timezone, sampling_radius):
    """Load a map of a `SAMPLED` kind from its file or folder of hours, ready for the roll-out."""
    mod, hourly = KINDS[kind]
    if not hourly:
        return mod.load(path, sampling_radius)
    files = sorted(Path(path).glob("*.parquet"))
    return HourlyMod({int(file.stem): mod.load(file, sampling_radius) for file in files}, timezone)
