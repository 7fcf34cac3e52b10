"""The program `modlhmp` and its version; each verb stands in a module beside this one."""

import os
from pathlib import Path
from typing import Annotated

import typer

from modlhmp.version import __version__

app = typer.Typer(  # without rich, whose help writes `<bool>` beside every flag
    help="Maps of dynamics and long-term human motion prediction.\n\nStart: modlhmp inspect FILE > site.yaml",
    no_args_is_help=True,
    rich_markup_mode=None,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"modlhmp {__version__}")
        raise typer.Exit


def _at_home(folder: Path) -> Path:
    return Path(os.path.expanduser(folder))


DataRoot = Annotated[  # of every verb that takes a dataset file; its default is `DATA_ROOT`
    Path,
    typer.Option(
        "--data-root", metavar="FOLDER", envvar="MODLHMP_DATA", help="Folder of a dataset file's recordings.",
        callback=_at_home,
    ),
]  # fmt: skip
DATA_ROOT = Path("data")
SetOption = Annotated[  # of every verb that takes options of a kind; `inputs.named_values` reads it
    list[str] | None,
    typer.Option("--set", "--option", metavar="NAME=VALUE", help="An option, as `modlhmp kinds NAME` lists them."),
]


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Maps of dynamics and long-term human motion prediction."""
