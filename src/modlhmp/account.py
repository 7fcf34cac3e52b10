"""The account of a recording: every row and track read is either kept or dropped under a name."""

from collections import Counter
from typing import Any

import numpy as np

from modlhmp.ids import Owners
from modlhmp.scenes import Scenes
from modlhmp.tracks import Tracks

MOST_UNREAD, LONGEST_UNREAD = 20, 4096  # lines, and characters of one
LEAST_PASSED_S = 10.0  # times that fall back by less may be a recorder's jitter


class Account:
    """Counts of rows and tracks; `add_up` proves that none was lost.

    `beyond` is {distance [m], speed [m/s], heading [rad], time [s]: (how many values no recording can have, the median
    of some of them)}: what tells a wrong unit from a bad row. `unread` are the first lines that could not be read as
    rows. `jumps` are rows to which an id jumped, noted by a reader that leaves out rows between time steps. `scenes`
    are the forecasts that a file asks for itself, None where it does not.
    """

    def __init__(self) -> None:
        self.rows_read = 0
        self.tracks_read = 0
        self.rows_kept = 0
        self.tracks_kept = 0
        self.rows_written = 0
        self.dropped_rows: Counter[str] = Counter()
        self.dropped_tracks: Counter[str] = Counter()
        self.first_seen: dict[str, str] = {}
        self.notes: Counter[str] = Counter()
        self.owners = Owners()
        self.jumps: list[Tracks] = []
        self.scenes: Scenes | None = None
        self.unread: list[str] = []
        self.beyond: dict[str, tuple[int, float]] = {}
        self._falls = self._far_falls = self._id_changes = 0
        self._seen = (np.inf, -np.inf, -np.inf, 0)  # the earliest, the latest and the last time, the last id

    def drop_rows(self, reason: str, count: int, example: str | None = None) -> None:
        """Count `count` rows as dropped for `reason`; `example` is the first row's number and text."""
        if count:
            self.dropped_rows[reason] += int(count)
            if example is not None:
                self.first_seen.setdefault(reason, example)

    def note_unread(self, line: str) -> None:
        """Note a line that could not be read as a row."""
        if len(self.unread) < MOST_UNREAD:
            self.unread.append(line[:LONGEST_UNREAD])

    def note_order(self, track_id: np.ndarray, t: np.ndarray) -> None:
        """Note the ids and times [s] of the file's next rows, in its order: see `starts_anew`."""
        earliest, latest_before, last, last_id = self._seen
        latest = np.maximum.accumulate(np.concatenate([[latest_before], t]))
        late = np.flatnonzero(t < latest[:-1])
        self.notes["rows_out_of_time_order"] += len(late)
        if not len(t):
            return
        earliest = min(earliest, t.min())
        fallen = np.concatenate([[last], t])[late] - t[late]
        self._falls += int((fallen > 0).sum())
        self._far_falls += int((fallen > np.maximum((latest[late] - earliest) / 2, LEAST_PASSED_S)).sum())
        self._id_changes += int((np.diff(track_id) != 0).sum()) + int(track_id[0] != last_id)
        self._seen = float(earliest), float(latest[-1]), float(t[-1]), int(track_id[-1])

    @property
    def starts_anew(self) -> int:
        """How often the times of a file by time fall back by more than half of all that has passed: a file's begin.

        0 in a file by people, where times fall back at many changes of the id.
        """
        return self._far_falls if 4 * self._falls <= self._id_changes else 0

    def note_beyond(self, what: str, values: np.ndarray) -> None:
        """Count values of `what` that lie beyond all that is possible; the median of the first ones is kept."""
        if len(values):
            middle = len(values) // 2  # not the mean of two, which may be beyond all numbers
            count, median = self.beyond.get(what, (0, float(np.partition(values, middle)[middle])))
            self.beyond[what] = count + len(values), median

    def drop_tracks(self, reason: str, tracks: int, rows: int) -> None:
        """Count whole tracks, with the rows they had, as dropped for `reason`."""
        if tracks:
            self.dropped_tracks[reason] += int(tracks)
        if rows:
            self.dropped_rows[reason] += int(rows)

    def as_dict(self) -> dict[str, Any]:
        """The account as plain JSON data; `ValueError` if it does not add up."""
        self.add_up()
        return {
            "rows": {
                "read": self.rows_read,
                "kept": self.rows_kept,
                "dropped": dict(sorted(self.dropped_rows.items())),
            },
            "tracks": {
                "read": self.tracks_read,
                "kept": self.tracks_kept,
                "dropped": dict(sorted(self.dropped_tracks.items())),
            },
            "rows_written": self.rows_written,
            "first_seen": self.first_seen,
            "notes": dict(sorted(self.notes.items())),
        }

    def add_up(self) -> None:
        """Raise `ValueError` unless read = kept + dropped, for rows and for tracks."""
        for kind, read, kept, dropped in (
            ("rows", self.rows_read, self.rows_kept, self.dropped_rows),
            ("tracks", self.tracks_read, self.tracks_kept, self.dropped_tracks),
        ):
            if read != kept + sum(dropped.values()):
                raise ValueError(
                    f"the account does not add up: {read} {kind} read, {kept} kept, dropped {dict(dropped)}"
                )
