"""Table and figure of the networks' trainings, from made-up curves."""

import numpy as np
import pandas as pd
import pytest

from modlhmp.datasets import Dataset
from modlhmp.storage import write_json
from modlhmp.study.exhibits import learning_curves, trainings
from modlhmp.study.layout import Layout

DATASETS = [
    Dataset(name="hall", title="Hall", label="hall", reader="atc"),
    Dataset(name="forum", title="Forum", label="forum", reader="atc", demo=True),
]
CONVERGENCES = [
    (
        {"outcome": "not asked", "fall_per_doubling": None, "most_core_minutes": 60.0, "next_core_minutes": 5.0},
        "not tested",
    ),
    (
        {"outcome": "converged", "fall_per_doubling": 0.0123, "most_core_minutes": 60.0, "next_core_minutes": 5.0},
        "converged: twice the windows are 1.2 % better",
    ),
    (
        {"outcome": "converged", "fall_per_doubling": -0.05, "most_core_minutes": 60.0, "next_core_minutes": 5.0},
        "converged: twice the windows are 5.0 % worse",
    ),
    (
        {"outcome": "no time", "fall_per_doubling": 0.08, "most_core_minutes": 60.0, "next_core_minutes": 45.0},
        "not converged: validation still falls by 8.0 % per doubling; 60 core-minutes allow no more",
    ),
    (
        {"outcome": "no time", "fall_per_doubling": None, "most_core_minutes": 60.0, "next_core_minutes": 75.2},
        "not tested: twice the windows may take 75 more, beyond 60 core-minutes in all",
    ),
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
                    "windows": 90 * n,
                    "train_loss": 1 / n,
                    "validation_ade_m": 5.0 - 0.1 * n,
                    "learning_rate": 0.01,
                    "seconds": 1.0,
                    "core_seconds": 1.0,
                }
                for n in range(1, 11)
            ]
            one = {
                "curve": curve, "budget": "economical", "futures": "masked", "parameters": 199487, "tracks": 90,
                "validation_tracks": 10, "epochs": 10, "planned_epochs": 20, "windows": 900, "planned_windows": 1800,
                "iterations": 1234, "best_epoch": 8, "validation_ade_m": 4.0, "last_validation_ade_m": 4.2, "seed": 1,
                "device": "cpu", "threads": 1, "trainings": [{"core_minutes": 2.5}, {"core_minutes": 5.25}],
                "convergence": CONVERGENCES[1][0],
            }  # fmt: skip
            write_json(layout.training(dataset.name, method), one)
    return layout


def test_every_training_is_a_row(layout, tmp_path):
    """Windows run of those planned, errors of the best and the last epoch, and how much the error still changed."""
    trainings.draw(layout, DATASETS, str(tmp_path / "tab_models"), METHODS)
    table = pd.read_csv(tmp_path / "tab_models.csv", dtype=str)
    assert table["dataset"].tolist() == ["Hall", "Hall", "Forum", "Forum"]
    assert set(table["parameters"]) == {"199,487"}
    assert set(table["windows run / planned"]) == {"900 / 1,800"}
    assert set(table["iterations"]) == {"1,234"}
    assert set(table["best epoch"]) == {"8 of 10"}
    columns = list(table.columns)
    best = columns.index("validation ADE [m], best epoch")
    assert columns[best + 1] == "last epoch"
    assert table.iloc[0, best : best + 2].tolist() == ["4.000", "4.200"]
    assert set(table["seed"]) == {"1"}
    assert set(table["convergence"]) == {CONVERGENCES[1][1]}
    assert set(table["core-minutes (trainings)"]) == {"7.8 (2)"}
    # The last two epochs have 4.05 m in the mean, the two before 4.25 m.
    assert set(table["change in the last fifth [m]"]) == {"-0.200"}
    assert "Demo data" in (tmp_path / "tab_models.md").read_text()


@pytest.mark.parametrize(("about", "text"), CONVERGENCES)
def test_whether_a_training_was_long_enough(about, text):
    assert trainings.convergence({"convergence": about}) == text


def test_a_short_training_has_no_late_change():
    """Below five epochs there is no fifth."""
    assert np.isnan(trainings.late_change([{"validation_ade_m": 1.0}] * 4))
    assert trainings.late_change([{"validation_ade_m": 1.0}] * 5) == 0.0


def test_curves_are_drawn_with_their_numbers(layout, tmp_path):
    """One row of the CSV per epoch and training; times, which differ from run to run, are not among them."""
    learning_curves.draw(layout, DATASETS, str(tmp_path / "learning-curves"), METHODS)
    numbers = pd.read_csv(tmp_path / "learning-curves.csv")
    assert len(numbers) == 40
    assert not {"seconds", "core_seconds"} & set(numbers)
    assert numbers["windows"].max() == 900
    assert numbers.groupby(["dataset", "method"])["validation_ade_m"].min().eq(4.0).all()
    assert (tmp_path / "learning-curves.pdf").stat().st_size > 1000
