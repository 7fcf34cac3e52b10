"""Scenes: the forecasts that a recording asks for itself, as TrajNet++'s files do: of whom, and over which time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from modlhmp.ids import Owners, id_of
from modlhmp.storage import DataError, read_metadata
from modlhmp.tracks import Tracks

LATE_S = 1e-6  # by which two ways to count a frame's time may differ


class Scenes(NamedTuple):
    """n scenes: whose path is forecast, `track_id` [n]; the times of its first observed row, `begin` [n], and of the
    last row of its future, `end` [n] (unix s).
    """

    track_id: np.ndarray
    begin: np.ndarray
    end: np.ndarray

    def plain(self) -> dict[str, list[Any]]:
        """As JSON data."""
        return {name: column.tolist() for name, column in self._asdict().items()}


def read_scenes(path: str | Path) -> Scenes | None:
    """The scenes of a clean recording; None where its files have none."""
    return scenes_of(read_metadata(path))


def scenes_of(account: Mapping[str, Any]) -> Scenes | None:
    """The same from what cleaning says beside the tracks, `scenes` among it as JSON data (`Scenes.plain`)."""
    plain = account.get("scenes")
    if plain is None:
        return None
    return Scenes(np.array(plain["track_id"], np.int64), np.array(plain["begin"]), np.array(plain["end"]))


def check_alike(scenes: Mapping[str, Scenes | None]) -> None:
    """Refuse test recordings, by their names, of which some have scenes and others none: their counts would not mean
    the same.
    """
    having = [name for name, found in scenes.items() if found is not None]
    if having and len(having) < len(scenes):
        none = next(name for name, found in scenes.items() if found is None)
        raise DataError(
            f"test recording {having[0]} has scenes and {none} has none: the first would be forecast in its scenes, "
            "the other's tracks once each. Make a dataset of each kind, or set `forecast_every_s`, which asks for "
            "forecasts of all tracks and leaves scenes out"
        )


def of_pieces(scenes: Scenes, tracks: Tracks, owners: Owners) -> Scenes:
    """The scenes whose person is there at their begin, in clean tracks: each of the piece that the person is then."""
    bounds = tracks.bounds()
    first, last = bounds[:-1], bounds[1:] - 1
    pieces: dict[int, list[tuple[int, float, float]]] = {}
    for track_id, since, until in zip(tracks.track_id[first].tolist(), tracks.t[first], tracks.t[last], strict=True):
        pieces.setdefault(id_of(owners.text(track_id)), []).append((track_id, since, until))
    kept, whose = np.zeros(len(scenes.begin), bool), scenes.track_id.copy()
    for number, (whole, begin, _) in enumerate(zip(*scenes, strict=True)):
        for track_id, since, until in pieces.get(int(whole), ()):
            if since - LATE_S <= begin < until:
                kept[number], whose[number] = True, track_id
    return Scenes(whose[kept], scenes.begin[kept], scenes.end[kept])
