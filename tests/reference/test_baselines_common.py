"""What holds for every network: padding, absent people, places and the future do not show where they must not."""

import network_twins as twins
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from network_twins import walking, without_dropout

from modlhmp.forecasting.observe import Observed
from modlhmp.kinds import BUILT_IN, find
from modlhmp.methods import make_forecaster
from modlhmp.networks import trajectronpp
from modlhmp.networks.data import Day, Scenes, observed_scene, scenes_at
from modlhmp.networks.network import cosine, masked_mean, rotated, track_ade, trimmed
from modlhmp.networks.training import save_network
from modlhmp.site import Site
from modlhmp.streams import stream_keys
from modlhmp.tracks import Tracks

SMALL = {
    "lstm": {"hidden": 12},
    "social_lstm": {"hidden": 12},
    "trajectronpp": {"decoder": 12, "modes": 6},
    "tutr": {"width": 16, "modes": 5},
    "mid": {"context": 8},
    "neural_map": {"channels": 3},
}
ALONE = ("lstm", "neural_map")  # look at nobody else
AUTOREGRESSIVE = ("lstm", "social_lstm", "trajectronpp")

NETWORKS = [kind for kind in BUILT_IN if kind.learned]
every_kind = pytest.mark.parametrize("kind", [kind.name for kind in NETWORKS])
every_published_kind = pytest.mark.parametrize("kind", [kind.name for kind in NETWORKS if kind.published])


def network(kind, seed=0, steps=twins.STEPS, **options):
    """A small network of random weights in double precision; TUTR's modes are from made-up walkers."""
    torch.manual_seed(seed)
    net = find(kind).implementation().Network(steps, twins.OBSERVED, 1.0, **SMALL[kind] | options).double()
    net.prepare(walking(100, n=20, steps=steps))
    return net.eval()


def keys_of(n, k=1):
    return torch.from_numpy(stream_keys(np.arange(n), k, 0, "hall").view(np.int64))


def forecast(net, scenes):
    with torch.no_grad():
        return net.forecast(scenes.past, scenes.past_present, keys_of(len(scenes.past)), scenes.where)


def loss_and_gradients(net, scenes, seed=1):
    """Of one iteration of training whose random numbers are those of `seed`."""
    torch.manual_seed(seed)
    if hasattr(net, "iteration"):
        net.iteration.zero_()
    net.zero_grad()
    loss = net.train().loss(scenes)
    loss.backward()
    gradients = {name: weights.grad.clone() for name, weights in net.named_parameters() if weights.grad is not None}
    net.eval()
    return loss.detach(), gradients


def filled(scenes, value):
    """The scenes with `value` wherever nobody is."""
    past = torch.where(scenes.past_present[..., None], scenes.past, value)
    return scenes._replace(past=past, future=torch.where(scenes.future_present[..., None], scenes.future, value))


# --- contract -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "options", "shape", "expected"),
    [
        ("lstm", {}, (60, 4), 199_487),
        ("social_lstm", {}, (60, 4), 529_487),
        ("trajectronpp", {}, (60, 4), 127_654),
        ("trajectronpp", {"decoder": 64}, (60, 4), 66_790),
        ("tutr", {}, (60, 4), 463_737),
        ("tutr", {"width": 64}, (60, 4), 125_433),
        ("tutr", {}, (12, 8), 441_113),
        ("tutr", {"width": 64}, (12, 8), 114_073),
        ("mid", {}, (60, 4), 7_115_664),
        ("mid", {"context": 128}, (60, 4), 1_788_368),
        ("mid", {"context": 64}, (60, 4), 451_824),
    ],
)
def test_number_of_parameters(kind, options, shape, expected):
    assert find(kind).implementation().Network(*shape, 1.0, **options).parameter_count() == expected


@every_kind
def test_contract(kind):
    net, scenes = network(kind, 1), walking(1)
    k = 3 if net.output == "mean" else 1
    with torch.no_grad():
        got = net.forecast(scenes.past, scenes.past_present, keys_of(6, k), scenes.where)
    assert got.shape == (6, k, twins.STEPS, 2)
    assert got.dtype == torch.float64
    assert net.turns == {"lstm": 0, "social_lstm": 0, "trajectronpp": 24, "mid": 24}.get(kind)
    assert net.output == ("mean" if kind == "mid" else "single")
    loss, gradients = loss_and_gradients(net, scenes)
    assert loss.shape == ()
    assert set(gradients) == {name for name, _ in net.named_parameters()}


@every_kind
def test_forecast_draws_nothing_and_changes_nothing(kind):
    net, scenes = network(kind, 2), walking(2)
    state = {name: value.clone() for name, value in net.state_dict().items()}
    torch.manual_seed(3)
    before = torch.get_rng_state()
    one = forecast(net, scenes)
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.equal(forecast(net, scenes), one)
    assert all(torch.equal(value, state[name]) for name, value in net.state_dict().items())


@every_kind
def test_same_seed_same_losses(kind):
    def losses():
        net = network(kind, 4).float().train()
        optimiser = net.optimiser(1e-3)
        torch.manual_seed(5)
        for seed in range(3):
            optimiser.zero_grad()
            loss = net.loss(walking(seed, dtype=torch.float32))
            loss.backward()
            net.clip()
            optimiser.step()
            yield loss.item()

    assert list(losses()) == list(losses())


@every_kind
def test_validation_error_is_the_mean_distance_of_the_steps_that_are_there(kind):
    net, scenes = network(kind, 6), walking(6)
    with torch.no_grad():
        got = net.validation_error(scenes)
        xy = net.forecast(scenes.past, scenes.past_present, torch.arange(6)[:, None], scenes.where)
    for i, length in enumerate(scenes.lengths().tolist()):
        distances = [twins.norm(xy[i, 0, t] - scenes.future[i, 0, t]) for t in range(length)]
        assert got[i].item() == pytest.approx(sum(distances) / length)


def test_error_of_a_worked_example():
    xy = torch.tensor([[[1.0, 0], [0, 2], [3, 0], [9, 9], [9, 9]]])
    present = torch.tensor([[True, True, True, False, False]])
    assert track_ade(xy, torch.zeros_like(xy), present).tolist() == [2.0]


def test_mean_over_a_mask_and_length_of_a_batch():
    values = torch.tensor([[1.0, 2, torch.nan], [5, torch.inf, torch.nan]])
    assert masked_mean(values, torch.tensor([[True, True, False], [True, False, False]])).item() == pytest.approx(8 / 3)
    assert trimmed(walking(7)) == 11
    assert [cosine(done) for done in (0.0, 0.5, 1.0)] == pytest.approx([1.0, 0.55, 0.1])


# --- padding ------------------------------------------------------------------------------------------------


@every_kind
@pytest.mark.parametrize("value", [1e6, 1e200])  # the square of which is infinite
def test_padding_is_inert(kind, value):
    net, scenes = network(kind, 8), walking(8)
    loss, gradients = loss_and_gradients(net, scenes)
    padded_loss, padded_gradients = loss_and_gradients(net, filled(scenes, value))
    assert torch.equal(padded_loss, loss)
    for name, gradient in gradients.items():
        assert torch.equal(padded_gradients[name], gradient), name
    assert torch.equal(forecast(net, filled(scenes, value)), forecast(net, scenes))


@every_kind
def test_truth_that_is_not_there_is_not_learned_from(kind):
    net, scenes = network(kind, 9).train(), walking(9)
    future = filled(scenes, 5.0).future.requires_grad_()
    net.loss(scenes._replace(future=future)).backward()
    assert (future.grad[~scenes.future_present] == 0).all()
    assert (future.grad[:, 0][scenes.future_present[:, 0]] != 0).any()


def without_chance(monkeypatch, kind):
    """Make a loss the mean of its scenes' losses: no random numbers, nothing of the batch as a whole."""
    if kind == "trajectronpp":
        monkeypatch.setattr(trajectronpp, "draw", lambda mean, log_sigma, rho: mean + 0.3 * torch.exp(log_sigma))
        monkeypatch.setattr(trajectronpp, "mutual_information", lambda p: 0.0)
        monkeypatch.setattr(trajectronpp, "KL_FLOOR", 0.0)
    if kind == "mid":
        monkeypatch.setattr(torch, "randn_like", lambda x: torch.full_like(x, 0.5))
        monkeypatch.setattr(torch, "randint", lambda low, high, size, device: torch.full(size, 30))


@pytest.mark.parametrize(
    ("kind", "weights", "left_out"),
    [
        ("lstm", "steps", None),
        ("social_lstm", "steps", None),
        ("trajectronpp", "tracks", None),
        ("tutr", "steps", "cross_entropy"),
        ("tutr", "tracks", "smooth_l1_loss"),
        ("mid", "steps", None),
    ],
)
def test_a_scene_counts_in_a_batch_as_it_does_cut_to_its_own_length(kind, weights, left_out, monkeypatch):
    net, scenes = without_dropout(network(kind, 10)), walking(10)
    without_chance(monkeypatch, kind)
    if left_out:
        net.eval()
        monkeypatch.setattr(torch.nn.functional, left_out, lambda one, other, reduction="": 0 * one[..., :1])

    def loss(some):
        if kind == "trajectronpp":
            net.iteration.fill_(1000)
        return net.loss(some).mean()

    def alone(i):
        cut = twins.one(scenes, i)
        if kind != "tutr":
            return cut
        wide = torch.nn.functional.pad(cut.future, (0, 0, 0, twins.STEPS - cut.future.shape[2]))
        return cut._replace(future=wide, future_present=scenes.future_present[i : i + 1])

    each = torch.stack([loss(alone(i)) for i in range(6)])
    share = scenes.lengths().double() if weights == "steps" else torch.ones(6)
    torch.testing.assert_close(loss(scenes), (each * share).sum() / share.sum())


@every_kind
def test_one_step_of_truth_is_enough(kind):
    net, scenes = network(kind, 11), walking(11)
    first = torch.arange(twins.STEPS) == 0
    loss, gradients = loss_and_gradients(net, scenes._replace(future_present=scenes.future_present & first))
    assert loss.isfinite()
    assert all(gradient.isfinite().all() for gradient in gradients.values())


# --- neighbours ---------------------------------------------------------------------------------------------


@every_kind
def test_order_of_the_neighbours_does_not_matter(kind):
    net, scenes = network(kind, 12), walking(12, others=4)
    mixed = twins.people(scenes, [0, 3, 1, 4, 2])
    torch.testing.assert_close(forecast(net, mixed), forecast(net, scenes))
    torch.testing.assert_close(loss_and_gradients(net, mixed)[0], loss_and_gradients(net, scenes)[0])


@every_kind
def test_more_places_for_nobody_do_not_matter(kind):
    net, scenes = network(kind, 13), walking(13)
    nobody = (torch.full_like(scenes.past[:, :3], 7.0), False & scenes.past_present[:, :3])
    later = (torch.full_like(scenes.future[:, :3], 7.0), False & scenes.future_present[:, :3])
    more = Scenes(*(torch.cat(pair, 1) for pair in zip(scenes[:4], nobody + later, strict=True)), scenes.where)
    torch.testing.assert_close(forecast(net, more), forecast(net, scenes))
    torch.testing.assert_close(loss_and_gradients(net, more), loss_and_gradients(net, scenes))


@every_kind
def test_neighbours_are_seen_by_all_but_some(kind):
    net, scenes = network(kind, 14), walking(14)
    alone = twins.people(scenes, [0])
    differ = (forecast(net, scenes) - forecast(net, alone)).abs().amax((1, 2, 3)) > 1e-9
    assert bool(differ.any()) == (kind not in ALONE)
    assert net.looks_at_neighbours == (kind not in ALONE)
    assert not differ[::4].any()  # there is nobody


@every_kind
def test_nobody_around_or_nobody_moves(kind):
    net, scenes = network(kind, 15), walking(15)
    alone = twins.people(scenes, [0])
    still = scenes._replace(past=torch.zeros_like(scenes.past), future=torch.zeros_like(scenes.future))
    for some in (alone, still, twins.people(still, [0]), Scenes(*(part[:1] for part in scenes))):
        loss, gradients = loss_and_gradients(net.double(), some)
        assert loss.isfinite()
        assert all(gradient.isfinite().all() for gradient in gradients.values())
        assert forecast(net, some).isfinite().all()
        single = Scenes(*(part.float() if part.is_floating_point() else part for part in some))
        assert loss_and_gradients(net.float(), single)[0].isfinite()
        assert forecast(net, single).isfinite().all()
    net.double()


@every_kind
def test_batch_does_not_matter(kind):
    net, scenes = network(kind, 16), walking(16)
    keys = keys_of(6)
    with torch.no_grad():
        whole = net.forecast(scenes.past, scenes.past_present, keys, scenes.where)
        for rows in ([4], [5, 2, 1]):
            part = net.forecast(scenes.past[rows], scenes.past_present[rows], keys[rows], scenes.where[rows])
            torch.testing.assert_close(part, whole[rows])


# --- space and time -----------------------------------------------------------------------------------------


def observed(seed, shift=(0.0, 0.0), n=8, others=3):
    """What is seen of n walkers, all at multiples of 2^-10 m, so that shifts by whole metres are exact."""
    rng = np.random.default_rng(seed)
    paths = np.round(1024 * rng.normal(0, 0.6, (n, 1 + others, 4, 2)).cumsum(2)) / 1024 + shift
    paths[1::2, 2, :2] = paths[::3, 3] = np.nan
    t = 1.9e9 + 100.0 * np.arange(n)[:, None] + np.arange(4.0)
    unknown = np.full((n, 4), np.nan)
    return Observed(np.arange(n), t, paths[:, 0, :, 0], paths[:, 0, :, 1], unknown, unknown, paths[:, 1:])


@every_published_kind
def test_translation_is_exact(kind):
    net = network(kind, 17)

    def predict(seen):
        past, present, origin = observed_scene(seen, 1.0)
        with torch.no_grad():
            return net.forecast(torch.from_numpy(past).double(), torch.from_numpy(present), keys_of(8)).numpy(), origin

    (here, origin), (there, far) = predict(observed(18)), predict(observed(18, (1000.0, -500.0)))
    np.testing.assert_array_equal(there, here)
    np.testing.assert_array_equal(far, origin + np.array([1000.0, -500.0]))


@every_published_kind
def test_translation_of_a_forecaster(kind, tmp_path):
    site = Site(horizon_s=12.0, time_step_s=1.0, observed_rows=4, timezone="UTC")
    options = find(kind).options(**SMALL[kind], windows=1, batch_size=8)
    net = network(kind, 19).float()
    save_network(tmp_path / "weights.safetensors", find(kind), options, site, net.state_dict())
    forecaster = make_forecaster(kind, options, site, tmp_path / "weights.safetensors", device="cpu", threads=1)
    keys = stream_keys(np.arange(8), 2 if kind == "mid" else 1, 0, "hall")
    here = forecaster(observed(20), twins.STEPS, keys)
    there = forecaster(observed(20, (50.0, -31.7)), twins.STEPS, keys)
    np.testing.assert_allclose(there.xy, here.xy + np.array([50.0, -31.7]), atol=1e-3)
    assert (here.steps_alive == twins.STEPS).all()
    assert here.output == net.output


def turned(values, angle):
    c, s = np.cos(angle), np.sin(angle)
    return values @ torch.tensor([[c, s], [-s, c]], dtype=values.dtype)


@pytest.mark.parametrize("angle", [0.3, 1.7, -2.9])
def test_rotated_walkers_have_rotated_tutr_forecasts(angle):
    net, scenes = network("tutr", 21), walking(21)
    got = forecast(net, scenes._replace(past=turned(scenes.past, angle)))
    torch.testing.assert_close(got, turned(forecast(net, scenes), angle))


@given(st.integers(0, 1000), st.lists(st.floats(-7, 7), min_size=6, max_size=6))
def test_augmentation_turns_everybody_alike(seed, angles):
    scenes = walking(seed)
    got = rotated(scenes, torch.tensor(angles, dtype=torch.float64))
    for i, angle in enumerate(angles):
        torch.testing.assert_close(got.past[i], turned(scenes.past[i], angle))
        torch.testing.assert_close(got.future[i], turned(scenes.future[i], angle))
    for part, there in ((got.past, got.past_present), (got.future, got.future_present)):
        assert (part[~there] == 0).all()
    assert torch.equal(got.past_present, scenes.past_present)
    assert torch.equal(got.future_present, scenes.future_present)

    def distances(some):
        people = torch.cat([some.past, some.future], 2).flatten(1, 2)
        return torch.cdist(people, people, compute_mode="donot_use_mm_for_euclid_dist")

    torch.testing.assert_close(distances(got), distances(scenes))


@pytest.mark.parametrize("kind", AUTOREGRESSIVE)
def test_shorter_horizon_is_a_prefix(kind):
    long, scenes = network(kind, 22, steps=60), walking(22)
    short = network(kind, 23, steps=20)
    short.load_state_dict(long.state_dict())
    torch.testing.assert_close(forecast(short, scenes), forecast(long, scenes)[:, :, :20])


def passers_by(seed, people=9, rows=14):
    """People on one clock of whole seconds who come one after the other, as a table and as bounds of their rows."""
    rng = np.random.default_rng(seed)
    starts, xy = np.sort(rng.integers(0, 8, people)), rng.normal(0, 0.5, (people, rows, 2)).cumsum(1)
    t = (1.9e9 + starts[:, None] + np.arange(float(rows))).ravel()
    unknown = np.full(people * rows, np.nan)
    table = Tracks(np.repeat(np.arange(people), rows), t, *xy.reshape(-1, 2).T, unknown, unknown)
    return table, rows * np.arange(people)


@every_kind
def test_nothing_after_t0_is_seen(kind):
    net, (table, first) = network(kind, 24), passers_by(25)
    rng = np.random.default_rng(26)

    def predict(tracks, start, end):
        day = Day(tracks, np.empty((0, 2), int))
        past, present, _, _, where = scenes_at(day, np.array([start]), np.array([end]), 5, 4, 1.0)
        past, where = (torch.from_numpy(part).double() for part in (past, where))
        with torch.no_grad():
            return net.forecast(past, torch.from_numpy(present), keys_of(1), where), present

    around = 0
    for start in first:
        later = table.t > table.t[start + 3]
        x, y = (np.where(later, rng.normal(0, 9, len(later)), column) for column in (table.x, table.y))
        expected, present = predict(table, start, start + 13)
        around += int(present[0, 1:, -1].sum())
        assert torch.equal(predict(table._replace(x=x, y=y), start, start + 13)[0], expected)
        kept = table.take(~later)
        here = np.flatnonzero(kept.track_id == table.track_id[start])
        assert torch.equal(predict(kept, here[0], here[-1])[0], expected)
    assert around > 10
