"""The command `modlhmp`: thin over the names of the library."""

import typer

from modlhmp.cli import forecast, inspect, kinds, live, map, map_update, score, task  # noqa: F401 - each adds its verbs
from modlhmp.cli.app import app
from modlhmp.storage import DataError


def main() -> None:
    """Run the command; an error of ours, or of the file system, is one line."""
    try:
        app()
    except OSError as error:
        typer.echo(f"{error.filename}: {error.strerror}" if error.filename else str(error), err=True)
        raise SystemExit(1) from None
    except DataError as error:
        typer.echo(str(error), err=True)
        raise SystemExit(1) from None
