"""Logs of a job, to its file and to the terminal, and its progress; bad input ends it with a message."""

import contextlib
import errno
import functools
import logging
import resource
import sys
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
from tqdm import tqdm

from modlhmp.storage import DataError

# Of whatever takes over 5 s: how much is done, how fast, how long to go.
progress = functools.partial(tqdm, delay=5.0, mininterval=5.0)


@contextlib.contextmanager
def job_log(path: str | Path) -> Iterator[logging.Logger]:
    """Yield a logger that writes to `path` and to stderr.

    A `DataError` is logged as its message, anything else with its traceback; both end the process with status 1.
    """
    pa.set_memory_pool(pa.system_memory_pool())  # gives memory back; the default one keeps some 20 MB in every job
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    logging.basicConfig(
        level=logging.WARNING, format="%(message)s", force=True,
        handlers=[logging.FileHandler(path, mode="w"), logging.StreamHandler(sys.stderr)],
    )  # fmt: skip
    logging.captureWarnings(True)
    warnings.simplefilter("default")
    log = logging.getLogger("modlhmp")
    log.setLevel(logging.INFO)
    try:
        yield log
    except DataError as error:
        log.error("%s", error)
        sys.exit(1)
    except MemoryError as error:
        log.error("%s", _no_memory(error))
        sys.exit(1)
    except OSError as error:
        log.error(
            "%s", f"{error}: make room, then run again" if error.errno == errno.ENOSPC else traceback.format_exc()
        )
        sys.exit(1)
    except Exception:
        log.error("%s", traceback.format_exc())
        sys.exit(1)


def _no_memory(error: MemoryError) -> str:
    """What to say where memory does not suffice, with how much this process had until then."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # KiB, on macOS bytes
    had = peak / (1e6 if sys.platform == "darwin" else 1e3)
    about = f" ({error})" if str(error) else ""
    return f"The memory does not suffice{about}: this job had {had:.0f} MB; run fewer jobs at once (--cores 1)"
