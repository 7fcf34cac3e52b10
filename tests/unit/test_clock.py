"""Clock times of a place: as Python's zones give them; what a change of the clocks skips or repeats is asked about."""

from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modlhmp.clock import local_time, midnight, unix_time
from modlhmp.storage import DataError

BERLIN = "Europe/Berlin"
moments = st.datetimes(datetime(1995, 1, 1), datetime(2037, 1, 1), timezones=st.just(timezone.utc))


@given(moments, st.sampled_from([BERLIN, "Asia/Tokyo", "America/New_York", "Australia/Lord_Howe", "UTC"]))
def test_a_local_time_is_the_moment_or_said_to_be_two(moment, zone):
    there = moment.astimezone(ZoneInfo(zone))
    other = there.replace(fold=1 - there.fold)
    if there.utcoffset() == other.utcoffset():
        assert local_time(there.replace(tzinfo=None, fold=0), zone) == pytest.approx(moment.timestamp(), abs=1e-6)
    else:
        with pytest.raises(DataError, match="exists twice"):
            local_time(there.replace(tzinfo=None, fold=0), zone)
    assert unix_time(there.isoformat(), "UTC") == pytest.approx(moment.timestamp(), abs=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2026-03-29T02:30", r"does not exist.*\(\+01:00 or \+02:00\)"),
        ("2026-10-25 02:30", r"exists twice.*\(\+02:00 or \+01:00\)"),
    ],
)
def test_what_a_change_of_the_clocks_skips_or_repeats_is_asked_about(text, message):
    with pytest.raises(DataError, match=message):
        unix_time(text, BERLIN)


@pytest.mark.parametrize("text", ["", "noon", "2026-02-30T09:00", "09:00", "2026-03-02T25:00", "1772442000"])
def test_other_texts_are_no_times(text):
    assert unix_time(text, BERLIN) is None


def test_days_of_23_and_25_hours():
    for day, hours in ((datetime(2026, 3, 29), 23), (datetime(2026, 10, 25), 25), (datetime(2026, 6, 1), 24)):
        assert midnight(day, BERLIN, 1) - midnight(day, BERLIN) == timedelta(hours=hours).total_seconds()
