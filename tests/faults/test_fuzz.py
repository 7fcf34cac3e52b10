"""Whatever comes in, damaged at random: a result or an error of ours that names it, soon, and in little memory.

`targets.py` has a small good file of each kind and what reads it. `make test` tries a few thousand damaged files in
all, the same ones every time; `make torture` a hundred thousand others. What was found and mended stands in the tests
beside this one.
"""

import re
import resource
import time
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from targets import TARGETS, Target
from test_boundary import told as foreseen

from modlhmp import DataError

FEW, MANY = 60, 2000  # damaged files of each target
MOST_S, MOST_MB = 5, 1000

PIECES = [
    b",", b"\n", b"\r", b"\t", b'"', b"[", b"]", b"{", b"}", b"(", b":", b";", b" ", b"-", b".", b"e", b"9", b"&a ",
    b"*a", b"<a>", b"</a>", b"<!--", b"&#0;", b"[[", b'{"a":', b"- ", b"\0", b"\xff", b"\xef\xbb\xbf", b"\n\n",
    b"TRACK.R1=[[1 2 3]];\n",
]  # fmt: skip
NUMBERS = [
    b"-1", b"0", b"1e9", b"-0", b"nan", b"inf", b"-Infinity", b"1e999", b"1e-320", b"9" * 19, b"9" * 400, b"9" * 5000,
    b"2147483648", b"-9223372036854775809", b"0x10", b"1_0", b"true", b"null", b"",
]  # fmt: skip
EDITS = st.lists(
    st.tuples(
        st.sampled_from(["flip", "cut", "insert", "repeat", "delete", "copy", "swap", "number"]),
        st.floats(0, 1, exclude_max=True),
        st.sampled_from([1, 2, 3, 7, 30, 1000, 60_000]),
        st.one_of(st.sampled_from(PIECES), st.sampled_from(NUMBERS), st.binary(min_size=1, max_size=4)),
    ),
    min_size=1,
    max_size=4,
)


def damaged(content: bytes, edits: list[tuple[str, float, int, bytes]]) -> bytes:
    """Content with bits flipped, its end cut off, bytes put in or repeated, left out, copied; lines or numbers changed.

    Each edit has a place, relative, a length and a piece of text.
    """
    for kind, place, length, new in edits:
        at = int(place * len(content))
        rest = content[at:]
        if kind == "flip":
            content = content[:at] + bytes(byte ^ 1 << length % 8 for byte in rest[: len(new)]) + rest[len(new) :]
        elif kind == "cut":
            content = content[:at]
        elif kind == "insert":
            content = content[:at] + new + rest
        elif kind == "repeat":
            content = content[:at] + new[:8] * length + rest
        elif kind == "delete":
            content = content[:at] + rest[length:]
        elif kind == "copy":
            content = content[:at] + rest[:length] + rest
        elif kind == "swap":
            lines = content.splitlines(keepends=True) or [b""]
            one, other = int(place * len(lines)), length % len(lines)
            lines[one], lines[other] = lines[other], lines[one]
            content = b"".join(lines)
        elif found := list(re.finditer(rb"\d+(\.\d+)?", content)):
            one = found[int(place * len(found))]
            content = content[: one.start()] + new + content[one.end() :]
    return content


@cache
def good(name: str, folder: Path) -> bytes:
    target = TARGETS[name]
    target.write(folder / target.file)
    target.read(folder / target.file)
    return (folder / target.file).read_bytes()


def check(target: Target, path: Path, content: bytes) -> None:
    """A result, or an error of ours that names the file, within 5 s of one core and 1 GB."""
    path.unlink(missing_ok=True)  # what remembers a file knows it by its inode
    path.write_bytes(content)
    target.seal(path)
    began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        target.read(path)
    except DataError as error:
        assert path.name in foreseen(error) or target.other in str(error)
        assert len(str(error)) < 5000
    assert time.process_time() - began < MOST_S
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_MB * 1000


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")  # of what a library calls, and tells only
@pytest.mark.parametrize("trials", [FEW, pytest.param(MANY, marks=pytest.mark.torture)])
@pytest.mark.parametrize("name", TARGETS)
def test_any_damage_is_read_or_refused(tmp_path, name, trials):
    content = good(name, tmp_path)
    target = TARGETS[name]

    @settings(max_examples=trials, derandomize=trials == FEW)
    @given(EDITS)
    def one(edits):
        check(target, tmp_path / target.file, damaged(content, edits))

    one()
