"""Maps of dynamics and long-term human motion prediction.

Data flow one way: readers -> cleaning -> maps -> forecasting -> scoring -> paper.
"""

import contextlib
import hashlib
import os
import re
import tempfile
from pathlib import Path

__version__ = "0.1.0"


def _kernel_cache():
    """Where compiled kernels are kept: a folder a version of their sources and of the modules that these name.

    Numba looks at a kernel's own file only, so after an edit of a function that it calls, or of a constant that it was
    compiled with, it would go on with the old machine code. Where the folder named, or the home folder, cannot be
    written to, it lies with the temporary files.
    """
    package, digest = Path(__file__).parent, hashlib.sha256()
    sources = {file: file.read_bytes() for file in sorted(package.rglob("*.py"))}
    used = {file for file, source in sources.items() if b"@kernel" in source}
    for file in list(used):
        for name in re.findall(rb"^from modlhmp\.([\w.]+) import", sources[file], re.MULTILINE):
            used.add(package.joinpath(*name.decode().split(".")).with_suffix(".py"))
    for file in sorted(used & sources.keys()):
        digest.update(sources[file])
    version, temporary = digest.hexdigest()[:12], Path(tempfile.gettempdir(), f"modlhmp-{os.getuid()}")
    for base in (Path(os.environ.get("NUMBA_CACHE_DIR") or "~/.cache/modlhmp").expanduser(), temporary):
        folder = base if base.name == version else base / version  # a child process inherits the folder
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
    raise OSError(f"compiled kernels can be kept neither in {folder} nor elsewhere: set NUMBA_CACHE_DIR to a folder")


os.environ["NUMBA_CACHE_DIR"] = str(_kernel_cache())
