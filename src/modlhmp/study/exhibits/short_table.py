"""Table tab_short: expected errors 2.0 s ahead at ten positions per second (not in the paper)."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.scoring.ttests import MeanTest, mean_test, paired_test
from modlhmp.scoring.uncertainty import BEST_OF, SAMPLES
from modlhmp.storage import column, read_metadata, read_parquet
from modlhmp.study import lacks
from modlhmp.study.comparisons import clusters
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.exhibits.words import OVER
from modlhmp.study.layout import Layout
from modlhmp.study.published import AHEAD_S, SHORT, STEP_S
from modlhmp.study.summary import ErrorsByOutput, at_horizons, keys_of, main_output

AGAINST = "expected ADE against constant velocity [m]"
EXPECTED = ("mean_ade_m", "mean_fde_m", "best_ade_m", "best_fde_m", "samples")
NOTE = (
    "Mean ADE / FDE in m up to 2.0 s, over all forecasts, complete protocol. Expected: the mean over a forecast's "
    "samples, of the first {most} those that are still there, or the error of the one path of a method without; in "
    f"brackets the 95 % interval, {OVER}. Against constant velocity: the paired difference of expected ADE from that "
    "of {reference}. One path: of the method's own output. Covered: of the forecasts, those that stay on the map for "
    "2.0 s. At recorded rows: only forecasts whose t0 is a row of the file. At all others the position at t0 lies on "
    "the line to a row that is recorded later, so that every method is told where the person is going next. Published: "
    "another split; whether its positions were interpolated likewise is not known."
)
SPLIT = (
    "{title}: our split; {rate:.2f} rows per second interpolated to 10 Hz; a forecast of each track every {every:g} s."
)


def draw(
    layout: Layout,
    datasets: Sequence[Dataset],
    stem: str,
    methods: Mapping[str, str],
    measured: Sequence[str],
    reference: str | None,
    short: Sequence[str],
    days: Mapping[str, Mapping[str, str]],
) -> None:
    """One row per dataset and method, then the published ones.

    `methods` maps the compared ones' names to titles, of which `measured` have scores of their samples and `reference`
    is the constant velocity; `short` are the datasets that have forecasts of 2 s at steps of 0.1 s; `days` maps
    datasets to their test recordings' days.
    """
    rows: list[dict[str, str]] = []
    for one in datasets:
        if one.name not in short:
            rows.append({"dataset": one.title, "method": str(lacks.NOT_SHORT)})
            continue
        errors = {name: at_horizons(layout.errors(one.name, name), [AHEAD_S], one.time_step_s) for name in methods}
        samples = {name: layout.uncertainty(one.name, name) for name in measured}
        found = {name: forecasts_of(errors[name], samples.get(name), one) for name in methods}
        for name, title in methods.items():
            against = found[reference] if reference not in (None, name) else None
            cells = _cells(found[name], against, errors[name], days[one.name])
            rows.append({"dataset": one.title, "method": title} | cells)
    for title, (number, ade, fde) in SHORT.items():
        cell = {"expected ADE / FDE [m]": f"{ade:.3f} / {fde:.3f}", "samples": str(number)}
        rows.append({"dataset": "Edinburgh, published", "method": title} | cell)
    splits = [
        SPLIT.format(title=one.title, rate=1 / period, every=one.forecast_every_s)
        for one in datasets
        if one.forecast_every_s and (period := row_period_s(one))
    ]
    note = " ".join([*splits, NOTE.format(reference=methods.get(reference or "", "no compared method"), most=SAMPLES)])
    table = pd.DataFrame(rows).fillna("–")
    write_table(table, stem, "2.0 s at 10 Hz", any(one.demo for one in datasets), note)


def row_period_s(dataset: Dataset) -> float | None:
    """Seconds between two rows of a dataset's files, where its format says that all are evenly apart; else None."""
    if dataset.reader != "edinburgh_rows" or dataset.row_stride is None or dataset.frame_rate is None:
        return None
    return dataset.row_stride / dataset.frame_rate


def forecasts_of(errors: ErrorsByOutput, samples: str | None, dataset: Dataset) -> pd.DataFrame:
    """What is known of each forecast of 2.0 s by one method: one row each, by (recording, track, t0), seeds averaged.

    `samples` is the file of its `uncertainty.MEASURES`, None where there is none: then the expected error is that of
    its one path, or the mean of its futures, NaN for a method that has neither. Columns: `person`; `EXPECTED`, of which
    the first two are the expected ADE and FDE; `ade_m`, `fde_m` of the method's own output [m]; `at_row`: whether t0 is
    known to be a recorded row.
    """
    output = main_output({output for output, _ in errors})
    own = errors[output, "complete"]
    found = pd.DataFrame(
        {"person": own.person, "ade_m": own.by_track("ade")[:, 0], "fde_m": own.by_track("fde")[:, 0]}, index=own.keys
    )
    if samples is not None:
        found = found.join(_of_samples(samples))
    else:
        like = errors.get(("mean", "complete"), own if output == "single" else None)
        for name, metric in (("mean_ade_m", "ade"), ("mean_fde_m", "fde")):
            found[name] = np.nan if like is None else like.by_track(metric)[:, 0]
    found = found.reindex(columns=["person", *EXPECTED, "ade_m", "fde_m"])
    found["at_row"] = _at_row(found.index, dataset)
    return found[np.isfinite(found["ade_m"])]


def _of_samples(path: str) -> pd.DataFrame:
    """`EXPECTED` by key, as `summary.Errors` has them, means over seeds."""
    table, place = read_parquet(path), read_metadata(path)["horizons_s"].index(AHEAD_S)
    rows = table.select([name for name in ("recording", "track_id", "t0") if name in table.column_names]).to_pandas()
    width = len(read_metadata(path)["horizons_s"])
    values = {name: column(table, name).reshape(-1, width)[:, place].astype(float) for name in EXPECTED}
    return pd.DataFrame(values).groupby(keys_of(rows).to_numpy()).mean()


def _at_row(keys: pd.Index, dataset: Dataset) -> np.ndarray:
    """Whether each forecast's t0 is known to be a recorded row, [n]."""
    period = row_period_s(dataset)
    if period is None or dataset.forecast_every_s is None:
        return np.zeros(len(keys), bool)
    track, _, t0 = zip(*(key.rpartition("@") for key in keys), strict=True)
    at = pd.Series(t0).astype(float)
    since = at - at.groupby(np.array(track)).transform("min") + (dataset.observed_rows - 1) * dataset.time_step_s
    return (np.abs(since / period - np.rint(since / period)) < 1e-3).to_numpy()


def _cells(
    one: pd.DataFrame, reference: pd.DataFrame | None, errors: ErrorsByOutput, days: Mapping[str, str]
) -> dict[str, str]:
    """A method's cells."""
    if one.empty:
        return {"expected ADE / FDE [m]": f"– ({lacks.NOT_AS_LONG})", "n": "0"}
    means = one.drop(columns="person").astype(float).mean()
    over = clusters(one["person"].to_numpy(str), days)
    ade, fde = (mean_test(one[name].to_numpy(), over) for name in EXPECTED[:2])
    cells = {"expected ADE / FDE [m]": f"{_interval(ade)} / {_interval(fde)}", AGAINST: "–"}
    if reference is not None:
        theirs = reference["mean_ade_m"].reindex(one.index)
        less = paired_test(one["mean_ade_m"].to_numpy(), theirs.to_numpy(), over)
        cells[AGAINST] = _interval(less, "+.3f")
    paper, steps = errors[main_output({output for output, _ in errors}), "paper"], round(AHEAD_S / STEP_S)
    cells |= {
        "samples": _number(means["samples"], ".1f"),
        f"best of {BEST_OF}: ADE / FDE [m]": _pair(means, "best_ade_m", "best_fde_m"),
        "one path: ADE / FDE [m]": _pair(means, "ade_m", "fde_m"),
        "covered": f"{np.isfinite(paper.ade).sum(axis=1).mean() / (paper.eligible_steps >= steps).sum():.2%}",
        "n": str(len(one)),
    }
    rows = one[one["at_row"]]
    at_rows = _pair(rows[list(EXPECTED[:2])].mean(), *EXPECTED[:2])
    return cells | {"at recorded rows: expected ADE / FDE [m]": at_rows, "at recorded rows: n": str(len(rows))}


def _interval(test: MeanTest, form: str = ".3f") -> str:
    """A mean with its interval, if it has one."""
    reach = f" [{test.low:{form}}, {test.high:{form}}]" if np.isfinite(test.low) else ""
    return _number(test.mean, form) + reach


def _pair(values: pd.Series, *names: str) -> str:
    """`ADE / FDE`, or a dash."""
    return " / ".join(map(_number, values[list(names)])) if np.isfinite(values[list(names)]).all() else "–"


def _number(value: float, form: str = ".3f") -> str:
    return f"{value:{form}}" if np.isfinite(value) else "–"
