"""Whether a run is at work in a folder: each of its processes holds a lock that dies with it.

Snakemake's own lock is files, which outlive a run that was killed, and say neither whose they are nor whether it lives.
"""

import fcntl
import os
import shutil
import sys
from pathlib import Path

from modlhmp.storage import DataError

_LOCKS, _MARK = ".snakemake/locks", ".snakemake/modlhmp.lock"
_held: list[int] = []  # open files, until the process ends


def join(folder: str | Path) -> str:
    """Hold a folder's lock together with the other processes of a run, for as long as this one lives.

    Returns what to say of a lock of Snakemake's that is there already: whether it is stale; empty where there is none.
    """
    others = None
    try:
        lock = _opened(folder)
        if not _alone(lock):
            others = _at_work(folder)
        fcntl.flock(lock, fcntl.LOCK_SH)
    except OSError:  # a folder that may not be written to, or whose file system has no locks
        return ""
    _held.append(lock)
    if not any(Path(folder, _LOCKS).glob("*")):
        return ""
    if others is not None:
        return f"{others} in {folder}, so its lock is not stale: wait until it has ended"
    return f"The lock of {folder} is stale: the run that took it is gone (it was killed). `make unlock` removes it."


def leave() -> None:
    """Give the lock back before the process ends."""
    while _held:
        os.close(_held.pop())


def unlock(folder: str | Path) -> str:
    """Remove the lock that a killed run has left; returns what was done. `DataError` where a run is at work."""
    if not any(Path(folder, _LOCKS).glob("*")):
        return f"{folder} is not locked."
    try:
        lock = _opened(folder)
    except OSError as error:
        raise DataError(f"{folder}: cannot be unlocked ({error.strerror})") from None
    try:
        if not _alone(lock):
            raise DataError(f"{_at_work(folder)} in {folder}: nothing was unlocked; wait until it has ended, or end it")
        shutil.rmtree(Path(folder, _LOCKS))
    finally:
        os.close(lock)
    return f"The lock of {folder} was stale (no process of a run is left) and has been removed: run again."


def _opened(folder):
    """The file of a folder's lock, open."""
    path = Path(folder, _MARK)
    path.parent.mkdir(exist_ok=True)
    return os.open(path, os.O_RDWR | os.O_CREAT, 0o666)


def _alone(lock):
    """Whether nobody else holds a lock, which is this process's alone then."""
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _at_work(folder):
    """Who holds a folder's lock, as text; only Linux says which processes these are."""
    try:
        inode = os.stat(Path(folder, _MARK)).st_ino
        listed = [line.split() for line in Path("/proc/locks").read_text().splitlines()]
        holders = sorted({int(one[4]) for one in listed if len(one) == 8 and one[5].endswith(f":{inode}")} - {0, -1})
    except (OSError, ValueError):
        holders = []
    numbers = f" (process {', '.join(map(str, holders))})" if holders else ""
    return f"A run is at work{numbers}"


if __name__ == "__main__":
    try:
        print(unlock(Path.cwd()))
    except DataError as error:
        sys.exit(str(error))
