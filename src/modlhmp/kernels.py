"""Compiled functions: each is compiled once per machine and version of its sources, then loaded where it is needed.

Numba's own cache looks at a kernel's file only: after an edit of a function that it calls, or of a constant that it was
compiled with, it goes on with the old machine code. It also lets two jobs that start together compile the same kernel
twice, and one may overwrite an entry of the other's with machine code for other types.

So kernels have a cache of their own, which leaves numba's settings and other packages' functions alone:

* One folder per version of the sources: all modules of this package that define kernels, the module that the kernel
  stands in, and what these import, directly or not, of this package and of the kernel's own (a script: of its folder).
  Imports are read from the text, so a module that is imported by a computed name does not count. Nothing is
  read or made before the first kernel is called.
* It lies in the folder that the environment variable MODLHMP_CACHE_DIR names, else in `modlhmp` of the user's cache
  folder ($XDG_CACHE_HOME or ~/.cache), else, where that may not be written to, in `modlhmp-<user id>` with the
  temporary files. Entries are pickles, and who writes one can run code in whatever process loads it, so a folder is
  used only if it belongs to the user and others may not write to it.
* Without any folder, with sources that changed since the process began, or while another process holds a kernel for
  minutes (it was stopped, perhaps), kernels are compiled without a cache, and a warning says so. A function without a
  source file (typed into an interpreter or notebook) never has one.
"""

import contextlib
import fcntl
import functools
import hashlib
import os
import re
import stat
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache, _CacheLocator
from numba.core.compiler_lock import global_compiler_lock

_STARTED = time.time()
_PACKAGE = Path(__file__).parent
_REMEDY = "set MODLHMP_CACHE_DIR to a folder of yours that nobody else may write to"
# `import a.b as c, d` or `from ..a import (b, c)`, wherever a line begins with it.
_IMPORT = re.compile(
    r"^[ \t]*(?:import[ \t]+([^\n#;]+)|from[ \t]*(\.*)([\w.]*)[ \t]*import\b[ \t]*(\((?:[^)#]|#[^\n]*)*\)|[^\n#;]+))",
    re.MULTILINE,
)
TELL_AFTER_S, WAIT_AT_MOST_S = 10.0, 300.0  # for a kernel that another process compiles, which takes seconds
_POLL_S = 0.02
_warned: list[str] = []


def kernel(function: Callable | None = None, **options) -> Callable:
    """`numba.njit` with a cache, of which one process at a time compiles or loads a function; the others wait for it.

    `options` are those of `numba.njit`, without `cache`.
    """
    if function is None:
        return functools.partial(kernel, **options)
    # C calls no kernel, and a form for it would be up to a fifth of the compiling; numba's types lack the option.
    compiled = njit(no_cfunc_wrapper=True, **options)(function)  # type: ignore[call-overload]
    if compiled is function:  # NUMBA_DISABLE_JIT, for debugging
        return function
    compile_or_load = compiled.compile
    file = os.path.abspath(function.__code__.co_filename)
    spec = getattr(sys.modules.get(function.__module__), "__spec__", None)  # a script has none
    module = spec.name if spec else Path(file).stem

    def one_at_a_time(signature):
        # A kernel waits only for those that it calls, so nobody waits in a circle; threads take numba's own lock first.
        with global_compiler_lock, contextlib.ExitStack() as held:
            compiled._cache = _open_cache(function, file, module, held)
            return compile_or_load(signature)

    compiled.compile = one_at_a_time
    return compiled


def _open_cache(function, file, module, held):
    """The cache of a kernel, locked until `held` is closed; one that keeps nothing where there cannot be any."""
    if not os.path.isfile(file):
        return NullCache()
    try:
        version = _version(file, module)
        folder = version and _folder(version[:12])
        if folder:
            cache = _Cache(function, _Locator(function, file, folder, version))
            lock = os.open(cache.lock, os.O_RDWR | os.O_CREAT, 0o600)
            held.callback(os.close, lock)
            if _take(cache.lock, lock):
                return cache
    except OSError as error:
        _warn(f"{error}: kernels are compiled without a cache; {_REMEDY}")
    return NullCache()


def _take(path, lock):
    """Lock an open file for this process, which then stands in it; False where another one keeps it for too long."""
    began, told = time.monotonic(), False
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            waited = time.monotonic() - began
        else:
            with contextlib.suppress(OSError):  # a full disk: then nobody can say who it is
                os.ftruncate(lock, 0)
                os.pwrite(lock, b"%d" % os.getpid(), 0)
            return True
        if waited > WAIT_AT_MOST_S:
            _warn(f"{_holder(path)} for too long: kernels are compiled without the cache")
            return False
        if waited > TELL_AFTER_S and not told:
            told = True
            remedy = "continue or end it if it was stopped"
            warnings.warn(f"{_holder(path)}; waiting for it. {remedy}", RuntimeWarning, stacklevel=2)
        time.sleep(_POLL_S)


def _holder(path):
    """Who has locked a file, as a text that a message begins with."""
    with contextlib.suppress(OSError, ValueError):
        holder, age = int(path.read_text()), time.time() - path.stat().st_mtime
        return f"process {holder} has held {path} for {age:.0f} s"
    return f"a process has held {path}"


class _Cache(FunctionCache):
    """Entries of one kernel. What cannot be read or written is compiled, not an error."""

    def __init__(self, function, locator):
        self._impl_class = functools.partial(_Entries, locator=locator)  # type: ignore[assignment]
        super().__init__(function)
        self.lock = Path(self.cache_path, f"{self._impl.filename_base}.lock")

    def load_overload(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except OSError:
            return None
        except Exception:  # damaged, as by a loss of power: a pickle may end in any error
            with contextlib.suppress(OSError):
                self.flush()  # an index that cannot be read could not be added to
            return None

    def save_overload(self, sig, data):
        try:
            super().save_overload(sig, data)
        except OSError as error:  # a full disk
            _warn(f"{error}: a kernel is compiled without a cache; {_REMEDY}")


class _Entries(CompileResultCacheImpl):
    """Form and names of the entries. Numba's constructor would ask its environment variables for the place."""

    def __init__(self, function, locator):
        self._lineno, self._locator = function.__code__.co_firstlineno, locator
        self._filename_base = self.get_filename_base(f"{function.__module__}.{function.__qualname__}", sys.abiflags)


class _Locator(_CacheLocator):
    """Place and version of a kernel's entries."""

    def __init__(self, function, file, folder, version):
        self._py_file, self._folder, self._version = file, folder, version
        path = hashlib.sha256(os.fsencode(file)).hexdigest()[:8]  # as numba's, entries of two copies are kept apart
        self._disambiguator = f"{path}-{function.__code__.co_firstlineno}"

    def get_cache_path(self):
        return str(self._folder)

    def ensure_cache_path(self):
        """Nothing: the folder was made and looked at when the lock was taken, and is not made anew if it has gone."""

    def get_source_stamp(self):
        return self._version

    def get_disambiguator(self):
        return self._disambiguator


def _folder(version):
    """The folder of a version, made where there is none yet; None where no place is safe and may be written to."""
    problems, unsafe = [], False
    for place in (_named_place, _temporary_place):
        try:
            base, closed_bits = place()
            folder = base / version
            for path, bits in ((base, closed_bits), (folder, 0o077)):
                path.mkdir(0o700, parents=True, exist_ok=True)
                status = path.lstat()
                if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & bits:
                    unsafe = True
                    raise PermissionError(f"{path} is a link, belongs to somebody else or is open to others")
            if not os.access(folder, os.W_OK | os.X_OK):
                raise PermissionError(f"{folder} may not be written to")
        except (OSError, RuntimeError) as error:
            problems.append(str(error))
            continue
        if unsafe:  # that nothing can be written is said only where nothing else helps
            _warn(f"{problems[0]}: compiled kernels are kept in {base} instead; {_REMEDY}")
        return folder
    _warn(f"{'; '.join(problems)}: kernels are compiled without a cache; {_REMEDY}")
    return None


def _warn(message):
    """Say it once per process: one trouble with the cache is every kernel's."""
    if not _warned:
        _warned.append(message)
        warnings.warn(message, RuntimeWarning, stacklevel=2)


def _named_place():
    """Where the user wants compiled kernels, and the mode bits that this folder may not have.

    RuntimeError: there is no home folder.
    """
    named, caches = os.environ.get("MODLHMP_CACHE_DIR"), os.environ.get("XDG_CACHE_HOME", "")
    if not named:
        named = os.path.join(caches if os.path.isabs(caches) else "~/.cache", "modlhmp")
    return Path(os.path.realpath(Path(named).expanduser())), 0o022  # a link of the user's own is one that we may follow


def _temporary_place():
    """Anybody could have made this folder, so nobody else may have any right to it."""
    return Path(tempfile.gettempdir(), f"modlhmp-{os.geteuid()}"), 0o077


def _version(file, module):
    """Digest of the sources that kernels of a file may depend on; None where they are not what the process runs."""
    name, roots = _roots(file, module)
    # The same for all kernels of this package, so that a process reads the sources once.
    digest, sources = _digest(frozenset({name: file, **_kernel_modules()}.items()), frozenset(roots.items()))
    # Machine code of what was imported must not be kept as that of an edit since (the inode's time cannot be set back).
    changed = [source for source in sources if os.stat(source).st_ctime > _STARTED]
    if changed:
        _warn(f"{changed[0]} has changed since this process began: kernels are compiled without a cache; start it anew")
        return None
    return digest


@functools.cache
def _digest(modules, roots):
    """Hexadecimal digest of modules' sources and of what they import, directly or not, and these files.

    `modules` are pairs of name and file, `roots` pairs as of `_roots`. Names in the digest are modules', so copies of
    the same sources have the same one.
    """
    todo, texts, roots = dict(modules), {}, dict(roots)
    while todo:
        name, path = todo.popitem()
        texts[name] = path, Path(path).read_bytes()
        todo.update((n, p) for n, p in _imported(name, *texts[name], roots) if n not in texts)
    digest = hashlib.sha256()
    for name, (_, text) in sorted(texts.items()):
        digest.update(f"{'.'.join(name)} {len(text)}\n".encode() + text)
    return digest.hexdigest(), [path for path, _ in texts.values()]


def _roots(file, module):
    """A module's name, and {first name of modules whose imports are followed: folder that these lie in}.

    A script, or a module outside any package, also uses what lies beside it (first name ""), unless these are
    installed packages: following, say, numpy would take long and find no kernel.
    """
    path, name = Path(file).with_suffix(""), tuple(module.split("."))
    is_package = path.name == "__init__"
    if is_package:
        path = path.parent
    if path.parts[-len(name) :] != name:
        name = (path.name,)
    folder = path.parents[len(name) - 1]
    roots = {name[0]: folder, __package__: _PACKAGE.parent}
    if len(name) == 1 and not is_package and folder.name not in {"site-packages", "dist-packages"}:
        roots[""] = folder
    return name, roots


@functools.cache
def _kernel_modules():
    """{name: file} of this package's modules that define kernels: those that import this module."""
    roots, found = {__package__: _PACKAGE.parent}, {}
    for path in _PACKAGE.rglob("*.py"):
        text = path.read_bytes()
        if b"kernels" in text:
            name = path.relative_to(_PACKAGE.parent).with_suffix("").parts
            name = name[:-1] if name[-1] == "__init__" else name
            if (__package__, "kernels") in dict(_imported(name, path, text, roots)):
                found[name] = str(path)
    return found


def _imported(name, path, text, roots):
    """Yield name and file of each module that a module's text imports and that lies in one of the roots."""
    package = name if Path(path).name == "__init__.py" else name[:-1]
    for plain, dots, origin, names in _IMPORT.findall(text.decode(errors="replace").replace("\\\n", " ")):
        wanted = []
        for words in re.sub(r"#[^\n]*|[()]", "", plain or names).split(","):
            first = (words.split() or [""])[0]
            if plain:
                parts = tuple(first.split("."))
                wanted += [parts[: n + 1] for n in range(len(parts))]
            else:
                above = package[: len(package) + 1 - len(dots)] if dots else ()
                parts = (*above, *filter(None, origin.split(".")))
                wanted.append((*parts, first) if _find((*parts, first), roots) else parts)
        for parts in wanted:
            file = _find(parts, roots)
            if file:
                yield parts, file


def _find(name, roots):
    """The file of a module (its name as a tuple) in one of the roots, or None."""
    root = name and roots.get(name[0], roots.get(""))
    return _file(f"{root}/{'/'.join(name)}") if root else None


@functools.cache
def _file(stem):
    """The file of the module at a path, or None."""
    return next(filter(os.path.isfile, (f"{stem}/__init__.py", f"{stem}.py")), None)
