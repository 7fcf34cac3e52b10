"""Clock times of a place: as Python's zones give them; what a change of the clocks skips or repeats is asked about."""

from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modlhmp.clock import local_time, midnight, start_time, unix_time
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


@pytest.mark.parametrize(
    "text",
    [
        "", "noon", "2026-02-30T09:00", "09:00", "2026-03-02T25:00", "1772442000", "1772442000123", "2026-03-02T",
        "2026-03-02 09:00:00 AM", "2026-03-02 09:00:60", "2026-03-02 23:58:60Z", "2026-03-02T09:00+25:00",
        "2026-03-0209:00", "2026-0302", "2026-03-02T09:0030", "2026-03-02T09:00:00.", "٢٠٢٦-03-02",
    ],
)  # fmt: skip
def test_other_texts_are_no_times(text):
    assert unix_time(text, BERLIN) is None


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        (f"2026-03-02{mark}{clock}{zone}", 1772438400 + more)
        for mark in "T "
        for clock, more in (
            ("09", 0), ("09:00", 0), ("09:00:00.5", 0.5), ("09:00:00,25", 0.25), ("0900", 0), ("090000.123", 0.123),
            ("09:00:00.123456789", 0.123456789),
        )
        for zone in ("+01:00", "+01", "+0100", "+01:00:00", " +01:00")
    ]
    + [(f"2026-03-02T08:00:00.5{zone}", 1772438400.5) for zone in ("Z", "z", " UTC", "-00:00")]
    + [("20260302T090000+0100", 1772438400), ("2026-03-02", 1772406000), ("2026-03-02T02:30-05:30", 1772438400)]
    + [("2016-12-31T23:59:60.5Z", 1483228800.5), ("2017-01-01T00:59:60", 1483228800)],
)  # fmt: skip
def test_times_as_they_are_written(text, seconds):
    """The same in every version of Python; a leap second is the next day's first, as unix times have it."""
    assert unix_time(text, BERLIN) == pytest.approx(seconds, abs=3e-7)


@given(moments, st.sampled_from(["seconds", "milliseconds", "microseconds"]))
def test_a_fraction_is_as_exact_as_a_number_can_be(moment, timespec):
    text = moment.isoformat(timespec=timespec)
    assert unix_time(text, BERLIN) == datetime.fromisoformat(text).timestamp()


@pytest.mark.parametrize("start", ["09:00", "09:00:00", "09:00+01:00"])
def test_a_start_is_a_clock_time_of_its_day(start):
    assert start_time(datetime(2026, 3, 2), start, "Europe/Stockholm") == 1772438400


@pytest.mark.parametrize("start", ["09:00:00.5", "09:00:00,5", "09:00:00.500+01:00"])
def test_a_start_may_have_parts_of_a_second(start):
    assert start_time(datetime(2026, 3, 2), start, "Europe/Stockholm") == 1772438400.5


@pytest.mark.parametrize("start", ["09:00-11:00", "09:00+05:00", "09:00+02:00"])
def test_a_start_has_an_offset_that_its_zone_has(start):
    """09:00-11:00 is a span of time, and no place of this zone has that offset."""
    with pytest.raises(DataError, match=r"Europe/Stockholm is \+01:00 then"):
        start_time(datetime(2026, 3, 2), start, "Europe/Stockholm")
    assert start_time(datetime(2026, 3, 28), "09:00+02:00", "Europe/Stockholm"), "clocks are put forward the next day"


@pytest.mark.parametrize("start", ["9:00", "09", "0900", "09:00Z", "09:00.5", "09:00:00.", "noon", "24:00", 9, None])
def test_other_starts_are_no_clock_times(start):
    assert start_time(datetime(2026, 3, 2), start, BERLIN) is None


def test_days_of_23_and_25_hours():
    for day, hours in ((datetime(2026, 3, 29), 23), (datetime(2026, 10, 25), 25), (datetime(2026, 6, 1), 24)):
        assert midnight(day, BERLIN, 1) - midnight(day, BERLIN) == timedelta(hours=hours).total_seconds()
