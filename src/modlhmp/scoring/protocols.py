"""The two scoring protocols, always both.

paper: the set-up that comes closest to the published numbers, a hypothesis about the study, not a proof. Futures that
left the map are not scored; the best ranked among those alive at the horizon is; a track with none is left out.
complete: every eligible track is scored; stopped futures are held at their last position, and the best ranked among
the longest-lived counts.
"""

from collections.abc import Mapping

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.ranking import longest_lived, most_likely
from modlhmp.scoring.errors import displacement_errors

PROTOCOLS = ("paper", "complete")
CHOSEN = {"ranked", "single", "median", "medoid", "modes", "likeliest", "mean_path"}  # one of the futures is the result


def score(
    forecast: Forecast,
    truth: np.ndarray,
    eligible_steps: Mapping[str, np.ndarray],
    infeasible: np.ndarray | None = None,
) -> dict[tuple[str, str], dict[str, np.ndarray]]:
    """Errors at every horizon of each track.

    `truth` [n, T, 2]; `eligible_steps` maps a protocol to the number of steps [n] to which a track is eligible;
    `infeasible` [n, k, T], where known, says which futures have been inside a wall. Returns {(output, protocol):
    {"ade": [n, T], "fde": [n, T], "infeasible": [n, T]}} in m, NaN where a track is not scored. Futures of equal
    standing (`ranked`) are also scored without ranking, as the mean of their values (`mean`); where that mean is the
    method's result, the path of their mean positions is scored beside it (`mean_path`), where all may be. Of modes the
    likeliest is scored.
    """
    forecast = forecast.results
    if infeasible is not None:
        infeasible = infeasible[:, : forecast.xy.shape[1]]
    values = dict(zip(("ade", "fde"), displacement_errors(forecast.xy, truth), strict=True))
    if infeasible is not None:
        values["infeasible"] = infeasible.astype(np.float32)
    horizon = np.arange(1, truth.shape[1] + 1)
    chosen_by = {
        "paper": forecast.steps_alive[:, :, None] >= horizon,
        "complete": longest_lived(forecast.steps_alive, len(horizon)),
    }
    everyone = {"paper": chosen_by["paper"], "complete": np.ones_like(chosen_by["complete"])}
    scores = {}
    for protocol in PROTOCOLS:
        outside = horizon > eligible_steps[protocol][:, None]
        if forecast.output in CHOSEN:
            best = most_likely(forecast.log_fitness, chosen_by[protocol])
            scores[forecast.output, protocol] = {m: _pick(one, best, outside) for m, one in values.items()}
        if forecast.output in {"ranked", "mean"}:
            counted = everyone[protocol]
            scores["mean", protocol] = {m: _mean(one, counted, outside) for m, one in values.items()}
        if forecast.output == "mean":
            errors = displacement_errors(forecast.xy.mean(axis=1, keepdims=True), truth)
            missing = outside | ~everyone[protocol].all(axis=1)
            path = {m: np.where(missing, np.nan, one[:, 0]) for m, one in zip(("ade", "fde"), errors, strict=True)}
            unknown = {m: np.full(missing.shape, np.nan) for m in values.keys() - path.keys()}  # walls: of futures only
            scores["mean_path", protocol] = {**path, **unknown}
    return scores


def _pick(values, best, outside):
    picked = np.take_along_axis(values, np.maximum(best, 0)[:, None], axis=1)[:, 0]
    return np.where((best < 0) | outside, np.nan, picked)


def _mean(values, counted, outside):
    number = counted.sum(axis=1)
    total = np.where(counted, values, 0.0).sum(axis=1)
    return np.where(outside | (number == 0), np.nan, total / np.maximum(number, 1))
