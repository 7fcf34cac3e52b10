"""MID: its schedule and samplers against the formulas and exact noise predictors, its denoiser against loops."""

import math

import network_twins as twins
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from network_twins import without_dropout
from scipy import stats

from modlhmp.networks import mid
from modlhmp.networks.mid import SCHEDULE, TIMES, Network, ddim, ddpm, diffused, noise_of, sinusoids
from modlhmp.streams import stream_keys, uniforms


def network(seed=0, context=8, steps=twins.STEPS, step_s=1.0):
    torch.manual_seed(seed)
    return Network(steps, twins.OBSERVED, step_s, context=context).double()


def normal(*shape, seed=0):
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


def abar(t):
    """Of times [n], beside values [n, T, 2]."""
    return SCHEDULE.abar[t][:, None, None]


def oracle(x0):
    """The noise in x_t, known exactly."""
    return lambda x, t: (x - torch.sqrt(abar(t)) * x0) / torch.sqrt(1 - abar(t))


# --- schedule -----------------------------------------------------------------------------------------------


def test_schedule():
    beta, alpha, product = twins.schedule()
    for got, expected in zip((SCHEDULE.beta, SCHEDULE.alpha, SCHEDULE.abar), (beta, alpha, product), strict=True):
        assert got.dtype == torch.float64
        np.testing.assert_allclose(got, expected, rtol=1e-12)
    at = [1, 10, 20, 40, 50, 60, 80, 100]
    published = [0.99990, 0.97656, 0.90656, 0.67044, 0.53381, 0.40361, 0.19738, 0.07823]
    np.testing.assert_allclose(SCHEDULE.abar[at], published, atol=5.1e-6)
    assert (SCHEDULE.abar.diff()[1:] < 0).all()
    assert SCHEDULE.beta[0] == 0
    assert SCHEDULE.abar[0] == 1


def test_posterior_deviations():
    got = [SCHEDULE.posterior_sd(t).item() for t in (1, 2, 50, 100)]
    np.testing.assert_allclose(got, [0.0, 0.00926, 0.15516, 0.22311], atol=5.1e-6)


# --- forward ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("t", [1, 20, 60, 100])
def test_diffused_nothing_has_the_noises_share_of_variance(t):
    n = 20_000
    x = diffused(torch.zeros(n, 1, 1, dtype=torch.float64), torch.full((n,), t), normal(n, 1, 1, seed=t))
    expected = 1 - SCHEDULE.abar[t].item()
    assert x.var().item() == pytest.approx(expected, abs=3 * expected * math.sqrt(2 / n))


@pytest.mark.parametrize("t", [1, 20, 60, 100])
def test_diffused_noise_keeps_its_variance(t):
    n = 20_000
    x = diffused(normal(n, 1, 1, seed=2), torch.full((n,), t), normal(n, 1, 1, seed=3 + t))
    assert x.var().item() == pytest.approx(1.0, abs=3 * math.sqrt(2 / n))


@given(st.integers(1, TIMES), st.integers(0, 1000))
def test_diffused_is_the_closed_form(t, seed):
    x0, noise = normal(3, 5, 2, seed=seed), normal(3, 5, 2, seed=seed + 1)
    product = twins.schedule()[2][t]
    expected = math.sqrt(product) * x0 + math.sqrt(1 - product) * noise
    torch.testing.assert_close(diffused(x0, torch.full((3,), t), noise), expected)


def test_single_steps_compose_to_the_closed_form():
    n, x = 20_000, torch.full((20_000,), 1.5, dtype=torch.float64)
    for t in range(1, 61):
        x = torch.sqrt(SCHEDULE.alpha[t]) * x + torch.sqrt(SCHEDULE.beta[t]) * normal(n, seed=t)
    closed = diffused(torch.full((n, 1, 1), 1.5).double(), torch.full((n,), 60), normal(n, 1, 1, seed=99))
    assert x.mean().item() == pytest.approx(1.5 * math.sqrt(0.40361), abs=4 * math.sqrt(0.6 / n))
    assert closed.mean().item() == pytest.approx(x.mean().item(), abs=5 * math.sqrt(0.6 / n))
    assert x.var().item() == pytest.approx(1 - 0.40361, rel=4 * math.sqrt(2 / n))
    assert closed.var().item() == pytest.approx(x.var().item(), rel=6 * math.sqrt(2 / n))


# --- samplers -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stride", [1, 7, 20, 30, 50, 100])
def test_known_noise_gives_back_the_path_whatever_the_stride(stride):
    x0 = normal(4, 6, 2, seed=4)
    torch.testing.assert_close(ddim(oracle(x0), normal(4, 6, 2, seed=5), stride), x0, rtol=0, atol=1e-10)
    single = ddim(lambda x, t: oracle(x0)(x.double(), t).float(), normal(4, 6, 2, seed=5).float(), stride)
    torch.testing.assert_close(single.double(), x0, rtol=0, atol=1e-5)


def test_last_ancestral_step_gives_back_the_path():
    x0 = normal(4, 6, 2, seed=6)
    got = ddpm(oracle(x0), normal(4, 6, 2, seed=7), torch.Generator().manual_seed(8))
    torch.testing.assert_close(got, x0, rtol=0, atol=1e-12)


def test_five_steps_and_the_last_leads_to_the_path():
    times = []

    def zero(x, t):
        assert (t == t[0]).all()
        times.append(int(t[0]))
        return torch.zeros_like(x)

    start = normal(3, 2, 2, seed=9)
    got = ddim(zero, start)
    assert times == [100, 80, 60, 40, 20]
    torch.testing.assert_close(got, start / math.sqrt(twins.schedule()[2][100]))  # without noise only the scale is left
    times.clear()
    ddpm(zero, start)
    assert times == list(range(100, 0, -1))


def wavy(x, t):
    """Some function of the path and the time."""
    return torch.sin(3 * x) + t.double()[:, None, None] / TIMES


@pytest.mark.parametrize("stride", [1, 20, 50])
def test_deterministic_sampling_equals_its_steps(stride):
    x = start = normal(3, 5, 2, seed=10)
    for t in range(TIMES, 0, -stride):
        x = twins.ddim_step(x, t, t - stride, wavy(x, torch.full((3,), t)))
    torch.testing.assert_close(ddim(wavy, start, stride), x, rtol=1e-9, atol=1e-9)


def test_ancestral_sampling_equals_its_steps():
    x = start = normal(3, 5, 2, seed=11)
    fresh = torch.Generator().manual_seed(12)
    for t in range(TIMES, 0, -1):
        drawn = torch.randn(x.shape, generator=fresh, dtype=x.dtype) if t > 1 else torch.zeros_like(x)
        x = twins.ddpm_step(x, t, wavy(x, torch.full((3,), t)), drawn)
    torch.testing.assert_close(ddpm(wavy, start, torch.Generator().manual_seed(12)), x, rtol=1e-8, atol=1e-8)


def test_best_noise_predictor_of_a_gaussian_samples_it():
    m, s, n = 0.5, 0.3, 20_000

    def best(x, t):
        return torch.sqrt(1 - abar(t)) * (x - torch.sqrt(abar(t)) * m) / (abar(t) * s**2 + 1 - abar(t))

    # Each ancestral step is linear in x, so mean and variance of what it yields are known.
    mean, variance = 0.0, 1.0
    for t in range(TIMES, 0, -1):
        at_0, at_1 = (twins.ddpm_step(x, t, best(x, torch.tensor([t])), 0.0).item() for x in torch.tensor([0.0, 1.0]))
        mean = at_0 + (at_1 - at_0) * mean
        variance = (at_1 - at_0) ** 2 * variance + SCHEDULE.posterior_sd(t).item() ** 2
    assert mean == pytest.approx(m, abs=0.03)
    assert math.sqrt(variance) == pytest.approx(s, rel=0.06)
    ancestral = ddpm(best, normal(n, 1, 1, seed=13), torch.Generator().manual_seed(14))
    assert ancestral.mean().item() == pytest.approx(mean, abs=4 * s / math.sqrt(n))
    assert ancestral.std().item() == pytest.approx(math.sqrt(variance), rel=4 / math.sqrt(2 * n))
    # Without fresh noise x_T is mapped to x_0 quantile by quantile, so that N(0, 1) instead of N(0.28 m, ..) shows.
    deterministic, last = ddim(best, normal(n, 1, 1, seed=15), 1), SCHEDULE.abar[TIMES].item()
    slope = s / math.sqrt(last * s**2 + 1 - last)
    assert deterministic.mean().item() == pytest.approx(m - slope * math.sqrt(last) * m, abs=0.01)
    assert deterministic.std().item() == pytest.approx(slope, rel=0.03)
    for got in (ancestral, deterministic):
        assert stats.kstest(((got - got.mean()) / got.std()).ravel().numpy(), "norm").pvalue > 0.01


# --- noise of the keys --------------------------------------------------------------------------------------


def test_noise_is_standard_normal():
    noise = noise_of(stream_keys(np.arange(1000), 5, 0, "hall", "mid", "day1").ravel(), 12)
    assert noise.shape == (5000, 12, 2)
    assert stats.kstest(noise.ravel(), "norm").pvalue > 0.01
    for step, axis in ((0, 0), (0, 1), (7, 0), (11, 1)):
        assert stats.kstest(noise[:, step, axis], "norm").pvalue > 0.01
    correlation = np.corrcoef(noise.reshape(5000, 24).T) - np.eye(24)
    assert np.abs(correlation).max() < 4.5 / math.sqrt(5000)
    samples = noise.reshape(1000, 5, 24)
    assert abs(np.corrcoef(samples[:, 0].ravel(), samples[:, 1].ravel())[0, 1]) < 4 / math.sqrt(24_000)


def test_noise_is_made_of_the_keys_uniform_numbers():
    keys = stream_keys(np.arange(9), 2, 0, "hall").ravel()
    expected = uniforms(keys, 0, 2 * 12).reshape(18, 12, 2)
    np.testing.assert_allclose(stats.norm.cdf(noise_of(keys, 12)), expected, atol=1e-12)


def test_noise_is_that_of_the_track_whoever_else_is_there():
    keys = stream_keys(np.arange(20), 3, 0, "hall")
    whole = noise_of(keys.ravel(), 12).reshape(20, 3, 12, 2)
    np.testing.assert_array_equal(noise_of(keys[7], 12), whole[7])
    np.testing.assert_array_equal(noise_of(keys[::-1, 1], 12), whole[::-1, 1])
    np.testing.assert_array_equal(noise_of(keys[:, 0], 5), whole[:, 0, :5])
    np.testing.assert_array_equal(noise_of(keys.view(np.int64)[3], 12), whole[3])  # keys as a tensor holds them


# --- denoiser -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("t", [1, 37, 100])
def test_noise_predicted_equals_that_of_loops(t):
    net = network(15).eval()
    x, context = normal(3, twins.STEPS, 2, seed=16), normal(3, 8, seed=17)
    got = net.noise(x, torch.full((3,), t), context)
    for i in range(3):
        torch.testing.assert_close(got[i], twins.denoiser(net, x[i], t, context[i]), rtol=1e-5, atol=1e-6)


def test_positions_are_told_apart_by_sines():
    table = sinusoids(60, 8)
    assert table.shape == (60, 8)
    np.testing.assert_allclose(table[0], [0, 1] * 4)
    np.testing.assert_allclose(table[5, :4], [math.sin(5), math.cos(5), math.sin(0.5), math.cos(0.5)], atol=1e-6)
    np.testing.assert_allclose(table[59, 6:], [math.sin(0.059), math.cos(0.059)], atol=1e-6)


def test_absent_steps_do_not_reach_the_others():
    net = network(18).eval()
    x, context, t = normal(4, twins.STEPS, 2, seed=19), normal(4, 8, seed=20), torch.tensor([3, 30, 60, 100])
    present = torch.arange(twins.STEPS) < torch.tensor([[1], [5], [11], [12]])
    got = net.noise(x, t, context, present)
    other = net.noise(torch.where(present[..., None], x, 1e3), t, context, present)
    assert torch.equal(got[present], other[present])
    for i, length in enumerate(present.sum(1).tolist()):
        alone = net.noise(x[i : i + 1, :length], t[i : i + 1], context[i : i + 1])
        torch.testing.assert_close(got[i, :length], alone[0])


def test_loss_is_the_mean_squared_error_of_the_noise_of_the_steps_that_are_there():
    net, scenes = without_dropout(network(21, step_s=0.4)), twins.walking(21)
    torch.manual_seed(22)
    got = net.loss(scenes)
    steps = int(scenes.lengths().max())
    torch.manual_seed(22)
    t, noise = torch.randint(1, TIMES + 1, (6,)), torch.randn(6, steps, 2, dtype=torch.float64)
    errors = []
    for i, length in enumerate(scenes.lengths().tolist()):
        context, _ = twins.encode(net.encoder, scenes.past[i], scenes.past_present[i], 0.4)
        path = torch.cat([torch.zeros(1, 2), scenes.future[i, 0, :length]])
        velocity = torch.stack([(path[k + 1] - path[k]) / 0.4 for k in range(length)])
        product = twins.schedule()[2][int(t[i])]
        x = math.sqrt(product) * velocity + math.sqrt(1 - product) * noise[i, :length]
        errors.append(((twins.denoiser(net, x, int(t[i]), context) - noise[i, :length]) ** 2).mean(1))
    torch.testing.assert_close(got, torch.cat(errors).mean(), rtol=1e-5, atol=1e-6)


def test_velocities_add_up_to_the_path(monkeypatch):
    net, scenes, seen = network(23, step_s=0.4), twins.walking(23), []
    monkeypatch.setattr(mid, "diffused", lambda x0, t, noise: seen.append(x0) or diffused(x0, t, noise))
    net.loss(scenes)
    steps = seen[0].shape[1]
    path = torch.where(scenes.future_present[:, 0, :steps, None], 0.4 * seen[0].cumsum(1), 0.0)
    torch.testing.assert_close(path, scenes.future[:, 0, :steps])
    assert (seen[0][~scenes.future_present[:, 0, :steps]] == 0).all()


def test_all_diffusion_times_are_trained(monkeypatch):
    net, scenes, times = network(24), twins.walking(24, n=64), []
    monkeypatch.setattr(mid, "diffused", lambda x0, t, noise: times.append(t) or diffused(x0, t, noise))
    torch.manual_seed(25)
    with torch.no_grad():
        for _ in range(40):
            net.loss(scenes)
    counts = torch.bincount(torch.cat(times), minlength=TIMES + 1)
    assert counts[0] == 0
    assert len(counts) == TIMES + 1
    assert stats.chisquare(counts[1:].numpy()).pvalue > 0.01


# --- forecast -----------------------------------------------------------------------------------------------


def test_forecast_denoises_each_keys_noise(monkeypatch):
    net, scenes = network(26, step_s=0.4).eval(), twins.walking(26)
    keys = stream_keys(np.arange(6), 2, 0, "hall")
    with torch.no_grad():
        got = net.forecast(scenes.past, scenes.past_present, torch.from_numpy(keys.view(np.int64)))
        assert got.shape == (6, 2, twins.STEPS, 2)
        for i in range(2):
            context, _ = twins.encode(net.encoder, scenes.past[i], scenes.past_present[i], 0.4)
            for k in range(2):
                x = torch.from_numpy(noise_of(keys[i, k : k + 1], twins.STEPS))[0]
                for t in (100, 80, 60, 40, 20):
                    x = twins.ddim_step(x, t, t - 20, twins.denoiser(net, x, t, context))
                torch.testing.assert_close(got[i, k], 0.4 * x.cumsum(0), rtol=1e-5, atol=1e-5)
        monkeypatch.setattr(mid, "CHUNK", 5)
        parts = net.forecast(scenes.past, scenes.past_present, torch.from_numpy(keys.view(np.int64)))
    torch.testing.assert_close(parts, got)
    assert (got[:, 0] - got[:, 1]).abs().amax((1, 2)).min() > 1e-3


def test_several_futures_whose_errors_are_averaged():
    assert Network.output == "mean"
    net, scenes = network(27).eval(), twins.walking(27)
    with torch.no_grad():
        one, other = net.validation_error(scenes), net.validation_error(scenes)
    assert torch.equal(one, other)
    assert one.isfinite().all()
