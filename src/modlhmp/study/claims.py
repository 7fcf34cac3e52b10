"""Every claim of the paper's results section beside our test of it and a verdict.

Tests are paired and one-sided on the tracks that both sides scored (`scoring.ttests.paired_test`), Holm-corrected over
the claims of one dataset and protocol.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from modlhmp.datasets import Dataset
from modlhmp.kinds import find
from modlhmp.scoring.errors import is_idle, nan_mean
from modlhmp.scoring.horizons import scored_horizons
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.ttests import holm, paired_test
from modlhmp.site import IdleFilter
from modlhmp.study.published import MAP_KB, MEMORY_MB, PERCENTILE_S, SECONDS_PER_TRACK, SHORT_S
from modlhmp.study.summary import ErrorsByOutput, main_output
from modlhmp.tracks import Tracks, usable_tracks

IDLE = IdleFilter()  # people who stand about, on any dataset, also where the paper protocol keeps them
NO_RUNTIME = "needs the runtime study (snakemake runtime) and the paper's number"
ALL = ("atc", "edin")


class Claim(NamedTuple):
    """What the paper says, where, with which p, and of which datasets (labels)."""

    text: str
    where: str
    p: str
    labels: tuple[str, ...]


CLAIMS = {
    "tc_cliff": Claim("TC-CLiFF is better than CLiFF", "Sec. V-A, tab:expres", "< 0.001", ALL),
    "stef": Claim("CLiFF-based methods are better than STeF over 30 s", "Sec. V-A", "< 0.001", ("atc",)),
    "half": Claim("TC-CLiFF's ADE is over 50 % better than the networks' at 60 s", "Sec. V-A", "< 0.001", ("atc",)),
    "short": Claim("the networks are slightly better at 10 s (ATC), 5 s (Edinburgh)", "Sec. V-A", "–", ALL),
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
COLUMNS = (
    "claim", "where", "the paper's p", "dataset", "protocol", "our test", "measured", "n",
    "mean difference", "95 % CI", "p", "p Holm", "verdict",
)  # fmt: skip


class Evidence(NamedTuple):
    """All that is known of one dataset.

    `errors` maps a method to `summary.at_horizons` of its errors at `horizons` [s]; `studies` maps a parameter to
    {value: the same}; `lengths` [n] are the seconds after t0 of the usable test tracks; `idle` holds the keys of those
    who stand about (`IDLE`); `runtime` is what the runtime study measured, None if it has not run.
    """

    dataset: Dataset
    horizons: list[float]
    errors: Mapping[str, ErrorsByOutput]
    studies: Mapping[str, Mapping[float, ErrorsByOutput]]
    lengths: np.ndarray
    idle: Collection[str]
    runtime: Mapping[str, Any] | None


def claim_horizons(dataset: Dataset, table_horizons: Sequence[float]) -> list[float]:
    """Horizons [s] that the claims look at: the tables', a half and the whole of the longest, the short one."""
    longest, step = dataset.horizon_s, dataset.time_step_s
    half = max(round(longest / 2 / step), 1) * step
    short = SHORT_S.get(dataset.label, half)
    return sorted({*scored_horizons(table_horizons, dataset), half, longest, *([short] if short <= longest else [])})


def idle_keys(name: str, tracks: Tracks, observed_rows: int) -> set[str]:
    """Keys "recording/track" of a recording's usable tracks who stand about, by `IDLE`."""
    rows = usable_tracks(tracks, observed_rows)
    idle = is_idle(tracks, rows, IDLE.rows, IDLE.min_displacement_m)
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
                for row in _TESTS[key](one, titles, kinds):
                    rows.append({**head, "dataset": one.dataset.title, **row})
    table = pd.DataFrame(rows)
    tested = table["p"].notna()
    table["p Holm"] = np.nan
    for _, group in table[tested].groupby(["dataset", "protocol"]):
        table.loc[group.index, "p Holm"] = holm(group["p"])
    table.loc[tested, "verdict"] = [_verdict(row) for _, row in table[tested].iterrows()]
    return table.reindex(columns=COLUMNS)


# --- one function per claim: yields rows of "protocol", "our test", "measured" and either p or a verdict -------------


def _tc_cliff(one, titles, _kinds):
    yield from _better(one, titles, "tc_cliff", "cliff", [one.dataset.horizon_s])
    if {"tc_cliff", "cliff"} <= one.errors.keys():
        for protocol in PROTOCOLS:
            gaps = [_means(one, "tc_cliff", "cliff", protocol, "ade", h) for h in one.horizons]
            lower = sum(ours < theirs for ours, theirs in gaps)
            verdict = {len(gaps): "supported", 0: "contradicted"}.get(lower, "not at every horizon")
            text = f"{titles['tc_cliff']}'s ADE is lower at every horizon of {_list(one.horizons)} s"
            yield _row(protocol, text, f"at {lower} of {len(gaps)}", verdict=verdict)


def _stef(one, titles, _kinds):
    longer = [h for h in one.horizons if h > 30]
    for method in ("tc_cliff", "cliff"):
        yield from _better(one, titles, method, "stef", longer)


def _half(one, titles, kinds):
    for learned in _learned(one, kinds):
        yield from _better(one, titles, "tc_cliff", learned, [one.dataset.horizon_s], ("ade",), factor=0.5)
    yield from _if_none(one, kinds)


def _short(one, titles, kinds):
    for learned in _learned(one, kinds):
        horizon = SHORT_S.get(one.dataset.label, one.horizons[0])
        yield from _better(one, titles, learned, "tc_cliff", [horizon], ("ade",))
    yield from _if_none(one, kinds)


def _idling(one, titles, kinds):
    for learned in _learned(one, kinds):
        longest = one.dataset.horizon_s
        yield from _better(one, titles, learned, "tc_cliff", [longest], ("fde",))
        if "tc_cliff" in one.errors:
            for protocol in PROTOCOLS:
                mine, other, keys = _pair(one, learned, "tc_cliff", protocol, "fde", longest)
                gain, idle = mine - other, np.isin(keys, list(one.idle))
                text = f"FDE {titles[learned]} - {titles['tc_cliff']}, {longest:g} s: those who idle < the others"
                yield _tested_groups(protocol, text, gain[idle], gain[~idle])
    yield from _if_none(one, kinds)


def _ranking(one, titles, kinds):
    method = next((m for m in one.errors if kinds[m] == "tc_cliff"), None)
    if method is None:
        yield _row("", "needs TC-CLiFF among the compared methods", "", verdict="not tested")
        return
    longest = one.dataset.horizon_s
    half = max(h for h in one.horizons if h <= longest / 2)
    for protocol in PROTOCOLS:
        ranked, mean = (one.errors[method][output, protocol].ade[0] for output in ("ranked", "mean"))
        last, middle = one.horizons.index(longest), one.horizons.index(half)
        gain = ranked - mean
        texts = f"ADE ranked < mean of the k, {longest:g} s", f"gain at {longest:g} s > gain at {half:g} s"
        yield _tested(protocol, texts[0], ranked[:, last], mean[:, last])
        yield _tested(protocol, texts[1], gain[:, last], gain[:, middle])


def _beta(one, _titles, _kinds):
    values = sorted(one.studies.get("beta", {}))
    pairs = [(values[0], values[-1])] if len(values) > 1 else []
    pairs += [(low, 1) for low in values if low < 1] if 1 in values else []
    yield from _study(one, "beta", pairs, "β")


def _radius(one, _titles, _kinds):
    values = sorted(one.studies.get("sampling_radius_m", {}))
    yield from _study(one, "sampling_radius_m", [(1, v) for v in values if v != 1] if 1 in values else [], "r_s")


def _walls(one, titles, kinds):
    if not one.dataset.floor_plan:
        yield _row("", "needs a floor plan", "", verdict="not tested")
        return
    longest = one.dataset.horizon_s
    for method in ("tc_cliff", "cliff", "stef"):
        for other in [*_learned(one, kinds), *(m for m in one.errors if kinds[m] == "cvm")]:
            yield from _better(one, titles, method, other, [longest], ("infeasible",))
    yield from _if_none(one, kinds)


def _length(one, _titles, _kinds):
    claimed = PERCENTILE_S.get(one.dataset.label)
    if claimed is None or len(one.lengths) < 2:
        yield _row("", "needs test tracks and the paper's number", "", verdict="not tested")
        return
    test = stats.quantile_test(one.lengths, q=claimed, p=0.9)
    low, high = test.confidence_interval(0.95)
    yield {
        **_row("", f"90th percentile of seconds after t0 is {claimed:g} s", f"{np.percentile(one.lengths, 90):.1f} s",
               verdict="supported" if low <= claimed <= high else "contradicted"),
        "n": len(one.lengths), "95 % CI": f"{low:.1f} to {high:.1f} s",
    }  # fmt: skip


def _rate(one, _titles, _kinds):
    claimed = SECONDS_PER_TRACK.get(one.dataset.label)
    if one.runtime is None or claimed is None:
        yield _row("", NO_RUNTIME, "", verdict="not tested")
        return
    seconds = one.runtime["latency_s"]  # of a single track: many together share the fixed cost of a call
    text = f"at most {claimed:g} s per track, k = {one.runtime['k']}, {one.runtime['horizon_s']:g} s (another machine)"
    row = _row("", text, f"{1000 * seconds:.3g} ms", verdict="supported" if seconds <= claimed else "contradicted")
    yield {**row, "n": one.runtime["tracks"]}


def _linear(one, _titles, _kinds):
    if one.runtime is None:
        yield _row("", NO_RUNTIME, "", verdict="not tested")
        return
    for name, (slope, low, high) in one.runtime["exponents"].items():
        verdict = "supported" if low <= 1 <= high else ("grows faster" if low > 1 else "grows more slowly")
        verdict = verdict if np.isfinite(slope) else "not tested"  # fewer than three sizes
        row = _row("", f"the exponent of time in {name} is 1", f"{slope:.2f}", verdict=verdict)
        yield {**row, "n": len(one.runtime["growth"][name]), "95 % CI": f"{low:.2f} to {high:.2f}"}


def _size(one, _titles, _kinds):
    if one.runtime is None:
        yield _row("", NO_RUNTIME, "", verdict="not tested")
        return
    for key, claimed, unit in (("memory_mb", MEMORY_MB, "MB"), ("map_kb", MAP_KB, "kB")):
        ours = one.runtime[key]
        verdict = "ours is smaller" if ours < claimed else "ours is larger"
        yield _row("", f"{claimed:g} {unit}", f"{ours:.0f} {unit}", verdict=verdict)


_TESTS = {
    "tc_cliff": _tc_cliff, "stef": _stef, "half": _half, "short": _short, "idling": _idling, "ranking": _ranking,
    "beta": _beta, "radius": _radius, "walls": _walls, "length": _length, "rate": _rate, "linear": _linear,
    "size": _size,
}  # fmt: skip


# --- helpers ---------------------------------------------------------------------------------------------------------


def _better(one, titles, ours, theirs, horizons, metrics=("ade", "fde"), factor=1.0):
    """Paired tests that `ours` is below `factor` times `theirs`."""
    if missing := [method for method in (ours, theirs) if method not in one.errors]:
        yield _row("", f"needs {', '.join(missing)} among the compared methods", "", verdict="not tested")
        return
    times = "" if factor == 1.0 else f"{factor:g} × "
    for protocol in PROTOCOLS:
        for metric in metrics:
            for horizon in horizons:
                mine, other, _ = _pair(one, ours, theirs, protocol, metric, horizon)
                name = metric.upper() if metric != "infeasible" else "share into walls"
                text = f"{name} {titles[ours]} < {times}{titles[theirs]}, {horizon:g} s"
                yield _tested(protocol, text, mine, factor * other)


def _study(one, parameter, pairs, symbol):
    """Paired tests that the first value of each pair is better than the second, at the longest horizon."""
    if not pairs:
        yield _row("", f"needs a study of {symbol} with these values", "", verdict="not tested")
        return
    last = one.horizons.index(one.dataset.horizon_s)
    for protocol in PROTOCOLS:
        for values in pairs:
            sides = [one.studies[parameter][value] for value in values]
            mine, other = (side[main_output({o for o, _ in side}), protocol].ade[0, :, last] for side in sides)
            text = f"ADE {symbol} = {values[0]:g} < {symbol} = {values[1]:g}, {one.dataset.horizon_s:g} s"
            yield _tested(protocol, text, mine, other)


def _pair(one, ours, theirs, protocol, metric, horizon):
    """Values of both methods on the tracks that both have, in the same order, and the tracks' keys."""
    sides = [one.errors[m][main_output({o for o, _ in one.errors[m]}), protocol] for m in (ours, theirs)]
    keys, *at = np.intersect1d(sides[0].keys, sides[1].keys, return_indices=True)
    column = one.horizons.index(horizon)
    values = [getattr(side, metric)[0, rows, column].astype(float) for side, rows in zip(sides, at, strict=True)]
    return *values, keys


def _means(one, ours, theirs, protocol, metric, horizon):
    """Mean of both methods over the tracks that both scored."""
    mine, other, _ = _pair(one, ours, theirs, protocol, metric, horizon)
    both = np.isfinite(mine) & np.isfinite(other)
    return nan_mean(np.where(both, mine, np.nan), 0), nan_mean(np.where(both, other, np.nan), 0)


def _tested(protocol, text, mine, other):
    """A row with the paired test of mine < other."""
    mine, other = np.asarray(mine, float), np.asarray(other, float)
    n, mean, low, high, _, _, p = paired_test(mine, other)
    both = np.isfinite(mine) & np.isfinite(other)
    measured = f"{mine[both].mean():.3f} against {other[both].mean():.3f}" if n else ""
    verdict = "" if np.isfinite(p) else ("no difference" if n > 1 else "too few tracks")
    interval = f"{low:.3f} to {high:.3f}" if np.isfinite(low) else ""
    numbers = {"n": n, "mean difference": mean, "95 % CI": interval, "p": p, "_low": low}
    return {**_row(protocol, text, measured, verdict), **numbers}


def _tested_groups(protocol, text, first, second):
    """A row with Welch's test of mean(first) < mean(second), of different tracks."""
    first, second = (group[np.isfinite(group)] for group in (first, second))
    if min(len(first), len(second)) < 2:
        return _row(protocol, text, f"{len(first)} and {len(second)} tracks", "too few tracks")
    test = stats.ttest_ind(first, second, equal_var=False, alternative="less")
    interval = stats.ttest_ind(first, second, equal_var=False).confidence_interval(0.95)
    return {
        **_row(protocol, text, f"{first.mean():.3f} (n {len(first)}) against {second.mean():.3f} (n {len(second)})"),
        "n": len(first) + len(second), "mean difference": first.mean() - second.mean(),
        "95 % CI": f"{interval.low:.3f} to {interval.high:.3f}", "p": test.pvalue, "_low": interval.low,
    }  # fmt: skip


def _row(protocol, text, measured, verdict=""):
    return {"protocol": protocol, "our test": text, "measured": measured, "verdict": verdict, "p": np.nan}


def _verdict(row):
    if row["p Holm"] < 0.05:
        return "supported"
    return "contradicted" if row["_low"] > 0 else "not shown"


def _learned(one, kinds):
    """The paper's networks: its claims are about them."""
    records = {method: find(kinds[method]) for method in one.errors}
    return [method for method, kind in records.items() if kind.learned and kind.published]


def _if_none(one, kinds):
    if not _learned(one, kinds):
        yield _row("", "needs learned methods (none is compared here)", "", verdict="not tested")


def _list(horizons):
    return ", ".join(f"{h:g}" for h in horizons)
