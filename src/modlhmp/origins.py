"""What a file was made of: hashes of inputs as they were read, settings and code, for the metadata of every result."""

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from modlhmp.storage import SEAL, DataError, read_json, read_metadata


def file_sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes as hexadecimal text."""
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        while block := file.read(1 << 18):
            digest.update(block)
    return digest.hexdigest()


def file_state(path: str | Path) -> tuple[int, ...] | None:
    """Which file stands under a name, its size and its time, by which a change shows; None where there is none."""
    try:
        found = os.stat(path)
    except FileNotFoundError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def check_unchanged(path: str | Path, same: bool) -> None:
    """`DataError` where a file is not the `same` as when reading began."""
    if not same:
        raise DataError(f"{path}: changed while it was read; wait until it is complete, then run again")


@contextmanager
def unchanged(*paths: str | Path) -> Iterator[dict[Path, str]]:
    """The SHA-256 of files that are read within; `DataError` where one is another at the end, by state or by hash."""
    states = {Path(path): file_state(path) for path in paths}
    hashes = {path: file_sha256(path) for path in states}
    yield hashes
    for path, state in states.items():
        check_unchanged(path, file_state(path) == state is not None and file_sha256(path) == hashes[path])


def by_name(files: Iterable[tuple[str, str]]) -> dict[str, str]:
    """{name: SHA-256} of files, each given as (name, SHA-256), so that those of one name are all kept.

    Different ones are told apart by the beginnings of their hashes, `tracks.csv@0123456789ab`: wherever they lie, and
    also where one comes with the origin of a result, which names no folder. Names made so may be given again.
    """
    known: dict[str, dict[str, None]] = {}
    for name, digest in files:
        known.setdefault(name.removesuffix(f"@{digest[:12]}"), {})[digest] = None
    return {
        name if len(digests) == 1 else f"{name}@{digest[:12]}": digest
        for name, digests in known.items()
        for digest in digests
    }


def provenance(
    wildcards: Mapping[str, Any],
    params: Mapping[str, Any],
    inputs: Iterable[str | Path],
    hashes: Mapping[Path, str] | None = None,
) -> dict[str, Any]:
    """Where a result comes from: dataset and other wildcards, hash of the settings, code version, source files.

    `inputs` are the files it was made of: a raw file is hashed, a Parquet file of ours hands on the sources it carries,
    and its settings and code go into the hash of the result's; so does the JSON file beside a network's weights. The
    sources are {file name: SHA-256}, of several files of one name as in `by_name`.
    `hashes` are those of files that are known already (`unchanged`).
    """
    settings = {key: value for key, value in params.items() if key != "code"}
    sources: list[tuple[str, str]] = []
    upstream = set()
    for path in map(Path, inputs):
        for file in sorted(path.glob("*.parquet")) if path.is_dir() else [path]:
            origin = read_metadata(file) if file.suffix == ".parquet" else None
            if file.suffix == ".json" and any(mark in file.read_bytes() for mark in (SEAL, b'"origin"')):
                origin = read_json(file).get("origin")
            if origin:
                sources += origin.get("sources", {}).items()
                upstream.add((str(origin.get("settings")), str(origin.get("code"))))
            elif file.is_file():
                sources.append((file.name, (hashes or {}).get(file) or file_sha256(file)))
    described = json.dumps([settings, sorted(upstream)], sort_keys=True, default=str)
    return {
        **wildcards,
        "settings": hashlib.sha256(described.encode()).hexdigest()[:12],
        "code": params.get("code"),
        "seed": params.get("seeds"),
        "sources": by_name(sources),
    }
