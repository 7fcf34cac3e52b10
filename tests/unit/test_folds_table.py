"""The table of folds: errors of all folds as those of one dataset, with the tests over all of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from test_study_figures import HALL, write_errors

from modlhmp.file_format import Recording
from modlhmp.study.exhibits import folds_table
from modlhmp.study.exhibits.folds_table import pooled
from modlhmp.study.layout import Layout
from modlhmp.study.summary import read_errors, summarise

TITLES = {"tc": "TC-CLiFF", "net": "Neural map"}
TRACKS = (5, 15)  # of each fold
ERRORS = {"tc": (2.0, 6.0), "net": (1.0, 2.0)}  # of each fold, at the first step; one more at each


@pytest.fixture
def parts():
    """Two folds of one dataset, each tested on a half of one day."""
    halves = [Recording(name=f"day-fold-{n}", day="2030-01-01", split="test") for n in (1, 2)]
    return [
        replace(HALL, name=f"hall-{n}", label=f"hall-{n}", fold_of="Hall", recordings=(half,))
        for n, half in enumerate(halves, 1)
    ]


@pytest.fixture
def layout(tmp_path, parts):
    layout = Layout("folds", str(tmp_path))
    for method, errors in ERRORS.items():
        for part, error, tracks in zip(parts, errors, TRACKS, strict=True):
            write_errors(layout.errors(part.name, method), error, 8, tracks, part.recordings[0].name)
    return layout


def test_folds_together_are_one_dataset(layout, parts):
    """The mean over all tracks, not of the folds' means."""
    together = pooled(read_errors(layout.errors(part.name, "tc")) for part in parts)
    rows = summarise("hall", "tc", together, 1.0)
    assert set(rows["n"]) == set(rows["eligible"]) == {sum(TRACKS)}
    first = rows[rows["horizon_s"] == 1]
    np.testing.assert_allclose(first["ade_m"], np.average(ERRORS["tc"], weights=TRACKS))
    for key, one in together.items():
        for fold, part in enumerate(parts):
            alone = read_errors(layout.errors(part.name, "tc"))[key]
            own = slice(0, TRACKS[0]) if fold == 0 else slice(TRACKS[0], None)
            np.testing.assert_array_equal(one.ade[:, own], alone.ade)
            np.testing.assert_array_equal(one.eligible_steps[own], alone.eligible_steps)


def test_a_row_says_errors_n_and_difference(layout, parts, tmp_path):
    stem = str(tmp_path / "folds")
    days, horizons = (
        dict.fromkeys(["day-fold-1", "day-fold-2"], "2030-01-01"),
        {part.name: [1.0, 4.0] for part in parts},
    )
    folds_table.draw(layout, parts, stem, TITLES, "tc", horizons, days)
    table = pd.read_csv(f"{stem}.csv").set_index("method")
    assert list(table.columns) == ["dataset", "1 s", "4 s", "paper protocol, the longest horizon"]
    assert set(table["dataset"]) == {"Hall"}
    assert table.loc["TC-CLiFF", "1 s"] == "5.00 / 5.00 (n 20); –"
    assert table.loc["Neural map", "4 s"].startswith("4.75 / 4.75 (n 20); -3.25 (")
    assert table.loc["Neural map", "paper protocol, the longest horizon"] == "4.75 / 4.75 (20/20)"
    assert "TC-CLiFF" in Path(f"{stem}.md").read_text(encoding="utf-8")
