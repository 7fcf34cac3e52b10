"""The results table under every reading of the scoring rules, which the paper does not state.

Three questions are open: whether tracks of people who stand about count, what becomes of a track whose forecasts have
left the map (not scored, or held at the last position), and which tracks a mean over seeds is of, where each seed
scores others. The velocity at t0 is a fourth, and a method's own option.
"""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.windows import in_order, windows
from modlhmp.scenes import Scenes
from modlhmp.scoring.errors import nan_mean, seed_mean, stands_about, truth_of
from modlhmp.scoring.protocols import score
from modlhmp.site import Site
from modlhmp.study.summary import main_output
from modlhmp.tracks import Tracks

COLUMNS = ("idle", "left", "tracks", "ade_m", "fde_m", "n", "eligible")
OWN, UNION, COMMON = "each seed's own", "that any seed scored", "that all seeds scored"


def readings(
    recordings: Iterable[tuple[Tracks, Iterable[tuple[int, np.ndarray, Forecast]], Scenes | None]], site: Site
) -> pd.DataFrame:
    """One method's errors at the longest horizon under each reading; a DataFrame of `COLUMNS`.

    `recordings` yields (tracks, forecasts as of `files.read_forecasts`, scenes). `idle`: whether idle tracks are `kept`
    or `dropped`; `left`: tracks whose futures have all left the map are `held` or `dropped`; `tracks`: which the mean
    is of; `n` scored (mean over seeds where each has its own) of `eligible`.
    """
    every = [_errors(*one, site) for one in recordings]
    parts = [part for part in every if len(part["idle"])] or every[:1]  # one without tracks has no seeds either
    idle, eligible = (np.concatenate([part[name] for part in parts]) for name in ("idle", "eligible"))
    rows = []
    for treated, counted in (("kept", eligible), ("dropped", eligible & ~idle)):
        for left in ("held", "dropped"):
            ade, fde = (
                np.where(counted, np.concatenate([part[left, metric] for part in parts], axis=1), np.nan)
                for metric in ("ade", "fde")
            )
            for name in (OWN,) if left == "held" else (OWN, UNION, COMMON):
                means, n = _mean(name, ade, fde)
                rows.append((treated, left, name, *means, n, int(counted.sum())))
    return pd.DataFrame(rows, columns=COLUMNS)


def _errors(tracks, forecasts, scenes, site):
    """ADE and FDE [seeds, tracks] of a recording at the longest horizon, held and dropped; who idles, who counts."""
    wanted = windows(tracks, site, scenes)
    truth, length = truth_of(tracks, wanted, site)
    by_seed: dict[int, list[dict]] = {}
    for seed, mine, forecast in in_order(forecasts, wanted):
        found = score(forecast, truth[mine], {"paper": length[mine], "complete": length[mine]})
        output = main_output({name for name, _ in found})
        block = {
            (left, metric): found[output, protocol][metric][:, -1]
            for left, protocol in (("held", "complete"), ("dropped", "paper"))
            for metric in ("ade", "fde")
        }
        by_seed.setdefault(seed, []).append(block)
    return {
        "idle": stands_about(tracks, wanted.tracks, site)[wanted.of],
        "eligible": length >= site.steps,
        **{
            (left, metric): np.stack([np.concatenate([b[left, metric] for b in some]) for some in by_seed.values()])
            if by_seed
            else np.empty((1, 0))
            for left in ("held", "dropped")
            for metric in ("ade", "fde")
        },
    }


def _mean(which, ade, fde):
    """((ADE, FDE), n) over one choice of tracks; errors [seeds, tracks]."""
    scored = np.isfinite(ade)
    if which == UNION:
        return [float(nan_mean(nan_mean(one, axis=0), axis=0)) for one in (ade, fde)], float(scored.any(axis=0).sum())
    counted = scored.all(axis=0) if which == COMMON else np.ones(scored.shape[1], bool)
    means = [float(seed_mean(np.where(counted, one, np.nan))) for one in (ade, fde)]
    return means, float((scored & counted).sum(axis=1).mean())
