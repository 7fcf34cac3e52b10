"""Training: seeded, resumable, stopped early; weights that only fit their configuration; forecasts free of batches."""

import logging
import re
from dataclasses import replace
from functools import cache
from itertools import chain

import numpy as np
import pytest
import torch
from crowds import crowd, straight

from modlhmp.forecasting.recording import forecast_recording
from modlhmp.kinds import BUILT_IN, find
from modlhmp.methods import make_forecaster
from modlhmp.networks import forecaster, lstm, training
from modlhmp.networks.data import Scenes, day_of
from modlhmp.networks.training import (
    batches,
    build_network,
    choose_device,
    load_network,
    save_network,
    train,
    validate,
)
from modlhmp.options import Learning
from modlhmp.settings import check
from modlhmp.site import Site
from modlhmp.storage import DataError, write_json
from modlhmp.tracks import concatenate, empty_tracks

LOG = logging.getLogger("training")
KINDS = [kind.name for kind in BUILT_IN if kind.learned]
SITE = Site(observed_rows=4, horizon_s=6.0, time_step_s=1.0, timezone="UTC")
LEARNING = Learning(device="cpu", futures="masked", seed=0)
OPTIONS = {"batch_size": 16, "learning_rate": 0.003, "schedule": "cosine", "rotate": True}
SIZES = {
    "lstm": {"hidden": 8},
    "social_lstm": {"hidden": 8},
    "trajectronpp": {"decoder": 8, "modes": 4},
    "tutr": {"width": 8, "modes": 5},
    "mid": {"context": 8, "k": 3},
    "neural_map": {"channels": 2, "held_out": "blocks", "another_every": 5},
}
NAMES = ("data", "method", "day")


@cache
def two_days():
    """Two days of some 50 usable people each."""
    return [day_of(crowd(seed, people=60, most_rows=24, gaps=(1, 1, 1, 2)), [], Site()) for seed in (1, 2)]


@cache
def drawn(kind):
    """Windows that a network of this kind looks at in one pass over the two days."""
    sizes = {name: value for name, value in SIZES[kind].items() if name in ("held_out", "another_every")}
    return training.training_data(two_days(), "masked", 0.1, 0, 6, 4, 1.0, **sizes).drawn


def options_of(kind, epochs=4, patience=9, **changes):
    """Options of so many passes over the two days, so many of them without a gain."""
    length = {"windows": epochs * drawn(kind), "patience": patience * drawn(kind)}
    return find(kind).options(**{**OPTIONS, **length, **SIZES[kind], **changes})


@pytest.fixture(scope="module")
def days():
    return two_days()


@pytest.fixture
def run(days, tmp_path):
    """Function (kind, options, days=..., learning=...) -> what `train` returns, with one checkpoint file for all."""

    def start(kind, options, days=days, checkpoint=tmp_path / "model.checkpoint", **learning):
        return train(find(kind), options, days, SITE, replace(LEARNING, **learning), checkpoint, LOG, threads=1)

    return start


def curve_of(trained):
    """The curve without its times."""
    return [{name: value for name, value in row.items() if "seconds" not in name} for row in trained[1]]


def assert_same_training(one, other):
    """Equal curves and weights to the last bit."""
    assert curve_of(one) == curve_of(other)
    weights, others = one[0].state_dict(), other[0].state_dict()
    assert weights.keys() == others.keys()
    for name, value in weights.items():
        assert torch.equal(value, others[name]), name


def interrupt(monkeypatch, epoch):
    """Make `train` break off in an epoch, after its gradient steps and before its checkpoint."""
    calls = []

    def broken(*arguments):
        calls.append(1)
        if len(calls) == epoch:
            raise KeyboardInterrupt
        return validate(*arguments)

    monkeypatch.setattr(training, "validate", broken)


# --- repeatable, and resumable ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_an_interrupted_training_gives_the_weights_of_an_undisturbed_one(kind, run, tmp_path, monkeypatch, caplog):
    whole = run(kind, options_of(kind), checkpoint=tmp_path / "whole")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        interrupt(patch, 3)
        run(kind, options_of(kind))
    torch.manual_seed(99)  # whatever has been drawn in between
    with caplog.at_level(logging.INFO, "training"):
        resumed = run(kind, options_of(kind))
    assert f"{kind}: continues after epoch 2" in caplog.text
    assert "epoch 2 of 4" not in caplog.text
    assert_same_training(resumed, whole)
    summaries = [{name: value for name, value in one[2].items() if "minutes" not in name} for one in (resumed, whole)]
    assert summaries[0] == summaries[1]
    assert_same_training(run(kind, options_of(kind)), whole)  # nothing is left to do
    assert not [file.name for file in tmp_path.iterdir() if file.name.endswith(".part")]


def test_the_same_seed_gives_the_same_training_and_another_another(run, tmp_path):
    one, same, other = (
        run("lstm", options_of("lstm"), checkpoint=tmp_path / str(n), seed=seed) for n, seed in enumerate((0, 0, 1))
    )
    assert_same_training(one, same)
    assert curve_of(one)[0]["train_loss"] != curve_of(other)[0]["train_loss"]


def test_curve_and_summary(run):
    network, curve, summary, _ = run("lstm", options_of("lstm", epochs=6, learning_rate=0.01))
    assert [tuple(row) for row in curve] == [training.CURVE] * 6
    assert [row["epoch"] for row in curve] == [1, 2, 3, 4, 5, 6]
    assert curve[-1]["train_loss"] < curve[0]["train_loss"]
    assert summary["parameters"] == network.parameter_count()
    assert summary["tracks"] > 80
    assert summary["validation_tracks"] > 0
    assert summary["epochs"] == summary["planned_epochs"] == 6
    assert summary["windows"] == summary["planned_windows"] == 6 * summary["tracks"]
    assert [row["windows"] for row in curve] == [n * summary["tracks"] for n in range(1, 7)]
    assert summary["iterations"] == summary["planned_iterations"] == 6 * -(-summary["tracks"] // 16)
    errors = [row["validation_ade_m"] for row in curve]
    assert summary["validation_ade_m"] == min(errors)
    assert summary["best_epoch"] == 1 + errors.index(min(errors))
    assert summary["last_validation_ade_m"] == errors[-1]
    assert (summary["device"], summary["seed"]) == ("cpu", 0)
    assert summary["core_minutes"] > 0


@pytest.mark.parametrize(("more", "epochs"), [(-1, 2), (0, 2), (1, 3)])
def test_as_many_passes_as_the_windows_need(run, monkeypatch, more, epochs):
    """The last one is a whole one; what training waits for a gain is counted in the same way."""
    windows = 2 * drawn("lstm") + more
    _, curve, summary, _ = run("lstm", options_of("lstm", windows=windows))
    assert len(curve) == summary["planned_epochs"] == epochs
    scripted(monkeypatch, [1.0] * 9)
    assert len(run("lstm", replace(options_of("lstm", epochs=9), patience=windows))[1]) == 1 + epochs


def test_more_windows_per_pass_are_fewer_passes(run):
    """Of a network that looks at several windows of a track."""
    few, more = options_of("neural_map", another_every=None), options_of("neural_map")
    assert few.windows == more.windows
    few, more = (run("neural_map", options)[2] for options in (few, more))
    assert more["epochs"] == 4 < few["epochs"]
    assert few["windows"] < more["windows"] + few["windows"] / few["epochs"]


@pytest.mark.parametrize("schedule", ["cosine", "original"])
def test_the_learning_rate_follows_its_schedule(run, schedule):
    _, curve, summary, _ = run("lstm", options_of("lstm", epochs=5, batch_size=4, schedule=schedule))
    iterations = -(-summary["tracks"] // 4)
    done = (np.arange(1, 6) * iterations - 1) / (5 * iterations)  # at the last iteration of each epoch
    expected = 0.55 + 0.45 * np.cos(np.pi * done) if schedule == "cosine" else [1.0, 1.0, 0.1, 0.1, 0.01]
    np.testing.assert_allclose([row["learning_rate"] / 0.003 for row in curve], expected, rtol=1e-9)


def test_every_epoch_draws_new_windows_and_turns_them(run, tmp_path, monkeypatch):
    loss, seen = lstm.Network.loss, {True: [], False: []}
    for rotate, batches_seen in seen.items():
        monkeypatch.setattr(lstm.Network, "loss", lambda self, s, to=batches_seen: to.append(s) or loss(self, s))
        _, _, summary, _ = run("lstm", options_of("lstm", epochs=2, rotate=rotate), checkpoint=tmp_path / str(rotate))
    turned, unturned = (Scenes(*map(torch.cat, zip(*part, strict=True))) for part in seen.values())
    assert len(turned.past) == 2 * summary["tracks"]
    assert torch.equal(turned.future_present, unturned.future_present)
    a, b = (torch.cat([scenes.past, scenes.future], 2).flatten(1, 2).double() for scenes in (turned, unturned))
    assert torch.allclose(torch.cdist(a, a), torch.cdist(b, b), atol=1e-4)  # past, future and neighbours alike
    assert not torch.isclose(a, b, atol=1e-4).all(-1).all(-1).any()
    epochs = unturned.lengths().split(summary["tracks"])
    assert not torch.equal(*(lengths.sort().values for lengths in epochs))  # other windows in the second


def test_dropout_is_on_in_training_and_off_in_validation(run, monkeypatch):
    modes = {"loss": [], "validation_error": []}
    for name, seen in modes.items():
        method = getattr(lstm.Network, name)
        monkeypatch.setattr(
            lstm.Network, name, lambda self, s, m=method, to=seen: to.append(self.training) or m(self, s)
        )
    run("lstm", options_of("lstm", epochs=2))
    assert all(modes["loss"])
    assert modes["validation_error"] == [False, False]


# --- checkpoints of others ----------------------------------------------------------------------------------


@pytest.mark.parametrize("changed", [{"learning_rate": 0.001}, {"epochs": 3}, {"hidden": 4}])
def test_a_checkpoint_of_other_options_is_not_taken_up(run, tmp_path, caplog, changed):
    run("lstm", options_of("lstm", epochs=2))
    again = run("lstm", options_of("lstm", **changed))
    assert re.search(r"model\.checkpoint is of another configuration; training starts anew", caplog.text)
    assert_same_training(again, run("lstm", options_of("lstm", **changed), checkpoint=tmp_path / "fresh"))


@pytest.mark.parametrize("setting", ["seed", "futures"])
def test_a_checkpoint_of_other_settings_is_not_taken_up(run, caplog, setting):
    """Even if as many tracks are trained on."""
    days = [day_of(concatenate([straight(n, (0, 0), (1, 0), 20, 100.0 * n) for n in range(40)]), [], Site())]
    numbers = [training.training_data(days, "masked", 0.1, seed, 6, 4, 1.0).tracks for seed in range(20)]
    other = {"seed": numbers.index(numbers[0], 1), "futures": "full"}[setting]
    run("lstm", options_of("lstm", windows=1), days=days)
    _, curve, summary, _ = run("lstm", options_of("lstm", windows=1), days=days, **{setting: other})
    assert summary["tracks"] == numbers[0]
    assert len(curve) == 1
    assert caplog.text.count("another configuration") == 1


def test_a_checkpoint_of_another_kind_or_other_tracks_is_not_taken_up(run, days, caplog):
    run("lstm", options_of("lstm", epochs=1))
    run("social_lstm", options_of("social_lstm", epochs=1))
    assert caplog.text.count("another configuration") == 1
    run("social_lstm", options_of("social_lstm", epochs=1), days=days[:1])
    assert caplog.text.count("another configuration") == 2


def test_a_checkpoint_of_other_positions_is_not_taken_up(run, days, tmp_path, caplog):
    """Say of the same tracks in other units, since the dataset's scale was wrong at first."""
    scaled = [day._replace(tracks=day.tracks._replace(x=2.0 * day.tracks.x, y=2.0 * day.tracks.y)) for day in days]
    run("lstm", options_of("lstm", epochs=2))
    again = run("lstm", options_of("lstm", epochs=2), days=scaled)
    assert "another configuration" in caplog.text
    fresh = run("lstm", options_of("lstm", epochs=2), days=scaled, checkpoint=tmp_path / "fresh")
    assert_same_training(again, fresh)


def cut_short(path):
    path.write_bytes(path.read_bytes()[:2000])


def emptied(path):
    path.write_bytes(b"")


def overwritten(path):
    path.write_bytes(bytes(range(256)) * 20)


@pytest.mark.parametrize("damage", [cut_short, emptied, overwritten])
def test_a_damaged_checkpoint_is_not_taken_up(run, tmp_path, caplog, damage):
    whole = run("lstm", options_of("lstm"))
    damage(tmp_path / "model.checkpoint")
    assert_same_training(run("lstm", options_of("lstm")), whole)
    assert re.search(r"model\.checkpoint cannot be read \(.+\); training starts anew", caplog.text)


# --- stopping -----------------------------------------------------------------------------------------------


def scripted(monkeypatch, errors):
    """Let `validate` say these errors, epoch by epoch; returns the weights it is shown."""
    left, shown = list(errors), []

    def say(network, scenes, device):
        shown.append({name: value.clone() for name, value in network.state_dict().items()})
        return left.pop(0)

    monkeypatch.setattr(training, "validate", say)
    return shown


def test_training_stops_when_it_no_longer_gains_and_returns_the_best_weights(run, monkeypatch):
    shown = scripted(monkeypatch, [3.0, 1.0, 2.0, 1.5, 0.5, 0.9])
    network, curve, summary, last = run("lstm", options_of("lstm", epochs=6, patience=2))
    assert len(curve) == len(shown) == summary["epochs"] == 4  # two epochs without gain after the second
    assert summary["planned_epochs"] == 6
    assert (summary["best_epoch"], summary["validation_ade_m"]) == (2, 1.0)
    for name, value in network.state_dict().items():
        assert torch.equal(value, shown[1][name])
    assert any(not torch.equal(value, shown[3][name]) for name, value in network.state_dict().items())
    assert last.keys() == shown[3].keys()
    assert all(torch.equal(value, shown[3][name]) for name, value in last.items())


def test_numbers_too_small_to_count_are_zero_while_training(run, monkeypatch):
    """Weights that decay below 1e-38 made epochs eight times longer; the caller's arithmetic is left as it was."""
    tiny, seen = torch.tensor([1e-38]), []

    def look(network, scenes, device):
        seen.append(float(tiny / 100))
        return 1.0

    monkeypatch.setattr(training, "validate", look)
    run("lstm", options_of("lstm", epochs=1))
    assert seen == [0.0]
    assert float(tiny / 100) > 0


def test_the_best_weights_are_kept_by_the_checkpoint(run, monkeypatch):
    with monkeypatch.context() as patch, pytest.raises(IndexError):
        shown = scripted(patch, [3.0, 1.0, 2.0])
        run("lstm", options_of("lstm", patience=2))
    scripted(monkeypatch, [4.0])
    network, curve, _, _ = run("lstm", options_of("lstm", patience=2))
    assert [row["validation_ade_m"] for row in curve] == [3.0, 1.0, 2.0, 4.0]
    for name, value in network.state_dict().items():
        assert torch.equal(value, shown[1][name])


def test_a_loss_that_is_not_finite_ends_the_training(run, monkeypatch):
    monkeypatch.setattr(lstm.Network, "loss", lambda self, scenes: self.head.bias.sum() * float("nan"))
    with pytest.raises(DataError, match=r"lstm: the loss of epoch 1 is not finite; lower learning_rate \(now 0\.00"):
        run("lstm", options_of("lstm"))


# --- what cannot be trained ---------------------------------------------------------------------------------


def test_too_few_tracks(run):
    few = day_of(concatenate([straight(n, (0, 0), (1, 0), 12, 100.0 * n) for n in range(15)]), [], Site())
    with pytest.raises(DataError, match=r"lstm: 1\d training and \d+ validation tracks are too few .*at least 20"):
        run("lstm", options_of("lstm"), days=[few])
    with pytest.raises(DataError, match=r"0 training and 0 validation tracks are too few .*name more training"):
        run("lstm", options_of("lstm"), days=[day_of(empty_tracks(), [], Site())])


def test_no_track_of_the_whole_horizon(run):
    short = [day_of(concatenate([straight(n, (0, 0), (1, 0), 8, 100.0 * n) for n in range(60)]), [], Site())]
    assert len(run("lstm", options_of("lstm", windows=1), days=short)[1]) == 1
    with pytest.raises(DataError, match=r"`futures: masked`"):
        run("lstm", options_of("lstm", windows=1), days=short, futures="full")


@pytest.mark.parametrize("kind", KINDS)
def test_an_unknown_size_is_named(kind):
    with pytest.raises(DataError, match=r"(?s)methods\.one.*unknown key 'colour'"):
        check(find(kind).options, {**OPTIONS, **SIZES[kind], "colour": 3}, "methods.one")


def test_devices(run, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert choose_device("cpu") == choose_device("auto") == torch.device("cpu")
    with pytest.raises(DataError, match=r"learned\.device: cuda .* no GPU .*use `auto` or `cpu`"):
        run("lstm", options_of("lstm"), device="cuda")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert choose_device("cuda") == choose_device("auto") == torch.device("cuda")
    assert choose_device("cpu") == torch.device("cpu")


# --- batches ------------------------------------------------------------------------------------------------


def numbered_scenes(lengths):
    """Scenes of such lengths of truth, each with its number in `past`."""
    n = len(lengths)
    past = np.zeros((n, 1, 4, 2), np.float32) + np.arange(n)[:, None, None, None]
    present = np.arange(60) < np.array(lengths)[:, None, None]
    return Scenes(past, np.ones((n, 1, 4), bool), np.zeros((n, 1, 60, 2), np.float32), present, np.zeros((n, 3)))


@pytest.mark.parametrize(("n", "size"), [(100, 16), (96, 16), (5, 16), (7, 1)])
def test_batches_hold_every_scene_once(n, size):
    scenes = numbered_scenes(1 + np.arange(n) % 60)
    parts = [part.past[:, 0, 0, 0].astype(int).tolist() for part in batches(scenes, size, np.random.default_rng(0))]
    assert sorted(chain.from_iterable(parts)) == list(range(n))
    assert sorted(map(len, parts)) == sorted([size] * (n // size) + [n % size] * (n % size > 0))


def test_batches_are_of_like_length_but_not_always_the_same():
    scenes = numbered_scenes(np.random.default_rng(1).integers(1, 61, 640))
    first, again, other = (list(batches(scenes, 64, np.random.default_rng(seed))) for seed in (1, 1, 2))
    spread = [part.lengths().std() for part in first]
    assert np.mean(spread) < scenes.lengths().std() / 2
    one, two = ({frozenset(part.past[:, 0, 0, 0].tolist()) for part in parts} for parts in (first, other))
    assert not one & two  # others come together the next time
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.past, b.past)
    lengths = [part.lengths().mean() for part in first]
    assert lengths != sorted(lengths)  # the batches themselves come in random order


# --- weights on disk ----------------------------------------------------------------------------------------


@pytest.fixture
def saved(tmp_path):
    """Function (kind) -> (path, network) of an untrained network's weights on disk."""

    def save(kind, options=None):
        torch.manual_seed(3)
        options = options or options_of(kind)
        network = build_network(find(kind), options, SITE).eval()
        for buffer in (buffer for name, buffer in network.named_buffers() if name == "modes"):
            buffer.copy_(torch.randn(buffer.shape).cumsum(1))
        save_network(tmp_path / f"{kind}.safetensors", find(kind), options, SITE, network.state_dict())
        return tmp_path / f"{kind}.safetensors", network

    return save


@pytest.mark.parametrize("kind", KINDS)
def test_saved_weights_are_loaded_as_they_were(kind, saved):
    path, network = saved(kind)
    loaded = load_network(path, find(kind), options_of(kind), replace(SITE))
    assert not loaded.training
    for name, value in network.state_dict().items():
        assert torch.equal(value, loaded.state_dict()[name])


@pytest.mark.parametrize(
    ("kind", "options", "site", "named"),
    [
        ("social_lstm", options_of("lstm"), SITE, "kind"),
        ("lstm", options_of("lstm", hidden=16), SITE, "options"),
        ("lstm", options_of("lstm", windows=5), SITE, "options"),
        ("lstm", options_of("lstm"), replace(SITE, horizon_s=12.0), "shape"),
        ("lstm", options_of("lstm"), replace(SITE, observed_rows=3), "shape"),
        ("lstm", options_of("lstm"), replace(SITE, horizon_s=3.0, time_step_s=0.5), "shape"),
    ],
)
def test_weights_of_another_configuration_are_refused(kind, options, site, named, saved):
    path, _ = saved("lstm")
    with pytest.raises(DataError, match=rf"{re.escape(str(path))}: trained with {named} .*; delete it and run again"):
        load_network(path, find(kind), options, site)


@pytest.mark.parametrize("damage", [cut_short, emptied, overwritten, lambda path: torch.save({"a": 1}, path),
                                    lambda path: write_json(path, {"a": 1})])  # fmt: skip
def test_files_that_are_no_weights_are_refused(damage, saved):
    path, _ = saved("lstm")
    damage(path)
    with pytest.raises(DataError, match=rf"{re.escape(str(path))}: .*; delete it and "):
        load_network(path, find("lstm"), options_of("lstm"), SITE)


def test_missing_weights_are_called_missing(saved):
    path, _ = saved("lstm")
    path.unlink()
    with pytest.raises(DataError, match=rf"{re.escape(str(path))}: no such file; .* run the workflow again"):
        load_network(path, find("lstm"), options_of("lstm"), SITE)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_that_are_no_finite_numbers_are_refused(value, saved):
    path, network = saved("lstm")
    weights = network.state_dict()
    weights["embed.bias"][3] = value
    save_network(path, find("lstm"), options_of("lstm"), SITE, weights)
    with pytest.raises(DataError, match=rf"{re.escape(str(path))}: embed\.bias holds NaN or infinity.*; delete it and"):
        load_network(path, find("lstm"), options_of("lstm"), SITE)


@pytest.mark.parametrize("change", [lambda w: w.pop("embed.bias"), lambda w: w.update(other=torch.zeros(2)),
                                    lambda w: w.update({"embed.bias": torch.zeros(3)})])  # fmt: skip
def test_weights_of_other_shapes_are_refused(change, saved):
    path, network = saved("lstm")
    change(weights := dict(network.state_dict()))
    save_network(path, find("lstm"), options_of("lstm"), SITE, weights)
    with pytest.raises(DataError, match=rf"{re.escape(str(path))}: of another network .*; delete it and run again"):
        load_network(path, find("lstm"), options_of("lstm"), SITE)


def test_the_same_weights_are_the_same_bytes_whatever_the_process_and_the_name(saved, tmp_path):
    """Also of a copy that lies otherwise in memory."""
    path, network = saved("lstm")
    weights = {name: value.t().contiguous().t() for name, value in network.state_dict().items()}
    save_network(tmp_path / "other.safetensors", find("lstm"), options_of("lstm"), SITE, weights)
    assert path.read_bytes() == (tmp_path / "other.safetensors").read_bytes()


# --- forecasts ----------------------------------------------------------------------------------------------


def futures_of(kind):
    """How many futures a track has."""
    return SIZES[kind].get("k", 1)


def forecasts(path, kind, own, others):
    """The forecasts of a recording with a saved network, seeds 0 and 1."""
    method = make_forecaster(kind, options_of(kind), SITE, path, device="cpu", threads=1)
    return list(forecast_recording(own, method, SITE, NAMES, futures_of(kind), find(kind).seeds([0, 1]), others))


@pytest.mark.parametrize("kind", KINDS)
def test_forecasts_do_not_depend_on_what_is_forecast_beside_them(kind, saved, monkeypatch):
    path, network = saved(kind)
    own, others = crowd(5, people=12, gaps=(1,)), [crowd(6, people=12, gaps=(1,))]
    together = forecasts(path, kind, own, others)
    k = futures_of(kind)
    n = len(together[0][1])
    assert n > 5
    assert [seed for seed, _, _ in together] == ([0, 1] if kind == "mid" else [0])
    for _, _, forecast in together:
        assert forecast.output == network.output == ("mean" if kind == "mid" else "single")
        assert forecast.xy.shape == (n, k, 6, 2)
        assert forecast.xy.dtype == forecast.log_fitness.dtype == np.float32
        assert np.isfinite(forecast.xy).all()
        assert forecast.log_fitness.shape == (n, k, 6)
        assert (forecast.log_fitness == 0).all()
        assert (forecast.steps_alive == np.full((n, k), 6)).all()
    monkeypatch.setattr(forecaster, "BATCH", 5)
    in_parts = forecasts(path, kind, own, others)
    for (_, _, one), (_, _, other) in zip(together, in_parts, strict=True):
        np.testing.assert_allclose(other.xy, one.xy, rtol=0, atol=1e-5)
    for track_id in together[0][1]:
        rest = [own.take(own.track_id != track_id), *others]
        alone = forecasts(path, kind, own.take(own.track_id == track_id), rest)
        for (_, ids, one), (_, _, forecast) in zip(together, alone, strict=True):
            np.testing.assert_allclose(forecast.xy[0], one.xy[ids == track_id][0], rtol=0, atol=1e-5)


def test_futures_of_mid_differ_by_sample_and_seed(saved):
    path, _ = saved("mid")
    (_, _, one), (_, _, other) = forecasts(path, "mid", crowd(5, people=12, gaps=(1,)), [])
    assert (np.ptp(one.xy, axis=1) > 1e-3).any(-1).all()
    assert not np.allclose(one.xy, other.xy, atol=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_forecasts_start_where_the_walker_is(kind, saved):
    path, _ = saved(kind)
    tracks = crowd(7, people=12, gaps=(1,))
    (_, _, here), (_, _, there) = (
        forecasts(path, kind, table, [])[0] for table in (tracks, tracks._replace(x=tracks.x + 1000, y=tracks.y - 500))
    )
    np.testing.assert_allclose(there.xy, here.xy + np.array([1000, -500]), rtol=0, atol=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_without_usable_tracks(kind, saved):
    path, _ = saved(kind)
    for own in (empty_tracks(), straight(1, (0, 0), (1, 0), 4)):
        _, ids, forecast = forecasts(path, kind, own, [crowd(8, people=3)])[0]
        k = futures_of(kind)
        assert len(ids) == 0
        assert forecast.xy.shape == (0, k, 6, 2)
        assert forecast.log_fitness.shape == (0, k, 6)
        assert forecast.steps_alive.shape == (0, k)
