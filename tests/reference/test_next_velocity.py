"""Likelihood of the next velocity: the kernel against plain sums and integrals, which step it is, halves of persons."""

import math

import numpy as np
import pytest

from modlhmp.forecasting.base import Forecast
from modlhmp.scoring import next_velocity
from modlhmp.scoring.next_velocity import KERNELS, kernel_density, score_next
from modlhmp.site import Site
from modlhmp.study.likelihood import NO_MAP
from modlhmp.study.likelihood_given import in_halves, measure_given
from modlhmp.tracks import Tracks

SITE = Site(horizon_s=2.0)
TWO_PI = 2 * np.pi


def plain(samples, heading, speed, sd_heading, sd_speed):
    """The density of one velocity under a list of samples (vx, vy)."""
    total = 0.0
    for vx, vy in samples:
        of, fast = math.atan2(vy, vx), math.hypot(vx, vy)
        around = sum(math.exp(-0.5 * ((heading - of + TWO_PI * k) / sd_heading) ** 2) for k in range(-4, 5))
        up = math.exp(-0.5 * ((speed - fast) / sd_speed) ** 2)
        above = 0.5 * math.erfc(-fast / sd_speed / math.sqrt(2))
        total += around * up / above / (TWO_PI * sd_heading * sd_speed)
    return total / len(samples)


def test_the_kernel_is_a_plain_sum_over_the_samples_alive():
    rng = np.random.default_rng(0)
    samples = rng.normal((1.0, 0.3), 0.4, (6, 9, 2))
    samples[2, 4:] = np.nan
    samples[5] = np.nan
    heading, speed = rng.uniform(-np.pi, np.pi, 6), rng.uniform(0.1, 2, 6)
    found = kernel_density(samples, heading, speed)
    assert np.isnan(found[5]).all()
    for row in range(5):
        alive = samples[row][np.isfinite(samples[row, :, 0])]
        expected = [plain(alive, heading[row], speed[row], *kernel) for kernel in KERNELS]
        np.testing.assert_allclose(np.exp(found[row]), expected, rtol=1e-6, atol=1e-200)


def test_every_kernel_integrates_to_1():
    """Also of samples that hardly move, whose kernel would reach below 0 m/s."""
    samples = np.array([[[0.02, 0.0], [-0.1, 0.1], [1.0, -0.5]]])
    heading, speed = -np.pi + TWO_PI * (np.arange(150) + 0.5) / 150, 4.0 * (np.arange(200) + 0.5) / 200
    grid = [part.ravel() for part in np.meshgrid(heading, speed, indexing="ij")]
    found = kernel_density(np.repeat(samples, len(grid[0]), axis=0), *grid)
    np.testing.assert_allclose(np.exp(found).sum(axis=0) * TWO_PI / 150 * 4 / 200, 1.0, atol=0.01)


def test_the_second_step_is_scored_of_those_who_walk_then():
    """Three tracks: one turns north in the second step, one stands then, one ends before it."""
    paths = [[(x, 0.0) for x in range(5)] + [(4.0, 1.5)], [(x, 5.0) for x in range(5)] + [(4.0, 5.0)],
             [(x, 9.0) for x in range(5)]]  # fmt: skip
    rows = [(person, t, *xy) for person, path in enumerate(paths) for t, xy in enumerate(path)]
    person, t, x, y = np.array(rows, float).T
    tracks = Tracks(person.astype(int), t, x, y, np.ones(len(t)), np.zeros(len(t)))
    xy = np.zeros((3, 2, 2, 2), np.float32)
    xy[:, 0] = [(4.0, 0.0), (4.0, 1.5)]  # the first sample does what the first person does
    xy[:, 1] = [(4.0, 0.0), (5.0, 0.0)]
    alive = np.array([[2, 1], [2, 2], [2, 2]], np.int32)
    forecast = Forecast(xy, np.zeros((3, 2, 2), np.float32), alive, "ranked")
    found = score_next(tracks, [(0, np.arange(3), forecast)], "hall", SITE)
    assert found.track_id.tolist() == [0]
    assert (found.heading[0], found.speed[0]) == pytest.approx((np.pi / 2, 1.5))
    expected = [plain([(0.0, 1.5)], np.pi / 2, 1.5, *kernel) for kernel in KERNELS]  # the other sample has stopped
    np.testing.assert_allclose(np.exp(found.log_p[0]), expected, rtol=1e-5)
    assert next_velocity.STEP == 2


def test_halves_are_of_persons_and_choose_for_each_other():
    """Walkers with a planted spread of 0.2 rad and 0.1 m/s: of all kernels around the truth that one is chosen."""
    rng = np.random.default_rng(1)
    person = np.repeat(np.arange(300), 4)
    half = in_halves(person)
    assert (half.reshape(300, 4) == half[::4, None]).all() and half[::4].sum() == 150
    mean, speed_of = rng.uniform(-np.pi, np.pi, 1200), rng.uniform(0.8, 1.6, 1200)
    heading, speed = mean + rng.normal(0, 0.2, 1200), speed_of + rng.normal(0, 0.1, 1200)
    samples = np.stack([speed_of * np.cos(mean), speed_of * np.sin(mean)], axis=-1)[:, None]
    blind = samples.copy()
    blind[:] = np.nan
    log_p = {name: kernel_density(one, heading, speed) for name, one in (("good", samples), ("blind", blind))}
    tables = measure_given(log_p, heading, speed, person, person)
    given = tables["given"].set_index("method")
    assert (
        given.loc["good", ["heading_rad_0", "speed_m_s_0", "heading_rad_1", "speed_m_s_1"]].tolist() == [0.2, 0.1] * 2
    )
    law = np.log(TWO_PI * np.e * 0.2 * 0.1)  # the entropy of the spread
    assert given.loc["good", "nll"] == pytest.approx(law, abs=0.08)
    assert given.loc["blind", "nll"] == given.loc[NO_MAP, "nll"] and given.loc["blind", "covered"] == 0
    assert given.loc["good", "gain"] > 1.5
    assert list(tables["given_pairs"]["map"]) == [NO_MAP, NO_MAP, "good"]
