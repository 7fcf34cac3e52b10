"""Real recordings that are not the paper's: the shipped dataset files read them as twenty lines of numpy do."""

import numpy as np
import pytest

from modlhmp.cleaning import clean_recording
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.forecasting.windows import windows
from modlhmp.methods import make_forecaster
from modlhmp.options import ConstantVelocity
from modlhmp.scoring.errors import truth_of

pytestmark = pytest.mark.real


def by_hand(name, data):
    """{person: rows [n, 3] of t, x, y in s and m} of the file itself."""
    if name == "hotel":
        frame, person, x, y = np.loadtxt(data / "eth_ucy/biwi_hotel.txt").T
        t, person = frame / 25, [f"{one:.1f}" for one in person]
    elif name == "thor1":
        t, person, x, y = np.loadtxt(data / "thor1/exp-1-run-2.csv", delimiter=",", usecols=(0, 1, 2, 3)).T
        person = [f"{one:.0f}" for one in person]
    else:
        rows = [line.split(",") for line in (data / "magni/condition-A.csv").read_text().splitlines()[1:]]
        t, x, y = np.array([[float(row[column]) for column in (0, 2, 3)] for row in rows]).T
        person = [f"{row[1]}/{row[8]}" for row in rows]
    person = np.array(person)
    found = {}
    for one in np.unique(person):
        mine = np.column_stack([t, x, y])[person == one]
        found[one] = mine[np.argsort(mine[:, 0], kind="stable")]
    return found


@pytest.mark.parametrize("name", ["hotel", "magni_a", "thor1"])
def test_constant_velocity_is_that_of_numpy(load_shipped, real_data, name):
    """From the file's own rows: the paper's weighted velocity, walked on, and where people were then; to a mm."""
    dataset = load_shipped(name, real_data)
    recording = dataset.of_split("test")[0]
    tracks, account = clean_recording(recording.path, dataset, recording)
    forecaster = make_forecaster("cvm", ConstantVelocity(), dataset)
    forecasts = list(forecast_recording(tracks, forecaster, dataset, ("d", "cvm", "r"), 1, [0]))
    wanted = windows(tracks, dataset)
    truth, length = truth_of(tracks, wanted, dataset)
    file, step, checked = by_hand(name, real_data), dataset.time_step_s, 0
    owners = {int(number): owner for number, (owner, _) in account.get("owners", {}).items()}
    xy = np.concatenate([forecast.xy[:, 0] for _, _, forecast in forecasts])
    for n, (row, track_id) in enumerate(zip(wanted.row, wanted.track_id, strict=True)):
        rows = file[owners.get(int(track_id), str(track_id))]
        seen = tracks.t[row - dataset.observed_rows + 1 : row + 1]
        then = np.column_stack([np.interp(seen, rows[:, 0], rows[:, axis]) for axis in (1, 2)])
        dx, dy = (np.diff(then, axis=0) / np.diff(seen)[:, None])[::-1].T
        weights = np.exp(-0.5 * (np.arange(1, len(dx) + 1) / 1.5) ** 2)
        weights /= weights.sum()
        speed, angle = weights @ np.hypot(dx, dy), np.arctan2(dy, dx)
        angle = np.arctan2(weights @ np.sin(angle), weights @ np.cos(angle))
        later = step * np.arange(1, min(length[n], dataset.steps) + 1)
        ahead = then[-1] + speed * later[:, None] * [np.cos(angle), np.sin(angle)]
        np.testing.assert_allclose(xy[n, : len(later)], ahead, atol=1e-3)
        walked = np.column_stack([np.interp(seen[-1] + later, rows[:, 0], rows[:, axis]) for axis in (1, 2)])
        np.testing.assert_allclose(truth[n, : len(later)], walked, atol=1e-3)
        checked += 1
    assert checked == len(wanted.t0) > 20


def test_magni_gives_forecasts_of_ten_seconds_and_none_over_a_gap(load_shipped, real_data):
    dataset = load_shipped("magni_a", real_data)
    recording = dataset.of_split("test")[0]
    tracks, _ = clean_recording(recording.path, dataset, recording)
    wanted = windows(tracks, dataset)
    _, length = truth_of(tracks, wanted, dataset)
    assert (length >= dataset.steps).sum() >= 150
    same = np.diff(tracks.track_id) == 0
    assert np.diff(tracks.t)[same].max() <= dataset.gap_s
