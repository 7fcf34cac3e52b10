"""Trajectron++ for pedestrians without a map: a CVAE with a discrete latent whose decoder yields velocity mixtures.

T. Salzmann, B. Ivanovic, P. Chakravarty, M. Pavone, Trajectron++, ECCV 2020. Departures: derivatives look backward
only (the published code's looked ahead); an absent neighbour adds nothing (there, minus the walker's own state); edges
ramp up within the observed steps; the log-likelihood counts the steps that are there; short trainings anneal faster.
"""

import math

import torch
from torch import Tensor, nn

from modlhmp.networks.data import Scenes
from modlhmp.networks.network import Base, trimmed, truth_of

RADIUS_M = 3.0  # of attention, also the scale of positions
STATE_SCALE = (RADIUS_M, RADIUS_M, 2.0, 2.0, 1.0, 1.0)  # position [m], velocity [m/s], acceleration [m/s^2]
EDGE_RAMP = (0.25, 0.5, 0.75, 1.0)  # a new edge comes in over four steps, a lost one goes at once
UNITS, FUTURE_UNITS = 32, 32
LOG_LIKELIHOOD_CAP, KL_FLOOR = 6.0, 0.07
KL_WEIGHT, KL_CENTRE, KL_WIDTH = 100.0, 400.0, 100.0
LOGIT_CLIP, CLIP_CENTRE, CLIP_WIDTH = (0.05, 5.0), 300.0, 60.0
UNCLIPPED = 40.0  # bound of the logits outside training, where e^-80 is still a float32
FULL_ANNEALING = 2000  # shorter trainings anneal as much faster
GRADIENT_CLIP = 1.0
DECAY_AN_ITERATION = 0.9999


class Encoder(nn.Module):
    """A walker's own history and the sum of the neighbours' as two LSTMs; [n, 2 * units]. Also MID's."""

    def __init__(self, units, step_s):
        super().__init__()
        self.step_s = step_s
        self.history = nn.LSTM(6, units, batch_first=True)
        self.edge = nn.LSTM(12, units, batch_first=True)
        # Additive attention over the types of edges. There is one type, so its weight is 1 and its layers, kept for the
        # architecture's sake, receive no gradient.
        self.of_edge = nn.Linear(units, units, bias=False)
        self.of_history = nn.Linear(units, units, bias=False)
        self.score = nn.Linear(units, 1, bias=False)
        self.drop = nn.Dropout(0.25)

    def forward(self, past: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Context [n, 2 * units] (edge, history) and the standardised present state [n, 6]."""
        scale = past.new_tensor(STATE_SCALE)
        states = kinematics(past, present, self.step_s)
        own = states[:, 0] / scale
        relative = (states[:, 1:] - states[:, :1, -1:]) / scale
        distance = torch.linalg.vector_norm(past[:, 1:] - past[:, :1], dim=-1)
        ramp = edge_ramp(present[:, 1:] & (distance <= RADIUS_M))[..., -1]
        seen = present[:, 1:, :, None] & (ramp > 0.01)[..., None, None]
        others = torch.where(seen, relative, 0.0).sum(1)
        history = self.drop(self.history(own)[0][:, -1])
        edge = self.drop(self.edge(torch.cat([others, own], -1))[0][:, -1]) * ramp.sum(1, keepdim=True).clamp(max=1.0)
        edges = edge[:, None]
        score = self.score(torch.tanh(self.of_edge(edges) + self.of_history(history)[:, None]))
        mixed = self.drop((torch.softmax(score, 1) * edges).sum(1))
        return torch.cat([mixed, history], -1), own[:, -1]


class Network(Base):
    """127,654 parameters with `decoder` = 128 and 25 `modes`."""

    turns = 24
    iteration: Tensor

    def __init__(self, steps, observed_rows, step_s, decoder=128, modes=25):
        super().__init__(steps, observed_rows, step_s)
        self.modes = modes
        self.encoder = Encoder(UNITS, step_s)
        self.future = nn.LSTM(2, FUTURE_UNITS, bidirectional=True, batch_first=True)
        self.future_h, self.future_c = nn.Linear(6, FUTURE_UNITS), nn.Linear(6, FUTURE_UNITS)
        self.prior = nn.Sequential(nn.Linear(2 * UNITS, 32), nn.ReLU(), nn.Dropout(0.1), nn.Linear(32, modes))
        self.posterior = nn.Linear(2 * UNITS + 4 * FUTURE_UNITS, modes)
        self.first_state = nn.Linear(modes + 2 * UNITS, decoder)
        self.first_velocity = nn.Linear(6, 2)
        self.cell = nn.GRUCell(modes + 2 * UNITS + 2, decoder)
        self.heads = nn.Linear(decoder, 6)
        self.drop = nn.Dropout(0.25)
        self.register_buffer("iteration", torch.zeros((), dtype=torch.int64))

    def loss(self, scenes: Scenes) -> Tensor:
        """-(log-likelihood summed over steps - beta max(0.07, KL) + mutual information), a mean over the batch."""
        steps = trimmed(scenes)
        truth, mask = truth_of(scenes, steps)
        context, now = self.encoder(scenes.past, scenes.past_present)
        beta, clip = annealed(int(self.iteration), self.planned_iterations)
        clip = clip if self.training else UNCLIPPED
        prior = torch.softmax(clipped(self.prior(context), clip), -1)
        ahead = self.encode_future(truth, mask, now)
        posterior = torch.softmax(clipped(self.posterior(torch.cat([context, ahead], -1)), clip), -1)
        velocity = self.decode(context, now, torch.arange(self.modes, device=context.device), steps, sample=True)
        log_density = mixture_log_density(truth[:, None], *integrate(*velocity, self.step_s))
        log_likelihood = torch.logsumexp(torch.log(posterior)[..., None] + log_density, 1).clamp(max=LOG_LIKELIHOOD_CAP)
        log_likelihood = torch.where(mask, log_likelihood, 0.0).sum(1).mean()
        kl = (posterior * (torch.log(posterior) - torch.log(prior))).sum(-1).mean()
        self.iteration += int(self.training)
        return -(log_likelihood - beta * kl.clamp(min=KL_FLOOR) + mutual_information(prior))

    def encode_future(self, truth: Tensor, mask: Tensor, now: Tensor) -> Tensor:
        """Both directions' last states of the true path, [n, 4 * FUTURE_UNITS]; padded steps are left out."""
        zeros = torch.zeros_like(self.future_h(now))
        first = tuple(torch.stack([layer(now), zeros]) for layer in (self.future_h, self.future_c))
        packed = nn.utils.rnn.pack_padded_sequence(truth, mask.sum(1).cpu(), batch_first=True, enforce_sorted=False)
        last = self.future(packed, first)[1]
        return self.drop(torch.cat([part for state in last for part in state], -1))

    def decode(
        self, context: Tensor, now: Tensor, z: Tensor, steps: int, sample: bool
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Velocity Gaussians of latent values: mean [n, Z, T, 2], log sigma [n, Z, T, 2], correlation [n, Z, T].

        `z` is [Z], the same for all, or [n, 1]. Fed back is a reparameterised sample, or the mean. The GRU's input is
        (z, context, velocity), of which only the velocity changes, so the others' products are made once.
        """
        n, modes, cell = len(context), self.modes, self.cell

        def product(weight, bias):
            of_z, of_context = weight[:, :modes].T[z], context @ weight[:, modes : modes + context.shape[1]].T
            return (of_z + of_context[:, None] + bias).flatten(0, 1)

        hidden = product(self.first_state.weight, self.first_state.bias)
        constant = product(cell.weight_ih, cell.bias_ih)
        of_velocity = cell.weight_ih[:, -2:].T
        velocity = self.first_velocity(now).repeat_interleave(len(hidden) // n, 0)
        outputs = []
        for _ in range(steps):
            hidden = gru_step(constant + velocity @ of_velocity, hidden, cell)
            _, mean, log_sigma, correlation = self.heads(hidden).split([1, 2, 2, 1], -1)
            correlation = torch.tanh(correlation[..., 0])
            outputs.append((mean, log_sigma, correlation))
            velocity = draw(mean, log_sigma, correlation) if sample else mean
        mean, log_sigma, correlation = (
            torch.stack(part, 1).unflatten(0, (n, -1)) for part in zip(*outputs, strict=True)
        )
        return mean, log_sigma, correlation

    def forecast(self, past: Tensor, present: Tensor, keys: Tensor, where: Tensor | None = None) -> Tensor:
        """The most likely latent value's path of mean velocities (the originals' z mode and mixture mode)."""
        context, now = self.encoder(past, present)
        best = self.prior(context).argmax(-1, keepdim=True)
        mean, _, _ = self.decode(context, now, best, self.steps, sample=False)
        return self.step_s * mean.cumsum(2)

    def decay(self, done: float) -> float:
        """0.9999 per iteration."""
        return DECAY_AN_ITERATION ** (done * self.planned_iterations)

    def clip(self) -> None:
        """By value."""
        nn.utils.clip_grad_value_(self.parameters(), GRADIENT_CLIP)


def backward_difference(values: Tensor, present: Tensor, step_s: float) -> Tensor:
    """Derivative [.., T, D] along time from this and the step before; the first present one copies the second's."""
    before = nn.functional.pad(present, (1, 0))[..., :-1]
    known = (present & before)[..., None]
    rate = torch.where(known, values - nn.functional.pad(values, (0, 0, 1, 0))[..., :-1, :], 0.0) / step_s
    after = nn.functional.pad(rate, (0, 0, 0, 1))[..., 1:, :]
    return torch.where(known, rate, torch.where(present[..., None], after, 0.0))


def kinematics(xy: Tensor, present: Tensor, step_s: float) -> Tensor:
    """Position, velocity and acceleration, [.., T, 6]."""
    velocity = backward_difference(xy, present, step_s)
    return torch.cat([xy, velocity, backward_difference(velocity, present, step_s)], -1)


def edge_ramp(adjacent: Tensor) -> Tensor:
    """Strength of edges [.., T] from adjacency [.., T] (bool): rises along `EDGE_RAMP`, falls at once."""
    edges = adjacent.float()
    lagged = [nn.functional.pad(edges, (lag, 0))[..., : edges.shape[-1]] for lag in range(len(EDGE_RAMP))]
    strength = sum((weight * edge for weight, edge in zip(EDGE_RAMP, lagged, strict=True)), torch.zeros_like(edges))
    return strength.clamp(max=1.0) * edges


def annealed(iteration: int, planned: int) -> tuple[float, float]:
    """Weight of the KL term and bound of the logits at an iteration of `planned`."""
    at = iteration * (FULL_ANNEALING / planned if 0 < planned < FULL_ANNEALING else 1.0)
    low, high = LOGIT_CLIP
    beta = KL_WEIGHT / (1 + math.exp(-(at - KL_CENTRE) / KL_WIDTH))
    return beta, low + (high - low) / (1 + math.exp(-(at - CLIP_CENTRE) / CLIP_WIDTH))


def clipped(logits: Tensor, bound: float) -> Tensor:
    """Logits around 0 within `bound`: a training aid only."""
    return (logits - logits.mean(-1, keepdim=True)).clamp(-bound, bound)


def mutual_information(p: Tensor) -> Tensor:
    """H(mean of p) - mean of H(p) of categorical distributions [n, K]."""

    def entropy(q):
        return -torch.special.xlogy(q, q).sum(-1)

    return entropy(p.mean(0)) - entropy(p).mean()


def gru_step(from_input: Tensor, hidden: Tensor, cell: nn.GRUCell) -> Tensor:
    """A GRUCell's step whose input products, bias included, are given."""
    reset, update, new = from_input.chunk(3, -1)
    h_reset, h_update, h_new = nn.functional.linear(hidden, cell.weight_hh, cell.bias_hh).chunk(3, -1)
    update = torch.sigmoid(update + h_update)
    new = torch.tanh(new + torch.sigmoid(reset + h_reset) * h_new)
    return torch.lerp(new, hidden, update)


def draw(mean: Tensor, log_sigma: Tensor, correlation: Tensor) -> Tensor:
    """A reparameterised sample of bivariate normals."""
    a, b = torch.randn_like(mean).unbind(-1)
    along = correlation * a + torch.sqrt((1 - correlation**2).clamp(min=1e-5)) * b
    return mean + torch.exp(log_sigma) * torch.stack([a, along], -1)


def integrate(mean: Tensor, log_sigma: Tensor, correlation: Tensor, step_s: float) -> tuple[Tensor, Tensor]:
    """Position Gaussians of velocity ones: means [.., T, 2], variances (xx, yy, xy) [.., T, 3], summed over time."""
    return step_s * mean.cumsum(-2), step_s**2 * moments_of(log_sigma, correlation).cumsum(-2)


def moments_of(log_sigma: Tensor, correlation: Tensor) -> Tensor:
    """Variances (xx, yy, xy) [.., 3] of bivariate normals."""
    sigma = torch.exp(log_sigma)
    covariance = correlation * sigma.prod(-1)
    return torch.cat([(sigma**2).clamp(min=1e-8), covariance[..., None]], -1)


def mixture_log_density(xy: Tensor, mean: Tensor, moments: Tensor) -> Tensor:
    """Log density [.., T] of positions [.., T, 2] under each Gaussian."""
    dx, dy = (xy - mean).unbind(-1)
    xx, yy, xy_ = moments.unbind(-1)
    rest = (1 - xy_**2 / (xx * yy)).clamp(1e-5, 1.0)
    exponent = (dx**2 / xx + dy**2 / yy - 2 * xy_ * dx * dy / (xx * yy)) / rest
    return -0.5 * (exponent + torch.log(xx) + torch.log(yy) + torch.log(rest)) - math.log(2 * math.pi)
