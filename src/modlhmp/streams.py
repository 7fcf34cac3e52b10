"""Random numbers by key: a number depends on what it is for, and on nothing else.

G. Steele, D. Lea, C. Flood, Fast splittable pseudorandom number generators, OOPSLA 2014 (SplitMix64).
"""

import hashlib

import numpy as np

from modlhmp.kernels import kernel


def stream_keys(track_ids: np.ndarray, k: int, *names: object, later_s: np.ndarray | None = None) -> np.ndarray:
    """One 64-bit key per track and sample [n, k], from `names` (seed, dataset, method, recording) and nothing else.

    So a forecast does not depend on batches, order, shards, cores or on how many samples are drawn. Of several
    forecasts of a track each has keys of its own by how much `later_s` [n] it is than the first, where that is above 0.
    """
    digest = hashlib.blake2b("\0".join(map(str, names)).encode(), digest_size=8).digest()
    base = np.uint64(int.from_bytes(digest, "little"))
    track = _mix(np.asarray(track_ids, np.int64).astype(np.uint64)[:, None] ^ base)
    if later_s is not None:
        later_ms = np.rint(1000 * np.asarray(later_s)).astype(np.uint64)[:, None]
        track = np.where(later_ms > 0, _mix(track ^ later_ms), track)
    return _mix(track + np.arange(k, dtype=np.uint64) * _GOLDEN)


def row_keys(track_ids: np.ndarray, t: np.ndarray, *names: object) -> np.ndarray:
    """One 64-bit key per row [n] of tracks, from its track, its time `t` [s] to the ms, and `names`."""
    digest = hashlib.blake2b("\0".join(map(str, names)).encode(), digest_size=8).digest()
    track = _mix(np.asarray(track_ids, np.int64).view(np.uint64) ^ np.uint64(int.from_bytes(digest, "little")))
    return _mix(track ^ _mix(np.rint(1000 * np.asarray(t)).astype(np.int64).view(np.uint64)))


def uniforms(keys: np.ndarray, step: int, draws: int) -> np.ndarray:
    """Numbers in (0, 1), one row per key: [n, draws] for `keys` [n]; a counter-based generator (SplitMix64).

    G. Steele, D. Lea, C. Flood, Fast splittable pseudorandom number generators, OOPSLA 2014.
    """
    counter = np.arange(step * draws + 1, (step + 1) * draws + 1, dtype=np.uint64) * _GOLDEN
    return uniform_of(_mix(keys[:, None] + counter))


def uniform_of(bits: np.ndarray) -> np.ndarray:
    """Numbers in (0, 1) of 64 random bits each."""
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
    """SplitMix64's finaliser of an array, whose overflow, which is meant, numpy does not warn of."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
