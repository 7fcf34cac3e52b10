"""`modlhmp export-task`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from modlhmp.cli.app import DATA_ROOT, DataRoot, app
from modlhmp.cli.inputs import check_folder


@app.command()
def export_task(
    dataset: Annotated[Path, typer.Argument(metavar="DATASET", help="A dataset file (.yaml).")],
    to: Annotated[Path, typer.Option(metavar="FOLDER", help="Where the files go.")],
    data_root: DataRoot = DATA_ROOT,
    split: Annotated[
        Literal["test", "validation", "train"],
        typer.Option(help="Whose tracks; validation as `evaluate_on: validation` has it."),
    ] = "test",
    form: Annotated[
        Literal["csv", "parquet", "ndjson"], typer.Option(help="Of the files; ndjson: TrajNet++'s lines.")
    ] = "csv",
    neighbours: Annotated[
        bool, typer.Option("--neighbours", help="Also who else was near; that gives away other tasks' futures.")
    ] = False,
    training: Annotated[
        bool, typer.Option("--training", help="Also the training tracks; not with `--split train`.")
    ] = False,
    forecasts: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Also these forecasts of a run, in the form of a hand-in."),
    ] = None,
) -> None:
    """Write what is seen of each test track up to t0, and nothing of its future: a task for anyone's predictor.

    \b
      modlhmp export-task config/datasets/atc.yaml --to atc-task --training
      modlhmp export-task config/datasets/demo_hall.yaml --data-root resources/demo/demo --to task \\
          --forecasts results/demo/demo_hall/forecasts/cvm

    Ids are renewed and shuffled, times are seconds before t0. task.json has the task's hash, which a hand-in must
    name. What to hand in, and how it is scored: docs/your-predictor.md.
    """
    check_folder("--to", to, "a task")
    from modlhmp.tasks import export_task as export  # noqa: PLC0415 - other commands need none of it

    task, files = export(
        dataset, to, data_root, split=split, form=form, neighbours=neighbours, training=training, forecasts=forecasts
    )
    typer.echo(f"{task.about['tasks']} tracks of {task.about['dataset']}, task {task.about['task']}", err=True)
    typer.echo(f"Written: {', '.join(map(str, files))}", err=True)
