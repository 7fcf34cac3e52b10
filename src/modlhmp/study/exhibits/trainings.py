"""Table tab_models: how the networks were trained, and whether they had finished."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_json
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout


def read_trainings(
    layout: Layout, datasets: Sequence[Dataset], methods: Iterable[str]
) -> dict[tuple[str, str], dict[str, Any]]:
    """What each training left, the JSON beside its weights: {(dataset name, method): dict}."""
    return {
        (dataset.name, method): read_json(layout.training(dataset.name, method))
        for dataset in datasets
        for method in methods
    }


def late_change(curve: Sequence[Mapping[str, float]]) -> float:
    """Mean validation ADE [m] of the last fifth of the epochs less that of the fifth before; NaN below 5 epochs."""
    ade = np.array([row["validation_ade_m"] for row in curve])
    fifth = len(ade) // 5
    return ade[-fifth:].mean() - ade[-2 * fifth : -fifth].mean() if fifth else np.nan


def convergence(one: Mapping[str, Any]) -> str:
    """What twice the windows showed, or why they were not tried."""
    about, minutes = one["convergence"], f"{one['convergence']['most_core_minutes']:g} core-minutes"
    if about["outcome"] == "not asked":
        return "not tested"
    if about["fall_per_doubling"] is None:
        return f"not tested: twice the windows may take {about['next_core_minutes']:.0f} more, beyond {minutes} in all"
    percent = 100 * about["fall_per_doubling"]
    if about["outcome"] == "no time":
        return f"not converged: validation still falls by {percent:.1f} % per doubling; {minutes} allow no more"
    return f"converged: twice the windows are {abs(percent):.1f} % {'worse' if percent < 0 else 'better'}"


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """One row per dataset and network: its size, its data, how long it was trained, and its validation error.

    `methods` maps the networks' names to their titles.
    """
    rows, titles = [], {dataset.name: dataset.title for dataset in datasets}
    for (name, method), one in read_trainings(layout, datasets, methods).items():
        change, spent = late_change(one["curve"]), sum(each["core_minutes"] for each in one["trainings"])
        rows.append(
            {
                "dataset": titles[name],
                "method": methods[method],
                "budget": one["budget"],
                "seed": one["seed"],
                "futures": one["futures"],
                "parameters": f"{one['parameters']:,}",
                "tracks (held out)": f"{one['tracks']} ({one['validation_tracks']})",
                "windows run / planned": f"{one['windows']:,} / {one['planned_windows']:,}",
                "iterations": f"{one['iterations']:,}",
                "best epoch": f"{one['best_epoch']} of {one['epochs']}",
                "validation ADE [m], best epoch": f"{one['validation_ade_m']:.3f}",
                "last epoch": f"{one['last_validation_ade_m']:.3f}",
                "change in the last fifth [m]": f"{change:+.3f}" if np.isfinite(change) else "too short",
                "convergence": convergence(one),
                "core-minutes (trainings)": f"{spent:.1f} ({len(one['trainings'])})",
                "on": f"{one['device']}, {one['threads']} thread{'s' if one['threads'] > 1 else ''}",
            }
        )
    note = (
        "Weights are those of the best epoch by the validation ADE, of held-out training persons, each at its own "
        "length; the change compares its mean over the last fifth of the epochs with that over the fifth before. A "
        "window is one future looked at; an epoch is one window of every track. Converged: a training with twice the "
        "windows is at most 3 % better on validation; as long as it is better than that, it is used, and twice its "
        "windows are tried, while the core-minutes of all trainings allow. So which training is used can depend on the "
        "machine; once chosen, it is repeatable. Budgets below `full` are reduced: docs/decisions.md."
    )
    write_table(pd.DataFrame(rows), stem, "Trained networks", any(dataset.demo for dataset in datasets), note)
