"""What there is to know of a recording before a run: people, times, places, speeds, and what is odd about them."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

from modlhmp.cleaning import clean_rows, source_of
from modlhmp.file_format import FileFormat, Recording
from modlhmp.motion import moves
from modlhmp.plausibility import Finding, check_recording
from modlhmp.readers import read_recording
from modlhmp.speed_units import extent_of
from modlhmp.splits import only_of
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks, clock_hours, empty_tracks, usual_step

REUSED_S = 60.0  # an id that pauses for longer is probably another person's


@dataclass(frozen=True)
class Facts:
    """A recording as it was read, and what is left of it; `raw` and `clean` are dropped where many are looked at."""

    recording: Recording
    form: FileFormat
    raw: Tracks
    clean: Tracks
    account: dict[str, Any]
    findings: list[Finding]
    megabytes: float
    fault: str = ""  # why nothing is left, where cleaning stops

    def lines(self) -> list[tuple[str, str]]:
        """What is told of a recording that is on one side, as names and texts."""
        return [*self.of_file(), ("once clean", self.of_side())]

    def of_side(self) -> str:
        """What is left of it once it is clean."""
        tracks = self.clean
        begin, end = (tracks.t.min(), tracks.t.max()) if len(tracks.t) else (0.0, 0.0)
        return (
            f"{len(tracks.bounds()) - 1:,} tracks of {len(tracks.t):,} rows, every {self.form.time_step_s:g} s, "
            f"within {end - begin:,.0f} s"
        )

    def owners(self) -> set[str]:
        """The owner's ids of whom it is left."""
        known = self.account.get("owners", {})
        ids = map(str, self.clean.track_id[self.clean.bounds()[:-1]].tolist())
        return {known[one][0] if one in known else one for one in ids}

    def of_file(self) -> list[tuple[str, str]]:
        """What is told of its file."""
        rows, account = self.raw, self.account
        bounds = rows.bounds()
        same = np.diff(rows.track_id) == 0
        seconds = np.diff(rows.t)[same]
        step, lasting = usual_step(rows), rows.t[bounds[1:] - 1] - rows.t[bounds[:-1]]
        walk = moves(rows, max(1, round(1 / step)) if step > 0 else 1)
        reused = np.unique(rows.track_id[1:][same][seconds > REUSED_S])
        told = [
            ("rows, ids", f"{len(rows.t):,} rows of {len(bounds) - 1:,} ids"),
            ("ids", _kinds_of(account.get("owners", {})) + (
                f"; {len(reused)} pause for more than a minute: probably used again by others" if len(reused) else "")),
            ("time", self._times()),
            ("rate", f"a row every {step:.3g} s ({1 / step:.3g} per second)" if step > 0 else "nobody has two rows"),
            ("tracks last", f"{np.median(lasting):.3g} s in the middle, a tenth {np.quantile(lasting, 0.9):.3g} s or "
             "more" if len(lasting) else "there are none"),
            ("place", f"x {_range(rows.x)} m, y {_range(rows.y)} m, {extent_of(rows):.3g} m at most"),
            ("walking speed", f"{np.median(walk.speed):.2f} m/s in the middle of those who move, half of them "
             f"{np.quantile(walk.speed, 0.25):.2f} to {np.quantile(walk.speed, 0.75):.2f}"
             if len(walk.speed) else "nobody moves"),
            ("gaps", f"{int((seconds > self.form.gap_s).sum()):,} pauses of more than {self.form.gap_s:g} s, "
             f"{account.get('notes', {}).get('cut_at_jump', 0):,} cuts at jumps"),
        ]  # fmt: skip
        dropped = {reason: count for reason, count in account.get("rows", {}).get("dropped", {}).items()
                   if reason not in ("other_split", "other_part")}  # fmt: skip
        if dropped:
            told.append(("dropped", ", ".join(f"{count:,} {reason}" for reason, count in dropped.items())))
        return told

    def _times(self) -> str:
        rows, zone = self.raw, ZoneInfo(self.form.timezone)
        hours = f"{(rows.t.max() - rows.t.min()) / 3600:.3g} h"
        if not self.recording.day:
            return f"{rows.t.min():.6g} to {rows.t.max():.6g} s, {hours}; days and hours are unknown"
        first, last = (datetime.fromtimestamp(float(t), zone) for t in (rows.t.min(), rows.t.max()))
        there = sorted(set(clock_hours(rows.t, self.form.timezone).tolist()))
        return (
            f"{first:%Y-%m-%d %H:%M} to {last:%Y-%m-%d %H:%M}, {self.form.timezone}, {hours}; clock hours "
            + ", ".join(map(str, there))
        )


def of_both_sides(train: Facts, test: Facts) -> list[tuple[str, str]]:
    """What is told of a file that holds both splits: of the file, of each side, and of those on neither or both."""
    told = [*train.of_file(), ("train, once clean", train.of_side()), ("test, once clean", test.of_side())]
    others = train.account.get("tracks", {}).get("dropped", {}).get("other_split", 0)
    neither = others - (len(test.clean.bounds()) - 1)
    chosen = train.recording.chosen
    if chosen is not None and chosen.by == "time" and neither > 0:
        told.append(("on neither side", f"tracks of people who are there when the file is divided: {neither:,}"))
    both = len(train.owners() & test.owners())
    if both:
        told.append(("ids on both sides", f"{both:,}, each in several pieces: are they the same people?"))
    return told


def look_at(path: str | Path, form: FileFormat, recording: Recording, clock: bool) -> Facts:
    """Read, check and clean a recording, whatever its checks say; `DataError` where it cannot be read at all."""
    form = only_of(form, recording)
    source = source_of(path, form, recording)
    raw, account = read_recording(source, form, recording.day, recording.start, recording.days)
    findings = check_recording(raw, account, form, clock)
    stored = [Path(file) for file in recording.people or (recording.stored or path,)]
    megabytes = sum(file.stat().st_size for file in stored if file.is_file()) / 1e6
    try:
        account.tracks_read += 0 if account.tracks_read else len(raw.bounds()) - 1
        clean, plain = clean_rows(source, raw, account, form, recording)
    except DataError as error:
        return Facts(recording, form, raw, empty_tracks(), {}, findings, megabytes, str(error))
    return Facts(recording, form, raw, clean, plain, findings, megabytes)


def _kinds_of(owners):
    """How ids are written; `owners` are those that are no whole numbers, or of a piece of a track."""
    texts = [text for text, piece in owners.values() if piece == 1]
    return f"texts, such as {min(texts)!r}" if texts else "whole numbers"


def _range(values):
    return f"{np.quantile(values, 0.01):.4g} to {np.quantile(values, 0.99):.4g}"
