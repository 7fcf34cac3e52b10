"""FreMEn: a signal over time as its mean and its few strongest periodic parts.

Paper Sec. III-C.3; T. Krajnik et al., FreMEn: frequency map enhancement for long-term mobile robot autonomy, IEEE
T-RO 2017.
"""

import numpy as np

PERIODS_S = 86400.0 / np.arange(1, 25)  # a day and its harmonics down to an hour
CYCLES_NEEDED = 1.5  # a period must fit this often into the time covered


def analyse(
    times: np.ndarray, signals: np.ndarray, order: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Strongest `order` periodic parts of each signal.

    `times` [T] in s, `signals` [n, T]. Returns mean [n], amplitude [n, order], phase [n, order] in rad, period
    [n, order] in s, strongest first; amplitudes are 0 where the time covered admits fewer periods.
    """
    times, signals = np.asarray(times, float), np.atleast_2d(signals).astype(float)
    mean = signals.mean(axis=1)
    admitted = PERIODS_S[np.ptp(times) >= CYCLES_NEEDED * PERIODS_S]
    # The mean is removed before the transform, so it is exact for times that are not equally spaced, too.
    basis = np.exp(2j * np.pi * times[:, None] / admitted)
    return mean, *_strongest((signals - mean[:, None]) @ basis / len(times), admitted, order)


def from_sums(
    times: np.ndarray, sums: np.ndarray, weights: np.ndarray, covered_s: float, order: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What `analyse` gives, of signals over many days from their sums [n, T] by time of day `times` [T] in s.

    `weights` [T] are how many observations, or what weight of them, each sum is of; `covered_s` is the time covered.
    It suffices, since every period divides a day: with c = sum w e^(i t), b = sum s e^(i t), mean m = sum s / sum w, a
    coefficient is (b - m c) / sum w, whatever the times.
    """
    mean = sums.sum(axis=1) / weights.sum()
    admitted = PERIODS_S[covered_s >= CYCLES_NEEDED * PERIODS_S]
    basis = np.exp(2j * np.pi * times[:, None] / admitted)
    parts = (sums @ basis - mean[:, None] * (weights @ basis)) / weights.sum()
    return mean, *_strongest(parts, admitted, order)


def _strongest(parts, admitted, order):
    """Amplitude, phase and period [n, order] of the strongest of the parts [n, periods]."""
    if parts.shape[1] < order:
        parts = np.pad(parts, ((0, 0), (0, order - parts.shape[1])))
        admitted = np.pad(admitted, (0, order - len(admitted)), constant_values=PERIODS_S[0])
    strongest = np.argsort(-np.round(np.abs(parts), 12), axis=1, kind="stable")[:, :order]
    chosen = np.take_along_axis(parts, strongest, axis=1)
    return np.abs(chosen), np.angle(chosen), admitted[strongest]


def predict(t: float, mean: np.ndarray, amplitude: np.ndarray, phase: np.ndarray, period: np.ndarray) -> np.ndarray:
    """Value at time `t` [s], clipped to [0, 1]: mean + 2 sum_i a_i cos(2 pi t / T_i - phi_i); shape as `mean`."""
    return np.clip(mean + 2.0 * np.sum(amplitude * np.cos(2 * np.pi * t / period - phase), axis=-1), 0.0, 1.0)
