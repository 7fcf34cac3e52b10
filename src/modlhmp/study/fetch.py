"""Recordings from their owners' servers: downloads that resume, and SHA-256 sums recorded at first use."""

import fcntl
import http.client
import os
import re
import ssl
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import contextmanager
from email.utils import mktime_tz, parsedate_tz
from pathlib import Path
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

from tqdm import tqdm

from modlhmp.cleaning import source_of
from modlhmp.file_format import FileFormat, Recording
from modlhmp.origins import file_sha256
from modlhmp.readers import read_recording
from modlhmp.splits import only_of
from modlhmp.storage import DataError, put_in_place, read_json, refused, write_json, write_text

BACKOFF = 1.0  # seconds before the first retry, doubled before each further one, where the server names none
LONGEST_WAIT = 300.0  # seconds that a server may ask for; a job that sleeps for longer looks as if it had died
TIMEOUT = 60.0  # seconds without an answer or a byte
HELD_BYTES = 1 << 26  # of a download; after so many, those that have come are made to last
# A plain OSError is not among them: a full disk does not pass.
_PASSING = (URLError, http.client.HTTPException, ConnectionError, TimeoutError, ssl.SSLError)
_UNUSABLE = (ValueError, http.client.InvalidURL)
_BY_HAND = "put the file there by hand, or give its sha256 in the dataset file"


def fetch(
    url: str,
    path: str | Path,
    sha256: str | None = None,
    sums: str | Path | None = None,
    retries: int = 5,
    progress: bool = True,
    name: str | None = None,
    read: Callable[[Path], object] | None = None,
) -> str:
    """Download `url` to `path`, check it as `check_sum` does, and return its SHA-256.

    Without a known sum `read` must be able to read what came, which is then recorded in `sums`: a page to log in is no
    recording. A file already at `path` is checked, never replaced. An interrupted download stays in `<path>.part`,
    where the next call continues it if the server still has the same version. Raises `DataError` if the address is
    refused (4xx) or unusable, the answer cannot be judged (neither length nor sum), the server fails all `retries`
    retries or asks to come back later, another process is downloading the file, its folder cannot be written to, or
    the sum differs or `read` fails (the download is then discarded); `OSError` if the disk is full.
    """
    path = Path(path)
    if path.exists():
        return check_sum(path, name, sha256, sums)
    part = path.with_name(path.name + ".part")
    note = part.with_name(part.name + ".json")  # of which version the part is
    with _opened(part) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DataError(f"{part}: another process is downloading this file; wait until it has finished") from None
        if path.exists():  # another process has renamed what is open here since the look above
            return check_sum(path, name, sha256, sums)
        known = _expected(path, name, sha256, sums)[0] is not None
        try:
            _download(url, file, path, note, known, retries, progress)
        except DataError:
            if not part.stat().st_size:
                part.unlink()
                note.unlink(missing_ok=True)
            raise
        try:
            found = _check(part, path, name, sha256, sums, "the download was discarded; run again")
            if read and not known:
                _read(read, part, path, url)
        except DataError:
            part.unlink()
            note.unlink(missing_ok=True)
            raise
        put_in_place(part, path)
        note.unlink(missing_ok=True)
    if sums:
        record_sum(found, name or os.path.relpath(path, Path(sums).parent), sums)
    return found


def read_as(path: Path, form: FileFormat, recordings: Iterable[Recording]) -> None:
    """Read a file as the recordings that it holds; `DataError` where it holds no such thing."""
    for one in recordings:
        file = Path(path, one.member) if one.member else path
        people = Recording(people=(str(file),) if one.people else ())
        read_recording(source_of(file, form, people), only_of(form, one), one.day, one.start, one.days)


def listed_sources(
    files: Sequence[str], first: str, sources: Iterable[Mapping[str, Any]]
) -> dict[str, Mapping[str, Any]]:
    """{file: the source that it is} of a recording's `files`, one or its people's; others are left out.

    `first` is the path of the first of them under the data root, as `file` of each source is.
    """
    root, named = files[0].removesuffix(first) or ".", {one["file"]: one for one in sources}
    return {file: named[name] for file in files if (name := os.path.relpath(file, root)) in named}


def _read(read, part, path, url):
    """Read a download under its own name, by whose suffix readers know archives."""
    with tempfile.TemporaryDirectory() as folder:
        named = Path(folder, path.name)
        named.symlink_to(part.resolve())
        try:
            read(named)
        except DataError as error:
            reason = str(error).replace(str(named), path.name)
            raise DataError(
                f"{path}: what {url} sends is not what the dataset file says ({reason}); it was discarded. Look at the "
                "address in a browser: is it a page to log in, or an error? Correct its url or the file's form, or "
                f"{_BY_HAND}"
            ) from None


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

    The line is that of `name`, or else of the path relative to the folder of `sums`. Where there is none (`record_sum`)
    nothing is checked. Raises `DataError` if the sum differs or a line of `sums` cannot be read; `OSError` if the file
    cannot be read.
    """
    return _check(path, path, name, sha256, sums, f"delete {path} and run again to fetch a fresh copy")


def record_sum(found: str, name: str, sums: str | Path) -> None:
    """Give a file that was read, of SHA-256 `found`, a line in `sums`, as sha256sum writes it; one that it has stays.

    Raises `DataError` if a line cannot be read; `OSError` if `sums` cannot be written.
    """
    sums = Path(sums)
    if name in _read_sums(sums):
        return
    sums.parent.mkdir(parents=True, exist_ok=True)
    with open(sums.with_name(f".{sums.name}.lock"), "a") as lock:  # stays: removing it would let two in
        fcntl.flock(lock, fcntl.LOCK_EX)
        if name not in _read_sums(sums):
            text = sums.read_text(encoding="utf-8") if sums.exists() else ""
            gap = "" if not text or text.endswith("\n") else "\n"
            write_text(sums, f"{text}{gap}{found}  {name}\n")


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


def _download(url, file, path, note, known, retries, progress):
    """Complete the open partial `file`, with retries; raises `DataError` when that fails."""
    for attempt in range(retries + 1):
        delay = BACKOFF * 2**attempt
        try:
            with refused(f"{path}: {url!r} is not a usable address", *_UNUSABLE, remedy="correct its url"):
                return _attempt(url, file, path, note, known, progress)
        except _PASSING as error:
            if isinstance(error, HTTPError):
                if error.code < 500 and error.code != http.client.TOO_MANY_REQUESTS:
                    remedy = "correct its url in the dataset file or put the file there by hand"
                    raise DataError(f"{path}: {url} answered {error.code} {error.reason}; {remedy}") from None
                delay = _asked_delay(error.headers.get("Retry-After", ""), delay)
            reason = f"{type(error).__name__}: {error}"
        if delay > LONGEST_WAIT:
            raise DataError(
                f"{path}: {url} failed with {reason} and asks to be left alone for {delay:.0f} s; run again then"
            )
        if attempt < retries:
            time.sleep(delay)
    remedy = "check the network and run again, the download continues where it stopped"
    raise DataError(f"{path}: {url} failed {retries + 1} times, last with {reason}; {remedy}")


def _asked_delay(text, otherwise):
    """The seconds of a header Retry-After, which names them or a date; `otherwise` where it names neither."""
    if text.isascii() and text.isdigit():
        return float(text)
    try:
        return max(mktime_tz(parsedate_tz(text)) - time.time(), 0.0)
    except (TypeError, ValueError, OverflowError):
        return otherwise


def _attempt(url, file, path, note, known, progress):
    """One request and its body, appended to `file`; raises one of `_PASSING` if the end is not reached."""
    response = _open(url, file, path, note)
    if response is None:
        return
    size = os.fstat(file.fileno()).st_size
    total = None if response.length is None else size + response.length
    bar = tqdm(
        total=total, initial=size, desc=path.name, disable=not progress, unit="B", unit_scale=True, mininterval=1.0
    )
    held = size
    with response, bar, _lasting(file, note):
        if total is None and not (known or response.chunked):
            raise DataError(
                f"{path}: {url} does not say how long it is, so a cut connection would pass for its end; {_BY_HAND}"
            )
        while block := response.read1(1 << 20):  # what has arrived, so that a broken connection loses nothing
            size += file.write(block)
            bar.update(len(block))
            if size - held >= HELD_BYTES:
                _hold(file, note)
                held = size
    if total is not None and size != total:
        raise ConnectionError(f"the connection ended after {size} of {total} bytes")
    if not size:
        raise ConnectionError("the server sent nothing")


@contextmanager
def _lasting(file, note):
    """Whatever ends this, all that has come is made to last, but after a kill or a loss of power."""
    try:
        yield
    finally:
        _hold(file, note)


def _hold(file, note):
    """Put a part's bytes on disk, and note how many: beyond them anything may stand after a loss of power."""
    file.flush()
    os.fsync(file.fileno())
    write_json(note, {**read_json(note), "held": os.fstat(file.fileno()).st_size})


def _open(url, file, path, note):
    """Request what `file` lacks: the response whose body is to be appended, or None if nothing is lacking."""
    file.flush()
    version = _noted(note, url)
    size = min(os.fstat(file.fileno()).st_size, version.get("held", 0))
    file.truncate(size)
    version = version if size else {}
    if size and size == version.get("total"):
        return None
    request = Request(url, headers={"User-Agent": "modlhmp", "Accept-Encoding": "identity"})
    if version.get("validator"):
        request.add_header("Range", f"bytes={size}-")
        request.add_header("If-Range", version["validator"])
    try:
        response = urlopen(request, timeout=TIMEOUT)
    except HTTPError as error:
        if not request.has_header("Range") or error.code != http.client.REQUESTED_RANGE_NOT_SATISFIABLE:
            raise
        response = error
    if request.has_header("Range") and _continues(response, size, version):
        return response
    file.truncate(0)  # before the note: a part without one is begun anew
    note.unlink(missing_ok=True)
    if response.status != http.client.OK:
        response.close()
        if request.has_header("Range"):
            return _open(url, file, path, note)
        raise DataError(f"{path}: {url} answered {response.status} to a request for the whole file; {_BY_HAND}")
    encoding = response.headers.get("Content-Encoding", "identity").lower()
    if encoding != "identity" and not (encoding in {"gzip", "x-gzip"} and path.suffix == ".gz"):
        response.close()
        raise DataError(
            f"{path}: {url} sends it packed ({encoding}), which was not asked for; put the file there by hand"
        )
    write_json(note, {"url": url, "validator": _validator(response.headers), "total": response.length, "held": 0})
    return response


def _noted(note, url):
    """What is known of the version that a part is of, nothing where it is not of this address."""
    try:
        noted = read_json(note)
    except DataError:
        return {}
    return noted if noted.get("url") == url else {}


def _validator(headers):
    """What tells versions of a file apart: its ETag, or else its date if two cannot share it; None if neither does."""
    etag, changed, sent = (headers.get(key, "") for key in ("ETag", "Last-Modified", "Date"))
    if etag.startswith('"'):  # not W/"...", which two versions may have
        return etag
    try:
        return changed if mktime_tz(parsedate_tz(sent)) > mktime_tz(parsedate_tz(changed)) else None
    except (TypeError, ValueError, OverflowError):
        return None


def _continues(response, size, version):
    """Whether a response goes on from the end of the part, to the end of the same version."""
    span = re.fullmatch(r"bytes (\d+)-(\d+)/(\d+)", response.headers.get("Content-Range", ""), re.ASCII)
    if response.status != http.client.PARTIAL_CONTENT or span is None:
        return False
    first, last, total = (int(number[:18]) for number in span.groups())
    return (
        first == size
        and last + 1 == total == size + (response.length or 0)
        and version["total"] in (None, total)
        and version["validator"] in (response.headers.get("ETag"), response.headers.get("Last-Modified"))
    )


def _check(file, path, name, sha256, sums, remedy):
    """Compare the sum of `file`, known as `path`, and return it; raises `DataError` if it differs."""
    found = file_sha256(file)
    expected, correction = _expected(path, name, sha256, sums)
    if expected not in (None, found):
        remedy = f"{remedy}, or, if the owner has published a new version, {correction}"
        raise DataError(f"{path}: expected SHA-256 {expected}, found {found}; {remedy}")
    return found


def _expected(path, name, sha256, sums):
    """The sum that a file should have, None where none is known, and what to correct where it is wrong."""
    if sha256:
        return sha256.lower(), "correct its sha256 in the dataset file"
    name = name or (sums and os.path.relpath(path, Path(sums).parent))
    return (_read_sums(Path(sums)).get(name) if sums else None), f"delete the line of {name} in {sums}"


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
