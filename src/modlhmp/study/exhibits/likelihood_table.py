"""Table tab_likelihood: which map is true? Likelihood of velocities by place and time only (not in the paper)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.scoring.likelihood import ACCOUNTINGS, PRINTED
from modlhmp.storage import read_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.layout import Layout
from modlhmp.study.likelihood import ALL_HOURS, NO_MAP, TITLES

FIRST_HOUR = 3  # columns of the table by hour before those of hours
LN2 = float(np.log(2.0))
SPACES = {"joint": "headings and speeds [nat per rad and m/s]", "heading": "headings alone [nat per rad]"}
NOTE = (
    "Mean negative log density (NLL) of the velocities of test persons under a map that knows the place and the time, "
    "and nothing of the walker; lower is better. Every density integrates to 1. Background: the map mixed with what "
    "is known without one (training speeds, any heading), by the weight given, chosen on persons held out of the "
    "training data; gain: how much less than without a map, with its 95 % interval over {over}; negative: worse than "
    "no map. Common: only rows that all maps cover. Charged: what a map does not cover, or gives less than 1e-12, "
    "costs 27.6. Fallback: the next broader map of its family is asked there. As printed: charged, with a density "
    "three times too large. Numbers in the literature seem to be so made: in earlier public code windings were "
    "wrapped again after their shift, so that each term counts three times, and it charges 27.6 likewise. That the "
    "printed numbers come from before this was mended, and how many rows they charge, is inferred from what is "
    "public; their authors do not say so. Such a number is up to ln 3 = {ln3:.2f} too low, and mostly decided by the "
    "charge. Rows with a speed of 0 or without a heading do not count. Headings alone and headings with speeds are "
    "two scales, never to be compared."
)


def draw(layout: Layout, datasets: Sequence[Dataset], stem: str, titles: Mapping[str, str], over: str) -> None:
    """One row per dataset, space and map; `titles` are the methods' by name, `over` what intervals are over."""
    titles = dict(titles) | TITLES
    rows, hours, pairs = [], [], []
    for dataset in datasets:
        scores, paired = (read_parquet(layout.likelihood(dataset.name, one)).to_pandas() for one in ("scores", "pairs"))
        for space, what in SPACES.items():
            here = scores[scores["space"] == space]
            rows += _rows(dataset.title, what, here[here["hour"] == ALL_HOURS], titles)
            if dataset.clock == "unknown":
                hours.append({"dataset": dataset.title, "density of": what, "map": str(lacks.NO_CLOCK)})
            else:
                hours += _hours(dataset.title, what, here[here["hour"] != ALL_HOURS], titles)
            pairs += _pairs(dataset.title, what, paired[paired["space"] == space], titles)
    note = NOTE.format(over=over, ln3=np.log(3.0))
    by_hour = pd.DataFrame(hours).fillna("–")
    ordered = [*by_hour.columns[:FIRST_HOUR], *sorted(by_hour.columns[FIRST_HOUR:])]
    others = [("NLL by hour, with background", by_hour[ordered]),
              ("Differences of NLL, with background", pd.DataFrame(pairs))]  # fmt: skip
    write_table(pd.DataFrame(rows), stem, "Which map is true?", any(one.demo for one in datasets), note, others)


def _rows(dataset, what, scores, titles):
    """A row per map; the lowest of a column is bold."""
    by_accounting = {name: scores[scores["accounting"] == name].set_index("map") for name in (*ACCOUNTINGS, PRINTED)}
    headline = by_accounting["background"]
    rows = []
    for name, one in headline.iterrows():
        chosen = f" ({one['chosen']})" if one["chosen"] else ""
        row = {
            "dataset": dataset, "density of": what, "map": titles[name] + chosen, "NLL": f"{one['nll']:.3f}",
            "gain [nat]": interval(one["gain"], one["gain_low"], one["gain_high"]) if name != NO_MAP else "–",
            "gain [bit]": f"{one['gain'] / LN2:.3f}" if name != NO_MAP else "–",
            "weight": f"{one['weight']:g}" if name != NO_MAP else "–",
            "covered": f"{one['covered']:.2%}",
        }  # fmt: skip
        for accounting in (*ACCOUNTINGS[1:], PRINTED):
            row[accounting] = f"{by_accounting[accounting].loc[name, 'nll']:.3f}"
        rows.append(row | {"charged rows": f"{one['charged']:.2%}", "n": f"{one['n']:.0f}"})
    for column, accounting in (("NLL", "background"), *((one, one) for one in ACCOUNTINGS[1:])):
        best = int(np.argmin(by_accounting[accounting].loc[headline.index, "nll"]))
        rows[best][column] = f"**{rows[best][column]}**"
    return [{"as printed" if key == PRINTED else key: value for key, value in row.items()} for row in rows]


def interval(value: float, low: float, high: float) -> str:
    """A value with its interval, if it has one."""
    return f"{value:.3f}" + (f" [{low:.3f}, {high:.3f}]" if np.isfinite(low) else "")


def _hours(dataset, what, scores, titles):
    """A row per map with a column per hour."""
    return [
        {"dataset": dataset, "density of": what, "map": titles[name]}
        | {f"{hour:02d} h": f"{nll:.3f}" for hour, nll in zip(group["hour"], group["nll"], strict=True)}
        for name, group in scores.groupby("map", sort=False)
    ]


def _pairs(dataset, what, pairs, titles):
    """A row per pair of maps; both with their backgrounds."""
    return [
        {
            "dataset": dataset, "density of": what, "map": titles[one.map], "against": titles[one.against],
            "NLL less [nat]": interval(one.difference, one.low, one.high),
        }
        for one in pairs.itertuples()
    ]  # fmt: skip
