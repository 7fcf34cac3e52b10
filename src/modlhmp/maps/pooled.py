"""Walks to be remembered in both ways: an episode map, of which a snippet flow map is made when it is loaded.

So one file serves a forecast that follows whole walks as well as one that strings pieces of them together
(`forecasting.pool`). It stores real tracks, as an episode map does. Not in the paper.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from modlhmp.maps import episodes, snippets
from modlhmp.maps.episodes import EpisodeMap, build
from modlhmp.maps.pieces import Pieces
from modlhmp.maps.snippets import SnippetMap
from modlhmp.options import Pooled, SnippetBuilding
from modlhmp.site import Site

__all__ = ["PooledMap", "build", "load"]


class PooledMap(NamedTuple):
    """The same walks as an episode map and as a snippet flow map."""

    episodes: EpisodeMap
    snippets: SnippetMap


def load(path: str | Path | pa.Table, site: Site, options: Pooled) -> PooledMap:
    """Read the Parquet form, that of an episode map; `DataError` where it is not one, or is of another time step."""
    walks = episodes.load(path, site, options)
    row = np.arange(len(walks.person))
    age = row - np.searchsorted(walks.person, walks.person)
    pieces = Pieces(walks.person, walks.t, walks.xy, walks.last, age)
    building = SnippetBuilding(length_s=options.length_s, most=options.most)
    return PooledMap(walks, snippets.load(snippets.of_pieces(pieces, site, building), site, options))
