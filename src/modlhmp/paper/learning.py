"""Table tab_models and figure learning-curves: how the networks were trained, and whether they had finished."""

import json
from pathlib import Path

import numpy as np
import pandas as pd

from modlhmp.paper import style
from modlhmp.paper.table_forms import write_table


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


def draw_curves(trainings, datasets, methods, stem):
    """Two rows a dataset: validation ADE above, training loss below; one column a network."""
    fig, axes = style.figure(
        2 * len(datasets), len(methods), style.PAGE_MM, 8 + 54 * len(datasets), sharex="col", sharey=False
    )
    tables = []
    for column, (method, title) in enumerate(methods.items()):
        for line, dataset in enumerate(datasets):
            one = trainings[dataset["name"], method]
            curve = pd.DataFrame(one["curve"])
            above, below = axes[2 * line : 2 * line + 2, column]
            look = {**style.method_style(column), "marker": "none"}
            above.plot(curve["epoch"], curve["validation_ade_m"], **look)
            above.plot(one["best_epoch"], one["validation_ade_m"], marker="o", markersize=3, color="black")
            below.plot(curve["epoch"], curve["train_loss"], color="0.4")
            above.set_title(f"{dataset['title']}\n{title}")
            above.set_ylim(bottom=0)
            if column == 0:
                above.set_ylabel("validation ADE [m]")
                below.set_ylabel("training loss")
            tables.append(curve.drop(columns="seconds").assign(dataset=dataset["name"], method=method))
        axes[-1, column].set_xlabel("epoch")
    note = "Dots: the epoch whose weights are used. Losses of different networks are different things."
    fig.supxlabel(note, fontsize=6)
    style.save(fig, stem, pd.concat(tables, ignore_index=True), any(dataset["demo"] for dataset in datasets))
