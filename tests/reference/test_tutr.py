"""TUTR against plain loops, and its motion modes against what k-means must do."""

import network_twins as twins
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from network_twins import without_dropout

from modlhmp.networks import tutr
from modlhmp.networks.tutr import Network, extended, mode_distance, motion_modes, own_frame

KEYS = torch.zeros(6, 1, dtype=torch.int64)


def network(seed=0, modes=5, width=8):
    torch.manual_seed(seed)
    net = Network(twins.STEPS, twins.OBSERVED, 1.0, width=width, modes=modes).double()
    net.modes.copy_(2 * torch.randn(modes, twins.STEPS, 2, dtype=torch.float64).cumsum(1))
    return net


def in_own_frames(scenes):
    frame = own_frame(scenes.past)
    return scenes.past @ frame[:, None], scenes.future[:, 0] @ frame


def parts_of_loss(net, scenes, monkeypatch):
    """The regression's and the scores' part of the loss, by leaving the other out."""
    with monkeypatch.context() as patch:
        patch.setattr(torch.nn.functional, "cross_entropy", lambda logits, soft: 0.0)
        regression = net.loss(scenes)
    with monkeypatch.context() as patch:
        patch.setattr(torch.nn.functional, "smooth_l1_loss", lambda path, future, reduction: torch.zeros_like(path))
        return regression, net.loss(scenes)


# --- frame --------------------------------------------------------------------------------------------------


@given(st.integers(0, 1000))
def test_frame_turns_the_first_position_onto_the_axis(seed):
    scenes = twins.walking(seed)
    frame = own_frame(scenes.past)
    turned = scenes.past @ frame[:, None]
    torch.testing.assert_close(turned[:, 0, 0, 1], torch.zeros(6, dtype=torch.float64), rtol=0, atol=1e-12)
    assert (turned[:, 0, 0, 0] >= 0).all()
    assert (turned[:, 0, -1] == 0).all()
    torch.testing.assert_close(turned @ frame[:, None].transpose(-1, -2), scenes.past)
    torch.testing.assert_close(torch.linalg.det(frame), torch.ones(6, dtype=torch.float64))  # no reflection
    lengths = torch.linalg.vector_norm(turned, dim=-1)
    torch.testing.assert_close(lengths, torch.linalg.vector_norm(scenes.past, dim=-1))


def test_who_stands_still_is_not_turned():
    frame = own_frame(torch.zeros(2, 3, 4, 2))
    assert (frame == torch.eye(2)).all()


# --- the whole ----------------------------------------------------------------------------------------------


def test_scores_and_paths_equal_those_of_loops():
    net, scenes = network(1).eval(), twins.walking(1)
    past, _ = in_own_frames(scenes)
    tokens, logits = net.tokens(past[:, 0])
    for i in range(6):
        expected_logits, paths = twins.tutr(net, past[i], scenes.past_present[i])
        torch.testing.assert_close(logits[i], expected_logits)
        for k, path in enumerate(paths):
            got = net.decode(tokens[i : i + 1, k], past[i : i + 1], scenes.past_present[i : i + 1])
            torch.testing.assert_close(got[0], path)


def test_forecast_is_the_path_of_the_highest_score():
    net, scenes = network(2).eval(), twins.walking(2)
    net.mode_token.weight.data[:, : 2 * twins.OBSERVED] *= 8  # the past decides
    past, _ = in_own_frames(scenes)
    frame = own_frame(scenes.past)
    got, chosen = net.forecast(scenes.past, scenes.past_present, KEYS), []
    for i in range(6):
        logits, paths = twins.tutr(net, past[i], scenes.past_present[i])
        chosen.append(int(logits.argmax()))
        torch.testing.assert_close(got[i, 0], paths[chosen[-1]] @ frame[i].T)
    assert len(set(chosen)) > 1


def test_loss_equals_that_of_loops(monkeypatch):
    net, scenes = network(3).eval(), twins.walking(3)
    past, future = in_own_frames(scenes)
    errors, entropies = [], []
    for i in range(6):
        logits, paths = twins.tutr(net, past[i], scenes.past_present[i])
        there = scenes.future_present[i, 0]
        distances = torch.tensor(twins.mode_distances(future[i], there, net.modes), dtype=torch.float64)
        path = paths[int(distances.argmin())]
        for t in range(int(there.sum())):
            away = (path[t] - future[i, t]).abs()
            errors.append(torch.where(away < 1, 0.5 * away**2, away - 0.5).mean())
        soft = torch.exp(-distances) / torch.exp(-distances).sum()
        entropies.append(-(soft * torch.log_softmax(logits, 0)).sum())
    regression, scores = parts_of_loss(net, scenes, monkeypatch)
    torch.testing.assert_close(regression, torch.stack(errors).mean())
    torch.testing.assert_close(scores, torch.stack(entropies).mean())
    torch.testing.assert_close(net.loss(scenes), regression + scores)


def test_training_scales_each_scene_by_a_factor_near_one():
    net, scenes = without_dropout(network(4)), twins.walking(4)
    torch.manual_seed(5)
    scale = 1 + 0.05 * torch.randn(6, 1, 1).double()
    scaled = scenes._replace(past=scenes.past * scale[..., None], future=scenes.future * scale[..., None])
    torch.manual_seed(5)
    got = net.loss(scenes)
    torch.testing.assert_close(got, net.eval().loss(scaled))
    assert abs(got.item() - net.loss(scenes).item()) > 1e-4


@pytest.mark.parametrize("layers", ["encoder", "decoder"])
def test_dropout_after_each_normalisation(layers):
    torch.manual_seed(5)
    net = Network(twins.STEPS, twins.OBSERVED, 1.0, width=64).train()
    block = net.encoder[0] if layers == "encoder" else net.decoder
    out = block(torch.randn(400, 1, 64), torch.randn(400, 3, 64))
    assert (out == 0).float().mean().item() == pytest.approx(0.1, abs=0.0075)  # 4 standard errors
    seen = []
    block.feed_forward.register_forward_hook(lambda layer, inputs, output: seen.append(inputs[0]))
    block(torch.randn(400, 1, 64), torch.randn(400, 3, 64))
    assert (seen[0] == 0).float().mean().item() == pytest.approx(0.1, abs=0.0075)


# --- scores -------------------------------------------------------------------------------------------------


def test_scores_are_best_when_they_are_the_negative_distances(monkeypatch):
    net, scenes = network(6).eval(), twins.walking(6)
    _, future = in_own_frames(scenes)
    distance = mode_distance(future, scenes.future_present[:, 0], net.modes)
    soft = torch.softmax(-distance, 1)
    torch.testing.assert_close(soft.sum(1), torch.ones(6, dtype=torch.float64))
    assert (soft.argmax(1) == distance.argmin(1)).all()
    entropy = -(soft * soft.log()).sum(1).mean()
    tokens, _ = net.tokens(in_own_frames(scenes)[0][:, 0])

    def scores(logits):
        with monkeypatch.context() as patch:
            patch.setattr(net, "tokens", lambda past: (tokens, logits))
            return parts_of_loss(net, scenes, patch)[1]

    torch.testing.assert_close(scores(7.0 - distance), entropy)
    for seed in range(5):
        other = 7.0 - distance + torch.randn(6, 5, generator=torch.Generator().manual_seed(seed))
        assert scores(other) > entropy


def test_order_of_the_modes_does_not_matter():
    net, scenes = network(7).eval(), twins.walking(7)
    past, _ = in_own_frames(scenes)
    logits, path = net.tokens(past[:, 0])[1], net.forecast(scenes.past, scenes.past_present, KEYS)
    loss = net.loss(scenes)
    order = torch.tensor([3, 0, 4, 2, 1])
    net.modes.copy_(net.modes[order].clone())
    torch.testing.assert_close(net.tokens(past[:, 0])[1], logits[:, order])
    torch.testing.assert_close(net.forecast(scenes.past, scenes.past_present, KEYS), path)
    torch.testing.assert_close(net.loss(scenes), loss)


def test_path_is_learned_through_the_closest_mode_only(monkeypatch):
    net, scenes = network(8).eval(), twins.walking(8)
    past, future = in_own_frames(scenes)
    tokens, logits = (part.detach() for part in net.tokens(past[:, 0]))
    tokens.requires_grad_()
    monkeypatch.setattr(net, "tokens", lambda past: (tokens, logits))
    monkeypatch.setattr(torch.nn.functional, "cross_entropy", lambda logits, soft: 0.0)
    net.loss(scenes).backward()
    reached = (tokens.grad != 0).any(-1)
    closest = mode_distance(future, scenes.future_present[:, 0], net.modes).argmin(1)
    assert (reached == (torch.arange(5) == closest[:, None])).all()


# --- neighbours ---------------------------------------------------------------------------------------------


def meeting(distance, present=(True,) * twins.OBSERVED):
    """One walker and one other, `distance` [m] away on the mean."""
    past = torch.zeros(1, 2, twins.OBSERVED, 2, dtype=torch.float64)
    past[0, 0, :, 0] = torch.tensor([3.0, 2, 1, 0])
    past[0, 1] = past[0, 0] + torch.tensor([[0.0, distance + away] for away in (-0.3, 0.3, -0.2, 0.2)])
    there = torch.tensor([[[True] * twins.OBSERVED, present]])
    return torch.where(there[..., None], past, 0.0), there


@pytest.mark.parametrize(
    ("other", "counts"),
    [
        (meeting(1.999), True),
        (meeting(2.001), False),
        (meeting(1.0, (False, True, True, True)), False),  # not seen all the time
        (meeting(1.0, (False,) * 4), False),
    ],
)
def test_neighbours_near_on_the_mean_count(other, counts):
    net = network(9).eval()
    alone = [part[:, :1] for part in other]
    got, expected = net.forecast(*other, KEYS[:1]), net.forecast(*alone, KEYS[:1])
    assert got.isfinite().all()
    assert bool((got - expected).abs().max() > 1e-9) == counts


def test_walker_sees_itself_even_if_nobody_is_there():
    net, scenes = network(10).eval(), twins.walking(10)
    nobody = scenes.past_present.clone()
    nobody[:, 1:] = False
    got = net.forecast(scenes.past, nobody, KEYS)
    torch.testing.assert_close(got, net.forecast(scenes.past[:, :1], scenes.past_present[:, :1], KEYS))


# --- motion modes -------------------------------------------------------------------------------------------


def futures(seed, n=40, steps=twins.STEPS, spread=1.0):
    """Random futures of many lengths; 0 where there is no truth."""
    g = torch.Generator().manual_seed(seed)
    pace = spread * torch.randn(n, 1, 2, dtype=torch.float64, generator=g)
    xy = (pace + 0.5 * torch.randn(n, steps, 2, dtype=torch.float64, generator=g)).cumsum(1)
    mask = torch.arange(steps) < torch.randint(1, steps + 1, (n, 1), generator=g)
    mask[0] = True
    return torch.where(mask[..., None], xy, 0.0), mask


def test_distance_equals_a_loop():
    future, mask = futures(11)
    modes, _ = futures(12, n=7)
    expected = [twins.mode_distances(path, there, modes) for path, there in zip(future, mask, strict=True)]
    got = mode_distance(torch.where(mask[..., None], future, 1e6), mask, modes)
    np.testing.assert_allclose(got, expected, rtol=1e-9)


def test_distance_sees_only_the_steps_that_are_there_scaled_to_all():
    future, mask = futures(13, n=1)
    mask = torch.arange(twins.STEPS)[None] < 7
    modes, _ = futures(14, n=5)
    short = mode_distance(future[:, :7], mask[:, :7], modes[:, :7])
    torch.testing.assert_close(mode_distance(future, mask, modes), short * (twins.STEPS / 7) ** 0.5)


def test_distance_of_a_long_future_to_itself_is_small_in_single_precision():
    sway = 0.3 * torch.randn(5, 60, 2, generator=torch.Generator().manual_seed(14)).cumsum(1)
    future = torch.arange(1.0, 61)[:, None] * torch.tensor([[1.3, 0.2]]) + sway
    there = torch.ones(5, 60, dtype=torch.bool)
    exact = mode_distance(future.double(), there, future.double())
    np.testing.assert_allclose(mode_distance(future, there, future), exact, atol=0.3)  # of paths 80 m long


def test_futures_go_on_as_they_went():
    paths = torch.tensor([[[1.0, 0], [2, 2], [9, 9], [9, 9]], [[0.5, 1], [9, 9], [9, 9], [9, 9]], [[1.0, 1]] * 4])
    mask = torch.arange(4) < torch.tensor([[2], [1], [4]])
    got = extended(paths, mask)
    assert got[0].tolist() == [[1, 0], [2, 2], [3, 3], [4, 4]]
    assert got[1].tolist() == [[0.5, 1], [1, 2], [1.5, 3], [2, 4]]
    assert got[2].tolist() == [[1, 1]] * 4


def test_bundles_far_apart_are_found():
    g = torch.Generator().manual_seed(15)
    steps = torch.arange(1.0, twins.STEPS + 1, dtype=torch.float64)[:, None]
    angles = torch.arange(6) * torch.pi / 3
    true = steps * torch.stack([angles.cos(), angles.sin()], -1)[:, None]
    future = true.repeat_interleave(15, 0) + 0.05 * torch.randn(90, twins.STEPS, 2, dtype=torch.float64, generator=g)
    mask = torch.arange(twins.STEPS) < torch.randint(4, twins.STEPS + 1, (90, 1), generator=g)
    mask[::15] = True
    order = torch.randperm(90, generator=g)
    modes = motion_modes(future[order], mask[order], 6)
    found = torch.cdist(true.flatten(1), modes.flatten(1)).argmin(1)
    assert sorted(found.tolist()) == list(range(6))
    for bundle in range(6):
        members = slice(15 * bundle, 15 * bundle + 15)
        for t in range(twins.STEPS):
            there = mask[members, t]
            torch.testing.assert_close(modes[found[bundle], t], future[members, t][there].mean(0))


@pytest.mark.parametrize("seed", range(6))
def test_clusters_are_never_worse_than_where_they_began(seed):
    future, mask = futures(seed, n=50)
    filled = extended(future, mask)
    chosen = tutr._first_centres(future, mask, filled, 4, torch.Generator().manual_seed(1))
    modes = motion_modes(future, mask, 4)
    began, ended = (twins.within_clusters(future, mask, centres) for centres in (filled[chosen], modes))
    assert ended < began
    g = torch.Generator().manual_seed(seed)
    near = [modes + 0.2 * torch.randn(modes.shape, generator=g) for _ in range(3)]
    assert ended < min(twins.within_clusters(future, mask, centres) for centres in near)


def test_iterations_never_make_clusters_worse(monkeypatch):
    future, mask = futures(16, n=60)
    after = []
    for iterations in range(8):
        monkeypatch.setattr(tutr, "LLOYD_ITERATIONS", iterations)
        after.append(twins.within_clusters(future, mask, motion_modes(future, mask, 5)))
    assert (np.diff(after) <= 1e-9).all()
    assert after[-1] < after[0]


def test_converged_modes_are_the_means_of_their_members(monkeypatch):
    monkeypatch.setattr(tutr, "LLOYD_ITERATIONS", 200)
    future, mask = futures(17, n=60)
    modes = motion_modes(future, mask, 4)
    members = [int(np.argmin(twins.mode_distances(f, m, modes))) for f, m in zip(future, mask, strict=True)]
    for k in range(4):
        mine = torch.tensor(members) == k
        for t in range(twins.STEPS):
            if (mine & mask[:, t]).any():
                torch.testing.assert_close(modes[k, t], future[mine & mask[:, t], t].mean(0))


def test_modes_are_whole_and_the_same_each_time():
    future, mask = futures(18)
    mask &= torch.arange(twins.STEPS) < 5  # nobody is known for longer
    torch.manual_seed(1)
    one = motion_modes(future, mask, 6)
    torch.manual_seed(2)
    assert torch.equal(one, motion_modes(future, mask, 6))
    assert one.isfinite().all()
    velocity = one[:, 4] / 5
    expected = velocity[:, None] * torch.arange(1, twins.STEPS + 1)[:, None]
    torch.testing.assert_close(one[:, 5:], expected[:, 5:])


def test_more_modes_than_different_futures():
    future, mask = torch.ones(3, twins.STEPS, 2), torch.ones(3, twins.STEPS, dtype=torch.bool)
    torch.testing.assert_close(motion_modes(future, mask, 5), torch.ones(5, twins.STEPS, 2))


def test_modes_of_training_futures_are_kept_in_their_walkers_frames():
    net, scenes = network(19, modes=4), twins.walking(19, n=20)
    net.prepare(scenes)
    _, future = in_own_frames(scenes)
    torch.testing.assert_close(net.modes, motion_modes(future, scenes.future_present[:, 0], 4))
    assert "modes" in net.state_dict()
    assert not any(net.modes.data_ptr() == weights.data_ptr() for weights in net.parameters())  # not trained
