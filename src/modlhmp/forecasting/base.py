"""What every forecaster takes and gives, and the random numbers they share.

A forecaster is a function or object called as

    forecast(observed, steps, keys) -> Forecast

with `observed` an `observe.Observed` of n tracks, `steps` the number of time steps to the longest horizon, and `keys`
[n, k] the random streams of the k futures (`stream_keys`). It never learns how long a track is.
"""

import hashlib
from typing import NamedTuple

import numpy as np

from modlhmp.kernels import kernel


class Forecast(NamedTuple):
    """k futures of n tracks.

    `xy` [n, k, T, 2] float32 in m, held at the last alive position (t0's if none) once a future has stopped;
    `log_fitness` [n, k, T] float32, cumulative, held likewise; `steps_alive` [n, k] int32;
    `output`: how one result comes out of the k (`ranked`: the fittest, `mean`: the mean error, `single`: k = 1,
    `median`: the first one, which is the geometric median of the living others at each step).
    """

    xy: np.ndarray
    log_fitness: np.ndarray
    steps_alive: np.ndarray
    output: str

    def first(self, number):
        """The first `number` of the futures."""
        return Forecast(*(part[:, :number] for part in self[:3]), self.output)


def stream_keys(track_ids, k, *names):
    """One 64-bit key a track and sample [n, k], from `names` (seed, dataset, method, recording) and nothing else.

    So a forecast does not depend on batches, order, shards, cores or on how many samples are drawn.
    """
    digest = hashlib.blake2b("\0".join(map(str, names)).encode(), digest_size=8).digest()
    base = np.uint64(int.from_bytes(digest, "little"))
    track = _mix(np.asarray(track_ids, np.int64).astype(np.uint64)[:, None] ^ base)
    return _mix(track + np.arange(k, dtype=np.uint64) * _GOLDEN)


def uniforms(keys, step, draws):
    """Numbers in (0, 1), one row a key: [n, draws] for `keys` [n]; a counter-based generator (SplitMix64).

    G. Steele, D. Lea, C. Flood, Fast splittable pseudorandom number generators, OOPSLA 2014.
    """
    counter = np.arange(step * draws + 1, (step + 1) * draws + 1, dtype=np.uint64) * _GOLDEN
    bits = _mix(keys[:, None] + counter)
    return ((bits >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53


_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@kernel
def uniform(key, number):
    """The number-th of a key's numbers in (0, 1): what `uniforms` gives, for kernels that use as many as they need."""
    z = key + np.uint64(number + 1) * _GOLDEN
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (np.float64((z ^ (z >> np.uint64(31))) >> np.uint64(11)) + 0.5) * 2.0**-53


def _mix(z):
    """SplitMix64's finaliser; unsigned overflow is meant."""
    with np.errstate(over="ignore"):
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        return z ^ (z >> np.uint64(31))
