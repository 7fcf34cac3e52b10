"""Slow, plain twins of Trajectron++, TUTR and MID, written person by person and step by step, and made-up scenes.

A twin takes the weights of the network under test and nothing else of it; distributions are torch's.
"""

import math

import torch
from torch import nn
from torch.distributions import Categorical, MultivariateNormal

from modlhmp.networks.data import Scenes

torch.set_num_threads(1)

OBSERVED, STEPS = 4, 12


def walking(seed, n=6, others=3, steps=STEPS, dtype=torch.float64, whole=False):
    """Made-up walkers with `others` around them, each of whom is absent now and then; truths of many lengths."""
    g = torch.Generator().manual_seed(seed)
    rows = OBSERVED + steps
    velocity = 0.5 * torch.randn(n, 1 + others, 1, 2, generator=g)
    at_t0 = 1.2 * torch.randn(n, 1 + others, 1, 2, generator=g)
    at_t0[:, 0] = 0.0
    sway = 0.05 * torch.randn(n, 1 + others, rows, 2, generator=g).cumsum(2)
    xy = velocity * torch.arange(float(rows))[:, None] + sway
    xy = xy - xy[:, :, OBSERVED - 1 : OBSERVED] + at_t0
    present = torch.ones(n, 1 + others, rows, dtype=torch.bool)
    came = torch.randint(-2, OBSERVED, (n, others), generator=g)
    left = torch.randint(OBSERVED, rows, (n, others), generator=g)
    row = torch.arange(rows)
    present[:, 1:] = (row >= came[..., None]) & (row <= left[..., None])
    present[::4, 1:] = False
    if not whole:
        length = torch.arange(n) * 5 % steps + 1
        present[:, 0] = row < OBSERVED + length[:, None]
    xy = torch.where(present[..., None], xy, 0.0).to(dtype)
    where = torch.cat([10 * torch.randn(n, 2, generator=g), 24 * torch.rand(n, 1, generator=g)], 1).to(dtype)
    return Scenes(xy[:, :, :OBSERVED], present[:, :, :OBSERVED], xy[:, :, OBSERVED:], present[:, :, OBSERVED:], where)


def without_dropout(network):
    """The network in training, with nothing dropped."""
    for layer in network.modules():
        if isinstance(layer, nn.Dropout | nn.MultiheadAttention):
            setattr(layer, "p" if isinstance(layer, nn.Dropout) else "dropout", 0.0)
    return network.train()


def one(scenes, i):
    """The scene i alone, up to its own truth."""
    length = int(scenes.future_present[i, 0].sum())
    past, past_present, future, future_present, where = (part[i : i + 1] for part in scenes)
    return Scenes(past, past_present, future[:, :, :length], future_present[:, :, :length], where)


def people(scenes, which):
    """The scenes with some of their people, or all in another order."""
    return Scenes(*(part[:, which] for part in scenes[:4]), scenes.where)


def norm(values):
    """Length of a vector."""
    return math.sqrt(sum(float(value) ** 2 for value in values))


# --- Trajectron++ -------------------------------------------------------------------------------------------


def derivative(values, present, step_s):
    """(v_t - v_{t-1}) / step of a list of vectors; a step whose predecessor is absent copies the next, if known."""
    steps, result = len(values), []

    def known(t):
        return 0 < t < steps and present[t] and present[t - 1]

    for t in range(steps):
        at = t if known(t) else t + 1
        zero = torch.zeros_like(values[t])
        result.append((values[at] - values[at - 1]) / step_s if present[t] and known(at) else zero)
    return result


def states(xy, present, step_s):
    """Position, velocity and acceleration of one person, a list of 6-vectors."""
    velocity = derivative(list(xy), present, step_s)
    acceleration = derivative(velocity, present, step_s)
    return [torch.cat(parts) for parts in zip(xy, velocity, acceleration, strict=True)]


def edge_strength(adjacent):
    """A list of 0 .. 1: min(1, 0.25 a_t + 0.5 a_{t-1} + 0.75 a_{t-2} + a_{t-3}) where a_t, else 0."""
    result = []
    for t, edge in enumerate(adjacent):
        total = sum((0.25, 0.5, 0.75, 1.0)[lag] * adjacent[t - lag] for lag in range(4) if t >= lag)
        result.append(min(1.0, total) if edge else 0.0)
    return result


def lstm_last(weights, inputs, suffix="_l0", state=None):
    """Last (h, c) of an LSTM over a list of vectors, gate by gate."""
    names = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
    w_ih, w_hh, b_ih, b_hh = (getattr(weights, f"{name}{suffix}") for name in names)
    zeros = inputs[0].new_zeros(w_hh.shape[1])
    h, c = state or (zeros, zeros)
    for x in inputs:
        i, f, g, o = (w_ih @ x + b_ih + w_hh @ h + b_hh).chunk(4)
        c = torch.sigmoid(f) * c + torch.sigmoid(i) * torch.tanh(g)
        h = torch.sigmoid(o) * torch.tanh(c)
    return h, c


def encode(encoder, past, present, step_s):
    """Context (edge, history) and the standardised present state of one walker; nothing is dropped."""
    scale = past.new_tensor([3.0, 3.0, 2.0, 2.0, 1.0, 1.0])
    everyone = [states(past[m], present[m], step_s) for m in range(len(past))]
    now = everyone[0][-1]
    own = [state / scale for state in everyone[0]]
    inputs, mask = [torch.zeros_like(now) for _ in own], 0.0
    for m in range(1, len(past)):
        adjacent = [bool(present[m, t]) and norm(past[m, t] - past[0, t]) <= 3.0 for t in range(len(own))]
        strength = edge_strength(adjacent)[-1]
        mask += strength
        for t in range(len(own)):
            if present[m, t] and strength > 0.01:
                inputs[t] = inputs[t] + (everyone[m][t] - now) / scale
    history, _ = lstm_last(encoder.history, own)
    edge, _ = lstm_last(encoder.edge, [torch.cat(pair) for pair in zip(inputs, own, strict=True)])
    return torch.cat([min(1.0, mask) * edge, history]), now / scale


def encode_future(network, truth, now):
    """Last h and c forward over a path, begun from the present state, then backward, begun from 0."""
    start = network.future_h(now), network.future_c(now)
    ahead = lstm_last(network.future, list(truth), state=start)
    back = lstm_last(network.future, list(truth.flip(0)), "_l0_reverse")
    return torch.cat([ahead[0], back[0], ahead[1], back[1]])


def decode(network, context, now, z, feedback):
    """[(mean, log sigma, rho)] of one latent value; `feedback`(t, mean, log sigma, rho) yields the next input."""
    one_hot = nn.functional.one_hot(torch.tensor(z), network.modes).to(context)
    hidden = network.first_state(torch.cat([one_hot, context]))
    velocity, outputs = network.first_velocity(now), []
    while True:
        hidden = network.cell(torch.cat([one_hot, context, velocity]), hidden)
        raw = network.heads(hidden)
        outputs.append((raw[1:3], raw[3:5], torch.tanh(raw[5])))
        velocity = feedback(len(outputs) - 1, *outputs[-1])
        if velocity is None:
            return outputs


def covariance(log_sigma, rho):
    """2 x 2 covariance of a velocity."""
    (a, b), off = torch.exp(log_sigma), rho * torch.exp(log_sigma).prod()
    return torch.stack([torch.stack([a * a, off]), torch.stack([off, b * b])])


def sampled(normals):
    """Feedback of a sample made of two standard normal numbers per step [T, 2]; ends after T steps."""

    def feedback(t, mean, log_sigma, rho):
        if t + 1 == len(normals):
            return None
        a, b = normals[t]
        return mean + torch.exp(log_sigma) * torch.stack([a, rho * a + torch.sqrt(1 - rho**2) * b])

    return feedback


def trajectron_loss(network, scenes, beta, bound, normals):
    """-(sum_t min(6, log sum_k q_k N_k(y_t)) - beta max(0.07, KL(q || p)) + MI(p)), means over the walkers.

    Nothing is dropped. `normals` [T, n, K, 2] are the standard normal numbers of the samples fed back.
    """
    likelihoods, divergences, priors = [], [], []

    def categorical(logits):
        return Categorical(logits=(logits - logits.mean()).clamp(-bound, bound))

    for i in range(len(scenes.past)):
        context, now = encode(network.encoder, scenes.past[i], scenes.past_present[i], network.step_s)
        length = int(scenes.future_present[i, 0].sum())
        truth = scenes.future[i, 0, :length]
        prior = categorical(network.prior(context))
        posterior = categorical(network.posterior(torch.cat([context, encode_future(network, truth, now)])))
        paths = [decode(network, context, now, z, sampled(normals[:length, i, z])) for z in range(network.modes)]
        total = 0.0
        for t in range(length):
            parts = []
            for z, outputs in enumerate(paths):
                mean = network.step_s * sum(output[0] for output in outputs[: t + 1])
                spread = network.step_s**2 * sum(covariance(*output[1:]) for output in outputs[: t + 1])
                density = MultivariateNormal(mean, spread, validate_args=False).log_prob(truth[t])
                parts.append(torch.log(posterior.probs[z]) + density)
            total = total + torch.logsumexp(torch.stack(parts), 0).clamp(max=6.0)
        likelihoods.append(total)
        divergences.append(torch.distributions.kl_divergence(posterior, prior))
        priors.append(prior)
    information = Categorical(torch.stack([p.probs for p in priors]).mean(0)).entropy()
    information = information - torch.stack([p.entropy() for p in priors]).mean()
    kl = torch.stack(divergences).mean()
    return -(torch.stack(likelihoods).mean() - beta * kl.clamp(min=0.07) + information)


# --- attention, TUTR ----------------------------------------------------------------------------------------


def attend(layer, queries, keys, values, allowed):
    """Multi-head attention [Q, width], head by head and query by query; `allowed` says which keys count."""
    q, k, v = (
        x @ w.T + b
        for x, w, b in zip(
            (queries, keys, values), layer.in_proj_weight.chunk(3), layer.in_proj_bias.chunk(3), strict=True
        )
    )
    size, rows = layer.head_dim, []
    for query in q:
        heads = []
        for h in range(layer.num_heads):
            part = slice(h * size, (h + 1) * size)
            score = torch.stack([query[part] @ key[part] / math.sqrt(size) for key in k[allowed]])
            heads.append(torch.softmax(score, 0) @ v[allowed][:, part])
        rows.append(layer.out_proj(torch.cat(heads)))
    return torch.stack(rows)


def normed(layer, x):
    """Layer normalisation."""
    away = x - x.mean(-1, keepdim=True)
    return away / torch.sqrt((away**2).mean(-1, keepdim=True) + layer.eps) * layer.weight + layer.bias


def tutr_block(block, x, others, allowed):
    """With u = norm(x + attention), norm(u + feed-forward); nothing is dropped."""
    u = normed(block.norms[0], x + attend(block.attention, block.query(x), block.key(others), others, allowed))
    return normed(block.norms[1], u + block.feed_forward(u))


def tutr(network, past, present):
    """Logits [K] and the path of every mode [K, steps, 2] of one walker, all in its own frame."""
    flat = [torch.cat([past[0].flatten(), mode.flatten()]) for mode in network.modes]
    x = network.mode_token(torch.stack(flat))
    everyone = torch.ones(len(x), dtype=torch.bool)
    for block in network.encoder:
        x = tutr_block(block, x, x, everyone)
    logits = network.score(x)[:, 0]
    near = [
        bool(present[m].all()) and sum(norm(past[m, t] - past[0, t]) for t in range(len(past[m]))) / len(past[m]) < 2.0
        for m in range(len(past))
    ]
    others = network.neighbour_token(past.flatten(1))
    decoded = tutr_block(network.decoder, x, others, torch.tensor(near))
    return logits, network.path(decoded).view(len(x), -1, 2)


def mode_distances(future, present, modes):
    """Distances [K]: the root of the squared distances of the present steps, times (all steps / present steps)."""
    steps = [t for t in range(len(future)) if present[t]]
    return [math.sqrt(sum(norm(future[t] - mode[t]) ** 2 for t in steps) * len(future) / len(steps)) for mode in modes]


def within_clusters(future, present, modes):
    """What k-means minimises: squared distances of the present steps to the closest mode, added up."""
    total = 0.0
    for path, there in zip(future, present, strict=True):
        steps = int(there.sum())
        total += min(mode_distances(path, there, modes)) ** 2 * steps / len(path)
    return total


# --- MID ----------------------------------------------------------------------------------------------------


def schedule():
    """Lists of beta_t, alpha_t and abar_t for t = 0..100."""
    beta = [0.0] + [1e-4 + (0.05 - 1e-4) * i / 99 for i in range(100)]
    alpha, abar = [1 - b for b in beta], []
    for a in alpha:
        abar.append(a * (abar[-1] if abar else 1.0))
    return beta, alpha, abar


def ddpm_step(x, t, noise, fresh):
    """x_{t-1} by the posterior mean from x_0's estimate, and its standard deviation times `fresh`."""
    beta, alpha, abar = schedule()
    x0 = (x - math.sqrt(1 - abar[t]) * noise) / math.sqrt(abar[t])
    before = abar[t - 1]
    mean = math.sqrt(before) * beta[t] / (1 - abar[t]) * x0 + math.sqrt(alpha[t]) * (1 - before) / (1 - abar[t]) * x
    return mean + math.sqrt(beta[t] * (1 - before) / (1 - abar[t])) * fresh


def ddim_step(x, t, s, noise):
    """x_s from x_t: x_0's estimate, diffused to s along the same noise."""
    _, _, abar = schedule()
    x0 = (x - math.sqrt(1 - abar[t]) * noise) / math.sqrt(abar[t])
    return math.sqrt(abar[s]) * x0 + math.sqrt(1 - abar[s]) * noise


def gated(layer, x, context):
    """(W x + b) sigmoid(Wg c + bg) + Wb c."""
    gate = torch.sigmoid(layer.gate.weight @ context + layer.gate.bias)
    return (layer.linear.weight @ x + layer.linear.bias) * gate + layer.shift.weight @ context


def denoiser(network, x, t, context):
    """Predicted noise [T, 2] of one path at time t; nothing is dropped, every step is there."""
    beta = schedule()[0][t]
    conditions = torch.cat([x.new_tensor([beta, math.sin(beta), math.cos(beta)]), context])
    width, rows = network.positions.shape[1], []
    for step, velocity in enumerate(x):
        angle = [step / 10000 ** (2 * (i // 2) / width) for i in range(width)]
        position = [math.cos(a) if i % 2 else math.sin(a) for i, a in enumerate(angle)]
        rows.append(gated(network.into, velocity, conditions) + x.new_tensor(position))
    h = torch.stack(rows)
    everyone = torch.ones(len(h), dtype=torch.bool)
    for layer in network.transformer.layers:
        h = normed(layer.norm1, h + attend(layer.self_attn, h, h, h, everyone))
        h = normed(layer.norm2, h + layer.linear2(torch.relu(layer.linear1(h))))
    for layer in network.out:
        h = torch.stack([gated(layer, row, conditions) for row in h])
    return h
