"""Mean shift on the cylinder (heading, speed): where do the velocities of a location gather?

Every observation climbs the kernel density estimate of all of them (D. Comaniciu, P. Meer, PAMI 2002). The data are
first spread over a fine grid; there the shift vector of every node is a ratio of two convolutions, so the climb
of each occupied node costs one interpolation a step, whatever the number of observations.
"""

import numpy as np
from numba import njit

from modlhmp.tracks import wrap_angle

NODES_PER_BANDWIDTH = 4.0
MAX_NODES = (256, 128)
MIN_NODES = (32, 8)
MAX_ITERATIONS = 200
STOP = 1e-3  # a climb ends when it moves less than this part of the bandwidth
MERGE = 0.5  # modes closer than this part of the bandwidth are one
TWO_PI = 2.0 * np.pi


def mean_shift(heading, speed, bandwidth):
    """Cluster velocities by the mode that each climbs to.

    `heading` [rad] and `speed` [m/s] are [n]; `bandwidth` is the pair of the Gaussian kernel's standard deviations
    (rad, m/s). Returns (labels [n], modes [m, 2]), modes ordered by falling number of members.
    """
    if min(np.ptp(speed), len(speed) - 1) <= 0 and np.ptp(heading) == 0:
        return np.zeros(len(heading), np.int64), np.array([[heading[0], speed[0]]])
    grid = _grid(speed, bandwidth)
    bandwidth = np.maximum(bandwidth, [grid[1], grid[3]])  # nothing finer than the grid can be told apart
    weights, corner = _spread(heading, speed, *grid)
    shift = _shift_field(weights, bandwidth, *grid)
    start = np.argwhere(weights > 0)
    ends = _climb(start, shift, np.array([grid[1], grid[3]]), STOP * bandwidth)
    labels = _merge(ends, weights[tuple(start.T)], bandwidth, grid)
    node_label = np.full(weights.shape, -1)
    node_label[tuple(start.T)] = labels
    return _order(node_label[tuple(corner.T)], ends, labels, weights[tuple(start.T)], grid)


def bandwidth_kucner(heading, speed):
    """The reference CLiFF-map builder's rule: h = (4 s^5 / 3n)^(1/5) for s = -2 ln R and s = var(speed).

    Its h is used as a *variance* of the kernel, so the standard deviations are sqrt(h).
    """
    n = len(heading)
    length = min(np.hypot(np.cos(heading).mean(), np.sin(heading).mean()), 1.0)
    spreads = np.array([-2.0 * np.log(max(length, 1e-12)), np.var(speed, ddof=1) if n > 1 else 0.0])
    return np.sqrt(np.maximum((4.0 / (3.0 * n)) ** 0.2 * spreads, 1e-10))


def bandwidth_isotropic(heading, speed):
    """The online CLiFF-map builder's rule: one h = (4 s^5 / 3n)^(1/5), the same number for radians and for m/s.

    s is the standard deviation of the observations' distances to (mean heading, speed 0). The original measures
    from heading 0, so that its maps change when the frame is rotated; ours do not.
    """
    n = len(heading)
    turned = wrap_angle(heading - np.arctan2(np.sin(heading).mean(), np.cos(heading).mean()))
    s = np.std(np.hypot(turned, speed), ddof=1) if n > 1 else 1.0
    h = max((4.0 / (3.0 * n)) ** 0.2 * s, 1e-5)
    return np.array([h, h])


BANDWIDTHS = {"kucner": bandwidth_kucner, "isotropic": bandwidth_isotropic}


def _grid(speed, bandwidth):
    """(nodes, step [rad], nodes, step [m/s], first speed): fine enough for the bandwidth, within limits."""
    turn = int(np.clip(np.ceil(NODES_PER_BANDWIDTH * TWO_PI / bandwidth[0]), MIN_NODES[0], MAX_NODES[0]))
    low, high = speed.min(), speed.max()
    wanted = np.ceil(NODES_PER_BANDWIDTH * (high - low) / bandwidth[1]) + 1
    speeds = int(np.clip(wanted, MIN_NODES[1], MAX_NODES[1]))
    return turn, TWO_PI / turn, speeds, max(high - low, 1e-9) / (speeds - 1), low


def _spread(heading, speed, turn, turn_step, speeds, speed_step, low):
    """Linear binning: each observation shared among its four nodes; also the nearest node [n, 2] of each."""
    u, v = np.mod(heading, TWO_PI) / turn_step, (speed - low) / speed_step
    i, j = np.floor(u).astype(np.int64), np.minimum(np.floor(v).astype(np.int64), speeds - 2)
    a, b = u - i, v - j
    weights = np.zeros((turn, speeds))
    for di, dj, share in ((0, 0, (1 - a) * (1 - b)), (1, 0, a * (1 - b)), (0, 1, (1 - a) * b), (1, 1, a * b)):
        np.add.at(weights, ((i + di) % turn, j + dj), share)
    return weights, np.column_stack([(i + (a >= 0.5)) % turn, j + (b >= 0.5)])


def _shift_field(weights, bandwidth, turn, turn_step, speeds, speed_step, low):
    """Mean-shift vector in nodes at every node, [turn, speeds, 2]."""
    # Both kernels depend on offsets between nodes only, so each is evaluated once an offset.
    node, between = np.arange(turn), np.arange(1 - speeds, speeds) * speed_step
    d_turn = wrap_angle(node * turn_step)[:, None] + TWO_PI * np.array([-1, 0, 1])  # three windings
    kernel = np.exp(-0.5 * (d_turn / bandwidth[0]) ** 2)
    offset = (node[None] - node[:, None]) % turn
    k_turn, m_turn = kernel.sum(-1)[offset], (kernel * d_turn).sum(-1)[offset]
    kernel = np.exp(-0.5 * (between / bandwidth[1]) ** 2)
    offset = np.arange(speeds)[:, None] - np.arange(speeds)[None] + speeds - 1
    k_speed, m_speed = kernel[offset], (kernel * between)[offset]
    smooth = weights @ k_speed
    mass = np.maximum(k_turn @ smooth, 1e-300)
    return np.stack([m_turn @ smooth / (mass * turn_step), k_turn @ weights @ m_speed / (mass * speed_step)], -1)


@njit(cache=True)
def _climb(start, shift, steps, stop):
    """Follow the shift field, bilinearly interpolated, from every start node until it is still; in nodes."""
    turn, speeds, _ = shift.shape
    ends = np.empty((len(start), 2))
    for n in range(len(start)):
        u, v = float(start[n, 0]), float(start[n, 1])
        for _ in range(MAX_ITERATIONS):
            i, j = int(np.floor(u)), min(int(np.floor(v)), speeds - 2)
            a, b = u - i, v - j
            du = dv = 0.0
            for p in range(2):
                for q in range(2):
                    w = (a if p else 1.0 - a) * (b if q else 1.0 - b)
                    du += w * shift[(i + p) % turn, j + q, 0]
                    dv += w * shift[(i + p) % turn, j + q, 1]
            u = np.mod(u + du, turn)
            v = min(max(v + dv, 0.0), speeds - 1.0)
            if abs(du) * steps[0] < stop[0] and abs(dv) * steps[1] < stop[1]:
                break
        ends[n, 0], ends[n, 1] = u, v
    return ends


def _merge(ends, weights, bandwidth, grid):
    """Label climbs by the mode they reach: the heaviest first, each within `MERGE` bandwidths of a mode joins it."""
    turn, turn_step, _, speed_step, _ = grid
    labels, modes = np.full(len(ends), -1), []
    for n in np.argsort(-weights, kind="stable"):
        if labels[n] < 0:
            du = np.abs(ends[:, 0] - ends[n, 0])
            du = np.minimum(du, turn - du) * turn_step / bandwidth[0]
            dv = (ends[:, 1] - ends[n, 1]) * speed_step / bandwidth[1]
            labels[(labels < 0) & (np.hypot(du, dv) < MERGE)] = len(modes)
            modes.append(n)
    return labels


def _order(point_labels, ends, labels, weights, grid):
    """Modes by falling membership, empty ones dropped; a mode is the weighted end of its climbs."""
    _, turn_step, _, speed_step, low = grid
    members = np.bincount(point_labels, minlength=labels.max() + 1)
    order = [m for m in np.argsort(-members, kind="stable") if members[m]]
    modes = np.empty((len(order), 2))
    for rank, m in enumerate(order):
        rows = labels == m
        angle, w = ends[rows, 0] * turn_step, weights[rows]
        modes[rank] = (
            np.arctan2(w @ np.sin(angle), w @ np.cos(angle)),
            low + speed_step * (w @ ends[rows, 1]) / w.sum(),
        )
    rank_of = np.empty(len(members), np.int64)
    rank_of[order] = np.arange(len(order))
    return rank_of[point_labels], modes
