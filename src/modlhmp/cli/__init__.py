"""The command `modlhmp`: thin over the names of the library."""

import os
import signal
import sys

import typer

from modlhmp.cli import forecast, inspect, kinds, live, map, map_update, score, task  # noqa: F401 - each adds its verbs
from modlhmp.cli.app import app
from modlhmp.storage import DataError


def main() -> None:
    """Run the command; an error of ours, or of the file system, is one line, and a reader that goes is no error."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so services end: as by Ctrl-C, all is tidied up
    try:
        try:
            app()
        except SystemExit as ended:  # typer's own, with status 1 where the reader of a pipe has gone
            if isinstance(ended.__context__, BrokenPipeError):
                raise ended.__context__ from None
            raise
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # for what is still to be written when Python ends
        raise SystemExit(0) from None
    except OSError as error:
        typer.echo(f"{error.filename}: {error.strerror}" if error.filename else str(error), err=True)
        raise SystemExit(1) from None
    except DataError as error:
        typer.echo(str(error), err=True)
        raise SystemExit(1) from None
