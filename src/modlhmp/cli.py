"""The command `modlhmp`: thin over the names of the library."""

import os
from pathlib import Path
from typing import Annotated

import typer

from modlhmp import __version__
from modlhmp.kinds import Kind, all_kinds, find
from modlhmp.settings import fields_of
from modlhmp.storage import DataError

app = typer.Typer(  # without rich, whose help writes `<bool>` beside every flag
    help="Maps of dynamics and long-term human motion prediction.", no_args_is_help=True, rich_markup_mode=None
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"modlhmp {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Maps of dynamics and long-term human motion prediction."""


@app.command()
def kinds(name: Annotated[str, typer.Argument(hidden=True, metavar="NAME")] = "") -> None:
    """List the kinds of maps, predictors and networks, also other packages'; or the options of the kind NAME."""
    if name:
        return _describe(find(name))
    for kind in all_kinds().values():
        what = "map" if kind.has_map else "network" if kind.learned else "predictor"
        what += ", one per hour" if kind.hourly else ""
        typer.echo(f"{kind.name:<14} {kind.title:<14} {what}")
    return None


@app.command()
def inspect(
    what: Annotated[Path, typer.Argument(metavar="FILE|DATASET", help="A recording, or a dataset file (.yaml).")],
    data_root: Annotated[
        Path | None, typer.Option(help="Folder of the recordings [default: MODLHMP_DATA, or data]")
    ] = None,
    to: Annotated[Path, typer.Option(help="Folder for the picture and the page.")] = Path(),
) -> None:
    """Look at a recording before any run: what it is, what looks wrong; of a FILE, draft its dataset file.

    The draft goes to the output, everything else beside it. Status 1: it could not be read, or a run would stop.
    """
    from modlhmp.inspection import inspect_dataset, inspect_file  # noqa: PLC0415 - other commands need none of it

    root = data_root or Path(os.environ.get("MODLHMP_DATA") or "data").expanduser()
    is_dataset = what.suffix in {".yaml", ".yml"}
    found = inspect_dataset(what, root) if is_dataset else inspect_file(what, root)
    files = found.write(to, what.stem)
    typer.echo(found.summary(), err=True)
    typer.echo(f"Written: {', '.join(map(str, files))}", err=True)
    if found.draft:
        typer.echo(found.draft, nl=False)
    if is_dataset and found.stops:
        raise typer.Exit(1)


def _describe(kind: Kind) -> None:
    typer.echo(f"{kind.name}: {kind.title}")
    for heading, cls in (("Its map is built with", kind.building), ("It forecasts with", kind.options)):
        rows = fields_of(cls) if cls is not None else []
        if rows:
            typer.echo(f"\n{heading}")
        for option, of, default, meaning in rows:
            typer.echo(f"  {option} = {default!r} ({of})\n      {meaning}")


def main() -> None:
    """Run the command; an error of ours is one line."""
    try:
        app()
    except DataError as error:
        typer.echo(str(error), err=True)
        raise SystemExit(1) from None


if __name__ == "__main__":
    main()
