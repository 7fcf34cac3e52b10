"""Forecasts see nothing of what comes after t0: of every kind, and of what the kinds without a forecaster are made of.

`contract.check_blind` asks every kind that forecasts, since `check_kind` does (`test_contract.py`, and other packages'
own tests). Here: that this check can fail, and the kinds without a forecaster: ways out, means, forecasts from outside.
"""

import numpy as np
import pytest
from test_contract import SMALL

from modlhmp import contract, kinds
from modlhmp.contract import SITE, check_kind, crowd
from modlhmp.exchange.task import make_task
from modlhmp.forecasting import recording
from modlhmp.forecasting.average import average_forecasts
from modlhmp.forecasting.neighbours import find_neighbours
from modlhmp.forecasting.observe import observe
from modlhmp.forecasting.windows import windows
from modlhmp.methods import forecaster_of
from modlhmp.options import ConstantVelocity

NEXT_ROW = ("cvm", "episodes", "lstm")
NEIGHBOURS = ("social_lstm", "trajectronpp", "tutr", "mid")


@pytest.fixture(autouse=True)
def _nothing_else(monkeypatch):
    """Of a kind's checks that of its blindness alone."""
    monkeypatch.setattr(contract, "check_forecaster", lambda *given: None)


def noise_after(tracks, moment):
    """The tracks with other positions after a moment."""
    shift = np.where(tracks.t > moment, np.random.default_rng(5).normal(0, 20, len(tracks.t)), 0.0)
    return tracks._replace(x=tracks.x + shift, y=tracks.y - shift)


def test_people_of_the_check_meet():
    """Else it would say nothing about neighbours."""
    tracks = crowd(apart_s=0.3)
    found = find_neighbours(tracks, windows(tracks, SITE).row, SITE.observed_rows)
    assert (found.track >= 0).sum(axis=1).mean() > 2


@pytest.mark.parametrize("name", NEXT_ROW)
def test_a_look_at_the_next_row_is_found(monkeypatch, name):
    monkeypatch.setattr(recording, "observe", lambda tracks, rows, seen: observe(tracks, rows + 1, seen))
    with pytest.raises(AssertionError, match="a forecast depends on what comes after t0"):
        check_kind(kinds.find(name), **SMALL.get(name, {}))


@pytest.mark.parametrize("name", NEIGHBOURS)
def test_a_look_at_the_neighbours_next_row_is_found(monkeypatch, name):
    def later(everyone, own_row, seen, step_s):
        return find_neighbours(everyone, own_row + 1, seen, step_s)

    monkeypatch.setattr(recording, "find_neighbours", later)
    with pytest.raises(AssertionError, match="a forecast depends on what comes after t0"):
        check_kind(kinds.find(name), **SMALL.get(name, {}))


@pytest.mark.parametrize("name", ["cliff", "tc_cliff", "stef"])
def test_methods_that_leave_by_exits(name):
    check_kind(kinds.find(name), exits=True)


def test_a_mean_of_forecasts():
    tracks = crowd(apart_s=0.3)
    moment = np.median(windows(tracks, SITE).t0)
    own = np.isin(tracks.track_id, windows(tracks, SITE).track_id[windows(tracks, SITE).t0 <= moment])
    members = [
        forecaster_of(kinds.find("cvm"), None, SITE, ConstantVelocity(velocity=velocity))
        for velocity in ("dataset", "differences")
    ]
    (ours,), (theirs,) = (
        list(average_forecasts(
            recording.forecast_recording(known.take(own), one, SITE, ("mean",), 1, (0,)) for one in members
        ))
        for known in (tracks, noise_after(tracks, moment))
    )  # fmt: skip
    assert len(ours[1]) > 20
    np.testing.assert_array_equal(ours[2].xy, theirs[2].xy)


@pytest.mark.parametrize("neighbours", [False, True])
def test_what_a_task_shows(neighbours):
    """Its tasks are the same; only their numbers depend on whole tracks, so that whoever has none cannot tell them."""
    tracks = crowd(apart_s=0.3)
    wanted = windows(tracks, SITE)
    moment = np.median(wanted.t0)
    own = np.isin(tracks.track_id, wanted.track_id[wanted.t0 <= moment])
    shown = []
    for known in (tracks, noise_after(tracks, moment)):
        others = [known.take(~own)] if neighbours else None
        task = make_task([("day", known.take(own), None, others)], SITE, "corridor")
        order = np.argsort(task.observed.x[:, 0])
        shown.append([part[order] for part in task.observed[1:]])
    assert np.isfinite(shown[0][-1]).any() == neighbours
    for one, other in zip(*shown, strict=True):
        np.testing.assert_array_equal(one, other)
