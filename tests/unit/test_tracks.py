"""The track table: clocks, bounds, files."""

from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from modlhmp.ids import id_of
from modlhmp.storage import VERSION, DataError, read_metadata, write_parquet
from modlhmp.tracks import (
    COLUMNS,
    Tracks,
    clock_hours,
    clock_offsets,
    concatenate,
    empty_tracks,
    read_tracks,
    together,
    write_tracks,
)
from modlhmp.version import __version__


def test_tracks_are_shown_by_how_many_when_and_where():
    """Not by their numbers; a position that is unknown is left out, and what is no table is shown as it is."""
    of = some_tracks([1, 1, 2])._replace(
        t=np.array([0.1 + 0.2, 1.0, 722.4000000000001]), x=np.array([0, np.nan, 20.04]), y=np.array([0.2, 1, 2.94])
    )
    assert repr(of) == str(of) == "Tracks(2 people, 3 rows, t 0.3 to 722.4 s, x 0.0 to 20.0 m, y 0.2 to 2.9 m)"
    assert repr(empty_tracks()) == "Tracks(0 people, 0 rows)"
    assert "nobody" in repr(of._replace(x="nobody"))
    assert len(of) == 6 and of == of._replace()  # a tuple of its columns still


def some_tracks(ids, seed=0):
    rng = np.random.default_rng(seed)
    n = len(ids)
    return Tracks(np.array(ids, np.int64), 1.3e9 + np.arange(n), *rng.normal(size=(3, n)), rng.uniform(-3, 3, n))


# --- clocks -------------------------------------------------------------------------------------------------

ZONES = ["Asia/Tokyo", "Europe/London", "Asia/Kolkata", "Asia/Kathmandu", "America/St_Johns",
         "Australia/Lord_Howe", "America/New_York", "UTC"]  # fmt: skip
CHANGES = [  # zone, a day on which its clock is set forward or back
    ("Europe/London", "2010-03-28"),
    ("Europe/London", "2010-10-31"),
    ("America/New_York", "2012-03-11"),
    ("America/New_York", "2012-11-04"),
    ("Australia/Lord_Howe", "2012-10-07"),  # by half an hour
    ("America/St_Johns", "2010-11-07"),  # at 00:01
]


def expected_clock(times, zone):
    local = [datetime.fromtimestamp(float(t), ZoneInfo(zone)) for t in times]
    return [d.hour for d in local], [d.utcoffset().total_seconds() for d in local]


@pytest.mark.parametrize("zone", ZONES)
@given(times=st.lists(st.floats(0, 1.9e9), min_size=1, max_size=20))
def test_clock_agrees_with_datetime(zone, times):
    hours, offsets = expected_clock(times, zone)
    assert clock_hours(times, zone).tolist() == hours
    assert clock_offsets(times, zone).tolist() == offsets


@pytest.mark.parametrize(("zone", "day"), CHANGES)
def test_clock_follows_a_change_of_summer_time(zone, day):
    midnight = datetime.fromisoformat(day).replace(tzinfo=timezone.utc)
    times = (midnight - timedelta(hours=14)).timestamp() + np.arange(0, 40 * 3600, 60.0)
    hours, offsets = expected_clock(times, zone)
    assert len(set(offsets)) == 2, "the day has no change: the test is wrong"
    assert clock_hours(times, zone).tolist() == hours
    assert clock_offsets(times, zone).tolist() == offsets


def test_an_hour_begins_at_its_first_instant():
    nine = datetime(2010, 7, 1, 9, tzinfo=ZoneInfo("Asia/Kolkata")).timestamp()
    assert clock_hours([nine - 0.001, nine, nine + 3599.999, nine + 3600], "Asia/Kolkata").tolist() == [8, 9, 9, 10]


def test_clocks_of_no_times_and_of_tables():
    assert clock_hours([], "Asia/Tokyo").shape == (0,)
    assert clock_offsets(np.zeros((2, 3)), "Asia/Tokyo").shape == (2, 3)


# --- tables -------------------------------------------------------------------------------------------------


@given(st.lists(st.integers(1, 4), max_size=6))
def test_bounds_are_the_tracks_first_rows(lengths):
    ids = np.repeat(np.arange(len(lengths)) * 10, lengths)
    assert some_tracks(ids).bounds().tolist() == np.cumsum([0, *lengths]).tolist()


def test_take_by_mask_and_by_index():
    tracks = some_tracks([1, 1, 2, 2])
    assert tracks.take(tracks.track_id == 2).t.tolist() == tracks.t[2:].tolist()
    assert tracks.take(np.array([3, 0])).x.tolist() == [tracks.x[3], tracks.x[0]]


def test_those_who_are_there_at_a_time():
    """One who has left, one who is there, one who comes that instant, one who comes later; the file may hold none."""
    t = np.array([0.0, 1, 2, 1, 2, 3, 4, 3, 4, 5, 6])
    table = Tracks(np.array([1, 1, 1, 2, 2, 2, 2, 3, 3, 4, 4]), t, *np.zeros((4, len(t))))
    seen = table.seen_by(3.0)
    assert seen.track_id.tolist() == [2, 2, 2, 3] and seen.t.tolist() == [1, 2, 3, 3]
    assert table.seen_by(3.0, rows=3).track_id.tolist() == [2, 2, 2]
    assert len(table.seen_by(-1.0).t) == len(table.seen_by(7.0).t) == len(empty_tracks().seen_by(0.0).t) == 0


def test_concatenate_keeps_order_and_types():
    one, two = some_tracks([1, 1]), some_tracks([5], seed=1)
    both = concatenate([one, empty_tracks(), two])
    assert both.track_id.tolist() == [1, 1, 5]
    assert both.y.tolist() == [*one.y, *two.y]
    assert [column.dtype for column in both] == [np.dtype(kind) for kind in COLUMNS.values()]


def test_concatenate_nothing_is_an_empty_table():
    assert [len(column) for column in concatenate(iter([]))] == [0] * 6


# --- files --------------------------------------------------------------------------------------------------


def test_parquet_round_trip_with_provenance(tmp_path):
    tracks = some_tracks([3, 3, 7])
    tracks.speed[0] = tracks.heading[0] = np.nan
    path = tmp_path / "new" / "day.parquet"
    write_tracks(tracks, path, dataset="hall", sources={"day.csv": "ab12"}, seed=None)
    again = read_tracks(path)
    for name, before, after in zip(COLUMNS, tracks, again, strict=True):
        np.testing.assert_array_equal(before, after, err_msg=name)
        assert after.dtype == COLUMNS[name]
    written = {"dataset": "hall", "sources": {"day.csv": "ab12"}, "seed": None}
    assert read_metadata(path) == {VERSION: __version__, **written}
    assert [file.name for file in path.parent.iterdir()] == ["day.parquet"], "a temporary file was left"


def test_empty_table_round_trip(tmp_path):
    write_tracks(empty_tracks(), tmp_path / "none.parquet")
    assert [column.dtype for column in read_tracks(tmp_path / "none.parquet")] == list(COLUMNS.values())


def test_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "day.parquet"
    write_tracks(some_tracks([1]), path)
    before = path.read_bytes()
    with pytest.raises(TypeError):
        write_tracks(some_tracks([2]), path, note=object())
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["day.parquet"]


def test_a_foreign_file_is_named(tmp_path):
    path = tmp_path / "foreign.parquet"
    write_parquet({"track_id": [1], "t": [0.0], "x": [0.0]}, path)
    with pytest.raises(DataError, match=r"foreign\.parquet: no column y, speed, heading"):
        read_tracks(path)


def test_metadata_of_a_file_without_provenance_is_empty(tmp_path):
    pq.write_table(pa.table({"a": [1]}), tmp_path / "plain.parquet")
    assert read_metadata(tmp_path / "plain.parquet") == {}


@pytest.mark.parametrize("content", [None, b"", b"PAR1 but nothing more", b"\x00" * 200])
def test_missing_or_damaged_parquet_says_what_to_do(tmp_path, content):
    path = tmp_path / "day.parquet"
    if content is not None:
        path.write_bytes(content)
    said = "no such file.* run the workflow" if content is None else "cannot be read as Parquet.* make it"
    with pytest.raises(DataError, match=rf"day\.parquet: {said} again"):
        read_tracks(path)


def test_ids_of_several_recordings_are_kept_apart_however_large():
    """Plain ids keep their distances; those of texts are near 2^63, where sums would run over."""
    t = np.arange(3.0)

    def people(*ids):
        unknown = np.full(3 * len(ids), np.nan)
        columns = (np.tile(t, len(ids)), unknown, unknown, unknown, unknown)
        return Tracks(np.repeat(np.array(sorted(ids), np.int64), 3), *columns)

    plain = together([people(10, 12), people(10, 11)])
    assert plain.track_id[::3].tolist() == [0, 2, 3, 4]
    large = [id_of(text) for text in ("a", "b", "c")]
    mixed = together([people(1, 2), people(*large), people(*large, 7), people(5)])
    assert len(set(mixed.track_id.tolist())) == 2 + 3 + 4 + 1
    assert len(mixed.bounds()) - 1 == 10


@pytest.mark.parametrize("ids", [[2, 2, 1, 1], [1, 2, 1, 2]])
def test_tracks_that_are_not_sorted_are_refused(tmp_path, ids):
    write_tracks(some_tracks(ids), tmp_path / "a.parquet")
    with pytest.raises(DataError, match=r"a\.parquet, row 3: track 1 at 1300000002 s comes after track 2 .*sort by"):
        read_tracks(tmp_path / "a.parquet")


@pytest.mark.parametrize("step", [0.0, -3.0])
def test_times_that_do_not_grow_are_refused(tmp_path, step):
    tracks = some_tracks([5, 5, 5, 7])
    tracks.t[2] = tracks.t[1] + step
    write_tracks(tracks, tmp_path / "a.parquet")
    with pytest.raises(DataError, match=r"a\.parquet, row 3: track 5 at .* comes after track 5"):
        read_tracks(tmp_path / "a.parquet")


@pytest.mark.parametrize("name", ["t", "x", "y"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_place_or_time_that_is_none_is_refused(tmp_path, name, value):
    tracks = some_tracks([5, 5, 7])
    getattr(tracks, name)[1] = value
    write_tracks(tracks, tmp_path / "a.parquet")
    with pytest.raises(DataError, match=rf"a\.parquet, row 2: {name} (nan|inf)"):
        read_tracks(tmp_path / "a.parquet")


def test_speeds_and_headings_may_be_unknown(tmp_path):
    tracks = some_tracks([5, 5, 7])
    tracks.speed[:] = tracks.heading[:] = np.nan
    write_tracks(tracks, tmp_path / "a.parquet")
    assert np.isnan(read_tracks(tmp_path / "a.parquet").speed).all()
