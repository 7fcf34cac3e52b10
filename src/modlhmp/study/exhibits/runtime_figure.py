"""Figure runtime: time, memory and map size beside the paper's, and their growth (paper Sec. V-A, runtime analysis)."""

import textwrap
from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.ticker import NullFormatter

from modlhmp.datasets import Dataset
from modlhmp.storage import read_json
from modlhmp.study import published
from modlhmp.study.exhibits import style
from modlhmp.study.layout import Layout

GROWTH = {"N": "tracks N", "T": "steps T", "M": "locations M of an hour"}


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, method: str) -> None:
    """What `study.runtime.measure` gave for each dataset; `method` is the measured one's title."""
    measured = [read_json(layout.runtime(one.name)) for one in datasets]
    fig, axes = style.figure(2, 3, style.PAGE_MM, 92.0)
    names = [dataset.title for dataset in datasets]
    seconds = [one["latency_s"] * 1000 for one in measured]
    theirs = [published.SECONDS_PER_TRACK.get(dataset.label, np.nan) * 1000 for dataset in datasets]
    _bars(axes[0, 0], names, seconds, theirs, "time of a single track [ms]", log=True)
    memory = [one["memory_mb"] for one in measured]
    _bars(axes[0, 1], names, memory, [published.MEMORY_MB] * len(names), "resident memory [MB]")
    sizes = [one["map_kb"] for one in measured]
    _bars(axes[0, 2], names, sizes, [published.MAP_KB] * len(names), "map of an hour [kB]")
    for ax, (name, label) in zip(axes[1], GROWTH.items(), strict=True):
        for position, one in enumerate(measured):
            size, time_s = np.array([row[:2] for row in one["growth"][name]]).T
            slope, low, high = one["exponents"][name]
            text = f"exponent {slope:.2f} ({low:.2f} to {high:.2f})"
            ax.plot(size, time_s * 1000, label=text, **style.method_style(position))
        ax.set(xscale="log", yscale="log", xlabel=label, ylabel="time of all tracks [ms]")
        low, high = ax.get_ylim()
        ax.set_ylim(low / 2, high * 8)  # a flat line shall look flat, and the legend has its place
        ax.legend(loc="upper left")
        ax.yaxis.set_minor_formatter(NullFormatter())
    bars = axes[0, 0].containers
    lines = [style.line_of(position) for position in range(len(names))]
    handles, labels = [*(bar for bar in bars if hasattr(bar, "patches")), *lines], ["ours", "the paper", *names]
    machine = measured[0]["machine"]
    counts = [
        f"{name}: {d.horizon_s:g} s; of {one['tracks']} tracks together each takes "
        f"{1000 * one['seconds_per_track']:.3g} ms"
        for name, d, one in zip(names, datasets, measured, strict=True)
    ]
    note = (
        f"{method}, k = {measured[0]['k']}, one core, median of {measured[0]['repetitions']}. {'; '.join(counts)}. "
        f"Ours: {machine['cpu']}, Python {machine['python']}, numba {machine['numba']}; the paper: Intel Core "
        "i7-1185G7. In brackets: 95 % interval."
    )
    note = "\n".join(textwrap.wrap(note, 150))
    fig.legend(handles, labels, loc="outside lower center", ncols=len(labels), title=note, title_fontsize=6)
    style.save(fig, stem, _numbers(measured, datasets), any(dataset.demo for dataset in datasets))


def _bars(ax, names, ours, theirs, label, log=False):
    """Ours and the paper's side by side, the values on the bars."""
    x = np.arange(len(names))
    looks = {"color": "#0072B2"}, {"color": "0.8", "hatch": "///"}
    for offset, values, look in zip((-0.2, 0.2), (ours, theirs), looks, strict=True):
        bars = ax.bar(x + offset, values, 0.38, edgecolor="black", linewidth=0.4, **look)
        ax.bar_label(bars, [f"{value:.3g}" if np.isfinite(value) else "" for value in values], fontsize=6, padding=1)
    ax.set_xticks(x, names)
    ax.set_ylabel(label)
    if log:
        ax.set_yscale("log")
    ax.margins(y=0.15)
    ax.grid(visible=False, axis="x")


def _numbers(measured, datasets):
    """Long form: dataset, quantity, size (of N, T or M), value."""
    rows = []
    for dataset, one in zip(datasets, measured, strict=True):
        single = {key: value for key, value in one.items() if isinstance(value, int | float)}
        rows += [(dataset.name, key, "", value) for key, value in single.items()]
        for name, line in one["growth"].items():
            rows += [(dataset.name, f"seconds against {name}", row[0], row[1]) for row in line]
            rows += [(dataset.name, f"exponent of {name}, {what}", "", value)
                     for what, value in zip(("slope", "low", "high"), one["exponents"][name], strict=True)]  # fmt: skip
    return pd.DataFrame(rows, columns=["dataset", "quantity", "size", "value"])
