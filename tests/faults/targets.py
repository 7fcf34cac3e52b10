"""All that comes in, as a small good file of each kind and what reads it; `test_fuzz.py` damages them."""

import bz2
import contextlib
import gzip
import hashlib
import io
import json
import logging
import os
import sqlite3
import zipfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import h5py
import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
import torch
import yaml
from PIL import Image
from test_bad_files import GOOD, clean
from test_bad_plans import IMAGES
from test_boundary import DATASET, ROWS
from test_boundary import told as foreseen

import modlhmp
from modlhmp import Live, Site, recordings, storage
from modlhmp.cli import main
from modlhmp.contract import SITE, crowd
from modlhmp.datasets import load_dataset
from modlhmp.exchange.hand_in import read_hand_in, write_hand_in
from modlhmp.exchange.task import make_task
from modlhmp.exchange.tracks import read_tracks_table, tracks_table
from modlhmp.file_format import FileFormat
from modlhmp.floor_plan import load_floor_plan
from modlhmp.forecasting.cvm import forecaster
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.inspection.guess import guess
from modlhmp.live_lines import batches, forecasts, text_of
from modlhmp.networks.training import load_checkpoint, save_checkpoint
from modlhmp.networks.weights import read_weights, write_weights
from modlhmp.options import ConstantVelocity
from modlhmp.readers import read_recording
from modlhmp.study.configuration import load_run
from modlhmp.tracks import read_tracks, write_tracks
from modlhmp.yaml_file import read_yaml

CONFIG = Path(__file__).parents[2] / "config"


class Target(NamedTuple):
    """A good file's name, what writes it at a path and what reads it there; `seal` seals it again once damaged.

    Errors name the file, or `other`, what belongs to it.
    """

    file: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    seal: Callable[[Path], object] = Path.exists
    other: str = "\0"


# --- good files -----------------------------------------------------------------------------------------------------


def text(content: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(content)


def recording(form: str, **described: Any) -> Callable[[Path], object]:
    return lambda path: read_recording(path, FileFormat(reader=form, timezone="UTC", **described))


def packed(path: Path) -> None:
    rows = GOOD["atc_1hz"].encode()
    if path.suffix == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("day.csv", rows)
    else:
        path.write_bytes({".gz": partial(gzip.compress, mtime=0), ".bz2": bz2.compress}[path.suffix](rows))


PREDICTED = "".join(
    json.dumps({"track": {"f": 10 * k, "p": p, "x": 0.5 * k, "y": p}}) + "\n" for p in (1, 2) for k in range(9)
)
TRAJNET = '{"scene": {"id": 0, "p": 1, "s": 0, "e": 80, "fps": 2.5, "tag": 0}}\n' + PREDICTED
MAGNI = "File,THOR\nFrame,Time,Helmet_1 Centroid_X,Helmet_1 Centroid_Y,Helmet_1 Centroid_Z\n" + "".join(
    f"{k},{k / 100},{100 * k},5,{'' if k == 3 else 1700}\n" for k in range(9)
)


def jupedsim(path: Path) -> None:
    path.unlink(missing_ok=True)
    with sqlite3.connect(path) as file:
        file.execute("PRAGMA page_size = 512")
        file.execute("CREATE TABLE trajectory_data (frame INTEGER, id INTEGER, pos_x REAL, pos_y REAL)")
        file.execute("CREATE TABLE metadata (key TEXT, value TEXT)")
        file.execute("INSERT INTO metadata VALUES ('fps', '10')")
        file.executemany(
            "INSERT INTO trajectory_data VALUES (?, ?, ?, ?)", [(k, p, 0.1 * k, p) for p in (1, 2) for k in range(12)]
        )
    file.close()


def hdf5(path: Path) -> None:
    rows = [(p, k, 0.1 * k, p) for p in (1, 2) for k in range(12)]
    with h5py.File(path, "w") as file:
        table = np.array(rows, [("id", "i8"), ("frame", "i8"), ("x", "f8"), ("y", "f8")])
        file.create_dataset("trajectory", data=table).attrs["fps"] = 10.0


def live(path: Path) -> None:
    """What `modlhmp live` does with a file of rows."""
    forecaster = Live("cvm", 5, site=Site(horizon_s=5))
    source = os.open(path, os.O_RDONLY)
    try:
        for t0, futures in forecasts(forecaster, batches(source), 1.0):
            text_of(t0, futures, forecaster, 1, [2.0])
    finally:
        os.close(source)


LIVE = "".join(json.dumps({"t": 1.3e9 + k, "id": p, "x": 1.2 * k, "y": p}) + "\n" for k in range(6) for p in (1, "a"))


@cache
def made(kind: str) -> modlhmp.Map:
    return modlhmp.build_map(kind, crowd(people=30), SITE)


def a_map(kind: str, form: str) -> Callable[[Path], object]:
    """What writes a map by hours, or of one, as one file."""

    def write(path: Path) -> None:
        one = made(kind)
        table = one.hours[7] if one.hours and form != "histogram" else one.whole
        path.unlink(missing_ok=True)
        if form == "parquet":
            one.save(path)
        elif kind == "stef" and form != "histogram":
            modlhmp.Map("stef", SITE, None, {7: table}).save(path.parent / "hours", form=form)
            (path.parent / "hours/07.csv").rename(path)
        else:
            one.save(path, form=form)

    return write


def map_of(form: str | None, **how: Any) -> Callable[[Path], object]:
    return lambda path: modlhmp.load_map(path, form, **({} if form is None else {"site": SITE}), **how)


def seal_parquet(path: Path) -> None:
    """So that what lies behind the seal is reached, as for `seal_text` and `seal_checkpoint`."""
    with contextlib.suppress(OSError, OverflowError):  # too short to have one
        if storage._digest(path)[1]:
            storage._seal(path)


def seal_text(path: Path) -> None:
    content = path.read_bytes()
    start, end = storage._seal_of(content)
    path.write_bytes(storage.sealed(content[:start] + storage._UNSEALED + content[end:]))


def seal_checkpoint(path: Path) -> None:
    content = path.read_bytes()[32:]
    path.write_bytes(hashlib.sha256(content).digest() + content)


WEIGHTS = {"bias": torch.linspace(-1, 1, 5), "weight": torch.arange(6, dtype=torch.float64).reshape(2, 3)}


@cache
def task() -> Any:
    return make_task([("monday", crowd(people=6), None, None)], Site(horizon_s=4), "hall")


def hand_in(form: str) -> Callable[[Path], object]:
    """What writes a hand-in beside a path; `f.json` in `form` "sheet" is the sheet of one as CSV."""

    def write(path: Path) -> None:
        method = forecaster(None, Site(horizon_s=4), ConstantVelocity())
        seeds = list(forecast_recording(crowd(people=6), method, Site(horizon_s=4), ("a", "cvm", "monday"), 1, [0]))
        write_hand_in(path.parent, task(), {"monday": seeds}, "csv" if form == "json" else form)

    return write


def plan(image: bytes) -> Target:
    """A floor plan's image."""

    def write(path: Path) -> None:
        (path.parent / "plan.yaml").write_text(PLAN.format(path.name))
        path.write_bytes(image)

    return Target("plan", write, lambda path: load_floor_plan(path.parent / "plan.yaml"), other="plan.yaml")


PLAN = "image: {}\nresolution: 0.5\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def plan_yaml(path: Path) -> None:
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(path.parent / "a.png")
    path.write_text(PLAN.format("a.png"))


def dataset(path: Path) -> None:
    (path.parent / "a.csv").write_text(ROWS)
    path.write_text(yaml.safe_dump(DATASET))


def read_dataset(path: Path) -> None:
    found = load_dataset(path, path.parent)
    for one in found.recordings:
        recordings.clean(found, one)


RUN = """run: a
datasets: [demo_hall]
compare: [tc_cliff, mine, cvm]
methods: {mine: {kind: episodes, options: {persons: 5, output: medoid}}}
comparisons: [[mine, tc_cliff]]
seeds: [0, 1]
rollout: {k: 5, beta: 1.0}
tables: {horizons_s: [1, 10]}
budgets:
  demo:
    lstm: {windows: 1}
    neural_map: &same {windows: 1}
    social_lstm: *same
    trajectronpp: *same
    mid: *same
    tutr: {windows: 1, modes: 10}
"""


def command(*arguments: str) -> Target:
    """A command line, an argument a line, in a folder with tracks and a map."""

    def write(path: Path) -> None:
        pa_csv.write_csv(tracks_table(crowd(people=4)), path.parent / "a.csv")
        made("cliff").save(path.parent / "m.parquet")
        (path.parent / "f.csv").write_text(
            "track_id,t0,step,x,y\n" + "".join(f"0,1300000005,{k},1,1\n" for k in (1, 2, 3))
        )
        path.write_text("\n".join(arguments))

    return Target("arguments", write, run, other="")


def run(path: Path) -> None:
    """The command, in this process; status 0, or 1 or 2 with a message."""
    given = path.read_bytes().replace(b"\0", b"").decode("utf-8", "surrogateescape").split("\n")
    said = io.StringIO()
    with (
        mock.patch("sys.argv", ["modlhmp", *given]),
        mock.patch("sys.stdin", io.TextIOWrapper(io.BytesIO())),
        contextlib.chdir(path.parent),
        contextlib.redirect_stdout(io.TextIOWrapper(io.BytesIO())),
        contextlib.redirect_stderr(said),
        pytest.raises(SystemExit) as ended,
    ):
        main()
    assert ended.value.code in {0, None} or (ended.value.code in {1, 2, 3} and foreseen(said.getvalue()))


TARGETS = {
    **{
        f"recording, {form}": Target("day.csv", text(content), partial(clean, form=form, cleaning=()))
        for form, content in GOOD.items()
    },
    "recording, cleaned": Target("day.csv", text(GOOD["positions"]), partial(clean, form="positions")),
    "recording, trajnet": Target("day.ndjson", text(TRAJNET), recording("trajnet")),
    "recording, magni": Target("day.csv", text(MAGNI), recording("magni")),
    "recording, jupedsim": Target("day.sqlite", jupedsim, recording("jupedsim")),
    "recording, hdf5": Target("day.h5", hdf5, recording("hdf5")),
    **{
        f"recording, {end}": Target(f"day.csv{end}", packed, partial(clean, form="atc_1hz"))
        for end in (".gz", ".bz2", ".zip")
    },
    "inspect": Target("day.csv", text(GOOD["named"]), guess),
    "inspect, ndjson": Target("day.ndjson", text(TRAJNET), guess),
    "dataset file": Target("own.yaml", dataset, read_dataset, other="a.csv"),
    "configuration": Target(
        "config.yaml", text(RUN), lambda path: load_run(read_yaml(path, "it"), CONFIG / "datasets"),
        other="configuration",
    ),
    "plan, YAML": Target("plan.yaml", plan_yaml, load_floor_plan),
    **{f"plan, {form}": plan(image) for form, image in IMAGES.items()},
    "tracks, CSV": Target(
        "a.csv", lambda path: pa_csv.write_csv(tracks_table(crowd(people=3)), path), read_tracks_table
    ),
    "tracks, Parquet of others": Target(
        "a.parquet", lambda path: pq.write_table(tracks_table(crowd(people=3)), path), read_tracks_table
    ),
    "tracks, Parquet": Target("a.parquet", partial(write_tracks, crowd(people=3)), read_tracks, seal_parquet),
    "map, Parquet": Target("m.parquet", a_map("cliff", "parquet"), map_of(None), seal_parquet),
    **{f"map, {form}": Target("m.csv", a_map("cliff", form), map_of(form)) for form in ("matlab", "online", "nemo")},
    "map, unnamed": Target("m.csv", a_map("cliff", "matlab"), lambda path: modlhmp.load_map(path, site=SITE)),
    "map, XML": Target("m.xml", a_map("cliff", "xml"), map_of("xml")),
    "map, STeF": Target("m.csv", a_map("stef", "stef_csv"), map_of("stef_csv")),
    "map, histogram": Target(
        "m.txt", text("".join(f"{3600 * k},{k},0,-1,2,1,0,0,3\n" for k in range(1, 6))),
        map_of("histogram", x=[0, 2], y=[0, 2], orientations=2),
    ),
    **{
        f"hand-in, {form}": Target(
            f"forecasts.{form}", hand_in(form), lambda path: read_hand_in(path.parent, task()), other="forecasts.json"
        )
        for form in ("csv", "parquet", "ndjson", "json")
    },
    "weights": Target("a.safetensors", lambda path: write_weights(path, WEIGHTS, {"kind": "a"}), read_weights,
                      seal_text),
    "checkpoint": Target(
        "a.checkpoint", lambda path: save_checkpoint(path, {"fingerprint": "a", "weights": WEIGHTS}),
        lambda path: load_checkpoint(path, "a", logging.getLogger("checkpoint")), seal_checkpoint,
    ),
    "JSON": Target("a.json", lambda path: storage.write_json(path, {"a": [1, {"b": "c"}]}), storage.read_json,
                   seal_text),
    "live": Target("rows.jsonl", text(LIVE), live),
    "command, forecast": command("forecast", "--map", "m.parquet", "--tracks", "a.csv", "--horizon", "3", "--best",
                                 "--set", "k=3"),
    "command, info": command("map", "info", "m.parquet", "--timezone", "UTC", "--set", "x=1,2"),
    "command, convert": command("map", "convert", "m.parquet", "-", "--to", "matlab", "--header"),
    "command, kinds": command("kinds", "cliff"),
    "command, live": command("live", "--map", "m.parquet", "--every", "0.5", "--set", "k=3", "--occupancy", "1,2"),
    "command, score": command("score", "f.csv", "--tracks", "a.csv", "--path", "mean", "--time-step", "1"),
}  # fmt: skip
