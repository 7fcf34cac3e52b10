"""What the report's sentences and its own tables hold: counts of cleaning, the best methods, verdicts, limits."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.storage import read_json
from modlhmp.study.claims import WITHOUT_FORECAST
from modlhmp.study.csv_cells import original
from modlhmp.study.exhibits.selection import main_rows
from modlhmp.study.layout import Layout

SPLITS = ("train", "test")
FEW = 100  # tracks: below this a mean says little
VERDICTS = (
    "supported", f"supported {WITHOUT_FORECAST}", "contradicted", f"contradicted {WITHOUT_FORECAST}", "not shown",
)  # fmt: skip


def cleaning(layout: Layout, dataset: Dataset, names: Mapping[str, Sequence[str]]) -> list[tuple[str, list[int]]]:
    """What became of a dataset's rows and tracks: [(what, [training rows, training tracks, test rows, test tracks])].

    First what was read, then what each rule dropped, last what was kept; it adds up, as the accounts do.
    """
    counts: dict[str, Counter[tuple[str, str]]] = {}
    for split in SPLITS:
        for name in names[split]:
            account = read_json(layout.account(dataset.name, name))
            for kind in ("rows", "tracks"):
                one = account[kind]
                for what, number in {"read": one["read"], **one["dropped"], "kept": one["kept"]}.items():
                    counts.setdefault(what, Counter())[split, kind] += number
    order = ["read", *sorted(counts.keys() - {"read", "kept"}), "kept"]
    places = [(split, kind) for split in SPLITS for kind in ("rows", "tracks")]
    return [(what.replace("_", " "), [counts[what][place] for place in places]) for what in order if what in counts]


def best(scores: pd.DataFrame, dataset: Dataset, methods: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How well a dataset's people were forecast at the longest horizon that test tracks reach, by protocol.

    `horizon` [s], 0 where none reaches one; `complete` and `paper`: the method of least ADE, the `constant` velocity of
    least ADE, and the method that scores `fewest`, be it none, each a dict of `title`, `ade`, `fde` [m], `n`,
    `eligible`; none where nothing is scored.
    """
    rows = main_rows(scores[scores["dataset"] == dataset.name])
    rows = rows[rows["method"].isin([one["name"] for one in methods])]
    scored = rows.loc[rows["n"] > 0, "horizon_s"]
    found: dict[str, Any] = {"horizon": float(scored.max()) if len(scored) else 0.0}
    titles = {one["name"]: one["title"] for one in methods}
    for protocol in ("complete", "paper"):
        at = rows[(rows["protocol"] == protocol) & (rows["horizon_s"] == found["horizon"])].set_index("method")
        if (at["n"] > 0).any():
            still = at["ade_m"].reindex([one["name"] for one in methods if one["kind"] == "cvm"]).dropna()
            constant = still.idxmin() if len(still) else None
            wanted = {"best": at["ade_m"].idxmin(), "constant": constant, "fewest": (at["n"] / at["eligible"]).idxmin()}
            found[protocol] = {
                what: {
                    "title": titles[name], "ade": at.loc[name, "ade_m"], "fde": at.loc[name, "fde_m"],
                    "n": at.loc[name, "n"], "eligible": int(at.loc[name, "eligible"]),
                }
                for what, name in wanted.items() if name in at.index
            }  # fmt: skip
    return found


def verdicts(claims: pd.DataFrame) -> dict[str, dict[str, int]]:
    """How many tests of the paper's claims came to each verdict: {verdict: {protocol: number}}, those of any left out.

    `another` are those that a run lacks something for, or that only measure. Tests of no protocol in particular are
    under "".
    """
    said = claims["verdict"].map(original)
    kinds = [text if text in VERDICTS else "another" for text in said]
    found = Counter(zip(kinds, claims["protocol"], strict=True))
    names = (*VERDICTS, "another")
    return {one: {protocol: found[one, protocol] for protocol in ("complete", "paper", "")} for one in names}


def limits(
    dataset: Dataset, recordings: Mapping[str, Any], reached: Mapping[str, Any], settings: Mapping[str, Any]
) -> list[str]:
    """What a dataset's results cannot say, one sentence each."""
    days, shared = recordings["days"]["test"], recordings["shared"]
    found = []
    if dataset.demo:
        found.append("The people are made up, so nothing here says how people walk; no number is comparable with the "
                     "paper's.")  # fmt: skip
    if settings["evaluate_on"] == "validation":
        found.append("This run chooses options: a part of the training recordings stands in for the test recordings.")
    elif shared and settings["evaluate_on"] == "test":
        found.append(f"People of training and test walked on the same day ({', '.join(shared[:3])}"
                     f"{' and others' if len(shared) > 3 else ''}): easier for maps than another day.")  # fmt: skip
    if recordings["over"] == "persons":
        many = f"{len(days)} test day{'s' if len(days) > 1 else ''}" if all(days) else "test days unknown"
        found.append(f"With {many}, tests and intervals are over persons: they say what other people of such days "
                     "would give, nothing about other days.")  # fmt: skip
    if dataset.clock == "unknown":
        found.append("Without a clock there are no maps by hours.")
    elif dataset.clock == "estimated":
        found.append("The hour of the day is an estimate, so nothing is claimed about hours.")
    if not dataset.floor_plan:
        found.append("Without a floor plan nobody knows whether forecasts go through walls.")
    if not reached["horizon"]:
        found.append("No test track is long enough to be scored at any horizon.")
    elif reached["horizon"] < dataset.horizon_s:
        found.append(f"No test track lasts {dataset.horizon_s:g} s after what is observed; the longest horizon scored "
                     f"is {reached['horizon']:g} s.")  # fmt: skip
    for protocol in ("complete", "paper"):
        fewest = reached.get(protocol, {}).get("fewest")
        if fewest and fewest["n"] < FEW:
            found.append(f"At {reached['horizon']:g} s the {protocol} protocol scores as few as {count(fewest['n'])} "
                         f"tracks ({fewest['title']}).")  # fmt: skip
    return found


def count(number: float) -> str:
    """`37.2` or `1,378`: n is a mean over seeds, so it may have a decimal."""
    return f"{number:,.1f}".removesuffix(".0")
