"""Compiled functions: each is compiled once a machine and version of its sources, then loaded by whoever needs it.

Numba's cache alone lets two jobs that start together compile the same kernel twice, and one may overwrite an entry of
the other's with machine code for other types.
"""

import fcntl
import functools
import os
from pathlib import Path

from numba import njit
from numba.core.compiler_lock import global_compiler_lock


def kernel(function=None, **options):
    """`numba.njit(cache=True)`, of which one process at a time compiles or loads a function; the others wait for it."""
    if function is None:
        return functools.partial(kernel, **options)
    compiled = njit(cache=True, **options)(function)
    compile_or_load = compiled.compile
    lock = Path(os.environ["NUMBA_CACHE_DIR"], f"{function.__module__}.{function.__qualname__}.lock")

    def one_at_a_time(signature):
        # A kernel waits only for those that it calls, so nobody waits in a circle; threads take numba's own lock first.
        with global_compiler_lock, open(lock, "w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            return compile_or_load(signature)

    compiled.compile = one_at_a_time
    return compiled
