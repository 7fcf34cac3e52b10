"""Table tab_uncertainty: how good each method's forecasts are as distributions (not in the paper)."""

from collections.abc import Mapping, Sequence

import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.scoring.uncertainty import BEST_OF, MISSED_M, OF_MODES, SAMPLES
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout
from modlhmp.study.reliability import read_uncertainty, summarise

HEADINGS = {
    "energy_m": "energy score [m]",
    "kde_nll": "KDE-NLL [nat]",
    "best_ade_m": f"best of {BEST_OF}: ADE [m]",
    "best_fde_m": f"best of {BEST_OF}: FDE [m]",
    "missed": f"best of {BEST_OF}: over {MISSED_M:g} m [%]",
    "modes_ade_m": "best of modes: ADE [m]",
    "modes_fde_m": "best of modes: FDE [m]",
    "modes_brier_m": "best of modes: Brier FDE [m]",
    "expected_m": "expected error [m]",
    "real_m": "real error [m]",
    "ratio": "real / expected",
    "n_ratio": "real / expected: n",
    "samples": "samples",
    "n": "n",
    "brier": "has left: Brier",
    "brier_base": "base rate's Brier",
    "left_share": "have left [%]",
    "n_left": "has left: n",
}
FORMS = {
    "ratio": "{:.2f}",
    "samples": "{:.1f}",
    "n": "{:.0f}",
    "n_ratio": "{:.0f}",
    "n_left": "{:.0f}",
    "left_share": "{:.1f}",
    "missed": "{:.1f}",
}
BEST = ("energy_m", "kde_nll", "best_ade_m", "best_fde_m", "missed", *OF_MODES, "brier")  # the lowest of each is bold


def draw(
    layout: Layout, datasets: Sequence[Dataset], stem: str, methods: Mapping[str, str], others: Mapping[str, str]
) -> None:
    """One row per dataset, horizon and method; `methods` maps the measured ones' names to titles in table order.

    `others` maps the titles of the compared methods that have no scores to the reason; they are dashes.
    """
    parts = [
        summarise(one.name, method, *read_uncertainty(layout.uncertainty(one.name, method))[:2])
        for one in datasets
        for method in methods
    ]
    rows = pd.concat(parts, ignore_index=True)
    rows[["left_share", "missed"]] *= 100
    titles = {one.name: one.title for one in datasets}
    for column, names in (("dataset", titles), ("method", methods)):
        rows[column] = pd.Categorical(rows[column], list(names))
    rows = rows.sort_values(["dataset", "horizon_s", "method"], ignore_index=True)
    table = pd.DataFrame({"dataset": rows["dataset"].map(titles), "horizon [s]": rows["horizon_s"].map("{:g}".format)})
    table["method"] = rows["method"].map(methods).astype(str)
    table["dataset"] = table["dataset"].astype(str)
    shown = {name: heading for name, heading in HEADINGS.items() if name not in OF_MODES or rows[name].notna().any()}
    for name, heading in shown.items():
        cells = rows[name].map(FORMS.get(name, "{:.3f}").format).where(rows[name].notna(), "–")
        if name in BEST:
            printed = pd.to_numeric(cells, errors="coerce")  # of values that print alike all are lowest
            lowest = printed.groupby([rows["dataset"], rows["horizon_s"]], observed=True).transform("min")
            cells = cells.where(printed != lowest, "**" + cells + "**")
        table[heading] = cells
    for title, reason in others.items():
        for dataset in datasets:
            dashes = dict.fromkeys(shown.values(), "–") | {"samples": reason}
            table.loc[len(table)] = {"dataset": dataset.title, "horizon [s]": "–", "method": title, **dashes}
    note = (
        f"Distributions are of the first {SAMPLES} samples that are still there, given that the person is; `samples` "
        "says how many that were, a repeated one counted once. Energy score: lower is better. KDE-NLL: of the truth "
        "under a Gaussian kernel estimate of the same or, where fewer than three are there, of the first samples, held "
        "where they ended; at most 20, as where these lie on a line. Expected error: mean distance of the "
        "method's own output from the other samples (a median's: their sum divided by one less than their number), of "
        "two samples or more; real error: that output's FDE, complete protocol; where the output is the mean error, "
        "both are means over every sample as the output. A method that is as sure as it may be has a ratio of 1, one "
        "that is too sure a larger one; it is of the tracks that have both errors. Has left: the probability that the "
        "person's track ends before the horizon. Means over a track's seeds, then over tracks."
    )
    if OF_MODES[0] in shown:
        note += " Best of modes: of at most five with probabilities p; Brier FDE: the FDE of the best plus (1 - p)^2."
    write_table(table, stem, "Forecasts as distributions", any(one.demo for one in datasets), note)
