"""Exhibits of distributions: the table's cells, and the bins behind the figure of calibration."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from scipy import stats

from modlhmp.datasets import Dataset
from modlhmp.scoring.uncertainty import MEASURES
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import calibration, horizon_errors, tables, uncertainty_table

HALL = Dataset(name="hall", title="Hall", label="atc", reader="atc", time_step_s=2.0, horizon_s=12.0, demo=True)
METHODS = {"cvm": "CVM", "snippets": "Snippets", "tc_cliff": "TC-CLiFF"}
MEASURED = ["snippets", "tc_cliff"]


def write_measures(layout, method, horizons=(4.0, 12.0), tracks=60, factor=1.0, known=True, days=1):
    """A file of one seed: track n expects an error of n / 10 m and errs by `factor` times that; the odd ones left.

    It is of recording "day0", or of n % `days`.
    """
    n = np.arange(tracks, dtype=np.float32)
    values = dict.fromkeys(MEASURES, n / 10 * factor) | {"expected_m": n / 10, "samples": n * 0 + 40}
    has_left = n % 2
    values = {name: np.where(has_left * known, np.nan, one) if known else one * np.nan for name, one in values.items()}
    values |= {"left": n / tracks, "has_left": has_left}
    lists = {
        name: pa.FixedSizeListArray.from_arrays(
            pa.array(np.repeat(one.astype(np.float32), len(horizons))), len(horizons)
        )
        for name, one in values.items()
    }
    table = pa.table(
        {
            "recording": [f"day{one % days}" for one in range(tracks)],
            "track_id": n.astype(int),
            "seed": n.astype(int) * 0,
            **lists,
        }
    )
    write_parquet(table, layout.uncertainty("hall", method), horizons_s=list(horizons))


def test_the_table_s_cells_by_hand(layout, tmp_path):
    write_measures(layout, "tc_cliff", factor=2.0)
    write_measures(layout, "snippets")
    uncertainty_table.draw(layout, [HALL], str(tmp_path / "t"), {m: METHODS[m] for m in MEASURED}, {})
    table = pd.read_csv(tmp_path / "t.csv")
    assert table["horizon [s]"].tolist() == [4, 4, 12, 12]
    assert table["method"].tolist() == ["Snippets", "TC-CLiFF"] * 2
    row = table.iloc[1]
    assert row["expected error [m]"] == pytest.approx(2.9)  # of the 30 even ones
    assert row["real error [m]"] == row["energy score [m]"] == pytest.approx(5.8)
    assert (row["real / expected"], row["n"], row["has left: n"], row["have left [%]"]) == (2.0, 30, 60, 50.0)
    n = np.arange(60)
    assert row["has left: Brier"] == pytest.approx(((n / 60 - n % 2) ** 2).mean(), abs=6e-4)
    assert row["base rate's Brier"] == 0.25
    text = (tmp_path / "t.md").read_text()
    assert "| **2.900** |" in text
    assert "**5.800**" not in text  # the best is bold
    for kind in ("md", "html", "tex"):
        assert "Demo data" in (tmp_path / f"t.{kind}").read_text()


def test_values_that_print_alike_are_bold_together(layout, tmp_path):
    """Whoever reads a table cannot see which of them is lower."""
    write_measures(layout, "tc_cliff", factor=1.00001)
    write_measures(layout, "snippets")
    uncertainty_table.draw(layout, [HALL], str(tmp_path / "t"), {m: METHODS[m] for m in MEASURED}, {})
    rows = [line for line in (tmp_path / "t.md").read_text().splitlines() if "| Hall | 4 |" in line]
    assert len(rows) == 2 and all("**2.900**" in row for row in rows)
    at = pd.DataFrame({"ade_m": [1.23449, 1.23441, 1.3, np.nan], "fde_m": [2.0, 1.0, 3.0, np.nan]}, index=list("abcd"))
    shown = ["**1.234** / 2.000", "**1.234** / **1.000**", "1.300 / 3.000", "– / –"]
    assert tables._errors(at) == shown


def test_the_spread_has_room_under_both_protocols(layout, tmp_path, monkeypatch):
    """The complete protocol's errors are the larger ones, and both share an axis."""
    rows = [
        {"dataset": "hall", "method": "tc_cliff", "output": "single", "protocol": protocol, "horizon_s": horizon,
         "n": 5, "eligible": 5, **{f"{of}_m": mean * horizon for of in ("ade", "fde")},
         **{f"{of}_sd_m": mean * horizon for of in ("ade", "fde")}}
        for protocol, mean in (("paper", 0.1), ("complete", 1.0)) for horizon in (2.0, 12.0)
    ]  # fmt: skip
    Path(layout.scores).parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows).to_csv(layout.scores, index=False)
    drawn = []
    monkeypatch.setattr(horizon_errors.style, "save", lambda fig, *others: drawn.append(fig))
    horizon_errors.draw(layout, HALL, str(tmp_path / "f"), {"tc_cliff": "TC-CLiFF"})
    for ax in drawn[0].axes[:4]:
        assert ax.get_ylim()[0] == 0 and ax.get_ylim()[1] >= 24


def test_a_table_of_nobody_long_enough(layout, tmp_path):
    """A dash and n 0, not a crash."""
    write_measures(layout, "snippets", known=False)
    uncertainty_table.draw(
        layout, [HALL], str(tmp_path / "t"), {"snippets": "Snippets"}, {"CVM": "one path, no samples"}
    )
    table = pd.read_csv(tmp_path / "t.csv")
    assert set(table["energy score [m]"]) == set(table["real / expected"]) == {"–"}
    assert set(table[table["method"] == "Snippets"]["n"]) == {"0"}
    (dash,) = table[table["method"] == "CVM"].to_dict("records")
    assert (dash["samples"], dash["n"], dash["KDE-NLL [nat]"]) == ("one path, no samples", "–", "–")


def test_calibration_holds_its_bins(layout, tmp_path):
    """All methods and horizons: ten bins of three tracks, twice too sure for the second; probabilities beside them."""
    write_measures(layout, "snippets")
    write_measures(layout, "tc_cliff", factor=2.0)
    calibration.draw(layout, [HALL], str(tmp_path / "f"), METHODS, MEASURED, {"hall": {"day0": "2030-01-01"}})
    table = pd.read_csv(tmp_path / "f.csv")
    assert table.groupby(["what", "method", "horizon_s"]).size().tolist() == [10] * 8
    errors = table[table["what"] == "error"]
    assert set(errors["n"]) == {3}
    for method, factor in (("snippets", 1.0), ("tc_cliff", 2.0)):
        one = errors[errors["method"] == method]
        np.testing.assert_allclose(one["outcome"], factor * one["forecast"], rtol=1e-5)
    left = table[table["what"] == "left"]
    assert set(left["n"]) == {6}
    np.testing.assert_allclose(left["outcome"], 0.5)


def test_calibration_is_as_sure_as_its_days_are_many(layout, tmp_path):
    """Of six days the intervals are those of six clusters, of one day those of the persons."""
    write_measures(layout, "snippets", tracks=600, days=6)
    days = {f"day{n}": f"2030-01-0{n + 1}" for n in range(6)}
    by_day = calibration.bins_of(layout, HALL, ["snippets"], days)
    by_person = calibration.bins_of(layout, HALL, ["snippets"], dict.fromkeys(days, "2030-01-01"))
    same = ["what", "method", "horizon_s", "bin", "forecast", "outcome", "n"]
    pd.testing.assert_frame_equal(by_day[same], by_person[same])
    at = (by_day["what"] == "left") & (by_day["bin"] == 2) & (by_day["horizon_s"] == 4)
    left = np.arange(60, 120) % 2  # ten tracks of each day; who walked on an odd one has left
    for bins, outcome in ((by_day, np.arange(6) % 2), (by_person, left)):
        interval = stats.ttest_1samp(outcome, 0).confidence_interval()
        np.testing.assert_allclose(bins.loc[at, ["low", "high"]].iloc[0], interval)


def test_the_longest_horizon_and_one_near_a_third_are_shown():
    assert calibration.shown_horizons([5, 10, 20, 30, 60], 60) == [20, 60]
    assert calibration.shown_horizons([5, 10, 20], 20) == [5, 20]
    assert calibration.shown_horizons([12.0], 12.0) == [12.0]


@pytest.mark.parametrize("known", [True, False])
def test_calibration_of_one_horizon_or_of_nobody(layout, tmp_path, known):
    """Panels that have nothing to show are left out, or say so."""
    write_measures(layout, "snippets", horizons=[12.0], known=known)
    seen = []
    calibration.style.empty_panel, kept = (lambda ax, text: seen.append(text)), calibration.style.empty_panel
    try:
        calibration.draw(layout, [HALL], str(tmp_path / "f"), METHODS, ["snippets"], {"hall": {"day0": "2030-01-01"}})
    finally:
        calibration.style.empty_panel = kept
    assert seen == ([] if known else ["Hall, 12 s\nno test track is as long"])
