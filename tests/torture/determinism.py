"""Are a run's bytes the same whatever should not matter? One run of the tiny demo for each thing that is varied.

    .venv/bin/python tests/torture/determinism.py        # some minutes a row; `make torture` calls it

Prints a row for each: how many outputs of the certificate are the same bytes as those of the first run, and how far
numbers of the others are apart. Status 1 where an output differs that should not.
"""

import os
import pwd
import shutil
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from modlhmp.storage import read_json
from modlhmp.study.certificate import differences

ROOT = Path(__file__).parents[2]
TINY = ("--configfile", "config/tiny.yaml")
RECORDINGS = "resources/demo/tiny"
CERTIFICATE = "results/tiny/certificate.json"


class Varied(NamedTuple):
    """What is varied: `alike` says whether every byte has to be the same."""

    cores: int = 2
    folder: str = "run"
    environment: Mapping[str, str] = {}
    umask: int = -1
    user: str | None = None
    again: bool = False
    prepare: Callable[[Path], None] | None = None  # changes the raw files, so that outputs carry other hashes
    alike: bool = True


def shuffle_rows(folder: Path) -> None:
    """The rows of the hall's recordings in another order."""
    found = sorted((folder / RECORDINGS / "hall").glob("*.csv"))
    assert found, "no recording to shuffle"
    for file in found:
        rows = file.read_text().splitlines(keepends=True)
        file.write_text("".join(np.random.default_rng(0).permutation(rows)))


def split_days(folder: Path) -> None:
    """Each training day of the hall as two recordings, of half the persons each."""
    dataset = folder / "config/datasets/demo_hall.yaml"
    lines = []
    for line in dataset.read_text().splitlines():
        if "split: train" not in line:
            lines.append(line)
            continue
        name = line.split("files: ")[1].split(",")[0]
        rows = (folder / RECORDINGS / name).read_text().splitlines(keepends=True)
        for part in (0, 1):
            halved = name.replace(".csv", f"-{part}.csv")
            mine = [row for row in rows if zlib.crc32(row.split(",")[1].encode()) % 2 == part]
            (folder / RECORDINGS / halved).write_text("".join(mine))
            lines.append(line.replace(name, halved))
    dataset.write_text("\n".join(lines) + "\n")


ROWS = {  # what must not matter is varied together: the same bytes clear all of it, others are looked for one by one
    "1 core, a path with a blank and an umlaut, umask 077, another locale, time zone and hash seed; "
    "then every rule anew, one at a time": Varied(
        cores=1,
        folder="a bläd run",
        umask=0o077,
        environment={"LC_ALL": "C", "LANG": "C", "TZ": "Asia/Tokyo", "PYTHONHASHSEED": "7"},
        again=True,
    ),
    "3 cores, another user": Varied(cores=3, user="nobody"),
    "rows of recordings shuffled": Varied(prepare=shuffle_rows, alike=False),
    "training days split in two files": Varied(prepare=split_days, alike=False),
    "numpy without vector instructions": Varied(
        environment={"NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512_SKX"}, alike=False
    ),
    "kernels for any processor": Varied(environment={"NUMBA_CPU_NAME": "generic"}, alike=False),
}


def made(folder: Path, how: Varied) -> dict[str, Any]:
    """The certificate of a run in a folder of its own."""
    folder.mkdir(parents=True)
    for name in ("workflow", "config", "profiles"):
        shutil.copytree(ROOT / name, folder / name)
    shutil.copy(ROOT / "Snakefile", folder)
    if how.user:
        for path in (folder, *folder.rglob("*")):
            shutil.chown(path, how.user)
    if how.prepare:
        _snakemake(folder, how, "--cores", how.cores, *TINY, "--until", "make_demo_recording", "make_demo_floor_plan")
        how.prepare(folder)
    _snakemake(folder, how, "--cores", how.cores, *TINY, "--", "certify")
    if how.again:
        for rule in sorted(_rules(folder)):  # and no more than it: what is made of its files is as old as before
            alone = ("--forcerun", rule, "--until", rule, "--rerun-triggers", "code")
            _snakemake(folder, how, "--cores", how.cores, *TINY, *alone, "--", "certify")
        _snakemake(
            folder,
            how,
            "--cores",
            how.cores,
            *TINY,
            "--forcerun",
            "certify",
            "--rerun-triggers",
            "code",
            "--",
            "certify",
        )
    return read_json(folder / CERTIFICATE)


def _rules(folder: Path) -> set[str]:
    """Rules that have made something in a run, by their logs; each network's training is a rule of its own."""
    logs = [path.relative_to(folder / "results/tiny/logs").with_suffix("") for path in
            (folder / "results/tiny/logs").rglob("*.log")]  # fmt: skip
    return {f"train_{log.name}" if log.parts[0] == "train" else log.parts[0] for log in logs}


def _snakemake(folder: Path, how: Varied, *arguments: object) -> None:
    environment = {**os.environ, "PYTHONHASHSEED": "0", **how.environment}
    environment |= {
        "MODLHMP_CACHE_DIR": str(folder / ".cache/kernels"),
        "MPLCONFIGDIR": str(folder / ".cache/matplotlib"),
    }
    if how.user:  # who may not write into our home
        environment |= {"HOME": str(folder), "XDG_CACHE_HOME": str(folder / ".cache")}
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", *map(str, arguments)], cwd=folder, env=environment, umask=how.umask,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, **_as_user(how.user),
    )  # fmt: skip
    if done.returncode:
        sys.exit(f"{folder}: {done.stdout[-3000:]}")


def _place(folder: Path, output: str) -> Path:
    """Where an output lies: certificates leave the run's name out."""
    first, rest = output.split("/", 1)
    return folder / first / "tiny" / rest


def _as_user(user: str | None) -> dict[str, Any]:
    """Options of a subprocess that is another user's, who is in none of our groups."""
    return {} if user is None else {"user": user, "group": pwd.getpwnam(user).pw_gid, "extra_groups": []}


def apart(one: Path, other: Path) -> float:
    """The largest difference of numbers of two Parquet files, of their size; infinite where texts or forms differ."""
    ours, theirs = pq.read_table(one), pq.read_table(other)
    if ours.schema.names != theirs.schema.names or len(ours) != len(theirs):
        return np.inf
    most = 0.0
    for name in ours.schema.names:
        a, b = (_numbers(table[name]) for table in (ours, theirs))
        if a is None or b is None:
            most = max(most, 0.0 if ours[name].equals(theirs[name]) else np.inf)
        elif a.shape != b.shape or (np.isnan(a) != np.isnan(b)).any():
            return np.inf
        elif len(a):
            most = max(most, float(np.nanmax(np.abs(a - b) / np.maximum(np.abs(b), 1.0), initial=0.0)))
    return most


def _numbers(column: pa.ChunkedArray) -> np.ndarray | None:
    values = column.combine_chunks()
    while pa.types.is_nested(values.type) and not pa.types.is_struct(values.type):
        values = values.flatten()
    known = pa.types.is_integer(values.type) or pa.types.is_floating(values.type)
    return values.to_numpy(zero_copy_only=False).astype(float) if known else None


def main(rows: Mapping[str, Varied] = ROWS, tell: Callable[[str], None] = print) -> int:
    """Print the table; 1 where a row that has to be alike is not."""
    wrong = 0
    with tempfile.TemporaryDirectory() as root:
        os.chmod(root, 0o755)  # another user has to get in
        first = made(Path(root, "first/run"), Varied())
        tell(f"| varied | same bytes, of {len(first['outputs'])} outputs | others: numbers at most apart | files |")
        tell("|---|---|---|---|")
        for number, (name, how) in enumerate(rows.items()):
            if how.user and os.geteuid():
                tell(f"| {name} | needs root | | |")
                continue
            folder = Path(root, str(number), how.folder)
            other = made(folder, how)
            lines = differences(first, other).get("outputs", [])
            files = [line.split(": ")[0] for line in lines]
            pairs = [
                (_place(Path(root, "first/run"), one), _place(folder, one)) for one in files if one.endswith(".parquet")
            ]
            pairs = [pair for pair in pairs if all(path.exists() for path in pair)]
            assert pairs or not any(file.endswith(".parquet") for file in files)
            far = max((apart(*pair) for pair in pairs), default=0.0)
            tell(f"| {name} | {len(first['outputs']) - len(files)} | {far:.1e} | {', '.join(files[:4])} |")
            wrong |= how.alike and bool(files)
            shutil.rmtree(folder)
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
