"""Training anew with twice the windows: when, which training is used, and that an interruption changes nothing."""

import itertools
import logging
from dataclasses import replace

import pytest
import torch
from test_training import LEARNING, SITE, curve_of, drawn, interrupt, options_of, scripted, two_days

from modlhmp.kinds import find
from modlhmp.networks import doubling, training
from modlhmp.networks.doubling import checkpoints, forget, train_long_enough

LOG = logging.getLogger("doubling")


@pytest.fixture
def minute_epochs(monkeypatch):
    """Every epoch takes one minute of a processor core."""
    clock = itertools.count(0, 60)
    monkeypatch.setattr(training.time, "process_time", lambda: next(clock))


@pytest.fixture
def run(tmp_path, minute_epochs):
    """Function (epochs=1, file=..., options={}, **learning) -> what `train_long_enough` returns for an LSTM."""

    def start(epochs=1, file=tmp_path / "lstm.st", options=None, **learning):
        chosen = replace(LEARNING, **{"doubling": True, "most_minutes": 60.0, **learning})
        options = options_of("lstm", epochs, **(options or {}))
        return train_long_enough(find("lstm"), options, two_days(), SITE, chosen, file, LOG)

    return start


def windows_of(summary):
    """Passes over the tracks of each training."""
    return [one["windows"] / drawn("lstm") for one in summary["trainings"]]


def assert_weights(network, expected):
    for name, value in network.state_dict().items():
        assert torch.equal(value, expected[name]), name


def test_unless_asked_for_there_is_one_training(run, tmp_path):
    network, curve, summary, _ = run(epochs=2, doubling=False)
    plain = training.train(find("lstm"), options_of("lstm", 2), two_days(), SITE, LEARNING, tmp_path / "plain", LOG)
    assert curve_of((network, curve)) == curve_of(plain)
    assert_weights(network, plain[0].state_dict())
    assert windows_of(summary) == [2]
    assert summary["convergence"]["outcome"] == "not asked"
    assert summary["convergence"]["fall_per_doubling"] is None


def test_a_longer_training_is_used_where_it_is_more_than_three_percent_better(run, monkeypatch):
    """Of 1, 2 and 4 passes the second is 10 % better than the first, the third 1 % better than the second."""
    shown = scripted(monkeypatch, [10.0, 9.0, 9.5, 9.2, 8.91, 9.3, 9.4])
    network, curve, summary, last = run()
    assert windows_of(summary) == [1, 2, 4]
    assert [one["validation_ade_m"] for one in summary["trainings"]] == [10.0, 9.0, 8.91]
    assert [one["last_validation_ade_m"] for one in summary["trainings"]] == [10.0, 9.5, 9.4]
    assert [one["core_minutes"] for one in summary["trainings"]] == [1, 2, 4]
    assert [row["validation_ade_m"] for row in curve] == [9.0, 9.5]
    assert (summary["validation_ade_m"], summary["epochs"], summary["best_epoch"]) == (9.0, 2, 1)
    assert_weights(network, shown[1])
    assert all(torch.equal(value, shown[2][name]) for name, value in last.items())  # of the training that is used
    assert summary["convergence"]["outcome"] == "converged"
    assert summary["convergence"]["fall_per_doubling"] == pytest.approx(0.01)


def test_twice_the_windows_are_twice_the_passes(run, tmp_path, monkeypatch):
    """Even if the windows are less than one, or not a whole number of them."""
    monkeypatch.setattr(doubling, "GAIN", -10.0)
    assert windows_of(run(options={"windows": 1}, most_minutes=7.0)[2]) == [1, 2, 4]
    forget(tmp_path / "lstm.st")
    assert windows_of(run(options={"windows": 1 + drawn("lstm")}, most_minutes=6.0)[2]) == [2, 4]


def test_a_longer_training_waits_longer_for_a_gain(run, monkeypatch):
    """With a patience of one pass of two, it is two of four."""
    scripted(monkeypatch, [10.0, 10.0, 9.0, 9.5, 8.0, 9.0])
    summary = run(epochs=2, options={"patience": drawn("lstm")}, most_minutes=6.0)[2]
    assert windows_of(summary) == [2, 4]
    assert summary["validation_ade_m"] == 8.0


@pytest.mark.parametrize("second", [9.75, 12.0])
def test_a_shorter_training_is_kept_where_the_longer_gains_no_more_than_three_percent(run, monkeypatch, second):
    shown = scripted(monkeypatch, [10.0, second, second])
    network, curve, summary, _ = run()
    assert (len(curve), windows_of(summary)) == (1, [1, 2])
    assert_weights(network, shown[0])
    assert summary["convergence"]["outcome"] == "converged"
    assert summary["convergence"]["fall_per_doubling"] == pytest.approx(1 - second / 10)


def test_no_training_is_begun_that_may_not_fit_into_the_minutes(run, monkeypatch):
    """1 and 2 minutes fit into 6, and 4 more do not."""
    shown = scripted(monkeypatch, [10.0, 9.0, 8.0])
    network, _, summary, _ = run(most_minutes=6.0)
    assert windows_of(summary) == [1, 2]
    assert_weights(network, shown[2])
    assert summary["convergence"] == {
        "outcome": "no time", "fall_per_doubling": pytest.approx(0.2), "most_core_minutes": 6.0,
        "next_core_minutes": 4.0,
    }  # fmt: skip


def test_no_time_for_any_other(run, monkeypatch):
    scripted(monkeypatch, [10.0])
    summary = run(most_minutes=2.0)[2]
    assert windows_of(summary) == [1]
    assert (summary["convergence"]["outcome"], summary["convergence"]["fall_per_doubling"]) == ("no time", None)


def test_what_a_training_that_stopped_early_may_take_with_twice_the_windows():
    """It may go on to the end: of 100 windows it ran 40 in 2 minutes, so 200 are 10 minutes."""
    assert doubling.minutes_of_twice({"planned_windows": 100, "windows": 40, "core_minutes": 2.0}) == 10


def test_an_interrupted_job_gives_the_weights_of_an_undisturbed_one(run, tmp_path, monkeypatch, caplog):
    """Broken off in the second training: the first is not made again, the second goes on."""
    monkeypatch.setattr(doubling, "GAIN", -10.0)  # every longer training is used
    whole = run(epochs=2, file=tmp_path / "whole.st", most_minutes=6.0)
    assert windows_of(whole[2]) == [2, 4]
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        interrupt(patch, 2 + 3)
        run(epochs=2, most_minutes=6.0)
    torch.manual_seed(99)
    with caplog.at_level(logging.INFO):
        network, curve, summary, _ = run(epochs=2, most_minutes=6.0)
    assert "epoch 1 of" not in caplog.text
    assert "epoch 2 of" not in caplog.text
    assert curve_of((network, curve)) == curve_of(whole)
    assert_weights(network, whole[0].state_dict())
    assert summary["convergence"] == whole[2]["convergence"]


def test_checkpoints_are_those_of_one_network(run, tmp_path, monkeypatch):
    monkeypatch.setattr(doubling, "GAIN", -10.0)
    for name in ("lstm.st", "lstm_axes.st"):
        run(file=tmp_path / name, most_minutes=3.0)
    (tmp_path / "lstm.json").touch()
    assert [path.name for path in checkpoints(tmp_path / "lstm.st")] == [
        "lstm.2.checkpoint",
        "lstm.checkpoint",
    ]
    forget(tmp_path / "lstm.st")
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["lstm.json", "lstm_axes.2.checkpoint", "lstm_axes.checkpoint"]
