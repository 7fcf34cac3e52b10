"""Tracks as a table of named columns, in CSV or Parquet.

| column | unit | meaning |
|---|---|---|
| `track_id` | | whose row it is: whole number or text |
| `t` | s | unix, or from any moment on |
| `x`, `y` | m | position |
| `speed`, `heading` | m/s, rad | as recorded, from the x-axis towards the y-axis; left out, or empty, where unknown |
"""

from pathlib import Path

import numpy as np
import pyarrow as pa

from modlhmp.exchange.columns import line_of, read_columns
from modlhmp.ids import MOST_PEOPLE, id_of
from modlhmp.storage import DataError, column
from modlhmp.tracks import Tracks

NEEDED, RECORDED = ("track_id", "t", "x", "y"), ("speed", "heading")
TYPES = {"track_id": pa.string()} | dict.fromkeys((*NEEDED[1:], *RECORDED), pa.float64())


def tracks_table(tracks: Tracks) -> pa.Table:
    """Tracks as a table; without speeds and headings where nobody has one, which are empty where unknown."""
    columns = {
        name: pa.array(values, from_pandas=True) for name, values in zip((*NEEDED, *RECORDED), tracks, strict=True)
    }
    names = (*NEEDED, *RECORDED) if np.isfinite(tracks.speed).any() else NEEDED
    return pa.table({name: columns[name] for name in names})


def read_tracks_table(path: str | Path) -> tuple[Tracks, dict[int, str]]:
    """Tracks of a table as they are, sorted by track and time, and {number: text} of ids that are no plain numbers.

    Nothing is dropped or resampled. `DataError` names the file, the row, the value and the remedy.
    """
    table = read_columns(path, TYPES, empty=RECORDED)
    if missing := [name for name in NEEDED if name not in table.column_names]:
        raise DataError(f"{path}: no column {missing[0]}; it has {', '.join(table.column_names)}")
    ids, names = numbers_of(table["track_id"], path)
    unknown = np.full(len(table), np.nan)
    found = {name: column(table, name) for name in table.column_names if name != "track_id"}
    rows = Tracks(ids, *(found.get(name, unknown) for name in (*NEEDED[1:], *RECORDED)))
    for name in NEEDED[1:]:
        values = getattr(rows, name)
        if not np.isfinite(values).all():
            row = int(np.argmax(~np.isfinite(values)))
            raise DataError(f"{path}, row {line_of(path, row)}: {name} {values[row]} is no finite number")
    order = np.lexsort((rows.t, rows.track_id))
    sorted_rows = rows.take(order)
    same = np.flatnonzero((np.diff(sorted_rows.t) == 0) & (np.diff(sorted_rows.track_id) == 0))
    if len(same):
        first, again = sorted(order[same[0] : same[0] + 2].tolist())
        who = names.get(int(ids[again]), ids[again])
        raise DataError(
            f"{path}, row {line_of(path, again)}: track {who} has a row at t {rows.t[again]:.16g} in row "
            f"{line_of(path, first)} already; keep one"
        )
    return sorted_rows, names


def numbers_of(texts: pa.ChunkedArray, path: str | Path) -> tuple[np.ndarray, dict[int, str]]:
    """Ids as numbers, as in a recording (`modlhmp.ids`), and {number: text} of those that are no plain numbers."""
    encoded = texts.combine_chunks().dictionary_encode()
    if (people := len(encoded.dictionary)) > MOST_PEOPLE:
        raise DataError(f"{path}: {people:,} track ids; at most {MOST_PEOPLE:,} of a file are read: divide it")
    owners = encoded.dictionary.to_pylist()
    numbers = np.array([id_of(text) for text in owners], np.int64)
    ids = numbers[np.from_dlpack(encoded.indices)] if len(texts) else np.empty(0, np.int64)
    return ids, {number: text for number, text in zip(numbers.tolist(), owners, strict=True) if str(number) != text}
