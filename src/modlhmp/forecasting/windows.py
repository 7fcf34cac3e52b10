"""Which forecasts are made of a recording: one of each track, as in the paper, or one every so many seconds of it.

A recording may also ask for some itself: its scenes.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.scenes import Scenes
from modlhmp.site import Site
from modlhmp.tracks import LATE_STEPS, Tracks, usable_tracks


class Windows(NamedTuple):
    """n forecasts of a recording, in the order of its tracks, then of time.

    `tracks` [m, 2] are the first and last row of its usable tracks; `of` [n] says whose each forecast is, counting
    these; `row` [n] is its row at t0, the last one that is observed, and `t0` [n] the time there in unix s. `until` [n]
    is the time at which its truth ends, at the track's end or before. `track_id` [n]. `later_s` [n] is how long t0 is
    after the track's first possible one. `several`: whether a track may have more than one, told apart by their t0.
    """

    tracks: np.ndarray
    of: np.ndarray
    row: np.ndarray
    t0: np.ndarray
    until: np.ndarray
    track_id: np.ndarray
    later_s: np.ndarray
    several: bool


def usable(tracks: Tracks, site: Site) -> np.ndarray:
    """First and last row of every track that can be forecast and scored, [n, 2] (`tracks.usable_tracks`)."""
    return usable_tracks(tracks, site.observed_rows, site.time_step_s)


def windows(tracks: Tracks, site: Site, scenes: Scenes | None = None) -> Windows:
    """The forecasts of every usable track: at its `observed_rows`-th row, and `forecast_every_s` after that, if given.

    A later t0 is the first row that is not before its moment; at least one row of the track comes after it. Without
    `forecast_every_s` the `scenes` of the recording, if it has any, are its forecasts: t0 is the `observed_rows`-th row
    from a scene's begin on, and the truth ends with the scene.
    """
    found = usable(tracks, site)
    first, last = found[:, 0] + site.observed_rows - 1, found[:, 1]
    of, row, until = np.arange(len(found)), first, tracks.t[last]
    if site.forecast_every_s is None and scenes is not None:
        of, row, until = _of_scenes(scenes, tracks, found, site)
    elif site.forecast_every_s is not None:
        late_s = LATE_STEPS * site.time_step_s
        rows = [
            begin + _moments(tracks.t[begin:end] - tracks.t[begin], site.forecast_every_s, late_s)
            for begin, end in zip(first, last, strict=True)
        ]
        of, row = np.repeat(of, [len(one) for one in rows]), np.concatenate([first[:0], *rows])
        until = until[of]
    t0, several = tracks.t[row], scenes is not None or site.forecast_every_s is not None
    return Windows(found, of, row, t0, until, tracks.track_id[row], t0 - tracks.t[first[of]], several)


def _moments(since_s: np.ndarray, every_s: float, late_s: float) -> np.ndarray:
    """Places of the first row at or after 0, `every_s`, twice that, ... in the times of rows [m], the first one 0."""
    wanted = np.arange(np.floor((since_s[-1] + late_s) / every_s) + 1) * every_s
    return np.unique(np.searchsorted(since_s, wanted - late_s))


def _of_scenes(
    scenes: Scenes, tracks: Tracks, found: np.ndarray, site: Site
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`of`, `row` and `until` of scenes that have a step of truth; `found` [m, 2] are the rows of the usable tracks.

    Of scenes with the same t0 of the same track the longest counts.
    """
    late_s, place = LATE_STEPS * site.time_step_s, {track: n for n, track in enumerate(tracks.track_id[found[:, 0]])}
    wanted: dict[tuple[int, int], float] = {}
    for whose, begin, end in zip(*scenes, strict=True):
        if (of := place.get(whose)) is None:
            continue
        first, last = found[of]
        t = tracks.t[first : last + 1]
        row = first + np.searchsorted(t, begin - late_s) + site.observed_rows - 1
        until = min(end, t[-1])
        if begin >= t[0] - late_s and row < last and until - tracks.t[row] >= site.time_step_s - late_s:
            wanted[of, row] = max(until, wanted.get((of, row), until))
    listed = sorted(wanted)
    of_row = np.array(listed, np.int64).reshape(-1, 2)
    return of_row[:, 0], of_row[:, 1], np.array([wanted[one] for one in listed])


def in_order(
    forecasts: Iterable[tuple[int, np.ndarray, Forecast]], wanted: Windows, recording: str = "recording"
) -> Iterator[tuple[int, np.ndarray, Forecast]]:
    """Yield (seed, places [m] among the `Windows`, Forecast) of forecasts that yield (seed, track_ids, Forecast).

    They come in the order of the windows, every one for each seed; `ValueError` if they are of other tracks.
    """
    done: dict[int, int] = {}
    for seed, track_ids, forecast in forecasts:
        places = done.get(seed, 0) + np.arange(len(track_ids))
        done[seed] = done.get(seed, 0) + len(track_ids)
        if not np.array_equal(track_ids, wanted.track_id[places[places < len(wanted.t0)]]):
            raise ValueError(f"{recording}: the forecasts are of other tracks than the recording's; remake them")
        yield seed, places, forecast
    if any(number != len(wanted.t0) for number in done.values()):
        raise ValueError(f"{recording}: the forecasts are of fewer tracks than the recording's; remake them")
