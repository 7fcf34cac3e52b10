"""The worst files we can think of, of just under 50 MB or the size that a reader takes: seconds and memory of reading.

    python tests/torture/memory.py [NAME ...]      # a table, a line for each file; status 1 where one breaks a bound

Each file is written by one process and read by another, whose time on the processor (not the clock's, so that a busy
machine tells the same) and peak memory are told. Refused files count as read: what is wanted is a result or an error
of ours, in less than 1 GB, and in 5 s or a second for each megabyte.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

SIZE, MAP = 49_900_000, 31 << 20  # bytes, of files of which more would be refused: below that limit
MOST_MB, MOST_ADDRESSES = 1000, 4 << 30  # of memory, as is wanted; of addresses, so that no trial harms the machine
MOST_S, MOST_S_PER_MB, ENDED_S = 5, 1, 300  # of the processor: the larger of the first two; the end of a trial


def repeated(unit: bytes, head: bytes = b"", tail: bytes = b"", most: int = SIZE) -> Callable[[Path], None]:
    """What writes a file of one piece of text many times, between a head and a tail."""

    def write(path: Path) -> None:
        path.write_bytes(head + unit * ((most - len(head) - len(tail)) // len(unit)) + tail)

    return write


def numbered(line: str, head: str = "", tail: str = "", most: int = SIZE) -> Callable[[Path], None]:
    """What writes lines with a number in each; {i} and {j} are its parts by a row of 2,000."""

    def write(path: Path) -> None:
        with path.open("w") as file:
            left, number = most - len(head) - len(tail) - 200, 0
            file.write(head)
            while left > 0:
                left -= file.write(line.format(n=number, i=number % 2000, j=number // 2000))
                number += 1
            file.write(tail)

    return write


def sqlite(*commands: str, rows: Iterable[tuple[Any, ...]] = ()) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        import sqlite3  # noqa: PLC0415 - only those who write

        with sqlite3.connect(path) as file:
            file.execute("CREATE TABLE metadata (key TEXT, value TEXT)")
            file.execute("INSERT INTO metadata VALUES ('fps', '10')")
            for command in commands:
                file.execute(command)
            if rows:
                file.executemany("INSERT INTO trajectory_data VALUES (?, ?, ?, ?)", rows)
        file.close()

    return write


def parquet(rows: int, **columns: Any) -> Callable[[Path], None]:
    """What writes columns of one value each, or of all those of a range."""

    def write(path: Path) -> None:
        import pyarrow as pa  # noqa: PLC0415
        import pyarrow.parquet as pq  # noqa: PLC0415

        def column(value: Any) -> Any:
            if isinstance(value, range):
                return pa.array(np.arange(rows))
            return pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array([value]))

        table = pa.table({name: column(value) for name, value in columns.items()})
        pq.write_table(table.cast(pa.schema([(f.name, f.type.value_type if pa.types.is_dictionary(f.type)
                       and not pa.types.is_string(f.type.value_type) else f.type) for f in table.schema])), path,
                       compression="zstd")  # fmt: skip

    return write


def hdf5(path: Path) -> None:
    import h5py  # noqa: PLC0415

    with h5py.File(path, "w") as file:
        kind = np.dtype([("id", "i8"), ("frame", "i8"), ("x", "f8"), ("y", "f8")])
        file.create_dataset("trajectory", (200_000_000,), kind, chunks=(10_000,)).attrs["fps"] = 10.0


def image(path: Path) -> None:
    from PIL import Image  # noqa: PLC0415

    Image.new("RGBA", (8900, 8900)).save(path.parent / "plan.png")
    path.write_text("image: plan.png\nresolution: 0.1\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.2\n")


def a_map(form: str | None = None, **how: Any) -> Callable[[Path], object]:
    def read(path: Path) -> object:
        import modlhmp  # noqa: PLC0415 - only those who read

        return modlhmp.load_map(path, form, site=None if path.suffix == ".parquet" else modlhmp.Site(), **how)

    return read


def recording(reader: str, columns: Any = None, **described: Any) -> Callable[[Path], object]:
    def read(path: Path) -> object:
        from modlhmp.file_format import Columns, FileFormat  # noqa: PLC0415
        from modlhmp.readers import read_recording  # noqa: PLC0415

        named = Columns(**columns) if columns else None
        return read_recording(path, FileFormat(reader=reader, timezone="UTC", columns=named, **described))

    return read


def samples(path: Path) -> object:
    from modlhmp.exchange.forecasts import read_samples  # noqa: PLC0415

    return read_samples(path, 1.0)


def tracks(path: Path) -> object:
    from modlhmp.exchange.tracks import read_tracks_table  # noqa: PLC0415

    return read_tracks_table(path)


def predictions(path: Path) -> object:
    from modlhmp.exchange.trajnet import read_predictions  # noqa: PLC0415

    return read_predictions(path, 4, 8)


def sheet(path: Path) -> object:
    from modlhmp.exchange.hand_in import read_sheet  # noqa: PLC0415

    return read_sheet(path)


def settings(path: Path) -> object:
    from modlhmp.yaml_file import read_yaml  # noqa: PLC0415

    return read_yaml(path, "a dataset file")


def plan(path: Path) -> object:
    from modlhmp.floor_plan import load_floor_plan  # noqa: PLC0415

    return load_floor_plan(path)


def live(path: Path) -> None:
    from modlhmp import Live, Site  # noqa: PLC0415
    from modlhmp.live_lines import batches, forecasts  # noqa: PLC0415

    with path.open("rb") as file:
        for _ in forecasts(Live("cvm", 5, site=Site(horizon_s=5)), batches(file.fileno()), 1.0):
            pass


FORECASTS = "track_id,step,x,y\n"
LOCATION = (
    "<location><id>1</id><p>1</p><q>1</q><pose><x>{i}</x><y>{j}</y></pose><distribution><P>1</P><M><th>1</th><r>1</r></M>"
    "<Cov><e_11>1</e_11><e_12>0</e_12><e_21>0</e_21><e_22>1</e_22></Cov></distribution></location>"
)
PARAMETERS = (
    "<map><parameters><x_min>0</x_min><x_max>2000</x_max><y_min>0</y_min><y_max>2000</y_max><step>1</step>"
    "<radious>1</radious></parameters><locations>"
)
TRAJECTORY = "CREATE TABLE trajectory_data (frame INTEGER, id INTEGER, pos_x, pos_y)"
ENDLESS = (
    "CREATE VIEW trajectory_data AS WITH RECURSIVE c(n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM c) "
    "SELECT n AS id, n AS frame, 0.0 AS pos_x, 0.0 AS pos_y FROM c"
)
BOX: dict[str, Any] = {"x": [0, 2], "y": [0, 2], "orientations": 2}
CASES: dict[str, tuple[str, Callable[[Path], Any], Callable[[Path], object]]] = {
    "CSV map, blank lines": ("m.csv", repeated(b"\n", most=MAP), a_map("stef_csv")),
    "CSV map, short rows": ("m.csv", numbered("{i},{j},1,1\n", most=MAP), a_map("stef_csv")),
    "CSV map, one line": ("m.csv", repeated(b"1,", most=MAP), a_map("stef_csv")),
    "CSV map, wide characters": ("m.csv", repeated(b"1,2\n", "\U0001f600".encode(), most=MAP), a_map("stef_csv")),
    "CLiFF CSV": ("m.csv", numbered("{i},{j},1,1,1,0,0,1,1,1,1\n", most=MAP), a_map("matlab")),
    "map, form not named": ("m.txt", repeated(b"1,2,3\n", most=MAP), a_map()),
    "histogram, one line": ("m.txt", repeated(b"10,", b"", b"0", most=MAP), a_map("histogram", **BOX)),
    "XML map, tags": ("m.xml", repeated(b"<a/>", b"<map>", b"</map>", most=MAP), a_map("xml")),
    "XML map, attributes": ("m.xml", numbered(' a{n}=""', "<map", "/>", most=MAP), a_map("xml")),
    "XML map, text": ("m.xml", repeated(b"a", b"<map>", b"</map>", most=MAP), a_map("xml")),
    "XML map, locations": ("m.xml", numbered(LOCATION, PARAMETERS, "</locations></map>", most=MAP), a_map("xml")),
    "forecasts, short rows": ("f.csv", numbered("{n},1,1,1\n", FORECASTS), samples),
    "forecasts, samples": ("f.csv", numbered("{i},{j},1,1,1\n", "track_id,sample,step,x,y\n"), samples),
    "forecasts, names": ("f.csv", numbered("a{n}" + "b" * 40 + ",1,1,1\n", FORECASTS), samples),
    "forecasts, columns": ("f.csv", repeated(b"a,"), samples),
    "forecasts, same columns": ("f.csv", repeated(b"x,"), samples),
    "forecasts, empty fields": ("f.csv", repeated(b",,,\n", FORECASTS.encode()), samples),
    "forecasts, blank lines": ("f.csv", repeated(b"\n", FORECASTS.encode()), samples),
    "forecasts, an open quote": ("f.csv", repeated(b"a", FORECASTS.encode() + b'"'), samples),
    "forecasts, Parquet of one value": ("f.parquet", parquet(100_000_000, track_id=1, step=1.0, x=1.0, y=1.0), samples),
    "forecasts, Parquet of long texts": ("f.parquet", parquet(2_000_000, track_id="a" * 1000, step=1.0, x=1.0, y=1.0),
                                         samples),
    "map, Parquet of one value": ("m.parquet", parquet(100_000_000, a=1.0, b=1.0, c=1.0), a_map()),
    "tracks, short rows": ("f.csv", numbered("1,{n},1,1\n", "track_id,t,x,y\n"), tracks),
    "tracks, names": ("f.csv", numbered("a{n}" + "b" * 40 + ",1,1,1\n", "track_id,t,x,y\n"), tracks),
    "TrajNet++ predictions": (
        "f.ndjson",
        numbered('{{"track":{{"f":4,"p":0,"x":1,"y":1,"prediction_number":{n},"scene_id":0}}}}\n'),
        predictions,
    ),
    "TrajNet++, brackets": ("f.ndjson", repeated(b"["), predictions),
    "TrajNet++, lists": ("f.ndjson", repeated(b'{"a":[' + b"[]," * 2_700_000 + b"0]}\n"), predictions),
    "sheet of a hand-in": ("f.json", repeated(b"[],", b'{"task":[', b"0]}"), sheet),
    "JuPedSim, rows": (
        "a.sqlite", sqlite(TRAJECTORY, rows=((k // 100, k % 100, 1, k % 100) for k in range(SIZE // 16))),
        recording("jupedsim"),
    ),
    "JuPedSim, endless view": ("a.sqlite", sqlite(ENDLESS), recording("jupedsim")),
    "JuPedSim, long text": (
        "a.sqlite", sqlite(TRAJECTORY, rows=iter([(1, 1, "1" * (SIZE - 99_999), 1)])), recording("jupedsim")
    ),
    "HDF5, 200 million fill values": ("a.h5", hdf5, recording("hdf5")),
    "YAML, list in a line": ("a.yaml", repeated(b"[],", b"a: [", b"0]"), settings),
    "YAML, largest": ("a.yaml", lambda path: path.write_bytes(b"a: [" + b"[]," * (yaml_size() // 3 - 9) + b"0]"),
                      settings),
    "YAML, brackets": ("a.yaml", lambda path: path.write_bytes(b"a: " + b"[" * 90_000), settings),
    "floor plan, RGBA": ("plan.yaml", image, plan),
    "TrajNet++ rows": (
        "a.ndjson", repeated(b'{"track":{"f":1,"p":1,"x":1,"y":1}}\n'), recording("trajnet", frame_rate=1.0)
    ),
    "CSV, short rows": (
        "a.csv", numbered("{n},1,1,1\n"), recording("delimited", columns={"t": 0, "track_id": 1, "x": 2, "y": 3})
    ),
    "CSV, people": (
        "a.csv", numbered("1,a{n},1,1\n"), recording("delimited", columns={"t": 0, "track_id": 1, "x": 2, "y": 3})
    ),
    "THOR-MAGNI, rows": (
        "a.csv", repeated(b"1,1,1,1\n", b"Frame,Time,Helmet_1 Centroid_X,Helmet_1 Centroid_Y\n"), recording("magni")
    ),
    "THOR-MAGNI, columns": (
        "a.csv",
        lambda path: path.write_bytes(b"Frame,Time" + b",a" * 8_000_000 + b"\n" + b"1," * 8_000_001 + b"1\n"),
        recording("magni"),
    ),
    "Edinburgh, people": (
        "a.txt", numbered("TRACK.R{n}=[[1 2 3]];\n"), recording("edinburgh", frame_rate=9.0, scale=0.02)
    ),
    "live, people": ("r.jsonl", numbered('{{"t":1,"id":{n},"x":{i},"y":1}}\n'), live),
}  # fmt: skip


def yaml_size() -> int:
    from modlhmp.yaml_file import MOST_CHARACTERS  # noqa: PLC0415

    return MOST_CHARACTERS


def measure(name: str, path: Path) -> None:
    """Read a file, and print what came of it, the processor's seconds and the peak memory [MB], as JSON."""
    from modlhmp import DataError  # noqa: PLC0415

    resource.setrlimit(resource.RLIMIT_AS, (MOST_ADDRESSES, MOST_ADDRESSES))
    resource.setrlimit(resource.RLIMIT_CPU, (ENDED_S, ENDED_S))
    began = time.process_time()
    try:
        CASES[name][2](path)
        told = "read"
    except DataError as error:
        told = str(error).replace(f"{path.parent}/", "")
    except BaseException as error:
        told = f"! {type(error).__name__}: {error}"
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000
    print(json.dumps([told, time.process_time() - began, peak]))


def main(names: list[str]) -> int:
    """Print the table; 1 where an error is not ours, or memory or time is above its bound."""
    failed = False
    print("| file | MB | s | peak MB | what is said |\n|---|---|---|---|---|")
    for name in names or CASES:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, CASES[name][0])
            subprocess.run([sys.executable, __file__, "--write", name, path], check=True)
            size = sum(file.stat().st_size for file in Path(folder).iterdir()) / 1e6
            done = subprocess.run(
                [sys.executable, __file__, "--read", name, path], capture_output=True, text=True, check=False
            )
            last = done.stdout.splitlines()[-1:]
            told, seconds, peak = json.loads(last[0]) if last else (f"! status {done.returncode}", 0.0, 0.0)
            late = seconds > max(MOST_S, MOST_S_PER_MB * size)
            failed |= told.startswith("!") or peak > MOST_MB or late
            print(f"| {name} | {size:.1f} | {seconds:.1f} | {peak:.0f} | {told[:150]} |", flush=True)
    return int(failed)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--write"]:
        CASES[sys.argv[2]][1](Path(sys.argv[3]))
    elif sys.argv[1:2] == ["--read"]:
        measure(sys.argv[2], Path(sys.argv[3]))
    else:
        sys.exit(main(sys.argv[1:]))
