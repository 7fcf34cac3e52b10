"""`modlhmp inspect`."""

from pathlib import Path
from typing import Annotated

import typer

from modlhmp.cli.app import DATA_ROOT, DataRoot, app
from modlhmp.cli.inputs import check_folder, is_dataset


@app.command()
def inspect(
    what: Annotated[
        Path,
        typer.Argument(metavar="FILE|FOLDER|DATASET", help="A recording, a folder of them, a dataset file (.yaml)."),
    ],
    data_root: DataRoot = DATA_ROOT,
    to: Annotated[Path, typer.Option(help="Folder for the picture and the page.")] = Path(),
) -> None:
    """Look at a recording before any run: what it is, what looks wrong; of a FILE or FOLDER, draft its dataset file.

    \b
      modlhmp inspect monday.csv > monday.yaml
      modlhmp inspect monday.yaml --data-root . --to looked

    The draft goes to the output, everything else beside it. Status 1: it could not be read, or a run would stop.
    """
    check_folder("--to", to, "where the picture and the page go")
    from modlhmp.inspection import inspect_dataset, inspect_file  # noqa: PLC0415 - other commands need none of it

    of_dataset = is_dataset(what)
    found = inspect_dataset(what, data_root) if of_dataset else inspect_file(what, data_root)
    files = found.write(to, what.resolve().stem)
    typer.echo(found.summary(), err=True)
    typer.echo(f"Written: {', '.join(map(str, files))}", err=True)
    if found.draft:
        typer.echo(found.draft, nl=False)
    if of_dataset and found.stops:
        raise typer.Exit(1)
