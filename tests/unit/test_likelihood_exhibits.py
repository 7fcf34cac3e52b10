"""Exhibits of likelihood: the tables' cells by hand, what is bold, the panels by hour."""

import dataclasses

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from explored_run import crowd, forecasts
from job import run_job

from modlhmp.datasets import Dataset
from modlhmp.forecasting.files import write_forecasts
from modlhmp.scoring.likelihood import ACCOUNTINGS, PRINTED, SUMMARY
from modlhmp.settings import as_plain
from modlhmp.site import Site
from modlhmp.storage import write_parquet
from modlhmp.study import lacks
from modlhmp.study.exhibits import likelihood_figure, likelihood_given_table, likelihood_table
from modlhmp.study.likelihood import ALL_HOURS, NO_MAP
from modlhmp.tracks import write_tracks

HALL = Dataset(name="hall", title="Hall", label="atc", reader="atc", time_step_s=1.0, horizon_s=12.0, demo=True)
TITLES = {"cliff": "CLiFF"}
NAN = np.nan


def write(layout, name, table):
    write_parquet(pa.Table.from_pandas(table, preserve_index=False), layout.likelihood("hall", name))


@pytest.fixture
def measured(layout):
    """A map that gains 0.5 nat of headings and speeds with its background, and loses 1 where it is charged."""
    rows = []
    for space in ("joint", "heading"):
        for name, gain in ((NO_MAP, 0.0), ("cliff", np.log(2.0))):
            for accounting in (*ACCOUNTINGS, PRINTED):
                won = gain - (1.5 if name == "cliff" and accounting == "charged" else 0.0)
                summary = (2.0 - won, 1.9 - won, 2.1 - won, won, won - 0.1, won + 0.1, 1000, 50)
                rows.append((space, name, accounting, ALL_HOURS, *summary, 0.97, 0.03, 0.05))
            rows += [(space, name, "background", hour, 2.0 - gain, 1.9, 2.1, gain, 0.1, 0.9, 500, 25, 1.0, 0.0, 0.05)
                     for hour in (9, 17)]  # fmt: skip
    columns = ["space", "map", "accounting", "hour", *SUMMARY, "covered", "charged", "weight"]
    scores = pd.DataFrame(rows, columns=columns)
    write(layout, "scores", scores.assign(chosen=np.where(scores["map"] == "cliff", "k 8", "")))
    pairs = pd.DataFrame([(NO_MAP, "cliff", 0.693, 0.5, 0.9, 1000, space) for space in ("joint", "heading")],
                         columns=["map", "against", "difference", "low", "high", "n", "space"])  # fmt: skip
    write(layout, "pairs", pairs)
    return layout


def test_the_table_s_cells_by_hand(measured, tmp_path):
    likelihood_table.draw(measured, [HALL], str(tmp_path / "t"), TITLES, "persons")
    table = pd.read_csv(tmp_path / "t.csv", dtype=str)
    assert table["map"].tolist() == ["no map", "CLiFF (k 8)"] * 2
    assert table["density of"].nunique() == 2
    none, ours = table.iloc[0], table.iloc[1]
    assert (none["NLL"], ours["NLL"]) == ("2.000", "1.307")
    assert (none["gain [nat]"], ours["gain [nat]"]) == ("–", "0.693 [0.593, 0.793]")
    assert ours["gain [bit]"] == "1.000"
    assert (ours["charged"], ours["weight"], ours["covered"], ours["charged rows"]) == (
        "2.807",
        "0.05",
        "97.00%",
        "3.00%",
    )
    text = (tmp_path / "t.md").read_text(encoding="utf-8")
    assert "**1.307**" in text and "**2.807**" not in text and text.count("**2.000**") == 2  # charged: no map is better
    assert "| Hall | headings alone [nat per rad] | CLiFF | 1.307 | 1.307 |" in text  # by hour
    assert "0.693 [0.500, 0.900]" in text
    assert "inferred" in text and "over persons" in text and "Demo data" in text


def test_a_panel_a_space_and_a_line_a_map(measured, tmp_path, figures):
    likelihood_figure.draw(measured, [HALL], str(tmp_path / "f"), TITLES)
    table = pd.read_csv(tmp_path / "f.csv")
    assert table["map"].unique().tolist() == ["cliff"]
    assert table["hour"].tolist() == [9, 17] * 2
    (fig,) = figures
    assert [ax.get_title() for ax in fig.axes] == ["Hall, headings and speeds", "Hall, headings alone"]
    np.testing.assert_allclose(fig.axes[0].lines[0].get_ydata(), np.log(2.0))


def test_without_a_clock_nothing_is_by_hours(measured, tmp_path, figures):
    unknown = dataclasses.replace(HALL, clock="unknown")
    likelihood_table.draw(measured, [unknown], str(tmp_path / "t"), TITLES, "persons")
    text = (tmp_path / "t.md").read_text(encoding="utf-8")
    assert f"headings alone [nat per rad] | {lacks.NO_CLOCK} |" in text and "09 h" not in text
    likelihood_figure.draw(measured, [unknown], str(tmp_path / "f"), TITLES)
    assert pd.read_csv(tmp_path / "f.csv").empty
    assert {one.get_text() for ax in figures[-1].axes for one in ax.texts} == {f"Hall: {lacks.NO_CLOCK}"}


def test_the_table_of_next_velocities_by_hand(layout, tmp_path):
    kinds = [f"{what}_{part}" for part in (0, 1) for what in ("heading_rad", "speed_m_s", "weight")]
    rows = [(NO_MAP, 2.0, 1.9, 2.1, 0.0, NAN, NAN, 100, 50, 0.0, NAN, NAN, 0.005, NAN, NAN, 0.005),
            ("cvm", 1.0, 0.9, 1.1, 1.0, 0.8, 1.2, 100, 50, 1.0, 0.2, 0.1, 0.02, 0.2, 0.1, 0.05)]  # fmt: skip
    write(layout, "given", pd.DataFrame(rows, columns=["method", *SUMMARY, "covered", *kinds]))
    pairs = [(NO_MAP, "cvm", 1.0, 0.8, 1.2, 100)]
    write(layout, "given_pairs", pd.DataFrame(pairs, columns=["map", "against", "difference", "low", "high", "n"]))
    likelihood_given_table.draw(layout, [HALL], str(tmp_path / "t"), {"cvm": "CVM"}, "persons")
    table = pd.read_csv(tmp_path / "t.csv", dtype=str)
    assert table.loc[1].tolist() == [
        *("Hall", "CVM", "1.000", "1.000 [0.800, 1.200]", "1.443", "0.2 rad, 0.1 m/s", "0.02; 0.05", "100.00%", "100"),
    ]
    assert table.loc[0, "method"] == "nothing of the walker"
    assert "**1.000**" in (tmp_path / "t.md").read_text(encoding="utf-8")


def next_velocities(layout, theirs):
    """The job that measures two methods, `ours` and `theirs`, once `theirs` says how its forecasts are written."""
    tracks, file = crowd(), layout.tracks("hall", "day")
    write_tracks(tracks, file)
    for name, seed, facts in (("ours", 5, {}), ("theirs", 0, theirs)):
        write_forecasts(layout.forecast("hall", name, "day"), [(seed, *forecasts(tracks, "snippets"))], **facts)
    params = {"run": layout.run, "made": {}, "methods": ["ours", "theirs"], "samples": 40, "recordings": ["day"],
              "dataset": as_plain(Site(horizon_s=12.0)), "days": {"day": "2030-03-17"}, "seed": 5}  # fmt: skip
    return run_job(
        "measure_given", input={"tracks": [file], "exits": []}, params=params, wildcards={"dataset": "hall"},
        output={name: layout.likelihood("hall", name) for name in ("given", "given_pairs")},
        log={"it": layout.log("measure_given", "hall")},
    )  # fmt: skip


def test_forecasts_from_outside_are_read_by_their_own_seed(layout):
    """Theirs is 0, whatever the run's are: they would count as no forecast at all."""
    done = next_velocities(layout, {"alike": True})
    assert done.returncode == 0, done.stderr
    given = pd.read_parquet(layout.likelihood("hall", "given")).set_index("method")
    assert given.loc["ours", "covered"] == given.loc["theirs", "covered"] == 1


def test_samples_with_probabilities_are_refused(layout):
    """A density of them would count each as often as the others."""
    done = next_velocities(layout, {"alike": False})
    assert done.returncode != 0
    assert "theirs: its samples differ" in done.stderr and "leave it out of `likelihood.given`" in done.stderr
