"""Mean shift on a grid against exact all-pairs mean shift, and the bandwidth rules against their formulas."""

import math

import numpy as np
import pytest
import twins

from modlhmp.maps import mean_shift as package
from modlhmp.maps.mean_shift import BANDWIDTHS, MAX_NODES, bandwidth_isotropic, bandwidth_kucner, mean_shift

TWO_PI = 2 * np.pi
# (observations, mean heading, SD, mean speed, SD) of each cluster, and the kernel
PLANTED = {
    "opposite flows": ([(120, 0.0, 0.2, 1.2, 0.15), (60, np.pi, 0.2, 1.2, 0.15)], (0.3, 0.2)),
    "flow across the seam": ([(150, 3.1, 0.25, 1.0, 0.1), (50, 1.2, 0.2, 1.3, 0.1)], (0.25, 0.2)),
    "slow and fast": ([(100, -1.0, 0.2, 0.5, 0.06), (100, -1.0, 0.2, 1.5, 0.1)], (0.3, 0.15)),
    "four ways": ([(60, a, 0.15, 1.1, 0.15) for a in (-2.4, -0.8, 0.8, 2.4)], (0.25, 0.25)),
    "one walker's few rows": ([(6, 2.0, 0.1, 1.3, 0.1)], (0.3, 0.3)),
    "wide kernel": ([(100, 0.0, 0.3, 1.2, 0.2), (70, 2.5, 0.3, 0.8, 0.2)], (0.8, 0.8)),
}


def draw(clusters, seed):
    """Velocities of planted clusters: headings in (-pi, pi], speeds not negative."""
    rng = np.random.default_rng(seed)
    heading = np.concatenate([rng.normal(mean, sd, n) for n, mean, sd, _, _ in clusters])
    speed = np.concatenate([rng.normal(mean, sd, n) for n, _, _, mean, sd in clusters])
    return np.array([twins.wrap(h) for h in heading]), np.abs(speed)


def same_modes(got, expected, bandwidth, within):
    """Mode of `expected` for each mode of `got`; fails unless they pair up within `within` bandwidths."""
    assert len(got) == len(expected), f"{len(got)} modes: {got}; expected {len(expected)}: {expected}"
    distance = [[twins.cylinder_distance(a, b, bandwidth) for b in expected] for a in got]
    assert max(map(min, distance)) < within
    pairs = [row.index(min(row)) for row in distance]
    assert sorted(pairs) == list(range(len(expected)))
    return np.array(pairs)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", PLANTED)
def test_equals_exact_mean_shift_on_planted_flows(name, seed):
    clusters, bandwidth = PLANTED[name]
    heading, speed = draw(clusters, seed)
    expected_labels, expected = twins.mean_shift(heading, speed, bandwidth)
    labels, modes = mean_shift(heading, speed, bandwidth)
    pairs = same_modes(modes, expected, bandwidth, within=0.1)
    assert (pairs[labels] == expected_labels).mean() >= 0.98
    assert len(modes) == len(clusters)


@pytest.mark.parametrize("rule", BANDWIDTHS)
@pytest.mark.parametrize("seed", range(3))
def test_finds_the_exact_modes_at_the_bandwidth_of_the_rule(rule, seed):
    heading, speed = draw(PLANTED["opposite flows"][0], seed)
    bandwidth = BANDWIDTHS[rule](heading, speed)
    expected_labels, expected = twins.mean_shift(heading, speed, bandwidth)
    labels, modes = mean_shift(heading, speed, bandwidth)
    pairs = same_modes(modes, expected, bandwidth, within=0.25)
    assert (pairs[labels] == expected_labels).mean() >= 0.98


@pytest.mark.parametrize("sd", [0.1, 0.03, 0.01, 0.003])
@pytest.mark.parametrize("centre", [0.0123, 1.0])
def test_a_narrow_flow_is_one_cluster(sd, centre):
    # A few persons who walk the same line: the kernel is as narrow as they are, whatever the grid.
    heading, speed = draw([(200, centre, sd, 1.2, sd)], seed=5)
    bandwidth = 1.5 * sd, 1.5 * sd
    _, expected = twins.mean_shift(heading, speed, bandwidth)
    labels, modes = mean_shift(heading, speed, bandwidth)
    assert len(expected) == 1
    same_modes(modes, expected, bandwidth, within=0.25 * coarser(bandwidth))
    assert not labels.any()


@pytest.mark.parametrize("sd", [0.1, 0.03, 0.01])
def test_two_narrow_flows_are_two_clusters(sd):
    clusters = [(120, 0.5, sd, 1.2, sd), (80, 0.5 + 8 * sd, sd, 1.2, sd)]
    heading, speed = draw(clusters, seed=6)
    bandwidth = 1.5 * sd, 1.5 * sd
    expected_labels, expected = twins.mean_shift(heading, speed, bandwidth)
    labels, modes = mean_shift(heading, speed, bandwidth)
    assert len(expected) == 2
    pairs = same_modes(modes, expected, bandwidth, within=0.25 * coarser(bandwidth))
    assert (pairs[labels] == expected_labels).mean() >= 0.98


def coarser(bandwidth):
    """How much coarser than a narrow bandwidth the finest grid of headings is; nothing finer can be told apart."""
    return max(1.0, 2 * np.pi / MAX_NODES[0] / bandwidth[0])


@pytest.mark.parametrize("name", ["opposite flows", "flow across the seam", "four ways"])
def test_modes_come_by_falling_membership(name):
    heading, speed = draw(PLANTED[name][0], seed=2)
    labels, modes = mean_shift(heading, speed, PLANTED[name][1])
    members = np.bincount(labels)
    assert len(members) == len(modes)
    assert (np.diff(members) <= 0).all()
    assert (members > 0).all()
    assert ((modes[:, 0] > -np.pi) & (modes[:, 0] <= np.pi)).all()


@pytest.mark.parametrize("mean", [0.0, np.pi])
def test_climbs_from_both_sides_of_a_seam_meet(mean):
    # Symmetric about the mean: half of the climbs end a hair before it, half of them a hair behind it.
    offset = np.random.default_rng(8).normal(0, 0.2, 60)
    heading = np.array([twins.wrap(mean + d) for d in (*offset, *-offset)])
    labels, modes = mean_shift(heading, np.full(120, 1.2), (0.3, 0.3))
    assert not labels.any()
    assert len(modes) == 1
    assert twins.wrap(modes[0, 0] - mean) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("angle", [0.01, 0.7, 2.0, np.pi, -1.3])
@pytest.mark.parametrize("name", ["opposite flows", "flow across the seam", "slow and fast"])
def test_modes_turn_with_the_headings(name, angle):
    clusters, bandwidth = PLANTED[name]
    heading, speed = draw(clusters, seed=3)
    labels, modes = mean_shift(heading, speed, bandwidth)
    turned_labels, turned = mean_shift(np.array([twins.wrap(h + angle) for h in heading]), speed, bandwidth)
    pairs = same_modes(turned, modes + np.array([angle, 0.0]), bandwidth, within=0.1)
    assert (pairs[turned_labels] == labels).mean() >= 0.98


def test_order_of_the_observations_only_permutes_the_labels():
    clusters, bandwidth = PLANTED["flow across the seam"]
    heading, speed = draw(clusters, seed=4)
    labels, modes = mean_shift(heading, speed, bandwidth)
    order = np.random.default_rng(4).permutation(len(heading))
    shuffled_labels, shuffled = mean_shift(heading[order], speed[order], bandwidth)
    np.testing.assert_array_equal(shuffled_labels, labels[order])
    np.testing.assert_allclose(shuffled, modes, atol=1e-9)


@pytest.mark.parametrize("heading", [0.0, 1.0, np.pi, -3.0])
@pytest.mark.parametrize("n", [1, 2, 50])
def test_equal_observations_are_one_cluster_at_their_place(heading, n):
    labels, modes = mean_shift(np.full(n, heading), np.full(n, 1.3), (0.2, 0.2))
    assert labels.tolist() == [0] * n
    assert modes.shape == (1, 2)
    assert twins.wrap(modes[0, 0] - heading) == pytest.approx(0.0, abs=1e-9)
    assert modes[0, 1] == pytest.approx(1.3, abs=1e-9)


@pytest.mark.parametrize(
    ("heading", "speed", "clusters"),
    [
        ((0.0, 2.0), (1.0, 1.0), 2),
        ((1.0, 1.0), (0.5, 1.8), 2),
        ((1.0, 1.1), (1.0, 1.1), 1),
        ((np.pi, -np.pi), (1.0, 1.0), 1),
        ((np.pi - 0.1, -np.pi + 0.1), (1.0, 1.05), 1),
        ((np.pi - 0.6, -np.pi + 0.6), (1.0, 1.0), 2),
    ],
)
def test_two_observations(heading, speed, clusters):
    bandwidth = 0.25, 0.25
    labels, modes = mean_shift(np.array(heading), np.array(speed), bandwidth)
    _, expected = twins.mean_shift(np.array(heading), np.array(speed), bandwidth)
    same_modes(modes, expected, bandwidth, within=0.25)
    assert len(modes) == len(set(labels.tolist())) == clusters


def test_all_at_one_speed():
    rng = np.random.default_rng(5)
    heading = np.concatenate([rng.normal(0.5, 0.15, 40), rng.normal(-2.0, 0.15, 20)])
    labels, modes = mean_shift(heading, np.full(60, 1.1), (0.3, 0.3))
    assert labels.tolist() == [0] * 40 + [1] * 20
    np.testing.assert_allclose(modes, [[heading[:40].mean(), 1.1], [heading[40:].mean(), 1.1]], atol=0.06)
    np.testing.assert_allclose(modes[:, 1], 1.1, atol=1e-6)


def test_all_with_one_heading():
    rng = np.random.default_rng(6)
    speed = np.concatenate([rng.normal(0.5, 0.05, 40), rng.normal(1.5, 0.05, 20)])
    labels, modes = mean_shift(np.full(60, -3.0), speed, (0.1, 0.1))
    assert labels.tolist() == [0] * 40 + [1] * 20
    np.testing.assert_allclose(modes[:, 0], -3.0, atol=0.01)
    np.testing.assert_allclose(modes[:, 1], [speed[:40].mean(), speed[40:].mean()], atol=0.03)


def test_every_heading_alike_is_still_an_answer():
    heading = np.linspace(-np.pi, np.pi, 101)[1:]  # a plaza: no direction stands out
    labels, modes = mean_shift(heading, np.full(100, 1.0), (2.0, 0.3))
    assert np.isfinite(modes).all()
    assert labels.shape == (100,)
    assert set(labels.tolist()) == set(range(len(modes)))


@pytest.mark.parametrize("seed", range(3))
def test_kucner_rule_is_its_formula(seed):
    heading, speed = draw(PLANTED["flow across the seam"][0], seed)
    n = len(heading)
    resultant = abs(sum(complex(math.cos(h), math.sin(h)) for h in heading)) / n
    # h = (4 s^5 / 3n)^(1/5) with variances in the place of s, and h is the variance of the kernel
    h = [(4 * s**5 / (3 * n)) ** 0.2 for s in (-2 * math.log(resultant), twins.deviation(list(speed)) ** 2)]
    np.testing.assert_allclose(bandwidth_kucner(heading, speed), np.sqrt(h), rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_isotropic_rule_is_its_formula(seed):
    heading, speed = draw(PLANTED["flow across the seam"][0], seed)
    n = len(heading)
    mean = math.atan2(sum(map(math.sin, heading)), sum(map(math.cos, heading)))
    distances = [math.hypot(twins.wrap(h - mean), v) for h, v in zip(heading, speed, strict=True)]
    h = (4 * twins.deviation(distances) ** 5 / (3 * n)) ** 0.2
    np.testing.assert_allclose(bandwidth_isotropic(heading, speed), [h, h], rtol=1e-9)


@pytest.mark.parametrize("rule", BANDWIDTHS)
def test_bandwidth_does_not_turn_with_the_headings(rule):
    heading, speed = draw(PLANTED["opposite flows"][0], seed=7)
    turned = np.array([twins.wrap(h + 2.2) for h in heading])
    np.testing.assert_allclose(BANDWIDTHS[rule](turned, speed), BANDWIDTHS[rule](heading, speed), rtol=1e-9)


@pytest.mark.parametrize("rule", BANDWIDTHS)
@pytest.mark.parametrize(
    ("heading", "speed"), [([1.0], [1.0]), ([1.0] * 9, [1.2] * 9), ([0.0, np.pi], [1.0, 1.0]), ([2.0, 2.1], [1.0, 1.0])]
)
def test_bandwidth_of_degenerate_data_is_positive(rule, heading, speed):
    heading, speed = np.array(heading), np.array(speed)
    bandwidth = BANDWIDTHS[rule](heading, speed)
    assert bandwidth.shape == (2,)
    assert np.isfinite(bandwidth).all()
    assert (bandwidth > 0).all()
    labels, modes = mean_shift(heading, speed, bandwidth)
    assert np.isfinite(modes).all()
    assert set(labels.tolist()) == set(range(len(modes)))


def test_one_merge_distance_for_twin_and_package():
    assert package.MERGE == 0.5
