"""LSTM and Social LSTM: values worked out by hand, PyTorch's own distributions, and grids filled cell by cell."""

import math

import numpy as np
import pytest
import torch
from network_twins import people
from torch.distributions import MultivariateNormal

from modlhmp.networks import lstm, social_lstm
from modlhmp.networks.data import Scenes
from modlhmp.networks.social_lstm import CELLS, LATENT, Crowd, grid_cell, pool

STEPS = 12
KEYS = torch.zeros(1, 1, dtype=torch.int64)
KINDS = pytest.mark.parametrize("module", [lstm, social_lstm])


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)
    torch.manual_seed(0)


def scenes_of(n=6, others=3, steps=STEPS, seed=0, dtype=torch.float32):
    """Random walkers and neighbours, some of them absent for a while; lengths of truth 1 to `steps`."""
    rng = np.random.default_rng(seed)
    paths = rng.normal(0, 1.5, (n, 1 + others, 1, 2)) + rng.normal(0, 0.6, (n, 1 + others, 4 + steps, 2)).cumsum(2)
    paths -= paths[:, :1, 3:4]
    until = 4 + rng.integers(0, steps + 1, (n, 1 + others, 1))
    until[:, 0] = 4 + np.linspace(1, steps, n).round().astype(int)[:, None]
    since = rng.integers(0, 6, (n, 1 + others, 1))
    since[:, 0] = 0
    present = (np.arange(4 + steps) < until) & (np.arange(4 + steps) >= since)
    paths[~present] = 0.0
    xy, present = torch.tensor(paths, dtype=dtype), torch.tensor(present)
    return Scenes(xy[:, :, :4], present[:, :, :4], xy[:, :, 4:], present[:, :, 4:], torch.zeros(n, 3))


def forecast(network, scenes):
    """Paths [n, steps, 2]."""
    with torch.no_grad():
        return network.eval().forecast(scenes.past, scenes.past_present, KEYS.expand(len(scenes.past), 1))[:, 0]


def constant_head(network, bias):
    """The network with a head that says `bias` whatever it sees."""
    with torch.no_grad():
        network.head.weight.zero_()
        network.head.bias.copy_(torch.tensor(bias))
    return network


# --- size ---------------------------------------------------------------------------------------------------


def test_parameter_counts():
    assert lstm.Network(60, 4, 1.0).parameter_count() == 199_487
    assert social_lstm.Network(60, 4, 1.0).parameter_count() == 529_487
    assert lstm.Network(20, 4, 1.0).parameter_count() == 199_487  # of any horizon


# --- loss ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("displacement", "loss"),
    [((0.0, 0.0), -2.40751), ((0.1, 0.1), -1.79635), ((1.0, 0.0), 4.31657), ((50.0, 0.0), 4.60517)],
)
def test_loss_of_known_displacements(displacement, loss):
    network = constant_head(lstm.Network(1, 4, 1.0), [0.0] * 5)
    mean, sigma, correlation = network.gaussian(torch.zeros(1, 128))
    assert torch.allclose(sigma, torch.tensor(0.11))
    assert torch.allclose(correlation, torch.tensor(0.35))
    got = lstm.robust_nll(torch.tensor([displacement]), mean, sigma, correlation)
    assert got.item() == pytest.approx(loss, abs=1e-4)
    scenes = Scenes(
        torch.zeros(1, 1, 4, 2), torch.ones(1, 1, 4) > 0, torch.tensor(displacement).view(1, 1, 1, 2),
        torch.ones(1, 1, 1) > 0, torch.zeros(1, 3),
    )  # fmt: skip
    assert network.loss(scenes).item() == pytest.approx(loss, abs=1e-4)


def test_loss_is_the_mixture_of_pytorchs_gaussians():
    rng = np.random.default_rng(1)
    displacement, mean = torch.tensor(rng.normal(0, 1, (2, 50, 2)))
    sigma, rho = torch.tensor(rng.uniform(0.05, 0.6, (50, 2))), torch.tensor(rng.uniform(-0.9, 0.9, 50))
    off = rho * sigma.prod(-1)
    covariance = torch.stack([sigma[:, 0] ** 2, off, off, sigma[:, 1] ** 2], -1).view(-1, 2, 2)
    narrow = MultivariateNormal(mean, covariance).log_prob(displacement).exp()
    assert torch.allclose(lstm.bivariate_density(displacement - mean, sigma, rho), narrow, rtol=1e-9)
    for scale in (1.0, 2.5):
        wide = MultivariateNormal(mean, torch.eye(2, dtype=torch.float64) * (3.0 * scale) ** 2)
        expected = -torch.log(0.01 + 0.2 * wide.log_prob(displacement).exp() + 0.79 * narrow)
        got = lstm.robust_nll(displacement, mean, sigma, rho, scale)
        assert torch.allclose(got, expected, rtol=1e-9)


def test_standard_deviations_and_correlation_keep_to_their_ranges():
    for scale in (1.0, 2.5):
        network = lstm.Network(1, 4, 1.0, sigma_scale=scale)
        hidden = 50 * torch.randn(200, 128)
        _, sigma, correlation = network.gaussian(hidden)
        assert sigma.min() >= 0.01 * scale - 1e-6
        assert sigma.max() <= 0.21 * scale + 1e-6
        assert correlation.min() >= 0
        assert correlation.max() <= 0.7


@KINDS
def test_loss_is_a_mean_over_steps_each_scored_as_if_its_track_ended_with_its_truth(module):
    scenes, network = scenes_of(), module.Network(STEPS, 4, 1.0, hidden=16)
    lengths = scenes.lengths().tolist()
    assert min(lengths) < max(lengths) == STEPS
    total = 0.0
    for n, length in enumerate(lengths):
        alone = scenes.take(slice(n, n + 1))
        cut = alone._replace(future=alone.future[:, :, :length], future_present=alone.future_present[:, :, :length])
        short = module.Network(length, 4, 1.0, hidden=16)
        short.load_state_dict(network.state_dict())
        total += length * short.loss(cut).item()
    assert network.loss(scenes).item() == pytest.approx(total / sum(lengths), rel=1e-5)


@KINDS
@pytest.mark.parametrize("filler", [1e6, math.nan])
def test_padding_is_inert(module, filler):
    scenes, network = scenes_of(), module.Network(STEPS, 4, 1.0, hidden=16)
    network.loss(scenes).backward()
    gradients = [p.grad.clone() for p in network.parameters()]
    padded = scenes._replace(
        past=torch.where(scenes.past_present[..., None], scenes.past, filler),
        future=torch.where(scenes.future_present[..., None], scenes.future, filler),
    )
    network.zero_grad()
    loss = network.loss(padded)
    loss.backward()
    assert torch.equal(loss, network.loss(scenes))
    for p, before in zip(network.parameters(), gradients, strict=True):
        assert torch.equal(p.grad, before)
    assert torch.equal(forecast(network, padded), forecast(network, scenes))


@KINDS
def test_gradient_reaches_the_truth_only_where_there_is_any(module):
    scenes, network = scenes_of(), module.Network(STEPS, 4, 1.0, hidden=16)
    future = scenes.future.clone().requires_grad_()
    network.loss(scenes._replace(future=future)).backward()
    own, present = future.grad[:, 0], scenes.future_present[:, 0]
    assert (own[~present] == 0).all()
    assert (own[present] != 0).any(-1).all()


# --- roll-out -----------------------------------------------------------------------------------------------


@KINDS
def test_a_constant_head_walks_on_by_its_bias(module):
    network = constant_head(module.Network(STEPS, 4, 1.0, hidden=16), [0.5, -0.25, 0.3, -0.2, 0.1])
    path = torch.arange(1, STEPS + 1)[:, None] * torch.tensor([0.5, -0.25])
    assert torch.equal(forecast(network, scenes_of()), path.expand(6, STEPS, 2))
    constant_head(network, [0.0] * 5)
    assert (forecast(network, scenes_of()) == 0).all()


@KINDS
def test_what_is_fed_back_carries_no_gradient(module):
    scenes, network = scenes_of(), module.Network(STEPS, 4, 1.0, hidden=16)
    inputs = (scenes.past, scenes.past_present) if module is social_lstm else (scenes.past[:, 0],)
    mean = network.roll_out(*inputs, STEPS)[0]
    for step in range(STEPS):
        gradient = torch.autograd.grad(mean[:, step].sum(), network.head.bias, retain_graph=True)[0]
        assert gradient.tolist() == [6, 6, 0, 0, 0]  # its own bias, and not that of the steps before
    recurrent = torch.autograd.grad(mean[:, -1].sum(), network.encoder.weight_hh)[0]
    assert (recurrent != 0).any()  # through the states it does reach back


@KINDS
def test_gradient_reaches_every_observed_position(module):
    scenes, network = scenes_of(), module.Network(STEPS, 4, 1.0, hidden=16)
    past = scenes.past.clone().requires_grad_()
    network.forecast(past, scenes.past_present, KEYS.expand(6, 1)).sum().backward()
    assert (past.grad[:, 0] != 0).any(-1).all()


@KINDS
def test_a_shorter_horizon_is_a_prefix(module):
    network, short = (module.Network(steps, 4, 1.0, hidden=16) for steps in (STEPS, 5))
    short.load_state_dict(network.state_dict())
    assert torch.equal(forecast(short, scenes_of()), forecast(network, scenes_of())[:, :5])


def plain_means(network, scenes, n, steps, taught=False):
    """Means of one predicted person's displacements, every person's cell advanced by hand, one at a time.

    Where `taught`, neighbours walk as they did and are gone once absent; else all present at t0 walk as predicted.
    """
    w = {name: value.detach() for name, value in network.state_dict().items()}
    here, people = scenes.past_present[n], [m for m in range(len(scenes.past[n])) if scenes.past_present[n, m, -1]]
    h, c = ({m: w["head.weight"].new_zeros(network.encoder.hidden_size) for m in people} for _ in range(2))
    at = {}

    def advance(cell, moved):
        latent = {m: w["latent.weight"] @ h[m] + w["latent.bias"] for m in moved if "grid.weight" in w}
        for m in moved:
            inputs = [torch.relu(4.0 * moved[m] @ w["embed.weight"].T + w["embed.bias"]), h[m].new_zeros(2)]
            if latent:
                order = [m, *(other for other in moved if other != m)]
                grid = fine_pool([latent[k] for k in order], [at[k] for k in order])[0]
                inputs.append(torch.relu(w["grid.weight"] @ grid + w["grid.bias"]))
            gates = w[f"{cell}.weight_ih"] @ torch.cat(inputs) + w[f"{cell}.bias_ih"]
            i, f, g, o = (gates + w[f"{cell}.weight_hh"] @ h[m] + w[f"{cell}.bias_hh"]).chunk(4)
            c[m] = torch.sigmoid(f) * c[m] + torch.sigmoid(i) * torch.tanh(g)
            ahead[m] = torch.sigmoid(o) * torch.tanh(c[m])
        h.update(ahead)

    for t in range(1, 4):
        ahead, at = {}, {m: scenes.past[n, m, t] for m in people}
        advance("encoder", {m: at[m] - scenes.past[n, m, t - 1] for m in people if here[m, t] and here[m, t - 1]})
    means = []
    for k in range(steps):
        moved = {m: (w["head.weight"] @ h[m] + w["head.bias"])[:2] for m in people}
        means.append(moved[0])
        if taught:
            people = [m for m in people if m == 0 or scenes.future_present[n, m, k]]
            moved = {m: scenes.future[n, m, k] - at[m] if m else moved[m] for m in people}
        ahead, at = {}, {m: at[m] + moved[m] for m in people}
        advance("decoder", moved)
    return torch.stack(means)


@KINDS
def test_roll_out_equals_cells_advanced_by_hand(module):
    network, scenes = module.Network(STEPS, 4, 1.0, hidden=16).double(), scenes_of(seed=3, dtype=torch.float64)
    if module is social_lstm:
        taught = loud(network).roll_out(*scenes[:2], STEPS, *scenes[2:4])[0].detach()
        assert not torch.allclose(taught, network.roll_out(*scenes[:2], STEPS)[0], atol=1e-3)
        for n in range(6):
            assert torch.allclose(taught[n], plain_means(network, scenes, n, STEPS, taught=True), atol=1e-9)
    for n, path in enumerate(forecast(network, scenes)):
        assert torch.allclose(path, plain_means(network, scenes, n, STEPS).cumsum(0), atol=1e-9)


# --- pooling ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("offset", "cell"),
    [((1.0, -0.5), 9), ((-4.0, 3.9), 3), ((4.0, 0.0), None), ((-4.01, 0.0), None), ((0.0, 0.0), 10),
     ((-1.0, 0.5), 6), ((0.0, 4.0), None), ((0.0, -4.01), None), ((3.99, 3.99), 15), ((-4.0, -4.0), 0)],
)  # fmt: skip
def test_grid_cells_by_hand(offset, cell):
    outside = CELLS**2
    assert grid_cell(torch.tensor([offset])).item() == (outside if cell is None else cell)


def pooled(paths, here, latent):
    """Grid [people, cells, LATENT] of one scene's people at t0."""
    crowd = Crowd(torch.tensor(paths)[None, :, None], torch.ones(1, len(paths), 1) > 0)
    grid = pool(latent, torch.tensor(paths), torch.tensor(here), crowd)
    return grid.view(len(paths), LATENT, CELLS**2).transpose(1, 2)


def test_states_in_one_cell_add_up():
    latent = torch.randn(4, LATENT)
    grid = pooled([(0.0, 0.0), (1.0, -0.5), (1.5, -1.5), (-4.0, 3.9)], [True] * 4, latent)
    assert torch.allclose(grid[0, 9], latent[1] + latent[2])
    assert torch.equal(grid[0, 3], latent[3])
    assert torch.allclose(grid[0].sum(0), latent[1:].sum(0), atol=1e-6)
    assert torch.equal(grid[1, 6], latent[0])  # the same pair seen from the other side


def test_self_absent_and_distant_people_are_not_pooled():
    latent = torch.randn(3, LATENT)
    assert (pooled([(0.0, 0.0)], [True], latent[:1]) == 0).all()
    grid = pooled([(0.0, 0.0), (1.0, 1.0), (1.5, 1.0)], [True, False, True], latent)
    assert torch.equal(grid[0].sum(0), latent[2])
    assert (grid[1] == 0).all()  # the absent one pools nobody either
    assert torch.equal(grid[2].sum(0), latent[0])
    assert (pooled([(0.0, 0.0), (9.0, 0.0)], [True, True], latent[:2]) == 0).all()


def fine_pool(latent, position, cells=32, side_m=8.0, window=8):
    """A grid of `cells` x `cells` around each person, filled one neighbour at a time, then summed by windows."""
    people = []
    for i, ego in enumerate(position):
        fine = latent[0].new_zeros(len(latent[0]), cells, cells)
        for j, other in enumerate(position):
            a, b = (math.floor((other[axis] - ego[axis]) * cells / side_m + cells / 2) for axis in (0, 1))
            if i != j and 0 <= a < cells and 0 <= b < cells:
                fine[:, a, b] += latent[j]
        windows = fine.unfold(1, window, window).unfold(2, window, window).sum((-1, -2))
        people.append(windows.flatten())
    return torch.stack(people)


@pytest.mark.parametrize("seed", range(3))
def test_pooling_equals_a_fine_grid_summed_by_windows(seed):
    rng = np.random.default_rng(seed)
    sizes = [1, 5, 2, 6]
    present = torch.arange(6) < torch.tensor(sizes)[:, None]
    paths = torch.tensor(rng.uniform(-5, 5, (4, 6, 1, 2)), dtype=torch.float32)
    crowd = Crowd(paths, present[..., None])
    position, latent = crowd.take(paths)[:, 0], torch.randn(sum(sizes), LATENT)
    got = pool(latent, position, torch.ones(sum(sizes)) > 0, crowd)
    expected = [
        fine_pool(part, at) for part, at in zip(latent.split(sizes), position.split(sizes), strict=True)
    ]  # no one is pooled across scenes
    assert torch.allclose(got, torch.cat(expected), atol=1e-5)


# --- Social LSTM --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cut", ["grid", "columns"])
def test_without_its_grid_a_social_lstm_is_an_lstm(cut):
    social, plain, scenes = social_lstm.Network(STEPS, 4, 1.0), lstm.Network(STEPS, 4, 1.0), scenes_of()
    weights = social.state_dict()
    with torch.no_grad():
        if cut == "grid":
            social.grid.weight.zero_()
            social.grid.bias.zero_()
        else:
            for cell in (social.encoder, social.decoder):
                cell.weight_ih[:, 64:] = 0.0
    plain.load_state_dict({name: value[:, :64] if name.endswith("weight_ih") else value
                           for name, value in weights.items() if not name.startswith(("grid", "latent"))})  # fmt: skip
    assert torch.allclose(forecast(social, scenes), forecast(plain, scenes), atol=1e-6)
    assert social.loss(scenes).item() == pytest.approx(plain.loss(scenes).item(), abs=1e-5)


def loud(network):
    """The network with a grid that matters."""
    with torch.no_grad():
        network.grid.weight.mul_(20)
        network.latent.weight.mul_(5)
    return network


def test_neighbours_in_any_order_and_absent_ones_make_no_difference():
    network, scenes = loud(social_lstm.Network(STEPS, 4, 1.0)), scenes_of(others=4)
    paths = forecast(network, scenes)
    order = [0, 3, 1, 4, 2]
    assert torch.allclose(forecast(network, people(scenes, order)), paths, atol=1e-5)
    more = Scenes(*(torch.cat([part, torch.zeros_like(part[:, :2])], 1) for part in scenes[:4]), scenes.where)
    assert torch.equal(forecast(network, more), paths)
    alone = people(scenes, [0])
    assert not torch.allclose(forecast(network, alone), paths, atol=1e-3)
    assert network.loss(scenes).item() == pytest.approx(network.loss(more).item(), abs=1e-6)


def test_who_left_before_t0_makes_no_difference():
    network, scenes = loud(social_lstm.Network(STEPS, 4, 1.0)), scenes_of()
    gone = scenes.past_present.clone()
    gone[:, 1:, -1] = False
    alone = people(scenes, [0])
    assert torch.allclose(forecast(network, scenes._replace(past_present=gone)), forecast(network, alone), atol=1e-6)


def test_a_distant_neighbour_makes_no_difference_but_a_near_one_does():
    network, scenes = loud(social_lstm.Network(STEPS, 4, 1.0)), scenes_of(others=1)
    alone = people(scenes, [0])
    present = torch.ones_like(scenes.past_present)

    def beside(metres):
        past = torch.stack([scenes.past[:, 0], scenes.past[:, 0] + torch.tensor([metres, 0.0])], 1)
        return forecast(network, scenes._replace(past=past, past_present=present))

    assert torch.allclose(beside(400.0)[:, :3], forecast(network, alone)[:, :3], atol=1e-6)
    assert not torch.allclose(beside(1.0)[:, :3], forecast(network, alone)[:, :3], atol=1e-3)


def test_in_training_neighbours_walk_as_they_did_and_leave_when_they_did():
    """The predicted person's later steps depend on the neighbours' true ones, while they are there."""
    network, scenes = loud(social_lstm.Network(STEPS, 4, 1.0)), scenes_of(n=1, others=1)
    past = torch.stack([scenes.past[:, 0], scenes.past[:, 0] + 1.0], 1)
    future = scenes.past[:, :, -1:] + torch.tensor([[[[0.0, 0.0]], [[1.0, 1.0]]]]).expand(1, 2, STEPS, 2)
    here = torch.ones(1, 2, 4) > 0

    def means(future, stays):
        there = torch.ones(1, 2, STEPS) > 0
        there[:, 1, stays:] = False
        return network.roll_out(past, here, STEPS, future, there)[0].detach()

    away = future.clone()
    away[:, 1, 4:] += 50.0
    whole, gone, moved = means(future, STEPS), means(future, 4), means(away, STEPS)
    # Step n sees where the others were at n - 1: what happens from the 5th on shows from the 6th.
    assert torch.equal(whole[:, :5], gone[:, :5])
    assert torch.equal(whole[:, :5], moved[:, :5])
    assert not torch.allclose(whole[:, 5], gone[:, 5], atol=1e-4)
    assert torch.allclose(moved[:, 5], gone[:, 5], atol=1e-6)  # out of the grid or gone is the same
    assert torch.equal(means(away, 4), gone)


@KINDS
def test_standing_still_alone_is_finite(module):
    network = module.Network(STEPS, 4, 1.0)
    scenes = Scenes(
        torch.zeros(2, 3, 4, 2), torch.zeros(2, 3, 4) > 0, torch.zeros(2, 3, STEPS, 2), torch.zeros(2, 3, STEPS) > 0,
        torch.zeros(2, 3),
    )  # fmt: skip
    scenes.past_present[:, 0] = scenes.future_present[:, 0] = True
    network.loss(scenes).backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in network.parameters())
    assert forecast(network, scenes).isfinite().all()


# --- optimiser ----------------------------------------------------------------------------------------------


@KINDS
def test_original_optimisation(module):
    network = module.Network(STEPS, 4, 1.0)
    optimiser = network.optimiser(0.003)
    assert isinstance(optimiser, torch.optim.Adam)
    assert optimiser.defaults["lr"] == 0.003
    assert optimiser.defaults["weight_decay"] == 1e-4
    assert not isinstance(optimiser, torch.optim.AdamW)  # coupled
    rates = [network.decay(epoch / 25) for epoch in range(25)]
    np.testing.assert_allclose(rates, [1.0] * 10 + [0.1] * 10 + [0.01] * 5)
    assert network.turns == 0  # any angle
    assert network.output == "single"
