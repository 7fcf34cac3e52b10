"""Figure ladder: the error of every rung from the paper's configuration to the best one (not in the paper)."""

import numpy as np

from modlhmp.study.exhibits.style import PAGE_MM, empty_panel, figure, save

DRAWN = 3  # panels a dataset: the longest horizons
COLOURS = {"ours": "#0072B2", "before": "#7F7F7F", "reference": "#D55E00"}


def draw(scored, datasets, ladder, titles, with_memory, stem):
    """Draw the ADE of every rung with its interval: a row of panels a dataset, a column a horizon.

    `scored` is of all datasets, `with_memory` names the rungs whose maps have it. Intervals are of single rungs and far
    wider than the paired ones of the table.
    """
    rows, reference = [method for method, _ in ladder["rows"]], ladder["reference"]
    complete = scored[(scored["protocol"] == "complete") & scored["method"].isin([*rows, reference])]
    names = [dataset["name"] for dataset in datasets]
    horizons = {name: sorted(set(complete.loc[complete["dataset"] == name, "horizon_s"]))[-DRAWN:] for name in names}
    columns = max(map(len, horizons.values()))
    fig, axes = figure(len(names), columns, PAGE_MM, (14 + 4.0 * len(rows)) * len(names))
    place = np.arange(len(rows))[::-1]
    for line, dataset in zip(axes, datasets, strict=True):
        mine = complete[complete["dataset"] == dataset["name"]]
        for panel, horizon in zip(line, horizons[dataset["name"]], strict=False):
            everyone = mine[mine["horizon_s"] == horizon].set_index("method")
            at = everyone.loc[rows]
            panel.set_yticks(place, [])
            if not at["n"].any():
                empty_panel(panel, f"{dataset['title']}: no test track of {horizon:g} s")
                continue
            panel.plot(at["ade_m"], place, color="0.6", linewidth=0.8, zorder=1)
            for y, (method, rung) in zip(place, at.iterrows(), strict=True):
                colour = COLOURS["reference" if method == reference else "ours" if method in with_memory else "before"]
                panel.plot([rung["ade_low_m"], rung["ade_high_m"]], [y, y], color=colour, linewidth=2, alpha=0.35)
                panel.plot(rung["ade_m"], y, "o", color=colour, markersize=3.5)
                right = np.nanmax([rung["ade_m"], rung["ade_high_m"]])
                panel.annotate(f"{rung['ade_m']:.2f}", (right, y), (4, 0), textcoords="offset points", va="center",
                               fontsize=5.5, color=colour)  # fmt: skip
            panel.axvline(
                everyone.loc[reference, "ade_m"], color=COLOURS["reference"], linewidth=0.6, linestyle=":", zorder=0
            )
            panel.set(xlim=(0, 1.2 * np.nanmax([at["ade_m"], at["ade_high_m"]])), ylim=(-0.7, len(rows) - 0.3))
            panel.set_title(f"{dataset['title']}: {horizon:g} s", loc="left")
            panel.set_xlabel(f"ADE [m], n = {at['n'].iloc[0]}")
        line[0].set_yticklabels([titles[method] for method in rows])
        for panel in line[len(horizons[dataset["name"]]) :]:
            panel.set_axis_off()
    save(fig, stem, scored, any(dataset["demo"] for dataset in datasets))
