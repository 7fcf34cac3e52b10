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
from modlhmp.study.ladder import scores
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
    days = {f"hall-{n}": {f"day-fold-{n}": "2030-01-01"} for n in (1, 2)}
    horizons = {part.name: [1.0, 4.0] for part in parts}
    folds_table.draw(layout, parts, stem, TITLES, "tc", horizons, days)
    table = pd.read_csv(f"{stem}.csv").set_index("method")
    assert list(table.columns) == ["dataset", "1 s", "4 s", "paper protocol, the longest horizon"]
    assert set(table["dataset"]) == {"Hall"}
    assert table.loc["TC-CLiFF", "1 s"] == "5.00 / 5.00 (n 20); –"
    assert table.loc["Neural map", "4 s"].startswith("4.75 / 4.75 (n 20); -3.25 (")
    assert table.loc["Neural map", "paper protocol, the longest horizon"] == "4.75 / 4.75 (20/20)"
    assert "TC-CLiFF" in Path(f"{stem}.md").read_text(encoding="utf-8")


def test_days_are_those_of_the_dataset(tmp_path, monkeypatch):
    """Two datasets whose recordings are called alike, of other days each."""
    layout, seen = Layout("folds", str(tmp_path)), []
    names = [f"r{n}" for n in range(6)]
    recordings = tuple(Recording(name=name, split="test") for name in names)
    halls = [replace(HALL, name=name, label=name, fold_of=name, recordings=recordings) for name in ("one", "two")]
    for hall in halls:
        for method in TITLES:
            write_errors(layout.errors(hall.name, method), 1.0, 8, 3, "r0")
    days = {hall.name: {name: f"{hall.name} {n}" for n, name in enumerate(names)} for hall in halls}
    monkeypatch.setattr(folds_table, "scores", lambda *known: seen.append(known[-1]) or scores(*known))
    folds_table.draw(layout, halls, str(tmp_path / "folds"), TITLES, "tc", {one.name: [1.0] for one in halls}, days)
    assert seen == [days["one"], days["two"]]
