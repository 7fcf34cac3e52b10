"""`modlhmp score`."""

import csv
import dataclasses
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from modlhmp.cli.app import DATA_ROOT, DataRoot, app
from modlhmp.cli.inputs import SAME, file_of, is_dataset, read_walkers
from modlhmp.storage import DataError
from modlhmp.tracks import shown_s


@app.command()
def score(
    forecasts: Annotated[
        str,
        typer.Argument(metavar="FORECASTS", help="A table, .csv or .parquet, - a stream; or a folder of a hand-in."),
    ],
    tracks: Annotated[
        str, typer.Option(metavar="FILE", help="What people did: their whole tracks; of a hand-in the dataset file.")
    ],
    path: Annotated[
        Literal["likeliest", "mean", "geometric_median"] | None,
        typer.Option(help="How one path comes out of several samples; a hand-in says it itself [default: likeliest]"),
    ] = None,
    time_step: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Of the forecasts, where their file does not say it.")
    ] = None,
    data_root: DataRoot = DATA_ROOT,
    split: Annotated[
        Literal["test", "validation", "train"] | None,
        typer.Option(help="Of a hand-in: what of the dataset file was exported [default: test]"),
    ] = None,
) -> None:
    """Score forecasts against what people did, under both protocols, or check a hand-in before a run.

    \b
      modlhmp score futures.csv --tracks monday.csv
      modlhmp score theirs/ --tracks config/datasets/atc.yaml --data-root ~/recordings
      modlhmp forecast --map cvm --tracks monday.csv --at 1351040400 | modlhmp score - --tracks monday.csv

    The output is a table: protocol, output, horizon_s, ade_m, fde_m, n, eligible. n people of those eligible, who were
    there for so long, are scored. Under `complete` all are, ended forecasts being held; under `paper` those whose
    forecast had not ended. docs/command-line.md has the forms and the exit codes.
    """
    writer = csv.writer(sys.stdout, lineterminator="\n")
    if Path(forecasts).is_dir():
        if not is_dataset(tracks):
            raise DataError(
                f"--tracks {tracks}: {forecasts} is a folder, so a hand-in: give the dataset file that its task was "
                "exported from (.yaml)"
            )
        for option, value in (("--path", path), ("--time-step", time_step)):
            if value is not None:
                raise DataError(f"{option} {value}: the hand-in {forecasts} says that itself; leave it out")
        from modlhmp.tasks import Row, score_hand_in  # noqa: PLC0415 - other commands need none of it

        handed, rows = score_hand_in(forecasts, tracks, data_root, split or "test")
        typer.echo(handed.coverage(), err=True)
        writer.writerow(Row._fields)
        writer.writerows((*row[:2], *(f"{one:.6g}" for one in row[2:])) for row in rows)
        return
    if split is not None:
        raise DataError(
            f"--split {split}: of a hand-in, a folder; {forecasts} is scored against all tracks: leave it out"
        )
    scored = list(_scores(forecasts, tracks, path or "likeliest", time_step, data_root))
    writer.writerow(("protocol", "output", "horizon_s", "ade_m", "fde_m", "n", "eligible"))
    for protocol, output, horizon_s, found in scored:
        numbers = (horizon_s, found["ade_m"], found["fde_m"], found["n"], found["eligible"])
        writer.writerow((protocol, output, *(f"{one:.6g}" for one in numbers)))


def _scores(forecasts: str, tracks: str, path: Any, time_step_s: float | None, data_root: Path) -> Any:
    """(protocol, output, horizon, means) of a table of forecasts of tracks."""
    import numpy as np  # noqa: PLC0415

    import modlhmp  # noqa: PLC0415
    from modlhmp.exchange.forecasts import forecast_of, read_long, rows_of, samples_of, step_said  # noqa: PLC0415
    from modlhmp.scoring.horizons import scored_horizons  # noqa: PLC0415
    from modlhmp.scoring.protocols import PROTOCOLS  # noqa: PLC0415

    if time_step_s is not None and not 0 < time_step_s < np.inf:
        raise DataError(f"--time-step {time_step_s:g}: give the seconds between two steps, above 0")
    if forecasts.endswith(".ndjson"):
        raise DataError(f"{forecasts}: TrajNet++'s lines have no clock and cannot be scored: write CSV or Parquet")
    with file_of(forecasts) as (file, shown):
        try:
            table = read_long(file)
            if not len(table):
                raise DataError(f"{shown}: it has no forecasts")
            said_s = step_said(table, file)
            if said_s and time_step_s and abs(time_step_s / said_s - 1) > SAME:
                raise DataError(f"--time-step {time_step_s:g}: a step of {shown} is {said_s:g} s; leave it out")
            time_step_s = time_step_s or said_s
            in_doubt = f"{shown} does not say how long its steps are: give --time-step, that of the forecasts"
            truth, owners, _, site = read_walkers(tracks, time_step_s, data_root, in_doubt)
            time_step_s = time_step_s or site.time_step_s
            samples = samples_of(rows_of(table, time_step_s, file), file)
        except DataError as error:
            raise DataError(str(error).replace(str(file), shown)) from None
    bounds = truth.bounds()
    number = {owners.get(one, str(one)): one for one in truth.track_id[bounds[:-1]].tolist()}
    names = [samples.name(place) for place in range(len(samples.t0))]
    start = np.array([
        _start(truth, number, samples, place, shown, tracks) for place in range(len(names))
    ])  # fmt: skip
    samples = samples._replace(track_id=np.array([number[name] for name in names], np.int64))
    end = dict(zip(truth.track_id[bounds[:-1]].tolist(), truth.t[bounds[1:] - 1].tolist(), strict=True))
    if all(end[whose] <= t0 + 1e-3 for whose, t0 in zip(samples.track_id.tolist(), samples.t0.tolist(), strict=True)):
        raise DataError(
            f"{shown}: no forecast has a future in {tracks}: each begins at the last row of its track, so there is "
            "nothing to score; forecast an earlier moment, `modlhmp forecast --at SECONDS`, or give tracks that go on"
        )
    steps = int(samples.steps.max())
    site = dataclasses.replace(site, time_step_s=time_step_s, horizon_s=steps * time_step_s)
    forecast = forecast_of(samples, np.arange(len(start)), start, steps, path)
    futures = modlhmp.Futures(samples.track_id, samples.t0, start, forecast, site)
    for protocol in PROTOCOLS:
        found = modlhmp.score(futures, truth, protocol)
        for horizon_s in scored_horizons(None, site):
            yield protocol, found.output, horizon_s, found.at(horizon_s)


def _start(
    truth: Any, number: dict[str, int], samples: Any, place: int, shown: str, tracks: str
) -> tuple[float, float]:
    """Where the person of a forecast was at t0; `number` are the tracks of `truth` by their owners' ids."""
    import numpy as np  # noqa: PLC0415

    from modlhmp.ids import as_written  # noqa: PLC0415

    where = f"{shown}, row {samples.line[place]}: track {samples.name(place)}"
    whose = number.get(samples.name(place))
    if whose is None:
        remedy = as_written(samples.name(place), number) or "; are they of the same recording?"
        raise DataError(f"{where}: nobody of that id is in {tracks}{remedy}")
    mine = np.flatnonzero(truth.track_id == whose)
    row = mine[np.abs(truth.t[mine] - samples.t0[place]).argmin()]
    if abs(truth.t[row] - samples.t0[place]) > 1e-3:
        raise DataError(
            f"{where}: t0 {shown_s(samples.t0[place])}: that track has no row then in {tracks} (the nearest is at "
            f"{shown_s(truth.t[row])}); t0 is the time of a person's last observed row"
        )
    return truth.x[row], truth.y[row]
