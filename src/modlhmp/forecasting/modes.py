"""A few distinct futures with probabilities: the samples in at most `MODES` groups, each represented by one of them.

Two samples are as far apart as they are on average while both are under way: who goes the same way is of one group,
whenever they leave. A group is represented by its medoid among those that live longest, so that only a group of which
nobody is left ends early; its probability is its share of all samples. Groups are joined by complete linkage, which
keeps the largest distance within a group small.
"""

from typing import NamedTuple

import numpy as np

from modlhmp.forecasting.base import MODES, Forecast
from modlhmp.kernels import kernel

ALIKE_M = 1.0  # samples that are at most so far apart are one future, even if there are fewer than `MODES`


class Modes(NamedTuple):
    """Distinct futures of n walkers, the likeliest first: `paths` [n, 5, T, 2] in m, held where they end.

    `probabilities` [n, 5] sum to 1, 0 where there are fewer; `steps_alive` [n, 5] until each ends.
    """

    paths: np.ndarray
    probabilities: np.ndarray
    steps_alive: np.ndarray


def with_modes(samples: Forecast) -> Forecast:
    """The same samples with their modes before them, as a `Forecast` of output `modes`.

    The log fitness of a mode is the log of its probability, that of a sample, and where there are fewer modes, -inf.
    """
    found = modes_of(samples)
    n, k, steps, _ = samples.xy.shape
    log_fitness = np.full((n, MODES + k, steps), -np.inf, np.float32)
    with np.errstate(divide="ignore"):
        log_fitness[:, :MODES] = np.log(found.probabilities)[:, :, None]
    xy = np.concatenate([found.paths, samples.xy], axis=1)
    return Forecast(xy, log_fitness, np.concatenate([found.steps_alive, samples.steps_alive], axis=1), "modes")


def modes_of(samples: Forecast) -> Modes:
    """The `Modes` of a forecast without results before its samples; those that are missing repeat the likeliest."""
    chosen, probabilities = np.zeros((len(samples.xy), MODES), np.int64), np.zeros((len(samples.xy), MODES))
    for row, (xy, alive) in enumerate(zip(samples.xy, samples.steps_alive, strict=True)):
        index, share = _groups(_apart(xy, alive), alive)
        chosen[row], probabilities[row, : len(share)] = index[0], share
        chosen[row, : len(index)] = index
    paths = np.take_along_axis(samples.xy, chosen[:, :, None, None], axis=1)
    alive = np.take_along_axis(samples.steps_alive, chosen, axis=1)
    return Modes(paths, probabilities, np.where(probabilities > 0, alive, 0).astype(np.int32))


def _groups(apart: np.ndarray, alive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples that stand for a group, and the groups' shares of all, the largest first, then in their own order.

    `apart` [k, k] are the samples' distances in m, `alive` [k] their lives.
    """
    from scipy.cluster.hierarchy import fcluster, linkage  # noqa: PLC0415 - only this output needs it

    k, found = len(apart), []
    label = np.ones(k, np.int64)
    if k > 1:
        tree = linkage(apart[np.triu_indices(k, 1)], "complete")
        label = min(fcluster(tree, MODES, "maxclust"), fcluster(tree, ALIKE_M, "distance"), key=np.max)
    for group in range(1, label.max() + 1):
        members = np.flatnonzero(label == group)
        able = members[alive[members] == alive[members].max()]
        distance = apart[np.ix_(able, members)].mean(axis=1)
        found.append((len(members), able[distance.argmin()], members[0]))
    found.sort(key=lambda one: (-one[0], one[2]))
    return np.array([index for _, index, _ in found]), np.array([size for size, _, _ in found]) / k


@kernel
def _apart(xy, steps_alive):
    """Mean distance [k, k] in m of paths [k, T, 2] while both are under way; at the first step if one never is."""
    k = len(xy)
    apart = np.zeros((k, k))
    for a in range(k):
        for b in range(a):
            common = max(min(steps_alive[a], steps_alive[b]), 1)
            for step in range(common):
                apart[a, b] += np.sqrt((xy[a, step, 0] - xy[b, step, 0]) ** 2 + (xy[a, step, 1] - xy[b, step, 1]) ** 2)
            apart[a, b] /= common
            apart[b, a] = apart[a, b]
    return apart
