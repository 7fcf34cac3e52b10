"""Mean shift on the cylinder (heading, speed): where do the velocities of a location gather?

Every observation climbs the density that all of them make as a sum of Gaussians (D. Comaniciu, P. Meer, PAMI 2002).
The data are first spread over a fine grid; there the shift vector of every node is a ratio of two convolutions, so the
climb of each occupied node costs one interpolation per step, whatever the number of observations. Nodes climb heaviest
first, and only until they come near a mode that an earlier one has reached.
"""

from typing import NamedTuple

import numpy as np

from modlhmp.angles import TWO_PI, circular_mean
from modlhmp.kernels import kernel

NODES_PER_BANDWIDTH = 4.0
MAX_NODES = (256, 128)
MIN_NODES = (32, 8)
MAX_ITERATIONS = 200
STOP = 1e-3  # a climb ends when it moves less than this part of the bandwidth
MERGE = 0.5  # modes closer than this part of the bandwidth are one
CAPTURE = 0.1  # a climb so near to a mode that is known already ends there


class Grid(NamedTuple):
    """Nodes over the circle of headings, a step [rad] apart, and over the speeds from `low` on, a step [m/s] apart."""

    turn: int
    turn_step: float
    speeds: int
    speed_step: float
    low: float


@kernel
def mean_shift(heading, speed, bandwidth):
    """Cluster velocities by the mode that each climbs to.

    `heading` [rad] and `speed` [m/s] are [n]; `bandwidth` is the pair of the Gaussian's standard deviations
    (rad, m/s). Returns (labels [n], modes [m, 2]), modes ordered by falling number of members.
    """
    if heading.min() == heading.max() and speed.min() == speed.max():
        return np.zeros(len(heading), np.int64), np.array([[heading[0], speed[0]]])
    grid = _grid(speed, bandwidth)
    # Nothing finer than the grid can be told apart.
    width = max(bandwidth[0], grid.turn_step), max(bandwidth[1], grid.speed_step)
    weights, nearest = _spread(heading, speed, grid)
    shift = _shift_field(weights, width, grid)
    occupied, weight, row_of = _occupied(weights)
    labels, ends = _climb(occupied, weight, shift, width, grid)
    of_point = np.empty(len(nearest), np.int64)
    for n in range(len(nearest)):
        of_point[n] = labels[row_of[nearest[n, 0], nearest[n, 1]]]
    return _order(of_point, labels, ends, weight, grid)


@kernel
def bandwidth_kucner(heading, speed):
    """The reference CLiFF-map builder's rule: h = (4 s^5 / 3n)^(1/5) for s = -2 ln R and s = var(speed).

    Its h is used as a *variance* of the Gaussian, so the standard deviations are sqrt(h).
    """
    n = len(heading)
    length = min(np.hypot(np.cos(heading).mean(), np.sin(heading).mean()), 1.0)
    spreads = np.array([-2.0 * np.log(max(length, 1e-12)), sample_variance(speed)])
    return np.sqrt(np.maximum((4.0 / (3.0 * n)) ** 0.2 * spreads, 1e-10))


@kernel
def bandwidth_isotropic(heading, speed):
    """The online CLiFF-map builder's rule: one h = (4 s^5 / 3n)^(1/5), the same number for radians and for m/s.

    s is the standard deviation of the observations' distances to (mean heading, speed 0). The original measures
    from heading 0, so that its maps change when the frame is rotated; ours do not.
    """
    n = len(heading)
    turned = heading - circular_mean(heading)
    turned -= TWO_PI * np.rint(turned / TWO_PI)
    s = np.sqrt(sample_variance(np.hypot(turned, speed))) if n > 1 else 1.0
    h = max((4.0 / (3.0 * n)) ** 0.2 * s, 1e-5)
    return np.array([h, h])


@kernel
def sample_variance(values):
    """Variance with n - 1; 0 of one value."""
    return np.sum((values - values.mean()) ** 2) / max(len(values) - 1, 1)


BANDWIDTHS = {"kucner": bandwidth_kucner, "isotropic": bandwidth_isotropic}


@kernel
def _grid(speed, bandwidth):
    """A `Grid` fine enough for the bandwidth, within limits."""
    turn = np.ceil(NODES_PER_BANDWIDTH * TWO_PI / bandwidth[0])
    turn = int(min(max(turn, MIN_NODES[0]), MAX_NODES[0]))
    low, high = speed.min(), speed.max()
    speeds = np.ceil(NODES_PER_BANDWIDTH * (high - low) / bandwidth[1]) + 1
    speeds = int(min(max(speeds, MIN_NODES[1]), MAX_NODES[1]))
    return Grid(turn, TWO_PI / turn, speeds, max(high - low, 1e-9) / (speeds - 1), low)


@kernel
def _spread(heading, speed, grid):
    """Linear binning: each observation shared among its four nodes; also the nearest node [n, 2] of each."""
    weights, nearest = np.zeros((grid.turn, grid.speeds)), np.empty((len(heading), 2), np.int64)
    for n in range(len(heading)):
        u, v = (heading[n] % TWO_PI) / grid.turn_step, (speed[n] - grid.low) / grid.speed_step
        i, j = int(u), min(int(v), grid.speeds - 2)
        a, b = u - i, v - j
        i, after = i % grid.turn, (i + 1) % grid.turn
        weights[i, j] += (1.0 - a) * (1.0 - b)
        weights[after, j] += a * (1.0 - b)
        weights[i, j + 1] += (1.0 - a) * b
        weights[after, j + 1] += a * b
        nearest[n, 0], nearest[n, 1] = after if a >= 0.5 else i, j + (b >= 0.5)
    return weights, nearest


@kernel
def _occupied(weights):
    """Nodes with any weight, [m, 2], their weights [m], and the row of each node among them, [turn, speeds]."""
    turn, speeds = weights.shape
    occupied, weight = np.empty((turn * speeds, 2), np.int64), np.empty(turn * speeds)
    row_of, m = np.empty((turn, speeds), np.int64), 0
    for i in range(turn):
        for j in range(speeds):
            if weights[i, j] > 0.0:
                occupied[m, 0], occupied[m, 1], weight[m] = i, j, weights[i, j]
                row_of[i, j] = m
                m += 1
    return occupied[:m].copy(), weight[:m].copy(), row_of


@kernel
def _shift_field(weights, bandwidth, grid):
    """Mean-shift vector in nodes at every node, [turn, speeds, 2]."""
    turn, speeds = weights.shape
    # Both Gaussians depend on offsets between nodes only. Sums run along the rows of the grid, which are contiguous.
    k_speed, m_speed = np.empty(2 * speeds - 1), np.empty(2 * speeds - 1)
    for offset in range(1 - speeds, speeds):
        away = offset * grid.speed_step
        k_speed[offset + speeds - 1] = np.exp(-0.5 * (away / bandwidth[1]) ** 2)
        m_speed[offset + speeds - 1] = k_speed[offset + speeds - 1] * away
    smooth, pull = np.zeros((turn, speeds)), np.zeros((turn, speeds))
    for i in range(turn):
        for j in range(speeds):
            if weights[i, j] > 0.0:
                first = speeds - 1 - j
                for at in range(speeds):
                    smooth[i, at] += weights[i, j] * k_speed[first + at]
                    pull[i, at] -= weights[i, j] * m_speed[first + at]
    mass, turned, sped = np.zeros((3, turn, speeds))
    for offset in range(turn):
        k_turn = m_turn = 0.0
        for winding in (-1, 0, 1):
            away = offset * grid.turn_step + TWO_PI * winding
            k = np.exp(-0.5 * (away / bandwidth[0]) ** 2)
            k_turn += k
            m_turn += k * away
        if k_turn < 1e-20:
            continue
        for i in range(turn):
            source = (i + offset) % turn
            for at in range(speeds):
                mass[i, at] += k_turn * smooth[source, at]
                turned[i, at] += m_turn * smooth[source, at]
                sped[i, at] += k_turn * pull[source, at]
    shift = np.empty((turn, speeds, 2))
    for i in range(turn):
        for at in range(speeds):
            total = max(mass[i, at], 1e-300)
            shift[i, at, 0] = turned[i, at] / (total * grid.turn_step)
            shift[i, at, 1] = sped[i, at] / (total * grid.speed_step)
    return shift


@kernel
def _climb(occupied, weight, shift, bandwidth, grid):
    """Follow the shift field from every occupied node [m, 2], the heaviest first, to a mode: labels [m], ends [m, 2].

    Modes are where a climb stands still; one that ends within `MERGE` bandwidths of an earlier mode belongs to it.
    Ends are in nodes.
    """
    labels, ends = np.full(len(occupied), -1), np.empty((len(occupied), 2))
    # What a node counts in bandwidths.
    scale = grid.turn_step / bandwidth[0], grid.speed_step / bandwidth[1]
    modes, number = np.empty((len(occupied), 2)), 0
    for n in np.argsort(-weight, kind="mergesort"):
        u, v = float(occupied[n, 0]), float(occupied[n, 1])
        for _ in range(MAX_ITERATIONS):
            du, dv = _interpolated(shift, u, v)
            u = (u + du) % grid.turn
            v = min(max(v + dv, 0.0), grid.speeds - 1.0)
            if abs(du) * scale[0] < STOP and abs(dv) * scale[1] < STOP:
                break
            if _nearest_mode(u, v, modes[:number], scale, grid.turn, CAPTURE) >= 0:
                break
        mode = _nearest_mode(u, v, modes[:number], scale, grid.turn, MERGE)
        if mode < 0:
            mode, number = number, number + 1
            modes[mode, 0], modes[mode, 1] = u, v
        labels[n] = mode
        ends[n, 0], ends[n, 1] = u, v
    return labels, ends


@kernel
def _interpolated(shift, u, v):
    """The shift field between four nodes."""
    turn, speeds, _ = shift.shape
    i, j = int(u), min(int(v), speeds - 2)
    a, b = u - i, v - j
    i, after = i % turn, (i + 1) % turn
    near, far = (1.0 - a) * (1.0 - b), (1.0 - a) * b
    near_after, far_after = a * (1.0 - b), a * b
    du = near * shift[i, j, 0] + far * shift[i, j + 1, 0] + near_after * shift[after, j, 0]
    dv = near * shift[i, j, 1] + far * shift[i, j + 1, 1] + near_after * shift[after, j, 1]
    return du + far_after * shift[after, j + 1, 0], dv + far_after * shift[after, j + 1, 1]


@kernel
def _nearest_mode(u, v, modes, scale, turn, within):
    """The first mode closer than `within` bandwidths, -1 if there is none."""
    for m in range(len(modes)):
        du = abs(u - modes[m, 0])
        du = min(du, turn - du) * scale[0]
        dv = (v - modes[m, 1]) * scale[1]
        if du * du + dv * dv < within * within:
            return m
    return -1


@kernel
def _order(of_point, labels, ends, weight, grid):
    """Labels of the points and modes by falling membership, empty ones dropped; a mode is the mean of its climbs."""
    sums = np.zeros((labels.max() + 1, 4))
    for n in range(len(labels)):
        angle = ends[n, 0] * grid.turn_step
        sums[labels[n], 0] += weight[n] * np.cos(angle)
        sums[labels[n], 1] += weight[n] * np.sin(angle)
        sums[labels[n], 2] += weight[n] * ends[n, 1]
        sums[labels[n], 3] += weight[n]
    members = np.bincount(of_point, minlength=len(sums))
    order = np.argsort(-members, kind="mergesort")[: np.sum(members > 0)]
    rank, modes = np.empty(len(members), np.int64), np.empty((len(order), 2))
    for place, m in enumerate(order):
        rank[m] = place
        modes[place, 0] = np.arctan2(sums[m, 1], sums[m, 0])
        modes[place, 1] = grid.low + grid.speed_step * sums[m, 2] / sums[m, 3]
    return rank[of_point], modes
