"""Does the time of every reader grow with the bytes of a file, and no faster? Made-up files and hostile ones.

    .venv/bin/python benchmarks/growth.py

A row for each reader and kind of file: processor seconds at a size, twice and four times that, and the exponent (1 is
linear, 2 quadratic), from sizes at which the last takes about a second. Nothing is said of small files, whose time is
the start's.
"""

import contextlib
import math
import tempfile
import time
from pathlib import Path

from modlhmp.file_format import Columns, FileFormat
from modlhmp.readers import read_recording
from modlhmp.storage import DataError

COLUMNS = Columns(t=0, track_id=1, x=2, y=3)
FORMS = {
    "delimited": FileFormat(columns=COLUMNS, timezone="UTC"),
    "text": FileFormat(reader="text", columns=COLUMNS, timezone="UTC"),
    "edinburgh": FileFormat(reader="edinburgh", frame_rate=9.0, scale=0.0247, timezone="UTC"),
    "trajnet": FileFormat(reader="trajnet", frame_rate=1.0, timezone="UTC"),
    "magni": FileFormat(reader="magni", timezone="UTC"),
}
FILES = {  # name: (reader, function from a number of lines, or blanks, to the bytes)
    "rows": ("delimited", lambda n: b"".join(b"%d,1,%d.5,2\n" % (k, k % 99) for k in range(n))),
    "blank lines": ("delimited", lambda n: b"0,1,2,3\n1,1,2,3\n" + b"\n" * n),
    "rows of text": ("delimited", lambda n: b"0,1,2,3\n1,1,2,3\n" + b"1,1,a,3\n" * n),
    "text rows": ("text", lambda n: b"".join(b"%d 1 %d.5 2\n" % (k, k % 99) for k in range(n))),
    "text blank lines": ("text", lambda n: b"\n" * n + b"0 1 2 3\n1 1 2 3\n"),
    "tracks": ("edinburgh", lambda n: b"".join(b"TRACK.R%d=[[1 2 3];[2 3 9]];\n" % k for k in range(n))),
    "one track": ("edinburgh", lambda n: b"TRACK.R1=[" + b";".join(b"[1 2 %d]" % k for k in range(n)) + b"];\n"),
    "blanks after a bracket": ("edinburgh", lambda n: b"TRACK.R1=[[1 2 3]" + b" " * n + b"x\n"),
    "brackets and blanks": ("edinburgh", lambda n: b"TRACK.R1=[" + b"]  " * n + b"x\n"),
    "json": ("trajnet", lambda n: b"".join(b'{"track": {"f": %d, "p": 1, "x": 1, "y": 2}}\n' % k for k in range(n))),
    "json blank lines": ("trajnet", lambda n: b"\n" * n),
    "bodies": ("magni", lambda n: b"Frame,Time,Helmet_1 Centroid_X,Helmet_1 Centroid_Y\n" + b"1,0.5,7,8\n" * n),
}
LEAST_S, FIRST, MOST = 0.25, 10_000, 1_000_000


def seconds(form, content, folder):
    """Processor seconds to read a file, or to refuse it."""
    path = Path(folder, "recording")
    path.write_bytes(content)
    began = time.process_time()
    with contextlib.suppress(DataError):
        read_recording(path, form)
    return time.process_time() - began


def main():
    """Print a row per kind of file."""
    with tempfile.TemporaryDirectory() as folder:
        for name, (reader, make) in FILES.items():
            n = FIRST
            seconds(FORMS[reader], make(10), folder)  # compiles what it needs
            while seconds(FORMS[reader], make(n), folder) < LEAST_S and n < MOST:
                n *= 2
            taken = [seconds(FORMS[reader], make(times * n), folder) for times in (1, 2, 4)]
            exponent = math.log(max(taken[2], 1e-9) / max(taken[0], 1e-9), 4)
            shown = "  ".join(f"{one:6.2f}" for one in taken)
            print(f"{reader:10s} {name:24s} {n:9,d}  {shown} s  exponent {exponent:5.2f}", flush=True)


if __name__ == "__main__":
    main()
