"""A small run that an explorer can be made of: a hall of made-up people and a yard of recorded ones, the same walks."""

import dataclasses

import numpy as np
import pandas as pd

from modlhmp.datasets import Dataset
from modlhmp.forecasting.base import Forecast
from modlhmp.forecasting.files import write_forecasts
from modlhmp.maps.base import DAY
from modlhmp.methods import build_map
from modlhmp.scoring.recording import score_recording
from modlhmp.storage import write_parquet, write_text
from modlhmp.study.csv_cells import csv_text
from modlhmp.study.explorer import page
from modlhmp.study.summary import read_errors, summarise
from modlhmp.tracks import Tracks, write_tracks

HALL = Dataset(
    name="hall", title="Hall", label="hall", reader="atc", demo=True, time_step_s=1.0, horizon_s=12.0,
    citation="made up", terms="free",
)  # fmt: skip
YARD = dataclasses.replace(HALL, name="yard", title="Yard", label="yard", demo=False)
METHODS = {"tc_cliff": "TC-CLiFF", "snippets": "Snippets", "cvm": "CVM"}
MAPS = ["cliff", "tc_cliff", "stef"]
RECORDINGS = {"train": ["monday"], "test": ["tuesday"]}
LONE_Y = 20.0  # where one person walks alone, up and down, so that a map has enough of their rows


def crowd(number=24, rows=18, seed=0):
    """People on two ways, east along y = 0, north along x = 8, half of them at 9:00 UTC, half at 10:00; one alone."""
    rng = np.random.default_rng(seed)
    parts, step = [], np.arange(rows)
    for person in range(1, number + 1):
        along, aside = 1.2 * step + rng.uniform(-3, 0), rng.normal(0, 0.3, rows)
        x, y = (along, aside) if person % 2 else (8 + aside, along - 6)
        parts.append((person, 3600.0 * (9 + (person > number / 2)) + 60 * person + step, x, y))
    parts.append(
        (number + 1, 3600.0 * 9 + np.arange(3 * rows), 4 + np.sin(np.arange(3 * rows)), np.full(3 * rows, LONE_Y))
    )
    tables = []
    for person, t, x, y in parts:
        vx, vy = np.gradient(x), np.gradient(y)
        heading = np.arctan2(vy, vx) + rng.normal(0, 0.05, len(x))
        tables.append((np.full(len(x), person), 1.9e9 // 86400 * 86400 + t, x, y, np.hypot(vx, vy), heading))
    return Tracks(*map(np.concatenate, zip(*tables, strict=True)))


def forecasts(tracks, method):
    """Of every person: three ranked futures, fourteen samples behind a median, or one path; some end early."""
    first = tracks.bounds()[:-1]
    ids, at_t0, steps = tracks.track_id[first], first + HALL.observed_rows - 1, np.arange(1, HALL.steps + 1)
    k, output = {"tc_cliff": (3, "ranked"), "snippets": (15, "median"), "cvm": (1, "single")}[method]
    way = np.stack([tracks.x[at_t0] - tracks.x[at_t0 - 1], tracks.y[at_t0] - tracks.y[at_t0 - 1]], axis=-1)
    turn = np.linspace(-0.4, 0.4, k) if k > 1 else np.zeros(1)
    turned = np.stack([way[:, :1] * np.cos(turn) - way[:, 1:] * np.sin(turn),
                       way[:, :1] * np.sin(turn) + way[:, 1:] * np.cos(turn)], axis=-1)  # fmt: skip
    start = np.stack([tracks.x[at_t0], tracks.y[at_t0]], axis=-1)
    xy = (start[:, None, None] + turned[:, :, None] * steps[:, None]).astype(np.float32)
    fitness = np.broadcast_to(-np.abs(turn)[:, None] * steps, xy.shape[:3]).astype(np.float32)
    alive = np.full(xy.shape[:2], HALL.steps, np.int32)
    alive[:, k // 2 + 1 :] -= 3
    return ids, Forecast(xy, fitness, alive, output)


def make_run(layout, datasets=(HALL, YARD), maps=MAPS, number=24):
    """Everything that the explorer of these datasets reads, of so many people and one more."""
    tables = []
    for dataset in datasets:
        training, tested = crowd(number), crowd(number, seed=1)
        write_tracks(training, layout.tracks(dataset.name, "monday"))
        write_tracks(tested, layout.tracks(dataset.name, "tuesday"))
        for kind in maps:
            whole, hours = build_map(kind, training, dataset, None)
            path = layout.map(dataset.name, kind)
            if whole is not None:
                write_parquet(whole, f"{path}/{DAY}" if hours else path)
            for hour, table in hours.items():
                write_parquet(table, layout.map_hour(dataset.name, kind, hour))
        for method in METHODS:
            ids, forecast = forecasts(tested, method)
            write_forecasts(layout.forecast(dataset.name, method, "tuesday"), [(0, ids, forecast)])
            errors = layout.errors(dataset.name, method)
            write_parquet(score_recording(tested, [(0, ids, forecast)], "tuesday", dataset), errors)
            tables.append(summarise(dataset.name, method, read_errors(errors), dataset.time_step_s))
    write_text(layout.scores, csv_text(pd.concat(tables)))


def make_page(layout, datasets=(HALL, YARD), tracks=("hall",), maps=MAPS, number=24):
    """The explorer of such a run; returns its path."""
    make_run(layout, datasets, maps, number)
    return draw_page(layout, datasets, tracks, maps)


def draw_page(layout, datasets=(HALL, YARD), tracks=("hall",), maps=MAPS):
    """The explorer of a run that is made; returns its path."""
    stem = layout.exhibit("explorer")
    recordings = {one.name: RECORDINGS for one in datasets}
    page.draw(layout, list(datasets), stem, METHODS, maps, tracks, recordings, "")
    return f"{stem}.html"
