"""One table across sites: means over them, their spread, and paired tests whose unit is the site."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.ttests import holm, mean_test
from modlhmp.study.summary import main_output, sample_sd

KEYS = ("protocol", "horizon_s", "metric", "method")
NUMBERS = (
    "mean_m", "n", "eligible", "difference_m", "ci_low_m", "ci_high_m", "clusters", "n_paired", "n_unknown",
)  # fmt: skip
SITE = ("site", *KEYS, "output", *NUMBERS, "why")
ACROSS = (
    *KEYS, "sites", "mean_m", "sd_m", "n", "eligible", "coverage", "against", "sites_paired", "difference_m",
    "ci_low_m", "ci_high_m", "p", "p_greater", "p_holm", "p_greater_holm", "sites_unknown", "left_out", "not_paired",
)  # fmt: skip


def site_rows(
    site: str, scores: pd.DataFrame, tests: pd.DataFrame, reference: str, horizons: Sequence[float]
) -> pd.DataFrame:
    """What a site adds to the table: one row per protocol, horizon [s], metric and method (`SITE`).

    `scores` is its run's `results.csv`, `tests` its table of t-tests, of which the pairs with `reference` are taken.
    """
    rows = []
    outputs = {name: main_output(set(group)) for name, group in scores.groupby("method", sort=False)["output"]}
    for protocol in PROTOCOLS:
        for horizon in horizons:
            for metric in ("ade", "fde"):
                for method, output in outputs.items():
                    score = _one(scores, horizon, method=method, output=output, protocol=protocol)
                    wanted = {"method": method, "against": reference, "metric": metric, "protocol": protocol}
                    pair = None if method == reference else _one(tests, horizon, **wanted)
                    numbers = [score[f"{metric}_m"], score["n"], score["eligible"], *[np.nan] * 6]
                    if pair is not None:
                        of_pair = ("mean_difference_m", "ci_low_m", "ci_high_m", "clusters", "n", "n_unknown")
                        numbers[3:] = [pair[name] for name in of_pair]
                    rows.append(
                        (site, protocol, horizon, metric, method, output, *numbers, _why(score, pair, reference))
                    )
    return pd.DataFrame(rows, columns=SITE)


def _one(table, horizon, **wanted):
    """The row of a table."""
    mine = np.isclose(table["horizon_s"], horizon)
    for name, value in wanted.items():
        mine &= (table[name] == value).to_numpy()
    return table[mine].iloc[0]


def _why(score, pair, reference):
    """Why a number of a site is missing; empty where none is."""
    if not score["eligible"]:
        return "no test track lasts as long"
    if not score["n"]:
        return "no forecast is scored"
    if pair is not None and not pair["n"]:
        return f"no track that {reference} scored, too"
    if pair is not None and pair["clusters"] < 2:
        return "one person or day only: no interval within the site"
    return ""


def gather(found: Mapping[str, pd.DataFrame | str], reference: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The table across sites (`ACROSS`), and all sites' own rows (`SITE`), a row for each site and line of the table.

    `found` maps a site to its `site_rows`, or to the reason why it has none. Where a site has no such method or
    horizon, or nothing to score, its row has no numbers and says why.
    """
    tables = [rows for rows in found.values() if isinstance(rows, pd.DataFrame)]
    joined = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame(columns=SITE)
    joined["horizon_s"] = joined["horizon_s"].astype(float).round(9)
    order = {"protocol": list(PROTOCOLS), "metric": ["ade", "fde"], "method": list(dict.fromkeys(joined["method"]))}
    keys = sorted(
        set(joined[list(KEYS)].itertuples(index=False, name=None)),
        key=lambda key: [order[name].index(one) if name in order else one for name, one in zip(KEYS, key, strict=True)],
    )
    by_key = {(row.site, *(getattr(row, name) for name in KEYS)): row for row in joined.itertuples(index=False)}
    missing = {site: _lacks(rows) for site, rows in found.items()}
    by_site = pd.DataFrame(
        [
            tuple(by_key.get((site, *key), (site, *key, "", *[np.nan] * len(NUMBERS), missing[site](key))))
            for key in keys
            for site in found
        ],
        columns=SITE,
    )
    across = [(*key, *_across(rows, reference)) for key, rows in by_site.groupby(list(KEYS), sort=False)]
    table = pd.DataFrame(across, columns=[name for name in ACROSS if "holm" not in name])
    for side in ("p", "p_greater"):
        table[f"{side}_holm"] = table.groupby("protocol")[side].transform(holm) if len(table) else []
    return table[list(ACROSS)], by_site


def _lacks(rows):
    """Function of a line's key: why a site has no such row."""
    if isinstance(rows, str):
        return lambda key: rows
    methods, longest = set(rows["method"]), rows["horizon_s"].max()
    return lambda key: (
        f"no horizon of {key[1]:g} s there (the longest is {longest:g} s)"
        if key[3] in methods
        else "not compared there"
    )


def _across(rows, reference):
    """A line's numbers from `sites` to `not_paired`, but for the corrected p."""
    values, differences = rows["mean_m"].to_numpy(float), rows["difference_m"].to_numpy(float)
    known, paired = np.isfinite(values), np.isfinite(differences)
    n, eligible = rows["n"][known].sum(), rows["eligible"][known].sum()
    test = mean_test(differences)
    is_reference = rows["method"].iloc[0] == reference
    left, unpaired = (
        "; ".join(f"{row.site}: {row.why}" for row in rows[which].itertuples())
        for which in (~known, known & ~paired & (not is_reference))
    )
    return (
        int(known.sum()), float(np.mean(values[known])) if known.any() else np.nan, sample_sd(values), n, eligible,
        n / eligible if eligible else np.nan, "" if is_reference else reference, int(paired.sum()),
        test.mean, test.low, test.high, test.p, test.p_greater, int((rows["n_unknown"] > 0).sum()), left, unpaired,
    )  # fmt: skip
