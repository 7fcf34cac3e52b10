"""`modlhmp forecast`."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from modlhmp.cli.app import DATA_ROOT, DataRoot, SetOption, app
from modlhmp.cli.inputs import STREAM, check_file, map_or_kind, named_values, read_walkers, with_exits
from modlhmp.storage import DataError
from modlhmp.tracks import shown_s

FORMS = (".csv", ".parquet", ".ndjson")
HERE = {"by": "--map", "history": "--tracks", "horizon_s": "--horizon", "seed": "--seed", "key": "", "site": ""}


@app.command()
def forecast(
    by: Annotated[
        str, typer.Option("--map", metavar="MAP", help="A map, file or folder; or a kind that needs none: cvm.")
    ],
    tracks: Annotated[str, typer.Option(metavar="FILE", help="What is seen of people; - reads CSV from a stream.")],
    horizon: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="How far [default: as the map's site, or the dataset, says]")
    ] = None,
    out: Annotated[
        str, typer.Option(metavar="FILE", help="The forecasts: .csv, .parquet, .ndjson (TrajNet++); - is CSV.")
    ] = STREAM,
    at: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Forecast who is there at this time, from rows up to it [default: all]"),
    ] = None,
    data_root: DataRoot = DATA_ROOT,
    best: Annotated[bool, typer.Option("--best", help="One path for each person instead of the samples.")] = False,
    seed: Annotated[int, typer.Option(metavar="NUMBER", help="Of the samples.")] = 0,
    exits: Annotated[Path | None, typer.Option(metavar="FILE", help="The ways out, for a map that is sampled.")] = None,
    options: SetOption = None,
    plot: Annotated[bool, typer.Option("--plot", help="Draw them, too: a picture beside the file.")] = False,
) -> None:
    """Forecast where people go, from what was seen of each last.

    \b
      modlhmp forecast --map hall.parquet --tracks now.csv --horizon 60 --out futures.csv --plot
      modlhmp forecast --map hall.parquet --tracks monday.csv --at 1351040400 --best --out futures.csv
      modlhmp forecast --map cvm --tracks - --horizon 10 < now.csv | head

    Tracks: a CSV file with the columns track_id, t, x, y (s, m), a row every time step or more often, with or without
    speed and heading (m/s, rad); a clean recording (.parquet); a dataset file (.yaml); or any file of which `modlhmp
    inspect` can tell without doubt how it is written.

    Forecasts: the columns track_id, t0 (s), sample, step and t (time steps and s after t0), x, y (m); a sample that
    ends has no rows from then on. docs/command-line.md has the forms and the exit codes.
    """
    import modlhmp  # noqa: PLC0415 - other commands need none of it

    if seed < 0:
        raise DataError(f"--seed {seed}: give a whole number from 0")
    if plot and out == STREAM:
        raise DataError("--plot: the picture lies beside the file of forecasts; name one by --out")
    if out != STREAM:
        check_file("--out", out, *FORMS)
    source = map_or_kind(by)
    given = with_exits(named_values(options, HERE), exits)
    of_map = None if isinstance(source, str) else source.site
    walkers, owners, recorded, own = read_walkers(tracks, None if of_map is None else of_map.time_step_s, data_root)
    site = of_map or own
    seen = _seen(walkers, at, site.observed_rows, tracks)
    _check_ids(owners, seen, tracks, out)
    if recorded and of_map is None and site.velocity == "differences":
        _tell_of_speeds(by, tracks)
    futures = modlhmp.forecast(source, seen, horizon, seed, site=site, **given)
    _tell_of_unknown(futures, tracks)
    _write(futures, owners, out, best)
    if plot:
        _draw(futures, seen, f"{Path(by).name}, {Path(tracks).name}", Path(out).with_suffix(".png"))


def _draw(futures: Any, seen: Any, title: str, picture: Path) -> None:
    from modlhmp.futures_drawing import draw_futures  # noqa: PLC0415 - matplotlib

    draw_futures(futures, seen, title, picture)
    typer.echo(f"Written: {picture}", err=True)


def _tell_of_unknown(futures: Any, tracks: str) -> None:
    """Tell how many have no forecast; `DataError` if nobody has one."""
    if not futures.known.any():
        raise DataError(f"{tracks}: nobody has a forecast: the map tells nothing of where and when they are")
    if unknown := int((~futures.known).sum()):
        of = f"{unknown} of {len(futures.known)} people have no forecast"
        typer.echo(f"{of}: the map tells nothing of where and when they are", err=True)


def _seen(walkers: Any, at: float | None, rows: int, file: str) -> Any:
    """What the forecasts are made from: of those who have enough rows, up to a moment."""
    if not len(walkers.t):
        raise DataError(f"{file}: it has no rows, so nobody can be forecast")
    if at is not None:
        seen = walkers.seen_by(at, rows=rows)
        if not len(seen.t):
            raise DataError(
                f"--at {at:.16g}: nobody in {file} has {rows} rows by then and is there; its times are "
                f"{shown_s(walkers.t.min())} to {shown_s(walkers.t.max())} s"
            )
        return seen
    counts = np.diff(walkers.bounds())
    if (counts < rows).any():
        typer.echo(f"{(counts < rows).sum()} of {len(counts)} people have fewer than {rows} rows: left out", err=True)
    if not (counts >= rows).any():
        raise DataError(f"{file}: nobody has {rows} rows, a time step apart, which a forecast is made from")
    return walkers.take(np.repeat(counts >= rows, counts))


def _check_ids(owners: dict[int, str], seen: Any, file: str, out: str) -> None:
    """`DataError` where ids that are text would go out as numbers."""
    if out.endswith(".ndjson") and (texts := owners.keys() & set(seen.track_id.tolist())):
        raise DataError(
            f"--out {out}: TrajNet++'s lines have whole numbers for ids, and {file} has texts, such as "
            f"{owners[min(texts)]!r}: write CSV or Parquet, or number the people"
        )


def _tell_of_speeds(kind: str, file: str) -> None:
    """Say where recorded speeds are not used: a run of the same tracks may use them."""
    typer.echo(
        f"{kind} takes velocities from positions: the speeds and headings in {file} are not used, as a run of a "
        "dataset whose `velocity` is as_recorded would use them",
        err=True,
    )


def _write(futures: Any, owners: dict[int, str], out: str, best: bool) -> None:
    """Forecasts in the form that a file's name says."""
    from modlhmp.exchange.columns import write_columns  # noqa: PLC0415
    from modlhmp.exchange.forecasts import long_table  # noqa: PLC0415
    from modlhmp.exchange.trajnet import predictions_as_lines, write_lines  # noqa: PLC0415
    from modlhmp.forecasting.base import Forecast  # noqa: PLC0415
    from modlhmp.forecasting.ranking import best_path  # noqa: PLC0415
    from modlhmp.settings import as_plain  # noqa: PLC0415

    forecast, site = futures.forecast.samples, futures.site
    if futures.forecast.output == "modes":
        forecast = futures.forecast.results
    if best:
        alive = futures.forecast.steps_alive.max(axis=1)
        alive = alive if futures.forecast.output == "mean" else best_path(futures.forecast)[1]
        path = np.asarray(futures.best, np.float32)[:, None]
        forecast = Forecast(path, np.zeros(path.shape[:3], np.float32), alive[:, None], "single")
    if Path(out).suffix == ".ndjson":
        frames = np.rint(futures.t0 / site.time_step_s).astype(int)
        scenes = np.arange(len(frames))
        write_lines(
            predictions_as_lines(scenes, futures.track_id, frames, forecast, site.observed_rows, site.time_step_s), out
        )
    else:
        table = long_table(futures.track_id, futures.t0, forecast, owners, site.time_step_s)
        write_columns([table], out, site=as_plain(site))
    if out != STREAM:
        typer.echo(f"Written: {out}", err=True)
