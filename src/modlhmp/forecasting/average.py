"""The mean path of several methods' forecasts, as a method of its own."""

from collections.abc import Iterable, Iterator

import numpy as np

from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.ranking import best_path


def average_forecasts(
    members: Iterable[Iterable[tuple[int, np.ndarray, Forecast]]],
) -> Iterator[tuple[int, np.ndarray, Forecast]]:
    """The mean path of several methods' forecasts, each as of `read_forecasts`; yields the same, of one future.

    A seed is averaged with the others' forecasts of that seed, or of their only one. Methods whose path has ended do
    not count from then on; the mean is held once all have.
    """
    by_seed = [_paths(member) for member in members]
    for seed in max(by_seed, key=len, default={}):
        chosen = [member.get(seed) or next(iter(member.values())) for member in by_seed]
        ids = chosen[0][0]
        if not all(np.array_equal(ids, other) for other, *_ in chosen):
            raise ValueError("the forecasts to be averaged are of different tracks; remake them")
        xy, alive = (np.stack(parts) for parts in zip(*(own for _, *own in chosen), strict=True))
        life, step = alive.max(axis=0), np.arange(xy.shape[2])
        # Where no member knows more than constant velocity, that is averaged.
        counts = (alive[..., None] > step) | (life == 0)[:, None]
        mean = (xy * counts[..., None]).sum(axis=0) / np.maximum(counts.sum(axis=0), 1)[..., None]
        held = np.minimum(step, np.where(life > 0, life - 1, len(step) - 1)[:, None])
        mean = np.take_along_axis(mean, held[..., None], axis=1).astype(np.float32)
        no_fitness = np.zeros((len(ids), 1, len(step)), np.float32)
        yield seed, ids, Forecast(mean[:, None], no_fitness, life[:, None].astype(np.int32), "single")


def _paths(forecasts):
    """{seed: (track_ids [n], xy [n, T, 2], steps alive [n])} of the paths that are the results of all blocks."""
    blocks: dict[int, list[tuple[np.ndarray, ...]]] = {}
    for seed, ids, forecast in forecasts:
        blocks.setdefault(seed, []).append((ids, *best_path(forecast)))
    return {seed: tuple(map(np.concatenate, zip(*some, strict=True))) for seed, some in blocks.items()}
