"""The library's front door: read tracks, build and load maps, forecast, score. Every name here is one of `modlhmp`."""

import functools
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from modlhmp.arguments import (
    checked_site,
    free_kind,
    last_rows,
    map_kind,
    numbers,
    path_of,
    site_from,
    site_of,
    tracks_of,
    truth_of,
    uses_recorded,
)
from modlhmp.cleaning import check_rules, clean_recording, tell_of_faults
from modlhmp.exchange.maps import read_tables, tell_of_zone, write_tables
from modlhmp.exchange.parquet import PARQUET, TEXTS, check_one_form, is_parquet, read_ours
from modlhmp.file_format import FileFormat, Recording, check_format
from modlhmp.forecasting.base import Forecaster
from modlhmp.forecasting.observe import Observed
from modlhmp.futures import Futures, Scores, whole_steps
from modlhmp.kinds import find
from modlhmp.maps.base import DAY, box_of, check_box, hour_files
from modlhmp.methods import build_map as build_tables
from modlhmp.methods import forecaster_of, model_of
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.protocols import score as score_forecast
from modlhmp.settings import as_plain, check, unknown
from modlhmp.site import Site
from modlhmp.storage import DataError, boundary, write_parquet
from modlhmp.streams import stream_keys
from modlhmp.tracks import Tracks, clock_hours
from modlhmp.tracks import read_tracks as read_clean_tracks

KEY = ("modlhmp", "forecast", "")  # takes the place of (dataset, method, recording) in the random numbers
MOST_POSITIONS = 500_000_000  # of a forecast; more would not fit in memory
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
    those of one `split`; they lie under `data_root` (default: the file's folder; `MODLHMP_DATA` is not asked), and
    where two share a track id all get others. Faulty rows are dropped, and a warning of the logger `modlhmp` counts
    them and shows the first.
    `DataError` names the file, the row or option, the value and the remedy.
    """
    path = path_of("read_tracks", path)
    suffix, is_dataset = path.suffix, path.suffix in {".yaml", ".yml"}
    asked = {"day": day, "start": start, "data_root": data_root, "split": split, **form}
    taken = {"data_root", "split"} if is_dataset else set() if suffix == ".parquet" else {"day", "start", *form}
    if unused := [name for name, value in asked.items() if value is not None and name not in taken]:
        of = "a dataset file says that itself" if is_dataset else f"it does not apply to a file {suffix or 'as this'}"
        raise DataError(f"read_tracks: {path}: {unused[0]}={asked[unused[0]]!r}: {of}; leave it out")
    if suffix == ".parquet":
        return read_clean_tracks(path)
    if is_dataset:
        from modlhmp.datasets import load_dataset  # noqa: PLC0415 - only dataset files need it
        from modlhmp.recordings import clean_all  # noqa: PLC0415

        root = path.parent if data_root is None else path_of("read_tracks, data_root", data_root)
        dataset = load_dataset(path, root)
        if split not in (None, *(one.split for one in dataset.recordings)):
            raise DataError(f"read_tracks: {path}: split {split!r}: it has `train` and `test`")
        return clean_all(dataset, split)[0]
    columns = form.get("columns")
    by_name = isinstance(columns, Mapping) and any(isinstance(column, str) for column in columns.values())
    if day is not None and not (isinstance(day, str) and day):
        raise DataError(f"read_tracks: day {day!r}: give an ISO date such as '2012-10-24'")
    described = check(FileFormat, {"header": by_name, **form}, "read_tracks")
    if described.reader == "delimited" and described.columns is None:
        raise DataError(f'read_tracks: {path}: say which `columns` hold what, such as columns={{"track_id": 0, ...}}')
    if described.file_is == "person":
        raise DataError(f"read_tracks: {path}: file_is: many files of one person each are described by a dataset file")
    check_format(described, "read_tracks")
    check_rules(described.cleaning, "read_tracks")
    tracks, account = clean_recording(path, described, Recording(day=day or "", start=start))
    tell_of_faults(path, account)
    return tracks


@dataclass(frozen=True, repr=False)
class Map:
    """A map of dynamics: its `kind`, the `site` it is of, and its tables.

    `whole` is the table of the whole day, `hours` {clock hour: table} those of a kind that has a map per hour.
    """

    kind: str
    site: Site
    whole: pa.Table | None
    hours: dict[int, pa.Table]

    def __post_init__(self) -> None:
        hourly = map_kind(self.kind).hourly
        if self.site is None:
            raise DataError("Map: site is None; give modlhmp.Site(...)")
        hours = self.hours
        if not isinstance(hours, Mapping) or not all(isinstance(hour, Integral) and 0 <= hour < 24 for hour in hours):
            raise DataError("Map: hours: give {clock hour from 0 to 23: pyarrow.Table}")
        object.__setattr__(self, "site", site_of(self.site))
        object.__setattr__(self, "hours", {int(hour): table for hour, table in hours.items()})
        tables = [*self.hours.values(), *([] if self.whole is None else [self.whole])]
        if not all(isinstance(table, pa.Table) for table in tables):
            raise DataError("Map: its tables must be pyarrow.Table")
        if not hourly and (self.whole is None or self.hours):
            raise DataError(f"Map: a map of kind {self.kind} is one table, `whole`")
        if not tables:
            raise DataError(f"Map: a map of kind {self.kind} without a table; give `whole`, `hours` or both")

    def __repr__(self) -> str:
        rows = sum(len(table) for table in (self.whole, *self.hours.values()) if table is not None)
        hours = f", hours {' '.join(map(str, self.hours))}" if self.hours else ""
        return f"<Map: {self.kind}, {rows} rows{hours}, a step {self.site.time_step_s:g} s, {self.site.timezone}>"

    def save(self, path: str | Path, form: str = PARQUET, **how: Any) -> None:
        """Write it to `path`: a Parquet file, or a folder of the hours' files for a kind that has a map per hour.

        A table of the whole day beside the hours is `day.parquet` in that folder. `form` names another form, such as
        `xml` for the ROS tools (`docs/maps.md` lists them, with what each can carry), `how` are its options, such as
        `header=True`. `DataError` where that form cannot carry the map.
        """
        path, hourly = path_of("Map.save", path), find(self.kind).hourly
        if form != PARQUET:
            write_tables(path, self.kind, self.whole, self.hours, form, self.site, **how)
            return
        if path.suffix in TEXTS:
            raise DataError(f"{path}: form parquet under this name; name its form, such as xml, or end in .parquet")
        if how:
            raise DataError(f"Map.save: {next(iter(how))}: form parquet has no options; leave it out")
        files: dict[Path, tuple[pa.Table, dict[str, int]]] = {}
        if hourly and path.exists() and not path.is_dir():
            raise DataError(f"{path}: a file is there; a map of kind {self.kind} is a folder, so give another name")
        if not hourly and path.is_dir():
            raise DataError(f"{path}: a folder is there; a map of kind {self.kind} is a file, so give another name")
        if hourly:
            check_one_form(path, f".{PARQUET}")
        if self.whole is not None:
            files[path / DAY if hourly else path] = self.whole, {}
        files |= {path / f"{hour:02d}.parquet": (table, {"hour": hour}) for hour, table in self.hours.items()}
        try:
            for file, (table, of) in files.items():
                write_parquet(table, file, kind=self.kind, site=as_plain(self.site), **of)
        except OSError as error:
            raise DataError(f"{path}: cannot be written ({error})") from None
        if hourly and path.is_dir():  # hours of a map that lay there before are not this one's
            for file in {*hour_files(path).values(), path / DAY} - files.keys():
                file.unlink(missing_ok=True)

    def model(self, options: Any) -> Any:
        """The map ready to be asked with a method's options."""
        return model_of(self.kind, self.whole, self.hours, self.site, options)


def build_map(kind: str, tracks: Tracks, site: Site | None = None, **building: Any) -> Map:
    """Build a kind of map from tracks: `cliff`, `stef`, `episodes`, `snippets`, `pooled` ..., or of another package.

    `site` gives the time zone and the time step (default: UTC, with a warning for a kind by hours, and the step of the
    tracks); `building` are the kind's own options, such as `resolution_m=0.5` (`modlhmp kinds NAME` lists them).
    `DataError` for a wrong kind or option, or tracks whose rows are not a time step apart.
    """
    if not isinstance(kind, str):
        given = type(kind).__name__
        raise DataError(f"kind: {given} given; the kind comes first: build_map('cliff', tracks)")
    record = map_kind(kind)
    options: Any = check(record.building, building, f"build_map({kind!r})")  # type: ignore[arg-type]
    if record.hourly and site is None:
        tell_of_zone(f"build_map({kind!r})", "build")
    site = checked_site("build_map", tracks, site)
    if not (np.isfinite(tracks.x).all() and np.isfinite(tracks.y).all()):
        raise DataError("build_map: a position is not a number; leave such rows out")
    if len(tracks.t) and np.diff(tracks.bounds()).max() < 2:
        raise DataError("build_map: no track has two rows; are the times in the unit that was said (s, ms)?")
    if record.hourly and len(tracks.t) and site.listed_hours:
        seen = np.unique(clock_hours(tracks.t, site.timezone)).tolist()
        if not set(seen) & set(site.listed_hours):
            raise DataError(
                f"build_map({kind!r}): the tracks are of the hours {', '.join(map(str, seen))} of {site.timezone}, of "
                f"which the site's `hours` {list(site.hours or ())} have none; correct the hours, or the time zone"
            )
    try:
        built = Map(kind, site, *build_tables(kind, tracks, site, options))
    except MemoryError:
        raise DataError(f"build_map({kind!r}): not enough memory with {as_plain(options)}") from None
    if record.forecasts and not any(len(table) for table in (built.whole, *built.hours.values()) if table is not None):
        raise DataError(
            f"build_map({kind!r}): the map is empty: in {len(tracks.t)} rows no place has enough of people who move"
        )
    return built


def load_map(
    path: str | Path,
    form: str | None = None,
    *,
    site: Site | None = None,
    origin_m: tuple[float, float] | None = None,
    **how: Any,
) -> Map:
    """Load a map that `Map.save` or the workflow wrote, or a published one in another form (`docs/maps.md`).

        published = modlhmp.load_map("atc-20121024-cliff.csv", site=modlhmp.Site(timezone="Asia/Tokyo"))

    A map is a file, or a folder of hours. `form` is found from the content where that is unmistakable; with a foreign
    form `site` is of the place, `origin_m` moves the map to recordings that were moved so, and `how` are the form's own
    options. What was wrong in a foreign file and could be repaired is logged with counts.
    `DataError` names the file, the row, the value and the remedy.
    """
    path = path_of("load_map", path)
    if not path.exists() and "{hour}" not in path.name:
        raise DataError(f"{path}: no such file; give the file of a map, or its folder of hours")
    if not is_parquet(path, form):
        of_place = site_of(site)
        kind, whole, hours = read_tables(path, form, None if site is None else of_place, origin_m, **how)
        return Map(kind, of_place, whole, hours)
    asked = {"site": site, "origin_m": origin_m, **how}
    if given := [name for name, value in asked.items() if value is not None]:
        raise DataError(f"load_map: {path}: {given[0]}: it holds its site and its frame itself; leave it out")
    with boundary(path, "cannot be read as a map"):
        kind, plain, whole, hours = read_ours(path)
    return Map(kind, site_from(plain, f"{path}: its site"), whole, hours)


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
    map's; of a kind without a map the default has the time step of the history.
    `DataError` names the argument, its value and the remedy.
    """
    if not isinstance(by, Map):
        free_kind(by)
        site = checked_site("history", tracks_of(history), site)
    asked = predictor(by, horizon_s, seed, k=k, key=key, exits=exits, site=site, **options)
    observed = last_rows(history, asked.site, uses_recorded(asked.options, asked.site))
    futures = asked.futures(observed)
    if why := asked.unfit(futures):
        logging.getLogger("modlhmp").warning("forecast: %s", why)
    return futures


@dataclass(frozen=True)
class Predictor:
    """A method ready to forecast at one place, as often as it is asked: with its map loaded and its options checked.

    `names` key the random numbers: the seed, then the names that `forecast` calls `key`.
    """

    site: Site
    options: Any
    steps: int
    names: tuple[object, ...]
    ask: Forecaster
    a_map: Map | None = None

    def futures(self, observed: Observed) -> Futures:
        """The futures of who is observed."""
        k = getattr(self.options, "k", 1)
        if (positions := len(observed.t) * k * self.steps) > MOST_POSITIONS:
            raise DataError(f"k {k}: {len(observed.t)} walkers have {positions:.2g} future positions; ask for fewer")
        found = self.ask(observed, self.steps, stream_keys(observed.track_id, k, *self.names))
        start = np.column_stack([observed.x[:, -1], observed.y[:, -1]])
        return Futures(observed.track_id, observed.t[:, -1], start, found, self.site)

    def unfit(self, futures: Futures) -> str:
        """Why the map knows nobody of these futures: it is of other hours or of another place; "" if neither."""
        if self.a_map is None or not len(futures.t0) or futures.known.any():
            return ""
        hours, zone = self.a_map.hours, self.site.timezone
        asked = np.unique(clock_hours(futures.t0, zone)).tolist()
        by_hours = find(self.a_map.kind).hourly and getattr(self.options, "without_map", "stop") == "stop"
        if by_hours and not hours.keys() & set(asked):
            of, theirs = (", ".join(map(str, sorted(one))) for one in (hours, asked))
            known = f"the map is of the hours {of}" if hours else "it has no map of an hour yet"
            mistake = ": another time zone?" if hours else ""
            remedy = "" if self.a_map.whole is None else '; without_map="whole_day" uses the map of the whole day'
            return f"it knows nobody: {known}, and all walkers are of {theirs} ({zone}){mistake}{remedy}"
        try:
            check_box("it knows nobody", self._box, futures.start)
        except DataError as error:
            return str(error)
        return ""

    @functools.cached_property
    def _box(self) -> np.ndarray | None:
        tables = [] if self.a_map is None else [self.a_map.whole, *self.a_map.hours.values()]
        return box_of([table for table in tables if table is not None])


def predictor(
    by: Map | str,
    horizon_s: float | None = None,
    seed: int = 0,
    *,
    k: int | None = None,
    key: Sequence[str] = KEY,
    exits: Map | bool | None = None,
    site: Site | None = None,
    **options: Any,
) -> Predictor:
    """What `forecast` asks once and `Live` again and again; the arguments are those of `forecast`."""
    record, site = (
        (map_kind(by.kind), site_of(site, by.site)) if isinstance(by, Map) else (free_kind(by), site_of(site))
    )
    if record.forecasts is None:
        raise DataError(f"a map of kind {record.name!r} has no forecaster; it serves other methods")
    if not (exits is None or isinstance(exits, bool) or (isinstance(exits, Map) and exits.kind == "exits")):
        raise DataError(f"exits {exits!r:.120}: give True, False, or a map of kind `exits`")
    asked = {"k": k, "exits": None if exits is None else exits is not False}
    given = {**options, **{name: value for name, value in asked.items() if value is not None}}
    ways_out = exits.whole if isinstance(exits, Map) else None
    chosen: Any = check(record.options, given, f"forecast with {record.name}")
    steps = whole_steps("horizon_s", site.horizon_s if horizon_s is None else horizon_s, site, LONGEST_S)
    if isinstance(key, str) or not isinstance(key, Sequence) or not all(isinstance(part, str) for part in key):
        raise DataError(f"key {key!r}: give names, such as (dataset, method, recording)")
    if not isinstance(seed, Integral) or isinstance(seed, bool) or seed < 0:
        raise DataError(f"seed {seed!r}: give a whole number of at least 0")
    if getattr(chosen, "k", 1) * steps > MOST_POSITIONS:  # before a map is loaded
        raise DataError(f"k {chosen.k}: one walker has {chosen.k * steps:.2g} future positions; ask for fewer")
    model = by.model(chosen) if isinstance(by, Map) else None
    ask = forecaster_of(record, model, site, chosen, ways_out)
    return Predictor(site, chosen, steps, (int(seed), *key), ask, by if isinstance(by, Map) else None)


def score(futures: Futures, truth: Tracks | np.ndarray, protocol: str = "complete") -> Scores:
    """ADE and FDE of futures at every horizon, under the `complete` or the `paper` protocol (`scoring.protocols`).

    `truth` are the walkers' whole tracks, or positions [n, T, 2] in m at the time steps after t0 (NaN once unknown), in
    the order of the futures. Walkers count up to the end of their truth. The paper protocol's idle filter needs tracks.
    """
    if not isinstance(futures, Futures):
        raise DataError(f"score: futures are {type(futures).__name__}; give what modlhmp.forecast returns")
    if not isinstance(protocol, str) or protocol not in PROTOCOLS:
        raise DataError(unknown("score", "protocol", protocol, PROTOCOLS))
    site, (n, _, steps, _) = futures.site, futures.forecast.xy.shape
    idle = np.zeros(n, bool)
    if isinstance(truth, Tracks):
        xy, length, idle = truth_of(futures, truth, site, steps)
    else:
        xy = numbers("truth", truth)
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
