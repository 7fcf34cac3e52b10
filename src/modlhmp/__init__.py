"""Maps of dynamics (MoDs) and long-term human motion prediction.

    tracks  = modlhmp.read_tracks("monday.csv", columns={...}, units={...})
    a_map   = modlhmp.build_map("snippets", tracks)
    futures = modlhmp.forecast(a_map, history, horizon_s=60)
    modlhmp.score(futures, truth)

Names are loaded when they are first used. Data flow one way: readers -> cleaning -> maps -> forecasting -> scoring ->
networks -> study; imports follow them.
"""

from modlhmp.version import __version__ as __version__

TYPE_CHECKING = False  # for checkers of types; `typing` itself is not needed here
if TYPE_CHECKING:
    from modlhmp.api import Map, build_map, forecast, load_map, read_tracks, score
    from modlhmp.futures import Futures, Scores
    from modlhmp.kinds import Kind, all_kinds
    from modlhmp.live import Live
    from modlhmp.planning import path_cost
    from modlhmp.site import Site
    from modlhmp.storage import DataError
    from modlhmp.tracks import Tracks

_HOMES = {
    "read_tracks": "modlhmp.api",
    "Tracks": "modlhmp.tracks",
    "Site": "modlhmp.site",
    "build_map": "modlhmp.api",
    "load_map": "modlhmp.api",
    "Map": "modlhmp.api",
    "forecast": "modlhmp.api",
    "Live": "modlhmp.live",
    "Futures": "modlhmp.futures",
    "score": "modlhmp.api",
    "Scores": "modlhmp.futures",
    "path_cost": "modlhmp.planning",
    "Kind": "modlhmp.kinds",
    "all_kinds": "modlhmp.kinds",
    "DataError": "modlhmp.storage",
}

__all__ = [
    "DataError",
    "Futures",
    "Kind",
    "Live",
    "Map",
    "Scores",
    "Site",
    "Tracks",
    "all_kinds",
    "build_map",
    "forecast",
    "load_map",
    "path_cost",
    "read_tracks",
    "score",
]


def __getattr__(name: str) -> object:
    from importlib import import_module  # noqa: PLC0415 - `import modlhmp` loads nothing

    if name not in _HOMES:
        raise AttributeError(f"module 'modlhmp' has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
