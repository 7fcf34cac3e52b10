"""Figures atc_final and edin_final: ADE and FDE against the horizon, mean and one SD, for every method."""

from collections.abc import Mapping

import numpy as np

from modlhmp.datasets import Dataset
from modlhmp.study.exhibits import style
from modlhmp.study.exhibits.selection import main_rows, scored_of
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_scores

TITLES = {"paper": "paper protocol", "complete": "complete protocol"}


def draw(layout: Layout, dataset: Dataset, stem: str, methods: Mapping[str, str]) -> None:
    """Draw the figure of one dataset; `methods` maps names to titles in table order."""
    results = read_scores(layout.scores)
    rows = main_rows(results[results["dataset"] == dataset.name])
    fig, axes = style.figure(2, 2, height_mm=80.0, sharex=True, sharey="col")
    for line, (protocol, title) in enumerate(TITLES.items()):
        for column, metric in enumerate(("ade", "fde")):
            ax = axes[line, column]
            for position, method in enumerate(methods):
                one = rows[(rows["method"] == method) & (rows["protocol"] == protocol)].sort_values("horizon_s")
                _curve(ax, one, metric, style.method_style(position))
            ax.set_title(title)
            ax.set_xlim(0, dataset.horizon_s)
            if line == 1:
                ax.set_xlabel("prediction horizon [s]")
            ax.set_ylabel(f"{metric.upper()} [m]")
    for ax in axes[0]:  # once both lines of axes, which share theirs, are drawn: it ends their scaling
        ax.set_ylim(bottom=0)
    handles = [line for line in axes[0, 0].get_lines() if line.get_marker() != "None"]
    labels = [f"{title} ({_counts(rows, method)})" for method, title in methods.items()]
    note = (
        f"{dataset.title}: mean (thick) ± 1 SD over tracks (thin)\n"
        f"in brackets: n (/ eligible) at {dataset.horizon_s:g} s, paper and complete protocol"
    )
    style.legend_below(fig, handles, labels, note, 2)
    style.save(fig, stem, rows, dataset.demo)


def _curve(ax, rows, metric, look):
    horizon, mean, sd = (rows[name].to_numpy(float) for name in ("horizon_s", f"{metric}_m", f"{metric}_sd_m"))
    every = max(len(horizon) // 6, 1)
    ax.plot(horizon, mean, markevery=(every - 1, every), clip_on=False, **look)
    ax.fill_between(horizon, np.maximum(mean - sd, 0), mean + sd, color=look["color"], alpha=0.04, linewidth=0)
    for edge in (mean - sd, mean + sd):
        ax.plot(horizon, edge, color=look["color"], linestyle=look["linestyle"], linewidth=0.4, alpha=0.6)


def _counts(rows, method):
    last = rows[(rows["method"] == method) & (rows["horizon_s"] == rows["horizon_s"].max())].set_index("protocol")
    counts = [last.loc[protocol] for protocol in TITLES if protocol in last.index]
    return ", ".join(scored_of(row) if row["n"] < row["eligible"] else f"{row['n']:.0f}" for row in counts)
