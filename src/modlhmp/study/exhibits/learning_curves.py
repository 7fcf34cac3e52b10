"""Figure learning-curves: validation error and training loss of networks over windows looked at (not in the paper)."""

import textwrap
from collections.abc import Mapping, Sequence

import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.trainings import read_trainings
from modlhmp.study.layout import Layout

TITLE_LETTERS = 14  # in a line above a panel: there may be eight panels across a page


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """Two rows per dataset: validation ADE above, training loss below; one column per network.

    `methods` maps the networks' names to their titles.
    """
    trainings = read_trainings(layout, datasets, methods)
    fig, axes = style.figure(
        2 * len(datasets), len(methods), style.PAGE_MM, 8 + 54 * len(datasets), sharex="col", sharey=False
    )
    tables = []
    for column, (method, title) in enumerate(methods.items()):
        for line, dataset in enumerate(datasets):
            one = trainings[dataset.name, method]
            curve = pd.DataFrame(one["curve"])
            above, below = axes[2 * line : 2 * line + 2, column]
            look = {**style.method_style(column), "marker": "none"}
            seen = curve["windows"] / 1000
            above.plot(seen, curve["validation_ade_m"], **look)
            best = seen[curve["epoch"] == one["best_epoch"]]
            above.plot(best, one["validation_ade_m"], marker="o", markersize=3, color="black")
            below.plot(seen, curve["train_loss"], color="0.4")
            if line == 0:
                above.set_title(textwrap.fill(title, TITLE_LETTERS))
            above.set_ylim(bottom=0)
            if column == 0:
                above.set_ylabel(f"{dataset.title}\nvalidation ADE [m]")
                below.set_ylabel("training loss")
            tables.append(curve.drop(columns=["seconds", "core_seconds"]).assign(dataset=dataset.name, method=method))
        axes[-1, column].set_xlabel("10³ windows")
    note = "Dots: the epoch whose weights are used. Losses of different networks are different things."
    fig.supxlabel(note, fontsize=6)
    style.save(fig, stem, pd.concat(tables, ignore_index=True), any(dataset.demo for dataset in datasets))
