"""Errors of one method's forecasts of one recording, under both protocols."""

from collections.abc import Iterable

import numpy as np
import pyarrow as pa

from modlhmp.floor_plan import FloorPlan, occupied_depth
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.windows import in_order, windows
from modlhmp.scenes import Scenes
from modlhmp.scoring.errors import enters_occupied, left_out, truth_of
from modlhmp.scoring.protocols import score
from modlhmp.site import Site
from modlhmp.tracks import Tracks, clock_hours


def score_recording(
    tracks: Tracks,
    forecasts: Iterable[tuple[int, np.ndarray, Forecast]],
    recording: str,
    site: Site,
    floor_plan: FloorPlan | None = None,
    scenes: Scenes | None = None,
) -> pa.Table:
    """Score one method's forecasts of one recording; returns a table, one row per track, seed, output and protocol.

    `forecasts` yields (seed, track_ids, `Forecast`) of all tracks, a few after the other; with the site's
    `forecast_every_s`, or the recording's `scenes`, each forecast of a track is a row of its own, with its `t0` (unix
    s), and all of an idle track's are idle. `ade` and `fde` [m] are lists over horizons, NaN where not scored;
    `eligible_steps` says to which step the track counts, `scored_steps` to how many it was scored, and `why_not` the
    reason where the two differ; `alive_steps` is how long the longest-lived future stayed on the map, 0 where the
    method could not forecast the track at all. With a `FloorPlan` there are also `infeasible`, lists of whether the
    forecast has been inside a wall (`errors.enters_occupied`), and `truth_infeasible_from`, the first step at which the
    person's own path has (0: never). Empty if the recording has no usable track.
    """
    steps, wanted = site.steps, windows(tracks, site, scenes)
    truth, length = truth_of(tracks, wanted, site)
    idle = left_out(tracks, wanted.tracks, site)[wanted.of]
    eligible = {"paper": np.where(idle, 0, length), "complete": length}
    by_track = {"track_id": wanted.track_id, **({"t0": wanted.t0} if wanted.several else {})}
    by_track["hour"] = clock_hours(wanted.t0, site.timezone).astype(np.int8)
    if floor_plan is not None:
        depth, start = occupied_depth(floor_plan), np.column_stack([tracks.x[wanted.row], tracks.y[wanted.row]])
        entered = enters_occupied(floor_plan, depth, start, truth)
        first = np.where(entered.any(axis=1), entered.argmax(axis=1) + 1, 0)
        by_track["truth_infeasible_from"] = first.astype(np.int32)
    tables: list[pa.Table] = []
    for seed, rows, whole in in_order(forecasts, wanted, recording):
        forecast = whole.results
        infeasible = None if floor_plan is None else enters_occupied(floor_plan, depth, start[rows], forecast.xy)
        mine = {protocol: number[rows] for protocol, number in eligible.items()}
        alive = forecast.steps_alive.max(axis=1).astype(np.int32)
        for (output, protocol), values in score(forecast, truth[rows], mine, infeasible).items():
            scored = np.isfinite(values["ade"]).sum(axis=1)
            counted = np.minimum(mine[protocol], steps)
            reason = np.where(scored < counted, "no dynamics", "")
            if protocol == "paper":
                reason = np.where(idle[rows], "idle", reason)
            one = {"recording": recording, "output": output, "protocol": protocol}
            whose = {name: values[rows] for name, values in by_track.items()} | {"alive_steps": alive}
            tables.append(_table(one, seed, whose, counted, scored, reason, values))
    if not tables:
        nothing, no_errors = np.empty(0, int), np.empty((0, steps))
        one = {"recording": recording, "output": "", "protocol": ""}
        by_track["alive_steps"] = nothing.astype(np.int32)
        values = dict.fromkeys(("ade", "fde") if floor_plan is None else ("ade", "fde", "infeasible"), no_errors)
        tables = [_table(one, 0, by_track, nothing, nothing, nothing.astype(str), values)]
    return pa.concat_tables(tables).unify_dictionaries()


def _table(one, seed, by_track, counted, scored, reason, values):
    """Rows of the errors table for one recording, output, protocol and seed."""
    n = len(by_track["track_id"])
    constants = {name: pa.array(np.full(n, value)).dictionary_encode() for name, value in one.items()}
    return pa.table(
        {
            **constants,
            **by_track,
            "seed": np.full(n, seed, np.int32),
            "eligible_steps": counted.astype(np.int32),
            "scored_steps": scored.astype(np.int32),
            "why_not": pa.array(reason).dictionary_encode(),
            **{name: _lists(one) for name, one in values.items()},
        }
    )


def _lists(values):
    return pa.FixedSizeListArray.from_arrays(pa.array(values.astype(np.float32).ravel()), values.shape[1])
