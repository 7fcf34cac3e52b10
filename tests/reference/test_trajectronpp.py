"""Trajectron++ against plain loops, torch's distributions, and numbers worked out by hand."""

import math

import network_twins as twins
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from network_twins import without_dropout
from torch.distributions import Categorical, MixtureSameFamily, MultivariateNormal

from modlhmp.networks import trajectronpp
from modlhmp.networks.trajectronpp import (
    Encoder,
    Network,
    annealed,
    backward_difference,
    clipped,
    draw,
    edge_ramp,
    integrate,
    kinematics,
    mixture_log_density,
    mutual_information,
)

ANNEALED = 10_000  # an iteration by which all is annealed: beta = 100, logits within 5


def network(seed=0, modes=5, decoder=12, step_s=1.0, **options):
    torch.manual_seed(seed)
    return Network(twins.STEPS, twins.OBSERVED, step_s, decoder=decoder, modes=modes, **options).double()


def tensor(values):
    return torch.tensor(values, dtype=torch.float64)


# --- the whole ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("iteration", [0, 350, ANNEALED])
@pytest.mark.parametrize("step_s", [1.0, 0.4])
def test_loss_and_gradients_equal_those_of_loops(iteration, step_s):
    net, scenes = without_dropout(network(1, modes=3, decoder=6, step_s=step_s)), twins.walking(1, n=5, steps=6)
    for layer in (net.posterior, net.prior[-1]):
        layer.weight.data *= 20  # far above the least KL that counts
    net.iteration.fill_(iteration)
    beta = 100 / (1 + math.exp(-(iteration - 400) / 100))
    bound = 0.05 + 4.95 / (1 + math.exp(-(iteration - 300) / 60))
    steps = int(scenes.lengths().max())
    assert steps == 6
    torch.manual_seed(2)
    normals = torch.stack([torch.randn(5 * 3, 2, dtype=torch.float64) for _ in range(steps)]).view(steps, 5, 3, 2)
    expected = twins.trajectron_loss(net, scenes, beta, bound, normals)
    wanted = torch.autograd.grad(expected, list(net.parameters()), allow_unused=True)
    torch.manual_seed(2)
    got = net.loss(scenes)
    gradients = torch.autograd.grad(got, list(net.parameters()), allow_unused=True)
    torch.testing.assert_close(got, expected)
    for (name, weights), one, other in zip(net.named_parameters(), gradients, wanted, strict=True):
        zero = torch.zeros_like(weights)
        torch.testing.assert_close(zero if one is None else one, zero if other is None else other, msg=name)
    assert int(net.iteration) == iteration + 1


@pytest.mark.parametrize("step_s", [1.0, 0.4])
def test_forecast_is_the_likeliest_row_of_all_latent_values_decoded(step_s):
    net, scenes = network(3, modes=7, step_s=step_s).eval(), twins.walking(3)
    torch.nn.init.orthogonal_(net.prior[0].weight)
    net.prior[0].bias.data = -net.prior[0](net.encoder(scenes.past, scenes.past_present)[0]).mean(0).detach()
    net.prior[-1].bias.data.zero_()
    got = net.forecast(scenes.past, scenes.past_present, torch.zeros(6, 1, dtype=torch.int64))
    context, now = net.encoder(scenes.past, scenes.past_present)
    everyone, _, _ = net.decode(context, now, torch.arange(7), net.steps, sample=False)
    logits = net.prior(context)
    torch.testing.assert_close(got[:, 0], step_s * everyone[torch.arange(6), logits.argmax(1)].cumsum(1))
    assert len(set(logits.argmax(1).tolist())) > 1
    for i in range(6):
        context, now = twins.encode(net.encoder, scenes.past[i], scenes.past_present[i], step_s)
        z = int(net.prior(context).argmax())
        path = twins.decode(net, context, now, z, lambda t, mean, *_: mean if t + 1 < net.steps else None)
        torch.testing.assert_close(got[i, 0], step_s * torch.stack([mean for mean, _, _ in path]).cumsum(0))


# --- encoder ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step_s", [1.0, 0.4])
def test_encoding_equals_loops_over_persons(step_s):
    torch.manual_seed(4)
    encoder, scenes = Encoder(8, step_s).double().eval(), twins.walking(4, n=12, others=4)
    context, now = encoder(scenes.past, scenes.past_present)
    for i in range(12):
        expected, state = twins.encode(encoder, scenes.past[i], scenes.past_present[i], step_s)
        torch.testing.assert_close(context[i], expected)  # the twin has no attention: over one type it is the identity
        torch.testing.assert_close(now[i], state)
    assert (context[::4, :8] == 0).all()  # of the lonely
    assert (context[1, :8] != 0).any()


def test_derivatives_of_a_worked_example():
    xy = tensor([0.0, 1, 3, 6])[:, None] * tensor([1.0, -2.0])
    states = kinematics(xy, torch.ones(4, dtype=torch.bool), 1.0)
    torch.testing.assert_close(states[:, 2], tensor([1.0, 1, 2, 3]))
    torch.testing.assert_close(states[:, 4], tensor([0.0, 0, 1, 1]))
    torch.testing.assert_close(states[:, 5], tensor([0.0, 0, -2, -2]))
    halved = kinematics(xy, torch.ones(4, dtype=torch.bool), 0.5)
    torch.testing.assert_close(halved[:, 2:], torch.cat([2 * states[:, 2:4], 4 * states[:, 4:]], 1))


@given(st.lists(st.tuples(st.floats(-50, 50), st.booleans()), min_size=1, max_size=8))
def test_derivatives_equal_a_loop_whoever_is_absent(rows):
    values, present = tensor([[v, -v] for v, _ in rows]), [there for _, there in rows]
    got = backward_difference(values, torch.tensor(present), 0.4)
    torch.testing.assert_close(got, torch.stack(twins.derivative(list(values), present, 0.4)))


def test_velocity_of_integrated_velocity_is_that():
    velocity = torch.randn(3, 9, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(5))
    xy = torch.cat([torch.zeros(3, 1, 2), 0.4 * velocity], 1).cumsum(1)
    got = backward_difference(xy, torch.ones(3, 10, dtype=torch.bool), 0.4)
    torch.testing.assert_close(got[:, 1:], velocity)


def test_edges_come_slowly_and_go_at_once():
    assert edge_ramp(torch.tensor([False, True, True, True, False])).tolist() == [0, 0.25, 0.75, 1.0, 0]
    assert edge_ramp(torch.tensor([True, True])).tolist() == [0.25, 0.75]


@given(st.lists(st.booleans(), min_size=1, max_size=9))
def test_edge_strength_equals_a_loop(adjacent):
    assert edge_ramp(torch.tensor(adjacent)).tolist() == twins.edge_strength(adjacent)


@pytest.mark.parametrize(("distance", "counts"), [(2.999, True), (3.0, True), (3.001, False)])
def test_neighbours_within_three_metres_at_t0_count(distance, counts):
    encoder = Encoder(4, 1.0).double().eval()
    past = torch.zeros(1, 2, 4, 2, dtype=torch.float64)
    past[0, 1, :, 0] = tensor([5.0, 5.0, 5.0, distance])
    context, _ = encoder(past, torch.ones(1, 2, 4, dtype=torch.bool))
    assert bool((context[:, :4] != 0).any()) == counts
    away = past.clone()
    away[0, 1, 0] += 1.0  # an earlier step, out of range: seen if the person is near at t0
    changed, _ = encoder(away, torch.ones(1, 2, 4, dtype=torch.bool))
    assert bool((changed != context).any()) == counts


def test_one_new_neighbour_weighs_a_quarter_and_four_one():
    encoder = Encoder(4, 1.0).double().eval()
    present = torch.ones(1, 2, 4, dtype=torch.bool)
    past = torch.zeros(1, 2, 4, 2, dtype=torch.float64)  # all at one place, so that the sums are 0 whoever is there
    always = encoder(past, present)[0][0, :4]
    for since, weight in ((3, 0.25), (2, 0.75), (1, 1.0)):
        present[0, 1] = torch.arange(4) >= since
        torch.testing.assert_close(encoder(past, present)[0][0, :4], weight * always)
    present[0, 1] = torch.arange(4) == 3
    for others, weight in ((2, 0.5), (4, 1.0), (6, 1.0)):
        crowd = [part[:, [0] + [1] * others] for part in (past, present)]
        torch.testing.assert_close(encoder(*crowd)[0][0, :4], weight * always)


def test_a_quarter_of_the_history_and_of_the_edges_twice_is_dropped():
    torch.manual_seed(6)
    encoder = Encoder(32, 1.0).double().train()
    past = torch.randn(1, 2, 4, 2, dtype=torch.float64).mul(0.5).expand(800, 2, 4, 2)
    context, _ = encoder(past - past[:, :1, -1:], torch.ones(800, 2, 4, dtype=torch.bool))
    edge, history = ((part == 0).float().mean().item() for part in context.chunk(2, 1))
    assert history == pytest.approx(0.25, abs=0.011)  # 4 standard errors of 25,600 values
    assert edge == pytest.approx(1 - 0.75**2, abs=0.0125)
    whole = encoder.eval()(past[:1] - past[:1, :1, -1:], torch.ones(1, 2, 4, dtype=torch.bool))[0]
    kept = torch.where(context != 0, context / whole, torch.nan).nanmean(0)
    torch.testing.assert_close(kept, tensor([1 / 0.75**2] * 32 + [1 / 0.75] * 32))


def test_true_path_is_encoded_up_to_its_own_end():
    net, scenes = network(7).eval(), twins.walking(7)
    truth, mask = scenes.future[:, 0], scenes.future_present[:, 0]
    now = torch.randn(6, 6, dtype=torch.float64)
    got = net.encode_future(truth, mask, now)
    for i, length in enumerate(scenes.lengths().tolist()):
        torch.testing.assert_close(got[i], twins.encode_future(net, truth[i, :length], now[i]))
    torch.testing.assert_close(net.encode_future(torch.where(mask[..., None], truth, 1e6), mask, now), got)


# --- mixture ------------------------------------------------------------------------------------------------


def mixture(weights, means, sigmas, correlations, xy):
    """Log density of velocities at `xy` [2] in one step of 1 s."""
    mean, moments = integrate(tensor(means)[:, None], tensor(sigmas).log()[:, None], tensor(correlations)[:, None], 1.0)
    density = mixture_log_density(tensor(xy)[None, None], mean, moments)
    return torch.logsumexp(tensor(weights).log() + density[:, 0], 0).item()


@pytest.mark.parametrize(("xy", "expected"), [([0.5, 1.0], -4.65952), ([1.0, 2.0], -0.84674)])
def test_density_of_a_worked_mixture(xy, expected):
    got = mixture([0.3, 0.7], [[0.0, 0], [1, 2]], [[0.5, 0.4], [1, 0.3]], [0.2, -0.5], xy)
    assert got == pytest.approx(expected, abs=1e-5)


def test_density_is_that_of_torchs_mixture():
    g = torch.Generator().manual_seed(8)
    mean, log_sigma = torch.randn(2, 4, 9, 2, dtype=torch.float64, generator=g)
    rho = torch.rand(4, 9, dtype=torch.float64, generator=g) * 1.9 - 0.95
    xy, weights = 3 * torch.randn(9, 2, dtype=torch.float64, generator=g), torch.softmax(mean[:, 0, 0], 0)
    means, moments = integrate(mean, log_sigma, rho, 0.4)
    got = torch.logsumexp(weights.log()[:, None] + mixture_log_density(xy, means, moments), 0)
    of_steps = [
        [twins.covariance(*step) for step in zip(*path, strict=True)] for path in zip(log_sigma, rho, strict=True)
    ]
    spread = 0.16 * torch.stack([torch.stack(path) for path in of_steps]).cumsum(1)
    parts = MultivariateNormal((0.4 * mean.cumsum(1)).transpose(0, 1), spread.transpose(0, 1))
    torch.testing.assert_close(got, MixtureSameFamily(Categorical(weights.expand(9, 4)), parts).log_prob(xy))


def test_constant_velocity_is_integrated():
    sigma = tensor([0.5, 0.5]).log().expand(3, 2)
    means, moments = integrate(tensor([[1.0, 2.0]] * 3), sigma, tensor([0.2] * 3), 1.0)
    torch.testing.assert_close(means, tensor([[1.0, 2], [2, 4], [3, 6]]))
    torch.testing.assert_close(moments[-1], 3 * tensor([0.25, 0.25, 0.05]))


def test_integrated_gaussians_are_those_of_summed_samples():
    torch.manual_seed(9)
    mean, log_sigma = tensor([[1.0, -0.5], [0.8, 0.1], [1.2, 0.0]]), tensor([[0.5, 0.2], [0.1, 0.4], [0.3, 0.3]]).log()
    rho, step_s = tensor([0.3, -0.8, 0.6]), 0.4
    steps = [draw(*(part[t].expand(100_000, *part[t].shape) for part in (mean, log_sigma, rho))) for t in range(3)]
    xy = step_s * torch.stack(steps).cumsum(0)
    means, moments = integrate(mean, log_sigma, rho, step_s)
    for t in range(3):
        torch.testing.assert_close(xy[t].mean(0), means[t], rtol=0.02, atol=0.002)
        (xx, xy_), (_, yy) = torch.cov(xy[t].T)
        torch.testing.assert_close(torch.stack([xx, yy]), moments[t, :2], rtol=0.02, atol=0)
        limit = 0.02 * torch.sqrt(xx * yy).item()
        assert xy_.item() == pytest.approx(moments[t, 2].item(), abs=limit)


@pytest.mark.parametrize("log_sigma", [-30.0, 0.0, 12.0])
@pytest.mark.parametrize("raw", [-20.0, 0.0, 20.0])  # tanh is +-1 to the last bit
def test_extreme_gaussians_have_finite_densities_and_gradients(log_sigma, raw):
    inputs = [torch.zeros(1, 3, 2), torch.full((1, 3, 2), log_sigma), torch.full((1, 3), raw)]
    for part in inputs:
        part.requires_grad_()
    mean, sigma, rho = inputs[0], inputs[1], torch.tanh(inputs[2])
    torch.manual_seed(10)
    sampled = draw(mean, sigma, rho)
    density = mixture_log_density(torch.tensor([[0.0, 0], [1, 2], [60, -60]]), *integrate(mean, sigma, rho, 1.0))
    assert density.isfinite().all()
    assert sampled.isfinite().all()
    (density.sum() + sampled.sum()).backward()
    assert all(part.grad.isfinite().all() for part in inputs)


# --- latent values ------------------------------------------------------------------------------------------


def test_information_of_a_worked_example():
    assert mutual_information(tensor([[0.7, 0.2, 0.1], [0.1, 0.8, 0.1]])).item() == pytest.approx(0.22292, abs=1e-5)
    assert mutual_information(tensor([[0.7, 0.2, 0.1]] * 4)).item() == pytest.approx(0.0, abs=1e-12)
    assert mutual_information(torch.eye(25, dtype=torch.float64)).item() == pytest.approx(3.2189, abs=1e-4)  # ln 25


@given(st.integers(0, 1000), st.sampled_from([0.1, 1.0, 10.0, 1000.0]))
def test_information_is_between_nothing_and_the_log_of_the_number(seed, spread):
    p = torch.softmax(
        spread * torch.randn(7, 25, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)), 1
    )
    assert -1e-12 <= mutual_information(p).item() <= math.log(7) + 1e-12


def test_least_divergence_that_counts():
    net, scenes = without_dropout(network(11)), twins.walking(11)
    for layer in (net.posterior, net.prior[-1]):  # q = p
        torch.nn.init.zeros_(layer.weight)
        torch.nn.init.zeros_(layer.bias)

    def loss(iteration):
        net.iteration.fill_(iteration)
        torch.manual_seed(12)
        return net.loss(scenes).item()

    assert loss(800) - loss(400) == pytest.approx(0.07 * (98.2014 - 50.0), abs=1e-5)
    assert loss(ANNEALED) - loss(0) == pytest.approx(0.07 * (100 - 1.7986), abs=1e-5)


def test_annealing():
    assert [round(annealed(i, 4000)[0], 4) for i in (0, 400, 800)] == [1.7986, 50.0, 98.2014]
    assert [round(annealed(i, 4000)[1], 5) for i in (0, 300, 600)] == [0.08313, 2.525, 4.96687]
    assert annealed(40, 200) == annealed(400, 2000) == annealed(400, 0)  # shorter trainings anneal as much faster
    assert annealed(1999, 2000)[0] < 100


def test_logits_are_clipped_around_their_mean():
    torch.testing.assert_close(clipped(tensor([[11.0, 8, 14, 7]]), 2.0), tensor([[1.0, -2, 2, -2]]))


def test_logits_are_clipped_in_training_only():
    net, scenes = without_dropout(network(13, modes=4)), twins.walking(13)
    torch.nn.init.zeros_(net.prior[-1].weight)
    net.prior[-1].bias.data = tensor([1.0, 2.0, 4.0, 3.0])  # the second and the third are both clipped to 0.083

    def loss(bias):
        net.prior[-1].bias.data[2] = bias
        net.iteration.zero_()
        torch.manual_seed(14)
        return net.loss(scenes).item()

    assert loss(4.0) == loss(4.5)
    net.eval()
    assert loss(4.0) != loss(4.5)
    assert int(net.iteration) == 0  # an iteration is one of training
    net.prior[-1].bias.data[2] = 4.0
    likeliest = net.forecast(scenes.past, scenes.past_present, torch.zeros(6, 1, dtype=torch.int64))
    context, now = net.encoder(scenes.past, scenes.past_present)
    third, _, _ = net.decode(context, now, torch.tensor([2]), net.steps, sample=False)
    torch.testing.assert_close(likeliest, third.cumsum(2))


def test_loss_is_finite_where_latent_values_are_out_of_the_question():
    net, scenes = network(13, modes=4).float().eval(), twins.walking(13, dtype=torch.float32)
    for layer in (net.prior[-1], net.posterior):
        layer.bias.data = torch.tensor([0.0, 300, 100, -200])  # a softmax of exactly 0
    assert net.loss(scenes).isfinite()


def test_likelihood_of_a_step_is_capped(monkeypatch):
    net, scenes = without_dropout(network(15)), twins.walking(15, steps=4, whole=True)
    monkeypatch.setattr(trajectronpp, "mixture_log_density", lambda xy, mean, moments: mean[..., 0] * 0 + 50.0)
    monkeypatch.setattr(trajectronpp, "annealed", lambda iteration, planned: (0.0, 5.0))
    monkeypatch.setattr(trajectronpp, "mutual_information", lambda p: 0.0)
    assert net.loss(scenes).item() == pytest.approx(-4 * 6.0)


# --- decoder ------------------------------------------------------------------------------------------------


def test_split_input_equals_torchs_cell_on_the_whole_input():
    net = network(16)
    g = torch.Generator().manual_seed(16)
    context, now = (torch.randn(4, size, dtype=torch.float64, generator=g) for size in (64, 6))
    mean, log_sigma, rho = net.decode(context, now, torch.arange(5), 6, sample=False)
    assert mean.shape == log_sigma.shape == (4, 5, 6, 2)
    assert rho.shape == (4, 5, 6)
    for i in range(4):
        for z in range(5):
            path = twins.decode(net, context[i], now[i], z, lambda t, mean, *_: mean if t < 5 else None)
            for got, expected in zip((mean, log_sigma, rho), zip(*path, strict=True), strict=True):
                torch.testing.assert_close(got[i, z], torch.stack(expected), rtol=0, atol=1e-9)


def test_heads_read_weight_mean_sigma_and_correlation():
    net = network(17)
    torch.nn.init.zeros_(net.heads.weight)
    net.heads.bias.data = tensor([9.0, 1.0, 2.0, -1.0, -2.0, 0.5])
    mean, log_sigma, rho = net.decode(
        torch.zeros(1, 64).double(), torch.zeros(1, 6).double(), torch.arange(2), 3, False
    )
    assert (mean == tensor([1.0, 2.0])).all()
    assert (log_sigma == tensor([-1.0, -2.0])).all()
    torch.testing.assert_close(rho, torch.full((1, 2, 3), math.tanh(0.5), dtype=torch.float64))


def test_samples_have_the_gaussians_covariance():
    torch.manual_seed(18)
    n = 100_000
    sample = draw(*(part.expand(n, *part.shape) for part in (tensor([1.0, 2]), tensor([2.0, 0.5]).log(), tensor(-0.6))))
    np.testing.assert_allclose(sample.mean(0), [1.0, 2.0], atol=0.03)
    np.testing.assert_allclose(torch.cov(sample.T), [[4.0, -0.6], [-0.6, 0.25]], rtol=0.02)


# --- optimisation -------------------------------------------------------------------------------------------


def test_rate_falls_by_a_ten_thousandth_an_iteration():
    net = network(19)
    net.planned_iterations = 4000
    rates = [net.decay(i / 4000) for i in range(3)]
    np.testing.assert_allclose(rates, [1.0, 0.9999, 0.9999**2])


def test_gradients_are_clipped_by_value():
    net = network(20)
    for weights in net.parameters():
        weights.grad = torch.full_like(weights, -7.0)
    net.heads.bias.grad[0] = 0.3
    net.clip()
    assert (net.cell.weight_hh.grad == -1.0).all()
    assert net.heads.bias.grad[0] == 0.3
