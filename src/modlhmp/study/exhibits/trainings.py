"""Table tab_models: how the networks were trained, and whether they had finished."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout


def read_trainings(
    layout: Layout, datasets: Sequence[Dataset], methods: Iterable[str]
) -> dict[tuple[str, str], dict[str, Any]]:
    """What each training left, the JSON beside its weights: {(dataset name, method): dict}."""
    return {
        (dataset.name, method): json.loads(Path(layout.training(dataset.name, method)).read_text(encoding="utf-8"))
        for dataset in datasets
        for method in methods
    }


def late_change(curve: Sequence[Mapping[str, float]]) -> float:
    """Mean validation ADE [m] of the last fifth of the epochs less that of the fifth before; NaN below 5 epochs."""
    ade = np.array([row["validation_ade_m"] for row in curve])
    fifth = len(ade) // 5
    return ade[-fifth:].mean() - ade[-2 * fifth : -fifth].mean() if fifth else np.nan


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """One row per dataset and network: its size, its data, how long it was trained, and its validation error.

    `methods` maps the networks' names to their titles.
    """
    rows, titles = [], {dataset.name: dataset.title for dataset in datasets}
    for (name, method), one in read_trainings(layout, datasets, methods).items():
        change = late_change(one["curve"])
        rows.append(
            {
                "dataset": titles[name],
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
    write_table(pd.DataFrame(rows), stem, "Trained networks", any(dataset.demo for dataset in datasets), note)
