"""Figure rank-metrics: ADE of TC-CLiFF with ranking (most likely future) and without (mean of the k)."""

from collections.abc import Sequence

from modlhmp.datasets import Dataset
from modlhmp.study import lacks
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import scored_of
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_scores

LINES = {"ranked": ("with ranking", 0), "mean": ("without (mean of k)", 1)}


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, method: str, title: str) -> None:
    """One column per dataset, one row per protocol; `method` has ranked futures, `title` is its title."""
    results = read_scores(layout.scores)
    rows = results[(results["method"] == method) & results["output"].isin(LINES)]
    fig, axes = style.figure(2, len(datasets), height_mm=92.0, sharex="col")
    for column, dataset in enumerate(datasets):
        for line, protocol in enumerate(("paper", "complete")):
            ax = axes[line, column]
            one = rows[(rows["dataset"] == dataset.name) & (rows["protocol"] == protocol)]
            if one.empty:
                style.empty_panel(ax, lacks.NO_FORECASTS.text.format(method=title, dataset=dataset.title))
                continue
            for output, (label, position) in LINES.items():
                curve = one[one["output"] == output].sort_values("horizon_s")
                every = max(len(curve) // 6, 1)
                look = style.method_style(position)
                points = {"markevery": (every - 1, every), "clip_on": False}
                ax.plot(curve["horizon_s"], curve["ade_m"], label=label, **points, **look)
            last = one.sort_values("horizon_s").iloc[-1]
            counts = f"n {scored_of(last)} at {last['horizon_s']:g} s"
            head = f"{dataset.title}\n" if line == 0 else ""
            ax.set_title(f"{head}{protocol} protocol\n{counts}")
            ax.set_ylim(bottom=0)
            ax.set_xlim(0, dataset.horizon_s)
            ax.set_ylabel("ADE [m]")
            if line == 1:
                ax.set_xlabel("prediction horizon [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    note = f"{title}; n: tracks scored / eligible"
    fig.legend(handles, labels, loc="outside lower center", ncols=2, title=note, title_fontsize=6)
    style.save(fig, stem, rows, any(dataset.demo for dataset in datasets))
