"""Semi-wrapped Gaussian mixture: density and EM against plain twins."""

import numpy as np
import pytest
import twins

from modlhmp.maps import swgmm

TWO_PI = 2 * np.pi
# weight, mean heading, mean speed, var(heading), cov, var(speed); the second lies across the seam at +-pi
MIXTURE = np.array([
    [0.5, 0.4, 1.2, 0.09, 0.01, 0.04],
    [0.3, 3.0, 0.8, 0.20, -0.05, 0.03],
    [0.2, -1.5, 1.5, 0.02, 0.00, 0.10],
])  # fmt: skip
WIDE = np.array([[0.7, -2.9, 1.0, 4.0, 0.2, 0.1], [0.3, 1.0, 0.5, 0.001, 0.0, 0.0005]])


def draw(components, n, seed):
    """Velocities of a mixture; headings in (-pi, pi]."""
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(components), n, p=components[:, 0])
    points = [rng.multivariate_normal(c[1:3], twins.covariance(c)) for c in components[chosen]]
    heading, speed = np.array(points).T
    return np.array([twins.wrap(angle) for angle in heading]), speed


def rough_start(components):
    """A start for EM near `components` but not at them."""
    start = components + np.array([0.0, 0.3, -0.2, 0.05, 0.0, 0.05])
    start[:, 0] = 1 / len(start)
    return start


@pytest.mark.parametrize("components", [MIXTURE, WIDE, MIXTURE[:1]], ids=["three", "wide", "one"])
def test_density_is_the_sum_over_three_windings(components):
    rng = np.random.default_rng(1)
    heading, speed = rng.uniform(-np.pi, np.pi, 500), rng.uniform(0, 2, 500)
    expected = np.log(twins.swgmm_density(heading, speed, components))
    np.testing.assert_allclose(swgmm.log_density(heading, speed, components), expected, rtol=1e-9, atol=1e-9)


def test_density_far_from_every_component_stays_finite():
    one = np.array([[1.0, 0.0, 1.0, 1e-4, 0.0, 1e-4]])
    # N is proportional to exp(-((pi - 0)^2 + 1^2) / (2 * 1e-4)) there, far below the smallest float; both the
    # windings 0 and -1 are that far.
    expected = np.log(2) - np.log(TWO_PI * 1e-4) - (np.pi**2 + 1.0) / 2e-4
    assert swgmm.log_density(np.pi, 2.0, one)[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("shift", [0.0, 2.0, 3.1])
def test_density_integrates_to_one_over_the_cylinder(shift):
    components = MIXTURE + np.array([0, shift, 0, 0, 0, 0])
    components[:, 1] = [twins.wrap(angle) for angle in components[:, 1]]
    heading = -np.pi + TWO_PI * (np.arange(400) + 0.5) / 400
    speed = np.linspace(-2.0, 4.0, 601)
    grid = np.meshgrid(heading, speed, indexing="ij")
    density = np.exp(swgmm.log_density(grid[0].ravel(), grid[1].ravel(), components))
    assert density.sum() * (TWO_PI / 400) * (speed[1] - speed[0]) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_covariance_floor_is_that_of_the_eigenvalues(seed):
    rng = np.random.default_rng(seed)
    values = 10.0 ** rng.uniform(-7, 0, 2) * rng.choice([1, 1, 1, -1], 2)  # rounding in files makes negative ones
    turn = rng.uniform(0, np.pi)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    sigma = axes @ np.diag(values) @ axes.T
    expected = twins.floored(sigma, 1e-4)
    got = swgmm.floor_covariance(sigma[0, 0], sigma[0, 1], sigma[1, 1])
    np.testing.assert_allclose(got, [expected[0, 0], expected[0, 1], expected[1, 1]], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("given", "floored"),
    [
        ((0.0, 0.0, 0.0), (1e-4, 0.0, 1e-4)),
        ((1e-5, 0.0, 0.2), (1e-4, 0.0, 0.2)),
        ((0.2, 0.0, 1e-5), (0.2, 0.0, 1e-4)),
        ((0.3, 0.1, 0.2), (0.3, 0.1, 0.2)),
    ],
)
def test_covariance_floor_by_hand(given, floored):
    np.testing.assert_allclose(swgmm.floor_covariance(*given), floored, rtol=1e-12, atol=1e-18)


def test_default_constants_are_those_of_the_design():
    assert (swgmm.MIN_EIGENVALUE, swgmm.TOLERANCE, swgmm.MAX_ITERATIONS, swgmm.WINDINGS) == (1e-4, 1e-5, 100, 1)


@pytest.mark.parametrize("start", [MIXTURE, rough_start(MIXTURE)], ids=["true", "rough"])
def test_one_step_of_em(monkeypatch, start):
    monkeypatch.setattr(swgmm, "MAX_ITERATIONS", 1)
    heading, speed = draw(MIXTURE, 200, seed=2)
    got, _ = swgmm.fit(heading, speed, start)
    np.testing.assert_allclose(got, twins.em_step(heading, speed, start, floor=1e-4), rtol=1e-6, atol=1e-6)


def test_one_step_of_em_floors_the_covariance(monkeypatch):
    monkeypatch.setattr(swgmm, "MAX_ITERATIONS", 1)
    speed = np.linspace(0.5, 1.5, 11)
    heading = np.full(11, 0.7)  # one heading: var(heading) would be 0
    got, _ = swgmm.fit(heading, speed, [[1.0, 0.6, 1.0, 0.1, 0.0, 0.1]])
    np.testing.assert_allclose(got, [[1.0, 0.7, 1.0, 1e-4, 0.0, np.var(speed)]], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_whole_run_of_em(seed):
    heading, speed = draw(MIXTURE, 150, seed)
    start = rough_start(MIXTURE)
    components, gained = twins.em(heading, speed, start)
    got, log_likelihood = swgmm.fit(heading, speed, start)
    np.testing.assert_allclose(got, components, rtol=1e-6, atol=1e-6)
    assert log_likelihood == pytest.approx(gained[-1], abs=1e-6)
    assert np.abs(got - start).max() > 0.05  # it went somewhere


def test_run_on_overlapping_components_stops_where_the_twin_does():
    # Slow to converge: the gain falls below 1e-5 per observation long before it falls below 1e-5 in all.
    close = np.array([[0.5, 0.3, 1.0, 0.10, 0.0, 0.04], [0.5, 0.9, 1.2, 0.10, 0.0, 0.04]])
    heading, speed = draw(close, 200, seed=12)
    start = rough_start(close)
    components, gained = twins.em(heading, speed, start)
    assert 10 < len(gained) < 100
    assert gained[-1] - gained[-2] > 1e-4  # a stricter rule would have gone on
    got, log_likelihood = swgmm.fit(heading, speed, start)
    np.testing.assert_allclose(got, components, rtol=1e-6, atol=1e-6)
    assert log_likelihood == pytest.approx(gained[-1], abs=1e-6)


@pytest.mark.parametrize("iterations", [1, 3, 100])
def test_log_likelihood_is_that_of_the_components_returned(monkeypatch, iterations):
    monkeypatch.setattr(swgmm, "MAX_ITERATIONS", iterations)
    heading, speed = draw(MIXTURE, 100, seed=6)
    components, log_likelihood = swgmm.fit(heading, speed, rough_start(MIXTURE))
    assert log_likelihood == pytest.approx(swgmm.log_density(heading, speed, components).sum(), abs=1e-6)


@pytest.mark.parametrize(("seed", "sharp"), [(7, 1.0), (8, 1e-3)])
def test_log_likelihood_never_falls(monkeypatch, seed, sharp):
    heading, speed = draw(MIXTURE * [1, 1, 1, sharp, sharp, sharp], 120, seed)  # sharp: at the floor
    start = rough_start(MIXTURE)
    gained = [swgmm.log_density(heading, speed, start).sum()]
    for iterations in range(1, 25):
        monkeypatch.setattr(swgmm, "MAX_ITERATIONS", iterations)
        components, _ = swgmm.fit(heading, speed, start)
        gained.append(swgmm.log_density(heading, speed, components).sum())
    assert min(np.diff(gained)) >= -1e-8
    assert gained[-1] > gained[0] + 10


def test_em_recovers_the_mixture_that_was_drawn():
    heading, speed = draw(MIXTURE, 4000, seed=9)
    got, _ = swgmm.fit(heading, speed, rough_start(MIXTURE))
    np.testing.assert_allclose(got, MIXTURE, atol=0.05)


@pytest.mark.parametrize("angle", [0.5, 2.0, np.pi, -3.0])
def test_em_turns_with_the_headings(angle):
    heading, speed = draw(MIXTURE, 300, seed=10)
    turned = np.array([twins.wrap(h + angle) for h in heading])
    start = rough_start(MIXTURE)
    turned_start = start + np.array([0, angle, 0, 0, 0, 0])
    turned_start[:, 1] = [twins.wrap(h) for h in turned_start[:, 1]]
    got, log_likelihood = swgmm.fit(heading, speed, start)
    got_turned, log_likelihood_turned = swgmm.fit(turned, speed, turned_start)
    assert log_likelihood_turned == pytest.approx(log_likelihood, abs=1e-6)
    moved = [twins.wrap(h) for h in got_turned[:, 1] - got[:, 1] - angle]
    np.testing.assert_allclose(moved, 0.0, atol=1e-7)
    np.testing.assert_allclose(np.delete(got_turned, 1, axis=1), np.delete(got, 1, axis=1), atol=1e-7)


def test_component_without_an_observation_is_removed():
    heading, speed = draw(MIXTURE[:1] * [2, 1, 1, 1, 1, 1], 60, seed=11)
    start = np.array([[0.5, 0.4, 1.2, 0.1, 0.0, 0.1], [0.5, -2.7, 9.0, 0.01, 0.0, 0.01]])
    got, log_likelihood = swgmm.fit(heading, speed, start)
    alone, log_likelihood_alone = swgmm.fit(heading, speed, start[:1])
    np.testing.assert_allclose(got, alone, atol=1e-3)
    assert got.shape == (1, 6)
    assert got[0, 0] == pytest.approx(1.0, abs=1e-12)
    assert log_likelihood == pytest.approx(log_likelihood_alone, abs=1e-3)


def test_moments_by_hand_across_the_seam():
    heading, speed = np.array([np.pi - 0.1, -np.pi + 0.3]), np.array([1.0, 2.0])
    # unrolled: pi - 0.1 and pi + 0.3, mean pi + 0.1 = -pi + 0.1; deviations -0.2, 0.2 and -0.5, 0.5; Sigma is singular
    expected = twins.floored(np.array([[0.04, 0.1], [0.1, 0.25]]), 1e-4)
    got = swgmm.moments(heading, speed)
    assert twins.wrap(got[0] - (-np.pi + 0.1)) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(got[1:], [1.5, expected[0, 0], expected[0, 1], expected[1, 1]], rtol=1e-9)
