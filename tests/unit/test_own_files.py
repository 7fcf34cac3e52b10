"""Exhibits read each dataset's own files, also in a run that is called like one of its datasets."""

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from modlhmp.datasets import Dataset
from modlhmp.scoring.protocols import PROTOCOLS
from modlhmp.storage import write_parquet
from modlhmp.study.comparisons import compare
from modlhmp.study.exhibits import claims_table, tables
from modlhmp.study.layout import Layout
from modlhmp.study.summary import at_horizons
from modlhmp.tracks import Tracks, write_tracks

HALL = Dataset(name="demo_hall", title="Hall", label="atc", reader="atc", horizon_s=10)
FORUM = Dataset(name="demo_forum", title="Forum", label="edin", reader="atc", horizon_s=10)
SECONDS = {"demo_hall": 20, "demo_forum": 8}  # of every track
PEOPLE = {"demo_hall": 6, "demo_forum": 9}
RECORDINGS = {"demo_hall": ["monday"], "demo_forum": ["monday", "tuesday"]}
DAYS = {"monday": "2030-01-07", "tuesday": "2030-01-08"}
CONSTANTS = {"cliff_resolution_m": 1.0, "stef_resolution_m": 2.0}
SAMPLED = {"demo_hall": {"sampling_radius_m": "1", "beta": "TC-CLiFF 8, CLiFF 1", "k": "5"}}
SAMPLED["demo_forum"] = {**SAMPLED["demo_hall"], "beta": "–"}


def people(number, seconds):
    """Walkers at 1 m/s, one row per second."""
    ids, t = np.repeat(np.arange(number), seconds), np.tile(np.arange(float(seconds)), number)
    return Tracks(ids, 1.9e9 + t, t, ids.astype(float), np.ones(len(t)), np.zeros(len(t)))


def errors(recordings, number, error_m, horizon=10):
    """An errors table of one method without randomness: `error_m` at every step of every track."""
    rows = [
        {"recording": name, "output": "single", "protocol": protocol, "track_id": track, "seed": 0,
         "eligible_steps": horizon, "alive_steps": horizon,
         "ade": [error_m] * horizon, "fde": [error_m + track / 100] * horizon}
        for name in recordings for protocol in PROTOCOLS for track in range(number)
    ]  # fmt: skip
    table = pa.Table.from_pylist(rows)
    for name in ("ade", "fde"):
        place = table.column_names.index(name)
        table = table.set_column(place, name, table[name].cast(pa.list_(pa.float32(), horizon)))
    return table


@pytest.fixture(params=["demo_hall", "demo_forum", "tracks", "any"])
def layout(tmp_path, request):
    """Two datasets with tracks and errors of two methods, in a run of this name."""
    layout = Layout(request.param, str(tmp_path))
    for name, recordings in RECORDINGS.items():
        for recording in recordings:
            Path(layout.tracks(name, recording)).parent.mkdir(parents=True, exist_ok=True)
            write_tracks(people(PEOPLE[name], SECONDS[name]), layout.tracks(name, recording))
        for method, error_m in (("tc_cliff", 1.0), ("cliff", 2.0)):
            Path(layout.errors(name, method)).parent.mkdir(parents=True, exist_ok=True)
            write_parquet(errors(recordings, PEOPLE[name], error_m), layout.errors(name, method))
        by_method = {one: at_horizons(layout.errors(name, one), [5.0, 10.0], 1.0) for one in ("tc_cliff", "cliff")}
        tests = compare(name, by_method, [("tc_cliff", "cliff")], [5.0, 10.0], DAYS)
        write_parquet(pa.Table.from_pandas(tests, preserve_index=False), layout.ttests(name))
    return layout


def test_parameters_are_of_each_dataset_s_tracks(layout, tmp_path):
    """Tracks of 20 s and 8 s, of which four rows are observed; 6 of them, and 9 on each of two days."""
    tables.draw_parameters(layout, [HALL, FORUM], str(tmp_path / "t"), RECORDINGS, CONSTANTS, SAMPLED)
    table = pd.read_csv(tmp_path / "t.csv").set_index("parameter")
    assert table.loc["usable test tracks"].tolist() == ["6", "18"]
    assert table.loc["90th percentile of their length after t0 [s]"].tolist() == ["16", "4"]
    assert table.loc["kernel parameter β"].tolist() == ["TC-CLiFF 8, CLiFF 1", "–"]


def test_claims_are_about_each_dataset_s_tracks_and_errors(layout):
    """Evidence of one is not mixed with the other's: numbers of tracks, lengths, who was scored."""
    for dataset in (HALL, FORUM):
        name = dataset.name
        one = claims_table.gather(layout, dataset, RECORDINGS[name], ["tc_cliff", "cliff"], {}, [5, 10], False, DAYS)
        expected = {f"{day}/{track}" for day in RECORDINGS[name] for track in range(PEOPLE[name])}
        assert set(one.errors["cliff"]["single", "paper"].keys) == expected
        assert one.lengths.tolist() == [SECONDS[name] - 4] * len(expected)
        assert one.idle == set()
        assert (one.runtime, one.studies) == (None, {})


def test_the_table_of_claims_has_a_row_per_dataset_and_test(layout, tmp_path):
    """Both methods are known, so TC-CLiFF is tested against CLiFF on 6 and on 18 tracks."""
    titles = {"tc_cliff": "TC-CLiFF", "cliff": "CLiFF"}
    # As kinds without ranked futures: what is tested here is where the numbers come from.
    kinds = {"tc_cliff": "cvm", "cliff": "cvm"}
    claims_table.draw(
        layout,
        [HALL, FORUM],
        str(tmp_path / "c"),
        RECORDINGS,
        titles,
        kinds,
        {},
        {name: [5, 10] for name in RECORDINGS},
        [],
        dict.fromkeys(RECORDINGS, DAYS),
    )
    table = pd.read_csv(tmp_path / "c.csv")
    rows = table[table["our test"] == "FDE TC-CLiFF < CLiFF, 10 s"]
    assert dict(zip(rows["dataset"], rows["n"], strict=False)) == {"Hall": 6, "Forum": 18}
