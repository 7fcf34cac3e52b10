"""Which unit, rate or scale would make people walk as fast as people do: what a wrong speed is answered with."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from modlhmp.file_format import LENGTH_M, FileFormat
from modlhmp.readers.delimited import SECONDS
from modlhmp.tracks import Tracks

USUAL_MPS = 1.3  # R. L. Bohannon, Age and Ageing 26, 1997: comfortable gait of adults, 1.27 to 1.46 m/s
WALKING_MPS = (0.8, 1.8)  # what an explanation must give
RATES = (1, 2, 2.5, 3, 5, 6, 7.5, 9, 10, 12, 12.5, 15, 16, 20, 24, 25, 30, 50, 60, 100, 120)
_COMMON = (2.5, 10, 15, 25, 30)  # preferred among rates that explain as well
_NEARER = 0.15  # by how much, in the logarithm of the speed
EXTENT_M = (2.0, 2000.0)  # of places where people are recorded
FOOT_M = 0.3048
_LONGER = {"minutes": 60.0, "hours": 3600.0, "days": 86_400.0}  # as spreadsheets count times
MOST = 3  # explanations that a message lists


class Explanation(NamedTuple):
    """An option that would mend a speed: its text, its factors on speeds and on lengths, its handicap."""

    option: str
    speed: float
    length: float = 1.0
    handicap: float = 0.0
    is_option: bool = True

    def __str__(self) -> str:
        return f"`{self.option}`" if self.is_option else self.option


def explain(measured: float, rows: Tracks, form: FileFormat, clock: bool) -> str:
    """The options that would make `measured` [m/s] a walking speed, likeliest first; empty where none would.

    `rows` are as read with `form`; `clock`: their times are unix times of the file, so the unit of time is right.
    """
    extent = extent_of(rows)
    if np.abs(rows.x).max() <= 180 and np.abs(rows.y).max() <= 90 and measured < 1e-3 and form.units.length == "m":
        return "are x and y degrees of longitude and latitude? Project them to metres first"
    found = [
        (not EXTENT_M[0] <= extent * one.length <= EXTENT_M[1], abs(np.log(implied / USUAL_MPS)) + one.handicap, one)
        for one in _candidates(measured, rows, form, clock)
        if WALKING_MPS[0] <= (implied := measured * one.speed) <= WALKING_MPS[1]
    ]
    found.sort(key=lambda entry: entry[:2])
    told = [f"{one} would give {measured * one.speed:.2g} m/s" for _, _, one in found[:MOST]]
    if form.units.time == "frame" and form.frame_rate == 25 and 2 < measured < 3:
        told.append("the public biwi_eth.txt, read at 25 frames per second, is 1.67 times too fast: it has 15")
    return ", ".join(told)


def extent_of(rows: Tracks) -> float:
    """The longer side of where people are [m], without the outermost 1 % on each side."""
    sides = [np.quantile(part, 0.99) - np.quantile(part, 0.01) for part in (rows.x, rows.y)]
    return float(max(sides))


def _candidates(measured: float, rows: Tracks, form: FileFormat, clock: bool) -> Iterator[Explanation]:
    table, units = form.reader in ("delimited", "text"), form.units
    if form.reader in ("atc", "atc_1hz"):
        other, factor = ("atc_1hz", 1000.0) if form.reader == "atc" else ("atc", 0.001)
        yield Explanation(f"reader: {other}", factor, factor)
    if table and form.homography is None:
        yield from _of_length(measured, form)
    if form.scale is not None:
        scale = form.scale * USUAL_MPS / measured
        yield Explanation(f"scale: {scale:.2g}", scale / form.scale, scale / form.scale, 0.3)
    if form.reader == "edinburgh_rows" and form.row_stride:
        for stride in range(1, 13):
            yield Explanation(f"row_stride: {stride}", form.row_stride / stride, 1.0, 0.2)
    if form.frame_rate is not None:
        for rate in RATES:
            yield Explanation(f"frame_rate: {rate:g}", rate / form.frame_rate, 1.0, -_NEARER * (rate in _COMMON))
    if table and units.time in SECONDS and not clock:
        yield from _of_time(rows, form)


def _of_length(measured: float, form: FileFormat) -> Iterator[Explanation]:
    metres = form.metres
    for unit, other in LENGTH_M.items():
        if unit != form.units.length:
            yield Explanation(f"units: {{length: {unit}}}", other / metres, other / metres)
    if form.units.length == "m" and 0.005 < USUAL_MPS / measured < 0.1:  # metres that a pixel may have
        scale = USUAL_MPS / measured
        yield Explanation(f"units: {{length: px}}, scale: {scale:.2g}", scale, scale, 0.3)
    if form.units.length == "m":
        yield Explanation(f"units: {{length: px}}, scale: {FOOT_M}", FOOT_M, FOOT_M, 0.2)


def _of_time(rows: Tracks, form: FileFormat) -> Iterator[Explanation]:
    seconds = SECONDS[form.units.time]
    for unit, other in SECONDS.items():
        if unit != form.units.time:
            yield Explanation(f"units: {{time: {unit}}}", seconds / other)
    for name, per in _LONGER.items():
        told = f"times in seconds (they look like {name}, for which there is no unit: rewrite the column)"
        yield Explanation(told, seconds / per, is_option=False)
    steps = np.diff(rows.t)[np.diff(rows.track_id) == 0] / seconds
    if len(steps) and np.abs(steps - np.rint(steps)).max() < 1e-3:  # whole numbers may count frames
        for rate in RATES[1:]:
            handicap = 0.1 - _NEARER * (rate in _COMMON)
            yield Explanation(f"units: {{time: frame}}, frame_rate: {rate:g}", seconds * rate, 1.0, handicap)


def rate_for(per_frame: float) -> float | None:
    """The frame rate [1/s] at which `per_frame` [m] is a walking speed, usual rates preferred; None where none is."""
    fitting = [rate for rate in RATES if WALKING_MPS[0] <= per_frame * rate <= WALKING_MPS[1]]
    if not fitting:
        return None
    handicap = {rate: -_NEARER * (rate in _COMMON) for rate in fitting}
    return float(min(fitting, key=lambda rate: abs(np.log(per_frame * rate / USUAL_MPS)) + handicap[rate]))
