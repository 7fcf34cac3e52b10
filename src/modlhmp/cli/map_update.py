"""`modlhmp map update`."""

from pathlib import Path
from typing import Annotated

import typer

from modlhmp import api
from modlhmp.arguments import site_from, site_of_tracks
from modlhmp.cli.app import DATA_ROOT, DataRoot, SetOption
from modlhmp.cli.inputs import check_file, is_dataset, named_values
from modlhmp.cli.map import TimezoneOption, _say, _summary, check_name, check_zone, maps
from modlhmp.datasets import load_dataset
from modlhmp.exchange.maps import tell_of_zone
from modlhmp.kinds import find
from modlhmp.recordings import clean
from modlhmp.settings import as_plain
from modlhmp.site import Site
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks
from modlhmp.updates import UpdatedMap

HERE = {"kind": "--kind", "half_life_h": "--half-life", "site": "--timezone, or the dataset file"}


@maps.command()
def update(
    state: Annotated[
        Path, typer.Argument(metavar="STATE", help="What the map holds (.parquet); made where there is none.")
    ],
    tracks: Annotated[
        list[Path] | None, typer.Argument(metavar="TRACKS", help="Clean tracks (.parquet) or dataset files (.yaml).")
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(metavar="KIND", help="Of a new map: tc_cliff, stef, episodes, snippets, exits [default: cliff]"),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", metavar="PATH", help="Where the map is written out.")] = None,
    half_life: Annotated[
        float | None, typer.Option(metavar="H", help="Let what was seen so many hours ago count half; inf: all.")
    ] = None,
    merge: Annotated[list[Path] | None, typer.Option(metavar="STATE", help="Add what another map holds.")] = None,
    remove_day: Annotated[
        list[str] | None, typer.Option(metavar="DATE", help="Take out a day of the place, before anything is added.")
    ] = None,
    options: SetOption = None,
    data_root: DataRoot = DATA_ROOT,
    timezone: TimezoneOption = None,
) -> None:
    """Keep a map up to date: add tracks, merge maps, remove days, and write it out for forecasts.

    \b
    modlhmp map update hall.state.parquet monday.parquet --timezone Asia/Tokyo --out hall.parquet
    modlhmp map update hall.state.parquet tuesday.parquet --half-life 12 --out hall.parquet
    modlhmp map update hall.state.parquet --merge other-robot.state.parquet --remove-day 2012-10-24
    modlhmp map update steps.state.parquet monday.parquet --kind episodes --out steps.parquet

    Tracks may come in any order, in pieces of any size, and twice; a file's name, without its ending, names the
    recording whose ids they have. A new map that others are merged into, without tracks, is of the first one's kind,
    site and options, and forgets nothing. What equals what is in docs/updated-maps.md.
    """
    if not (tracks or merge or remove_day or out or half_life is not None):
        raise DataError(f"{state}: nothing to do: give tracks, --merge, --remove-day, --half-life or --out")
    check_file("STATE", state, ".parquet")
    kept = _begun(state, bool(tracks), merge, kind, options, timezone)
    if tracks and all(map(is_dataset, tracks)) and not kept:
        check_zone(timezone, tracks[0])
    if out is not None:
        check_name("--out", kept.kind if kept else kind or "cliff", out)
    place = kept.site if kept else timezone or "UTC"
    walked = _walked(tracks or [], data_root, place)
    site = walked[0][2] if walked else Site(timezone=timezone or "UTC")
    if not kept and timezone is None and find(kind or "cliff").hourly and not all(map(is_dataset, tracks or [])):
        tell_of_zone(state, "update")
    kept = kept or UpdatedMap(kind or "cliff", site, **named_values(options, HERE))
    for day in remove_day or []:
        _say(f"{state}: {kept.remove(day=day)} rows of {day} removed")
    for other in merge or []:
        _say(f"{state}: {other} merged, {kept.merge(UpdatedMap.load(other))} rows of it were there")
    _add(kept, walked, state)
    if half_life is not None:
        kept.forget(None if half_life == float("inf") else half_life)
    kept.save(state)
    if out is not None:
        _write(kept, out)


def _begun(
    state: Path, told: bool, merge: list[Path] | None, kind: str | None, options: list[str] | None, timezone: str | None
) -> UpdatedMap | None:
    """What a state holds, or an empty map like the first that is merged into a new one; None if tracks make it."""
    if state.exists():
        return _kept(state, kind, options, timezone)
    if told:
        return None
    if not merge:
        raise DataError(f"{state}: no such file; give tracks or --merge for a new map")
    first = _kept(merge[0], kind, options, timezone)
    return UpdatedMap(first.kind, first.site, **first.building)


def _kept(state: Path, kind: str | None, options: list[str] | None, timezone: str | None) -> UpdatedMap:
    """What a state holds; `DataError` for what cannot be said of it any more."""
    kept = UpdatedMap.load(state)
    if kind not in (None, kept.kind) or options:
        raise DataError(f"{state}: it is a map of kind {kept.kind} with options of its own; leave --kind and --set out")
    if timezone not in (None, kept.site.timezone):
        raise DataError(f"--timezone {timezone}: the map {state} is of {kept.site.timezone}; leave it out")
    return kept


def _write(kept: UpdatedMap, out: Path) -> None:
    """Write a map out for forecasts, and say where it has to wait for its hours."""
    written = kept.written()
    written.save(out)
    _say(f"{out}: {_summary(written)}")
    if (listed := kept.site.listed_hours) and find(kept.kind).hourly and not written.hours:
        hours = ", ".join(map(str, listed))
        _say(f"{out}: none of the hours {hours} of its site yet: nobody was seen in them, or too few")


def _add(kept: UpdatedMap, walked: list[tuple[str, Tracks, Site]], state: Path) -> None:
    """Tell a map of recordings of its site."""
    for name, rows, site in walked:
        if (site.timezone, site.time_step_s) != (kept.site.timezone, kept.site.time_step_s):
            raise DataError(
                f"{name}: time zone {site.timezone}, time step {site.time_step_s:g} s: the map {state} has "
                f"{kept.site.timezone} and {kept.site.time_step_s:g} s"
            )
        _say(f"{name}: {kept.add(rows, name)}")


def _walked(files: list[Path], data_root: Path, of: Site | str) -> list[tuple[str, Tracks, Site]]:
    """The `_recordings` of several files; `DataError` where two have one name."""
    walked = [one for file in files for one in _recordings(file, data_root, of)]
    if len({name for name, _, _ in walked}) < len(walked):
        raise DataError("two recordings have the same name, by which their persons are known: rename a file")
    return walked


def _recordings(file: Path, data_root: Path, of: Site | str) -> list[tuple[str, Tracks, Site]]:
    """(name, tracks, site) of a clean recording at a site, or in a time zone, or of a dataset's training recordings."""
    if file.suffix == ".parquet":
        rows = api.read_tracks(file)
        return [(file.stem, rows, of if isinstance(of, Site) else site_of_tracks(str(file), rows, timezone=of))]
    if not is_dataset(file):
        raise DataError(f"{file}: describe it first: modlhmp inspect {file} > {file.stem}.yaml")
    dataset = load_dataset(file, data_root)
    site = site_from(as_plain(dataset), str(file))
    return [(one.name, clean(dataset, one), site) for one in dataset.of_split("train")]
