"""One test for each of the paper's claims (`study.claims`): functions that yield its rows of the table.

Each takes (evidence of one dataset, {method: title}, {method: kind}) and yields rows of "protocol", "our test",
"measured", and either numbers with a p or a verdict.
"""

from collections.abc import Mapping

import numpy as np

from modlhmp.kinds import find
from modlhmp.scoring.errors import seed_mean
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.scoring.ttests import SAME, groups_test, paired_test
from modlhmp.study import lacks
from modlhmp.study.comparisons import main_errors, side_by_side, tracks_of, with_known
from modlhmp.study.published import MAP_KB, MEMORY_MB, PERCENTILE_S, SECONDS_PER_TRACK, SHORT_S

CONSTANT = "the difference does not vary: not tested"
NOT_CONTRADICTED = "not contradicted"  # the interval holds the number: that does not show that it is this one
NO_RUNTIME = "needs the runtime study (snakemake runtime) and the paper's number"


def _tc_cliff(one, titles, _kinds):
    if one.dataset.clock == "estimated":
        yield _row("", str(lacks.ESTIMATED_CLOCK), "", verdict="not tested")
        return
    yield from _better(one, titles, "tc_cliff", "cliff", [one.dataset.horizon_s])
    if {"tc_cliff", "cliff"} <= one.errors.keys():
        for protocol in PROTOCOLS:
            gaps = [_means(one, "tc_cliff", "cliff", protocol, "ade", h) for h in one.horizons]
            lower = sum(ours < theirs for ours, theirs in gaps)
            text = f"{titles['tc_cliff']}'s ADE is lower at every horizon of {_list(one.horizons)} s"
            yield _row(protocol, text, f"at {lower} of {len(gaps)}", verdict="counted, not tested")


def _stef(one, titles, _kinds):
    longer = [h for h in one.horizons if h > 30]
    if not longer:
        yield _row("", str(lacks.NEEDS_LONGER), "", verdict="not tested")
        return
    for method in ("tc_cliff", "cliff"):
        yield from _better(one, titles, method, "stef", longer)


def _longest(one, titles, kinds):
    for learned in _learned(one, kinds):
        yield from _better(one, titles, "tc_cliff", learned, [one.dataset.horizon_s], ("ade",))
    yield from _if_none(one, kinds)


def _best(one, titles, kinds):
    for other in kinds:
        if other != "tc_cliff" and of_the_paper(other, kinds):
            yield from _better(one, titles, "tc_cliff", other, [one.dataset.horizon_s], ("ade",))


def _half(one, titles, kinds):
    for learned in _learned(one, kinds) if "tc_cliff" in one.errors else ():
        for protocol in PROTOCOLS:
            both, column = _pair(one, "tc_cliff", learned, protocol, "ade"), one.horizons.index(one.dataset.horizon_s)
            text = f"ADE {titles['tc_cliff']} < 0.5 × {titles[learned]}, {one.dataset.horizon_s:g} s"
            yield _paired(protocol, text, both, both.ours[:, :, column], 0.5 * both.theirs[:, :, column])
    yield from _if_none(one, kinds)


def _short(one, titles, kinds):
    for learned in _learned(one, kinds):
        short = SHORT_S.get(one.dataset.label)
        horizon = short if short in one.horizons else one.horizons[0]
        yield from _better(one, titles, learned, "tc_cliff", [horizon], ("ade",))
    yield from _if_none(one, kinds)


def _idling(one, titles, kinds):
    for learned in _learned(one, kinds):
        longest = one.dataset.horizon_s
        yield from _better(one, titles, learned, "tc_cliff", [longest], ("fde",))
        if "tc_cliff" in one.errors:
            for protocol in PROTOCOLS:
                both, column = _pair(one, learned, "tc_cliff", protocol, "fde"), one.horizons.index(longest)
                gain, idle = (both.ours - both.theirs)[:, :, column], np.isin(tracks_of(both.keys), list(one.idle))
                text = f"FDE {titles[learned]} - {titles['tc_cliff']}, {longest:g} s: those who idle < the others"
                yield _groups(protocol, text, both, gain, idle)
    yield from _if_none(one, kinds)


def _ranking(one, _titles, _kinds):
    outputs = one.errors.get("tc_cliff", {})
    if not {(output, protocol) for output in ("ranked", "mean") for protocol in PROTOCOLS} <= set(outputs):
        yield _row("", "needs TC-CLiFF with ranked futures among the compared methods", "", verdict="not tested")
        return
    longest = one.dataset.horizon_s
    half = max((h for h in one.horizons if h <= longest / 2), default=longest)  # of a single step there is none
    last, middle = one.horizons.index(longest), one.horizons.index(half)
    for protocol in PROTOCOLS:
        both = side_by_side(outputs["ranked", protocol], outputs["mean", protocol], "ade", one.days)
        gain = both.ours - both.theirs
        texts = f"ADE ranked < mean of the k, {longest:g} s", f"gain at {longest:g} s > gain at {half:g} s"
        yield _paired(protocol, texts[0], both, both.ours[:, :, last], both.theirs[:, :, last])
        yield _paired(protocol, texts[1], both, gain[:, :, last], gain[:, :, middle])


def _beta(one, _titles, _kinds):
    values = sorted(one.studies.get("beta", {}))
    pairs = [(values[0], values[-1])] if len(values) > 1 else []
    pairs += [(low, 1) for low in values if low < 1] if 1 in values else []
    yield from _study(one, "beta", list(dict.fromkeys(pairs)), "β")


def _radius(one, _titles, _kinds):
    values = sorted(one.studies.get("sampling_radius_m", {}))
    yield from _study(one, "sampling_radius_m", [(1, v) for v in values if v != 1] if 1 in values else [], "r_s")


def _walls(one, titles, kinds):
    if not one.dataset.floor_plan:
        yield _row("", str(lacks.NEEDS_PLAN), "", verdict="not tested")
        return
    longest = one.dataset.horizon_s
    for ours in (method for method in ("tc_cliff", "cliff", "stef") if method in one.errors):
        for theirs in _learned(one, kinds):
            for protocol in PROTOCOLS:
                both, column = _pair(one, ours, theirs, protocol, "infeasible"), one.horizons.index(longest)
                text = f"share into walls {titles[ours]} < {titles[theirs]}, {longest:g} s"
                yield _paired(protocol, text, both, both.ours[:, :, column], both.theirs[:, :, column])
    yield from _if_none(one, kinds)


def _length(one, _titles, _kinds):
    claimed = PERCENTILE_S.get(one.dataset.label)
    if claimed is None or len(one.lengths) < 2:
        yield _row("", str(lacks.NEEDS_NUMBER), "", verdict="not tested")
        return
    from scipy import stats  # noqa: PLC0415 - takes a second to load, and only this claim needs it

    test = stats.quantile_test(one.lengths, q=claimed, p=0.9)
    low, high = test.confidence_interval(0.95)
    bounded = np.isfinite(high)  # of few tracks even the longest may be below the percentile
    text = f"90th percentile of seconds after t0 is {claimed:g} s (tracks as independent)"
    yield {
        **_row("", text, f"{np.percentile(one.lengths, 90):.1f} s",
               verdict="contradicted" if claimed < low or (bounded and claimed > high) else NOT_CONTRADICTED),
        "n": len(one.lengths), "95 % CI": f"{low:.1f} to {high:.1f} s" if bounded else f"from {low:.1f} s",
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
        verdict = NOT_CONTRADICTED if low <= 1 <= high else ("grows faster" if low > 1 else "grows more slowly")
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


TESTS = {
    "tc_cliff": _tc_cliff, "stef": _stef, "longest": _longest, "half": _half, "short": _short, "overtaking": _longest,
    "best": _best, "idling": _idling, "ranking": _ranking, "beta": _beta, "radius": _radius, "walls": _walls,
    "length": _length, "rate": _rate, "linear": _linear, "size": _size,
}  # fmt: skip


# --- helpers ---------------------------------------------------------------------------------------------------------


def _better(one, titles, ours, theirs, horizons, metrics=("ade", "fde")):
    """Rows of the run's tests that `ours` is below `theirs`; a test of the other direction serves by its other side."""
    if missing := [method for method in (ours, theirs) if method not in one.errors]:
        yield _row("", f"needs {', '.join(missing)} among the compared methods", "", verdict="not tested")
        return
    table = one.tests.set_index(["protocol", "metric", "horizon_s", "method", "against"])
    for protocol in PROTOCOLS:
        for metric in metrics:
            for horizon in horizons:
                text = f"{metric.upper()} {titles[ours]} < {titles[theirs]}, {horizon:g} s"
                place = (protocol, metric, horizon)
                swapped = (*place, ours, theirs) not in table.index
                found = table.loc[(*place, theirs, ours) if swapped else (*place, ours, theirs)]
                yield _looked_up(protocol, text, found, swapped)


def _looked_up(protocol, text, found, swapped):
    """A row from a test of the table; `swapped` if that is of the other method first."""
    sides, ends, means, sign = ["p", "p_greater"], ["ci_low_m", "ci_high_m"], ["mean_m", "mean_against_m"], 1.0
    if swapped:
        sides, ends, means, sign = sides[::-1], ends[::-1], means[::-1], -1.0
    low, high = (sign * found[name] for name in ends)
    values = [found[name] for name in means]
    measured = "{:.3f} against {:.3f}".format(*values) if found["n"] else ""
    corrected = {"p Holm": found[f"{sides[0]}_holm"], "p Holm, opposite": found[f"{sides[1]}_holm"]}
    known = {"_known": found[f"{sides[0]}_known_holm"], "_opposite_known": found[f"{sides[1]}_known_holm"]}
    return {
        **_row(protocol, text, measured, _untested(found["p"], found["clusters"], values)), **corrected, **known,
        **_numbers(found["n"], found["clusters"], sign * found["mean_difference_m"], low, high, found[sides[0]]),
        "not forecast": found["n_unknown"],
    }  # fmt: skip


def _study(one, parameter, pairs, symbol):
    """Paired tests that the first value of each pair is better than the second, at the longest horizon."""
    if not pairs:
        yield _row("", f"needs a study of {symbol} with these values", "", verdict="not tested")
        return
    last = one.horizons.index(one.dataset.horizon_s)
    for protocol in PROTOCOLS:
        for values in pairs:
            first, second = (main_errors(one.studies[parameter][value], protocol) for value in values)
            both = side_by_side(first, second, "ade", one.days)
            text = f"ADE {symbol} = {values[0]:g} < {symbol} = {values[1]:g}, {one.dataset.horizon_s:g} s"
            yield _paired(protocol, text, both, both.ours[:, :, last], both.theirs[:, :, last])


def _pair(one, ours, theirs, protocol, metric):
    """Two methods' values side by side."""
    sides = main_errors(one.errors[ours], protocol), main_errors(one.errors[theirs], protocol)
    return side_by_side(*sides, metric, one.days)


def _means(one, ours, theirs, protocol, metric, horizon):
    """Mean of both methods over the tracks that both scored."""
    both, column = _pair(one, ours, theirs, protocol, metric), one.horizons.index(horizon)
    return [float(seed_mean(part[:, :, column])) for part in (both.ours, both.theirs)]


def _paired(protocol, text, both, ours, theirs):
    """A row with the paired test of ours < theirs, [seeds, tracks] of the tracks of `both`."""
    scored = np.isfinite(ours) & np.isfinite(theirs)
    tests = with_known(paired_test, both.unknown, scored.any(axis=0), ours, theirs, both.cluster)
    means = [float(seed_mean(np.where(scored, part, np.nan))) for part in (ours, theirs)]
    return _of_tests(protocol, text, "{:.3f} against {:.3f}".format(*means) if tests[0].n else "", means, *tests)


def _groups(protocol, text, both, values, first):
    """A row with the test of mean(first) < mean(others), of different tracks of `both`; `values` [seeds, tracks]."""
    scored = np.isfinite(values).any(axis=0)
    sizes = [int((scored & group).sum()) for group in (first, ~first)]
    if min(sizes) < 2:
        return _row(protocol, text, f"{sizes[0]} and {sizes[1]} tracks", str(lacks.TOO_FEW))
    tests = with_known(groups_test, both.unknown, scored, values, first, ~first, both.cluster)
    means = [float(seed_mean(values[:, group])) for group in (first, ~first)]
    measured = f"{means[0]:.3f} (n {sizes[0]}) against {means[1]:.3f} (n {sizes[1]})"
    return _of_tests(protocol, text, measured, means, *tests)


def _of_tests(protocol, text, measured, means, test, unknown, known):
    """A row of a test that is made here; the last three as of `with_known`."""
    return {
        **_row(protocol, text, measured, _untested(test.p, test.clusters, means)),
        **_numbers(test.n, test.clusters, test.mean, test.low, test.high, test.p), "not forecast": unknown,
        "_opposite": test.p_greater, "_known": known.p, "_opposite_known": known.p_greater,
    }  # fmt: skip


def _numbers(n, clusters, mean, low, high, p):
    interval = f"{low:.3f} to {high:.3f}" if np.isfinite(low) else ""
    return {"n": n, "clusters": clusters, "mean difference": mean, "95 % CI": interval, "p": p}


def _untested(p, clusters, means):
    """What is said instead of a verdict where there is no p."""
    if np.isfinite(p):
        return ""
    if clusters < 2:
        return str(lacks.TOO_FEW)
    return "no difference" if abs(means[0] - means[1]) <= SAME * max(map(abs, means)) else CONSTANT


def _row(protocol, text, measured, verdict=""):
    return {"protocol": protocol, "our test": text, "measured": measured, "verdict": verdict, "p": np.nan}


def _learned(one, kinds):
    """The paper's networks: its claims are about them."""
    return [method for method in one.errors if of_the_paper(method, kinds) and find(kinds[method]).learned]


def of_the_paper(method: str, kinds: Mapping[str, str]) -> bool:
    """Whether a method is the paper's own: of one of its kinds, under that name, and no variant of it."""
    return kinds[method] == method and find(method).published


def _if_none(one, kinds):
    if not _learned(one, kinds):
        yield _row("", "needs learned methods (none is compared here)", "", verdict="not tested")


def _list(horizons):
    return ", ".join(f"{h:g}" for h in horizons)
