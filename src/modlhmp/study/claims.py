"""Every claim of the paper's results section beside our test of it and a verdict.

Tests between methods are those of the run's table of t-tests (`study.comparisons`), with the p that is corrected there;
the others are Holm-corrected here, over those of one dataset and protocol, each side by itself.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.forecasting.windows import usable
from modlhmp.scoring.errors import stands_about
from modlhmp.scoring.horizons import scored_horizons
from modlhmp.scoring.ttests import holm
from modlhmp.site import Site
from modlhmp.study.claim_tests import TESTS, of_the_paper
from modlhmp.study.published import SHORT_S
from modlhmp.study.summary import ErrorsByOutput
from modlhmp.tracks import Tracks

ALL = ("atc", "edin")
ALPHA = 0.05
WITHOUT_FORECAST = "only by tracks that one side could not forecast"  # what such a verdict ends with


class Claim(NamedTuple):
    """What the paper says, where, with which p, and of which datasets (labels)."""

    text: str
    where: str
    p: str
    labels: tuple[str, ...]


CLAIMS = {
    "tc_cliff": Claim("TC-CLiFF is better than CLiFF", "Sec. V-A, tab:expres", "< 0.001", ALL),
    "stef": Claim("CLiFF-based methods are better than STeF over 30 s", "Sec. V-A", "< 0.001", ("atc",)),
    "longest": Claim("TC-CLiFF's ADE is below the networks' at 60 s", "Sec. V-A", "< 0.001", ("atc",)),
    "half": Claim("TC-CLiFF's ADE is over 50 % better than the networks' at 60 s", "Sec. V-A", "–", ("atc",)),
    "short": Claim("the networks are slightly better at 10 s (ATC), 5 s (Edinburgh)", "Sec. V-A", "–", ALL),
    "overtaking": Claim("at longer horizons the maps overtake the networks", "Sec. V-A", "–", ("edin",)),
    "best": Claim("TC-CLiFF has the lowest ADE", "tab:expres", "–", ("edin",)),
    "idling": Claim("the networks' FDE is lower in Edinburgh, by following those who idle", "Sec. V-A", "–", ("edin",)),
    "ranking": Claim("ranking helps, the more the longer the horizon", "Sec. V-A, fig:rank-metrics", "–", ALL),
    "beta": Claim("a lower β is better at long horizons", "Sec. V-B, fig:parameter", "–", ("atc",)),
    "radius": Claim("r_s close to the map resolution (1 m) is best", "Sec. V-B, fig:parameter", "–", ("atc",)),
    "walls": Claim("the networks' forecasts cross walls, the maps' do not", "Sec. V-C", "–", ("atc",)),
    "length": Claim("60 s and 20 s are the 90th percentiles of track length", "Sec. IV-B", "–", ALL),
    "rate": Claim("about 10 Hz on a CPU: 0.11 s (ATC), 0.04 s (Edinburgh) per track", "Sec. V-A, runtime", "–", ALL),
    "linear": Claim("time grows linearly with tracks N, horizon T and locations M", "Sec. V-A, runtime", "–", ALL),
    "size": Claim("273 MB of memory, 152 kB for an hour's map", "Sec. V-A, runtime", "–", ALL),
}
MEASURED = ("rate", "linear", "size")  # by the runtime study: other numbers each time, and other rows once it has run
COLUMNS = (
    "claim", "where", "the paper's p", "dataset", "protocol", "our test", "measured", "n", "clusters",
    "mean difference", "95 % CI", "p", "p Holm", "p Holm, opposite", "not forecast", "verdict",
)  # fmt: skip


_MADE_HERE = ("_opposite", "_known", "_opposite_known")  # p values that are not shown
# What is corrected here: the corrected p of the tests that only the claims make, and their p.
_OWN = {
    "p Holm": "p", "p Holm, opposite": "_opposite", "_known": "_known", "_opposite_known": "_opposite_known",
}  # fmt: skip


class Evidence(NamedTuple):
    """All that is known of one dataset.

    `tests` is the dataset's table of `comparisons.compare`; `errors` maps a method to `summary.at_horizons` of its
    errors at `horizons` [s]; `studies` maps a parameter to {value: the same}; `lengths` [n] are the seconds after t0 of
    the test tracks that the paper protocol counts; `idle` holds the `idle_keys` of those who stand about; `days` as
    of `comparisons.clusters`; `runtime` is what the runtime study measured, None if it has not run.
    """

    dataset: Dataset
    horizons: list[float]
    tests: pd.DataFrame
    errors: Mapping[str, ErrorsByOutput]
    studies: Mapping[str, Mapping[float, ErrorsByOutput]]
    lengths: np.ndarray
    idle: Collection[str]
    days: Mapping[str, str]
    runtime: Mapping[str, Any] | None


def claim_horizons(dataset: Dataset, table_horizons: Sequence[float]) -> list[float]:
    """Horizons [s] that the claims look at: the tables', a half and the whole of the longest, the short one."""
    longest = dataset.horizon_s
    half = round(max(dataset.steps // 2, 1) * dataset.time_step_s, 9)  # the same number as in the tables
    short = scored_horizons([SHORT_S[dataset.label]], dataset) if dataset.label in SHORT_S else []
    return sorted({*table_horizons, half, longest, *short})


def claimed_pairs(kinds: Mapping[str, str]) -> list[tuple[str, str]]:
    """The pairs (method, against) that claims compare, of methods {name: kind}: the paper's own, no variants."""
    maps = [method for method in ("tc_cliff", "cliff", "stef") if method in kinds]
    others = [method for method in kinds if method not in maps and of_the_paper(method, kinds)]
    pairs = [(one, other) for number, one in enumerate(maps) for other in maps[number + 1 :]]
    return [*pairs, *(("tc_cliff", other) for other in others if "tc_cliff" in maps)]


def idle_keys(name: str, tracks: Tracks, site: Site) -> set[str]:
    """Keys "recording/track" of a recording's usable tracks who stand about (`errors.stands_about`)."""
    rows = usable(tracks, site)
    idle = stands_about(tracks, rows, site)
    return {f"{name}/{track}" for track in tracks.track_id[rows[idle, 0]]}


def test_claims(evidence: Sequence[Evidence], titles: Mapping[str, str], kinds: Mapping[str, str]) -> pd.DataFrame:
    """One row per claim, dataset, protocol and test: a DataFrame of `COLUMNS`.

    `evidence` lists an `Evidence` per dataset; `titles` and `kinds` map the compared methods to their title and kind.
    """
    rows = []
    for key, claim in CLAIMS.items():
        head = {"claim": claim.text, "where": claim.where, "the paper's p": claim.p}
        for one in evidence:
            label = one.dataset.label
            if label in claim.labels or label not in ALL:  # on a dataset unknown to the paper, every claim is tested
                for row in TESTS[key](one, titles, kinds):
                    rows.append({**head, "dataset": one.dataset.title, **row})
    table = pd.DataFrame(rows).reindex(columns=[*COLUMNS, *_MADE_HERE])
    own = table["p"].notna() & table["p Holm"].isna()
    for _, group in table[own].groupby(["dataset", "protocol"]):
        for name, p in _OWN.items():
            table.loc[group.index, name] = holm(group[p])
    tested = table["p"].notna()
    table.loc[tested, "verdict"] = [_verdict(row) for _, row in table[tested].iterrows()]
    return table.reindex(columns=COLUMNS)


def _verdict(row):
    """Both sides need the same corrected p, and where a method could not forecast some tracks, the others' too."""
    for verdict, corrected, known in (
        ("supported", "p Holm", "_known"), ("contradicted", "p Holm, opposite", "_opposite_known"),
    ):  # fmt: skip
        if row[corrected] < ALPHA:
            rests = row["not forecast"] > 0 and not row[known] < ALPHA
            return f"{verdict} {WITHOUT_FORECAST}" if rests else verdict
    return "not shown"
