"""Which method knows best where a walker turns next? Likelihood of the next velocity, given the last ones.

Not to be compared with the likelihood by place and time (`study.likelihood`): who knows the last velocity knows most.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.maps.density import NoMap
from modlhmp.scoring.likelihood import DIFFERENCE, SUMMARY, WEIGHTS, differences, summarise, with_background
from modlhmp.scoring.next_velocity import KERNELS
from modlhmp.study.likelihood import NO_MAP


def in_halves(person: np.ndarray) -> np.ndarray:
    """Which half of the persons each row is of, 0 or 1 [n]; `person` [n] numbers them."""
    people = np.unique(person)
    second = np.random.default_rng(0).permutation(people)[: len(people) // 2]
    return np.isin(person, second).astype(int)


def measure_given(
    scored: Mapping[str, np.ndarray], heading: np.ndarray, speed: np.ndarray, person: np.ndarray, cluster: np.ndarray
) -> dict[str, pd.DataFrame]:
    """Tables {`given`, `given_pairs`} of methods' log densities [n, kernels] of velocities of persons.

    The kernel and the weight of the background (speeds of the persons, any heading) are those that suit the one half
    of the persons best, for the other half, and the other way round. `given`: per method the `SUMMARY`, gain being over
    that background alone, the share of rows `covered`, and the kernels and weights of both halves.
    """
    half, rows, log_p = in_halves(person), [], {}
    without = np.empty(len(speed))
    for part in (0, 1):
        without[half == part] = NoMap(speed[half != part]).log_speed(speed[half == part]) - np.log(2 * np.pi)
    for name, found in {NO_MAP: np.full((len(speed), 1), np.nan), **scored}.items():
        log_p[name], chosen = np.empty(len(speed)), []
        for part in (0, 1):
            there, here = half != part, half == part
            kernel, weight = _choose(found[there], without[there])
            log_p[name][here] = with_background(found[here, kernel], without[here], weight)
            chosen += [*(KERNELS[kernel] if name != NO_MAP else (np.nan, np.nan)), weight]
        covered = float(np.isfinite(found).any(axis=1).mean())
        rows.append((name, *summarise(log_p[name], without, cluster), covered, *chosen))
    kinds = [f"{what}_{part}" for part in (0, 1) for what in ("heading_rad", "speed_m_s", "weight")]
    table = pd.DataFrame(rows, columns=["method", *SUMMARY, "covered", *kinds])
    return {"given": table, "given_pairs": pd.DataFrame(differences(log_p, cluster), columns=list(DIFFERENCE))}


def _choose(log_p: np.ndarray, without: np.ndarray) -> tuple[int, float]:
    """Number of the kernel and weight of the background with the best mean."""
    pairs: Sequence[tuple[int, float]] = [(n, weight) for n in range(log_p.shape[1]) for weight in WEIGHTS]
    means = [with_background(log_p[:, kernel], without, weight).mean() for kernel, weight in pairs]
    return pairs[int(np.argmax(means))]
