"""Are the numbers of two runs the same to the bit? Of every Parquet file's columns and every exhibit's CSV.

    python benchmarks/same_numbers.py OLD/results/demo results/demo OLD/paper_figures/demo paper_figures/demo

Names that changed since commit 021f66f stand in the tables below; whatever else is new, gone or different is listed,
and then the exit status is 1. Timings and sizes of machines (`runtime`, `costs.json`, minutes of trainings) are not
compared.
"""

import argparse
import csv
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

# Old name: new name, of files relative to the two folders.
RENAMED_FILES: dict[str, str] = {}
# Old name: new name, of columns.
RENAMED_COLUMNS: dict[str, str] = {}
NOT_COMPARED = ("runtime", "benchmarks/", "logs/")  # files
TIMES = ("minutes", "ms a track", "ms per track", "seconds")  # in the names of columns of tables that are times
# Old text: new text, in tables (wording of headings and cells).
REWORDED: dict[str, str] = {
    "futures a track k": "futures per track k",
    "ms a track": "ms per track",
    "Snippets, 10 a bin": "Snippets, 10 per bin",
    "about 10 Hz on a CPU: 0.11 s (ATC), 0.04 s (Edinburgh) a track": (
        "about 10 Hz on a CPU: 0.11 s (ATC), 0.04 s (Edinburgh) per track"
    ),
    "at most 0.11 s a track, k = 5, 60 s (another machine)": "at most 0.11 s per track, k = 5, 60 s (another machine)",
    "at most 0.04 s a track, k = 5, 20 s (another machine)": "at most 0.04 s per track, k = 5, 20 s (another machine)",
}


def plain(table: pa.Table) -> dict[str, pa.ChunkedArray]:
    """Columns by name, dictionaries decoded: which numbers encode a text may change."""
    columns = {}
    for name in table.column_names:
        column = table[name].combine_chunks()
        columns[name] = column.dictionary_decode() if pa.types.is_dictionary(column.type) else column
    return columns


def bits(column: pa.Array) -> list[bytes | None]:
    """The buffers of a column without its padding, so that NaN equals NaN and -0.0 is not 0.0."""
    values = column
    while pa.types.is_fixed_size_list(values.type):
        values = values.flatten()
    if not pa.types.is_primitive(values.type) or pa.types.is_boolean(values.type):
        return [str(values.to_pylist()).encode()]
    width = values.type.bit_width // 8
    data = values.buffers()[1]
    raw = b"" if data is None else data.to_pybytes()[values.offset * width : (values.offset + len(values)) * width]
    return [raw, str(values.null_count).encode()]


def parquet_differences(old: Path, new: Path) -> list[str]:
    """What differs between two Parquet files."""
    ours, theirs = plain(pq.read_table(old)), plain(pq.read_table(new))
    ours = {RENAMED_COLUMNS.get(name, name): column for name, column in ours.items()}
    found = [f"column {name} is gone" for name in ours.keys() - theirs.keys()]
    found += [f"column {name} is new" for name in theirs.keys() - ours.keys()]
    for name in ours.keys() & theirs.keys():
        if ours[name].type != theirs[name].type:
            found.append(f"column {name} was {ours[name].type}, is {theirs[name].type}")
        elif bits(ours[name]) != bits(theirs[name]):
            found.append(f"column {name} has other values")
    return found


def csv_differences(old: Path, new: Path) -> list[str]:
    """What differs between two tables; columns of times are left out."""
    ours, theirs = (list(csv.reader(file.read_text().splitlines())) for file in (old, new))
    ours = [[REWORDED.get(cell, cell) for cell in row] for row in ours]
    if ours[:1] != theirs[:1]:
        return [f"columns were {ours[:1]}, are {theirs[:1]}"]
    times = [number for number, name in enumerate(theirs[0]) if any(one in name for one in TIMES)] if theirs else []
    for rows in (ours, theirs):
        for row in rows:
            for number in times:
                row[number] = ""
    if len(ours) != len(theirs):
        return [f"had {len(ours)} rows, has {len(theirs)}"]
    return [f"row {n}: {a} is now {b}" for n, (a, b) in enumerate(zip(ours, theirs, strict=True), 1) if a != b][:3]


def files_of(folder: Path) -> dict[str, Path]:
    """The compared files below a folder, by their path in it."""
    found = [file for kind in ("*.parquet", "*.csv") for file in folder.rglob(kind)]
    named = {file.relative_to(folder).as_posix(): file for file in found}
    return {name: file for name, file in sorted(named.items()) if not any(part in name for part in NOT_COMPARED)}


def main() -> int:
    """Compare the pairs of folders that are named."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("folders", nargs="+", type=Path, help="old and new folder, as often as wanted")
    folders = parser.parse_args().folders
    number = wrong = 0
    for old, new in zip(folders[::2], folders[1::2], strict=True):
        ours = {RENAMED_FILES.get(name, name): file for name, file in files_of(old).items()}
        theirs = files_of(new)
        for name in sorted(ours.keys() | theirs.keys()):
            if name not in theirs or name not in ours:
                found = ["is gone" if name not in theirs else "is new"]
            else:
                compare = parquet_differences if name.endswith(".parquet") else csv_differences
                found = compare(ours[name], theirs[name])
            number += 1
            wrong += bool(found)
            for line in found:
                print(f"{new / name}: {line}")
    print(f"{number} files compared, {number - wrong} the same to the bit, {wrong} not")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
