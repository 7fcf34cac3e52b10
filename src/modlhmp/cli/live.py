"""`modlhmp live`."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from modlhmp.cli.app import SetOption, app
from modlhmp.storage import DataError, no_folder

if TYPE_CHECKING:
    from modlhmp.futures import Futures
    from modlhmp.live import Live

NO_ROW, INTERRUPTED = 3, 130  # of the status
HERE = {"by": "--map", "horizon_s": "--horizon", "recording": "--recording NAME", "key": "", "site": ""}
LEAST_EVERY_S, MOST_EVERY_S = 0.01, 3600.0
HELP = """Forecast people as they are seen: JSON lines in, JSON lines out.

\b
ROWS is a file, or -, the input. A row says when who was where: unix s, any
id, m; any rate, any order.
  {"t": 1351042800.1, "id": 7, "x": 1.5, "y": -3.0}
\b
A forecast has everyone's path and the probability of having left, one
entry for every time step after t0; `new` are those seen too briefly.
  {"t0": 1351042801.0, "step_s": 1.0, "people": [{"id": 7,
   "path": [[2.1, -3.0], ...], "left": [0.0, ...]}], "new": 0}
\b
A recording; and a tracker, twice a second, with cells after 10 and 20 s:
  modlhmp live --map episodes.parquet rows.jsonl > forecasts.jsonl
  tracker | modlhmp live --map episodes.parquet --every 0.5 \\
      --occupancy 10,20 --latest | robot
\b
A map that learns, at every full hour, from who is seen:
  tracker | modlhmp live --map hall.state.parquet --keep hall.state.parquet
\b
A moment is forecast when the first row from after it comes. A tracker can
say that it has told everyone who was there, and wait for no row:
  {"t": 1351042801.0}

Without --latest every moment is forecast, and a reader that stalls is waited for, by the tracker as well. With it
rows are always taken, and a reader that comes back finds the newest forecast. What becomes of rows that are late,
repeated, impossible or no rows is in docs/live.md; they are counted on stderr.

\b
Status 0: the rows have ended, or the reader has gone. 1: the map, an
option or the file of rows is wrong. 2: the command line is wrong.
3: no line was a row. 130: interrupted.
"""


@app.command(help=HELP)
def live(
    map_file: Annotated[
        str,
        typer.Option("--map", metavar="FILE", help="A map (a folder, of hours), a state of `map update`, or: cvm."),
    ],
    rows: Annotated[Path, typer.Argument(metavar="ROWS", hidden=True)] = Path("-"),
    horizon: Annotated[float | None, typer.Option(metavar="S", help="How far ahead [s] [default: the map's]")] = None,
    every: Annotated[
        float | None, typer.Option(metavar="S", help="Forecast at multiples of so many s [default: the time step]")
    ] = None,
    occupancy: Annotated[
        str, typer.Option(metavar="S,...", help="Tell which cells of 1 m are occupied after so many s.")
    ] = "",
    samples: Annotated[int, typer.Option(metavar="N", min=0, help="Tell so many samples of everyone.")] = 0,
    exits: Annotated[Path | None, typer.Option(metavar="FILE", help="The ways out, for a map that is sampled.")] = None,
    options: SetOption = None,
    keep: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="MAP is a state of `map update`: write here what it holds when rows end."),
    ] = None,
    recording: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of the stream, for a map that learns [default: live]")
    ] = None,
    latest: Annotated[
        bool, typer.Option("--latest", help="Leave forecasts out where the reader does not keep up.")
    ] = False,
) -> None:
    """Forecast people as they are seen; the help is `HELP`."""
    from modlhmp.cli.inputs import check_file  # noqa: PLC0415 - as other verbs do
    from modlhmp.live_lines import Newest, batches, forecasts, text_of, write_all  # noqa: PLC0415 - as other verbs do

    if keep is not None:
        check_file("--keep", keep, ".parquet")
    forecaster = _forecaster(map_file, horizon, exits, recording, options)
    if keep is not None and not forecaster.learns:
        raise DataError(f"--keep {keep}: {map_file} is a finished map: give the state that modlhmp map update keeps")
    at_s, every_s = _moments(forecaster, occupancy), _every(forecaster, every)
    source = _opened(rows)
    forecaster.warm_up()
    newest, status, told = Newest(1) if latest else None, 0, False
    try:
        for t0, futures in forecasts(forecaster, batches(source), every_s, latest, _told_once()):
            told = told or _told_of_few(samples, futures)
            line = text_of(t0, futures, forecaster, samples, at_s)
            newest.put(line) if newest else write_all(1, line)
        if newest:
            newest.close()
    except BrokenPipeError:
        pass
    except OSError as error:
        raise DataError(
            f"{rows}: {error.strerror}; are the rows a file, and is there room for the forecasts?"
        ) from None
    except KeyboardInterrupt:
        status = INTERRUPTED
    finally:  # what was seen is seen once, however it ends
        if keep is not None:
            forecaster.updated().save(keep)
    if status := status or _counted({**forecaster.counts, **({"skipped": newest.skipped} if newest else {})}):
        raise typer.Exit(status)


def _told_of_few(samples: int, futures: "Futures") -> bool:
    """Tell, if anybody is forecast, where more samples are asked for than there are."""
    if fewer := bool(len(futures.t0)) and samples > (most := futures.paths.shape[1]):
        typer.echo(
            f"--samples {samples}: a forecast has {most}; an option says how many, such as --set k={samples}", err=True
        )
    return fewer


def _counted(counts: Mapping[str, int]) -> int:
    """Tell what became of the rows; returns the status that follows."""
    typer.echo(", ".join(f"{name} {number}" for name, number in counts.items() if number) or "no rows", err=True)
    return NO_ROW if counts["bad"] and not counts["taken"] else 0


def _forecaster(
    map_file: str, horizon_s: float | None, exits: Path | None, recording: str | None, options: list[str] | None
) -> "Live":
    """The `Live` of what was said."""
    from modlhmp.cli.inputs import map_or_kind, named_values, with_exits  # noqa: PLC0415 - as other verbs do
    from modlhmp.live import Live  # noqa: PLC0415
    from modlhmp.updates import UpdatedMap, is_state  # noqa: PLC0415

    given = with_exits(named_values(options, HERE), exits)
    source = UpdatedMap.load(map_file) if is_state(map_file) else map_or_kind(map_file)
    given |= {} if recording is None else {"recording": recording}
    return Live(source, horizon_s, **given)


def _moments(forecaster: "Live", listed: str) -> list[float]:
    """The seconds of `--occupancy`; `DataError` for one that is not forecast."""
    from modlhmp.futures import whole_steps  # noqa: PLC0415

    try:
        at_s = [float(one) for one in listed.split(",") if one.strip()]
    except ValueError:
        raise DataError(f"--occupancy {listed!r}: give seconds, such as 10,20") from None
    for one in at_s:
        whole_steps("--occupancy", one, forecaster.site, forecaster.horizon_s)
    return at_s


def _every(forecaster: "Live", every_s: float | None) -> float:
    """The seconds between forecasts."""
    every_s = forecaster.site.time_step_s if every_s is None else every_s
    if not LEAST_EVERY_S <= every_s <= MOST_EVERY_S:
        raise DataError(f"--every {every_s:g}: give {LEAST_EVERY_S:g} to {MOST_EVERY_S:g} s")
    return every_s


def _opened(rows: Path) -> int:
    """The file descriptor of the rows."""
    no_folder(rows)
    try:
        return 0 if str(rows) == "-" else os.open(rows, os.O_RDONLY)
    except OSError as error:
        raise DataError(f"{rows}: cannot be read ({error.strerror}); give a file of rows, or - for the input") from None


def _told_once() -> Callable[[int, bytes, str], None]:
    """What tells of the first line that is no row, and of no other."""
    told: list[int] = []

    def problem(number: int, line: bytes, why: str) -> None:
        if not told:
            told.append(number)
            shown = line[:100].decode(errors="replace")
            typer.echo(f"line {number} is no row, {why}: {shown}; others are counted", err=True)

    return problem
