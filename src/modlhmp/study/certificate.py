"""A run's certificate: what went into it and what came out of it by SHA-256, and in what two certificates differ.

`make certify` writes `results/{run}/certificate.json`. `make verify` holds it against the files that lie there now, and
against the certificate of a second run, of another machine, or of a paper: `docs/trust.md`.
"""

import csv
import hashlib
import io
import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatch
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

from modlhmp.origins import by_name, file_sha256
from modlhmp.storage import DataError, boundary, read_json, read_metadata
from modlhmp.study.claims import CLAIMS, MEASURED
from modlhmp.study.layout import Layout

PACKAGE = Path(__file__).parents[1]
# Files of a run that are others each time, and why; nothing else is left out.
LEFT_OUT = {
    "certificate.json": "the certificate itself",
    "logs/*": "what jobs said, and when",
    "benchmarks/*": "how long jobs took",
    "*/costs.json": "how long a forecast takes",
    "*/runtime.json": "how long forecasts take",
    "*/models/*.checkpoint": "a training that has not ended",
    "runtime.*": "a figure of times",
    "report.html": "the exhibits on one page, with times among them",
    "tab_models.[!c]*": "the table of the CSV beside it, with times",
    "ladder-*.[!c]*": "the table of the CSV beside it, with times",
    "claims.[!c]*": "the table of the CSV beside it, with times",
}
# Keys of JSON, and columns of tables, that are times or depend on them, and rows of tables: claims about times and
# sizes. The rest of such a file counts.
TIMES = re.compile(r"seconds|minutes|ms per track|convergence")
TIMED_ROWS = {CLAIMS[name].text for name in MEASURED}
VARIABLES = ("NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "OMP_NUM_THREADS", "LC_ALL", "TZ")
FORM = 2  # of what a certificate names; the first had neither dataset files nor floor plans nor forecasts from outside
REASONS = ("inputs", "configuration", "code", "environment")


def certificate(layout: Layout, config: Mapping[str, Any], root: str | Path) -> dict[str, Any]:
    """The certificate of a run that has been made, of its `Plan.configuration`; `root` is the project's folder."""
    return {
        "form": FORM,
        "run": layout.run,
        "commit": _commit(root),
        "inputs": inputs(layout),
        "configuration": {key: _digest(json.dumps(value, sort_keys=True).encode()) for key, value in config.items()},
        "code": code(root),
        "environment": environment(root),
        "outputs": outputs(layout),
        "left_out": LEFT_OUT,
    }


def inputs(layout: Layout) -> dict[str, str]:
    """SHA-256 of every file from outside, by the dataset and the file, recordings also by their own names.

    They are those of the bytes that were read: results carry them, whatever kind of file it was.
    """
    results, recordings, others = Path(layout.results), dict[str, str](), list[tuple[str, str, str]]()
    for path in sorted(results.glob("*/**/*.parquet")):
        dataset, folder = path.relative_to(results).parts[:2]
        for name, digest in read_metadata(path).get("sources", {}).items():
            if folder == "tracks":
                recordings[f"{dataset}/{path.stem}/{name}"] = digest
            else:
                others.append((dataset, name, digest))
    known = {(name.split("/")[0], digest) for name, digest in recordings.items()}
    rest = [(f"{dataset}/{name}", digest) for dataset, name, digest in others if (dataset, digest) not in known]
    return recordings | by_name(rest)


def outputs(layout: Layout) -> dict[str, str]:
    """SHA-256 of every file of a run, of tables and JSON with times of the rest of them."""
    return {
        f"{top}/{name}": content_sha256(path)
        for top, folder in (("results", layout.results), ("paper_figures", layout.exhibits))
        for name, path in _files(Path(folder))
        if not any(fnmatch(name, pattern) for pattern in LEFT_OUT)
    }


def content_sha256(path: Path) -> str:
    """SHA-256 of a file; of JSON and CSV without what `TIMES` and `TIMED_ROWS` name."""
    if path.suffix == ".json":
        return _digest(json.dumps(_timeless(read_json(path)), sort_keys=True).encode())
    if path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if not TIMED_ROWS.intersection(row[:1])]
        kept = [place for place, name in enumerate(rows[0] if rows else []) if not TIMES.search(name)]
        text = io.StringIO()
        csv.writer(text).writerows([[row[place] for place in kept if place < len(row)] for row in rows])
        return _digest(text.getvalue().encode())
    return file_sha256(path)


def code(root: str | Path) -> dict[str, str]:
    """SHA-256 of every file of the package and of the workflow."""
    parts = {"modlhmp": PACKAGE, "workflow": Path(root) / "workflow"}
    return {
        f"{part}/{name}": file_sha256(path)
        for part, folder in parts.items()
        for name, path in _files(folder)
        if "__pycache__" not in name
    }


def environment(root: str | Path) -> dict[str, str]:
    """Python, machine, the lock, versions of all packages, and variables that numerical libraries obey."""
    lock = Path(root) / "environment.lock"
    return {
        "python": platform.python_version(),
        "system": platform.system(),
        "machine": platform.machine(),
        "processor": _processor(),
        "environment.lock": file_sha256(lock) if lock.exists() else "none",
        **{name: os.environ[name] for name in VARIABLES if name in os.environ},
        **{one.metadata["Name"].lower(): one.version for one in distributions() if one.metadata["Name"]},
    }


def differences(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> dict[str, list[str]]:
    """{part of the certificate: what differs there}; parts that are the same are left out.

    Of two forms, one names more of what went in than the other: only what both name is compared there.
    """
    found = {}
    for part in (*REASONS, "outputs"):
        one, other = ours.get(part, {}), theirs.get(part, {})
        in_both = part in ("inputs", "configuration") and ours.get("form") != theirs.get("form")
        names = {*one} & {*other} if in_both else {*one, *other}
        named = [name for name in sorted(names) if one.get(name) != other.get(name)]
        if named:
            found[part] = [_difference(name, one.get(name), other.get(name)) for name in named]
    return found


def verdict(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> str:
    """What the differences between two certificates come to, in one sentence."""
    found, number = differences(ours, theirs), len(ours["outputs"])
    reasons = [part for part in REASONS if part in found]
    if "outputs" not in found:
        return f"the same: all {number:,} outputs" + (f", with other {_and(reasons)}" if reasons else "")
    told = f"{len(found['outputs']):,} of {number:,} outputs differ"
    if reasons:
        told += f", with other {_and(reasons)}, which may be why"
    if any(one.get("form") != FORM for one in (ours, theirs)):
        return f"{told}; a certificate of an earlier form does not name all that went in"
    return told if reasons else f"{told}, and nothing that went in does: please report this"


def verify(layout: Layout, other: str | Path | None) -> tuple[dict[str, list[str]], str]:
    """(differences, verdict) of a run's files from its certificate, or from another one; `DataError` without any."""
    own = read_json(layout.certificate)
    now = {**own, "outputs": outputs(layout)}
    changed, number = differences(now, own), len(own["outputs"])
    if changed or other is None:
        told = f"{len(changed['outputs'])} of {number} outputs have changed" if changed else verdict(now, own)
        return changed, f"since the certificate was written: {told}"
    with boundary(other, "cannot be read as a certificate"):
        theirs = read_json(other)
        return differences(own, theirs), f"{other}: {verdict(own, theirs)}"


def _files(folder: Path) -> Iterator[tuple[str, Path]]:
    """(name from the folder on, path) of every file below it, sorted."""
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".")):
        yield path.relative_to(folder).as_posix(), path


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _timeless(one) for key, one in value.items() if not TIMES.search(key)}
    return [_timeless(one) for one in value] if isinstance(value, list) else value


def _difference(name: str, one: str | None, other: str | None) -> str:
    if one is None or other is None:
        return f"{name}: only in the {'other' if one is None else 'first'}"
    return f"{name}: {one[:12]} and {other[:12]}"


def _and(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _commit(root: str | Path) -> str:
    """The commit of the project's folder, with `+` where files differ from it; "" outside a repository."""
    told = subprocess.run(
        ["git", "-C", str(root), "describe", "--always", "--abbrev=40", "--dirty=+", "--exclude=*"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return told.stdout.strip()


def _processor() -> str:
    """The processor's name; vectorised loops, and so last digits, may depend on it."""
    try:
        told = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.processor()
    named = re.search(r"^model name\s*:\s*(.*)$", told, re.MULTILINE)
    return named[1] if named else platform.processor()


def main(arguments: Sequence[str]) -> int:
    """`python -m modlhmp.study.certificate RUN [CERTIFICATE]`: status 0 where the outputs are the same, else 1."""
    try:
        found, told = verify(Layout(arguments[0]), arguments[1] if len(arguments) > 1 else None)
    except DataError as error:
        print(f"modlhmp: {error}", file=sys.stderr)
        return 1
    for part, lines in found.items():
        print(f"{part}:", *lines, sep="\n  ")
    print(told)
    return 1 if "outputs" in found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
