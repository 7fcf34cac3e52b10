"""Maps of dynamics and long-term human motion prediction.

Data flow one way: readers -> cleaning -> maps -> forecasting -> scoring -> paper.
"""

import hashlib
import os
from pathlib import Path

__version__ = "0.1.0"


def _kernel_cache():
    """Where compiled kernels are kept: a folder a version of their sources.

    Numba looks at a kernel's own file only, so after an edit of a function that it calls it would go on with the old
    machine code.
    """
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        source = file.read_bytes()
        if b"@njit" in source:
            digest.update(source)
    base = Path(os.environ.get("NUMBA_CACHE_DIR") or Path.home() / ".cache" / "modlhmp")
    version = digest.hexdigest()[:12]
    return base if base.name == version else base / version  # a child process inherits the folder


os.environ["NUMBA_CACHE_DIR"] = str(_kernel_cache())
