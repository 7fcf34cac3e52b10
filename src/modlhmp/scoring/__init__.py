"""Scoring: forecasts against what people really did."""

import numpy as np
import pyarrow as pa

from modlhmp.forecasting.observe import usable_tracks
from modlhmp.scoring.errors import ground_truth, is_idle
from modlhmp.scoring.protocols import score
from modlhmp.tracks import clock_hours


def score_recording(tracks, forecasts, recording, dataset):
    """Score one method's forecasts of one recording; returns a table, one row a track, seed, output, protocol.

    `forecasts` yields (seed, track_ids, `Forecast`). `ade` and `fde` [m] are lists over horizons, NaN where not
    scored; `eligible_steps` says to which step the track counts, `scored_steps` to how many it was scored, and
    `why_not` the reason where the two differ. Empty if the recording has no usable track.
    """
    rows = usable_tracks(tracks, dataset["observed_rows"])
    ids = tracks.track_id[rows[:, 0]]
    steps = round(dataset["horizon_s"] / dataset["time_step_s"])
    truth, length = ground_truth(tracks, rows, dataset["observed_rows"], steps, dataset["time_step_s"])
    idle_filter = dataset["paper_protocol"]["idle_filter"]
    idle = np.zeros(len(rows), bool)
    if idle_filter:
        idle = is_idle(tracks, rows, idle_filter["rows"], idle_filter["min_displacement_m"])
    eligible = {"paper": np.where(idle, 0, length), "complete": length}
    hours = clock_hours(tracks.t[rows[:, 0] + dataset["observed_rows"] - 1], dataset["timezone"])
    tables = []
    for seed, track_ids, forecast in forecasts:
        if not np.array_equal(track_ids, ids):
            raise ValueError(f"{recording}: the forecasts are of other tracks than the recording's; remake them")
        for (output, protocol), (ade, fde) in score(forecast, truth, eligible).items():
            scored = np.isfinite(ade).sum(axis=1)
            wanted = np.minimum(eligible[protocol], steps)
            reason = np.where(scored < wanted, "no dynamics", "")
            if protocol == "paper":
                reason = np.where(idle, "idle", reason)
            one = {"recording": recording, "output": output, "protocol": protocol}
            tables.append(_table(one, seed, ids, hours, wanted, scored, reason, ade, fde))
    if not tables:
        nothing, no_errors = np.empty(0, int), np.empty((0, steps))
        one = {"recording": recording, "output": "", "protocol": ""}
        tables = [_table(one, 0, *[nothing] * 4, nothing.astype(str), no_errors, no_errors)]
    return pa.concat_tables(tables).unify_dictionaries()


def _table(one, seed, ids, hours, wanted, scored, reason, ade, fde):
    """Rows of the errors table for one recording, output, protocol and seed."""
    constants = {name: pa.array(np.full(len(ids), value)).dictionary_encode() for name, value in one.items()}
    return pa.table(
        {
            **constants,
            "track_id": ids,
            "seed": np.full(len(ids), seed, np.int32),
            "hour": hours.astype(np.int8),
            "eligible_steps": wanted.astype(np.int32),
            "scored_steps": scored.astype(np.int32),
            "why_not": pa.array(reason).dictionary_encode(),
            "ade": _lists(ade),
            "fde": _lists(fde),
        }
    )


def _lists(errors):
    return pa.FixedSizeListArray.from_arrays(pa.array(errors.astype(np.float32).ravel()), errors.shape[1])
