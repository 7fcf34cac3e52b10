"""Names of files that are being written, and what is left of those whose writers were killed."""

import hashlib
import os
import re
import shutil
import time
from pathlib import Path

_TEMPORARY = re.compile(r"\..+\.(h[0-9a-f]{8})\.([1-9]\d*)\.part")  # a `temporary_name`: by which host and process
_STALE_S = 7 * 86400.0  # of a writer on another host, of which no process can be asked: no job takes so long


def temporary_name(path: Path) -> Path:
    """A name beside `path`, of which `remove_leftovers` knows that this process of this host gave it."""
    return path.with_name(f".{path.name}.{_host()}.{os.getpid()}.part")


def _host() -> str:
    """The host in a file's name: a digest, since names of hosts are long and have points."""
    return "h" + hashlib.sha256(os.fsencode(os.uname().nodename)).hexdigest()[:8]


def remove_leftovers(*folders: str | Path) -> list[Path]:
    """Delete what has a `temporary_name` in folders and below whose writers are no more; returns them.

    A process that is killed cannot delete its own. Other hosts' may still be written, by jobs of a cluster that outlive
    their run, say: they are left until nothing has been written for a week. Folders that do not exist hold none.
    """
    left = []
    for path in (path for folder in folders for path in sorted(Path(folder).rglob(".*.part"))):
        writer = _TEMPORARY.fullmatch(path.name)
        if writer and not (_runs(int(writer[2])) if writer[1] == _host() else _is_fresh(path)):
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)
            left.append(path)
    return left


def _is_fresh(path: Path) -> bool:
    """Whether a file of another host has been written to of late, or is just being given its name."""
    try:
        return time.time() - path.lstat().st_mtime < _STALE_S
    except FileNotFoundError:
        return True


def _runs(process: int) -> bool:
    """Whether there is a process of this number."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True
