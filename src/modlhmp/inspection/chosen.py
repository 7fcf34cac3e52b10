"""Which rows of a table are of people, and which columns make their ids: keys of a dataset file beside the columns."""

import re
from collections import Counter
from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from modlhmp.inspection.roles import Columns, Values, name_and_unit, table_rows
from modlhmp.inspection.sheet import Sheet
from modlhmp.motion import returned_to

LEAST_ROWS = 3
LEAST_SHARE = 0.01  # of rows that one position, or of rows that stand twice at a time, must have
REPEATED = 0.1  # so many rows of an id and time of an earlier one are no accident
MOST_TEXTS = 30  # of a column of classes
LARGEST = 1000  # of a number that makes an id together with another one
_PEOPLE = {"pedestrian", "pedestrians", "person", "persons", "people", "ped", "human", "humans", "walker"}
_OTHERS = {
    # without "train", which names a part of a data set more often
    *("car", "cars", "bus", "truck", "lorry", "van", "tram", "vehicle", "vehicles", "taxi", "motorcycle"),
    *("motorbike", "motorcyclist", "cyclist", "cyclists", "bicyclist", "bicycle", "bike", "biker", "scooter", "skater"),
    *("skateboarder", "cart", "forklift", "robot", "agv", "dog", "animal"),
}
_CLASSES = {
    *("class", "classname", "cls", "type", "label", "labels", "category", "kind", "datalabel", "object", "objtype"),
    *("objecttype", "objectclass", "objectlabel", "agent", "agenttype", "agentclass", "usertype", "roaduser"),
    *("roadusertype", "species"),
}
_TRUE = {"true", "t", "yes", "y", "lost"}


class Chosen(NamedTuple):
    """Keys of a dataset file, remarks for a human, notes for the draft, and the rows that are left."""

    keys: dict[str, Any]
    asks: dict[str, str]
    notes: list[str]
    rows: np.ndarray


def choose(sheet: Sheet, values: Values, columns: Columns) -> Chosen:
    """`only`, `without` and `missing` as far as the table tells them."""
    found = Chosen({}, {}, [], np.ones(len(sheet.rows), bool))
    places = {columns.track_id, columns.t, columns.x, columns.y}
    for column in set(range(len(sheet.rows[0]))) - places:
        _by_class(sheet, column, found)
    _by_lost(sheet, found)
    _by_id(sheet, columns, found)
    found.rows[:] &= ~_not_seen(values, columns, found)
    return found


def _by_class(sheet: Sheet, column: int, found: Chosen) -> None:
    """Rows of what is no person, by a column that names it: a column of classes, or one without a name that has both.

    The texts of other columns may be of places and of what people do, so that a human decides.
    """
    texts = [row[column] for row in sheet.rows]
    kinds = Counter(texts)
    if not 2 <= len(kinds) <= MOST_TEXTS:
        return
    called = str(sheet.called(column))
    named = column < len(sheet.names) and name_and_unit(sheet.names[column])[0] in _CLASSES
    words = {text: _words(text) for text in kinds}
    others = sorted(text for text in kinds if words[text] & _OTHERS)
    people = sorted(text for text in kinds if words[text] & _PEOPLE and text not in others)
    whole = {text.lower() for text in kinds}
    of_classes = named or (not sheet.names and bool(whole & _OTHERS and whole & _PEOPLE))
    if of_classes and others and len(others) < len(kinds):
        key, chosen = ("only", people) if people else ("without", others)
        gone = sorted(kinds.keys() - people) if people else others
        found.keys.setdefault(key, {})[called] = chosen
        _ask(found, key, f"rows of {', '.join(gone)} are left out, by their names")
        found.rows[:] &= np.isin(texts, chosen) == (key == "only")
    elif named or others:
        found.notes.append(f"decide: column {called!r} holds {_shown(kinds)}: if some are no people, or one id is "
                           "several, say so by `only`, `without` or `columns: {track_id: [...]}`")  # fmt: skip


def _by_id(sheet: Sheet, columns: Columns, found: Chosen) -> None:
    """Rows of what is no person by its id: a word of such alone or with a number: `robot_1`, not `van der Berg 1`."""
    if columns.track_id is None:
        return
    texts = [row[columns.track_id] for row in sheet.rows]
    like = {text for text in set(texts) if _words(text) & _OTHERS}
    others = sorted(text for text in like if re.sub(r"[\W\d_]", "", text.lower()) in _OTHERS)
    if 0 < len(others) <= MOST_TEXTS and len(others) < len(set(texts)):
        found.keys.setdefault("without", {})[str(sheet.called(columns.track_id))] = others
        _ask(found, "without", f"rows of {', '.join(others)} are left out, by their ids")
        found.rows[:] &= ~np.isin(texts, others)
        like -= set(others)
    if like:
        found.notes.append(f"decide: are ids such as {_shown(like)} of people? If not, say so by `without`")


def _ask(found: Chosen, key: str, why: str) -> None:
    """Add a remark on a key, which several columns may have one on."""
    found.asks[key] = f"{found.asks[key]}; {why}" if key in found.asks else why


def _words(text: str) -> set[str]:
    return set(re.findall(r"[^\W\d_]+", text.lower()))


def _shown(texts: Collection[str]) -> str:
    """The first of some texts, for a remark."""
    return ", ".join(sorted(texts)[:8]) + (", ..." if len(texts) > 8 else "")


def _by_lost(sheet: Sheet, found: Chosen) -> None:
    """Rows of boxes that their annotators could not see: a column `lost`, or the seventh of ten in files without names.

    The ten are id, corners, frame, lost, occluded, generated and a class in quotes.
    """
    column = next((c for c, name in enumerate(sheet.names) if name.lower() == "lost"), None)
    flags = [{row[c] for row in sheet.rows} for c in (6, 7, 8)] if len(sheet.rows[0]) == 10 and not sheet.names else []
    if flags and all(flag <= {"0", "1"} for flag in flags) and sheet.number(sheet.rows[0][9]) is None:
        column = 6
    if column is None:
        return
    texts = [row[column] for row in sheet.rows]
    kinds = set(texts)
    lost = sorted(text for text in kinds if sheet.number(text) == 1 or text.lower() in _TRUE)
    if 0 < len(lost) < len(kinds):
        found.keys.setdefault("without", {})[str(sheet.called(column))] = lost
        _ask(found, "without", "rows of boxes that were lost from view")
        found.rows[:] &= ~np.isin(texts, lost)
    elif len(kinds) > 1:
        found.notes.append(f"decide: column {sheet.called(column)!r} holds {_shown(kinds)}: if some rows are of boxes "
                           "that were lost from view, say so by `without`")  # fmt: skip


def _not_seen(values: Values, columns: Columns, found: Chosen) -> np.ndarray:
    """Rows at the one position that stands for "not seen"; it becomes `missing`."""
    rows, order = table_rows(values, columns)
    kept = found.rows[order]
    at, x, y = returned_to(rows.take(kept))
    absent = np.zeros(len(values.numbers), bool)
    if at.sum() >= max(LEAST_ROWS, LEAST_SHARE * len(at)):
        absent[order[kept][at]] = True
        found.keys["missing"] = {"x": _plain(x), "y": _plain(y)}
        found.asks["missing"] = f"{at.sum()} of the first {len(at)} rows are there, to and from which people jump"
    return absent


def _plain(value: float) -> float | int:
    return int(value) if value == int(value) else value


def joint_ids(values: Values, columns: Columns) -> int | None:
    """The column that makes an id together with that of ids, where an id alone stands twice at a time; None else."""
    ids, t = values.ids(columns), values.numbers[:, columns.t]
    if columns.track_id is None or repeated_share(ids, t) <= REPEATED:
        return None
    found = []
    for column in set(range(values.codes.shape[1])) - {columns.track_id, columns.t, columns.x, columns.y}:
        codes = values.codes[:, column]
        kinds = len(np.unique(codes))
        small = not (np.abs(values.numbers[:, column]) > LARGEST).any()  # neither of times nor of places
        steady = (np.diff(codes) != 0).mean() < LEAST_SHARE  # such as a date
        if not (small or steady) or not 2 <= kinds <= MOST_TEXTS:
            continue
        if (repeated := repeated_share(ids * len(codes) + codes, t)) <= LEAST_SHARE:
            found.append((repeated, kinds, column))
    return min(found)[2] if found else None


def repeated_share(ids: np.ndarray, t: np.ndarray) -> float:
    """The share of rows with the id and time of an earlier one."""
    order = np.lexsort((t, ids))
    return float(((np.diff(ids[order]) == 0) & (np.diff(t[order]) == 0)).mean()) if len(ids) > 1 else 0.0
