"""The command `modlhmp`: thin over the names of the library."""

import typer

from modlhmp.cli import inspect, kinds, live  # noqa: F401 - each adds its verbs
from modlhmp.cli.app import app
from modlhmp.storage import DataError


def main() -> None:
    """Run the command; an error of ours is one line."""
    try:
        app()
    except DataError as error:
        typer.echo(str(error), err=True)
        raise SystemExit(1) from None
