"""Cleaning: named rules that remove whole tracks.

The rules of the Edinburgh recordings are B. Majecka's (see the paper, Sec. IV-A); every rule counts what it drops.
"""

import logging
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from modlhmp.account import Account
from modlhmp.file_format import FileFormat, Recording
from modlhmp.ids import id_of
from modlhmp.plausibility import ask_about, check_recording, step_of
from modlhmp.readers import read_recording
from modlhmp.readers.raw import People
from modlhmp.scenes import of_pieces
from modlhmp.settings import unknown
from modlhmp.splits import BLOCK_S, FOLDS, in_part, in_split, only_of
from modlhmp.storage import DataError
from modlhmp.time_step import interpolate, jumped
from modlhmp.tracks import Tracks, concatenate, laid_out, usual_step, whole_ids

# Reasons for which readers drop a row that should have been somebody's position at a time.
FAULTS = (
    "text_value", "nan_value", "infinite_value", "absurd_value", "wrong_column_count", "no_track_id", "first_row_lost",
)  # fmt: skip
# Reasons that may be right: `no_person` by its id, and a time that `days` may have left out.
OTHERS = {"no_person": "nobody's by their id and dropped", "outside_day": "of another day and dropped"}
BORDER = 1e-9  # a point this near to an edge lies on it, in the polygon's units


def clean_recording(path: str | Path | People, form: FileFormat, recording: Recording) -> tuple[Tracks, dict[str, Any]]:
    """Read a recording, apply the cleaning rules in their order, and resample it at the time step.

    Returns (Tracks at `time_step_s`, account as a dict of JSON data that adds up). Where ids are no plain numbers, the
    account's `owners` are {track id: [owner's id, which piece of that track]} (`modlhmp.ids`); where pieces are one
    person, `persons` are {track id of a later piece: that of the first}; where the file asks for forecasts itself,
    `scenes` are these, of people who are left (`Scenes.plain`). `DataError` where a check of `modlhmp.plausibility`
    stops; `warnings` of the account are what others warn of, if any do.
    """
    form = only_of(form, recording)
    path = source_of(path, form, recording)
    rows, account = read_recording(path, form, recording.day, recording.start, recording.days)
    clock = bool(recording.day) and recording.start is None
    warnings = ask_about(path, check_recording(rows, account, form, clock), form)
    tracks, plain = clean_rows(path, rows, account, form, recording)
    return tracks, {**plain, **({"warnings": warnings} if warnings else {})}


def tell_of_faults(source: object, account: Mapping[str, Any]) -> None:
    """Warn of the rows of `source` that are dropped unasked: how many of all, and the first of each kind."""
    rows, first = account["rows"], account["first_seen"]
    checks = {one.partition(":")[0] for one in account.get("warnings", ())}  # which have told of their rows
    for reasons, told in ((FAULTS, "faulty and dropped"), *(((one,), told) for one, told in OTHERS.items())):
        found = {one: count for one, count in rows["dropped"].items() if one in reasons and one not in checks}
        kinds = (
            f"{n} {reason}" + (f" (first: {first[reason]})" if reason in first else "") for reason, n in found.items()
        )
        if found:
            logging.getLogger("modlhmp").warning(
                "%s: %d of %d rows are %s: %s", source, sum(found.values()), rows["read"], told, ", ".join(kinds)
            )


def source_of(path: str | Path | People, form: FileFormat, recording: Recording) -> str | Path | People:
    """What a recording is read from: its file, or those of all its people."""
    if not recording.people:
        return path
    separator = " " if form.reader == "text" else form.separator
    read = [*(form.columns.given().values() if form.columns else ()), *form.only, *form.without]
    names = tuple(one for one in read if isinstance(one, str)) if form.header else ()
    return People(recording.people, separator, form.header, form.skip_lines, form.comment_mark, names)


def clean_rows(
    path: str | Path | People, tracks: Tracks, account: Account, form: FileFormat, recording: Recording
) -> tuple[Tracks, dict[str, Any]]:
    """What `clean_recording` does once a recording is read and checked; `path` is named in errors."""
    # What each block dropped is counted; what is left belongs to tracks from here on.
    account.tracks_read += 0 if account.tracks_read else len(tracks.bounds()) - 1
    whole = tracks
    drops_gaps = form.gaps == "drop" or "gap_over_5s" in form.cleaning
    tracks = cut(tracks, None if drops_gaps else form.gap_s, form.max_jump_mps, account)
    rules = [*form.cleaning, *(["gap_over_5s"] if drops_gaps and "gap_over_5s" not in form.cleaning else [])]
    for name, options in map(_rule, rules):
        tracks = _drop(tracks, name, RULES[name](tracks, form, **options), account)
    if recording.chosen is not None:
        owners = account.owners if form.same_person else None
        tracks = _drop(tracks, "other_split", ~in_split(tracks, recording, owners), account)
    if recording.part:
        ids = tracks.track_id[tracks.bounds()[:-1]]
        pieces = {int(piece): whole for piece, whole in _pieces(account.owners.of(ids), form).items()}
        person = whole_ids(ids, pieces)
        tracks = _drop(tracks, "other_part", ~in_part(tracks, recording.part, person), account)
    account.rows_kept = len(tracks.t)
    account.tracks_kept = len(tracks.bounds()) - 1
    if np.isnan(tracks.speed).all():
        raw = tracks
        try:
            tracks = interpolate(raw, form.time_step_s)
        except DataError as error:
            raise DataError(f"{path}: {error}") from None
        if not drops_gaps:
            account.notes["interpolated_rows"] = between_rows(raw, tracks)
        if form.min_heading_mps:
            slow = tracks.speed < form.min_heading_mps
            tracks = tracks._replace(heading=np.where(slow, np.nan, tracks.heading))
    account.rows_written = len(tracks.t)
    if not len(tracks.t):
        raise DataError(
            f"{path}: cleaning left no track; rows dropped: {dict(account.dropped_rows)}, "
            f"tracks dropped: {dict(account.dropped_tracks)}; {_remedy(form, recording, usual_step(whole), account)}"
        )
    known = account.owners.of(tracks.track_id[tracks.bounds()[:-1]])
    pieces = _pieces(known, form)
    beside: dict[str, Any] = {name: ids for name, ids in (("owners", known), ("persons", pieces)) if ids}
    if account.scenes is not None:
        scenes = of_pieces(account.scenes, tracks, account.owners)
        account.notes["scenes_of_others"] = len(account.scenes.begin) - len(scenes.begin)
        beside["scenes"] = scenes.plain()
    return tracks, {**account.as_dict(), **beside}


def _pieces(known, form):
    """{track id of a later piece: that of the first} among the `known` owners; nothing if they are not one person."""
    return {number: id_of(owner) for number, (owner, piece) in known.items() if piece > 1 and form.same_person}


def cut(tracks: Tracks, gap_s: float | None, jump_mps: float | None, account: Account) -> Tracks:
    """Tracks in pieces, cut where they pause for more than `gap_s`, or go on faster than `jump_mps` (None: not there).

    They are also cut where a reader noted such rows, between which it left out others (`account.jumps`). A piece has an
    id of its own (`ids.id_of`), which depends on the owner's id and on how many pieces came before; cuts are counted.
    """
    if not (gap_s or jump_mps):
        return tracks
    later = np.flatnonzero(np.diff(tracks.track_id) == 0) + 1
    seconds = tracks.t[later] - tracks.t[later - 1]
    paused = seconds > gap_s if gap_s else np.zeros(len(later), bool)
    other = np.zeros(len(tracks.t), bool)
    if jump_mps:
        other = jumped(tracks, jump_mps)
        other[_rows_from(tracks, concatenate(account.jumps))] = True
    for name, where in (("cut_at_gap", paused), ("cut_at_jump", other[later] & ~paused)):
        if where.any():
            account.notes[name] += int(where.sum())
            account.first_seen.setdefault(name, _place(tracks, later[np.argmax(where)], account))
    cuts = later[paused | other[later]]
    if not len(cuts):
        return tracks
    starts = np.union1d(tracks.bounds()[:-1], cuts)
    whole = np.searchsorted(tracks.bounds(), starts, side="right") - 1
    ids, piece = np.empty(len(starts), np.int64), 0
    for number, (row, track) in enumerate(zip(starts, whole, strict=True)):
        piece = piece + 1 if number and track == whole[number - 1] else 1
        ids[number] = tracks.track_id[row]
        if piece > 1:
            ids[number] = account.owners.number(account.owners.text(int(ids[number])), piece)
    account.tracks_read += len(cuts)
    pieces = tracks._replace(track_id=np.repeat(ids, np.diff([*starts, len(tracks.t)])))
    return pieces.take(np.lexsort((pieces.t, pieces.track_id)))


def _rows_from(tracks, noted):
    """The first row of a track at or after each of the `noted` ones, as indices; none where a track has no such row."""
    both = concatenate([noted, tracks])
    is_row = np.lexsort((both.t, both.track_id)) >= len(noted.t)  # stable: a noted row is before that of its time
    place = np.minimum(np.cumsum(is_row)[~is_row], len(tracks.t) - 1)
    ids = np.sort(noted.track_id)
    return place[tracks.track_id[place] == ids]


def _remedy(form, recording, usual, account):
    """What may help where no track is left."""
    if account.dropped_tracks["other_part"]:
        takes = f"folds by time take {FOLDS * BLOCK_S / 3600:g} hours or more, or {FOLDS} test days"
        if recording.part in ("fit", "validation"):
            takes = "a validation part by time takes people who come at different times"
        return (
            f"nobody is left for `{recording.part}`: {takes}; use longer recordings or more days, or test on the test "
            "recordings"
        )
    if account.dropped_tracks["other_split"]:
        return "nobody is left for this side of `split`: divide the file differently"
    if account.dropped_rows["outside_day"] > 0.5 * account.rows_read:
        return "most rows are of another day: are `day`, `days`, `start` and `timezone` right?"
    if usual > form.gap_s:
        return (
            f"rows of a track are usually {usual:g} s apart, more than the longest gap of {form.gap_s:g} s: "
            f"{step_of(usual)}"
        )
    if account.notes["cut_at_jump"] > len(account.dropped_tracks):
        return "tracks were cut at every row that jumps: is the unit of length or time right (`units`, `frame_rate`)?"
    if account.dropped_rows["duplicate_row"] > 0.5 * account.rows_read:
        return (
            "most rows have the id and time of another row: are `columns: {track_id, t}` right, and are times written "
            "with all of their digits?"
        )
    return "is `cleaning` too strict?"


def between_rows(raw: Tracks, grid: Tracks) -> int:
    """How many rows of `grid` are on no row of `raw` (to 1 ms), but between two; both are of the same tracks."""
    if not len(raw.t):
        return 0
    bounds = raw.bounds()
    axis, offset, _ = laid_out(raw, np.column_stack([bounds[:-1], bounds[1:] - 1]), 10.0)
    first = raw.t[bounds[:-1]] - offset
    when = grid.t - np.repeat(first, np.diff(grid.bounds()))
    after = np.clip(np.searchsorted(axis, when), 1, max(len(axis) - 1, 1))
    nearest = np.minimum(np.abs(axis[np.minimum(after, len(axis) - 1)] - when), np.abs(axis[after - 1] - when))
    return int((nearest > 1e-3).sum())


def _place(tracks, row, account):
    """Whose row it is and when, as text."""
    owner = account.owners.text(int(tracks.track_id[row]))
    before, after = tracks.take(slice(row - 1, row)), tracks.take(slice(row, row + 1))
    return (
        f"id {owner}: {before.t[0]:.3f} s at {before.x[0]:.2f}, {before.y[0]:.2f} m, then {after.t[0]:.3f} s at "
        f"{after.x[0]:.2f}, {after.y[0]:.2f} m"
    )


def single_row(tracks: Tracks, form: FileFormat) -> np.ndarray:
    """Tracks of one row: no motion to learn from."""
    return _rows(tracks) == 1


def gap_over_5s(tracks: Tracks, form: FileFormat) -> np.ndarray:
    """Tracks with a longer gap between two rows than is allowed (`max_gap_s`): probably two persons under one id."""
    return _any_row(
        tracks, np.concatenate([[False], (np.diff(tracks.t) > form.gap_s) & (np.diff(tracks.track_id) == 0)])
    )


def min_points(tracks: Tracks, form: FileFormat, points: int) -> np.ndarray:
    """Tracks with fewer than `points` rows: spurious detections."""
    return _rows(tracks) < points


def start_end_margin(tracks: Tracks, form: FileFormat, polygons: list[list[list[float]]]) -> np.ndarray:
    """Tracks that start or end outside all of `polygons`, the doors' side (in pixels if there is a `scale`, else m)."""
    starts, ends = _ends(tracks, form.scale)
    return ~(inside_polygons(starts, polygons) & inside_polygons(ends, polygons))


def lift_loiterers(tracks: Tracks, form: FileFormat, polygons: list[list[list[float]]]) -> np.ndarray:
    """Tracks that both start and end inside `polygons` (units as above), where people wait for the lift."""
    starts, ends = _ends(tracks, form.scale)
    return inside_polygons(starts, polygons) & inside_polygons(ends, polygons)


RULES = {rule.__name__: rule for rule in (single_row, gap_over_5s, min_points, start_end_margin, lift_loiterers)}
RULE_NEEDS = {"min_points": "points", "start_end_margin": "polygons", "lift_loiterers": "polygons"}
RULE_EXAMPLES = {"points": "3", "polygons": "[[[0, 0], [9, 0], [9, 4]]]"}
_RULE_FORM = "write it as {min_points: {points: 3}}"


def check_rules(cleaning: Iterable[str | dict[str, dict[str, Any]]], source: object) -> None:
    """Whether every entry is a rule that exists, with the option that it takes; `DataError` that names `source`."""
    for entry in cleaning:
        _check_rule(source, entry)


def are_polygons(value: Any) -> bool:
    """Whether `value` is a list of polygons: lists of three or more [x, y]."""
    lists = (list, tuple)
    return bool(
        isinstance(value, lists)
        and value
        and all(isinstance(polygon, lists) and len(polygon) >= 3 for polygon in value)
        and all(
            isinstance(corner, lists) and len(corner) == 2 and all(type(part) in (int, float) for part in corner)
            for polygon in value
            for corner in polygon
        )
    )


def inside_polygons(points: np.ndarray, polygons: Sequence[Sequence[Sequence[float]]]) -> np.ndarray:
    """Whether points [n, 2] lie in at least one of `polygons`, lists of corners that close themselves.

    Points on the border are inside. What a polygon's own edges enclose twice is outside (the even-odd rule).
    """
    x, y = np.asarray(points, float).reshape(-1, 2).T
    inside = np.zeros(len(x), bool)
    for polygon in polygons:
        corners = np.asarray(polygon, float)
        odd = np.zeros(len(x), bool)  # whether a ray to the right crosses an odd number of edges
        for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            dx, dy, px, py = x1 - x0, y1 - y0, x - x0, y - y0
            if dy:
                odd ^= ((y0 > y) != (y1 > y)) & (px < py * (dx / dy))
            length = dx * dx + dy * dy
            along = np.clip((px * dx + py * dy) / length, 0, 1) if length else 0.0
            inside |= np.hypot(px - along * dx, py - along * dy) <= BORDER
        inside |= odd
    return inside


def _check_rule(source: object, entry: str | dict[str, dict[str, Any]]) -> None:
    """One entry of `cleaning`: a rule that exists, with the option that it takes."""
    if not isinstance(entry, str) and len(entry) != 1:
        raise DataError(f"{source}: cleaning: {entry} is not one rule with its option; {_RULE_FORM}")
    name, options = (entry, {}) if isinstance(entry, str) else next(iter(entry.items()))
    if name not in RULES:
        raise DataError(unknown(f"{source}: cleaning", "rule", name, RULES))
    if set(options) != ({RULE_NEEDS[name]} if name in RULE_NEEDS else set()):
        takes = f"{RULE_NEEDS[name]}; {_RULE_FORM}" if name in RULE_NEEDS else "no option"
        raise DataError(f"{source}: cleaning rule {name} takes {takes}; got {sorted(options)}")
    if "points" in options and not (type(options["points"]) is int and options["points"] > 0):
        raise DataError(f"{source}: cleaning rule {name}: points {options['points']!r} is not a positive whole number")
    if "polygons" in options and not are_polygons(options["polygons"]):
        raise DataError(f"{source}: cleaning rule {name}: polygons must be lists of at least three [x, y] corners")


def _rule(entry):
    name, options = (entry, {}) if isinstance(entry, str) else next(iter(entry.items()))
    return name, options


def _drop(tracks, name, dropped, account):
    rows = np.repeat(dropped, _rows(tracks))
    account.drop_tracks(name, int(dropped.sum()), int(rows.sum()))
    return tracks.take(~rows)


def _rows(tracks):
    return np.diff(tracks.bounds())


def _any_row(tracks, mask):
    return np.logical_or.reduceat(mask, tracks.bounds()[:-1]) if len(mask) > 1 or len(tracks.t) else mask[:0]


def _ends(tracks, scale):
    bounds = tracks.bounds()
    positions = np.column_stack([tracks.x, tracks.y]) / (scale or 1.0)
    return positions[bounds[:-1]], positions[bounds[1:] - 1]
