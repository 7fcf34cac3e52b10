"""How good a forecast is as a distribution: energy score, best of a few, the error it expects, who will have left.

Energy score: T. Gneiting, A. Raftery, J. Am. Stat. Assoc. 102, 2007, in the form that does not depend on the number of
samples: C. Ferro, Q. J. R. Meteorol. Soc. 140, 2014. Brier-weighted error: B. Wilson et al., Argoverse 2, NeurIPS
Datasets and Benchmarks, 2021. KDE-NLL: B. Ivanovic, M. Pavone, The Trajectron, ICCV 2019.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pyarrow as pa
from scipy.special import logsumexp

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.ranking import longest_lived, most_likely
from modlhmp.forecasting.windows import Windows, in_order, windows
from modlhmp.kernels import kernel
from modlhmp.scenes import Scenes
from modlhmp.scoring.errors import displacement_errors, nan_mean, truth_of
from modlhmp.site import Site
from modlhmp.tracks import Tracks

SAMPLES = 40  # of a distribution, so that every method is judged by as many
BEST_OF = 5
MISSED_M = 2.0  # a miss: the best of a few is farther from the truth
LEAST_LOG_DENSITY = -20.0  # so that one who is far from all samples does not decide the mean
FITTED = ("median", "mean_path")  # outputs that are no sample, but lie amid all of them
OF_MODES = ("modes_ade_m", "modes_fde_m", "modes_brier_m")
MEASURES = (
    "energy_m", "kde_nll", "best_ade_m", "best_fde_m", "missed", *OF_MODES,
    "mean_ade_m", "mean_fde_m", "expected_m", "real_m", "samples", "left", "has_left",
)  # fmt: skip


def score_samples(
    tracks: Tracks,
    forecasts: Iterable[tuple[int, np.ndarray, Forecast]],
    recording: str,
    site: Site,
    horizons_s: Sequence[float],
    scenes: Scenes | None = None,
    given: Iterable[tuple[int, np.ndarray, Forecast]] | None = None,
) -> pa.Table:
    """The `MEASURES` of one method's forecasts of one recording; a table, one row per track and seed.

    `forecasts` yields (seed, track_ids, `Forecast`) of all tracks (or of the `scenes`), in blocks. Their samples may be
    more than the method's own futures: its result is then that of the forecasts that it has `given`, which come in the
    same blocks (None: it is theirs). Each measure is a list over `horizons_s`, NaN where the
    track is shorter: `energy_m` the energy score [m], `kde_nll` what the function says [nat], `best_ade_m` and
    `best_fde_m` the best of the first five samples [m], `missed` (0 or 1) whether that FDE is over 2 m, those of
    `OF_MODES` what `mode_errors` says, NaN for a method of another output, `mean_ade_m` and `mean_fde_m` the mean ADE
    and FDE of the distribution's samples, `expected_m` and `real_m` what `expected_error` says and the distance of the
    same outputs from the truth [m]; `samples` how many the distribution has. `left` is the probability that the person
    has left by then, `has_left` (0 or 1) whether they had; these two are known for every track. Empty without a
    usable track (or scene).
    """
    wanted, tables = windows(tracks, site, scenes), []
    steps = np.rint(np.asarray(horizons_s) / site.time_step_s).astype(int)
    truth, length = truth_of(tracks, wanted, site)
    drawn, own = in_order(forecasts, wanted, recording), in_order(given or (), wanted, recording)
    for seed, mine, forecast in drawn:
        if not len(mine):
            continue
        result = forecast if given is None else _same_block(next(own, None), seed, mine, recording)
        values = measures(forecast, truth[mine], length[mine], steps, result)
        tables.append(_table(recording, wanted, mine, seed, values))
    if not tables:
        nothing = dict.fromkeys(MEASURES, np.empty((0, len(steps)), np.float32))
        tables = [_table(recording, wanted, np.empty(0, np.int64), 0, nothing)]
    return pa.concat_tables(tables).unify_dictionaries()


def _table(recording: str, wanted: Windows, mine: np.ndarray, seed: int, values: Mapping[str, np.ndarray]) -> pa.Table:
    """Rows of `score_samples` for the forecasts `mine` of one seed; `values` are [n, H]."""
    n = len(mine)
    of = {"recording": pa.array(np.full(n, recording)).dictionary_encode(), "track_id": wanted.track_id[mine]}
    if wanted.several:
        of["t0"] = wanted.t0[mine]
    lists = {
        name: pa.FixedSizeListArray.from_arrays(pa.array(one.ravel()), one.shape[1]) for name, one in values.items()
    }
    return pa.table({**of, "seed": np.full(n, seed, np.int32), **lists})


def _same_block(own: tuple[int, np.ndarray, Forecast] | None, seed: int, mine: np.ndarray, recording: str) -> Forecast:
    """The forecast of what is `own` to the method, if it is of the same seed and tracks; `ValueError` else."""
    if own is None or own[0] != seed or not np.array_equal(own[1], mine):
        raise ValueError(f"{recording}: the forecasts and their samples are not of the same tracks; remake them")
    return own[2]


def measures(
    forecast: Forecast, truth: np.ndarray, length: np.ndarray, steps: np.ndarray, given: Forecast | None = None
) -> dict[str, np.ndarray]:
    """{measure: [n, H] float32} after each of `steps` [H]; `truth` [n, T, 2], `length` [n] steps of it.

    Of the samples of `forecast` and of the result of `given`, by default the same forecast.
    """
    xy, steps_alive = samples_of(forecast)
    given = forecast if given is None else given
    output, repeated = own_output(given), repeats(xy, steps_alive)
    errors = dict(zip(("ade_m", "fde_m"), displacement_errors(xy, truth), strict=True))
    found = {name: np.full((len(truth), len(steps)), np.nan, np.float32) for name in MEASURES}
    for column, step in enumerate(steps):
        points, at = still_there(xy, steps_alive, repeated, step), truth[:, step - 1]
        first, counted = of_distribution(steps_alive, repeated, step)
        # The error of a mean is the mean error of its samples, each of which is the output in turn.
        outputs = points if given.output == "mean" else output[:, None, step - 1]
        now = {
            "energy_m": energy_score(points, at),
            "kde_nll": kde_nll(still_there(xy, steps_alive, repeated, step, least=3), at),
            **{f"best_{name}": one[:, :BEST_OF, step - 1].min(axis=1) for name, one in errors.items()},
            **{f"mean_{name}": _mean_of(one[:, :, step - 1], first, counted) for name, one in errors.items()},
            **mode_errors(given, truth, step),
            "expected_m": expected_error(points, outputs, given.output in FITTED),
            "real_m": nan_mean(distance(outputs, at[:, None]), axis=1),
            "samples": np.isfinite(points[..., 0]).sum(axis=1),
        }
        now["missed"] = now["best_fde_m"] > MISSED_M
        for name, one in now.items():
            found[name][:, column] = np.where(length >= step, one, np.nan)
        found["left"][:, column] = (steps_alive < step).mean(axis=1)
        found["has_left"][:, column] = length < step
    return found


def samples_of(forecast: Forecast) -> tuple[np.ndarray, np.ndarray]:
    """The futures that are samples, `xy` [n, m, T, 2] and `steps_alive` [n, m]: all but a median or modes."""
    samples = forecast.samples
    return samples.xy, samples.steps_alive


def mode_errors(forecast: Forecast, truth: np.ndarray, step: int) -> dict[str, np.ndarray]:
    """{measure of `OF_MODES`: [n]} in m of a forecast of output `modes`, after `step` steps; of others nothing.

    The least ADE and the least FDE of the modes, which are held where they end; and the latter plus (1 - p)^2, p being
    the probability of that mode (the first of equals).
    """
    if forecast.output != "modes":
        return {}
    modes, rows = forecast.results, np.arange(len(truth))
    probability = np.exp(modes.log_fitness[:, :, step - 1].astype(np.float64))
    ade, fde = displacement_errors(modes.xy[:, :, :step], truth[:, :step])
    ade, fde = (np.where(probability > 0, one[:, :, -1], np.inf) for one in (ade, fde))
    best = fde.argmin(axis=1)
    brier = fde[rows, best] + (1 - probability[rows, best]) ** 2
    return dict(zip(OF_MODES, (ade.min(axis=1), fde[rows, best], brier), strict=True))


def own_output(forecast: Forecast) -> np.ndarray:
    """The path [n, T, 2] that the method gives as its one result at each step."""
    own = forecast.results
    best = most_likely(own.log_fitness, longest_lived(own.steps_alive, own.xy.shape[2]))
    return np.take_along_axis(own.xy, best[:, None, :, None], axis=1)[:, 0]


def of_distribution(
    steps_alive: np.ndarray, repeated: np.ndarray, step: int, most: int = SAMPLES, least: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Which samples are the distribution after `step` steps: their places [n, `most`], and whether each counts.

    They are the first that are still alive, given that the person is still there; where fewer than `least` are, the
    held ones of the first samples. `repeated` [n, m] samples do not count.
    """
    counted = (steps_alive >= step) & ~repeated
    counted = np.where(counted.sum(axis=1, keepdims=True) >= least, counted, ~repeated)
    first = np.argsort(~counted, axis=1, kind="stable")[:, :most]
    return first, np.take_along_axis(counted, first, axis=1)


def still_there(
    xy: np.ndarray, steps_alive: np.ndarray, repeated: np.ndarray, step: int, most: int = SAMPLES, least: int = 1
) -> np.ndarray:
    """Positions [n, `most`, 2] of the samples `of_distribution` after `step` steps, NaN where there are fewer."""
    first, counted = of_distribution(steps_alive, repeated, step, most, least)
    points = np.take_along_axis(xy[:, :, step - 1], first[..., None], axis=1).astype(np.float64)
    points[~counted] = np.nan
    return points


def _mean_of(values: np.ndarray, first: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Mean [n] of the values [n, m] of the samples `of_distribution`."""
    return nan_mean(np.where(counted, np.take_along_axis(values, first, axis=1), np.nan), axis=1)


@kernel
def repeats(xy, steps_alive):
    """Which samples are an earlier one again, the whole way, bool [n, m]."""
    n, m, _, _ = xy.shape
    repeated = np.zeros((n, m), np.bool_)
    for i in range(n):
        for j in range(m):
            for earlier in range(j):
                if steps_alive[i, j] == steps_alive[i, earlier] and _same(xy[i, j], xy[i, earlier]):
                    repeated[i, j] = True
                    break
    return repeated


@kernel
def _same(path, other):
    for step in range(len(path) - 1, -1, -1):  # from the end, where two paths are likeliest to differ
        if path[step, 0] != other[step, 0] or path[step, 1] != other[step, 1]:
            return False
    return True


def energy_score(points: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Energy score [n] in m of samples [n, m, 2] (NaN: none) for what happened, `truth` [n, 2]; lower is better.

    Mean distance from the truth less half the mean distance between two different samples; one sample's is its error.
    """
    number = np.isfinite(points[..., 0]).sum(axis=1)
    between = np.nansum(distance(points[:, :, None], points[:, None]), axis=(1, 2))
    return nan_mean(distance(points, truth[:, None]), axis=1) - between / np.maximum(2 * number * (number - 1), 1)


def expected_error(points: np.ndarray, outputs: np.ndarray, fitted: bool) -> np.ndarray:
    """Error [n] in m that samples [n, m, 2] (NaN: none) expect of outputs [n, o, 2] (NaN: none), the mean over these.

    Of each it is the sum of its distances from the samples, divided by the number of the others: a sample that is the
    output itself, at distance 0, says nothing of what else may happen. An output that is `fitted` to n samples is
    nearer to them than to the truth, about as if it were one of them: so n - 1, as in a variance. NaN without others.
    """
    apart = distance(points[:, :, None], outputs[:, None])
    others = np.isfinite(apart).sum(axis=1) - (fitted | (apart == 0).any(axis=1))
    return nan_mean(np.where(others > 0, np.nansum(apart, axis=1) / np.maximum(others, 1), np.nan), axis=1)


def kde_nll(points: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Negative log density [n] in nat of what happened, `truth` [n, 2], under a Gaussian kernel estimate of samples.

    `points` [n, m, 2] in m, NaN where there are fewer; the kernel is the samples' covariance by Scott's rule. At most
    20, as also where samples are fewer than three or on a line and so have no density: every method's mean is of the
    same people. NaN for a method that never has three.
    """
    known = np.isfinite(points[..., 0])
    number = known.sum(axis=1)
    from_mean = np.where(known[..., None], points - nan_mean(points, axis=1)[:, None], 0.0)
    scale = np.maximum(number, 2.0) ** (-1 / 3) / np.maximum(number - 1, 1)  # Scott's factor squared
    xx, xy, yy = (scale * (from_mean[..., i] * from_mean[..., j]).sum(axis=1) for i, j in ((0, 0), (0, 1), (1, 1)))
    determinant = xx * yy - xy**2
    usable = (number >= 3) & (determinant > 1e-12)
    determinant = np.where(usable, determinant, 1.0)
    dx, dy = (np.where(known, truth[:, None, i] - points[..., i], 0.0) for i in (0, 1))
    exponent = -0.5 * (yy[:, None] * dx**2 - 2 * xy[:, None] * dx * dy + xx[:, None] * dy**2) / determinant[:, None]
    total = logsumexp(np.where(known, exponent, -np.inf), axis=1)
    density = total - np.log(np.maximum(number, 1)) - np.log(2 * np.pi) - 0.5 * np.log(determinant)
    charged = np.nan if points.shape[1] < 3 else -LEAST_LOG_DENSITY
    return np.where(usable, -np.maximum(density, LEAST_LOG_DENSITY), charged)


def distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance [m] between positions [..., 2]."""
    return np.hypot(a[..., 0] - b[..., 0], a[..., 1] - b[..., 1])
