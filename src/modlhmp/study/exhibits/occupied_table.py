"""Table tab_occupied: how good probabilities of occupied cells are, beside what knows nobody (not in the paper)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_parquet
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout
from modlhmp.study.occupied import CLOSE, ENOUGH, reliability_of

NO_SKILL = {"brier_cells": "no skill: each cell's share", "brier_flat": "no skill: one share for all"}
NOTE = (
    "Everyone there is forecast every {every_s:g} s of the recordings' days, with maps of people who were not recorded "
    "within ten minutes of them; truth is where these people are then, not who comes later. A cell of 1 m is occupied "
    "if the position of one of them lies in it; cells are those in which anybody was ever seen. Brier: mean squared "
    "error of the probability, lower is better; without skill, that of the share of the moments of other folds (the "
    "half-hours are dealt into five) at which a cell was occupied, and of one share for all. Skill: how much less than "
    "the former it is. Foretold and real: occupied cells per moment; unforeseen: the share of these that no sample "
    "reached. Calibrated: of the bins of ten with at least {enough} cells, those whose share is within {close:g} of "
    "its probability, or whose 95 % interval holds it."
)


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    titles: Mapping[str, str],
    horizons: Mapping[str, Sequence[float]],
    every_s: float,
) -> None:
    """One row per dataset, horizon [s] and method, then those without skill; `titles` are the methods' by name."""
    rows = []
    for dataset in datasets:
        scores, bins = (read_parquet(layout.occupied(dataset.name, one)).to_pandas() for one in ("scores", "bins"))
        judged = reliability_of(bins)
        for horizon_s in horizons[dataset.name]:
            now = scores[np.isclose(scores["horizon_s"], horizon_s)]
            then = judged[np.isclose(judged["horizon_s"], horizon_s)]
            where = {"dataset": dataset.title, "horizon [s]": f"{horizon_s:g}"}
            rows += [{**where, **_cells(one, then, titles)} for one in now.itertuples()]
            for name, title in NO_SKILL.items():
                rows.append({**where, "method": title, "Brier [1e-3]": f"{1e3 * now[name].iloc[0]:.3f}"})
    note = NOTE.format(every_s=every_s, enough=ENOUGH, close=CLOSE)
    demo = any(dataset.demo for dataset in datasets)
    write_table(pd.DataFrame(rows).fillna("–"), stem, "Which cells will be occupied", demo, note)


def _cells(one, judged, titles):
    """The cells of a method's row."""
    known = judged.loc[judged["method"] == one.method, "calibrated"].dropna()
    moments = max(one.moments, 1)
    return {
        "method": titles[one.method],
        "Brier [1e-3]": f"{1e3 * one.brier:.3f}",
        "skill": f"{1 - one.brier / one.brier_cells:.0%}" if one.brier_cells else "–",
        "foretold": f"{one.p / moments:.2f}",
        "real": f"{one.occupied / moments:.2f}",
        "unforeseen": f"{one.unforeseen / one.occupied:.0%}" if one.occupied else "–",
        "calibrated": f"{known.astype(bool).sum()} of {len(known)}",
        "moments": str(one.moments),
    }
