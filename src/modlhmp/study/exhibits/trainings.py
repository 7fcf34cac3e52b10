"""Table tab_models: how the networks were trained, and whether they had finished."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from modlhmp.study.exhibits.table_forms import write_table


def read_trainings(files):
    """What each training left, the JSON beside its weights: {(dataset name, method): dict}."""
    paths = [Path(file) for file in files]
    return {(path.parts[-3], path.stem): json.loads(path.read_text(encoding="utf-8")) for path in paths}


def late_change(curve):
    """Mean validation ADE [m] of the last fifth of the epochs less that of the fifth before; NaN below 5 epochs."""
    ade = np.array([row["validation_ade_m"] for row in curve])
    fifth = len(ade) // 5
    return ade[-fifth:].mean() - ade[-2 * fifth : -fifth].mean() if fifth else np.nan


def write_models(trainings, datasets, methods, stem):
    """One row a network: its size, its data, how long it was trained, and its validation error."""
    rows = []
    for (name, method), one in trainings.items():
        change = late_change(one["curve"])
        rows.append(
            {
                "dataset": next(d["title"] for d in datasets if d["name"] == name),
                "method": methods[method],
                "budget": one["budget"],
                "futures": one["futures"],
                "parameters": f"{one['parameters']:,}",
                "tracks (held out)": f"{one['tracks']} ({one['validation_tracks']})",
                "epochs run / planned": f"{one['epochs']} / {one['planned_epochs']}",
                "best epoch": one["best_epoch"],
                "validation ADE [m]": f"{one['validation_ade_m']:.3f}",
                "change in the last fifth [m]": f"{change:+.3f}" if np.isfinite(change) else "too short",
                "minutes": f"{one['minutes']:.1f}",
                "on": f"{one['device']}, {one['threads']} thread{'s' if one['threads'] > 1 else ''}",
            }
        )
    note = (
        "Weights are those of the best epoch by the validation ADE, of held-out training persons, each at its own "
        "length; the change compares its mean over the last fifth of the epochs with that over the fifth before. An "
        "epoch is one window of every track. Budgets below `full` are reduced: docs/decisions.md."
    )
    write_table(pd.DataFrame(rows), stem, "Trained networks", any(d["demo"] for d in datasets), note)
