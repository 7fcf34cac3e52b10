"""Figures of studies: every value or share that was tried is read and drawn once."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from modlhmp.datasets import Dataset
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.storage import write_parquet
from modlhmp.study.exhibits import parameter_study, style, training_share
from modlhmp.study.layout import Layout

HALL = Dataset(name="hall", title="Hall", label="hall", reader="atc", horizon_s=8)
YARD = Dataset(name="yard", title="Yard", label="yard", reader="atc", horizon_s=4, demo=True)
VALUES = {"beta": [10, 0.1, 1], "sampling_radius_m": [0.5, 2]}


def write_errors(path, error_m, steps, tracks=5, recording="day"):
    """An errors file: `error_m` at the first step, one more at each, of every track and two seeds."""
    errors = np.tile(error_m + np.arange(steps, dtype=np.float32), (2 * len(PROTOCOLS) * tracks, 1))
    rows = pd.MultiIndex.from_product(
        [["single"], PROTOCOLS, range(2), range(tracks)], names=["output", "protocol", "seed", "track_id"]
    ).to_frame(index=False)
    table = pa.Table.from_pandas(
        rows.assign(recording=recording, eligible_steps=steps, alive_steps=steps), preserve_index=False
    )
    for name in ("ade", "fde"):
        table = table.append_column(name, pa.FixedSizeListArray.from_arrays(pa.array(errors.ravel()), steps))
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    write_parquet(table, path)


@pytest.fixture
def layout(tmp_path):
    """Studies whose error says what was tried: 100 times the value, or the share."""
    layout = Layout("studies", str(tmp_path))
    for parameter, values in VALUES.items():
        for value in values:
            write_errors(layout.study_value("hall", parameter, value), 100 * value, 8)
    for dataset, steps in ((HALL, 8), (YARD, 4)):
        for method in ("cliff", "episodes"):
            for share in (0.1, 1):
                write_errors(layout.training_share(dataset.name, method, share), 100 * share, steps)
    return layout


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (25, 73, {"30", "50"}),
        (10, 100, {"10", "30", "100"}),
        (60, 71, {"60", "68"}),
        (100, 3000, {"100", "300", "1000"}),
        (1, 1e4, {"1", "100", "10000"}),
        (5, 5, {"5"}),
    ],
)
def test_numbers_on_a_logarithmic_axis_are_written_out(low, high, shown):
    """Two or more in whatever range, of which a few tracks have a small one."""
    fig, axes = style.figure(1, 1)
    axes[0, 0].plot([0, 1], [low, high])
    axes[0, 0].set_yscale("log")
    style.plain_numbers(axes[0, 0].yaxis)
    fig.canvas.draw()
    bottom, top = axes[0, 0].get_ylim()
    ticks = axes[0, 0].yaxis.get_ticklabels(which="both")
    labels = {tick.get_text() for tick in ticks if bottom <= tick.get_position()[1] <= top} - {""}
    assert shown <= labels
    assert all(label == f"{float(label):g}" for label in labels)


def test_every_value_has_its_errors(layout, tmp_path):
    """At the horizons that the dataset has, from the smallest value to the largest."""
    chosen = {"beta": 1, "sampling_radius_m": 1.0}
    parameter_study.draw(layout, HALL, str(tmp_path / "p"), "TC-CLiFF", VALUES, chosen, [2, 5])
    table = pd.read_csv(tmp_path / "p.csv")
    assert set(table["horizon_s"]) == {2, 5}
    for parameter, values in VALUES.items():
        mine = table[(table["parameter"] == parameter) & (table["horizon_s"] == 2) & (table["protocol"] == "paper")]
        assert mine["value"].tolist() == sorted(values)
        np.testing.assert_allclose(mine["ade_m"], 100 * mine["value"] + 1)
    assert (tmp_path / "p.pdf").stat().st_size > 1000


def test_a_single_parameter_is_drawn_alone(layout, tmp_path):
    parameter_study.draw(layout, HALL, str(tmp_path / "p"), "TC-CLiFF", {"beta": [1, 10]}, {"beta": 1}, [5])
    table = pd.read_csv(tmp_path / "p.csv")
    assert set(table["parameter"]) == {"beta"}
    assert set(table["value"]) == {1, 10}


def test_every_share_of_every_method_and_dataset_has_its_errors(layout, tmp_path):
    """Complete protocol only; each dataset at its own horizons."""
    titles = {"cliff": "CLiFF", "episodes": "Episodes"}
    training_share.draw(
        layout, [HALL, YARD], str(tmp_path / "s"), titles, [1, 0.1], {"hall": [2, 4, 8], "yard": [2, 4]}
    )
    table = pd.read_csv(tmp_path / "s.csv")
    assert set(table["protocol"]) == {"complete"}
    last = table.groupby(["dataset", "method"])["horizon_s"].max()
    assert last.to_dict() == {(d, m): s for d, s in (("hall", 8), ("yard", 4)) for m in titles}
    first = table[table["horizon_s"] == 1]
    assert len(first) == 8
    np.testing.assert_allclose(first["ade_m"], 100 * first["share"])


def test_no_two_methods_look_alike():
    looks = [(one["color"], str(one["linestyle"]), one["marker"]) for one in map(style.method_style, range(60))]
    assert len(set(looks)) == len(looks)
    assert len({(colour, marker) for colour, _, marker in looks}) == len(looks), "also without their lines"


@pytest.mark.parametrize("labels", [["a"] * 20, ["Trajectron++, scenes not turned (332.8/1160, 1160)"] * 17, ["LSTM"]])
def test_a_legend_stays_in_its_figure(labels):
    """However many methods there are, and however they are called; the panels keep their room."""
    fig, axes = style.figure(1, 1, height_mm=60.0)
    handles = [style.line_of(number) for number in range(len(labels))]
    style.legend_below(fig, handles, labels, "n at 20 s")
    fig.canvas.draw()
    legend, page = fig.legends[0].get_window_extent(), fig.bbox
    assert legend.x0 >= page.x0 - 1 and legend.x1 <= page.x1 + 1
    assert legend.y0 >= page.y0 - 1
    assert axes[0, 0].get_window_extent().height / fig.dpi * 25.4 > 30
