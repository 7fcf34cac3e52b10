"""Table and figure of the networks' trainings, from made-up curves."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modlhmp.datasets import Dataset
from modlhmp.study.exhibits import learning_curves, trainings
from modlhmp.study.layout import Layout

DATASETS = [
    Dataset(name="hall", title="Hall", label="hall", reader="atc"),
    Dataset(name="forum", title="Forum", label="forum", reader="atc", demo=True),
]
METHODS = {"lstm": "LSTM", "tutr": "TUTR"}


@pytest.fixture
def layout(tmp_path):
    """Where the JSON files of four trainings lie; the validation error falls by 0.1 m per epoch from 5 m."""
    layout = Layout("models", str(tmp_path))  # a name that its own paths hold as well
    for dataset in DATASETS:
        for method in METHODS:
            curve = [
                {
                    "epoch": n,
                    "train_loss": 1 / n,
                    "validation_ade_m": 5.0 - 0.1 * n,
                    "learning_rate": 0.01,
                    "seconds": 1.0,
                }
                for n in range(1, 11)
            ]
            one = {
                "curve": curve, "budget": "economical", "futures": "masked", "parameters": 199487, "tracks": 90,
                "validation_tracks": 10, "epochs": 10, "planned_epochs": 20, "best_epoch": 10, "validation_ade_m": 4.0,
                "minutes": 2.5, "device": "cpu", "threads": 1,
            }  # fmt: skip
            path = Path(layout.training(dataset.name, method))
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps(one))
    return layout


def test_every_training_is_a_row(layout, tmp_path):
    """Epochs run of those planned, parameters, and how much the error still changed."""
    trainings.draw(layout, DATASETS, str(tmp_path / "tab_models"), METHODS)
    table = pd.read_csv(tmp_path / "tab_models.csv", dtype=str)
    assert table["dataset"].tolist() == ["Hall", "Hall", "Forum", "Forum"]
    assert set(table["parameters"]) == {"199,487"}
    assert set(table["epochs run / planned"]) == {"10 / 20"}
    # The last two epochs have 4.05 m in the mean, the two before 4.25 m.
    assert set(table["change in the last fifth [m]"]) == {"-0.200"}
    assert "Demo data" in (tmp_path / "tab_models.md").read_text()


def test_a_short_training_has_no_late_change():
    """Below five epochs there is no fifth."""
    assert np.isnan(trainings.late_change([{"validation_ade_m": 1.0}] * 4))
    assert trainings.late_change([{"validation_ade_m": 1.0}] * 5) == 0.0


def test_curves_are_drawn_with_their_numbers(layout, tmp_path):
    """One row of the CSV per epoch and training; times, which differ from run to run, are not among them."""
    learning_curves.draw(layout, DATASETS, str(tmp_path / "learning-curves"), METHODS)
    numbers = pd.read_csv(tmp_path / "learning-curves.csv")
    assert len(numbers) == 40
    assert "seconds" not in numbers
    assert numbers.groupby(["dataset", "method"])["validation_ade_m"].min().eq(4.0).all()
    assert (tmp_path / "learning-curves.pdf").stat().st_size > 1000
