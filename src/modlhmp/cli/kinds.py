"""`modlhmp kinds`."""

from typing import Annotated

import typer

from modlhmp.cli.app import app
from modlhmp.kinds import Kind, all_kinds, find
from modlhmp.settings import fields_of


@app.command()
def kinds(name: Annotated[str, typer.Argument(hidden=True, metavar="NAME")] = "") -> None:
    """List the kinds of maps, predictors and networks, also other packages'; or the options of the kind NAME.

    \b
      modlhmp kinds
      modlhmp kinds snippets
    """
    if name:
        return _describe(find(name))
    for kind in all_kinds().values():
        what = "map" if kind.has_map else "network" if kind.learned else "predictor"
        what += ", one per hour" if kind.hourly else ""
        typer.echo(f"{kind.name:<16} {kind.title:<23} {what}")
    return None


def _describe(kind: Kind) -> None:
    typer.echo(f"{kind.name}: {kind.title}")
    for heading, cls in (("Its map is built with", kind.building), ("It forecasts with", kind.options)):
        rows = fields_of(cls) if cls is not None else []
        if rows:
            typer.echo(f"\n{heading}")
        for option, of, default, meaning in rows:
            typer.echo(f"  {option} = {default!r} ({of})\n      {meaning}")
