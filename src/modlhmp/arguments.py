"""What users hand in, checked: `DataError` names the argument, its value and the remedy."""

import dataclasses
import os
from collections.abc import Mapping
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.forecasting.observe import Observed
from modlhmp.futures import Futures
from modlhmp.kinds import Kind, all_kinds, find
from modlhmp.scoring.errors import ground_truth, left_out
from modlhmp.settings import as_plain, check
from modlhmp.site import MOST_STEP_S, Site, check_site
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, gap_limit, usable_tracks, usual_step

LATEST_S = 1e11  # of a time in unix s: the year 5138; one in ms is beyond
A_MAP = "a Map (build_map, load_map, or UpdatedMap.written)"
NETWORK = (
    "kind {} is a network, which a run trains and forecasts with: name it in `compare` of a run's configuration "
    "(docs/runs.md)"
)
SHORT = 2.0**24  # a float32 holds no larger time to the second
FASTEST_M_S = 100.0  # a recorded speed beyond is in another unit
USUAL_M_S = 10.0  # of half of all steps: nobody walks so
STANDING_M_S = 0.3  # recorded speeds up to here may come without a heading: a reader's `min_heading_mps` is less
START_M = 1.0  # what a history may differ from the truth at t0
STEPS_APART = (0.8, 1.25)  # of rows that need no resampling, in time steps
EVEN, OFF_GRID = 0.9, 0.2  # of the rows are so near, in time steps, to a whole number of them, or these are in doubt


def unix_time(told: str, t: Any) -> float:
    """A moment in unix s; `DataError` for what is none, `told` being its name."""
    if not isinstance(t, Real) or isinstance(t, bool) or not abs(t) < LATEST_S:  # type: ignore[operator]  # also NaN
        raise DataError(f"{told} {t!r}: give a time in unix s")
    return float(t)


def site_of(site: Any, of_map: Site | None = None) -> Site:
    """The site asked for, checked like a dataset file's; beside a map only the map's own."""
    if site is None:
        return of_map or Site()
    if not isinstance(site, Site):
        raise DataError(f"site is {type(site).__name__}; give modlhmp.Site(timezone=..., time_step_s=...)")
    checked = site_from(as_plain(site), "site")
    if of_map is not None and checked != of_map:
        raise DataError("site: the map has a site of its own, and this one differs from it; leave it out")
    return checked


def site_of_tracks(where: str, tracks: Tracks, **more: Any) -> Site:
    """The site of tracks of which nothing is said but `more`: its time step is the median of theirs.

    The horizon is the usual one, to the next whole time step. `DataError` where rows are not on a grid of time steps,
    of which some may be missing.
    """
    step_s = usual_step(tracks)
    if np.isnan(step_s):
        return Site(**more)
    if not step_s <= MOST_STEP_S:
        raise DataError(f"{where}: tracks have a row every {step_s:g} s, at most {MOST_STEP_S:g}; are the times in ms?")
    apart = np.diff(tracks.t)[np.diff(tracks.track_id) == 0] / step_s
    if (even := np.mean(np.abs(apart - np.maximum(np.rint(apart), 1)) <= OFF_GRID)) < EVEN:
        raise DataError(
            f"{where}: the time step of the tracks is in doubt: their rows are {step_s:.4g} s apart in the median, but "
            f"{1 - even:.0%} of them are not; bring them to one step by read_tracks, or say it: Site(time_step_s=...)"
        )
    low, high = np.quantile(apart, [0.25, 0.75]) * step_s  # clocks jitter: 1 s where that is among the usual steps
    rounded = (float(f"{step_s:.{digits}g}") for digits in range(1, 6))
    step_s = next((one for one in rounded if low <= one <= high), round(step_s, 6))
    return site_from({"time_step_s": step_s, "horizon_s": round(Site().horizon_s / step_s) * step_s, **more}, where)


def site_from(plain: Any, where: str) -> Site:
    """A checked site from its plain form; other keys are ignored, since a dataset is a site, too."""
    if isinstance(plain, Mapping):
        plain = {field.name: plain[field.name] for field in dataclasses.fields(Site) if field.name in plain}
    site = check(Site, plain, where)
    check_site(site, where)
    return site


def map_kind(name: str) -> Kind:
    """The record of a kind of map."""
    record = find(name, maps_only=True)
    if record.learned:
        raise DataError(NETWORK.format(repr(name)))
    if not record.has_map:
        maps = [kind.name for kind in all_kinds().values() if kind.has_map]
        raise DataError(f"kind {name!r} is not a map; maps are {', '.join(maps)}")
    return record


def free_kind(name: str) -> Kind:
    """The record of a kind that needs no map."""
    if not isinstance(name, str):
        raise DataError(f"forecast by {type(name).__name__}: give {A_MAP} or the name of a kind")
    if os.sep in name or name.endswith(".parquet"):
        raise DataError(f"forecast by {name!r}: give the map that lies there, modlhmp.load_map({name!r})")
    record = find(name)
    if record.has_map:
        raise DataError(f"kind {name!r} cannot forecast by its name alone: give a Map, as build_map makes it")
    if record.learned:
        raise DataError(NETWORK.format(repr(name)))
    if record.outside:
        raise DataError(
            f"kind {name!r} is scored, not asked: read the files with modlhmp.exchange, or run the workflow"
        )
    if record.forecasts is None:
        raise DataError(f"kind {name!r} is made of other methods' forecasts, in the workflow")
    return record


def check_tracks(where: str, tracks: Tracks, site: Site | None = None) -> None:
    """Whether it is a track table, sorted, its rows a time step of the site apart, if there is one; `DataError`."""
    if not isinstance(tracks, Tracks):
        given = type(tracks).__name__
        raise DataError(
            f"{where}: tracks are {given}; give modlhmp.Tracks, as read_tracks makes them{_of_file(tracks)}"
        )
    for name, values in zip(Tracks._fields, tracks, strict=True):
        wanted = np.integer if name == "track_id" else np.floating
        if not isinstance(values, np.ndarray) or not np.issubdtype(values.dtype, wanted) or values.ndim != 1:
            kind = "whole numbers" if name == "track_id" else "floats"
            raise DataError(f"{where}: column {name} of the tracks: give a 1-d numpy array of {kind}")
        if len(values) != len(tracks.track_id):
            raise DataError(f"{where}: column {name} has {len(values)} rows, track_id has {len(tracks.track_id)}")
    if (bad := ~(np.abs(tracks.t) < LATEST_S)).any():  # also NaN
        row = int(np.argmax(bad))
        raise DataError(f"{where}: row {row}: t {tracks.t[row]} is not a time in unix s; is it in ms?")
    if (bad := (tracks.speed < 0) | (tracks.speed > FASTEST_M_S) | (np.abs(tracks.heading) > 2 * np.pi + 0.01)).any():
        row = int(np.argmax(bad))
        moves = f"speed {tracks.speed[row]:g}, heading {tracks.heading[row]:g}"
        raise DataError(f"{where}: row {row}: {moves}: speeds are from 0 to {FASTEST_M_S:g} m/s, headings in rad")
    if len(tracks.bounds()) - 1 > len(np.unique(tracks.track_id)):
        ids, counts = np.unique(tracks.track_id[tracks.bounds()[:-1]], return_counts=True)
        raise DataError(f"{where}: track {ids[counts > 1][0]} stands in several places; sort by track, then time")
    same = np.diff(tracks.track_id) == 0
    apart = np.diff(tracks.t)[same]
    if len(apart) and apart.min() <= 0:
        row = int(np.flatnonzero(same)[apart.argmin()]) + 1
        short = np.abs(tracks.t[row]) > SHORT and (tracks.t == tracks.t.astype(np.float32)).all()
        remedy = "give float64: unix times have more digits than float32" if short else "sort by track, then time"
        raise DataError(f"{where}: row {row}: t {tracks.t[row]} is not after the row before; {remedy}")
    moved = np.hypot(np.diff(tracks.x)[same], np.diff(tracks.y)[same]) / apart
    if len(apart) and (usual := float(np.nanmedian(np.append(moved, 0.0)))) > USUAL_M_S:
        raise DataError(
            f"{where}: half of all steps are faster than {usual:.3g} m/s; are positions in m (not cm, mm), times in s?"
        )
    if site is None or not len(apart):
        return
    step = float(np.median(apart))
    if not STEPS_APART[0] <= step / site.time_step_s <= STEPS_APART[1]:
        raise DataError(
            f"{where}: tracks have a row every {step:g} s, the site's time_step_s is {site.time_step_s:g}; "
            + (
                "are the times in ms?"
                if 500 < step / site.time_step_s < 2000
                else "give read_tracks and Site the same one"
            )
        )


def checked_site(where: str, tracks: Tracks, site: Any) -> Site:
    """The site asked for, or where there is none that of the tracks; and whether they are tracks of it."""
    if site is not None:
        site = site_of(site)
        check_tracks(where, tracks, site)
        return site
    check_tracks(where, tracks)
    return site_of_tracks(where, tracks)


def _of_file(value: Any) -> str:
    """What to do with a file's name in place of what stands in the file."""
    return f": read {os.fspath(value)!r} with read_tracks first" if isinstance(value, str | PathLike) else ""


def uses_recorded(options: Any, site: Site) -> bool:
    """Whether a method looks at recorded speeds and headings; those that replay walks know positions alone."""
    return getattr(options, "velocity", "differences") == "dataset" and site.velocity == "as_recorded"


def last_rows(history: Tracks | np.ndarray, site: Site, recorded: bool = False) -> Observed:
    """The last rows of each walker, as a forecaster sees them; with speeds and headings if it uses `recorded` ones."""
    tracks = tracks_of(history)
    check_tracks("history", tracks, site)
    if not len(tracks.t):
        raise DataError("history: it has no rows; is anyone there at that time (t is in unix s)?")
    bounds, seen = tracks.bounds(), site.observed_rows
    counts = np.diff(bounds)
    if counts.min() < seen:
        short, remedy = tracks.track_id[bounds[counts.argmin()]], f"give the last {seen} rows or more"
        if isinstance(history, Tracks):
            remedy = f"leave such walkers out, as Tracks.seen_by(t, rows={seen}) does"
        raise DataError(
            f"history: walker {short} has {counts.min()} rows; observed_rows of the site is {seen}; {remedy}"
        )
    rows = bounds[1:, None] - np.arange(seen, 0, -1)
    whose, last = tracks.track_id[rows[:, 0]], f"the last {seen} rows"
    gap_s = gap_limit(site.time_step_s)
    gap = np.diff(tracks.t[rows], axis=1).max(axis=1) > gap_s
    if gap.any():
        raise DataError(f"history: walker {whose[gap][0]} has a gap of more than {gap_s:g} s in {last}")
    nowhere = ~(np.isfinite(tracks.x[rows]) & np.isfinite(tracks.y[rows])).all(axis=1)
    if nowhere.any():
        raise DataError(f"history: walker {whose[nowhere][0]}: a position in {last} is not a number")
    if recorded:
        _check_recorded(whose, tracks.speed[rows[:, :-1]], tracks.heading[rows[:, :-1]])
    nobody = np.empty((len(rows), 0, seen, 2))
    return Observed(whose, *(column[rows] for column in tracks[1:]), nobody)  # type: ignore[call-arg]


def _check_recorded(whose, speed, heading):
    """Whether the rows before t0 say how fast and which way each walker goes; who stands has no heading."""
    fastest = np.where(np.isfinite(speed), speed, -np.inf).max(axis=1)
    lost = ~np.isfinite(heading).any(axis=1) & (fastest > STANDING_M_S)
    for lacking, what in ((fastest < 0, "speed"), (lost, f"heading, though faster than {STANDING_M_S:g} m/s")):
        if lacking.any():
            raise DataError(
                f"history: the site's velocity is as_recorded, but no row of walker {whose[lacking][0]} before t0 has "
                f"a {what} ({lacking.sum()} of {len(whose)} walkers); leave such walkers out, or use "
                "velocity='differences'"
            )


def tracks_of(history: Tracks | np.ndarray) -> Tracks:
    """Tracks as they are, or of an array [rows, 3] or [n, rows, 3] of t, x, y, whose walkers are numbered from 0."""
    if isinstance(history, Tracks):
        return history
    array = numbers("history", history)
    if array.ndim == 2:
        array = array[None]
    if array.ndim != 3 or array.shape[2] != 3:
        raise DataError(f"history of shape {array.shape}: give Tracks, or [rows, 3] of t, x, y (several: [n, rows, 3])")
    flat = array.reshape(-1, 3)
    unknown_velocity = np.full(len(flat), np.nan)
    return Tracks(np.repeat(np.arange(len(array)), array.shape[1]), *flat.T, unknown_velocity, unknown_velocity)  # type: ignore[call-arg]


def path_of(where: str, path: Any) -> Path:
    """A path that the file system can have, whether anything lies there or not."""
    if not isinstance(path, str | PathLike) or not os.fspath(path) or isinstance(os.fspath(path), bytes):
        raise DataError(f"{where}: path {path!r}: give a file's path as text")
    path = Path(os.path.expanduser(path))  # of pathlib: `~` and a user whom nobody knows are an error of another kind
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:
        raise DataError(f"{where}: path {str(path)[:80]!r}: give a file's path ({error})") from None
    return path


def numbers(name: str, values: Any) -> np.ndarray:
    """An array of floats; not of text, dates or complex numbers, which numpy would turn into them."""
    if of_file := _of_file(values):
        raise DataError(f"{name}: give numbers, not a file's name{of_file}")
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "iufO" or any(
            isinstance(one, str | bytes) for one in array.flat if array.dtype == "O"
        ):
            raise TypeError(f"they are {array.dtype}")
        return array.astype(float)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name}: give numbers, all rows equally long ({error})") from None


def truth_of(futures: Futures, truth: Tracks, site: Site, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True positions [n, T, 2], how many steps of them [n], and who is idle [n], of the futures' walkers."""
    check_tracks("truth", truth, site)
    bounds = truth.bounds()
    rows = np.column_stack([bounds[:-1], bounds[1:] - 1])
    of = {int(track): row for track, row in zip(truth.track_id[rows[:, 0]], rows, strict=True)}
    if missing := [int(track) for track in futures.track_id if int(track) not in of]:
        raise DataError(f"truth: walker {missing[0]} of the futures has no track in it")
    rows = np.array([of[int(track)] for track in futures.track_id])
    usable = {int(truth.track_id[first]) for first, _ in usable_tracks(truth, 1, site.time_step_s)}
    xy, length = np.full((len(rows), steps, 2), np.nan), np.zeros(len(rows), np.int64)
    for number, (first, last) in enumerate(rows):
        at = first + int(np.searchsorted(truth.t[first : last + 1], futures.t0[number] - 1e-6))
        walker = futures.track_id[number]
        if at > last or abs(truth.t[at] - futures.t0[number]) > 1e-3:
            raise DataError(f"truth: track {truth.track_id[first]} has no row at t0 = {futures.t0[number]:.3f}")
        apart = np.hypot(truth.x[at] - futures.start[number, 0], truth.y[at] - futures.start[number, 1])
        if not apart <= START_M:
            raise DataError(
                f"truth: walker {walker} of the futures starts {apart:.1f} m from where that track is at t0; "
                "are they the same people? An array's walkers are numbered from 0"
            )
        if not (np.isfinite(truth.x[at : last + 1]) & np.isfinite(truth.y[at : last + 1])).all():
            raise DataError(f"truth: track {walker} has positions that are not numbers; leave such rows out")
        if int(truth.track_id[first]) in usable:
            found, seconds = ground_truth(truth, np.array([[at, last]]), 1, steps, site.time_step_s)
            xy[number], length[number] = found[0], seconds[0]
    return xy, length, left_out(truth, rows, site)
