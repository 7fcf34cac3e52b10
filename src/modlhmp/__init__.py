"""Maps of dynamics and long-term human motion prediction.

Data flow one way: readers -> cleaning -> maps -> forecasting -> scoring -> paper.
"""

import hashlib
import os
import re
from pathlib import Path

__version__ = "0.1.0"


def _kernel_cache():
    """Where compiled kernels are kept: a folder a version of their sources and of the modules that these name.

    Numba looks at a kernel's own file only, so after an edit of a function that it calls, or of a constant that it was
    compiled with, it would go on with the old machine code.
    """
    package, digest = Path(__file__).parent, hashlib.sha256()
    sources = {file: file.read_bytes() for file in sorted(package.rglob("*.py"))}
    used = {file for file, source in sources.items() if b"@njit" in source}
    for file in list(used):
        for name in re.findall(rb"^from modlhmp\.([\w.]+) import", sources[file], re.MULTILINE):
            used.add(package.joinpath(*name.decode().split(".")).with_suffix(".py"))
    for file in sorted(used & sources.keys()):
        digest.update(sources[file])
    base = Path(os.environ.get("NUMBA_CACHE_DIR") or Path.home() / ".cache" / "modlhmp")
    version = digest.hexdigest()[:12]
    return base if base.name == version else base / version  # a child process inherits the folder


os.environ["NUMBA_CACHE_DIR"] = str(_kernel_cache())
