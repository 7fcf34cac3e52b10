"""`modlhmp map`: build, look at, draw, convert and compare maps of dynamics."""

import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pyarrow as pa
import typer

from modlhmp import api, pictures
from modlhmp.cli.app import DATA_ROOT, DataRoot, SetOption, app
from modlhmp.cli.inputs import STREAM, check_file, check_folder, is_dataset, named_values
from modlhmp.exchange import maps as exchange
from modlhmp.exchange.forms import BY_NAME, find_form, recognise
from modlhmp.exchange.parquet import PARQUET
from modlhmp.exchange.rows import read_source, table_text
from modlhmp.kinds import find
from modlhmp.maps import stef
from modlhmp.maps.base import box_of
from modlhmp.maps.columns import METADATA, described
from modlhmp.maps.comparison import compare as compare_flows
from modlhmp.maps.comparison import flows
from modlhmp.site import Site
from modlhmp.storage import DataError, write_text

TABLES = (".csv", ".txt")  # endings of a table's text
OF_BUILD = {"kind": "KIND", "tracks": "TRACKS", "site": "--timezone, or the dataset file"}
OF_LOAD = {"path": "MAP", "form": "--form", "site": "`map convert --timezone`", "origin_m": "`map convert --origin`"}
ANYWHERE = Site()  # of a map of which only places are looked at
maps = typer.Typer(
    help="Build, look at, draw, convert and compare maps of dynamics.\n\n"
    "MAP is a file, a folder of hours, or - for standard input, in any of the forms of docs/maps.md: "
    f"{', '.join([PARQUET, *BY_NAME])}. Reports go to standard error. "
    "Status 0: done; 1: the data are wrong, as the message says; 2: the command is.",
    no_args_is_help=True,
    rich_markup_mode=None,
)
app.add_typer(maps, name="map")

MapArgument = Annotated[str, typer.Argument(metavar="MAP", help="File, folder of hours, or -.")]
FormOption = Annotated[
    str | None, typer.Option("--form", metavar="NAME", help="Form of MAP, where its content does not tell.")
]
TimezoneOption = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Time zone of the place, for maps by hours [default: UTC, with a warning]"),
]
HoursZoneOption = Annotated[
    str | None,
    typer.Option("--timezone", metavar="NAME", help="Time zone of MAP's hours [default: UTC, with a warning]"),
]


@maps.command()
def build(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="cliff, tc_cliff, stef, episodes, snippets, pooled ...")],
    tracks: Annotated[
        Path, typer.Argument(metavar="TRACKS", help="A dataset file (.yaml) or clean tracks (.parquet).")
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="PATH", help="Where the map goes: a file, or a folder for a kind by hours.")
    ],
    options: SetOption = None,
    data_root: DataRoot = DATA_ROOT,
    timezone: TimezoneOption = None,
) -> None:
    """Build a map from tracks: of a dataset file, the training recordings.

    \b
    modlhmp inspect monday.csv > monday.yaml
    modlhmp map build cliff monday.yaml --data-root . --out cliff.parquet
    modlhmp map build cliff monday.yaml --data-root . --out fine.parquet --set resolution_m=0.5
    modlhmp map build tc_cliff results/real/atc/tracks/monday.parquet --timezone Asia/Tokyo --out hours
    """
    check_name("--out", kind, out)
    site: Site | None = None
    if is_dataset(tracks):
        check_zone(timezone, tracks)
        from modlhmp.arguments import site_from  # noqa: PLC0415 - only this needs a dataset file
        from modlhmp.datasets import load_dataset  # noqa: PLC0415
        from modlhmp.settings import as_plain  # noqa: PLC0415

        site = site_from(as_plain(load_dataset(tracks, data_root)), str(tracks))
        walked = api.read_tracks(tracks, data_root=data_root, split="train")
    elif tracks.suffix == ".parquet":
        from modlhmp.arguments import site_of_tracks  # noqa: PLC0415

        walked = api.read_tracks(tracks)
        site = None if timezone is None else site_of_tracks(str(tracks), walked, timezone=timezone)
    else:
        raise DataError(f"{tracks}: describe it first: modlhmp inspect {tracks} > {tracks.stem}.yaml")
    made = api.build_map(kind, walked, site, **named_values(options, OF_BUILD))
    made.save(out)
    _say(f"{out}: {_summary(made)}")


@maps.command()
def info(
    a_map: MapArgument, form: FormOption = None, options: SetOption = None, timezone: HoursZoneOption = None
) -> None:
    """Say what a map is: its kind, where it is, how large, when, and what was wrong in its file.

    \b
    modlhmp map info atc-20121024-cliff.csv
    modlhmp map info hours_of_others --form online
    """
    loaded = _load(a_map, form, _site(timezone), None, options)
    typer.echo(f"kind: {loaded.kind}")
    typer.echo(f"site: {loaded.site.timezone}, time step {loaded.site.time_step_s:g} s")
    if loaded.hours:
        typer.echo(f"hours: {' '.join(map(str, loaded.hours))}")
    for name, table in _tables(loaded):
        facts = [f"{table.num_rows} rows"]
        if "location" in table.column_names:
            facts.append(f"{pa.compute.count_distinct(table['location']).as_py()} locations")
        if (box := box_of([table])) is not None:
            facts.append(f"x {box[0, 0]:.9g} to {box[1, 0]:.9g} m, y {box[0, 1]:.9g} to {box[1, 1]:.9g} m")
        facts += [
            f"{key.decode()} {value.decode()}"
            for key, value in (table.schema.metadata or {}).items()
            if key.decode() in METADATA.keys() - {"imported", "modlhmp"}
        ]
        typer.echo(f"{name}: {', '.join(facts)}")
        if about := exchange.imported(table):
            typer.echo(f"  from {about['file']}, form {about['form']}, SHA-256 {about['sha256'][:12]}...")
            for what, number in about["repaired"].items():
                typer.echo(f"  {number} {what}")
    first = _tables(loaded)[0][1]
    for name in first.column_names:
        unit, meaning = described(first).get(name, ("", ""))
        typer.echo(f"  {name}{f' [{unit}]' if unit else ''}{f': {meaning}' if meaning else ''}")


@maps.command()
def plot(
    a_map: MapArgument,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The picture: .png, .pdf or .svg.")],
    hour: Annotated[int | None, typer.Option(metavar="HOUR", help="Of a map by hours; default: the first.")] = None,
    floor_plan: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A floor plan of map_server (.yaml) to lie beneath.")
    ] = None,
    form: FormOption = None,
    options: SetOption = None,
) -> None:
    """Draw a map: arrows coloured by heading, as long as people walk in a second.

    \b
    modlhmp map plot cliff.parquet --out cliff.png
    modlhmp map plot atc-20121024-cliff.csv --floor-plan atc.yaml --out atc.pdf
    modlhmp map plot hours --hour 18 --out evening.png
    """
    check_file("--out", out, *sorted(pictures.FORMATS))
    loaded = _load(a_map, form, ANYWHERE, None, options)
    name, table = _at_hour(loaded, hour)
    of = [Path(a_map).name, loaded.kind, *([name] if loaded.hours else [])]
    pictures.draw_map(loaded.kind, table, out, ", ".join(of), floor_plan)
    _say(f"Written: {out}")


@maps.command()
def convert(
    a_map: MapArgument,
    out: Annotated[str, typer.Argument(metavar="OUT", help="Where it goes: a file, a folder of hours, or -.")],
    to: Annotated[
        str | None, typer.Option(metavar="NAME", help="The form of OUT [default: parquet; xml for a name with .xml]")
    ] = None,
    form: FormOption = None,
    options: SetOption = None,
    header: Annotated[bool, typer.Option("--header", help="Begin a CSV with the columns' names.")] = False,
    origin: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="X Y", help="Origin of the recordings in MAP's frame [m]; what is written is moved."),
    ] = None,
    timezone: HoursZoneOption = None,
) -> None:
    """Write a map in another form, and say what that form cannot carry.

    \b
    modlhmp map convert atc-20121024-cliff.csv atc.parquet --timezone Asia/Tokyo
    modlhmp map convert cliff.parquet cliff.xml
    modlhmp map convert hours_of_others hours --form online
    modlhmp map convert stef.txt stef --form histogram --set x=-60,80 --set y=-40,20
    cat theirs.csv | modlhmp map convert - - --form online --to matlab > ours.csv
    """
    to = to or ("xml" if out.endswith(".xml") else PARQUET)
    loaded = _load(a_map, form, _site(timezone), origin, options)
    how: dict[str, Any] = {"header": True} if header else {}
    if out != STREAM:
        check_name("OUT", loaded.kind, Path(out), to)
        loaded.save(out, form=to, **how)
        _say(f"{out}: {_summary(loaded)}, form {to}")
    elif to == PARQUET:
        raise DataError("Parquet does not go to standard output: name a file, or another form by --to")
    else:
        texts = exchange.texts(loaded.kind, loaded.whole, loaded.hours, to, loaded.site, **how)
        if list(texts) != [""]:
            raise DataError(f"a map of kind {loaded.kind} is a folder of hours in form {to}: name one")
        sys.stdout.write(texts[""])
    if to in BY_NAME:
        _say(f"Form {to} loses {BY_NAME[to].loses}.")


@maps.command()
def compare(
    ours: Annotated[str, typer.Argument(metavar="MAP", help="File, folder of hours, or -.")],
    theirs: Annotated[str, typer.Argument(metavar="OTHER", help="Another one of the same place.")],
    out: Annotated[
        str | None, typer.Option("--out", metavar="FILE", help="The places that both have, as CSV: a file, or -.")
    ] = None,
    hour: Annotated[
        int | None, typer.Option(metavar="HOUR", help="Of maps by hours; default: the first that both have.")
    ] = None,
    form: FormOption = None,
    other_form: Annotated[str | None, typer.Option(metavar="NAME", help="Form of OTHER, likewise.")] = None,
) -> None:
    """Say how far two maps agree where both have places: which way people walk there, how fast, and how many.

    \b
    modlhmp map compare monday.parquet friday.parquet
    modlhmp map compare cliff.parquet atc-20121024-cliff.csv --out - > places.csv
    """
    if out not in (None, STREAM):
        check_file("--out", out, *TABLES)
    loaded = [_load(path, its, ANYWHERE, None, None) for path, its in ((ours, form), (theirs, other_form))]
    if hour is not None and not any(one.hours for one in loaded):
        raise DataError(f"--hour {hour}: neither map has hours; leave it out")
    shared = [one for one in loaded[0].hours if one in loaded[1].hours]
    hour = shared[0] if hour is None and shared else hour
    named = [_at_hour(one, hour if one.hours else None) for one in loaded]
    found = [flows(one.kind, table) for one, (_, table) in zip(loaded, named, strict=True)]
    places = compare_flows(*found)
    lines = [f"{len(found[0].x)} and {len(found[1].x)} places, {len(places['x'])} of the first near one of the second"]
    if any(one.hours for one in loaded):
        of = [name if one.hours else "all hours" for one, (name, _) in zip(loaded, named, strict=True)]
        lines.insert(0, f"of the map {of[0]}, of the other {of[1]}")
    if len(places["x"]):
        lines += [
            f"direction: {_spread(places['direction'], '')} of the probability goes elsewhere (0: the same, 1: all)",
            f"speed: {_spread(np.abs(places['speed_m_s']), ' m/s')} apart"
            if np.isfinite(places["speed_m_s"]).any()
            else "speed: one of the maps has none",
            f"motion intensity p: {_spread(np.abs(places['p'] - places['p_theirs']), '')} apart"
            if np.ptp(places["p"]) and np.ptp(places["p_theirs"])
            else "motion intensity p: one of the maps has none",
        ]
    typer.echo("\n".join(lines), err=out == STREAM)
    if out is not None:
        text = table_text(list(places.values()), tuple(places))
        sys.stdout.write(text) if out == STREAM else write_text(out, text)


def _load(path: str, form: str | None, site: Site | None, origin: tuple[float, float] | None, options: Any) -> api.Map:
    """The map at a path, or of standard input; `site` is what was said of its place, `ANYWHERE` if no matter."""
    how = named_values(options, OF_LOAD)
    if path != STREAM:
        ours = exchange.is_parquet(path, form)
        if ours and site is not None and site is not ANYWHERE:
            raise DataError(f"--timezone {site.timezone}: {path} says of which time zone its hours are; leave it out")
        return api.load_map(path, form, site=None if ours else site, origin_m=origin, **how)
    source = read_source("standard input", sys.stdin.buffer, exchange.origin_of(origin))
    found = form or recognise(source)
    if found == PARQUET:
        raise DataError("standard input: Parquet is not read from a stream: give the file")
    kind, whole, hours = exchange.read_one(source, found, site, how)
    return api.Map(kind, site or Site(), whole, hours)


def _site(timezone: str | None) -> Site | None:
    return None if timezone is None else Site(timezone=timezone)


def check_zone(timezone: str | None, dataset: Path) -> None:
    """`DataError` where a time zone is said beside a dataset file."""
    if timezone is not None:
        raise DataError(f"--timezone {timezone}: {dataset} has a `timezone` of its own; leave it out, or correct that")


def check_name(option: str, kind: str, path: Path, to: str = PARQUET) -> None:
    """`DataError` where a map of that kind would get a name that says another form; the library takes any."""
    if find(kind).hourly and (to == PARQUET or find_form(to).write is not None):
        check_folder(option, path, f"a map of kind {kind}, one map an hour,")
        return
    suffix = f".{PARQUET}" if to == PARQUET else find_form(to).suffix
    try:
        check_file(option, path, "", *(TABLES if suffix in TABLES else [suffix]))
    except DataError as error:
        raise DataError(f"{error}, as form {to} does; `modlhmp map convert --to` writes others") from None


def _tables(a_map: api.Map) -> list[tuple[str, pa.Table]]:
    """(name, table) of a map's parts."""
    day = [] if a_map.whole is None else [("whole day" if a_map.hours else "map", a_map.whole)]
    return [*day, *((f"hour {hour:02d}", table) for hour, table in a_map.hours.items())]


def _at_hour(a_map: api.Map, hour: int | None) -> tuple[str, pa.Table]:
    """The part of a map for an hour: the map itself of one that has none, else the first or the whole day's."""
    if not a_map.hours:
        if hour is not None:
            raise DataError(f"hour {hour}: a map of kind {a_map.kind} has no hours")
        name, table = _tables(a_map)[0]
        return name, stef.mean_probabilities(table) if a_map.kind == "stef" else table
    hour = next(iter(a_map.hours)) if hour is None else hour
    if hour not in a_map.hours:
        raise DataError(f"hour {hour}: the map has {', '.join(map(str, a_map.hours))}")
    return f"{hour}:00 to {hour + 1}:00", a_map.hours[hour]


def _summary(a_map: api.Map) -> str:
    hours = f", hours {' '.join(map(str, a_map.hours))}" if a_map.hours else ""
    return f"{a_map.kind}, {sum(table.num_rows for _, table in _tables(a_map))} rows{hours}"


def _spread(values: np.ndarray, unit: str) -> str:
    middle, high = np.nanquantile(values, [0.5, 0.9])
    return f"median {middle:.3g}{unit}, 90th percentile {high:.3g}{unit}"


def _say(text: str) -> None:
    typer.echo(text, err=True)
