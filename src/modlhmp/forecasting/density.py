"""Where a person will be at one moment, as probabilities on a grid, from the positions of a forecast's samples."""

import numpy as np
from scipy.ndimage import gaussian_filter


def density(
    positions: np.ndarray, extent: tuple[float, float, float, float], cell_m: float, bandwidth_m: float
) -> np.ndarray:
    """Probability per cell [rows, columns], summing to 1; divide by `cell_m`**2 for a density per m^2.

    `positions` [m, 2] in m are those of the samples at that moment, `extent` = (x low, x high, y low, y high) [m] is
    what the grid covers: cells of `cell_m` from its lower left corner on, row 0 at the bottom.
    Each sample is spread as a Gaussian of standard deviation `bandwidth_m`. Samples outside do not count: the
    probabilities are those given that the person is inside.

        xy, alive = samples_of(forecast)  # modlhmp.scoring.uncertainty; xy [n, m, T, 2]
        p = density(xy[0, alive[0] >= 10, 9], (0, 40, 0, 30), cell_m=0.25, bandwidth_m=0.5)  # after 10 steps
    """
    positions, edges = np.asarray(positions, float), edges_of(extent, cell_m)
    known = positions[np.isfinite(positions).all(axis=1)]
    counts, _, _ = np.histogram2d(known[:, 1], known[:, 0], bins=edges)
    if not counts.any():
        raise ValueError(f"none of {len(positions)} samples lies within {extent}, so there is no density there")
    spread = gaussian_filter(counts, bandwidth_m / cell_m, mode="reflect")  # reflected, so none of it is lost
    return spread / spread.sum()


def edges_of(extent: tuple[float, float, float, float], cell_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Edges in y [rows + 1] and in x [columns + 1] of the cells that cover `extent`."""
    x_low, x_high, y_low, y_high = extent
    columns, rows = (max(round(np.ceil(size / cell_m - 1e-9)), 1) for size in (x_high - x_low, y_high - y_low))
    return y_low + cell_m * np.arange(rows + 1), x_low + cell_m * np.arange(columns + 1)


def level_that_holds(probabilities: np.ndarray, share: float) -> float:
    """The probability per cell that the likeliest cells, which together hold `share`, have at least.

    Its contour encloses the smallest area in which the person is with this probability.
    """
    ordered = np.sort(probabilities, axis=None)[::-1]
    return ordered[min(int(np.searchsorted(np.cumsum(ordered), share)), ordered.size - 1)]
