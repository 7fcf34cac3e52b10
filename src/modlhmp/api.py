"""The library's front door: read tracks, build and load maps, forecast, score. Every name here is one of `modlhmp`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.cleaning import clean_recording
from modlhmp.file_format import FileFormat, Recording, check_format
from modlhmp.forecasting.observe import Observed
from modlhmp.futures import Futures, Scores, whole_steps
from modlhmp.kinds import Kind, all_kinds, find
from modlhmp.maps.base import HourlyMod, hour_files
from modlhmp.methods import build_map as build_tables
from modlhmp.methods import forecaster_of
from modlhmp.scoring.errors import ground_truth, is_idle
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.protocols import score as score_forecast
from modlhmp.settings import as_plain, build, check, unknown
from modlhmp.site import Site, check_site
from modlhmp.storage import DataError, read_metadata, read_parquet, write_parquet
from modlhmp.streams import stream_keys
from modlhmp.tracks import MAX_GAP_S, Tracks, together, usable_tracks
from modlhmp.tracks import read_tracks as read_clean_tracks

KEY = ("modlhmp", "forecast", "")  # takes the place of (dataset, method, recording) in the random numbers
DAY = "day.parquet"  # the whole-day table of a map that is saved by hours
LONGEST_S = 3600.0  # of a forecast; more is a wrong unit


def read_tracks(
    path: str | Path,
    *,
    day: str | None = None,
    start: str | None = None,
    data_root: str | Path | None = None,
    split: str | None = None,
    **form: Any,
) -> Tracks:
    """Read and clean a recording: any text file of one row per person and time.

        read_tracks("monday.csv", columns={"track_id": "person", "t": "time", "x": "x", "y": "y"}, units={"time": "ms"})

    `form` are the keys of `file_format.FileFormat`: `columns` (by position from 0, or by name, which says that there is
    a header), `units`, `separator`, `timezone`, `time_step_s`, `cleaning`, `reader` ... `day` (ISO date) keeps the rows
    of that local day only; `start`, such as "09:00", is the clock time of a file whose times begin at 0 on that day.
    A clean recording of the workflow (.parquet) is read as it is. Of a dataset file (.yaml) all recordings are read, or
    those of one `split`; they lie under `data_root`, and get track ids of their own.
    `DataError` names the file, the row or option, the value and the remedy.
    """
    suffix = _path("read_tracks", path).suffix
    if suffix == ".parquet":
        return read_clean_tracks(path)
    if suffix in {".yaml", ".yml"}:
        from modlhmp.datasets import load_dataset  # noqa: PLC0415 - only dataset files need it

        dataset = load_dataset(path, Path(path).parent if data_root is None else data_root)
        return together(
            clean_recording(Path(one.stored, one.member) if one.member else one.path, dataset, one)[0]
            for one in dataset.of_split(split)
        )
    columns = form.get("columns") or {}
    by_name = isinstance(columns, Mapping) and any(isinstance(column, str) for column in columns.values())
    described = check(FileFormat, {"header": by_name, **form}, "read_tracks")
    if described.reader == "delimited" and described.columns is None:
        raise DataError(f'read_tracks: {path}: say which `columns` hold what, such as columns={{"track_id": 0, ...}}')
    check_format(described, "read_tracks")
    return clean_recording(path, described, Recording(day=day or "", start=start))[0]


@dataclass(frozen=True)
class Map:
    """A map of dynamics: its `kind`, the `site` it is of, and its tables.

    `whole` is the table of the whole day, `hours` {clock hour: table} those of a kind that has a map per hour.
    """

    kind: str
    site: Site
    whole: pa.Table | None
    hours: dict[int, pa.Table]

    def save(self, path: str | Path) -> None:
        """Write it to `path`: a Parquet file, or a folder of the hours' files for a kind that has a map per hour.

        A table of the whole day beside the hours is `day.parquet` in that folder.
        """
        path, origin = _path("Map.save", path), {"kind": self.kind, "site": as_plain(self.site)}
        if not find(self.kind).hourly:
            if self.whole is None:
                raise DataError(f"Map of kind {self.kind}: it has no table")
            if path.is_dir():
                raise DataError(f"{path}: a folder is there; a map of kind {self.kind} is a file, so give another name")
            return write_parquet(self.whole, path, **origin)
        if path.exists() and not path.is_dir():
            raise DataError(f"{path}: a file is there; a map of kind {self.kind} is a folder, so give another name")
        path.mkdir(parents=True, exist_ok=True)
        for hour, table in self.hours.items():
            write_parquet(table, path / f"{hour:02d}.parquet", hour=hour, **origin)
        if self.whole is not None:
            write_parquet(self.whole, path / DAY, **origin)
        return None

    def model(self, options: Any) -> Any:
        """The map ready to be asked with a method's options."""
        module = find(self.kind).implementation()
        if not find(self.kind).hourly:
            return module.load(self.whole, self.site, options)
        hours = {hour: module.load(table, self.site, options) for hour, table in self.hours.items()}
        return HourlyMod(hours, self.site.timezone)


def build_map(kind: str, tracks: Tracks, site: Site | None = None, **building: Any) -> Map:
    """Build a kind of map from tracks: `cliff`, `tc_cliff`, `stef`, `episodes`, `snippets`, or one of another package.

    `site` gives the time zone and the time step (default: UTC, 1 s); `building` are the kind's own options, such as
    `resolution_m=0.5` (`modlhmp kinds NAME` lists them). `DataError` for a wrong kind or option, or tracks whose rows
    are not a time step apart.
    """
    site, record = _site(site), _map_kind(kind)
    options: Any = check(record.building, building, f"build_map({kind!r})")  # type: ignore[arg-type]
    _check_tracks("build_map", tracks, site)
    if not (np.isfinite(tracks.x).all() and np.isfinite(tracks.y).all()):
        raise DataError("build_map: a position is not a number; leave such rows out")
    if len(tracks.t) and np.diff(tracks.bounds()).max() < 2:
        raise DataError("build_map: no track has two rows; are the times in the unit that was said (s, ms)?")
    whole, hours = build_tables(kind, tracks, site, options)
    return Map(kind, site, whole, hours)


def load_map(path: str | Path) -> Map:
    """Load a map that `Map.save` or the workflow wrote: a file, or a folder of hours; `DataError` where it is none."""
    path = _path("load_map", path)
    files = hour_files(path) if path.is_dir() else {}
    if path.is_dir() and not files:
        raise DataError(f"{path}: a folder without a map; a map by hours has files such as 09.parquet")
    first = next(iter(files.values()), path)
    tables = {hour: read_parquet(file) for hour, file in files.items()}
    whole = None if files else read_parquet(path)
    origin = read_metadata(first)
    if not {"kind", "site"} <= origin.keys():
        raise DataError(f"{first}: lacks its kind and its site; build it again")
    kind, site = find(origin["kind"]), build(Site, origin["site"])
    if kind.hourly != path.is_dir():
        parts = "one file per hour: give the folder that holds them" if kind.hourly else "one file: give that"
        raise DataError(f"{path}: a map of kind {kind.name} is {parts}")
    if (path / DAY).exists():
        whole = read_parquet(path / DAY)
    return Map(kind.name, site, whole, tables)


def forecast(
    by: Map | str,
    history: Tracks | np.ndarray,
    horizon_s: float | None = None,
    seed: int = 0,
    *,
    k: int | None = None,
    key: Sequence[str] = KEY,
    exits: Map | bool | None = None,
    site: Site | None = None,
    **options: Any,
) -> Futures:
    """Forecast where walkers go, with a map, or with a kind that needs none (`"cvm"`).

    `history` is what has been seen of one or more walkers up to now: `Tracks`, or an array [rows, 3] (several walkers:
    [n, rows, 3]) of t (unix s), x, y (m), one row per time step. The last `site.observed_rows` rows of each are used.
    `k` is the number of futures, `options` are the method's others (`modlhmp kinds NAME`). `exits` says whether
    futures may leave; a map that is sampled needs the ways out for that, a map of kind `exits`. Random numbers depend
    on `seed`, the track's id, and `key`, for which the workflow gives (dataset, method, recording). `site` is the
    map's; give one for a kind without a map.
    `DataError` names the argument, its value and the remedy.
    """
    record, site = (_map_kind(by.kind), _site(site, by.site)) if isinstance(by, Map) else (_free_kind(by), _site(site))
    if record.forecasts is None:
        raise DataError(f"a map of kind {record.name!r} has no forecaster; it serves other methods")
    if not (exits is None or isinstance(exits, bool) or (isinstance(exits, Map) and exits.kind == "exits")):
        raise DataError(f"exits {exits!r}: give True, False, or a map of kind `exits`")
    asked = {"k": k, "exits": None if exits is None else exits is not False}
    given = {**options, **{name: value for name, value in asked.items() if value is not None}}
    ways_out = exits.whole if isinstance(exits, Map) else None
    chosen: Any = check(record.options, given, f"forecast with {record.name}")
    observed = _observed(history, site)
    horizon_s = site.horizon_s if horizon_s is None else horizon_s
    steps = whole_steps("horizon_s", horizon_s, site, LONGEST_S)
    if isinstance(key, str) or not isinstance(key, Sequence) or not all(isinstance(part, str) for part in key):
        raise DataError(f"key {key!r}: give names, such as (dataset, method, recording)")
    if not isinstance(seed, Integral) or isinstance(seed, bool) or seed < 0:
        raise DataError(f"seed {seed!r}: give a whole number of at least 0")
    model = by.model(chosen) if isinstance(by, Map) else None
    ask = forecaster_of(record, model, site, chosen, ways_out)
    keys = stream_keys(observed.track_id, getattr(chosen, "k", 1), int(seed), *key)
    start = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
    return Futures(observed.track_id, observed.t[:, -1], start, ask(observed, steps, keys), site)


def score(futures: Futures, truth: Tracks | np.ndarray, protocol: str = "complete") -> Scores:
    """ADE and FDE of futures at every horizon, under the `complete` or the `paper` protocol (`scoring.protocols`).

    `truth` are the walkers' whole tracks, or positions [n, T, 2] in m at the time steps after t0 (NaN once unknown), in
    the order of the futures. Walkers count up to the end of their truth. The paper protocol's idle filter needs tracks.
    """
    if not isinstance(futures, Futures):
        raise DataError(f"score: futures are {type(futures).__name__}; give what modlhmp.forecast returns")
    if protocol not in PROTOCOLS:
        raise DataError(unknown("score", "protocol", protocol, PROTOCOLS))
    site, (n, _, steps, _) = futures.site, futures.forecast.xy.shape
    idle = np.zeros(n, bool)
    if isinstance(truth, Tracks):
        xy, length, idle = _truth(futures, truth, site, steps)
    else:
        xy = _numbers("truth", truth)
        if xy.ndim != 3 or xy.shape[0] != n or xy.shape[2] != 2:
            raise DataError(
                f"truth of shape {xy.shape}: give [{n}, T, 2], one row per walker of the futures, or Tracks"
            )
        xy = np.concatenate([xy[:, :steps], np.full((n, max(steps - xy.shape[1], 0), 2), np.nan)], axis=1)
        known = np.isfinite(xy).all(axis=2)
        length = np.where(known.all(axis=1), steps, np.argmin(known, axis=1))
        if site.paper_protocol.idle_filter and protocol == "paper":
            raise DataError("truth: the site's paper protocol filters idle tracks, so give whole Tracks as truth")
    counted = np.where(idle, 0, length) if protocol == "paper" else length
    found = score_forecast(futures.forecast, xy, {"paper": np.where(idle, 0, length), "complete": length})
    output = next(name for name, of in found if of == protocol)
    values = found[output, protocol]
    eligible = np.arange(1, steps + 1) <= counted[:, None]
    return Scores(protocol, output, futures.times_s, values["ade"], values["fde"], eligible)


def _site(site: Any, of_map: Site | None = None) -> Site:
    """The site asked for, checked like a dataset file's; beside a map only the map's own."""
    if site is None or site == of_map:
        return of_map or Site()
    if not isinstance(site, Site):
        raise DataError(f"site is {type(site).__name__}; give modlhmp.Site(timezone=..., time_step_s=...)")
    if of_map is not None:
        raise DataError("site: the map has a site of its own, and this one differs from it; leave it out")
    check(Site, as_plain(site), "site")
    check_site(site, "site")
    return site


def _map_kind(name: str) -> Kind:
    record = find(name)
    if not record.has_map:
        maps = [kind.name for kind in all_kinds().values() if kind.has_map]
        raise DataError(f"kind {name!r} is not a map; maps are {', '.join(maps)}")
    return record


def _free_kind(name: str) -> Kind:
    if not isinstance(name, str):
        raise DataError(f"forecast by {type(name).__name__}: give a Map (build_map, load_map) or the name of a kind")
    record = find(name)
    if record.has_map or record.learned or record.forecasts is None:
        raise DataError(f"kind {name!r} cannot forecast by its name alone: give a Map, as build_map makes it")
    return record


def _check_tracks(where: str, tracks: Tracks, site: Site) -> None:
    """Whether it is a track table, sorted, with its rows a time step apart; `DataError`."""
    if not isinstance(tracks, Tracks):
        raise DataError(f"{where}: tracks are {type(tracks).__name__}; give modlhmp.Tracks, as read_tracks makes them")
    for name, values in zip(Tracks._fields, tracks, strict=True):
        wanted = np.integer if name == "track_id" else np.floating
        if not isinstance(values, np.ndarray) or not np.issubdtype(values.dtype, wanted) or values.ndim != 1:
            kind = "whole numbers" if name == "track_id" else "floats"
            raise DataError(f"{where}: column {name} of the tracks: give a 1-d numpy array of {kind}")
        if len(values) != len(tracks.track_id):
            raise DataError(f"{where}: column {name} has {len(values)} rows, track_id has {len(tracks.track_id)}")
    if not np.isfinite(tracks.t).all():
        row = int(np.argmin(np.isfinite(tracks.t)))
        raise DataError(f"{where}: row {row}: t {tracks.t[row]} is not a time in unix s")
    same = np.diff(tracks.track_id) == 0
    apart = np.diff(tracks.t)[same]
    if len(apart) and apart.min() <= 0:
        row = int(np.flatnonzero(same)[apart.argmin()]) + 1
        raise DataError(f"{where}: row {row}: t {tracks.t[row]} is not after the row before; sort by track, then time")
    step = float(np.median(apart)) if len(apart) else site.time_step_s
    if not 0.8 <= step / site.time_step_s <= 1.25:
        raise DataError(
            f"{where}: tracks have a row every {step:g} s, the site's time_step_s is {site.time_step_s:g}; give "
            "read_tracks and Site the same one"
        )


def _observed(history: Tracks | np.ndarray, site: Site) -> Observed:
    """The last rows of each walker, as a forecaster sees them."""
    tracks = history if isinstance(history, Tracks) else _from_array(history)
    _check_tracks("history", tracks, site)
    if not len(tracks.t):
        raise DataError("history: it has no rows; is anyone there at that time (t is in unix s)?")
    bounds, seen = tracks.bounds(), site.observed_rows
    counts = np.diff(bounds)
    if counts.min() < seen:
        track = tracks.track_id[bounds[counts.argmin()]]
        raise DataError(
            f"history: walker {track} has {counts.min()} rows; observed_rows of the site is {seen}; "
            f"leave such walkers out, as Tracks.seen_by(t, rows={seen}) does"
        )
    rows = bounds[1:, None] - np.arange(seen, 0, -1)
    if np.diff(tracks.t[rows], axis=1).max() > MAX_GAP_S:
        raise DataError(f"history: a gap of more than {MAX_GAP_S:g} s in the last {seen} rows of a walker")
    if not (np.isfinite(tracks.x[rows]).all() and np.isfinite(tracks.y[rows]).all()):
        raise DataError(f"history: a position in the last {seen} rows of a walker is not a number")
    if site.velocity == "as_recorded" and not np.isfinite(tracks.speed[rows]).all():
        raise DataError("history: the site's velocity is as_recorded, but rows lack speeds; use velocity=`differences`")
    nobody = np.empty((len(rows), 0, seen, 2))
    return Observed(tracks.track_id[rows[:, 0]], *(column[rows] for column in tracks[1:]), nobody)  # type: ignore[call-arg]


def _from_array(history: np.ndarray) -> Tracks:
    """Tracks of an array [rows, 3] or [n, rows, 3] of t, x, y; walkers are numbered from 0."""
    array = _numbers("history", history)
    if array.ndim == 2:
        array = array[None]
    if array.ndim != 3 or array.shape[2] != 3:
        raise DataError(f"history of shape {array.shape}: give Tracks, or [rows, 3] of t, x, y (several: [n, rows, 3])")
    flat = array.reshape(-1, 3)
    unknown_velocity = np.full(len(flat), np.nan)
    return Tracks(np.repeat(np.arange(len(array)), array.shape[1]), *flat.T, unknown_velocity, unknown_velocity)  # type: ignore[call-arg]


def _path(where: str, path: Any) -> Path:
    if not isinstance(path, str | PathLike):
        raise DataError(f"{where}: path {path!r}: give a file's path")
    return Path(path)


def _numbers(name: str, values: Any) -> np.ndarray:
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name}: give numbers, all rows equally long ({error})") from None


def _truth(futures: Futures, truth: Tracks, site: Site, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True positions [n, T, 2], how many steps of them [n], and who is idle [n], of the futures' walkers."""
    _check_tracks("truth", truth, site)
    bounds = truth.bounds()
    rows = np.column_stack([bounds[:-1], bounds[1:] - 1])
    of = {int(track): row for track, row in zip(truth.track_id[rows[:, 0]], rows, strict=True)}
    if missing := [int(track) for track in futures.track_id if int(track) not in of]:
        raise DataError(f"truth: walker {missing[0]} of the futures has no track in it")
    rows = np.array([of[int(track)] for track in futures.track_id])
    usable = {int(truth.track_id[first]) for first, _ in usable_tracks(truth, 1)}
    xy, length = np.full((len(rows), steps, 2), np.nan), np.zeros(len(rows), np.int64)
    for number, (first, last) in enumerate(rows):
        at = first + int(np.searchsorted(truth.t[first : last + 1], futures.t0[number] - 1e-6))
        if at > last or abs(truth.t[at] - futures.t0[number]) > 1e-3:
            raise DataError(f"truth: track {truth.track_id[first]} has no row at t0 = {futures.t0[number]:.3f}")
        if int(truth.track_id[first]) in usable:
            found, seconds = ground_truth(truth, np.array([[at, last]]), 1, steps, site.time_step_s)
            xy[number], length[number] = found[0], seconds[0]
    idle_filter, idle = site.paper_protocol.idle_filter, np.zeros(len(rows), bool)
    if idle_filter:
        idle = is_idle(truth, rows, idle_filter.rows, idle_filter.min_displacement_m)
    return xy, length, idle
