"""Figure coverage: what share of the eligible tracks each method scores at each horizon (not in the paper)."""

from collections.abc import Mapping, Sequence
from typing import Any

from modlhmp.datasets import Dataset
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import main_rows
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_scores

# The complete protocol's line is wide, so that it shows where both coincide.
ELIGIBLE: dict[str, dict[str, Any]] = {
    "complete": {"color": "0.7", "linestyle": "-", "linewidth": 2.5},
    "paper": {"color": "black", "linestyle": "--"},
}


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str]) -> None:
    """One column per dataset: coverage under the paper protocol above, the number of eligible tracks below.

    `methods` maps names to titles in table order. Under the complete protocol every eligible track is scored.
    """
    rows = main_rows(read_scores(layout.scores))
    rows = rows.assign(coverage=rows["n"] / rows["eligible"].where(rows["eligible"] > 0))
    fig, axes = style.figure(2, len(datasets), height_mm=78.0, sharex="col")
    for column, dataset in enumerate(datasets):
        one = rows[rows["dataset"] == dataset.name]
        above, below = axes[:, column]
        for position, method in enumerate(methods):
            curve = one[(one["method"] == method) & (one["protocol"] == "paper")].sort_values("horizon_s")
            every = max(len(curve) // 6, 1)
            look = style.method_style(position)
            above.plot(curve["horizon_s"], 100 * curve["coverage"], markevery=(every - 1, every), clip_on=False, **look)
        for protocol, look in ELIGIBLE.items():
            counts = one[one["protocol"] == protocol].groupby("horizon_s")["eligible"].first()
            below.plot(counts.index, counts.where(counts > 0), **look)
        above.set_title(f"{dataset.title}\npaper protocol")
        above.set(xlim=(0, dataset.horizon_s), ylim=(0, 105), ylabel="scored / eligible [%]")
        below.set(xlabel="prediction horizon [s]", ylabel="eligible tracks n")
        below.set_yscale("log")
        style.plain_numbers(below.yaxis)
    handles = [style.line_of(position) for position in range(len(methods))] + axes[1, 0].get_lines()
    names = [*methods.values(), *(f"eligible, {protocol} protocol" for protocol in ELIGIBLE)]
    note = "Under the complete protocol every method scores all eligible tracks."
    style.legend_below(fig, handles, names, note)
    columns = ["dataset", "method", "output", "protocol", "horizon_s", "n", "eligible", "coverage"]
    style.save(fig, stem, rows[columns], any(dataset.demo for dataset in datasets))
