"""The readers on the real ATC day (skipped where it is absent)."""

import dataclasses

import numpy as np
import pytest

from modlhmp.readers import read_recording
from modlhmp.tracks import clock_hours

pytestmark = pytest.mark.real

DAY = "2012-10-24"
FILES = {"train": (470_553, 11_289), "test": (83_513, 2_004)}
WINDOWS = {"atc-20121024-raw-11552300": 1904, "atc-20121024-raw-15325900": 2482}


@pytest.fixture(scope="module")
def dataset(real_data, load_shipped):
    return load_shipped("atc_1day", real_data)


@pytest.fixture(scope="module")
def one_hz(dataset):
    """{split: (Tracks, Account)} of the day's two files."""
    missing = [recording.path for recording in dataset.recordings if not recording.exists]
    if missing:
        pytest.skip(f"{', '.join(missing)}: not there")
    return {r.split: read_recording(r.path, dataset, r.day, r.start) for r in dataset.recordings}


@pytest.mark.parametrize("split", FILES)
def test_every_row_and_track_is_kept(one_hz, split):
    tracks, account = one_hz[split]
    rows, persons = FILES[split]
    assert (account.rows_read, len(tracks.t), len(tracks.bounds()) - 1) == (rows, rows, persons)
    assert dict(account.dropped_rows) == {}
    assert np.isfinite(np.array(tracks[1:])).all()


def test_the_hours_of_the_day(one_hz):
    """Open from 9 to 21 in Japan; hour 12 is lost."""
    hours = {split: set(clock_hours(tracks.t, "Asia/Tokyo").tolist()) for split, (tracks, _) in one_hz.items()}
    assert hours == dict.fromkeys(FILES, set(range(9, 21)) - {12})


def test_no_person_is_in_both_splits(one_hz):
    assert not set(one_hz["train"][0].track_id) & set(one_hz["test"][0].track_id)


@pytest.mark.parametrize(("window", "expected"), WINDOWS.items())
def test_raw_rows_become_the_1_hz_rows(real_data, dataset, one_hz, window, expected):
    """The last sample of each second, value for value; the window's last second is cut short."""
    path = real_data / "atc" / f"{window}.csv"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    tracks, account = read_recording(path, dataclasses.replace(dataset, reader="atc"), DAY)
    assert account.rows_read == len(tracks.t) + account.dropped_rows["downsampled"]
    assert set(account.dropped_rows) == {"downsampled"}
    first, last = int(np.floor(tracks.t.min())), int(np.floor(tracks.t.max()))

    def rows(table):
        """{(person, second): its row} before the window's last second."""
        seconds = np.floor(table.t).astype(int)
        inside = np.flatnonzero((seconds >= first) & (seconds < last))
        keys = zip(table.track_id[inside].tolist(), seconds[inside].tolist(), strict=True)
        return dict(zip(keys, np.column_stack(table[1:])[inside], strict=True))

    ours, theirs = rows(tracks), {}
    for table, _ in one_hz.values():
        theirs |= rows(table)
    persons = {key[0] for key in theirs}
    assert {key for key in ours if key[0] in persons} == set(theirs)
    assert len(theirs) == expected
    keys = list(theirs)
    difference = np.abs(np.array([ours[k] for k in keys]) - np.array([theirs[k] for k in keys]))
    t, x, y, speed, heading = difference.max(axis=0)
    assert t == 0
    assert max(x, y) < 1e-9
    assert speed < 0.0005 + 1e-9  # written with three decimals
    assert heading < 1e-9
