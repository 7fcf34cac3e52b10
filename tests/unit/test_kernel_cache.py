"""Where compiled kernels are kept: a folder of their own for every version of their sources, which only we may use.

Versions and folders are asked of a copy of `kernels.py` in this process; what compiles runs in processes of its own, in
a package of a few lines around such a copy.
"""

import fcntl
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import pytest

import modlhmp

PACKAGE = Path(modlhmp.__file__).parent
SMALL = {
    "modlhmp/values.py": "FACTOR = 2\n",
    "modlhmp/helpers.py": """
from modlhmp.kernels import kernel
from modlhmp.values import FACTOR
@kernel
def helper(x):
    return FACTOR * x
""",
    "modlhmp/calls.py": """
from modlhmp.helpers import helper
from modlhmp.kernels import kernel
@kernel
def call(x):
    return helper(x) + 1
""",
}
CALL = "from modlhmp.calls import call; print(call(3), len(call.stats.cache_misses), call.stats.cache_path)"


def write(folder, files):
    """Write files {path in the folder: text}."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def edit(file, old="", new="# an edit\n"):
    """Change a source file: `old`, which stands in it, into `new`; without it, add a line at the end."""
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new) if old else text + new)


@pytest.fixture
def package(tmp_path):
    """Function (name) -> a copy of the package under this name, where it can be edited."""

    def copy(name="one"):
        folder = tmp_path / name / "modlhmp"
        shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__"))
        return folder

    return copy


@pytest.fixture
def small(tmp_path):
    """A folder with a small package of this one's name, of which two kernels (and a constant) build on each other."""
    write(tmp_path / "small", SMALL)
    for name in ("__init__.py", "kernels.py", "version.py"):
        shutil.copy(PACKAGE / name, tmp_path / "small/modlhmp" / name)
    return tmp_path / "small"


def cache(folder):
    """A fresh `kernels` module, as a new process has it, of the package in a folder."""
    spec = importlib.util.spec_from_file_location("modlhmp.kernels", folder / "kernels.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def version(folder, file=None, module="modlhmp.maps.swgmm"):
    """The version that a kernel in a file (by default one of the package's own) has in a new process."""
    return cache(folder)._version(str(file or folder / "maps/swgmm.py"), module)


def start(folder, base, code, *options):
    """A process that runs code with the packages of a folder, told where to keep kernels (None: nothing)."""
    inherited = {key: value for key, value in os.environ.items() if not key.startswith(("MODLHMP_", "NUMBA_"))}
    told = {} if base is None else {"MODLHMP_CACHE_DIR": str(base)}
    environment = {**inherited, "PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(folder), **told}
    command = [sys.executable, *options, "-c", code]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def run(folder, base, code=CALL, *options):
    """(What such a process prints, as words; what it complains of)."""
    process = start(folder, base, code, *options)
    out, complaints = process.communicate(timeout=300)
    assert process.returncode == 0, complaints
    return out.split(), complaints


# Versions


def test_the_same_sources_have_the_same_version_wherever_they_lie_and_whichever_kernel_asks(package):
    one, two = package("one"), package("two")
    assert version(one) == version(two) == version(one, one / "readers/lines.py", "modlhmp.readers.lines")


@pytest.mark.parametrize("name", ["forecasting/base.py", "maps/swgmm.py", "scoring/uncertainty.py", "kernels.py"])
def test_an_edited_kernel_has_another(package, name):
    """Also one that other kernels only call; taken back, the old machine code is found again."""
    copy = package()
    before, source = version(copy), (copy / name).read_text()
    edit(copy / name)
    assert version(copy) != before
    (copy / name).write_text(source)
    assert version(copy) == before


def test_an_edited_constant_of_kernels_has_another(package):
    """Numba compiles the values of globals in: those that the snippets' kernels import stand in a file without any."""
    copy = package()
    assert "@kernel" not in (copy / "maps/pieces.py").read_text()
    before = version(copy)
    edit(copy / "maps/pieces.py", "SLOW_M_S = 0.3", "SLOW_M_S = 0.4")
    assert version(copy) != before


@pytest.mark.parametrize("name", ["api.py", "study/exhibits/style.py", "networks/lstm.py"])
def test_an_edit_elsewhere_compiles_nothing_again(package, name):
    copy = package()
    before = version(copy)
    edit(copy / name)
    assert version(copy) == before


@pytest.mark.parametrize(
    "line",
    [
        "from modlhmp.more.part import VALUE",
        "from modlhmp.more import part",
        "from . import more",  # whose own text imports it
        "from .more.part import *",
        "from modlhmp.more import (  # (a remark)\n    part as other,\n)",
        "from modlhmp.more \\\n    import part",
        "import modlhmp.more.part",
        "import os, modlhmp.more.part as part",
        "def f():\n    from modlhmp.more.part import VALUE",
    ],
)
def test_every_form_of_import_is_followed(small, line):
    write(small, {"modlhmp/more/__init__.py": "from ..more.part import VALUE\n", "modlhmp/more/part.py": "VALUE = 1\n"})
    edit(small / "modlhmp/values.py", new=line + "\n")
    before = version(small / "modlhmp", small / "modlhmp/calls.py", "modlhmp.calls")
    edit(small / "modlhmp/more/part.py")
    assert version(small / "modlhmp", small / "modlhmp/calls.py", "modlhmp.calls") != before


OUTSIDE = {
    "site-packages/other/__init__.py": "",
    "site-packages/other/sub/__init__.py": "",
    "site-packages/other/sub/kern.py": "from .. import near\nimport far, modlhmp.values, modlhmp.kernels",
    "site-packages/other/near.py": "",
    "site-packages/far.py": "",
    "site-packages/alone.py": "import far\nfrom modlhmp.kernels import kernel",
    "scripts/script.py": "from beside import VALUE\nfrom modlhmp.kernels import kernel",
    "scripts/beside.py": "VALUE = 1",
}


@pytest.mark.parametrize(
    ("file", "module", "edited", "seen"),
    [
        ("site-packages/other/sub/kern.py", "other.sub.kern", "site-packages/other/sub/kern.py", True),
        ("site-packages/other/sub/kern.py", "other.sub.kern", "site-packages/other/near.py", True),
        ("site-packages/other/sub/kern.py", "other.sub.kern", "small/modlhmp/values.py", True),
        ("site-packages/other/sub/kern.py", "other.sub.kern", "small/modlhmp/calls.py", True),
        ("site-packages/other/sub/kern.py", "other.sub.kern", "site-packages/far.py", False),
        ("site-packages/alone.py", "alone", "site-packages/alone.py", True),
        ("site-packages/alone.py", "alone", "site-packages/far.py", False),
        ("scripts/script.py", "script", "scripts/beside.py", True),
        ("scripts/script.py", "a name of its own", "scripts/script.py", True),
    ],
)
def test_a_kernel_elsewhere_has_the_version_of_its_own_sources_too(small, tmp_path, file, module, edited, seen):
    """Of its file, of its package, of ours; a script's neighbours count, other installed packages do not."""
    write(tmp_path, OUTSIDE)
    before = version(small / "modlhmp", tmp_path / file, module)
    assert before != version(small / "modlhmp", small / "modlhmp/calls.py", "modlhmp.calls")
    edit(tmp_path / edited)
    assert (version(small / "modlhmp", tmp_path / file, module) != before) == seen


def test_sources_that_changed_after_the_process_began_are_not_kept(small):
    """The process has imported, and compiles, what stood there before."""
    time.sleep(0.05)  # the file system's clock is a little coarse
    module = cache(small / "modlhmp")
    time.sleep(0.05)
    edit(small / "modlhmp/values.py", "2", "3")
    with pytest.warns(RuntimeWarning, match=r"values\.py has changed since"):
        assert module._version(str(small / "modlhmp/calls.py"), "modlhmp.calls") is None


# Folders


@pytest.fixture
def places(tmp_path, monkeypatch):
    """The cache's module, with a home and a temporary folder of this test's; no folder is named."""
    for name in ("home", "tmp"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("MODLHMP_CACHE_DIR", raising=False)
    return cache(PACKAGE)


def mode(path):
    """Permissions of a file or folder."""
    return path.stat().st_mode & 0o777


def be_somebody_else(monkeypatch):
    """From here on, what we make and have made seems to be another user's."""
    other = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: other)


def own_temporary(tmp_path):
    """The folder among the temporary files that is this user's."""
    return tmp_path / f"tmp/modlhmp-{os.geteuid()}"


def test_it_lies_in_the_folder_named_or_the_user_s_cache(places, tmp_path, monkeypatch):
    assert places._folder("v") == tmp_path / "home/.cache/modlhmp/v"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, says the standard
    assert places._folder("v") == tmp_path / "home/.cache/modlhmp/v"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert places._folder("v") == tmp_path / "xdg/modlhmp/v"
    monkeypatch.setenv("MODLHMP_CACHE_DIR", str(tmp_path / "named"))
    assert places._folder("v") == tmp_path / "named/v"
    assert mode(tmp_path / "named/v") == mode(tmp_path / "named") == 0o700


def test_a_link_of_the_user_s_own_is_followed(places, tmp_path, monkeypatch):
    """A cache folder that lies on a larger disk."""
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "disk")
    monkeypatch.setenv("MODLHMP_CACHE_DIR", str(tmp_path / "link"))
    assert places._folder("v") == tmp_path / "disk/v"


@pytest.mark.parametrize("named", ["a file/cache", "/proc/nowhere"])
@pytest.mark.filterwarnings("error")
def test_where_nothing_may_be_written_it_lies_with_the_temporary_files(places, tmp_path, monkeypatch, named):
    """A read-only installation, or a home folder that is none."""
    (tmp_path / "a file").touch()
    monkeypatch.setenv("MODLHMP_CACHE_DIR", str(tmp_path / named))
    assert places._folder("v") == own_temporary(tmp_path) / "v"
    assert mode(own_temporary(tmp_path)) == 0o700


@pytest.mark.parametrize("bits", [0o777, 0o770, 0o1777])
def test_a_folder_that_others_may_write_to_is_not_used(places, tmp_path, monkeypatch, bits):
    monkeypatch.setenv("MODLHMP_CACHE_DIR", str(tmp_path / "named"))
    (tmp_path / "named").mkdir()
    (tmp_path / "named").chmod(bits)
    with pytest.warns(RuntimeWarning, match=r"named is .* set MODLHMP_CACHE_DIR"):
        assert places._folder("v") == own_temporary(tmp_path) / "v"
    assert not list((tmp_path / "named").iterdir())


def test_a_version_s_folder_that_is_open_to_others_is_not_used(places, tmp_path):
    """Its files have whatever mode the process's mask leaves them."""
    places._folder("v").chmod(0o755)
    with pytest.warns(RuntimeWarning, match="open to others"):
        assert places._folder("v") == own_temporary(tmp_path) / "v"


@pytest.mark.parametrize("trap", ["open", "link", "another's"])
def test_a_temporary_folder_that_somebody_else_may_have_made_is_not_used(places, tmp_path, monkeypatch, trap):
    monkeypatch.setenv("MODLHMP_CACHE_DIR", "/proc/nowhere")
    if trap == "another's":
        be_somebody_else(monkeypatch)
        own_temporary(tmp_path).mkdir(0o700)
    elif trap == "link":
        (tmp_path / "theirs").mkdir(0o700)
        own_temporary(tmp_path).symlink_to(tmp_path / "theirs")
    else:
        own_temporary(tmp_path).mkdir(0o755)
    with pytest.warns(RuntimeWarning, match="without a cache; set MODLHMP_CACHE_DIR") as told:
        assert places._folder("v") is None
    assert not list(own_temporary(tmp_path).iterdir())
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # once is enough
        assert places._folder("w") is None
    assert len(told) == 1


def test_a_folder_of_another_owner_is_not_used(places, tmp_path, monkeypatch):
    places._folder("v")
    be_somebody_else(monkeypatch)
    with pytest.warns(RuntimeWarning, match="modlhmp is a link, belongs to somebody else"):
        assert places._folder("v") is None


# Processes


def test_an_import_reads_and_makes_nothing(small, tmp_path):
    """Nor do modules with kernels, before one is called."""
    code = """
import os, sys
before, loaded = dict(os.environ), set(sys.modules)
import modlhmp
print(*sorted(set(sys.modules) - loaded), os.environ == before)
sys.modules.pop("modlhmp")
import modlhmp.calls
print(os.path.exists(os.environ["MODLHMP_CACHE_DIR"]), modlhmp.kernels._kernel_modules.cache_info().currsize)
from numba.core import config
cache = config.CACHE_DIR
modlhmp.calls.call(3)
print(os.path.exists(os.environ["MODLHMP_CACHE_DIR"]), os.environ == before, config.CACHE_DIR == cache)
"""
    assert run(small, tmp_path / "cache", code)[0] == [
        "modlhmp",
        "modlhmp.version",
        "True",
        "False",
        "0",
        "True",
        "True",
        "True",
    ]


@pytest.mark.parametrize("first", ["", "import os; os.environ['NUMBA_CACHE_DIR'] = '/proc/x'; import numba; "])
def test_an_edit_of_what_a_kernel_calls_is_seen_whatever_was_imported_first(small, tmp_path, first):
    (value, misses, folder), _ = run(small, tmp_path, first + CALL)
    assert (value, misses, Path(folder).parent) == ("7", "1", tmp_path)
    edit(small / "modlhmp/values.py", "2", "5")
    assert run(small, tmp_path, first + CALL)[0][:2] == ["16", "1"]
    edit(small / "modlhmp/helpers.py", "FACTOR * x", "FACTOR + x")
    assert run(small, tmp_path, first + CALL)[0][:2] == ["9", "1"]


def test_other_packages_kernels_stay_where_numba_keeps_them(small, tmp_path):
    """And a kernel of ours in another package follows that package's sources."""
    write(small, {
        "other/__init__.py": "", "other/values.py": "VALUE = 10\n",
        "other/theirs.py": "import numba\n@numba.njit(cache=True)\ndef theirs(x):\n    return x\n",
        "other/ours.py": """
from modlhmp.calls import call
from modlhmp.kernels import kernel
from other.values import VALUE
@kernel
def ours(x):
    return call(x) + VALUE
""",
    })  # fmt: skip
    code = """
from other.ours import ours
from other.theirs import theirs
print(ours(3), len(ours.stats.cache_misses), theirs(3), theirs.stats.cache_path, ours.stats.cache_path)
"""
    told, _ = run(small, tmp_path / "cache", code)
    assert told[:4] == ["17", "1", "3", str(small / "other/__pycache__")]
    assert list((small / "other/__pycache__").glob("theirs*.nbi"))
    assert Path(told[4]).parent == tmp_path / "cache"
    edit(small / "other/values.py", "10", "20")
    assert run(small, tmp_path / "cache", code)[0][:2] == ["27", "1"]
    edit(small / "modlhmp/values.py", "2", "3")
    assert run(small, tmp_path / "cache", code)[0][:2] == ["30", "1"]


def test_without_a_folder_kernels_are_compiled_all_the_same(small, tmp_path):
    own = tmp_path / f"modlhmp-{os.geteuid()}"
    own.mkdir(0o777)
    code = f"import tempfile; tempfile.tempdir = {str(tmp_path)!r}; {CALL}; call(3.0)"
    told, complaints = run(small, "/proc/nowhere", code)
    assert told == ["7", "1", "None"]
    assert complaints.count("Warning: ") == complaints.count("set MODLHMP_CACHE_DIR to a folder of yours") == 1
    assert not list(own.iterdir())


def test_a_full_disk_costs_the_entry_only(small, tmp_path):
    code = f"""
import errno, numba.core.caching as caching
def full(*_):
    raise OSError(errno.ENOSPC, "No space left on device")
caching.IndexDataCacheFile.save = full
{CALL}
"""
    told, complaints = run(small, tmp_path, code)
    assert told[:2] == ["7", "1"]
    assert complaints.count("No space left on device") == complaints.count("Warning: ") == 1


@pytest.mark.parametrize(("suffix", "left"), [("nbi", 0), ("nbi", 0.5), ("nbc", 0.5)])
def test_a_damaged_entry_is_compiled_again_and_mended(small, tmp_path, suffix, left):
    run(small, tmp_path)
    entries = list(tmp_path.rglob(f"*.{suffix}"))
    assert entries
    for entry in entries:
        data = entry.read_bytes()
        entry.write_bytes(data[: int(left * len(data))])
    assert run(small, tmp_path)[0][:2] == ["7", "1"]  # a miss
    assert run(small, tmp_path)[0][:2] == ["7", "0"]


def test_a_function_without_a_file_is_compiled_without_a_cache(small, tmp_path):
    code = "from modlhmp.kernels import kernel\n@kernel\ndef f(x): return x\nprint(f(1), f.stats.cache_path)"
    assert run(small, tmp_path / "cache", code) == (["1", "None"], "")


def test_jobs_that_start_together_compile_a_kernel_once(small, tmp_path):
    jobs = [start(small, tmp_path / "cache", CALL) for _ in range(4)]
    compiled = [int(job.communicate(timeout=300)[0].split()[1]) for job in jobs]
    assert sorted(compiled) == [0, 0, 0, 1]  # the others found what that one had compiled


def test_types_that_are_compiled_at_once_do_not_take_each_other_s_place(small, tmp_path):
    """Numba's index of a kernel is read, changed and written again: without a lock the last writer wins."""
    calls = [CALL.replace("call(3)", value) for value in ("call(3)", "call(3.0)", "call(True)")]
    jobs = [start(small, tmp_path / "cache", code) for code in calls]
    assert [job.communicate(timeout=300)[0].split()[1] for job in jobs] == ["1", "1", "1"]
    again = [start(small, tmp_path / "cache", code) for code in calls]
    assert [job.communicate(timeout=300)[0].split()[1] for job in again] == ["0", "0", "0"]


@pytest.fixture
def stopped(tmp_path):
    """A kernel's lock that a process holds which was stopped, and that process."""
    path = tmp_path / "call.lock"
    code = (
        "import os, signal, sys; from pathlib import Path; from modlhmp import kernels\n"
        "lock = os.open(sys.argv[1], os.O_RDWR | os.O_CREAT); kernels._take(Path(sys.argv[1]), lock)\n"
        "os.kill(os.getpid(), signal.SIGSTOP)"
    )
    command = [sys.executable, "-c", code, str(path)]
    process = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(PACKAGE.parent)})
    while not (path.exists() and path.read_text() and Path(f"/proc/{process.pid}/stat").read_text().split()[2] == "T"):
        time.sleep(0.01)
    yield path, process
    process.kill()
    process.wait()


def test_a_stopped_process_is_named_and_then_not_waited_for(stopped, monkeypatch):
    path, process = stopped
    module = cache(PACKAGE)
    monkeypatch.setattr(module, "TELL_AFTER_S", 0.2)
    monkeypatch.setattr(module, "WAIT_AT_MOST_S", 0.6)
    lock = os.open(path, os.O_RDWR)
    with pytest.warns(RuntimeWarning) as told:
        assert not module._take(path, lock)
    waits, ends = (str(one.message) for one in told)
    assert re.search(rf"process {process.pid} has held .*call\.lock for \d+ s; waiting for it", waits)
    assert re.search(rf"process {process.pid} has held .* for too long: kernels are compiled without the cache", ends)
    process.kill()
    process.wait()
    assert module._take(path, lock)
    assert path.read_text() == str(os.getpid())
    os.close(lock)


def test_a_kernel_that_another_process_keeps_is_compiled_all_the_same(small, tmp_path):
    told, _ = run(small, tmp_path / "cache")
    locks = [open(path) for path in Path(told[2]).glob("*.lock")]  # noqa: SIM115 - held until the end
    assert len(locks) == 2
    for lock in locks:
        fcntl.flock(lock, fcntl.LOCK_EX)
    code = f"from modlhmp import kernels; kernels.WAIT_AT_MOST_S = 0.1; {CALL}"
    told, complaints = run(small, tmp_path / "cache", code)
    assert told == ["7", "1", "None"]
    assert complaints.count("Warning: ") == complaints.count("has held") == 1
    for lock in locks:
        lock.close()


def test_debugging_without_compilation_works(small, tmp_path):
    code = "import os; os.environ['NUMBA_DISABLE_JIT'] = '1'; from modlhmp.calls import call; print(call(3))"
    assert run(small, tmp_path / "cache", code)[0] == ["7"]
