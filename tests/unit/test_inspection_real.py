"""`modlhmp inspect` on the real recordings (skipped where they are absent): right guesses, no false alarms."""

import numpy as np
import pytest
import yaml

from modlhmp.cleaning import clean_recording
from modlhmp.datasets import load_dataset
from modlhmp.inspection import inspect_dataset, inspect_file

pytestmark = pytest.mark.real

ATC = {"track_id": 1, "t": 0, "x": 2, "y": 3, "speed": 4, "heading": 5}
PLACES = {"track_id": 1, "t": 0, "x": 2, "y": 3}


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("atc/atc-20121024-1hz-test.csv", {"columns": ATC, "velocity": "as_recorded"}),
        (
            "atc/atc-20121024-raw-11552300.csv",
            {"columns": {**PLACES, "speed": 5, "heading": 6}, "units": {"length": "mm"}, "velocity": "as_recorded"},
        ),
        (
            "eth_ucy/biwi_hotel.txt",
            {"columns": PLACES, "separator": "\t", "units": {"time": "frame"}, "frame_rate": 25.0},
        ),
        ("thor1/exp-1-run-2.csv", {"columns": PLACES, "velocity": "differences"}),
        ("magni/condition-A.csv", {"columns": {"track_id": "ag_id", "t": "Time", "x": "x", "y": "y"}}),
        ("edinburgh/raw/tracks.01Jul.txt", {"reader": "edinburgh", "frame_rate": 9.0, "scale": 0.0247}),
        ("edinburgh/days/0106.csv", {"columns": PLACES, "units": {"time": "frame", "length": "px"}}),
    ],
)
def test_a_draft_of_a_real_file(real_data, tmp_path, file, expected):
    if not (real_data / file).exists():
        pytest.skip(f"{real_data / file}: not there")
    found = inspect_file(real_data / file, real_data)
    keys = yaml.safe_load(found.draft)
    assert {key: keys.get(key) for key in expected} == expected
    assert keys["recordings"][0]["files"] == file
    path = tmp_path / "drafted.yaml"
    path.write_text(found.draft, encoding="utf-8")
    dataset = load_dataset(path, real_data)
    for one in dataset.recordings:
        tracks, account = clean_recording(one.path, dataset, one)
        assert "warnings" not in account
        assert 0.2 < np.nanmedian(tracks.speed) < 2


@pytest.mark.parametrize("name", ["atc_1day", "edinburgh_25days", "hotel", "thor1", "magni_a"])
def test_shipped_datasets_look_right(real_data, config_folder, load_shipped, name):
    if not all(one.exists for one in load_shipped(name, real_data).recordings):
        pytest.skip(f"{real_data}: lacks recordings of {name}")
    found = inspect_dataset(config_folder / "datasets" / f"{name}.yaml", real_data)
    assert found.findings == []
    assert not found.stops
