"""Whether the splits of a dataset are of different people, at one place, as long and when its settings say.

Memory does not grow with the rows: of each recording the outlines of its tracks and the cells are kept.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from modlhmp.file_format import Recording
from modlhmp.plausibility import Finding
from modlhmp.scoring.errors import lengths_counted
from modlhmp.site import Site
from modlhmp.tracks import LATE_STEPS, Tracks, clock_hours, gap_limit

LEAST_ROWS, LEAST_M = 4, 2.0  # of a track that could be told from another one's by its positions
STOP_SHARED = 0.01
STOP_TRAINED, WARN_TRAINED = 0.1, 0.5
CELL_M = 1.0
_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)  # odd, of xxHash


class _Seen(NamedTuple):
    """What is kept of a recording: each track's id, begin, end [s] and a number of its positions; its cells.

    Also the longest time that it can be forecast [s], and its clock hours; none where its day is unknown.
    """

    recording: Recording
    ids: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    walk: np.ndarray
    cells: np.ndarray
    rows_of_cell: np.ndarray
    ahead_s: float
    hours: set[int]


def check_splits(recordings: Iterable[tuple[Recording, Tracks]], site: Site) -> list[Finding]:
    """What looks wrong about the splits of a dataset's clean recordings, which are taken one after the other."""
    seen = [_seen(recording, tracks, site) for recording, tracks in recordings]
    train = [one for one in seen if one.recording.split == "train"]
    test = [one for one in seen if one.recording.split == "test"]
    told = (
        _shared_people(train, test, site), _copied_recording(train), _copied_recording(test),
        _untrained_place(train, test), _horizon(test, site), _hours(train, site),
    )  # fmt: skip
    return [one for one in told if one is not None]


def trained_share(train: Iterable[Tracks], test: Iterable[Tracks]) -> float:
    """The share of test rows in cells of 1 m with training rows; NaN without test rows."""
    return _trained_share(*([_seen(Recording(day=""), one, Site()) for one in split] for split in (train, test)))


def _seen(recording, tracks, site):
    bounds = tracks.bounds()
    first, last = bounds[:-1], bounds[1:] - 1
    cells, rows = np.unique(_cell(tracks.x, tracks.y), return_counts=True)
    ahead_s = float(lengths_counted([tracks], site, "complete").max(initial=0.0))
    hours = set(clock_hours(tracks.t, site.timezone).tolist()) if recording.day and site.hours else set()
    ids, begin, end = tracks.track_id[first], tracks.t[first], tracks.t[last]
    return _Seen(recording, ids, begin, end, _walks(tracks), cells, rows, ahead_s, hours)


def _cell(x, y):
    """A number of each position's cell."""
    east, north = (np.floor(part / CELL_M).astype(np.int64) for part in (x, y))
    return (east << 32) + north


def _walks(tracks):
    """A number of each track's positions in their order; 0 for a track too short to tell it from others."""
    bounds = tracks.bounds()
    if len(bounds) == 1:
        return np.empty(0, np.uint64)
    first, counts = bounds[:-1], np.diff(bounds)
    place = (np.arange(len(tracks.t)) - np.repeat(first, counts)).astype(np.uint64)
    x, y = (np.rint(1000 * part).astype(np.int64).view(np.uint64) for part in (tracks.x, tracks.y))
    mixed = x * _MIX[0] + y * _MIX[1] + place * _MIX[2]
    mixed = (mixed ^ (mixed >> np.uint64(29))) * _MIX[0]
    number = np.add.reduceat(mixed ^ (mixed >> np.uint64(32)), first)
    wide = np.zeros(len(first))
    for part in (tracks.x, tracks.y):
        wide = np.maximum(wide, np.maximum.reduceat(part, first) - np.minimum.reduceat(part, first))
    return np.where((counts >= LEAST_ROWS) & (wide >= LEAST_M), number, 0)


def _shared_people(train, test, site):
    """Test tracks that are in a training recording as well."""
    shared, pairs = 0, []
    for one in test:
        also = np.zeros(len(one.ids), bool)
        for other in train:
            found = (one.walk != 0) & np.isin(one.walk, other.walk)
            day, file = one.recording.day, one.recording.path
            if (day and day == other.recording.day) or (file and file == other.recording.path):
                found |= _goes_on(one, other, gap_limit(site.time_step_s))
            if found.any():
                pairs.append(f"{other.recording.name} and {one.recording.name}")
            also |= found
        shared += int(also.sum())
    total = sum(len(one.ids) for one in test)
    if not shared:
        return None
    told = f"{shared} of {total} test tracks are in the training recordings as well (first: {pairs[0]})"
    remedy = "divide the recordings so that nobody is in both, by `recordings: [{split: ...}]`"
    return Finding("shared_people", "stop" if shared > STOP_SHARED * total else "warn", told, remedy)


def _copied_recording(seen):
    """Recordings of one split that have walks in common, so that the same people would count twice."""
    walks = [np.unique(one.walk[one.walk != 0]) for one in seen]
    counts = [len(one) for one in walks]
    every, whose = np.concatenate([*walks, np.empty(0, np.uint64)]), np.repeat(np.arange(len(seen)), counts)
    order = np.argsort(every, kind="stable")
    again = np.flatnonzero(every[order][1:] == every[order][:-1])
    pairs, common = np.unique(np.stack([whose[order[again]], whose[order[again + 1]]], 1), axis=0, return_counts=True)
    for (first, second), shared in zip(pairs.tolist(), common.tolist(), strict=True):
        of = min(counts[first], counts[second])
        if shared > STOP_SHARED * of:
            names = f"{seen[first].recording.name} and {seen[second].recording.name}"
            told = f"{names} ({seen[first].recording.split}) have the same walks, {shared} of {of}: these count twice"
            remedy = "leave one of them out of `recordings`, or cut the files so that nobody is in both"
            return Finding("copied_recording", "stop" if 2 * shared > of else "warn", told, remedy)
    return None


def _goes_on(one, other, gap_s):
    """Whether a track has the id of one in the other recording that is there within `gap_s` of it."""
    common, mine, theirs = np.intersect1d(one.ids, other.ids, return_indices=True)
    near = (one.begin[mine] <= other.end[theirs] + gap_s) & (other.begin[theirs] <= one.end[mine] + gap_s)
    return np.isin(one.ids, common[near])


def _trained_share(train, test):
    trained = np.unique(np.concatenate([one.cells for one in train])) if train else np.empty(0, np.int64)
    rows = sum(int(one.rows_of_cell.sum()) for one in test)
    known = sum(int(one.rows_of_cell[np.isin(one.cells, trained)].sum()) for one in test)
    return known / rows if rows else float("nan")


def _untrained_place(train, test):
    """How much of the test rows is where somebody trained."""
    share = _trained_share(train, test)
    if not share < WARN_TRAINED:
        return None
    told = f"{share:.0%} of the test rows are in 1 m cells with training rows"
    remedy = "are both of the same place, in the same frame (`units`, `scale`, `origin_m`)? Or train on more recordings"
    return Finding("untrained_place", "stop" if share < STOP_TRAINED else "warn", told, remedy)


def _horizon(test, site):
    """Whether any test track is as long as the longest horizon."""
    step = site.time_step_s
    steps = int(max((one.ahead_s for one in test), default=0.0) / step + LATE_STEPS)
    if not test or steps >= site.steps:
        return None
    if not steps:
        told = f"no test track is long enough to be forecast: more than {site.observed_rows} rows, {step:g} s apart"
        return Finding("horizon", "warn", told, "set fewer `observed_rows`, or test on longer recordings")
    told = f"no test track lasts {site.horizon_s:g} s after what is observed, the longest does {steps * step:g} s"
    return Finding("horizon", "warn", told, f"set `horizon_s: {steps * step:.6g}` or less")


def _hours(train, site):
    """Whether somebody trained in every hour that shall have a map."""
    seen = set().union(*(one.hours for one in train))
    empty = [hour for hour in site.listed_hours or [] if hour not in seen]
    if not empty or not any(one.recording.day for one in train):
        return None
    told = f"nobody trains in {', '.join(map(str, empty))} of `hours`, so these have no map"
    return Finding("hours", "warn", told, "correct `hours`, `timezone` or `start`, or train on more recordings")
