"""The field's short table: planted walkers whose errors are known, forecasts told too much, what cannot be in it."""

import dataclasses

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from modlhmp.datasets import load_dataset
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.methods import make_forecaster
from modlhmp.options import ConstantVelocity
from modlhmp.recordings import clean
from modlhmp.scoring.recording import score_recording
from modlhmp.scoring.uncertainty import score_samples
from modlhmp.storage import write_parquet
from modlhmp.study import lacks
from modlhmp.study.csv_cells import original
from modlhmp.study.exhibits import EXHIBITS, short_table
from modlhmp.study.published import SHORT

FORUM = """
title: Forum
reader: edinburgh_rows
timezone: Europe/London
recordings:
  - {{files: train.csv, day: 2031-03-02, start: "09:00", split: train}}
{tests}
frame_rate: 9.0
row_stride: 4
scale: 0.025
time_step_s: 0.1
accept: [time_step, extent]
observed_rows: 31
forecast_every_s: 1
horizon_s: {horizon_s}
velocity: differences
difference_weights: [1.0]
citation: made up by a test
terms: free
"""
DAYS = 6
HORIZONS = [0.5, 1.0, 1.5, 2.0]
OFFSETS_M = np.array([0.1, 0.2, 0.6])  # of three samples from the path that comes true, of a walker who walks straight
EXPECTED, AT_ROWS = "expected ADE / FDE [m]", "at recorded rows: expected ADE / FDE [m]"


def forum(folder, people, horizon_s=2):
    """The dataset of people [(x [px], y [px]) at every row]: on each of its days the same ways, a pixel further up."""
    days = [f"0{3 + day}" for day in range(DAYS)]
    entry = '  - {{files: test{0}.csv, day: 2031-03-{0}, start: "09:00", split: test}}'
    tests = "\n".join(entry.format(day) for day in days)
    for up, name in enumerate(("train", *(f"test{day}" for day in days))):
        rows = [
            f"{100 * person + row},{person},{x},{y + up}"
            for person, path in enumerate(people, 1)
            for row, (x, y) in enumerate(zip(*path, strict=True))
        ]
        (folder / f"{name}.csv").write_text("\n".join(rows) + "\n")
    (folder / "forum.yaml").write_text(FORUM.format(tests=tests, horizon_s=horizon_s))
    return load_dataset(folder / "forum.yaml", folder)


def straight(rows, step=20):
    """Who walks along x, `step` px a row."""
    return 50 + step * np.arange(rows), np.full(rows, 100)


def beside(dataset):
    """A forecaster of three samples, each a path at constant velocity moved aside by one of `OFFSETS_M`."""
    line = make_forecaster("cvm", ConstantVelocity(velocity="differences"), dataset, None, None)

    def forecast(observed, steps, keys):
        path = line(observed, steps, keys[:, :1])
        xy = np.repeat(path.xy, len(OFFSETS_M), axis=1)
        xy[..., 1] += OFFSETS_M[:, None].astype(np.float32)
        alive = np.full(xy.shape[:2], steps, np.int32)
        return Forecast(xy, np.zeros(xy.shape[:3], np.float32), alive, "ranked")

    return forecast


def measure(layout, dataset, seeds=(0, 1)):
    """Files of errors of both methods, and of the second one's samples."""
    line = make_forecaster("cvm", ConstantVelocity(velocity="differences"), dataset, None, None)
    for method, forecaster, k in (("cvm", line, 1), ("beside", beside(dataset), 3)):
        errors, samples = [], []
        for one in dataset.of_split("test"):
            tracks, key = clean(dataset, one), (dataset.name, method, one.name)
            made = list(forecast_recording(tracks, forecaster, dataset, key, k, seeds))
            errors.append(score_recording(tracks, made, one.name, dataset).to_pandas())
            samples.append(score_samples(tracks, made, one.name, dataset, HORIZONS).to_pandas())
        for path, parts, meta in (
            (layout.errors(dataset.name, method), errors, {}),
            (layout.uncertainty(dataset.name, method), samples, {"horizons_s": HORIZONS}),
        ):
            write_parquet(as_table(pd.concat(parts, ignore_index=True)), path, **meta)


def as_table(rows):
    """The form of the files: lists of a fixed size."""
    columns = {}
    for name, values in rows.items():
        if isinstance(values.iloc[0], np.ndarray):
            columns[name] = pa.FixedSizeListArray.from_arrays(np.concatenate(values.to_numpy()), len(values.iloc[0]))
        else:
            columns[name] = pa.array(values)
    return pa.table(columns)


def drawn(layout, datasets, reference="cvm"):
    """The table's rows of ours and of others, and its Markdown."""
    methods = {"cvm": "CVM", "beside": "Beside"}
    days = {one.name: one.days("test") for one in datasets}
    stem = layout.exhibit("tab_short")
    short_table.draw(layout, datasets, stem, methods, ["beside"], reference, ["forum"], days)
    table = pd.read_csv(f"{stem}.csv", dtype=str, keep_default_na=False).map(original)
    ours = len(table) - len(SHORT)
    with open(f"{stem}.md", encoding="utf-8") as file:
        return table[:ours].set_index("method"), table[ours:], file.read()


def test_who_walks_straight_is_forecast_without_error(layout, tmp_path):
    """Constant velocity has none; three samples beside it have the mean of what they are off; n is counted by hand."""
    dataset = forum(tmp_path, [straight(28), straight(14, 24)])  # 12.0 s and 5.8 s long
    measure(layout, dataset)
    ours, published, text = drawn(layout, [dataset])
    starts = [3, 4, 5, 6, 7, 8, 9, 10], [3]  # seconds after the first row, with 2 s to come
    n = DAYS * sum(map(len, starts))
    assert set(ours["n"]) == {str(n)}
    assert ours.loc["CVM", EXPECTED] == "0.000 [0.000, 0.000] / 0.000 [0.000, 0.000]"
    off = OFFSETS_M.mean()
    assert ours.loc["Beside", EXPECTED] == " / ".join([f"{off:.3f} [{off:.3f}, {off:.3f}]"] * 2)
    assert ours.loc["Beside", short_table.AGAINST] == f"{off:+.3f} [{off:+.3f}, {off:+.3f}]"
    assert ours.loc["Beside", "best of 5: ADE / FDE [m]"] == "0.100 / 0.100"
    assert ours.loc["Beside", "samples"] == "3.0"
    assert set(ours.loc["CVM", ["samples", "best of 5: ADE / FDE [m]"]]) == {"–"}
    assert set(ours["covered"]) == {"100.00%"}
    assert set(ours["at recorded rows: n"]) == {str(DAYS * 2)}  # 4 and 8 s: whole numbers of 4/9 s
    assert "2.25 rows per second interpolated to 10 Hz" in text
    assert "our split" in text
    cliff = published.set_index("method").loc["CLiFF-LHMP"]
    assert (cliff["samples"], cliff[EXPECTED]) == ("64", "0.554 / 1.119")
    assert cliff["n"] == "–"


def test_interpolation_tells_what_comes(layout, tmp_path):
    """People who turn at every row: what is known only at recorded rows is worse than what lies on a line ahead."""
    rng = np.random.default_rng(1)
    turning = [
        (300 + np.cumsum(rng.choice([-18, 18], 40)), 300 + np.cumsum(rng.choice([-18, 18], 40))) for _ in range(20)
    ]
    dataset = forum(tmp_path, turning)
    measure(layout, dataset, seeds=(0,))
    ours, _, _ = drawn(layout, [dataset])
    told, at_rows = (float(ours.loc["CVM", name].split()[0]) for name in (EXPECTED, AT_ROWS))
    assert at_rows > 1.05 * told


def test_expected_errors_equal_the_loop(layout, tmp_path):
    """Mean over seeds of a forecast, then over forecasts; paired with constant velocity forecast by forecast."""
    rng = np.random.default_rng(2)
    people = [(50 + np.cumsum(rng.integers(5, 25, 30)), 100 + np.cumsum(rng.integers(-9, 9, 30))) for _ in range(4)]
    dataset = forum(tmp_path, people)
    measure(layout, dataset)
    whole = {}
    for row in pd.read_parquet(layout.uncertainty("forum", "beside")).to_dict("records"):
        if np.isfinite(ade := row["mean_ade_m"][-1]):
            whole.setdefault((row["recording"], row["track_id"], row["t0"]), []).append(ade)
    expected = np.mean([np.mean(values) for values in whole.values()])
    ours, _, _ = drawn(layout, [dataset])
    assert float(ours.loc["Beside", EXPECTED].split()[0]) == pytest.approx(expected, abs=6e-4)
    line = float(ours.loc["CVM", EXPECTED].split()[0])
    less = float(ours.loc["Beside", short_table.AGAINST].split()[0])
    assert less == pytest.approx(expected - line, abs=1.2e-3)


def test_what_cannot_be_in_it_has_its_reason(layout, tmp_path):
    """A dataset of other steps; a horizon that nobody reaches."""
    dataset = forum(tmp_path, [straight(10)])  # 4.0 s: one second after t0
    measure(layout, dataset)
    other = dataclasses.replace(dataset, name="hall", title="Hall", time_step_s=1.0)
    ours, _, text = drawn(layout, [dataset, other])
    assert ours.loc["CVM", EXPECTED] == f"– ({lacks.NOT_AS_LONG})"
    assert ours.loc["CVM", "n"] == "0"
    assert ours.loc[str(lacks.NOT_SHORT), "dataset"] == "Hall"
    assert f"| Hall | {lacks.NOT_SHORT} | – |" in text


def test_without_constant_velocity_nothing_is_compared(layout, tmp_path):
    dataset = forum(tmp_path, [straight(28)])
    measure(layout, dataset)
    ours, _, text = drawn(layout, [dataset], reference=None)
    assert set(ours[short_table.AGAINST]) == {"–"}
    assert "that of no compared method" in text


def test_it_is_made_of_such_datasets_alone():
    """The demo, at steps of 1 s, has no such table."""
    from test_exhibits import plan_of  # noqa: PLC0415

    (record,) = (one for one in EXHIBITS if one.name == "tab_short")
    assert not record.made_in(plan_of())
    plan = plan_of(datasets=["edinburgh_short", "demo_hall"], compare=["cliff", "cvm"], run="short")
    assert record.made_in(plan)
    asks = record.asks(plan, list(plan.datasets.values()))
    assert (asks["short"], asks["reference"]) == (["edinburgh_short"], "cvm")
    assert not record.made_in(plan_of(datasets=["edinburgh_short"], run="short", tables={"horizons_s": [1.0]}))
