"""Readers: one recording file in, rows in SI units and the account of every row out."""

from datetime import datetime, time, timedelta
from zoneinfo import ZoneInfo

from modlhmp.readers import atc, edinburgh
from modlhmp.readers.delimited import read_delimited


def read_recording(path, dataset, recording):
    """Read `path` with the dataset's reader; returns (Tracks in the file's own sampling, Account).

    `recording` says the `day` (ISO date) and, where the file has no clock, at what local time it `start`s.
    """
    day, origin = _day_and_origin(dataset["timezone"], recording)
    reader = dataset["reader"]
    if reader == "edinburgh":
        return edinburgh.read_raw(path, dataset["frame_rate"], dataset["scale"], origin)
    if reader == "edinburgh_rows":
        return edinburgh.read_rows(path, dataset["frame_rate"], dataset["row_stride"], dataset["scale"], origin, day)
    layout = {"atc": atc.RAW_LAYOUT, "atc_1hz": atc.ONE_HZ_LAYOUT}.get(reader) or {
        key: dataset[key]
        for key in ("columns", "separator", "header", "units", "scale", "frame_rate")
        if dataset.get(key) is not None
    }
    return read_delimited(path, {**layout, "origin": origin}, day, dataset["time_step_s"])


def _day_and_origin(timezone, recording):
    """((first, last) unix second of the day, unix time of the file's time 0)."""
    zone = ZoneInfo(timezone)
    date = datetime.fromisoformat(recording["day"])
    midnight = date.replace(tzinfo=zone)
    day = midnight.timestamp(), (date + timedelta(days=1)).replace(tzinfo=zone).timestamp()
    if recording.get("start") is None:
        return day, 0.0
    return day, datetime.combine(date, time.fromisoformat(recording["start"]), zone).timestamp()
