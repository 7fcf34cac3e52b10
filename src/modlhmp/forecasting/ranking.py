"""Which of the k futures is the forecast? Paper Sec. III-C: the one with the largest cumulative log fitness."""

import numpy as np


def most_likely(log_fitness, candidates):
    """Index [n, T] of the fittest candidate at each horizon, -1 where there is none.

    `log_fitness` [n, k, T] is cumulative, so each horizon ranks by its own prefix; `candidates` [n, k, T] says which
    futures may be chosen. Ties go to the first.
    """
    score = np.where(candidates, log_fitness, -np.inf)
    return np.where(candidates.any(axis=1), score.argmax(axis=1), -1)
