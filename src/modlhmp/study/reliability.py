"""What the distributions' scores say: means over tracks, and whether errors and probabilities are as announced."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from modlhmp.scoring.errors import nan_mean
from modlhmp.scoring.ttests import mean_test
from modlhmp.scoring.uncertainty import MEASURES, OF_MODES
from modlhmp.storage import column, read_metadata, read_parquet

BINS = 10
COLUMNS = (
    "dataset", "method", "horizon_s", "energy_m", "kde_nll", "best_ade_m", "best_fde_m", "missed", *OF_MODES,
    "expected_m", "real_m", "ratio", "n_ratio", "samples", "n", "brier", "brier_base", "left_share", "n_left",
)  # fmt: skip


def read_uncertainty(path: str | Path) -> tuple[list[float], dict[str, np.ndarray], np.ndarray]:
    """A file of `uncertainty.MEASURES` as (horizons [s], {measure: [tracks, H]}, person [tracks]), means over seeds.

    `brier` is added: the squared error of the probability of having left, of each seed before their mean. A track that
    is forecast several times is there as often; `person` is "recording/person" (of `same_person`, all pieces').
    """
    table = read_parquet(path)
    horizons = read_metadata(path)["horizons_s"]
    key = [name for name in ("recording", "track_id", "t0") if name in table.column_names]
    rows = table.select(key).to_pandas()
    track = rows.groupby(key, observed=True).ngroup().to_numpy()
    first = np.unique(track, return_index=True)[1]
    whose = table.select([key[0], "person" if "person" in table.column_names else key[1]]).take(first).to_pandas()
    person = np.array(["/".join(map(str, one)) for one in whose.itertuples(index=False)], dtype=str)
    values = {name: column(table, name).reshape(-1, len(horizons)).astype(np.float64) for name in MEASURES}
    values["brier"] = (values["left"] - values["has_left"]) ** 2
    number = np.bincount(track)[:, None]
    means = {}
    for name, one in values.items():  # NaN where any seed's is
        total = np.zeros((len(number), len(horizons)))
        np.add.at(total, track, one)
        means[name] = total / number
    return horizons, means, person


def summarise(
    dataset: str, method: str, horizons_s: Sequence[float], by_track: Mapping[str, np.ndarray]
) -> pd.DataFrame:
    """One row per horizon (`COLUMNS`): means over tracks of what `read_uncertainty` gives of a method on a dataset.

    `ratio`: real error by expected error, above 1 for a method that is too sure of itself, of the `n_ratio` tracks that
    have both: one sample alone expects nothing. `n` tracks are long enough; having left is known of all `n_left`.
    `brier_base` is the score of always forecasting the share that has left.
    """
    rows = []
    for place, horizon in enumerate(horizons_s):
        at = {name: one[:, place] for name, one in by_track.items()}
        mean = {name: float(nan_mean(one, axis=0)) for name, one in at.items()}
        share = mean["has_left"]
        both = np.isfinite(at["expected_m"]) & np.isfinite(at["real_m"])
        expected, real = (float(nan_mean(at[name][both], axis=0)) for name in ("expected_m", "real_m"))
        rows.append((
            dataset, method, horizon,
            *(mean[name] for name in ("energy_m", "kde_nll", "best_ade_m", "best_fde_m", "missed", *OF_MODES)),
            mean["expected_m"], mean["real_m"], real / expected if expected else np.nan, int(both.sum()),
            mean["samples"], int(np.isfinite(at["real_m"]).sum()), mean["brier"], share * (1 - share), share,
            len(at["has_left"]),
        ))  # fmt: skip
    return pd.DataFrame(rows, columns=COLUMNS)


def calibration(expected: np.ndarray, real: np.ndarray, cluster: np.ndarray | None = None) -> pd.DataFrame:
    """Expected and real errors [tracks] in `BINS` bins of equally many tracks, by expected error (see `_in_bins`).

    `cluster` [tracks] says which of them belong together (default: none).
    """
    known = np.flatnonzero(np.isfinite(expected) & np.isfinite(real))
    ordered = known[np.argsort(expected[known], kind="stable")]
    return _in_bins(expected, real, np.array_split(ordered, BINS), cluster)


def reliability(probability: np.ndarray, happened: np.ndarray, cluster: np.ndarray | None = None) -> pd.DataFrame:
    """Probabilities and what happened (0 or 1), [tracks], in `BINS` equally wide bins; others as of `calibration`."""
    place = np.minimum((probability * BINS + 1e-6).astype(int), BINS - 1)  # stored in single precision
    return _in_bins(probability, happened, [np.flatnonzero(place == number) for number in range(BINS)], cluster)


def _in_bins(
    forecast: np.ndarray, outcome: np.ndarray, bins: Sequence[np.ndarray], cluster: np.ndarray | None
) -> pd.DataFrame:
    """One row per bin that is not empty: `forecast` and `outcome` (means), `low`, `high`, `n`.

    `low` to `high` is the outcome's 95 % interval over the clusters (`ttests.mean_test`), NaN where it has none.
    """
    rows = []
    for number, members in enumerate(bins, 1):
        if n := len(members):
            test = mean_test(outcome[members], None if cluster is None else cluster[members])
            rows.append((number, forecast[members].mean(), outcome[members].mean(), test.low, test.high, n))
    return pd.DataFrame(rows, columns=["bin", "forecast", "outcome", "low", "high", "n"])
