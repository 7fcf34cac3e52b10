"""Recordings from their owners' servers: downloads that resume, and SHA-256 sums recorded at first use."""

import fcntl
import http.client
import os
import re
import ssl
import time
from email.utils import mktime_tz, parsedate_tz
from pathlib import Path
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

from tqdm import tqdm

from modlhmp.storage import DataError, file_sha256, write_text

BACKOFF = 1.0  # seconds before the first retry, doubled before each further one
TIMEOUT = 60.0  # seconds without an answer or a byte
# A plain OSError is not among them: a full disk does not pass.
_PASSING = (URLError, http.client.HTTPException, ConnectionError, TimeoutError, ssl.SSLError)


def fetch(
    url: str,
    path: str | Path,
    sha256: str | None = None,
    sums: str | Path | None = None,
    retries: int = 5,
    progress: bool = True,
    name: str | None = None,
) -> str:
    """Download `url` to `path`, check it as `check_sum` does, and return its SHA-256.

    A file already at `path` is checked, never replaced. An interrupted download stays in `<path>.part`, where
    the next call continues it. Raises `DataError` if the address is refused (4xx) or unusable, the server
    fails all `retries` retries, another process is downloading the file, its folder cannot be written to, or the
    sum differs (the download is then discarded); `OSError` if the disk is full.
    """
    path = Path(path)
    if path.exists():
        return check_sum(path, name, sha256, sums)
    part = path.with_name(path.name + ".part")
    with _opened(part) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DataError(f"{part}: another process is downloading this file; wait until it has finished") from None
        if path.exists():  # another process has renamed what is open here since the look above
            return check_sum(path, name, sha256, sums)
        try:
            _download(url, file, path, retries, progress)
        except DataError:
            if not part.stat().st_size:
                part.unlink()
            raise
        try:
            found = _check(part, path, name, sha256, sums, "the download was discarded; run again")
        except DataError:
            part.unlink()
            raise
        part.replace(path)
    return found


def _opened(part):
    """The partial file, open to be continued; its folder is made."""
    try:
        part.parent.mkdir(parents=True, exist_ok=True)
        return open(part, "ab")
    except OSError as error:
        remedy = "let it be written to, put the file there by hand, or name another folder as data_root"
        raise DataError(f"{part}: the folder cannot be written to ({error.strerror}); {remedy}") from None


def check_sum(
    path: str | Path, name: str | None = None, sha256: str | None = None, sums: str | Path | None = None
) -> str:
    """Check a file against `sha256`, else against its line in the text file `sums`; return its SHA-256.

    A file without a line in `sums` gets one, as sha256sum writes it, under `name` or else under its path
    relative to the folder of `sums`. Without `sha256` and `sums` nothing is checked. Raises `DataError` if
    the sum differs or a line of `sums` cannot be read; `OSError` if the file cannot be read or `sums` written.
    """
    return _check(path, path, name, sha256, sums, f"delete {path} and run again to fetch a fresh copy")


def missing_message(file: str, expected_path: str | Path, owner_page: str, title: str) -> str:
    """What to tell the user about a file that has to be fetched by hand."""
    expected_path = Path(expected_path)
    return (
        f"{title}: {file} is missing and has no address to fetch it from.\n"
        f"Get it from its owner's page: {owner_page}\n"
        f"and put {expected_path.name} (or the same name with .gz, .bz2 or .zip appended)\n"
        f"into the folder {expected_path.parent}\n"
        "If your recordings are elsewhere, say so in the environment variable MODLHMP_DATA or in data_root."
    )


def _download(url, file, path, retries, progress):
    """Complete the open partial `file`, with retries; raises `DataError` when that fails."""
    for attempt in range(retries + 1):
        try:
            return _attempt(url, file, path.name, progress)
        except (ValueError, http.client.InvalidURL) as error:
            raise DataError(f"{path}: {url!r} is not a usable address ({error}); correct its url") from None
        except _PASSING as error:
            if isinstance(error, HTTPError) and error.code < 500:
                remedy = "correct its url in the dataset file or put the file there by hand"
                raise DataError(f"{path}: {url} answered {error.code} {error.reason}; {remedy}") from None
            reason = f"{type(error).__name__}: {error}"
        if attempt < retries:
            time.sleep(BACKOFF * 2**attempt)
    remedy = "check the network and run again, the download continues where it stopped"
    raise DataError(f"{path}: {url} failed {retries + 1} times, last with {reason}; {remedy}")


def _attempt(url, file, label, progress):
    """One request and its body, appended to `file`; raises one of `_PASSING` if the end is not reached."""
    response = _open(url, file)
    if response is None:
        return
    size = os.fstat(file.fileno()).st_size
    length = response.headers.get("Content-Length")
    total = None if length is None else size + int(length)
    bar = tqdm(total=total, initial=size, desc=label, disable=not progress, unit="B", unit_scale=True, mininterval=1.0)
    with response, bar:
        while block := response.read1(1 << 20):  # what has arrived, so that a broken connection loses nothing
            size += file.write(block)
            bar.update(len(block))
    file.flush()
    if total is not None and size != total:
        raise ConnectionError(f"the connection ended after {size} of {total} bytes")


def _open(url, file):
    """Request what `file` lacks: the response whose body is to be appended, or None if nothing is lacking."""
    file.flush()
    state = os.fstat(file.fileno())
    request = Request(url, headers={"User-Agent": "modlhmp"})
    if not state.st_size:
        return urlopen(request, timeout=TIMEOUT)
    request.add_header("Range", f"bytes={state.st_size}-")
    try:
        response = urlopen(request, timeout=TIMEOUT)
        if _continues(response, state):
            return response
    except HTTPError as error:
        if error.code != http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
            raise
        if error.headers.get("Content-Range") == f"bytes */{state.st_size}":
            return None
        response = error
    file.truncate(0)
    if response.status == http.client.OK:
        return response
    response.close()
    return _open(url, file)


def _continues(response, state):
    """Whether a response goes on from the partial file: at its end, not changed since."""
    changed = parsedate_tz(response.headers.get("Last-Modified", ""))
    return (
        response.status == http.client.PARTIAL_CONTENT
        and response.headers.get("Content-Range", "").startswith(f"bytes {state.st_size}-")
        and (changed is None or mktime_tz(changed) <= state.st_mtime)
    )


def _check(file, path, name, sha256, sums, remedy):
    """Compare the sum of `file`, known as `path`, and return it; raises `DataError` if it differs."""
    found = expected = file_sha256(file)
    if sha256:
        expected, correction = sha256.lower(), "correct its sha256 in the dataset file"
    elif sums:
        name = name or os.path.relpath(path, Path(sums).parent)
        expected, correction = _recorded(Path(sums), name, found), f"delete the line of {name} in {sums}"
    if found != expected:
        remedy = f"{remedy}, or, if the owner has published a new version, {correction}"
        raise DataError(f"{path}: expected SHA-256 {expected}, found {found}; {remedy}")
    return found


def _recorded(sums, name, found):
    """The sum recorded under `name`; `found` is recorded if there was none."""
    known = _read_sums(sums)
    if name not in known:
        sums.parent.mkdir(parents=True, exist_ok=True)
        with open(sums.with_name(f".{sums.name}.lock"), "a") as lock:  # stays: removing it would let two in
            fcntl.flock(lock, fcntl.LOCK_EX)
            known = _read_sums(sums)
            if name not in known:
                text = sums.read_text(encoding="utf-8") if sums.exists() else ""
                gap = "" if not text or text.endswith("\n") else "\n"
                write_text(sums, f"{text}{gap}{found}  {name}\n")
    return known.get(name, found)


def _read_sums(sums):
    """Recorded sums by name (none without a file); raises `DataError` for a line that is not one."""
    known = {}
    lines = sums.read_text(encoding="utf-8").splitlines() if sums.exists() else []
    for row, line in enumerate(lines, 1):
        if match := re.fullmatch(r"([0-9a-fA-F]{64}) [ *](.+)", line):
            known[match[2]] = match[1].lower()
        elif line.strip():
            raise DataError(f"{sums}, line {row}: {line!r} is not '<SHA-256>  <file>'; correct or delete it")
    return known
