"""The Edinburgh Informatics Forum's two forms: the owner's raw text, and days of every 4th frame as rows.

B. Majecka, Statistical models of pedestrian behaviour in the Forum, MSc dissertation, University of Edinburgh, 2009.
Positions are pixels (y downwards), times are capture frames, about 9 per second; there is no clock in the files.
"""

import itertools
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.account import Account
from modlhmp.ids import MOST_PEOPLE
from modlhmp.readers.columns import read_columns
from modlhmp.readers.delimited import MAX_DISTANCE_M, read_delimited
from modlhmp.readers.raw import line_blocks
from modlhmp.storage import DataError
from modlhmp.tracks import Tracks

ROWS_LAYOUT = {
    "columns": {"t": 0, "track_id": 1, "x": 2, "y": 3},
    "width": 4,
    "units": {"length": "px", "time": "frame"},
}
MAX_FRAME = 1e7  # twelve days' worth
_TRACK = re.compile(rb"TRACK\.R(\d+)\s*=\s*\[")
_MOST_DIGITS = 19  # of a track's number in 64 bits
_TOTAL = re.compile(rb"Total number of trajectories in file are\s+(\d+)")
_POINTS = re.compile(rb"(?:\s*\[\s*[^\s\[\];]+\s+[^\s\[\];]+\s+[^\s\[\];]+\s*\]\s*(?:;|$))*\s*")
_SPACES = bytes.maketrans(b"[];", b"   ")


def read_rows(
    path: str | Path,
    frame_rate: float,
    row_stride: int,
    scale: float,
    origin: float,
    day: tuple[float, float] | None = None,
) -> tuple[Tracks, Account]:
    """Read a day of rows `frame, track_id, x, y`, each `row_stride` raw frames after the one before.

    The frame column is the track's first raw frame plus the row number, so the true time of a row is
    (first frame + row_stride * rows since) / frame_rate seconds after `origin` (unix time of frame 0). A first row that
    is dropped counts as such if its frame and track can be read. Where the line before a track's first row cannot, it
    may have been its first, so the track has no time: it is dropped (`first_row_lost`). Blank lines are no lines.
    """
    layout = {**ROWS_LAYOUT, "frame_rate": frame_rate, "scale": scale, "origin": origin}
    tracks, account = read_delimited(path, layout, day)
    ids, first, in_doubt = _first_times(path, layout, day)
    whose = np.searchsorted(ids, tracks.track_id)
    first, lost = first[whose], in_doubt[whose]
    tracks = tracks._replace(t=first + row_stride * (tracks.t - first))
    if lost.any():
        example = f"track {tracks.track_id[np.argmax(lost)]}: the line before its first row cannot be read"
        account.first_seen["first_row_lost"] = example
        account.tracks_read = len(tracks.bounds()) - 1
        account.drop_tracks("first_row_lost", len(np.unique(whose[lost])), int(lost.sum()))
        tracks = tracks.take(~lost)
    return tracks, account


def _first_times(
    path: str | Path, layout: Mapping[str, Any], day: tuple[float, float] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tracks of a day of rows, sorted; when each begins by its frame [unix s]; whether the line before is no row."""
    account = Account()
    parts = list(read_columns(path, {**layout, "columns": {"t": 0, "track_id": 1}}, account, {}))
    track, frame, row = (np.concatenate([part[name] for part in parts]) for name in ("track_id", "t", "row"))
    t = frame * (1.0 / layout["frame_rate"]) + layout["origin"]
    low, high = day or (-np.inf, np.inf)
    known = np.isfinite(t)
    unread = np.ones(row.max(initial=0) + 1, bool)  # by line, from 1
    unread[row[known]] = unread[0] = False
    if unread.any():
        lines = (line for block in line_blocks(path) for line in block.removesuffix(b"\n").split(b"\n"))
        for number, line in enumerate(itertools.islice(lines, len(unread) - 1), 1):
            if not line.strip():  # as the line before it
                unread[number] = unread[number - 1]
    known &= (t >= low) & (t < high)
    order = np.lexsort((t[known], track[known]))
    ids, starts = np.unique(track[known][order], return_index=True)
    begins = order[starts]
    return ids, t[known][begins], unread[row[known][begins] - 1]


def read_raw(path: str | Path, frame_rate: float, scale: float, origin: float) -> tuple[Tracks, Account]:
    """Read the owner's `TRACK.Rn=[[x y frame];...]` text; returns (Tracks, Account), headings unknown.

    Points with a frame not later than an earlier one are dropped (`frame_not_increasing`), as are points that are
    not three numbers (`text_value`). `DataError` if the file holds fewer tracks than it announces.
    """
    account, pieces, announced, seen = Account(), [], None, set()
    line_number = described = 0
    limits = np.array([MAX_DISTANCE_M / scale, MAX_DISTANCE_M / scale, MAX_FRAME])
    for block in line_blocks(path):
        for line in block.removesuffix(b"\n").split(b"\n"):
            line_number += 1
            described += b"Properties.R" in line
            if total := _TOTAL.search(line):
                if len(total[1]) > _MOST_DIGITS:
                    raise DataError(
                        f"{path}, line {line_number}: announces a number of {len(total[1])} digits of tracks"
                    )
                announced = int(total[1])
            elif b"TRACK.R" in line:
                piece = _track(path, line, line_number, limits, account)
                if piece is not None and piece[0] in seen:
                    account.drop_tracks("repeated_track_id", 1, len(piece[1]))
                elif piece is not None:
                    seen.add(piece[0])
                    pieces.append(piece)
    if announced is None and not account.tracks_read:
        raise DataError(f"{path}: no line `TRACK.Rn=[[x y frame];...]`: is `reader: edinburgh` right for this file?")
    announced = described if announced is None else announced
    if announced and announced != account.tracks_read:
        raise DataError(
            f"{path}: announces {announced} tracks but holds {account.tracks_read}: "
            "the file was cut off; fetch it again"
        )
    if not pieces:
        raise DataError(f"{path}: no usable point; {account.rows_read} read, dropped {dict(account.dropped_rows)}")
    pieces.sort(key=lambda piece: piece[0])
    track_id = np.repeat([track for track, _ in pieces], [len(points) for _, points in pieces])
    x, y, frame = np.concatenate([points for _, points in pieces]).T
    unknown = np.full(len(x), np.nan)
    return Tracks(track_id, origin + frame / frame_rate, x * scale, y * scale, unknown, unknown), account


def _track(path, line, number, limits, account):
    """One TRACK line to (id, points [n, 3] px px frame); None if it holds no usable point."""
    whole = line.strip().removesuffix(b";").rstrip()  # not by a pattern, whose time would be quadratic in blanks
    match = _TRACK.match(whole)
    if not match or not whole.endswith(b"]") or len(whole) <= match.end():
        raise DataError(
            f"{path}, line {number}: {line[:60].decode(errors='replace')!r} is not a whole TRACK line: "
            "the file is cut off or damaged"
        )
    account.tracks_read += 1
    if account.tracks_read > MOST_PEOPLE:
        raise DataError(f"{path}, line {number}: more than {MOST_PEOPLE:,} tracks; divide the file")
    body = whole[match.end() : -1]
    regular = _POINTS.fullmatch(body) is not None
    if regular:
        try:
            points = np.array(body.translate(_SPACES).split(), float).reshape(-1, 3)
            regular = bool((np.abs(points) < limits).all())
        except ValueError:
            regular = False
    account.rows_read += len(points) if regular else 0
    if not regular:
        points = _point_by_point(body, number, limits, account)
    later = points[1:, 2] > points[:-1, 2]
    if not later.all():
        later = points[1:, 2] > np.maximum.accumulate(points[:, 2])[:-1]
        account.drop_rows("frame_not_increasing", (~later).sum(), f"line {number}")
        points = points[np.concatenate([[True], later])]
    if not len(points):
        account.drop_tracks("no_usable_point", 1, 0)
        return None
    if len(match[1].lstrip(b"0")) > _MOST_DIGITS or int(match[1]) >= 2**63:
        raise DataError(f"{path}, line {number}: track number {match[1][:30].decode()} does not fit 64 bits")
    return int(match[1]), points


def _point_by_point(body, number, limits, account):
    points = []
    for text in body.split(b";"):
        account.rows_read += 1
        fields = text.translate(_SPACES).split()
        try:
            point = [float(field) for field in fields]
            if len(point) != 3:
                account.drop_rows("wrong_column_count", 1, f"line {number}: {text[:60].decode(errors='replace')!r}")
            elif np.isinf(point).any():
                account.drop_rows("infinite_value", 1, f"line {number}: {text[:60].decode(errors='replace')!r}")
            elif np.isnan(point).any():
                account.drop_rows("nan_value", 1, f"line {number}: {text[:60].decode(errors='replace')!r}")
            elif (np.abs(point) >= limits).any():
                account.drop_rows("absurd_value", 1, f"line {number}: {text[:60].decode(errors='replace')!r}")
            else:
                points.append(point)
        except ValueError:
            account.drop_rows("text_value", 1, f"line {number}: {text[:60].decode(errors='replace')!r}")
    return np.array(points, float).reshape(-1, 3)
